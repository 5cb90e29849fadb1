//! Which cells of a curvilinear grid may contain a place: a hierarchy of boxes over blocks of cells.
//!
//! The hierarchy follows the grid's own numbering: a node covers 2 × 2 × 2 nodes of the level below,
//! those of the lowest level 2 × 2 × 2 cells. Neighbours in number are neighbours in space, however
//! the grid is stretched, and nothing but boxes need be kept: 3 bytes a cell and little more.
//!
//! Boxes of cells are widened by more than location tolerates; that a place lies in the box of a
//! cell is the first condition for the cell to contain it, which is what makes macrocells built
//! from the same boxes safe.

use glam::DVec3;
use rayon::prelude::*;
use vacua_simd::{Float, LANES, Mask, Simd, per_axis};
use vacua_volume::CellMask;

use crate::hexahedron;

/// Most levels of a hierarchy: 2^40 cells a side.
const MAX_LEVELS: usize = 40;

/// Widening of a cell's box, in parts of its size.
const RELATIVE_SLACK: f32 = 1e-6;

/// Lower and upper corner of a box; empty if `lo > hi`.
pub(crate) type Box3 = [[f32; 3]; 2];

const EMPTY: Box3 = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];

/// The points of a curvilinear grid in ray space, and the hierarchy over its cells.
#[derive(Clone, Debug)]
pub(crate) struct CellTree {
    /// Points a side.
    points: [usize; 3],
    /// Positions, x fastest. These `f32` are where the points are.
    positions: Vec<[f32; 3]>,
    /// From the lowest to the root.
    levels: Vec<TreeLevel>,
}

#[derive(Clone, Debug)]
struct TreeLevel {
    counts: [usize; 3],
    boxes: Vec<Box3>,
}

/// What is done with cells that may contain places.
pub(crate) trait VisitCell {
    /// Looks at a cell for the places of some lanes.
    fn cell(&mut self, cell: [usize; 3], lanes: u16);
}

/// How far the walk has come in one level.
#[derive(Clone, Copy)]
struct Progress {
    node: [usize; 3],
    lanes: u16,
    next_child: u8,
}

impl CellTree {
    /// Builds the hierarchy; blanked cells and cells with a corner that is nowhere are left out.
    pub fn new(
        points: [usize; 3],
        positions: Vec<[f32; 3]>,
        blanked_cells: Option<&CellMask>,
    ) -> Self {
        let mut tree = Self {
            points,
            positions,
            levels: Vec::new(),
        };
        let cells = tree.cells();
        let lowest = TreeLevel::of(cells, |cell| {
            let blank = blanked_cells.is_some_and(|mask| mask.is_blank(tree.number(cell)));
            if blank { None } else { tree.cell_box(cell) }
        });
        tree.levels.push(lowest);
        while let Some(below) = tree.levels.last().filter(|l| l.boxes.len() > 1) {
            let [nx, ny, _] = below.counts;
            let at = |[x, y, z]: [usize; 3]| Some(below.boxes[x + nx * (y + ny * z)]);
            let level = TreeLevel::of(below.counts, at);
            tree.levels.push(level);
        }
        tree
    }

    /// Cells a side.
    pub fn cells(&self) -> [usize; 3] {
        self.points.map(|n| n - 1)
    }

    /// Number of cells.
    pub fn num_cells(&self) -> usize {
        self.cells().iter().product()
    }

    /// Number of a cell.
    pub fn number(&self, [x, y, z]: [usize; 3]) -> usize {
        let [nx, ny, _] = self.cells();
        x + nx * (y + ny * z)
    }

    /// The cell with a number.
    pub fn cell(&self, number: usize) -> [usize; 3] {
        let [nx, ny, _] = self.cells();
        [number % nx, number / nx % ny, number / nx / ny]
    }

    /// Numbers of the points at a cell's corners.
    #[inline]
    pub fn corners(&self, cell: [usize; 3]) -> [usize; 8] {
        corner_points(self.points, cell)
    }

    /// The widened box of a cell; `None` if a corner is nowhere.
    #[inline]
    pub fn cell_box(&self, cell: [usize; 3]) -> Option<Box3> {
        let mut found = EMPTY;
        for point in self.corners(cell) {
            let p = self.positions[point];
            for a in 0..3 {
                if !p[a].is_finite() {
                    return None;
                }
                found[0][a] = found[0][a].min(p[a]);
                found[1][a] = found[1][a].max(p[a]);
            }
        }
        let size = (0..3).fold(0.0f32, |s, a| s.max(found[1][a] - found[0][a]));
        for a in 0..3 {
            let largest = found[0][a].abs().max(found[1][a].abs());
            let slack = size * RELATIVE_SLACK + largest * (4.0 * f32::EPSILON) + f32::MIN_POSITIVE;
            found[0][a] -= slack;
            found[1][a] += slack;
        }
        Some(found)
    }

