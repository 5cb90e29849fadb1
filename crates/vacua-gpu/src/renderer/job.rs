//! What one submission needs to know, and what must be redone before its rays march.

use std::sync::Arc;

use vacua_render::contract::pixel_offset;
use vacua_render::contract::{GOLDEN, LIGHT};
use vacua_render::{Integrator, Jitter, Overlay, RenderError, RenderSettings, Scene, SkipMethod};
use vacua_skip::Lattice;

use super::pipelines::{Shader, Special, special, special_of};
use super::{GpuRenderer, Look, Plan, Share, Tables};
use crate::error::GpuError;
use crate::frame::Picture;
use crate::shared::{MAX_REACH, Parameters, Push};
use crate::skip::DeviceMacrocells;
use crate::table::DeviceTable;
use crate::view;
use crate::volume::DeviceVolume;
use crate::vulkan::{Buffer, ComputePipeline, Recorder};

/// What a classification of macrocells depends on, besides volume and transfer function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct SkipKey {
    pub side: usize,
    pub integrator: Integrator,
}

/// Parameters of one submission.
pub(super) struct Job {
    pub parameters: Parameters,
    pub clips: Vec<[f32; 4]>,
    pub push: Push,
    pub special: Special,
    pub key: SkipKey,
    pub lattice: Lattice,
    /// Whether anything asks which macrocells are active.
    pub uses_mask: bool,
}

/// What must be redone before rays march, and by which pipelines.
#[derive(Default)]
pub(super) struct Steps {
    pub sends_table: bool,
    pub ranges: Option<Arc<ComputePipeline>>,
    pub classify: Option<Arc<ComputePipeline>>,
    pub distance: Option<Arc<ComputePipeline>>,
}

/// What is recorded before all else.
pub(super) struct Preparation<'a> {
    pub job: &'a Job,
    pub steps: &'a Steps,
    pub tables: &'a Tables,
    pub table: &'a DeviceTable,
    pub cells: Option<&'a DeviceMacrocells>,
}

impl GpuRenderer {
    /// Settles what a submission does; makes room for macrocells. `None` without a volume.
    pub(super) fn job(
        &mut self,
        scene: &Scene,
        settings: &RenderSettings,
        plan: Plan,
    ) -> Result<Option<Job>, GpuError> {
        let (Some(look), Some(picture)) = (&self.look, &self.picture) else {
            return Ok(None);
        };
        let space = match (&self.volume, &self.mesh) {
            (Some(volume), _) => &volume.space,
            (None, Some(mesh)) => &mesh.cells.space,
            (None, None) => return Ok(None),
        };
        let is_skipping = plan.method != SkipMethod::None;
        let uses_mask = is_skipping || settings.overlay != Overlay::None;
        let lattice = Lattice::new(space.axes.clone(), plan.side)
            .map_err(|e| GpuError::Render(RenderError::Lattice(e)))?;
        let mut parameters = Parameters::default();
        view::rays(&mut parameters, scene, settings, space)?;
        let clips = view::half_spaces(scene, space);
        if size_of_val(clips.as_slice()) as u64 > self.tables.clips.size_bytes() {
            return Err(GpuError::Unsupported {
                what: format!("{} clip planes", clips.len()),
                device: self.device.name().to_owned(),
            });
        }
        fill(&mut parameters, look, &lattice, clips.len());
        if let Some(volume) = &self.volume {
            fill_voxels(&mut parameters, volume);
        }
        parameters.picture[2] = u32::from(self.options.reach.clamp(1, MAX_REACH));
        parameters.picture[3] = self.share.bits();
        if uses_mask && !self.macrocells.contains_key(&plan.side) {
            let mut cells = DeviceMacrocells::new(&self.device, &lattice)?;
            if let Some(mesh) = &mut self.mesh {
                let macrocells = mesh.macrocells(&lattice);
                let macrocells =
                    macrocells.map_err(|e| GpuError::Render(RenderError::Lattice(e)))?;
                cells.send_ranges(&self.device, &mut self.commands, &self.layout, &macrocells)?;
            }
            self.macrocells.insert(plan.side, cells);
        }
        let mut push = self.tables.push(picture);
        if let Some(volume) = &self.volume {
            push.planes = volume.planes.as_ref().map_or(0, |p| p.buffer.address());
            push.blanked = volume.blanked.as_ref().map_or(0, Buffer::address);
        }
        if let Some(mesh) = &self.mesh {
            push.planes = mesh.header.address();
        }
        if let Some(cells) = self.macrocells.get(&plan.side).filter(|_| uses_mask) {
            push.ranges = cells.ranges.address();
            // The map after all passes, or, where rays are traced, the mask before them.
            let is_walk = plan.method == SkipMethod::Grid;
            push.skip = cells.maps[usize::from(is_walk)].address();
        }
        Ok(Some(Job {
            special: match &self.volume {
                Some(volume) => special(volume, look.table.is_log, settings, is_skipping),
                None => special_of(look.table.is_log, settings, is_skipping),
            },
            parameters,
            clips,
            push,
            key: SkipKey {
                side: plan.side,
                integrator: settings.integrator,
            },
            lattice,
            uses_mask,
        }))
    }

