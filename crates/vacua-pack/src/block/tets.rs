//! Tetrahedra of several leaves: their planes set up sixteen cells at a time, for `trials` to try
//! places on.
//!
//! With edges `b, c, d` from corner `a` and the place `p` seen from there, the volumes that `p`
//! makes with the faces are `p·(c×d)`, `p·(d×b)`, `p·(b×c)` and what they leave of the whole,
//! `b·(c×d)`. A place is inside if all have the whole's sign; over the whole they are its weights.
//! Every product of an x, a y and a z difference within the leaf's box is at most that box's volume,
//! which bounds all rounding: only volumes above the bound decide, the rest is left to
//! [`crate::weights_at`].

use vacua_simd::{Float, LANES, Mask, Simd, per_axis};

use crate::layout::{LeafCounts, PAIR_INDICES, TET_INDICES};
use crate::packed::Submesh;
use crate::pairs::tets_of;

use super::accepted::Accepted;
use super::descend::Leaf;
use super::packets::{InLeaves, Packets, load, store};
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

/// Tetrahedra of some leaves, and the places in those.
pub(super) struct TetBatch {
    /// How many there are.
    pub len: usize,
    pub(super) corners: [[u32; SLOTS]; TET_INDICES],
    pub(super) primitive: [i32; SLOTS],
    /// Bound on the rounding of each one's volumes.
    rounding: [f32; SLOTS],
    pub(super) leaves: [Leaf; SLOTS],
    pub(super) num_leaves: usize,
    /// The places in the leaves, leaf after leaf.
    pub(super) places: InLeaves,
    /// Where among the places those of the next leaf begin.
    pub(super) ends: [usize; SLOTS],
    /// Those of the places that tetrahedra accept.
    pub(super) accepted: Accepted,
    pub(super) planes: Planes,
}

/// How many tetrahedra a leaf has.
#[inline(always)]
pub(super) fn num_tets(leaf: &Leaf) -> usize {
    let counts = LeafCounts::unpack(leaf.counts);
    usize::from(counts.tets) + 2 * usize::from(counts.pairs)
}

/// What is computed of each tetrahedron.
pub(super) struct Planes {
    /// Its first corner.
    pub corner: [[f32; ROOM]; 3],
    /// Normals of the faces opposite the other corners, turned inward, as long as twice their areas.
    pub normals: [[[f32; ROOM]; 3]; 3],
    /// Six times its volume, and one over that.
    pub whole: [f32; ROOM],
    pub inverse: [f32; ROOM],
    /// Volumes above this are positive, those below its negative negative.
    pub bound: [f32; ROOM],
    /// Value at the first corner, and how much more there is at the others.
    pub first: [f32; ROOM],
    pub more: [[f32; ROOM]; 3],
    /// The least and the largest value.
    pub least: [f32; ROOM],
    pub largest: [f32; ROOM],
    /// The tetrahedra, a bit each, that are too flat for weights in `f32`.
    pub flat: u64,
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
            places: InLeaves::new(),
            ends: [0; SLOTS],
            accepted: Accepted::new(),
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

    /// Whether there is room for the tetrahedra of a leaf, and the places in it.
    #[inline(always)]
    pub fn has_room(&self, leaf: &Leaf) -> bool {
        self.len + num_tets(leaf) <= SLOTS && self.places.has_room()
    }

    /// Adds the tetrahedra of a leaf, if it has any, and the live places in it, multiplied by `scale`;
    /// there must be room for them. A leaf without a place is left out, so that its cells are not set
    /// up.
    #[inline(always)]
    pub fn add<S: Simd>(&mut self, leaf: &Leaf, scale: f32, packets: &Packets) {
        let tets = num_tets(leaf);
        if tets == 0 {
            return;
        }
        let before = self.places.len;
        let first = leaf.first_index.wrapping_mul(2) as i32;
        packets.collect::<S>(leaf, scale, first, &mut self.places);
        if self.places.len == before {
            return;
        }
        self.leaves[self.num_leaves % SLOTS] = *leaf;
        self.ends[self.num_leaves % SLOTS] = self.places.len;
        self.num_leaves += 1;
        self.len += tets;
    }

