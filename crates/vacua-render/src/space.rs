//! Ray space of a grid: where its cells are boxes between axis-aligned planes.

use glam::{DAffine3, DMat3, DVec3};
use vacua_skip::Axis;
use vacua_volume::{Geometry, RectilinearGrid, UniformGrid};

/// How to get from world space to ray space, and what is there.
#[derive(Clone, Debug)]
pub struct RaySpace {
    /// Maps world space to ray space.
    pub ray_from_world: DAffine3,
    /// Cells along each axis.
    pub axes: [Axis; 3],
    /// Smallest cell along each axis, in ray space.
    pub finest: DVec3,
}

impl RaySpace {
    /// Ray space of a geometry whose cells lie between axis-aligned planes; `None` for others.
    pub fn of_planes(geometry: &Geometry) -> Option<Self> {
        match geometry {
            Geometry::Uniform(grid) => Some(Self::of_uniform(grid)),
            Geometry::Rectilinear(grid) => Some(Self::of_rectilinear(grid)),
            Geometry::Curvilinear(_) | Geometry::Unstructured(_) => None,
        }
    }

    /// Ray space of a uniform grid is index space.
    fn of_uniform(grid: &UniformGrid) -> Self {
        Self {
            ray_from_world: grid.world_from_index().inverse(),
            axes: grid.points().map(|n| Axis::Unit { cells: n - 1 }),
            finest: DVec3::ONE,
        }
    }

    /// Ray space of a rectilinear grid is the world, moved to the grid's middle so that its
    /// coordinates keep their digits in `f32`.
    fn of_rectilinear(grid: &RectilinearGrid) -> Self {
        let bounds = Geometry::Rectilinear(grid.clone()).bounds();
        let middle = bounds.center();
        let planes = |axis: usize| -> Vec<f32> {
            grid.coordinates(axis)
                .iter()
                .map(|c| (c - middle[axis]) as f32)
                .collect()
        };
        let finest = |axis: usize| {
            grid.coordinates(axis)
                .windows(2)
                .map(|pair| pair[1] - pair[0])
                .fold(f64::INFINITY, f64::min)
        };
        Self {
            ray_from_world: DAffine3::from_mat3_translation(DMat3::IDENTITY, -middle),
            axes: [0, 1, 2].map(|axis| Axis::planes(planes(axis))),
            finest: DVec3::new(finest(0), finest(1), finest(2)),
        }
    }
}
