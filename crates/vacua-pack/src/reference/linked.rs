//! The layout of OSPRay 2.x, that is of Open VKL: the caller's arrays as they are, and a binary
//! hierarchy of linked nodes over single cells.
//!
//! ```text
//! the caller's     a vertex 12 + 4 bytes, indices of 32 bits, a cell's first index 4 and type 1
//! an inner node    96 bytes: least cell size f32, value range 2 × f32 and padding to 16; two boxes of
//!                  2 × 16 bytes; two pointers of 8
//! a leaf           64 bytes: the same 16; the cell's box, 2 × 16; the cell u64; padding to 64
//! ```
//!
//! Source: paper B, §6.1.2, which measures 157 to 159 bytes a cell on the Mars Lander, 197 on
//! Exa-Jet; the layout is that of Open VKL's unstructured volumes. Deviation: what its allocator
//! leaves unused between nodes is not there.

use super::search::{self, Inside, Source};
use super::tree::{self, Below, Box3};
use super::user_geometry::{CellLists, Kinds};
use super::{Cell, Cells, Found, Reference};
use crate::block::Places;

/// What nodes and leaves begin with.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(16))]
struct Head {
    /// The least side of a cell below; negative in leaves.
    nominal_length: f32,
    range: [f32; 2],
}

/// A box whose corners are vectors of four.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(16))]
struct Box4 {
    lo: [f32; 4],
    hi: [f32; 4],
}

#[derive(Clone, Copy, Debug)]
#[repr(C, align(16))]
struct InnerNode {
    head: Head,
    bounds: [Box4; 2],
    /// Numbers instead of pointers: twice that of a node, or twice that of a leaf and one more.
    child: [u64; 2],
}

#[derive(Clone, Copy, Debug)]
#[repr(C, align(16))]
struct Leaf {
    head: Head,
    bounds: Box4,
    cell: u64,
}

const _: () = {
    assert!(size_of::<InnerNode>() == 96);
    assert!(size_of::<Leaf>() == 64);
};

/// Cells under linked nodes.
pub struct LinkedBvh {
    positions: Vec<[f32; 3]>,
    values: Vec<f32>,
    cells: CellLists,
    nodes: Vec<InnerNode>,
    leaves: Vec<Leaf>,
    scale: f32,
}

impl Box4 {
    fn new([lo, hi]: &Box3) -> Self {
        Self {
            lo: [lo[0], lo[1], lo[2], 0.0],
            hi: [hi[0], hi[1], hi[2], 0.0],
        }
    }

    #[inline(always)]
    fn corners(&self) -> Box3 {
        let (lo, hi) = (&self.lo, &self.hi);
        [[lo[0], lo[1], lo[2]], [hi[0], hi[1], hi[2]]]
    }
}

impl LinkedBvh {
    /// Builds the hierarchy.
    pub fn new(cells: &Cells) -> Self {
        let boxes: Vec<_> = cells.cells.iter().map(|c| cells.bounds(c)).collect();
        let tree = tree::build(&boxes);
        let (mut nodes, mut leaves) = (Vec::new(), Vec::new());
        // Where each node of the tree has got to, as a link, from the last to the first: children come
        // after their parents.
        let mut links = vec![(0u64, [0.0f32; 3]); tree.nodes.len()];
        for (number, node) in tree.nodes.iter().enumerate().rev() {
            links[number] = match node.below {
                Below::Items(first, _) => {
                    let cell = tree.items[first as usize];
                    let bounds = &boxes[cell as usize];
                    let sides = [0, 1, 2].map(|i| bounds[1][i] - bounds[0][i]);
                    let side = sides.into_iter().fold(f32::INFINITY, f32::min);
                    let range = cells.range(&cells.cells[cell as usize]);
                    leaves.push(Leaf {
                        head: head(-side, range),
                        bounds: Box4::new(bounds),
                        cell: u64::from(cell),
                    });
                    (
                        2 * (leaves.len() as u64 - 1) + 1,
                        [side, range[0], range[1]],
                    )
                }
                Below::Nodes(first) => {
                    let [a, b] = [0, 1].map(|k| links[first as usize + k]);
                    let side = a.1[0].min(b.1[0]);
                    let range = [a.1[1].min(b.1[1]), a.1[2].max(b.1[2])];
                    nodes.push(InnerNode {
                        head: head(side, range),
                        bounds: [0, 1].map(|k| Box4::new(&tree.nodes[first as usize + k].bounds)),
                        child: [a.0, b.0],
                    });
                    (2 * (nodes.len() as u64 - 1), [side, range[0], range[1]])
                }
            };
        }
        let mut lists = CellLists::new(cells);
        // The interface asks for types and offsets even where all cells are alike.
        lists.kinds = Kinds::mixed(cells);
        Self {
            positions: cells
                .vertices
                .iter()
                .map(|&[x, y, z, _]| [x, y, z])
                .collect(),
            values: cells.vertices.iter().map(|v| v[3]).collect(),
            cells: lists,
            nodes,
            leaves,
            scale: search::scale_of(&cells.vertices),
        }
    }

