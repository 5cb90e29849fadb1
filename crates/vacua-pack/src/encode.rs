//! The encoder: partition, sub-meshes in parallel, one after the other into flat arrays.
//!
//! Source: paper B, §4 and §5.

use std::time::Instant;

use rayon::prelude::*;
use vacua_volume::UnstructuredMesh;

use crate::grid::Grid;
use crate::ids::Ids;
use crate::indices::PADDING;
use crate::input::Input;
use crate::layout::{CHILD_DIVISIONS, MultiLeaf, SubmeshHeader};
use crate::outer::{self, MAX_ITEMS};
use crate::packed::{Nodes, PackedMesh};
use crate::partition::{self, INDEX_BITS};
use crate::pool::Pool;
use crate::section::Flat;
use crate::submesh::{self, EncodedSubmesh, LeafTotals};

/// Sub-meshes a thread between two copies into the common arrays.
const SUBMESHES_A_THREAD: usize = 4;

/// The two layouts of paper B, Table 3.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Variant {
    /// Variant 1: 48-byte multi-leaves, and one outer tree over all of them.
    MultiLeaves,
    /// Variant 2: 52-byte nodes down from the root of each sub-mesh, and a small outer tree over the
    /// sub-meshes.
    #[default]
    MultiNodes,
}

/// How to encode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EncodeOptions {
    /// Which layout.
    pub variant: Variant,
    /// Bits of an index, 8 to 32: sub-meshes have at most two to this many vertices.
    pub index_bits: u32,
}

impl Default for EncodeOptions {
    fn default() -> Self {
        Self {
            variant: Variant::default(),
            index_bits: 16,
        }
    }
}

/// Why a mesh cannot be encoded.
#[derive(Clone, Debug, thiserror::Error, PartialEq, Eq)]
pub enum EncodeError {
    /// Bits of an index out of range.
    #[error("an index has 8 to 32 bits, {actual} were asked for")]
    IndexBits {
        /// Bits asked for.
        actual: u32,
    },
    /// A sub-mesh whose primitives 32-bit offsets do not reach.
    #[error(
        "a sub-mesh of {cells} cells has {indices} indices, 32-bit offsets reach 4294967295; use fewer index bits"
    )]
    TooManyIndices {
        /// Its cells.
        cells: u64,
        /// Its indices.
        indices: u64,
    },
    /// More multi-leaves or sub-meshes than the outer tree can tell apart.
    #[error("{actual} multi-leaves or sub-meshes, the outer tree reaches {MAX_ITEMS}")]
    TooManyItems {
        /// How many there are.
        actual: usize,
    },
}

/// Which cells and points of the input the packed ones are; needed to bring fields along.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PackMap {
    /// A point of the input for each vertex.
    pub points: Ids,
    /// A cell of the input for each cell, in packed order.
    pub cells: Ids,
}

/// What encoding did, with the trouble it met.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EncodeReport {
    /// Cells left out because they are blanked.
    pub num_blanked: usize,
    /// Cells left out because a position is not finite, or not in `f32`.
    pub num_not_finite: usize,
    /// The largest distance along an axis by which a stored position is off, in world units.
    pub worst_rounding: f64,
    /// Primitives, leaves and children.
    pub totals: LeafTotals,
    /// Time to split into sub-meshes.
    pub partition_secs: f64,
    /// Time to encode them.
    pub submeshes_secs: f64,
    /// Time to build the outer tree.
    pub outer_secs: f64,
}

/// An encoded mesh, where it came from, and how it went.
pub struct Encoded {
    /// The mesh.
    pub mesh: PackedMesh,
    /// From packed to original order.
    pub map: PackMap,
    /// How it went.
    pub report: EncodeReport,
}

