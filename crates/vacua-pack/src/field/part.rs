//! A field on one sub-mesh: its values in packed order, and the ranges of its nodes.

use vacua_volume::{Association, Scalar, ValueRange};

use super::{NO_RANGE, encode_range};
use crate::layout::{Child, WIDTH};
use crate::packed::Submesh;

/// What a field is on one sub-mesh.
pub(crate) struct FieldPart<T> {
    /// Values in packed order.
    pub values: Vec<T>,
    /// Their exact range; `None` without any finite one.
    pub range: Option<ValueRange>,
    /// The ranges of its nodes.
    pub slots: Vec<[[u8; 2]; WIDTH]>,
}

/// A range that no number is in.
const NOTHING: [f64; 2] = [f64::INFINITY, f64::NEG_INFINITY];

#[inline(always)]
fn join(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    // In this order what is no number changes nothing.
    [
        if b[0] < a[0] { b[0] } else { a[0] },
        if b[1] > a[1] { b[1] } else { a[1] },
    ]
}

impl<T: Scalar> FieldPart<T> {
    /// Finds the ranges of values in packed order, one for each vertex or cell of the sub-mesh.
    pub fn of(submesh: &Submesh, association: Association, values: Vec<T>) -> Self {
        let finite = |v: &T| {
            let v = v.to_f64();
            if v.is_finite() { v } else { f64::NAN }
        };
        let numbers: Vec<f64> = values.iter().map(finite).collect();
        let exact = exact_ranges(submesh, association, &numbers);
        let whole = exact.iter().flatten().fold(NOTHING, |a, &b| join(a, b));
        let as_range = |[lo, hi]: [f64; 2]| (lo <= hi).then_some(ValueRange { lo, hi });
        let range = as_range(whole);
        let slot = |ends| range.map_or(NO_RANGE, |whole| encode_range(whole, as_range(ends)));
        let slots = exact.iter().map(|node| {
            let mut slots = [NO_RANGE; WIDTH];
            for (slots, &ends) in slots.iter_mut().zip(node) {
                *slots = slot(ends);
            }
            slots
        });
        Self {
            slots: slots.collect(),
            range,
            values,
        }
    }

    /// The range as it is stored.
    pub fn ends(&self) -> [f64; 2] {
        self.range.map_or(NOTHING, |r| [r.lo, r.hi])
    }
}

/// The ranges of all children of all nodes. What is not finite is no number in `numbers`.
fn exact_ranges(
    submesh: &Submesh,
    association: Association,
    numbers: &[f64],
) -> Vec<[[f64; 2]; WIDTH]> {
    let num_nodes = submesh.header.num_nodes;
    let mut exact = vec![[NOTHING; WIDTH]; num_nodes as usize];
    let mut cell = 0;
    for (number, slots) in (0..num_nodes).zip(exact.iter_mut()) {
        let Some((node, _)) = submesh.node(number) else {
            continue;
        };
        let mut first_index = u64::from(node.first_index);
        for (k, slot) in slots.iter_mut().enumerate() {
            let Child::Leaf(counts) = node.child(k) else {
                continue;
            };
            let (num_indices, num_cells) = (counts.num_indices(), counts.num_cells());
            if submesh.clusters.is_some() {
                submesh.cells_of_leaf(first_index, counts, |index, cell_type, corners| {
                    let mut add = |place: usize| {
                        if let Some(&v) = numbers.get(place) {
                            *slot = join(*slot, [v, v]);
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
                first_index += num_indices as u64;
                continue;
            }
            match association {
                // The primitives of a leaf are neighbours; a marker is the number of no vertex, or
                // of one that is a corner here.
                Association::Point => submesh.indices.visit(first_index, num_indices, |index| {
                    if let Some(&v) = numbers.get(index as usize) {
                        *slot = join(*slot, [v, v]);
                    }
                }),
                Association::Cell => {
                    let own = numbers.get(cell..cell + num_cells).unwrap_or(&[]);
                    *slot = own.iter().fold(*slot, |slot, &v| join(slot, [v, v]));
                }
            }
            cell += num_cells;
            first_index += num_indices as u64;
        }
    }
    // Children come after their parents: from the last node up.
    for number in (0..num_nodes).rev() {
        let Some((node, mut next)) = submesh.node(number) else {
            continue;
        };
        for k in 0..WIDTH {
            if node.child(k) == Child::Inner {
                let below = exact.get(next as usize).copied();
                let below = below.unwrap_or([NOTHING; WIDTH]);
                exact[number as usize][k] = below.into_iter().fold(NOTHING, join);
                next = next.saturating_add(1);
            }
        }
    }
    exact
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
