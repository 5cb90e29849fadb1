//! The bytes of the encoding: multi-leaves, multi-nodes, sub-mesh headers.
//!
//! Source: paper B, §5.3 to §5.6 and Figure 3. All numbers are little-endian.
//!
//! # A multi-leaf, 48 bytes
//!
//! ```text
//! byte  0      6      12         16                24                32                40        48
//!       ├──────┼──────┼──────────┼─────────────────┼─────────────────┼─────────────────┼─────────┤
//!       │ lo   │ hi   │ first    │ child 0…7 in x  │ child 0…7 in y  │ child 0…7 in z  │ counts  │
//!       │3×u16 │3×u16 │ index u32│ 8 × (hi:4 lo:4) │ 8 × (hi:4 lo:4) │ 8 × (hi:4 lo:4) │ 8 × u8  │
//!       └──────┴──────┴──────────┴─────────────────┴─────────────────┴─────────────────┴─────────┘
//!
//! a child's byte along an axis:   7      4 3      0        a child's counts:  7 6 5    2 1 0
//!                                │  hi    │  lo    │                         │oth│pairs │tet│
//! ```
//!
//! `lo` and `hi` are steps of the sub-mesh's [`Grid`]. A child's box divides `lo..hi`
//! into sixteen along each axis: with `w = hi − lo`, it spans `16·lo + w·child_lo` to
//! `16·lo + w·(child_hi + 1)` in sixteenths of a step, all of it exact in 20-bit integers.
//!
//! A child is
//! - *a leaf* if its counts are not zero: so many tetrahedra (4 indices each), then pairs (5 each),
//!   then others (8 each) in the sub-mesh's list of indices. The children's primitives follow each
//!   other in the order of the children, from `first index`;
//! - *absent* if its counts are zero and its byte along x has `lo > hi` (it is `0x0F`);
//! - *an inner node* otherwise, which only a multi-node may have.
//!
//! # A multi-node, 52 bytes
//!
//! A multi-leaf, then at byte 48 a `u32`: the place of the first inner child among the sub-mesh's
//! nodes; further inner children follow it in the order of the children. Inner children have larger
//! numbers than their parent.
//!
//! # One worked example
//!
//! A grid with base (0, 0, 0) and step 1/4; a multi-leaf over the box (0, 0, 0) to (4, 2, 1) whose
//! child 0 is a leaf of one tetrahedron and one pair in (1, 0, 0) to (2, 2, 1), nothing else:
//!
//! ```text
//! lo = 0 0 0               00 00 00 00 00 00
//! hi = 16 8 4              10 00 08 00 04 00
//! first index = 9          09 00 00 00
//! x: w = 16; 1 = 4 steps = 64 sixteenths → lo 4; 2 = 8 steps = 128 → hi 7   74 0F 0F 0F 0F 0F 0F 0F
//! y: the whole side        → lo 0, hi 15                                    F0 00 00 00 00 00 00 00
//! z: the whole side        → lo 0, hi 15                                    F0 00 00 00 00 00 00 00
//! counts: 1 tet + 1 pair = 1 | 1 << 2                                       05 00 00 00 00 00 00 00
//! ```
//!
//! Its primitives are indices 9..13 (the tetrahedron) and 13..18 (the pair).
//!
//! # Primitives
//!
//! - tetrahedron: its 4 points in an order of the same orientation;
//! - pair `a b c d e`: the tetrahedra `a b c d` and `a c b e`, which share the face `a b c`;
//! - other: the 5, 6 or 8 points of a pyramid, wedge or hexahedron, filled up to 8 with the marker
//!   `2^N − 1`. The marker is reserved (is no point) in sub-meshes that hold a pyramid or a wedge;
//!   where there are only hexahedra it is a point like any other.

use bytemuck::{Pod, Zeroable};

use crate::grid::Grid;

/// Children of a node.
pub const WIDTH: usize = 8;
/// Divisions of a node's box along an axis, for its children: 4 bits.
pub const CHILD_DIVISIONS: u32 = 16;
/// Steps of a sub-mesh's grid along an axis: 16 bits.
pub const GRID_STEPS: u32 = u16::MAX as u32;
/// The most tetrahedra on their own in a leaf: 2 bits.
pub const MAX_LEAF_TETS: usize = 3;
/// The most pairs of tetrahedra in a leaf: 4 bits.
pub const MAX_LEAF_PAIRS: usize = 15;
/// The most pyramids, wedges and hexahedra in a leaf: 2 bits.
pub const MAX_LEAF_OTHERS: usize = 3;
/// Indices of a tetrahedron.
pub const TET_INDICES: usize = 4;
/// Indices of a pair of tetrahedra.
pub const PAIR_INDICES: usize = 5;
/// Indices of every other cell.
pub const OTHER_INDICES: usize = 8;
/// Byte along x of a child that is not there: `lo` 15, `hi` 0.
pub const ABSENT: u8 = 0x0F;

/// How many primitives of each kind a leaf holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct LeafCounts {
    /// Tetrahedra on their own.
    pub tets: u8,
    /// Pairs of tetrahedra.
    pub pairs: u8,
    /// Pyramids, wedges and hexahedra.
    pub others: u8,
}

