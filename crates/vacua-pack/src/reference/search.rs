//! The cells of sixteen places through a hierarchy of boxes, whatever its layout.
//!
//! Sixteen places go down together, breadth first, a mask of lanes with every node. Of the cells whose
//! boxes they are in, tetrahedra are tested sixteen at a time: their planes in `f32`, with a bound on
//! the rounding that leaves whatever is in doubt to the scalar code; hexahedra by Newton's method in
//! `f64` on eight pairs of cell and place. Among several cells the lowest is the answer.

use vacua_simd::{Float, Kernel, LANES, Mask, Simd, dispatch, per_axis};
use vacua_volume::CellType;

use super::tree::Box3;
use super::weigh::{self, WIDE};
use super::{Cell, Found, NONE};
use crate::block::Places;
use crate::element::{Weights, interpolate};

/// What is in a box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Inside {
    /// A node of the hierarchy.
    Node(u32),
    /// A leaf of one cell, whose box it is.
    Leaf(u32),
}

/// A hierarchy of boxes over cells, with the cells.
pub(super) trait Source: Sync {
    /// The first node, if there is any cell.
    fn root(&self) -> Option<u32>;
    /// How many boxes are below a node, at most [`MOST_BELOW`].
    fn num_below(&self, node: u32) -> usize;
    /// One of the boxes below a node, and what is in it.
    fn below(&self, node: u32, k: usize) -> (Box3, Inside);
    /// The cell of a leaf.
    fn cell_of_leaf(&self, leaf: u32) -> u32;
    /// Asks for a node that will be visited soon.
    fn prefetch(&self, node: u32);
    /// A cell.
    fn cell(&self, cell: u32) -> Cell;
    /// Position and value of a vertex.
    fn vertex(&self, vertex: u32) -> [f32; 4];
    /// A power of two that makes the mesh about 1 in size.
    fn scale(&self) -> f32;
}

/// The power of two for [`Source::scale`].
pub(super) fn scale_of(vertices: &[[f32; 4]]) -> f32 {
    let mut extent = 0.0f64;
    for axis in 0..3 {
        let of_axis = vertices.iter().map(|v| f64::from(v[axis]));
        let lo = of_axis.clone().fold(f64::INFINITY, f64::min);
        let hi = of_axis.fold(f64::NEG_INFINITY, f64::max);
        extent = extent.max(hi - lo);
    }
    let exponent = (-crate::grid::ceil_log2(extent)).clamp(-100, 100);
    crate::grid::exp2(exponent) as f32
}

/// The values at sixteen places.
pub(super) fn sample<T: Source>(source: &T, at: &Places, lanes: u16) -> Found {
    dispatch(Search { source, at, lanes })
}

struct Search<'a, T> {
    source: &'a T,
    at: &'a Places,
    lanes: u16,
}

/// What has been found so far.
struct State {
    cells: [u32; LANES],
    /// The lanes that have a cell.
    found: u16,
    /// The lanes whose cell is no tetrahedron.
    others: u16,
    /// Weights of those.
    weights: [Weights; LANES],
}

impl State {
    /// The lanes of `lanes` whose answer so far does not come before a cell.
    #[inline(always)]
    fn open(&self, lanes: u16, cell: u32) -> u16 {
        let mut open = lanes & !self.found;
        let mut left = lanes & self.found;
        while left != 0 {
            let lane = left.trailing_zeros() as usize;
            left &= left - 1;
            open |= u16::from(self.cells[lane % LANES] > cell) << lane;
        }
        open
    }

    #[inline(always)]
    fn set_tet(&mut self, lane: usize, cell: u32) {
        self.cells[lane] = cell;
        self.found |= 1 << lane;
        self.others &= !(1 << lane);
    }

    #[inline(always)]
    fn set_other(&mut self, lane: usize, cell: u32, weights: Weights) {
        self.cells[lane] = cell;
        self.found |= 1 << lane;
        self.others |= 1 << lane;
        self.weights[lane] = weights;
    }
}

/// Up to sixteen tetrahedra, the corners' positions coordinate by coordinate, and the lanes that are
/// in the box of each.
struct Tets {
    len: usize,
    cells: [u32; LANES],
    corners: [[[f32; LANES]; 3]; 4],
    candidates: [u16; LANES],
}

