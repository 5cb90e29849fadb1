//! AVX2 and FMA: two registers a vector.
//!
//! As in [`crate::avx512`], every method is `#[inline(always)]` and runs only below
//! [`crate::dispatch_at`], which found the features. Masks are lane masks in vector registers.

use std::arch::x86_64::*;
use std::ops::{Add, BitAnd, BitOr, Mul, Not, Sub};

use crate::{BLOCK, Float, Int, LANES, Mask, Simd, Voxel, VoxelKind, WideMap};

/// AVX2 and FMA.
#[derive(Clone, Copy, Debug)]
pub struct Avx2;

/// Sixteen `f32`.
#[derive(Clone, Copy, Debug)]
pub struct F(__m256, __m256);
/// Sixteen `i32`.
#[derive(Clone, Copy, Debug)]
pub struct I(__m256i, __m256i);
/// Sixteen lanes of all ones or all zeros.
#[derive(Clone, Copy, Debug)]
pub struct M(__m256i, __m256i);

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
                simd!(Self(
                    $intrinsic(self.0, other.0),
                    $intrinsic(self.1, other.1)
                ))
            }
        }
    };
}
operator!(F, Add, add, _mm256_add_ps);
operator!(F, Sub, sub, _mm256_sub_ps);
operator!(F, Mul, mul, _mm256_mul_ps);
operator!(I, Add, add, _mm256_add_epi32);
operator!(I, Sub, sub, _mm256_sub_epi32);
operator!(I, Mul, mul, _mm256_mullo_epi32);
operator!(M, BitAnd, bitand, _mm256_and_si256);
operator!(M, BitOr, bitor, _mm256_or_si256);

impl Not for M {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        simd! {
            let ones = _mm256_set1_epi32(-1);
            Self(_mm256_xor_si256(self.0, ones), _mm256_xor_si256(self.1, ones))
        }
    }
}
impl Mask for M {
    #[inline(always)]
    fn from_bits(bits: u16) -> Self {
        simd! {
            let lane = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
            let low = _mm256_and_si256(_mm256_set1_epi32(i32::from(bits)), lane);
            let high = _mm256_and_si256(_mm256_set1_epi32(i32::from(bits >> 8)), lane);
            Self(_mm256_cmpeq_epi32(low, lane), _mm256_cmpeq_epi32(high, lane))
        }
    }
    #[inline(always)]
    fn to_bits(self) -> u16 {
        simd! {
            let low = _mm256_movemask_ps(_mm256_castsi256_ps(self.0));
            let high = _mm256_movemask_ps(_mm256_castsi256_ps(self.1));
            (low | high << 8) as u16
        }
    }
}

impl Float for F {
    type M = M;
    type I = I;

