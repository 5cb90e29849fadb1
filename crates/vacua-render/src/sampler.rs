//! Values and gradients of structured grids at sixteen places of ray space at once.
//!
//! Point data is trilinear: the two voxels along x come in one fetch, four fetches a cell. Cell data
//! is constant in a cell. A place whose cell has a corner that is not a finite number, or is
//! blanked, has no value.

use vacua_simd::{Float, Int, LANES, Mask, Simd, Voxel, VoxelKind, WideMap, per_axis};
use vacua_skip::{Axis, Bundle, locate_units};
use vacua_volume::CellMask;

use crate::ahead::PointMemory;
use crate::blocks::Group;
use crate::lift::Lift;
use crate::voxels::{Voxels, with_voxels};

/// Anything that has a value at places of ray space.
pub(crate) trait Sampler: Sync {
    /// In which cells places are, where that is too dear to be found again for the gradient.
    type Place: Copy + Default;

    /// Whether it is best asked for the samples of all rays of a tile together.
    const IS_TOGETHER: bool = false;

    /// Values at sixteen places, and where there are any. Only lanes of `lanes` count.
    fn sample<S: Simd>(&self, at: [S::F; 3], lanes: S::M) -> (S::F, S::M, Self::Place);

    /// As [`Sampler::sample`] for sixteen places of each of some rays of a tile: fills in all of the
    /// group but its lanes, which it reads.
    #[inline(always)]
    fn sample_tile<S: Simd>(
        &self,
        places: &[(usize, [S::F; 3])],
        group: &mut Group<S, Self::Place>,
    ) {
        for (n, (_, at)) in places.iter().enumerate() {
            (group.value[n], group.seen[n], group.place[n]) = self.sample::<S>(*at, group.lanes[n]);
        }
    }

    /// Asks for what samples of a beam from one number to another will read.
    #[inline(always)]
    fn fetch_ahead(&self, _: &Bundle, _: [f32; 2]) {}

    /// Gradients in ray space, at places whose cells [`Sampler::sample`] gave.
    fn gradient<S: Simd>(&self, at: [S::F; 3], place: &Self::Place) -> [S::F; 3];
}

/// Point data of a uniform or rectilinear grid.
pub(crate) struct PointSampler<'a> {
    grid: Grid<'a>,
    /// Whether element offsets need more than 31 bits.
    wide: bool,
    /// For asking for values ahead.
    memory: PointMemory<'a>,
    /// The last cell along each axis if cells are of unit size.
    last_unit_cell: Option<[i32; 3]>,
    /// Elements from one row, and from one slice, to the next.
    row: i32,
    slice: i32,
}

/// Cell data of a uniform or rectilinear grid.
pub(crate) struct CellSampler<'a> {
    grid: Grid<'a>,
}

/// What both samplers know of the grid.
pub(crate) struct Grid<'a> {
    /// Cells along each axis.
    pub axes: &'a [Axis; 3],
    /// Values, x fastest.
    pub voxels: Voxels<'a>,
    /// The same as they lie in memory.
    pub bytes: &'a [u8],
    /// Whether all values are plain: finite then are those between them.
    pub plain: bool,
    /// For plain `f32`.
    pub lift: Lift,
    /// How values become what rendering computes with; `None` for the identity.
    pub map: Option<WideMap>,
    /// Cells that hold nothing to see.
    pub blanked_cells: Option<&'a CellMask>,
}

impl Grid<'_> {
    /// Of some lanes those with a finite value in a cell that is not blanked.
    #[inline(always)]
    fn valid<S: Simd>(&self, lanes: S::M, value: S::F, cell: [S::I; 3]) -> S::M {
        let mut valid = lanes;
        if !self.plain {
            valid = valid & value.abs().le(S::F::splat(f32::MAX));
        }
        if self.blanked_cells.is_some() {
            valid = valid & self.seen::<S>(cell);
        }
        valid
    }

    /// The lanes whose cell is not blanked.
    #[inline(always)]
    fn seen<S: Simd>(&self, cell: [S::I; 3]) -> S::M {
        let Some(mask) = self.blanked_cells else {
            return S::M::from_bits(u16::MAX);
        };
        let [nx, ny] = [self.axes[0].cells(), self.axes[1].cells()];
        let (x, y, z) = (cell[0].to_array(), cell[1].to_array(), cell[2].to_array());
        let mut bits = 0;
        for i in 0..LANES {
            let index = x[i] as usize + nx * (y[i] as usize + ny * z[i] as usize);
            bits |= u16::from(!mask.is_blank(index)) << i;
        }
        S::M::from_bits(bits)
    }
}

