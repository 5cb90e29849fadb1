//! Curvilinear grids in the renderer: their ray space, sizes and ranges of their cells, and their
//! sampler.
//!
//! Ray space is the world, moved to the grid's lower corner and scaled, the same along each axis,
//! so that its unit cubes hold about [`CELLS_PER_CUBE`] cells each. The cubes are the cells of the
//! lattice that macrocells and strides are made of. Positions are rounded to `f32` in ray space once;
//! that is where the points are.

use glam::{DAffine3, DMat3, DVec3};
use rayon::prelude::*;
use vacua_simd::{Float, LANES, Mask, Simd, WideMap, per_axis};
use vacua_skip::{Axis, Lattice, Macrocells};
use vacua_volume::{Association, Bounds, CellMask, CurvilinearGrid};

use crate::blocks::{LatticeMinima, Strides};
use crate::celltree::{Box3, CellTree, LowestCell};
use crate::error::RenderError;
use crate::hexahedron;
use crate::sampler::{Sampler, Voxels};
use crate::space::RaySpace;

/// Cells in a cube of the lattice, about, were they all alike.
const CELLS_PER_CUBE: f64 = 64.0;

/// Most cubes along an axis.
const MAX_CUBES: f64 = 256.0;

/// Cubes that a cell may touch on average; in grids so tangled that it would be more, cubes grow.
const MAX_CUBES_PER_CELL: f64 = 64.0;

/// The smallest cell size that sampling follows is the lattice's diagonal over this.
const MAX_RESOLUTION: f64 = (1 << 20) as f64;

/// The largest `f32` below 1: interpolation stays within what it interpolates.
const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;

/// A curvilinear grid, ready to be sampled.
#[derive(Clone, Debug)]
pub(crate) struct CurvilinearCells {
    pub space: RaySpace,
    pub tree: CellTree,
}

impl CurvilinearCells {
    /// Prepares a grid.
    ///
    /// # Errors
    /// [`RenderError::NoPositions`] if no point is anywhere, or they are further apart than numbers
    /// go.
    pub fn new(
        grid: &CurvilinearGrid,
        blanked_cells: Option<&CellMask>,
    ) -> Result<Self, RenderError> {
        let points = grid.points();
        let num_points: usize = points.iter().product();
        let bounds = Bounds::of_points((0..num_points).map(|i| grid.position(i)));
        let bounds = bounds.ok_or(RenderError::NoPositions)?;
        let mut tree;
        let mut cube = cube_size(bounds, points.iter().map(|n| (n - 1) as f64).product());
        loop {
            if !(cube.is_finite() && cube.recip().is_finite()) {
                return Err(RenderError::NoPositions);
            }
            let positions = (0..num_points).into_par_iter().map(|i| {
                let p = (grid.position(i) - bounds.lo) / cube;
                p.as_vec3().to_array()
            });
            tree = CellTree::new(points, positions.collect(), blanked_cells);
            if bounds.size().max_element() <= cube || !is_tangled(&tree) {
                break;
            }
            cube *= 2.0;
        }
        let counts = bounds.size() / cube;
        let axes = counts.to_array().map(|n| Axis::Unit {
            cells: (n.ceil() as usize).max(1),
        });
        let diagonal = counts.length().max(1.0);
        let smallest = (0..tree.num_cells())
            .into_par_iter()
            .filter_map(|i| cell_size(&tree, i))
            .reduce(|| f64::INFINITY, f64::min);
        let finest = smallest.clamp(diagonal / MAX_RESOLUTION, diagonal);
        let matrix = DMat3::from_diagonal(DVec3::splat(cube.recip()));
        let space = RaySpace {
            ray_from_world: DAffine3::from_mat3_translation(matrix, -bounds.lo / cube),
            axes,
            finest: DVec3::splat(finest),
        };
        Ok(Self { space, tree })
    }

