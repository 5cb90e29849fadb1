//! Through the trees, breadth first, a mask of lanes with every node.

use vacua_simd::{Float, Int, LANES, Mask, Simd, per_axis};

use crate::layout::{CHILD_DIVISIONS, MultiLeaf, OTHER_INDICES, WIDTH};
use crate::outer::{OuterChild, OuterNode};
use crate::packed::Submesh;

use super::batch::{self, Batch, LEAVES, Leaf, Leaves, Progress};
use super::{BlockLocator, Boxes, Frame, Located, MAX_CORNERS, Places, others, tets};

/// Nodes that wait at most; a power of two. Lanes that need more are served one by one.
const QUEUE: usize = 256;
/// Items of the outer tree that places fall into at most.
const ITEMS: usize = 64;
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

/// A node or item that some lanes fall into.
#[derive(Clone, Copy, Default)]
struct Waiting {
    number: u32,
    lanes: u16,
}

/// First in, first out; a number and its lanes above it in one word.
struct Queue {
    entries: [u64; QUEUE],
    first: usize,
    len: usize,
    /// Lanes that found it full.
    refused: u16,
}

impl Queue {
    #[inline(always)]
    fn new() -> Self {
        Self {
            entries: [0; QUEUE],
            first: 0,
            len: 0,
            refused: 0,
        }
    }

    /// Whether so many more find room; if not, their lanes are refused.
    #[inline(always)]
    fn has_room(&mut self, more: usize, lanes: u16) -> bool {
        let has_room = self.len + more <= QUEUE;
        if !has_room {
            self.refused |= lanes;
        }
        has_room
    }

    /// Adds one if `really`, for which there must be room.
    #[inline(always)]
    fn push_if(&mut self, really: bool, number: u32, lanes: u16) {
        let entry = u64::from(number) | u64::from(lanes) << 32;
        self.entries[(self.first + self.len) % QUEUE] = entry;
        self.len += usize::from(really);
    }

    #[inline(always)]
    fn push(&mut self, number: u32, lanes: u16) {
        if self.has_room(1, lanes) {
            self.push_if(true, number, lanes);
        }
    }

    #[inline(always)]
    fn pop(&mut self) -> Option<Waiting> {
        if self.len == 0 {
            return None;
        }
        let entry = self.entries[self.first % QUEUE];
        self.first = (self.first + 1) % QUEUE;
        self.len -= 1;
        Some(Waiting {
            number: entry as u32,
            lanes: (entry >> 32) as u16,
        })
    }
}

/// Items of the outer tree that lanes fall into.
struct Items {
    entries: [Waiting; ITEMS],
    len: usize,
    /// Lanes that found no room.
    refused: u16,
}

impl Items {
    #[inline(always)]
    fn push(&mut self, number: u32, lanes: u16) {
        if self.len == ITEMS {
            self.refused |= lanes;
            return;
        }
        self.entries[self.len] = Waiting { number, lanes };
        self.len += 1;
    }
}

/// Sixteen places in sixteenths of a step of one sub-mesh's grid, and the same with their signs
/// turned.
struct GridPlaces<S: Simd> {
    at: [S::F; 3],
    turned: [S::F; 3],
}

