//! Places tried on the tetrahedra of a batch: sixteen places on one cell at a time, or, where a leaf
//! has fewer places than cells, one place on sixteen cells.

use std::ops::Range;

use vacua_simd::{Float, Int, LANES, Mask, Simd, per_axis};
use vacua_volume::CellType;

use crate::Weights;
use crate::element::weights_at;
use crate::layout::TET_INDICES;
use crate::packed::Submesh;

use super::packets::{InLeaf, NOT_FOUND, Packets, load};
use super::tets::{Planes, SLOTS, TetBatch, dot, num_tets};

/// Volumes that places make with the faces of tetrahedra, each the same lane's.
struct Volumes<S: Simd> {
    u: S::F,
    v: S::F,
    w: S::F,
    /// The lanes of which the place is inside for certain, and outside for certain.
    inside: u16,
    outside: u16,
}

/// Which sixteen numbers of an array are meant. No closure, as those may be compiled without the
/// features of the instruction set.
trait Pick: Copy {
    fn of<S: Simd>(self, numbers: &[f32]) -> S::F;
}

/// The number of one slot, sixteen times.
#[derive(Clone, Copy)]
struct One(usize);

/// The numbers of sixteen slots, given the first.
#[derive(Clone, Copy)]
struct Sixteen(usize);

impl Pick for One {
    #[inline(always)]
    fn of<S: Simd>(self, numbers: &[f32]) -> S::F {
        S::F::splat(numbers[self.0])
    }
}

impl Pick for Sixteen {
    #[inline(always)]
    fn of<S: Simd>(self, numbers: &[f32]) -> S::F {
        load::<S>(numbers, self.0)
    }
}

impl Planes {
    /// The volumes that places make with tetrahedra.
    #[inline(always)]
    fn volumes<S: Simd>(&self, at: [S::F; 3], pick: impl Pick) -> Volumes<S> {
        let p = per_axis!(i => at[i] - pick.of::<S>(&self.corner[i]));
        let normals = &self.normals;
        let u = dot(p, per_axis!(i => pick.of::<S>(&normals[0][i])));
        let v = dot(p, per_axis!(i => pick.of::<S>(&normals[1][i])));
        let w = dot(p, per_axis!(i => pick.of::<S>(&normals[2][i])));
        let whole = pick.of::<S>(&self.whole);
        let least = u.min(v).min(w.min(whole - (u + v + w)));
        let bound = pick.of::<S>(&self.bound);
        Volumes {
            inside: bound.lt(least).to_bits(),
            outside: least.lt(S::F::splat(0.0) - bound).to_bits(),
            u,
            v,
            w,
        }
    }

    /// The values there.
    #[inline(always)]
    fn values<S: Simd>(&self, volumes: &Volumes<S>, pick: impl Pick) -> S::F {
        let (zero, one) = (S::F::splat(0.0), S::F::splat(1.0));
        let inverse = pick.of::<S>(&self.inverse);
        let u = (volumes.u * inverse).max(zero).min(one);
        let v = (volumes.v * inverse).max(zero).min(one);
        let w = (volumes.w * inverse).max(zero).min(one);
        let mut values = u.mul_add(pick.of::<S>(&self.more[0]), pick.of::<S>(&self.first));
        values = v.mul_add(pick.of::<S>(&self.more[1]), values);
        values = w.mul_add(pick.of::<S>(&self.more[2]), values);
        values
            .max(pick.of::<S>(&self.least))
            .min(pick.of::<S>(&self.largest))
    }
}

impl TetBatch {
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
        for leaf in self.leaves() {
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
        slots: Range<usize>,
        place: usize,
        packets: &mut Packets,
        in_leaf: &InLeaf,
    ) {
        let (at, lanes) = in_leaf.sixteen::<S>(place);
        let mut open = lanes;
        let mut best = S::f_from_bits(S::I::splat(NOT_FOUND));
        let mut value = S::F::splat(0.0);
        for slot in slots {
            let slot = slot % SLOTS;
            let pick = One(slot);
            let volumes = self.planes.volumes::<S>(at, pick);
            let mut accepted = volumes.inside & open;
            let doubt = open & !volumes.inside & !volumes.outside;
            if doubt != 0 {
                accepted |= self.decide(submesh, slot, doubt, place, packets, in_leaf);
            }
            if accepted == 0 {
                continue;
            }
            let mut here = self.planes.values::<S>(&volumes, pick);
            if self.planes.flat >> slot & 1 == 1 {
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
        slots: Range<usize>,
        place: usize,
        packets: &mut Packets,
        in_leaf: &InLeaf,
    ) {
        let number = in_leaf.number[place];
        let at = per_axis!(i => S::F::splat(in_leaf.at[i][place]));
        let mut from = slots.start;
        while from < slots.end {
            let there = ((1u32 << (slots.end - from).min(LANES)) - 1) as u16;
            let pick = Sixteen(from);
            let volumes = self.planes.volumes::<S>(at, pick);
            let mut maybe = there & !volumes.outside;
            if maybe == 0 {
                from += LANES;
                continue;
            }
            let values = self.planes.values::<S>(&volumes, pick).to_array();
            while maybe != 0 {
                let lane = maybe.trailing_zeros() as usize;
                maybe &= maybe - 1;
                let slot = (from + lane) % SLOTS;
                if volumes.inside >> lane & 1 == 0
                    && self.decide(submesh, slot, 1, place, packets, in_leaf) == 0
                {
                    continue;
                }
                let mut value = [values[lane]; LANES];
                if self.planes.flat >> slot & 1 == 1 {
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
