//! A field on one sub-mesh: its values in packed order, and the ranges of its nodes.
//!
//! Each value first becomes two steps of the sub-mesh's range, the last one below it and the first one
//! above it; what the cells of a leaf span then is a minimum of bytes, eight indices at a time.

use vacua_volume::{Association, Scalar, ValueRange};

use super::{NO_RANGE, STEPS, decode_step};
use crate::layout::{Child, WIDTH};
use crate::packed::Submesh;

/// What a field is on one sub-mesh.
pub(crate) struct FieldPart<T> {
    /// Values in packed order.
    pub values: Vec<T>,
    /// Their ranges.
    pub ranges: FieldRanges,
}

/// Ranges on one sub-mesh.
pub(crate) struct FieldRanges {
    /// The exact range of all values; `None` without any finite one.
    pub range: Option<ValueRange>,
    /// The ranges of its nodes.
    pub slots: Vec<[[u8; 2]; WIDTH]>,
}

/// A range that no number is in, as it is stored.
const NOTHING: [f64; 2] = [f64::INFINITY, f64::NEG_INFINITY];

/// A slot while slots are joined: its lower step, and how far its upper step is below the last. The
/// least of both is the union.
type Span = [u8; 2];
/// The span of nothing.
const EMPTY: Span = [u8::MAX; 2];
/// Numbers that 16 bits can be.
const NUM_SHORTS: usize = 1 << 16;

#[inline(always)]
fn join(a: Span, b: Span) -> Span {
    [a[0].min(b[0]), a[1].min(b[1])]
}

fn union(spans: &[Span]) -> Span {
    spans.iter().fold(EMPTY, |a, &b| join(a, b))
}

impl<T: Scalar> FieldPart<T> {
    /// Finds the ranges of values in packed order, one for each vertex or cell of the sub-mesh.
    pub fn of(submesh: &Submesh, association: Association, values: Vec<T>) -> Self {
        Self {
            ranges: FieldRanges::of(submesh, association, &values),
            values,
        }
    }
}

impl FieldRanges {
    /// The ranges of values in packed order, one for each vertex or cell of the sub-mesh.
    ///
    /// Cost: some operations a value, and two or three for each index of a cell's corner.
    pub fn of<T: Scalar>(submesh: &Submesh, association: Association, values: &[T]) -> Self {
        let num_nodes = submesh.header.num_nodes as usize;
        let Some(whole) = range_of(values) else {
            return Self {
                range: None,
                slots: vec![[NO_RANGE; WIDTH]; num_nodes],
            };
        };
        let spans = spans_of(values, whole);
        let mut nodes = vec![[EMPTY; WIDTH]; num_nodes];
        match association {
            _ if submesh.clusters.is_some() => {
                join_clusters(submesh, association, &spans, &mut nodes);
            }
            Association::Point => join_corners(submesh, spans, &mut nodes),
            Association::Cell => join_cells(submesh, &spans, &mut nodes),
        }
        // Children come after their parents: from the last node up.
        for number in (0..submesh.header.num_nodes).rev() {
            let Some((node, mut next)) = submesh.node(number) else {
                continue;
            };
            for k in 0..WIDTH {
                if node.child(k) == Child::Inner {
                    let below = nodes.get(next as usize);
                    nodes[number as usize][k] = below.map_or(EMPTY, |below| union(below));
                    next = next.saturating_add(1);
                }
            }
        }
        Self {
            range: Some(whole),
            slots: nodes
                .iter()
                .map(|node| node.map(|[lo, below_last]| [lo, u8::MAX - below_last]))
                .collect(),
        }
    }

    /// The range as it is stored.
    pub fn ends(&self) -> [f64; 2] {
        self.range.map_or(NOTHING, |r| [r.lo, r.hi])
    }
}

/// The range of the finite ones of some values.
fn range_of<T: Scalar>(values: &[T]) -> Option<ValueRange> {
    let [lo, hi] = values.iter().fold(NOTHING, |[lo, hi], value| {
        let v = value.to_f64();
        // In this order what is no number changes nothing.
        let v = if v.is_finite() { v } else { f64::NAN };
        [if v < lo { v } else { lo }, if v > hi { v } else { hi }]
    });
    (lo <= hi).then_some(ValueRange { lo, hi })
}

/// The smallest span whose decoded range contains a value, for each; of what is not finite, nothing.
fn spans_of<T: Scalar>(values: &[T], whole: ValueRange) -> Vec<Span> {
    let mut decoded = [0.0; 256];
    for step in 0..=u8::MAX {
        decoded[usize::from(step)] = decode_step(whole, step);
    }
    // A guess; what is decoded decides.
    let per_unit = STEPS / (0.5 * whole.hi - 0.5 * whole.lo);
    let base = 0.5 * whole.lo;
    let span = |value: &T| {
        let v = value.to_f64();
        if !v.is_finite() {
            return EMPTY;
        }
        let guess = ((0.5 * v - base) * per_unit) as u8;
        let mut lo = guess;
        while lo > 0 && decoded[usize::from(lo)] > v {
            lo -= 1;
        }
        let mut hi = guess;
        while hi < u8::MAX && decoded[usize::from(hi)] < v {
            hi += 1;
        }
        [lo, u8::MAX - hi]
    };
    values.iter().map(span).collect()
}

