//! Cutting the tree of a sub-mesh into clusters, and writing them.
//!
//! Every subtree of the binary tree with few enough vertices could be a cluster; which ones are is a
//! sum of bits, minimised bottom up. Vertices are numbered in the order in which clusters, left to
//! right, first use them, so that a cluster's own vertices follow each other.

use vacua_volume::CellType;

use crate::EncodeError;
use crate::bvh::{Below, BinaryNode};
use crate::collapse::multi_nodes;
use crate::layout::{LeafCounts, MultiNode, OTHER_INDICES, SubmeshHeader};
use crate::submesh::{self, MARKER, Made};

use super::bits::{BitWriter, PADDING, width_of};
use super::frame::{PositionBlock, pack_positions};
use super::{
    CLUSTER_COUNTS, ClusterHeader, HEADER_WORDS, MAX_CLUSTER_VERTICES, Places, SubmeshClusters,
    num_blocks,
};

/// Leaves of a cluster, at most.
const MAX_LEAVES: usize = u8::MAX as usize;
/// What a cluster takes besides its bits: a header, a child of a node, its range.
const OVERHEAD_BITS: u64 = 8 * (16 + 12);

/// The clusters of a sub-mesh with all that belongs to them.
pub struct EncodedClusters {
    /// Headers in the order of the nodes.
    pub headers: Vec<ClusterHeader>,
    /// Their bits.
    pub bits: Vec<u8>,
    /// Frames of the positions.
    pub position_blocks: Vec<PositionBlock>,
    /// Positions within their frames.
    pub position_bits: Vec<u8>,
    /// The tree above the clusters.
    pub nodes: Vec<MultiNode>,
    /// Gathered vertices in their final order.
    pub vertices: Vec<u32>,
    /// Cells of the sub-mesh in their final order.
    pub cells: Vec<u32>,
}

impl EncodedClusters {
    /// The clusters as they are seen in a packed mesh. Needs [`super::bits::PADDING`] bytes after both
    /// kinds of bits.
    pub fn view(&self, header: &SubmeshHeader) -> SubmeshClusters<'_> {
        SubmeshClusters {
            id: 0,
            headers: &self.headers,
            bits: &self.bits,
            num_vertices: header.num_vertices,
            position_blocks: &self.position_blocks,
            position_bits: &self.position_bits,
        }
    }
}

impl EncodedClusters {
    /// Adds what [`Self::view`] needs after the bits.
    pub fn pad(&mut self) {
        self.bits.extend([0; PADDING]);
        self.position_bits.extend([0; PADDING]);
    }

    /// Takes away what [`Self::pad`] has added.
    pub fn unpad(&mut self) {
        self.bits.truncate(self.bits.len().saturating_sub(PADDING));
        let len = self.position_bits.len().saturating_sub(PADDING);
        self.position_bits.truncate(len);
    }

    /// Where the parts of the next sub-mesh start after these, whose own do at `places`.
    pub fn next_places(&self, header: &SubmeshHeader, places: Places) -> Places {
        Places {
            first_byte: places.first_byte + self.bits.len() as u64,
            first_block: places.first_block + self.position_blocks.len() as u64,
            first_position_byte: places.first_position_byte + self.position_bits.len() as u64,
            // Enough for 2^38 cells.
            first_cell_block: (places.first_cell_block)
                .saturating_add(num_blocks(header.total_cells()) as u32),
        }
    }
}

/// What eight indices are, by number.
fn kind_of(words: &[u32]) -> u8 {
    let kind = match words.iter().filter(|&&w| w != MARKER).count() {
        5 => CellType::Pyramid,
        6 => CellType::Wedge,
        _ => CellType::Hexahedron,
    };
    kind as u8
}

/// What a subtree would be as one cluster.
struct Part {
    /// Its vertices, ascending.
    vertices: Vec<u32>,
    leaves: usize,
    indices: u64,
}

impl Part {
    fn of_leaf(words: &[u32]) -> Self {
        let mut vertices: Vec<u32> = words.iter().copied().filter(|&w| w != MARKER).collect();
        let indices = vertices.len() as u64;
        vertices.sort_unstable();
        vertices.dedup();
        Self {
            vertices,
            leaves: 1,
            indices,
        }
    }

