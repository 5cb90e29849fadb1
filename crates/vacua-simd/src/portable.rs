//! The scalar twin of every vector operation: arrays of sixteen, one lane after the other.
//!
//! Operations are functions of their own on purpose: unrolled sixteenfold into every kernel they
//! would cost minutes of compile time, for a path that only machines without AVX2 take.

use std::array::from_fn;
use std::ops::{Add, BitAnd, BitOr, Mul, Not, Sub};

use crate::{BLOCK, Float, Int, LANES, Mask, Simd, Voxel, WideMap};

/// Plain Rust; runs everywhere.
#[derive(Clone, Copy, Debug)]
pub struct Portable;

/// Sixteen `f32` in an array.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub struct F([f32; LANES]);
/// Sixteen `i32` in an array.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub struct I([i32; LANES]);
/// Sixteen booleans, one bit each.
#[derive(Clone, Copy, Debug)]
pub struct M(u16);

macro_rules! lanewise {
    ($vector:ident, $trait:ident, $method:ident, |$a:ident, $b:ident| $body:expr) => {
        impl $trait for $vector {
            type Output = Self;
            #[inline(never)]
            fn $method(self, other: Self) -> Self {
                Self(from_fn(|lane| {
                    let ($a, $b) = (self.0[lane], other.0[lane]);
                    $body
                }))
            }
        }
    };
}
lanewise!(F, Add, add, |a, b| a + b);
lanewise!(F, Sub, sub, |a, b| a - b);
lanewise!(F, Mul, mul, |a, b| a * b);
lanewise!(I, Add, add, |a, b| a.wrapping_add(b));
lanewise!(I, Sub, sub, |a, b| a.wrapping_sub(b));
lanewise!(I, Mul, mul, |a, b| a.wrapping_mul(b));

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

/// Builds a mask from a predicate on lanes.
#[inline(always)]
fn mask(predicate: impl Fn(usize) -> bool) -> M {
    M((0..LANES).fold(0, |bits, lane| bits | u16::from(predicate(lane)) << lane))
}

impl Float for F {
    type M = M;
    type I = I;

    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self([value; LANES])
    }
    #[inline(always)]
    fn from_array(values: [f32; LANES]) -> Self {
        Self(values)
    }
    #[inline(always)]
    fn to_array(self) -> [f32; LANES] {
        self.0
    }
    #[inline(never)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        Self(from_fn(|i| self.0[i].mul_add(b.0[i], c.0[i])))
    }
    #[inline(never)]
    fn min(self, b: Self) -> Self {
        Self(from_fn(|i| {
            if self.0[i] < b.0[i] {
                self.0[i]
            } else {
                b.0[i]
            }
        }))
    }
    #[inline(never)]
    fn max(self, b: Self) -> Self {
        Self(from_fn(|i| {
            if self.0[i] > b.0[i] {
                self.0[i]
            } else {
                b.0[i]
            }
        }))
    }
    #[inline(never)]
    fn floor(self) -> Self {
        Self(self.0.map(f32::floor))
    }
    #[inline(never)]
    fn fraction(self) -> Self {
        Self(self.0.map(|v| v - v.trunc()))
    }
    #[inline(never)]
    fn round(self) -> Self {
        Self(self.0.map(f32::round_ties_even))
    }
    #[inline(never)]
    fn abs(self) -> Self {
        Self(self.0.map(f32::abs))
    }
    #[inline(never)]
    fn sqrt(self) -> Self {
        Self(self.0.map(f32::sqrt))
    }
    #[inline(never)]
    fn div(self, b: Self) -> Self {
        Self(from_fn(|i| self.0[i] / b.0[i]))
    }
    #[inline(never)]
    fn to_i(self) -> I {
        I(self.0.map(|v| v as i32))
    }
    #[inline(never)]
    fn to_bits(self) -> I {
        I(self.0.map(|v| v.to_bits() as i32))
    }
    #[inline(never)]
    fn lt(self, b: Self) -> M {
        mask(|i| self.0[i] < b.0[i])
    }
    #[inline(never)]
    fn le(self, b: Self) -> M {
        mask(|i| self.0[i] <= b.0[i])
    }
    #[inline(never)]
    fn select(self, mask: M, other: Self) -> Self {
        Self(from_fn(|i| {
            if mask.0 >> i & 1 == 1 {
                self.0[i]
            } else {
                other.0[i]
            }
        }))
    }
    #[inline(never)]
    fn block_products(self) -> (Self, [f32; 2]) {
        let mut inclusive = self.0;
        for shift in [1, 2, 4] {
            let before = inclusive;
            for i in 0..LANES {
                if i % BLOCK >= shift {
                    inclusive[i] = before[i] * before[i - shift];
                }
            }
        }
        let exclusive = from_fn(|i| {
            if i % BLOCK == 0 {
                1.0
            } else {
                inclusive[i - 1]
            }
        });
        (
            Self(exclusive),
            [inclusive[BLOCK - 1], inclusive[LANES - 1]],
        )
    }
    #[inline(never)]
    fn blocks(self) -> [[f32; BLOCK]; 2] {
        [from_fn(|i| self.0[i]), from_fn(|i| self.0[BLOCK + i])]
    }
    #[inline(never)]
    fn of_blocks(first: f32, second: f32) -> Self {
        Self(from_fn(|i| if i < BLOCK { first } else { second }))
    }
    #[inline(never)]
    fn lowest(self) -> f32 {
        self.0
            .iter()
            .fold(self.0[0], |a, &b| if b < a { b } else { a })
    }
    #[inline(never)]
    fn highest(self) -> f32 {
        self.0
            .iter()
            .fold(self.0[0], |a, &b| if b > a { b } else { a })
    }
    #[inline(never)]
    fn permute(self, index: I) -> Self {
        Self(from_fn(|i| self.0[(index.0[i] & 15) as usize]))
    }
    #[inline(never)]
    fn compress(self, mask: M) -> Self {
        let mut compressed = [0.0; LANES];
        let mut len = 0;
        for (i, &value) in self.0.iter().enumerate() {
            compressed[len] = value;
            len += usize::from(mask.0 >> i & 1 == 1);
        }
        Self(compressed)
    }
    #[inline(never)]
    fn add_blocks_to(self, sums: &mut [f32; BLOCK]) {
        for (i, sum) in sums.iter_mut().enumerate() {
            *sum = *sum + self.0[i] + self.0[BLOCK + i];
        }
    }
}

