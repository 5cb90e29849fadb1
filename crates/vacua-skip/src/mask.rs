//! Which macrocells are active: one bit each, recomputed at every edit of the transfer function
//! (paper A §4.2.1).
//!
//! Rows of bits are padded to whole words, so that neighbours along y and z are whole words apart.

use rayon::prelude::*;
use vacua_simd::{Float, Int, Kernel, LANES, Mask, Simd, dispatch};
use vacua_volume::{TRANSFER_BINS, TransferTable, ValueScale};

use crate::macrocells::Macrocells;

/// Below this many macrocells, threads cost more than they save.
const PARALLEL_CELLS: usize = 1 << 15;

/// What makes a macrocell active.
#[derive(Clone, Copy, Debug)]
pub enum Activity<'a> {
    /// Any value in its range has extinction: compositing.
    Extinction(&'a TransferTable),
    /// Its range reaches above a rendered value: maximum intensity.
    Above(f32),
}

/// One bit a macrocell: set where something may be seen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ActiveMask {
    counts: [usize; 3],
    row_words: usize,
    words: Vec<u32>,
}

impl ActiveMask {
    /// Classifies every macrocell, in constant time each.
    pub fn new(macrocells: &Macrocells, activity: Activity<'_>) -> Self {
        let mut mask = Self::inactive(macrocells.lattice().counts());
        let [cx, cy, _] = mask.counts;
        let row_words = mask.row_words;
        let classify = |(row, words): (usize, &mut [u32])| {
            let from = row * cx;
            dispatch(ClassifyRow {
                lo: &macrocells.lo()[from..],
                hi: &macrocells.hi()[from..],
                len: cx,
                activity,
                words,
            });
        };
        if macrocells.lattice().len() < PARALLEL_CELLS {
            mask.words
                .chunks_mut(row_words)
                .enumerate()
                .for_each(classify);
        } else {
            mask.words
                .par_chunks_mut(row_words)
                .with_min_len(cy)
                .enumerate()
                .for_each(classify);
        }
        mask
    }

    /// A mask without any active macrocell.
    pub fn inactive(counts: [usize; 3]) -> Self {
        let row_words = counts[0].div_ceil(32);
        Self {
            counts,
            row_words,
            words: vec![0; row_words * counts[1] * counts[2]],
        }
    }

    /// Sets or clears one macrocell, for masks that do not come from a transfer function.
    ///
    /// # Panics
    /// If the macrocell is out of range.
    pub fn set(&mut self, at: [usize; 3], active: bool) {
        let (word, bit) = self.place(at);
        self.words[word] = self.words[word] & !(1 << bit) | u32::from(active) << bit;
    }

    /// Whether a macrocell is active.
    ///
    /// # Panics
    /// If the macrocell is out of range.
    pub fn get(&self, at: [usize; 3]) -> bool {
        let (word, bit) = self.place(at);
        self.words[word] >> bit & 1 == 1
    }

    fn place(&self, at: [usize; 3]) -> (usize, usize) {
        assert!(
            (0..3).all(|a| at[a] < self.counts[a]),
            "macrocell {at:?} of {:?}",
            self.counts
        );
        (
            at[0] / 32 + self.row_words * (at[1] + self.counts[1] * at[2]),
            at[0] % 32,
        )
    }

    /// Macrocells along each axis.
    pub fn counts(&self) -> [usize; 3] {
        self.counts
    }

    /// Words a row of macrocells along x.
    pub fn row_words(&self) -> usize {
        self.row_words
    }

    /// The bits, row after row.
    pub fn words(&self) -> &[u32] {
        &self.words
    }

    /// The bits, row after row, to be changed in place; bits past the end of a row stay clear.
    pub(crate) fn words_mut(&mut self) -> &mut [u32] {
        &mut self.words
    }

    /// The bits of sixteen macrocells.
    #[inline(always)]
    pub(crate) fn bits_at<S: Simd>(&self, at: &[S::I; 3]) -> S::M {
        let row = at[2] * S::I::splat(self.counts[1] as i32) + at[1];
        let word = row * S::I::splat(self.row_words as i32) + at[0].shr(S::I::splat(5));
        let last = S::I::splat(self.words.len() as i32 - 1);
        // SAFETY: limited to the words.
        let word = unsafe { S::gather_u32(&self.words, word.min_unsigned(last)) };
        let bit = word.shr(at[0].and(S::I::splat(31))).and(S::I::splat(1));
        S::I::splat(0).lt(bit)
    }

    /// Number of active macrocells.
    pub fn num_active(&self) -> usize {
        self.words.iter().map(|w| w.count_ones() as usize).sum()
    }

    /// Bytes of the bits.
    pub fn size_bytes(&self) -> usize {
        size_of_val(self.words.as_slice())
    }
}

