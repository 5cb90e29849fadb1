//! Pictures of packed meshes: the same stages as for grids, but ranges of macrocells come from the
//! host, which has them from the leaves' own.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Instant;

use vacua_render::SceneData;
use vacua_render::contract::PackedCells;
use vacua_volume::{Association, ValueScale};

use super::pipelines::Special;
use super::subgroups::{Kept, Parts, Subgroups};
use super::submit::Marcher;
use super::{GpuRenderer, Search, Tables};
use crate::error::GpuError;
use crate::mesh::{DeviceMesh, MeshBytes, MeshHeader, mesh_constant};
use crate::reference::{Held, MeshReference};
use crate::shaders;
use crate::shared::{Parameters, Push, constant, words};
use crate::vulkan::{Buffer, ComputePipeline, Constant, Layout, Place, Recorder};

/// Places a row, where rays find the cells of many.
const LAUNCH_WIDTH: u32 = 1 << 12;

/// A compute shader over a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum MeshShader {
    Check,
    March(Subgroups),
    Sample(Subgroups),
    Boxes,
    Query,
}

/// Pipelines of meshes so far.
#[derive(Default)]
pub(super) struct MeshPipelines(HashMap<(MeshShader, Vec<Constant>), Arc<ComputePipeline>>);

impl MeshPipelines {
    pub(super) fn get(
        &mut self,
        layout: &Layout,
        shader: MeshShader,
        constants: Vec<Constant>,
    ) -> Result<Arc<ComputePipeline>, GpuError> {
        let key = (shader, constants);
        if let Some(found) = self.0.get(&key) {
            return Ok(found.clone());
        }
        let (spirv, subgroups) = match shader {
            MeshShader::Check => (shaders::PACKED_CHECK, None),
            MeshShader::March(subgroups) => (shaders::PACKED_MARCH, Some(subgroups)),
            MeshShader::Sample(subgroups) => (shaders::PACKED_SAMPLE, Some(subgroups)),
            MeshShader::Boxes => (shaders::PACKED_BOXES, None),
            MeshShader::Query => (shaders::PACKED_QUERY, None),
        };
        let lanes = subgroups.map(Subgroups::lanes);
        let spirv = words(spirv).unwrap_or_default();
        let pipeline = Arc::new(ComputePipeline::new(layout, &spirv, &key.1, lanes)?);
        self.0.insert(key, pipeline.clone());
        Ok(pipeline)
    }
}

/// What was found at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshSample {
    /// The cell: sub-mesh, and primitive there (see `vacua_pack::PackedCell::index`).
    pub cell: Option<(u32, u32)>,
    /// The rendered value, if there is one.
    pub value: Option<f32>,
}

impl GpuRenderer {
    /// Seconds to bring the last scene's mesh to the device, its check included; 0 if it was none.
    pub fn mesh_send_secs(&self) -> f64 {
        self.mesh.as_ref().map_or(0.0, |m| m.send_secs)
    }

    /// Bytes of the sections of a file with the last scene's mesh and field; `None` if it was none.
    pub fn mesh_file_bytes(&self) -> Option<u64> {
        let cells = &self.mesh.as_ref()?.cells;
        let field = cells.field().bytes();
        let of_field = field.values + field.ranges + field.cells_before;
        Some((cells.mesh().bytes().total() + of_field) as u64)
    }

    /// The box around the last scene's mesh, relative to its origin; `None` if it was none.
    pub fn mesh_box(&self) -> Option<[[f32; 3]; 2]> {
        let headers = self.mesh.as_ref()?.cells.mesh().submeshes();
        let first = headers.first()?;
        Some(headers.iter().fold([first.lo, first.hi], |[lo, hi], h| {
            [
                [0, 1, 2].map(|a| lo[a].min(h.lo[a])),
                [0, 1, 2].map(|a| hi[a].max(h.hi[a])),
            ]
        }))
    }

    /// Bytes of the mesh on the device, part by part; `None` if the last scene was none.
    pub fn mesh_bytes(&self) -> Option<MeshBytes> {
        self.mesh.as_ref().map(|m| m.bytes)
    }

    /// Holds the next meshes in an encoding that the packed one is compared with, or as they are packed
    /// again; pictures do not depend on it. Its cells are those of the scenes that follow.
    pub fn set_reference(&mut self, reference: Option<MeshReference>) {
        self.reference = reference;
        self.forget();
    }

    /// How subgroups search that know of some cells in which sub-mesh they are.
    pub(super) fn subgroups(&self, search: Search, parts: Parts) -> Result<Subgroups, GpuError> {
        let info = self.device.info();
        let Some(lanes) = info.subgroup_lanes else {
            return Err(self.unsupported("a mesh (no ballots among lanes)"));
        };
        let mesh = self.mesh.as_ref();
        let kept = Kept {
            tets: mesh.is_some_and(DeviceMesh::has_tets),
            others: mesh.is_some_and(DeviceMesh::has_others),
            cell_data: mesh.is_some_and(DeviceMesh::is_of_cell_data),
            parts: parts == Parts::OfAll,
        };
        Ok(Subgroups::new(info, lanes, search, kept))
    }