    #[inline(always)]
    fn splat(value: f32) -> Self {
        simd!(Self(_mm256_set1_ps(value), _mm256_set1_ps(value)))
    }
    #[inline(always)]
    fn from_array(values: [f32; LANES]) -> Self {
        simd!(Self(
            _mm256_loadu_ps(values.as_ptr()),
            _mm256_loadu_ps(values.as_ptr().add(BLOCK))
        ))
    }
    #[inline(always)]
    fn to_array(self) -> [f32; LANES] {
        let mut values = [0.0; LANES];
        simd! {
            _mm256_storeu_ps(values.as_mut_ptr(), self.0);
            _mm256_storeu_ps(values.as_mut_ptr().add(BLOCK), self.1);
        }
        values
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        simd!(Self(
            _mm256_fmadd_ps(self.0, b.0, c.0),
            _mm256_fmadd_ps(self.1, b.1, c.1)
        ))
    }
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        simd!(Self(_mm256_min_ps(self.0, b.0), _mm256_min_ps(self.1, b.1)))
    }
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        simd!(Self(_mm256_max_ps(self.0, b.0), _mm256_max_ps(self.1, b.1)))
    }
    #[inline(always)]
    fn floor(self) -> Self {
        simd!(Self(_mm256_floor_ps(self.0), _mm256_floor_ps(self.1)))
    }
    #[inline(always)]
    fn fraction(self) -> Self {
        const TO_ZERO: i32 = _MM_FROUND_TO_ZERO | _MM_FROUND_NO_EXC;
        simd!(Self(
            _mm256_sub_ps(self.0, _mm256_round_ps::<TO_ZERO>(self.0)),
            _mm256_sub_ps(self.1, _mm256_round_ps::<TO_ZERO>(self.1))
        ))
    }
    #[inline(always)]
    fn round(self) -> Self {
        const NEAREST: i32 = _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC;
        simd!(Self(
            _mm256_round_ps::<NEAREST>(self.0),
            _mm256_round_ps::<NEAREST>(self.1)
        ))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        simd! {
            let sign = _mm256_set1_ps(-0.0);
            Self(_mm256_andnot_ps(sign, self.0), _mm256_andnot_ps(sign, self.1))
        }
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        simd!(Self(_mm256_sqrt_ps(self.0), _mm256_sqrt_ps(self.1)))
    }
    #[inline(always)]
    fn div(self, b: Self) -> Self {
        simd!(Self(_mm256_div_ps(self.0, b.0), _mm256_div_ps(self.1, b.1)))
    }
    #[inline(always)]
    fn to_i(self) -> I {
        simd!(I(_mm256_cvttps_epi32(self.0), _mm256_cvttps_epi32(self.1)))
    }
    #[inline(always)]
    fn to_bits(self) -> I {
        simd!(I(_mm256_castps_si256(self.0), _mm256_castps_si256(self.1)))
    }
    #[inline(always)]
    fn lt(self, b: Self) -> M {
        simd! {
            M(
                _mm256_castps_si256(_mm256_cmp_ps::<_CMP_LT_OQ>(self.0, b.0)),
                _mm256_castps_si256(_mm256_cmp_ps::<_CMP_LT_OQ>(self.1, b.1)),
            )
        }
    }
    #[inline(always)]
    fn le(self, b: Self) -> M {
        simd! {
            M(
                _mm256_castps_si256(_mm256_cmp_ps::<_CMP_LE_OQ>(self.0, b.0)),
                _mm256_castps_si256(_mm256_cmp_ps::<_CMP_LE_OQ>(self.1, b.1)),
            )
        }
    }
    #[inline(always)]
    fn select(self, mask: M, other: Self) -> Self {
        simd! {
            Self(
                _mm256_blendv_ps(other.0, self.0, _mm256_castsi256_ps(mask.0)),
                _mm256_blendv_ps(other.1, self.1, _mm256_castsi256_ps(mask.1)),
            )
        }
    }
    #[inline(always)]
    fn block_products(self) -> (Self, [f32; 2]) {
        let (low, through_low) = products(self.0);
        let (high, through_high) = products(self.1);
        (Self(low, high), [through_low, through_high])
    }
    #[inline(always)]
    fn blocks(self) -> [[f32; BLOCK]; 2] {
        let mut blocks = [[0.0; BLOCK]; 2];
        simd! {
            _mm256_storeu_ps(blocks[0].as_mut_ptr(), self.0);
            _mm256_storeu_ps(blocks[1].as_mut_ptr(), self.1);
        }
        blocks
    }
    #[inline(always)]
    fn of_blocks(first: f32, second: f32) -> Self {
        simd!(Self(_mm256_set1_ps(first), _mm256_set1_ps(second)))
    }
    #[inline(always)]
    fn lowest(self) -> f32 {
        simd! {
            let half = _mm256_min_ps(self.0, self.1);
            let four = _mm_min_ps(_mm256_castps256_ps128(half), _mm256_extractf128_ps::<1>(half));
            let two = _mm_min_ps(four, _mm_movehl_ps(four, four));
            _mm_cvtss_f32(_mm_min_ss(two, _mm_movehdup_ps(two)))
        }
    }
    #[inline(always)]
    fn highest(self) -> f32 {
        simd! {
            let half = _mm256_max_ps(self.0, self.1);
            let four = _mm_max_ps(_mm256_castps256_ps128(half), _mm256_extractf128_ps::<1>(half));
            let two = _mm_max_ps(four, _mm_movehl_ps(four, four));
            _mm_cvtss_f32(_mm_max_ss(two, _mm_movehdup_ps(two)))
        }
    }
    #[inline(always)]
    fn permute(self, index: I) -> Self {
        simd! {
            // The sign of a blend's mask is bit 3 of the index.
            let half_0 = _mm256_castsi256_ps(_mm256_slli_epi32::<28>(index.0));
            let half_1 = _mm256_castsi256_ps(_mm256_slli_epi32::<28>(index.1));
            Self(
                _mm256_blendv_ps(
                    _mm256_permutevar8x32_ps(self.0, index.0),
                    _mm256_permutevar8x32_ps(self.1, index.0),
                    half_0,
                ),
                _mm256_blendv_ps(
                    _mm256_permutevar8x32_ps(self.0, index.1),
                    _mm256_permutevar8x32_ps(self.1, index.1),
                    half_1,
                ),
            )
        }
    }
    #[inline(always)]
    fn compress(self, mask: M) -> Self {
        let bits = mask.to_bits();
        let (low, high) = (front(bits as u8), front((bits >> 8) as u8));
        let mut values = [0.0f32; LANES];
        let from = (bits as u8).count_ones() as usize;
        simd! {
            _mm256_storeu_ps(values.as_mut_ptr(), _mm256_permutevar8x32_ps(self.0, low));
            // At most eight lanes come before: the second half fits after them.
            let second = _mm256_permutevar8x32_ps(self.1, high);
            _mm256_storeu_ps(values.as_mut_ptr().add(from), second);
        }
        Self::from_array(values)
    }
    #[inline(always)]
    fn add_blocks_to(self, sums: &mut [f32; BLOCK]) {
        simd! {
            let sum = _mm256_add_ps(_mm256_loadu_ps(sums.as_ptr()), self.0);
            _mm256_storeu_ps(sums.as_mut_ptr(), _mm256_add_ps(sum, self.1));
        }
    }
}