    /// Both together, if that can be one cluster.
    fn joined(&self, other: &Self, most_vertices: usize) -> Option<Self> {
        let leaves = self.leaves + other.leaves;
        let least = self.vertices.len().max(other.vertices.len());
        if leaves > MAX_LEAVES || least > most_vertices {
            return None;
        }
        let mut vertices = Vec::with_capacity(self.vertices.len() + other.vertices.len());
        let (mut a, mut b) = (self.vertices.as_slice(), other.vertices.as_slice());
        while let (Some(&x), Some(&y)) = (a.first(), b.first()) {
            vertices.push(x.min(y));
            a = &a[usize::from(x <= y)..];
            b = &b[usize::from(y <= x)..];
        }
        vertices.extend_from_slice(a);
        vertices.extend_from_slice(b);
        (vertices.len() <= most_vertices).then(|| Self {
            vertices,
            leaves,
            indices: self.indices + other.indices,
        })
    }

    /// Bits that it takes. Each vertex counts as borrowed: whatever the cut, the same number of them
    /// is not.
    fn cost(&self, borrowed_bits: u64) -> u64 {
        let n = self.vertices.len() as u64;
        OVERHEAD_BITS
            + 8 * self.leaves as u64
            + n * borrowed_bits
            + self.indices * u64::from(width_of(n.saturating_sub(1)))
    }
}

/// Which subtrees become clusters: the least bits in all.
fn choose(made: &Made) -> Vec<bool> {
    let nodes = made.nodes;
    let borrowed_bits = u64::from(width_of(made.num_vertices() as u64));
    let mut parts: Vec<Option<Part>> = Vec::with_capacity(nodes.len());
    let mut costs: Vec<u64> = Vec::with_capacity(nodes.len());
    let mut is_cluster = Vec::with_capacity(nodes.len());
    for node in nodes {
        let (part, below) = match node.below {
            Below::Leaf(leaf) => {
                let (words, _, _) = made.leaf(leaf as usize);
                (Some(Part::of_leaf(words)), u64::MAX)
            }
            Below::Nodes(a, b) => {
                let (a, b) = (a as usize, b as usize);
                let below = costs[a] + costs[b];
                let joined = match (parts[a].take(), parts[b].take()) {
                    (Some(a), Some(b)) => a.joined(&b, MAX_CLUSTER_VERTICES),
                    _ => None,
                };
                (joined, below)
            }
        };
        let cost = part.as_ref().map_or(u64::MAX, |p| p.cost(borrowed_bits));
        is_cluster.push(cost <= below);
        costs.push(cost.min(below));
        parts.push(part);
    }
    is_cluster
}

/// Encodes the cells of a sub-mesh, of which leaves and tree are made. `final_number` is `u32::MAX`
/// for each gathered vertex.
///
/// # Errors
/// [`EncodeError::TooManyIndices`] if 32-bit offsets do not reach.
pub fn encode(made: &Made, final_number: &mut [u32]) -> Result<EncodedClusters, EncodeError> {
    let nodes = made.nodes;
    let mut writer = Writer {
        made,
        is_cluster: choose(made),
        upper: Vec::new(),
        headers: Vec::new(),
        final_number,
        out: EncodedClusters {
            headers: Vec::new(),
            bits: Vec::new(),
            position_blocks: Vec::new(),
            position_bits: Vec::new(),
            nodes: Vec::new(),
            vertices: Vec::with_capacity(made.num_vertices()),
            cells: Vec::new(),
        },
    };
    writer.subtree(nodes.len() - 1);
    let too_many = |indices: usize| EncodeError::TooManyIndices {
        cells: writer.out.cells.len() as u64,
        indices: indices as u64,
    };
    if u32::try_from(writer.out.bits.len()).is_err() {
        return Err(too_many(writer.out.bits.len()));
    }
    let Writer {
        upper,
        headers,
        mut out,
        ..
    } = writer;
    for wide in multi_nodes(&upper) {
        let first_index = out.headers.len() as u32 * HEADER_WORDS;
        let mut leaf = submesh::node_of(&wide, &upper, &made.grid, first_index);
        for (k, &child) in wide.children.as_slice().iter().enumerate() {
            if let Below::Leaf(cluster) = upper[child as usize].below {
                leaf.counts[k] = CLUSTER_COUNTS;
                out.headers.push(headers[cluster as usize]);
            }
        }
        out.nodes.push(MultiNode {
            leaf,
            first_child: wide.first_child,
        });
    }
    let positions: Vec<[f32; 3]> = out.vertices.iter().map(|&v| made.position(v)).collect();
    (out.position_blocks, out.position_bits) = pack_positions(&positions);
    Ok(out)
}

