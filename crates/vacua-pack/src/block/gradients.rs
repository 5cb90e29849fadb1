//! Gradients of a field in cells that are known: of sixteen tetrahedra at a time in vectors, one
//! after the other in `f64` where those are flat, and in other cells, whose weights are found anew.

use vacua_simd::{Float, Kernel, LANES, Level, Mask, Simd, dispatch_at, per_axis};
use vacua_volume::{Association, CellType};

use super::others::scalar_weights;
use super::tets::{cross, dot, is_round};
use super::values::Values;
use super::verdict::judge;
use super::{BlockSampler, Located, MAX_CORNERS, Places};
use crate::element::gradient_at;
use crate::layout::{OTHER_INDICES, PAIR_INDICES, TET_INDICES};
use crate::packed::Submesh;
use crate::pairs::tets_of;

/// The cells of sixteen lanes.
struct Cells {
    /// The lanes that have one.
    lanes: u16,
    cell_type: [u8; LANES],
    corners: [[u32; LANES]; MAX_CORNERS],
    /// Their corners, and the values there; of a tetrahedron four.
    positions: [[[f32; LANES]; 3]; MAX_CORNERS],
    values: [[f32; LANES]; MAX_CORNERS],
}

impl BlockSampler<'_> {
    /// Gradients of the values at the places that were found, axis by axis; 0 for fields on cells,
    /// and where there is no value.
    pub fn gradients(&self, at: &Places, located: &Located) -> [[f32; LANES]; 3] {
        self.gradients_at(Level::best(), at, located)
    }

    /// As [`Self::gradients`] on a given instruction set; the same answer on each.
    pub fn gradients_at(&self, level: Level, at: &Places, located: &Located) -> [[f32; LANES]; 3] {
        if self.field.association() == Association::Cell {
            return [[0.0; LANES]; 3];
        }
        let gradients = Gradients {
            sampler: self,
            at,
            located,
        };
        dispatch_at(level, gradients)
    }

    /// Looks up the cells that were found.
    #[inline(always)]
    fn cells<S: Simd>(&self, located: &Located) -> Cells {
        let mut cells = Cells {
            lanes: 0,
            cell_type: [0; LANES],
            corners: [[0; LANES]; MAX_CORNERS],
            positions: [[[0.0; LANES]; 3]; MAX_CORNERS],
            values: [[0.0; LANES]; MAX_CORNERS],
        };
        let mut left = located.found;
        while left != 0 {
            // The lanes of one sub-mesh, which mostly are all.
            let number = located.submesh[left.trailing_zeros() as usize];
            let mut lanes = 0;
            for lane in 0..LANES {
                lanes |= u16::from(located.submesh[lane] == number) << lane;
            }
            lanes &= left;
            left &= !lanes;
            if let Some(submesh) = self.mesh.submesh(number as usize) {
                cells.add(&submesh, located, lanes);
                let values = Values::new(self.mesh, self.field, self.map, number as usize);
                if let Values::Points(values) = values {
                    let mut found = [[0.0; LANES]; MAX_CORNERS];
                    let header = submesh.header;
                    if located.others & lanes == 0 {
                        let corners = cells.corners.first_chunk::<TET_INDICES>();
                        let found = found.first_chunk_mut::<TET_INDICES>();
                        if let (Some(corners), Some(found)) = (corners, found) {
                            values.at_vertices::<S, _, _>(header, corners, LANES, found);
                        }
                    } else {
                        values.at_vertices::<S, _, _>(header, &cells.corners, LANES, &mut found);
                    }
                    for k in 0..MAX_CORNERS {
                        for lane in 0..LANES {
                            let here = lanes >> lane & 1 == 1;
                            let values = &mut cells.values[k];
                            values[lane] = if here { found[k][lane] } else { values[lane] };
                        }
                    }
                }
            }
        }
        cells
    }
}

