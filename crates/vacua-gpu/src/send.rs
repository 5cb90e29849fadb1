//! Parts of meshes, and small things, on their way to the device.

use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;

use crate::error::GpuError;
use crate::vulkan::{Buffer, Commands, Device, Layout, Place};

/// Bytes that are sent at once.
const STAGING_BYTES: u64 = 64 << 20;

/// Bytes past a part that shaders may read: they take five indices where there are four.
const MARGIN: u64 = 16;

/// One section in one or more buffers.
pub(crate) struct Section {
    chunks: Vec<(Range<u64>, Buffer)>,
}

impl Section {
    /// Where the device has a byte of the section.
    pub fn address(&self, byte: u64) -> u64 {
        let chunk = self.chunks.iter().find(|(r, _)| r.contains(&byte));
        chunk.map_or(0, |(range, buffer)| buffer.address() + (byte - range.start))
    }

    pub fn size_bytes(&self) -> u64 {
        self.chunks.iter().map(|(_, b)| b.size_bytes()).sum()
    }

    /// Its buffers.
    pub fn into_buffers(self) -> impl Iterator<Item = Buffer> {
        self.chunks.into_iter().map(|(_, buffer)| buffer)
    }
}

/// Sends sections.
pub(crate) struct Sender<'a> {
    device: &'a Arc<Device>,
    commands: &'a mut Commands,
    layout: &'a Layout,
    staging: Buffer,
    max_bytes: u64,
}

impl<'a> Sender<'a> {
    /// Of parts to a device, none of whose buffers takes more than `max_bytes` unless a part does.
    pub fn new(
        device: &'a Arc<Device>,
        commands: &'a mut Commands,
        layout: &'a Layout,
        max_bytes: u64,
    ) -> Result<Self, GpuError> {
        Ok(Self {
            device,
            commands,
            layout,
            staging: Buffer::new(device, "sending the mesh", STAGING_BYTES, Place::Upload)?,
            max_bytes,
        })
    }

    /// Sends a section; `parts` are the bytes of each sub-mesh, none of which is split. `fill` writes
    /// the bytes from a place on.
    pub fn send(
        &mut self,
        what: &'static str,
        len: u64,
        parts: &[Range<u64>],
        fill: impl Fn(u64, &mut [u8]),
    ) -> Result<Section, GpuError> {
        let mut chunks: Vec<Range<u64>> = Vec::new();
        for part in parts.iter().filter(|p| p.start < p.end) {
            let part = part.start..(part.end + MARGIN).min(len);
            match chunks.last_mut() {
                Some(last)
                    if last.start <= part.start
                        && part.end.max(last.end) - last.start <= self.max_bytes =>
                {
                    last.end = last.end.max(part.end);
                }
                _ => chunks.push(part),
            }
        }
        let mut made = Vec::new();
        for range in chunks {
            let size = range.end - range.start;
            let buffer = Buffer::new(self.device, what, size + MARGIN, Place::Device)?;
            let mut from = 0;
            while from < size {
                let now = (size - from).min(STAGING_BYTES);
                fill(
                    range.start + from,
                    &mut self.staging.bytes_mut()[..now as usize],
                );
                let staging = &self.staging;
                self.commands.run(self.layout, |recorder| {
                    recorder.copy(staging, &buffer, from, now);
                    recorder.barrier();
                    Ok(())
                })?;
                from += now;
            }
            made.push((range, buffer));
        }
        Ok(Section { chunks: made })
    }

    /// Sends bytes as they are.
    pub fn send_bytes(
        &mut self,
        what: &'static str,
        bytes: &[u8],
        parts: &[Range<u64>],
    ) -> Result<Section, GpuError> {
        self.send(what, bytes.len() as u64, parts, |first, to| {
            const CHUNK: usize = 1 << 20;
            let from = &bytes[first as usize..first as usize + to.len()];
            to.par_chunks_mut(CHUNK)
                .zip(from.par_chunks(CHUNK))
                .for_each(|(to, from)| to.copy_from_slice(from));
        })
    }

    /// Sends all of something small as one buffer.
    pub fn send_whole(&mut self, what: &'static str, bytes: &[u8]) -> Result<Buffer, GpuError> {
        let buffer = Buffer::new(self.device, what, bytes.len() as u64, Place::Device)?;
        let mut from = 0;
        while from < bytes.len() {
            let now = (bytes.len() - from).min(STAGING_BYTES as usize);
            self.staging.bytes_mut()[..now].copy_from_slice(&bytes[from..from + now]);
            let staging = &self.staging;
            self.commands.run(self.layout, |recorder| {
                recorder.copy(staging, &buffer, from as u64, now as u64);
                recorder.barrier();
                Ok(())
            })?;
            from += now;
        }
        Ok(buffer)
    }
}

/// A buffer on the device with these bytes, which are sent at once.
pub(crate) fn sent(
    device: &Arc<Device>,
    commands: &mut Commands,
    layout: &Layout,
    what: &'static str,
    bytes: &[u8],
) -> Result<Buffer, GpuError> {
    let size = bytes.len() as u64;
    let buffer = Buffer::new(device, what, size, Place::Device)?;
    let mut staging = Buffer::new(device, what, size, Place::Upload)?;
    staging.bytes_mut()[..bytes.len()].copy_from_slice(bytes);
    commands.run(layout, |recorder| {
        recorder.copy(&staging, &buffer, 0, size);
        recorder.barrier();
        Ok(())
    })?;
    Ok(buffer)
}