impl Int for I {
    type M = M;

    #[inline(always)]
    fn splat(value: i32) -> Self {
        Self([value; LANES])
    }
    #[inline(always)]
    fn from_array(values: [i32; LANES]) -> Self {
        Self(values)
    }
    #[inline(always)]
    fn to_array(self) -> [i32; LANES] {
        self.0
    }
    #[inline(never)]
    fn min(self, b: Self) -> Self {
        Self(from_fn(|i| self.0[i].min(b.0[i])))
    }
    #[inline(never)]
    fn max(self, b: Self) -> Self {
        Self(from_fn(|i| self.0[i].max(b.0[i])))
    }
    #[inline(never)]
    fn min_unsigned(self, b: Self) -> Self {
        Self(from_fn(|i| (self.0[i] as u32).min(b.0[i] as u32) as i32))
    }
    #[inline(never)]
    fn and(self, b: Self) -> Self {
        Self(from_fn(|i| self.0[i] & b.0[i]))
    }
    #[inline(never)]
    fn shl<const N: u32>(self) -> Self {
        Self(self.0.map(|v| v << N))
    }
    #[inline(never)]
    fn shr(self, by: Self) -> Self {
        Self(from_fn(|i| ((self.0[i] as u32) >> (by.0[i] & 31)) as i32))
    }
    #[inline(never)]
    fn lt(self, b: Self) -> M {
        mask(|i| self.0[i] < b.0[i])
    }
    #[inline(never)]
    fn eq(self, b: Self) -> M {
        mask(|i| self.0[i] == b.0[i])
    }
    #[inline(never)]
    fn or_zero(self, mask: M) -> Self {
        Self(from_fn(
            |i| if mask.0 >> i & 1 == 1 { self.0[i] } else { 0 },
        ))
    }
}

/// Loads a pair without a bounds check in release builds.
///
/// # Safety
/// `index + 1 < slice.len()`.
#[inline(always)]
unsafe fn pair<T: Copy>(slice: &[T], index: usize) -> (T, T) {
    debug_assert!(index + 1 < slice.len(), "{index} of {}", slice.len());
    // SAFETY: the caller's promise.
    unsafe { (*slice.get_unchecked(index), *slice.get_unchecked(index + 1)) }
}

/// Splits an array of pairs.
#[inline(always)]
fn unzip(pairs: [(f32, f32); LANES]) -> (F, F) {
    (F(pairs.map(|p| p.0)), F(pairs.map(|p| p.1)))
}

