//! The macrocell grid: the range of the values that sampling can compute in each macrocell
//! (paper A §4.1.1).
//!
//! For point data a macrocell of K cells a side takes K + 1 points a side into account: those of
//! the upper faces belong to both neighbours. Interpolation never leaves the range of a cell's
//! corners (`vacua_skip`'s fractions stay below 1), and the macrocell of a sample is decided by
//! the same arithmetic as its cell, so that nothing further need be added. Values that are not
//! numbers are left out: a sample that touches one shows nothing.

use rayon::prelude::*;
use vacua_simd::{Kernel, LANES, Simd, dispatch};
use vacua_volume::{Association, CellMask, DataArray, Scalar, ValueMap, dispatch_scalar};

use crate::lattice::{Lattice, LatticeError};

/// Values on the points or cells of a structured grid.
#[derive(Clone, Copy, Debug)]
pub struct PointSource<'a> {
    /// One number a point or cell, x fastest.
    pub scalars: &'a DataArray,
    /// Which of the two.
    pub association: Association,
    /// Points a side.
    pub points: [usize; 3],
    /// How values become what rendering computes with.
    pub map: ValueMap,
    /// Cells that hold nothing to see.
    pub blanked_cells: Option<&'a CellMask>,
}

/// A value range a macrocell, in rendered values; empty ranges have `lo > hi`.
#[derive(Clone, Debug)]
pub struct Macrocells {
    lattice: Lattice,
    lo: Vec<f32>,
    hi: Vec<f32>,
}

impl Macrocells {
    /// Computes the ranges of a structured grid, in parallel.
    ///
    /// Cost: one pass over the voxels, of which those on macrocell faces are read twice.
    pub fn of_grid(lattice: Lattice, source: PointSource<'_>) -> Self {
        let mut cells = Self::empty(lattice);
        dispatch_scalar!(source.scalars.scalar_type(), T => {
            let values = bytemuck_slice::<T>(source.scalars);
            cells.fill::<T>(values, &source);
        });
        cells
    }

    /// Macrocells of which none contains anything yet.
    fn empty(lattice: Lattice) -> Self {
        // Classification reads whole vectors, hence the padding.
        let padded = lattice.len() + LANES;
        Self {
            lattice,
            lo: vec![f32::INFINITY; padded],
            hi: vec![f32::NEG_INFINITY; padded],
        }
    }

    /// The ranges of items (cells of a curvilinear grid or a mesh) by their boxes in ray space: a
    /// macrocell's range covers all items whose box touches it.
    pub fn of_boxes(
        lattice: Lattice,
        items: impl Iterator<Item = ([[f32; 3]; 2], [f32; 2])>,
    ) -> Self {
        let mut cells = Self::empty(lattice);
        let [nx, ny, _] = cells.lattice.counts();
        for ([lo, hi], range) in items {
            let from = [0, 1, 2].map(|a| cells.lattice.macrocell_of(a, lo[a]));
            let to = [0, 1, 2].map(|a| cells.lattice.macrocell_of(a, hi[a]));
            for z in from[2]..=to[2] {
                for y in from[1]..=to[1] {
                    for x in from[0]..=to[0] {
                        let i = x + nx * (y + ny * z);
                        cells.lo[i] = cells.lo[i].min(range[0]);
                        cells.hi[i] = cells.hi[i].max(range[1]);
                    }
                }
            }
        }
        cells
    }

    /// The same ranges over macrocells `factor` times as long a side.
    ///
    /// # Errors
    /// [`LatticeError::ZeroSide`] for factor 0.
    pub fn coarser(&self, factor: usize) -> Result<Self, LatticeError> {
        let lattice = Lattice::new(
            self.lattice.axes().clone(),
            self.lattice.side().saturating_mul(factor),
        )?;
        let mut coarse = Self::empty(lattice);
        let ([nx, ny, nz], [cx, cy, _]) = (self.lattice.counts(), coarse.lattice.counts());
        for z in 0..nz {
            for y in 0..ny {
                for x in 0..nx {
                    let (i, j) = (
                        x + nx * (y + ny * z),
                        x / factor + cx * (y / factor + cy * (z / factor)),
                    );
                    coarse.lo[j] = coarse.lo[j].min(self.lo[i]);
                    coarse.hi[j] = coarse.hi[j].max(self.hi[i]);
                }
            }
        }
        Ok(coarse)
    }

