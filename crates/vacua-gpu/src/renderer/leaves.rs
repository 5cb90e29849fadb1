//! Meshes of multi-leaves alone (variant 1): an acceleration structure over them takes the place of
//! inner nodes (paper B §5.5), asked by ray queries in compute shaders or on a ray tracing pipeline.

use std::collections::HashMap;
use std::sync::Arc;

use vacua_pack::Nodes;
use vacua_render::contract::PackedCells;

use super::mesh::{MeshShader, constants};
use super::submit::Marcher;
use super::{GpuRenderer, Tracer};
use crate::error::GpuError;
use crate::mesh::DeviceMesh;
use crate::shaders;
use crate::shared::{Push, words};
use crate::vulkan::{
    Buffer, BuildMode, CompactedSize, Constant, Place, Preference, RayPipeline, RayShaders, Shapes,
    Structure,
};

/// Numbers of a box: two corners.
const BOX_NUMBERS: u64 = 6;

/// An acceleration structure over the multi-leaves of a mesh.
pub(crate) struct Leaves {
    lower: Structure,
    upper: Structure,
}

impl Leaves {
    /// Bytes of the structures.
    pub fn size_bytes(&self) -> u64 {
        self.lower.size_bytes() + self.upper.size_bytes()
    }
}

/// Ray tracing pipelines of meshes so far.
#[derive(Default)]
pub(super) struct LeafPipelines(HashMap<Vec<Constant>, Arc<RayPipeline>>);

impl GpuRenderer {
    /// How the device traces rays against multi-leaves, if it does.
    pub(super) fn leaf_tracer(&self) -> Option<Tracer> {
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
            Nodes::MultiLeaves(_) if self.leaf_tracer().is_none() => {
                Err(self.unsupported("a mesh without inner nodes (variant 1)"))
            }
            _ => Ok(()),
        }
    }

    /// Builds the acceleration structure of a mesh.
    pub(super) fn build_leaves(&mut self, mesh: &DeviceMesh) -> Result<Leaves, GpuError> {
        let device = self.device.clone();
        let num = mesh.cells.mesh().nodes().len();
        let num = u32::try_from(num)
            .map_err(|_| self.unsupported(&format!("a mesh of {num} multi-leaves")))?;
        let what = "the boxes of multi-leaves";
        let size = 4 * BOX_NUMBERS * u64::from(num.max(1));
        let boxes = Buffer::new(&device, what, size, Place::Device)?;
        let shapes = Shapes::Boxes {
            address: boxes.address(),
            num,
        };
        let mode = BuildMode {
            preference: Preference::FastTrace,
            compactable: true,
            updatable: false,
        };
        let loose = Structure::new(&device, shapes, mode, None)?;
        let fill = self.mesh_pipelines.get(
            &self.layout,
            MeshShader::Boxes,
            constants(mesh, self.subgroups()?),
        )?;
        let push = Push {
            planes: mesh.header.address(),
            depth: boxes.address(),
            ..Push::default()
        };
        let rows = mesh.rows();
        let compacted = CompactedSize::new(&device)?;
        self.commands.run(&self.layout, |recorder| {
            recorder.dispatch(&fill, &push, rows);
            recorder.barrier();
            recorder.build(&loose, shapes, false);
            recorder.barrier();
            recorder.ask_size(&loose, &compacted);
            Ok(())
        })?;
        let lower = loose.compacted(compacted.bytes()?)?;
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
        Ok(Leaves { lower, upper })
    }

    /// What makes pictures of a mesh whose multi-leaves are traced.
    pub(super) fn leaf_marcher(&mut self, constants: Vec<Constant>) -> Result<Marcher, GpuError> {
        if self.leaf_tracer() == Some(Tracer::Query) {
            let pipeline = self
                .mesh_pipelines
                .get(&self.layout, MeshShader::Query, constants)?;
            return Ok(Marcher::Squares(pipeline));
        }
        if let Some(found) = self.leaf_pipelines.0.get(&constants) {
            return Ok(Marcher::Rays(found.clone()));
        }
        let code = |spirv| words(spirv).unwrap_or_default();
        let generation = code(shaders::PACKED_GENERATION);
        let intersection = code(shaders::PACKED_INTERSECTION);
        let any_hit = code(shaders::LOWEST_HIT);
        let miss = code(shaders::LOWEST_MISS);
        let shaders = RayShaders {
            generation: &generation,
            miss: &miss,
            closest_hit: None,
            any_hit: Some(&any_hit),
            intersection: Some(&intersection),
        };
        let pipeline = Arc::new(RayPipeline::new(&self.layout, &shaders, &constants)?);
        self.leaf_pipelines.0.insert(constants, pipeline.clone());
        Ok(Marcher::Rays(pipeline))
    }
}