    /// The range of all finite values, if there are any: that of the last node, which is the first.
    pub fn range(&self) -> Option<[f32; 2]> {
        let head = self.nodes.last().map(|n| n.head);
        let range = head.or(self.leaves.first().map(|l| l.head))?.range;
        (range[0] <= range[1]).then_some(range)
    }

    /// The least side of a cell's box.
    pub fn nominal_length(&self) -> Option<f32> {
        let head = self.nodes.last().map(|n| n.head);
        head.or(self.leaves.first().map(|l| l.head))
            .map(|head| head.nominal_length.abs())
    }
}

fn head(nominal_length: f32, range: [f32; 2]) -> Head {
    Head {
        nominal_length,
        range,
    }
}

impl Source for LinkedBvh {
    /// Nodes go by their links.
    #[inline(always)]
    fn root(&self) -> Option<u32> {
        match (self.nodes.len(), self.leaves.len()) {
            (_, 0) => None,
            (0, _) => Some(1),
            (nodes, _) => Some(2 * (nodes as u32 - 1)),
        }
    }

    #[inline(always)]
    fn num_below(&self, node: u32) -> usize {
        if node % 2 == 1 { 1 } else { 2 }
    }

    #[inline(always)]
    fn below(&self, node: u32, k: usize) -> (Box3, Inside) {
        if node % 2 == 1 {
            let leaf = &self.leaves[node as usize / 2];
            return (leaf.bounds.corners(), Inside::Leaf(leaf.cell as u32));
        }
        let node = &self.nodes[node as usize / 2];
        (node.bounds[k].corners(), Inside::Node(node.child[k] as u32))
    }

    #[inline(always)]
    fn cell_of_leaf(&self, leaf: u32) -> u32 {
        leaf
    }

    #[inline(always)]
    fn prefetch(&self, node: u32) {
        if node % 2 == 1 {
            vacua_simd::prefetch(&self.leaves, node as usize / 2);
        } else {
            vacua_simd::prefetch(&self.nodes, node as usize / 2);
        }
    }

    #[inline(always)]
    fn cell(&self, cell: u32) -> Cell {
        self.cells.get(cell)
    }

    #[inline(always)]
    fn vertex(&self, vertex: u32) -> [f32; 4] {
        let [x, y, z] = self.positions[vertex as usize];
        [x, y, z, self.values[vertex as usize]]
    }

    #[inline(always)]
    fn scale(&self) -> f32 {
        self.scale
    }
}

impl Reference for LinkedBvh {
    fn name(&self) -> &'static str {
        "OSPRay 2.x (Open VKL)"
    }

    fn num_cells(&self) -> u64 {
        self.cells.num_cells()
    }

    fn parts(&self) -> Vec<(&'static str, usize)> {
        let positions = size_of_val(self.positions.as_slice());
        vec![
            ("vertices", positions + size_of_val(self.values.as_slice())),
            ("indices", size_of_val(self.cells.connectivity.as_slice())),
            ("types and offsets", self.cells.kinds.num_bytes()),
            ("nodes", size_of_val(self.nodes.as_slice())),
            ("leaves", size_of_val(self.leaves.as_slice())),
        ]
    }

    fn sample(&self, at: &Places, lanes: u16) -> Found {
        search::sample(self, at, lanes)
    }
}
