//! A volume on the device: voxels in images of layers, one layer a slice.
//!
//! Slices, not a 3D image: `textureGather` exists for 2D images only, and two gathers fetch the
//! eight corners of a cell exactly as they are stored, at the price of one filtered fetch of a 3D
//! image, whose 8-bit weights would be visible. Integers of 8 and 16 bits stay as they are (signed
//! ones with their top bit flipped); everything else becomes the `f32` that rendering computes with.
//!
//! A volume of more slices than an image may have, or more bytes than an allocation, is split along
//! z. Each image then holds the slices of its cells and one more on either side, for gradients.

use std::sync::Arc;

use ash::vk;
use rayon::prelude::*;
use vacua_render::contract::{RaySpace, SpanMinima};
use vacua_skip::Axis;
use vacua_volume::{
    Association, Scalar, ScalarType, ValueMap, ValueRange, ValueScale, Volume, dispatch_scalar,
};

use crate::error::GpuError;
use crate::send::sent;
use crate::shared::MAX_SLABS;
use crate::vulkan::{Buffer, Commands, Device, Layers, Layout, Place};

/// Least bytes that are sent at once.
const STAGING_BYTES: u64 = 64 << 20;

/// Most of one image, besides what the device says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ImageLimits {
    pub side: u32,
    pub layers: u32,
    pub bytes: u64,
}

/// How voxels lie in an image.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Texels {
    format: vk::Format,
    bytes: u64,
    /// What texels are multiplied by, and what is added then.
    factor: f32,
    offset: f32,
    /// Whether they may be no finite numbers.
    check_finite: bool,
}

impl Texels {
    fn of(scalar_type: ScalarType) -> Self {
        let integers = |format, bytes, factor, offset| Self {
            format,
            bytes,
            factor,
            offset,
            check_finite: false,
        };
        match scalar_type {
            ScalarType::U8 => integers(vk::Format::R8_UNORM, 1, 255.0, 0.0),
            ScalarType::I8 => integers(vk::Format::R8_UNORM, 1, 255.0, -128.0),
            ScalarType::U16 => integers(vk::Format::R16_UNORM, 2, 65535.0, 0.0),
            ScalarType::I16 => integers(vk::Format::R16_UNORM, 2, 65535.0, -32768.0),
            other => Self {
                format: vk::Format::R32_SFLOAT,
                bytes: 4,
                factor: 1.0,
                offset: 0.0,
                check_finite: matches!(other, ScalarType::F32 | ScalarType::F64),
            },
        }
    }
}

/// A volume on the device, and what of it the host keeps.
pub(crate) struct DeviceVolume {
    pub volume: Arc<Volume>,
    pub scale: ValueScale,
    pub space: RaySpace,
    pub map: ValueMap,
    /// Range of the finite values; `None` if there are none.
    pub range: Option<ValueRange>,
    pub images: Vec<Layers>,
    /// Cells that an image holds along z.
    pub slab_cells: u32,
    /// Voxels along x and y.
    pub sides: [u32; 2],
    /// What texels are multiplied by, and what is added then.
    pub texel: [f32; 2],
    pub check_finite: bool,
    /// Planes, search tables and minima of cell sizes; `None` for grids whose cells are alike.
    pub planes: Option<Planes>,
    pub blanked: Option<Buffer>,
}

/// The axes of a rectilinear grid on the device.
pub(crate) struct Planes {
    pub buffer: Buffer,
    /// Where each axis begins.
    pub offsets: [u32; 3],
    /// Bins of the search table a unit.
    pub bins_per_unit: [f32; 3],
}

