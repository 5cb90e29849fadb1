//! Numbers of cells and points of the input, in 32 bits where they fit.

use std::fmt::Debug;

use crate::delta;

/// A number of a cell or point.
pub trait Id: Copy + Ord + Send + Sync + Debug {
    /// The number that fits by the caller's check.
    fn from_u64(value: u64) -> Self;
    /// The number.
    fn to_u64(self) -> u64;
    /// A list of numbers.
    fn list(all: Vec<Self>) -> Ids;
}

impl Id for u32 {
    fn from_u64(value: u64) -> Self {
        value as u32
    }
    fn to_u64(self) -> u64 {
        u64::from(self)
    }
    fn list(all: Vec<Self>) -> Ids {
        Ids::Narrow(all)
    }
}

impl Id for u64 {
    fn from_u64(value: u64) -> Self {
        value
    }
    fn to_u64(self) -> u64 {
        self
    }
    fn list(all: Vec<Self>) -> Ids {
        Ids::Wide(all)
    }
}

/// A list of such numbers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ids {
    /// All below 2^32.
    Narrow(Vec<u32>),
    /// Any.
    Wide(Vec<u64>),
}

impl Ids {
    /// An empty list for numbers below `limit`.
    pub fn below(limit: u64, capacity: usize) -> Self {
        if limit <= 1 << 32 {
            Self::Narrow(Vec::with_capacity(capacity))
        } else {
            Self::Wide(Vec::with_capacity(capacity))
        }
    }

    /// Appends a number, which must be below the limit the list was made for.
    #[inline(always)]
    pub fn push(&mut self, id: u64) {
        match self {
            Self::Narrow(all) => all.push(id as u32),
            Self::Wide(all) => all.push(id),
        }
    }

    /// Appends another list of the same kind.
    pub fn append(&mut self, other: &Self) {
        match (self, other) {
            (Self::Narrow(all), Self::Narrow(more)) => all.extend_from_slice(more),
            (all, more) => (0..more.len()).for_each(|i| all.push(more.get(i))),
        }
    }

    /// One number.
    ///
    /// # Panics
    /// If `place` is past the end.
    #[inline(always)]
    pub fn get(&self, place: usize) -> u64 {
        match self {
            Self::Narrow(all) => u64::from(all[place]),
            Self::Wide(all) => all[place],
        }
    }

    /// The values at some of the numbers.
    ///
    /// # Panics
    /// If a place or a number is past the end.
    pub fn pick<T: Copy>(&self, places: std::ops::Range<usize>, all: &[T]) -> Vec<T> {
        match self {
            Self::Narrow(ids) => pick(&ids[places], all),
            Self::Wide(ids) => pick(&ids[places], all),
        }
    }

