//! A packed mesh: the flat arrays that are written to a file as they are, and what they say.

use vacua_volume::{Bounds, CellType};

use crate::Variant;
use crate::grid::Grid;
use crate::indices::IndexList;
use crate::layout::{Child, MultiLeaf, MultiNode, SubmeshHeader, WIDTH};
use crate::outer::OuterNode;
use crate::pairs::tets_of;
use crate::section::Flat;
use crate::small::{self, Cluster, Clusters, SubmeshClusters};

/// The nodes of all sub-meshes.
#[derive(Clone)]
pub enum Nodes {
    /// Variant 1.
    MultiLeaves(Flat<MultiLeaf>),
    /// Variant 2.
    MultiNodes(Flat<MultiNode>),
}

impl Nodes {
    /// Number of nodes.
    pub fn len(&self) -> usize {
        match self {
            Self::MultiLeaves(nodes) => nodes.as_slice().len(),
            Self::MultiNodes(nodes) => nodes.as_slice().len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Length in bytes.
    pub fn num_bytes(&self) -> usize {
        match self {
            Self::MultiLeaves(nodes) => nodes.num_bytes(),
            Self::MultiNodes(nodes) => nodes.num_bytes(),
        }
    }

    /// The bytes.
    pub fn bytes(&self) -> &[u8] {
        match self {
            Self::MultiLeaves(nodes) => nodes.bytes(),
            Self::MultiNodes(nodes) => nodes.bytes(),
        }
    }

    /// Some of them, if there are so many.
    fn slice(&self, places: std::ops::Range<u64>) -> Option<NodeSlice<'_>> {
        let places = usize::try_from(places.start).ok()?..usize::try_from(places.end).ok()?;
        match self {
            Self::MultiLeaves(n) => n.as_slice().get(places).map(NodeSlice::MultiLeaves),
            Self::MultiNodes(n) => n.as_slice().get(places).map(NodeSlice::MultiNodes),
        }
    }

    /// One node's boxes and counts, and its first inner child (0 in variant 1).
    #[inline(always)]
    pub fn get(&self, node: usize) -> Option<(&MultiLeaf, u32)> {
        match self {
            Self::MultiLeaves(nodes) => nodes.as_slice().get(node).map(|n| (n, 0)),
            Self::MultiNodes(nodes) => nodes.as_slice().get(node).map(|n| (&n.leaf, n.first_child)),
        }
    }
}

/// An encoded mesh: geometry only, immutable. Clones share the arrays.
#[derive(Clone)]
pub struct PackedMesh {
    pub(crate) variant: Variant,
    pub(crate) index_bits: u32,
    pub(crate) submeshes: Flat<SubmeshHeader>,
    pub(crate) nodes: Nodes,
    pub(crate) outer: Flat<OuterNode>,
    pub(crate) positions: Flat<[f32; 3]>,
    pub(crate) indices: Flat<u8>,
    /// What variant `small` has instead of positions and indices.
    pub(crate) clusters: Option<Clusters>,
}

/// Bytes of every part of a packed mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct PackedBytes {
    /// Positions of vertices, 12 a vertex, replicated ones included.
    pub positions: usize,
    /// Indices of cells.
    pub indices: usize,
    /// Multi-leaves or multi-nodes.
    pub nodes: usize,
    /// The tree above them.
    pub outer: usize,
    /// Headers of sub-meshes.
    pub submeshes: usize,
}

impl PackedBytes {
    /// The sum.
    pub fn total(&self) -> usize {
        self.positions + self.indices + self.nodes + self.outer + self.submeshes
    }
}

impl PackedMesh {
    /// Which variant this is.
    pub fn variant(&self) -> Variant {
        self.variant
    }

    /// Bits of an index.
    pub fn index_bits(&self) -> u32 {
        self.index_bits
    }

    /// Headers of all sub-meshes.
    pub fn submeshes(&self) -> &[SubmeshHeader] {
        self.submeshes.as_slice()
    }

