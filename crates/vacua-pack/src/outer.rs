//! The tree above: over all multi-leaves (variant 1) or over the sub-meshes (variant 2).
//!
//! Source: paper B, §5.5, where this tree is an OptiX BVH. Deviation: here it is our own, eight
//! children wide, their boxes quantised to 8 bits an axis within the node, and its bytes are counted.
//! Deviation: in variant 2 the paper leaves the tree over sub-meshes open; it is this one too.

use bytemuck::{Pod, Zeroable};

use crate::bvh::{self, Below, Box4, LeafMaker, Prim, Scratch};
use crate::collapse::multi_nodes;
use crate::grid::{Grid, exp2};
use crate::layout::WIDTH;

/// Set in a child that is an item.
const ITEM: u32 = 1 << 31;
/// More items than this cannot be told from nodes.
pub const MAX_ITEMS: usize = ITEM as usize;
/// Steps of a node's grid.
const STEPS: u32 = u8::MAX as u32;

/// A node of the outer tree, 96 bytes.
///
/// ```text
/// byte  0  base        3 × f32   corner of the node's grid, relative to the mesh's origin
///      12  exponent    3 × i8    a step is 2 to this
///      15  num_children    u8
///      16  child       8 × u32   bit 31 set: an item; clear: a node, larger than its parent
///      48  lo      3 × 8 × u8    a child's box in steps, axis by axis
///      72  hi      3 × 8 × u8
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct OuterNode {
    base: [f32; 3],
    exponent: [i8; 3],
    num_children: u8,
    child: [u32; WIDTH],
    lo: [[u8; WIDTH]; 3],
    hi: [[u8; WIDTH]; 3],
}

const _: () = {
    assert!(size_of::<OuterNode>() == 96);
    assert!(std::mem::offset_of!(OuterNode, exponent) == 12);
    assert!(std::mem::offset_of!(OuterNode, num_children) == 15);
    assert!(std::mem::offset_of!(OuterNode, child) == 16);
    assert!(std::mem::offset_of!(OuterNode, lo) == 48);
    assert!(std::mem::offset_of!(OuterNode, hi) == 72);
};

/// What a child of an outer node is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OuterChild {
    /// A node.
    Node(u32),
    /// An item: a multi-leaf or a sub-mesh.
    Item(u32),
}

impl OuterNode {
    /// Calls `visit` for the children whose box contains a position relative to the mesh's origin.
    #[inline(always)]
    pub fn children_at(&self, position: [f64; 3], mut visit: impl FnMut(OuterChild)) {
        let steps = [0, 1, 2].map(|axis| {
            (position[axis] - f64::from(self.base[axis])) * exp2(-i32::from(self.exponent[axis]))
        });
        for k in 0..usize::from(self.num_children).min(WIDTH) {
            let inside = (0..3).all(|axis| {
                f64::from(self.lo[axis][k]) <= steps[axis]
                    && steps[axis] <= f64::from(self.hi[axis][k])
            });
            if inside {
                visit(self.child(k));
            }
        }
    }

    /// The corner of its grid, and steps per unit of length.
    #[inline(always)]
    pub(crate) fn grid(&self) -> ([f32; 3], [f32; 3]) {
        let step = |axis: usize| exp2(-i32::from(self.exponent[axis])) as f32;
        (self.base, [step(0), step(1), step(2)])
    }

    /// A child's box in steps of the node's grid.
    #[inline(always)]
    pub(crate) fn child_steps(&self, k: usize) -> ([f32; 3], [f32; 3]) {
        let (lo, hi) = (&self.lo, &self.hi);
        (
            [
                f32::from(lo[0][k]),
                f32::from(lo[1][k]),
                f32::from(lo[2][k]),
            ],
            [
                f32::from(hi[0][k]),
                f32::from(hi[1][k]),
                f32::from(hi[2][k]),
            ],
        )
    }

    /// One child.
    pub fn child(&self, k: usize) -> OuterChild {
        let child = self.child[k];
        if child & ITEM != 0 {
            OuterChild::Item(child & !ITEM)
        } else {
            OuterChild::Node(child)
        }
    }

    /// Number of children.
    pub fn num_children(&self) -> usize {
        usize::from(self.num_children).min(WIDTH)
    }