/// Encodes a mesh. The same bytes come out whatever the number of threads.
///
/// # Errors
/// [`EncodeError`]; bad cells are no error but are left out and counted.
pub fn encode(mesh: &UnstructuredMesh, options: EncodeOptions) -> Result<Encoded, EncodeError> {
    let EncodeOptions {
        variant,
        index_bits,
    } = options;
    if !INDEX_BITS.contains(&index_bits) {
        return Err(EncodeError::IndexBits { actual: index_bits });
    }
    let start = Instant::now();
    let input = Input::new(mesh);
    let partition = partition::split(&input, index_bits);
    let mut report = EncodeReport {
        num_blanked: partition.num_blanked,
        num_not_finite: partition.num_not_finite,
        worst_rounding: input.worst_rounding,
        partition_secs: start.elapsed().as_secs_f64(),
        ..EncodeReport::default()
    };
    tracing::debug!(
        submeshes = partition.parts.len(),
        secs = report.partition_secs,
        "partitioned"
    );
    let start = Instant::now();
    let mut flat = FlatArrays::new(mesh, partition.cells.len());
    let scratch = Pool::<submesh::Scratch>::default();
    let batch = SUBMESHES_A_THREAD * rayon::current_num_threads();
    for parts in partition.parts.chunks(batch) {
        let encoded: Result<Vec<EncodedSubmesh>, EncodeError> = parts
            .par_iter()
            .map(|part| {
                let cells: Vec<u64> = part.clone().map(|i| partition.cells.get(i)).collect();
                scratch.with(|s| submesh::encode(&input, &cells, variant, index_bits, s))
            })
            .collect();
        for submesh in encoded? {
            flat.append(submesh, index_bits);
        }
        tracing::debug!(submeshes = flat.submeshes.len(), "encoded");
    }
    report.totals = flat.totals;
    report.submeshes_secs = start.elapsed().as_secs_f64();

    let start = Instant::now();
    let num_items = match variant {
        Variant::MultiLeaves => flat.multi_leaves.len(),
        Variant::MultiNodes => flat.submeshes.len(),
    };
    if num_items > MAX_ITEMS {
        return Err(EncodeError::TooManyItems { actual: num_items });
    }
    let outer = match variant {
        Variant::MultiLeaves => outer::build(flat.multi_leaf_boxes()),
        Variant::MultiNodes => outer::build(flat.submeshes.iter().map(|s| (s.lo, s.hi))),
    };
    report.outer_secs = start.elapsed().as_secs_f64();
    Ok(flat.finish(options, outer, report))
}

/// The common arrays while sub-meshes are added.
struct FlatArrays {
    submeshes: Vec<SubmeshHeader>,
    multi_leaves: Vec<MultiLeaf>,
    multi_nodes: Vec<crate::layout::MultiNode>,
    positions: Vec<[f32; 3]>,
    indices: Vec<u8>,
    map: PackMap,
    totals: LeafTotals,
}

impl FlatArrays {
    fn new(mesh: &UnstructuredMesh, num_cells: usize) -> Self {
        Self {
            submeshes: Vec::new(),
            multi_leaves: Vec::new(),
            multi_nodes: Vec::new(),
            positions: Vec::new(),
            indices: Vec::new(),
            map: PackMap {
                points: Ids::below(mesh.num_points() as u64, 0),
                cells: Ids::below(mesh.num_cells() as u64, num_cells),
            },
            totals: LeafTotals::default(),
        }
    }

    fn append(&mut self, submesh: EncodedSubmesh, index_bits: u32) {
        let mut header = submesh.header;
        header.first_vertex = self.positions.len() as u64;
        header.first_index = self.indices.len() as u64 * 8 / u64::from(index_bits);
        header.first_node = (self.multi_leaves.len() + self.multi_nodes.len()) as u64;
        header.first_cell = self.map.cells.len() as u64;
        self.submeshes.push(header);
        self.multi_leaves.extend(submesh.multi_leaves);
        self.multi_nodes.extend(submesh.multi_nodes);
        self.positions.extend(submesh.positions);
        self.indices.extend(submesh.indices);
        self.map.points.append(&submesh.points);
        self.map.cells.append(&submesh.cells);
        self.totals = self.totals.plus(submesh.num_primitives);
    }

    /// Boxes of all multi-leaves as they decode.
    fn multi_leaf_boxes(&self) -> impl Iterator<Item = ([f32; 3], [f32; 3])> + '_ {
        self.submeshes.iter().flat_map(|header| {
            let grid = Grid::of(header);
            let first = header.first_node as usize;
            let nodes = &self.multi_leaves[first..first + header.num_nodes as usize];
            nodes.iter().map(move |node| {
                let at = |q: [u16; 3]| {
                    grid.local_from_sixteenths(q.map(|q| CHILD_DIVISIONS * u32::from(q)))
                };
                (at(node.lo).map(below), at(node.hi).map(above))
            })
        })
    }

    fn finish(
        mut self,
        options: EncodeOptions,
        outer: Vec<outer::OuterNode>,
        report: EncodeReport,
    ) -> Encoded {
        self.indices.extend([0; PADDING]);
        let nodes = match options.variant {
            Variant::MultiLeaves => Nodes::MultiLeaves(Flat::from_vec(self.multi_leaves)),
            Variant::MultiNodes => Nodes::MultiNodes(Flat::from_vec(self.multi_nodes)),
        };
        Encoded {
            mesh: PackedMesh {
                variant: options.variant,
                index_bits: options.index_bits,
                submeshes: Flat::from_vec(self.submeshes),
                nodes,
                outer: Flat::from_vec(outer),
                positions: Flat::from_vec(self.positions),
                indices: Flat::from_vec(self.indices),
            },
            map: self.map,
            report,
        }
    }
}

/// The largest finite `f32` not above a number, or the lowest there is.
fn below(value: f64) -> f32 {
    let near = value as f32;
    let near = if f64::from(near) > value {
        near.next_down()
    } else {
        near
    };
    near.max(f32::MIN)
}

/// The smallest finite `f32` not below a number, or the highest there is.
fn above(value: f64) -> f32 {
    -below(-value)
}
