//! The grid to which the boxes of a sub-mesh are quantised, always outward.
//!
//! Source: paper B, §5.3 (first of the two layers of quantisation).
//! Deviation: a step is a power of two and the grid's base a multiple of it. Decoded boxes are then
//! exact in `f32` and in integers, with or without fused multiply-add, so that every kernel on
//! every machine decodes the same box. It costs less than one bit of the sixteen.

use crate::layout::{CHILD_DIVISIONS, GRID_STEPS, SubmeshHeader};

/// Steps and sixteenths of them have to stay normal numbers of `f32`.
const MIN_EXPONENT: i32 = -120;

/// A regular grid over a sub-mesh, relative to its origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Lower corner.
    pub base: [f64; 3],
    /// A step along each axis is 2 to this.
    pub exponent: [i32; 3],
}

impl Grid {
    /// The finest grid whose [`GRID_STEPS`] steps span a box.
    pub fn new(lo: [f32; 3], hi: [f32; 3]) -> Self {
        Self::with_steps(lo, hi, GRID_STEPS)
    }

    /// The finest grid that spans a box with so many steps, at least 2 and at most [`GRID_STEPS`].
    pub fn with_steps(lo: [f32; 3], hi: [f32; 3], steps: u32) -> Self {
        let mut grid = Self {
            base: [0.0; 3],
            exponent: [0; 3],
        };
        for axis in 0..3 {
            let (lo, hi) = (f64::from(lo[axis]), f64::from(hi[axis]));
            // One step is lost to rounding the base down.
            let step = (hi - lo) / f64::from(steps - 1);
            let largest = lo.abs().max(hi.abs());
            let exponent = ceil_log2(step)
                .max(ceil_log2(largest) - (f32::MANTISSA_DIGITS as i32 - 1))
                .max(MIN_EXPONENT);
            grid.exponent[axis] = exponent;
            // Never past the end of `f32`, which is a multiple of any step that large.
            let base = (lo * exp2(-exponent)).floor() * exp2(exponent);
            grid.base[axis] = base.max(f64::from(f32::MIN));
        }
        grid
    }

    /// The grid of a sub-mesh.
    pub fn of(header: &SubmeshHeader) -> Self {
        Self {
            base: header.grid_base,
            exponent: header.grid_exponent,
        }
    }

    /// A box in whole steps, rounded outward. The box must lie within the one the grid was made for.
    pub fn quantise(&self, lo: [f32; 3], hi: [f32; 3]) -> ([u16; 3], [u16; 3]) {
        let mut result = ([0; 3], [0; 3]);
        for axis in 0..3 {
            let (base, step) = (self.base[axis], exp2(self.exponent[axis]));
            let (lo, hi) = (f64::from(lo[axis]), f64::from(hi[axis]));
            let mut a = ((lo - base) / step).floor();
            let mut b = ((hi - base) / step).ceil();
            // `base + k · step` is exact, the differences above may not be.
            if base + a * step > lo {
                a -= 1.0;
            }
            if base + b * step < hi {
                b += 1.0;
            }
            result.0[axis] = a as u16;
            result.1[axis] = b as u16;
        }
        result
    }

    /// A position in steps: rounded, monotone, hence on the right side of every plane of the grid.
    #[inline(always)]
    pub fn grid_from_local(&self, local: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|axis| (local[axis] - self.base[axis]) * exp2(-self.exponent[axis]))
    }

    /// A place in sixteenths of a step, relative to the sub-mesh's origin. Exact.
    pub fn local_from_sixteenths(&self, place: [u32; 3]) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.local_from_sixteenths_along(axis, place[axis]))
    }

    /// One component of [`Self::local_from_sixteenths`].
    #[inline(always)]
    pub fn local_from_sixteenths_along(&self, axis: usize, place: u32) -> f64 {
        let sixteenth = 1.0 / f64::from(CHILD_DIVISIONS);
        self.base[axis] + f64::from(place) * (sixteenth * exp2(self.exponent[axis]))
    }
}

/// The power of two, for exponents of normal numbers.
#[inline(always)]
pub fn exp2(exponent: i32) -> f64 {
    f64::from_bits(((exponent + 1023).clamp(1, 2046) as u64) << 52)
}

