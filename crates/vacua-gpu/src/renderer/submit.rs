//! One submission: what is out of date, then the rays of some frames.

use std::ops::Range;
use std::sync::Arc;

use vacua_render::{Overlay, RenderSettings, Scene, SkipMethod};

use super::finder::tiles;
use super::job::{Job, Preparation, pass};
use super::options::Search;
use super::outline::Outline;
use super::pipelines::{Ahead, Beams, Shader};
use super::subgroups::Subgroups;
use super::{GpuRenderer, Plan, Tracer};
use crate::error::GpuError;
use crate::shared::{Push, constant};
use crate::vulkan::{ComputePipeline, RayPipeline, Recorder, Timings};

/// What makes the pixels.
pub(super) enum Marcher {
    Voxels(Arc<ComputePipeline>),
    /// In tiles that subgroups take in turn.
    Beams(Arc<ComputePipeline>, Beams),
    /// In squares of eight pixels a side.
    Squares(Arc<ComputePipeline>),
    Rays(Arc<RayPipeline>),
    Mesh(Arc<ComputePipeline>, Subgroups),
    /// A list of places.
    Places(Arc<ComputePipeline>, Subgroups),
}

impl Marcher {
    pub(super) fn record(&self, recorder: &Recorder<'_>, push: &Push, size: [u32; 2]) {
        match self {
            Self::Voxels(pipeline) => recorder.dispatch(pipeline, push, tiles(size)),
            Self::Beams(pipeline, beams) => {
                recorder.dispatch(pipeline, push, beams.groups(size));
            }
            Self::Squares(pipeline) => {
                let groups = [size[0].div_ceil(8), size[1].div_ceil(8), 1];
                recorder.dispatch(pipeline, push, groups);
            }
            Self::Rays(pipeline) => recorder.trace(pipeline, push, size),
            Self::Mesh(pipeline, subgroups) => {
                recorder.dispatch(pipeline, push, subgroups.tiles(size[0], size[1]));
            }
            Self::Places(pipeline, subgroups) => {
                let groups = [size[0].div_ceil(subgroups.invocations()), 1, 1];
                recorder.dispatch(pipeline, push, groups);
            }
        }
    }
}

impl GpuRenderer {
    /// Records and runs some frames of a picture, and all that must be redone before them. Sends
    /// the picture back after the last.
    pub(super) fn submit(
        &mut self,
        scene: &Scene,
        settings: &RenderSettings,
        plan: Plan,
        frames: Range<u32>,
        num_frames: u32,
    ) -> Result<Timings, GpuError> {
        let mut timings = Timings::default();
        let tracer = self.tracer_of(plan)?;
        let Some(mut job) = self.job(scene, settings, plan)? else {
            return Ok(timings);
        };
        let pending = match tracer {
            Some(tracer) => self.outline(&mut job, plan, tracer, &mut timings)?,
            None => None,
        };
        let steps = self.steps(&job, plan)?;
        let finder = self.finder(&mut job, plan, tracer)?;
        let marcher = if self.mesh.is_some() {
            self.mesh_marcher(job.special)?
        } else {
            let ahead = match tracer {
                Some(_) => Ahead::Runs,
                None => Ahead::Map,
            };
            let beams = self.beams(&job, ahead);
            let shader = match (ahead, beams) {
                (_, Some(beams)) => Shader::MarchBeams(beams),
                (Ahead::Runs, None) => Shader::MarchRuns,
                (Ahead::Map, None) => Shader::March,
            };
            let pipeline = self.pipelines.get(&self.layout, shader, job.special)?;
            match beams {
                Some(beams) => Marcher::Beams(pipeline, beams),
                None => Marcher::Voxels(pipeline),
            }
        };
        let overlay = match settings.overlay {
            Overlay::None => None,
            Overlay::Boundary => {
                let get = self
                    .pipelines
                    .get(&self.layout, Shader::Overlay, job.special);
                Some(get?)
            }
        };
        let (Some(look), Some(picture)) = (&self.look, &self.picture) else {
            return Ok(timings);
        };
        let is_skipping = plan.method != SkipMethod::None;
        let tables = &self.tables;
        let preparation = Preparation {
            job: &job,
            steps: &steps,
            tables,
            table: &look.table,
            cells: self.macrocells.get(&plan.side).filter(|_| job.uses_mask),
        };
        let size = [picture.width as u32, picture.rows as u32];
        let is_empty = picture.width * picture.rows == 0;
        let is_last = frames.end == num_frames;
        let outline = self.outline.as_ref();
        let mesh = self.mesh.as_ref();
        let found = self.commands.run(&self.layout, |recorder| {
            preparation.record(recorder);
            if let (Some(pending), Some(outline)) = (&pending, outline) {
                outline.record(recorder, pending, &job);
            }
            for frame in frames.filter(|_| !is_empty) {
                let mut push = pass(job.push, settings, frame, num_frames);
                if !is_skipping {
                    push.skip = 0;
                }
                if let Some(finder) = &finder {
                    recorder.stage("find", |r| finder.record(r, &push, size));
                }
                recorder.stage("march", |r| {
                    if matches!(marcher, Marcher::Beams(..)) {
                        // The next tile, behind the number of active macrocells.
                        r.clear_word(&tables.counter, 1);
                        r.barrier();
                    }
                    marcher.record(r, &push, size);
                });
            }
            if let Some(overlay) = overlay.as_ref().filter(|_| is_last && !is_empty) {
                recorder.stage("overlay", |r| r.dispatch(overlay, &job.push, tiles(size)));
            }
            if is_last {
                recorder.stage("copy", |r| picture.send(r));
            }
            recorder.stage("count", |r| {
                r.copy(&tables.counter, &tables.counted, 0, 8);
                if let Some(mesh) = mesh {
                    mesh.send_header(r, tables);
                }
            });
            Ok(())
        })?;
        timings.0.extend(found.0);
        if mesh.is_some() && self.tables.header().overflow != 0 {
            return Err(self.unsupported("a mesh with a tree this deep"));
        }
        self.done(&job, &steps);
        if pending.is_some() {
            self.outline_is_current = true;
            self.outline.iter_mut().for_each(Outline::set_built);
        }
        if is_skipping {
            let counted: &[u32] = bytemuck::cast_slice(&self.tables.counted.bytes()[..4]);
            self.num_active = counted[0] as usize;
        }
        Ok(timings)
    }