    /// Reads the indices of all tetrahedra; asks for the positions and values of their corners if
    /// those are likely to be far away. `rounding` bounds the rounding of volumes per cubic sixteenth
    /// of a leaf's box.
    #[inline(always)]
    pub fn read(&mut self, submesh: &Submesh, rounding: f32, values: &Values, is_far: bool) {
        let ask = |corners: &[u32]| {
            for &corner in corners.iter().filter(|_| is_far) {
                vacua_simd::prefetch(submesh.positions, corner as usize);
                values.prefetch(submesh.header, corner);
            }
        };
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
            } else {
                for _ in 0..counts.tets {
                    let corners = submesh.indices.read(place);
                    ask(&corners);
                    self.put(slot, corners, 2 * place);
                    slot += 1;
                    place += TET_INDICES as u64;
                }
                for _ in 0..counts.pairs {
                    let corners = submesh.indices.read::<PAIR_INDICES>(place);
                    ask(&corners);
                    let [one, two] = tets_of(corners);
                    self.put(slot, one, 2 * place);
                    self.put(slot + 1, two, 2 * place + 1);
                    slot += 2;
                    place += PAIR_INDICES as u64;
                }
            }
            self.rounding[from..slot.min(SLOTS)].fill(leaf.volume * rounding);
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
        self.places.len = 0;
    }

    /// Computes the planes of all tetrahedra, which have been read; coordinates are multiplied by
    /// `scale`, a power of two.
    #[inline(always)]
    pub fn set_up<S: Simd>(&mut self, submesh: &Submesh, scale: f32, values: &Values) {
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::block::PACKETS;
    use vacua_simd::Portable;

    #[test]
    fn a_full_batch_loses_no_leaf() {
        let leaf = |first_index, counts: LeafCounts| Leaf {
            first_index,
            packets: 1,
            counts: counts.pack().expect("fits"),
            ..Leaf::default()
        };
        let one = LeafCounts {
            tets: 1,
            ..LeafCounts::default()
        };
        let other = LeafCounts {
            others: 1,
            ..LeafCounts::default()
        };
        // One place, which is in every leaf: all have the box around the origin.
        let at = [[[0.0; LANES]; 3]];
        let mut live = [0; PACKETS];
        live[0] = 1;
        let packets = Packets::new(&at, live);
        let add = |batch: &mut TetBatch, leaf| batch.add::<Portable>(&leaf, 1.0, &packets);
        let mut batch = TetBatch::new();
        for i in 0..SLOTS as u32 {
            assert!(batch.has_room(&leaf(i, one)));
            add(&mut batch, leaf(i, one));
        }
        assert!(!batch.has_room(&leaf(99, one)));
        assert!(batch.has_room(&leaf(99, other)));
        add(&mut batch, leaf(99, other));
        let firsts = batch.leaves[..batch.num_leaves]
            .iter()
            .map(|leaf| leaf.first_index);
        assert!(firsts.eq(0..SLOTS as u32));
        assert_eq!(batch.places.len, SLOTS);
    }

    #[test]
    fn a_leaf_without_places_is_left_out() {
        let leaf = Leaf {
            packets: 1,
            lo: [1.0; 3],
            hi: [2.0; 3],
            counts: LeafCounts {
                tets: 1,
                ..LeafCounts::default()
            }
            .pack()
            .expect("fits"),
            ..Leaf::default()
        };
        let at = [[[0.0; LANES]; 3]];
        let packets = Packets::new(&at, [u16::MAX; PACKETS]);
        let mut batch = TetBatch::new();
        batch.add::<Portable>(&leaf, 1.0, &packets);
        assert_eq!((batch.len, batch.num_leaves), (0, 0));
    }
}
