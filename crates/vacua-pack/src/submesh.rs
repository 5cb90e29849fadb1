//! Encoding one sub-mesh: leaves of tetrahedra, pairs and others, the tree over them, its nodes.
//!
//! Source: paper B, §4.1 and §5.1 to §5.7.

mod gathered;
mod leaves;

use crate::bvh::{self, Below, BinaryNode, Box4};
use crate::collapse::{WideNode, multi_leaves, multi_nodes};
use crate::grid::Grid;
use crate::ids::Ids;
use crate::indices::IndexList;
use crate::input::Input;
use crate::layout::{Child, LeafCounts, MultiLeaf, MultiNode, SubmeshHeader, WIDTH};
use crate::packed::Submesh;
use crate::small::{self, EncodedClusters};
use crate::{EncodeError, Variant, indices};

use gathered::Gathered;
use leaves::{CellLeaves, Leaf, Leaves};

/// Stands for the marker until the number of bits is applied.
pub(crate) const MARKER: u32 = u32::MAX;

/// A sub-mesh whose places in the common arrays are still to be given.
pub struct EncodedSubmesh {
    /// Everything but the `first_…`.
    pub header: SubmeshHeader,
    /// Positions of its vertices, relative to the origin.
    pub positions: Vec<[f32; 3]>,
    /// Which points of the input its vertices are.
    pub points: Ids,
    /// Which cells of the input its cells are, in packed order.
    pub cells: Ids,
    /// Its indices, packed.
    pub indices: Vec<u8>,
    /// Bits of an index.
    pub index_bits: u32,
    /// Its nodes in variant 1.
    pub multi_leaves: Vec<MultiLeaf>,
    /// Its nodes in variant 2.
    pub multi_nodes: Vec<MultiNode>,
    /// Its clusters and positions in variant `small`.
    pub clusters: Option<EncodedClusters>,
    /// How many primitives there are.
    pub num_primitives: LeafTotals,
}

impl EncodedSubmesh {
    /// The sub-mesh as it is seen in a packed mesh, if it were the only one. Needs
    /// [`indices::PADDING`] bytes after its indices.
    pub fn view(&self) -> Submesh<'_> {
        let bits = self.index_bits;
        Submesh::new(
            &self.header,
            &self.positions,
            IndexList::new(&self.indices, bits),
            &self.multi_leaves,
            &self.multi_nodes,
            self.clusters.as_ref().map(|c| c.view(&self.header)),
        )
    }
}

/// Primitives, leaves and nodes of a sub-mesh, or of several.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LeafTotals {
    /// Tetrahedra on their own.
    pub tets: u64,
    /// Pairs of tetrahedra.
    pub pairs: u64,
    /// Pyramids, wedges and hexahedra.
    pub others: u64,
    /// Leaves.
    pub leaves: u64,
    /// Children of all nodes.
    pub children: u64,
}

impl LeafTotals {
    /// The sum.
    pub fn plus(self, other: Self) -> Self {
        Self {
            tets: self.tets + other.tets,
            pairs: self.pairs + other.pairs,
            others: self.others + other.others,
            leaves: self.leaves + other.leaves,
            children: self.children + other.children,
        }
    }
}

/// Memory that sub-meshes use one after the other.
#[derive(Default)]
pub struct Scratch {
    gathered: Gathered,
    tree: bvh::Scratch,
    leaves: Leaves,
    final_number: Vec<u32>,
    words: Vec<u32>,
}

/// What has been made of a sub-mesh's cells before any of it is laid out.
pub struct Made<'a> {
    gathered: &'a Gathered,
    leaves: &'a Leaves,
    /// The tree, children before their parents.
    pub nodes: &'a [BinaryNode],
    /// The grid of its boxes.
    pub grid: Grid,
}

