//! Every instruction set computes the bits that the scalar twin computes.

use proptest::prelude::*;
use vacua_simd::{
    Float, Int, Kernel, LANES, Level, Mask, PlainF32, Portable, Simd, Voxel, WideMap, dispatch_at,
};

/// Every operation on the same operands, results as bits.
struct Operations {
    a: [f32; LANES],
    b: [f32; LANES],
    c: [f32; LANES],
    i: [i32; LANES],
    j: [i32; LANES],
}

impl Kernel for Operations {
    type Output = Vec<u32>;
    #[inline(always)]
    fn run<S: Simd>(self) -> Vec<u32> {
        let [a, b, c] = [self.a, self.b, self.c].map(S::F::from_array);
        let [i, j] = [self.i, self.j].map(S::I::from_array);
        let bits = std::array::from_fn(|k| self.i[k % LANES].rotate_left(k as u32) as u32);
        let in_bits = S::bit_of_1024(&bits, j);
        let m = a.lt(b);
        let n = b.le(c) & !m | i.lt(j) & i.eq(i.min(j));
        let (products, ends) = a.block_products();
        let floats = [
            a + b,
            a - b,
            a * b,
            a.mul_add(b, c),
            a.min(b),
            a.max(b),
            a.floor(),
            a.round(),
            a.abs(),
            a.abs().sqrt(),
            a.div(b),
            a.select(n, c),
            a.or_zero(m),
            products,
            S::f_from_i(i),
            S::f_from_bits(a.to_bits()),
            S::f_from_i(a.to_i()),
            S::F::of_blocks(self.a[3], self.b[5]),
            a.permute(i),
            S::f_from_i(S::nibbles(std::array::from_fn(|k| self.i[k] as u8))),
        ];
        let shifts = j.and(S::I::splat(31));
        let ints = [
            i + j,
            i - j,
            i * j,
            i.min(j),
            i.max(j),
            i.min_unsigned(j),
            i.and(j),
            i.shl::<5>(),
            i.shr(shifts),
            i.or_zero(m),
        ];
        let mut out: Vec<u32> = floats
            .iter()
            .flat_map(|f| f.to_array())
            .map(f32::to_bits)
            .collect();
        out.extend(ints.iter().flat_map(|i| i.to_array()).map(|v| v as u32));
        let unsigned = [i.le_unsigned(j), j.le_unsigned(j), i.shares_bits(shifts)];
        out.extend(
            [m, n]
                .iter()
                .chain(&unsigned)
                .map(|m| u32::from(m.to_bits())),
        );
        out.push(u32::from(in_bits.to_bits()));
        let [mut sums, _] = a.blocks();
        b.add_blocks_to(&mut sums);
        out.extend(sums.map(f32::to_bits));
        out.extend(ends.map(f32::to_bits));
        let kept = m.to_bits().count_ones() as usize;
        out.extend(a.compress(m).to_array()[..kept].iter().map(|v| v.to_bits()));
        let small = a.abs().le(S::F::splat(1e9));
        out.extend(
            a.or_zero(small)
                .fraction()
                .to_array()
                .map(|v| (v + 0.0).to_bits()),
        );
        let finite = a.abs().le(S::F::splat(f32::MAX));
        // Adding 0 makes one zero of two.
        out.extend(
            [a.or_zero(finite).lowest(), a.or_zero(finite).highest()].map(|v| (v + 0.0).to_bits()),
        );
        out.extend(c.blocks().as_flattened().iter().map(|v| v.to_bits()));
        out
    }
}

/// All three voxel fetches at the same places.
struct Fetches<'a, T> {
    voxels: &'a [T],
    places: [i32; LANES],
    mask: u16,
    map: Option<WideMap>,
}

impl<T: Voxel> Kernel for Fetches<'_, T> {
    type Output = Vec<u32>;
    #[inline(always)]
    fn run<S: Simd>(self) -> Vec<u32> {
        let places = S::I::from_array(self.places);
        let wide = S::offsets(S::I::splat(0), 7, places);
        // SAFETY: the test draws places below `voxels.len() − 2`, and one more is added at most.
        let (p, q, one) = unsafe {
            (
                S::voxel_pair_32(self.voxels, 1, places, self.map),
                S::voxel_pair(self.voxels, 0, wide, self.map),
                S::voxel(self.voxels, wide, S::M::from_bits(self.mask), self.map),
            )
        };
        [p.0, p.1, q.0, q.1, one]
            .iter()
            .flat_map(|f| f.to_array())
            .map(f32::to_bits)
            .collect()
    }
}

fn check_fetch<T: Voxel>(voxels: &[T], places: [i32; LANES], mask: u16, map: Option<WideMap>) {
    let fetch = || Fetches {
        voxels,
        places,
        mask,
        map,
    };
    let expected = fetch().run::<Portable>();
    for level in Level::available() {
        assert_eq!(
            dispatch_at(level, fetch()),
            expected,
            "{:?} {level:?}",
            T::KIND
        );
    }
    for (lane, &bits) in expected[..LANES].iter().enumerate() {
        assert_eq!(
            bits,
            voxels[places[lane] as usize + 1].rendered(map).to_bits()
        );
    }
}

