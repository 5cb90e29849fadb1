//! Ray space: cells between axis-aligned planes, macrocells of K cells a side, and the one
//! function that says in which cell a coordinate lies.

use vacua_simd::{Float, Int, LANES, Mask, Simd, per_axis};

/// Most cells along one axis: below it, every step of [`Lattice::macrocell`] is exact in `f32`.
pub const MAX_CELLS_PER_AXIS: usize = 1 << 21;

/// The largest `f32` below 1: interpolation fractions stay at or below it, so that
/// `fma(t, b − a, a)` never leaves `[a, b]` (the rounding of `b − a` cannot carry it past `b`).
const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;

/// Why cells make no lattice.
#[derive(Clone, Debug, thiserror::Error, PartialEq, Eq)]
pub enum LatticeError {
    /// An axis without cells or with too many.
    #[error("{cells} cells along axis {axis}; there must be 1 to {MAX_CELLS_PER_AXIS}")]
    Cells {
        /// 0, 1 or 2.
        axis: usize,
        /// Cells there.
        cells: usize,
    },
    /// A macrocell side of zero cells.
    #[error("macrocells need at least one cell a side")]
    ZeroSide,
}

/// Where the planes between cells lie along one axis of ray space.
#[derive(Clone, Debug)]
pub enum Axis {
    /// Cell `c` spans `c..c + 1`.
    Unit {
        /// Number of cells.
        cells: usize,
    },
    /// Cell `c` spans `planes[c]..planes[c + 1]`.
    Planes(Planes),
}

/// [`Axis::locate`] for cells of unit size, given the last of them.
#[inline(always)]
pub fn locate_unit<S: Simd>(coordinate: S::F, last_cell: i32) -> (S::I, S::F) {
    let inside = coordinate.max(S::F::splat(0.0));
    // What is too large for an integer is large as unsigned one.
    let cell = inside.to_i().min_unsigned(S::I::splat(last_cell));
    let fraction = (inside - S::f_from_i(cell)).min(S::F::splat(BELOW_ONE));
    (cell, fraction)
}

/// [`Axis::locate`] on three axes with cells of unit size, given the last of each; quicker where nothing
/// needs to be clamped. A lane with a negative coordinate may then have a fraction between −1 and 0; its
/// cells are cells all the same.
#[inline(always)]
pub fn locate_units<S: Simd>(at: [S::F; 3], last_cell: [i32; 3]) -> ([S::I; 3], [S::F; 3]) {
    let cell = per_axis!(a => at[a].to_i());
    let within = cell[0].le_unsigned(S::I::splat(last_cell[0]))
        & cell[1].le_unsigned(S::I::splat(last_cell[1]))
        & cell[2].le_unsigned(S::I::splat(last_cell[2]));
    if within.all() {
        return (cell, per_axis!(a => at[a].fraction()));
    }
    let [(x, fx), (y, fy), (z, fz)] = per_axis!(a => locate_unit::<S>(at[a], last_cell[a]));
    ([x, y, z], [fx, fy, fz])
}

/// Increasing plane coordinates with a table that starts the search near its end.
#[derive(Clone, Debug)]
pub struct Planes {
    planes: Vec<f32>,
    /// For each bin of coordinates a cell that begins before every coordinate in the bin.
    first_cell: Vec<u32>,
    bins_per_unit: f32,
}

impl Axis {
    /// An axis with planes at the given coordinates, which must not decrease.
    pub fn planes(planes: Vec<f32>) -> Self {
        let cells = planes.len() - 1;
        let num_bins = 4 * cells;
        let width = planes[cells] - planes[0];
        let bins_per_unit = if width > 0.0 {
            num_bins as f32 / width
        } else {
            0.0
        };
        let mut axis = Planes {
            planes,
            first_cell: vec![0; num_bins],
            bins_per_unit,
        };
        let mut cell = 0;
        for bin in 0..num_bins {
            while cell + 1 < cells && axis.bin(axis.planes[cell + 1]) < bin {
                cell += 1;
            }
            axis.first_cell[bin] = cell as u32;
        }
        Self::Planes(axis)
    }

    /// Number of cells.
    pub fn cells(&self) -> usize {
        match self {
            Self::Unit { cells } => *cells,
            Self::Planes(axis) => axis.planes.len() - 1,
        }
    }

