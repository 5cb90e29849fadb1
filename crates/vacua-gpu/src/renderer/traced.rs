//! Meshes whose cells rays find in an acceleration structure, asked by ray queries in compute shaders or
//! on a ray tracing pipeline: multi-leaves alone (variant 1), over which one takes the place of inner
//! nodes (paper B §5.5), and the encodings that packed meshes are compared with.

use std::collections::HashMap;
use std::sync::Arc;

use vacua_pack::Nodes;
use vacua_render::contract::PackedCells;

use super::mesh::{MeshShader, constants};
use super::subgroups::Parts;
use super::submit::Marcher;
use super::{GpuRenderer, Tracer};
use crate::error::GpuError;
use crate::mesh::DeviceMesh;
use crate::reference::Held;
use crate::shaders;
use crate::shared::{Push, words};
use crate::vulkan::{
    Buffer, BuildMode, CompactedSize, Constant, Place, Preference, RayPipeline, RayShaders, Shapes,
    Structure,
};

/// Numbers of a box: two corners.
const BOX_NUMBERS: u64 = 6;

/// An acceleration structure over multi-leaves, cells or faces of a mesh.
pub(crate) struct MeshStructure {
    lower: Structure,
    upper: Structure,
}

impl MeshStructure {
    /// Bytes of the structures.
    pub fn size_bytes(&self) -> u64 {
        self.lower.size_bytes() + self.upper.size_bytes()
    }
}

/// Ray tracing pipelines of meshes so far.
#[derive(Default)]
pub(super) struct TracedPipelines(HashMap<Vec<Constant>, Arc<RayPipeline>>);

impl GpuRenderer {
    /// How the device traces rays to find cells, if it does.
    pub(super) fn cell_tracer(&self) -> Option<Tracer> {
        let info = self.device.info();
        let all = [
            (info.has_ray_tracing(), Tracer::Pipeline),
            (info.has_ray_queries(), Tracer::Query),
        ];
        let mut there = all.into_iter().filter(|(is_there, _)| *is_there);
        let wanted = |&(_, tracer): &(bool, Tracer)| self.options.tracer == Some(tracer);
        let found = there.clone().find(wanted).or_else(|| there.next());
        found.map(|(_, tracer)| tracer)
    }

    /// Whether there is a way to find the cells of a mesh of this variant.
    pub(super) fn check_variant(&self, cells: &PackedCells) -> Result<(), GpuError> {
        match cells.mesh().nodes() {
            _ if self.reference.is_some() && self.cell_tracer().is_none() => {
                Err(self.unsupported("a mesh that is not packed"))
            }
            Nodes::MultiLeaves(_) if self.cell_tracer().is_none() => {
                Err(self.unsupported("a mesh without inner nodes (variant 1)"))
            }
            _ => Ok(()),
        }
    }

    /// Builds the acceleration structure of a mesh.
    pub(super) fn build_structure(
        &mut self,
        mesh: &mut DeviceMesh,
    ) -> Result<MeshStructure, GpuError> {
        let device = self.device.clone();
        // The shapes are needed no longer than this.
        let (_faces, _boxes);
        let shapes = match mesh.faces.take() {
            Some(faces) => {
                let shapes = faces.shapes;
                _faces = faces;
                shapes
            }
            None => {
                let (buffer, shapes) = self.boxes_of(mesh)?;
                _boxes = buffer;
                shapes
            }
        };
        let mode = BuildMode {
            preference: Preference::FastTrace,
            compactable: true,
            updatable: false,
        };
        let loose = Structure::new(&device, shapes, mode, None)?;
        let compacted = CompactedSize::new(&device)?;
        self.commands.run(&self.layout, |recorder| {
            recorder.build(&loose, shapes, false);
            recorder.barrier();
            recorder.ask_size(&loose, &compacted);
            Ok(())
        })?;
        let lower = loose.compacted(compacted.bytes()?)?;
        let what = "the instance of a mesh";
        let instance = Buffer::new(&device, what, 64, Place::Device)?;
        let placed = Shapes::Instance {
            address: instance.address(),
        };
        let upper = Structure::new(&device, placed, BuildMode::default(), None)?;
        self.commands.run(&self.layout, |recorder| {
            recorder.compact(&loose, &lower);
            recorder.barrier();
            recorder.write(&instance, &lower.instance());
            recorder.barrier();
            recorder.build(&upper, placed, false);
            Ok(())
        })?;
        self.layout.bind_scene(upper.raw());
        Ok(MeshStructure { lower, upper })
    }

