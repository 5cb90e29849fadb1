//! The dual of an octree: a point in the middle of each leaf, a cell around each corner of leaves.
//!
//! Where all eight leaves around a corner are different the cell is a hexahedron; where leaves of
//! different levels meet some are the same, and the cell is a wedge, a pyramid, a tetrahedron, or a
//! hexahedron with corners at the same place.

use glam::DVec3;
use vacua_volume::CellType;

use crate::kind::SynthError;
use crate::mesh_cells::{Cells, check_points};

/// Octants around a corner in VTK's order of a hexahedron.
const OCTANTS: [[usize; 3]; 8] = CellType::HEXAHEDRON_CORNERS;

/// Corners of the faces of a hexahedron, each seen counter-clockwise from inside, and those opposite.
const FACES: [([usize; 4], [usize; 4]); 6] = [
    ([0, 1, 2, 3], [4, 5, 6, 7]),
    ([4, 7, 6, 5], [0, 3, 2, 1]),
    ([0, 4, 5, 1], [3, 7, 6, 2]),
    ([3, 2, 6, 7], [0, 1, 5, 4]),
    ([0, 3, 7, 4], [1, 2, 6, 5]),
    ([1, 5, 6, 2], [0, 4, 7, 3]),
];

/// A cube of side `n` (rounded up to a power of 2), refined to cells of 1 near a jet's hull and left
/// as coarse as 8 elsewhere.
pub(crate) fn dual(n: usize) -> Result<Cells, SynthError> {
    let side = n.next_power_of_two().max(16);
    check_points(n, side.checked_pow(3))?;
    let mut tree = Tree {
        side,
        leaf_of: vec![u32::MAX; side * side * side],
        leaves: Vec::new(),
    };
    const COARSEST: usize = 8;
    for z in (0..side).step_by(COARSEST) {
        for y in (0..side).step_by(COARSEST) {
            for x in (0..side).step_by(COARSEST) {
                tree.refine([x, y, z], COARSEST);
            }
        }
    }
    Ok(tree.dual_cells())
}

struct Tree {
    side: usize,
    /// The leaf that each of the finest cells is in.
    leaf_of: Vec<u32>,
    /// Lowest corner and size of each.
    leaves: Vec<([usize; 3], usize)>,
}

impl Tree {
    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        x + self.side * (y + self.side * z)
    }

    fn refine(&mut self, at: [usize; 3], size: usize) {
        if size > 1 && self.is_interesting(at, size) {
            let half = size / 2;
            for octant in 0..8 {
                self.refine([0, 1, 2].map(|a| at[a] + half * (octant >> a & 1)), half);
            }
            return;
        }
        let leaf = self.leaves.len() as u32;
        self.leaves.push((at, size));
        for z in 0..size {
            for y in 0..size {
                for x in 0..size {
                    let index = self.index([at[0] + x, at[1] + y, at[2] + z]);
                    self.leaf_of[index] = leaf;
                }
            }
        }
    }

    /// Whether the hull of a jet that widens along x passes near a cube.
    fn is_interesting(&self, at: [usize; 3], size: usize) -> bool {
        let middle = at.map(|c| (c as f64 + 0.5 * size as f64) / self.side as f64);
        let [x, y, z] = middle;
        let wave = 0.03 * (20.0 * x).sin();
        let away = ((y - 0.5 - wave).powi(2) + (z - 0.5).powi(2)).sqrt();
        let hull = (away - (0.08 + 0.25 * x)).abs();
        hull < 0.75 * size as f64 / self.side as f64
    }

    fn dual_cells(&self) -> Cells {
        let mut cells = Cells::default();
        for &(at, size) in &self.leaves {
            let middle = DVec3::from_array(at.map(|c| c as f64)) + 0.5 * size as f64;
            cells.points.push(middle.as_vec3().to_array());
        }
        let side = self.side;
        for z in 1..side {
            for y in 1..side {
                for x in 1..side {
                    let corner = [x, y, z];
                    let around = OCTANTS
                        .map(|o| self.leaf_of[self.index([0, 1, 2].map(|a| corner[a] + o[a] - 1))]);
                    let is_corner_of = |&leaf: &u32| {
                        let (at, size) = self.leaves[leaf as usize];
                        (0..3).all(|a| (corner[a] - at[a]).is_multiple_of(size))
                    };
                    if around.iter().any(is_corner_of) {
                        add(&mut cells, around);
                    }
                }
            }
        }
        cells
    }
}

/// Adds the cell between eight leaves, of which some may be the same.
fn add(cells: &mut Cells, around: [u32; 8]) {
    let mut distinct = around;
    distinct.sort_unstable();
    let count = 1 + distinct.windows(2).filter(|w| w[0] != w[1]).count();
    let same = |corners: &[usize]| corners.iter().all(|&c| around[c] == around[corners[0]]);
    let different = |corners: &[usize; 4]| {
        (0..4).all(|i| (0..i).all(|j| around[corners[i]] != around[corners[j]]))
    };
    match count {
        8 => return cells.push(CellType::Hexahedron, around),
        0..4 => return,
        _ => {}
    }
    for (base, top) in &FACES {
        if !different(base) {
            continue;
        }
        let at = |c: &[usize; 4]| c.map(|i| around[i]);
        if count == 5 && same(top) {
            let apex = around[top[0]];
            return cells.push(CellType::Pyramid, at(base).into_iter().chain([apex]));
        }
        if count == 6 {
            for turn in 0..2 {
                let [p, q, r, s] = [0, 1, 2, 3].map(|i| base[(i + turn) % 4]);
                let [t, u, v, w] = [0, 1, 2, 3].map(|i| top[(i + turn) % 4]);
                if same(&[t, u]) && same(&[v, w]) {
                    // A ridge over the base: triangles p, q, ridge and s, r, ridge.
                    let wedge = [p, q, t, s, r, w].map(|i| around[i]);
                    return cells.push(CellType::Wedge, wedge);
                }
            }
        }
    }
    cells.push(CellType::Hexahedron, around);
}
