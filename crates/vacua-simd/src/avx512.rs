//! AVX-512: one register a vector.
//!
//! Every method here is `#[inline(always)]` and calls intrinsics that need AVX-512 F, BW, DQ or VL.
//! The only way to run code on this type is [`crate::dispatch_at`], which checks for them first:
//! that is the safety argument of each `unsafe` block below that has no argument of its own.
//!
//! Gathers fetch *pairs*: the two voxels that trilinear interpolation needs along x lie side by
//! side, so one 64-bit element (two `f32`) or one 32-bit element (two to four small integers)
//! brings both, and a trilinear cell takes 4 gathers of 16 lanes instead of 8.

use std::arch::x86_64::*;
use std::ops::{Add, BitAnd, BitOr, Mul, Not, Sub};

use crate::{BLOCK, Float, Int, LANES, Mask, Simd, Voxel, VoxelKind, WideMap};

/// AVX-512 F, BW, DQ and VL.
#[derive(Clone, Copy, Debug)]
pub struct Avx512;

/// Sixteen `f32`.
#[derive(Clone, Copy, Debug)]
pub struct F(__m512);
/// Sixteen `i32`.
#[derive(Clone, Copy, Debug)]
pub struct I(__m512i);
/// A mask register.
#[derive(Clone, Copy, Debug)]
pub struct M(__mmask16);

/// Evaluates intrinsics under the safety argument of the module.
macro_rules! simd {
    ($($body:tt)*) => {{
        // SAFETY: values of these types exist only below `dispatch_at`, which found the features.
        #[allow(unused_unsafe, reason = "some intrinsics are safe, depending on the toolchain")]
        unsafe { $($body)* }
    }};
}

macro_rules! operator {
    ($vector:ident, $trait:ident, $method:ident, $intrinsic:ident) => {
        impl $trait for $vector {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(simd!($intrinsic(self.0, other.0)))
            }
        }
    };
}
operator!(F, Add, add, _mm512_add_ps);
operator!(F, Sub, sub, _mm512_sub_ps);
operator!(F, Mul, mul, _mm512_mul_ps);
operator!(I, Add, add, _mm512_add_epi32);
operator!(I, Sub, sub, _mm512_sub_epi32);
operator!(I, Mul, mul, _mm512_mullo_epi32);

impl BitAnd for M {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }
}
impl BitOr for M {
    type Output = Self;
    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}
impl Not for M {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(!self.0)
    }
}
impl Mask for M {
    #[inline(always)]
    fn from_bits(bits: u16) -> Self {
        Self(bits)
    }
    #[inline(always)]
    fn to_bits(self) -> u16 {
        self.0
    }
}