impl BlockLocator<'_> {
    /// Fills in the cells of some lanes.
    #[inline(always)]
    pub(super) fn walk<S: Simd>(&self, at: &Places, lanes: u16, out: &mut Located) {
        let places = per_axis!(i => S::F::from_array(at[i]));
        let largest = S::F::splat(f32::MAX);
        let finite =
            places[0].abs().le(largest) & places[1].abs().le(largest) & places[2].abs().le(largest);
        let lanes = lanes & finite.to_bits();
        if lanes == 0 || self.mesh.outer().is_empty() {
            return;
        }
        if !self.is_tame {
            self.locate_one_by_one(at, lanes, out);
            return;
        }
        let mut items = Items {
            entries: [Waiting::default(); ITEMS],
            len: 0,
            refused: 0,
        };
        match &self.boxes {
            Some(boxes) => in_boxes::<S>(boxes, places, lanes, &mut items),
            None => in_outer_tree::<S>(self.mesh.outer(), places, lanes, &mut items),
        }
        let mut refused = items.refused;
        let mut next = 0;
        while next < items.len {
            next = self.visit_submesh::<S>(&items, next, at, &mut refused, out);
        }
        if refused != 0 {
            self.locate_one_by_one(at, refused, out);
        }
    }

    /// Searches the sub-mesh of item `first` and of those that follow in it; gives the next item.
    #[inline(always)]
    fn visit_submesh<S: Simd>(
        &self,
        items: &Items,
        first: usize,
        at: &Places,
        refused: &mut u16,
        out: &mut Located,
    ) -> usize {
        let mut queue = Queue::new();
        let mut next = first + 1;
        let number = match self.mesh.variant() {
            crate::Variant::MultiNodes => {
                let item = items.entries[first];
                queue.push(0, item.lanes & !out.found);
                item.number as usize
            }
            crate::Variant::MultiLeaves => {
                let item = items.entries[first];
                let Some(number) = self.mesh.submesh_of_node(u64::from(item.number)) else {
                    return next;
                };
                let nodes = self.mesh.submeshes()[number].nodes();
                queue.push(
                    (u64::from(item.number) - nodes.start) as u32,
                    item.lanes & !out.found,
                );
                while next < items.len && nodes.contains(&u64::from(items.entries[next].number)) {
                    let item = items.entries[next];
                    queue.push(
                        (u64::from(item.number) - nodes.start) as u32,
                        item.lanes & !out.found,
                    );
                    next += 1;
                }
                number
            }
        };
        let mut lanes = 0;
        for i in 0..queue.len {
            lanes |= (queue.entries[i] >> 32) as u16;
        }
        let (Some(submesh), true) = (self.mesh.submesh(number), lanes != 0) else {
            return next;
        };
        let frame = &self.frames[number];
        let places = grid_places::<S>(frame, at);
        let found_before = out.found;
        let mut leaves = Leaves::new();
        let mut tet_batch = Batch::<4>::new();
        let mut other_batch = Batch::<MAX_CORNERS>::new();
        let has_others = submesh.header.num_cells[1..].iter().any(|&n| n > 0);
        loop {
            let more = collect::<S>(&submesh, &places, &mut queue, &mut leaves);
            let mut progress = Progress::default();
            while batch::fill_tets(&submesh, &leaves, &mut progress, out, &mut tet_batch) {
                let rounding = frame.rounding;
                tets::test::<S>(&submesh, &tet_batch, self.scale, rounding, at, out);
            }
            if has_others {
                let mut progress = Progress::default();
                while batch::fill_others(&submesh, &leaves, &mut progress, out, &mut other_batch) {
                    others::test::<S>(&submesh, &other_batch, at, out);
                }
            }
            if !more {
                break;
            }
            leaves.len = 0;
        }
        *refused |= queue.refused;
        let mut found = out.found & !found_before;
        while found != 0 {
            let lane = found.trailing_zeros() as usize;
            found &= found - 1;
            out.submesh[lane] = number as u32;
        }
        let tets = out.found & !found_before & !out.others;
        if tets != 0 {
            tets::weigh::<S>(&submesh, self.scale, at, tets, out);
        }
        next
    }
}

/// Places in sixteenths of a sub-mesh's grid. Rounding is monotone and planes are exact, so that no
/// place changes its side of a plane.
#[inline(always)]
fn grid_places<S: Simd>(frame: &Frame, at: &Places) -> GridPlaces<S> {
    let at = per_axis!(i => {
        (S::F::from_array(at[i]) - S::F::splat(frame.base[i])) * S::F::splat(frame.sixteenths[i])
    });
    let zero = S::F::splat(0.0);
    GridPlaces {
        at,
        turned: per_axis!(i => zero - at[i]),
    }
}

