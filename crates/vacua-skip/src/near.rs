//! Whether anything is active within a box of macrocells, for sixteen boxes at once: masks dilated
//! upwards, on a few levels.
//!
//! On level `l` macrocells are grouped `2^l` a side. A bit of its mask is set if any of the 2 × 2 × 2
//! groups from there upwards holds an active macrocell, so that a box at most two groups wide takes
//! one look, and one at most four wide eight.

use vacua_simd::{Int, Mask, Simd, per_axis};

use crate::mask::ActiveMask;

/// Dilated masks, finest first.
#[derive(Clone, Debug)]
pub(crate) struct Near {
    levels: Vec<ActiveMask>,
}

impl Near {
    /// Dilates a mask, and coarser ones until two groups span the lattice.
    pub fn new(active: &ActiveMask) -> Self {
        let mut levels = vec![dilated(active)];
        while let Some(finer) = levels.last() {
            if finer.counts().iter().all(|&n| n <= 2) {
                break;
            }
            levels.push(dilated(&halved(finer)));
        }
        Self { levels }
    }

    /// The mask that tells of 2 × 2 × 2 macrocells upwards.
    pub fn finest(&self) -> &ActiveMask {
        &self.levels[0]
    }

    /// Bytes of all masks.
    pub fn size_bytes(&self) -> usize {
        self.levels.iter().map(ActiveMask::size_bytes).sum()
    }

    /// Of sixteen boxes of macrocells, both ends included, those in which something is active; also
    /// some with something active around them.
    #[inline(always)]
    pub fn any_in_boxes<S: Simd>(&self, lo: [S::I; 3], hi: [S::I; 3]) -> u16 {
        let mut level = 0;
        let shifted = |at: [S::I; 3], level: usize| {
            let by = S::I::splat(level as i32);
            [at[0].shr(by), at[1].shr(by), at[2].shr(by)]
        };
        loop {
            let (low, high) = (shifted(lo, level), shifted(hi, level));
            let wider = |limit: i32| {
                let limit = S::I::splat(limit);
                let wide = per_axis!(a => limit.lt(high[a] - low[a]));
                (wide[0] | wide[1] | wide[2]).any()
            };
            let Some(mask) = self.levels.get(level) else {
                return u16::MAX;
            };
            if !wider(1) {
                return mask.bits_at::<S>(&low).to_bits();
            }
            if !wider(3) {
                let up = per_axis!(a => low[a].max(high[a] - S::I::splat(1)));
                let mut bits = 0;
                for z in [low[2], up[2]] {
                    for y in [low[1], up[1]] {
                        for x in [low[0], up[0]] {
                            bits |= mask.bits_at::<S>(&[x, y, z]).to_bits();
                        }
                    }
                }
                return bits;
            }
            level += 1;
        }
    }
}

/// `m[x ..= x + 1, y ..= y + 1, z ..= z + 1]`, any.
fn dilated(mask: &ActiveMask) -> ActiveMask {
    let [_, cy, cz] = mask.counts();
    let row = mask.row_words();
    let slice = row * cy;
    let mut out = mask.clone();
    let from = mask.words();
    for (z, out) in out.words_mut().chunks_mut(slice).enumerate() {
        let here = &from[z * slice..][..slice];
        if z + 1 < cz {
            let above = &from[(z + 1) * slice..][..slice];
            for (word, up) in out.iter_mut().zip(above) {
                *word |= up;
            }
            for (word, up) in out.iter_mut().zip(&above[row..]) {
                *word |= up;
            }
        }
        for (word, next) in out.iter_mut().zip(&here[row..]) {
            *word |= next;
        }
        for words in out.chunks_mut(row) {
            let mut next = 0;
            for word in words.iter_mut().rev() {
                let here = *word;
                *word |= here >> 1 | next << 31;
                next = here;
            }
        }
    }
    out
}

/// The mask of groups of 2 × 2 × 2 macrocells, from the dilated mask of the macrocells.
fn halved(dilated: &ActiveMask) -> ActiveMask {
    let mut out = ActiveMask::inactive(dilated.counts().map(|n| n.div_ceil(2)));
    let [_, cy, _] = dilated.counts();
    let (row, out_row) = (dilated.row_words(), out.row_words());
    let [_, out_cy, _] = out.counts();
    let from = dilated.words();
    for (i, words) in out.words_mut().chunks_mut(out_row).enumerate() {
        let (y, z) = (2 * (i % out_cy), 2 * (i / out_cy));
        let wide = &from[(z * cy + y) * row..][..row];
        for (word, pair) in words.iter_mut().zip(wide.chunks(2)) {
            let high = pair.get(1).map_or(0, |&w| even_bits(w));
            *word = even_bits(pair[0]) | high << 16;
        }
    }
    out
}

/// The even bits of a word, moved together.
fn even_bits(word: u32) -> u32 {
    let mut w = word & 0x5555_5555;
    w = (w | w >> 1) & 0x3333_3333;
    w = (w | w >> 2) & 0x0f0f_0f0f;
    w = (w | w >> 4) & 0x00ff_00ff;
    (w | w >> 8) & 0x0000_ffff
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use vacua_simd::{Kernel, LANES, Level, dispatch_at};

    struct Look<'a>(&'a Near, [usize; 3], [usize; 3]);
    impl Kernel for Look<'_> {
        type Output = u16;
        #[inline(always)]
        fn run<S: Simd>(self) -> u16 {
            let splat = |at: [usize; 3]| at.map(|c| S::I::from_array([c as i32; LANES]));
            self.0.any_in_boxes::<S>(splat(self.1), splat(self.2))
        }
    }

    proptest! {
        #[test]
        fn nothing_active_in_a_box_is_missed(
            counts in prop::array::uniform3(1usize..70),
            active in prop::collection::vec(prop::array::uniform3(any::<prop::sample::Index>()), 0..6),
            corners in prop::array::uniform2(prop::array::uniform3(any::<prop::sample::Index>())),
        ) {
            let mut mask = ActiveMask::inactive(counts);
            let at = |i: &[prop::sample::Index; 3]| [0, 1, 2].map(|a| i[a].index(counts[a]));
            for i in &active {
                mask.set(at(i), true);
            }
            let near = Near::new(&mask);
            let [p, q] = corners.each_ref().map(at);
            let lo = [0, 1, 2].map(|a| p[a].min(q[a]));
            let hi = [0, 1, 2].map(|a| p[a].max(q[a]));
            let inside = |c: &[usize; 3], by: usize| {
                (0..3).all(|a| lo[a] <= c[a] + by && c[a] <= hi[a] + by)
            };
            let found = active.iter().any(|i| inside(&at(i), 0));
            // Groups are at most as wide as the box.
            let width = (0..3).map(|a| hi[a] - lo[a] + 1).max().unwrap_or(1);
            let around = active.iter().any(|i| inside(&at(i), 2 * width));
            for level in Level::available() {
                let bits = dispatch_at(level, Look(&near, lo, hi));
                prop_assert!(bits == 0 || bits == u16::MAX);
                prop_assert!(!found || bits != 0, "{lo:?} {hi:?}");
                prop_assert!(around || bits == 0, "{lo:?} {hi:?}");
            }
        }
    }
}
