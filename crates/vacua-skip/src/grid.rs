//! `grid`: asks the active mask directly, sixteen blocks of a ray at a time.
//!
//! Of each block only the first and the last sample are located. If their macrocells are the same,
//! or neighbours across one plane, all samples of the block lie in those two, and two bits answer.
//! A block that crosses several planes at once is first checked against a mask dilated in the
//! direction of the ray (one per octant of directions), which answers most with "nothing near";
//! for the rest, and for blocks longer than a macrocell, each sample is located.

use vacua_simd::{BLOCK, Float, Int, Kernel, LANES, Mask, Simd, dispatch, per_axis};

use crate::lattice::Lattice;
use crate::mask::ActiveMask;
use crate::ray::{BLOCKS_PER_WINDOW, SampleRay, Skipper, Window};

/// A walk over the active mask.
#[derive(Clone, Debug)]
pub struct GridSkip {
    lattice: Lattice,
    active: ActiveMask,
    /// For each octant of directions (bit a set: towards lower a) the mask that is active where
    /// any of the 2 × 2 × 2 macrocells in that direction is.
    towards: Vec<ActiveMask>,
}

impl GridSkip {
    /// Prepares the masks.
    ///
    /// Cost: 14 passes over the bits.
    ///
    /// # Panics
    /// If the mask belongs to another lattice.
    pub fn new(lattice: Lattice, active: ActiveMask) -> Self {
        assert_eq!(
            lattice.counts(),
            active.counts(),
            "mask and lattice belong together"
        );
        let along_x = [false, true].map(|down| dilate_x(&active, down));
        let along_xy = [0, 1, 2, 3].map(|o| dilate_rows(&along_x[o & 1], 1, o >> 1 == 1));
        let towards = (0..8)
            .map(|o| dilate_rows(&along_xy[o & 3], 2, o >> 2 == 1))
            .collect();
        Self {
            lattice,
            active,
            towards,
        }
    }

    /// The mask this walks.
    pub fn active(&self) -> &ActiveMask {
        &self.active
    }
}

/// `m[x] | m[x ± 1]`.
fn dilate_x(mask: &ActiveMask, down: bool) -> ActiveMask {
    let mut out = mask.clone();
    let row_words = mask.row_words();
    for (to, from) in out
        .words_mut()
        .chunks_mut(row_words)
        .zip(mask.words().chunks(row_words))
    {
        for word in 0..row_words {
            to[word] |= if down {
                let carry = if word > 0 { from[word - 1] >> 31 } else { 0 };
                from[word] << 1 | carry
            } else {
                let carry = if word + 1 < row_words {
                    from[word + 1] << 31
                } else {
                    0
                };
                from[word] >> 1 | carry
            };
        }
    }
    out
}

/// `m[a] | m[a ± 1]` along y (axis 1) or z (axis 2).
fn dilate_rows(mask: &ActiveMask, axis: usize, down: bool) -> ActiveMask {
    let mut out = mask.clone();
    let row_words = mask.row_words();
    let [_, cy, cz] = mask.counts();
    let (stride, period) = if axis == 1 {
        (row_words, cy)
    } else {
        (row_words * cy, cz)
    };
    let group = stride * period;
    for (to, from) in out
        .words_mut()
        .chunks_mut(group)
        .zip(mask.words().chunks(group))
    {
        let inner = group - stride;
        let (to, from) = if down {
            (&mut to[stride..], &from[..inner])
        } else {
            (&mut to[..inner], &from[stride..])
        };
        for (to, from) in to.iter_mut().zip(from) {
            *to |= from;
        }
    }
    out
}

impl Skipper for GridSkip {
    fn name(&self) -> &'static str {
        "grid"
    }

    fn next_window(&self, ray: &SampleRay, from: u32) -> Option<Window> {
        dispatch(Walk {
            grid: self,
            ray,
            from,
        })
    }

    fn size_bytes(&self) -> usize {
        self.active.size_bytes() * (1 + self.towards.len())
    }
}

struct Walk<'a> {
    grid: &'a GridSkip,
    ray: &'a SampleRay,
    from: u32,
}

