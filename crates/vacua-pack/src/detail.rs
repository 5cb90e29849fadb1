//! Values at a level of detail: what boxes say of what is in them, without a look at any cell.
//!
//! Sub-meshes, multi-leaves and leaves each have a box and a range of values, which a renderer can
//! take for the values themselves: coarser, and several times as fast.
//!
//! - The boxes of level *sub-mesh* are those around the cells of a sub-mesh; of level *leaf* those of
//!   the leaves; of level *multi-leaf*, for each node with leaves, the smallest around those leaves
//!   (inner nodes below it count for themselves).
//! - The *estimate* at a place is the middle of the smallest range that contains the ranges of all
//!   boxes of the level in which the place is. Where no box is, there is nothing.
//! - Its *bound* is half that range's width: no value that exact sampling finds there is farther off.
//!   A place outside every cell may still be in a box and then has an estimate; a place that exact
//!   sampling has a value for always has one.
//! - In variant `small` the leaves of the tree are clusters, and have no finer ranges in the file: its
//!   level *leaf* is that of clusters.
//!
//! Source: paper B, §5.8 and Figure 4. Deviation: the paper replaces samples by the average of "the
//! first" leaf, multi-leaf or sub-mesh; here all that contain the place count, whatever the order of
//! the search, so that there is a bound, and neighbouring rays agree.
//!
//! A place counts as inside a leaf's box by its coordinates rounded to `f32` in steps of the grid, and
//! only if it is in the exact box of the sub-mesh (variant 1: of the multi-leaf) too. That depends on
//! place and box alone, not on the way through the tree.

mod walk;

pub use walk::Estimates;

use vacua_volume::{ValueMap, ValueRange};

use crate::Variant;
use crate::field::{PackedField, decode_range, decode_step};
use crate::grid::exp2;
use crate::layout::{CHILD_DIVISIONS, Child, MultiLeaf, SubmeshHeader, WIDTH};
use crate::outer::{self, OuterChild, OuterNode};
use crate::packed::{PackedMesh, Submesh};

/// Which boxes stand for what is in them, from the coarsest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum DetailLevel {
    /// One range for all of a sub-mesh.
    Submesh,
    /// One range for the leaves of a node.
    MultiLeaf,
    /// One range a leaf; a cluster in variant `small`.
    Leaf,
}

impl DetailLevel {
    /// All levels, from the coarsest.
    pub const ALL: [Self; 3] = [Self::Submesh, Self::MultiLeaf, Self::Leaf];

    /// The word that `--lod` takes.
    pub fn name(self) -> &'static str {
        match self {
            Self::Submesh => "submesh",
            Self::MultiLeaf => "multileaf",
            Self::Leaf => "leaf",
        }
    }
}

/// A value that stands for others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The middle of the range.
    pub value: f64,
    /// No exact value is farther from it than this.
    pub bound: f64,
}

impl From<ValueRange> for Estimate {
    fn from(range: ValueRange) -> Self {
        let value = 0.5 * range.lo + 0.5 * range.hi;
        // Rounded as a difference to any value between the ends is, or more.
        let bound = (range.hi - value).max(value - range.lo);
        Self { value, bound }
    }
}

/// A slot that contains nothing.
const NO_SLOT: [u8; 2] = [u8::MAX, 0];
/// The slot of all of a sub-mesh.
const WHOLE_SLOT: [u8; 2] = [0, u8::MAX];
/// What a node's box may reach out of the one that its parent stores for it, in sixteenths: both contain
/// its cells, its own is rounded to whole steps.
const OVERHANG: f64 = CHILD_DIVISIONS as f64;
/// A relative error that no coordinate in steps of a grid reaches by rounding.
const ROUNDING: f64 = 1.0 / (1u32 << 22) as f64;

/// What a sub-mesh's slots mean to a renderer.
struct Steps {
    /// Lower ends by step, upper ends by step. Both rise: the least of all that follow, the largest
    /// of all before, which rounding may have put out of order.
    lo: [f32; 256],
    hi: [f32; 256],
}

