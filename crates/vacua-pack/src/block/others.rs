//! Pyramids, wedges and hexahedra of several leaves: boxes tried on sixteen places at a time, then
//! the inverse of their maps on sixteen pairs of cell and place.

use vacua_simd::{Float, Int, LANES, Mask, Simd, per_axis};
use vacua_volume::CellType;

use crate::element::weights_at;
use crate::layout::{LeafCounts, OTHER_INDICES, PAIR_INDICES, TET_INDICES};
use crate::packed::Submesh;
use crate::small::ClusterCell;

use super::MAX_CORNERS;
use super::descend::Leaf;
use super::packets::{InLeaves, Packets, store};
use super::values::Values;
use super::verdict::judge;

/// Pairs of cell and place that wait at most: fewer than sixteen, and sixteen more.
const PAIRS: usize = 2 * LANES;

/// Cells of some leaves.
pub(super) struct OtherBatch {
    /// How many there are.
    pub len: usize,
    corners: [[u32; LANES]; MAX_CORNERS],
    primitive: [i32; LANES],
    /// The kind of each, by number.
    cell_type: [u8; LANES],
    leaves: [Leaf; LANES],
    num_leaves: usize,
}

/// Pairs of cell and place.
struct Pairs {
    at: [[f32; PAIRS]; 3],
    number: [i32; PAIRS],
    slot: [i32; PAIRS],
    len: usize,
}

/// What the cells of a batch are.
struct Cells<S: Simd> {
    corners: [[S::F; 3]; MAX_CORNERS],
    values: [S::F; MAX_CORNERS],
}

impl OtherBatch {
    pub fn new() -> Self {
        Self {
            len: 0,
            corners: [[0; LANES]; MAX_CORNERS],
            primitive: [0; LANES],
            cell_type: [0; LANES],
            leaves: [Leaf::default(); LANES],
            num_leaves: 0,
        }
    }

    /// Whether there is room for the cells of a leaf.
    #[inline(always)]
    pub fn has_room(&self, leaf: &Leaf) -> bool {
        self.len + usize::from(LeafCounts::unpack(leaf.counts).others) <= LANES
    }

    /// Adds the pyramids, wedges and hexahedra of a leaf, if it has any; there must be room for them.
    #[inline(always)]
    pub fn add(&mut self, leaf: &Leaf) {
        let others = usize::from(LeafCounts::unpack(leaf.counts).others);
        if others > 0 {
            self.leaves[self.num_leaves % LANES] = *leaf;
            self.num_leaves += 1;
            self.len += others;
        }
    }

    /// Reads the indices of all cells; asks for the positions and values of their corners if those
    /// are likely to be far away.
    #[inline(always)]
    pub fn read(&mut self, submesh: &Submesh, values: &Values, is_far: bool) {
        let mut slot = 0;
        for number in 0..self.num_leaves {
            let leaf = self.leaves[number % LANES];
            let mut place = first_other(&leaf);
            for _ in 0..LeafCounts::unpack(leaf.counts).others {
                let indices = submesh.indices.read::<OTHER_INDICES>(place);
                let (cell_type, corners) = submesh.other(indices);
                for k in 0..MAX_CORNERS {
                    if is_far {
                        vacua_simd::prefetch(submesh.positions, corners[k] as usize);
                        values.prefetch(submesh.header, corners[k]);
                    }
                    self.corners[k][slot % LANES] = corners[k];
                }
                self.primitive[slot % LANES] = (2 * place) as i32;
                self.cell_type[slot % LANES] = cell_type as u8;
                slot += 1;
                place += OTHER_INDICES as u64;
            }
        }
    }

    /// Adds pyramids, wedges and hexahedra of a decoded cluster, one leaf's.
    #[inline(always)]
    pub fn add_cells(&mut self, cells: &[ClusterCell], leaf: &Leaf) {
        for (i, cell) in cells.iter().enumerate() {
            let slot = self.len % LANES;
            for k in 0..MAX_CORNERS {
                self.corners[k][slot] = u32::from(cell.corners[k]);
            }
            self.primitive[slot] = (2 * (u64::from(leaf.first_index) + i as u64)) as i32;
            self.cell_type[slot] = cell.cell_type as u8;
            self.len += 1;
        }
        self.leaves[self.num_leaves % LANES] = *leaf;
        self.num_leaves += 1;
    }

    /// Forgets the cells.
    pub fn clear(&mut self) {
        self.len = 0;
        self.num_leaves = 0;
    }

