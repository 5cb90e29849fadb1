//! Structured grids, and the [`Geometry`] of any dataset: where the points are. Values are fields and live elsewhere.
//!
//! All three kinds number points with x fastest: `x + nx · (y + ny · z)`; cells likewise with one
//! cell fewer a side. *Index space* has point `(i, j, k)` at coordinates `(i, j, k)`.

use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3};

use crate::array::DataArray;
use crate::mesh::UnstructuredMesh;
use crate::scalar::ScalarType;

/// Why numbers do not make a grid.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
pub enum GridError {
    /// A side without a cell.
    #[error("a volume needs at least 2 points along each axis, here they are {0} × {1} × {2}")]
    Flat(usize, usize, usize),
    /// More points than the address space.
    #[error("{0} × {1} × {2} points are more than this machine can address")]
    TooLarge(usize, usize, usize),
    /// Spacing or direction that folds the grid flat, or is not finite.
    #[error("the axes of the grid do not span space: spacing and direction give determinant {0}")]
    Singular(f64),
    /// Coordinates that do not increase.
    #[error(
        "{axis} coordinate {index} is {value}, which does not follow {previous}: rectilinear coordinates must be finite and strictly increasing"
    )]
    NotIncreasing {
        /// `x`, `y` or `z`.
        axis: char,
        /// Which coordinate.
        index: usize,
        /// The coordinate.
        value: f64,
        /// The one before it.
        previous: f64,
    },
    /// Positions that do not fit the dimensions.
    #[error(
        "{points} points need positions of 3 × f32 or f64 for each, got {tuples} × {components} {scalar_type}"
    )]
    Positions {
        /// Points by the dimensions.
        points: usize,
        /// Tuples given.
        tuples: usize,
        /// Components given.
        components: usize,
        /// Type given.
        scalar_type: ScalarType,
    },
}

/// Checks the dimensions that every grid must have and returns the number of points.
fn check_points([nx, ny, nz]: [usize; 3]) -> Result<usize, GridError> {
    if nx < 2 || ny < 2 || nz < 2 {
        return Err(GridError::Flat(nx, ny, nz));
    }
    nx.checked_mul(ny)
        .and_then(|n| n.checked_mul(nz))
        .filter(|&n| n <= isize::MAX as usize / 8)
        .ok_or(GridError::TooLarge(nx, ny, nz))
}

/// Points on a regular lattice, placed in the world by an affine map.
#[derive(Clone, Debug, PartialEq)]
pub struct UniformGrid {
    points: [usize; 3],
    world_from_index: DAffine3,
}

impl UniformGrid {
    /// A grid of `points` a side whose axes are those of the world.
    ///
    /// # Errors
    /// [`GridError`] for fewer than two points a side, too many, or a spacing that is zero or not finite.
    pub fn new(points: [usize; 3], origin: DVec3, spacing: DVec3) -> Result<Self, GridError> {
        Self::with_affine(
            points,
            DAffine3::from_mat3_translation(DMat3::from_diagonal(spacing), origin),
        )
    }

    /// A grid of `points` a side with any invertible placement (rotated, sheared, mirrored).
    ///
    /// # Errors
    /// As [`UniformGrid::new`].
    pub fn with_affine(points: [usize; 3], world_from_index: DAffine3) -> Result<Self, GridError> {
        check_points(points)?;
        let axes = world_from_index.matrix3;
        let volume: f64 = [axes.x_axis, axes.y_axis, axes.z_axis]
            .iter()
            .map(|a| a.length())
            .product();
        let determinant = axes.determinant();
        let spans_space = determinant.abs() > 1e-9 * volume;
        if !world_from_index.is_finite() || !spans_space {
            return Err(GridError::Singular(determinant));
        }
        Ok(Self {
            points,
            world_from_index,
        })
    }

    /// Points a side.
    pub fn points(&self) -> [usize; 3] {
        self.points
    }

    /// Maps index space to world space.
    pub fn world_from_index(&self) -> DAffine3 {
        self.world_from_index
    }

    /// Distance between neighbouring points along each index axis, in world units.
    pub fn spacing(&self) -> DVec3 {
        let axes = self.world_from_index.matrix3;
        DVec3::new(
            axes.x_axis.length(),
            axes.y_axis.length(),
            axes.z_axis.length(),
        )
    }
}