impl Steps {
    fn new(whole: ValueRange, map: ValueMap) -> Self {
        let mut steps = Self {
            lo: [0.0; 256],
            hi: [0.0; 256],
        };
        for step in 0..=u8::MAX {
            let value = map.rendered(decode_step(whole, step));
            steps.lo[usize::from(step)] = value;
            steps.hi[usize::from(step)] = value;
        }
        for step in 1..256 {
            steps.lo[255 - step] = steps.lo[255 - step].min(steps.lo[256 - step]);
            steps.hi[step] = steps.hi[step].max(steps.hi[step - 1]);
        }
        steps
    }

    /// The rendered ends of a slot.
    fn ends(&self, [lo, hi]: [u8; 2]) -> [f32; 2] {
        [self.lo[usize::from(lo)], self.hi[usize::from(hi)]]
    }
}

/// What the sampler needs to know of a sub-mesh.
struct Part {
    /// The grid's corner, and sixteenths of a step per unit of length.
    base: [f32; 3],
    sixteenths: [f32; 3],
    /// `None` without any finite value.
    steps: Option<Steps>,
}

/// Gives estimates of a field's values at many places.
pub struct DetailSampler<'a> {
    mesh: &'a PackedMesh,
    field: &'a PackedField,
    level: DetailLevel,
    /// Over sub-meshes; with its own memory where the mesh has none.
    tree: std::borrow::Cow<'a, [OuterNode]>,
    /// Whether the items of the tree are multi-leaves.
    items_are_nodes: bool,
    parts: Vec<Part>,
    /// Whether vectors can be trusted with this mesh at all.
    is_tame: bool,
}

impl<'a> DetailSampler<'a> {
    /// Prepares a field of a mesh: a few numbers, and two kibibytes, a sub-mesh. `map` says how stored
    /// values become those that [`Self::sample_all`] gives.
    pub fn new(
        mesh: &'a PackedMesh,
        field: &'a PackedField,
        level: DetailLevel,
        map: ValueMap,
    ) -> Self {
        let items_are_nodes =
            mesh.variant() == Variant::MultiLeaves && level != DetailLevel::Submesh;
        let has_tree = items_are_nodes || mesh.variant() != Variant::MultiLeaves;
        let tree = if has_tree {
            mesh.outer().into()
        } else {
            outer::build(mesh.submeshes().iter().map(|h| (h.lo, h.hi))).into()
        };
        let part = |(number, header): (usize, &SubmeshHeader)| Part {
            base: header.grid_base.map(|b| b as f32),
            sixteenths: header.grid_exponent.map(|e| exp2(4 - e) as f32),
            steps: field.submesh_range(number).map(|r| Steps::new(r, map)),
        };
        Self {
            mesh,
            field,
            level,
            tree,
            items_are_nodes,
            parts: mesh.submeshes().iter().enumerate().map(part).collect(),
            is_tame: is_tame(mesh),
        }
    }

    /// The range of all values that exact sampling may find at a place, relative to the mesh's origin
    /// (see [`PackedMesh::origin`]); `None` where no box of the level has any.
    pub fn range_at(&self, position: [f64; 3]) -> Option<ValueRange> {
        let mut found: Option<ValueRange> = None;
        let in_grid = |submesh: &Submesh, local: [f64; 3]| {
            let steps = submesh.grid.grid_from_local(local);
            steps.map(|g| g * f64::from(CHILD_DIVISIONS))
        };
        self.visit_slots(position, in_grid, |number, slot| {
            let whole = self.field.submesh_range(number);
            if let Some(range) = whole.and_then(|whole| decode_range(whole, slot)) {
                found = Some(found.map_or(range, |f| f.union(range)));
            }
        });
        found
    }

