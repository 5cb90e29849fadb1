//! Sixteen lanes of `f32`: two blocks of eight consecutive samples of a ray in one vector.
//!
//! Kernels are written once, generic over [`Simd`], and run through [`dispatch()`], which picks the
//! widest instruction set of the machine at run time. All operations are IEEE 754 operations with
//! one rounding (fused multiply-add included), so every instruction set computes the same bits;
//! the tests compare them. [`Portable`] is the scalar twin: plain arrays, on every machine.
//!
//! The whole of vacua's `unsafe` vector code is in `avx512`, `avx2` and the gathers; what a gather's
//! caller must guarantee is that indices lie within the slice.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod dispatch;
pub mod math;
mod portable;

use std::fmt::Debug;
use std::ops::{Add, BitAnd, BitOr, Mul, Not, Sub};

pub use dispatch::{Kernel, Level, dispatch, dispatch_at};
pub use portable::Portable;

/// Lanes in a vector.
pub const LANES: usize = 16;

/// Samples in a block of the rendering contract; a vector holds two blocks.
pub const BLOCK: usize = 8;

/// Number of each lane within its block.
pub const IN_BLOCK: [f32; LANES] = [
    0., 1., 2., 3., 4., 5., 6., 7., 0., 1., 2., 3., 4., 5., 6., 7.,
];

/// An array of three, one expression an axis: `per_axis!(a => position[a] + step[a])`.
///
/// Vector code uses this instead of `[0, 1, 2].map(|a| …)`: the closure that `map` takes, and `map`
/// itself, are functions without the features of the instruction set, and when they are not inlined
/// every operation in them becomes a call.
#[macro_export]
macro_rules! per_axis {
    ($a:ident => $body:expr) => {
        [
            {
                let $a = 0usize;
                $body
            },
            {
                let $a = 1usize;
                $body
            },
            {
                let $a = 2usize;
                $body
            },
        ]
    };
}

/// How values of wide types become `f32`: `((value − offset) · factor) as f32`, in `f64`.
#[derive(Clone, Copy, Debug)]
pub struct WideMap {
    /// Subtracted first.
    pub offset: f64,
    /// Multiplied then.
    pub factor: f64,
}

/// An instruction set: vector types and the operations that are no methods of theirs.
pub trait Simd: Copy + Debug + 'static {
    /// Sixteen `f32`.
    type F: Float<M = Self::M, I = Self::I>;
    /// Sixteen `i32`, wrapping.
    type I: Int<M = Self::M>;
    /// Sixteen booleans.
    type M: Mask;
    /// Sixteen element offsets of 64 bits.
    type Offsets: Copy;

    /// `f32` nearest to each integer.
    fn f_from_i(a: Self::I) -> Self::F;
    /// Reinterprets the bits.
    fn f_from_bits(a: Self::I) -> Self::F;
    /// `high · stride + low` with `high` and `low` taken as non-negative, in 64 bits.
    fn offsets(high: Self::I, stride: u32, low: Self::I) -> Self::Offsets;

    /// `slice[i]` a lane.
    ///
    /// # Safety
    /// Every index lies within the slice.
    unsafe fn gather(slice: &[f32], index: Self::I) -> Self::F;
    /// `slice[i]` and `slice[i + 1]` a lane.
    ///
    /// # Safety
    /// Every index is at least 0 and at most `slice.len() − 2`.
    unsafe fn gather_pair(slice: &[f32], index: Self::I) -> (Self::F, Self::F);
    /// `slice[i]` a lane.
    ///
    /// # Safety
    /// Every index lies within the slice.
    unsafe fn gather_u32(slice: &[u32], index: Self::I) -> Self::I;

    /// `rows[i]` and `rows[i + 1]` a lane, column by column.
    ///
    /// # Safety
    /// Every index is at least 0 and at most `rows.len() − 2`.
    unsafe fn gather_rows(rows: &[[f32; 4]], index: Self::I) -> [[Self::F; 4]; 2];

    /// Three coordinates a lane, axis by axis, of the points with these numbers. A number past the end
    /// stands for the last point; without any point all is 0.
    fn gather_points(points: &[[f32; 3]], index: &[u32; LANES]) -> [Self::F; 3];
    /// Values with these numbers as rendering sees them (see [`Voxel::rendered`]), NaN for a number
    /// past the end.
    #[inline(always)]
    fn gather_values(values: &[f32], index: &[u32; LANES]) -> Self::F {
        let mut found = [f32::NAN; LANES];
        for lane in 0..LANES {
            if let Some(value) = values.get(index[lane] as usize) {
                found[lane] = value.rendered(None);
            }
        }
        Self::F::from_array(found)
    }
    /// The lower halves of eight bytes in the lanes of the first block, their upper halves in those of
    /// the second.
    fn nibbles(bytes: [u8; BLOCK]) -> Self::I;
    /// Bit `i` of 1024 a lane: `bits[i / 32] >> i % 32 & 1`, with `i` modulo 1024.
    fn bit_of_1024(bits: &[u32; 32], index: Self::I) -> Self::M;

    /// Voxels `base[o]` and `base[o + 1]` a lane, as `f32`; `base` is `voxels` from element `from`.
    ///
    /// # Safety
    /// For every lane `from + o + 1 < voxels.len()`, and there are at least 4 voxels.
    unsafe fn voxel_pair<T: Voxel>(
        voxels: &[T],
        from: usize,
        offsets: Self::Offsets,
        map: Option<WideMap>,
    ) -> (Self::F, Self::F);
    /// As [`Simd::voxel_pair`] with offsets of 32 bits.
    ///
    /// # Safety
    /// As [`Simd::voxel_pair`], and offsets are not negative.
    unsafe fn voxel_pair_32<T: Voxel>(
        voxels: &[T],
        from: usize,
        offsets: Self::I,
        map: Option<WideMap>,
    ) -> (Self::F, Self::F);
    /// One voxel `voxels[o]` a lane, as `f32`; lanes without their bit in `mask` give 0.
    ///
    /// # Safety
    /// For every lane of the mask `o < voxels.len()`.
    unsafe fn voxel<T: Voxel>(
        voxels: &[T],
        offsets: Self::Offsets,
        mask: Self::M,
        map: Option<WideMap>,
    ) -> Self::F;
}