    /// Where the macrocells are.
    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// Range of one macrocell, in rendered values; `None` if nothing is there.
    ///
    /// # Panics
    /// If the macrocell is out of range.
    pub fn range(&self, index: usize) -> Option<(f32, f32)> {
        assert!(
            index < self.lattice.len(),
            "macrocell {index} of {}",
            self.lattice.len()
        );
        let (lo, hi) = (self.lo[index], self.hi[index]);
        (lo <= hi).then_some((lo, hi))
    }

    /// Lower ends, with [`LANES`] entries of padding.
    pub(crate) fn lo(&self) -> &[f32] {
        &self.lo
    }

    /// Upper ends, with [`LANES`] entries of padding.
    pub(crate) fn hi(&self) -> &[f32] {
        &self.hi
    }

    /// Bytes of the ranges.
    pub fn size_bytes(&self) -> usize {
        size_of_val(self.lo.as_slice()) + size_of_val(self.hi.as_slice())
    }

    fn fill<T: Scalar + Extremes>(&mut self, values: &[T], source: &PointSource<'_>) {
        let [cx, cy, cz] = self.lattice.counts();
        let slab = cx * cy;
        let lattice = &self.lattice;
        let side = lattice.side();
        // Values a side, and how many beyond the last cell of a macrocell belong to it.
        let (values_a_side, apron) = match source.association {
            Association::Point => (source.points, 1),
            Association::Cell => (source.points.map(|n| n - 1), 0),
        };
        let map = source.map;
        // A task is a row of macrocells, so that even flat volumes keep all threads busy.
        let rows_lo = self.lo[..slab * cz].par_chunks_mut(cx);
        let rows_hi = self.hi[..slab * cz].par_chunks_mut(cx);
        rows_lo.zip(rows_hi).enumerate().for_each_init(
            || {
                (
                    vec![T::HIGHEST; values_a_side[0]],
                    vec![T::LOWEST; values_a_side[0]],
                )
            },
            |(min, max), (row, (lo, hi))| {
                let (my, mz) = (row % cy, row / cy);
                let span = |m: usize, n: usize| m * side..((m + 1) * side + apron).min(n);
                dispatch(RowExtremes {
                    values,
                    size: values_a_side,
                    y: span(my, values_a_side[1]),
                    z: span(mz, values_a_side[2]),
                    min,
                    max,
                });
                for mx in 0..cx {
                    let span = span(mx, values_a_side[0]);
                    let least = min[span.clone()]
                        .iter()
                        .fold(T::HIGHEST, |a, &b| T::least(a, b));
                    let most = max[span].iter().fold(T::LOWEST, |a, &b| T::most(a, b));
                    if least <= most {
                        lo[mx] = map.rendered(least.to_f64());
                        hi[mx] = map.rendered(most.to_f64());
                    }
                }
                if let Some(mask) = source.blanked_cells {
                    let cells = source.points.map(|n| n - 1);
                    for mx in 0..cx {
                        if all_blank(mask, cells, side, [mx, my, mz]) {
                            (lo[mx], hi[mx]) = (f32::INFINITY, f32::NEG_INFINITY);
                        }
                    }
                }
            },
        );
    }
}

/// Whether every cell of a macrocell is blanked.
fn all_blank(mask: &CellMask, cells: [usize; 3], side: usize, at: [usize; 3]) -> bool {
    let span = |a: usize| at[a] * side..((at[a] + 1) * side).min(cells[a]);
    span(2)
        .all(|z| span(1).all(|y| span(0).all(|x| mask.is_blank(x + cells[0] * (y + cells[1] * z)))))
}

/// The numbers of an array that has this type.
fn bytemuck_slice<T: Scalar>(array: &DataArray) -> &[T] {
    match array.as_slice() {
        Some(slice) => slice,
        None => unreachable!("dispatched on the array's own type"),
    }
}

/// Minimum and maximum that leave NaN out.
trait Extremes: Copy {
    const LOWEST: Self;
    const HIGHEST: Self;
    fn least(a: Self, b: Self) -> Self;
    fn most(a: Self, b: Self) -> Self;
}

