//! What rays are traced against: the triangulated boundary of the active macrocells (paper A §4.2.2
//! and §4.2.3), or proxy boxes around them, and the acceleration structures over it.
//!
//! The boundary never leaves the device: the host learns the number of its faces, because structures
//! cannot be built over a number that only the device knows. Boxes are clustered on the host, as their
//! authors do it.

use std::time::Instant;

use vacua_render::SkipMethod;
use vacua_skip::{ActiveMask, cluster_boxes};

use super::job::{Job, Preparation, SkipKey, Steps};
use super::pipelines::Shader;
use super::{GpuRenderer, Plan, StructureOptions};
use crate::error::GpuError;
use crate::shared::{FACE_NUMBERS, FACE_WORDS, POINTS_A_GROUP};
use crate::skip::spread;
use crate::vulkan::{
    Buffer, BuildMode, CompactedSize, Place, Recorder, Shapes, Structure, Timings,
};

/// Numbers of a box: two corners.
const BOX_NUMBERS: usize = 6;

/// Most faces whose corners shaders can number.
const MOST_FACES: u32 = 1 << 27;

/// What an outline depends on, besides volume and transfer function.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct OutlineKey {
    skip: SkipKey,
    method: SkipMethod,
    /// What rounding can move a computed coordinate by.
    slack: f32,
    options: StructureOptions,
}

/// What rays are traced against.
pub(super) struct Outline {
    pub key: OutlineKey,
    /// Faces of the boundary, or boxes.
    pub num: u32,
    /// Those that there is room for.
    capacity: u32,
    pub faces: Buffer,
    pub corners: Buffer,
    pub lower: Structure,
    pub upper: Structure,
    instance: Buffer,
}

/// What is left to be recorded before an outline can be used.
pub(super) struct Pending {
    lower: Option<Lower>,
}

struct Lower {
    /// Groups of lattice points; none for boxes, which are there already.
    groups: Option<[u32; 3]>,
    is_update: bool,
}

impl Outline {
    fn shapes(&self) -> Shapes {
        shapes(self.key.method, &self.corners, self.capacity)
    }

    /// The method that it is for.
    pub fn method(&self) -> SkipMethod {
        self.key.method
    }

    /// Bytes of everything.
    pub fn size_bytes(&self) -> u64 {
        let buffers = self.faces.size_bytes() + self.corners.size_bytes();
        buffers + self.lower.size_bytes() + self.upper.size_bytes()
    }

    fn record_upper(&self, recorder: &mut Recorder<'_>) {
        let shapes = Shapes::Instance {
            address: self.instance.address(),
        };
        recorder.stage("tlas", |r| {
            r.write(&self.instance, &self.lower.instance());
            r.barrier();
            r.build(&self.upper, shapes, false);
        });
    }
}

/// What a structure is built over.
fn shapes(method: SkipMethod, corners: &Buffer, capacity: u32) -> Shapes {
    let address = corners.address();
    match method {
        SkipMethod::Boxes => Shapes::Boxes {
            address,
            num: capacity,
        },
        _ => Shapes::Triangles {
            address,
            num: 2 * capacity,
        },
    }
}

/// A buffer of at least so many bytes: an older one if it suffices, else one with room to grow.
fn grown(renderer: &GpuRenderer, older: Option<Buffer>, bytes: u64) -> Result<Buffer, GpuError> {
    match older {
        Some(buffer) if buffer.size_bytes() >= bytes => Ok(buffer),
        older => {
            drop(older);
            let what = "the outline of what is seen";
            Buffer::new(&renderer.device, what, bytes + bytes / 4, Place::Device)
        }
    }
}

