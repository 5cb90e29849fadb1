//! The table that a transfer function is compiled to.

use super::{TransferFunction, linear_from_srgb};
use crate::ValueScale;
use crate::range::{ValueMap, ValueRange};

/// Number of linear pieces in a [`TransferTable`]; it holds one entry more.
pub const TRANSFER_BINS: usize = 1024;

/// A transfer function as renderers evaluate it: [`TRANSFER_BINS`] linear pieces over the values
/// that occur, colours in linear light.
///
/// A value `v` has the table coordinate `u = clamp((key(v) − key(lo)) · bins_per_key, 0, BINS)`, bin
/// `i = min(⌊u⌋, BINS − 1)` and fraction `u − i`; `key` is the identity on a linear scale, and the
/// bit pattern of the `f32` (a monotone, piecewise linear logarithm) on a logarithmic one.
/// Every step is monotone in `v`, so the bins of a range of values are the bins between those of
/// its ends.
#[derive(Clone, Debug)]
pub struct TransferTable {
    scale: ValueScale,
    lo: f32,
    bins_per_key: f32,
    entries: Vec<[f32; 4]>,
    /// For each bin, the first bin at or after it with any extinction; one more entry than bins.
    next_active: Vec<u32>,
    /// A bit for each bin, set if it has any extinction.
    active_bins: [u32; TRANSFER_BINS / 32],
}

impl TransferTable {
    /// Compiles a transfer function for values within `data_range` (data units); the bins cover the
    /// part of the function's domain that the data can reach. The table is asked with values that
    /// went through `map`, which must be the identity on a logarithmic scale.
    pub fn new(function: &TransferFunction, data_range: ValueRange, map: ValueMap) -> Self {
        debug_assert!(function.scale == ValueScale::Linear || map.is_identity());
        let domain = function.domain();
        let mut lo = domain.lo.max(data_range.lo).min(domain.hi);
        let hi = domain.hi.min(data_range.hi).max(lo);
        if function.scale == ValueScale::Log {
            lo = lo.max(f64::from(f32::MIN_POSITIVE));
        }
        let (lo32, hi32) = (map.rendered(lo), map.rendered(hi));
        let width = match function.scale {
            ValueScale::Linear => hi32 - lo32,
            ValueScale::Log => (hi32.to_bits() as i32 - lo32.to_bits() as i32) as f32,
        };
        let bins_per_key = if width > 0.0 {
            TRANSFER_BINS as f32 / width
        } else {
            0.0
        };
        let bins_per_key = if bins_per_key.is_finite() {
            bins_per_key
        } else {
            0.0
        };
        let value_at = |entry: usize| -> f64 {
            let fraction = entry as f64 / TRANSFER_BINS as f64;
            match function.scale {
                ValueScale::Linear => lo + fraction * (hi - lo),
                ValueScale::Log => {
                    let bits = lo32.to_bits() + (fraction * f64::from(width)) as u32;
                    f64::from(f32::from_bits(bits))
                }
            }
        };
        let entry = |e: usize| {
            let value = value_at(e);
            let [r, g, b] = function.srgb_at(value).map(|c| linear_from_srgb(c) as f32);
            [r, g, b, function.extinction_at(value) as f32]
        };
        let entries: Vec<[f32; 4]> = (0..=TRANSFER_BINS).map(entry).collect();
        let mut active_bins = [0; TRANSFER_BINS / 32];
        let mut next_active = vec![TRANSFER_BINS as u32; TRANSFER_BINS + 1];
        for bin in (0..TRANSFER_BINS).rev() {
            let active = entries[bin][3] > 0.0 || entries[bin + 1][3] > 0.0;
            active_bins[bin / 32] |= u32::from(active) << (bin % 32);
            next_active[bin] = if active {
                bin as u32
            } else {
                next_active[bin + 1]
            };
        }
        Self {
            scale: function.scale,
            lo: lo32,
            bins_per_key,
            entries,
            next_active,
            active_bins,
        }
    }

    /// How table coordinates follow from values.
    pub fn scale(&self) -> ValueScale {
        self.scale
    }

    /// The value at table coordinate 0.
    pub fn lo(&self) -> f32 {
        self.lo
    }

    /// Factor from key difference to table coordinate.
    pub fn bins_per_key(&self) -> f32 {
        self.bins_per_key
    }

    /// The [`TRANSFER_BINS`] + 1 entries: linear-light red, green and blue, and extinction per world
    /// length.
    pub fn entries(&self) -> &[[f32; 4]] {
        &self.entries
    }

