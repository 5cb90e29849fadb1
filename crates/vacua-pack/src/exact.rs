//! Finding cells of a mesh as it came, with positions in `f64`: what `sample` uses, and an oracle for
//! the packed form.
//!
//! A binary tree of boxes over the cells, halved by number along the longest side of the centres'
//! box. A node at depth `d` with place `j` has the cells `j·n/2^d .. (j+1)·n/2^d` of the order, so
//! that nothing but boxes and the order are stored.

use glam::DVec3;
use rayon::prelude::*;
use vacua_volume::UnstructuredMesh;

use crate::element::{Weights, weights_at_f64};

/// Cells of a leaf, at most.
const LEAF_CELLS: usize = 8;

/// Cells below which a piece of the order is split by one thread.
const SERIAL_CELLS: usize = 1 << 13;

/// A closed box; empty if `lo > hi`.
#[derive(Clone, Copy, Debug)]
struct Box3 {
    lo: DVec3,
    hi: DVec3,
}

impl Box3 {
    const EMPTY: Self = Self {
        lo: DVec3::INFINITY,
        hi: DVec3::NEG_INFINITY,
    };

    fn union(self, other: Self) -> Self {
        Self {
            lo: self.lo.min(other.lo),
            hi: self.hi.max(other.hi),
        }
    }

    fn contains(&self, p: DVec3) -> bool {
        self.lo.cmple(p).all() && p.cmple(self.hi).all()
    }
}

/// Finds the cells of a mesh by position, in `f64`.
#[derive(Clone, Debug)]
pub struct MeshLocator {
    mesh: UnstructuredMesh,
    /// Cells in the order of the tree: neither blanked nor with a corner that is nowhere.
    order: Vec<u64>,
    /// Levels of the tree below the root.
    depth: u32,
    /// All levels, root first.
    boxes: Vec<Box3>,
}

impl MeshLocator {
    /// Builds the tree over a mesh, whose arrays are shared.
    ///
    /// Cost: `n·log n` in parallel, 8 bytes and half a box a cell to keep.
    pub fn new(mesh: &UnstructuredMesh) -> Self {
        let mut placed: Vec<(u64, DVec3)> = (0..mesh.num_cells())
            .into_par_iter()
            .filter_map(|cell| {
                let Box3 { lo, hi } = cell_box(mesh, cell)?;
                Some((cell as u64, 0.5 * lo + 0.5 * hi))
            })
            .collect();
        let n = placed.len();
        let depth = n.div_ceil(LEAF_CELLS).next_power_of_two().trailing_zeros();
        split(&mut placed, depth);
        let order: Vec<u64> = placed.into_iter().map(|(cell, _)| cell).collect();
        let mut boxes = vec![Box3::EMPTY; (2usize << depth) - 1];
        let leaves = &mut boxes[(1 << depth) - 1..];
        leaves.par_iter_mut().enumerate().for_each(|(leaf, place)| {
            let cells = order[piece(n, depth, leaf)].iter();
            *place = cells
                .filter_map(|&cell| cell_box(mesh, cell as usize))
                .fold(Box3::EMPTY, Box3::union);
        });
        for node in (0..(1usize << depth) - 1).rev() {
            boxes[node] = boxes[2 * node + 1].union(boxes[2 * node + 2]);
        }
        Self {
            mesh: mesh.clone(),
            order,
            depth,
            boxes,
        }
    }

    /// The mesh.
    pub fn mesh(&self) -> &UnstructuredMesh {
        &self.mesh
    }

    /// The cell with the lowest number among those that accept a position, and the weights of its
    /// corners there.
    pub fn locate(&self, position: DVec3) -> Option<(usize, Weights)> {
        let mut best: Option<(usize, Weights)> = None;
        let mut stack = vec![(0u32, 0usize)];
        while let Some((depth, place)) = stack.pop() {
            let node = (1usize << depth) - 1 + place;
            if !self.boxes[node].contains(position) {
                continue;
            }
            if depth < self.depth {
                stack.push((depth + 1, 2 * place));
                stack.push((depth + 1, 2 * place + 1));
                continue;
            }
            for &cell in &self.order[piece(self.order.len(), depth, place)] {
                let cell = cell as usize;
                if best.is_some_and(|(known, _)| known <= cell) {
                    continue;
                }
                let corners = self.mesh.cell(cell);
                let mut positions = [[0.0; 3]; 8];
                for (to, &point) in positions.iter_mut().zip(corners.points()) {
                    *to = self.mesh.position(point as usize).to_array();
                }
                let weights = weights_at_f64(corners.cell_type, &positions, position.to_array());
                best = weights.map(|weights| (cell, weights)).or(best);
            }
        }
        best
    }
}

/// The cells of a node within the order.
fn piece(n: usize, depth: u32, place: usize) -> std::ops::Range<usize> {
    let at = |place: usize| ((n as u128 * place as u128) >> depth) as usize;
    at(place)..at(place + 1)
}

/// Orders cells so that the pieces of every depth down to `depth` are near each other.
fn split(cells: &mut [(u64, DVec3)], depth: u32) {
    split_node(cells, cells.len(), 0, 0, depth);
}

fn split_node(cells: &mut [(u64, DVec3)], n: usize, at: u32, place: usize, depth: u32) {
    if at == depth {
        return;
    }
    let around = cells
        .iter()
        .fold(Box3::EMPTY, |b, &(_, c)| b.union(Box3 { lo: c, hi: c }));
    let size = (around.hi - around.lo).to_array();
    let axis = (0..3).fold(0, |a, b| if size[b] > size[a] { b } else { a });
    let middle = piece(n, at + 1, 2 * place).len();
    if middle > 0 && middle < cells.len() {
        cells.select_nth_unstable_by(middle, |a, b| {
            a.1[axis].total_cmp(&b.1[axis]).then(a.0.cmp(&b.0))
        });
    }
    let serial = cells.len() < SERIAL_CELLS;
    let (left, right) = cells.split_at_mut(middle);
    let mut left = || split_node(left, n, at + 1, 2 * place, depth);
    let mut right = || split_node(right, n, at + 1, 2 * place + 1, depth);
    if serial {
        left();
        right();
    } else {
        rayon::join(left, right);
    }
}

/// The box around a cell; `None` if it is blanked or one of its corners is nowhere.
fn cell_box(mesh: &UnstructuredMesh, cell: usize) -> Option<Box3> {
    if mesh.blanked_cells().is_some_and(|b| b.is_blank(cell)) {
        return None;
    }
    mesh.cell(cell)
        .points()
        .iter()
        .try_fold(Box3::EMPTY, |b, &point| {
            let p = mesh.position(point as usize);
            p.is_finite().then(|| b.union(Box3 { lo: p, hi: p }))
        })
}