    /// Sends a scene's mesh to the device.
    pub(super) fn upload_mesh(
        &mut self,
        data: &SceneData,
        scale: ValueScale,
        cells: PackedCells,
    ) -> Result<(), GpuError> {
        self.subgroups(self.options.rays, Parts::OfAll)?;
        self.check_variant(&cells)?;
        if cells.mesh().num_cells() == 0 {
            return Err(GpuError::Unsupported {
                what: "a mesh without cells".to_owned(),
                device: self.device.name().to_owned(),
            });
        }
        let start = Instant::now();
        let advised = self.device.info().max_allocation_bytes.max(1 << 28);
        let limit = self.options.max_buffer_bytes.unwrap_or(u64::MAX);
        let mut mesh = match &self.reference {
            Some(reference) => DeviceMesh::of_reference(
                &self.device,
                &mut self.commands,
                &self.layout,
                (data.clone(), scale),
                cells,
                reference,
            )?,
            None => DeviceMesh::new(
                &self.device,
                &mut self.commands,
                &self.layout,
                data.clone(),
                scale,
                cells,
                limit.min(advised),
            )?,
        };
        self.layout.bind_parameters(&self.tables.parameters);
        if mesh.held == Held::Packed {
            self.check_mesh(&mesh)?;
        }
        if mesh.is_traced() {
            let structure = self.build_structure(&mut mesh)?;
            mesh.bytes.structures = structure.size_bytes();
            mesh.structure = Some(structure);
        }
        mesh.send_secs = start.elapsed().as_secs_f64();
        self.mesh = Some(mesh);
        Ok(())
    }

    /// Has the device look whether a mesh stays within itself.
    fn check_mesh(&mut self, mesh: &DeviceMesh) -> Result<(), GpuError> {
        let inner = vec![Constant {
            id: mesh_constant::INNER_NODES,
            bits: u32::from(!mesh.is_of_leaves()),
        }];
        let pipeline = self
            .mesh_pipelines
            .get(&self.layout, MeshShader::Check, inner)?;
        let num_nodes = mesh.cells.mesh().nodes().len() as u64;
        let marks = Buffer::new(
            &self.device,
            "checking the mesh",
            num_nodes.div_ceil(32).max(1) * 4,
            Place::Device,
        )?;
        let push = Push {
            planes: mesh.header.address(),
            skip: marks.address(),
            ..Push::default()
        };
        let tables = &self.tables;
        self.commands.run(&self.layout, |recorder| {
            recorder.clear(&marks);
            recorder.barrier();
            recorder.stage("check", |r| r.dispatch(&pipeline, &push, mesh.rows()));
            recorder.copy(
                &mesh.header,
                &tables.mesh_header,
                0,
                size_of::<MeshHeader>() as u64,
            );
            recorder.barrier();
            Ok(())
        })?;
        if self.tables.header().damage != 0 {
            return Err(GpuError::DamagedMesh);
        }
        Ok(())
    }

    /// Values at places of the mesh of the last scene, relative to its origin; for tests.
    ///
    /// # Errors
    /// What the driver says; that cells are found by rays where there are no ray tracing pipelines.
    pub fn sample_mesh(&mut self, places: &[[f32; 3]]) -> Result<Vec<MeshSample>, GpuError> {
        let subgroups = self.subgroups(self.options.places, Parts::OfAll)?;
        let Some(mesh) = &self.mesh else {
            return Ok(Vec::new());
        };
        let quads: Vec<[f32; 4]> = places.iter().map(|&[x, y, z]| [x, y, z, 0.0]).collect();
        let size = size_of_val(quads.as_slice()) as u64;
        let mut from = Buffer::new(&self.device, "places", size, Place::Upload)?;
        let bytes: &[u8] = bytemuck::cast_slice(&quads);
        from.bytes_mut()[..bytes.len()].copy_from_slice(bytes);
        let here = Buffer::new(&self.device, "places", size, Place::Device)?;
        let to = Buffer::new(&self.device, "samples", size, Place::Device)?;
        let back = Buffer::new(&self.device, "samples", size, Place::Download)?;
        let mut parameters = Parameters::default();
        parameters.picture[0] = places.len() as u32;
        let push = Push {
            planes: mesh.header.address(),
            clips: here.address(),
            rgba: to.address(),
            ..Push::default()
        };
        let mut constants = constants(mesh, subgroups);
        let held = mesh.held;
        let (sampler, size_of_launch) = if mesh.is_traced() {
            if !self.device.info().has_ray_tracing() {
                return Err(self.unsupported("a list of places in a mesh whose cells rays find"));
            }
            constants.push(Constant {
                id: mesh_constant::PLACES,
                bits: 1,
            });
            let width = (places.len() as u32).clamp(1, LAUNCH_WIDTH);
            let rows = (places.len() as u32).div_ceil(width);
            let pipeline = self.traced_pipeline(held, constants)?;
            (Marcher::Rays(pipeline), [width, rows])
        } else {
            let pipeline =
                self.mesh_pipelines
                    .get(&self.layout, MeshShader::Sample(subgroups), constants)?;
            (
                Marcher::Places(pipeline, subgroups),
                [places.len() as u32, 1],
            )
        };
        let tables = &self.tables;
        self.timings = self.commands.run(&self.layout, |recorder| {
            recorder.stage("tables", |r| {
                r.write(&tables.parameters, bytemuck::bytes_of(&parameters));
                r.copy(&from, &here, 0, size);
            });
            recorder.stage("sample", |r| sampler.record(r, &push, size_of_launch));
            recorder.copy(&to, &back, 0, size);
            recorder.barrier();
            Ok(())
        })?;
        let found: &[[u32; 4]] = bytemuck::cast_slice(&back.bytes()[..bytes.len()]);
        let samples = found
            .iter()
            .map(|&[value, valid, part, primitive]| MeshSample {
                cell: (primitive != u32::MAX).then_some((part, primitive)),
                value: (valid != 0).then_some(f32::from_bits(value)),
            });
        Ok(samples.collect())
    }