impl GpuRenderer {
    /// Brings the outline up to date as far as the host can, and fills in where it lies; what is left
    /// to be recorded, or `None` if it was up to date.
    pub(super) fn outline(
        &mut self,
        job: &mut Job,
        plan: Plan,
        timings: &mut Timings,
    ) -> Result<Option<Pending>, GpuError> {
        let slack = job.parameters.length_sq[3];
        // Lines are where samples are, give or take a rounding, and so is where they are traced from.
        job.parameters.flange = 4.0 * slack;
        let key = OutlineKey {
            skip: job.key,
            method: plan.method,
            slack,
            options: self.options.structures,
        };
        let is_current =
            self.outline_is_current && self.outline.as_ref().is_some_and(|o| o.key == key);
        let pending = if is_current {
            None
        } else {
            let older = self.outline.take();
            self.outline_is_current = false;
            Some(match plan.method {
                SkipMethod::Boxes => self.new_boxes(job, plan, key, older, timings)?,
                _ => self.new_boundary(job, plan, key, older, timings)?,
            })
        };
        if let Some(outline) = &self.outline {
            job.parameters.faces = outline.faces.address();
            job.parameters.corners = outline.corners.address();
        }
        Ok(pending)
    }

    /// Counts the faces of the boundary, and makes room for them.
    fn new_boundary(
        &mut self,
        job: &mut Job,
        plan: Plan,
        key: OutlineKey,
        older: Option<Outline>,
        timings: &mut Timings,
    ) -> Result<Pending, GpuError> {
        let points = self.macrocells.get(&plan.side).and_then(|m| m.points());
        let Some(points) = points else {
            return Err(GpuError::Unsupported {
                what: format!("the boundary of macrocells of {} cells a side", plan.side),
                device: self.device.name().to_owned(),
            });
        };
        let num_groups = points.div_ceil(POINTS_A_GROUP);
        let groups = spread(num_groups.into());
        let counts = self.face_counts.take();
        let counts = grown(self, counts, 4 * u64::from(num_groups))?;
        job.parameters.num_face_groups = num_groups;
        job.parameters.face_counts = counts.address();
        self.face_counts = Some(counts);
        let steps = self.steps(job, plan)?;
        let count = self
            .pipelines
            .get(&self.layout, Shader::BoundaryCount, job.special)?;
        let scan = self
            .pipelines
            .get(&self.layout, Shader::BoundaryScan, job.special)?;
        self.run_first(job, &steps, plan, timings, |recorder, known| {
            recorder.stage("faces", |r| {
                r.dispatch(&count, &job.push, groups);
                r.barrier();
                r.dispatch(&scan, &job.push, [1, 1, 1]);
            });
            recorder.stage("count", |r| {
                r.copy(&known.tables.counter, &known.tables.counted, 0, 8);
            });
        })?;
        let counted: &[u32] = bytemuck::cast_slice(&self.tables.counted.bytes()[..8]);
        let num = counted[1];
        if num > MOST_FACES {
            return Err(self.unsupported(&format!("a boundary of {num} faces")));
        }
        let options = self.options.structures;
        // To be moved later, a structure has to have room for more shapes than there are.
        let wanted = if options.refit { num + num / 4 } else { num }.max(1);
        let is_alike = |o: &Outline| o.key.method == key.method && o.key.options == options;
        let older_capacity = older.as_ref().filter(|o| is_alike(o)).map(|o| o.capacity);
        let is_update = options.refit && older_capacity.is_some_and(|room| room >= num.max(1));
        let capacity = match older_capacity {
            Some(room) if is_update => room,
            _ => wanted,
        };
        let sizes = [4 * FACE_WORDS, 4 * FACE_NUMBERS].map(|n| n * u64::from(capacity));
        self.new_structures(key, (num, capacity), sizes, is_update, older)?;
        if options.compact && !is_update {
            self.compact(job, groups, timings)?;
            return Ok(Pending { lower: None });
        }
        Ok(Pending {
            lower: Some(Lower {
                groups: Some(groups),
                is_update,
            }),
        })
    }