    /// Local coordinates of a place in a cell.
    #[inline]
    pub fn locate(&self, cell: [usize; 3], at: DVec3) -> Option<DVec3> {
        hexahedron::locate(&self.corner_positions(cell, at))
    }

    /// The corners of a cell as seen from a place.
    #[inline]
    pub fn corner_positions(&self, cell: [usize; 3], from: DVec3) -> [DVec3; 8] {
        self.corners(cell)
            .map(|p| DVec3::from(self.positions[p].map(f64::from)) - from)
    }

    /// Visits every cell whose box contains a place of `lanes`.
    #[inline(always)]
    pub fn visit<S: Simd>(&self, at: [S::F; 3], lanes: u16, visit: &mut impl VisitCell) {
        let start = Progress {
            node: [0; 3],
            lanes: 0,
            next_child: 0,
        };
        let mut progress = [start; MAX_LEVELS];
        let mut level = self.levels.len() - 1;
        progress[level].lanes = lanes & inside::<S>(at, &self.levels[level].boxes[0]);
        loop {
            let here = &mut progress[level];
            if here.next_child == 8 || here.lanes == 0 {
                level += 1;
                if level == self.levels.len() {
                    return;
                }
                continue;
            }
            let child = usize::from(here.next_child);
            here.next_child += 1;
            let lanes = here.lanes;
            let node = per_axis!(a => 2 * here.node[a] + (child >> a & 1));
            let counts = match level {
                0 => self.cells(),
                _ => self.levels[level - 1].counts,
            };
            if node[0] >= counts[0] || node[1] >= counts[1] || node[2] >= counts[2] {
                continue;
            }
            if level == 0 {
                if let Some(bounds) = self.cell_box(node) {
                    let lanes = lanes & inside::<S>(at, &bounds);
                    if lanes != 0 {
                        visit.cell(node, lanes);
                    }
                }
                continue;
            }
            let bounds = &self.levels[level - 1].boxes
                [node[0] + counts[0] * (node[1] + counts[1] * node[2])];
            let lanes = lanes & inside::<S>(at, bounds);
            if lanes != 0 {
                level -= 1;
                progress[level] = Progress {
                    node,
                    lanes,
                    next_child: 0,
                };
            }
        }
    }
}

/// Numbers of the points at a cell's corners, x fastest.
#[inline]
pub(crate) fn corner_points([nx, ny, _]: [usize; 3], [x, y, z]: [usize; 3]) -> [usize; 8] {
    let first = x + nx * (y + ny * z);
    let slice = nx * ny;
    [
        first,
        first + 1,
        first + nx,
        first + nx + 1,
        first + slice,
        first + slice + 1,
        first + slice + nx,
        first + slice + nx + 1,
    ]
}

/// The lanes whose place is in a box.
#[inline(always)]
fn inside<S: Simd>(at: [S::F; 3], bounds: &Box3) -> u16 {
    let within = per_axis!(a => {
        S::F::splat(bounds[0][a]).le(at[a]) & at[a].le(S::F::splat(bounds[1][a]))
    });
    (within[0] & within[1] & within[2]).to_bits()
}

impl TreeLevel {
    /// The level over items of which some have a box.
    fn of(items: [usize; 3], item: impl Fn([usize; 3]) -> Option<Box3> + Sync) -> Self {
        let counts = items.map(|n| n.div_ceil(2));
        let [nx, ny, nz] = counts;
        let span = |i: usize, a: usize| 2 * i..(2 * i + 2).min(items[a]);
        let boxes = (0..nx * ny * nz).into_par_iter().map(|i| {
            let (x, y, z) = (i % nx, i / nx % ny, i / nx / ny);
            let mut found = EMPTY;
            for z in span(z, 2) {
                for y in span(y, 1) {
                    for x in span(x, 0) {
                        let [lo, hi] = item([x, y, z]).unwrap_or(EMPTY);
                        for a in 0..3 {
                            found[0][a] = found[0][a].min(lo[a]);
                            found[1][a] = found[1][a].max(hi[a]);
                        }
                    }
                }
            }
            found
        });
        Self {
            counts,
            boxes: boxes.collect(),
        }
    }
}