    /// How far apart samples may be in each cube, by the smallest cell that touches it.
    pub fn strides(&self) -> Result<Strides, RenderError> {
        let lattice = Lattice::new(self.space.axes.clone(), 1)?;
        let counts = lattice.counts();
        let mut sizes = vec![f32::INFINITY; lattice.len()];
        for cell in 0..self.tree.num_cells() {
            let Some(size) = cell_size(&self.tree, cell) else {
                continue;
            };
            let Some([lo, hi]) = self.tree.cell_box(self.tree.cell(cell)) else {
                continue;
            };
            let size = (size / self.space.finest.x).max(1.0) as f32;
            let from = [0, 1, 2].map(|a| lattice.macrocell_of(a, lo[a]));
            let to = [0, 1, 2].map(|a| lattice.macrocell_of(a, hi[a]));
            for z in from[2]..=to[2] {
                for y in from[1]..=to[1] {
                    let row = counts[0] * (y + counts[1] * z);
                    for smallest in &mut sizes[row + from[0]..=row + to[0]] {
                        *smallest = smallest.min(size);
                    }
                }
            }
        }
        Ok(Strides::Lattice(LatticeMinima::new(counts, sizes)))
    }

    /// Ranges of the values that sampling can compute in each macrocell.
    pub fn macrocells(&self, lattice: Lattice, values: &CellValues<'_>) -> Macrocells {
        let items = (0..self.tree.num_cells()).filter_map(|number| {
            let bounds: Box3 = values
                .is_seen(number)
                .then(|| self.tree.cell_box(self.tree.cell(number)))??;
            let range = values.range(&self.tree, number)?;
            Some((bounds, range))
        });
        Macrocells::of_boxes(lattice, items)
    }
}

/// Side of a lattice cube in world units.
fn cube_size(bounds: Bounds, num_cells: f64) -> f64 {
    let size = bounds.size();
    let largest = size.max_element();
    if largest == 0.0 {
        return 1.0;
    }
    let mut cube = largest / MAX_CUBES;
    let cubes = |cube: f64| (size / cube).ceil().max(DVec3::ONE).element_product();
    while cube < largest && cubes(cube) > num_cells / CELLS_PER_CUBE {
        cube *= 1.125;
    }
    cube
}

/// Whether cells touch far more cubes than cells of a lattice should: random positions, say.
fn is_tangled(tree: &CellTree) -> bool {
    let cubes = |number| {
        let [lo, hi] = tree.cell_box(tree.cell(number))?;
        Some(
            (0..3)
                .map(|a| f64::from(hi[a] - lo[a]) + 1.0)
                .product::<f64>(),
        )
    };
    let num_cells = tree.num_cells();
    // Summed by slices in order, so that the sum is the same with any number of threads.
    let slices: Vec<f64> = (0..num_cells.div_ceil(1 << 16))
        .into_par_iter()
        .map(|i| {
            (i << 16..((i + 1) << 16).min(num_cells))
                .filter_map(cubes)
                .sum()
        })
        .collect();
    slices.iter().sum::<f64>() > MAX_CUBES_PER_CELL * (num_cells as f64) + 1e5
}

/// Size of a cell: along each of its own axes the mean of its four edges, and of these the least.
/// Means, since edges that meet in a pole are common, and a cell is not small for it. `None` for
/// cells that are nowhere or flat.
fn cell_size(tree: &CellTree, number: usize) -> Option<f64> {
    let corners = tree.corner_positions(tree.cell(number), DVec3::ZERO);
    let edge = |a: usize, b: usize| (corners[a] - corners[b]).length();
    let along = [
        edge(0, 1) + edge(2, 3) + edge(4, 5) + edge(6, 7),
        edge(0, 2) + edge(1, 3) + edge(4, 6) + edge(5, 7),
        edge(0, 4) + edge(1, 5) + edge(2, 6) + edge(3, 7),
    ];
    let least = along.iter().fold(f64::INFINITY, |m, &l| m.min(l)) / 4.0;
    let anywhere = corners.iter().all(|c| c.is_finite());
    (anywhere && least > 0.0).then_some(least)
}

/// Values of a curvilinear grid as rendering sees them.
#[derive(Clone, Copy)]
pub(crate) struct CellValues<'a> {
    pub voxels: Voxels<'a>,
    pub association: Association,
    pub map: Option<WideMap>,
    pub blanked_cells: Option<&'a CellMask>,
}

