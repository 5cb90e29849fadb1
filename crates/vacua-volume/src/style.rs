//! From wishes to a transfer function: a colour map by name, an opacity ramp, and defaults that
//! show something whatever the units of the data.
//!
//! A [`TransferStyle`] says what is wanted without knowing the data; [`TransferStyle::resolve`]
//! fills in the rest from a volume: the range of values from percentiles, so that a few outliers do
//! not wash the picture out, and the reference length of opacity from the bounds, so that units of
//! length do not matter.

use std::ops::RangeInclusive;

use crate::array::DataArray;
use crate::dataset::Volume;
use crate::grid::Bounds;
use crate::presets::{self, UnknownPreset};
use crate::range::ValueRange;
use crate::transfer::{
    ColorPoint, OpacityPoint, TransferFunction, TransferFunctionError, ValueScale,
};
use crate::{Scalar, dispatch_scalar};

/// Opacity per reference length at the upper end of the default ramp.
pub const DEFAULT_RAMP_OPACITY: f64 = 0.2;
/// The reference length of opacity is the longest side of the bounds divided by this.
const UNITS_PER_SIDE: f64 = 100.0;
/// The percentiles that the default range of values spans.
const PERCENTILES: [f64; 2] = [0.02, 0.98];
/// Values looked at for the percentiles; larger arrays are sampled.
pub const PERCENTILE_SAMPLES: usize = 1 << 19;

/// How opacity follows from the value.
#[derive(Clone, Debug, PartialEq)]
pub enum OpacityStyle {
    /// Rising evenly from 0 to `opacity`, between two fractions of the value range; `opacity` above.
    Ramp {
        /// Where the ramp starts and ends, as fractions of the value range.
        fractions: RangeInclusive<f64>,
        /// Opacity per reference length at its end.
        opacity: f64,
    },
    /// Points in data units.
    Points(Vec<OpacityPoint>),
}

/// What a picture should look like, before the data is known. Everything left out follows from the
/// data.
#[derive(Clone, Debug, PartialEq)]
pub struct TransferStyle {
    /// Name of the colour map; see [`presets::names`].
    pub color_map: String,
    /// The values that the colours and a ramp span; percentiles of the data if not said.
    pub range: Option<ValueRange>,
    /// Opacity by value.
    pub opacity: OpacityStyle,
    /// World length over which opacities hold; the longest side of the bounds ÷ 100 if not said.
    pub unit_length: Option<f64>,
    /// How values are spread.
    pub scale: ValueScale,
}

impl Default for TransferStyle {
    fn default() -> Self {
        Self {
            color_map: "viridis".to_owned(),
            range: None,
            opacity: OpacityStyle::Ramp {
                fractions: 0.0..=1.0,
                opacity: DEFAULT_RAMP_OPACITY,
            },
            unit_length: None,
            scale: ValueScale::Linear,
        }
    }
}

