//! A field on one sub-mesh: its values in packed order, and the ranges of its nodes.
//!
//! Each value first becomes a span of steps; what the cells of a leaf span then is the least of
//! the spans at their indices, which are gathered node by node and compared side by side.

use vacua_simd::{Kernel, Simd, dispatch};
use vacua_volume::{Association, Scalar};

use super::NO_RANGE;
use super::span::{EMPTY, NOTHING, Span, join, range_of, spans_of};
use crate::layout::{Child, LeafCounts, MultiLeaf, WIDTH};
use crate::packed::Submesh;

/// What a field is on one sub-mesh.
pub(crate) struct FieldPart<T> {
    /// Values in packed order.
    pub values: Vec<T>,
    /// The exact range of all values as it is stored.
    pub ends: [f64; 2],
    /// The ranges of its nodes.
    pub slots: Vec<Slots>,
}

/// The ranges of a node's children.
pub(crate) type Slots = [[u8; 2]; WIDTH];

/// Memory that sub-meshes use one after the other.
#[derive(Default)]
pub(crate) struct Scratch {
    spans: Vec<Span>,
    nodes: Vec<[Span; WIDTH]>,
}

/// Numbers that 16 bits can be.
const NUM_SHORTS: usize = 1 << 16;
/// Spans that are compared at once.
const LANES: usize = 32;
/// Nodes whose spans are gathered before any are joined: what was just written in small pieces cannot
/// be read in large ones at once.
const TOGETHER: usize = 8;
/// The most indices of the leaves of these, and what may be read past them.
const MOST_GATHERED: usize = TOGETHER * WIDTH * LeafCounts::unpack(u8::MAX).num_indices() + LANES;

/// Indices, and cells, of a leaf by its counts.
const SIZES: [[u8; 256]; 2] = {
    let mut sizes = [[0; 256]; 2];
    let mut counts = 0;
    while counts < 256 {
        let leaf = LeafCounts::unpack(counts as u8);
        sizes[0][counts] = leaf.num_indices() as u8;
        sizes[1][counts] = leaf.num_cells() as u8;
        counts += 1;
    }
    sizes
};
const NUM_INDICES: [u8; 256] = SIZES[0];
const NUM_CELLS: [u8; 256] = SIZES[1];
/// Makes spans from a place on those of nothing.
const PAST: [[Span; LANES]; LANES + 1] = {
    let mut masks = [[0; LANES]; LANES + 1];
    let mut place = 0;
    while place < LANES {
        let mut i = place;
        while i < LANES {
            masks[place][i] = EMPTY;
            i += 1;
        }
        place += 1;
    }
    masks
};

impl<T: Scalar> FieldPart<T> {
    /// Finds the ranges of values in packed order, one for each vertex or cell of the sub-mesh.
    pub fn of(submesh: &Submesh, association: Association, values: Vec<T>) -> Self {
        let mut slots = vec![[NO_RANGE; WIDTH]; submesh.header.num_nodes as usize];
        let mut scratch = Scratch::default();
        Self {
            ends: find_ranges(submesh, association, &values, &mut slots, &mut scratch),
            slots,
            values,
        }
    }
}

/// Finds the ranges of the nodes of a sub-mesh, and that of all values as it is stored, from values in
/// packed order, one for each vertex or cell. Slots, one for each node, are `NO_RANGE` before.
///
/// Cost: some operations a value, and one or two for each index of a cell's corner.
pub(crate) fn find_ranges<T: Scalar>(
    submesh: &Submesh,
    association: Association,
    values: &[T],
    slots: &mut [Slots],
    scratch: &mut Scratch,
) -> [f64; 2] {
    let Some(whole) = range_of(values) else {
        return NOTHING;
    };
    let Scratch { spans, nodes } = scratch;
    // A span for every number of 16 bits, and for what is read past the last cell.
    spans.resize((values.len() + LANES).max(NUM_SHORTS), EMPTY);
    spans_of(values, whole, &mut spans[..values.len()]);
    spans[values.len()..].fill(EMPTY);
    nodes.clear();
    nodes.resize(slots.len(), [EMPTY; WIDTH]);
    if submesh.clusters.is_some() {
        join_clusters(submesh, association, &spans[..values.len()], nodes);
    } else {
        dispatch(Leaves {
            submesh,
            association,
            spans,
            num_values: values.len(),
            nodes,
        });
    }
    dispatch(InnerNodes {
        submesh,
        nodes,
        slots,
    });
    [whole.lo, whole.hi]
}

