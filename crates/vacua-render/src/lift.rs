//! Interpolating `f32` without subnormal numbers in between.
//!
//! A multiplication that takes or gives a subnormal number keeps a processor for more than a hundred
//! cycles, and fields that decay have many: not only where they are subnormal themselves, but where
//! their products with a fraction are. Masking each number as it is fetched takes a third of the time of
//! a fetch, and leaves the products.

use vacua_simd::{Float, Int, Simd};
use vacua_volume::ValueRange;

/// How plain `f32` are kept clear of subnormal numbers: they are interpolated 2ᵏ times as large.
///
/// Adding k to the exponents does that in one step; it makes 0 and subnormal numbers numbers between half
/// the smallest normal one and that, which is as far from them as reading subnormal ones as 0 is. What
/// comes out smaller than any normal number is 0. All else is interpolated to the same bits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Lift {
    /// Added to the bits of numbers.
    bits: i32,
    /// Bits of which lifted normal numbers have one, and lifted 0 and subnormal numbers none.
    normal: i32,
}

impl Lift {
    /// Largest k: beyond it nothing is gained.
    const MOST: i32 = 63;

    /// For values of a range: as far as all differences of two of them stay finite, and by one less than
    /// a power of two, so that bits tell normal numbers from others.
    pub fn for_range(range: Option<ValueRange>) -> Self {
        let largest = range.map_or(0.0, |range| range.lo.abs().max(range.hi.abs()) as f32);
        let exponent = (largest.to_bits() >> MANTISSA_BITS) as i32 - EXPONENT_BIAS;
        let most = (EXPONENT_BIAS - 2 - exponent).clamp(0, Self::MOST);
        let smallest_exponent = 1 << (most + 1).ilog2();
        Self {
            bits: (smallest_exponent - 1) << MANTISSA_BITS,
            normal: -smallest_exponent << MANTISSA_BITS & i32::MAX,
        }
    }

    /// Lifts numbers.
    #[inline(always)]
    pub fn raise<S: Simd>(self, (a, b): (S::F, S::F)) -> (S::F, S::F) {
        let k = S::I::splat(self.bits);
        (
            S::f_from_bits(a.to_bits() + k),
            S::f_from_bits(b.to_bits() + k),
        )
    }

    /// What lifted numbers mean.
    #[inline(always)]
    pub fn lower<S: Simd>(self, value: S::F) -> S::F {
        let bits = value.to_bits();
        let normal = bits.shares_bits(S::I::splat(self.normal));
        S::f_from_bits((bits - S::I::splat(self.bits)).or_zero(normal))
    }
}

/// Bits of an `f32` below its exponent.
const MANTISSA_BITS: u32 = f32::MANTISSA_DIGITS - 1;

/// What the exponent of an `f32` in `[1, 2)` is stored as.
const EXPONENT_BIAS: i32 = f32::MAX_EXP - 1;

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use vacua_simd::{LANES, Portable};

    type F = <Portable as Simd>::F;

    fn range(largest: f32) -> Option<ValueRange> {
        let largest = f64::from(largest);
        Some(ValueRange {
            lo: -largest,
            hi: largest / 3.0,
        })
    }

    /// A number between two others, through a lift and without.
    fn between(lift: Lift, a: f32, b: f32, t: f32) -> [f32; 2] {
        let splat = <F as Float>::splat;
        let mixed = |(a, b): (F, F)| splat(t).mul_add(b - a, a);
        let lifted = mixed(lift.raise::<Portable>((splat(a), splat(b))));
        let plain = mixed((splat(a), splat(b)));
        let first = |v: F| v.to_array()[LANES - 1];
        [first(lift.lower::<Portable>(lifted)), first(plain)]
    }

    #[test]
    fn what_is_no_normal_number_is_zero() {
        for largest in [0.0, 1e-38, 1.0, 1e18, 1e25, 1e37] {
            let lift = Lift::for_range(range(largest));
            for v in [0.0, -0.0, 1e-45, -1e-39, 1.17e-38] {
                let [value, _] = between(lift, v, v, 0.5);
                assert_eq!(value, 0.0, "{v} of {largest}");
            }
            for v in [f32::MIN_POSITIVE, -f32::MIN_POSITIVE, largest / 3.0] {
                if v.is_normal() {
                    assert_eq!(between(lift, v, v, 0.5)[0], v, "of {largest}");
                }
            }
        }
        assert_eq!(Lift::for_range(None).bits >> MANTISSA_BITS, Lift::MOST);
    }

    proptest! {
        /// Where no number is nearly subnormal, lifting changes no bit; else it stays between its ends
        /// and as near as the smallest normal number.
        #[test]
        fn changes_no_bit(a in -30i32..=37, b in -30i32..=37, signs in 0u8..4, t in 0.0f32..1.0, size in 1.0f32..9.0) {
            let sign = |bit: u8| if signs & bit == 0 { 1.0f32 } else { -1.0 };
            let (a, b) = (sign(1) * size * 10f32.powi(a - 1), sign(2) * 10f32.powi(b));
            let lift = Lift::for_range(range(a.abs().max(b.abs())));
            let [lifted, plain] = between(lift, a, b, t);
            prop_assert_eq!(lifted.to_bits(), plain.to_bits());
        }

        #[test]
        fn stays_between_its_ends(a in any::<f32>(), b in any::<f32>(), t in 0.0f32..1.0) {
            let tame = |v: f32| if v.is_nan() { 0.0 } else { v.clamp(-1e37, 1e37) };
            let (a, b) = (tame(a), tame(b));
            let lift = Lift::for_range(range(a.abs().max(b.abs())));
            let [v, _] = between(lift, a, b, t);
            prop_assert!(v == 0.0 || v.is_normal());
            prop_assert!(v == 0.0 || a.min(b) <= v && v <= a.max(b), "{} of {}, {}", v, a, b);
            let exact = f64::from(a) + f64::from(t) * (f64::from(b) - f64::from(a));
            let largest = f64::from(a.abs().max(b.abs()));
            let error = (f64::from(v) - exact).abs();
            prop_assert!(error <= 2.0 * f64::from(f32::MIN_POSITIVE) + largest * 2e-7, "{}", error);
        }
    }
}
