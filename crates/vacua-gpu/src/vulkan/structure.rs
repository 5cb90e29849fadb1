//! Acceleration structures: built on the device, from what lies there.

use std::sync::Arc;

use ash::vk;

use super::{Buffer, Device, Named, Place, Recorder};
use crate::error::GpuError;

/// What a structure is built for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Preference {
    /// Rays that are traced fast (paper A §4.2.3).
    #[default]
    FastTrace,
    /// A build that is fast.
    FastBuild,
}

/// What a structure is built over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Shapes {
    /// Three corners of three numbers each, one after the other.
    Triangles { address: u64, num: u32 },
    /// Triangles of a list of vertices, of three numbers each, by three numbers of 32 bits each.
    Faces {
        vertices: u64,
        num_vertices: u32,
        indices: u64,
        num: u32,
    },
    /// Two corners of three numbers each.
    Boxes { address: u64, num: u32 },
    /// One structure, placed as it is; the address of its description.
    Instance { address: u64 },
}

impl Shapes {
    fn num(self) -> u32 {
        match self {
            Self::Triangles { num, .. } | Self::Faces { num, .. } | Self::Boxes { num, .. } => num,
            Self::Instance { .. } => 1,
        }
    }

    fn kind(self) -> vk::AccelerationStructureTypeKHR {
        match self {
            Self::Instance { .. } => vk::AccelerationStructureTypeKHR::TOP_LEVEL,
            _ => vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL,
        }
    }

    fn geometry(self) -> vk::AccelerationStructureGeometryKHR<'static> {
        let at = |device_address| vk::DeviceOrHostAddressConstKHR { device_address };
        let geometry =
            vk::AccelerationStructureGeometryKHR::default().flags(vk::GeometryFlagsKHR::OPAQUE);
        match self {
            Self::Triangles { address, num } => {
                let triangles = vk::AccelerationStructureGeometryTrianglesDataKHR::default()
                    .vertex_format(vk::Format::R32G32B32_SFLOAT)
                    .vertex_data(at(address))
                    .vertex_stride(12)
                    .max_vertex((3 * num).saturating_sub(1))
                    .index_type(vk::IndexType::NONE_KHR);
                geometry
                    .geometry_type(vk::GeometryTypeKHR::TRIANGLES)
                    .geometry(vk::AccelerationStructureGeometryDataKHR { triangles })
            }
            Self::Faces {
                vertices,
                num_vertices,
                indices,
                ..
            } => {
                let triangles = vk::AccelerationStructureGeometryTrianglesDataKHR::default()
                    .vertex_format(vk::Format::R32G32B32_SFLOAT)
                    .vertex_data(at(vertices))
                    .vertex_stride(12)
                    .max_vertex(num_vertices.saturating_sub(1))
                    .index_type(vk::IndexType::UINT32)
                    .index_data(at(indices));
                geometry
                    .geometry_type(vk::GeometryTypeKHR::TRIANGLES)
                    .geometry(vk::AccelerationStructureGeometryDataKHR { triangles })
            }
            Self::Boxes { address, .. } => {
                let aabbs = vk::AccelerationStructureGeometryAabbsDataKHR::default()
                    .data(at(address))
                    .stride(24);
                geometry
                    .geometry_type(vk::GeometryTypeKHR::AABBS)
                    .geometry(vk::AccelerationStructureGeometryDataKHR { aabbs })
            }
            Self::Instance { address } => {
                let instances =
                    vk::AccelerationStructureGeometryInstancesDataKHR::default().data(at(address));
                geometry
                    .geometry_type(vk::GeometryTypeKHR::INSTANCES)
                    .geometry(vk::AccelerationStructureGeometryDataKHR { instances })
            }
        }
    }
}

/// How a structure is built.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(crate) struct BuildMode {
    pub preference: Preference,
    /// Whether it will be copied to where it takes less memory.
    pub compactable: bool,
    /// Whether its shapes may be moved later.
    pub updatable: bool,
}

impl BuildMode {
    fn flags(self) -> vk::BuildAccelerationStructureFlagsKHR {
        let mut flags = match self.preference {
            Preference::FastTrace => vk::BuildAccelerationStructureFlagsKHR::PREFER_FAST_TRACE,
            Preference::FastBuild => vk::BuildAccelerationStructureFlagsKHR::PREFER_FAST_BUILD,
        };
        if self.compactable {
            flags |= vk::BuildAccelerationStructureFlagsKHR::ALLOW_COMPACTION;
        }
        if self.updatable {
            flags |= vk::BuildAccelerationStructureFlagsKHR::ALLOW_UPDATE;
        }
        flags
    }
}

/// An acceleration structure and its memory. Must be built before it is used.
pub(crate) struct Structure {
    device: Arc<Device>,
    raw: vk::AccelerationStructureKHR,
    address: u64,
    /// Its own and that of builds; there until it is destroyed.
    memory: Option<(Buffer, Buffer)>,
    scratch_address: u64,
    size_bytes: u64,
    mode: BuildMode,
}