/// The least `e` with `2^e >= value`; a very small number for 0.
pub fn ceil_log2(value: f64) -> i32 {
    let bits = value.to_bits();
    let exponent = ((bits >> 52) & 0x7FF) as i32 - 1023;
    exponent + i32::from(bits << 12 != 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::MultiLeaf;
    use proptest::prelude::*;

    #[test]
    fn powers_of_two() {
        for e in [-1000, -126, -1, 0, 1, 23, 128, 1000] {
            assert_eq!(exp2(e), 2f64.powi(e));
            assert_eq!(ceil_log2(2f64.powi(e)), e);
            assert_eq!(ceil_log2(2f64.powi(e) * 1.001), e + 1);
        }
        assert!(ceil_log2(0.0) < -1000);
    }

    fn ordered(a: [f32; 3], b: [f32; 3]) -> ([f32; 3], [f32; 3]) {
        (
            [0, 1, 2].map(|i| a[i].min(b[i])),
            [0, 1, 2].map(|i| a[i].max(b[i])),
        )
    }

    fn coordinate() -> impl Strategy<Value = f32> {
        prop_oneof![
            -1.0f32..1.0,
            -1e9f32..1e9,
            -1e-9f32..1e-9,
            1e6f32..1.000001e6,
            Just(0.0),
            Just(-1e-30),
            Just(f32::MAX),
            Just(f32::MIN),
            Just(f32::MIN_POSITIVE / 8.0),
        ]
    }

    fn point() -> impl Strategy<Value = [f32; 3]> {
        prop::array::uniform3(coordinate())
    }

    proptest! {
        /// Both layers of quantisation contain what they stand for, exactly.
        #[test]
        fn decoded_boxes_contain_their_boxes(points in prop::collection::vec(point(), 8)) {
            let around = |p: &[[f32; 3]]| p.iter().skip(1).fold((p[0], p[0]), |(lo, hi), &q| {
                (ordered(lo, q).0, ordered(hi, q).1)
            });
            let (lo, hi) = around(&points);
            let grid = Grid::new(lo, hi);
            let (node_lo, node_hi) = around(&points[..6]);
            let (qlo, qhi) = grid.quantise(node_lo, node_hi);
            let mut node = MultiLeaf { lo: qlo, hi: qhi, ..MultiLeaf::EMPTY };
            for (child, pair) in points[..6].chunks(2).enumerate() {
                let (lo, hi) = around(pair);
                node.set_child_box(child, &grid, lo, hi);
                let (clo, chi) = node.child_box(child);
                let inside = (grid.local_from_sixteenths(clo), grid.local_from_sixteenths(chi));
                for axis in 0..3 {
                    prop_assert!(inside.0[axis] <= f64::from(lo[axis]));
                    prop_assert!(inside.1[axis] >= f64::from(hi[axis]));
                }
                // The test that traversal makes, in f64 and in f32.
                for p in pair {
                    let g = grid.grid_from_local(p.map(f64::from)).map(|g| 16.0 * g);
                    for axis in 0..3 {
                        prop_assert!(f64::from(clo[axis]) <= g[axis]);
                        prop_assert!(f64::from(chi[axis]) >= g[axis]);
                        let base = grid.base[axis] as f32;
                        // The difference itself overflows at the ends of f32.
                        if (hi[axis] - base).is_finite() && grid.exponent[axis] < 100 {
                            let g = (p[axis] - base) * exp2(4 - grid.exponent[axis]) as f32;
                            prop_assert!(clo[axis] as f32 <= g && g <= chi[axis] as f32);
                        }
                    }
                }
            }
            let corners = (node_lo, node_hi);
            let decoded_lo = grid.local_from_sixteenths(qlo.map(|q| 16 * u32::from(q)));
            let decoded_hi = grid.local_from_sixteenths(qhi.map(|q| 16 * u32::from(q)));
            for axis in 0..3 {
                prop_assert!(decoded_lo[axis] <= f64::from(corners.0[axis]));
                prop_assert!(decoded_hi[axis] >= f64::from(corners.1[axis]));
            }
        }
    }
}
