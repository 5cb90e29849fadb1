//! What the rays of a tile have in common: where all of them are at once.

use crate::ray::SampleRay;

/// Bounds on the rays of a bundle: sample `k` of each lies between `fma(k, step[0], start[0])` and
/// `fma(k, step[1], start[1])` on each axis, as rounding is monotone.
#[derive(Clone, Copy, Debug)]
pub struct Bundle {
    /// Least and greatest position of sample 0 along each axis.
    pub start: [[f32; 2]; 3],
    /// The same of the way to the next sample.
    pub step: [[f32; 2]; 3],
    /// First block with a sample of any ray, and one past the last.
    pub blocks: [u32; 2],
}

impl Bundle {
    /// Of the rays that have samples, if any.
    #[inline]
    pub fn of(rays: &[SampleRay]) -> Option<Self> {
        let unset = [[f32::INFINITY, f32::NEG_INFINITY]; 3];
        let mut bundle = Self {
            start: unset,
            step: unset,
            blocks: [u32::MAX, 0],
        };
        let wider = |[lo, hi]: [f32; 2], x: f32| [lo.min(x), hi.max(x)];
        for ray in rays.iter().filter(|ray| !ray.is_empty()) {
            for a in 0..3 {
                bundle.start[a] = wider(bundle.start[a], ray.start[a]);
                bundle.step[a] = wider(bundle.step[a], ray.step[a]);
            }
            let [first, end] = bundle.blocks;
            bundle.blocks = [first.min(ray.first_block()), end.max(ray.end_block())];
        }
        (bundle.blocks[0] < bundle.blocks[1]).then_some(bundle)
    }

    /// Bound from below (`end` 0) or above (1) on the positions of samples of one number along an axis.
    #[inline]
    pub fn at(&self, axis: usize, end: usize, sample: f32) -> f32 {
        sample.mul_add(self.step[axis][end], self.start[axis][end])
    }
}
