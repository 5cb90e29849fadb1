//! The variant `small`: clusters of cells with short indices, exact positions and values in frames.
//!
//! Source: paper B, §4 and §5, taken further than the paper does. Sub-meshes, leaves, pairs and the
//! order of everything are those of variant 1; what changes is how they are stored, so that places,
//! cells and corners decode to the very same numbers, and pictures have the same bits.
//!
//! Deviation: no leaf has a box in the file. The tree ends at *clusters* of up to 255 vertices, some
//! hundred cells, which are decoded whole into a cache; the boxes of their leaves are found then.
//!
//! # Counting the bits, before anything was written
//!
//! tet100 has 0.172 vertices a tetrahedron, 0.185 with those that sub-meshes repeat. A cluster of 64
//! vertices is about 4³ of them: 27 cubes, 162 tetrahedra. Bits a tetrahedron:
//!
//! | part | bits | bytes |
//! |---|---|---|
//! | position in frames: 0.185 × (3 × 20.5 + 3 for frames) | 12 | 1.5 |
//! | value in frames: 0.185 × (22 + 2) | 4.4 | 0.55 |
//! | indices: 2.7 (most tetrahedra are in pairs of five) × 6 | 16.2 | 2.0 |
//! | borrowed vertices: (64 − 28) × 15 / 162 | 3.3 | 0.4 |
//! | counts of leaves: a byte for 7 | 1.2 | 0.15 |
//! | header 16 bytes, a sixth of a node, ranges | 1.4 | 0.2 |
//! | sum | 38.5 | 4.8 |
//!
//! A hexahedron (hex150: 1.1 vertices with repeated ones; clusters of 128 vertices are 66 cells):
//! 1.1 × 11 bytes of vertices, 8 × 7 bits of indices, 62 borrowed vertices of 15 bits for 66 cells, a
//! byte for two or three in a leaf: 12.1 + 7 + 1.8 + 0.4 + 0.5 = 21.8 bytes. What was measured
//! stands in the documentation of performance.
//!
//! # A cluster
//!
//! A leaf of the tree has the counts of one tetrahedron (a byte `1`), and its first index is that of
//! the four 32-bit words of a cluster's header:
//!
//! ```text
//! byte  0  offset          u32   of its bits, in bytes from the sub-mesh's first
//!       4  first_vertex    u32   first of its own vertices in the sub-mesh
//!       8  first_cell      u32   its first cell in the sub-mesh
//!      12  num_own          u8   vertices that no cluster before it has
//!      13  num_borrowed     u8   vertices of clusters before it
//!      14  num_leaves       u8
//!      15  kind             u8   0: others of several kinds; 1 pyramids, 2 wedges, 3 hexahedra
//! ```
//!
//! and its bits are, lowest first:
//!
//! ```text
//! counts     num_leaves × 8     tetrahedra, pairs, others of each leaf
//! kinds      2 for each other, if `kind` is 0: 1 pyramid, 2 wedge, 3 hexahedron
//! borrowed   num_borrowed × b   ascending; b bits reach the vertex before its first own one
//! indices    i bits each        4 a tetrahedron, 5 a pair, 5, 6 or 8 another, leaf after leaf:
//!                               own vertices first, then borrowed ones; i is as large as they need
//! ```
//!
//! Cells are numbered through the sub-mesh in the order of variant 1. That number, twice, is a
//! [`crate::PackedCell::index`].

pub(crate) mod bits;
mod cache;
mod decode;
mod encode;
pub(crate) mod frame;

use std::sync::atomic::{AtomicU64, Ordering};

use bytemuck::{Pod, Zeroable};
use vacua_volume::CellType;

use crate::layout::{LeafCounts, SubmeshHeader};
use crate::packed::Submesh;
use crate::section::Flat;

pub(crate) use cache::Cache;
pub use decode::{Cluster, ClusterCell, ClusterLeaf};
pub(crate) use encode::{EncodedClusters, encode};
pub use frame::{FramedValues, PositionBlock, ValueBlock};

use frame::BLOCK;

/// Vertices of a cluster, at most.
pub const MAX_CLUSTER_VERTICES: usize = 255;
/// 32-bit words of a header, which is what the tree counts in.
pub const HEADER_WORDS: u32 = 4;
/// What the tree says of a leaf: one primitive of four words.
pub const CLUSTER_COUNTS: u8 = 1;
/// Most bits of an index: offsets within a sub-mesh have 32.
pub const MAX_INDEX_BITS: u32 = 24;

/// A cluster's header; see the [module](self).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct ClusterHeader {
    /// Where its bits start, in bytes from the sub-mesh's first.
    pub offset: u32,
    /// First of its own vertices in the sub-mesh.
    pub first_vertex: u32,
    /// Its first cell in the sub-mesh.
    pub first_cell: u32,
    /// Vertices that no cluster before it has.
    pub num_own: u8,
    /// Vertices of clusters before it.
    pub num_borrowed: u8,
    /// Leaves.
    pub num_leaves: u8,
    /// Which kind all of its others are; 0 if they are several.
    pub kind: u8,
}