/// The cell with the lowest number that contains the place of each lane.
pub(crate) struct LowestCell<'a> {
    pub tree: &'a CellTree,
    pub blanked_cells: Option<&'a CellMask>,
    pub at: [[f32; LANES]; 3],
    /// `usize::MAX` for none.
    pub found: [usize; LANES],
    pub local: [DVec3; LANES],
}

impl<'a> LowestCell<'a> {
    /// Nothing found yet.
    #[inline(always)]
    pub fn new(
        tree: &'a CellTree,
        blanked_cells: Option<&'a CellMask>,
        at: [[f32; LANES]; 3],
    ) -> Self {
        Self {
            tree,
            blanked_cells,
            at,
            found: [usize::MAX; LANES],
            local: [DVec3::ZERO; LANES],
        }
    }
}

impl VisitCell for LowestCell<'_> {
    fn cell(&mut self, cell: [usize; 3], mut lanes: u16) {
        let number = self.tree.number(cell);
        if self.blanked_cells.is_some_and(|mask| mask.is_blank(number)) {
            return;
        }
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            if number >= self.found[lane] {
                continue;
            }
            let at = DVec3::from(self.at.map(|x| f64::from(x[lane])));
            if let Some(local) = self.tree.locate(cell, at) {
                self.found[lane] = number;
                self.local[lane] = local;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use vacua_simd::{Kernel, Level, dispatch_at};

    struct Find<'a>(&'a CellTree, Option<&'a CellMask>, [[f32; LANES]; 3]);
    impl Kernel for Find<'_> {
        type Output = ([usize; LANES], [DVec3; LANES]);
        #[inline(always)]
        fn run<S: Simd>(self) -> Self::Output {
            let mut lowest = LowestCell::new(self.0, self.1, self.2);
            let at = per_axis!(a => S::F::from_array(self.2[a]));
            self.0.visit::<S>(at, 0x7fff, &mut lowest);
            (lowest.found, lowest.local)
        }
    }

    proptest! {
        #[test]
        fn the_lowest_cell_of_all_is_found(
            points in prop::array::uniform3(2usize..8),
            disorder in prop_oneof![Just(0.0f32), 0.0f32..0.5, 0.0f32..5.0],
            seed in any::<u32>(),
            places in prop::array::uniform16(prop::array::uniform3(-0.1f32..1.1)),
            holes in any::<bool>(),
        ) {
            let noise = |i: usize| {
                let h = (i as u32 ^ seed).wrapping_mul(2_654_435_761).rotate_left(15);
                (h.wrapping_mul(0x9e37_79b1) >> 8) as f32 / (1 << 24) as f32
            };
            let positions = (0..points.iter().product()).map(|i: usize| {
                let at = [i % points[0], i / points[0] % points[1], i / points[0] / points[1]];
                [0, 1, 2].map(|a| {
                    let hole = holes && a == 0 && i % 41 == 3;
                    let p = at[a] as f32 + disorder * noise(3 * i + a);
                    if hole { f32::NAN } else { p }
                })
            });
            let num_cells = points.iter().map(|n| n - 1).product();
            let mut mask = CellMask::new(num_cells);
            for cell in (0..num_cells).filter(|c| holes && c % 5 == 2) {
                mask.blank(cell);
            }
            let tree = CellTree::new(points, positions.collect(), Some(&mask));
            prop_assert_eq!(tree.num_cells(), num_cells);
            let at = [0, 1, 2].map(|a| places.map(|p| p[a] * (points[a] - 1) as f32));
            let expected: [Option<(usize, DVec3)>; LANES] = std::array::from_fn(|lane| {
                let at = at.map(|x| x[lane]);
                (0..num_cells).filter(|&c| !mask.is_blank(c)).find_map(|number| {
                    let cell = tree.cell(number);
                    let [lo, hi] = tree.cell_box(cell)?;
                    let near = (0..3).all(|a| lo[a] <= at[a] && at[a] <= hi[a]);
                    let local = near.then(|| tree.locate(cell, DVec3::from(at.map(f64::from))))??;
                    Some((number, local))
                })
            });
            for level in Level::available() {
                let (found, local) = dispatch_at(level, Find(&tree, Some(&mask), at));
                prop_assert_eq!(found[15], usize::MAX, "a lane that was not asked for");
                for lane in 0..15 {
                    let found = (found[lane] != usize::MAX).then_some((found[lane], local[lane]));
                    prop_assert_eq!(found, expected[lane]);
                    if disorder == 0.0 && !holes {
                        let inside = (0..3).all(|a| (0.0..=(points[a] - 1) as f32).contains(&at[a][lane]));
                        prop_assert!(found.is_some() || !inside, "no gaps");
                    }
                }
            }
        }
    }
}
