//! The picture on the device, and its way back.

use std::sync::Arc;

use rayon::prelude::*;
use vacua_render::Frame;

use crate::error::GpuError;
use crate::vulkan::{Buffer, Device, Place, Recorder};

/// Buffers of one picture: colour, depth, samples.
pub(crate) struct Picture {
    pub width: usize,
    pub height: usize,
    pub rgba: Buffer,
    pub depth: Buffer,
    pub samples: Buffer,
    /// All three on the host, one after the other.
    download: Buffer,
}

impl Picture {
    pub fn new(device: &Arc<Device>, width: usize, height: usize) -> Result<Self, GpuError> {
        let pixels = (width * height) as u64;
        let on_device =
            |bytes: u64| Buffer::new(device, "the picture", bytes * pixels, Place::Device);
        Ok(Self {
            width,
            height,
            rgba: on_device(16)?,
            depth: on_device(4)?,
            samples: on_device(4)?,
            download: Buffer::new(device, "the picture", 24 * pixels, Place::Download)?,
        })
    }

    fn pixels(&self) -> u64 {
        (self.width * self.height) as u64
    }

    /// Has the picture sent to the host.
    pub fn send(&self, recorder: &Recorder<'_>) {
        let n = self.pixels();
        recorder.copy(&self.rgba, &self.download, 0, 16 * n);
        recorder.copy(&self.depth, &self.download, 16 * n, 4 * n);
        recorder.copy(&self.samples, &self.download, 20 * n, 4 * n);
    }

    /// What was sent.
    pub fn frame(&self) -> Frame {
        let n = self.width * self.height;
        let bytes = &self.download.bytes()[..24 * n];
        let (rgba, rest) = bytes.split_at(16 * n);
        let (depth, samples) = rest.split_at(4 * n);
        fn copied<T: bytemuck::AnyBitPattern + Send + Sync>(bytes: &[u8]) -> Vec<T> {
            bytemuck::cast_slice::<u8, T>(bytes)
                .par_iter()
                .copied()
                .collect()
        }
        Frame {
            width: self.width,
            height: self.height,
            rgba: copied(rgba),
            depth: copied(depth),
            samples: copied(samples),
        }
    }
}
