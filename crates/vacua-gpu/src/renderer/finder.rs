//! What finds where rays meet what is active by tracing them, in a pass of its own before they are sampled:
//! rays march in step and read the transfer table from shared memory, as only compute shaders can.

use std::sync::Arc;

use vacua_render::SkipMethod;

use super::job::Job;
use super::pipelines::{Beams, Met, Shader};
use super::{GpuRenderer, Plan, Tracer};
use crate::error::GpuError;
use crate::shared::{MAX_RUNS, Push, TILE};
use crate::skip::spread;
use crate::vulkan::{Buffer, ComputePipeline, Place, RayPipeline, Recorder};

/// A pipeline that finds runs.
pub(super) enum Finder {
    /// Ray queries.
    Compute(Arc<ComputePipeline>),
    /// A ray tracing pipeline.
    Rays(Arc<RayPipeline>),
    /// Subgroups that walk our own hierarchy, each for a tile.
    Packets(Arc<ComputePipeline>, Beams),
}

impl Finder {
    pub fn record(&self, recorder: &Recorder<'_>, push: &Push, size: [u32; 2]) {
        match self {
            Self::Compute(pipeline) => recorder.dispatch(pipeline, push, tiles(size)),
            Self::Rays(pipeline) => recorder.trace(pipeline, push, size),
            Self::Packets(pipeline, beams) => {
                recorder.dispatch(pipeline, push, spread(beams.num_groups(size)));
            }
        }
    }
}

/// Workgroups that make a picture of a device's own size.
pub(super) fn tiles([width, rows]: [u32; 2]) -> [u32; 3] {
    [width.div_ceil(TILE), rows.div_ceil(TILE), 1]
}

impl GpuRenderer {
    /// What finds the runs of a picture of voxels, with room for them; `None` if no ray is traced: by other
    /// methods, or where nothing is active and so nothing can be met.
    pub(super) fn finder(
        &mut self,
        job: &mut Job,
        plan: Plan,
        tracer: Option<Tracer>,
    ) -> Result<Option<Finder>, GpuError> {
        let has_shapes = self.outline.as_ref().is_some_and(|o| o.num > 0);
        let may_trace = self.mesh.is_none() && has_shapes;
        let Some(picture) = self.picture.as_ref().filter(|_| may_trace) else {
            return Ok(None);
        };
        let size = [picture.width as u32, picture.rows as u32];
        let layout = &self.layout;
        let finder = match (plan.method, tracer) {
            (_, None) => return Ok(None),
            (_, Some(Tracer::Query)) => {
                Finder::Compute(self.pipelines.get(layout, Shader::Query, job.special)?)
            }
            (_, Some(Tracer::Packets)) => {
                let beams = Beams::of_packets(self.device.info());
                let beams = beams.ok_or_else(|| self.unsupported("packets of rays"))?;
                let shader = Shader::Packets(beams);
                Finder::Packets(self.pipelines.get(layout, shader, job.special)?, beams)
            }
            (SkipMethod::Boxes, Some(Tracer::Pipeline)) => {
                Finder::Rays(self.pipelines.rays(layout, Met::Boxes, job.special)?)
            }
            (_, Some(Tracer::Pipeline)) => {
                Finder::Rays(self.pipelines.rays(layout, Met::Mesh, job.special)?)
            }
        };
        let [columns, rows, _] = tiles(size).map(u64::from);
        let bytes = 4 * u64::from(MAX_RUNS) * columns * rows * u64::from(TILE * TILE);
        let runs = match self.runs.take() {
            Some(runs) if runs.size_bytes() >= bytes => runs,
            older => {
                drop(older);
                Buffer::new(&self.device, "runs of samples", bytes, Place::Device)?
            }
        };
        job.push.runs = runs.address();
        self.runs = Some(runs);
        Ok(Some(finder))
    }
}
