//! Rays as sequences of samples, blocks of them, and the trait that every skipping method keeps.

use vacua_simd::BLOCK;

use crate::lattice::Lattice;

/// Blocks in a window: one a bit.
pub const BLOCKS_PER_WINDOW: u32 = 64;

/// Most samples a ray may have: their numbers are exact in `f32`.
pub const MAX_SAMPLES: u32 = 1 << 23;

/// A ray in ray space as the renderer samples it: sample `k` is at `fma(k, step, start)` on each
/// axis, and lies in the volume if `begin <= k < end`.
#[derive(Clone, Copy, Debug)]
pub struct SampleRay {
    /// Position of sample 0.
    pub start: [f32; 3],
    /// From one sample to the next.
    pub step: [f32; 3],
    /// First sample in the volume.
    pub begin: u32,
    /// One past the last sample in the volume.
    pub end: u32,
}

impl SampleRay {
    /// A ray without samples.
    pub const NONE: Self = Self {
        start: [0.0; 3],
        step: [0.0; 3],
        begin: 0,
        end: 0,
    };

    /// A ray cut to the samples that lie in the lattice, its planes included.
    pub fn within(lattice: &Lattice, start: [f32; 3], step: [f32; 3]) -> Self {
        let (begin, end) =
            SampleRanges::new(lattice).of(&start.map(|s| [s; 1]), &step.map(|s| [s; 1]));
        Self {
            start,
            step,
            begin: begin[0],
            end: end[0],
        }
    }

    /// Coordinate of a sample along one axis: the definition of where it is.
    #[inline(always)]
    pub fn at(&self, axis: usize, k: u32) -> f32 {
        (k as f32).mul_add(self.step[axis], self.start[axis])
    }

    /// Whether no sample lies in the volume.
    pub fn is_empty(&self) -> bool {
        self.begin >= self.end
    }

    /// First block with a sample in the volume.
    pub fn first_block(&self) -> u32 {
        self.begin / BLOCK as u32
    }

    /// One past the last block with a sample in the volume.
    pub fn end_block(&self) -> u32 {
        self.end.div_ceil(BLOCK as u32)
    }

    /// The bits of a window's blocks that hold samples of the ray.
    #[inline]
    pub fn window_bits(&self, first_block: u32) -> u64 {
        if self.is_empty() {
            return 0;
        }
        bits_between(first_block, self.first_block(), self.end_block())
    }
}

/// A window's bits for blocks `from..to`, clamped to the window.
#[inline]
pub(crate) fn bits_between(first_block: u32, from: u32, to: u32) -> u64 {
    let lo = from.saturating_sub(first_block).min(BLOCKS_PER_WINDOW);
    let hi = to.saturating_sub(first_block).min(BLOCKS_PER_WINDOW);
    if hi <= lo {
        return 0;
    }
    (u64::MAX >> (64 - (hi - lo))) << lo
}

/// Finds which samples of rays lie in a lattice, its planes included.
#[derive(Clone, Copy, Debug)]
pub struct SampleRanges {
    lo: [f32; 3],
    hi: [f32; 3],
    /// A computed coordinate reaches a plane when the exact one passes half-way from the number
    /// before it: these are those half-way points, before `lo` and after `hi`.
    before_lo: [f64; 3],
    after_hi: [f64; 3],
}

impl SampleRanges {
    /// For rays through a lattice.
    pub fn new(lattice: &Lattice) -> Self {
        let plane = |a: usize, last: bool| {
            let axis = &lattice.axes()[a];
            axis.plane(if last { axis.cells() } else { 0 })
        };
        let lo = [0, 1, 2].map(|a| plane(a, false));
        let hi = [0, 1, 2].map(|a| plane(a, true));
        let middle = |a: f32, b: f32| 0.5 * (f64::from(a) + f64::from(b));
        Self {
            lo,
            hi,
            before_lo: lo.map(|x| middle(x, x.next_down())),
            after_hi: hi.map(|x| middle(x, x.next_up())),
        }
    }