impl Made<'_> {
    /// A leaf's indices of gathered vertices, its cells, and its counts.
    pub fn leaf(&self, leaf: usize) -> (&[u32], &[u32], LeafCounts) {
        let Leaf {
            counts,
            first_word,
            first_cell,
        } = self.leaves.leaves[leaf];
        let words = &self.leaves.words[first_word as usize..][..counts.num_indices()];
        let cells = &self.leaves.cells[first_cell as usize..][..counts.num_cells()];
        (words, cells, counts)
    }

    /// Number of gathered vertices.
    pub fn num_vertices(&self) -> usize {
        self.gathered.positions.len()
    }

    /// Where a gathered vertex is.
    pub fn position(&self, vertex: u32) -> [f32; 3] {
        let [x, y, z, _] = self.gathered.positions[vertex as usize];
        [x, y, z]
    }

    fn totals(&self) -> LeafTotals {
        let of_leaf = |leaf: &Leaf| LeafTotals {
            tets: u64::from(leaf.counts.tets),
            pairs: u64::from(leaf.counts.pairs),
            others: u64::from(leaf.counts.others),
            leaves: 1,
            children: 0,
        };
        let leaves = self.leaves.leaves.iter();
        leaves.fold(LeafTotals::default(), |sum, leaf| sum.plus(of_leaf(leaf)))
    }
}

/// A node's box and those of its children; nothing is a leaf yet.
pub fn node_of(wide: &WideNode, nodes: &[BinaryNode], grid: &Grid, first_index: u32) -> MultiLeaf {
    let bounds = nodes[wide.node as usize].bounds;
    let (lo, hi) = grid.quantise(bounds.lo3(), bounds.hi3());
    let mut node = MultiLeaf {
        lo,
        hi,
        first_index,
        ..MultiLeaf::EMPTY
    };
    for (k, &child) in wide.children.as_slice().iter().enumerate().take(WIDTH) {
        let child = &nodes[child as usize];
        node.set_child_box(k, grid, child.bounds.lo3(), child.bounds.hi3());
    }
    node
}

/// Encodes the cells of one sub-mesh: at least one, all finite, few enough for the bits.
///
/// # Errors
/// [`EncodeError::TooManyIndices`] if 32-bit offsets do not reach.
pub fn encode(
    input: &Input,
    cells: &[u64],
    variant: Variant,
    index_bits: u32,
    scratch: &mut Scratch,
) -> Result<EncodedSubmesh, EncodeError> {
    let Scratch {
        gathered,
        tree,
        leaves,
        final_number,
        words,
    } = scratch;
    gathered.gather(input, cells, index_bits);
    leaves.clear();
    let mut maker = CellLeaves {
        gathered,
        mean_cost: gathered.mean_cost(),
        out: leaves,
    };
    let bounds = gathered.bounds.unwrap_or(Box4::EMPTY);
    let nodes = bvh::build(cells.len() as u32, &bounds, &mut maker, tree);
    if u32::try_from(leaves.words.len()).is_err() {
        return Err(EncodeError::TooManyIndices {
            cells: cells.len() as u64,
            indices: leaves.words.len() as u64,
        });
    }
    let wide = match variant {
        Variant::MultiLeaves => multi_leaves(nodes),
        Variant::MultiNodes => multi_nodes(nodes),
        Variant::Small => Vec::new(),
    };
    words.clear();
    final_number.clear();
    final_number.resize(gathered.positions.len(), u32::MAX);
    let bounds = nodes[nodes.len() - 1].bounds;
    let grid = Grid::new(bounds.lo3(), bounds.hi3());
    let num_points = input.mesh().num_points() as u64;
    let num_input_cells = input.mesh().num_cells() as u64;
    let mut emitter = Emitter {
        cells,
        gathered,
        leaves,
        nodes,
        grid,
        marker: u32::MAX >> (32 - index_bits),
        final_number,
        words,
        out: EncodedSubmesh {
            header: SubmeshHeader {
                origin: input.origin,
                grid_base: grid.base,
                grid_exponent: grid.exponent,
                num_vertices: gathered.positions.len() as u32,
                num_cells: gathered.num_cells,
                lo: bounds.lo3(),
                hi: bounds.hi3(),
                num_nodes: wide.len() as u32,
                ..bytemuck::Zeroable::zeroed()
            },
            positions: Vec::with_capacity(gathered.positions.len()),
            points: Ids::below(num_points, gathered.positions.len()),
            cells: Ids::below(num_input_cells, cells.len()),
            indices: Vec::new(),
            index_bits,
            multi_leaves: Vec::new(),
            multi_nodes: Vec::new(),
            clusters: None,
            num_primitives: LeafTotals::default(),
        },
    };
    match variant {
        Variant::MultiLeaves => emitter.out.multi_leaves.reserve_exact(wide.len()),
        Variant::MultiNodes => emitter.out.multi_nodes.reserve_exact(wide.len()),
        Variant::Small => return emitter.clusters(),
    }
    for node in &wide {
        let leaf = emitter.node(node);
        match variant {
            Variant::MultiLeaves => emitter.out.multi_leaves.push(leaf),
            _ => emitter.out.multi_nodes.push(MultiNode {
                leaf,
                first_child: node.first_child,
            }),
        }
    }
    Ok(emitter.finish(index_bits))
}

