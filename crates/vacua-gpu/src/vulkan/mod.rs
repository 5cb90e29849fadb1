//! The thin layer over Vulkan: every call into the driver is in here and in the modules that record
//! commands. Objects free themselves; each keeps the device alive.

mod buffer;
mod commands;
mod device;
mod image;
mod instance;
mod pipeline;
mod ray_pipeline;
mod ray_tracing;
mod shader_cache;
mod structure;

pub(crate) use buffer::{Buffer, Place};
pub use commands::Timings;
pub(crate) use commands::{Commands, Recorder};
pub use device::Device;
pub(crate) use image::{Layers, Sampler};
pub use instance::{DeviceChoice, DeviceInfo, DeviceKind, Instance};
pub(crate) use pipeline::{ComputePipeline, Constant, Layout};
pub(crate) use ray_pipeline::{RayPipeline, RayShaders};
pub use structure::Preference;
pub(crate) use structure::{BuildMode, CompactedSize, Shapes, Structure};

use ash::vk;

use crate::error::GpuError;

/// Gives a driver's result a name and a place.
pub(crate) trait Named<T> {
    /// The value, or an error that says what failed on which device.
    fn named(self, operation: &'static str, device: &str) -> Result<T, GpuError>;
}

impl<T> Named<T> for Result<T, vk::Result> {
    fn named(self, operation: &'static str, device: &str) -> Result<T, GpuError> {
        self.map_err(|source| match source {
            vk::Result::ERROR_DEVICE_LOST => GpuError::Lost {
                device: device.to_owned(),
            },
            source => GpuError::Vulkan {
                operation,
                device: device.to_owned(),
                source,
            },
        })
    }
}