    /// The lattice's box.
    pub fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        (self.lo, self.hi)
    }

    /// Of each ray, from `start` in steps of `step` (arrays an axis, a number a ray), the first
    /// sample in the lattice and the one after the last; the same twice if there are none.
    #[inline(always)]
    pub fn of<const N: usize>(
        &self,
        start: &[[f32; N]; 3],
        step: &[[f32; N]; 3],
    ) -> ([u32; N], [u32; N]) {
        const LIMIT: f64 = MAX_SAMPLES as f64;
        let (mut begin, mut end) = ([0.0f64; N], [LIMIT; N]);
        let mut settled = [true; N];
        for axis in 0..3 {
            let (lo, hi) = (self.lo[axis], self.hi[axis]);
            let (before_lo, after_hi) = (self.before_lo[axis], self.after_hi[axis]);
            // One loop without branches, so that it becomes vector code.
            for i in 0..N {
                let (s, d) = (start[axis][i], step[axis][i]);
                let up = d > 0.0;
                let inverse = 1.0 / f64::from(d);
                let (first, last) = if up {
                    (before_lo, after_hi)
                } else {
                    (after_hi, before_lo)
                };
                let enter = ((first - f64::from(s)) * inverse).ceil();
                let leave = ((last - f64::from(s)) * inverse).floor() + 1.0;
                let clamp = |k: f64| {
                    let k = if k > 0.0 { k } else { 0.0 };
                    if k < LIMIT { k } else { LIMIT }
                };
                // Estimates; the computed coordinates settle the last step.
                let (k, l) = (clamp(enter), clamp(leave));
                let (sign, near, far) = if up { (1.0, lo, hi) } else { (-1.0, -hi, -lo) };
                let at = |k: f64| (k as f32).mul_add(d, s) * sign;
                let before = |k: f64| at(k) < near;
                let after = |k: f64| at(k) > far;
                let sooner = (k > 0.0) & !before(k - 1.0);
                let k = if sooner { k - 1.0 } else { k };
                let later = (k < LIMIT) & before(k) & !sooner;
                let k = if later { k + 1.0 } else { k };
                let sooner = (l > 0.0) & after(l - 1.0);
                let l = if sooner { l - 1.0 } else { l };
                let later = (l < LIMIT) & !after(l) & !sooner;
                let l = if later { l + 1.0 } else { l };
                let sure = ((k <= 0.0) | before(k - 1.0))
                    & ((k >= LIMIT) | !before(k))
                    & ((l <= 0.0) | !after(l - 1.0))
                    & ((l >= LIMIT) | after(l));
                let still = d == 0.0;
                let inside = (lo <= s) & (s <= hi);
                let k = if still { 0.0 } else { k };
                let l = if still {
                    if inside { LIMIT } else { 0.0 }
                } else {
                    l
                };
                settled[i] &= sure | still;
                begin[i] = if k > begin[i] { k } else { begin[i] };
                end[i] = if l < end[i] { l } else { end[i] };
            }
        }
        for i in (0..N).filter(|&i| !settled[i]) {
            (begin[i], end[i]) = (0.0, LIMIT);
            for axis in 0..3 {
                let planes = (self.lo[axis], self.hi[axis]);
                let (k, l) = samples_between(start[axis][i], step[axis][i], planes);
                (begin[i], end[i]) = (begin[i].max(f64::from(k)), end[i].min(f64::from(l)));
            }
        }
        let mut ranges = ([0; N], [0; N]);
        for i in 0..N {
            ranges.0[i] = begin[i] as u32;
            ranges.1[i] = if end[i] > begin[i] { end[i] } else { begin[i] } as u32;
        }
        ranges
    }
}

/// The samples `k` with `lo <= fma(k, step, start) <= hi`, as a half-open range: by bisection, for
/// steps that are lost in the rounding of coordinates.
#[cold]
fn samples_between(start: f32, step: f32, (lo, hi): (f32, f32)) -> (u32, u32) {
    let at = |k: u32| (k as f32).mul_add(step, start);
    let first = |reached: &dyn Fn(f32) -> bool| {
        let (mut from, mut to) = (0, MAX_SAMPLES);
        while from < to {
            let middle = from + (to - from) / 2;
            if reached(at(middle)) {
                to = middle;
            } else {
                from = middle + 1;
            }
        }
        from
    };
    if step > 0.0 {
        (first(&|x| x >= lo), first(&|x| x > hi))
    } else {
        (first(&|x| x <= hi), first(&|x| x < lo))
    }
}

/// A method of skipping empty space.
///
/// Rays are asked about in bundles, those of neighbouring pixels, a *window* of
/// [`BLOCKS_PER_WINDOW`] blocks at a time: what is empty for all of them costs little.
pub trait Skipper: Send + Sync {
    /// The word that `--skip` takes.
    fn name(&self) -> &'static str;

    /// Which blocks of the window that begins with `first_block` must be evaluated, for each ray a
    /// bit a block. Every block with a sample of the ray's `begin..end` in an active macrocell is
    /// set, whatever else is; blocks without any sample of it are not.
    ///
    /// # Panics
    /// If `first_block` is no multiple of [`BLOCKS_PER_WINDOW`], or there are fewer `blocks` than
    /// `rays`.
    fn window(&self, rays: &[SampleRay], first_block: u32, blocks: &mut [u64]);

    /// Bytes of the structure.
    fn size_bytes(&self) -> usize;
}

/// Evaluates everything: the reference that all methods must match to the bit.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoSkip;

impl Skipper for NoSkip {
    fn name(&self) -> &'static str {
        "none"
    }

    fn window(&self, rays: &[SampleRay], first_block: u32, blocks: &mut [u64]) {
        for (ray, blocks) in rays.iter().zip(blocks) {
            *blocks = ray.window_bits(first_block);
        }
    }

    fn size_bytes(&self) -> usize {
        0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_range_holds_exactly_the_samples_inside(
            start in prop_oneof![Just(0.0f32), Just(7.0), -20.0f32..40.0],
            step in prop_oneof![Just(0.0f32), Just(0.5), Just(-0.5), Just(1e-9), Just(-1e-9), -3.0f32..3.0],
            hi in 1usize..30,
        ) {
            let axes = [hi, 1, 1].map(|cells| crate::Axis::Unit { cells });
            let lattice = Lattice::new(axes, 1).expect("cells on each axis");
            let SampleRay { begin, end, .. } =
                SampleRay::within(&lattice, [start, 0.5, 0.5], [step, 0.0, 0.0]);
            prop_assert!(begin <= end);
            for k in (0..400).chain([begin.wrapping_sub(1), begin, end.wrapping_sub(1), end]) {
                if k < MAX_SAMPLES {
                    let x = (k as f32).mul_add(step, start);
                    let inside = (0.0..=hi as f32).contains(&x);
                    prop_assert_eq!(inside, begin <= k && k < end, "k {} x {}", k, x);
                }
            }
            if step != 0.0 {
                let (k, l) = samples_between(start, step, (0.0, hi as f32));
                prop_assert_eq!((begin, end), (k, l.max(k)));
            }
        }
    }

    #[test]
    fn window_bits_clamp() {
        assert_eq!(bits_between(64, 0, 66), 3);
        assert_eq!(bits_between(0, 62, 900), 3 << 62);
        assert_eq!(bits_between(0, 0, 64), u64::MAX);
        assert_eq!(bits_between(64, 0, 64), 0);
    }
}