/// One row of macrocells along x, sixteen at a time.
struct ClassifyRow<'a> {
    lo: &'a [f32],
    hi: &'a [f32],
    len: usize,
    activity: Activity<'a>,
    words: &'a mut [u32],
}

impl ClassifyRow<'_> {
    /// Bit per macrocell of a chunk; `lo` and `hi` have at least [`LANES`] entries from there.
    #[inline(always)]
    fn chunk<S: Simd>(&self, from: usize) -> u16 {
        let (lo, hi) = (load::<S>(&self.lo[from..]), load::<S>(&self.hi[from..]));
        match self.activity {
            Activity::Above(threshold) => S::F::splat(threshold).lt(hi).to_bits(),
            Activity::Extinction(table) => {
                let next = {
                    let bin = bin::<S>(table, lo);
                    // SAFETY: bins are clamped to the table.
                    unsafe { S::gather_u32(table.next_active(), bin) }
                };
                let beyond = bin::<S>(table, hi) + S::I::splat(1);
                (next.lt(beyond) & lo.le(hi)).to_bits()
            }
        }
    }
}

/// The first [`LANES`] numbers of a slice.
#[inline(always)]
fn load<S: Simd>(numbers: &[f32]) -> S::F {
    let mut lanes = [0.0; LANES];
    lanes.copy_from_slice(&numbers[..LANES]);
    S::F::from_array(lanes)
}

/// Bins of values: the vector twin of [`TransferTable::bin`].
#[inline(always)]
fn bin<S: Simd>(table: &TransferTable, value: S::F) -> S::I {
    let lo = S::F::splat(table.lo());
    let key = match table.scale() {
        ValueScale::Linear => value - lo,
        ValueScale::Log => S::f_from_i(value.max(lo).to_bits() - lo.to_bits()),
    };
    let last = S::F::splat((TRANSFER_BINS - 1) as f32);
    (key * S::F::splat(table.bins_per_key()))
        .max(S::F::splat(0.0))
        .min(last)
        .to_i()
}

impl Kernel for ClassifyRow<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self) {
        for word in 0..self.words.len() {
            let mut bits = 0u32;
            for half in 0..2 {
                let from = 32 * word + LANES * half;
                if from < self.len {
                    let valid = (1u32 << (self.len - from).min(LANES)) - 1;
                    bits |= (u32::from(self.chunk::<S>(from)) & valid) << (LANES * half);
                }
            }
            self.words[word] = bits;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lattice::{Axis, Lattice};
    use proptest::prelude::*;
    use vacua_volume::{ColorPoint, OpacityPoint, TransferFunction, ValueMap, ValueRange};

    proptest! {
        #[test]
        fn classification_is_that_of_the_table(
            ranges in prop::collection::vec((-1.0f32..5.0, 0.0f32..2.0, 0u8..9), 1..200),
            width in 1usize..40,
            mut knots in prop::collection::vec((0.1f64..4.0, prop_oneof![Just(0.0), 0.0..1.0]), 1..6),
            log in any::<bool>(),
        ) {
            let width = width.min(ranges.len());
            let rows = ranges.len() / width;
            let axes = [width, rows, 1].map(|cells| Axis::Unit { cells });
            let lattice = Lattice::new(axes, 1).expect("cells on each axis");
            let boxes = ranges.iter().take(width * rows).enumerate().filter(|(_, r)| r.2 > 0).map(|(i, r)| {
                let p = [(i % width) as f32 + 0.5, (i / width) as f32 + 0.5, 0.5];
                ([p, p], [r.0, r.0 + r.1])
            });
            let cells = Macrocells::of_boxes(lattice, boxes);
            knots.sort_by(|a, b| a.0.total_cmp(&b.0));
            let table = TransferTable::new(
                &TransferFunction::new(
                    vec![ColorPoint { value: knots[0].0, srgb: [1.0; 3] }],
                    knots.iter().map(|k| OpacityPoint { value: k.0, opacity: k.1 }).collect(),
                    1.0,
                    if log { ValueScale::Log } else { ValueScale::Linear },
                ).expect("sorted knots"),
                ValueRange { lo: -1.0, hi: 7.0 },
                ValueMap::IDENTITY,
            );
            let mask = ActiveMask::new(&cells, Activity::Extinction(&table));
            let above = ActiveMask::new(&cells, Activity::Above(2.0));
            for i in 0..cells.lattice().len() {
                let at = [i % width, i / width, 0];
                let range = cells.range(i);
                prop_assert_eq!(mask.get(at), range.is_some_and(|r| table.is_active(r.0, r.1)));
                prop_assert_eq!(above.get(at), range.is_some_and(|r| r.1 > 2.0));
            }
            let active = (0..width * rows).filter(|i| mask.get([i % width, i / width, 0])).count();
            prop_assert_eq!(mask.num_active(), active);
        }
    }
}