struct Writer<'a> {
    made: &'a Made<'a>,
    is_cluster: Vec<bool>,
    /// The tree down to the clusters; they are its leaves.
    upper: Vec<BinaryNode>,
    /// Headers of the clusters, left to right.
    headers: Vec<ClusterHeader>,
    /// By gathered vertex.
    final_number: &'a mut [u32],
    out: EncodedClusters,
}

impl Writer<'_> {
    /// Writes the clusters of a subtree, left to right; gives its place in the upper tree. The depth
    /// is that of the tree, which is bounded.
    fn subtree(&mut self, node: usize) -> u32 {
        let below = match self.made.nodes[node].below {
            Below::Nodes(a, b) if !self.is_cluster[node] => {
                let a = self.subtree(a as usize);
                Below::Nodes(a, self.subtree(b as usize))
            }
            _ => {
                self.cluster(node);
                Below::Leaf((self.headers.len() - 1) as u32)
            }
        };
        self.upper.push(BinaryNode {
            bounds: self.made.nodes[node].bounds,
            below,
        });
        (self.upper.len() - 1) as u32
    }

    /// The leaves of a subtree, left to right.
    fn leaves(&self, node: usize) -> Vec<usize> {
        let mut leaves = Vec::new();
        let mut stack = vec![node];
        while let Some(node) = stack.pop() {
            match self.made.nodes[node].below {
                Below::Leaf(leaf) => leaves.push(leaf as usize),
                Below::Nodes(a, b) => stack.extend([b as usize, a as usize]),
            }
        }
        leaves
    }

    fn cluster(&mut self, node: usize) {
        let leaves = self.leaves(node);
        let first_vertex = self.out.vertices.len() as u32;
        let mut borrowed = Vec::new();
        let mut kinds = Vec::new();
        let mut counts = Vec::with_capacity(leaves.len());
        let first_cell = self.out.cells.len() as u32;
        for &leaf in &leaves {
            let (words, cells, leaf_counts) = self.made.leaf(leaf);
            self.out.cells.extend_from_slice(cells);
            counts.push(leaf_counts);
            for &word in words.iter().filter(|&&w| w != MARKER) {
                let number = &mut self.final_number[word as usize];
                if *number == u32::MAX {
                    *number = self.out.vertices.len() as u32;
                    self.out.vertices.push(word);
                } else if *number < first_vertex {
                    borrowed.push(*number);
                }
            }
            let others = &cells[cells.len() - usize::from(leaf_counts.others)..];
            kinds.extend(
                words[words.len() - OTHER_INDICES * others.len()..]
                    .chunks(OTHER_INDICES)
                    .map(kind_of),
            );
        }
        borrowed.sort_unstable();
        borrowed.dedup();
        let kind = kinds.first().copied().unwrap_or(3);
        let kind = if kinds.iter().all(|&k| k == kind) {
            kind
        } else {
            0
        };
        let header = ClusterHeader {
            offset: self.out.bits.len() as u32,
            first_vertex,
            first_cell,
            num_own: (self.out.vertices.len() as u32 - first_vertex) as u8,
            num_borrowed: borrowed.len() as u8,
            num_leaves: leaves.len() as u8,
            kind,
        };
        self.write(&header, &leaves, &counts, &kinds, &borrowed);
        self.headers.push(header);
    }

    fn write(
        &mut self,
        header: &ClusterHeader,
        leaves: &[usize],
        counts: &[LeafCounts],
        kinds: &[u8],
        borrowed: &[u32],
    ) {
        let mut writer = BitWriter::new(&mut self.out.bits);
        for counts in counts {
            writer.push(u64::from(counts.pack().unwrap_or(0)), 8);
        }
        if header.kind == 0 {
            kinds
                .iter()
                .for_each(|&kind| writer.push(u64::from(kind), 2));
        }
        for &vertex in borrowed {
            writer.push(u64::from(vertex), header.borrowed_bits());
        }
        let width = header.index_bits();
        for &leaf in leaves {
            let (words, _, _) = self.made.leaf(leaf);
            for &word in words.iter().filter(|&&w| w != MARKER) {
                let number = self.final_number[word as usize];
                let local = match number.checked_sub(header.first_vertex) {
                    Some(own) => u64::from(own),
                    None => {
                        let place = borrowed.partition_point(|&b| b < number);
                        u64::from(header.num_own) + place as u64
                    }
                };
                writer.push(local, width);
            }
        }
        writer.finish();
    }
}