    /// How subgroups look ahead together, if they do.
    fn beams(&self, job: &Job, ahead: Ahead) -> Option<Beams> {
        let is_uniform = job.special[constant::RECTILINEAR as usize] == 0;
        let is_shaded = job.special[constant::SHADED as usize] != 0;
        let beams = Beams::new(self.device.info(), is_shaded, ahead);
        let is_skipping = job.special[constant::SKIPPING as usize] != 0;
        let looks = is_skipping && ahead == Ahead::Map;
        let suits = |beams: &Beams| !looks || beams.are_narrow(&job.parameters);
        beams.filter(|beams| is_uniform && self.options.rays == Search::Together && suits(beams))
    }

    /// How a plan traces rays, if it does.
    fn tracer_of(&self, plan: Plan) -> Result<Option<Tracer>, GpuError> {
        let what = format!("--skip {}", plan.method.name());
        match plan.method {
            SkipMethod::None | SkipMethod::Grid => Ok(None),
            SkipMethod::Auto => Err(self.unsupported(&what)),
            _ if self.mesh.is_some() => Err(self.unsupported(&format!("{what} over a mesh"))),
            SkipMethod::Boxes if !self.device.info().has_ray_tracing() => {
                Err(self.unsupported(&what))
            }
            SkipMethod::Boxes => Ok(Some(Tracer::Pipeline)),
            SkipMethod::Mesh => {
                let tracer = plan.tracer.or_else(|| self.tracers().first().copied());
                match tracer {
                    Some(tracer) if self.tracers().contains(&tracer) => Ok(Some(tracer)),
                    _ => Err(self.unsupported(&what)),
                }
            }
        }
    }

    /// The ways in which `mesh` can trace rays on this device, that which is taken if none is chosen first; none
    /// over a packed mesh.
    pub fn tracers(&self) -> Vec<Tracer> {
        if self.mesh.is_some() {
            return Vec::new();
        }
        let info = self.device.info();
        let all = [
            (info.has_ray_tracing(), Tracer::Pipeline),
            (info.has_ray_queries(), Tracer::Query),
            (Beams::of_packets(info).is_some(), Tracer::Packets),
        ];
        let there = all.into_iter().filter(|(is_there, _)| *is_there);
        there.map(|(_, tracer)| tracer).collect()
    }

    pub(super) fn unsupported(&self, what: &str) -> GpuError {
        GpuError::Unsupported {
            what: what.to_owned(),
            device: self.device.name().to_owned(),
        }
    }
}