impl F {
    /// Subnormal numbers as 0.
    #[inline(always)]
    fn flushed(self) -> Self {
        let normal = Self::splat(f32::MIN_POSITIVE).le(self.abs());
        let not_a_number = !self.le(self);
        self.or_zero(normal | not_a_number)
    }
}

/// The numbers of the bits that are set, in order; zeros after them.
#[inline(always)]
fn front(bits: u8) -> __m256i {
    simd! {
        let bytes = _pdep_u64(u64::from(bits), 0x0101_0101_0101_0101).wrapping_mul(0xFF);
        let numbers = _pext_u64(0x0706_0504_0302_0100, bytes);
        _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(numbers as i64))
    }
}

/// Products of all lanes before each, and of all eight.
#[inline(always)]
fn products(p: __m256) -> (__m256, f32) {
    simd! {
        let one = _mm256_set1_ps(1.0);
        let by_1 = _mm256_setr_epi32(0, 0, 1, 2, 3, 4, 5, 6);
        let by_2 = _mm256_setr_epi32(0, 0, 0, 1, 2, 3, 4, 5);
        let by_4 = _mm256_setr_epi32(0, 0, 0, 0, 0, 1, 2, 3);
        let shifted = _mm256_permutevar8x32_ps(p, by_1);
        let p = _mm256_mul_ps(p, _mm256_blend_ps::<0b0000_0001>(shifted, one));
        let shifted = _mm256_permutevar8x32_ps(p, by_2);
        let p = _mm256_mul_ps(p, _mm256_blend_ps::<0b0000_0011>(shifted, one));
        let shifted = _mm256_permutevar8x32_ps(p, by_4);
        let p = _mm256_mul_ps(p, _mm256_blend_ps::<0b0000_1111>(shifted, one));
        let exclusive = _mm256_blend_ps::<1>(_mm256_permutevar8x32_ps(p, by_1), one);
        let last = _mm256_permutevar8x32_ps(p, _mm256_set1_epi32(7));
        (exclusive, _mm256_cvtss_f32(last))
    }
}

impl Int for I {
    type M = M;

