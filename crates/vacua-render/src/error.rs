//! Why a picture cannot be made.

use std::error::Error;
use std::sync::Arc;

use vacua_skip::LatticeError;

use crate::camera::CameraError;

/// Why a picture cannot be made.
#[derive(Clone, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// A picture without pixels, or with too many.
    #[error("a picture of {width}×{height} pixels; both sides must be 1 to 65536")]
    Size {
        /// Pixels a row.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// A step that is not positive.
    #[error("a step of {0} cells, it must be positive and finite")]
    Step(f64),
    /// A step so small that rays have more samples than can be counted.
    #[error(
        "a step of {step} cells gives rays of {samples:.0} samples, at most {limit} are possible; take a larger step"
    )]
    StepTooSmall {
        /// The step in cells.
        step: f64,
        /// Samples of the longest ray.
        samples: f64,
        /// The limit.
        limit: u32,
    },
    /// The camera makes no sense.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The grid is too long.
    #[error(transparent)]
    Lattice(#[from] LatticeError),
    /// Points of a curvilinear grid that are nowhere.
    #[error("no point of the grid has a finite position")]
    NoPositions,
    /// A level of detail of what has none.
    #[error(
        "level of detail `{asked}` of a grid; only meshes and curvilinear grids have levels of detail"
    )]
    NoDetail {
        /// What was asked for.
        asked: &'static str,
    },
    /// What renders failed: neither the scene nor the settings are to blame.
    #[error(transparent)]
    Device(Arc<dyn Error + Send + Sync>),
    /// A mesh that cannot be encoded.
    #[error("the mesh cannot be encoded")]
    Encode(#[from] vacua_pack::EncodeError),
    /// A field that cannot be encoded.
    #[error("the field cannot be encoded")]
    Field(#[from] vacua_pack::PackFieldError),
    /// Threads could not be started.
    #[error("cannot start {threads} threads: {reason}")]
    Threads {
        /// How many were asked for.
        threads: usize,
        /// What the system says.
        reason: String,
    },
}