impl Simd for Portable {
    type F = F;
    type I = I;
    type M = M;
    type Offsets = [u64; LANES];

    #[inline(never)]
    fn f_from_i(a: I) -> F {
        F(a.0.map(|v| v as f32))
    }
    #[inline(always)]
    fn f_from_bits(a: I) -> F {
        F(a.0.map(|v| f32::from_bits(v as u32)))
    }
    #[inline(never)]
    fn offsets(high: I, stride: u32, low: I) -> [u64; LANES] {
        from_fn(|i| u64::from(high.0[i] as u32) * u64::from(stride) + u64::from(low.0[i] as u32))
    }
    #[inline(never)]
    unsafe fn gather(slice: &[f32], index: I) -> F {
        F(from_fn(|i| {
            debug_assert!((index.0[i] as usize) < slice.len());
            // SAFETY: the caller's promise.
            unsafe { *slice.get_unchecked(index.0[i] as usize) }
        }))
    }
    #[inline(never)]
    unsafe fn gather_pair(slice: &[f32], index: I) -> (F, F) {
        // SAFETY: the caller's promise.
        unzip(from_fn(|i| unsafe { pair(slice, index.0[i] as usize) }))
    }
    #[inline(never)]
    unsafe fn gather_u32(slice: &[u32], index: I) -> I {
        I(from_fn(|i| {
            debug_assert!((index.0[i] as usize) < slice.len());
            // SAFETY: the caller's promise.
            unsafe { *slice.get_unchecked(index.0[i] as usize) as i32 }
        }))
    }
    #[inline(never)]
    unsafe fn gather_rows(rows: &[[f32; 4]], index: I) -> [[F; 4]; 2] {
        debug_assert!(index.0.iter().all(|&i| (i as usize) + 1 < rows.len()));
        // SAFETY: the caller's promise.
        let entry =
            |lane: usize, row: usize| unsafe { rows.get_unchecked(index.0[lane] as usize + row) };
        from_fn(|row| from_fn(|column| F(from_fn(|lane| entry(lane, row)[column]))))
    }
    #[inline(never)]
    fn gather_points(points: &[[f32; 3]], index: &[u32; LANES]) -> [F; 3] {
        let Some(last) = points.len().checked_sub(1) else {
            return [F([0.0; LANES]); 3];
        };
        let mut found = [F([0.0; LANES]); 3];
        for lane in 0..LANES {
            let point = points[(index[lane] as usize).min(last)];
            for axis in 0..3 {
                found[axis].0[lane] = point[axis];
            }
        }
        found
    }
    #[inline(never)]
    fn nibbles(bytes: [u8; BLOCK]) -> I {
        I(from_fn(|i| {
            i32::from(if i < BLOCK {
                bytes[i] & 15
            } else {
                bytes[i - BLOCK] >> 4
            })
        }))
    }
    #[inline(never)]
    fn bit_of_1024(bits: &[u32; 32], index: I) -> M {
        mask(|i| bits[index.0[i] as usize >> 5 & 31] >> (index.0[i] & 31) & 1 == 1)
    }
    #[inline(never)]
    unsafe fn voxel_pair<T: Voxel>(
        voxels: &[T],
        from: usize,
        offsets: [u64; LANES],
        map: Option<WideMap>,
    ) -> (F, F) {
        unzip(from_fn(|i| {
            // SAFETY: the caller's promise.
            let (a, b) = unsafe { pair(voxels, from + offsets[i] as usize) };
            (a.rendered(map), b.rendered(map))
        }))
    }
    #[inline(never)]
    unsafe fn voxel_pair_32<T: Voxel>(
        voxels: &[T],
        from: usize,
        offsets: I,
        map: Option<WideMap>,
    ) -> (F, F) {
        // SAFETY: the caller's promise, the offsets only widened.
        unsafe { Self::voxel_pair(voxels, from, offsets.0.map(|o| u64::from(o as u32)), map) }
    }
    #[inline(never)]
    unsafe fn voxel<T: Voxel>(
        voxels: &[T],
        offsets: [u64; LANES],
        mask: M,
        map: Option<WideMap>,
    ) -> F {
        F(from_fn(|i| {
            if mask.0 >> i & 1 == 0 {
                return 0.0;
            }
            debug_assert!((offsets[i] as usize) < voxels.len());
            // SAFETY: the caller's promise for lanes of the mask.
            unsafe { voxels.get_unchecked(offsets[i] as usize) }.rendered(map)
        }))
    }
}