    /// Coordinate of plane `i`, `0..=cells`.
    pub fn plane(&self, i: usize) -> f32 {
        match self {
            Self::Unit { .. } => i as f32,
            Self::Planes(axis) => axis.planes[i],
        }
    }

    /// Coordinates of planes, each `0..=cells`.
    #[inline(always)]
    pub fn planes_at<S: Simd>(&self, index: S::I) -> S::F {
        match self {
            Self::Unit { .. } => S::f_from_i(index),
            Self::Planes(axis) => {
                let clamped = index
                    .max(S::I::splat(0))
                    .min(S::I::splat(self.cells() as i32));
                // SAFETY: the index was clamped to the planes.
                unsafe { S::gather(&axis.planes, clamped) }
            }
        }
    }

    /// The cell of each coordinate, clamped to the axis, as a whole number, and the fraction of
    /// the way through it, in `[0, 1)`.
    #[inline(always)]
    pub fn locate<S: Simd>(&self, coordinate: S::F) -> (S::I, S::F) {
        match self {
            Self::Unit { cells } => locate_unit::<S>(coordinate, *cells as i32 - 1),
            Self::Planes(axis) => {
                let cell = axis.search::<S>(coordinate);
                // SAFETY: `search` gives cells below `planes.len() − 1`.
                let (lo, hi) = unsafe { S::gather_pair(&axis.planes, cell) };
                let fraction = (coordinate - lo).div(hi - lo);
                let fraction = fraction.max(S::F::splat(0.0)).min(S::F::splat(BELOW_ONE));
                (cell, fraction)
            }
        }
    }

    /// The cell of each coordinate, clamped to the axis.
    #[inline(always)]
    pub fn cell<S: Simd>(&self, coordinate: S::F) -> S::I {
        match self {
            Self::Unit { cells } => {
                let last = S::F::splat((*cells - 1) as f32);
                coordinate.max(S::F::splat(0.0)).min(last).to_i()
            }
            Self::Planes(axis) => axis.search::<S>(coordinate),
        }
    }

    /// The cell of one coordinate: the scalar twin of [`Axis::cell`].
    pub fn cell_of(&self, coordinate: f32) -> usize {
        let clamped = |cell: usize| cell.min(self.cells() - 1);
        match self {
            Self::Unit { .. } => clamped(coordinate.max(0.0) as usize),
            Self::Planes(axis) => clamped(
                axis.planes
                    .partition_point(|&p| p <= coordinate)
                    .saturating_sub(1),
            ),
        }
    }
}

impl Planes {
    /// Bin of a coordinate, monotone; the scalar twin of the first step of [`Planes::search`].
    fn bin(&self, coordinate: f32) -> usize {
        let bin = (coordinate - self.planes[0]) * self.bins_per_unit;
        (bin.max(0.0) as usize).min(self.first_cell.len() - 1)
    }

    /// The last cell that begins at or before each coordinate, clamped to the axis.
    #[inline(always)]
    fn search<S: Simd>(&self, coordinate: S::F) -> S::I {
        let last_bin = S::F::splat((self.first_cell.len() - 1) as f32);
        let bin = (coordinate - S::F::splat(self.planes[0])) * S::F::splat(self.bins_per_unit);
        let bin = bin.max(S::F::splat(0.0)).min(last_bin).to_i();
        // SAFETY: the bin was clamped to the table.
        let mut cell = unsafe { S::gather_u32(&self.first_cell, bin) };
        let last_cell = S::I::splat(self.planes.len() as i32 - 2);
        loop {
            // SAFETY: cells never pass `last_cell`, whose upper plane is the last one.
            let (_, upper) = unsafe { S::gather_pair(&self.planes, cell) };
            let advance = upper.le(coordinate) & cell.lt(last_cell);
            if !advance.any() {
                return cell;
            }
            let bits = advance.to_bits();
            let step: [i32; LANES] = std::array::from_fn(|i| i32::from(bits >> i & 1));
            cell = cell + S::I::from_array(step);
        }
    }
}

/// Cells and macrocells of ray space.
#[derive(Clone, Debug)]
pub struct Lattice {
    axes: [Axis; 3],
    side: usize,
    counts: [usize; 3],
}