impl DeviceVolume {
    /// Sends a volume to the device, for transfer functions of one scale.
    pub fn new(
        device: &Arc<Device>,
        commands: &mut Commands,
        layout: &Layout,
        volume: Arc<Volume>,
        scale: ValueScale,
        limits: ImageLimits,
    ) -> Result<Self, GpuError> {
        let unsupported = |what: String| GpuError::Unsupported {
            what,
            device: device.name().to_owned(),
        };
        let geometry = volume.geometry();
        let space = RaySpace::of_planes(geometry)
            .ok_or_else(|| unsupported(format!("a texture of a {} grid", geometry.kind())))?;
        let scalars = volume.scalars();
        let range = scalars.range(0);
        let map = match (scale, range) {
            (ValueScale::Linear, Some(range)) => ValueMap::for_range(scalars.scalar_type(), range),
            _ => ValueMap::IDENTITY,
        };
        let cells = space.axes.each_ref().map(|a| a.cells() as u64);
        let sides = match volume.association() {
            Association::Point => cells.map(|n| n + 1),
            Association::Cell => cells,
        };
        let [nx, ny, nz] = sides;
        if nx.max(ny) > u64::from(limits.side) {
            return Err(unsupported(format!("a slice of {nx} × {ny} voxels")));
        }
        let texels = Texels::of(scalars.scalar_type());
        let Some((max_layers, max_bytes)) = device.image_limits(texels.format) else {
            return Err(unsupported(format!("{} data", scalars.scalar_type())));
        };
        let layer_bytes = nx * ny * texels.bytes;
        let layers =
            u64::from(limits.layers.min(max_layers)).min(limits.bytes.min(max_bytes) / layer_bytes);
        let slab_cells = if nz <= layers {
            cells[2]
        } else {
            layers.saturating_sub(3)
        };
        if slab_cells == 0 || cells[2].div_ceil(slab_cells) > MAX_SLABS as u64 {
            return Err(unsupported(format!(
                "a volume of {nx} × {ny} × {nz} voxels"
            )));
        }
        let slabs: Vec<[u64; 2]> = (0..cells[2].div_ceil(slab_cells))
            .map(|slab| {
                let first = (slab * slab_cells).saturating_sub(1);
                [first, ((slab + 1) * slab_cells + 2).min(nz)]
            })
            .collect();
        let needed = slabs.iter().map(|[a, b]| (b - a) * layer_bytes).sum();
        if needed > device.free_bytes() {
            return Err(device.too_little("the volume", needed));
        }
        let mut images = Vec::new();
        for [first, end] in slabs {
            let size = [nx as u32, ny as u32, (end - first) as u32];
            let image = Layers::new(device, "the volume", size, texels.format)?;
            images.push((image, first, end));
        }
        let sender = Sender {
            volume: &volume,
            map,
            layer: (nx * ny) as usize,
            texels,
        };
        sender.send(device, commands, layout, &images, [nx as u32, ny as u32])?;
        let planes = Planes::of(device, &space)?;
        let blanked = match volume.blanked_cells() {
            Some(mask) => {
                let bytes = bytemuck::cast_slice(mask.words());
                let what = "the mask of blanked cells";
                Some(sent(device, commands, layout, what, bytes)?)
            }
            None => None,
        };
        Ok(Self {
            scale,
            space,
            map,
            range,
            images: images.into_iter().map(|(image, ..)| image).collect(),
            slab_cells: slab_cells as u32,
            sides: [nx as u32, ny as u32],
            texel: [texels.factor, texels.offset],
            check_finite: texels.check_finite,
            planes,
            blanked,
            volume,
        })
    }

    /// Bytes of the voxels on the device.
    pub fn size_bytes(&self) -> u64 {
        self.images.iter().map(Layers::size_bytes).sum()
    }
}

/// Sends voxels.
struct Sender<'a> {
    volume: &'a Volume,
    map: ValueMap,
    /// Voxels in a slice.
    layer: usize,
    texels: Texels,
}

