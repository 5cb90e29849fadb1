//! Transfer functions: what a value looks like.
//!
//! People describe a [`TransferFunction`] with colour points and opacity points in data units;
//! opacity `a` is per reference length `u`, that is, an extinction σ = −ln(1 − a) / u per world
//! length. Compiled to a [`TransferTable`] it is *the* definition of colour and extinction: sampling
//! interpolates the table, and empty-space classification asks the very same bins, so that what
//! is classified as empty is exactly what would have contributed nothing.

mod table;

use crate::range::ValueRange;

pub use table::{TRANSFER_BINS, TransferTable};

/// The largest opacity per reference length; 1 would be an infinite extinction.
const MAX_OPACITY: f64 = 1.0 - 1e-6;

/// A colour at a value. sRGB-encoded components in `0..=1`, as colour maps are published.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColorPoint {
    /// Data value.
    pub value: f64,
    /// Red, green, blue, sRGB-encoded.
    pub srgb: [f64; 3],
}

/// An opacity at a value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OpacityPoint {
    /// Data value.
    pub value: f64,
    /// Opacity of one reference length of this value, in `0..=1`.
    pub opacity: f64,
}

/// How values are spread over the table between its ends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ValueScale {
    /// Evenly.
    #[default]
    Linear,
    /// Evenly in the logarithm; values must be positive, others clamp to the lower end.
    Log,
}

impl ValueScale {
    /// The value a fraction of the way through a range, evenly on this scale; the ends come out as
    /// they went in.
    pub fn at(self, range: ValueRange, fraction: f64) -> f64 {
        let value = match self {
            _ if fraction <= 0.0 => range.lo,
            _ if fraction >= 1.0 => range.hi,
            Self::Linear => range.lo + fraction * (range.hi - range.lo),
            Self::Log => range.lo * (fraction * (range.hi / range.lo).ln()).exp(),
        };
        value.max(range.lo).min(range.hi)
    }

    /// Where a value lies in a range, 0 at its lower and 1 at its upper end; the inverse of
    /// [`ValueScale::at`]. 0 in a range without width.
    pub fn fraction(self, range: ValueRange, value: f64) -> f64 {
        let fraction = match self {
            Self::Linear => (value - range.lo) / (range.hi - range.lo),
            Self::Log => (value / range.lo).ln() / (range.hi / range.lo).ln(),
        };
        if fraction.is_finite() { fraction } else { 0.0 }
    }
}

/// Why points make no transfer function.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
pub enum TransferFunctionError {
    /// No colour points or no opacity points.
    #[error("a transfer function needs at least one {0} point")]
    Empty(&'static str),
    /// A number that is not finite.
    #[error("{kind} point {index} has a value or component that is not finite")]
    NotFinite {
        /// `colour` or `opacity`.
        kind: &'static str,
        /// Which point.
        index: usize,
    },
    /// Values that step back.
    #[error("{kind} point {index} at {value} comes after {previous}: values must not decrease")]
    Decreasing {
        /// `colour` or `opacity`.
        kind: &'static str,
        /// Which point.
        index: usize,
        /// Its value.
        value: f64,
        /// The value before it.
        previous: f64,
    },
    /// An opacity or a colour component outside `0..=1`.
    #[error("{kind} point {index} is {value}, outside 0 to 1")]
    OutOfUnit {
        /// `colour` or `opacity`.
        kind: &'static str,
        /// Which point.
        index: usize,
        /// The offending number.
        value: f64,
    },
    /// A reference length that is not positive.
    #[error("the reference length of opacity is {0}, it must be positive and finite")]
    UnitLength(f64),
    /// A logarithmic scale over values that are not positive.
    #[error("a logarithmic scale needs positive values, the first point is at {0}")]
    LogOfNonPositive(f64),
}

/// Maps a data value to a colour and to an extinction per world length; piecewise linear.
#[derive(Clone, Debug, PartialEq)]
pub struct TransferFunction {
    colors: Vec<ColorPoint>,
    opacities: Vec<OpacityPoint>,
    unit_length: f64,
    scale: ValueScale,
}

impl TransferFunction {
    /// A transfer function from points in order of value. `unit_length` is the world length over
    /// which the opacities hold. Two points at one value make a step.
    ///
    /// # Errors
    /// [`TransferFunctionError`] naming the offending point.
    pub fn new(
        colors: Vec<ColorPoint>,
        opacities: Vec<OpacityPoint>,
        unit_length: f64,
        scale: ValueScale,
    ) -> Result<Self, TransferFunctionError> {
        check("colour", colors.iter().map(|c| (c.value, c.srgb.to_vec())))?;
        check(
            "opacity",
            opacities.iter().map(|o| (o.value, vec![o.opacity])),
        )?;
        if !(unit_length > 0.0 && unit_length.is_finite()) {
            return Err(TransferFunctionError::UnitLength(unit_length));
        }
        let lowest = colors[0].value.min(opacities[0].value);
        if scale == ValueScale::Log && lowest <= 0.0 {
            return Err(TransferFunctionError::LogOfNonPositive(lowest));
        }
        Ok(Self {
            colors,
            opacities,
            unit_length,
            scale,
        })
    }

    /// The colour points, in order of value.
    pub fn colors(&self) -> &[ColorPoint] {
        &self.colors
    }