/// The spans of leaves from those of vertices or cells.
struct Leaves<'a> {
    submesh: &'a Submesh<'a>,
    association: Association,
    /// Of vertices or cells, and more of nothing.
    spans: &'a [Span],
    num_values: usize,
    nodes: &'a mut [[Span; WIDTH]],
}

impl Kernel for Leaves<'_> {
    type Output = ();

    /// The primitives of the leaves of a node follow each other, and cells those of the node before. A
    /// marker is the number of no vertex, or of one that is a corner here.
    #[inline(always)]
    fn run<S: Simd>(self) {
        let (submesh, spans) = (self.submesh, self.spans);
        let mut gathered = [EMPTY; MOST_GATHERED];
        let mut cell = 0;
        let mut number = 0;
        for found in self.nodes.chunks_mut(TOGETHER) {
            let mut ends = [[0; WIDTH + 1]; TOGETHER];
            match self.association {
                Association::Cell => {
                    for (node, ends) in (number..).zip(ends.iter_mut()) {
                        *ends = ends_of(submesh, node, &NUM_CELLS, cell);
                        cell = ends[WIDTH];
                    }
                    join_runs(spans, &ends, found);
                }
                Association::Point => {
                    let mut len = 0;
                    for (node, ends) in (number..).zip(ends.iter_mut()) {
                        *ends = ends_of(submesh, node, &NUM_INDICES, len);
                        let (num, here) = (ends[WIDTH] - len, &mut gathered[len..]);
                        if gather_node(submesh, node, num, spans, here) {
                            len = ends[WIDTH];
                        } else {
                            *ends = [len; WIDTH + 1];
                        }
                    }
                    join_runs(&gathered, &ends, found);
                    // Without leaves, or with indices of other than 16 bits.
                    for ((node, ends), found) in (number..).zip(&ends).zip(found) {
                        if ends[0] == ends[WIDTH] {
                            *found = one_by_one(submesh, node, &spans[..self.num_values]);
                        }
                    }
                }
            }
            number += TOGETHER as u32;
        }
    }
}

/// Gathers the spans at all indices of a node's leaves; not if they are of other than 16 bits.
#[inline(always)]
fn gather_node(
    submesh: &Submesh,
    number: u32,
    len: usize,
    spans: &[Span],
    gathered: &mut [Span],
) -> bool {
    if let Some((node, _)) = submesh.node(number)
        && let Some(shorts) = submesh.indices.shorts(u64::from(node.first_index), len)
        && let Some(spans) = spans.first_chunk()
    {
        gather(shorts, spans, gathered);
        return true;
    }
    false
}

/// Where the runs of a node's leaves end one after the other, by their sizes.
#[inline(always)]
fn ends_of(submesh: &Submesh, number: u32, sizes: &[u8; 256], first: usize) -> [usize; WIDTH + 1] {
    let mut ends = [first; WIDTH + 1];
    if let Some((node, _)) = submesh.node(number) {
        for k in 0..WIDTH {
            ends[k + 1] = ends[k] + usize::from(sizes[usize::from(node.counts[k])]);
        }
    }
    ends
}

/// The unions of the runs of leaves.
#[inline(always)]
fn join_runs(spans: &[Span], ends: &[[usize; WIDTH + 1]; TOGETHER], found: &mut [[Span; WIDTH]]) {
    for (found, ends) in found.iter_mut().zip(ends) {
        for k in 0..WIDTH {
            found[k] = least(spans, ends[k], ends[k + 1]);
        }
    }
}

