//! OSPRay 1.8.5's layout as paper B counts it.
//!
//! ```text
//! a vertex    16 bytes   x, y, z, value, f32
//! a cell      32 bytes   8 × i32; a hexahedron: its points; else a negative number that says the type,
//!                        and its 4, 5 or 6 points at the end
//! a node      40 bytes   lo 3 × f32, hi 3 × f32, least and largest value 2 × f32, and a u64: 3 bits
//!                        how many cells (0: an inner node), 61 bits where its two nodes or its items
//!                        start
//! an item      8 bytes   u64: a cell
//! ```
//!
//! Source: paper B, §3; Rathke, Wald, Chiu and Brownlee 2015. The hierarchy goes down to single
//! cells, as OSPRay's builder almost always does (§5.2).

use vacua_volume::CellType;

use super::search::{self, Inside, Source};
use super::tree::{self, Below, Box3};
use super::{Cell, Cells, Found, Reference};
use crate::block::Places;

/// A node.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
struct Node {
    lo: [f32; 3],
    hi: [f32; 3],
    range: [f32; 2],
    child: u64,
}

const _: () = assert!(size_of::<Node>() == 40);

/// Bits of a node's count.
const COUNT_BITS: u32 = 3;

impl Node {
    #[inline(always)]
    fn is_leaf(&self) -> bool {
        self.child & ((1 << COUNT_BITS) - 1) != 0
    }

    /// Its first node or item.
    #[inline(always)]
    fn first(&self) -> u32 {
        (self.child >> COUNT_BITS) as u32
    }
}

/// Numbers that say the type of a cell.
const TETRAHEDRON: i32 = -4;
const PYRAMID: i32 = -5;
const WEDGE: i32 = -6;

/// Cells in records of one size under a binary min-max hierarchy.
pub struct MinMaxBvh {
    vertices: Vec<[f32; 4]>,
    records: Vec<[i32; 8]>,
    nodes: Vec<Node>,
    items: Vec<u64>,
    scale: f32,
}

fn record(cell: &Cell) -> [i32; 8] {
    let marker = match cell.cell_type {
        CellType::Tetrahedron => TETRAHEDRON,
        CellType::Pyramid => PYRAMID,
        CellType::Wedge => WEDGE,
        CellType::Hexahedron => return cell.corners.map(|c| c as i32),
    };
    let corners = cell.corners();
    let mut record = [marker; 8];
    for (entry, &corner) in record[8 - corners.len()..].iter_mut().zip(corners) {
        *entry = corner as i32;
    }
    record
}

#[inline(always)]
fn cell_of(record: &[i32; 8]) -> Cell {
    let mut corners = record.map(|c| c as u32);
    let cell_type = match record[0] {
        TETRAHEDRON => {
            corners.rotate_left(4);
            CellType::Tetrahedron
        }
        PYRAMID => {
            corners.rotate_left(3);
            CellType::Pyramid
        }
        WEDGE => {
            corners.rotate_left(2);
            CellType::Wedge
        }
        _ => CellType::Hexahedron,
    };
    let first = corners[0];
    corners[cell_type.num_points()..].fill(first);
    Cell { cell_type, corners }
}

impl MinMaxBvh {
    /// Builds the hierarchy.
    pub fn new(cells: &Cells) -> Self {
        let boxes: Vec<_> = cells.cells.iter().map(|c| cells.bounds(c)).collect();
        let tree = tree::build(&boxes);
        drop(boxes);
        let node = |node: &tree::Node| {
            let child = match node.below {
                Below::Nodes(first) => u64::from(first) << COUNT_BITS,
                Below::Items(first, count) => u64::from(first) << COUNT_BITS | u64::from(count),
            };
            Node {
                lo: node.bounds[0],
                hi: node.bounds[1],
                range: [f32::INFINITY, f32::NEG_INFINITY],
                child,
            }
        };
        let mut nodes: Vec<Node> = tree.nodes.iter().map(node).collect();
        // Children come after their parents.
        for (number, node) in tree.nodes.iter().enumerate().rev() {
            let ranges = match node.below {
                Below::Nodes(first) => [0, 1].map(|k| nodes[first as usize + k].range),
                Below::Items(first, _) => {
                    let cell = tree.items[first as usize];
                    [cells.range(&cells.cells[cell as usize]); 2]
                }
            };
            let [a, b] = ranges;
            nodes[number].range = [a[0].min(b[0]), a[1].max(b[1])];
        }
        Self {
            vertices: cells.vertices.clone(),
            records: cells.cells.iter().map(record).collect(),
            nodes,
            items: tree.items.iter().map(|&item| u64::from(item)).collect(),
            scale: search::scale_of(&cells.vertices),
        }
    }

    /// The range of all finite values, if there are any: that of the first node.
    pub fn range(&self) -> Option<[f32; 2]> {
        let range = self.nodes.first()?.range;
        (range[0] <= range[1]).then_some(range)
    }
}

impl Source for MinMaxBvh {
    #[inline(always)]
    fn root(&self) -> Option<u32> {
        (!self.nodes.is_empty()).then_some(0)
    }

    /// One if the only node is a leaf.
    #[inline(always)]
    fn num_below(&self, node: u32) -> usize {
        if self.nodes[node as usize].is_leaf() {
            1
        } else {
            2
        }
    }

    #[inline(always)]
    fn below(&self, number: u32, k: usize) -> (Box3, Inside) {
        let node = &self.nodes[number as usize];
        let child = if node.is_leaf() {
            number
        } else {
            node.first() + k as u32
        };
        let node = &self.nodes[child as usize];
        let inside = if node.is_leaf() {
            Inside::Leaf(node.first())
        } else {
            Inside::Node(child)
        };
        ([node.lo, node.hi], inside)
    }

    #[inline(always)]
    fn cell_of_leaf(&self, leaf: u32) -> u32 {
        self.items[leaf as usize] as u32
    }

    #[inline(always)]
    fn prefetch(&self, node: u32) {
        let first = self.nodes[node as usize].first();
        vacua_simd::prefetch(&self.nodes, first as usize);
        vacua_simd::prefetch(&self.nodes, first as usize + 1);
    }

    #[inline(always)]
    fn cell(&self, cell: u32) -> Cell {
        cell_of(&self.records[cell as usize])
    }

    #[inline(always)]
    fn vertex(&self, vertex: u32) -> [f32; 4] {
        self.vertices[vertex as usize]
    }

    #[inline(always)]
    fn scale(&self) -> f32 {
        self.scale
    }
}

impl Reference for MinMaxBvh {
    fn name(&self) -> &'static str {
        "OSPRay 1.8.5"
    }

    fn num_cells(&self) -> u64 {
        self.records.len() as u64
    }

    fn parts(&self) -> Vec<(&'static str, usize)> {
        vec![
            ("vertices", size_of_val(self.vertices.as_slice())),
            ("indices", size_of_val(self.records.as_slice())),
            ("nodes", size_of_val(self.nodes.as_slice())),
            ("item list", size_of_val(self.items.as_slice())),
        ]
    }

    fn sample(&self, at: &Places, lanes: u16) -> Found {
        search::sample(self, at, lanes)
    }
}