    #[inline(always)]
    fn splat(value: i32) -> Self {
        simd!(Self(_mm256_set1_epi32(value), _mm256_set1_epi32(value)))
    }
    #[inline(always)]
    fn from_array(values: [i32; LANES]) -> Self {
        simd! {
            Self(
                _mm256_loadu_si256(values.as_ptr().cast()),
                _mm256_loadu_si256(values.as_ptr().add(BLOCK).cast()),
            )
        }
    }
    #[inline(always)]
    fn to_array(self) -> [i32; LANES] {
        let mut values = [0; LANES];
        simd! {
            _mm256_storeu_si256(values.as_mut_ptr().cast(), self.0);
            _mm256_storeu_si256(values.as_mut_ptr().add(BLOCK).cast(), self.1);
        }
        values
    }
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        simd!(Self(
            _mm256_min_epi32(self.0, b.0),
            _mm256_min_epi32(self.1, b.1)
        ))
    }
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        simd!(Self(
            _mm256_max_epi32(self.0, b.0),
            _mm256_max_epi32(self.1, b.1)
        ))
    }
    #[inline(always)]
    fn min_unsigned(self, b: Self) -> Self {
        simd!(Self(
            _mm256_min_epu32(self.0, b.0),
            _mm256_min_epu32(self.1, b.1)
        ))
    }
    #[inline(always)]
    fn and(self, b: Self) -> Self {
        simd!(Self(
            _mm256_and_si256(self.0, b.0),
            _mm256_and_si256(self.1, b.1)
        ))
    }
    #[inline(always)]
    fn shl<const N: u32>(self) -> Self {
        simd! {
            let by = _mm_cvtsi32_si128(N as i32);
            Self(_mm256_sll_epi32(self.0, by), _mm256_sll_epi32(self.1, by))
        }
    }
    #[inline(always)]
    fn shr(self, by: Self) -> Self {
        simd!(Self(
            _mm256_srlv_epi32(self.0, by.0),
            _mm256_srlv_epi32(self.1, by.1)
        ))
    }
    #[inline(always)]
    fn lt(self, b: Self) -> M {
        simd!(M(
            _mm256_cmpgt_epi32(b.0, self.0),
            _mm256_cmpgt_epi32(b.1, self.1)
        ))
    }
    #[inline(always)]
    fn eq(self, b: Self) -> M {
        simd!(M(
            _mm256_cmpeq_epi32(self.0, b.0),
            _mm256_cmpeq_epi32(self.1, b.1)
        ))
    }
    #[inline(always)]
    fn or_zero(self, mask: M) -> Self {
        simd!(Self(
            _mm256_and_si256(self.0, mask.0),
            _mm256_and_si256(self.1, mask.1)
        ))
    }
}

/// Loads the pairs of sixteen places one after the other; AVX2's gathers are no faster.
///
/// # Safety
/// For every lane both voxels lie within the slice.
#[inline(always)]
unsafe fn pairs<T: Voxel>(
    voxels: &[T],
    from: usize,
    offsets: &[u64; LANES],
    map: Option<WideMap>,
) -> (F, F) {
    let (mut a, mut b) = ([0.0f32; LANES], [0.0f32; LANES]);
    for lane in 0..LANES {
        let place = from + offsets[lane] as usize;
        debug_assert!(place + 1 < voxels.len());
        // SAFETY: the caller's promise.
        let (x, y) = unsafe {
            (
                *voxels.get_unchecked(place),
                *voxels.get_unchecked(place + 1),
            )
        };
        a[lane] = x.rendered(map);
        b[lane] = y.rendered(map);
    }
    (F::from_array(a), F::from_array(b))
}

/// Offsets of 32 bits in 64.
#[inline(always)]
fn widen(offsets: I) -> [u64; LANES] {
    let narrow = offsets.to_array();
    let mut wide = [0; LANES];
    for lane in 0..LANES {
        wide[lane] = u64::from(narrow[lane] as u32);
    }
    wide
}

