//! A binary bounding volume hierarchy by the surface area heuristic: what multi-nodes are made of.
//!
//! Source: paper B, §5.7. A traversal step costs as much as [`TRAVERSAL_COST`] primitives, of which a
//! pair of tetrahedra is one ([`LeafMaker::primitive_cost`]). A node
//! becomes a leaf when no split is cheaper *and* whoever builds can encode such a leaf; otherwise it
//! is split all the same. Sixteen bins an axis for many primitives (a sample of them for very many),
//! every place for few.
//!
//! The shape of the tree is decided on boxes of sixteen bits within a frame, a quarter of the work
//! that `f32` is; where centres come to lie within a few steps of it, those below get a frame of
//! their own. Boxes of nodes are exact. Deterministic: the result depends on the primitives and
//! their order alone.

mod few;
mod prim;

use few::FEW;
use prim::{Around, Lanes};
pub use prim::{Box4, Frame, Prim};

/// What a traversal step costs, in primitives.
pub const TRAVERSAL_COST: f32 = 2.0;
/// Deeper than this, nodes split in the middle of their list, which bounds the depth by
/// this + log2(primitives).
const MAX_SAH_DEPTH: usize = 48;
/// Bins an axis.
const BINS: usize = 16;
/// Of more primitives than this only every second, third … is binned, at least so many of them.
const MIN_SAMPLES: usize = 1024;
/// Where centres lie within fewer steps, a finer frame is tried.
const COARSE_STEPS: u32 = 256;

/// What a binary node has below it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Below {
    /// Two nodes.
    Nodes(u32, u32),
    /// A leaf, by the number that its maker gave.
    Leaf(u32),
}

/// A node of the binary tree.
#[derive(Clone, Copy, Debug)]
pub struct BinaryNode {
    /// Box around everything below.
    pub bounds: Box4,
    /// What is below.
    pub below: Below,
}

/// Knows the primitives, and makes leaves of some.
pub trait LeafMaker {
    /// More primitives than this are never offered.
    const MAX_PRIMS: usize;

    /// What testing a primitive costs.
    fn primitive_cost(&self) -> f32 {
        1.0
    }

    /// The box of a primitive.
    fn bounds(&self, prim: u32) -> Box4;

    /// Asks for a primitive that may soon be in a leaf.
    fn prefetch(&self, _prim: u32) {}

    /// Makes a leaf and gives its number and its box, or refuses what cannot be encoded. A single
    /// primitive is never refused.
    fn leaf(&mut self, prims: &[Prim]) -> Option<(u32, Box4)>;
}

/// Memory that builds use one after the other.
#[derive(Default)]
pub struct Scratch {
    prims: Vec<Prim>,
    nodes: Vec<BinaryNode>,
}

/// Builds the tree over primitives 0 to `num_prims`, at least one, whose boxes lie within `bounds`.
/// Nodes come after those below them, the root is last.
pub fn build<'s, M: LeafMaker>(
    num_prims: u32,
    bounds: &Box4,
    maker: &mut M,
    scratch: &'s mut Scratch,
) -> &'s [BinaryNode] {
    let Scratch { prims, nodes } = scratch;
    let frame = Frame::new(bounds);
    prims.clear();
    prims.extend((0..num_prims).map(|i| frame.prim(i, &maker.bounds(i))));
    nodes.clear();
    nodes.reserve(prims.len() / 2 + 2);
    Builder { maker, nodes }.build(prims, &frame, 0, true);
    nodes
}

struct Builder<'a, M> {
    maker: &'a mut M,
    nodes: &'a mut Vec<BinaryNode>,
}