/// Up to eight pairs of a hexahedron and a lane.
struct Pairs {
    len: usize,
    cells: [u32; WIDE],
    lanes: [usize; WIDE],
    corners: [[[f64; WIDE]; 3]; 8],
}

/// The most boxes below a node.
pub(super) const MOST_BELOW: usize = 4;
/// A scaled product below this may have lost digits.
const SMALLEST: f32 = f32::MIN_POSITIVE;
/// Bound on the rounding of a volume, in units of that of the cell's box; see `block::tets`.
const ROUNDING: f32 = 512.0 / (1 << 24) as f32;
/// Coordinates up to which `f32` computes; beyond, products could overflow.
const LARGEST: f32 = 1e30;

impl<T: Source> Kernel for Search<'_, T> {
    type Output = Found;

    #[inline(always)]
    fn run<S: Simd>(self) -> Found {
        let Self { source, at, lanes } = self;
        let places = per_axis!(i => S::F::from_array(at[i]));
        let largest = S::F::splat(f32::MAX);
        let finite =
            places[0].abs().le(largest) & places[1].abs().le(largest) & places[2].abs().le(largest);
        let lanes = lanes & finite.to_bits();
        let mut state = State {
            cells: [NONE; LANES],
            found: 0,
            others: 0,
            weights: [[0.0; 8]; LANES],
        };
        let Some(root) = source.root().filter(|_| lanes != 0) else {
            return Found::NOTHING;
        };
        let mut tets = Tets {
            len: 0,
            cells: [NONE; LANES],
            corners: [[[0.0; LANES]; 3]; 4],
            candidates: [0; LANES],
        };
        let mut pairs = Pairs {
            len: 0,
            cells: [NONE; WIDE],
            lanes: [0; WIDE],
            corners: [[[0.0; WIDE]; 3]; 8],
        };
        let mut queue = Vec::with_capacity(512);
        queue.push((root, lanes));
        let mut first = 0;
        while let Some(&(node, lanes)) = queue.get(first) {
            first += 1;
            let mut cells = [(0, 0); MOST_BELOW];
            let mut num_cells = 0;
            for k in 0..source.num_below(node) {
                let ([lo, hi], inside) = source.below(node, k);
                let within = per_axis!(i => {
                    S::F::splat(lo[i]).le(places[i]) & places[i].le(S::F::splat(hi[i]))
                });
                let lanes = (within[0] & within[1] & within[2]).to_bits() & lanes;
                if lanes == 0 {
                    continue;
                }
                match inside {
                    Inside::Node(below) => {
                        source.prefetch(below);
                        queue.push((below, lanes));
                    }
                    Inside::Leaf(leaf) => {
                        cells[num_cells % MOST_BELOW] = (source.cell_of_leaf(leaf), lanes);
                        num_cells += 1;
                    }
                }
            }
            for &(number, lanes) in &cells[..num_cells.min(MOST_BELOW)] {
                let lanes = state.open(lanes, number);
                if lanes == 0 {
                    continue;
                }
                let cell = source.cell(number);
                if cell.cell_type == CellType::Tetrahedron {
                    tets.add(source, number, &cell, lanes);
                    if tets.len == LANES {
                        tets.test::<S, T>(source, at, &mut state);
                    }
                } else {
                    others::<T>(source, number, &cell, at, lanes, &mut pairs, &mut state);
                }
            }
        }
        tets.test::<S, T>(source, at, &mut state);
        pairs.test(source, at, &mut state);
        finish(source, at, &state)
    }
}

impl Tets {
    #[inline(always)]
    fn add<T: Source>(&mut self, source: &T, number: u32, cell: &Cell, lanes: u16) {
        let slot = self.len % LANES;
        self.cells[slot] = number;
        self.candidates[slot] = lanes;
        for k in 0..4 {
            let [x, y, z, _] = source.vertex(cell.corners[k]);
            self.corners[k][0][slot] = x;
            self.corners[k][1][slot] = y;
            self.corners[k][2][slot] = z;
        }
        self.len += 1;
    }