/// Pairs of `f32` as four gathers of four 64-bit elements.
///
/// # Safety
/// For every lane both elements lie within the slice.
#[inline(always)]
unsafe fn float_pairs(base: *const f32, offsets: I) -> (F, F) {
    // SAFETY: the caller's promise.
    unsafe {
        let (a0, b0) = eight_pairs(base, offsets.0);
        let (a1, b1) = eight_pairs(base, offsets.1);
        (F(a0, a1), F(b0, b1))
    }
}

/// Eight pairs of `f32`.
///
/// # Safety
/// For every lane both elements lie within what `base` points to.
#[inline(always)]
unsafe fn eight_pairs(base: *const f32, offsets: __m256i) -> (__m256, __m256) {
    // SAFETY: the caller's promise.
    unsafe {
        let low = _mm256_i32gather_epi64::<4>(base.cast(), _mm256_castsi256_si128(offsets));
        let high = _mm256_i32gather_epi64::<4>(base.cast(), _mm256_extracti128_si256::<1>(offsets));
        let (low, high) = (_mm256_castsi256_ps(low), _mm256_castsi256_ps(high));
        let even = _mm256_shuffle_ps::<0b10_00_10_00>(low, high);
        let odd = _mm256_shuffle_ps::<0b11_01_11_01>(low, high);
        let even = _mm256_permute4x64_pd::<0b11_01_10_00>(_mm256_castps_pd(even));
        let odd = _mm256_permute4x64_pd::<0b11_01_10_00>(_mm256_castps_pd(odd));
        (_mm256_castpd_ps(even), _mm256_castpd_ps(odd))
    }
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
    macro_rules! eight {
        ($from:expr) => {{
            macro_rules! two {
                ($i:expr) => {
                    _mm256_insertf128_ps::<1>(
                        _mm256_castps128_ps256(_mm_loadu_ps(base.add(index[$i] as usize).cast())),
                        _mm_loadu_ps(base.add(index[$i + 4] as usize).cast()),
                    )
                };
            }
            let (a, b, c, d) = (
                two!($from),
                two!($from + 1),
                two!($from + 2),
                two!($from + 3),
            );
            let (ab, cd) = (_mm256_unpacklo_ps(a, b), _mm256_unpacklo_ps(c, d));
            let (ab, cd) = (_mm256_castps_pd(ab), _mm256_castps_pd(cd));
            let (ab_z, cd_z) = (_mm256_unpackhi_ps(a, b), _mm256_unpackhi_ps(c, d));
            let (ab_z, cd_z) = (_mm256_castps_pd(ab_z), _mm256_castps_pd(cd_z));
            [
                _mm256_castpd_ps(_mm256_unpacklo_pd(ab, cd)),
                _mm256_castpd_ps(_mm256_unpackhi_pd(ab, cd)),
                _mm256_castpd_ps(_mm256_unpacklo_pd(ab_z, cd_z)),
                _mm256_castpd_ps(_mm256_unpackhi_pd(ab_z, cd_z)),
            ]
        }};
    }
    // SAFETY: the caller's promise.
    let ([x0, y0, z0, w0], [x1, y1, z1, w1]) = unsafe { (eight!(0), eight!(BLOCK)) };
    [F(x0, x1), F(y0, y1), F(z0, z1), F(w0, w1)]
}

impl Simd for Avx2 {
    type F = F;
    type I = I;
    type M = M;
    type Offsets = [u64; LANES];