const _: () = {
    assert!(size_of::<ClusterHeader>() == 4 * HEADER_WORDS as usize);
    assert!(std::mem::offset_of!(ClusterHeader, first_vertex) == 4);
    assert!(std::mem::offset_of!(ClusterHeader, first_cell) == 8);
    assert!(std::mem::offset_of!(ClusterHeader, num_own) == 12);
    assert!(std::mem::offset_of!(ClusterHeader, kind) == 15);
};

impl ClusterHeader {
    /// Its vertices, own and borrowed.
    fn num_vertices(&self) -> usize {
        usize::from(self.num_own) + usize::from(self.num_borrowed)
    }

    /// Bits of a borrowed vertex.
    fn borrowed_bits(&self) -> u32 {
        bits::width_of(u64::from(self.first_vertex.saturating_sub(1)))
    }

    /// Bits of an index.
    fn index_bits(&self) -> u32 {
        bits::width_of(self.num_vertices().saturating_sub(1) as u64)
    }
}

/// Where the parts of a sub-mesh start; kept in the header's reserved words.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Places {
    /// First byte of its clusters' bits.
    pub first_byte: u64,
    /// First block of its positions, and of values at its vertices.
    pub first_block: u64,
    /// First byte of its positions' bits.
    pub first_position_byte: u64,
    /// First block of values on its cells.
    pub first_cell_block: u32,
}

impl Places {
    /// What a header says.
    #[inline(always)]
    pub fn of(header: &SubmeshHeader) -> Self {
        let at = |i: usize| u64::from(header.reserved[i]) | u64::from(header.reserved[i + 1]) << 32;
        Self {
            first_byte: at(0),
            first_block: at(2),
            first_position_byte: at(4),
            first_cell_block: header.reserved[6],
        }
    }

    /// Puts them into a header.
    pub fn put(self, header: &mut SubmeshHeader) {
        header.reserved[6] = self.first_cell_block;
        let all = [self.first_byte, self.first_block, self.first_position_byte];
        for (i, place) in all.into_iter().enumerate() {
            header.reserved[2 * i] = place as u32;
            header.reserved[2 * i + 1] = (place >> 32) as u32;
        }
    }
}

/// Blocks of so many positions or values.
pub(crate) fn num_blocks(count: u64) -> u64 {
    count.div_ceil(BLOCK as u64)
}

/// The block of a vertex's values.
#[inline(always)]
pub(crate) fn block_of_vertex(header: &SubmeshHeader, vertex: u32) -> u64 {
    Places::of(header)
        .first_block
        .saturating_add(u64::from(vertex) / BLOCK as u64)
}

/// The block of the value of a cell of the sub-mesh.
#[inline(always)]
pub(crate) fn block_of_cell(header: &SubmeshHeader, cell: u32) -> u64 {
    u64::from(Places::of(header).first_cell_block) + u64::from(cell) / BLOCK as u64
}

/// A number that nothing else in this process has; 0 is nobody's.
fn next_id() -> u64 {
    static NEXT: AtomicU64 = AtomicU64::new(1);
    NEXT.fetch_add(1, Ordering::Relaxed)
}

/// The arrays of all sub-meshes. Clones share them.
#[derive(Clone)]
pub struct Clusters {
    /// Tells decoded clusters of one mesh from those of another.
    pub(crate) id: u64,
    pub(crate) headers: Flat<ClusterHeader>,
    pub(crate) bits: Flat<u8>,
    pub(crate) position_blocks: Flat<PositionBlock>,
    pub(crate) position_bits: Flat<u8>,
}

impl Clusters {
    /// Joins the arrays.
    pub(crate) fn new(
        headers: Flat<ClusterHeader>,
        bits: Flat<u8>,
        position_blocks: Flat<PositionBlock>,
        position_bits: Flat<u8>,
    ) -> Self {
        Self {
            id: next_id(),
            headers,
            bits,
            position_blocks,
            position_bits,
        }
    }

    /// Number of clusters.
    pub fn len(&self) -> usize {
        self.headers.as_slice().len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The bytes of all arrays: headers, bits, frames of positions, positions.
    pub fn bytes(&self) -> [&[u8]; 4] {
        [
            self.headers.bytes(),
            self.bits.bytes(),
            self.position_blocks.bytes(),
            self.position_bits.bytes(),
        ]
    }

    /// Bytes of positions, with their frames.
    pub(crate) fn position_bytes(&self) -> usize {
        self.position_blocks.num_bytes() + self.position_bits.num_bytes()
    }

    /// Bytes of clusters' headers and bits.
    pub(crate) fn cluster_bytes(&self) -> usize {
        self.headers.num_bytes() + self.bits.num_bytes()
    }

    /// The parts of one sub-mesh, if its header is true.
    #[inline(always)]
    pub(crate) fn submesh(&self, header: &SubmeshHeader) -> Option<SubmeshClusters<'_>> {
        let places = Places::of(header);
        let first = usize::try_from(header.first_index).ok()?;
        let end = first.checked_add(usize::try_from(header.num_indices).ok()?)?;
        let first_block = usize::try_from(places.first_block).ok()?;
        let end_block =
            first_block.checked_add(num_blocks(u64::from(header.num_vertices)) as usize)?;
        let bits = usize::try_from(places.first_byte).ok()?;
        let position_bits = usize::try_from(places.first_position_byte).ok()?;
        Some(SubmeshClusters {
            id: self.id,
            headers: self.headers.as_slice().get(first..end)?,
            bits: self.bits.as_slice().get(bits..)?,
            num_vertices: header.num_vertices,
            position_blocks: self
                .position_blocks
                .as_slice()
                .get(first_block..end_block)?,
            position_bits: self.position_bits.as_slice().get(position_bits..)?,
        })
    }
}