    /// Boxes around the multi-leaves of a mesh, or around the cells of a list.
    fn boxes_of(&mut self, mesh: &DeviceMesh) -> Result<(Buffer, Shapes), GpuError> {
        let num = match mesh.held {
            Held::Packed => mesh.cells.mesh().nodes().len() as u64,
            _ => mesh.cells.mesh().num_cells(),
        };
        let num =
            u32::try_from(num).map_err(|_| self.unsupported(&format!("a mesh of {num} boxes")))?;
        let size = 4 * BOX_NUMBERS * u64::from(num.max(1));
        let boxes = Buffer::new(&self.device, "the boxes of a mesh", size, Place::Device)?;
        let fill = self.mesh_pipelines.get(
            &self.layout,
            MeshShader::Boxes,
            constants(mesh, self.subgroups(self.options.rays, Parts::OfAll)?),
        )?;
        let push = Push {
            planes: mesh.header.address(),
            depth: boxes.address(),
            ..Push::default()
        };
        self.commands.run(&self.layout, |recorder| {
            recorder.dispatch(&fill, &push, mesh.rows());
            Ok(())
        })?;
        let shapes = Shapes::Boxes {
            address: boxes.address(),
            num,
        };
        Ok((boxes, shapes))
    }

    /// What makes pictures of a mesh whose cells are found by rays.
    pub(super) fn traced_marcher(
        &mut self,
        held: Held,
        constants: Vec<Constant>,
    ) -> Result<Marcher, GpuError> {
        let is_of_boxes = matches!(held, Held::Packed | Held::InBoxes);
        if is_of_boxes && self.cell_tracer() == Some(Tracer::Query) {
            let pipeline = self
                .mesh_pipelines
                .get(&self.layout, MeshShader::Query, constants)?;
            return Ok(Marcher::Squares(pipeline));
        }
        Ok(Marcher::Rays(self.traced_pipeline(held, constants)?))
    }

    /// The ray tracing pipeline that finds a mesh's cells.
    pub(super) fn traced_pipeline(
        &mut self,
        held: Held,
        constants: Vec<Constant>,
    ) -> Result<Arc<RayPipeline>, GpuError> {
        if let Some(found) = self.traced_pipelines.0.get(&constants) {
            return Ok(found.clone());
        }
        let code = |spirv| words(spirv).unwrap_or_default();
        let miss = code(shaders::LOWEST_MISS);
        let made = match held {
            Held::Packed | Held::InBoxes => RayPipeline::new(
                &self.layout,
                &RayShaders {
                    generation: &code(shaders::PACKED_GENERATION),
                    miss: &miss,
                    closest_hit: None,
                    any_hit: Some(&code(shaders::LOWEST_HIT)),
                    intersection: Some(&code(shaders::PACKED_INTERSECTION)),
                },
                &constants,
            ),
            Held::ByFaces | Held::ByNeighbours => RayPipeline::new(
                &self.layout,
                &RayShaders {
                    generation: &code(shaders::FACES_GENERATION),
                    miss: &miss,
                    closest_hit: Some(&code(shaders::FACE_HIT)),
                    any_hit: None,
                    intersection: None,
                },
                &constants,
            ),
        };
        let pipeline = Arc::new(made?);
        self.traced_pipelines.0.insert(constants, pipeline.clone());
        Ok(pipeline)
    }
}
