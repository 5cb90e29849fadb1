//! What rays are traced against: the triangulated boundary of the active macrocells (paper A §4.2.2
//! and §4.2.3) or proxy boxes around them, under acceleration structures of the driver, or the boundary
//! under a hierarchy of our own.
//!
//! The boundary never leaves the device: the host learns the number of its faces, because structures
//! cannot be built over a number that only the device knows. Boxes are clustered on the host, as their
//! authors do it.

mod boundary;
mod boxes;

use std::sync::Arc;

use vacua_render::SkipMethod;

use super::job::{Job, Preparation, SkipKey, Steps};
use super::{GpuRenderer, Plan, StructureOptions, Tracer};
use crate::error::GpuError;
use crate::shared::{Push, TREE_GROUP, TREE_WIDTH};
use crate::skip::spread;
use crate::vulkan::{
    Buffer, BuildMode, ComputePipeline, Place, Recorder, Shapes, Structure, Timings,
};

/// Numbers of a box: two corners.
const BOX_NUMBERS: usize = 6;

/// What a structure of the driver is built over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shape {
    /// Two triangles for each face of the boundary.
    Triangles,
    /// Proxy boxes.
    Boxes,
}

/// What an outline is.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    /// Faces of the boundary, under our own hierarchy.
    Faces,
    /// Shapes under structures of the driver.
    Shapes(ShapesKey),
}

/// What shapes and structures over them depend on, besides what is active.
#[derive(Clone, Copy, Debug, PartialEq)]
struct ShapesKey {
    shape: Shape,
    /// What rounding can move a computed coordinate by.
    slack: f32,
    options: StructureOptions,
}

/// What an outline depends on, besides volume and transfer function.
#[derive(Clone, Copy, Debug, PartialEq)]
struct OutlineKey {
    skip: SkipKey,
    kind: Kind,
}

/// What rays are traced against.
pub(super) struct Outline {
    key: OutlineKey,
    /// Faces of the boundary, or boxes.
    pub num: u32,
    pub faces: Buffer,
    over: Over,
}

/// What leads rays to faces or boxes.
enum Over {
    Structures(Box<Structures>),
    Tree(Tree),
}

/// Acceleration structures of the driver.
struct Structures {
    shape: Shape,
    /// Faces or boxes that there is room for.
    capacity: u32,
    corners: Buffer,
    lower: Structure,
    /// Whether the lower one was ever built, so that it can be moved.
    is_built: bool,
    upper: Structure,
    instance: Buffer,
}

/// Our own hierarchy.
struct Tree {
    nodes: Buffer,
    /// Levels of it.
    height: u32,
}

/// What is left to be recorded before an outline can be used.
pub(super) struct Pending {
    faces: Option<PendingFaces>,
    over: PendingOver,
}

/// The boundary's faces, by groups of lattice points.
struct PendingFaces {
    write: Arc<ComputePipeline>,
    groups: [u32; 3],
}

enum PendingOver {
    /// The lower structure is there.
    Upper,
    Structures {
        /// Whether the lower one is moved instead of built.
        is_update: bool,
    },
    Tree(Arc<ComputePipeline>),
}

impl Outline {
    /// Whether it is the boundary.
    pub fn is_boundary(&self) -> bool {
        !matches!(
            self.key.kind,
            Kind::Shapes(ShapesKey {
                shape: Shape::Boxes,
                ..
            })
        )
    }

    /// What was recorded for it has been done.
    pub fn set_built(&mut self) {
        if let Over::Structures(structures) = &mut self.over {
            structures.is_built = true;
        }
    }

    /// Corners of the triangles or boxes, if there are any.
    pub fn corners(&self) -> Option<&Buffer> {
        match &self.over {
            Over::Structures(structures) => Some(&structures.corners),
            Over::Tree(_) => None,
        }
    }

    /// Bytes of everything, and of what leads rays to triangles, faces or boxes alone.
    pub fn size_bytes(&self) -> [u64; 2] {
        let [over, alone] = match &self.over {
            Over::Structures(s) => {
                let lower = s.lower.size_bytes();
                [s.corners.size_bytes() + lower + s.upper.size_bytes(), lower]
            }
            Over::Tree(tree) => [tree.nodes.size_bytes(); 2],
        };
        [self.faces.size_bytes() + over, alone]
    }

    /// Tells shaders where it lies.
    fn fill(&self, job: &mut Job) {
        let parameters = &mut job.parameters;
        parameters.faces = self.faces.address();
        parameters.corners = self.corners().map_or(0, Buffer::address);
        parameters.num_shapes = self.num;
        if let Over::Tree(tree) = &self.over {
            parameters.nodes = tree.nodes.address();
            parameters.tree_height = tree.height;
        }
    }

    /// Records what is left of it; the last thing before rays are traced.
    pub fn record(&self, recorder: &mut Recorder<'_>, pending: &Pending, job: &Job) {
        self.record_lower(recorder, pending, job);
        if let Over::Structures(structures) = &self.over {
            structures.record_upper(recorder);
        }
    }