impl LeafCounts {
    /// The byte, if the counts fit their bits and are not all zero.
    pub fn pack(self) -> Option<u8> {
        let fits = usize::from(self.tets) <= MAX_LEAF_TETS
            && usize::from(self.pairs) <= MAX_LEAF_PAIRS
            && usize::from(self.others) <= MAX_LEAF_OTHERS;
        let byte = self.tets | self.pairs << 2 | self.others << 6;
        (fits && byte != 0).then_some(byte)
    }

    /// The counts in a byte.
    #[inline(always)]
    pub const fn unpack(byte: u8) -> Self {
        Self {
            tets: byte & 3,
            pairs: byte >> 2 & 15,
            others: byte >> 6,
        }
    }

    /// Indices that the primitives take.
    #[inline(always)]
    pub const fn num_indices(self) -> usize {
        TET_INDICES * self.tets as usize
            + PAIR_INDICES * self.pairs as usize
            + OTHER_INDICES * self.others as usize
    }

    /// Cells that the primitives are.
    #[inline(always)]
    pub const fn num_cells(self) -> usize {
        self.tets as usize + 2 * self.pairs as usize + self.others as usize
    }
}

/// Eight children with their boxes and counts: Figure 3 of paper B. See the [module](self).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct MultiLeaf {
    /// Lower corner of the shared box, in steps of the grid.
    pub lo: [u16; 3],
    /// Upper corner of the shared box, in steps of the grid.
    pub hi: [u16; 3],
    /// Where the children's primitives start among the sub-mesh's indices.
    pub first_index: u32,
    /// A child's box along each axis: low nibble `lo`, high nibble `hi`.
    pub child_bounds: [[u8; WIDTH]; 3],
    /// A child's counts.
    pub counts: [u8; WIDTH],
}

/// A multi-leaf whose children may be inner nodes too. See the [module](self).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct MultiNode {
    /// Boxes and counts.
    pub leaf: MultiLeaf,
    /// Where the inner children start among the sub-mesh's nodes.
    pub first_child: u32,
}

const _: () = {
    assert!(size_of::<MultiLeaf>() == 48);
    assert!(std::mem::offset_of!(MultiLeaf, lo) == 0);
    assert!(std::mem::offset_of!(MultiLeaf, hi) == 6);
    assert!(std::mem::offset_of!(MultiLeaf, first_index) == 12);
    assert!(std::mem::offset_of!(MultiLeaf, child_bounds) == 16);
    assert!(std::mem::offset_of!(MultiLeaf, counts) == 40);
    assert!(size_of::<MultiNode>() == 52);
    assert!(std::mem::offset_of!(MultiNode, first_child) == 48);
    assert!(size_of::<SubmeshHeader>() == 176);
};

/// What a child of a node is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Child {
    /// Nothing.
    Absent,
    /// A node below.
    Inner,
    /// Primitives.
    Leaf(LeafCounts),
}

impl MultiLeaf {
    /// A node without children.
    pub const EMPTY: Self = Self {
        lo: [0; 3],
        hi: [0; 3],
        first_index: 0,
        child_bounds: [[ABSENT; WIDTH], [0; WIDTH], [0; WIDTH]],
        counts: [0; WIDTH],
    };

    /// What child number `child` is.
    #[inline(always)]
    pub fn child(&self, child: usize) -> Child {
        let x = self.child_bounds[0][child];
        match self.counts[child] {
            0 if x & 15 > x >> 4 => Child::Absent,
            0 => Child::Inner,
            counts => Child::Leaf(LeafCounts::unpack(counts)),
        }
    }

    /// A child's box, in sixteenths of a step of the grid.
    #[inline(always)]
    pub fn child_box(&self, child: usize) -> ([u32; 3], [u32; 3]) {
        let mut lo = [0; 3];
        let mut hi = [0; 3];
        for axis in 0..3 {
            let byte = u32::from(self.child_bounds[axis][child]);
            let from = u32::from(self.lo[axis]) * CHILD_DIVISIONS;
            let width = u32::from(self.hi[axis]).saturating_sub(u32::from(self.lo[axis]));
            lo[axis] = from + width * (byte & 15);
            hi[axis] = from + width * ((byte >> 4) + 1);
        }
        (lo, hi)
    }

    /// Sets a child's box to the smallest that contains a box given relative to the sub-mesh's
    /// origin, which must lie within the node's own.
    pub fn set_child_box(&mut self, child: usize, grid: &Grid, lo: [f32; 3], hi: [f32; 3]) {
        let last = CHILD_DIVISIONS - 1;
        for axis in 0..3 {
            let from = u32::from(self.lo[axis]) * CHILD_DIVISIONS;
            let width = u32::from(self.hi[axis]) - u32::from(self.lo[axis]);
            // Exact, so that these comparisons are with the very box that is decoded.
            let at = |k: u32| grid.local_from_sixteenths_along(axis, from + width * k);
            let (lo, hi) = (f64::from(lo[axis]), f64::from(hi[axis]));
            let start = at(0);
            let divisions = f64::from(CHILD_DIVISIONS) / (at(CHILD_DIVISIONS) - start);
            let guess = |x: f64| (((x - start) * divisions) as u32).min(last);
            let mut a = guess(lo);
            while a > 0 && at(a) > lo {
                a -= 1;
            }
            while a < last && at(a + 1) <= lo {
                a += 1;
            }
            let mut b = guess(hi).max(a);
            while b > a && at(b) >= hi {
                b -= 1;
            }
            while b < last && at(b + 1) < hi {
                b += 1;
            }
            self.child_bounds[axis][child] = a as u8 | (b as u8) << 4;
        }
    }
}

