//! The picture on the device, and its way back.

use std::sync::Arc;

use rayon::prelude::*;
use vacua_render::Frame;

use crate::error::GpuError;
use crate::renderer::Share;
use crate::vulkan::{Buffer, Device, Place, Recorder};

/// Buffers of one picture: colour, depth, samples.
pub(crate) struct Picture {
    pub width: usize,
    /// Rows of this device's part of it.
    pub rows: usize,
    pub rgba: Buffer,
    pub depth: Buffer,
    pub samples: Buffer,
    /// All three on the host, one after the other.
    download: Buffer,
}

impl Picture {
    pub fn new(device: &Arc<Device>, width: usize, rows: usize) -> Result<Self, GpuError> {
        let pixels = (width * rows) as u64;
        let on_device =
            |bytes: u64| Buffer::new(device, "the picture", bytes * pixels, Place::Device);
        Ok(Self {
            width,
            rows,
            rgba: on_device(16)?,
            depth: on_device(4)?,
            samples: on_device(4)?,
            download: Buffer::new(device, "the picture", 24 * pixels, Place::Download)?,
        })
    }

    fn pixels(&self) -> u64 {
        (self.width * self.rows) as u64
    }

    /// Has the picture sent to the host.
    pub fn send(&self, recorder: &Recorder<'_>) {
        let n = self.pixels();
        if n == 0 {
            return;
        }
        recorder.copy(&self.rgba, &self.download, 0, 16 * n);
        recorder.copy(&self.depth, &self.download, 16 * n, 4 * n);
        recorder.copy(&self.samples, &self.download, 20 * n, 4 * n);
    }

    /// Copies what was sent to the rows that it is.
    pub fn copy_into(&self, frame: &mut Frame, share: Share) {
        let n = self.width * self.rows;
        let bytes = &self.download.bytes()[..24 * n];
        let (rgba, rest) = bytes.split_at(16 * n);
        let (depth, samples) = rest.split_at(4 * n);
        let bands: Vec<(usize, usize)> = share.bands(frame.height).collect();
        scatter(
            bytemuck::cast_slice(rgba),
            &mut frame.rgba,
            &bands,
            self.width,
        );
        scatter(
            bytemuck::cast_slice(depth),
            &mut frame.depth,
            &bands,
            self.width,
        );
        scatter(
            bytemuck::cast_slice(samples),
            &mut frame.samples,
            &bands,
            self.width,
        );
    }
}

/// Makes room for a picture: that of an earlier one of its size, or else new memory.
pub(crate) fn make_room(frame: &mut Frame, width: usize, height: usize) {
    let pixels = width * height;
    let lens = [frame.rgba.len(), frame.depth.len(), frame.samples.len()];
    if (frame.width, frame.height) == (width, height) && lens == [pixels; 3] {
        return;
    }
    *frame = Frame {
        width,
        height,
        rgba: vec![[0.0; 4]; pixels],
        depth: vec![0.0; pixels],
        samples: vec![0; pixels],
    };
    touch(&mut frame.rgba);
    touch(&mut frame.depth);
    touch(&mut frame.samples);
}

/// Writes to every page of new memory, which is when the system provides it: on two cores that took
/// five times as long as to copy a picture, and is done while the device renders.
fn touch<T: Copy + Default + Send>(plane: &mut [T]) {
    const PAGE_BYTES: usize = 4096;
    let pages = plane.par_chunks_mut(PAGE_BYTES / size_of::<T>());
    pages
        .with_min_len(256)
        .for_each(|page| page[0] = T::default());
}

/// Copies bands of rows, which lie one after the other, to where they belong.
fn scatter<T: Copy + Send + Sync>(
    from: &[T],
    to: &mut [T],
    bands: &[(usize, usize)],
    width: usize,
) {
    let mut places = Vec::with_capacity(bands.len());
    let (mut from, mut to, mut row) = (from, to, 0);
    for &(first, end) in bands {
        let (_, rest) = to.split_at_mut((first - row) * width);
        let (place, rest) = rest.split_at_mut((end - first) * width);
        let (band, others) = from.split_at(place.len());
        places.push((band, place));
        (from, to, row) = (others, rest, end);
    }
    let places = places.into_par_iter();
    places.for_each(|(band, place)| place.copy_from_slice(band));
}