impl Float for F {
    type M = M;
    type I = I;

    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self(simd!(_mm512_set1_ps(value)))
    }
    #[inline(always)]
    fn from_array(values: [f32; LANES]) -> Self {
        Self(simd!(_mm512_loadu_ps(values.as_ptr())))
    }
    #[inline(always)]
    fn to_array(self) -> [f32; LANES] {
        let mut values = [0.0; LANES];
        simd!(_mm512_storeu_ps(values.as_mut_ptr(), self.0));
        values
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        Self(simd!(_mm512_fmadd_ps(self.0, b.0, c.0)))
    }
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        Self(simd!(_mm512_min_ps(self.0, b.0)))
    }
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        Self(simd!(_mm512_max_ps(self.0, b.0)))
    }
    #[inline(always)]
    fn floor(self) -> Self {
        Self(simd!(_mm512_roundscale_ps::<
            { _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC },
        >(self.0)))
    }
    #[inline(always)]
    fn fraction(self) -> Self {
        Self(simd!(_mm512_reduce_ps::<
            { _MM_FROUND_TO_ZERO | _MM_FROUND_NO_EXC },
        >(self.0)))
    }
    #[inline(always)]
    fn round(self) -> Self {
        Self(simd!(_mm512_roundscale_ps::<
            { _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC },
        >(self.0)))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(simd!(_mm512_abs_ps(self.0)))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(simd!(_mm512_sqrt_ps(self.0)))
    }
    #[inline(always)]
    fn div(self, b: Self) -> Self {
        Self(simd!(_mm512_div_ps(self.0, b.0)))
    }
    #[inline(always)]
    fn to_i(self) -> I {
        I(simd!(_mm512_cvttps_epi32(self.0)))
    }
    #[inline(always)]
    fn to_bits(self) -> I {
        I(simd!(_mm512_castps_si512(self.0)))
    }
    #[inline(always)]
    fn lt(self, b: Self) -> M {
        M(simd!(_mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, b.0)))
    }
    #[inline(always)]
    fn le(self, b: Self) -> M {
        M(simd!(_mm512_cmp_ps_mask::<_CMP_LE_OQ>(self.0, b.0)))
    }
    #[inline(always)]
    fn select(self, mask: M, other: Self) -> Self {
        Self(simd!(_mm512_mask_blend_ps(mask.0, other.0, self.0)))
    }
    #[inline(always)]
    fn or_zero(self, mask: M) -> Self {
        Self(simd!(_mm512_maskz_mov_ps(mask.0, self.0)))
    }
    #[inline(always)]
    fn block_products(self) -> (Self, [f32; 2]) {
        simd! {
            let one = _mm512_set1_ps(1.0);
            let by_1 = _mm512_setr_epi32(0, 0, 1, 2, 3, 4, 5, 6, 8, 8, 9, 10, 11, 12, 13, 14);
            let by_2 = _mm512_setr_epi32(0, 0, 0, 1, 2, 3, 4, 5, 8, 8, 8, 9, 10, 11, 12, 13);
            let by_4 = _mm512_setr_epi32(0, 0, 0, 0, 0, 1, 2, 3, 8, 8, 8, 8, 8, 9, 10, 11);
            let mut p = self.0;
            p = _mm512_mask_mul_ps(p, 0xfefe, p, _mm512_permutexvar_ps(by_1, p));
            p = _mm512_mask_mul_ps(p, 0xfcfc, p, _mm512_permutexvar_ps(by_2, p));
            p = _mm512_mask_mul_ps(p, 0xf0f0, p, _mm512_permutexvar_ps(by_4, p));
            let exclusive = _mm512_mask_permutexvar_ps(one, 0xfefe, by_1, p);
            let last = _mm512_setr_epi32(7, 15, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0);
            let ends = _mm512_castps512_ps128(_mm512_permutexvar_ps(last, p));
            let second = _mm_cvtss_f32(_mm_movehdup_ps(ends));
            (Self(exclusive), [_mm_cvtss_f32(ends), second])
        }
    }
    #[inline(always)]
    fn blocks(self) -> [[f32; BLOCK]; 2] {
        let mut blocks = [[0.0; BLOCK]; 2];
        simd! {
            _mm256_storeu_ps(blocks[0].as_mut_ptr(), _mm512_castps512_ps256(self.0));
            _mm256_storeu_ps(blocks[1].as_mut_ptr(), _mm512_extractf32x8_ps::<1>(self.0));
        }
        blocks
    }
    #[inline(always)]
    fn of_blocks(first: f32, second: f32) -> Self {
        let (first, second) = (Self::splat(first), Self::splat(second));
        second.select(M(0xff00), first)
    }
    #[inline(always)]
    fn lowest(self) -> f32 {
        simd!(_mm512_reduce_min_ps(self.0))
    }
    #[inline(always)]
    fn highest(self) -> f32 {
        simd!(_mm512_reduce_max_ps(self.0))
    }
    #[inline(always)]
    fn permute(self, index: I) -> Self {
        Self(simd!(_mm512_permutexvar_ps(index.0, self.0)))
    }
    #[inline(always)]
    fn compress(self, mask: M) -> Self {
        Self(simd!(_mm512_maskz_compress_ps(mask.0, self.0)))
    }
    #[inline(always)]
    fn add_blocks_to(self, sums: &mut [f32; BLOCK]) {
        simd! {
            let sum = _mm256_loadu_ps(sums.as_ptr());
            let sum = _mm256_add_ps(sum, _mm512_castps512_ps256(self.0));
            let sum = _mm256_add_ps(sum, _mm512_extractf32x8_ps::<1>(self.0));
            _mm256_storeu_ps(sums.as_mut_ptr(), sum);
        }
    }
}

impl Int for I {
    type M = M;

