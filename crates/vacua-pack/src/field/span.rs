//! Values as steps of the range of a sub-mesh, and the range itself.
//!
//! A span is two steps in 16 bits: the last one below a value in the lower half, and how far the first
//! one above it is below the last of all in the upper half. What several span is the least of either half.

use vacua_simd::{Kernel, Simd, dispatch};
use vacua_volume::{Scalar, ValueRange};

use super::{STEPS, decode_step};

/// A lower step, and how far an upper step is below the last.
pub(super) type Span = u16;
/// The span of nothing.
pub(super) const EMPTY: Span = Span::MAX;
/// A range that no number is in, as it is stored.
pub(super) const NOTHING: [f64; 2] = [f64::INFINITY, f64::NEG_INFINITY];

/// Values that are compared side by side.
const LANES: usize = 16;
/// Values that are looked at together.
const PIECE: usize = 64;
/// Steps, and the last once more.
type Decoded = [f64; 257];

#[inline(always)]
pub(super) fn span(lo: u8, hi: u8) -> Span {
    Span::from_le_bytes([lo, u8::MAX - hi])
}

/// A span as it is stored.
#[cfg(test)]
pub(super) fn slot(span: Span) -> [u8; 2] {
    let [lo, below_last] = span.to_le_bytes();
    [lo, u8::MAX - below_last]
}

#[inline(always)]
pub(super) fn join(a: Span, b: Span) -> Span {
    (a & 255).min(b & 255) | (a >> 8).min(b >> 8) << 8
}

/// The range of the finite ones of some values.
pub(super) fn range_of<T: Scalar>(values: &[T]) -> Option<ValueRange> {
    let ends = dispatch(Ends { values });
    // Of several zeros the first one counts, whatever its sign.
    let [lo, hi] = ends.map(|end| {
        let same = |v: &f64| *v == end;
        let first = (end == 0.0).then(|| values.iter().map(|v| v.to_f64()).find(same));
        first.flatten().unwrap_or(end)
    });
    (lo <= hi).then_some(ValueRange { lo, hi })
}

/// The least and the largest finite value, of zeros either one.
struct Ends<'a, T> {
    values: &'a [T],
}

#[inline(always)]
fn widen([lo, hi]: [f64; 2], value: f64) -> [f64; 2] {
    // In this order what is no number changes nothing.
    let v = if value.is_finite() { value } else { f64::NAN };
    [if v < lo { v } else { lo }, if v > hi { v } else { hi }]
}

impl<T: Scalar> Kernel for Ends<'_, T> {
    type Output = [f64; 2];

    #[inline(always)]
    fn run<S: Simd>(self) -> [f64; 2] {
        let (mut lo, mut hi) = ([NOTHING[0]; LANES], [NOTHING[1]; LANES]);
        let (pieces, rest) = self.values.as_chunks::<LANES>();
        for piece in pieces {
            for lane in 0..LANES {
                [lo[lane], hi[lane]] = widen([lo[lane], hi[lane]], piece[lane].to_f64());
            }
        }
        let mut ends = NOTHING;
        for lane in 0..LANES {
            ends = widen(widen(ends, lo[lane]), hi[lane]);
        }
        for value in rest {
            ends = widen(ends, value.to_f64());
        }
        ends
    }
}

/// The smallest span whose decoded range contains a value, for each; of what is not finite, nothing.
/// `whole` is the range of these values.
pub(super) fn spans_of<T: Scalar>(values: &[T], whole: ValueRange, spans: &mut [Span]) {
    let mut decoded = [whole.hi; 257];
    for step in 0..=u8::MAX {
        decoded[usize::from(step)] = decode_step(whole, step);
    }
    dispatch(Spans {
        values,
        whole,
        decoded: &decoded,
        spans,
    });
}

struct Spans<'a, T> {
    values: &'a [T],
    whole: ValueRange,
    decoded: &'a Decoded,
    spans: &'a mut [Span],
}

impl<T: Scalar> Kernel for Spans<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        // A guess; what is decoded decides.
        let per_unit = STEPS / (0.5 * self.whole.hi - 0.5 * self.whole.lo);
        let base = 0.5 * self.whole.lo;
        let pieces = self.values.chunks(PIECE);
        for (values, spans) in pieces.zip(self.spans.chunks_mut(PIECE)) {
            let mut wide = [f64::NAN; PIECE];
            for (wide, value) in wide.iter_mut().zip(values) {
                *wide = value.to_f64();
            }
            let mut guesses = [0; PIECE];
            for i in 0..PIECE {
                guesses[i] = truncate((0.5 * wide[i] - base) * per_unit);
            }
            settle(&wide, &guesses, self.decoded, spans);
        }
    }
}