/// The spans at indices of 16 bits. Not inlined: where there are gathers of wide numbers it would be
/// compiled to them, which are slower.
#[inline(never)]
fn gather(shorts: &[u8], spans: &[Span; NUM_SHORTS], gathered: &mut [Span]) {
    let (shorts, _) = shorts.as_chunks();
    for (gathered, &short) in gathered.iter_mut().zip(shorts) {
        *gathered = spans[usize::from(u16::from_le_bytes(short))];
    }
}

/// The union of some spans with as many after them as are compared at once.
#[inline(always)]
fn least(spans: &[Span], first: usize, end: usize) -> Span {
    let mut found = EMPTY;
    if let Some((piece, _)) = spans.split_at(first.min(spans.len())).1.split_first_chunk() {
        found = least_of(piece, end - first);
    }
    // Seldom: a leaf of more indices than that.
    let mut place = first + LANES;
    while place < end {
        if let Some((piece, _)) = spans.split_at(place.min(spans.len())).1.split_first_chunk() {
            found = join(found, least_of(piece, end - place));
        }
        place += LANES;
    }
    found
}

/// The union of so many of the first spans.
#[inline(always)]
fn least_of(spans: &[Span; LANES], len: usize) -> Span {
    let past = &PAST[len.min(LANES)];
    let (mut lo, mut below_last) = (EMPTY & 255, EMPTY >> 8);
    for lane in 0..LANES {
        let span = spans[lane] | past[lane];
        lo = lo.min(span & 255);
        below_last = below_last.min(span >> 8);
    }
    lo | below_last << 8
}

/// The spans of a node's leaves from indices of any number of bits, none of a leaf past their end.
#[inline(never)]
fn one_by_one(submesh: &Submesh, number: u32, spans: &[Span]) -> [Span; WIDTH] {
    let mut found = [EMPTY; WIDTH];
    let Some((node, _)) = submesh.node(number) else {
        return found;
    };
    let mut first = u64::from(node.first_index);
    for (k, found) in found.iter_mut().enumerate() {
        let len = LeafCounts::unpack(node.counts[k]).num_indices();
        submesh.indices.visit(first, len, |index| {
            if let Some(&span) = spans.get(index as usize) {
                *found = join(*found, span);
            }
        });
        first += len as u64;
    }
    found
}

/// The ranges of inner children from those of their own.
struct InnerNodes<'a> {
    submesh: &'a Submesh<'a>,
    nodes: &'a mut [[Span; WIDTH]],
    slots: &'a mut [Slots],
}

impl Kernel for InnerNodes<'_> {
    type Output = ();

    /// Children come after their parents: from the last node up.
    #[inline(always)]
    fn run<S: Simd>(self) {
        let num_nodes = self.nodes.len().min(self.slots.len());
        for number in (0..num_nodes).rev() {
            let Some((node, mut next)) = self.submesh.node(number as u32) else {
                continue;
            };
            let mut inner = inner_children(node);
            while inner != 0 {
                let below = match self.nodes.get(next as usize) {
                    Some(below) => union(below),
                    None => EMPTY,
                };
                self.nodes[number][inner.trailing_zeros() as usize / 8] = below;
                inner &= inner - 1;
                next = next.saturating_add(1);
            }
            self.slots[number] = slots_of(&self.nodes[number]);
        }
    }
}

/// Bit `8 k + 4` for each child `k` that is a node: all of them in one number.
#[inline(always)]
fn inner_children(node: &MultiLeaf) -> u64 {
    const LOW: u64 = 0x0F0F_0F0F_0F0F_0F0F;
    const FIRST: u64 = 0x0101_0101_0101_0101;
    let x = u64::from_le_bytes(node.child_bounds[0]);
    let counts = u64::from_le_bytes(node.counts);
    // The fifth bit of a byte stays where its upper half is not below its lower one.
    let is_ordered = (x >> 4 & LOW | FIRST << 4) - (x & LOW);
    // And the eighth of one that is not 0 is set.
    let has_counts = ((counts & !(FIRST << 7)) + !(FIRST << 7)) | counts;
    is_ordered & !(has_counts >> 3) & FIRST << 4
}