    #[inline(always)]
    fn splat(value: i32) -> Self {
        Self(simd!(_mm512_set1_epi32(value)))
    }
    #[inline(always)]
    fn from_array(values: [i32; LANES]) -> Self {
        Self(simd!(_mm512_loadu_si512(values.as_ptr().cast())))
    }
    #[inline(always)]
    fn to_array(self) -> [i32; LANES] {
        let mut values = [0; LANES];
        simd!(_mm512_storeu_si512(values.as_mut_ptr().cast(), self.0));
        values
    }
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        Self(simd!(_mm512_min_epi32(self.0, b.0)))
    }
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        Self(simd!(_mm512_max_epi32(self.0, b.0)))
    }
    #[inline(always)]
    fn min_unsigned(self, b: Self) -> Self {
        Self(simd!(_mm512_min_epu32(self.0, b.0)))
    }
    #[inline(always)]
    fn and(self, b: Self) -> Self {
        Self(simd!(_mm512_and_si512(self.0, b.0)))
    }
    #[inline(always)]
    fn shl<const N: u32>(self) -> Self {
        Self(simd!(_mm512_slli_epi32::<N>(self.0)))
    }
    #[inline(always)]
    fn shr(self, by: Self) -> Self {
        Self(simd!(_mm512_srlv_epi32(self.0, by.0)))
    }
    #[inline(always)]
    fn lt(self, b: Self) -> M {
        M(simd!(_mm512_cmplt_epi32_mask(self.0, b.0)))
    }
    #[inline(always)]
    fn eq(self, b: Self) -> M {
        M(simd!(_mm512_cmpeq_epi32_mask(self.0, b.0)))
    }
    #[inline(always)]
    fn le_unsigned(self, b: Self) -> M {
        M(simd!(_mm512_cmple_epu32_mask(self.0, b.0)))
    }
    #[inline(always)]
    fn shares_bits(self, b: Self) -> M {
        M(simd!(_mm512_test_epi32_mask(self.0, b.0)))
    }
    #[inline(always)]
    fn or_zero(self, mask: M) -> Self {
        Self(simd!(_mm512_maskz_mov_epi32(mask.0, self.0)))
    }
}

/// Lower eight lanes.
#[inline(always)]
fn low(v: __m512i) -> __m256i {
    simd!(_mm512_castsi512_si256(v))
}

/// Upper eight lanes.
#[inline(always)]
fn high(v: __m512i) -> __m256i {
    simd!(_mm512_extracti64x4_epi64::<1>(v))
}

/// [`Simd::gather_points`] where the last point, or none, is among them.
#[cold]
fn clamped_points(points: &[[f32; 3]], index: &[u32; LANES]) -> [F; 3] {
    let found = crate::Portable::gather_points(points, index);
    [
        F::from_array(found[0].to_array()),
        F::from_array(found[1].to_array()),
        F::from_array(found[2].to_array()),
    ]
}

/// Four numbers from the beginning of each item, number by number.
///
/// # Safety
/// From each item on four numbers can be read.
#[inline(always)]
unsafe fn quads<const N: usize>(base: *const [f32; N], index: &[u32; LANES]) -> [F; 4] {
    // SAFETY: the caller's promise.
    unsafe {
        macro_rules! load {
            ($i:expr) => {
                _mm_loadu_ps(base.add(index[$i] as usize).cast())
            };
        }
        macro_rules! four {
            ($i:expr) => {{
                let v = _mm512_castps128_ps512(load!($i));
                let v = _mm512_insertf32x4::<1>(v, load!($i + 4));
                let v = _mm512_insertf32x4::<2>(v, load!($i + 8));
                _mm512_insertf32x4::<3>(v, load!($i + 12))
            }};
        }
        let (a, b, c, d) = (four!(0), four!(1), four!(2), four!(3));
        let (ab, cd) = (_mm512_unpacklo_ps(a, b), _mm512_unpacklo_ps(c, d));
        let (ab, cd) = (_mm512_castps_pd(ab), _mm512_castps_pd(cd));
        let (ab_z, cd_z) = (_mm512_unpackhi_ps(a, b), _mm512_unpackhi_ps(c, d));
        let (ab_z, cd_z) = (_mm512_castps_pd(ab_z), _mm512_castps_pd(cd_z));
        [
            F(_mm512_castpd_ps(_mm512_unpacklo_pd(ab, cd))),
            F(_mm512_castpd_ps(_mm512_unpackhi_pd(ab, cd))),
            F(_mm512_castpd_ps(_mm512_unpacklo_pd(ab_z, cd_z))),
            F(_mm512_castpd_ps(_mm512_unpackhi_pd(ab_z, cd_z))),
        ]
    }
}