    /// Sub-meshes and slots of all boxes of the level in which a place is.
    fn visit_slots(
        &self,
        position: [f64; 3],
        in_grid: impl Fn(&Submesh, [f64; 3]) -> [f64; 3],
        mut visit: impl FnMut(usize, [u8; 2]),
    ) {
        if !position.iter().all(|c| c.is_finite()) {
            return;
        }
        let origin = self.mesh.origin();
        let mut stack = vec![0];
        let mut nodes = Vec::new();
        while let Some(place) = stack.pop() {
            let Some(node) = self.tree.get(place as usize) else {
                continue;
            };
            let mut items = Vec::new();
            node.children_at(position, |child| match child {
                OuterChild::Node(n) if n > place => stack.push(n),
                OuterChild::Node(_) => {}
                OuterChild::Item(item) => items.push(item),
            });
            for item in items {
                let Some((number, first)) = self.enter(item) else {
                    continue;
                };
                let Some(submesh) = self.mesh.submesh(number) else {
                    continue;
                };
                let moved = submesh.header.origin;
                let local = [0, 1, 2].map(|a| position[a] - (moved[a] - origin[a]));
                let Some((lo, hi)) = self.entry_box(&submesh, first) else {
                    continue;
                };
                if !(0..3).all(|a| lo[a] <= local[a] && local[a] <= hi[a]) {
                    continue;
                }
                if self.level == DetailLevel::Submesh {
                    visit(number, WHOLE_SLOT);
                    continue;
                }
                let at = in_grid(&submesh, local);
                nodes.clear();
                nodes.push(first);
                while let Some(node) = nodes.pop() {
                    self.visit_node(&submesh, number, node, at, &mut nodes, &mut visit);
                }
            }
        }
    }

    /// The sub-mesh of an item of the tree, and its first node to visit.
    fn enter(&self, item: u32) -> Option<(usize, u32)> {
        if !self.items_are_nodes {
            return Some((item as usize, 0));
        }
        let number = self.mesh.submesh_of_node(u64::from(item))?;
        let first = self.mesh.submeshes().get(number)?.first_node;
        let node = u32::try_from(u64::from(item).checked_sub(first)?).ok()?;
        Some((number, node))
    }

    /// The box that a place has to be in for any box of the level below an item to count.
    fn entry_box(&self, submesh: &Submesh, first: u32) -> Option<([f64; 3], [f64; 3])> {
        if !self.items_are_nodes {
            let header = submesh.header;
            return Some((header.lo.map(f64::from), header.hi.map(f64::from)));
        }
        let (node, _) = submesh.node(first)?;
        let at = |q: [u16; 3]| {
            let place = q.map(|q| u32::from(q) * CHILD_DIVISIONS);
            submesh.grid.local_from_sixteenths(place)
        };
        Some((at(node.lo), at(node.hi)))
    }

    /// Visits the slots of a node's boxes in which a place is, given in sixteenths of a step of the
    /// grid, and adds the nodes below in which it may be.
    fn visit_node(
        &self,
        submesh: &Submesh,
        number: usize,
        place: u32,
        at: [f64; 3],
        nodes: &mut Vec<u32>,
        visit: &mut impl FnMut(usize, [u8; 2]),
    ) {
        let Some((node, first_child)) = submesh.node(place) else {
            return;
        };
        let is_in = |(lo, hi): ([u32; 3], [u32; 3]), slack: f64| {
            (0..3).all(|a| f64::from(lo[a]) - slack <= at[a] && at[a] <= f64::from(hi[a]) + slack)
        };
        let slots = self.field.slots(self.mesh, number, place);
        let slots = slots.copied().unwrap_or([NO_SLOT; WIDTH]);
        let mut next = first_child;
        for (k, slot) in slots.iter().enumerate() {
            match node.child(k) {
                Child::Inner => {
                    if next > place && is_in(node.child_box(k), OVERHANG) {
                        nodes.push(next);
                    }
                    next = next.saturating_add(1);
                }
                Child::Leaf(_)
                    if self.level == DetailLevel::Leaf && is_in(node.child_box(k), 0.0) =>
                {
                    visit(number, *slot);
                }
                Child::Leaf(_) | Child::Absent => {}
            }
        }
        if self.level == DetailLevel::MultiLeaf
            && let Some((bounds, slot)) = multi_leaf(node, &slots)
            && is_in(bounds, 0.0)
        {
            visit(number, slot);
        }
    }

