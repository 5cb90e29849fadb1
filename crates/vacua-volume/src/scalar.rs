//! The ten numeric types a voxel may have, and how code is written once for all of them.

use std::fmt;
use std::str::FromStr;

/// The type of one stored number, in native byte order once it is in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum ScalarType {
    /// Unsigned 8-bit integer.
    U8,
    /// Signed 8-bit integer.
    I8,
    /// Unsigned 16-bit integer.
    U16,
    /// Signed 16-bit integer.
    I16,
    /// Unsigned 32-bit integer.
    U32,
    /// Signed 32-bit integer.
    I32,
    /// Unsigned 64-bit integer.
    U64,
    /// Signed 64-bit integer.
    I64,
    /// IEEE 754 single precision.
    F32,
    /// IEEE 754 double precision.
    F64,
}

impl ScalarType {
    /// Every scalar type, in declaration order.
    pub const ALL: [Self; 10] = [
        Self::U8,
        Self::I8,
        Self::U16,
        Self::I16,
        Self::U32,
        Self::I32,
        Self::U64,
        Self::I64,
        Self::F32,
        Self::F64,
    ];

    /// Size of one number in bytes.
    pub const fn size_bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }

    /// The short Rust name: `u8` … `f64`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::U8 => "u8",
            Self::I8 => "i8",
            Self::U16 => "u16",
            Self::I16 => "i16",
            Self::U32 => "u32",
            Self::I32 => "i32",
            Self::U64 => "u64",
            Self::I64 => "i64",
            Self::F32 => "f32",
            Self::F64 => "f64",
        }
    }
}

impl fmt::Display for ScalarType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A name that is none of the ten scalar types.
#[derive(Clone, Debug, thiserror::Error, PartialEq, Eq)]
#[error("unknown number type `{0}`, expected one of u8 i8 u16 i16 u32 i32 u64 i64 f32 f64")]
pub struct UnknownScalarType(pub String);

impl FromStr for ScalarType {
    type Err = UnknownScalarType;

    /// Reads the short names and the spellings of the Open SciVis data sets (`uint8`, `float32` …).
    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Ok(match name.to_ascii_lowercase().as_str() {
            "u8" | "uint8" | "uchar" | "ubyte" => Self::U8,
            "i8" | "int8" | "char" | "byte" => Self::I8,
            "u16" | "uint16" | "ushort" => Self::U16,
            "i16" | "int16" | "short" => Self::I16,
            "u32" | "uint32" | "uint" => Self::U32,
            "i32" | "int32" | "int" => Self::I32,
            "u64" | "uint64" | "ulong" => Self::U64,
            "i64" | "int64" | "long" => Self::I64,
            "f32" | "float32" | "float" => Self::F32,
            "f64" | "float64" | "double" => Self::F64,
            _ => return Err(UnknownScalarType(name.to_owned())),
        })
    }
}

mod sealed {
    pub trait Sealed {}
}

/// A Rust number type that a field may be stored in. Sealed: exactly the ten of [`ScalarType`].
pub trait Scalar: bytemuck::Pod + PartialOrd + Send + Sync + sealed::Sealed + fmt::Debug {
    /// The tag of this type.
    const TYPE: ScalarType;
    /// The value as `f64`; 64-bit integers round to nearest.
    fn to_f64(self) -> f64;
    /// The `f64` nearest to a value of this type: rounded for integers, saturating at the ends.
    fn from_f64(value: f64) -> Self;
    /// Whether the value is finite.
    fn is_finite(self) -> bool;
    /// Whether the value is finite and of a size that differences of two are so too; for `f64`, which
    /// are narrowed, also not too small unless 0; always, for integers.
    fn is_plain(self) -> bool;
}

/// Largest size of plain floating-point numbers; the smallest of an `f64` is one over it.
const PLAIN: f32 = 1e37;

macro_rules! impl_scalar {
    ($($t:ty => $tag:ident, $from:expr, $finite:expr, $plain:expr;)*) => {$(
        impl sealed::Sealed for $t {}
        impl Scalar for $t {
            const TYPE: ScalarType = ScalarType::$tag;
            #[inline(always)]
            fn to_f64(self) -> f64 { self as f64 }
            #[inline(always)]
            fn from_f64(value: f64) -> Self { let f: fn(f64) -> $t = $from; f(value) }
            #[inline(always)]
            fn is_finite(self) -> bool { let f: fn($t) -> bool = $finite; f(self) }
            #[inline(always)]
            fn is_plain(self) -> bool { let f: fn($t) -> bool = $plain; f(self) }
        }
    )*};
}
impl_scalar! {
    u8 => U8, |v| v.round() as u8, |_| true, |_| true;
    i8 => I8, |v| v.round() as i8, |_| true, |_| true;
    u16 => U16, |v| v.round() as u16, |_| true, |_| true;
    i16 => I16, |v| v.round() as i16, |_| true, |_| true;
    u32 => U32, |v| v.round() as u32, |_| true, |_| true;
    i32 => I32, |v| v.round() as i32, |_| true, |_| true;
    u64 => U64, |v| v.round() as u64, |_| true, |_| true;
    i64 => I64, |v| v.round() as i64, |_| true, |_| true;
    f32 => F32, |v| v as f32, f32::is_finite,
        |v| v.abs() <= PLAIN;
    f64 => F64, |v| v, f64::is_finite,
        |v| v == 0.0 || (f64::from(1.0 / PLAIN)..=f64::from(PLAIN)).contains(&v.abs());
}

/// Runs an expression with `$T` bound to the Rust type of a [`ScalarType`].
///
/// ```
/// use vacua_volume::{ScalarType, dispatch_scalar};
/// let size = dispatch_scalar!(ScalarType::U16, T => std::mem::size_of::<T>());
/// assert_eq!(size, 2);
/// ```
#[macro_export]
macro_rules! dispatch_scalar {
    ($scalar_type:expr, $T:ident => $body:expr) => {
        match $scalar_type {
            $crate::ScalarType::U8 => {
                type $T = u8;
                $body
            }
            $crate::ScalarType::I8 => {
                type $T = i8;
                $body
            }
            $crate::ScalarType::U16 => {
                type $T = u16;
                $body
            }
            $crate::ScalarType::I16 => {
                type $T = i16;
                $body
            }
            $crate::ScalarType::U32 => {
                type $T = u32;
                $body
            }
            $crate::ScalarType::I32 => {
                type $T = i32;
                $body
            }
            $crate::ScalarType::U64 => {
                type $T = u64;
                $body
            }
            $crate::ScalarType::I64 => {
                type $T = i64;
                $body
            }
            $crate::ScalarType::F32 => {
                type $T = f32;
                $body
            }
            $crate::ScalarType::F64 => {
                type $T = f64;
                $body
            }
        }
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_round_trip() {
        for scalar_type in ScalarType::ALL {
            assert_eq!(scalar_type.name().parse(), Ok(scalar_type));
            let size = dispatch_scalar!(scalar_type, T => size_of::<T>());
            assert_eq!(size, scalar_type.size_bytes());
            let tag = dispatch_scalar!(scalar_type, T => <T as Scalar>::TYPE);
            assert_eq!(tag, scalar_type);
        }
        assert!("float16".parse::<ScalarType>().is_err());
    }

    #[test]
    fn from_f64_rounds_and_saturates() {
        assert_eq!(u8::from_f64(254.6), 255);
        assert_eq!(u8::from_f64(-3.0), 0);
        assert_eq!(i16::from_f64(1e9), i16::MAX);
        assert_eq!(f32::from_f64(0.1), 0.1f32);
    }
}