impl Lattice {
    /// Groups cells into macrocells of `side` cells (the papers' K); those at the upper ends may
    /// have fewer.
    ///
    /// # Errors
    /// [`LatticeError`] for no cells, too many, or `side` 0.
    pub fn new(axes: [Axis; 3], side: usize) -> Result<Self, LatticeError> {
        if side == 0 {
            return Err(LatticeError::ZeroSide);
        }
        for (axis, cells) in axes.iter().map(Axis::cells).enumerate() {
            if cells == 0 || cells > MAX_CELLS_PER_AXIS {
                return Err(LatticeError::Cells { axis, cells });
            }
        }
        let counts = [0, 1, 2].map(|a| axes[a].cells().div_ceil(side));
        Ok(Self { axes, side, counts })
    }

    /// The axes.
    pub fn axes(&self) -> &[Axis; 3] {
        &self.axes
    }

    /// Cells a side of a macrocell (K).
    pub fn side(&self) -> usize {
        self.side
    }

    /// Macrocells along each axis.
    pub fn counts(&self) -> [usize; 3] {
        self.counts
    }

    /// Number of macrocells.
    pub fn len(&self) -> usize {
        self.counts.iter().product()
    }

    /// Whether there are no macrocells; never, as each axis has a cell.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Coordinate of macrocell plane `i`, `0..=counts[axis]`.
    pub fn plane(&self, axis: usize, i: usize) -> f32 {
        let axis = &self.axes[axis];
        axis.plane((i * self.side).min(axis.cells()))
    }

    /// The macrocell of each coordinate along one axis, clamped to the lattice.
    ///
    /// `⌊c / K⌋` as `⌊(c + ½) · (1/K)⌋`: no multiple of 1/K is nearer to `(c + ½)/K` than ½/K,
    /// which exceeds the rounding error for fewer than [`MAX_CELLS_PER_AXIS`] cells.
    #[inline(always)]
    pub fn macrocell<S: Simd>(&self, axis: usize, coordinate: S::F) -> S::I {
        let inverse_side = S::F::splat(1.0 / self.side as f32);
        if self.side.is_power_of_two() && matches!(self.axes[axis], Axis::Unit { .. }) {
            // The product is exact: no need to find the cell first.
            return (coordinate * inverse_side)
                .max(S::F::splat(0.0))
                .min(S::F::splat((self.counts[axis] - 1) as f32))
                .to_i();
        }
        let cell = S::f_from_i(self.axes[axis].cell::<S>(coordinate));
        ((cell + S::F::splat(0.5)) * inverse_side).to_i()
    }

