//! Through the trees, depth first, with a bit for each packet whose box meets that of a node.

use std::collections::VecDeque;

use vacua_simd::{Float, Int, LANES, Mask, Simd, per_axis};

use crate::layout::{CHILD_DIVISIONS, LeafCounts, MultiLeaf, OTHER_INDICES, WIDTH};
use crate::outer::{OuterChild, OuterNode};
use crate::packed::Submesh;
use crate::pairs::bits;

use super::Frame;
use super::packets::{GROUPS, PacketBoxes, PacketMask, load, store};

/// Indices that the primitives of a leaf take, by its counts.
const NUM_INDICES: [u8; 256] = {
    let mut table = [0; 256];
    let mut counts = 0;
    while counts < 256 {
        let (tets, pairs, others) = (counts & 3, counts >> 2 & 15, counts >> 6);
        table[counts] = (4 * tets + 5 * pairs + OTHER_INDICES * others) as u8;
        counts += 1;
    }
    table
};

/// A node or item, and the packets that may have places in it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Visit {
    pub number: u32,
    pub packets: PacketMask,
}

/// A leaf that packets may have places in.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Leaf {
    pub packets: PacketMask,
    /// Its box, in sixteenths of a step of the grid.
    pub lo: [f32; 3],
    pub hi: [f32; 3],
    /// Volume of the box, widened by a sixteenth a side.
    pub volume: f32,
    /// Where its primitives start among the sub-mesh's indices.
    pub first_index: u32,
    /// The node it is in, and how many cells of that come before its own.
    pub node: u32,
    pub cells_before: u32,
    pub counts: u8,
}

/// Leaves of one node.
pub(super) struct NodeLeaves {
    pub leaves: [Leaf; WIDTH],
    pub len: usize,
}

/// Packets that are tried on the eight children of a node one after the other, rather than children
/// on sixteen packets.
const FEW: u32 = 20;

/// The packets of a set whose boxes meet a child's, given by its lower corner and its upper corner
/// with signs turned.
#[inline(always)]
pub(super) fn meeting<S: Simd>(
    boxes: &PacketBoxes,
    packets: PacketMask,
    lo: [f32; 3],
    turned_hi: [f32; 3],
) -> PacketMask {
    let (lo, turned_hi) = (
        per_axis!(a => S::F::splat(lo[a])),
        per_axis!(a => S::F::splat(turned_hi[a])),
    );
    let mut meeting = 0;
    for group in 0..GROUPS {
        let from = group * LANES;
        if (packets >> from) as u16 == 0 {
            continue;
        }
        let meets = per_axis!(a => {
            lo[a].le(load::<S>(&boxes.hi[a], from))
                & turned_hi[a].le(load::<S>(&boxes.turned_lo[a], from))
        });
        let meets = (meets[0] & meets[1] & meets[2]).to_bits();
        meeting |= PacketMask::from(meets) << from;
    }
    meeting & packets
}

/// For each child of a node the packets of a set whose boxes meet its box; `children` has lower
/// corners in the first block and turned upper corners in the second.
#[inline(always)]
fn meeting_each<S: Simd>(
    boxes: &PacketBoxes,
    packets: PacketMask,
    children: &[S::F; 3],
    corners: &[[f32; LANES]; 3],
    there: u8,
) -> [PacketMask; WIDTH] {
    let mut each = [0; WIDTH];
    if packets.count_ones() <= FEW {
        for packet in bits(packets) {
            let meets = per_axis!(a => {
                let (hi, turned_lo) = (boxes.hi[a][packet], boxes.turned_lo[a][packet]);
                children[a].le(S::F::of_blocks(hi, turned_lo))
            });
            let meets = (meets[0] & meets[1] & meets[2]).to_bits();
            let meets = PacketMask::from(meets as u8 & (meets >> WIDTH) as u8 & there);
            for (child, each) in each.iter_mut().enumerate() {
                *each |= (meets >> child & 1) << packet;
            }
        }
    } else {
        let mut left = there;
        while left != 0 {
            let child = left.trailing_zeros() as usize;
            left &= left - 1;
            let lo = per_axis!(i => corners[i][child]);
            let turned_hi = per_axis!(i => corners[i][WIDTH + child]);
            each[child] = meeting::<S>(boxes, packets, lo, turned_hi);
        }
    }
    each
}