    fn record_lower(&self, recorder: &mut Recorder<'_>, pending: &Pending, job: &Job) {
        if let Some(faces) = &pending.faces {
            recorder.stage("triangles", |r| {
                if let Over::Structures(s) = &self.over
                    && self.num < s.capacity
                {
                    // Shapes that there are no faces for are points, which no ray meets.
                    r.clear(&s.corners);
                    r.barrier();
                }
                r.dispatch(&faces.write, &job.push, faces.groups);
            });
        }
        match (&self.over, &pending.over) {
            (Over::Structures(s), &PendingOver::Structures { is_update }) => {
                let shapes = s.shape.over(&s.corners, s.capacity);
                let name = if is_update { "refit" } else { "blas" };
                recorder.stage(name, |r| r.build(&s.lower, shapes, is_update));
            }
            (Over::Tree(tree), PendingOver::Tree(level)) => {
                recorder.stage("tree", |r| tree.record(r, level, &job.push, self.num));
            }
            _ => {}
        }
    }
}

impl Structures {
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

impl Tree {
    /// Levels of a tree over so many faces.
    fn height(num: u32) -> u32 {
        let mut height = 0;
        let mut nodes = num;
        while nodes > 1 || height == 0 && nodes > 0 {
            nodes = nodes.div_ceil(TREE_WIDTH);
            height += 1;
        }
        height
    }

    /// Nodes that there must be room for: every level but the lowest has room for all that it could have.
    fn room(num: u32) -> u64 {
        let above: u64 = (0..Self::height(num).saturating_sub(1))
            .map(|depth| u64::from(TREE_WIDTH).pow(depth))
            .sum();
        above + u64::from(num.div_ceil(TREE_WIDTH))
    }

    /// Builds level by level, from the lowest to the one below the root, whose bounds nobody asks for.
    fn record(&self, recorder: &Recorder<'_>, level: &ComputePipeline, push: &Push, num: u32) {
        let mut nodes = u64::from(num);
        for height in 1..self.height {
            nodes = nodes.div_ceil(u64::from(TREE_WIDTH));
            recorder.barrier();
            let push = Push {
                pass: height,
                ..*push
            };
            recorder.dispatch(level, &push, spread(nodes.div_ceil(TREE_GROUP)));
        }
    }
}

impl Shape {
    /// As many as there is room for.
    fn over(self, corners: &Buffer, capacity: u32) -> Shapes {
        let address = corners.address();
        match self {
            Self::Boxes => Shapes::Boxes {
                address,
                num: capacity,
            },
            Self::Triangles => Shapes::Triangles {
                address,
                num: 2 * capacity,
            },
        }
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
        tracer: Tracer,
        timings: &mut Timings,
    ) -> Result<Option<Pending>, GpuError> {
        let slack = job.parameters.length_sq[3];
        // Lines are where samples are, give or take a rounding, and so is where they are traced from.
        job.parameters.flange = 4.0 * slack;
        let under_structures = |shape| {
            Kind::Shapes(ShapesKey {
                shape,
                slack,
                options: self.options.structures,
            })
        };
        let key = OutlineKey {
            skip: job.key,
            kind: match (plan.method, tracer) {
                (SkipMethod::Boxes, _) => under_structures(Shape::Boxes),
                (_, Tracer::Packets) => Kind::Faces,
                _ => under_structures(Shape::Triangles),
            },
        };
        let is_current =
            self.outline_is_current && self.outline.as_ref().is_some_and(|o| o.key == key);
        let pending = if is_current {
            None
        } else {
            let older = self.outline.take();
            self.outline_is_current = false;
            Some(match key.kind {
                Kind::Faces => self.new_tree(job, plan, older, timings)?,
                Kind::Shapes(shapes) => match shapes.shape {
                    Shape::Boxes => self.new_boxes(job, plan, shapes, older, timings)?,
                    Shape::Triangles => self.new_triangles(job, plan, shapes, older, timings)?,
                },
            })
        };
        if let Some(outline) = &self.outline {
            outline.fill(job);
        }
        Ok(pending)
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
        (skip, shapes): (SkipKey, ShapesKey),
        (num, capacity): (u32, u32),
        [face_bytes, corner_bytes]: [u64; 2],
        is_update: bool,
        older: Option<Outline>,
    ) -> Result<(), GpuError> {
        let (older_faces, older) = match older {
            Some(Outline {
                faces,
                over: Over::Structures(structures),
                ..
            }) => (Some(faces), Some((structures.lower, structures.corners))),
            Some(Outline { faces, .. }) => (Some(faces), None),
            None => (None, None),
        };
        let (older_lower, older_corners) = older.unzip();
        let faces = grown(self, older_faces, face_bytes)?;
        let corners = grown(self, older_corners, corner_bytes)?;
        let ShapesKey { shape, options, .. } = shapes;
        let over = shape.over(&corners, capacity);
        let mode = BuildMode {
            preference: options.preference,
            compactable: options.compact && shape == Shape::Triangles,
            updatable: options.refit && shape == Shape::Triangles,
        };
        let lower = match older_lower {
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
        let kind = Kind::Shapes(shapes);
        self.outline = Some(Outline {
            key: OutlineKey { skip, kind },
            num,
            faces,
            over: Over::Structures(Box::new(Structures {
                shape,
                capacity,
                corners,
                lower,
                is_built: false,
                upper,
                instance,
            })),
        });
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heights_and_room_of_trees() {
        for (num, height, room) in [
            (0, 0, 0),
            (1, 1, 1),
            (32, 1, 1),
            (33, 2, 1 + 2),
            (1024, 2, 1 + 32),
            (1025, 3, 1 + 32 + 33),
            (1 << 27, 6, 1 + 32 + 1024 + 32768 + 1_048_576 + (1 << 22)),
        ] {
            assert_eq!(
                (Tree::height(num), Tree::room(num)),
                (height, room),
                "{num}"
            );
        }
    }
}