/// The spans of leaves from those of vertices. The primitives of a leaf are neighbours; a marker is the
/// number of no vertex, or of one that is a corner here.
fn join_corners(submesh: &Submesh, mut spans: Vec<Span>, nodes: &mut [[Span; WIDTH]]) {
    let is_short = submesh.indices.shorts(0, 0).is_some();
    if is_short {
        // A span for every number of 16 bits.
        spans.resize(NUM_SHORTS, EMPTY);
    }
    let table: Option<&[Span; NUM_SHORTS]> = spans.as_slice().try_into().ok();
    for (number, found) in (0..submesh.header.num_nodes).zip(nodes) {
        let Some((node, _)) = submesh.node(number) else {
            continue;
        };
        let mut first = u64::from(node.first_index);
        for (k, found) in found.iter_mut().enumerate() {
            let Child::Leaf(counts) = node.child(k) else {
                continue;
            };
            let len = counts.num_indices();
            match (table, submesh.indices.shorts(first, len)) {
                (Some(table), Some(shorts)) => *found = union_of_shorts(shorts, table),
                _ => submesh.indices.visit(first, len, |index| {
                    if let Some(&span) = spans.get(index as usize) {
                        *found = join(*found, span);
                    }
                }),
            }
            first += len as u64;
        }
    }
}

/// The union of the spans at some indices of 16 bits.
#[inline(always)]
fn union_of_shorts(shorts: &[u8], table: &[Span; NUM_SHORTS]) -> Span {
    let at = |bytes: &[u8]| table[usize::from(u16::from_le_bytes([bytes[0], bytes[1]]))];
    let eight = shorts.chunks_exact(16);
    let rest = eight.remainder();
    let mut least = [u8::MAX; 16];
    for eight in eight {
        let mut found = [u8::MAX; 16];
        for i in 0..8 {
            [found[2 * i], found[2 * i + 1]] = at(&eight[2 * i..2 * i + 2]);
        }
        for i in 0..16 {
            least[i] = least[i].min(found[i]);
        }
    }
    let rest = rest.chunks_exact(2).fold(EMPTY, |a, two| join(a, at(two)));
    let pairs: [Span; 8] = bytemuck::cast(least);
    join(rest, union(&pairs))
}

/// The spans of leaves from those of their cells, which follow each other.
fn join_cells(submesh: &Submesh, spans: &[Span], nodes: &mut [[Span; WIDTH]]) {
    let mut cell = 0;
    for (number, found) in (0..submesh.header.num_nodes).zip(nodes) {
        let Some((node, _)) = submesh.node(number) else {
            continue;
        };
        for (k, found) in found.iter_mut().enumerate() {
            if let Child::Leaf(counts) = node.child(k) {
                let end = cell + counts.num_cells();
                *found = union(spans.get(cell..end).unwrap_or(&[]));
                cell = end;
            }
        }
    }
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
    use super::super::decode_range;
    use super::*;
    use proptest::prelude::*;

    fn slot(values: &[f64], whole: ValueRange) -> [u8; 2] {
        let [lo, below_last] = union(&spans_of(values, whole));
        [lo, u8::MAX - below_last]
    }

    proptest! {
        #[test]
        fn slots_contain_their_ranges(
            ends in prop::array::uniform4(prop_oneof![-1.0f64..1.0, -1e-30f64..1e-30, -1e308f64..1e308]),
        ) {
            let mut e = ends;
            e.sort_by(f64::total_cmp);
            let whole = ValueRange { lo: e[0], hi: e[3] };
            let back = decode_range(whole, slot(&[e[2], f64::NAN, e[1]], whole)).expect("a range");
            prop_assert!(back.lo <= e[1] && e[2] <= back.hi);
            prop_assert!(whole.lo <= back.lo && back.hi <= whole.hi);
            prop_assert_eq!(decode_range(whole, slot(&[f64::INFINITY], whole)), None);
            let exact = ValueRange { lo: e[0], hi: e[0] };
            prop_assert_eq!(decode_range(exact, slot(&[e[0]], exact)), Some(exact));
        }

        #[test]
        fn eight_indices_are_as_good_as_one(
            values in prop::collection::vec(any::<[u8; 2]>(), 1..300),
            indices in prop::collection::vec(0u16..400, 0..60),
        ) {
            let mut table = values.clone();
            table.resize(NUM_SHORTS, EMPTY);
            let table: &[Span; NUM_SHORTS] = table.as_slice().try_into().expect("all");
            let bytes: Vec<u8> = indices.iter().flat_map(|i| i.to_le_bytes()).collect();
            let there = indices.iter().filter_map(|&i| values.get(usize::from(i)));
            let expected = there.fold(EMPTY, |a, &b| join(a, b));
            prop_assert_eq!(union_of_shorts(&bytes, table), expected);
        }
    }
}
