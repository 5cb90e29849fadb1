//! `grid`: asks the active mask directly, sixteen blocks of a ray at a time.
//!
//! First for a whole bundle: where its rays are during a block lies in a box of macrocells, and a
//! mask that is dilated upwards answers for two macrocells a side at once ([`Near`]), coarser ones
//! for wider boxes. What is empty there is empty for every ray.
//!
//! Of the blocks that remain only the first and the last sample are located, ray by ray. If their
//! macrocells are the same, or neighbours across one plane, all samples of the block lie in those
//! two, and two bits answer. A block that crosses several planes at once is checked against the
//! dilated mask; for what is still open, each sample is located.

use vacua_simd::{BLOCK, Float, IN_BLOCK, Int, Kernel, LANES, Mask, Simd, dispatch, per_axis};

use crate::bundle::Bundle;
use crate::lattice::Lattice;
use crate::mask::ActiveMask;
use crate::near::Near;
use crate::ray::{BLOCKS_PER_WINDOW, SampleRay, Skipper, bits_between};

/// A walk over the active mask.
#[derive(Clone, Debug)]
pub struct GridSkip {
    lattice: Lattice,
    active: ActiveMask,
    near: Near,
}

impl GridSkip {
    /// Prepares the masks.
    ///
    /// Cost: a few passes over the bits.
    ///
    /// # Panics
    /// If the mask belongs to another lattice.
    pub fn new(lattice: Lattice, active: ActiveMask) -> Self {
        assert_eq!(
            lattice.counts(),
            active.counts(),
            "mask and lattice belong together"
        );
        let near = Near::new(&active);
        Self {
            lattice,
            active,
            near,
        }
    }

    /// The mask this walks.
    pub fn active(&self) -> &ActiveMask {
        &self.active
    }
}

impl Skipper for GridSkip {
    fn name(&self) -> &'static str {
        "grid"
    }

    fn window(&self, rays: &[SampleRay], first_block: u32, blocks: &mut [u64]) {
        dispatch(Walk {
            grid: self,
            rays,
            first_block,
            blocks,
        });
    }

    fn size_bytes(&self) -> usize {
        self.active.size_bytes() + self.near.size_bytes()
    }
}

/// One window of a bundle of rays.
struct Walk<'a> {
    grid: &'a GridSkip,
    rays: &'a [SampleRay],
    first_block: u32,
    blocks: &'a mut [u64],
}

/// First samples of sixteen blocks, from block 0 on.
const FIRST_SAMPLES: [f32; LANES] = {
    let mut first = [0.0; LANES];
    let mut i = 0;
    while i < LANES {
        first[i] = (i * BLOCK) as f32;
        i += 1;
    }
    first
};