    /// What makes pictures of the mesh.
    pub(super) fn mesh_marcher(&mut self, special: Special) -> Result<Marcher, GpuError> {
        let parts = match special[constant::SHADED as usize] {
            0 => Parts::OfTetrahedra,
            _ => Parts::OfAll,
        };
        let subgroups = self.subgroups(self.options.rays, parts)?;
        let Some(mesh) = &self.mesh else {
            return Err(self.unsupported("no mesh"));
        };
        let mut constants = constants(mesh, subgroups);
        let of_settings = [
            constant::SKIPPING,
            constant::LOG_SCALE,
            constant::SHADED,
            constant::MAXIMUM,
        ];
        // Where there are other cells than tetrahedra it is asked at run time.
        let is_asked = |id| id == constant::SKIPPING && mesh.has_others();
        constants.extend(of_settings.map(|id| Constant {
            id,
            bits: if is_asked(id) {
                1
            } else {
                special[id as usize]
            },
        }));
        if mesh.is_traced() {
            let held = mesh.held;
            return self.traced_marcher(held, constants);
        }
        let pipeline =
            self.mesh_pipelines
                .get(&self.layout, MeshShader::March(subgroups), constants)?;
        Ok(Marcher::Mesh(pipeline, subgroups))
    }
}

impl DeviceMesh {
    /// Whether there are tetrahedra.
    fn has_tets(&self) -> bool {
        let [tets, ..] = self.cells.mesh().num_cells_by_type();
        tets > 0
    }

    /// Whether there are other cells than tetrahedra.
    fn has_others(&self) -> bool {
        let [_, others @ ..] = self.cells.mesh().num_cells_by_type();
        others.iter().any(|&n| n > 0)
    }

    /// Whether values are those of cells.
    fn is_of_cell_data(&self) -> bool {
        self.cells.field().association() == Association::Cell
    }

    /// Workgroups of shaders that look at every node: some a sub-mesh, a row each.
    pub(super) fn rows(&self) -> [u32; 3] {
        const MOST_PARTS: usize = 1 << 15;
        const GROUPS: u32 = 64;
        if self.held != Held::Packed {
            // A list is one part.
            return [GROUPS * GROUPS, 1, 1];
        }
        let parts = self.cells.mesh().submeshes().len().clamp(1, MOST_PARTS);
        [GROUPS, parts as u32, 1]
    }

    /// Has the header sent to the host, as shaders left it.
    pub(super) fn send_header(&self, recorder: &Recorder<'_>, tables: &Tables) {
        let size = size_of::<MeshHeader>() as u64;
        recorder.copy(&self.header, &tables.mesh_header, 0, size);
    }
}

impl Tables {
    /// The mesh's header as shaders left it.
    pub(super) fn header(&self) -> MeshHeader {
        bytemuck::pod_read_unaligned(&self.mesh_header.bytes()[..size_of::<MeshHeader>()])
    }
}

/// What all shaders over a mesh are specialised for.
pub(super) fn constants(mesh: &DeviceMesh, subgroups: Subgroups) -> Vec<Constant> {
    let constant = |id, bits| Constant { id, bits };
    let mut all = vec![
        constant(mesh_constant::HELD, mesh.held as u32),
        constant(mesh_constant::ONLY_KIND, mesh.only_kind),
        constant(mesh_constant::HAS_TETS, u32::from(mesh.has_tets())),
        constant(mesh_constant::HAS_OTHERS, u32::from(mesh.has_others())),
        constant(mesh_constant::VALUE_TYPE, mesh.value_type as u32),
        constant(mesh_constant::INNER_NODES, u32::from(!mesh.is_of_leaves())),
        constant(
            mesh_constant::VARYING,
            u32::from(mesh.cells.minima().is_some()),
        ),
        constant(constant::CELL_DATA, u32::from(mesh.is_of_cell_data())),
    ];
    all.extend(subgroups.constants());
    all
}