/// `a + t · (b − a)`, which stays within `[a, b]` for `t` in `[0, 1)`.
#[inline(always)]
fn lerp<F: Float>(t: F, a: F, b: F) -> F {
    t.mul_add(b - a, a)
}

/// Interpolates a pair.
#[inline(always)]
fn mixed<F: Float>(t: F, (a, b): (F, F)) -> F {
    lerp(t, a, b)
}

/// Central differences at the second and third of four values, interpolated between them;
/// `inverse_spans` are one over the distances first to third and second to fourth.
#[inline(always)]
fn slope<F: Float>(v: [F; 4], t: F, inverse_spans: (F, F)) -> F {
    lerp(
        t,
        (v[2] - v[0]) * inverse_spans.0,
        (v[3] - v[1]) * inverse_spans.1,
    )
}

impl<'a> PointSampler<'a> {
    /// A sampler of as many values as there are points.
    ///
    /// # Panics
    /// If there are fewer: the gathers below rely on it.
    pub fn new(grid: Grid<'a>) -> Self {
        let points = grid.axes.each_ref().map(|a| a.cells() + 1);
        assert_eq!(
            grid.voxels.len(),
            points.iter().product::<usize>(),
            "one value a point"
        );
        assert!(points[0] * points[1] < 1 << 31, "31-bit offsets in a slice");
        let wide = grid.voxels.len() >= 1 << 31;
        let unit = |axis: &Axis| matches!(axis, Axis::Unit { .. });
        let last_cells = points.map(|n| n as i32 - 2);
        Self {
            wide,
            memory: PointMemory {
                bytes: grid.bytes,
                points,
            },
            last_unit_cell: grid.axes.iter().all(unit).then_some(last_cells),
            row: points[0] as i32,
            slice: (points[0] * points[1]) as i32,
            grid,
        }
    }

    /// The points (x, y, z) and (x + 1, y, z) of every lane, for many places at once.
    ///
    /// # Safety
    /// Every `x` is a cell index, every `y` and `z` a point index of the grid.
    #[inline(always)]
    unsafe fn rows<S: Simd, const N: usize>(&self, places: &[[S::I; 3]; N]) -> [(S::F, S::F); N] {
        let (row, slice) = (self.row, self.slice);
        let map = self.grid.map;
        let mut rows = [(S::F::splat(0.0), S::F::splat(0.0)); N];
        with_voxels!(self.grid.voxels, values => {
            for i in 0..N {
                let [x, y, z] = places[i];
                let low = y * S::I::splat(row) + x;
                // SAFETY: the point after a cell index is a point, so both lie in the grid; `new`
                // checked that there is a value for each point and that offsets fit their width.
                rows[i] = unsafe {
                    if self.wide {
                        S::voxel_pair(values, 0, S::offsets(z, slice as u32, low), map)
                    } else {
                        S::voxel_pair_32(values, 0, z * S::I::splat(slice) + low, map)
                    }
                };
            }
        });
        rows
    }
}

/// A cell of each lane, and where in it.
struct InCell<S: Simd> {
    cell: [S::I; 3],
    fraction: [S::F; 3],
}