/// Points on axis-aligned planes at given coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct RectilinearGrid {
    coordinates: [Arc<[f64]>; 3],
}

impl RectilinearGrid {
    /// A grid from the coordinates of its planes in x, y and z, in world units.
    ///
    /// # Errors
    /// [`GridError`] for fewer than two planes a side or coordinates that do not strictly increase.
    pub fn new(x: Vec<f64>, y: Vec<f64>, z: Vec<f64>) -> Result<Self, GridError> {
        check_points([x.len(), y.len(), z.len()])?;
        for (axis, coordinates) in ['x', 'y', 'z'].into_iter().zip([&x, &y, &z]) {
            for (i, pair) in coordinates.windows(2).enumerate() {
                let increasing = pair[0] < pair[1] && pair[0].is_finite() && pair[1].is_finite();
                if !increasing {
                    return Err(GridError::NotIncreasing {
                        axis,
                        index: i + 1,
                        value: pair[1],
                        previous: pair[0],
                    });
                }
            }
        }
        Ok(Self {
            coordinates: [x.into(), y.into(), z.into()],
        })
    }

    /// Points a side.
    pub fn points(&self) -> [usize; 3] {
        [0, 1, 2].map(|axis| self.coordinates[axis].len())
    }

    /// Coordinates of the planes along one axis (0, 1, 2), in world units.
    pub fn coordinates(&self, axis: usize) -> &[f64] {
        &self.coordinates[axis]
    }
}

/// Points anywhere, connected as a lattice: cells are hexahedra with possibly curved faces.
#[derive(Clone, Debug)]
pub struct CurvilinearGrid {
    points: [usize; 3],
    positions: DataArray,
}

impl CurvilinearGrid {
    /// A grid from its dimensions and one position (x, y, z; f32 or f64; world units) a point.
    ///
    /// # Errors
    /// [`GridError`] if dimensions and positions disagree.
    pub fn new(points: [usize; 3], positions: DataArray) -> Result<Self, GridError> {
        let expected = check_points(points)?;
        let float = matches!(positions.scalar_type(), ScalarType::F32 | ScalarType::F64);
        if !float || positions.components() != 3 || positions.tuples() != expected {
            return Err(GridError::Positions {
                points: expected,
                tuples: positions.tuples(),
                components: positions.components(),
                scalar_type: positions.scalar_type(),
            });
        }
        Ok(Self { points, positions })
    }

    /// Points a side.
    pub fn points(&self) -> [usize; 3] {
        self.points
    }

    /// One position a point.
    pub fn positions(&self) -> &DataArray {
        &self.positions
    }

    /// Position of one point in the world.
    pub fn position(&self, point: usize) -> DVec3 {
        DVec3::new(
            self.positions.get_f64(point, 0),
            self.positions.get_f64(point, 1),
            self.positions.get_f64(point, 2),
        )
    }
}

/// An axis-aligned box in world space, `lo <= hi` by component.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Lower corner.
    pub lo: DVec3,
    /// Upper corner.
    pub hi: DVec3,
}

impl Bounds {
    /// The box around points; `None` without any finite point. Points that are not finite are left out.
    pub fn of_points(points: impl IntoIterator<Item = DVec3>) -> Option<Self> {
        points
            .into_iter()
            .filter(|p| p.is_finite())
            .fold(None, |bounds: Option<Self>, p| {
                Some(bounds.map_or(Self { lo: p, hi: p }, |b| Self {
                    lo: b.lo.min(p),
                    hi: b.hi.max(p),
                }))
            })
    }

    /// The centre.
    pub fn center(&self) -> DVec3 {
        0.5 * (self.lo + self.hi)
    }

    /// Length of the sides.
    pub fn size(&self) -> DVec3 {
        self.hi - self.lo
    }

    /// Length of the space diagonal.
    pub fn diagonal(&self) -> f64 {
        self.size().length()
    }
}

/// Where the points and cells of a dataset are.
#[derive(Clone, Debug)]
pub enum Geometry {
    /// A regular lattice.
    Uniform(UniformGrid),
    /// Axis-aligned planes.
    Rectilinear(RectilinearGrid),
    /// A bent lattice.
    Curvilinear(CurvilinearGrid),
    /// Cells in any mix, joined in any way.
    Unstructured(UnstructuredMesh),
}