/// One sub-mesh: where its parts are in the common arrays, and its grid. 176 bytes.
///
/// ```text
/// byte   0  origin        3 × f64   added to its positions gives the world
///       24  grid_base     3 × f64   corner of the grid, relative to the origin
///       48  first_vertex      u64   in the positions
///       56  first_index       u64   in the indices
///       64  first_node        u64   in the nodes
///       72  first_cell        u64   in packed order
///       80  num_indices       u64
///       88  grid_exponent 3 × i32   a step is 2 to this
///      100  num_vertices      u32
///      104  num_nodes         u32
///      108  num_cells     4 × u32   tetrahedra, pyramids, wedges, hexahedra
///      124  lo            3 × f32   box of its cells, relative to the origin
///      136  hi            3 × f32
///      148  reserved      7 × u32   zero
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct SubmeshHeader {
    /// Added to its positions gives the world.
    pub origin: [f64; 3],
    /// Corner of the grid that its nodes are quantised to, relative to the origin.
    pub grid_base: [f64; 3],
    /// Its first vertex.
    pub first_vertex: u64,
    /// Its first index.
    pub first_index: u64,
    /// Its first node.
    pub first_node: u64,
    /// Its first cell in packed order.
    pub first_cell: u64,
    /// Number of indices.
    pub num_indices: u64,
    /// A step of the grid is 2 to this.
    pub grid_exponent: [i32; 3],
    /// Number of vertices.
    pub num_vertices: u32,
    /// Number of nodes.
    pub num_nodes: u32,
    /// Number of cells by [`vacua_volume::CellType`]'s number.
    pub num_cells: [u32; 4],
    /// Lower corner of the box around its cells, relative to the origin.
    pub lo: [f32; 3],
    /// Upper corner of the box around its cells, relative to the origin.
    pub hi: [f32; 3],
    /// Zero.
    pub reserved: [u32; 7],
}

impl SubmeshHeader {
    /// Places of its nodes among those of all sub-meshes.
    pub fn nodes(&self) -> std::ops::Range<u64> {
        let end = self.first_node.saturating_add(u64::from(self.num_nodes));
        self.first_node..end
    }

    /// Number of cells.
    pub fn total_cells(&self) -> u64 {
        self.num_cells.iter().map(|&n| u64::from(n)).sum()
    }

    /// Whether the largest index is a marker here and no vertex.
    pub fn has_marker(&self) -> bool {
        self.num_cells[1] > 0 || self.num_cells[2] > 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The worked example of the module's documentation.
    #[test]
    fn the_worked_example() {
        let mut node = MultiLeaf {
            hi: [16, 8, 4],
            first_index: 9,
            ..MultiLeaf::EMPTY
        };
        let grid = Grid {
            base: [0.0; 3],
            exponent: [-2; 3],
        };
        node.set_child_box(0, &grid, [1.0, 0.0, 0.0], [2.0, 2.0, 1.0]);
        let counts = LeafCounts {
            tets: 1,
            pairs: 1,
            others: 0,
        };
        node.counts[0] = counts.pack().expect("fits");
        #[rustfmt::skip]
        let expected: [u8; 48] = [
            0, 0, 0, 0, 0, 0, 0x10, 0, 8, 0, 4, 0, 9, 0, 0, 0,
            0x74, 0x0F, 0x0F, 0x0F, 0x0F, 0x0F, 0x0F, 0x0F,
            0xF0, 0, 0, 0, 0, 0, 0, 0,
            0xF0, 0, 0, 0, 0, 0, 0, 0,
            5, 0, 0, 0, 0, 0, 0, 0,
        ];
        assert_eq!(bytemuck::bytes_of(&node), expected);
        assert_eq!(node.child(0), Child::Leaf(counts));
        assert_eq!(node.child(1), Child::Absent);
        assert_eq!(node.child_box(0), ([64, 0, 0], [128, 128, 64]));
        assert_eq!((counts.num_indices(), counts.num_cells()), (9, 3));
    }

    #[test]
    fn counts_fill_a_byte() {
        for byte in 1..=255u8 {
            assert_eq!(LeafCounts::unpack(byte).pack(), Some(byte));
        }
        let too_many = LeafCounts {
            tets: 4,
            ..LeafCounts::default()
        };
        assert_eq!(too_many.pack(), None);
        assert_eq!(LeafCounts::default().pack(), None);
    }
}