    /// Finds the places in each leaf and notes, for each, the lowest primitive that accepts it and
    /// its value.
    #[inline(always)]
    pub fn test<S: Simd>(
        &self,
        submesh: &Submesh,
        values: &Values,
        packets: &mut Packets,
        in_leaves: &mut InLeaves,
    ) {
        let mut cells = Cells::<S> {
            corners: [[S::F::splat(0.0); 3]; MAX_CORNERS],
            values: [S::F::splat(0.0); MAX_CORNERS],
        };
        let at_corners = self.values_at_corners::<S>(submesh, values);
        for k in 0..MAX_CORNERS {
            cells.corners[k] = S::gather_points(submesh.positions, &self.corners[k]);
            cells.values[k] = S::F::from_array(at_corners[k]);
        }
        let mut lo = cells.corners[0];
        let mut hi = cells.corners[0];
        for k in 1..MAX_CORNERS {
            lo = per_axis!(i => cells.corners[k][i].min(lo[i]));
            hi = per_axis!(i => cells.corners[k][i].max(hi[i]));
        }
        let (lo, hi) = (
            per_axis!(i => lo[i].to_array()),
            per_axis!(i => hi[i].to_array()),
        );
        let mut pairs = Pairs {
            at: [[0.0; PAIRS]; 3],
            number: [0; PAIRS],
            slot: [0; PAIRS],
            len: 0,
        };
        let mut slot = 0;
        for leaf in &self.leaves[..self.num_leaves] {
            let end = slot + usize::from(LeafCounts::unpack(leaf.counts).others);
            in_leaves.len = 0;
            packets.collect::<S>(leaf, 1.0, (2 * first_other(leaf)) as i32, in_leaves);
            while slot < end {
                let mut place = 0;
                while place < in_leaves.len {
                    let (at, lanes) = in_leaves.sixteen::<S>(place, in_leaves.len);
                    let within = per_axis!(i => {
                        let (lo, hi) = (lo[i][slot % LANES], hi[i][slot % LANES]);
                        S::F::splat(lo).le(at[i]) & at[i].le(S::F::splat(hi))
                    });
                    let within = within[0] & within[1] & within[2];
                    let lanes = within.to_bits() & lanes;
                    if lanes != 0 {
                        pairs.add::<S>(at, &in_leaves.number[place..], lanes, slot);
                        if pairs.len >= LANES {
                            self.judge_pairs::<S>(submesh, &cells, &pairs, LANES, packets);
                            pairs.drop_sixteen();
                        }
                    }
                    place += LANES;
                }
                slot += 1;
            }
        }
        if pairs.len > 0 {
            self.judge_pairs::<S>(submesh, &cells, &pairs, pairs.len, packets);
        }
    }

    /// Values at the corners of all cells.
    #[inline(always)]
    fn values_at_corners<S: Simd>(
        &self,
        submesh: &Submesh,
        values: &Values,
    ) -> [[f32; LANES]; MAX_CORNERS] {
        let mut at_corners = [[0.0; LANES]; MAX_CORNERS];
        match values {
            Values::Points(values) => {
                values.at_vertices::<S, _, _>(
                    submesh.header,
                    &self.corners,
                    self.len,
                    &mut at_corners,
                );
            }
            Values::Cluster(values) => {
                values.at_corners(&self.corners, self.len, &mut at_corners);
            }
            Values::Cells(values) => {
                let mut slot = 0;
                for leaf in &self.leaves[..self.num_leaves] {
                    let counts = LeafCounts::unpack(leaf.counts);
                    let tets = u32::from(counts.tets + 2 * counts.pairs);
                    for cell in 0..u32::from(counts.others) {
                        let value = values.at_cell(leaf.node, leaf.cells_before + tets + cell);
                        for k in 0..MAX_CORNERS {
                            at_corners[k][slot % LANES] = value;
                        }
                        slot += 1;
                    }
                }
            }
        }
        at_corners
    }

    /// Notes which of the first pairs are of a cell that accepts the place.
    #[inline(always)]
    fn judge_pairs<S: Simd>(
        &self,
        submesh: &Submesh,
        cells: &Cells<S>,
        pairs: &Pairs,
        len: usize,
        packets: &mut Packets,
    ) {
        let mut slots = [0; LANES];
        slots.copy_from_slice(&pairs.slot[..LANES]);
        let mut cell_type = [0u8; LANES];
        for pair in 0..LANES {
            slots[pair] %= LANES as i32;
            cell_type[pair] = self.cell_type[slots[pair] as usize % LANES];
        }
        let slot = S::I::from_array(slots);
        let place = per_axis!(i => super::packets::load::<S>(&pairs.at[i], 0));
        let mut p = [[S::F::splat(0.0); 3]; MAX_CORNERS];
        for k in 0..MAX_CORNERS {
            p[k] = per_axis!(i => cells.corners[k][i].permute(slot) - place[i]);
        }
        let lanes = ((1u32 << len) - 1) as u16;
        let mut verdict = judge::<S>(p, &cell_type, lanes);
        let doubt = lanes & !verdict.inside.to_bits() & !verdict.outside.to_bits();
        let mut accepted = verdict.inside.to_bits() & lanes;
        if doubt != 0 {
            let mut weights = [[0.0; LANES]; MAX_CORNERS];
            for k in 1..MAX_CORNERS {
                weights[k] = verdict.weights[k].to_array();
            }
            accepted |= self.decide(submesh, doubt, pairs, packets, &mut weights);
            for k in 1..MAX_CORNERS {
                verdict.weights[k] = S::F::from_array(weights[k]);
            }
        }
        if accepted == 0 {
            return;
        }
        let mut values = [S::F::splat(0.0); MAX_CORNERS];
        for k in 0..MAX_CORNERS {
            values[k] = cells.values[k].permute(slot);
        }
        let value = interpolate::<S>(&values, &verdict.weights).to_array();
        while accepted != 0 {
            let pair = accepted.trailing_zeros() as usize;
            accepted &= accepted - 1;
            let number = pairs.number[pair];
            let primitive = self.primitive[slots[pair] as usize % LANES];
            if packets.note(number, primitive, value[pair]) {
                packets.note_kind(number, true);
            }
        }
    }

