//! Leaves that fit their counters: tetrahedra, pairs of tetrahedra, other cells.

use super::MARKER;
use super::gathered::Gathered;
use crate::bvh::{Box4, LeafMaker, Prim};
use crate::layout::{LeafCounts, MAX_LEAF_OTHERS, MAX_LEAF_PAIRS, MAX_LEAF_TETS, OTHER_INDICES};
use crate::pairs::{bits, match_pairs};

/// A leaf's counts and where its indices and cells start.
pub(super) struct Leaf {
    pub(super) counts: LeafCounts,
    pub(super) first_word: u32,
    pub(super) first_cell: u32,
}

/// The leaves of a sub-mesh in the order in which they were made.
#[derive(Default)]
pub(super) struct Leaves {
    pub(super) leaves: Vec<Leaf>,
    pub(super) words: Vec<u32>,
    pub(super) cells: Vec<u32>,
}

impl Leaves {
    pub(super) fn clear(&mut self) {
        self.leaves.clear();
        self.words.clear();
        self.cells.clear();
    }
}

/// Makes leaves that fit the counters.
pub(super) struct CellLeaves<'a> {
    pub(super) gathered: &'a Gathered,
    pub(super) mean_cost: f32,
    pub(super) out: &'a mut Leaves,
}

impl LeafMaker for CellLeaves<'_> {
    const MAX_PRIMS: usize = MAX_LEAF_TETS + 2 * MAX_LEAF_PAIRS + MAX_LEAF_OTHERS;

    fn primitive_cost(&self) -> f32 {
        self.mean_cost
    }

    #[inline(always)]
    fn bounds(&self, cell: u32) -> Box4 {
        self.gathered
            .bounds_of(self.gathered.corners(cell as usize))
    }

    #[inline(always)]
    fn prefetch(&self, cell: u32) {
        if let Some(width) = self.gathered.width {
            vacua_simd::prefetch(&self.gathered.corners, cell as usize * width);
        }
    }

    fn leaf(&mut self, prims: &[Prim]) -> Option<(u32, Box4)> {
        let mut tets = [[0; 4]; Self::MAX_PRIMS];
        let mut tet_cells = [0; Self::MAX_PRIMS];
        let mut upright = [false; Self::MAX_PRIMS];
        let mut others = [0; MAX_LEAF_OTHERS];
        let (mut num_tets, mut num_others) = (0, 0);
        for prim in prims {
            let cell = prim.number();
            if let [a, b, c, d] = *self.gathered.corners(cell as usize) {
                tets[num_tets] = [a, b, c, d];
                tet_cells[num_tets] = cell;
                upright[num_tets] = self.gathered.is_upright([a, b, c, d]);
                num_tets += 1;
            } else {
                *others.get_mut(num_others)? = cell;
                num_others += 1;
            }
        }
        let mut pairs = [([0; 2], [0; 5]); Self::MAX_PRIMS / 2];
        let mut num_pairs = 0;
        let single = match_pairs(&tets[..num_tets], &upright[..num_tets], |i, j, five| {
            pairs[num_pairs] = ([i, j], five);
            num_pairs += 1;
        });
        let counts = LeafCounts {
            tets: single.count_ones() as u8,
            pairs: num_pairs as u8,
            others: num_others as u8,
        };
        counts.pack()?;
        let out = &mut *self.out;
        let (first_word, first_cell) = (out.words.len(), out.cells.len() as u32);
        let mut bounds = Box4::EMPTY;
        for i in bits(single) {
            out.words.extend_from_slice(&tets[i]);
            out.cells.push(tet_cells[i]);
        }
        for (both, five) in &pairs[..num_pairs] {
            out.words.extend_from_slice(five);
            out.cells.extend(both.map(|i| tet_cells[i]));
        }
        bounds = bounds.union(&self.gathered.bounds_of(&out.words[first_word..]));
        for &cell in &others[..num_others] {
            let corners = self.gathered.corners(cell as usize);
            bounds = bounds.union(&self.gathered.bounds_of(corners));
            out.words.extend_from_slice(corners);
            let fill = OTHER_INDICES - corners.len();
            out.words.extend(std::iter::repeat_n(MARKER, fill));
            out.cells.push(cell);
        }
        out.leaves.push(Leaf {
            counts,
            first_word: first_word as u32,
            first_cell,
        });
        Some(((out.leaves.len() - 1) as u32, bounds))
    }
}