/// Spans as they are stored.
#[inline(always)]
fn slots_of(spans: &[Span; WIDTH]) -> Slots {
    let mut stored = [0; WIDTH];
    for k in 0..WIDTH {
        stored[k] = (spans[k] ^ 0xFF00).to_le();
    }
    bytemuck::cast(stored)
}

#[inline(always)]
fn union(spans: &[Span; WIDTH]) -> Span {
    let (mut lo, mut below_last) = (EMPTY & 255, EMPTY >> 8);
    for span in spans {
        lo = lo.min(span & 255);
        below_last = below_last.min(span >> 8);
    }
    lo | below_last << 8
}

/// The spans of clusters.
fn join_clusters(
    submesh: &Submesh,
    association: Association,
    spans: &[Span],
    nodes: &mut [[Span; WIDTH]],
) {
    for (number, found) in (0..submesh.header.num_nodes).zip(nodes) {
        let Some((node, _)) = submesh.node(number) else {
            continue;
        };
        let mut first = u64::from(node.first_index);
        for (k, found) in found.iter_mut().enumerate() {
            let Child::Leaf(counts) = node.child(k) else {
                continue;
            };
            submesh.cells_of_leaf(first, counts, |index, cell_type, corners| {
                let mut add = |place: usize| {
                    if let Some(&span) = spans.get(place) {
                        *found = join(*found, span);
                    }
                };
                match association {
                    Association::Point => {
                        let corners = &corners[..cell_type.num_points()];
                        corners.iter().for_each(|&c| add(c as usize));
                    }
                    Association::Cell => add((index / 2) as usize),
                }
            });
            first += counts.num_indices() as u64;
        }
    }
}

/// For every node the number of cells in nodes before it.
pub(crate) fn cells_before(submesh: &Submesh) -> Vec<u32> {
    let mut count = 0u32;
    let mut before = Vec::with_capacity(submesh.header.num_nodes as usize);
    for number in 0..submesh.header.num_nodes {
        before.push(count);
        let Some((node, _)) = submesh.node(number) else {
            continue;
        };
        for k in 0..WIDTH {
            if let Child::Leaf(counts) = node.child(k) {
                count = count.saturating_add(counts.num_cells() as u32);
            }
        }
    }
    before
}

#[cfg(test)]
mod tests {
    use super::super::span::slot;
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn many_are_as_good_as_one(
            values in prop::collection::vec(any::<u16>(), 1..300),
            indices in prop::collection::vec(0u16..400, 0..120),
            first in 0usize..130,
        ) {
            let mut spans = values.clone();
            spans.resize(NUM_SHORTS, EMPTY);
            let spans: &[Span; NUM_SHORTS] = spans.as_slice().try_into().expect("all");
            let bytes: Vec<u8> = indices.iter().flat_map(|i| i.to_le_bytes()).collect();
            let mut gathered = [7; MOST_GATHERED];
            gather(&bytes, spans, &mut gathered);
            let end = indices.len();
            let there = indices[first.min(end)..].iter().filter_map(|&i| values.get(usize::from(i)));
            let expected = there.fold(EMPTY, |a, &b| join(a, b));
            let first = first.min(end);
            prop_assert_eq!(least(&gathered, first, end), expected);
        }

        #[test]
        fn children_are_what_the_layout_says(
            x in any::<[u8; WIDTH]>(),
            counts in prop::array::uniform8(0u8..3),
            spans in any::<[Span; WIDTH]>(),
        ) {
            let mut node = MultiLeaf { counts, ..MultiLeaf::EMPTY };
            node.child_bounds[0] = x;
            let slots = slots_of(&spans);
            let num_inner = (0..WIDTH).filter(|&k| node.child(k) == Child::Inner).count() as u32;
            for k in 0..WIDTH {
                let is_inner = node.child(k) == Child::Inner;
                prop_assert_eq!(inner_children(&node) >> (8 * k + 4) & 1 == 1, is_inner);
                prop_assert_eq!(inner_children(&node).count_ones(), num_inner);
                prop_assert_eq!(slots[k], slot(spans[k]));
            }
        }
    }
}