impl PacketBoxes {
    /// The same boxes in the steps of a grid: rounding is monotone.
    #[inline(always)]
    fn on_grid<S: Simd>(&self, base: [f32; 3], per_unit: [f32; 3]) -> Self {
        let mut on_grid = self.clone();
        for axis in 0..3 {
            let (base, per_unit) = (S::F::splat(base[axis]), S::F::splat(per_unit[axis]));
            for group in 0..GROUPS {
                let from = group * LANES;
                let hi = (load::<S>(&self.hi[axis], from) - base) * per_unit;
                let turned_lo = (load::<S>(&self.turned_lo[axis], from) + base) * per_unit;
                store::<S>(hi, &mut on_grid.hi[axis], from);
                store::<S>(turned_lo, &mut on_grid.turned_lo[axis], from);
            }
        }
        on_grid
    }

    /// The same boxes in sixteenths of a step of a sub-mesh's grid.
    #[inline(always)]
    pub fn in_sixteenths<S: Simd>(&self, frame: &Frame) -> Self {
        self.on_grid::<S>(frame.base, frame.sixteenths)
    }
}

/// Lower corners of a node's children in the first block, turned upper corners in the second.
#[inline(always)]
pub(crate) fn child_boxes<S: Simd>(node: &MultiLeaf) -> [S::F; 3] {
    let one_more = S::F::of_blocks(0.0, 1.0);
    per_axis!(i => {
        let from = f32::from(node.lo[i]) * CHILD_DIVISIONS as f32;
        let width = f32::from(node.hi[i].saturating_sub(node.lo[i]));
        let steps = S::f_from_i(S::nibbles(node.child_bounds[i])) + one_more;
        // Whole numbers below 2^24: exact.
        steps.mul_add(S::F::of_blocks(width, -width), S::F::of_blocks(from, -from))
    })
}

/// A bit for each byte that is not 0.
#[inline(always)]
pub(crate) fn nonzero_bytes(bytes: [u8; WIDTH]) -> u8 {
    const LOW: u64 = 0x7F7F_7F7F_7F7F_7F7F;
    let word = u64::from_le_bytes(bytes);
    lowest_bits(((((word & LOW) + LOW) | word) >> 7) & 0x0101_0101_0101_0101)
}

/// The lowest bit of each byte; all others must be 0.
#[inline(always)]
fn lowest_bits(bytes: u64) -> u8 {
    (bytes.wrapping_mul(0x0102_0408_1020_4080) >> 56) as u8
}

/// A bit for each child that is there, leaf or node: the upper nibble along x is not below the lower.
#[inline(always)]
pub(crate) fn ordered_nibbles(bytes: [u8; WIDTH]) -> u8 {
    const NIBBLE: u64 = 0x0F0F_0F0F_0F0F_0F0F;
    let word = u64::from_le_bytes(bytes);
    let (lo, hi) = (word & NIBBLE, word >> 4 & NIBBLE);
    // 16 more in each byte, so that no difference borrows from the next.
    lowest_bits((hi + (NIBBLE + 0x0101_0101_0101_0101) - lo) >> 4 & 0x0101_0101_0101_0101)
}

