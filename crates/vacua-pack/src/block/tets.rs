//! Tetrahedra of several leaves: their planes set up sixteen cells at a time, then tried on sixteen
//! places at a time.
//!
//! With edges `b, c, d` from corner `a` and the place `p` seen from there, the volumes that `p`
//! makes with the faces are `p·(c×d)`, `p·(d×b)`, `p·(b×c)` and what they leave of the whole,
//! `b·(c×d)`. A place is inside if all have the whole's sign; over the whole they are its weights.
//! Every product of an x, a y and a z difference within the leaf's box is at most that box's volume,
//! which bounds all rounding: only volumes above the bound decide, the rest is left to
//! [`crate::weights_at`].

use vacua_simd::{Float, Int, LANES, Mask, Simd, per_axis};
use vacua_volume::CellType;

use crate::Weights;
use crate::element::weights_at;
use crate::layout::{LeafCounts, PAIR_INDICES, TET_INDICES};
use crate::packed::Submesh;
use crate::pairs::tets_of;

use super::descend::Leaf;
use super::packets::{InLeaf, NOT_FOUND, Packets, load, store};
use super::values::Values;

/// Bound on the rounding of a volume, in units of the volume of the leaf's box: the last of the
/// four, a difference of four sums of three products of differences, is off by 264 · 2⁻²⁴ at most.
pub(super) const ROUNDING: f64 = 512.0 / (1 << 24) as f64;

/// Where products of scaled differences may be subnormal and lose digits.
const SMALLEST: f32 = f32::MIN_POSITIVE;

/// A tetrahedron this flat, box volume by volume, gets its weights in `f64`.
const FLAT: f32 = 32.0;

/// Tetrahedra of a batch at most.
pub(super) const SLOTS: usize = 64;
/// Room for as many, and for sixteen that begin at the last.
const ROOM: usize = SLOTS + LANES;

#[inline(always)]
pub(super) fn cross<F: Float>(a: [F; 3], b: [F; 3]) -> [F; 3] {
    let zero = F::splat(0.0);
    [
        a[1].mul_add(b[2], zero - a[2] * b[1]),
        a[2].mul_add(b[0], zero - a[0] * b[2]),
        a[0].mul_add(b[1], zero - a[1] * b[0]),
    ]
}

