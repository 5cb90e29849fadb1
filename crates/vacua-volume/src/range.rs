//! Closed ranges of data values, and the map from stored values to those rendered.

use crate::scalar::ScalarType;

/// A closed range `lo..=hi` of data values, in data units. `lo <= hi`, both finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ValueRange {
    /// Smallest value.
    pub lo: f64,
    /// Largest value.
    pub hi: f64,
}

impl ValueRange {
    /// The smallest range that contains both.
    pub fn union(self, other: Self) -> Self {
        Self {
            lo: self.lo.min(other.lo),
            hi: self.hi.max(other.hi),
        }
    }

    /// `hi - lo`.
    pub fn width(self) -> f64 {
        self.hi - self.lo
    }
}

/// How stored values become the `f32` that rendering computes with: `(value − offset) · factor`.
///
/// The identity for types that `f32` holds exactly or nearly so. Values of wide types (`f64` and
/// integers of 32 and 64 bits) move to the middle of their range first, so that a small signal on
/// a large offset keeps its digits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ValueMap {
    /// Subtracted in `f64`.
    pub offset: f64,
    /// Multiplied after that.
    pub factor: f64,
}

impl ValueMap {
    /// Values as they are.
    pub const IDENTITY: Self = Self {
        offset: 0.0,
        factor: 1.0,
    };

    /// The map for a type whose finite values span `range`.
    pub fn for_range(scalar_type: ScalarType, range: ValueRange) -> Self {
        let half_width = 0.5 * range.hi - 0.5 * range.lo;
        let magnitude = range.lo.abs().max(range.hi.abs());
        let fits_f32 = match scalar_type {
            ScalarType::U8 | ScalarType::I8 | ScalarType::U16 | ScalarType::I16 => true,
            ScalarType::F32 => magnitude < f64::from(f32::MAX) / 4.0,
            _ => half_width == 0.0 && magnitude < f64::from(f32::MAX) / 4.0,
        };
        if fits_f32 {
            return Self::IDENTITY;
        }
        let factor = if half_width > 0.0 {
            half_width.recip()
        } else {
            1.0
        };
        let factor = if factor.is_finite() { factor } else { 1.0 };
        Self {
            offset: 0.5 * range.lo + 0.5 * range.hi,
            factor,
        }
    }

    /// Whether values stay as they are.
    pub fn is_identity(&self) -> bool {
        *self == Self::IDENTITY
    }

    /// A stored value as rendering sees it; subnormal numbers are 0 to it.
    #[inline(always)]
    pub fn rendered(&self, value: f64) -> f32 {
        let rendered = ((value - self.offset) * self.factor) as f32;
        if rendered.is_subnormal() {
            0.0
        } else {
            rendered
        }
    }

    /// The stored value that rendering sees as `rendered`.
    pub fn stored(&self, rendered: f32) -> f64 {
        f64::from(rendered) / self.factor + self.offset
    }
}
