//! Rows of unit values in parallel, converted to any number type.
//!
//! A procedural volume is a function into `0..=1`, evaluated row by row. Integers store it times
//! [`unit_scale`], so that every type spans its natural range; floats store it as it is.

use std::ops::Range;

use rayon::prelude::*;
use vacua_volume::{DataArray, Scalar, ScalarType, dispatch_scalar};

use crate::kind::SynthError;

/// What a unit value of 1 is stored as: the largest value of 8- and 16-bit integers, a million for
/// wider ones, 1 for floats.
pub fn unit_scale(scalar_type: ScalarType) -> f64 {
    match scalar_type {
        ScalarType::U8 => 255.0,
        ScalarType::I8 => 127.0,
        ScalarType::U16 => 65_535.0,
        ScalarType::I16 => 32_767.0,
        ScalarType::U32 | ScalarType::I32 | ScalarType::U64 | ScalarType::I64 => 1e6,
        ScalarType::F32 | ScalarType::F64 => 1.0,
    }
}

/// A volume as rows of unit values.
pub(crate) trait Rows: Sync {
    /// What the rows of one slice share.
    type Slice<'a>
    where
        Self: 'a;

    /// Prepares slice `z`.
    fn slice(&self, z: usize) -> Self::Slice<'_>;

    /// Evaluates row `y` of a slice into `row` and returns the part it wrote; the rest is zero,
    /// whatever `row` held before.
    fn row(&self, slice: &mut Self::Slice<'_>, y: usize, row: &mut [f32]) -> Range<usize>;
}

/// A number type that unit values convert to.
pub(crate) trait FromUnit: Scalar {
    /// A value in `0..=1` times [`unit_scale`], rounded to nearest for integers.
    fn from_unit(value: f32) -> Self;
}

macro_rules! impl_from_unit {
    ($($integer:ty => $scale:expr,)*) => {$(
        impl FromUnit for $integer {
            #[inline(always)]
            fn from_unit(value: f32) -> Self {
                (value * $scale + 0.5) as $integer
            }
        }
    )*};
}
impl_from_unit! {
    u8 => 255.0, i8 => 127.0, u16 => 65_535.0, i16 => 32_767.0,
    u32 => 1e6, i32 => 1e6, u64 => 1e6, i64 => 1e6,
}

impl FromUnit for f32 {
    #[inline(always)]
    fn from_unit(value: f32) -> Self {
        value
    }
}

impl FromUnit for f64 {
    #[inline(always)]
    fn from_unit(value: f32) -> Self {
        f64::from(value)
    }
}

/// Number of points, or an error if an array of them cannot be.
pub(crate) fn num_points(points: [usize; 3]) -> Result<usize, SynthError> {
    let too_large = SynthError::TooLarge { points };
    let [nx, ny, nz] = points;
    if nx < 2 || ny < 2 || nz < 2 {
        return Err(SynthError::TooSmall { points });
    }
    nx.checked_mul(ny)
        .and_then(|n| n.checked_mul(nz))
        .ok_or(too_large)
}

/// An array of zeros, or an error if there is no memory for it.
pub(crate) fn zeros<T: Scalar>(points: [usize; 3]) -> Result<Vec<T>, SynthError> {
    let n = num_points(points)?;
    bytemuck::allocation::try_zeroed_slice_box::<T>(n)
        .map(<[T]>::into_vec)
        .map_err(|()| SynthError::TooLarge { points })
}

/// Evaluates all rows in parallel into an array of the given type.
pub(crate) fn fill(
    points: [usize; 3],
    scalar_type: ScalarType,
    rows: &impl Rows,
) -> Result<DataArray, SynthError> {
    dispatch_scalar!(scalar_type, T => fill_typed::<T>(points, rows))
}

fn fill_typed<T: FromUnit>(points: [usize; 3], rows: &impl Rows) -> Result<DataArray, SynthError> {
    let [nx, ny, _] = points;
    let mut values = zeros::<T>(points)?;
    values.par_chunks_mut(nx * ny).enumerate().for_each_init(
        || vec![0.0f32; nx],
        |row, (z, slice_values)| {
            let mut slice = rows.slice(z);
            for (y, out) in slice_values.chunks_mut(nx).enumerate() {
                let span = rows.row(&mut slice, y, row);
                for (out, &value) in out[span.clone()].iter_mut().zip(&row[span]) {
                    *out = T::from_unit(value);
                }
            }
        },
    );
    Ok(DataArray::from_vec(values, 1)?)
}

/// Evaluates a function of the point index in `f64` into an array of the given type; integers
/// round to nearest and saturate.
pub(crate) fn fill_f64(
    points: [usize; 3],
    scalar_type: ScalarType,
    value: impl Fn([usize; 3]) -> f64 + Sync,
) -> Result<DataArray, SynthError> {
    let [nx, ny, _] = points;
    dispatch_scalar!(scalar_type, T => {
        let mut values = zeros::<T>(points)?;
        values.par_chunks_mut(nx).enumerate().for_each(|(row, out)| {
            let (y, z) = (row % ny, row / ny);
            for (x, out) in out.iter_mut().enumerate() {
                *out = <T as Scalar>::from_f64(value([x, y, z]));
            }
        });
        Ok(DataArray::from_vec(values, 1)?)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unit_is_the_scale_of_its_type() {
        for scalar_type in ScalarType::ALL {
            let one = dispatch_scalar!(scalar_type, T => T::from_unit(1.0).to_f64());
            assert_eq!(one, unit_scale(scalar_type), "{scalar_type}");
            let none = dispatch_scalar!(scalar_type, T => T::from_unit(0.0).to_f64());
            assert_eq!(none, 0.0);
        }
        assert_eq!(u8::from_unit(0.501), 128);
    }

    #[test]
    fn impossible_sizes_are_errors() {
        let huge = [usize::MAX / 2, 2, 2];
        assert!(matches!(
            zeros::<u8>(huge),
            Err(SynthError::TooLarge { .. })
        ));
        let large = [1 << 20, 1 << 20, 1 << 19];
        assert!(matches!(
            zeros::<u8>(large),
            Err(SynthError::TooLarge { .. })
        ));
        assert!(matches!(
            zeros::<u8>([1, 9, 9]),
            Err(SynthError::TooSmall { .. })
        ));
    }
}
