//! The boundary of the active macrocells (paper A §4.2.2), and what leads rays to its faces.

use super::{
    Kind, Outline, OutlineKey, Over, Pending, PendingFaces, PendingOver, ShapesKey, Tree, grown,
};
use crate::error::GpuError;
use crate::renderer::job::Job;
use crate::renderer::pipelines::Shader;
use crate::renderer::{GpuRenderer, Plan};
use crate::shared::{FACE_NUMBERS, FACE_WORDS, NODE_WORDS};
use crate::skip::spread;
use crate::vulkan::{CompactedSize, Timings};

/// Most faces whose corners shaders can number.
const MOST_FACES: u32 = 1 << 27;

impl GpuRenderer {
    /// Counts the faces of the boundary, and makes room for their triangles and structures over them.
    pub(super) fn new_triangles(
        &mut self,
        job: &mut Job,
        plan: Plan,
        shapes: ShapesKey,
        older: Option<Outline>,
        timings: &mut Timings,
    ) -> Result<Pending, GpuError> {
        let (num, faces) = self.count_faces(job, plan, timings)?;
        let options = shapes.options;
        // To be moved later, a structure has to have room for more shapes than there are.
        let wanted = if options.refit { num + num / 4 } else { num }.max(1);
        let older_capacity = match &older {
            Some(Outline {
                key:
                    OutlineKey {
                        kind: Kind::Shapes(older),
                        ..
                    },
                over: Over::Structures(structures),
                ..
            }) if older.shape == shapes.shape
                && older.options == options
                && structures.is_built =>
            {
                Some(structures.capacity)
            }
            _ => None,
        };
        let is_update = options.refit
            && !options.compact
            && older_capacity.is_some_and(|room| room >= num.max(1));
        let capacity = match older_capacity {
            Some(room) if is_update => room,
            _ => wanted,
        };
        let sizes = [4 * FACE_WORDS, 4 * FACE_NUMBERS].map(|n| n * u64::from(capacity));
        self.new_structures((job.key, shapes), (num, capacity), sizes, is_update, older)?;
        let pending = Pending {
            faces: Some(faces),
            over: PendingOver::Structures { is_update },
        };
        if options.compact && !is_update {
            return self.compact(job, &pending, timings);
        }
        Ok(pending)
    }

    /// The number of faces, and what will write them.
    fn count_faces(
        &mut self,
        job: &mut Job,
        plan: Plan,
        timings: &mut Timings,
    ) -> Result<(u32, PendingFaces), GpuError> {
        if let Some(cells) = self.macrocells.get_mut(&plan.side) {
            cells.order_bricks(&self.device, &mut self.commands, &self.layout)?;
        }
        let bricks = self.macrocells.get(&plan.side).and_then(|m| m.bricks());
        let Some((address, num_groups)) = bricks else {
            return Err(self.unsupported(&format!(
                "the boundary of macrocells of {} cells a side",
                plan.side
            )));
        };
        let groups = spread(num_groups.into());
        let counts = self.face_counts.take();
        let counts = grown(self, counts, 4 * u64::from(num_groups))?;
        job.parameters.bricks = address;
        job.parameters.num_face_groups = num_groups;
        job.parameters.face_counts = counts.address();
        self.face_counts = Some(counts);
        let steps = self.steps(job, plan)?;
        let mut get = |shader| self.pipelines.get(&self.layout, shader, job.special);
        let count = get(Shader::BoundaryCount)?;
        let scan = get(Shader::BoundaryScan)?;
        let write = get(Shader::BoundaryWrite)?;
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
            let what = format!("a boundary of more than {MOST_FACES} faces");
            return Err(self.unsupported(&what));
        }
        Ok((num, PendingFaces { write, groups }))
    }

    /// Counts the faces of the boundary, and makes room for them and our own hierarchy over them.
    pub(super) fn new_tree(
        &mut self,
        job: &mut Job,
        plan: Plan,
        older: Option<Outline>,
        timings: &mut Timings,
    ) -> Result<Pending, GpuError> {
        let (num, faces) = self.count_faces(job, plan, timings)?;
        let level = self
            .pipelines
            .get(&self.layout, Shader::Tree, job.special)?;
        let (older_faces, older_nodes) = match older {
            Some(Outline {
                faces,
                over: Over::Tree(tree),
                ..
            }) => (Some(faces), Some(tree.nodes)),
            Some(Outline { faces, .. }) => (Some(faces), None),
            None => (None, None),
        };
        let room = |each: u64, num: u64| each * num.max(1);
        let face_bytes = room(4 * FACE_WORDS, num.into());
        let node_bytes = room(4 * NODE_WORDS, Tree::room(num));
        let (skip, kind) = (job.key, Kind::Faces);
        self.outline = Some(Outline {
            key: OutlineKey { skip, kind },
            num,
            faces: grown(self, older_faces, face_bytes)?,
            over: Over::Tree(Tree {
                nodes: grown(self, older_nodes, node_bytes)?,
                height: Tree::height(num),
            }),
        });
        Ok(Pending {
            faces: Some(faces),
            over: PendingOver::Tree(level),
        })
    }

    /// Builds the structure over the boundary now, and copies it to where it takes less memory.
    fn compact(
        &mut self,
        job: &mut Job,
        pending: &Pending,
        timings: &mut Timings,
    ) -> Result<Pending, GpuError> {
        let size = CompactedSize::new(&self.device)?;
        let done = Pending {
            faces: None,
            over: PendingOver::Upper,
        };
        let Some(mut outline) = self.outline.take() else {
            return Ok(done);
        };
        outline.fill(job);
        let Over::Structures(structures) = &outline.over else {
            return Ok(done);
        };
        let found = self.commands.run(&self.layout, |recorder| {
            recorder.stage("tables", |r| {
                r.write(&self.tables.parameters, bytemuck::bytes_of(&job.parameters));
            });
            outline.record_lower(recorder, pending, job);
            recorder.stage("size", |r| r.ask_size(&structures.lower, &size));
            Ok(())
        })?;
        timings.0.extend(found.0);
        let smaller = structures.lower.compacted(size.bytes()?)?;
        let found = self.commands.run(&self.layout, |recorder| {
            recorder.stage("compact", |r| r.compact(&structures.lower, &smaller));
            Ok(())
        })?;
        timings.0.extend(found.0);
        if let Over::Structures(structures) = &mut outline.over {
            structures.lower = smaller;
        }
        self.outline = Some(outline);
        Ok(done)
    }
}