fn no_ray_tracing(device: &Device) -> GpuError {
    GpuError::Unsupported {
        what: "tracing rays".to_owned(),
        device: device.name().to_owned(),
    }
}

impl Structure {
    /// Memory for a structure over shapes; takes that of an older one over if it suffices.
    pub fn new(
        device: &Arc<Device>,
        shapes: Shapes,
        mode: BuildMode,
        older: Option<Self>,
    ) -> Result<Self, GpuError> {
        let limits = device
            .info()
            .ray_tracing
            .ok_or_else(|| no_ray_tracing(device))?;
        let functions = device
            .ray_functions()
            .ok_or_else(|| no_ray_tracing(device))?;
        if u64::from(shapes.num()) > limits.max_primitives {
            return Err(GpuError::Unsupported {
                what: format!("an acceleration structure over {} shapes", shapes.num()),
                device: device.name().to_owned(),
            });
        }
        let geometry = [shapes.geometry()];
        let info = build_info(shapes, mode, &geometry);
        let mut sizes = vk::AccelerationStructureBuildSizesInfoKHR::default();
        // SAFETY: one geometry, and the most shapes it will have.
        unsafe {
            functions.structures.get_acceleration_structure_build_sizes(
                vk::AccelerationStructureBuildTypeKHR::DEVICE,
                &info,
                &[shapes.num()],
                &mut sizes,
            );
        }
        let alignment = limits.scratch_alignment;
        let scratch_bytes = sizes.build_scratch_size.max(sizes.update_scratch_size) + alignment;
        let size_bytes = sizes.acceleration_structure_size;
        let what = "an acceleration structure";
        let (memory, scratch) = match older.and_then(Self::into_memory) {
            Some((memory, scratch))
                if memory.size_bytes() >= size_bytes && scratch.size_bytes() >= scratch_bytes =>
            {
                (memory, scratch)
            }
            older => {
                drop(older);
                (
                    Buffer::new(device, what, size_bytes, Place::Device)?,
                    Buffer::new(device, what, scratch_bytes, Place::Device)?,
                )
            }
        };
        let scratch_address = scratch.address().next_multiple_of(alignment);
        Self::in_memory(
            device,
            shapes.kind(),
            memory,
            (scratch, scratch_address),
            size_bytes,
            mode,
        )
    }

    fn in_memory(
        device: &Arc<Device>,
        kind: vk::AccelerationStructureTypeKHR,
        memory: Buffer,
        (scratch, scratch_address): (Buffer, u64),
        size_bytes: u64,
        mode: BuildMode,
    ) -> Result<Self, GpuError> {
        let functions = device
            .ray_functions()
            .ok_or_else(|| no_ray_tracing(device))?;
        let create = vk::AccelerationStructureCreateInfoKHR::default()
            .buffer(memory.raw())
            .size(size_bytes)
            .ty(kind);
        // SAFETY: the buffer is large enough and was made for this.
        let raw = unsafe {
            functions
                .structures
                .create_acceleration_structure(&create, None)
        }
        .named("making an acceleration structure", device.name())?;
        let info =
            vk::AccelerationStructureDeviceAddressInfoKHR::default().acceleration_structure(raw);
        // SAFETY: it was just made.
        let address = unsafe {
            functions
                .structures
                .get_acceleration_structure_device_address(&info)
        };
        Ok(Self {
            device: device.clone(),
            raw,
            address,
            memory: Some((memory, scratch)),
            scratch_address,
            size_bytes,
            mode,
        })
    }

    /// An empty one of less memory, for a copy of this.
    pub fn compacted(&self, size_bytes: u64) -> Result<Self, GpuError> {
        let what = "an acceleration structure";
        let memory = Buffer::new(&self.device, what, size_bytes, Place::Device)?;
        let scratch = Buffer::new(&self.device, what, 16, Place::Device)?;
        let address = scratch.address();
        let kind = vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL;
        let mode = self.mode;
        Self::in_memory(
            &self.device,
            kind,
            memory,
            (scratch, address),
            size_bytes,
            mode,
        )
    }

    /// Destroys it and keeps its memory and that of its builds.
    fn into_memory(mut self) -> Option<(Buffer, Buffer)> {
        self.destroy();
        self.memory.take()
    }

    fn destroy(&mut self) {
        if let Some(functions) = self.device.ray_functions() {
            // SAFETY: submissions are waited for, so nothing uses it; null is allowed.
            unsafe {
                functions
                    .structures
                    .destroy_acceleration_structure(self.raw, None);
            }
        }
        self.raw = vk::AccelerationStructureKHR::null();
    }

    pub fn raw(&self) -> vk::AccelerationStructureKHR {
        self.raw
    }

    /// Bytes of the structure itself.
    pub fn size_bytes(&self) -> u64 {
        self.size_bytes
    }