/// Asks for the cache line of an element that will be read soon; nothing if there is no such element.
#[inline(always)]
pub fn prefetch<T>(slice: &[T], index: usize) {
    #[cfg(target_arch = "x86_64")]
    if let Some(element) = slice.get(index) {
        let first = std::ptr::from_ref(element).cast::<i8>();
        // SAFETY: prefetching has no effect but on caches, and SSE is part of x86-64.
        unsafe {
            use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
            _mm_prefetch::<_MM_HINT_T0>(first);
            // An element longer than its alignment may end in the next line.
            if size_of::<T>() > align_of::<T>() {
                _mm_prefetch::<_MM_HINT_T0>(first.wrapping_add(size_of::<T>() - 1));
            }
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (slice, index);
}

/// How a number lies in memory, which decides how it is gathered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VoxelKind {
    /// `u8`
    U8,
    /// `i8`
    I8,
    /// `u16`
    U16,
    /// `i16`
    I16,
    /// `u32`
    U32,
    /// `i32`
    I32,
    /// `u64`
    U64,
    /// `i64`
    I64,
    /// `f32`
    F32,
    /// [`PlainF32`]
    PlainF32,
    /// `f64`
    F64,
}

/// A number type that can be gathered.
pub trait Voxel: Copy + Send + Sync + 'static {
    /// Its layout.
    const KIND: VoxelKind;
    /// The value as `f64`.
    fn wide(self) -> f64;
    /// The value as `f32`, rounded once from the exact value; subnormal `f32` read as 0, as
    /// arithmetic on them is a hundred times slower.
    fn narrow(self) -> f32;

    /// The value as rendering sees it.
    #[inline(always)]
    fn rendered(self, map: Option<WideMap>) -> f32 {
        match map {
            None => self.narrow(),
            Some(map) => ((self.wide() - map.offset) * map.factor) as f32,
        }
    }
}

macro_rules! impl_voxel {
    ($($t:ty => $kind:ident),*) => {$(
        impl Voxel for $t {
            const KIND: VoxelKind = VoxelKind::$kind;
            #[inline(always)]
            fn wide(self) -> f64 { self as f64 }
            #[inline(always)]
            fn narrow(self) -> f32 {
                let value = self as f32;
                let flush = matches!(VoxelKind::$kind, VoxelKind::F32) && value.is_subnormal();
                if flush { 0.0 } else { value }
            }
        }
    )*};
}
impl_voxel!(u8 => U8, i8 => I8, u16 => U16, i16 => I16, u32 => U32, i32 => I32, u64 => U64,
    i64 => I64, f32 => F32, f64 => F64);

/// An `f32` that is fetched as it is: subnormal numbers are not looked for.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub struct PlainF32(f32);

impl PlainF32 {
    /// Numbers of which the caller keeps subnormal ones out of the way; nothing worse comes of them than
    /// that they count for what they are, slowly.
    pub fn of(values: &[f32]) -> &[Self] {
        // SAFETY: the same layout, by `repr(transparent)`.
        unsafe { std::slice::from_raw_parts(values.as_ptr().cast(), values.len()) }
    }
}

impl Voxel for PlainF32 {
    const KIND: VoxelKind = VoxelKind::PlainF32;
    #[inline(always)]
    fn wide(self) -> f64 {
        self.0.into()
    }
    #[inline(always)]
    fn narrow(self) -> f32 {
        self.0
    }
}