impl<M: LeafMaker> Builder<'_, M> {
    /// Builds the tree over primitives and gives its root. `is_own_frame`: the frame was made for
    /// just these primitives.
    fn build(
        &mut self,
        prims: &mut [Prim],
        frame: &Frame,
        depth: usize,
        is_own_frame: bool,
    ) -> u32 {
        let around = Around::of(prims);
        if !is_own_frame && prims.len() > 2 && around.widest() < COARSE_STEPS {
            let bounds = prims
                .iter()
                .fold(Box4::EMPTY, |b, p| b.union(&self.maker.bounds(p.number())));
            let finer = Frame::new(&bounds);
            for p in prims.iter_mut() {
                *p = finer.prim(p.number(), &self.maker.bounds(p.number()));
            }
            return self.build(prims, &finer, depth, true);
        }
        if prims.len() <= FEW {
            return self.build_few(prims, frame, depth);
        }
        let (after, middle) = if depth >= MAX_SAH_DEPTH {
            (f32::INFINITY, prims.len() / 2)
        } else {
            binned(prims, frame, &around)
        };
        if prims.len() <= M::MAX_PRIMS
            && self.wants_leaf(after, prims.len())
            && let Some(node) = self.leaf(prims)
        {
            return node;
        }
        let (left, right) = prims.split_at_mut(middle);
        let left = self.build(left, frame, depth + 1, false);
        let right = self.build(right, frame, depth + 1, false);
        self.push(Below::Nodes(left, right))
    }

    /// Whether a leaf is no dearer than the best split, after which so many tests are left.
    fn wants_leaf(&self, tests_after: f32, n: usize) -> bool {
        TRAVERSAL_COST / self.maker.primitive_cost() + tests_after >= n as f32
    }

    /// Whether a leaf is no dearer than any split.
    fn is_leaf_anyway(&self, n: usize) -> bool {
        n < 2 || self.wants_leaf(0.0, n)
    }

    fn leaf(&mut self, prims: &[Prim]) -> Option<u32> {
        let (leaf, bounds) = self.maker.leaf(prims)?;
        self.nodes.push(BinaryNode {
            bounds,
            below: Below::Leaf(leaf),
        });
        Some((self.nodes.len() - 1) as u32)
    }

    fn push(&mut self, below: Below) -> u32 {
        let bounds = match below {
            Below::Nodes(a, b) => self.nodes[a as usize]
                .bounds
                .union(&self.nodes[b as usize].bounds),
            Below::Leaf(_) => Box4::EMPTY,
        };
        self.nodes.push(BinaryNode { bounds, below });
        (self.nodes.len() - 1) as u32
    }
}

/// Primitives still to be tested after a split into boxes of these areas and counts, on average. A
/// flat parent (area 0) is never worth splitting.
#[inline(always)]
fn tests_after_split(weighted_areas: f32, parent_area: f32) -> f32 {
    let tests = weighted_areas / parent_area;
    if tests.is_nan() { f32::INFINITY } else { tests }
}

/// Partitions the primitives by the best of the planes between bins; gives the tests left
/// after it, and its place.
fn binned(prims: &mut [Prim], frame: &Frame, around: &Around) -> (f32, usize) {
    let n = prims.len();
    // In fixed point, rounded down: the largest centre is in the last bin.
    let scale_along = |axis| ((BINS as u64) << 32) / u64::from(around.spread(axis) + 1);
    let scale = [scale_along(0), scale_along(1), scale_along(2)];
    let bin_of = |p: &Prim, axis: usize| {
        let steps = (i32::from(p.center(axis)) - i32::from(around.lo[axis])) as u32;
        (u64::from(steps).wrapping_mul(scale[axis]) >> 32) as usize % BINS
    };
    let mut bins = [[Lanes::EMPTY; BINS]; 3];
    let mut counts = [[0u32; BINS]; 3];
    for p in prims.iter().step_by((n / MIN_SAMPLES).max(1)) {
        let bounds = p.bounds();
        for axis in 0..3 {
            let bin = bin_of(p, axis);
            bins[axis][bin] = bins[axis][bin].union(&bounds);
            counts[axis][bin] += 1;
        }
    }
    let mut best = (f32::INFINITY, 0, 0);
    for axis in 0..3 {
        let (bins, counts) = (&bins[axis], &counts[axis]);
        let mut right = [(0.0f32, 0u32); BINS];
        let (mut b, mut count) = (Lanes::EMPTY, 0);
        for k in (1..BINS).rev() {
            b = b.union(&bins[k]);
            count += counts[k];
            right[k] = (frame.half_area(&b) * count as f32, count);
        }
        let (mut b, mut count) = (Lanes::EMPTY, 0);
        for k in 1..BINS {
            b = b.union(&bins[k - 1]);
            count += counts[k - 1];
            if count == 0 || right[k].1 == 0 {
                continue;
            }
            let weighted = frame.half_area(&b) * count as f32 + right[k].0;
            if weighted < best.0 {
                best = (weighted, axis, k);
            }
        }
    }
    let (weighted, axis, plane) = best;
    if plane == 0 {
        return (f32::INFINITY, n / 2);
    }
    let middle = partition(prims, |p| bin_of(p, axis) < plane);
    let parent = frame.half_area(&around.bounds);
    (tests_after_split(weighted, parent), middle)
}