    /// The opacity points, in order of value.
    pub fn opacities(&self) -> &[OpacityPoint] {
        &self.opacities
    }

    /// The world length over which the opacities hold.
    pub fn unit_length(&self) -> f64 {
        self.unit_length
    }

    /// How values are spread between the points.
    pub fn scale(&self) -> ValueScale {
        self.scale
    }

    /// From the lowest to the highest point.
    pub fn domain(&self) -> ValueRange {
        let (c, o) = (&self.colors, &self.opacities);
        ValueRange {
            lo: c[0].value.min(o[0].value),
            hi: c[c.len() - 1].value.max(o[o.len() - 1].value),
        }
    }

    /// The values that the colours span.
    pub fn color_range(&self) -> ValueRange {
        ValueRange {
            lo: self.colors[0].value,
            hi: self.colors[self.colors.len() - 1].value,
        }
    }

    /// sRGB-encoded colour at a value; values beyond the ends clamp.
    pub fn srgb_at(&self, value: f64) -> [f64; 3] {
        let (a, b, t) = self.bracket(value, self.colors.len(), |i| self.colors[i].value);
        let (a, b) = (self.colors[a].srgb, self.colors[b].srgb);
        [0, 1, 2].map(|c| a[c] + t * (b[c] - a[c]))
    }

    /// Opacity per reference length at a value; values beyond the ends clamp.
    pub fn opacity_at(&self, value: f64) -> f64 {
        let (a, b, t) = self.bracket(value, self.opacities.len(), |i| self.opacities[i].value);
        let (a, b) = (self.opacities[a].opacity, self.opacities[b].opacity);
        a + t * (b - a)
    }

    /// Extinction per world length at a value.
    pub fn extinction_at(&self, value: f64) -> f64 {
        -(-self.opacity_at(value).min(MAX_OPACITY)).ln_1p() / self.unit_length
    }

    /// The two points around a value, among as many as `len` at `value_of`, and the fraction between
    /// them.
    fn bracket(
        &self,
        value: f64,
        len: usize,
        value_of: impl Fn(usize) -> f64,
    ) -> (usize, usize, f64) {
        let (mut after, mut end) = (0, len);
        while after < end {
            let middle = (after + end) / 2;
            if value_of(middle) <= value {
                after = middle + 1
            } else {
                end = middle
            }
        }
        if after == 0 {
            return (0, 0, 0.0);
        }
        if after == len {
            return (after - 1, after - 1, 0.0);
        }
        let (lo, hi) = (value_of(after - 1), value_of(after));
        let t = match self.scale {
            ValueScale::Linear => (value - lo) / (hi - lo),
            ValueScale::Log => (value / lo).ln() / (hi / lo).ln(),
        };
        (after - 1, after, t.clamp(0.0, 1.0))
    }
}

fn check(
    kind: &'static str,
    points: impl Iterator<Item = (f64, Vec<f64>)>,
) -> Result<(), TransferFunctionError> {
    let mut previous = f64::NEG_INFINITY;
    let mut any = false;
    for (index, (value, numbers)) in points.enumerate() {
        any = true;
        if !value.is_finite() || numbers.iter().any(|n| !n.is_finite()) {
            return Err(TransferFunctionError::NotFinite { kind, index });
        }
        if value < previous {
            return Err(TransferFunctionError::Decreasing {
                kind,
                index,
                value,
                previous,
            });
        }
        if let Some(&value) = numbers.iter().find(|n| !(0.0..=1.0).contains(*n)) {
            return Err(TransferFunctionError::OutOfUnit { kind, index, value });
        }
        previous = value;
    }
    if any {
        Ok(())
    } else {
        Err(TransferFunctionError::Empty(kind))
    }
}

/// sRGB to linear light, for one component in `0..=1` (IEC 61966-2-1).
pub fn linear_from_srgb(encoded: f64) -> f64 {
    if encoded <= 0.04045 {
        encoded / 12.92
    } else {
        ((encoded + 0.055) / 1.055).powf(2.4)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nonsense_is_refused() {
        let c = |value| ColorPoint {
            value,
            srgb: [0.5; 3],
        };
        let o = |value, opacity| OpacityPoint { value, opacity };
        let new = |c, o, u, s| TransferFunction::new(c, o, u, s).unwrap_err();
        use TransferFunctionError as E;
        let linear = ValueScale::Linear;
        assert_eq!(
            new(vec![], vec![o(0.0, 0.0)], 1.0, linear),
            E::Empty("colour")
        );
        assert!(matches!(
            new(vec![c(1.0), c(0.0)], vec![o(0.0, 0.0)], 1.0, linear),
            E::Decreasing { index: 1, .. }
        ));
        assert!(matches!(
            new(vec![c(1.0)], vec![o(0.0, 1.5)], 1.0, linear),
            E::OutOfUnit {
                kind: "opacity",
                ..
            }
        ));
        assert!(matches!(
            new(vec![c(1.0)], vec![o(f64::NAN, 0.5)], 1.0, linear),
            E::NotFinite { .. }
        ));
        assert_eq!(
            new(vec![c(1.0)], vec![o(1.0, 0.5)], 0.0, linear),
            E::UnitLength(0.0)
        );
        assert_eq!(
            new(vec![c(-1.0)], vec![o(1.0, 0.5)], 1.0, ValueScale::Log),
            E::LogOfNonPositive(-1.0)
        );
    }
}