    /// The macrocell of one coordinate along one axis.
    pub fn macrocell_of(&self, axis: usize, coordinate: f32) -> usize {
        self.axes[axis].cell_of(coordinate) / self.side
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use vacua_simd::Kernel;

    struct Locate<'a>(&'a Lattice, [f32; LANES]);
    impl Kernel for Locate<'_> {
        type Output = ([i32; LANES], [f32; LANES], [i32; LANES]);
        #[inline(always)]
        fn run<S: Simd>(self) -> Self::Output {
            let x = S::F::from_array(self.1);
            let (cell, fraction) = self.0.axes[0].locate::<S>(x);
            let macrocell = self.0.macrocell::<S>(0, x);
            (cell.to_array(), fraction.to_array(), macrocell.to_array())
        }
    }

    /// Cells and fractions on three axes, together and one by one.
    struct LocateUnits([[f32; LANES]; 3], [i32; 3]);
    impl Kernel for LocateUnits {
        type Output = [[([i32; LANES], [f32; LANES]); 3]; 2];
        #[inline(always)]
        fn run<S: Simd>(self) -> Self::Output {
            let Self(at, last) = self;
            let at = per_axis!(a => S::F::from_array(at[a]));
            let (cell, fraction) = locate_units::<S>(at, last);
            let together = per_axis!(a => (cell[a].to_array(), fraction[a].to_array()));
            let alone = per_axis!(a => {
                let (cell, fraction) = locate_unit::<S>(at[a], last[a]);
                (cell.to_array(), fraction.to_array())
            });
            [together, alone]
        }
    }

    /// Numbers as a coordinate between 0 and `cells`, and such as are none.
    fn coordinate(cells: i32, inside: bool) -> BoxedStrategy<f32> {
        let next_below = |c: i32| (c as f32).next_down().max(0.0);
        let within = prop_oneof![
            (0..cells, 0.0f32..1.0).prop_map(move |(c, f)| (c as f32 + f).min(next_below(cells))),
            (0..cells).prop_map(|c| c as f32),
            (1..=cells).prop_map(next_below),
        ];
        if inside {
            return within.boxed();
        }
        prop_oneof![within, Just(cells as f32), -3.0f32..1e3, any::<f32>()].boxed()
    }

    proptest! {
        #[test]
        fn three_axes_together_are_three_axes_alone(
            (last, at) in (prop::array::uniform3(1i32..40), any::<bool>()).prop_flat_map(|(cells, inside)| {
                let at = cells.map(|n| prop::collection::vec(coordinate(n, inside), LANES));
                (Just(cells.map(|n| n - 1)), at)
            }),
        ) {
            let mut places = [[0.0; LANES]; 3];
            for (to, from) in places.iter_mut().zip(&at) {
                to.copy_from_slice(from);
            }
            for level in vacua_simd::Level::available() {
                let [together, alone] = vacua_simd::dispatch_at(level, LocateUnits(places, last));
                for (a, (lane, &x)) in (0..3).flat_map(|a| places[a].iter().enumerate().map(move |p| (a, p))) {
                    let (cell, fraction) = (together[a].0[lane], together[a].1[lane]);
                    prop_assert!((0..=last[a]).contains(&cell), "{} at {}", cell, x);
                    if (0.0..=last[a] as f32 + 1.0).contains(&x) {
                        prop_assert_eq!((cell, fraction), (alone[a].0[lane], alone[a].1[lane]), "at {}", x);
                    }
                }
            }
        }

        #[test]
        fn cells_contain_their_coordinates(
            steps in prop::collection::vec(prop_oneof![Just(1e-6f32), 0.01f32..10.0], 1..40),
            picks in prop::array::uniform16((any::<prop::sample::Index>(), -0.5f32..1.5)),
            side in 1usize..9,
            unit in any::<bool>(),
        ) {
            let mut planes = vec![-3.0f32];
            for step in &steps {
                planes.push(planes[planes.len() - 1] + step);
            }
            let axis = if unit { Axis::Unit { cells: steps.len() } } else { Axis::planes(planes) };
            let at = |i: usize| axis.plane(i);
            let x = picks.map(|(i, f)| {
                let c = i.index(steps.len());
                at(c) + f * (at(c + 1) - at(c))
            });
            let lattice = Lattice::new([axis.clone(), axis.clone(), axis.clone()], side)
                .expect("a few cells");
            for level in vacua_simd::Level::available() {
                let (cells, fractions, macrocells) =
                    vacua_simd::dispatch_at(level, Locate(&lattice, x));
                for lane in 0..LANES {
                    let c = cells[lane] as usize;
                    prop_assert!(c < steps.len());
                    prop_assert!(x[lane] >= at(c) || c == 0);
                    prop_assert!(x[lane] < at(c + 1) || c + 1 == steps.len());
                    prop_assert!((0.0..1.0).contains(&fractions[lane]));
                    prop_assert_eq!(macrocells[lane] as usize, c / side);
                    prop_assert_eq!(axis.cell_of(x[lane]), c);
                }
            }
        }
    }

    #[test]
    fn every_macrocell_index_is_exact_up_to_the_limit() {
        let axis = Axis::Unit {
            cells: MAX_CELLS_PER_AXIS,
        };
        for side in [1, 3, 5, 7, 8, 10, 31, 33, 1000] {
            let lattice = Lattice::new([axis.clone(), axis.clone(), axis.clone()], side)
                .expect("within the limit");
            for multiple in 0..MAX_CELLS_PER_AXIS / side {
                for cell in [multiple * side, (multiple * side).saturating_sub(1)] {
                    let inverse = 1.0 / side as f32;
                    let computed = ((cell as f32 + 0.5) * inverse) as usize;
                    assert_eq!(computed, cell / side, "{cell} / {side}");
                }
            }
            assert_eq!(
                lattice.macrocell_of(0, 1e9),
                (MAX_CELLS_PER_AXIS - 1) / side
            );
        }
    }
}