    /// Which pairs in doubt the scalar code accepts, with the weights.
    #[cold]
    #[inline(never)]
    fn decide(
        &self,
        submesh: &Submesh,
        doubt: u16,
        pairs: &Pairs,
        packets: &Packets,
        weights: &mut [[f32; LANES]; MAX_CORNERS],
    ) -> u16 {
        let mut accepted = 0;
        for pair in (0..LANES).filter(|pair| doubt >> pair & 1 == 1) {
            let slot = pairs.slot[pair] as usize % LANES;
            let corner = |k: usize| submesh.positions.get(self.corners[k][slot] as usize);
            let positions = std::array::from_fn(|k| corner(k).copied().unwrap_or([f32::NAN; 3]));
            let place = packets.place(pairs.number[pair]);
            if let Some(found) = scalar_weights(self.cell_type[slot], &positions, place) {
                accepted |= 1 << pair;
                for k in 1..MAX_CORNERS {
                    weights[k][pair] = found[k];
                }
            }
        }
        accepted
    }
}

impl Pairs {
    /// Adds some lanes, each with a cell's slot.
    #[inline(always)]
    fn add<S: Simd>(&mut self, at: [S::F; 3], numbers: &[i32], lanes: u16, slot: usize) {
        let kept = S::M::from_bits(lanes);
        for axis in 0..3 {
            store::<S>(at[axis].compress(kept), &mut self.at[axis], self.len);
        }
        let mut left = lanes;
        while left != 0 {
            let lane = left.trailing_zeros() as usize;
            left &= left - 1;
            self.number[self.len % PAIRS] = numbers[lane];
            self.slot[self.len % PAIRS] = slot as i32;
            self.len += 1;
        }
    }

    /// Forgets the first sixteen.
    #[inline(always)]
    fn drop_sixteen(&mut self) {
        for axis in 0..3 {
            self.at[axis].copy_within(LANES.., 0);
        }
        self.number.copy_within(LANES.., 0);
        self.slot.copy_within(LANES.., 0);
        self.len -= LANES;
    }
}

/// Where the pyramids, wedges and hexahedra of a leaf begin among the indices.
#[inline(always)]
fn first_other(leaf: &Leaf) -> u64 {
    let counts = LeafCounts::unpack(leaf.counts);
    let (tets, pairs) = (u64::from(counts.tets), u64::from(counts.pairs));
    u64::from(leaf.first_index) + TET_INDICES as u64 * tets + PAIR_INDICES as u64 * pairs
}

/// The scalar code's answer for a cell, given its kind's number and its corners, and a place.
pub(super) fn scalar_weights(
    cell_type: u8,
    positions: &[[f32; 3]; MAX_CORNERS],
    place: [f32; 3],
) -> Option<[f32; MAX_CORNERS]> {
    let cell_type = CellType::ALL[usize::from(cell_type) % CellType::ALL.len()];
    let weights = weights_at(cell_type, positions, place.map(f64::from))?;
    Some(weights.map(|w| w as f32))
}

/// The value that weights make of the corners' values, within their range whatever the rounding;
/// NaN where one of them is not finite.
#[inline(always)]
fn interpolate<S: Simd>(values: &[S::F; MAX_CORNERS], weights: &[S::F; MAX_CORNERS]) -> S::F {
    let first = values[0];
    let (mut lo, mut hi, mut value) = (first, first, first);
    let mut finite = first.abs().le(S::F::splat(f32::MAX));
    for k in 1..MAX_CORNERS {
        let corner = values[k];
        finite = finite & corner.abs().le(S::F::splat(f32::MAX));
        lo = lo.min(corner);
        hi = hi.max(corner);
        value = weights[k].mul_add(corner - first, value);
    }
    value.max(lo).min(hi).select(finite, S::F::splat(f32::NAN))
}