    /// Tests all and forgets them.
    #[inline(always)]
    fn test<S: Simd, T: Source>(&mut self, source: &T, at: &Places, state: &mut State) {
        let len = std::mem::take(&mut self.len);
        if len == 0 {
            return;
        }
        let mut slots_of = [0u16; LANES];
        let mut lanes = 0;
        for slot in 0..len {
            lanes |= self.candidates[slot];
            let mut left = self.candidates[slot];
            while left != 0 {
                let lane = left.trailing_zeros() as usize;
                left &= left - 1;
                slots_of[lane % LANES] |= 1 << slot;
            }
        }
        let scale = S::F::splat(source.scale());
        let a = per_axis!(i => S::F::from_array(self.corners[0][i]));
        let b = per_axis!(i => (S::F::from_array(self.corners[1][i]) - a[i]) * scale);
        let c = per_axis!(i => (S::F::from_array(self.corners[2][i]) - a[i]) * scale);
        let d = per_axis!(i => (S::F::from_array(self.corners[3][i]) - a[i]) * scale);
        let zero = S::F::splat(0.0);
        let side = per_axis!(i => {
            b[i].max(c[i]).max(d[i].max(zero)) - b[i].min(c[i]).min(d[i].min(zero))
        });
        let bound = side[0] * side[1] * side[2] * S::F::splat(ROUNDING) + S::F::splat(SMALLEST);
        let (cd, db, bc) = (cross(c, d), cross(d, b), cross(b, c));
        let whole = dot(b, cd);
        let factor = scale.select(zero.le(whole), zero - scale);
        let cd = per_axis!(i => cd[i] * factor);
        let db = per_axis!(i => db[i] * factor);
        let bc = per_axis!(i => bc[i] * factor);
        let whole = whole.abs();
        // Of a cell that may be flat nothing is certain, nor far out.
        let far = a[0].abs().max(a[1].abs()).max(a[2].abs());
        let tame = (bound * S::F::splat(4.0)).lt(whole) & far.lt(S::F::splat(LARGEST));
        let bound = bound.select(tame, S::F::splat(f32::INFINITY));
        let below = zero - bound;
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            let p = per_axis!(i => S::F::splat(at[i][lane]) - a[i]);
            let (u, v, w) = (dot(p, cd), dot(p, db), dot(p, bc));
            let least = u.min(v).min(w.min(whole - (u + v + w)));
            let candidates = slots_of[lane];
            let inside = bound.lt(least).to_bits() & candidates;
            let mut left = candidates & !least.lt(below).to_bits();
            while left != 0 {
                let slot = left.trailing_zeros() as usize % LANES;
                left &= left - 1;
                let cell = self.cells[slot];
                if state.found >> lane & 1 == 1 && state.cells[lane] <= cell {
                    continue;
                }
                if inside >> slot & 1 == 1 || accepts(source, cell, at, lane).is_some() {
                    state.set_tet(lane, cell);
                }
            }
        }
    }
}

#[inline(always)]
fn cross<F: Float>(a: [F; 3], b: [F; 3]) -> [F; 3] {
    let zero = F::splat(0.0);
    [
        a[1].mul_add(b[2], zero - a[2] * b[1]),
        a[2].mul_add(b[0], zero - a[0] * b[2]),
        a[0].mul_add(b[1], zero - a[1] * b[0]),
    ]
}