    /// Clusters the active macrocells on the host, and sends the boxes.
    fn new_boxes(
        &mut self,
        job: &mut Job,
        plan: Plan,
        key: OutlineKey,
        older: Option<Outline>,
        timings: &mut Timings,
    ) -> Result<Pending, GpuError> {
        let steps = self.steps(job, plan)?;
        let len = job.lattice.len();
        let mask = Buffer::new(&self.device, "the mask", len as u64, Place::Download)?;
        self.run_first(job, &steps, plan, timings, |recorder, known| {
            recorder.stage("mask", |r| {
                if let Some(cells) = known.cells {
                    r.copy(&cells.maps[0], &mask, 0, len as u64);
                }
            });
        })?;
        let start = Instant::now();
        let mut active = ActiveMask::inactive(job.lattice.counts());
        let [nx, ny, _] = job.lattice.counts();
        for (i, _) in mask.bytes()[..len]
            .iter()
            .enumerate()
            .filter(|(_, b)| **b == 0)
        {
            active.set([i % nx, i / nx % ny, i / (nx * ny)], true);
        }
        let boxes = cluster_boxes(&active);
        timings.0.push(("cluster", start.elapsed().as_secs_f64()));
        let num = u32::try_from(boxes.len()).unwrap_or(u32::MAX);
        let capacity = num.max(1);
        let size = 4 * (BOX_NUMBERS * capacity as usize) as u64;
        self.new_structures(key, (num, capacity), [size; 2], false, older)?;
        let wider = job.parameters.flange;
        // Both as they are and wider, one after the other; what there is no box for is far away.
        let mut numbers = vec![f32::MAX; 2 * BOX_NUMBERS * capacity as usize];
        let (exact, wide) = numbers.split_at_mut(BOX_NUMBERS * capacity as usize);
        for (i, corners) in boxes.iter().enumerate() {
            for (c, corner) in corners.iter().enumerate() {
                for (a, &plane) in corner.iter().enumerate() {
                    let at = BOX_NUMBERS * i + 3 * c + a;
                    exact[at] = job.lattice.plane(a, plane);
                    wide[at] = exact[at] + if c == 0 { -wider } else { wider };
                }
            }
        }
        let bytes: &[u8] = bytemuck::cast_slice(&numbers);
        let mut staging = Buffer::new(&self.device, "boxes", bytes.len() as u64, Place::Upload)?;
        staging.bytes_mut()[..bytes.len()].copy_from_slice(bytes);
        if let Some(outline) = &self.outline {
            let sent = self.commands.run(&self.layout, |recorder| {
                recorder.stage("boxes", |r| {
                    r.copy(&staging, &outline.faces, 0, size);
                    r.copy_between((&staging, size), (&outline.corners, 0), size);
                });
                Ok(())
            })?;
            timings.0.extend(sent.0);
        }
        Ok(Pending {
            lower: Some(Lower {
                groups: None,
                is_update: false,
            }),
        })
    }

    /// Runs what must be known before structures can be made.
    fn run_first(
        &mut self,
        job: &Job,
        steps: &Steps,
        plan: Plan,
        timings: &mut Timings,
        record: impl FnOnce(&mut Recorder<'_>, &Preparation<'_>),
    ) -> Result<(), GpuError> {
        let Some(look) = &self.look else {
            return Ok(());
        };
        let preparation = Preparation {
            job,
            steps,
            tables: &self.tables,
            table: &look.table,
            cells: self.macrocells.get(&plan.side),
        };
        let found = self.commands.run(&self.layout, |recorder| {
            preparation.record(recorder);
            record(recorder, &preparation);
            Ok(())
        })?;
        timings.0.extend(found.0);
        self.done(job, steps);
        Ok(())
    }