impl PointSampler<'_> {
    /// The cells of places.
    #[inline(always)]
    fn cells<S: Simd>(&self, at: [S::F; 3]) -> InCell<S> {
        if let Some(last) = self.last_unit_cell {
            let (cell, fraction) = locate_units::<S>(at, last);
            return InCell { cell, fraction };
        }
        let [(x, fx), (y, fy), (z, fz)] = per_axis!(a => self.grid.axes[a].locate::<S>(at[a]));
        InCell {
            cell: [x, y, z],
            fraction: [fx, fy, fz],
        }
    }

    /// The four rows of corners (y then z) of cells, which [`PointSampler::cells`] found.
    #[inline(always)]
    fn corners<S: Simd, T: Voxel>(&self, values: &[T], cell: [S::I; 3]) -> [(S::F, S::F); 4] {
        let (row, slice) = (self.row, self.slice);
        let low = cell[1] * S::I::splat(row) + cell[0];
        let map = self.grid.map;
        let (next_row, next_slice) = (row as usize, slice as usize);
        let from = [0, next_row, next_slice, next_slice + next_row];
        let mut rows = [(S::F::splat(0.0), S::F::splat(0.0)); 4];
        // SAFETY: `cells` gives cells of the grid alone, each of which has a point after it on every
        // axis; `new` checked that there is a value for each point and that offsets fit their width.
        unsafe {
            if self.wide {
                let offsets = S::offsets(cell[2], slice as u32, low);
                for i in 0..4 {
                    rows[i] = S::voxel_pair(values, from[i], offsets, map);
                }
            } else {
                let offsets = cell[2] * S::I::splat(slice) + low;
                for i in 0..4 {
                    rows[i] = S::voxel_pair_32(values, from[i], offsets, map);
                }
            }
        }
        rows
    }

    /// The values at places in cells, which [`PointSampler::cells`] found.
    #[inline(always)]
    fn value<S: Simd, T: Voxel>(&self, values: &[T], place: &InCell<S>) -> S::F {
        let is_lifted = T::KIND == VoxelKind::PlainF32;
        let mut rows = self.corners::<S, T>(values, place.cell);
        if is_lifted {
            for row in &mut rows {
                *row = self.grid.lift.raise::<S>(*row);
            }
        }
        let [fx, fy, fz] = place.fraction;
        let front = lerp(fy, mixed(fx, rows[0]), mixed(fx, rows[1]));
        let back = lerp(fy, mixed(fx, rows[2]), mixed(fx, rows[3]));
        let value = lerp(fz, front, back);
        if is_lifted {
            self.grid.lift.lower::<S>(value)
        } else {
            value
        }
    }
}

impl Sampler for PointSampler<'_> {
    type Place = ();

    #[inline(always)]
    fn sample<S: Simd>(&self, at: [S::F; 3], lanes: S::M) -> (S::F, S::M, ()) {
        let place = self.cells::<S>(at);
        let value = with_voxels!(self.grid.voxels, values => self.value(values, &place));
        (value, self.grid.valid::<S>(lanes, value, place.cell), ())
    }

    #[inline(always)]
    fn fetch_ahead(&self, beam: &Bundle, samples: [f32; 2]) {
        if self.last_unit_cell.is_some() {
            self.memory.fetch(beam, samples);
        }
    }

    /// Central differences at the points, interpolated like the values; one-sided at the ends.
    #[inline(always)]
    fn gradient<S: Simd>(&self, at: [S::F; 3], (): &()) -> [S::F; 3] {
        let place = self.cells::<S>(at);
        let ([x, y, z], [fx, fy, fz]) = (place.cell, place.fraction);
        let rows = with_voxels!(self.grid.voxels, values => {
            self.corners::<S, _>(values, place.cell)
        });
        let one = S::I::splat(1);
        let zero = S::I::splat(0);
        // The points before and after the cell along each axis, and one over the distances that
        // the differences at its two ends span.
        let cell = [x, y, z];
        let before = per_axis!(a => (cell[a] - one).max(zero));
        let after = per_axis!(a => {
            (cell[a] + one + one).min(S::I::splat(self.grid.axes[a].cells() as i32))
        });
        let spans = per_axis!(a => self.inverse_spans::<S>(a, before[a], cell[a], after[a]));
        let here = [
            mixed(fx, rows[0]),
            mixed(fx, rows[1]),
            mixed(fx, rows[2]),
            mixed(fx, rows[3]),
        ];
        let (y1, z1) = (y + one, z + one);
        let next = (x + one).min(S::I::splat(self.grid.axes[0].cells() as i32 - 1));
        let [x0, y0, z0] = before;
        let [_, y2, z2] = after;
        let places = [
            [x0, y, z],
            [next, y, z],
            [x0, y1, z],
            [next, y1, z],
            [x0, y, z1],
            [next, y, z1],
            [x0, y1, z1],
            [next, y1, z1],
            [x, y0, z],
            [x, y2, z],
            [x, y0, z1],
            [x, y2, z1],
            [x, y, z0],
            [x, y, z2],
            [x, y1, z0],
            [x, y1, z2],
        ];
        // SAFETY: all indices are clamped to the points of the grid, and first indices of pairs
        // along x to its cells.
        let outer = unsafe { self.rows::<S, 16>(&places) };
        let mut x_slopes = here;
        for i in 0..4 {
            let line = [outer[2 * i].0, rows[i].0, rows[i].1, outer[2 * i + 1].1];
            x_slopes[i] = slope(line, fx, spans[0]);
        }
        let along_x = lerp(
            fz,
            lerp(fy, x_slopes[0], x_slopes[1]),
            lerp(fy, x_slopes[2], x_slopes[3]),
        );
        let mut ring = [fx; 16];
        for i in 8..16 {
            ring[i] = mixed(fx, outer[i]);
        }
        let along_y = lerp(
            fz,
            slope([ring[8], here[0], here[1], ring[9]], fy, spans[1]),
            slope([ring[10], here[2], here[3], ring[11]], fy, spans[1]),
        );
        let along_z = lerp(
            fy,
            slope([ring[12], here[0], here[2], ring[13]], fz, spans[2]),
            slope([ring[14], here[1], here[3], ring[15]], fz, spans[2]),
        );
        [along_x, along_y, along_z]
    }
}