#[inline(always)]
fn dot<F: Float>(a: [F; 3], b: [F; 3]) -> F {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

/// The scalar code's answer.
#[cold]
#[inline(never)]
fn accepts<T: Source>(source: &T, cell: u32, at: &Places, lane: usize) -> Option<Weights> {
    let cell = source.cell(cell);
    let corners = cell.corners.map(|corner| source.vertex(corner));
    weigh::one(
        cell.cell_type,
        &corners,
        [0, 1, 2].map(|axis| at[axis][lane]),
    )
}

/// Takes a cell that is no tetrahedron: hexahedra wait for each other.
#[inline(always)]
fn others<T: Source>(
    source: &T,
    number: u32,
    cell: &Cell,
    at: &Places,
    lanes: u16,
    pairs: &mut Pairs,
    state: &mut State,
) {
    let mut left = lanes;
    if cell.cell_type == CellType::Hexahedron {
        let corners = cell.corners.map(|corner| source.vertex(corner));
        while left != 0 {
            let lane = left.trailing_zeros() as usize % LANES;
            left &= left - 1;
            pairs.add(number, &corners, at, lane);
            if pairs.len == WIDE {
                pairs.test(source, at, state);
            }
        }
        return;
    }
    while left != 0 {
        let lane = left.trailing_zeros() as usize % LANES;
        left &= left - 1;
        if let Some(weights) = accepts(source, number, at, lane) {
            state.set_other(lane, number, weights);
        }
    }
}

impl Pairs {
    #[inline(always)]
    fn add(&mut self, cell: u32, corners: &[[f32; 4]; 8], at: &Places, lane: usize) {
        let slot = self.len % WIDE;
        self.cells[slot] = cell;
        self.lanes[slot] = lane;
        for k in 0..8 {
            for axis in 0..3 {
                self.corners[k][axis][slot] =
                    f64::from(corners[k][axis]) - f64::from(at[axis][lane]);
            }
        }
        self.len += 1;
    }

    /// Tests all and forgets them.
    #[inline(always)]
    fn test<T: Source>(&mut self, source: &T, at: &Places, state: &mut State) {
        let len = std::mem::take(&mut self.len);
        if len == 0 {
            return;
        }
        let found = weigh::hexahedra(&self.corners, ((1u32 << len) - 1) as u8);
        for slot in 0..len {
            let (cell, lane) = (self.cells[slot], self.lanes[slot] % LANES);
            if state.found >> lane & 1 == 1 && state.cells[lane] <= cell {
                continue;
            }
            if found.accepted >> slot & 1 == 1 {
                let mut weights = [0.0; 8];
                for (weight, lanes) in weights.iter_mut().zip(&found.weights) {
                    *weight = lanes[slot];
                }
                state.set_other(lane, cell, weights);
            } else if found.lost >> slot & 1 == 1
                && let Some(weights) = accepts(source, cell, at, lane)
            {
                state.set_other(lane, cell, weights);
            }
        }
    }
}

/// Weights of tetrahedra, and all values.
#[inline(always)]
fn finish<T: Source>(source: &T, at: &Places, state: &State) -> Found {
    let mut found = Found {
        cells: state.cells,
        ..Found::NOTHING
    };
    let tets = state.found & !state.others;
    if tets != 0 {
        let corners = |lane: usize| {
            let cell = source.cell(state.cells[lane]);
            [0, 1, 2, 3].map(|k| source.vertex(cell.corners[k]))
        };
        weigh_tets(at, tets, corners, &mut found);
    }
    let mut left = state.others;
    while left != 0 {
        let lane = left.trailing_zeros() as usize % LANES;
        left &= left - 1;
        let cell = source.cell(state.cells[lane]);
        let mut values = [0.0; 8];
        for (value, &corner) in values.iter_mut().zip(cell.corners()) {
            *value = f64::from(source.vertex(corner)[3]);
        }
        let value = interpolate(&state.weights[lane], &values[..cell.corners().len()]);
        if let Some(value) = value {
            found.values[lane] = value as f32;
            found.valid |= 1 << lane;
        }
    }
    found
}

/// The values of lanes whose tetrahedra have these corners; gives the lanes that are surely inside
/// theirs. Those that are not accepted by theirs stay without value.
#[inline(always)]
pub(super) fn weigh_tets(
    at: &Places,
    lanes: u16,
    corners: impl Fn(usize) -> [[f32; 4]; 4],
    found: &mut Found,
) -> u16 {
    let mut sure = 0;
    for half in [0, WIDE] {
        let mask = (lanes >> half) as u8;
        if mask == 0 {
            continue;
        }
        let mut relative = [[[0.0; WIDE]; 3]; 4];
        let mut values = [[0.0; 4]; WIDE];
        let mut left = mask;
        while left != 0 {
            let l = left.trailing_zeros() as usize % WIDE;
            left &= left - 1;
            let corners = corners(half + l);
            for k in 0..4 {
                for axis in 0..3 {
                    relative[k][axis][l] =
                        f64::from(corners[k][axis]) - f64::from(at[axis][half + l]);
                }
                values[l][k] = f64::from(corners[k][3]);
            }
        }
        let weighed = weigh::tetrahedra(&relative);
        sure |= u16::from(weighed.sure & mask) << half;
        let mut left = weighed.accepted & mask;
        while left != 0 {
            let l = left.trailing_zeros() as usize % WIDE;
            left &= left - 1;
            let mut weights = [0.0; 8];
            for (weight, lanes) in weights.iter_mut().zip(&weighed.weights) {
                *weight = lanes[l];
            }
            if let Some(value) = interpolate(&weights, &values[l]) {
                found.values[half + l] = value as f32;
                found.valid |= 1 << (half + l);
            }
        }
    }
    sure
}
