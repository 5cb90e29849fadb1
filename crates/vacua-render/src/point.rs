//! Values at single points of the world, positions and values in `f64` throughout: what `sample`
//! prints, and an oracle for the samplers that render.
//!
//! The conventions are those of rendering: point data is trilinear in grids and isoparametric in
//! the cells of meshes, cell data constant in a cell; nothing outside the grid, in blanked cells, and
//! in cells with a corner that is not a finite number. Outer faces belong to the grid, give or take the rounding of coordinates.

use glam::{DMat3, DVec3};
use vacua_pack::{MeshLocator, interpolate};
use vacua_volume::{Association, Geometry, MAX_CELL_POINTS, RectilinearGrid, UniformGrid, Volume};

use crate::error::RenderError;
use crate::packed::mesh_of;

/// How far outside the grid a point may be, in units of the rounding of its coordinates.
const FACE_TOLERANCE: f64 = 4.0 * f64::EPSILON;

/// Gives the values of a volume at points of the world.
#[derive(Clone, Debug)]
pub struct VolumeSampler {
    volume: Volume,
    locator: Locator,
}

/// What finding cells takes beyond the geometry.
#[derive(Clone, Debug)]
enum Locator {
    /// Maps offsets from point 0 to index space.
    Uniform {
        index_from_offset: DMat3,
    },
    Rectilinear,
    /// For curvilinear grids, too.
    Mesh(Box<MeshLocator>),
}

/// A cell, and where in it, in `[0, 1]` along each of its axes.
type Place = ([usize; 3], DVec3);

impl VolumeSampler {
    /// Prepares a volume, whose values are shared, not copied.
    ///
    /// Cost: nothing but for curvilinear grids and meshes, whose cells are put in a hierarchy.
    ///
    /// # Errors
    /// [`RenderError::NoPositions`] if no point of a curvilinear grid or mesh is anywhere.
    pub fn new(volume: &Volume) -> Result<Self, RenderError> {
        let locator = match (&**volume.geometry(), mesh_of(volume)) {
            (_, Some(mesh)) => {
                if mesh.bounds().is_none() {
                    return Err(RenderError::NoPositions);
                }
                Locator::Mesh(Box::new(MeshLocator::new(&mesh)))
            }
            (Geometry::Uniform(grid), None) => Locator::Uniform {
                index_from_offset: grid.world_from_index().matrix3.inverse(),
            },
            (_, None) => Locator::Rectilinear,
        };
        Ok(Self {
            volume: volume.clone(),
            locator,
        })
    }

    /// The value at a point of the world; `None` where there is none.
    pub fn sample(&self, world: DVec3) -> Option<f64> {
        let place = match (&**self.volume.geometry(), &self.locator) {
            (Geometry::Uniform(grid), Locator::Uniform { index_from_offset }) => {
                in_uniform(grid, index_from_offset, world)
            }
            (Geometry::Rectilinear(grid), _) => in_rectilinear(grid, world),
            (_, Locator::Mesh(cells)) => return self.in_mesh(cells, world),
            _ => unreachable!("the locator was made for the geometry"),
        };
        let (cell, at) = place?;
        let number = self.number(cell);
        if !self.is_seen(number) {
            return None;
        }
        let scalars = self.volume.scalars();
        let value = match self.volume.association() {
            Association::Cell => scalars.get_f64(number, 0),
            Association::Point => {
                let points = corner_points(self.volume.geometry().points(), cell);
                let v = points.map(|p| scalars.get_f64(p, 0));
                if !v.iter().all(|v| v.is_finite()) {
                    return None;
                }
                let lerp = |t: f64, a: f64, b: f64| a + t * (b - a);
                let front = lerp(at.y, lerp(at.x, v[0], v[1]), lerp(at.x, v[2], v[3]));
                let back = lerp(at.y, lerp(at.x, v[4], v[5]), lerp(at.x, v[6], v[7]));
                lerp(at.z, front, back)
            }
        };
        value.is_finite().then_some(value)
    }

    /// The value in the cell of a mesh with the lowest number among those that contain a point.
    fn in_mesh(&self, cells: &MeshLocator, world: DVec3) -> Option<f64> {
        let (cell, weights) = cells.locate(world)?;
        let scalars = self.volume.scalars();
        match self.volume.association() {
            Association::Cell => Some(scalars.get_f64(cell, 0)).filter(|v| v.is_finite()),
            Association::Point => {
                let cell = cells.mesh().cell(cell);
                let mut values = [0.0; MAX_CELL_POINTS];
                for (value, &point) in values.iter_mut().zip(cell.points()) {
                    *value = scalars.get_f64(point as usize, 0);
                }
                interpolate(&weights, &values[..cell.points().len()])
            }
        }
    }

    /// Number of a cell.
    fn number(&self, [x, y, z]: [usize; 3]) -> usize {
        let [nx, ny, _] = self.volume.geometry().points();
        x + (nx - 1) * (y + (ny - 1) * z)
    }

    /// Whether a cell is not blanked.
    fn is_seen(&self, number: usize) -> bool {
        let mask = self.volume.blanked_cells();
        mask.is_none_or(|mask| !mask.is_blank(number))
    }
}

/// Numbers of the points at a cell's corners, x fastest.
fn corner_points([nx, ny, _]: [usize; 3], [x, y, z]: [usize; 3]) -> [usize; 8] {
    let first = x + nx * (y + ny * z);
    let slice = nx * ny;
    [
        0,
        1,
        nx,
        nx + 1,
        slice,
        slice + 1,
        slice + nx,
        slice + nx + 1,
    ]
    .map(|step| first + step)
}

/// The cell of a point of a uniform grid.
fn in_uniform(grid: &UniformGrid, index_from_offset: &DMat3, world: DVec3) -> Option<Place> {
    let origin = grid.world_from_index().translation;
    let index = *index_from_offset * (world - origin);
    let points = grid.points();
    // What rounding each world coordinate by one unit does to the index, and the index's own.
    let coordinates = world.abs().max(origin.abs());
    let rows = index_from_offset.transpose();
    let mut place = ([0; 3], DVec3::ZERO);
    for a in 0..3 {
        let last = (points[a] - 1) as f64;
        let tolerance = FACE_TOLERANCE * (rows.col(a).abs().dot(coordinates) + last);
        if !(index[a] >= -tolerance && index[a] <= last + tolerance) {
            return None;
        }
        let cell = index[a].floor().clamp(0.0, last - 1.0);
        place.0[a] = cell as usize;
        place.1[a] = (index[a] - cell).clamp(0.0, 1.0);
    }
    Some(place)
}

/// The cell of a point of a rectilinear grid.
fn in_rectilinear(grid: &RectilinearGrid, world: DVec3) -> Option<Place> {
    let mut place = ([0; 3], DVec3::ZERO);
    for a in 0..3 {
        let planes = grid.coordinates(a);
        let (first, last) = (planes[0], planes[planes.len() - 1]);
        let tolerance = FACE_TOLERANCE * first.abs().max(last.abs());
        if !(world[a] >= first - tolerance && world[a] <= last + tolerance) {
            return None;
        }
        let cell = planes
            .partition_point(|&p| p <= world[a])
            .saturating_sub(1)
            .min(planes.len() - 2);
        let (lo, hi) = (planes[cell], planes[cell + 1]);
        place.0[a] = cell;
        place.1[a] = ((world[a] - lo) / (hi - lo)).clamp(0.0, 1.0);
    }
    Some(place)
}