    /// Nodes of all sub-meshes.
    pub fn nodes(&self) -> &Nodes {
        &self.nodes
    }

    /// The tree over multi-leaves (variant 1) or sub-meshes (variant 2); the root is first.
    pub fn outer(&self) -> &[OuterNode] {
        self.outer.as_slice()
    }

    /// Positions of all vertices, sub-mesh after sub-mesh, relative to the sub-mesh's origin; none in
    /// variant `small`, where [`Submesh::position`] gives them one by one.
    pub fn positions(&self) -> &[[f32; 3]] {
        self.positions.as_slice()
    }

    /// Indices of all sub-meshes; none in variant `small`.
    pub fn indices(&self) -> IndexList<'_> {
        IndexList::new(self.indices.bytes(), self.index_bits)
    }

    /// Number of vertices, replicated ones included.
    pub fn num_vertices(&self) -> usize {
        match self.clusters {
            None => self.positions().len(),
            Some(_) => {
                let all = self.submeshes().iter().map(|h| u64::from(h.num_vertices));
                usize::try_from(all.sum::<u64>()).unwrap_or(usize::MAX)
            }
        }
    }

    /// The clusters of variant `small`.
    pub fn clusters(&self) -> Option<&Clusters> {
        self.clusters.as_ref()
    }

    /// Number of cells by [`CellType`]'s number.
    pub fn num_cells_by_type(&self) -> [u64; 4] {
        let mut sums = [0u64; 4];
        for header in self.submeshes() {
            for (sum, &n) in sums.iter_mut().zip(&header.num_cells) {
                *sum = sum.saturating_add(u64::from(n));
            }
        }
        sums
    }

    /// Number of cells.
    pub fn num_cells(&self) -> u64 {
        self.num_cells_by_type().iter().sum()
    }

    /// The box around all cells, in the world; `None` without any.
    pub fn bounds(&self) -> Option<Bounds> {
        let corner = |h: &SubmeshHeader, c: [f32; 3]| {
            glam::DVec3::from_array([0, 1, 2].map(|i| h.origin[i] + f64::from(c[i])))
        };
        let corners = self.submeshes().iter();
        Bounds::of_points(corners.flat_map(|h| [corner(h, h.lo), corner(h, h.hi)]))
    }

    /// Bytes of every part.
    pub fn bytes(&self) -> PackedBytes {
        let (positions, indices) = match &self.clusters {
            None => (self.positions.num_bytes(), self.indices.num_bytes()),
            Some(clusters) => (clusters.position_bytes(), clusters.cluster_bytes()),
        };
        PackedBytes {
            positions,
            indices,
            nodes: self.nodes.num_bytes(),
            outer: self.outer.num_bytes(),
            submeshes: self.submeshes.num_bytes(),
        }
    }

    /// One sub-mesh with its parts, if its header is true.
    #[inline]
    pub fn submesh(&self, submesh: usize) -> Option<Submesh<'_>> {
        let header = self.submeshes().get(submesh)?;
        let nodes = self.nodes.slice(header.nodes())?;
        let grid = Grid::of(header);
        if let Some(clusters) = &self.clusters {
            return Some(Submesh {
                header,
                grid,
                positions: &[],
                indices: self.indices(),
                nodes,
                clusters: Some(clusters.submesh(header)?),
                decoded: None,
            });
        }
        let first = usize::try_from(header.first_vertex).ok()?;
        let end = first.checked_add(header.num_vertices as usize)?;
        Some(Submesh {
            header,
            grid,
            positions: self.positions().get(first..end)?,
            indices: self.indices().from(header.first_index),
            nodes,
            clusters: None,
            decoded: None,
        })
    }

    /// All cells in packed order: sub-mesh after sub-mesh, node after node.
    pub fn cells(&self) -> impl Iterator<Item = PackedCell> + '_ {
        (0..self.submeshes().len())
            .filter_map(|s| self.submesh(s).map(|submesh| (s, submesh)))
            .flat_map(|(s, submesh)| {
                let pieces: Vec<u32> = match &submesh.clusters {
                    None => (0..submesh.header.num_nodes).collect(),
                    Some(clusters) => clusters.in_order(),
                };
                pieces.into_iter().flat_map(move |piece| {
                    let mut cells = Vec::new();
                    submesh.cells_of_piece(piece, |index, cell_type, corners| {
                        cells.push(PackedCell {
                            submesh: s as u32,
                            index,
                            cell_type,
                            corners,
                        });
                    });
                    cells
                })
            })
    }
}