macro_rules! impl_extremes {
    ($($t:ty: $lowest:expr, $highest:expr;)*) => {$(
        impl Extremes for $t {
            const LOWEST: Self = $lowest;
            const HIGHEST: Self = $highest;
            #[inline(always)]
            fn least(a: Self, b: Self) -> Self { if b < a { b } else { a } }
            #[inline(always)]
            fn most(a: Self, b: Self) -> Self { if b > a { b } else { a } }
        }
    )*};
}
impl_extremes! {
    u8: u8::MIN, u8::MAX; i8: i8::MIN, i8::MAX;
    u16: u16::MIN, u16::MAX; i16: i16::MIN, i16::MAX;
    u32: u32::MIN, u32::MAX; i32: i32::MIN, i32::MAX;
    u64: u64::MIN, u64::MAX; i64: i64::MIN, i64::MAX;
    f32: f32::NEG_INFINITY, f32::INFINITY; f64: f64::NEG_INFINITY, f64::INFINITY;
}

/// Elementwise extremes of a bundle of rows: what remains is to reduce along x.
struct RowExtremes<'a, T> {
    values: &'a [T],
    size: [usize; 3],
    y: std::ops::Range<usize>,
    z: std::ops::Range<usize>,
    min: &'a mut [T],
    max: &'a mut [T],
}

impl<T: Extremes> Kernel for RowExtremes<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self) {
        let [nx, ny, _] = self.size;
        self.min.fill(T::HIGHEST);
        self.max.fill(T::LOWEST);
        for z in self.z {
            for y in self.y.clone() {
                let row = &self.values[nx * (y + ny * z)..][..nx];
                for ((min, max), &v) in self.min.iter_mut().zip(self.max.iter_mut()).zip(row) {
                    *min = T::least(*min, v);
                    *max = T::most(*max, v);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lattice::Axis;
    use proptest::prelude::*;

    fn lattice(points: [usize; 3], side: usize) -> Lattice {
        Lattice::new(points.map(|n| Axis::Unit { cells: n - 1 }), side).expect("cells on each axis")
    }

    proptest! {
        #[test]
        fn ranges_are_those_of_the_values_a_side(
            points in prop::array::uniform3(2usize..20),
            side in 1usize..9,
            seed in any::<u32>(),
            cell_data in any::<bool>(),
        ) {
            let n = if cell_data { points.map(|p| p - 1) } else { points };
            let noise = |i: usize| {
                let h = (i as u32 ^ seed).wrapping_mul(2654435761) >> 8;
                if h.is_multiple_of(7) { f32::NAN } else { h as f32 * 1e-3 }
            };
            let values: Vec<f32> = (0..n.iter().product()).map(noise).collect();
            let scalars = DataArray::from_vec(values.clone(), 1).expect("one component");
            let association = if cell_data { Association::Cell } else { Association::Point };
            let map = ValueMap::IDENTITY;
            let source = PointSource { scalars: &scalars, association, points, map, blanked_cells: None };
            let cells = Macrocells::of_grid(lattice(points, side), source);
            let counts = cells.lattice().counts();
            let apron = usize::from(!cell_data);
            for z in 0..counts[2] { for y in 0..counts[1] { for x in 0..counts[0] {
                let mut expected: Option<(f32, f32)> = None;
                for k in z * side..((z + 1) * side + apron).min(n[2]) {
                    for j in y * side..((y + 1) * side + apron).min(n[1]) {
                        for i in x * side..((x + 1) * side + apron).min(n[0]) {
                            let v = values[i + n[0] * (j + n[1] * k)];
                            if !v.is_nan() {
                                let (lo, hi) = expected.unwrap_or((v, v));
                                expected = Some((lo.min(v), hi.max(v)));
                            }
                        }
                    }
                }
                prop_assert_eq!(cells.range(x + counts[0] * (y + counts[1] * z)), expected);
            }}}
            let direct = Macrocells::of_grid(lattice(points, side * 2), source);
            let coarse = cells.coarser(2).expect("factor is 2");
            for i in 0..direct.lattice().len() {
                prop_assert_eq!(direct.range(i), coarse.range(i));
            }
        }
    }

    #[test]
    fn macrocells_of_blanked_cells_are_empty() {
        let points = [5, 3, 3];
        let scalars = DataArray::from_vec(vec![1u8; 45], 1).expect("one component");
        let mut mask = CellMask::new(16);
        for cell in [0, 1, 4, 5, 8, 9, 12, 13, 2] {
            mask.blank(cell);
        }
        let source = PointSource {
            scalars: &scalars,
            association: Association::Point,
            points,
            map: ValueMap::IDENTITY,
            blanked_cells: Some(&mask),
        };
        let cells = Macrocells::of_grid(lattice(points, 2), source);
        assert_eq!(cells.range(0), None);
        assert_eq!(cells.range(1), Some((1.0, 1.0)));
    }
}