#[inline(always)]
pub(super) fn dot<F: Float>(a: [F; 3], b: [F; 3]) -> F {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

/// Whether tetrahedra with these edges from a corner, of this volume, are not too flat for `f32`.
#[inline(always)]
pub(super) fn is_round<S: Simd>([b, c, d]: [[S::F; 3]; 3], whole: S::F) -> S::M {
    let sides = per_axis!(i => b[i].abs().max(c[i].abs().max(d[i].abs())));
    let whole = whole.abs();
    (sides[0] * sides[1] * sides[2]).lt(whole * S::F::splat(FLAT)) & S::F::splat(1e-30).lt(whole)
}

/// Tetrahedra of some leaves.
pub(super) struct TetBatch {
    /// How many there are.
    pub len: usize,
    corners: [[u32; SLOTS]; TET_INDICES],
    primitive: [i32; SLOTS],
    /// Bound on the rounding of each one's volumes.
    rounding: [f32; SLOTS],
    leaves: [Leaf; SLOTS],
    num_leaves: usize,
    planes: Planes,
}

/// How many tetrahedra a leaf has.
#[inline(always)]
fn num_tets(leaf: &Leaf) -> usize {
    let counts = LeafCounts::unpack(leaf.counts);
    usize::from(counts.tets) + 2 * usize::from(counts.pairs)
}

/// What is computed of each tetrahedron.
struct Planes {
    /// Its first corner.
    corner: [[f32; ROOM]; 3],
    /// Normals of the faces opposite the other corners, turned inward, as long as twice their areas.
    normals: [[[f32; ROOM]; 3]; 3],
    /// Six times its volume, and one over that.
    whole: [f32; ROOM],
    inverse: [f32; ROOM],
    /// Volumes above this are positive, those below its negative negative.
    bound: [f32; ROOM],
    /// Value at the first corner, and how much more there is at the others.
    first: [f32; ROOM],
    more: [[f32; ROOM]; 3],
    /// The least and the largest value.
    least: [f32; ROOM],
    largest: [f32; ROOM],
    /// The tetrahedra, a bit each, that are too flat for weights in `f32`.
    flat: u64,
}

impl TetBatch {
    pub fn new() -> Self {
        let zeros = [0.0; ROOM];
        Self {
            len: 0,
            corners: [[0; SLOTS]; TET_INDICES],
            primitive: [0; SLOTS],
            rounding: [0.0; SLOTS],
            leaves: [Leaf::default(); SLOTS],
            num_leaves: 0,
            planes: Planes {
                corner: [zeros; 3],
                normals: [[zeros; 3]; 3],
                whole: zeros,
                inverse: zeros,
                bound: zeros,
                first: zeros,
                more: [zeros; 3],
                least: zeros,
                largest: zeros,
                flat: 0,
            },
        }
    }

    /// Whether there is room for the tetrahedra of a leaf.
    #[inline(always)]
    pub fn has_room(&self, leaf: &Leaf) -> bool {
        self.len + num_tets(leaf) <= SLOTS
    }

    /// Adds the tetrahedra of a leaf, if it has any; there must be room for them.
    #[inline(always)]
    pub fn add(&mut self, leaf: &Leaf) {
        self.leaves[self.num_leaves % SLOTS] = *leaf;
        self.num_leaves += usize::from(num_tets(leaf) > 0);
        self.len += num_tets(leaf);
    }

    /// Reads the indices of all tetrahedra; asks for the positions and values of their corners if
    /// those are likely to be far away.
    #[inline(always)]
    fn read(&mut self, submesh: &Submesh, rounding: f32, values: &Values, is_far: bool) {
        let mut slot = 0;
        for number in 0..self.num_leaves {
            let leaf = self.leaves[number % SLOTS];
            let counts = LeafCounts::unpack(leaf.counts);
            let from = slot;
            let mut place = u64::from(leaf.first_index);
            if let Some(cluster) = submesh.decoded {
                let first = leaf.first_index.wrapping_sub(cluster.first_cell) as usize;
                let cells = cluster
                    .cells
                    .get(first..first.saturating_add(num_tets(&leaf)));
                for (i, cell) in cells.unwrap_or(&[]).iter().enumerate() {
                    let [a, b, c, d, ..] = cell.corners.map(u32::from);
                    self.put(slot, [a, b, c, d], 2 * (place + i as u64));
                    slot += 1;
                }
                self.rounding[from..slot.min(SLOTS)].fill(leaf.volume * rounding);
                continue;
            }
            for _ in 0..counts.tets {
                self.put(slot, submesh.indices.read(place), 2 * place);
                slot += 1;
                place += TET_INDICES as u64;
            }
            for _ in 0..counts.pairs {
                let [one, two] = tets_of(submesh.indices.read::<PAIR_INDICES>(place));
                self.put(slot, one, 2 * place);
                self.put(slot + 1, two, 2 * place + 1);
                slot += 2;
                place += PAIR_INDICES as u64;
            }
            let rounding = leaf.volume * rounding;
            for slot in from..slot {
                self.rounding[slot % SLOTS] = rounding;
                if is_far {
                    for k in 0..TET_INDICES {
                        let corner = self.corners[k][slot % SLOTS];
                        vacua_simd::prefetch(submesh.positions, corner as usize);
                        values.prefetch(submesh.header, corner);
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn put(&mut self, slot: usize, corners: [u32; TET_INDICES], primitive: u64) {
        let slot = slot % SLOTS;
        for k in 0..TET_INDICES {
            self.corners[k][slot] = corners[k];
        }
        self.primitive[slot] = primitive as i32;
    }

    /// Forgets the tetrahedra.
    pub fn clear(&mut self) {
        self.len = 0;
        self.num_leaves = 0;
    }

    /// Computes the planes of all tetrahedra; coordinates are multiplied by `scale`, a power of two.
    /// `rounding` bounds the rounding of volumes per cubic sixteenth of a leaf's box; `is_far` says
    /// that cells are likely to be far from each other in memory.
    #[inline(always)]
    pub fn set_up<S: Simd>(
        &mut self,
        submesh: &Submesh,
        scale: f32,
        rounding: f32,
        values: &Values,
        is_far: bool,
    ) {
        self.read(submesh, rounding, values, is_far);
        let mut at_corners = [[0.0; SLOTS]; TET_INDICES];
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
                    for cell in 0..num_tets(leaf) as u32 {
                        let value = values.at_cell(leaf.node, leaf.cells_before + cell);
                        for k in 0..TET_INDICES {
                            at_corners[k][slot % SLOTS] = value;
                        }
                        slot += 1;
                    }
                }
            }
        }
        self.planes.flat = 0;
        let mut from = 0;
        while from < self.len {
            self.set_up_sixteen::<S>(submesh, scale, &at_corners, from);
            from += LANES;
        }
    }

    #[inline(always)]
    fn set_up_sixteen<S: Simd>(
        &mut self,
        submesh: &Submesh,
        scale: f32,
        values: &[[f32; SLOTS]; TET_INDICES],
        from: usize,
    ) {
        let scale = S::F::splat(scale);
        let (zero, one) = (S::F::splat(0.0), S::F::splat(1.0));
        let planes = &mut self.planes;
        let mut p = [[zero; 3]; TET_INDICES];
        for k in 0..TET_INDICES {
            if let Some(corners) = self.corners[k].get(from..).and_then(|c| c.first_chunk()) {
                p[k] = S::gather_points(submesh.positions, corners);
            }
        }
        let [a, b, c, d] = p;
        let b = per_axis!(i => (b[i] - a[i]) * scale);
        let c = per_axis!(i => (c[i] - a[i]) * scale);
        let d = per_axis!(i => (d[i] - a[i]) * scale);
        let (cd, db, bc) = (cross(c, d), cross(d, b), cross(b, c));
        let whole = dot(b, cd);
        let bound = load::<S>(&self.rounding, from) + S::F::splat(SMALLEST);
        // With the sign of the whole all volumes inside are positive, whichever way the cell is
        // turned.
        let sign = one.select(zero.le(whole), zero - one);
        let whole = whole.abs();
        // Of a cell that may be flat or turned either way nothing is certain.
        let four_bounds = bound * S::F::splat(4.0);
        let bound = bound.select(four_bounds.lt(whole), S::F::splat(f32::INFINITY));
        let round = is_round::<S>([b, c, d], whole);
        planes.flat |= u64::from(!round.to_bits()) << from;
        for i in 0..3 {
            store::<S>(a[i] * scale, &mut planes.corner[i], from);
            store::<S>(cd[i] * sign, &mut planes.normals[0][i], from);
            store::<S>(db[i] * sign, &mut planes.normals[1][i], from);
            store::<S>(bc[i] * sign, &mut planes.normals[2][i], from);
        }
        store::<S>(whole, &mut planes.whole, from);
        store::<S>(one.div(whole), &mut planes.inverse, from);
        store::<S>(bound, &mut planes.bound, from);
        let first = load::<S>(&values[0], from);
        let (mut least, mut largest) = (first, first);
        let finite = S::F::splat(f32::MAX);
        let mut plain = first.abs().le(finite);
        for k in 1..TET_INDICES {
            let corner = load::<S>(&values[k], from);
            plain = plain & corner.abs().le(finite);
            least = least.min(corner);
            largest = largest.max(corner);
            store::<S>(corner - first, &mut planes.more[k - 1], from);
        }
        // A cell with a value that is not finite has none.
        let none = S::F::splat(f32::NAN);
        store::<S>(first, &mut planes.first, from);
        store::<S>(least.select(plain, none), &mut planes.least, from);
        store::<S>(largest.select(plain, none), &mut planes.largest, from);
    }

    /// Finds the places in each leaf and notes, for each, the lowest primitive that accepts it and
    /// its value.
    #[inline(always)]
    pub fn test<S: Simd>(
        &self,
        submesh: &Submesh,
        scale: f32,
        packets: &mut Packets,
        in_leaf: &mut InLeaf,
    ) {
        let mut from = 0;
        for leaf in &self.leaves[..self.num_leaves] {
            let to = from + num_tets(leaf);
            let first = leaf.first_index.wrapping_mul(2) as i32;
            packets.collect::<S>(leaf, scale, first, in_leaf);
            if 2 * in_leaf.len <= to - from {
                for place in 0..in_leaf.len {
                    self.test_one::<S>(submesh, from..to, place, packets, in_leaf);
                }
                from = to;
                continue;
            }
            let mut place = 0;
            while place < in_leaf.len {
                self.test_sixteen::<S>(submesh, from..to, place, packets, in_leaf);
                place += LANES;
            }
            from = to;
        }
    }

    #[inline(always)]
    fn test_sixteen<S: Simd>(
        &self,
        submesh: &Submesh,
        slots: std::ops::Range<usize>,
        place: usize,
        packets: &mut Packets,
        in_leaf: &InLeaf,
    ) {
        let planes = &self.planes;
        let (zero, one) = (S::F::splat(0.0), S::F::splat(1.0));
        let (at, lanes) = in_leaf.sixteen::<S>(place);
        let mut open = lanes;
        let mut best = S::f_from_bits(S::I::splat(NOT_FOUND));
        let mut value = zero;
        for slot in slots {
            let slot = slot % SLOTS;
            let p = per_axis!(i => at[i] - S::F::splat(planes.corner[i][slot]));
            let normals = &planes.normals;
            let cd = per_axis!(i => S::F::splat(normals[0][i][slot]));
            let db = per_axis!(i => S::F::splat(normals[1][i][slot]));
            let bc = per_axis!(i => S::F::splat(normals[2][i][slot]));
            let (u, v, w) = (dot(p, cd), dot(p, db), dot(p, bc));
            let whole = S::F::splat(planes.whole[slot]);
            let least = u.min(v).min(w.min(whole - (u + v + w)));
            let bound = S::F::splat(planes.bound[slot]);
            let inside = bound.lt(least).to_bits() & open;
            let outside = least.lt(zero - bound).to_bits();
            let mut accepted = inside;
            let doubt = open & !inside & !outside;
            if doubt != 0 {
                accepted |= self.decide(submesh, slot, doubt, place, packets, in_leaf);
            }
            if accepted == 0 {
                continue;
            }
            let inverse = S::F::splat(planes.inverse[slot]);
            let u = (u * inverse).max(zero).min(one);
            let v = (v * inverse).max(zero).min(one);
            let w = (w * inverse).max(zero).min(one);
            let mut here = u.mul_add(
                S::F::splat(planes.more[0][slot]),
                S::F::splat(planes.first[slot]),
            );
            here = v.mul_add(S::F::splat(planes.more[1][slot]), here);
            here = w.mul_add(S::F::splat(planes.more[2][slot]), here);
            let (least, largest) = (
                S::F::splat(planes.least[slot]),
                S::F::splat(planes.largest[slot]),
            );
            here = here.max(least).min(largest);
            if planes.flat >> slot & 1 == 1 {
                let mut values = here.to_array();
                self.interpolate_flat(
                    submesh,
                    slot,
                    accepted,
                    place,
                    packets,
                    in_leaf,
                    &mut values,
                );
                here = S::F::from_array(values);
            }
            let mask = S::M::from_bits(accepted);
            value = here.select(mask, value);
            best = S::f_from_bits(S::I::splat(self.primitive[slot])).select(mask, best);
            open &= !accepted;
            if open == 0 {
                break;
            }
        }
        let (best, value) = (best.to_bits().to_array(), value.to_array());
        let mut found = lanes & !open;
        while found != 0 {
            let lane = found.trailing_zeros() as usize;
            found &= found - 1;
            let number = in_leaf.number[place + lane];
            packets.note(number, best[lane], value[lane]);
            if packets.is_mixed {
                packets.note_kind(number, false);
            }
        }
    }

    /// One place, tried on sixteen tetrahedra at a time.
    #[inline(always)]
    fn test_one<S: Simd>(
        &self,
        submesh: &Submesh,
        slots: std::ops::Range<usize>,
        place: usize,
        packets: &mut Packets,
        in_leaf: &InLeaf,
    ) {
        let planes = &self.planes;
        let (zero, one) = (S::F::splat(0.0), S::F::splat(1.0));
        let number = in_leaf.number[place];
        let at = per_axis!(i => S::F::splat(in_leaf.at[i][place]));
        let mut from = slots.start;
        while from < slots.end {
            let there = ((1u32 << (slots.end - from).min(LANES)) - 1) as u16;
            let p = per_axis!(i => at[i] - load::<S>(&planes.corner[i], from));
            let normals = &planes.normals;
            let cd = per_axis!(i => load::<S>(&normals[0][i], from));
            let db = per_axis!(i => load::<S>(&normals[1][i], from));
            let bc = per_axis!(i => load::<S>(&normals[2][i], from));
            let (u, v, w) = (dot(p, cd), dot(p, db), dot(p, bc));
            let whole = load::<S>(&planes.whole, from);
            let least = u.min(v).min(w.min(whole - (u + v + w)));
            let bound = load::<S>(&planes.bound, from);
            let inside = bound.lt(least).to_bits();
            let mut maybe = there & !least.lt(zero - bound).to_bits();
            if maybe == 0 {
                from += LANES;
                continue;
            }
            let inverse = load::<S>(&planes.inverse, from);
            let u = (u * inverse).max(zero).min(one);
            let v = (v * inverse).max(zero).min(one);
            let w = (w * inverse).max(zero).min(one);
            let more = &planes.more;
            let mut values = u.mul_add(load::<S>(&more[0], from), load::<S>(&planes.first, from));
            values = v.mul_add(load::<S>(&more[1], from), values);
            values = w.mul_add(load::<S>(&more[2], from), values);
            values = values.max(load::<S>(&planes.least, from));
            let values = values.min(load::<S>(&planes.largest, from)).to_array();
            while maybe != 0 {
                let lane = maybe.trailing_zeros() as usize;
                maybe &= maybe - 1;
                let slot = (from + lane) % SLOTS;
                if inside >> lane & 1 == 0
                    && self.decide(submesh, slot, 1, place, packets, in_leaf) == 0
                {
                    continue;
                }
                let mut value = [values[lane]; LANES];
                if planes.flat >> slot & 1 == 1 {
                    self.interpolate_flat(submesh, slot, 1, place, packets, in_leaf, &mut value);
                }
                packets.note(number, self.primitive[slot], value[0]);
                if packets.is_mixed {
                    packets.note_kind(number, false);
                }
                return;
            }
            from += LANES;
        }
    }

    /// The lanes of those in doubt whose place the scalar code accepts.
    #[cold]
    #[inline(never)]
    fn decide(
        &self,
        submesh: &Submesh,
        slot: usize,
        doubt: u16,
        place: usize,
        packets: &Packets,
        in_leaf: &InLeaf,
    ) -> u16 {
        let mut accepted = 0;
        for lane in (0..LANES).filter(|lane| doubt >> lane & 1 == 1) {
            let at = packets.place(in_leaf.number[place + lane]);
            accepted |= u16::from(self.weights(submesh, slot, at).is_some()) << lane;
        }
        accepted
    }

    /// Values of some lanes in a tetrahedron that is too flat for weights in `f32`.
    #[cold]
    #[inline(never)]
    fn interpolate_flat(
        &self,
        submesh: &Submesh,
        slot: usize,
        lanes: u16,
        place: usize,
        packets: &Packets,
        in_leaf: &InLeaf,
        values: &mut [f32; LANES],
    ) {
        let planes = &self.planes;
        for lane in (0..LANES).filter(|lane| lanes >> lane & 1 == 1) {
            let at = packets.place(in_leaf.number[place + lane]);
            let weights = self.weights(submesh, slot, at).unwrap_or_default();
            let mut value = planes.first[slot];
            for k in 0..3 {
                value = (weights[k + 1] as f32).mul_add(planes.more[k][slot], value);
            }
            let (least, largest) = (planes.least[slot], planes.largest[slot]);
            values[lane] = if least <= largest {
                value.max(least).min(largest)
            } else {
                f32::NAN
            };
        }
    }

    /// What the scalar code says of a tetrahedron and a place.
    fn weights(&self, submesh: &Submesh, slot: usize, at: [f32; 3]) -> Option<Weights> {
        let mut positions = [[0.0; 3]; 8];
        for k in 0..TET_INDICES {
            positions[k] = *submesh.positions.get(self.corners[k][slot] as usize)?;
        }
        weights_at(CellType::Tetrahedron, &positions, at.map(f64::from))
    }
}
