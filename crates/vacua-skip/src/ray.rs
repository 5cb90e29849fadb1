//! Rays as sequences of samples, blocks of them, and the trait that every skipping method keeps.

use vacua_simd::BLOCK;

use crate::lattice::Lattice;

/// Blocks in a [`Window`]: one a bit.
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
    /// A ray cut to the samples that lie in the lattice, its planes included.
    #[inline(always)]
    pub fn within(lattice: &Lattice, start: [f32; 3], step: [f32; 3]) -> Self {
        let mut ray = Self {
            start,
            step,
            begin: 0,
            end: MAX_SAMPLES,
        };
        for axis in 0..3 {
            let lo = lattice.axes()[axis].plane(0);
            let hi = lattice.axes()[axis].plane(lattice.axes()[axis].cells());
            let (begin, end) = samples_between(start[axis], step[axis], lo, hi);
            ray.begin = ray.begin.max(begin);
            ray.end = ray.end.min(end);
        }
        ray.end = ray.end.max(ray.begin);
        ray
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

    /// A window's bits for blocks `from..to` (clamped to the window).
    pub(crate) fn window_bits(first_block: u32, from: u32, to: u32) -> u64 {
        let lo = from.saturating_sub(first_block).min(BLOCKS_PER_WINDOW);
        let hi = to.saturating_sub(first_block).min(BLOCKS_PER_WINDOW);
        if hi <= lo {
            return 0;
        }
        let below = |n: u32| if n >= 64 { u64::MAX } else { (1u64 << n) - 1 };
        below(hi) & !below(lo)
    }
}

/// The samples `k` with `lo <= fma(k, step, start) <= hi`, as a half-open range.
#[inline(always)]
fn samples_between(start: f32, step: f32, lo: f32, hi: f32) -> (u32, u32) {
    let at = |k: f64| (k as f32).mul_add(step, start);
    if step == 0.0 {
        let inside = lo <= start && start <= hi;
        return if inside { (0, MAX_SAMPLES) } else { (0, 0) };
    }
    // A computed coordinate reaches a plane when the exact one passes half-way from the number
    // before it: estimate there, then settle the last step with the computed coordinates.
    let half_before = |x: f32| 0.5 * (f64::from(x) + f64::from(x.next_down()));
    let half_after = |x: f32| 0.5 * (f64::from(x) + f64::from(x.next_up()));
    let solve = |x: f64| (x - f64::from(start)) / f64::from(step);
    let limit = f64::from(MAX_SAMPLES);
    let (enter, leave) = if step > 0.0 {
        (solve(half_before(lo)), solve(half_after(hi)))
    } else {
        (solve(half_after(hi)), solve(half_before(lo)))
    };
    let before = |k: f64| if step > 0.0 { at(k) < lo } else { at(k) > hi };
    let after = |k: f64| if step > 0.0 { at(k) > hi } else { at(k) < lo };
    let mut begin = enter.ceil().clamp(0.0, limit);
    while begin > 0.0 && !before(begin - 1.0) {
        begin -= 1.0;
    }
    while begin < limit && before(begin) {
        begin += 1.0;
    }
    let mut end = leave.floor().clamp(-1.0, limit - 1.0) + 1.0;
    while end < limit && !after(end) {
        end += 1.0;
    }
    while end > 0.0 && after(end - 1.0) {
        end -= 1.0;
    }
    (begin as u32, end as u32)
}

/// 64 consecutive blocks of a ray, a bit each: set where the block may contain an active sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Number of the block of bit 0.
    pub first_block: u32,
    /// Which blocks must be evaluated.
    pub blocks: u64,
}

/// A method of skipping empty space.
pub trait Skipper: Send + Sync {
    /// The word that `--skip` takes.
    fn name(&self) -> &'static str;

    /// The next window with anything in it, from block `from` on; `None` if the rest of the ray is
    /// empty. A later call must start behind the window. Every block with a sample of
    /// `begin..end` in an active macrocell is set in the window that holds it, whatever else is.
    fn next_window(&self, ray: &SampleRay, from: u32) -> Option<Window>;

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

    fn next_window(&self, ray: &SampleRay, from: u32) -> Option<Window> {
        let from = from.max(ray.first_block());
        let first_block = from - from % BLOCKS_PER_WINDOW;
        let blocks = SampleRay::window_bits(first_block, from, ray.end_block());
        (!ray.is_empty() && blocks != 0).then_some(Window {
            first_block,
            blocks,
        })
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
            hi in 1u32..30,
        ) {
            let (begin, end) = samples_between(start, step, 0.0, hi as f32);
            for k in (0..400).chain([begin.wrapping_sub(1), begin, end.wrapping_sub(1), end]) {
                if k < MAX_SAMPLES {
                    let x = (k as f32).mul_add(step, start);
                    let inside = (0.0..=hi as f32).contains(&x);
                    prop_assert_eq!(inside, begin <= k && k < end, "k {} x {}", k, x);
                }
            }
        }
    }

    #[test]
    fn window_bits_clamp() {
        assert_eq!(SampleRay::window_bits(64, 0, 66), 3);
        assert_eq!(SampleRay::window_bits(0, 62, 900), 3 << 62);
        assert_eq!(SampleRay::window_bits(0, 0, 64), u64::MAX);
        assert_eq!(SampleRay::window_bits(64, 0, 64), 0);
    }
}