/// Why a style makes no transfer function.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
pub enum StyleError {
    /// No colour map by that name.
    #[error(transparent)]
    Preset(#[from] UnknownPreset),
    /// A range that is not one.
    #[error("the value range {lo} to {hi} is empty or not finite")]
    Range {
        /// Its lower end.
        lo: f64,
        /// Its upper end.
        hi: f64,
    },
    /// A logarithmic scale over data or a range without positive values.
    #[error("a logarithmic scale needs positive values, the range is {lo} to {hi}")]
    NothingPositive {
        /// Lower end of the range.
        lo: f64,
        /// Upper end of the range.
        hi: f64,
    },
    /// Points that make no transfer function.
    #[error(transparent)]
    Function(#[from] TransferFunctionError),
}

impl TransferFunction {
    /// A style with a colour map by name, to be completed from the data.
    pub fn preset(color_map: &str) -> TransferStyle {
        TransferStyle {
            color_map: color_map.to_owned(),
            ..TransferStyle::default()
        }
    }

    /// The same colours and opacities over another range of values: the lower end of
    /// [`TransferFunction::color_range`] moves to `range.lo`, its upper end to `range.hi`, all other
    /// points in proportion on the function's scale.
    ///
    /// # Errors
    /// [`TransferFunctionError`] if the range suits no transfer function, for instance a
    /// logarithmic one with values that are not positive.
    pub fn stretched_to(&self, range: ValueRange) -> Result<Self, TransferFunctionError> {
        if self.scale() == ValueScale::Log && range.lo <= 0.0 {
            return Err(TransferFunctionError::LogOfNonPositive(range.lo));
        }
        let from = self.color_range();
        let moved = |value: f64| {
            if value == from.lo {
                return range.lo;
            }
            if value == from.hi {
                return range.hi;
            }
            let t = self.scale().fraction(from, value);
            match self.scale() {
                ValueScale::Linear => range.lo + t * range.width(),
                ValueScale::Log => range.lo * (range.hi / range.lo).powf(t),
            }
        };
        let colors = self.colors().iter().map(|c| ColorPoint {
            value: moved(c.value),
            srgb: c.srgb,
        });
        let opacities = self.opacities().iter().map(|o| OpacityPoint {
            value: moved(o.value),
            opacity: o.opacity,
        });
        Self::new(
            colors.collect(),
            opacities.collect(),
            self.unit_length(),
            self.scale(),
        )
    }
}

impl TransferStyle {
    /// Opacity rising from 0 between two fractions of the value range, up to
    /// [`DEFAULT_RAMP_OPACITY`] per reference length.
    pub fn opacity_ramp(self, fractions: RangeInclusive<f64>) -> Self {
        self.opacity_ramp_to(fractions, DEFAULT_RAMP_OPACITY)
    }

    /// Opacity rising from 0 to `opacity` per reference length, between two fractions of the value
    /// range.
    pub fn opacity_ramp_to(mut self, fractions: RangeInclusive<f64>, opacity: f64) -> Self {
        self.opacity = OpacityStyle::Ramp { fractions, opacity };
        self
    }

    /// Opacity points in data units.
    pub fn opacity_points(mut self, points: Vec<OpacityPoint>) -> Self {
        self.opacity = OpacityStyle::Points(points);
        self
    }

    /// The values that the colours and a ramp span, in data units.
    pub fn range(mut self, lo: f64, hi: f64) -> Self {
        self.range = Some(ValueRange { lo, hi });
        self
    }

    /// The world length over which opacities hold.
    pub fn unit_length(mut self, length: f64) -> Self {
        self.unit_length = Some(length);
        self
    }

    /// How values are spread over colours and ramp.
    pub fn scale(mut self, scale: ValueScale) -> Self {
        self.scale = scale;
        self
    }

    /// The transfer function for a volume.
    ///
    /// # Errors
    /// [`StyleError`] naming what does not fit.
    pub fn resolve(&self, volume: &Volume) -> Result<TransferFunction, StyleError> {
        self.resolve_for(volume.scalars(), volume.geometry().bounds())
    }

    /// The transfer function for one-component scalars within bounds.
    ///
    /// # Errors
    /// [`StyleError`] naming what does not fit.
    pub fn resolve_for(
        &self,
        scalars: &DataArray,
        bounds: Bounds,
    ) -> Result<TransferFunction, StyleError> {
        // Without any value in the data every range is as good as another.
        let range = self
            .range
            .or_else(|| percentile_range(scalars, self.scale))
            .or_else(|| scalars.range(0))
            .unwrap_or(ValueRange { lo: 0.0, hi: 1.0 });
        let ValueRange { lo, hi } = range;
        if !(lo <= hi && lo.is_finite() && hi.is_finite()) {
            return Err(StyleError::Range { lo, hi });
        }
        if self.scale == ValueScale::Log && lo <= 0.0 {
            return Err(StyleError::NothingPositive { lo, hi });
        }
        let colors = presets::color_points_on(&self.color_map, range, self.scale)?;
        let opacities = match &self.opacity {
            OpacityStyle::Points(points) => points.clone(),
            OpacityStyle::Ramp { fractions, opacity } => {
                let at = |fraction, opacity| OpacityPoint {
                    value: self.scale.at(range, fraction),
                    opacity,
                };
                vec![at(*fractions.start(), 0.0), at(*fractions.end(), *opacity)]
            }
        };
        let unit_length = self
            .unit_length
            .unwrap_or_else(|| default_unit_length(bounds));
        Ok(TransferFunction::new(
            colors,
            opacities,
            unit_length,
            self.scale,
        )?)
    }
}

/// A transfer function that shows something of any volume: viridis over the 2nd to 98th percentile
/// of the values, opacity rising from 0 in units of the data's size.
///
/// # Errors
/// [`StyleError`] if the bounds of the volume have no length.
pub fn default_transfer_function(volume: &Volume) -> Result<TransferFunction, StyleError> {
    TransferStyle::default().resolve(volume)
}

/// The reference length of opacity that follows from the data: the longest side of the bounds ÷ 100.
pub fn default_unit_length(bounds: Bounds) -> f64 {
    bounds.size().max_element() / UNITS_PER_SIDE
}

/// The 2nd to 98th percentile of the finite values (the positive ones, on a logarithmic scale) of
/// an array with one component; `None` if there are none.
///
/// A large array is sampled, one value from each of 2^19 equal stretches, always the same ones.
/// Where more than half of all have one value (a background), that value and the percentiles of all
/// others are spanned instead: three labels in a large nothing keep their colours.
pub fn percentile_range(scalars: &DataArray, scale: ValueScale) -> Option<ValueRange> {
    let mut samples: Vec<f64> = dispatch_scalar!(scalars.scalar_type(), T => {
        sampled(bytemuck::cast_slice::<u8, T>(scalars.bytes()))
    });
    samples.retain(|v| v.is_finite() && (scale == ValueScale::Linear || *v > 0.0));
    let whole = percentiles(&mut samples)?;
    let all = samples.len();
    let (_, &mut middle, _) = samples.select_nth_unstable_by(all / 2, f64::total_cmp);
    samples.retain(|v| *v != middle);
    if 2 * samples.len() >= all {
        return Some(whole);
    }
    if let Some(others) = percentiles(&mut samples) {
        let background = ValueRange {
            lo: middle,
            hi: middle,
        };
        return Some(background.union(others));
    }
    // A feature so small that no sample met it.
    scalars
        .range(0)
        .filter(|r| scale == ValueScale::Linear || r.lo > 0.0)
        .or(Some(whole))
}

fn percentiles(samples: &mut [f64]) -> Option<ValueRange> {
    let last = samples.len().checked_sub(1)?;
    let [lo, hi] = PERCENTILES.map(|fraction| {
        let rank = (fraction * last as f64).round() as usize;
        *samples.select_nth_unstable_by(rank, f64::total_cmp).1
    });
    Some(ValueRange { lo, hi })
}

/// At most [`PERCENTILE_SAMPLES`] values: all of them, or one from each stretch at a place that
/// varies from stretch to stretch, so that the sampling follows no row or slice of a grid.
fn sampled<T: Scalar>(values: &[T]) -> Vec<f64> {
    if values.len() <= PERCENTILE_SAMPLES {
        return values.iter().map(|v| v.to_f64()).collect();
    }
    (0..PERCENTILE_SAMPLES)
        .map(|i| {
            let stretch =
                |i: usize| (i as u128 * values.len() as u128 / PERCENTILE_SAMPLES as u128) as usize;
            let (from, to) = (stretch(i), stretch(i + 1));
            values[from + (scramble(i as u64) % (to - from) as u64) as usize].to_f64()
        })
        .collect()
}

/// A well-mixed number for each index (the finaliser of SplitMix64).
fn scramble(index: u64) -> u64 {
    let mut x = index.wrapping_add(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use proptest::prelude::*;

    fn array(values: Vec<f64>) -> DataArray {
        DataArray::from_vec(values, 1).expect("one component")
    }

    fn bounds() -> Bounds {
        Bounds {
            lo: DVec3::ZERO,
            hi: DVec3::new(4.0, 50.0, 10.0),
        }
    }

    #[test]
    fn labels_in_a_large_background_keep_their_colors() {
        let label = |i: usize| {
            if i % 100 < 97 {
                0
            } else {
                (i % 100 - 96) as u8
            }
        };
        let values = DataArray::from_vec((0..10_000).map(label).collect(), 1);
        let range = percentile_range(&values.expect("one component"), ValueScale::Linear);
        assert_eq!(range, Some(ValueRange { lo: 0.0, hi: 3.0 }));
    }

    #[test]
    fn outliers_do_not_set_the_range() {
        let mut values: Vec<f64> = (0..1000).map(f64::from).collect();
        values.extend([1e30, -1e30, f64::NAN, f64::INFINITY]);
        let range = percentile_range(&array(values), ValueScale::Linear).expect("values");
        assert!(
            (range.lo - 20.0).abs() <= 1.0 && (range.hi - 980.0).abs() <= 1.0,
            "{range:?}"
        );
    }

    #[test]
    fn a_large_background_is_spanned() {
        let mut values = vec![-1000.0; 100_000];
        values[500..600].fill(3.0);
        let range = percentile_range(&array(values), ValueScale::Linear).expect("values");
        assert_eq!(
            range,
            ValueRange {
                lo: -1000.0,
                hi: 3.0
            }
        );
    }

    #[test]
    fn large_arrays_are_sampled_alike_each_time() {
        let values = array((0..2_000_000).map(|i| f64::from(i % 1000)).collect());
        let range = percentile_range(&values, ValueScale::Linear).expect("values");
        assert_eq!(percentile_range(&values, ValueScale::Linear), Some(range));
        assert!(
            (range.lo - 20.0).abs() < 3.0 && (range.hi - 979.0).abs() < 3.0,
            "{range:?}"
        );
    }

    #[test]
    fn a_speck_in_a_large_constant_array_is_found() {
        let mut values = vec![0u8; 4 << 20];
        values[1_234_567] = 9;
        let values = DataArray::from_vec(values, 1).expect("one component");
        let range = percentile_range(&values, ValueScale::Linear).expect("values");
        assert_eq!(range.hi, 9.0);
    }

    #[test]
    fn styles_resolve() {
        let f = TransferFunction::preset("viridis")
            .opacity_ramp(0.2..=1.0)
            .range(10.0, 20.0)
            .resolve_for(&array(vec![0.0, 1.0]), bounds())
            .expect("a style that fits");
        assert_eq!(f.unit_length(), 0.5);
        assert_eq!(f.opacity_at(12.0), 0.0);
        assert_eq!(f.opacity_at(25.0), DEFAULT_RAMP_OPACITY);
        assert_eq!(f.color_range(), ValueRange { lo: 10.0, hi: 20.0 });

        let constant = TransferStyle::default()
            .resolve_for(&array(vec![7.0; 8]), bounds())
            .expect("a constant field");
        assert_eq!(constant.opacity_at(7.0), DEFAULT_RAMP_OPACITY);
        let nothing = TransferStyle::default().resolve_for(&array(vec![f64::NAN; 8]), bounds());
        assert!(nothing.is_ok());
    }

    #[test]
    fn nonsense_is_refused() {
        let data = array(vec![-2.0, -1.0]);
        let resolve = |style: TransferStyle| style.resolve_for(&data, bounds()).unwrap_err();
        let style = TransferStyle::default;
        assert!(matches!(
            resolve(TransferFunction::preset("nope")),
            StyleError::Preset(_)
        ));
        assert!(matches!(
            resolve(style().range(2.0, 1.0)),
            StyleError::Range { .. }
        ));
        assert!(matches!(
            resolve(style().range(f64::NAN, 1.0)),
            StyleError::Range { .. }
        ));
        assert!(matches!(
            resolve(style().scale(ValueScale::Log)),
            StyleError::NothingPositive { .. }
        ));
        assert!(matches!(
            resolve(style().unit_length(-1.0)),
            StyleError::Function(TransferFunctionError::UnitLength(_))
        ));
    }

    proptest! {
        #[test]
        fn stretching_keeps_the_looks(
            t in 0.0f64..=1.0,
            lo in 0.1f64..10.0,
            factor in 1.1f64..100.0,
            log in any::<bool>(),
        ) {
            let scale = if log { ValueScale::Log } else { ValueScale::Linear };
            let from = ValueRange { lo: 1.0, hi: 30.0 };
            let to = ValueRange { lo, hi: lo * factor };
            let f = TransferFunction::preset("viridis")
                .range(from.lo, from.hi)
                .scale(scale)
                .resolve_for(&array(vec![0.0]), bounds())
                .expect("fits");
            let g = f.stretched_to(to).expect("positive range");
            prop_assert!((f.opacity_at(scale.at(from, t)) - g.opacity_at(scale.at(to, t))).abs() < 1e-9);
        }
    }
}