/// Sixteen `f32`.
pub trait Float:
    Copy + Debug + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self>
{
    /// Masks of this instruction set.
    type M: Mask;
    /// Integers of this instruction set.
    type I: Int;

    /// The same number in every lane.
    fn splat(value: f32) -> Self;
    /// From an array, lane 0 first.
    fn from_array(values: [f32; LANES]) -> Self;
    /// To an array, lane 0 first.
    fn to_array(self) -> [f32; LANES];
    /// `self · b + c` with one rounding.
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// The smaller; `b` if either is NaN.
    fn min(self, b: Self) -> Self;
    /// The larger; `b` if either is NaN.
    fn max(self, b: Self) -> Self;
    /// Rounds down.
    fn floor(self) -> Self;
    /// Rounds to the nearest integer, ties to even.
    fn round(self) -> Self;
    /// What truncation takes away, exactly: `self − trunc(self)`, for numbers below 2³¹ in size.
    fn fraction(self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// Square root, correctly rounded.
    fn sqrt(self) -> Self;
    /// Quotient, correctly rounded.
    fn div(self, b: Self) -> Self;
    /// Truncates to integers; lanes that are no `i32` give one that as unsigned exceeds 2³¹ − 2,
    /// NaN any.
    fn to_i(self) -> Self::I;
    /// Reinterprets the bits.
    fn to_bits(self) -> Self::I;
    /// `self < b`, false for NaN.
    fn lt(self, b: Self) -> Self::M;
    /// `self <= b`, false for NaN.
    fn le(self, b: Self) -> Self::M;
    /// `self` where the mask is set, else `other`.
    fn select(self, mask: Self::M, other: Self) -> Self;
    /// `self` where the mask is set, else 0.
    #[inline(always)]
    fn or_zero(self, mask: Self::M) -> Self {
        self.select(mask, Self::splat(0.0))
    }
    /// Products of all lanes before each within its block of [`BLOCK`] lanes (1 for the first), and
    /// the product of each whole block. The order of multiplication is fixed.
    fn block_products(self) -> (Self, [f32; 2]);
    /// The two blocks.
    fn blocks(self) -> [[f32; BLOCK]; 2];
    /// `first` in the lanes of the first block, `second` in those of the second.
    fn of_blocks(first: f32, second: f32) -> Self;
    /// The lowest of all lanes, none of which may be NaN; which of two zeros is not said.
    fn lowest(self) -> f32;
    /// The highest of all lanes, none of which may be NaN; which of two zeros is not said.
    fn highest(self) -> f32;
    /// `self[index]` a lane; of an index only the lowest four bits count.
    fn permute(self, index: Self::I) -> Self;
    /// The lanes of a mask, moved to the front in their order; what comes after them is not said.
    fn compress(self, mask: Self::M) -> Self;
    /// Adds the first block, then the second, to sums.
    fn add_blocks_to(self, sums: &mut [f32; BLOCK]);
}

/// Sixteen `i32`, wrapping.
pub trait Int: Copy + Debug + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// Masks of this instruction set.
    type M: Mask;

    /// The same number in every lane.
    fn splat(value: i32) -> Self;
    /// From an array, lane 0 first.
    fn from_array(values: [i32; LANES]) -> Self;
    /// To an array, lane 0 first.
    fn to_array(self) -> [i32; LANES];
    /// The smaller, signed.
    fn min(self, b: Self) -> Self;
    /// The larger, signed.
    fn max(self, b: Self) -> Self;
    /// The smaller, both taken as unsigned: limits an index to `b` whatever it is.
    fn min_unsigned(self, b: Self) -> Self;
    /// Bitwise and.
    fn and(self, b: Self) -> Self;
    /// Logical shift left by a constant.
    fn shl<const N: u32>(self) -> Self;
    /// Logical shift right by a number a lane, each in `0..32`.
    fn shr(self, by: Self) -> Self;
    /// `self < b`, signed.
    fn lt(self, b: Self) -> Self::M;
    /// `self == b`.
    fn eq(self, b: Self) -> Self::M;
    /// `self <= b`, both taken as unsigned.
    #[inline(always)]
    fn le_unsigned(self, b: Self) -> Self::M {
        self.min_unsigned(b).eq(self)
    }
    /// Whether any bit is set in both.
    #[inline(always)]
    fn shares_bits(self, b: Self) -> Self::M {
        !self.and(b).eq(Self::splat(0))
    }
    /// `self` where the mask is set, else 0.
    fn or_zero(self, mask: Self::M) -> Self;
}

/// Sixteen booleans.
pub trait Mask:
    Copy + Debug + BitAnd<Output = Self> + BitOr<Output = Self> + Not<Output = Self>
{
    /// Lane `i` is bit `i`.
    fn from_bits(bits: u16) -> Self;
    /// Lane `i` is bit `i`.
    fn to_bits(self) -> u16;
    /// Whether any lane is set.
    #[inline(always)]
    fn any(self) -> bool {
        self.to_bits() != 0
    }
    /// Whether all lanes are set.
    #[inline(always)]
    fn all(self) -> bool {
        self.to_bits() == u16::MAX
    }
}