    /// Calls `visit` for all boxes of the level in a sub-mesh that have a range: a box around all that
    /// counts as inside, relative to the sub-mesh's origin, and the ends of its range as
    /// [`Self::sample_all`] computes with them.
    pub fn boxes(&self, number: usize, mut visit: impl FnMut([[f64; 3]; 2], [f32; 2])) {
        let steps = self.parts.get(number).and_then(|part| part.steps.as_ref());
        let (Some(submesh), Some(steps)) = (self.mesh.submesh(number), steps) else {
            return;
        };
        let header = submesh.header;
        if self.level == DetailLevel::Submesh {
            let bounds = [header.lo.map(f64::from), header.hi.map(f64::from)];
            visit(bounds, steps.ends(WHOLE_SLOT));
            return;
        }
        let mut one = |(lo, hi): ([u32; 3], [u32; 3]), slot: [u8; 2]| {
            if slot[0] > slot[1] {
                return;
            }
            let widened = |axis: usize, place: u32, side: f64| {
                let at = submesh.grid.local_from_sixteenths_along(axis, place);
                at + side * ROUNDING * (at.abs() + header.grid_base[axis].abs())
            };
            let bounds = [
                [0, 1, 2].map(|a| widened(a, lo[a], -1.0)),
                [0, 1, 2].map(|a| widened(a, hi[a], 1.0)),
            ];
            visit(bounds, steps.ends(slot));
        };
        for place in 0..header.num_nodes {
            let slots = self.field.slots(self.mesh, number, place);
            let (Some((node, _)), Some(slots)) = (submesh.node(place), slots) else {
                continue;
            };
            if self.level == DetailLevel::MultiLeaf {
                if let Some((bounds, slot)) = multi_leaf(node, slots) {
                    one(bounds, slot);
                }
                continue;
            }
            for (k, slot) in slots.iter().enumerate() {
                if let Child::Leaf(_) = node.child(k) {
                    one(node.child_box(k), *slot);
                }
            }
        }
    }
}

/// The smallest box around the leaves of a node, and the smallest slot that contains theirs; `None`
/// without any leaf.
fn multi_leaf(
    node: &MultiLeaf,
    slots: &[[u8; 2]; WIDTH],
) -> Option<(([u32; 3], [u32; 3]), [u8; 2])> {
    let leaves = (0..WIDTH).filter(|&k| matches!(node.child(k), Child::Leaf(_)));
    leaves
        .map(|k| (node.child_box(k), slots[k]))
        .reduce(|((lo, hi), slot), ((l, h), s)| {
            let lo = [0, 1, 2].map(|a| lo[a].min(l[a]));
            let hi = [0, 1, 2].map(|a| hi[a].max(h[a]));
            ((lo, hi), [slot[0].min(s[0]), slot[1].max(s[1])])
        })
}

/// Whether `f32` serves for positions in a mesh: all relative to one origin, of a size that does not
/// overflow.
fn is_tame(mesh: &PackedMesh) -> bool {
    /// Coordinates up to which vectors compute.
    const LARGEST: f32 = 1e30;
    let origin = mesh.origin();
    mesh.submeshes().iter().all(|header| {
        (0..3).all(|a| {
            let base = header.grid_base[a];
            header.origin[a] == origin[a]
                && f64::from(base as f32) == base
                && header.lo[a] >= -LARGEST
                && header.hi[a] <= LARGEST
        })
    })
}