    /// For each bin, the first bin at or after it with any extinction ([`TRANSFER_BINS`] if none).
    pub fn next_active(&self) -> &[u32] {
        &self.next_active
    }

    /// Bit `bin % 32` of word `bin / 32`: whether a bin has any extinction.
    pub fn active_bins(&self) -> &[u32; TRANSFER_BINS / 32] {
        &self.active_bins
    }

    /// Table coordinate of a value, in `0..=BINS`; the scalar twin of what the kernels compute.
    #[inline]
    pub fn coordinate(&self, value: f32) -> f32 {
        let key = match self.scale {
            ValueScale::Linear => value - self.lo,
            ValueScale::Log => {
                (value.max(self.lo).to_bits() as i32 - self.lo.to_bits() as i32) as f32
            }
        };
        (key * self.bins_per_key).clamp(0.0, TRANSFER_BINS as f32)
    }

    /// The bin of a value.
    #[inline]
    pub fn bin(&self, value: f32) -> usize {
        (self.coordinate(value) as usize).min(TRANSFER_BINS - 1)
    }

    /// Extinction per world length and linear-light colour at a value.
    pub fn evaluate(&self, value: f32) -> (f32, [f32; 3]) {
        let u = self.coordinate(value);
        let bin = (u as usize).min(TRANSFER_BINS - 1);
        let t = u - bin as f32;
        let (a, b) = (self.entries[bin], self.entries[bin + 1]);
        let [r, g, b, extinction] = [0, 1, 2, 3].map(|c: usize| t.mul_add(b[c] - a[c], a[c]));
        (extinction, [r, g, b])
    }

    /// Whether any value in `lo..=hi` has any extinction, in constant time.
    #[inline]
    pub fn is_active(&self, lo: f32, hi: f32) -> bool {
        self.next_active[self.bin(lo)] as usize <= self.bin(hi)
    }

    /// Whether every value is fully transparent.
    pub fn is_empty(&self) -> bool {
        self.next_active[0] as usize == TRANSFER_BINS
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ColorPoint, OpacityPoint};
    use proptest::prelude::*;

    fn ramp(points: &[(f64, f64)], scale: ValueScale) -> TransferFunction {
        let colors = points
            .iter()
            .enumerate()
            .map(|(i, p)| ColorPoint {
                value: p.0,
                srgb: [i as f64 / points.len() as f64; 3],
            })
            .collect();
        let opacities = points
            .iter()
            .map(|p| OpacityPoint {
                value: p.0,
                opacity: p.1,
            })
            .collect();
        TransferFunction::new(colors, opacities, 1.0, scale).expect("points are in order")
    }

    #[test]
    fn the_table_follows_the_function() {
        for scale in [ValueScale::Linear, ValueScale::Log] {
            let f = ramp(&[(1.0, 0.0), (2.0, 0.0), (3.0, 0.2), (9.0, 0.7)], scale);
            let t = TransferTable::new(&f, ValueRange { lo: 0.5, hi: 20.0 }, ValueMap::IDENTITY);
            for i in 0..=1000 {
                let v = 0.5 + f64::from(i) * 0.01;
                let (sigma, _) = t.evaluate(v as f32);
                assert!(
                    (f64::from(sigma) - f.extinction_at(v)).abs() < 2e-3,
                    "{scale:?} {v}"
                );
            }
            assert_eq!(t.evaluate(1.5).0, 0.0);
            assert!(!t.is_active(0.1, 1.9));
            assert!(t.is_active(0.1, 2.1));
            assert!(t.is_active(5.0, 5.0));
        }
    }

    proptest! {
        #[test]
        fn a_range_is_active_if_any_value_in_it_is(
            mut knots in prop::collection::vec((0.0f64..10.0, prop_oneof![Just(0.0), 0.0..1.0]), 1..8),
            ends in (-1.0f32..11.0, -1.0f32..11.0),
            fractions in prop::collection::vec(0.0f32..=1.0, 32),
        ) {
            knots.sort_by(|a, b| a.0.total_cmp(&b.0));
            let t = TransferTable::new(
                &ramp(&knots, ValueScale::Linear),
                ValueRange { lo: -1.0, hi: 11.0 },
                ValueMap::IDENTITY,
            );
            let (lo, hi) = (ends.0.min(ends.1), ends.0.max(ends.1));
            for f in fractions {
                let v = (lo + f * (hi - lo)).clamp(lo, hi);
                if t.evaluate(v).0 > 0.0 {
                    prop_assert!(t.is_active(lo, hi), "{v} in {lo}..={hi}");
                }
            }
        }
    }
}