/// Joins two halves.
#[inline(always)]
fn join(low: __m256, high: __m256) -> F {
    F(simd!(_mm512_insertf32x8::<1>(
        _mm512_castps256_ps512(low),
        high
    )))
}

/// Sixteen element offsets, in 32 or 64 bits, as gathers take them.
trait Offsets: Copy {
    /// Gathers 64-bit elements at `base + offset · SCALE` bytes, lanes 0–7 and 8–15.
    ///
    /// # Safety
    /// Every element lies within the allocation that `base` points into.
    unsafe fn gather_64<const SCALE: i32>(self, base: *const u8) -> [__m512i; 2];
    /// Gathers 32-bit elements at `base + offset · SCALE` bytes.
    ///
    /// # Safety
    /// Every element lies within the allocation that `base` points into.
    unsafe fn gather_32<const SCALE: i32>(self, base: *const u8) -> __m512i;
    /// Offsets limited to `last`, and by how many bits the wanted byte lies above there.
    fn limit(self, last: usize) -> (Self, __m512i);
}

impl Offsets for __m512i {
    #[inline(always)]
    unsafe fn gather_64<const SCALE: i32>(self, base: *const u8) -> [__m512i; 2] {
        // SAFETY: the caller keeps every element in bounds.
        unsafe {
            [
                _mm512_i32gather_epi64::<SCALE>(low(self), base.cast()),
                _mm512_i32gather_epi64::<SCALE>(high(self), base.cast()),
            ]
        }
    }
    #[inline(always)]
    unsafe fn gather_32<const SCALE: i32>(self, base: *const u8) -> __m512i {
        // SAFETY: the caller keeps every element in bounds.
        unsafe { _mm512_i32gather_epi32::<SCALE>(self, base.cast()) }
    }
    #[inline(always)]
    fn limit(self, last: usize) -> (Self, __m512i) {
        simd! {
            let last = _mm512_set1_epi32(last.min(i32::MAX as usize) as i32);
            let limited = _mm512_min_epi32(self, last);
            (limited, _mm512_slli_epi32::<3>(_mm512_sub_epi32(self, limited)))
        }
    }
}

impl Offsets for [__m512i; 2] {
    #[inline(always)]
    unsafe fn gather_64<const SCALE: i32>(self, base: *const u8) -> [__m512i; 2] {
        // SAFETY: the caller keeps every element in bounds.
        unsafe {
            [
                _mm512_i64gather_epi64::<SCALE>(self[0], base.cast()),
                _mm512_i64gather_epi64::<SCALE>(self[1], base.cast()),
            ]
        }
    }
    #[inline(always)]
    unsafe fn gather_32<const SCALE: i32>(self, base: *const u8) -> __m512i {
        // SAFETY: the caller keeps every element in bounds.
        unsafe {
            let a = _mm512_i64gather_epi32::<SCALE>(self[0], base.cast());
            let b = _mm512_i64gather_epi32::<SCALE>(self[1], base.cast());
            _mm512_inserti64x4::<1>(_mm512_castsi256_si512(a), b)
        }
    }
    #[inline(always)]
    fn limit(self, last: usize) -> (Self, __m512i) {
        simd! {
            let last = _mm512_set1_epi64(last as i64);
            let limited = [_mm512_min_epi64(self[0], last), _mm512_min_epi64(self[1], last)];
            let over_low = _mm512_cvtepi64_epi32(_mm512_sub_epi64(self[0], limited[0]));
            let over_high = _mm512_cvtepi64_epi32(_mm512_sub_epi64(self[1], limited[1]));
            let over = _mm512_inserti64x4::<1>(_mm512_castsi256_si512(over_low), over_high);
            (limited, _mm512_slli_epi32::<3>(over))
        }
    }
}

/// `factor · stride + term` of eight lanes in 64 bits, all taken as non-negative.
#[inline(always)]
fn term(factor: __m256i, stride: __m512i, term: __m256i) -> __m512i {
    simd! {
        _mm512_add_epi64(
            _mm512_mul_epu32(_mm512_cvtepu32_epi64(factor), stride),
            _mm512_cvtepu32_epi64(term),
        )
    }
}