impl Walk<'_> {
    /// Macrocells of sixteen samples.
    #[inline(always)]
    fn macrocells<S: Simd>(&self, k: S::F) -> [S::I; 3] {
        per_axis!(axis => {
            let step = S::F::splat(self.ray.step[axis]);
            let at = k.mul_add(step, S::F::splat(self.ray.start[axis]));
            self.grid.lattice.macrocell::<S>(axis, at)
        })
    }

    /// The bits of sixteen macrocells in a mask.
    #[inline(always)]
    fn bits<S: Simd>(mask: &ActiveMask, at: &[S::I; 3]) -> S::M {
        let [_, cy, _] = mask.counts();
        let row = at[2] * S::I::splat(cy as i32) + at[1];
        let word = row * S::I::splat(mask.row_words() as i32) + at[0].shr(S::I::splat(5));
        // SAFETY: macrocells are clamped to the lattice, whose counts are those of the mask.
        let word = unsafe { S::gather_u32(mask.words(), word) };
        let bit = word.shr(at[0].and(S::I::splat(31))).and(S::I::splat(1));
        S::I::splat(0).lt(bit)
    }

    /// Whether any sample of a block lies in an active macrocell.
    #[inline(always)]
    fn block_is_active<S: Simd>(&self, block: u32) -> bool {
        let first = (block * BLOCK as u32) as f32;
        let k: [f32; LANES] = std::array::from_fn(|i| first + (i % BLOCK) as f32);
        let at = self.macrocells::<S>(S::F::from_array(k));
        Self::bits::<S>(&self.grid.active, &at).any()
    }
}

impl Kernel for Walk<'_> {
    type Output = Option<Window>;

    #[inline(always)]
    fn run<S: Simd>(self) -> Option<Window> {
        if self.ray.is_empty() {
            return None;
        }
        let octant = (0..3).fold(0, |o, a| o | usize::from(self.ray.step[a] < 0.0) << a);
        let towards = &self.grid.towards[octant];
        let active = &self.grid.active;
        let end = self.ray.end_block();
        let mut from = self.from.max(self.ray.first_block());
        let iota: [f32; LANES] = std::array::from_fn(|i| (i * BLOCK) as f32);
        while from < end {
            let first_block = from - from % BLOCKS_PER_WINDOW;
            let mut blocks = 0u64;
            let mut group = from - from % LANES as u32;
            while group < end.min(first_block + BLOCKS_PER_WINDOW) {
                let k = S::F::from_array(iota) + S::F::splat((group * BLOCK as u32) as f32);
                let head = self.macrocells::<S>(k);
                let tail = self.macrocells::<S>(k + S::F::splat((BLOCK - 1) as f32));
                let sure = Self::bits::<S>(active, &head) | Self::bits::<S>(active, &tail);
                let same = per_axis!(a => head[a].eq(tail[a]));
                let near = per_axis!(a => {
                    let apart = tail[a] - head[a];
                    apart.lt(S::I::splat(2)) & S::I::splat(-2).lt(apart)
                });
                let settled = same[0] & (same[1] | same[2]) | same[1] & same[2];
                let all_near = near[0] & near[1] & near[2];
                let open = !(sure | settled & all_near);
                let maybe = open & (!all_near | Self::bits::<S>(towards, &head));
                let mut bits = sure.to_bits();
                let mut doubtful = maybe.to_bits();
                while doubtful != 0 {
                    let lane = doubtful.trailing_zeros();
                    doubtful &= doubtful - 1;
                    let block = group + lane;
                    if block >= from && block < end && self.block_is_active::<S>(block) {
                        bits |= 1 << lane;
                    }
                }
                blocks |= u64::from(bits) << (group - first_block);
                group += LANES as u32;
            }
            blocks &= SampleRay::window_bits(first_block, from, end);
            if blocks != 0 {
                return Some(Window {
                    first_block,
                    blocks,
                });
            }
            from = first_block + BLOCKS_PER_WINDOW;
        }
        None
    }
}