    /// Makes room for shapes and structures over them.
    fn new_structures(
        &mut self,
        key: OutlineKey,
        (num, capacity): (u32, u32),
        [face_bytes, corner_bytes]: [u64; 2],
        is_update: bool,
        older: Option<Outline>,
    ) -> Result<(), GpuError> {
        let (mut lower, mut faces, mut corners) = (None, None, None);
        if let Some(outline) = older {
            (lower, faces, corners) = (
                Some(outline.lower),
                Some(outline.faces),
                Some(outline.corners),
            );
        }
        let faces = grown(self, faces, face_bytes)?;
        let corners = grown(self, corners, corner_bytes)?;
        let over = shapes(key.method, &corners, capacity);
        let options = key.options;
        let mode = BuildMode {
            preference: options.preference,
            compactable: options.compact && key.method == SkipMethod::Mesh,
            updatable: options.refit && key.method == SkipMethod::Mesh,
        };
        let lower = match lower {
            Some(lower) if is_update => lower,
            older => Structure::new(&self.device, over, mode, older)?,
        };
        let instance = Buffer::new(&self.device, "an instance", 64, Place::Device)?;
        let above = Shapes::Instance {
            address: instance.address(),
        };
        let mode = BuildMode {
            preference: options.preference,
            ..BuildMode::default()
        };
        let upper = Structure::new(&self.device, above, mode, None)?;
        self.layout.bind_scene(upper.raw());
        self.outline = Some(Outline {
            key,
            num,
            capacity,
            faces,
            corners,
            lower,
            upper,
            instance,
        });
        Ok(())
    }

    /// Builds the structure over the boundary now, and copies it to where it takes less memory.
    fn compact(
        &mut self,
        job: &mut Job,
        groups: [u32; 3],
        timings: &mut Timings,
    ) -> Result<(), GpuError> {
        let size = CompactedSize::new(&self.device)?;
        let pending = Pending {
            lower: Some(Lower {
                groups: Some(groups),
                is_update: false,
            }),
        };
        let Some(mut outline) = self.outline.take() else {
            return Ok(());
        };
        job.parameters.faces = outline.faces.address();
        job.parameters.corners = outline.corners.address();
        let write = self
            .pipelines
            .get(&self.layout, Shader::BoundaryWrite, job.special)?;
        let found = self.commands.run(&self.layout, |recorder| {
            recorder.stage("tables", |r| {
                r.write(&self.tables.parameters, bytemuck::bytes_of(&job.parameters));
            });
            pending.record_lower(recorder, &outline, job, &write);
            recorder.stage("size", |r| r.ask_size(&outline.lower, &size));
            Ok(())
        })?;
        timings.0.extend(found.0);
        let smaller = outline.lower.compacted(size.bytes()?)?;
        let found = self.commands.run(&self.layout, |recorder| {
            recorder.stage("compact", |r| r.compact(&outline.lower, &smaller));
            Ok(())
        })?;
        timings.0.extend(found.0);
        outline.lower = smaller;
        self.outline = Some(outline);
        Ok(())
    }

    /// Records what is left of an outline; the last thing before rays are traced.
    pub(super) fn record_outline(
        recorder: &mut Recorder<'_>,
        pending: &Pending,
        outline: &Outline,
        job: &Job,
        write: &crate::vulkan::ComputePipeline,
    ) {
        pending.record_lower(recorder, outline, job, write);
        outline.record_upper(recorder);
    }
}

impl Pending {
    fn record_lower(
        &self,
        recorder: &mut Recorder<'_>,
        outline: &Outline,
        job: &Job,
        write: &crate::vulkan::ComputePipeline,
    ) {
        let Some(lower) = &self.lower else { return };
        if let Some(groups) = lower.groups {
            recorder.stage("triangles", |r| {
                if outline.num < outline.capacity {
                    // Shapes that there are no faces for are points, which no ray meets.
                    r.clear(&outline.corners);
                    r.barrier();
                }
                r.dispatch(write, &job.push, groups);
            });
        }
        let name = if lower.is_update { "refit" } else { "blas" };
        recorder.stage(name, |r| {
            r.build(&outline.lower, outline.shapes(), lower.is_update)
        });
    }
}
