//! Places that cells have accepted, gathered without a branch and noted together.

use vacua_simd::{Float, Mask, Simd};

use super::packets::{ROOM, store, store_i};

/// Places, the slots of the cells that accept them, and the values there.
pub(super) struct Accepted {
    number: [i32; ROOM],
    slot: [i32; ROOM],
    value: [f32; ROOM],
    len: usize,
}

/// A place that a cell accepts.
#[derive(Clone, Copy, Debug)]
pub(super) struct OneAccepted {
    /// The number of the place among those of all packets.
    pub number: i32,
    /// The slot of the cell in its batch.
    pub slot: i32,
    pub value: f32,
}

impl Accepted {
    pub fn new() -> Self {
        Self {
            number: [0; ROOM],
            slot: [0; ROOM],
            value: [0.0; ROOM],
            len: 0,
        }
    }

    /// How many there are.
    #[inline(always)]
    pub fn len(&self) -> usize {
        self.len
    }

    /// One of them.
    #[inline(always)]
    pub fn get(&self, i: usize) -> OneAccepted {
        OneAccepted {
            number: self.number[i],
            slot: self.slot[i],
            value: self.value[i],
        }
    }

    /// Forgets them.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Adds some lanes.
    #[inline(always)]
    pub fn add<S: Simd>(&mut self, lanes: u16, number: S::I, slot: S::I, value: S::F) {
        let kept = S::M::from_bits(lanes);
        let compressed = |numbers: S::I| S::f_from_bits(numbers).compress(kept).to_bits();
        store_i::<S>(compressed(number), &mut self.number, self.len);
        store_i::<S>(compressed(slot), &mut self.slot, self.len);
        store::<S>(value.compress(kept), &mut self.value, self.len);
        self.len += lanes.count_ones() as usize;
    }

    /// Adds one, or none: as many as `count` says.
    #[inline(always)]
    pub fn add_one(&mut self, one: OneAccepted, count: usize) {
        let last = self.len % ROOM;
        self.number[last] = one.number;
        self.slot[last] = one.slot;
        self.value[last] = one.value;
        self.len += count;
    }
}