/// Moves those for which `is_left` holds to the front and returns their number. No branch depends on
/// the answers.
#[inline(always)]
pub fn partition<T: Copy>(items: &mut [T], mut is_left: impl FnMut(&T) -> bool) -> usize {
    let mut num_left = 0;
    for k in 0..items.len() {
        let left = is_left(&items[k]);
        items.swap(k, num_left);
        num_left += usize::from(left);
    }
    num_left
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    struct Lists<'a> {
        boxes: &'a [Box4],
        most: usize,
        lists: Vec<Vec<u32>>,
    }

    fn around(boxes: impl Iterator<Item = Box4>) -> Box4 {
        boxes.fold(Box4::EMPTY, |a, b| a.union(&b))
    }

    impl LeafMaker for Lists<'_> {
        const MAX_PRIMS: usize = 33;
        fn bounds(&self, prim: u32) -> Box4 {
            self.boxes[prim as usize]
        }
        fn leaf(&mut self, prims: &[Prim]) -> Option<(u32, Box4)> {
            (prims.len() <= self.most).then(|| {
                self.lists.push(prims.iter().map(Prim::number).collect());
                let bounds = around(prims.iter().map(|p| self.bounds(p.number())));
                ((self.lists.len() - 1) as u32, bounds)
            })
        }
    }

    fn check(boxes: &[Box4], most: usize) {
        let mut maker = Lists {
            boxes,
            most,
            lists: Vec::new(),
        };
        let bounds = around(boxes.iter().copied());
        let mut scratch = Scratch::default();
        let nodes = build(boxes.len() as u32, &bounds, &mut maker, &mut scratch);
        let mut seen = vec![0; boxes.len()];
        let mut referenced = vec![0; nodes.len()];
        for node in nodes {
            let contains = |b: &Box4| {
                (0..3).all(|i| node.bounds.lo[i] <= b.lo[i] && b.hi[i] <= node.bounds.hi[i])
            };
            match node.below {
                Below::Leaf(leaf) => {
                    for &p in &maker.lists[leaf as usize] {
                        seen[p as usize] += 1;
                        assert!(contains(&boxes[p as usize]));
                    }
                }
                Below::Nodes(a, b) => {
                    for child in [a, b] {
                        referenced[child as usize] += 1;
                        assert!(contains(&nodes[child as usize].bounds));
                    }
                }
            }
        }
        assert!(seen.iter().all(|&n| n == 1));
        assert_eq!(referenced.pop(), Some(0), "the root is last");
        assert!(referenced.iter().all(|&n| n == 1));
    }

    #[test]
    fn equal_and_flat_boxes_build_in_bounded_depth() {
        let same = Box4 {
            lo: [1.0; 4],
            hi: [1.0; 4],
        };
        check(&vec![same; 100_000], 3);
        let line: Vec<Box4> = (0..5000)
            .map(|i| {
                let x = 0.5f32.powi(i / 40);
                Box4 {
                    lo: [x, 0.0, 0.0, 0.0],
                    hi: [x, 0.0, 0.0, 0.0],
                }
            })
            .collect();
        check(&line, 1);
    }

    proptest! {
        #[test]
        fn every_primitive_is_in_one_leaf_and_boxes_contain(
            corners in prop::collection::vec(prop::array::uniform6(-1e30f32..1e30), 1..300),
            most in 1usize..33,
        ) {
            let boxes: Vec<Box4> = corners.iter().map(|c| {
                Box4::EMPTY
                    .with_point([c[0], c[1], c[2], 0.0])
                    .with_point([c[3], c[4], c[5], 0.0])
            }).collect();
            check(&boxes, most);
        }
    }
}
