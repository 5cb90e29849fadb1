//! Places tried on the tetrahedra of a batch: sixteen places on one cell at a time, or, where a leaf
//! has fewer places than cells, one place on sixteen cells.

use std::ops::Range;

use vacua_simd::{Float, Int, LANES, Mask, Simd, per_axis};
use vacua_volume::CellType;

use crate::Weights;
use crate::element::weights_at;
use crate::layout::TET_INDICES;
use crate::packed::Submesh;

use super::accepted::OneAccepted;
use super::packets::{Packets, load, load_i};
use super::tets::{Planes, SLOTS, TetBatch, dot, num_tets};

/// Volumes that places make with the faces of tetrahedra, each the same lane's.
struct Volumes<S: Simd> {
    u: S::F,
    v: S::F,
    w: S::F,
    /// The lanes of which the place is inside for certain, and outside for certain.
    inside: S::M,
    outside: S::M,
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
            inside: bound.lt(least),
            outside: least.lt(S::F::splat(0.0) - bound),
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
    /// Notes, for each place in each leaf, the lowest primitive that accepts it and its value.
    #[inline(always)]
    pub fn test<S: Simd>(&mut self, submesh: &Submesh, packets: &mut Packets) {
        self.accepted.clear();
        let (mut slot, mut place) = (0, 0);
        for leaf in 0..self.num_leaves {
            let end = self.ends[leaf % SLOTS];
            let slots = slot..slot + num_tets(&self.leaves[leaf % SLOTS]);
            slot = slots.end;
            if 2 * (end - place) <= slots.len() {
                while place < end {
                    self.test_one::<S>(submesh, slots.clone(), place, packets);
                    place += 1;
                }
            } else {
                while place < end {
                    self.test_sixteen::<S>(submesh, slots.clone(), place, end, packets);
                    place += LANES;
                }
            }
            place = end;
        }
        for i in 0..self.accepted.len() {
            self.note(submesh, self.accepted.get(i), packets);
        }
    }

    /// Sixteen places of a leaf, tried on one tetrahedron after the other, from the last to the first:
    /// what a lower one accepts replaces what was found before, without a branch.
    #[inline(always)]
    fn test_sixteen<S: Simd>(
        &mut self,
        submesh: &Submesh,
        slots: Range<usize>,
        place: usize,
        end: usize,
        packets: &mut Packets,
    ) {
        let (at, lanes) = self.places.sixteen::<S>(place, end);
        let none = S::M::from_bits(0);
        let (mut found, mut doubt) = (none, none);
        let mut value = S::F::splat(0.0);
        let mut in_slot = S::F::splat(0.0);
        for slot in slots.clone().rev() {
            let pick = One(slot % SLOTS);
            let volumes = self.planes.volumes::<S>(at, pick);
            let inside = volumes.inside;
            let here = self.planes.values::<S>(&volumes, pick);
            value = here.select(inside, value);
            in_slot = S::f_from_bits(S::I::splat(slot as i32)).select(inside, in_slot);
            found = found | inside;
            doubt = (doubt | !volumes.outside) & !inside;
        }
        let mut doubt = doubt.to_bits() & lanes;
        let found = found.to_bits() & lanes & !doubt;
        let number = load_i::<S>(&self.places.number, place);
        self.accepted
            .add::<S>(found, number, in_slot.to_bits(), value);
        while doubt != 0 {
            let lane = doubt.trailing_zeros() as usize;
            doubt &= doubt - 1;
            if let Some(slot) = self.decide(submesh, slots.clone(), place + lane, packets) {
                let pick = One(slot % SLOTS);
                let volumes = self.planes.volumes::<S>(at, pick);
                let accepted = OneAccepted {
                    number: self.places.number[place + lane],
                    slot: slot as i32,
                    value: self.planes.values::<S>(&volumes, pick).to_array()[lane],
                };
                self.note(submesh, accepted, packets);
            }
        }
    }

    /// One place, tried on sixteen tetrahedra at a time.
    #[inline(always)]
    fn test_one<S: Simd>(
        &mut self,
        submesh: &Submesh,
        slots: Range<usize>,
        place: usize,
        packets: &mut Packets,
    ) {
        let number = self.places.number[place];
        let at = per_axis!(i => S::F::splat(self.places.at[i][place]));
        let mut from = slots.start;
        while from < slots.end {
            let there = ((1u32 << (slots.end - from).min(LANES)) - 1) as u16;
            let pick = Sixteen(from);
            let volumes = self.planes.volumes::<S>(at, pick);
            let values = self.planes.values::<S>(&volumes, pick).to_array();
            let inside = volumes.inside.to_bits() & there;
            let doubt = there & !volumes.inside.to_bits() & !volumes.outside.to_bits();
            let lane = inside.trailing_zeros() as usize;
            let mut accepted = OneAccepted {
                number,
                slot: (from + lane) as i32,
                value: values[lane % LANES],
            };
            // A cell in doubt before that one?
            if u32::from(doubt).trailing_zeros() < inside.trailing_zeros() {
                let slots = from..slots.end.min(from + LANES);
                if let Some(slot) = self.decide(submesh, slots, place, packets) {
                    accepted.slot = slot as i32;
                    accepted.value = values[(slot - from) % LANES];
                    self.note(submesh, accepted, packets);
                }
            } else {
                self.accepted.add_one(accepted, usize::from(inside != 0));
            }
            from += LANES;
        }
    }

    /// Notes that a tetrahedron accepts a place, unless a lower one does, and the value there.
    #[inline(always)]
    fn note(&self, submesh: &Submesh, accepted: OneAccepted, packets: &mut Packets) {
        let OneAccepted {
            number,
            slot,
            mut value,
        } = accepted;
        let slot = slot as usize % SLOTS;
        if self.planes.flat >> slot & 1 == 1 {
            value = self.interpolate_flat(submesh, slot, packets.place(number));
        }
        if packets.note(number, self.primitive[slot], value) && packets.is_mixed {
            packets.note_kind(number, false);
        }
    }

    /// The first of some tetrahedra of which the scalar code says that it accepts a place.
    #[cold]
    #[inline(never)]
    fn decide(
        &self,
        submesh: &Submesh,
        mut slots: Range<usize>,
        place: usize,
        packets: &Packets,
    ) -> Option<usize> {
        let at = packets.place(self.places.number[place]);
        slots.find(|slot| self.weights(submesh, slot % SLOTS, at).is_some())
    }

    /// The value at a place in a tetrahedron that is too flat for weights in `f32`.
    #[cold]
    #[inline(never)]
    fn interpolate_flat(&self, submesh: &Submesh, slot: usize, at: [f32; 3]) -> f32 {
        let planes = &self.planes;
        let weights = self.weights(submesh, slot, at).unwrap_or_default();
        let mut value = planes.first[slot];
        for k in 0..3 {
            value = (weights[k + 1] as f32).mul_add(planes.more[k][slot], value);
        }
        let (least, largest) = (planes.least[slot], planes.largest[slot]);
        if least <= largest {
            value.max(least).min(largest)
        } else {
            f32::NAN
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