    #[inline(always)]
    fn f_from_i(a: I) -> F {
        simd!(F(_mm256_cvtepi32_ps(a.0), _mm256_cvtepi32_ps(a.1)))
    }
    #[inline(always)]
    fn f_from_bits(a: I) -> F {
        simd!(F(_mm256_castsi256_ps(a.0), _mm256_castsi256_ps(a.1)))
    }
    #[inline(always)]
    fn offsets(high: I, stride: u32, low: I) -> [u64; LANES] {
        let (high, low) = (widen(high), widen(low));
        let mut offsets = [0; LANES];
        for lane in 0..LANES {
            offsets[lane] = high[lane] * u64::from(stride) + low[lane];
        }
        offsets
    }
    #[inline(always)]
    unsafe fn gather(slice: &[f32], index: I) -> F {
        // SAFETY: the caller keeps every index within the slice.
        unsafe {
            F(
                _mm256_i32gather_ps::<4>(slice.as_ptr(), index.0),
                _mm256_i32gather_ps::<4>(slice.as_ptr(), index.1),
            )
        }
    }
    #[inline(always)]
    unsafe fn gather_pair(slice: &[f32], index: I) -> (F, F) {
        // SAFETY: the caller keeps both elements within the slice.
        unsafe { float_pairs(slice.as_ptr(), index) }
    }
    #[inline(always)]
    unsafe fn gather_u32(slice: &[u32], index: I) -> I {
        // SAFETY: the caller keeps every index within the slice.
        unsafe {
            I(
                _mm256_i32gather_epi32::<4>(slice.as_ptr().cast(), index.0),
                _mm256_i32gather_epi32::<4>(slice.as_ptr().cast(), index.1),
            )
        }
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
        let limit = points.len().saturating_sub(1);
        let mut largest = 0;
        for &i in index {
            largest = i.max(largest);
        }
        if largest as usize >= limit {
            return clamped_points(points, index);
        }
        // SAFETY: every number is below that of the last point, so that the point and one number
        // more lie within the slice.
        let [x, y, z, _] = unsafe { quads(points.as_ptr(), index) };
        [x, y, z]
    }
    #[inline(always)]
    fn nibbles(bytes: [u8; BLOCK]) -> I {
        simd! {
            let bytes = _mm256_cvtepu8_epi32(_mm_set1_epi64x(i64::from_le_bytes(bytes)));
            I(
                _mm256_and_si256(bytes, _mm256_set1_epi32(15)),
                _mm256_srli_epi32::<4>(bytes),
            )
        }
    }
    #[inline(always)]
    fn bit_of_1024(bits: &[u32; 32], index: I) -> M {
        let word = index.shr(I::splat(5)).and(I::splat(31));
        // SAFETY: limited to the words.
        let word = unsafe { Self::gather_u32(bits, word) };
        let bit = word.shr(index.and(I::splat(31))).and(I::splat(1));
        I::splat(0).lt(bit)
    }
    #[inline(always)]
    unsafe fn voxel_pair<T: Voxel>(
        voxels: &[T],
        from: usize,
        offsets: [u64; LANES],
        map: Option<WideMap>,
    ) -> (F, F) {
        // SAFETY: the caller's promise is that of `pairs`.
        unsafe { pairs(voxels, from, &offsets, map) }
    }
    #[inline(always)]
    unsafe fn voxel_pair_32<T: Voxel>(
        voxels: &[T],
        from: usize,
        offsets: I,
        map: Option<WideMap>,
    ) -> (F, F) {
        if matches!(T::KIND, VoxelKind::F32 | VoxelKind::PlainF32) && map.is_none() {
            let base = voxels.as_ptr().wrapping_add(from).cast::<f32>();
            // SAFETY: `T` is an `f32`, and the caller keeps both voxels of every lane in the slice.
            let (a, b) = unsafe { float_pairs(base, offsets) };
            return match T::KIND {
                VoxelKind::F32 => (a.flushed(), b.flushed()),
                _ => (a, b),
            };
        }
        // SAFETY: the caller's promise is that of `pairs`.
        unsafe { pairs(voxels, from, &widen(offsets), map) }
    }
    #[inline(always)]
    unsafe fn voxel<T: Voxel>(
        voxels: &[T],
        offsets: [u64; LANES],
        mask: M,
        map: Option<WideMap>,
    ) -> F {
        let bits = mask.to_bits();
        let mut values = [0.0f32; LANES];
        for lane in 0..LANES {
            if bits >> lane & 1 == 1 {
                debug_assert!((offsets[lane] as usize) < voxels.len());
                // SAFETY: the caller's promise for lanes of the mask.
                let voxel = unsafe { voxels.get_unchecked(offsets[lane] as usize) };
                values[lane] = voxel.rendered(map);
            }
        }
        F::from_array(values)
    }
}