impl CellValues<'_> {
    /// Whether a cell is not blanked.
    fn is_seen(&self, number: usize) -> bool {
        self.blanked_cells.is_none_or(|mask| !mask.is_blank(number))
    }

    /// Values at the corners of a cell; for cell data its value, eight times.
    #[inline(always)]
    fn corners(&self, tree: &CellTree, number: usize) -> [f32; 8] {
        match self.association {
            Association::Point => self
                .voxels
                .rendered(tree.corners(tree.cell(number)), self.map),
            Association::Cell => self.voxels.rendered([number; 8], self.map),
        }
    }

    /// Range of the values in a cell; `None` if it shows nothing.
    fn range(&self, tree: &CellTree, number: usize) -> Option<[f32; 2]> {
        let values = self.corners(tree, number);
        let finite = values.iter().all(|v| v.is_finite());
        let lo = values.iter().copied().fold(f32::INFINITY, f32::min);
        let hi = values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        finite.then_some([lo, hi])
    }
}

/// Values and gradients of a curvilinear grid. Candidates are found for sixteen places at once; what
/// happens within a cell is computed a place at a time.
pub(crate) struct CurvilinearSampler<'a> {
    pub cells: &'a CurvilinearCells,
    pub values: CellValues<'a>,
}

/// Cell (`usize::MAX` for none) and local coordinates of each lane.
#[derive(Clone, Copy)]
pub(crate) struct CellPlace {
    cell: [usize; LANES],
    local: [DVec3; LANES],
}

impl Default for CellPlace {
    fn default() -> Self {
        Self {
            cell: [usize::MAX; LANES],
            local: [DVec3::ZERO; LANES],
        }
    }
}

/// `a + t · (b − a)`, within `[a, b]` for `t` below 1.
#[inline(always)]
fn lerp(t: f32, a: f32, b: f32) -> f32 {
    t.mul_add(b - a, a)
}

impl Sampler for CurvilinearSampler<'_> {
    type Place = CellPlace;

    #[inline(always)]
    fn sample<S: Simd>(&self, at: [S::F; 3], lanes: S::M) -> (S::F, S::M, CellPlace) {
        let tree = &self.cells.tree;
        let mut lowest = LowestCell::new(
            tree,
            self.values.blanked_cells,
            per_axis!(a => at[a].to_array()),
        );
        tree.visit::<S>(at, lanes.to_bits(), &mut lowest);
        let (cell, local) = (lowest.found, lowest.local);
        let mut value = [0.0; LANES];
        let mut valid = 0;
        for lane in 0..LANES {
            if cell[lane] == usize::MAX {
                continue;
            }
            let v = self.values.corners(tree, cell[lane]);
            let x = (local[lane].x as f32).min(BELOW_ONE);
            let y = (local[lane].y as f32).min(BELOW_ONE);
            let z = (local[lane].z as f32).min(BELOW_ONE);
            let front = lerp(y, lerp(x, v[0], v[1]), lerp(x, v[2], v[3]));
            let back = lerp(y, lerp(x, v[4], v[5]), lerp(x, v[6], v[7]));
            value[lane] = lerp(z, front, back);
            // An unseen corner hides the whole cell, whatever its weight.
            let mut finite = value[lane].is_finite();
            for corner in v {
                finite &= corner.is_finite();
            }
            valid |= u16::from(finite) << lane;
        }
        (
            S::F::from_array(value),
            S::M::from_bits(valid) & lanes,
            CellPlace { cell, local },
        )
    }

    #[inline(always)]
    fn gradient<S: Simd>(&self, _: [S::F; 3], place: &CellPlace) -> [S::F; 3] {
        let mut gradients = [[0.0; LANES]; 3];
        for lane in 0..LANES {
            if place.cell[lane] == usize::MAX {
                continue;
            }
            let found = self.gradient_at(place.cell[lane], place.local[lane]);
            for a in 0..3 {
                gradients[a][lane] = found[a];
            }
        }
        per_axis!(a => S::F::from_array(gradients[a]))
    }
}

impl CurvilinearSampler<'_> {
    /// The gradient of the interpolant at local coordinates of a cell, in ray space.
    fn gradient_at(&self, number: usize, at: DVec3) -> [f32; 3] {
        let tree = &self.cells.tree;
        let corners = tree.corner_positions(tree.cell(number), DVec3::ZERO);
        let values = self.values.corners(tree, number);
        let (_, derivatives) = hexahedron::map(&corners, at);
        let (_, slopes) = hexahedron::map(&values.map(|v| DVec3::splat(f64::from(v))), at);
        let local = DVec3::new(slopes[0].x, slopes[1].x, slopes[2].x);
        hexahedron::gradient(derivatives, local)
            .as_vec3()
            .to_array()
    }
}