/// A cell as it is packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PackedCell {
    /// Which sub-mesh it is in.
    pub submesh: u32,
    /// Which primitive it is there, or which half of one: twice its first index, and one more for
    /// the second tetrahedron of a pair. Grows in packed order.
    pub index: u64,
    /// What it is.
    pub cell_type: CellType,
    /// Its vertices within the sub-mesh, VTK's order; past those of its type, repetitions.
    pub corners: [u32; 8],
}

impl PackedCell {
    /// Its vertices within the sub-mesh.
    pub fn corners(&self) -> &[u32] {
        &self.corners[..self.cell_type.num_points()]
    }
}

/// A sub-mesh: its header and its parts.
#[derive(Clone, Copy)]
pub struct Submesh<'a> {
    /// Its header.
    pub header: &'a SubmeshHeader,
    /// The grid of its boxes.
    pub grid: Grid,
    /// Its vertices, relative to the origin.
    pub positions: &'a [[f32; 3]],
    /// Its indices, and those of sub-meshes after it.
    pub indices: IndexList<'a>,
    nodes: NodeSlice<'a>,
    /// What there is instead of positions and indices in variant `small`.
    pub(crate) clusters: Option<SubmeshClusters<'a>>,
    /// The cluster whose positions and cells are to be used.
    pub(crate) decoded: Option<&'a Cluster>,
}