/// Visits a node: its inner children that packets meet go on the stack, the first on top; its leaves
/// that packets meet are collected.
#[inline(always)]
pub(super) fn visit_node<S: Simd>(
    submesh: &Submesh,
    boxes: &PacketBoxes,
    visit: Visit,
    stack: &mut VecDeque<Visit>,
    found: &mut NodeLeaves,
) {
    found.len = 0;
    let Visit { number, packets } = visit;
    let Some((node, first_child)) = submesh.node(number) else {
        return;
    };
    let vectors = child_boxes::<S>(node);
    let corners = per_axis!(i => vectors[i].to_array());
    let leaf_bits = nonzero_bytes(node.counts);
    let inner = ordered_nibbles(node.child_bounds[0]) & !leaf_bits;
    let there = inner | leaf_bits;
    let meeting = meeting_each::<S>(boxes, packets, &vectors, &corners, there);
    let mut left = inner;
    while left != 0 {
        let child = 7 - left.leading_zeros() as usize;
        left &= !(1 << child);
        let meeting = meeting[child];
        let before = (inner & ((1u8 << child) - 1)).count_ones();
        let below = first_child.saturating_add(before);
        // Children come after their parents, so that no walk is endless.
        if meeting != 0 && below > number {
            submesh.prefetch_node(below);
            stack.push_back(Visit {
                number: below,
                packets: meeting,
            });
        }
    }
    if leaf_bits == 0 {
        return;
    }
    let (zero, one) = (S::F::splat(0.0), S::F::splat(1.0));
    let flip = S::I::from_array([8, 9, 10, 11, 12, 13, 14, 15, 0, 1, 2, 3, 4, 5, 6, 7]);
    let side = per_axis!(i => zero - vectors[i] - vectors[i].permute(flip) + one);
    let volumes = (side[0] * side[1] * side[2]).to_array();
    let mut first_index = node.first_index;
    let mut cells_before = 0;
    for child in 0..WIDTH {
        // Met as often as not: written without a branch, and overwritten if it is none.
        let counts = node.counts[child];
        submesh.prefetch_indices(first_index);
        found.leaves[found.len % WIDTH] = Leaf {
            packets: meeting[child],
            lo: per_axis!(i => corners[i][child]),
            hi: per_axis!(i => -corners[i][WIDTH + child]),
            volume: volumes[child],
            first_index,
            node: number,
            cells_before,
            counts,
        };
        found.len += usize::from(counts != 0 && meeting[child] != 0);
        first_index = first_index.wrapping_add(u32::from(NUM_INDICES[usize::from(counts)]));
        cells_before += LeafCounts::unpack(counts).num_cells() as u32;
    }
}

/// The items of the outer tree whose boxes packets meet, in order.
#[inline(always)]
pub(super) fn outer_items<S: Simd>(
    tree: &[OuterNode],
    boxes: &PacketBoxes,
    packets: PacketMask,
    stack: &mut VecDeque<Visit>,
    items: &mut Vec<Visit>,
) {
    stack.push_back(Visit { number: 0, packets });
    while let Some(Visit { number, packets }) = stack.pop_back() {
        let Some(node) = tree.get(number as usize) else {
            continue;
        };
        let (base, per_unit) = node.grid();
        let boxes = boxes.on_grid::<S>(base, per_unit);
        for child in 0..node.num_children() {
            let (lo, hi) = node.child_steps(child);
            let turned_hi = per_axis!(a => -hi[a]);
            let packets = meeting::<S>(&boxes, packets, lo, turned_hi);
            if packets == 0 {
                continue;
            }
            match node.child(child) {
                // Children come after their parents, so that no walk is endless.
                OuterChild::Node(below) if below > number => stack.push_back(Visit {
                    number: below,
                    packets,
                }),
                OuterChild::Node(_) => {}
                OuterChild::Item(number) => items.push(Visit { number, packets }),
            }
        }
    }
    items.sort_unstable_by_key(|item| item.number);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn bytes_become_bits(bytes in prop::array::uniform8(prop_oneof![Just(0u8), any::<u8>()])) {
            for i in 0..WIDTH {
                prop_assert_eq!(nonzero_bytes(bytes) >> i & 1 == 1, bytes[i] != 0);
                prop_assert_eq!(ordered_nibbles(bytes) >> i & 1 == 1, bytes[i] & 15 <= bytes[i] >> 4);
            }
        }
    }

    #[test]
    fn tables_are_what_the_counts_say() {
        for byte in 0..=255u8 {
            let expected = LeafCounts::unpack(byte).num_indices();
            assert_eq!(usize::from(NUM_INDICES[usize::from(byte)]), expected);
        }
    }
}