/// Writes nodes and their primitives in final order and gives vertices their final numbers.
struct Emitter<'a> {
    cells: &'a [u64],
    gathered: &'a Gathered,
    leaves: &'a Leaves,
    nodes: &'a [BinaryNode],
    grid: Grid,
    marker: u32,
    final_number: &'a mut [u32],
    words: &'a mut Vec<u32>,
    out: EncodedSubmesh,
}

impl Emitter<'_> {
    /// Everything in variant `small`.
    fn clusters(mut self) -> Result<EncodedSubmesh, EncodeError> {
        let made = Made {
            gathered: self.gathered,
            leaves: self.leaves,
            nodes: self.nodes,
            grid: self.grid,
        };
        let mut clusters = small::encode(&made, self.final_number)?;
        let out = &mut self.out;
        let points = self.gathered.numbering.points();
        let vertices = clusters.vertices.iter();
        vertices.for_each(|&v| out.points.push(points[v as usize]));
        let cells = clusters.cells.iter();
        cells.for_each(|&c| out.cells.push(self.cells[c as usize]));
        out.multi_nodes = std::mem::take(&mut clusters.nodes);
        out.header.num_nodes = out.multi_nodes.len() as u32;
        out.header.num_indices = clusters.headers.len() as u64;
        out.num_primitives = made.totals();
        let children = |n: &MultiNode| {
            let there = (0..WIDTH).filter(|&k| n.leaf.child(k) != Child::Absent);
            there.count() as u64
        };
        out.num_primitives.children = out.multi_nodes.iter().map(children).sum();
        out.clusters = Some(clusters);
        Ok(self.out)
    }

    fn node(&mut self, wide: &WideNode) -> MultiLeaf {
        let mut node = node_of(wide, self.nodes, &self.grid, self.words.len() as u32);
        for &child in wide.children.as_slice() {
            self.prefetch(child);
        }
        for (k, &child) in wide.children.as_slice().iter().enumerate().take(WIDTH) {
            let child = &self.nodes[child as usize];
            self.out.num_primitives.children += 1;
            if let Below::Leaf(leaf) = child.below {
                node.counts[k] = self.leaf(leaf as usize);
            }
        }
        node
    }

    /// Asks for what the leaf at a node will need.
    fn prefetch(&self, node: u32) {
        let Below::Leaf(leaf) = self.nodes[node as usize].below else {
            return;
        };
        let leaf = &self.leaves.leaves[leaf as usize];
        let first = leaf.first_cell as usize;
        for &cell in &self.leaves.cells[first..first + leaf.counts.num_cells()] {
            vacua_simd::prefetch(self.cells, cell as usize);
        }
    }

    fn leaf(&mut self, leaf: usize) -> u8 {
        let (leaves, out) = (self.leaves, &mut self.out);
        let leaf = &leaves.leaves[leaf];
        let first = leaf.first_word as usize;
        for &word in &leaves.words[first..first + leaf.counts.num_indices()] {
            if word == MARKER {
                self.words.push(self.marker);
                continue;
            }
            let number = &mut self.final_number[word as usize];
            if *number == u32::MAX {
                *number = out.positions.len() as u32;
                let [x, y, z, _] = self.gathered.positions[word as usize];
                out.positions.push([x, y, z]);
                out.points
                    .push(self.gathered.numbering.points()[word as usize]);
            }
            self.words.push(*number);
        }
        let first = leaf.first_cell as usize;
        for &cell in &leaves.cells[first..first + leaf.counts.num_cells()] {
            out.cells.push(self.cells[cell as usize]);
        }
        out.num_primitives = out.num_primitives.plus(LeafTotals {
            tets: u64::from(leaf.counts.tets),
            pairs: u64::from(leaf.counts.pairs),
            others: u64::from(leaf.counts.others),
            leaves: 1,
            children: 0,
        });
        leaf.counts.pack().unwrap_or(0)
    }

    fn finish(mut self, index_bits: u32) -> EncodedSubmesh {
        self.out.header.num_indices = self.words.len() as u64;
        indices::pack(self.words, index_bits, &mut self.out.indices);
        self.out
    }
}