/// The nodes of one sub-mesh.
#[derive(Clone, Copy)]
enum NodeSlice<'a> {
    MultiLeaves(&'a [MultiLeaf]),
    MultiNodes(&'a [MultiNode]),
}

impl<'a> Submesh<'a> {
    /// A sub-mesh from its parts: nodes of one of the two kinds, none of the other.
    pub(crate) fn new(
        header: &'a SubmeshHeader,
        positions: &'a [[f32; 3]],
        indices: IndexList<'a>,
        multi_leaves: &'a [MultiLeaf],
        multi_nodes: &'a [MultiNode],
        clusters: Option<SubmeshClusters<'a>>,
    ) -> Self {
        Self {
            header,
            grid: Grid::of(header),
            positions,
            indices,
            nodes: if multi_leaves.is_empty() {
                NodeSlice::MultiNodes(multi_nodes)
            } else {
                NodeSlice::MultiLeaves(multi_leaves)
            },
            clusters,
            decoded: None,
        }
    }

    /// The same with the positions and cells of a decoded cluster.
    #[inline(always)]
    pub(crate) fn with_cluster<'b>(&self, cluster: &'b Cluster) -> Submesh<'b>
    where
        'a: 'b,
    {
        Submesh {
            positions: &cluster.positions,
            decoded: Some(cluster),
            ..*self
        }
    }

    /// One of its nodes.
    #[inline(always)]
    pub fn node(&self, node: u32) -> Option<(&'a MultiLeaf, u32)> {
        match self.nodes {
            NodeSlice::MultiLeaves(nodes) => nodes.get(node as usize).map(|n| (n, 0)),
            NodeSlice::MultiNodes(nodes) => {
                let node = nodes.get(node as usize)?;
                Some((&node.leaf, node.first_child))
            }
        }
    }

    /// Asks for a node that will be visited soon.
    #[inline(always)]
    pub(crate) fn prefetch_node(&self, node: u32) {
        match self.nodes {
            NodeSlice::MultiLeaves(nodes) => vacua_simd::prefetch(nodes, node as usize),
            NodeSlice::MultiNodes(nodes) => vacua_simd::prefetch(nodes, node as usize),
        }
    }

    /// Asks for indices that will be read soon.
    #[inline(always)]
    pub(crate) fn prefetch_indices(&self, first: u32) {
        match &self.clusters {
            None => self.indices.prefetch(first),
            Some(clusters) => clusters.prefetch(first),
        }
    }

    /// The position of one of its vertices, relative to the origin.
    #[inline(always)]
    pub fn position(&self, vertex: u32) -> Option<[f32; 3]> {
        match &self.clusters {
            None => self.positions.get(vertex as usize).copied(),
            Some(clusters) => clusters.position(vertex),
        }
    }

    /// Calls `visit` with the primitive (see [`PackedCell::index`]), type and vertices of every cell
    /// in a leaf whose primitives start at an index.
    #[inline(always)]
    pub fn cells_of_leaf(
        &self,
        first_index: u64,
        counts: crate::layout::LeafCounts,
        mut visit: impl FnMut(u64, CellType, [u32; 8]),
    ) {
        if let Some(clusters) = &self.clusters {
            return small::cells_of_leaf(self, clusters, first_index, counts, visit);
        }
        let filled = |t: [u32; 4]| [t[0], t[1], t[2], t[3], t[3], t[3], t[3], t[3]];
        let mut at = first_index;
        for _ in 0..counts.tets {
            visit(2 * at, CellType::Tetrahedron, filled(self.indices.read(at)));
            at += 4;
        }
        for _ in 0..counts.pairs {
            let [first, second] = tets_of(self.indices.read(at));
            visit(2 * at, CellType::Tetrahedron, filled(first));
            visit(2 * at + 1, CellType::Tetrahedron, filled(second));
            at += 5;
        }
        for _ in 0..counts.others {
            let (cell_type, corners) = self.other(self.indices.read(at));
            visit(2 * at, cell_type, corners);
            at += 8;
        }
    }

    /// Positions of a cell's corners, relative to the origin; `None` if one is out of range.
    #[inline(always)]
    pub fn corner_positions(&self, cell: &PackedCell) -> Option<[[f32; 3]; 8]> {
        let mut corners = [[0.0; 3]; 8];
        for (position, &corner) in corners.iter_mut().zip(cell.corners()) {
            *position = self.position(corner)?;
        }
        Some(corners)
    }

    /// What eight indices are: the number of markers at their end says so.
    #[inline(always)]
    pub(crate) fn other(&self, mut corners: [u32; 8]) -> (CellType, [u32; 8]) {
        if !self.header.has_marker() || corners[7] != self.indices.largest() {
            return (CellType::Hexahedron, corners);
        }
        let (cell_type, last) = if corners[5] == self.indices.largest() {
            (CellType::Pyramid, corners[4])
        } else {
            (CellType::Wedge, corners[5])
        };
        corners[cell_type.num_points()..].fill(last);
        (cell_type, corners)
    }

    /// The cells of a node, or of a cluster in variant `small`.
    fn cells_of_piece(&self, piece: u32, visit: impl FnMut(u64, CellType, [u32; 8])) {
        match &self.clusters {
            None => self.cells_of_node(piece, visit),
            Some(clusters) => small::cells_of_cluster(self, clusters, piece as usize, visit),
        }
    }

    /// As [`Self::cells_of_leaf`] for all leaves of a node.
    pub fn cells_of_node(&self, node: u32, mut visit: impl FnMut(u64, CellType, [u32; 8])) {
        let Some((node, _)) = self.node(node) else {
            return;
        };
        let mut at = u64::from(node.first_index);
        for k in 0..WIDTH {
            if let Child::Leaf(counts) = node.child(k) {
                self.cells_of_leaf(at, counts, &mut visit);
                at += counts.num_indices() as u64;
            }
        }
    }
}