    /// The description of an instance of it, placed as it is: what a structure above is built over.
    pub fn instance(&self) -> [u8; 64] {
        const IDENTITY: [f32; 12] = [
            1.0, 0.0, 0.0, 0.0, //
            0.0, 1.0, 0.0, 0.0, //
            0.0, 0.0, 1.0, 0.0,
        ];
        let mut bytes = [0; 64];
        bytes[..48].copy_from_slice(bytemuck::cast_slice(&IDENTITY));
        // Number 0, seen by all rays; the first shaders of the table, no flags.
        bytes[48..52].copy_from_slice(&0xff00_0000u32.to_le_bytes());
        bytes[56..].copy_from_slice(&self.address.to_le_bytes());
        bytes
    }
}

impl Drop for Structure {
    fn drop(&mut self) {
        self.destroy();
    }
}

fn build_info<'a>(
    shapes: Shapes,
    mode: BuildMode,
    geometry: &'a [vk::AccelerationStructureGeometryKHR<'a>],
) -> vk::AccelerationStructureBuildGeometryInfoKHR<'a> {
    vk::AccelerationStructureBuildGeometryInfoKHR::default()
        .ty(shapes.kind())
        .flags(mode.flags())
        .mode(vk::BuildAccelerationStructureModeKHR::BUILD)
        .geometries(geometry)
}

/// Asks for the bytes that structures would take if they were compacted.
pub(crate) struct CompactedSize {
    device: Arc<Device>,
    queries: vk::QueryPool,
}

impl CompactedSize {
    pub fn new(device: &Arc<Device>) -> Result<Self, GpuError> {
        let create = vk::QueryPoolCreateInfo::default()
            .query_type(vk::QueryType::ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR)
            .query_count(1);
        // SAFETY: only devices with acceleration structures come here.
        let queries = unsafe { device.raw().create_query_pool(&create, None) }
            .named("making a query", device.name())?;
        Ok(Self {
            device: device.clone(),
            queries,
        })
    }

    /// The answer, once the commands have run.
    pub fn bytes(&self) -> Result<u64, GpuError> {
        let mut found = [0u64];
        let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
        // SAFETY: the query was written.
        unsafe {
            self.device
                .raw()
                .get_query_pool_results(self.queries, 0, &mut found, flags)
        }
        .named("reading a query", self.device.name())?;
        Ok(found[0])
    }
}

impl Drop for CompactedSize {
    fn drop(&mut self) {
        // SAFETY: submissions are waited for, so nothing uses it.
        unsafe { self.device.raw().destroy_query_pool(self.queries, None) }
    }
}

impl Recorder<'_> {
    /// Builds a structure, or moves its shapes to where they are now.
    pub fn build(&self, structure: &Structure, shapes: Shapes, is_update: bool) {
        let Some(functions) = structure.device.ray_functions() else {
            return;
        };
        let geometry = [shapes.geometry()];
        let mut info = build_info(shapes, structure.mode, &geometry)
            .dst_acceleration_structure(structure.raw)
            .scratch_data(vk::DeviceOrHostAddressKHR {
                device_address: structure.scratch_address,
            });
        if is_update {
            info = info
                .mode(vk::BuildAccelerationStructureModeKHR::UPDATE)
                .src_acceleration_structure(structure.raw);
        }
        let range =
            [vk::AccelerationStructureBuildRangeInfoKHR::default().primitive_count(shapes.num())];
        // SAFETY: structure and scratch were sized for these shapes; what they are read from lies
        // on the device and was written before a barrier; updates keep number and kind.
        unsafe {
            functions.structures.cmd_build_acceleration_structures(
                self.raw_commands(),
                &[info],
                &[&range],
            );
        }
    }

    /// Asks how many bytes a structure would take if it were compacted.
    pub fn ask_size(&self, structure: &Structure, size: &CompactedSize) {
        let Some(functions) = structure.device.ray_functions() else {
            return;
        };
        // SAFETY: the structure is built, and was built to be compacted; the query is not in use.
        unsafe {
            structure
                .device
                .raw()
                .cmd_reset_query_pool(self.raw_commands(), size.queries, 0, 1);
            functions
                .structures
                .cmd_write_acceleration_structures_properties(
                    self.raw_commands(),
                    &[structure.raw],
                    vk::QueryType::ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR,
                    size.queries,
                    0,
                );
        }
    }

    /// Copies a structure to where it takes less memory.
    pub fn compact(&self, from: &Structure, to: &Structure) {
        let Some(functions) = from.device.ray_functions() else {
            return;
        };
        let info = vk::CopyAccelerationStructureInfoKHR::default()
            .src(from.raw)
            .dst(to.raw)
            .mode(vk::CopyAccelerationStructureModeKHR::COMPACT);
        // SAFETY: `to` has as many bytes as the device asked for.
        unsafe {
            functions
                .structures
                .cmd_copy_acceleration_structure(self.raw_commands(), &info);
        }
    }
}