    /// A child's box, relative to the mesh's origin. Exact.
    pub fn child_box(&self, k: usize) -> ([f64; 3], [f64; 3]) {
        let at = |axis: usize, q: u8| {
            let step = exp2(i32::from(self.exponent[axis]));
            f64::from(self.base[axis]) + f64::from(q) * step
        };
        (
            [0, 1, 2].map(|axis| at(axis, self.lo[axis][k])),
            [0, 1, 2].map(|axis| at(axis, self.hi[axis][k])),
        )
    }
}

/// Leaves of one item each.
struct OneByOne {
    boxes: Vec<Box4>,
}

impl LeafMaker for OneByOne {
    const MAX_PRIMS: usize = 1;

    fn bounds(&self, prim: u32) -> Box4 {
        self.boxes[prim as usize]
    }

    fn leaf(&mut self, prims: &[Prim]) -> Option<(u32, Box4)> {
        match prims {
            [one] => Some((one.number(), self.bounds(one.number()))),
            _ => None,
        }
    }
}

/// Builds the tree over items with these boxes, relative to the mesh's origin; at most
/// [`MAX_ITEMS`].
pub fn build(boxes: impl Iterator<Item = ([f32; 3], [f32; 3])>) -> Vec<OuterNode> {
    let boxes: Vec<Box4> = boxes.map(|(lo, hi)| Box4::new(lo, hi)).collect();
    if boxes.is_empty() {
        return Vec::new();
    }
    let bounds = boxes.iter().fold(Box4::EMPTY, |a, b| a.union(b));
    let num_items = boxes.len() as u32;
    let mut scratch = Scratch::default();
    let nodes = bvh::build(num_items, &bounds, &mut OneByOne { boxes }, &mut scratch);
    let mut outer = Vec::new();
    for wide in multi_nodes(nodes) {
        let bounds = nodes[wide.node as usize].bounds;
        let grid = Grid::with_steps(bounds.lo3(), bounds.hi3(), STEPS);
        let mut node = OuterNode {
            base: grid.base.map(|b| b as f32),
            exponent: grid.exponent.map(|e| e as i8),
            ..OuterNode::zeroed()
        };
        let mut next = wide.first_child;
        for (k, &child) in wide.children.as_slice().iter().enumerate() {
            let child = &nodes[child as usize];
            let (lo, hi) = grid.quantise(child.bounds.lo3(), child.bounds.hi3());
            for axis in 0..3 {
                node.lo[axis][k] = lo[axis] as u8;
                node.hi[axis][k] = hi[axis] as u8;
            }
            node.child[k] = match child.below {
                Below::Leaf(item) => ITEM | item,
                Below::Nodes(..) => {
                    next += 1;
                    next - 1
                }
            };
            node.num_children += 1;
        }
        outer.push(node);
    }
    outer
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_item_is_found_at_its_corners(
            corners in prop::collection::vec(
                prop::array::uniform6(prop_oneof![-1f32..1.0, -1e-6f32..1e-6, 1e30f32..3e38, Just(f32::MIN)]),
                1..100),
        ) {
            let boxes: Vec<_> = corners.iter().map(|c| (
                [0, 1, 2].map(|i| c[i].min(c[i + 3])),
                [0, 1, 2].map(|i| c[i].max(c[i + 3])),
            )).collect();
            let nodes = build(boxes.iter().copied());
            let mut reached = vec![0; boxes.len()];
            for (place, node) in nodes.iter().enumerate() {
                for k in 0..node.num_children() {
                    match node.child(k) {
                        OuterChild::Node(n) => prop_assert!(n as usize > place),
                        OuterChild::Item(i) => {
                            reached[i as usize] += 1;
                            let (lo, hi) = node.child_box(k);
                            for axis in 0..3 {
                                prop_assert!(lo[axis] <= f64::from(boxes[i as usize].0[axis]));
                                prop_assert!(hi[axis] >= f64::from(boxes[i as usize].1[axis]));
                            }
                        }
                    }
                }
            }
            prop_assert!(reached.iter().all(|&n| n == 1));
            for (i, (lo, hi)) in boxes.iter().enumerate() {
                for p in [lo, hi] {
                    let mut found = false;
                    let mut stack = vec![0];
                    while let Some(n) = stack.pop() {
                        nodes[n as usize].children_at(p.map(f64::from), |child| match child {
                            OuterChild::Node(n) => stack.push(n),
                            OuterChild::Item(item) => found |= item as usize == i,
                        });
                    }
                    prop_assert!(found);
                }
            }
        }
    }
}
