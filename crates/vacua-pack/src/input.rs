//! A mesh as the encoder sees it: positions rounded to what is stored, bad cells told apart.

use std::ops::Range;

use rayon::prelude::*;
use vacua_volume::{CellType, Indices, UnstructuredMesh};

/// Work items of a parallel loop over points or cells.
const CHUNK: usize = 1 << 14;
/// So many cells ahead positions are asked for.
const AHEAD: usize = 12;

/// A mesh and the origin to which its stored positions are relative.
pub struct Input<'a> {
    mesh: &'a UnstructuredMesh,
    indices: Indices<'a>,
    positions_f32: Option<&'a [f32]>,
    /// Added to stored positions gives the world.
    pub origin: [f64; 3],
    /// The largest distance along an axis by which a stored position is off.
    pub worst_rounding: f64,
}

/// Why a cell is left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unfit {
    /// It is blanked.
    Blanked,
    /// One of its positions is not finite.
    NotFinite,
}

impl<'a> Input<'a> {
    /// Chooses the origin: zero for positions that `f32` holds exactly, else the middle of the mesh,
    /// so that a small mesh far from zero keeps its digits.
    ///
    /// Deviation from a per-sub-mesh origin: one origin for all, so that a vertex that several
    /// sub-meshes share is rounded to the same place in each, and no crack opens.
    pub fn new(mesh: &'a UnstructuredMesh) -> Self {
        let positions_f32 = mesh.positions().as_slice::<f32>();
        let mut input = Self {
            mesh,
            indices: mesh.indices(),
            positions_f32,
            origin: [0.0; 3],
            worst_rounding: 0.0,
        };
        if positions_f32.is_some() {
            return input;
        }
        input.worst_rounding = input.measure_rounding();
        if input.worst_rounding > 0.0
            && let Some(bounds) = mesh.bounds()
        {
            let at_zero = input.worst_rounding;
            // A coarse number, so that adding it back rounds little.
            input.origin = (0.5 * bounds.lo + 0.5 * bounds.hi)
                .to_array()
                .map(|c| f64::from(c as f32));
            input.worst_rounding = input.measure_rounding();
            if input.worst_rounding >= at_zero {
                input.origin = [0.0; 3];
                input.worst_rounding = at_zero;
            }
        }
        input
    }

    fn measure_rounding(&self) -> f64 {
        chunks(self.mesh.num_points())
            .into_par_iter()
            .map(|range| {
                let mut worst = 0.0f64;
                for point in range {
                    let exact = self.mesh.position(point).to_array();
                    let local = self.local(point as u64);
                    for axis in 0..3 {
                        let off = (exact[axis] - self.origin[axis] - f64::from(local[axis])).abs();
                        if off.is_finite() {
                            worst = worst.max(off);
                        }
                    }
                }
                worst
            })
            .reduce(|| 0.0, f64::max)
    }

    /// A position as it is stored.
    #[inline(always)]
    pub fn local(&self, point: u64) -> [f32; 3] {
        let point = point as usize;
        match self.positions_f32 {
            Some(p) => [p[3 * point], p[3 * point + 1], p[3 * point + 2]],
            None => {
                let p = self.mesh.position(point).to_array();
                [0, 1, 2].map(|axis| (p[axis] - self.origin[axis]) as f32)
            }
        }
    }

    /// The mesh.
    pub fn mesh(&self) -> &'a UnstructuredMesh {
        self.mesh
    }

    /// Calls `visit` with the points of a cell in order; gives its type.
    #[inline(always)]
    pub fn visit_points(&self, cell: u64, mut visit: impl FnMut(u64)) -> CellType {
        let cell = cell as usize;
        let Some(cell_type) = self.mesh.uniform_type() else {
            let cell = self.mesh.cell(cell);
            cell.points().iter().for_each(|&p| visit(p));
            return cell.cell_type;
        };
        let width = cell_type.num_points();
        let place = cell * width..(cell + 1) * width;
        match self.indices {
            Indices::U32(all) => all[place].iter().for_each(|&p| visit(u64::from(p))),
            Indices::U64(all) => all[place].iter().for_each(|&p| visit(p)),
        }
        cell_type
    }

    /// Asks for the points of a cell that will be visited soon.
    #[inline(always)]
    pub fn prefetch_cell(&self, cell: u64) {
        if let Some(cell_type) = self.mesh.uniform_type() {
            let first = cell as usize * cell_type.num_points();
            match self.indices {
                Indices::U32(all) => vacua_simd::prefetch(all, first),
                Indices::U64(all) => vacua_simd::prefetch(all, first),
            }
        }
    }

    /// Asks for the positions of a cell that will be needed soon; nothing past the last cell.
    #[inline(always)]
    fn prefetch_positions(&self, cell: usize) {
        if cell < self.mesh.num_cells()
            && let (Some(p), Some(_)) = (self.positions_f32, self.mesh.uniform_type())
        {
            self.visit_points(cell as u64, |point| {
                vacua_simd::prefetch(p, 3 * point as usize);
            });
        }
    }

    /// Asks for a position that will be needed soon.
    #[inline(always)]
    pub fn prefetch_position(&self, point: u64) {
        if let Some(p) = self.positions_f32 {
            vacua_simd::prefetch(p, 3 * point as usize);
        }
    }

    /// The middle of the box around a cell, halved, or why the cell is left out.
    #[inline]
    pub fn center(&self, cell: usize) -> Result<[f32; 3], Unfit> {
        if self.mesh.blanked_cells().is_some_and(|b| b.is_blank(cell)) {
            return Err(Unfit::Blanked);
        }
        self.prefetch_positions(cell + AHEAD);
        let mut lo = [f32::INFINITY; 3];
        let mut hi = [f32::NEG_INFINITY; 3];
        let mut finite = true;
        self.visit_points(cell as u64, |point| {
            let p = self.local(point);
            for axis in 0..3 {
                finite &= p[axis].is_finite();
                lo[axis] = if p[axis] < lo[axis] {
                    p[axis]
                } else {
                    lo[axis]
                };
                hi[axis] = if p[axis] > hi[axis] {
                    p[axis]
                } else {
                    hi[axis]
                };
            }
        });
        if !finite {
            return Err(Unfit::NotFinite);
        }
        Ok([
            0.25 * lo[0] + 0.25 * hi[0],
            0.25 * lo[1] + 0.25 * hi[1],
            0.25 * lo[2] + 0.25 * hi[2],
        ])
    }
}

/// Consecutive ranges that cover `0..n`, the same whatever the number of threads.
fn chunks(n: usize) -> Vec<Range<usize>> {
    (0..n.div_ceil(CHUNK))
        .map(|c| c * CHUNK..((c + 1) * CHUNK).min(n))
        .collect()
}
