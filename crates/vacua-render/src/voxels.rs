//! The numbers of a grid as they lie in memory.

use vacua_simd::PlainF32;
use vacua_volume::{DataArray, ScalarType};

/// Values in their native type. Samplers choose among the types at each fetch of a whole cell: the
/// branch is always the same one, and the kernels are compiled once instead of ten times.
#[derive(Clone, Copy)]
pub(crate) enum Voxels<'a> {
    U8(&'a [u8]),
    I8(&'a [i8]),
    U16(&'a [u16]),
    I16(&'a [i16]),
    U32(&'a [u32]),
    I32(&'a [i32]),
    U64(&'a [u64]),
    I64(&'a [i64]),
    F32(&'a [f32]),
    /// See [`Voxels::plain`].
    PlainF32(&'a [PlainF32]),
    F64(&'a [f64]),
}

/// Runs an expression with `$values` bound to the typed slice.
macro_rules! with_voxels {
    ($voxels:expr, $values:ident => $body:expr) => {
        match $voxels {
            Voxels::U8($values) => $body,
            Voxels::I8($values) => $body,
            Voxels::U16($values) => $body,
            Voxels::I16($values) => $body,
            Voxels::U32($values) => $body,
            Voxels::I32($values) => $body,
            Voxels::U64($values) => $body,
            Voxels::I64($values) => $body,
            Voxels::F32($values) => $body,
            Voxels::PlainF32($values) => $body,
            Voxels::F64($values) => $body,
        }
    };
}
pub(crate) use with_voxels;

impl<'a> Voxels<'a> {
    /// The numbers of an array whose `f32` are known to be plain, to be read through a
    /// [`Lift`](crate::lift::Lift).
    pub fn plain(array: &'a DataArray) -> Self {
        match Self::of(array) {
            Self::F32(values) => Self::PlainF32(PlainF32::of(values)),
            other => other,
        }
    }

    /// The numbers of an array.
    pub fn of(array: &'a DataArray) -> Self {
        let bytes = array.bytes();
        match array.scalar_type() {
            ScalarType::U8 => Self::U8(bytemuck::cast_slice(bytes)),
            ScalarType::I8 => Self::I8(bytemuck::cast_slice(bytes)),
            ScalarType::U16 => Self::U16(bytemuck::cast_slice(bytes)),
            ScalarType::I16 => Self::I16(bytemuck::cast_slice(bytes)),
            ScalarType::U32 => Self::U32(bytemuck::cast_slice(bytes)),
            ScalarType::I32 => Self::I32(bytemuck::cast_slice(bytes)),
            ScalarType::U64 => Self::U64(bytemuck::cast_slice(bytes)),
            ScalarType::I64 => Self::I64(bytemuck::cast_slice(bytes)),
            ScalarType::F32 => Self::F32(bytemuck::cast_slice(bytes)),
            ScalarType::F64 => Self::F64(bytemuck::cast_slice(bytes)),
        }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        with_voxels!(self, values => values.len())
    }
}