impl Walk<'_> {
    /// Of sixteen blocks, those near which anything is active.
    #[inline(always)]
    fn near_bundle<S: Simd>(&self, bundle: &Bundle, first_block: u32) -> u16 {
        let head =
            S::F::from_array(FIRST_SAMPLES) + S::F::splat((first_block * BLOCK as u32) as f32);
        let tail = head + S::F::splat((BLOCK - 1) as f32);
        let lo = per_axis!(a => {
            let (start, step) = (S::F::splat(bundle.start[a][0]), S::F::splat(bundle.step[a][0]));
            let at = head.mul_add(step, start).min(tail.mul_add(step, start));
            self.grid.lattice.macrocell::<S>(a, at)
        });
        let hi = per_axis!(a => {
            let (start, step) = (S::F::splat(bundle.start[a][1]), S::F::splat(bundle.step[a][1]));
            let at = head.mul_add(step, start).max(tail.mul_add(step, start));
            self.grid.lattice.macrocell::<S>(a, at)
        });
        self.grid.near.any_in_boxes::<S>(lo, hi)
    }

    /// The blocks among `candidates` of a window with a sample of the ray in an active macrocell.
    #[inline(always)]
    fn refine<S: Simd>(&self, ray: &SampleRay, candidates: u64) -> u64 {
        let mut blocks = 0;
        let mut group = 0;
        while group < BLOCKS_PER_WINDOW {
            let wanted = (candidates >> group) as u16;
            if wanted != 0 {
                let found = self.group::<S>(ray, self.first_block + group, wanted);
                blocks |= u64::from(found) << group;
            }
            group += LANES as u32;
        }
        blocks
    }

    /// As [`Walk::refine`] for sixteen blocks.
    #[inline(always)]
    fn group<S: Simd>(&self, ray: &SampleRay, first_block: u32, wanted: u16) -> u16 {
        let (begin, last) = (ray.begin as f32, (ray.end - 1) as f32);
        let first =
            S::F::from_array(FIRST_SAMPLES) + S::F::splat((first_block * BLOCK as u32) as f32);
        let (begin, last) = (S::F::splat(begin), S::F::splat(last));
        let final_sample = first + S::F::splat((BLOCK - 1) as f32);
        let head = self.macrocells::<S>(ray, first.max(begin).min(last));
        let tail = self.macrocells::<S>(ray, final_sample.max(begin).min(last));
        let active = &self.grid.active;
        let sure = active.bits_at::<S>(&head) | active.bits_at::<S>(&tail);
        let same = per_axis!(a => head[a].eq(tail[a]));
        let low = per_axis!(a => head[a].min(tail[a]));
        let near = per_axis!(a => (head[a].max(tail[a]) - low[a]).lt(S::I::splat(2)));
        let all_near = near[0] & near[1] & near[2];
        // Neighbours across one plane at most: there is nothing between them.
        let settled = (same[0] & (same[1] | same[2]) | same[1] & same[2]) & all_near;
        let open = !(sure | settled);
        let maybe = open & (!all_near | self.grid.near.finest().bits_at::<S>(&low));
        let mut doubtful = maybe.to_bits() & wanted;
        let mut found = sure.to_bits() & wanted;
        while doubtful != 0 {
            let a = doubtful.trailing_zeros();
            doubtful &= doubtful - 1;
            let b = if doubtful != 0 {
                doubtful.trailing_zeros()
            } else {
                a
            };
            doubtful &= doubtful.wrapping_sub(1);
            let first = |lane: u32| ((first_block + lane) * BLOCK as u32) as f32;
            let k = S::F::from_array(IN_BLOCK) + S::F::of_blocks(first(a), first(b));
            let at = self.macrocells::<S>(ray, k.max(begin).min(last));
            let hits = active.bits_at::<S>(&at).to_bits();
            found |= u16::from(hits & 0xff != 0) << a | u16::from(hits >> BLOCK != 0) << b;
        }
        found
    }

    /// Macrocells of sixteen samples.
    #[inline(always)]
    fn macrocells<S: Simd>(&self, ray: &SampleRay, k: S::F) -> [S::I; 3] {
        per_axis!(a => {
            let at = k.mul_add(S::F::splat(ray.step[a]), S::F::splat(ray.start[a]));
            self.grid.lattice.macrocell::<S>(a, at)
        })
    }
}

impl Kernel for Walk<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        let mut near = 0u64;
        if let Some(bundle) = Bundle::of(self.rays) {
            let [from, to] = bundle.blocks;
            let within = bits_between(self.first_block, from, to);
            let mut group = 0;
            while group < BLOCKS_PER_WINDOW {
                if within >> group & 0xffff != 0 {
                    let bits = self.near_bundle::<S>(&bundle, self.first_block + group);
                    near |= u64::from(bits) << group;
                }
                group += LANES as u32;
            }
        }
        for i in 0..self.rays.len() {
            let ray = &self.rays[i];
            let candidates = near & ray.window_bits(self.first_block);
            self.blocks[i] = if candidates == 0 {
                0
            } else {
                self.refine::<S>(ray, candidates)
            };
        }
    }
}
