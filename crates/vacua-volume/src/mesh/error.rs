//! Why arrays do not make a mesh.

use super::CellType;
use crate::scalar::ScalarType;

/// Why arrays do not make a mesh.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
pub enum MeshError {
    /// Positions of the wrong shape.
    #[error("positions must be 3 × f32 or f64 a point, got {components} × {scalar_type}")]
    Positions {
        /// Components given.
        components: usize,
        /// Type given.
        scalar_type: ScalarType,
    },
    /// Connectivity that is not one column of 32-bit or 64-bit integers.
    #[error(
        "connectivity must be one column of 32-bit or 64-bit integers, got {components} × {scalar_type}"
    )]
    Connectivity {
        /// Components given.
        components: usize,
        /// Type given.
        scalar_type: ScalarType,
    },
    /// The cells need another number of point indices than there are.
    #[error("{cells} cells need {expected} point indices, the connectivity has {actual}")]
    ConnectivityLength {
        /// Number of cells.
        cells: usize,
        /// Indices that their types need.
        expected: u64,
        /// Indices given.
        actual: u64,
    },
    /// A cell uses a point that does not exist.
    #[error("{} {cell} uses point {index}, but points go from 0 to {}, {points} in all", .cell_type.name(), .points.saturating_sub(1))]
    PointOutOfRange {
        /// Which cell.
        cell: usize,
        /// Its type.
        cell_type: CellType,
        /// The index found, as stored.
        index: i128,
        /// Number of points.
        points: usize,
    },
    /// An offset that contradicts the cell types.
    #[error("offset {position} is {actual}, the cell types before it give {expected}")]
    Offset {
        /// Which offset.
        position: usize,
        /// Value found.
        actual: i128,
        /// Value that the types give.
        expected: u64,
    },
    /// Offsets of the wrong number or type.
    #[error(
        "{cells} cells need {} offsets as one column of 32-bit or 64-bit integers, got {tuples} × {components} {scalar_type}",
        .cells.saturating_add(1)
    )]
    Offsets {
        /// Number of cells.
        cells: usize,
        /// Tuples given.
        tuples: usize,
        /// Components given.
        components: usize,
        /// Type given.
        scalar_type: ScalarType,
    },
    /// A blanking mask of the wrong length.
    #[error("the blanking mask covers {actual} cells of {expected}")]
    MaskLength {
        /// Cells the mask covers.
        actual: usize,
        /// Cells of the mesh.
        expected: usize,
    },
}
