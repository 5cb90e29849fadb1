//! Why a benchmark cannot be run at all; what fails for one cell of a table is said in that cell.

use vacua_skip::LatticeError;
use vacua_synth::SynthError;
use vacua_volume::{DatasetError, TransferFunctionError};

use vacua_render::RenderError;

/// Why a benchmark cannot be run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BenchError {
    /// An option out of its range.
    #[error("{option} is {actual}, it must be {expected}")]
    Option {
        /// Which option.
        option: &'static str,
        /// What was given.
        actual: String,
        /// What it must be.
        expected: &'static str,
    },
    /// A model by a name that is none.
    #[error("no model is called `{asked}`; there are heptane, flower, dns and llnl")]
    Model {
        /// What was asked for.
        asked: String,
    },
    /// A volume larger than the memory that is free.
    #[error(
        "{name} takes {needed_bytes} bytes at {scale} of its size, {available_bytes} are free; take a smaller scale"
    )]
    Memory {
        /// Which volume.
        name: String,
        /// What it takes.
        needed_bytes: u64,
        /// What is free.
        available_bytes: u64,
        /// Part of its full size a side.
        scale: f64,
    },
    /// Threads could not be started.
    #[error("cannot start the threads")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// A volume could not be made.
    #[error(transparent)]
    Synth(#[from] SynthError),
    /// A volume could not be loaded.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// A transfer function could not be made.
    #[error(transparent)]
    TransferFunction(#[from] TransferFunctionError),
    /// Macrocells do not fit the volume.
    #[error(transparent)]
    Lattice(#[from] LatticeError),
    /// There is no GPU, or it cannot render.
    #[error(transparent)]
    Gpu(#[from] vacua_gpu::GpuError),
    /// A picture could not be written.
    #[error(transparent)]
    Io(#[from] vacua_io::IoError),
    /// A mesh could not be encoded.
    #[error(transparent)]
    Encode(#[from] vacua_pack::EncodeError),
    /// A field could not be brought along.
    #[error(transparent)]
    Field(#[from] vacua_pack::PackFieldError),
    /// A mesh does not fit a reference encoding.
    #[error(transparent)]
    Reference(#[from] vacua_pack::reference::ReferenceError),
    /// Parts of a mesh do not fit together.
    #[error(transparent)]
    Mesh(#[from] vacua_volume::MeshError),
    /// An array of a wrong shape.
    #[error(transparent)]
    Array(#[from] vacua_volume::ArrayError),
    /// A camera that sees nothing.
    #[error(transparent)]
    Camera(#[from] vacua_render::CameraError),
    /// A picture could not be made.
    #[error(transparent)]
    Render(#[from] RenderError),
}