impl Cells {
    /// Looks up the cells of some lanes of a sub-mesh.
    #[inline(always)]
    fn add(&mut self, submesh: &Submesh, located: &Located, mut lanes: u16) {
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            let primitive = located.primitive[lane];
            let place = primitive / 2;
            let (cell_type, corners) = if let Some(clusters) = &submesh.clusters {
                clusters.cell(submesh, place)
            } else if located.others >> lane & 1 == 1 {
                submesh.other(submesh.indices.read::<OTHER_INDICES>(place))
            } else {
                // A tetrahedron on its own reads one index too many, which the padding allows for.
                let five = submesh.indices.read::<PAIR_INDICES>(place);
                let [a, b, c, d] = tets_of(five)[(primitive % 2) as usize];
                (CellType::Tetrahedron, [a, b, c, d, d, d, d, d])
            };
            self.cell_type[lane] = cell_type as u8;
            let num_corners = if cell_type == CellType::Tetrahedron {
                TET_INDICES
            } else {
                MAX_CORNERS
            };
            let mut is_there = true;
            for k in 0..num_corners {
                self.corners[k][lane] = corners[k];
                let Some(position) = submesh.position(corners[k]) else {
                    is_there = false;
                    continue;
                };
                for axis in 0..3 {
                    self.positions[k][axis][lane] = position[axis];
                }
            }
            self.lanes |= u16::from(is_there) << lane;
        }
    }

    /// The gradient in one cell, given the weights of its corners but the first.
    fn gradient(&self, lane: usize, weights: &[f32; MAX_CORNERS]) -> [f64; 3] {
        let cell_type = CellType::ALL[usize::from(self.cell_type[lane]) % CellType::ALL.len()];
        let mut all_weights = [0.0; MAX_CORNERS];
        all_weights[0] = 1.0;
        for k in 1..cell_type.num_points() {
            all_weights[k] = f64::from(weights[k]);
            all_weights[0] -= all_weights[k];
        }
        let positions = self.positions.map(|p| p.map(|c| c[lane]));
        let values = self.values.map(|v| v[lane]);
        gradient_at(cell_type, &positions, &values, &all_weights)
    }
}

/// Gradients at sixteen places.
struct Gradients<'a> {
    sampler: &'a BlockSampler<'a>,
    at: &'a Places,
    located: &'a Located,
}

impl Kernel for Gradients<'_> {
    type Output = [[f32; LANES]; 3];

    #[inline(always)]
    fn run<S: Simd>(self) -> [[f32; LANES]; 3] {
        let cells = self.sampler.cells::<S>(self.located);
        let tets = cells.lanes & !self.located.others;
        let mut gradients = [[0.0; LANES]; 3];
        let mut left = tets;
        if tets != 0 {
            let (found, round) = in_tets::<S>(&cells, self.sampler.scale);
            let mask = S::M::from_bits(tets & round);
            gradients = per_axis!(i => found[i].or_zero(mask).to_array());
            left &= !round;
        }
        let mut weights = [[0.0; LANES]; MAX_CORNERS];
        let others = cells.lanes & self.located.others;
        if others != 0 {
            let mut p = [[S::F::splat(0.0); 3]; MAX_CORNERS];
            for k in 0..MAX_CORNERS {
                p[k] = per_axis!(i => {
                    S::F::from_array(cells.positions[k][i]) - S::F::from_array(self.at[i])
                });
            }
            let verdict = judge::<S>(p, &cells.cell_type, others);
            for k in 1..MAX_CORNERS {
                weights[k] = verdict.weights[k].to_array();
            }
            let doubt = others & !verdict.inside.to_bits();
            self.weigh_again(&cells, doubt, &mut weights);
            left |= others;
        }
        for lane in (0..LANES).filter(|lane| left >> lane & 1 == 1) {
            let gradient = cells.gradient(lane, &weights.map(|w| w[lane]));
            for axis in 0..3 {
                gradients[axis][lane] = gradient[axis] as f32;
            }
        }
        gradients
    }
}

impl Gradients<'_> {
    /// The scalar code's weights.
    #[cold]
    #[inline(never)]
    fn weigh_again(&self, cells: &Cells, lanes: u16, weights: &mut [[f32; LANES]; MAX_CORNERS]) {
        for lane in (0..LANES).filter(|lane| lanes >> lane & 1 == 1) {
            let positions = cells.positions.map(|p| p.map(|c| c[lane]));
            let place = self.at.map(|c| c[lane]);
            if let Some(found) = scalar_weights(cells.cell_type[lane], &positions, place) {
                for k in 1..MAX_CORNERS {
                    weights[k][lane] = found[k];
                }
            }
        }
    }
}

/// Gradients in sixteen tetrahedra, and which of them are not too flat for that.
#[inline(always)]
fn in_tets<S: Simd>(cells: &Cells, scale: f32) -> ([S::F; 3], u16) {
    let scale = S::F::splat(scale);
    let corner = &cells.positions;
    let a = per_axis!(i => S::F::from_array(corner[0][i]));
    let b = per_axis!(i => (S::F::from_array(corner[1][i]) - a[i]) * scale);
    let c = per_axis!(i => (S::F::from_array(corner[2][i]) - a[i]) * scale);
    let d = per_axis!(i => (S::F::from_array(corner[3][i]) - a[i]) * scale);
    let (cd, db, bc) = (cross(c, d), cross(d, b), cross(b, c));
    let whole = dot(b, cd);
    let round = is_round::<S>([b, c, d], whole);
    let first = S::F::from_array(cells.values[0]);
    let [u, v, w] = per_axis!(k => S::F::from_array(cells.values[k + 1]) - first);
    let factor = scale.div(whole);
    let gradient = per_axis!(i => {
        u.mul_add(cd[i], v.mul_add(db[i], w * bc[i])) * factor
    });
    (gradient, round.to_bits())
}
