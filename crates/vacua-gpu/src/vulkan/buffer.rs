//! Buffers: plain memory that shaders reach through its address.

use std::sync::Arc;

use ash::vk;

use super::{Device, Named};
use crate::error::GpuError;

/// Where a buffer's memory lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Place {
    /// On the device.
    Device,
    /// On the host, written by it.
    Upload,
    /// On the host, read by it: cached.
    Download,
    /// On the device if the host can write there, else on the host: small tables.
    Shared,
}

impl Place {
    fn wishes(self) -> &'static [vk::MemoryPropertyFlags] {
        const LOCAL: vk::MemoryPropertyFlags = vk::MemoryPropertyFlags::DEVICE_LOCAL;
        const ANY: vk::MemoryPropertyFlags = vk::MemoryPropertyFlags::empty();
        const SHARED: vk::MemoryPropertyFlags = vk::MemoryPropertyFlags::from_raw(
            vk::MemoryPropertyFlags::HOST_VISIBLE.as_raw()
                | vk::MemoryPropertyFlags::HOST_COHERENT.as_raw(),
        );
        const CACHED: vk::MemoryPropertyFlags = vk::MemoryPropertyFlags::from_raw(
            SHARED.as_raw() | vk::MemoryPropertyFlags::HOST_CACHED.as_raw(),
        );
        const BOTH: vk::MemoryPropertyFlags =
            vk::MemoryPropertyFlags::from_raw(SHARED.as_raw() | LOCAL.as_raw());
        match self {
            Self::Device => &[LOCAL, ANY],
            Self::Upload => &[SHARED],
            Self::Download => &[CACHED, SHARED],
            Self::Shared => &[BOTH, SHARED],
        }
    }
}

/// A buffer with memory of its own.
pub(crate) struct Buffer {
    device: Arc<Device>,
    raw: vk::Buffer,
    memory: vk::DeviceMemory,
    size_bytes: u64,
    address: u64,
    /// Where the host sees it.
    mapped: *mut u8,
}

// SAFETY: the mapping is plain memory that only `&mut self` writes through.
unsafe impl Send for Buffer {}
// SAFETY: as above; a shared reference only reads.
unsafe impl Sync for Buffer {}

impl Buffer {
    /// A buffer of at least one byte; its contents are undefined.
    pub fn new(
        device: &Arc<Device>,
        what: &'static str,
        size_bytes: u64,
        place: Place,
    ) -> Result<Self, GpuError> {
        let size_bytes = size_bytes.max(16).next_multiple_of(16);
        let create = vk::BufferCreateInfo::default()
            .size(size_bytes)
            .usage(device.buffer_usage());
        let name = device.name();
        // SAFETY: the size is positive, the usage is what the device was opened for.
        let raw =
            unsafe { device.raw().create_buffer(&create, None) }.named("making a buffer", name)?;
        let mut buffer = Self {
            device: device.clone(),
            raw,
            memory: vk::DeviceMemory::null(),
            size_bytes,
            address: 0,
            mapped: std::ptr::null_mut(),
        };
        // SAFETY: the buffer was just made.
        let needs = unsafe { device.raw().get_buffer_memory_requirements(raw) };
        let (memory, _) = device.allocate(what, needs, place.wishes(), true)?;
        buffer.memory = memory;
        // SAFETY: memory of the size and kind that the buffer asked for, used for nothing else.
        unsafe { device.raw().bind_buffer_memory(raw, memory, 0) }.named("binding memory", name)?;
        if place != Place::Device {
            let flags = vk::MemoryMapFlags::empty();
            // SAFETY: the memory is visible to the host and not mapped yet.
            let mapped = unsafe { device.raw().map_memory(memory, 0, vk::WHOLE_SIZE, flags) }
                .named("mapping memory", name)?;
            buffer.mapped = mapped.cast();
        }
        let info = vk::BufferDeviceAddressInfo::default().buffer(raw);
        // SAFETY: the buffer has memory and was made for addresses.
        buffer.address = unsafe { device.raw().get_buffer_device_address(&info) };
        Ok(buffer)
    }

    pub fn raw(&self) -> vk::Buffer {
        self.raw
    }

    /// Where shaders find it.
    pub fn address(&self) -> u64 {
        self.address
    }

    /// Bytes it holds.
    pub fn size_bytes(&self) -> u64 {
        self.size_bytes
    }

    /// What the host sees; empty for buffers on the device.
    pub fn bytes(&self) -> &[u8] {
        if self.mapped.is_null() {
            return &[];
        }
        // SAFETY: mapped for its whole size; the device writes only during `Device::run`, which
        // returns when it is done.
        unsafe { std::slice::from_raw_parts(self.mapped, self.size_bytes as usize) }
    }

    /// What the host sees, to be written; empty for buffers on the device.
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        if self.mapped.is_null() {
            return &mut [];
        }
        // SAFETY: as for `bytes`, and `&mut self` keeps others away.
        unsafe { std::slice::from_raw_parts_mut(self.mapped, self.size_bytes as usize) }
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        // SAFETY: submissions are waited for, so nothing uses the buffer; freeing unmaps.
        unsafe {
            self.device.raw().destroy_buffer(self.raw, None);
            self.device.raw().free_memory(self.memory, None);
        }
    }
}