impl PointSampler<'_> {
    /// One over the distances `cell + 1 − before` and `after − cell` along an axis.
    #[inline(always)]
    fn inverse_spans<S: Simd>(
        &self,
        axis: usize,
        before: S::I,
        cell: S::I,
        after: S::I,
    ) -> (S::F, S::F) {
        let one = S::F::splat(1.0);
        match &self.grid.axes[axis] {
            Axis::Unit { .. } => {
                let upper = cell + S::I::splat(1);
                (
                    one.div(S::f_from_i(upper - before)),
                    one.div(S::f_from_i(after - cell)),
                )
            }
            planes => {
                let upper = planes.planes_at::<S>(cell + S::I::splat(1));
                let lower = planes.planes_at::<S>(cell);
                let (first, last) = (planes.planes_at::<S>(before), planes.planes_at::<S>(after));
                (one.div(upper - first), one.div(last - lower))
            }
        }
    }
}

impl<'a> CellSampler<'a> {
    /// A sampler of as many values as there are cells.
    ///
    /// # Panics
    /// If there are fewer: the fetch below relies on it.
    pub fn new(grid: Grid<'a>) -> Self {
        let cells = grid.axes.each_ref().map(Axis::cells);
        assert_eq!(
            grid.voxels.len(),
            cells.iter().product::<usize>(),
            "one value a cell"
        );
        assert!(cells[0] * cells[1] < 1 << 31, "31-bit offsets in a slice");
        Self { grid }
    }
}

impl Sampler for CellSampler<'_> {
    type Place = ();

    #[inline(always)]
    fn sample<S: Simd>(&self, at: [S::F; 3], lanes: S::M) -> (S::F, S::M, ()) {
        let cell = per_axis!(a => self.grid.axes[a].cell::<S>(at[a]));
        let [nx, ny] = [self.grid.axes[0].cells(), self.grid.axes[1].cells()];
        let offsets = S::offsets(
            cell[2],
            (nx * ny) as u32,
            cell[1] * S::I::splat(nx as i32) + cell[0],
        );
        let value = with_voxels!(self.grid.voxels, values => {
            // SAFETY: `cell` clamps to the cells, and `new` checked that there is a value for each.
            unsafe { S::voxel(values, offsets, lanes, self.grid.map) }
        });
        (value, self.grid.valid::<S>(lanes, value, cell), ())
    }

    /// A constant has no gradient.
    #[inline(always)]
    fn gradient<S: Simd>(&self, _: [S::F; 3], (): &()) -> [S::F; 3] {
        [S::F::splat(0.0); 3]
    }
}