impl Geometry {
    /// The word `info` prints: `uniform`, `rectilinear`, `curvilinear`, `unstructured`.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Uniform(_) => "uniform",
            Self::Rectilinear(_) => "rectilinear",
            Self::Curvilinear(_) => "curvilinear",
            Self::Unstructured(_) => "unstructured",
        }
    }

    /// Points a side of a grid; all points in one row for a mesh, which has no sides.
    pub fn points(&self) -> [usize; 3] {
        match self {
            Self::Uniform(grid) => grid.points(),
            Self::Rectilinear(grid) => grid.points(),
            Self::Curvilinear(grid) => grid.points(),
            Self::Unstructured(mesh) => [mesh.num_points(), 1, 1],
        }
    }

    /// Points a side; `None` for a mesh.
    pub fn dimensions(&self) -> Option<[usize; 3]> {
        (!matches!(self, Self::Unstructured(_))).then(|| self.points())
    }

    /// The mesh, if this is one.
    pub fn mesh(&self) -> Option<&UnstructuredMesh> {
        match self {
            Self::Unstructured(mesh) => Some(mesh),
            _ => None,
        }
    }

    /// Number of points.
    pub fn num_points(&self) -> usize {
        self.points().iter().product()
    }

    /// Number of cells.
    pub fn num_cells(&self) -> usize {
        match self {
            Self::Unstructured(mesh) => mesh.num_cells(),
            _ => self.points().iter().map(|n| n - 1).product(),
        }
    }

    /// The world box from the first to the last point, after orientation; around all points of a
    /// mesh, whether a cell uses them or not.
    pub fn bounds(&self) -> Bounds {
        let none = Bounds {
            lo: DVec3::ZERO,
            hi: DVec3::ZERO,
        };
        match self {
            Self::Uniform(grid) => {
                let last = grid.points().map(|n| (n - 1) as f64);
                let corners = (0..8).map(|corner| {
                    let pick = |axis: usize| {
                        if corner >> axis & 1 == 1 {
                            last[axis]
                        } else {
                            0.0
                        }
                    };
                    grid.world_from_index()
                        .transform_point3(DVec3::new(pick(0), pick(1), pick(2)))
                });
                Bounds::of_points(corners).unwrap_or(none)
            }
            Self::Rectilinear(grid) => {
                let ends = [0, 1, 2].map(|axis| {
                    let c = grid.coordinates(axis);
                    (c[0], c[c.len() - 1])
                });
                Bounds {
                    lo: DVec3::new(ends[0].0, ends[1].0, ends[2].0),
                    hi: DVec3::new(ends[0].1, ends[1].1, ends[2].1),
                }
            }
            Self::Curvilinear(grid) => {
                Bounds::of_points((0..self.num_points()).map(|i| grid.position(i))).unwrap_or(none)
            }
            Self::Unstructured(mesh) => mesh.bounds().unwrap_or(none),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_follow_orientation() {
        let flip = DAffine3::from_mat3_translation(
            DMat3::from_diagonal(DVec3::new(-2.0, 1.0, 1.0)),
            DVec3::new(10.0, 0.0, 0.0),
        );
        let grid = UniformGrid::with_affine([6, 3, 2], flip).expect("invertible");
        let bounds = Geometry::Uniform(grid).bounds();
        assert_eq!(bounds.lo, DVec3::new(0.0, 0.0, 0.0));
        assert_eq!(bounds.hi, DVec3::new(10.0, 2.0, 1.0));
    }

    #[test]
    fn impossible_grids_are_refused() {
        let unit = DVec3::ONE;
        assert!(matches!(
            UniformGrid::new([1, 5, 5], unit, unit),
            Err(GridError::Flat(1, 5, 5))
        ));
        assert!(matches!(
            UniformGrid::new([usize::MAX, 2, 2], unit, unit),
            Err(GridError::TooLarge(..))
        ));
        let flat = DVec3::new(1.0, 0.0, 1.0);
        assert!(matches!(
            UniformGrid::new([5, 5, 5], unit, flat),
            Err(GridError::Singular(_))
        ));
        let nan = vec![0.0, f64::NAN];
        let good = vec![0.0, 1.0];
        assert!(RectilinearGrid::new(good.clone(), nan, good.clone()).is_err());
        assert!(RectilinearGrid::new(good.clone(), good.clone(), vec![1.0, 1.0]).is_err());
    }
}