/// The clusters of one sub-mesh.
#[derive(Clone, Copy)]
pub struct SubmeshClusters<'a> {
    pub(crate) id: u64,
    pub(crate) headers: &'a [ClusterHeader],
    bits: &'a [u8],
    num_vertices: u32,
    position_blocks: &'a [PositionBlock],
    position_bits: &'a [u8],
}

impl SubmeshClusters<'_> {
    /// Number of clusters.
    pub fn len(&self) -> usize {
        self.headers.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.headers.is_empty()
    }

    /// The position of a vertex, relative to the origin.
    #[inline(always)]
    pub fn position(&self, vertex: u32) -> Option<[f32; 3]> {
        if vertex >= self.num_vertices {
            return None;
        }
        let block = self.position_blocks.get(vertex as usize / BLOCK)?;
        Some(block.read(self.position_bits, vertex as usize))
    }

    /// The number of the cluster that a leaf of the tree stands for.
    #[inline(always)]
    pub fn cluster_of_leaf(first_index: u64) -> usize {
        usize::try_from(first_index / u64::from(HEADER_WORDS)).unwrap_or(usize::MAX)
    }

    /// The cluster that a cell of the sub-mesh is in, if any is.
    ///
    /// Cost: looks at all headers.
    pub(crate) fn of_cell(&self, cell: u64) -> Option<usize> {
        let before = self.headers.iter().enumerate();
        let before = before.filter(|(_, h)| u64::from(h.first_cell) <= cell);
        before.max_by_key(|(_, h)| h.first_cell).map(|(i, _)| i)
    }

    /// A cell of the sub-mesh, with vertices of the sub-mesh; a cell without extent if there is none.
    ///
    /// Cost: looks at all headers and decodes a cluster.
    #[cold]
    #[inline(never)]
    pub(crate) fn cell(&self, submesh: &Submesh, cell: u64) -> (CellType, [u32; 8]) {
        let mut cluster = Cluster::default();
        if let Some(number) = self.of_cell(cell) {
            cluster.decode(submesh, self, number);
        }
        let place = cell.wrapping_sub(u64::from(cluster.first_cell));
        let found = usize::try_from(place)
            .ok()
            .and_then(|p| cluster.cells.get(p));
        found.map_or((CellType::Tetrahedron, [0; 8]), |cell| {
            let corners = cell.corners.map(|c| cluster.vertices[usize::from(c)]);
            (cell.cell_type, corners)
        })
    }

    /// The numbers of the clusters in packed order.
    pub(crate) fn in_order(&self) -> Vec<u32> {
        let mut all: Vec<u32> = (0..self.headers.len() as u32).collect();
        all.sort_by_key(|&c| self.headers[c as usize].first_cell);
        all
    }

    /// Asks for a cluster that will be decoded soon.
    #[inline(always)]
    pub(crate) fn prefetch(&self, first_index: u32) {
        let cluster = Self::cluster_of_leaf(u64::from(first_index));
        vacua_simd::prefetch(self.headers, cluster);
    }
}

/// Calls `visit` as [`Submesh::cells_of_leaf`] does, with the cells of the clusters that a leaf of
/// the tree stands for.
pub(crate) fn cells_of_leaf(
    submesh: &Submesh,
    clusters: &SubmeshClusters,
    first_index: u64,
    counts: LeafCounts,
    mut visit: impl FnMut(u64, CellType, [u32; 8]),
) {
    for k in 0..u64::from(counts.tets) {
        let number = SubmeshClusters::cluster_of_leaf(first_index + k * u64::from(HEADER_WORDS));
        cells_of_cluster(submesh, clusters, number, &mut visit);
    }
}

/// As [`cells_of_leaf`] for one cluster.
pub(crate) fn cells_of_cluster(
    submesh: &Submesh,
    clusters: &SubmeshClusters,
    number: usize,
    mut visit: impl FnMut(u64, CellType, [u32; 8]),
) {
    let mut cluster = Cluster::default();
    cluster.decode(submesh, clusters, number);
    for (i, cell) in cluster.cells.iter().enumerate() {
        let corners = cell.corners.map(|c| cluster.vertices[usize::from(c)]);
        visit(cluster.index_of(i), cell.cell_type, corners);
    }
}
