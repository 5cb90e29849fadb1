//! The cells of a sub-mesh as the encoder works on them: points numbered from 0, positions side by side.

use vacua_volume::CellType;

use crate::bvh::Box4;
use crate::ids::Numbering;
use crate::input::Input;

/// What testing a tetrahedron costs, in primitives. The heuristic counts cells before they are
/// paired, and most tetrahedra end up as half of a pair, which is one primitive of 5 indices: this is
/// what such a half reads of a tetrahedron's 4. With 1 a Delaunay mesh has 4.7 cells a leaf and takes
/// 10.5 bytes a cell in variant 2, with this 6.9 and 9.5.
const TET_COST: f32 = 0.625;

/// So many cells or points ahead memory is asked for.
const AHEAD: usize = 16;

/// The cells of a sub-mesh with points numbered from 0 as they are first seen.
#[derive(Default)]
pub(super) struct Gathered {
    pub(super) numbering: Numbering,
    pub(super) positions: Vec<[f32; 4]>,
    /// Where a cell's corners start, unless all have `width`.
    starts: Vec<u32>,
    pub(super) corners: Vec<u32>,
    /// Corners of every cell, if that is one number.
    pub(super) width: Option<usize>,
    num_all: usize,
    pub(super) num_cells: [u32; 4],
    pub(super) bounds: Option<Box4>,
}

impl Gathered {
    /// Fills it with some cells, whose points are fewer than two to so many bits.
    pub(super) fn gather(&mut self, input: &Input, cells: &[u64], index_bits: u32) {
        let most_points = (cells.len() * 4).min(1 << index_bits);
        self.numbering.clear(most_points);
        self.starts.clear();
        self.corners.clear();
        self.num_cells = [0; 4];
        self.num_all = cells.len();
        self.width = input.mesh().uniform_type().map(CellType::num_points);
        for (i, &cell) in cells.iter().enumerate() {
            if let Some(&soon) = cells.get(i + AHEAD) {
                input.prefetch_cell(soon);
            }
            if let Some(&next) = cells.get(i + AHEAD / 4) {
                input.visit_points(next, |point| self.numbering.prefetch(point));
            }
            if self.width.is_none() {
                self.starts.push(self.corners.len() as u32);
            }
            let cell_type = input.visit_points(cell, |point| {
                self.corners.push(self.numbering.number(point));
            });
            self.num_cells[cell_type as usize] += 1;
        }
        self.starts.push(self.corners.len() as u32);
        self.positions.clear();
        let mut bounds = Box4::EMPTY;
        let points = self.numbering.points();
        for (i, &point) in points.iter().enumerate() {
            if let Some(&soon) = points.get(i + AHEAD) {
                input.prefetch_position(soon);
            }
            let [x, y, z] = input.local(point);
            bounds = bounds.with_point([x, y, z, 0.0]);
            self.positions.push([x, y, z, 0.0]);
        }
        self.bounds = Some(bounds);
    }

    /// What testing a cell costs on average.
    pub(super) fn mean_cost(&self) -> f32 {
        let tets = self.num_cells[CellType::Tetrahedron as usize];
        let tets = tets as f32 / self.num_all as f32;
        1.0 - tets * (1.0 - TET_COST)
    }

    #[inline(always)]
    pub(super) fn corners(&self, cell: usize) -> &[u32] {
        match self.width {
            Some(width) => &self.corners[cell * width..(cell + 1) * width],
            None => &self.corners[self.starts[cell] as usize..self.starts[cell + 1] as usize],
        }
    }

    /// The box around some points.
    #[inline(always)]
    pub(super) fn bounds_of(&self, points: &[u32]) -> Box4 {
        let around = |b: Box4, &v: &u32| b.with_point(self.positions[v as usize]);
        points.iter().fold(Box4::EMPTY, around)
    }

    /// Whether a tetrahedron has positive volume.
    pub(super) fn is_upright(&self, [a, b, c, d]: [u32; 4]) -> bool {
        let base = &self.positions[a as usize];
        let from_base = |v: u32| {
            let p = &self.positions[v as usize];
            let along = |axis: usize| f64::from(p[axis]) - f64::from(base[axis]);
            [along(0), along(1), along(2)]
        };
        let (u, v, w) = (from_base(b), from_base(c), from_base(d));
        let volume = u[0] * (v[1] * w[2] - v[2] * w[1])
            + u[1] * (v[2] * w[0] - v[0] * w[2])
            + u[2] * (v[0] * w[1] - v[1] * w[0]);
        volume > 0.0
    }
}
