//! A mesh as the encoder sees it: positions rounded to what is stored, bad cells told apart.

use std::ops::Range;

use rayon::prelude::*;
use vacua_volume::{CellType, Indices, MAX_CELL_POINTS, UnstructuredMesh};

/// Work items of a parallel loop over points or cells.
const CHUNK: usize = 1 << 14;

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

    /// A cell's type and points.
    #[inline(always)]
    pub fn cell(&self, cell: u64) -> (CellType, Points) {
        let cell = cell as usize;
        let Some(cell_type) = self.mesh.uniform_type() else {
            let cell = self.mesh.cell(cell);
            let mut points = Points::default();
            cell.points().iter().for_each(|&p| points.push(p));
            return (cell.cell_type, points);
        };
        let width = cell_type.num_points();
        let place = cell * width..(cell + 1) * width;
        let mut points = Points::default();
        match self.indices {
            Indices::U32(all) => all[place].iter().for_each(|&p| points.push(u64::from(p))),
            Indices::U64(all) => all[place].iter().for_each(|&p| points.push(p)),
        }
        (cell_type, points)
    }

    /// The middle of the box around a cell, halved, or why the cell is left out.
    #[inline]
    pub fn center(&self, cell: usize) -> Result<[f32; 3], Unfit> {
        if self.mesh.blanked_cells().is_some_and(|b| b.is_blank(cell)) {
            return Err(Unfit::Blanked);
        }
        let mut lo = [f32::INFINITY; 3];
        let mut hi = [f32::NEG_INFINITY; 3];
        let mut finite = true;
        for &point in self.cell(cell as u64).1.as_slice() {
            let p = self.local(point);
            for axis in 0..3 {
                finite &= p[axis].is_finite();
                lo[axis] = lo[axis].min(p[axis]);
                hi[axis] = hi[axis].max(p[axis]);
            }
        }
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

/// The points of a cell.
#[derive(Clone, Copy, Default)]
pub struct Points {
    all: [u64; MAX_CELL_POINTS],
    len: usize,
}

impl Points {
    #[inline(always)]
    fn push(&mut self, point: u64) {
        self.all[self.len] = point;
        self.len += 1;
    }

    /// The points.
    #[inline(always)]
    pub fn as_slice(&self) -> &[u64] {
        &self.all[..self.len]
    }
}

/// Consecutive ranges that cover `0..n`, the same whatever the number of threads.
pub fn chunks(n: usize) -> Vec<Range<usize>> {
    (0..n.div_ceil(CHUNK))
        .map(|c| c * CHUNK..((c + 1) * CHUNK).min(n))
        .collect()
}