    /// What is out of date.
    pub(super) fn steps(&mut self, job: &Job, plan: Plan) -> Result<Steps, GpuError> {
        let is_walk = plan.method == SkipMethod::Grid;
        let cells = self.macrocells.get(&plan.side).filter(|_| job.uses_mask);
        let wants_ranges = cells.is_some_and(|m| !m.is_ready);
        let is_classified = self.skip == Some(job.key) && (self.has_distances || !is_walk);
        let wants_mask = job.uses_mask && !is_classified;
        let mut get = |shader| self.pipelines.get(&self.layout, shader, job.special);
        Ok(Steps {
            sends_table: self.look.as_ref().is_some_and(|l| !l.is_sent),
            ranges: wants_ranges.then(|| get(Shader::Ranges)).transpose()?,
            classify: wants_mask.then(|| get(Shader::Classify)).transpose()?,
            distance: (wants_mask && is_walk)
                .then(|| get(Shader::Distance))
                .transpose()?,
        })
    }

    /// Remembers that these steps were done.
    pub(super) fn done(&mut self, job: &Job, steps: &Steps) {
        if let Some(look) = &mut self.look {
            look.is_sent = true;
        }
        if steps.ranges.is_some()
            && let Some(cells) = self.macrocells.get_mut(&job.key.side)
        {
            cells.is_ready = true;
        }
        if steps.classify.is_some() {
            self.skip = Some(job.key);
            self.has_distances = steps.distance.is_some();
        }
    }
}

impl Preparation<'_> {
    /// Records everything that is out of date.
    pub fn record(&self, recorder: &mut Recorder<'_>) {
        let Self {
            job, steps, tables, ..
        } = self;
        recorder.stage("tables", |r| {
            r.write(&tables.parameters, bytemuck::bytes_of(&job.parameters));
            if !job.clips.is_empty() {
                r.write(&tables.clips, bytemuck::cast_slice(&job.clips));
            }
            if steps.sends_table {
                r.write(&tables.entries, &self.table.entry_bytes());
                let next_active = bytemuck::cast_slice(&self.table.next_active);
                r.write(&tables.next_active, next_active);
            }
            if steps.classify.is_some() {
                r.clear(&tables.counter);
            }
        });
        let Some(cells) = self.cells else { return };
        if let Some(pipeline) = &steps.ranges {
            recorder.stage("ranges", |r| {
                r.dispatch(pipeline, &job.push, cells.groups())
            });
        }
        let groups = cells.word_groups();
        let maps = cells.maps.each_ref().map(Buffer::address);
        if let Some(pipeline) = &steps.classify {
            recorder.stage("classify", |r| {
                let skip = maps[0];
                r.dispatch(pipeline, &Push { skip, ..job.push }, groups);
            });
        }
        if let Some(pipeline) = &steps.distance {
            recorder.stage("distance", |r| {
                for axis in 0..3 {
                    let (from, to) = (axis % 2, (axis + 1) % 2);
                    let pass = Push {
                        skip_before: maps[from],
                        skip: maps[to],
                        pass: axis as u32,
                        ..job.push
                    };
                    r.dispatch(pipeline, &pass, groups);
                    r.barrier();
                }
            });
        }
    }
}

impl Tables {
    /// Addresses of everything that depends neither on data nor on macrocells.
    fn push(&self, picture: &Picture) -> Push {
        Push {
            table: self.entries.address(),
            next_active: self.next_active.address(),
            counter: self.counter.address(),
            clips: self.clips.address(),
            rgba: picture.rgba.address(),
            depth: picture.depth.address(),
            samples: picture.samples.address(),
            ..Push::default()
        }
    }
}

impl Share {
    /// As shaders have it.
    fn bits(self) -> u32 {
        self.count << 16 | self.index
    }
}

/// Fills in what depends on voxels.
fn fill_voxels(parameters: &mut Parameters, volume: &DeviceVolume) {
    let [x, y] = volume.sides.map(|n| 1.0 / n as f32);
    parameters.texel = [x, y, volume.texel[0], volume.texel[1]];
    parameters.cells[3] = volume.slab_cells;
    if let Some(planes) = &volume.planes {
        parameters.axis_offset[..3].copy_from_slice(&planes.offsets);
        parameters.bins_per_unit[..3].copy_from_slice(&planes.bins_per_unit);
    }
}

/// Fills in what depends on transfer function and macrocells.
fn fill(parameters: &mut Parameters, look: &Look, lattice: &Lattice, num_clips: usize) {
    let [lo, bins_per_key, largest] = look.table.scale;
    parameters.table_scale = [lo, bins_per_key, largest, look.threshold];
    let cells = lattice.axes().each_ref().map(|a| a.cells() as u32);
    parameters.cells = [cells[0], cells[1], cells[2], 0];
    let last = cells.map(|n| (n - 1) as f32);
    parameters.last_cell = [last[0], last[1], last[2], 1.0 / lattice.side() as f32];
    let [cx, cy, cz] = lattice.counts().map(|n| n as u32);
    parameters.macrocells = [cx, cy, cz, lattice.side() as u32];
    parameters.light = [LIGHT.ambient, LIGHT.diffuse, LIGHT.specular, 0.0];
    parameters.axis_offset[3] = num_clips as u32;
}

/// The push constants of one frame among those that are summed.
pub(super) fn pass(push: Push, settings: &RenderSettings, frame: u32, num_frames: u32) -> Push {
    let number = settings.first_frame.wrapping_add(frame);
    let jitter = match settings.jitter {
        Jitter::Auto => settings.samples_per_pixel > 1 || settings.first_frame > 0,
        Jitter::On => true,
        Jitter::Off => false,
    };
    let is_sum = num_frames > 1 && frame + 1 == num_frames;
    Push {
        offset: pixel_offset(number).map(|v| v as f32),
        jitter: if jitter {
            (f64::from(number) * GOLDEN).fract() as f32
        } else {
            -1.0
        },
        weight: if is_sum { 1.0 / num_frames as f32 } else { 0.0 },
        frame,
        ..push
    }
}