impl Sender<'_> {
    fn send(
        &self,
        device: &Arc<Device>,
        commands: &mut Commands,
        layout: &Layout,
        images: &[(Layers, u64, u64)],
        [width, height]: [u32; 2],
    ) -> Result<(), GpuError> {
        let layer_bytes = self.layer as u64 * self.texels.bytes;
        let at_once = (STAGING_BYTES / layer_bytes).max(1);
        let mut staging = Buffer::new(
            device,
            "sending the volume",
            at_once * layer_bytes,
            Place::Upload,
        )?;
        for (image, first, end) in images {
            commands.run(layout, |recorder| {
                let (from, to) = (
                    vk::ImageLayout::UNDEFINED,
                    vk::ImageLayout::TRANSFER_DST_OPTIMAL,
                );
                recorder.transition(image, from, to);
                Ok(())
            })?;
            for from in (*first..*end).step_by(at_once as usize) {
                let to = (from + at_once).min(*end);
                let voxels = from as usize * self.layer..to as usize * self.layer;
                self.fill(voxels, staging.bytes_mut());
                let region = vk::BufferImageCopy::default()
                    .image_subresource(
                        vk::ImageSubresourceLayers::default()
                            .aspect_mask(vk::ImageAspectFlags::COLOR)
                            .base_array_layer((from - first) as u32)
                            .layer_count((to - from) as u32),
                    )
                    .image_extent(vk::Extent3D {
                        width,
                        height,
                        depth: 1,
                    });
                commands.run(layout, |recorder| {
                    recorder.fill(&staging, image, &[region]);
                    Ok(())
                })?;
            }
            commands.run(layout, |recorder| {
                let (from, to) = (
                    vk::ImageLayout::TRANSFER_DST_OPTIMAL,
                    vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL,
                );
                recorder.transition(image, from, to);
                Ok(())
            })?;
        }
        Ok(())
    }

    /// Writes some voxels as texels.
    fn fill(&self, voxels: std::ops::Range<usize>, to: &mut [u8]) {
        const CHUNK: usize = 1 << 18;
        let scalars = self.volume.scalars();
        let bytes = self.texels.bytes as usize;
        let to = to[..voxels.len() * bytes].par_chunks_mut(CHUNK * bytes);
        let chunks = to.enumerate();
        let source_bytes = scalars.bytes();
        let from = |chunk: usize, len: usize| {
            let first = voxels.start + chunk * CHUNK;
            first..first + len
        };
        match scalars.scalar_type() {
            ScalarType::U8 | ScalarType::U16 => chunks.for_each(|(i, to)| {
                let start = from(i, 0).start * bytes;
                to.copy_from_slice(&source_bytes[start..start + to.len()]);
            }),
            ScalarType::I8 | ScalarType::I16 => chunks.for_each(|(i, to)| {
                let start = from(i, 0).start * bytes;
                to.copy_from_slice(&source_bytes[start..start + to.len()]);
                // Little-endian: the top bit is in the last byte of each.
                for byte in to.iter_mut().skip(bytes - 1).step_by(bytes) {
                    *byte ^= 0x80;
                }
            }),
            other => dispatch_scalar!(other, T => {
                let Some(values) = scalars.as_slice::<T>() else { return };
                chunks.for_each(|(i, to)| {
                    let values = &values[from(i, to.len() / bytes)];
                    for (value, to) in values.iter().zip(to.chunks_exact_mut(4)) {
                        to.copy_from_slice(&self.map.rendered(value.to_f64()).to_le_bytes());
                    }
                });
            }),
        }
    }
}

impl Planes {
    fn of(device: &Arc<Device>, space: &RaySpace) -> Result<Option<Self>, GpuError> {
        if space.axes.iter().all(|a| matches!(a, Axis::Unit { .. })) {
            return Ok(None);
        }
        let mut numbers: Vec<f32> = Vec::new();
        let (mut offsets, mut bins_per_unit) = ([0; 3], [0.0; 3]);
        for (a, axis) in space.axes.iter().enumerate() {
            offsets[a] = numbers.len() as u32;
            let cells = axis.cells();
            let planes: Vec<f32> = (0..=cells).map(|i| axis.plane(i)).collect();
            let num_bins = 4 * cells;
            let width = planes[cells] - planes[0];
            let scale = if width > 0.0 {
                num_bins as f32 / width
            } else {
                0.0
            };
            let bin = |c: f32| (((c - planes[0]) * scale).max(0.0) as usize).min(num_bins - 1);
            numbers.extend(&planes);
            let mut cell = 0;
            for b in 0..num_bins {
                while cell + 1 < cells && bin(planes[cell + 1]) < b {
                    cell += 1;
                }
                numbers.push(f32::from_bits(cell as u32));
            }
            for level in SpanMinima::new(axis, space.finest[a]).levels() {
                numbers.extend(level);
            }
            bins_per_unit[a] = scale;
        }
        let bytes: &[u8] = bytemuck::cast_slice(&numbers);
        // Small, and read through caches: it may stay on the host if it must.
        let size = bytes.len() as u64;
        let mut buffer = Buffer::new(device, "the planes of the grid", size, Place::Upload)?;
        buffer.bytes_mut()[..bytes.len()].copy_from_slice(bytes);
        Ok(Some(Self {
            buffer,
            offsets,
            bins_per_unit,
        }))
    }
}