/// Splits sixteen 64-bit elements into their lower and upper 32 bits.
#[inline(always)]
fn unzip_32(pairs: [__m512i; 2]) -> (__m512i, __m512i) {
    simd! {
        let even = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
        let odd = _mm512_setr_epi32(1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
        (
            _mm512_permutex2var_epi32(pairs[0], even, pairs[1]),
            _mm512_permutex2var_epi32(pairs[0], odd, pairs[1]),
        )
    }
}

/// `f64` lanes 0–7 and 8–15 to `f32`, through the map of wide types.
#[inline(always)]
fn narrow(wide: [__m512d; 2], map: Option<WideMap>) -> F {
    simd! {
        let mapped = match map {
            None => wide,
            Some(map) => {
                let (offset, factor) = (_mm512_set1_pd(map.offset), _mm512_set1_pd(map.factor));
                [
                    _mm512_mul_pd(_mm512_sub_pd(wide[0], offset), factor),
                    _mm512_mul_pd(_mm512_sub_pd(wide[1], offset), factor),
                ]
            }
        };
        join(_mm512_cvtpd_ps(mapped[0]), _mm512_cvtpd_ps(mapped[1]))
    }
}

/// Sixteen raw 32-bit elements as `f32` values.
#[inline(always)]
fn from_32<T: Voxel>(raw: __m512i, map: Option<WideMap>) -> F {
    simd! {
        match (T::KIND, map) {
            (VoxelKind::F32, None) => {
                // Subnormal numbers make every multiplication a microcode assist: read them as 0.
                let normal = _mm512_test_epi32_mask(raw, _mm512_set1_epi32(0x7f80_0000));
                F(_mm512_maskz_mov_ps(normal, _mm512_castsi512_ps(raw)))
            }
            (VoxelKind::PlainF32, None) => F(_mm512_castsi512_ps(raw)),
            (VoxelKind::U32, None) => F(_mm512_cvtepu32_ps(raw)),
            (VoxelKind::I32, None) => F(_mm512_cvtepi32_ps(raw)),
            (VoxelKind::U32, _) => {
                narrow([_mm512_cvtepu32_pd(low(raw)), _mm512_cvtepu32_pd(high(raw))], map)
            }
            (VoxelKind::I32, _) => {
                narrow([_mm512_cvtepi32_pd(low(raw)), _mm512_cvtepi32_pd(high(raw))], map)
            }
            _ => {
                let halves = [_mm256_castsi256_ps(low(raw)), _mm256_castsi256_ps(high(raw))];
                narrow([_mm512_cvtps_pd(halves[0]), _mm512_cvtps_pd(halves[1])], map)
            }
        }
    }
}

/// Sixteen raw 64-bit elements as `f32` values, rounded once when there is no map.
#[inline(always)]
fn from_64<T: Voxel>(raw: [__m512i; 2], map: Option<WideMap>) -> F {
    simd! {
        match (T::KIND, map) {
            (VoxelKind::U64, None) => join(_mm512_cvtepu64_ps(raw[0]), _mm512_cvtepu64_ps(raw[1])),
            (VoxelKind::I64, None) => join(_mm512_cvtepi64_ps(raw[0]), _mm512_cvtepi64_ps(raw[1])),
            (VoxelKind::U64, _) => narrow([_mm512_cvtepu64_pd(raw[0]), _mm512_cvtepu64_pd(raw[1])], map),
            (VoxelKind::I64, _) => narrow([_mm512_cvtepi64_pd(raw[0]), _mm512_cvtepi64_pd(raw[1])], map),
            _ => narrow([_mm512_castsi512_pd(raw[0]), _mm512_castsi512_pd(raw[1])], map),
        }
    }
}

/// Small integers that lie in the low bits of 32-bit lanes, as `f32`.
#[inline(always)]
fn from_small<T: Voxel>(raw: __m512i) -> F {
    simd! {
        F(_mm512_cvtepi32_ps(match T::KIND {
            VoxelKind::U8 => _mm512_and_si512(raw, _mm512_set1_epi32(0xff)),
            VoxelKind::I8 => _mm512_srai_epi32::<24>(_mm512_slli_epi32::<24>(raw)),
            VoxelKind::U16 => _mm512_and_si512(raw, _mm512_set1_epi32(0xffff)),
            _ => _mm512_srai_epi32::<16>(_mm512_slli_epi32::<16>(raw)),
        }))
    }
}

/// Voxels `o` and `o + 1` from `base` a lane.
///
/// # Safety
/// For every lane both voxels lie within the `len` voxels from `base`, or, for 8-bit types, within
/// `len − 4` and the two before.
#[inline(always)]
unsafe fn pairs<T: Voxel, O: Offsets>(
    voxels: &[T],
    from: usize,
    offsets: O,
    map: Option<WideMap>,
) -> (F, F) {
    let base = voxels.as_ptr().wrapping_add(from).cast::<u8>();
    // SAFETY: the caller keeps voxels `from + o` and `from + o + 1` within the slice. Elements
    // gathered are exactly those two voxels, but for 8-bit types: there they are four voxels, the
    // two before as well where there are such for all offsets, else moved down so that they end
    // with the slice at the latest (which has at least four).
    unsafe {
        match T::KIND {
            VoxelKind::U8 | VoxelKind::I8 if from >= 2 => {
                let raw = offsets.gather_32::<1>(base.wrapping_sub(2));
                (
                    from_small::<T>(_mm512_srli_epi32::<16>(raw)),
                    from_small::<T>(_mm512_srli_epi32::<24>(raw)),
                )
            }
            VoxelKind::U8 | VoxelKind::I8 => {
                let (limited, shift) = offsets.limit(voxels.len().wrapping_sub(4 + from));
                let raw = _mm512_srlv_epi32(limited.gather_32::<1>(base), shift);
                (
                    from_small::<T>(raw),
                    from_small::<T>(_mm512_srli_epi32::<8>(raw)),
                )
            }
            VoxelKind::U16 | VoxelKind::I16 => {
                let raw = offsets.gather_32::<2>(base);
                (
                    from_small::<T>(raw),
                    from_small::<T>(_mm512_srli_epi32::<16>(raw)),
                )
            }
            VoxelKind::U32 | VoxelKind::I32 | VoxelKind::F32 | VoxelKind::PlainF32 => {
                let (a, b) = unzip_32(offsets.gather_64::<4>(base));
                (from_32::<T>(a, map), from_32::<T>(b, map))
            }
            VoxelKind::U64 | VoxelKind::I64 | VoxelKind::F64 => {
                let a = offsets.gather_64::<8>(base);
                let b = offsets.gather_64::<8>(base.wrapping_add(8));
                (from_64::<T>(a, map), from_64::<T>(b, map))
            }
        }
    }
}

impl Simd for Avx512 {
    type F = F;
    type I = I;
    type M = M;
    type Offsets = [__m512i; 2];

    #[inline(always)]
    fn f_from_i(a: I) -> F {
        F(simd!(_mm512_cvtepi32_ps(a.0)))
    }
    #[inline(always)]
    fn f_from_bits(a: I) -> F {
        F(simd!(_mm512_castsi512_ps(a.0)))
    }
    #[inline(always)]
    fn offsets(high_factor: I, stride: u32, low_term: I) -> [__m512i; 2] {
        simd! {
            let stride = _mm512_set1_epi64(i64::from(stride));
            [
                term(low(high_factor.0), stride, low(low_term.0)),
                term(high(high_factor.0), stride, high(low_term.0)),
            ]
        }
    }
    #[inline(always)]
    unsafe fn gather(slice: &[f32], index: I) -> F {
        // SAFETY: the caller keeps every index within the slice.
        F(unsafe { _mm512_i32gather_ps::<4>(index.0, slice.as_ptr().cast()) })
    }
    #[inline(always)]
    unsafe fn gather_pair(slice: &[f32], index: I) -> (F, F) {
        // SAFETY: the caller keeps both elements within the slice.
        let (a, b) = unzip_32(unsafe { index.0.gather_64::<4>(slice.as_ptr().cast()) });
        simd!((F(_mm512_castsi512_ps(a)), F(_mm512_castsi512_ps(b))))
    }
    #[inline(always)]
    unsafe fn gather_u32(slice: &[u32], index: I) -> I {
        // SAFETY: the caller keeps every index within the slice.
        I(unsafe { _mm512_i32gather_epi32::<4>(index.0, slice.as_ptr().cast()) })
    }
    #[inline(always)]
    unsafe fn gather_rows(rows: &[[f32; 4]], index: I) -> [[F; 4]; 2] {
        let index = index.to_array().map(|i| i as u32);
        let first = rows.as_ptr();
        // SAFETY: the caller keeps both rows within the slice.
        unsafe { [quads(first, &index), quads(first.wrapping_add(1), &index)] }
    }
    #[inline(always)]
    fn gather_points(points: &[[f32; 3]], index: &[u32; LANES]) -> [F; 3] {
        // Points are loaded as four numbers, of which the last belongs to the next point.
        let limit = u32::try_from(points.len())
            .unwrap_or(u32::MAX)
            .saturating_sub(1);
        // SAFETY: the features are there; `index` has sixteen numbers.
        let within = unsafe {
            let index = _mm512_loadu_si512(index.as_ptr().cast());
            _mm512_cmplt_epu32_mask(index, _mm512_set1_epi32(limit as i32))
        };
        if within != u16::MAX {
            return clamped_points(points, index);
        }
        // SAFETY: every number is below that of the last point, so that the point and one number
        // more lie within the slice.
        let [x, y, z, _] = unsafe { quads(points.as_ptr(), index) };
        [x, y, z]
    }
    #[inline(always)]
    fn gather_values(values: &[f32], index: &[u32; LANES]) -> F {
        let end = values.len().min(i32::MAX as usize) as i32;
        const SUBNORMAL: i32 = 0x20;
        // SAFETY: the features are there; `index` has sixteen numbers, and only lanes whose number
        // is one of a value, hence not negative, are read.
        unsafe {
            let index = _mm512_loadu_si512(index.as_ptr().cast());
            let there = _mm512_cmplt_epu32_mask(index, _mm512_set1_epi32(end));
            let none = _mm512_set1_ps(f32::NAN);
            let found = _mm512_mask_i32gather_ps::<4>(none, there, index, values.as_ptr().cast());
            let subnormal = _mm512_fpclass_ps_mask::<SUBNORMAL>(found);
            F(_mm512_maskz_mov_ps(!subnormal, found))
        }
    }
    #[inline(always)]
    fn nibbles(bytes: [u8; BLOCK]) -> I {
        simd! {
            let bytes = _mm_set1_epi64x(i64::from_le_bytes(bytes));
            let by = _mm512_setr_epi32(0, 0, 0, 0, 0, 0, 0, 0, 4, 4, 4, 4, 4, 4, 4, 4);
            let shifted = _mm512_srlv_epi32(_mm512_cvtepu8_epi32(bytes), by);
            I(_mm512_and_si512(shifted, _mm512_set1_epi32(15)))
        }
    }
    #[inline(always)]
    fn bit_of_1024(bits: &[u32; 32], index: I) -> M {
        simd! {
            let low = _mm512_loadu_si512(bits.as_ptr().cast());
            let high = _mm512_loadu_si512(bits.as_ptr().add(LANES).cast());
            // Both look at the lower five bits of their index alone.
            let word = _mm512_permutex2var_epi32(low, _mm512_srli_epi32::<5>(index.0), high);
            let bit = _mm512_rolv_epi32(_mm512_set1_epi32(1), index.0);
            M(_mm512_test_epi32_mask(word, bit))
        }
    }
    #[inline(always)]
    unsafe fn voxel_pair<T: Voxel>(
        voxels: &[T],
        from: usize,
        offsets: [__m512i; 2],
        map: Option<WideMap>,
    ) -> (F, F) {
        // SAFETY: the caller's promise is that of `pairs`.
        unsafe { pairs(voxels, from, offsets, map) }
    }
    #[inline(always)]
    unsafe fn voxel_pair_32<T: Voxel>(
        voxels: &[T],
        from: usize,
        offsets: I,
        map: Option<WideMap>,
    ) -> (F, F) {
        // SAFETY: the caller's promise is that of `pairs`; offsets are not negative.
        unsafe { pairs(voxels, from, offsets.0, map) }
    }
    #[inline(always)]
    unsafe fn voxel<T: Voxel>(
        voxels: &[T],
        offsets: [__m512i; 2],
        mask: M,
        map: Option<WideMap>,
    ) -> F {
        let (mut places, mut values) = ([0u64; LANES], [0.0f32; LANES]);
        simd! {
            _mm512_storeu_si512(places.as_mut_ptr().cast(), offsets[0]);
            _mm512_storeu_si512(places.as_mut_ptr().add(BLOCK).cast(), offsets[1]);
        }
        for lane in 0..LANES {
            if mask.0 >> lane & 1 == 1 {
                debug_assert!((places[lane] as usize) < voxels.len());
                // SAFETY: the caller's promise for lanes of the mask.
                values[lane] = unsafe { voxels.get_unchecked(places[lane] as usize) }.rendered(map);
            }
        }
        F::from_array(values)
    }
}