/// Lower corners of a node's children in the first block, turned upper corners in the second.
#[inline(always)]
fn child_boxes<S: Simd>(node: &MultiLeaf) -> [S::F; 3] {
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
fn nonzero_bytes(bytes: [u8; WIDTH]) -> u8 {
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
fn ordered_nibbles(bytes: [u8; WIDTH]) -> u8 {
    const NIBBLE: u64 = 0x0F0F_0F0F_0F0F_0F0F;
    let word = u64::from_le_bytes(bytes);
    let (lo, hi) = (word & NIBBLE, word >> 4 & NIBBLE);
    // 16 more in each byte, so that no difference borrows from the next.
    lowest_bits((hi + (NIBBLE + 0x0101_0101_0101_0101) - lo) >> 4 & 0x0101_0101_0101_0101)
}

/// Goes on through the nodes that wait until there are none, or no room for more leaves; whether
/// there are any left. What happens to a child does not branch on whether any lane falls into it:
/// that is as good as random, and guessed wrong as often as not.
#[inline(always)]
fn collect<S: Simd>(
    submesh: &Submesh,
    places: &GridPlaces<S>,
    queue: &mut Queue,
    leaves: &mut Leaves,
) -> bool {
    while leaves.len + WIDTH <= LEAVES {
        let Some(Waiting { number, lanes }) = queue.pop() else {
            return false;
        };
        let Some((node, first_child)) = submesh.node(number) else {
            continue;
        };
        let boxes = child_boxes::<S>(node);
        let leaf_bits = nonzero_bytes(node.counts);
        let inner = ordered_nibbles(node.child_bounds[0]) & !leaf_bits;
        let corners = per_axis!(i => boxes[i].to_array());
        let mut child_lanes = [0u16; WIDTH];
        for child in 0..WIDTH {
            let within = per_axis!(i => {
                S::F::splat(corners[i][child]).le(places.at[i])
                    & S::F::splat(corners[i][WIDTH + child]).le(places.turned[i])
            });
            child_lanes[child] = (within[0] & within[1] & within[2]).to_bits() & lanes;
        }
        if inner != 0 && queue.has_room(WIDTH, lanes) {
            let mut below = first_child;
            for child in 0..WIDTH {
                let is_inner = inner >> child & 1 == 1;
                // Children come after their parents, so that no walk is endless.
                let visit = is_inner & (child_lanes[child] != 0) & (below > number);
                queue.push_if(visit, below, child_lanes[child]);
                submesh.prefetch_node(if visit { below } else { first_child });
                below = below.wrapping_add(u32::from(is_inner));
            }
        }
        if leaf_bits != 0 {
            let (zero, one) = (S::F::splat(0.0), S::F::splat(1.0));
            let flip = S::I::from_array([8, 9, 10, 11, 12, 13, 14, 15, 0, 1, 2, 3, 4, 5, 6, 7]);
            let side = per_axis!(i => zero - boxes[i] - boxes[i].permute(flip) + one);
            let volumes = (side[0] * side[1] * side[2]).to_array();
            let mut first_index = node.first_index;
            for child in 0..WIDTH {
                let counts = node.counts[child];
                let visit = (counts != 0) & (child_lanes[child] != 0);
                let leaf = Leaf {
                    first_index,
                    node: number,
                    lanes: child_lanes[child],
                    counts,
                };
                leaves.push_if(visit, leaf, volumes[child]);
                submesh.prefetch_indices(if visit { first_index } else { node.first_index });
                let num_indices = NUM_INDICES[usize::from(counts)];
                first_index = first_index.wrapping_add(u32::from(num_indices));
            }
        }
    }
    queue.len > 0
}

/// The sub-meshes whose boxes contain places, in order.
#[inline(always)]
fn in_boxes<S: Simd>(boxes: &[Boxes], places: [S::F; 3], lanes: u16, items: &mut Items) {
    // The box around all places first: of inactive lanes, too, if they are finite, which is safe.
    let active = S::M::from_bits(lanes);
    let (far, near) = (S::F::splat(f32::MAX), S::F::splat(f32::MIN));
    let lo = per_axis!(i => S::F::splat(places[i].select(active, far).lowest()));
    let hi = per_axis!(i => S::F::splat(places[i].select(active, near).highest()));
    for (sixteen, boxes) in boxes.iter().enumerate() {
        let touched = per_axis!(i => {
            S::F::from_array(boxes[i]).le(hi[i]) & lo[i].le(S::F::from_array(boxes[3 + i]))
        });
        let mut touched = (touched[0] & touched[1] & touched[2]).to_bits();
        while touched != 0 {
            let slot = touched.trailing_zeros() as usize;
            touched &= touched - 1;
            let within = per_axis!(i => {
                S::F::splat(boxes[i][slot]).le(places[i]) & places[i].le(S::F::splat(boxes[3 + i][slot]))
            });
            let within = (within[0] & within[1] & within[2]).to_bits() & lanes;
            if within != 0 {
                items.push((sixteen * LANES + slot) as u32, within);
            }
        }
    }
}

/// The items of the outer tree whose boxes contain places, in order.
#[inline(always)]
fn in_outer_tree<S: Simd>(tree: &[OuterNode], places: [S::F; 3], lanes: u16, items: &mut Items) {
    let mut queue = Queue::new();
    queue.push(0, lanes);
    while let Some(Waiting { number, lanes }) = queue.pop() {
        let Some(node) = tree.get(number as usize) else {
            continue;
        };
        let (base, per_unit) = node.grid();
        let steps = per_axis!(i => (places[i] - S::F::splat(base[i])) * S::F::splat(per_unit[i]));
        for child in 0..node.num_children() {
            let (lo, hi) = node.child_steps(child);
            let within = per_axis!(i => {
                S::F::splat(lo[i]).le(steps[i]) & steps[i].le(S::F::splat(hi[i]))
            });
            let within = (within[0] & within[1] & within[2]).to_bits() & lanes;
            if within == 0 {
                continue;
            }
            match node.child(child) {
                // Children come after their parents, so that no walk is endless.
                OuterChild::Node(below) if below > number => {
                    vacua_simd::prefetch(tree, below as usize);
                    queue.push(below, within);
                }
                OuterChild::Node(_) => {}
                OuterChild::Item(item) => items.push(item, within),
            }
        }
    }
    items.refused |= queue.refused;
    items.entries[..items.len].sort_unstable_by_key(|item| item.number);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::LeafCounts;
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
