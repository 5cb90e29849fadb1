//! Elementary functions on lanes, built from operations that round the same everywhere.

use crate::{Float, Int, Simd};

/// `1 − exp(−x)` for `x ≥ 0`: the opacity of an optical depth. Exactly 0 at 0, relative error below
/// 3 ulp, also for small `x` where `1 − exp(−x)` would cancel.
///
/// Range reduction `−x = n·ln 2 + r`, `|r| ≤ ln 2 / 2`; then `exp(−x) − 1 = 2ⁿ·expm1(r) + (2ⁿ − 1)`
/// with the Taylor polynomial of `expm1` to degree 8 (remainder below 2⁻³⁰ of the result).
#[inline(always)]
pub fn opacity_of_depth<S: Simd>(x: S::F) -> S::F {
    const LOG2_E: f32 = std::f32::consts::LOG2_E;
    const LN_2_HIGH: f32 = 0.693_359_4;
    const LN_2_LOW: f32 = -2.121_944_4e-4;
    let y = S::F::splat(0.0) - x.min(S::F::splat(80.0));
    let n = (y * S::F::splat(LOG2_E)).round();
    let r = n.mul_add(S::F::splat(-LN_2_HIGH), y);
    let r = n.mul_add(S::F::splat(-LN_2_LOW), r);
    let mut p = S::F::splat(1.0 / 40320.0);
    for coefficient in [
        1.0 / 5040.0,
        1.0 / 720.0,
        1.0 / 120.0,
        1.0 / 24.0,
        1.0 / 6.0,
        0.5,
    ] {
        p = p.mul_add(r, S::F::splat(coefficient));
    }
    let expm1 = (r * r).mul_add(p, r);
    let two_to_n = S::f_from_bits((n.to_i() + S::I::splat(127)).shl::<23>());
    let sum = two_to_n.mul_add(expm1, two_to_n - S::F::splat(1.0));
    S::F::splat(0.0) - sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Kernel, LANES, Level, Portable, dispatch_at};

    struct Opacity([f32; LANES]);
    impl Kernel for Opacity {
        type Output = [f32; LANES];
        #[inline(always)]
        fn run<S: Simd>(self) -> [f32; LANES] {
            opacity_of_depth::<S>(S::F::from_array(self.0)).to_array()
        }
    }

    #[test]
    fn opacity_is_accurate_and_the_same_everywhere() {
        let mut worst_ulps = 0.0f64;
        for step in 0..20_000 {
            let x: [f32; LANES] =
                std::array::from_fn(|i| 1e-9 * (1.0021f32).powi(step) * (1.0 + i as f32 / 20.0));
            if x[0] > 100.0 {
                break;
            }
            let reference = Opacity(x).run::<Portable>();
            for level in Level::available() {
                assert_eq!(
                    dispatch_at(level, Opacity(x)).map(f32::to_bits),
                    reference.map(f32::to_bits)
                );
            }
            for i in 0..LANES {
                let exact = -(-f64::from(x[i])).exp_m1();
                let ulp = f64::from(f32::EPSILON) * exact;
                worst_ulps = worst_ulps.max((f64::from(reference[i]) - exact).abs() / ulp);
            }
        }
        assert!(worst_ulps < 3.0, "{worst_ulps} ulp");
        assert_eq!(
            Opacity([0.0; LANES]).run::<Portable>().map(f32::to_bits),
            [0; LANES]
        );
    }
}
