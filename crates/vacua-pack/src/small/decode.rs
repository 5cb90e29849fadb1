//! A cluster decoded: its vertices with their positions, its cells, and the boxes of its leaves.

use vacua_volume::CellType;

use super::bits::BitReader;
use super::{BLOCK, SubmeshClusters};
use crate::layout::LeafCounts;
use crate::packed::Submesh;

/// A cell of a decoded cluster.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClusterCell {
    /// Its vertices within the cluster, VTK's order; past those of its type, the last one again.
    pub corners: [u8; 8],
    /// What it is.
    pub cell_type: CellType,
}

/// A leaf of a decoded cluster: first tetrahedra (those of pairs too), then others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClusterLeaf {
    /// Its first cell in the cluster.
    pub first_cell: u32,
    /// How many are tetrahedra.
    pub num_tets: u32,
    /// How many are not.
    pub num_others: u32,
    /// Its counts, as of leaves of the other variants.
    pub counts: u8,
    /// The box around its cells, relative to the origin.
    pub lo: [f32; 3],
    /// The box around its cells, relative to the origin.
    pub hi: [f32; 3],
}

/// A decoded cluster. Decoding into the same one again reuses its memory.
#[derive(Clone, Debug, Default)]
pub struct Cluster {
    /// Its vertices within the sub-mesh: own ones, then borrowed ones, then, so that there is one for
    /// each number of eight bits, the first of the sub-mesh.
    pub vertices: Vec<u32>,
    /// How many it has.
    pub num_vertices: usize,
    /// Where they are, relative to the origin.
    pub positions: Vec<[f32; 3]>,
    /// Its cells in packed order.
    pub cells: Vec<ClusterCell>,
    /// Its leaves in packed order.
    pub leaves: Vec<ClusterLeaf>,
    /// Its first cell in the sub-mesh.
    pub first_cell: u32,
    counts: Vec<u8>,
}

impl Cluster {
    /// Which primitive of the sub-mesh a cell is: see [`crate::PackedCell::index`].
    #[inline(always)]
    pub fn index_of(&self, cell: usize) -> u64 {
        2 * (u64::from(self.first_cell) + cell as u64)
    }

    /// Decodes a cluster of a sub-mesh; without any cell if there is no such cluster, or its header
    /// contradicts itself.
    pub fn decode(&mut self, submesh: &Submesh, clusters: &SubmeshClusters, number: usize) {
        self.vertices.clear();
        self.positions.clear();
        self.cells.clear();
        self.leaves.clear();
        self.counts.clear();
        self.num_vertices = 0;
        let Some(header) = clusters.headers.get(number) else {
            return;
        };
        let num_vertices = header.num_vertices();
        let Some(bytes) = clusters.bits.get(header.offset as usize..) else {
            return;
        };
        if num_vertices == 0 || num_vertices > super::MAX_CLUSTER_VERTICES {
            return;
        }
        self.first_cell = header.first_cell;
        self.num_vertices = num_vertices;
        let mut reader = BitReader::new(bytes);
        let mut num_others = 0;
        for _ in 0..header.num_leaves {
            let counts = reader.next(8) as u8;
            num_others += usize::from(LeafCounts::unpack(counts).others);
            self.counts.push(counts);
        }
        let mut kinds = reader;
        if header.kind == 0 {
            (0..num_others).for_each(|_| {
                reader.next(2);
            });
        }
        self.decode_vertices(clusters, header, &mut reader);
        let all = [0, 1, 2, 3].map(|k| submesh.header.num_cells[k]);
        self.cells
            .reserve(all.iter().fold(0u32, |a, &b| a.saturating_add(b)).min(1024) as usize);
        let width = header.index_bits();
        for leaf in 0..self.counts.len() {
            let counts = LeafCounts::unpack(self.counts[leaf]);
            let first = self.cells.len();
            for _ in 0..counts.tets {
                let [a, b, c, d] = reader.next_few(width);
                self.push_tet([a, b, c, d]);
            }
            for _ in 0..counts.pairs {
                let [a, b, c, d, e] = reader.next_few(width);
                self.push_tet([a, b, c, d]);
                self.push_tet([a, c, b, e]);
            }
            let num_tets = self.cells.len() - first;
            for _ in 0..counts.others {
                let kind = match header.kind {
                    0 => kinds.next(2) as u8,
                    kind => kind,
                };
                self.push_other(kind, width, &mut reader);
            }
            self.push_leaf(self.counts[leaf], first, num_tets);
        }
    }

    fn decode_vertices(
        &mut self,
        clusters: &SubmeshClusters,
        header: &super::ClusterHeader,
        reader: &mut BitReader,
    ) {
        let first = header.first_vertex;
        for vertex in first..first.saturating_add(u32::from(header.num_own)) {
            self.vertices.push(vertex);
        }
        let width = header.borrowed_bits();
        for _ in 0..header.num_borrowed {
            self.vertices.push(reader.next(width) as u32);
        }
        // Whatever a false header says: a vertex for every number of eight bits.
        self.vertices.resize(u8::MAX as usize + 1, 0);
        for &vertex in &self.vertices[..header.num_vertices()] {
            let block = clusters.position_blocks.get(vertex as usize / BLOCK);
            let position = block.map(|b| b.read(clusters.position_bits, vertex as usize));
            self.positions.push(position.unwrap_or([f32::NAN; 3]));
        }
        self.positions.resize(u8::MAX as usize + 1, [f32::NAN; 3]);
    }

    #[inline(always)]
    fn push_tet(&mut self, [a, b, c, d]: [u8; 4]) {
        self.cells.push(ClusterCell {
            corners: [a, b, c, d, d, d, d, d],
            cell_type: CellType::Tetrahedron,
        });
    }

    #[inline(always)]
    fn push_other(&mut self, kind: u8, width: u32, reader: &mut BitReader) {
        let cell = match kind {
            1 => {
                let [a, b, c, d, e] = reader.next_few(width);
                ClusterCell {
                    corners: [a, b, c, d, e, e, e, e],
                    cell_type: CellType::Pyramid,
                }
            }
            2 => {
                let [a, b, c, d, e, f] = reader.next_few(width);
                ClusterCell {
                    corners: [a, b, c, d, e, f, f, f],
                    cell_type: CellType::Wedge,
                }
            }
            _ => ClusterCell {
                corners: reader.next_few(width),
                cell_type: CellType::Hexahedron,
            },
        };
        self.cells.push(cell);
    }

    fn push_leaf(&mut self, counts: u8, first: usize, num_tets: usize) {
        let (mut lo, mut hi) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for (i, cell) in self.cells[first..].iter().enumerate() {
            let corners = if i < num_tets { 4 } else { 8 };
            for &corner in &cell.corners[..corners] {
                let p = self.positions[usize::from(corner)];
                for axis in 0..3 {
                    lo[axis] = if p[axis] < lo[axis] {
                        p[axis]
                    } else {
                        lo[axis]
                    };
                    hi[axis] = if p[axis] > hi[axis] {
                        p[axis]
                    } else {
                        hi[axis]
                    };
                }
            }
        }
        self.leaves.push(ClusterLeaf {
            first_cell: first as u32,
            num_tets: num_tets as u32,
            num_others: (self.cells.len() - first - num_tets) as u32,
            counts,
            lo,
            hi,
        });
    }
}
