//! Compiled shaders that go from run to run: drivers take seconds to compile some, and not all keep them.
//!
//! What a driver hands out is its own affair, and a driver that is given anything else may do anything, so it
//! goes out sealed: behind a checksum, with the header by which Vulkan tells devices and drivers apart, and
//! with what not all drivers put into that. A seal shows damage, not forgery: who can write the user's files
//! can run anything anyway.

use std::hash::Hasher as _;
use std::sync::Arc;

use ash::vk;
use twox_hash::XxHash3_64;

use super::{Device, Named};
use crate::error::GpuError;
use crate::shaders::ALL;

/// How sealed shaders begin; the last byte counts versions of this format.
const MAGIC: [u8; 8] = *b"vacuaSC\x01";

/// What follows: hashes of whom they are for, and of themselves.
const HASHES: usize = 16;

/// What tells compiled shaders of one device and driver from those of others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ShaderKind {
    pub vendor: u32,
    pub device: u32,
    /// What a driver knows its own by; some kept it from version to version.
    pub driver: [u8; vk::UUID_SIZE],
    pub driver_version: u32,
}

impl ShaderKind {
    /// The header of what Vulkan hands out (Vulkan 1.2, §10.7.3).
    fn header(&self) -> [u8; 32] {
        let version = vk::PipelineCacheHeaderVersion::ONE.as_raw() as u32;
        let mut header = [0; 32];
        let words = [32, version, self.vendor, self.device];
        header[..16].copy_from_slice(bytemuck::cast_slice(&words.map(u32::to_le)));
        header[16..].copy_from_slice(&self.driver);
        header
    }

    /// A name of the device's model, of letters, digits and `-`.
    pub fn model(&self) -> String {
        format!("{:04x}-{:04x}", self.vendor, self.device)
    }

    /// A hash of all that shaders depend on: this, the width of pointers, and what they were compiled from.
    fn hash(&self) -> u64 {
        let mut hasher = XxHash3_64::new();
        hasher.write(&self.header());
        hasher.write(&self.driver_version.to_le_bytes());
        hasher.write(&size_of::<usize>().to_le_bytes());
        ALL.iter().for_each(|(_, spirv)| hasher.write(spirv));
        hasher.finish()
    }

    fn hashes(&self, data: &[u8]) -> [u8; HASHES] {
        let both = [self.hash(), XxHash3_64::oneshot(data)];
        let mut bytes = [0; HASHES];
        bytes[..8].copy_from_slice(&both[0].to_le_bytes());
        bytes[8..].copy_from_slice(&both[1].to_le_bytes());
        bytes
    }

    /// Puts a seal on shaders.
    fn seal(&self, data: &[u8]) -> Vec<u8> {
        [&MAGIC[..], &self.hashes(data), data].concat()
    }

    /// What is under a seal; `None` if it is broken, or that of another device or driver, or of other shaders.
    fn unseal<'a>(&self, sealed: &'a [u8]) -> Option<Unsealed<'a>> {
        let (hashes, data) = sealed.strip_prefix(&MAGIC)?.split_at_checked(HASHES)?;
        let is_ours = self.hashes(data) == *hashes && data.starts_with(&self.header());
        is_ours.then_some(Unsealed(data))
    }
}

/// What a driver has handed out, as its seal says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Unsealed<'a>(&'a [u8]);

/// Shaders that a device has compiled.
pub(crate) struct ShaderCache {
    device: Arc<Device>,
    raw: vk::PipelineCache,
}

impl ShaderCache {
    pub fn new(device: &Arc<Device>) -> Result<Self, GpuError> {
        Self::of(device, Unsealed(&[]))
    }

    fn of(device: &Arc<Device>, Unsealed(data): Unsealed<'_>) -> Result<Self, GpuError> {
        let create = vk::PipelineCacheCreateInfo::default().initial_data(data);
        // SAFETY: the data outlives the call, and is empty or came out of a cache of the same device and
        // driver: its seal excludes any other and all damage, though no forgery.
        let raw = unsafe { device.raw().create_pipeline_cache(&create, None) }
            .named("making a pipeline cache", device.name())?;
        Ok(Self {
            device: device.clone(),
            raw,
        })
    }

    pub fn raw(&self) -> vk::PipelineCache {
        self.raw
    }

    /// All of them, sealed.
    pub fn sealed(&self) -> Result<Vec<u8>, GpuError> {
        // SAFETY: the cache is alive.
        let data = unsafe { self.device.raw().get_pipeline_cache_data(self.raw) }
            .named("reading a pipeline cache", self.device.name())?;
        Ok(self.device.info().shaders.seal(&data))
    }

    /// Adds those of an earlier run; whether they were whole, and of this device and driver.
    pub fn add(&mut self, sealed: &[u8]) -> Result<bool, GpuError> {
        let Some(data) = self.device.info().shaders.unseal(sealed) else {
            return Ok(false);
        };
        let earlier = Self::of(&self.device, data)?;
        // SAFETY: both are alive and of this device, and `self` is borrowed by nobody else.
        let merged = unsafe {
            self.device
                .raw()
                .merge_pipeline_caches(self.raw, &[earlier.raw])
        };
        merged.named("filling a pipeline cache", self.device.name())?;
        Ok(true)
    }
}

impl Drop for ShaderCache {
    fn drop(&mut self) {
        // SAFETY: pipelines keep what they need of it.
        unsafe { self.device.raw().destroy_pipeline_cache(self.raw, None) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KIND: ShaderKind = ShaderKind {
        vendor: 0x10de,
        device: 0x2330,
        driver: [7; 16],
        driver_version: 580,
    };

    #[test]
    fn only_what_was_sealed_here_is_taken() {
        let data = [&KIND.header()[..], b"shaders"].concat();
        let sealed = KIND.seal(&data);
        assert_eq!(KIND.unseal(&sealed), Some(Unsealed(&data)));
        for end in 0..sealed.len() {
            assert_eq!(KIND.unseal(&sealed[..end]), None, "cut at {end}");
        }
        for i in 0..sealed.len() {
            let mut damaged = sealed.clone();
            damaged[i] ^= 1;
            assert_eq!(KIND.unseal(&damaged), None, "byte {i}");
        }
        let others = [
            ShaderKind { vendor: 1, ..KIND },
            ShaderKind { device: 1, ..KIND },
            ShaderKind {
                driver: [8; 16],
                ..KIND
            },
            ShaderKind {
                driver_version: 581,
                ..KIND
            },
        ];
        for other in others {
            assert_eq!(other.unseal(&sealed), None);
        }
    }

    #[test]
    fn models_are_names_of_files() {
        assert_eq!(KIND.model(), "10de-2330");
    }
}