    /// Length of the list.
    pub fn len(&self) -> usize {
        match self {
            Self::Narrow(all) => all.len(),
            Self::Wide(all) => all.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Bytes in memory.
    pub fn num_bytes(&self) -> usize {
        match self {
            Self::Narrow(all) => size_of_val(all.as_slice()),
            Self::Wide(all) => size_of_val(all.as_slice()),
        }
    }
}

fn pick<I: Id, T: Copy>(ids: &[I], all: &[T]) -> Vec<T> {
    let one = |(i, id): (usize, &I)| {
        if let Some(soon) = ids.get(i + AHEAD) {
            vacua_simd::prefetch(all, soon.to_u64() as usize);
        }
        all[id.to_u64() as usize]
    };
    ids.iter().enumerate().map(one).collect()
}

/// So many values ahead memory is asked for.
const AHEAD: usize = 32;

/// The original numbers of vertices or cells in packed order.
pub(crate) enum Order<'a> {
    /// As they are.
    List(&'a Ids),
    /// As they are in a file.
    Blocks(delta::Blocks<'a>),
}

impl Order<'_> {
    /// How many there are.
    pub fn len(&self) -> usize {
        match self {
            Self::List(ids) => ids.len(),
            Self::Blocks(blocks) => blocks.len(),
        }
    }

    /// The largest of them; 0 without any.
    pub fn largest(&self) -> u64 {
        match self {
            Self::List(ids) => (0..ids.len()).map(|i| ids.get(i)).max().unwrap_or(0),
            Self::Blocks(blocks) => blocks.largest(),
        }
    }

    /// The values at the numbers from a place on, as many as `picked` has room for.
    ///
    /// # Errors
    /// A number that no value has.
    pub fn pick<T: Copy>(&self, first: usize, all: &[T], picked: &mut [T]) -> Result<(), u64> {
        match self {
            Self::List(Ids::Narrow(ids)) => pick_some(&ids[first..], all, picked),
            Self::List(Ids::Wide(ids)) => pick_some(&ids[first..], all, picked),
            Self::Blocks(blocks) => blocks.pick(first, all, picked),
        }
    }
}

fn pick_some<I: Id, T: Copy>(ids: &[I], all: &[T], picked: &mut [T]) -> Result<(), u64> {
    for (i, (picked, id)) in picked.iter_mut().zip(ids).enumerate() {
        if let Some(soon) = ids.get(i + AHEAD) {
            vacua_simd::prefetch(all, soon.to_u64() as usize);
        }
        let id = id.to_u64();
        *picked = *all.get(id as usize).ok_or(id)?;
    }
    Ok(())
}

/// Numbers points in the order in which they are first seen: an open hash table whose slots hold the
/// lower half of a point and its number.
#[derive(Default)]
pub struct Numbering {
    slots: Vec<u64>,
    points: Vec<u64>,
    shift: u32,
    /// Whether some point has more than 32 bits.
    is_wide: bool,
}

const FREE: u64 = u64::MAX;

impl Numbering {
    /// Forgets all numbers; `most` points are expected at most.
    pub fn clear(&mut self, most: usize) {
        let log2 = (most.max(8) * 2).next_power_of_two().ilog2();
        self.is_wide = false;
        self.points.clear();
        self.slots.clear();
        self.slots.resize(1 << log2, FREE);
        self.shift = 64 - log2;
    }

    /// The number of a point, a new one if it has none yet; below 2^32 − 1.
    #[inline(always)]
    pub fn number(&mut self, point: u64) -> u32 {
        let mask = self.slots.len() - 1;
        let mut slot = self.home(point);
        self.is_wide |= point >> 32 != 0;
        loop {
            let found = self.slots[slot];
            if found == FREE {
                break;
            }
            if found >> 32 == point & 0xFFFF_FFFF {
                let number = found as u32;
                if !self.is_wide || self.points[number as usize] == point {
                    return number;
                }
            }
            slot = (slot + 1) & mask;
        }
        let number = self.points.len() as u32;
        self.slots[slot] = point << 32 | u64::from(number);
        self.points.push(point);
        if self.points.len() * 2 > self.slots.len() {
            self.grow();
        }
        number
    }

    /// Asks for the number of a point that will be wanted soon.
    #[inline(always)]
    pub fn prefetch(&self, point: u64) {
        vacua_simd::prefetch(&self.slots, self.home(point));
    }

    #[inline(always)]
    fn home(&self, point: u64) -> usize {
        (point.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> self.shift) as usize
    }

    #[cold]
    fn grow(&mut self) {
        let (points, is_wide) = (std::mem::take(&mut self.points), self.is_wide);
        self.clear(2 * points.len());
        self.is_wide = is_wide;
        let mask = self.slots.len() - 1;
        for (number, &point) in (0u64..).zip(&points) {
            let mut slot = self.home(point);
            while self.slots[slot] != FREE {
                slot = (slot + 1) & mask;
            }
            self.slots[slot] = point << 32 | number;
        }
        self.points = points;
    }

    /// Points by their number.
    pub fn points(&self) -> &[u64] {
        &self.points
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_follow_first_sight() {
        let mut numbering = Numbering::default();
        numbering.clear(10);
        let key = |i: u64| i.wrapping_mul(0xD134_2543_DE82_EF95) >> 3;
        for round in 0..2 {
            for i in 0..100_000u64 {
                assert_eq!(numbering.number(key(i)), i as u32, "round {round}");
            }
        }
        assert_eq!(numbering.points().len(), 100_000);
    }

    #[test]
    fn lists_keep_numbers_past_32_bits() {
        let mut wide = Ids::below(1 << 33, 2);
        wide.push(1 << 32);
        let mut narrow = Ids::below(1 << 32, 2);
        narrow.push(7);
        wide.append(&narrow);
        assert_eq!((wide.get(0), wide.get(1), wide.len()), (1 << 32, 7, 2));
        assert_eq!(narrow.num_bytes(), 4);
    }
}