proptest! {
    #[test]
    fn operations_agree(
        a in prop::array::uniform16(-1e6f32..1e6),
        b in prop::array::uniform16(prop_oneof![Just(0.5f32), -10.0f32..10.0]),
        c in prop::array::uniform16(prop_oneof![Just(f32::NAN), Just(f32::INFINITY), -1.0f32..1.0]),
        i in prop::array::uniform16(any::<i32>()),
        j in prop::array::uniform16(any::<i32>()),
    ) {
        let operations = || Operations { a, b, c, i, j };
        let expected = operations().run::<Portable>();
        for level in Level::available() {
            let actual = dispatch_at(level, operations());
            for (k, (x, y)) in expected.iter().zip(&actual).enumerate() {
                let both_nan = f32::from_bits(*x).is_nan() && f32::from_bits(*y).is_nan();
                prop_assert!(x == y || both_nan, "output {} differs on {:?}", k, level);
            }
        }
    }

    #[test]
    fn fetches_agree(
        seed in prop::collection::vec(any::<u64>(), 5..60),
        picks in prop::array::uniform16(any::<u16>()),
        mask in any::<u16>(),
    ) {
        let places = picks.map(|p| i32::from(p) % (seed.len() as i32 - 2));
        let map = Some(WideMap { offset: 12345.5, factor: 1e-3 });
        macro_rules! check {
            ($($t:ty => $from:expr),*) => {$(
                let voxels: Vec<$t> = seed.iter().map(|&s| { let f: fn(u64) -> $t = $from; f(s) }).collect();
                check_fetch(&voxels, places, mask, None);
                if std::mem::size_of::<$t>() >= 4 { check_fetch(&voxels, places, mask, map); }
            )*};
        }
        check!(u8 => |s| s as u8, i8 => |s| s as i8, u16 => |s| s as u16, i16 => |s| s as i16,
            u32 => |s| s as u32, i32 => |s| s as i32, u64 => |s| s, i64 => |s| s as i64,
            f32 => |s| s as u32 as f32 * 0.37 - 1e6,
            PlainF32 => |s| PlainF32::of(&[s as u32 as f32 * 0.37 - 1e6])[0], f64 => |s| s as f64 * 0.37 - 1e9);
    }
}

/// Rows by number.
struct Rows<'a>(&'a [[f32; 4]], [i32; LANES]);

impl Kernel for Rows<'_> {
    type Output = [[[f32; LANES]; 4]; 2];
    #[inline(always)]
    fn run<S: Simd>(self) -> Self::Output {
        // SAFETY: the test below keeps all but the last row.
        let rows = unsafe { S::gather_rows(self.0, S::I::from_array(self.1)) };
        rows.map(|columns| columns.map(Float::to_array))
    }
}

proptest! {
    #[test]
    fn rows_come_with_the_next_ones(len in 2usize..40, picks in prop::array::uniform16(any::<u16>())) {
        let rows: Vec<[f32; 4]> = (0..len).map(|i| [0, 1, 2, 3].map(|c| (4 * i + c) as f32)).collect();
        let index = picks.map(|pick| i32::from(pick) % (len as i32 - 1));
        for level in Level::available() {
            let found = dispatch_at(level, Rows(&rows, index));
            for lane in 0..LANES {
                for column in 0..4 {
                    let first = rows[index[lane] as usize][column];
                    prop_assert_eq!([found[0][column][lane], found[1][column][lane]], [first, first + 4.0]);
                }
            }
        }
    }
}

/// Points by number.
struct Points<'a>(&'a [[f32; 3]], [u32; LANES]);

impl Kernel for Points<'_> {
    type Output = [[f32; LANES]; 3];
    #[inline(always)]
    fn run<S: Simd>(self) -> Self::Output {
        let [x, y, z] = S::gather_points(self.0, &self.1);
        [x.to_array(), y.to_array(), z.to_array()]
    }
}

proptest! {
    #[test]
    fn points_are_gathered_and_never_past_the_end(
        len in 0usize..40,
        index in prop::array::uniform16(prop_oneof![4 => 0u32..40, 1 => any::<u32>()]),
        tame in any::<bool>(),
    ) {
        let points: Vec<[f32; 3]> = (0..len).map(|i| [0, 1, 2].map(|a| (3 * i + a) as f32)).collect();
        let index = index.map(|i| if tame { i % (len as u32).max(1) } else { i });
        for level in Level::available() {
            let found = dispatch_at(level, Points(&points, index));
            for lane in 0..LANES {
                let point = points.get((index[lane] as usize).min(len.saturating_sub(1)));
                for axis in 0..3 {
                    prop_assert_eq!(found[axis][lane], point.map_or(0.0, |p| p[axis]));
                }
            }
        }
    }
}

/// Values by number.
struct Values<'a>(&'a [f32], [u32; LANES]);

impl Kernel for Values<'_> {
    type Output = [f32; LANES];
    #[inline(always)]
    fn run<S: Simd>(self) -> Self::Output {
        S::gather_values(self.0, &self.1).to_array()
    }
}

proptest! {
    #[test]
    fn values_are_gathered_as_they_are_rendered(
        bits in prop::collection::vec(prop_oneof![
            any::<u32>(),
            Just((-0.0f32).to_bits()),
            0u32..0x0080_0000,
            Just(f32::INFINITY.to_bits()),
        ], 0..40),
        index in prop::array::uniform16(prop_oneof![4 => 0u32..40, 1 => any::<u32>()]),
    ) {
        let values: Vec<f32> = bits.iter().map(|&b| f32::from_bits(b)).collect();
        for level in Level::available() {
            let found = dispatch_at(level, Values(&values, index));
            for lane in 0..LANES {
                let value = values.get(index[lane] as usize).map(|v| v.rendered(None));
                let value = value.unwrap_or(f32::NAN);
                let same = found[lane].to_bits() == value.to_bits();
                prop_assert!(same || found[lane].is_nan() && value.is_nan());
            }
        }
    }
}