/// As `as u8`, in operations that work side by side.
#[inline(always)]
fn truncate(value: f64) -> u8 {
    /// Numbers of this size are whole.
    const WHOLE: f64 = (1u64 << 52) as f64;
    #[expect(clippy::manual_clamp, reason = "what is no number becomes 0")]
    let value = value.max(0.0).min(STEPS);
    let nearest = value + WHOLE;
    let is_above = nearest - WHOLE > value;
    (nearest.to_bits() as u8).wrapping_sub(u8::from(is_above))
}

/// The spans of values from guesses of their steps. Not inlined: where there are gathers of wide numbers
/// it would be compiled to them, which are slower.
#[inline(never)]
fn settle(values: &[f64; PIECE], guesses: &[u8; PIECE], decoded: &Decoded, spans: &mut [Span]) {
    for ((span, &v), &guess) in spans.iter_mut().zip(values).zip(guesses) {
        let step = usize::from(guess);
        let (below, above) = (decoded[step], decoded[step + 1]);
        *span = if below <= v && v <= above {
            self::span(guess, guess + u8::from(below < v))
        } else {
            search(v, guess, decoded)
        };
    }
}

#[cold]
fn search(v: f64, guess: u8, decoded: &Decoded) -> Span {
    if !v.is_finite() {
        return EMPTY;
    }
    let mut lo = guess;
    while lo > 0 && decoded[usize::from(lo)] > v {
        lo -= 1;
    }
    let mut hi = guess;
    while hi < u8::MAX && decoded[usize::from(hi)] < v {
        hi += 1;
    }
    span(lo, hi)
}

#[cfg(test)]
mod tests {
    use super::super::decode_range;
    use super::*;
    use proptest::prelude::*;

    fn slot_of(values: &[f64], whole: ValueRange) -> [u8; 2] {
        let mut spans = vec![EMPTY; values.len()];
        spans_of(values, whole, &mut spans);
        slot(spans.into_iter().fold(EMPTY, join))
    }

    /// As [`range_of`], one value after the other.
    fn plain_range_of(values: &[f64]) -> Option<ValueRange> {
        let [lo, hi] = values.iter().fold(NOTHING, |ends, &v| widen(ends, v));
        (lo <= hi).then_some(ValueRange { lo, hi })
    }

    fn bits(range: Option<ValueRange>) -> Option<[u64; 2]> {
        range.map(|r| [r.lo.to_bits(), r.hi.to_bits()])
    }

    proptest! {
        #[test]
        fn truncated_as_by_the_language(value in any::<f64>(), near in -2.0f64..258.0, whole in 0u8..=255) {
            for value in [value, near, f64::from(whole), f64::from(whole).next_down(), f64::NAN] {
                prop_assert_eq!(truncate(value), value as u8);
            }
        }

        #[test]
        fn slots_contain_their_ranges(
            ends in prop::array::uniform4(prop_oneof![-1.0f64..1.0, -1e-30f64..1e-30, -1e308f64..1e308]),
        ) {
            let mut e = ends;
            e.sort_by(f64::total_cmp);
            let whole = ValueRange { lo: e[0], hi: e[3] };
            let back = decode_range(whole, slot_of(&[e[2], f64::NAN, e[1]], whole)).expect("a range");
            prop_assert!(back.lo <= e[1] && e[2] <= back.hi);
            prop_assert!(whole.lo <= back.lo && back.hi <= whole.hi);
            prop_assert_eq!(decode_range(whole, slot_of(&[f64::INFINITY], whole)), None);
            let exact = ValueRange { lo: e[0], hi: e[0] };
            prop_assert_eq!(decode_range(exact, slot_of(&[e[0]], exact)), Some(exact));
        }

        #[test]
        fn spans_are_those_of_a_search(
            values in prop::collection::vec(
                prop_oneof![
                    -1.0f64..1.0,
                    (0u8..=255).prop_map(f64::from),
                    Just(f64::NAN),
                    Just(f64::INFINITY),
                    Just(-0.0),
                    Just(0.0),
                    Just(-1e308),
                ],
                1..200,
            ),
        ) {
            prop_assert_eq!(bits(range_of(&values)), bits(plain_range_of(&values)));
            if let Some(whole) = range_of(&values) {
                let mut decoded = [whole.hi; 257];
                for step in 0..=u8::MAX {
                    decoded[usize::from(step)] = decode_step(whole, step);
                }
                let mut spans = vec![EMPTY; values.len()];
                spans_of(&values, whole, &mut spans);
                let per_unit = STEPS / (0.5 * whole.hi - 0.5 * whole.lo);
                let guess = |v: f64| ((0.5 * v - 0.5 * whole.lo) * per_unit) as u8;
                let expected: Vec<Span> =
                    values.iter().map(|&v| search(v, guess(v), &decoded)).collect();
                prop_assert_eq!(spans, expected);
            }
        }
    }
}
