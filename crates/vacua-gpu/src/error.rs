//! Why a GPU cannot render.

use std::sync::Arc;

use ash::vk;
use vacua_pack::reference::ReferenceError;
use vacua_render::RenderError;

/// Why a GPU cannot render.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GpuError {
    /// The system has no Vulkan loader.
    #[error("there is no Vulkan loader on this machine (libvulkan; Debian: libvulkan1)")]
    NoLoader {
        /// What the system says.
        #[source]
        source: ash::LoadingError,
    },
    /// A loader older than Vulkan 1.2.
    #[error("the Vulkan loader is for version {major}.{minor}, 1.2 is needed")]
    OldLoader {
        /// Major version.
        major: u32,
        /// Minor version.
        minor: u32,
    },
    /// No device that can be used.
    #[error("no Vulkan device can be used{}", list(.refused))]
    NoDevice {
        /// Those there are, and why not.
        refused: Vec<String>,
    },
    /// A device number that does not exist.
    #[error("there is no Vulkan device {asked}{}", list(.available))]
    NoSuchDevice {
        /// Number asked for.
        asked: usize,
        /// Those there are.
        available: Vec<String>,
    },
    /// A device that was asked for and cannot render.
    #[error("{device} cannot render: it lacks {missing}")]
    Lacking {
        /// Its name.
        device: String,
        /// What it lacks.
        missing: String,
    },
    /// More memory than there is.
    #[error(
        "{what} needs {needed} bytes on {device}, {available} are free: {} are missing",
        .needed.saturating_sub(*.available)
    )]
    Memory {
        /// What needs it.
        what: &'static str,
        /// Name of the device.
        device: String,
        /// Bytes needed.
        needed: u64,
        /// Bytes free.
        available: u64,
    },
    /// The device stopped working.
    #[error("{device} was lost (reset by its driver, or unplugged)")]
    Lost {
        /// Its name.
        device: String,
    },
    /// Something this renderer does not do.
    #[error("{what} cannot be rendered on {device}; take --device cpu")]
    Unsupported {
        /// What was asked for.
        what: String,
        /// Name of the device.
        device: String,
    },
    /// A level of detail, which is for those who sample a mesh's cells in groups.
    #[error(
        "level of detail `{asked}` on a GPU, which samples exactly; the CPU renders it (--device cpu)"
    )]
    Detail {
        /// What was asked for.
        asked: &'static str,
    },
    /// A mesh that leads out of itself, or whose nodes are no tree.
    #[error(
        "the packed mesh is damaged: a node or an index points out of its sub-mesh, or two nodes have one \
             child"
    )]
    DamagedMesh,
    /// A mesh that another encoding than the packed one cannot hold.
    #[error(transparent)]
    Reference(#[from] ReferenceError),
    /// Any other error of the driver.
    #[error("{operation} failed on {device}")]
    Vulkan {
        /// What was being done.
        operation: &'static str,
        /// Name of the device, or of the loader.
        device: String,
        /// What the driver says.
        #[source]
        source: vk::Result,
    },
    /// The scene or the settings make no sense.
    #[error(transparent)]
    Render(#[from] RenderError),
}

impl From<GpuError> for RenderError {
    fn from(error: GpuError) -> Self {
        match error {
            GpuError::Render(error) => error,
            other => Self::Device(Arc::new(other)),
        }
    }
}

fn list(items: &[String]) -> String {
    if items.is_empty() {
        "; there is none".to_owned()
    } else {
        format!("; there are: {}", items.join("; "))
    }
}
