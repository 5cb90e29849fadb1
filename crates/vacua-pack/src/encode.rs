//! The encoder: partition, sub-meshes in parallel, one after the other into flat arrays.
//!
//! Source: paper B, §4 and §5.

use std::sync::atomic::{AtomicUsize, Ordering};
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
use crate::partition::{Group, INDEX_BITS, LeftOut, SplitError, Splitter};
use crate::pool::Pool;
use crate::section::Flat;
use crate::small::{self, ClusterHeader, Clusters, MAX_INDEX_BITS, Places, PositionBlock};
use crate::spill::SpillFolder;
use crate::submesh::{self, EncodedSubmesh, LeafTotals};

/// Sub-meshes a thread between two copies into the common arrays.
const SUBMESHES_A_THREAD: usize = 4;

/// The two layouts of paper B, Table 3, and a smaller one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Variant {
    /// Variant 1: 48-byte multi-leaves, and one outer tree over all of them.
    MultiLeaves,
    /// Variant 2: 52-byte nodes down from the root of each sub-mesh, and a small outer tree over the
    /// sub-meshes.
    #[default]
    MultiNodes,
    /// Variant `small`: clusters of cells with short indices under the nodes of variant 2; positions
    /// and values in frames, exact. See [`crate::small`].
    Small,
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
    #[error("an index has 8 to {most} bits in this variant, {actual} were asked for")]
    IndexBits {
        /// Bits asked for.
        actual: u32,
        /// The most there may be.
        most: u32,
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
    /// A temporary file with what does not fit in memory.
    #[error("a temporary file beside the output: {0}")]
    Spill(String),
    /// One sub-mesh is larger than what may be in memory.
    #[error(
        "a sub-mesh of {cells} cells, the memory budget allows {most} at a time; use fewer index bits or more memory"
    )]
    Budget {
        /// Its cells.
        cells: u64,
        /// How many may be in memory.
        most: usize,
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

/// What the encoder is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EncodeStage {
    /// Splitting into sub-meshes; counts cells.
    Partition,
    /// Encoding sub-meshes; counts cells.
    Submeshes,
    /// Building the outer tree; counts its items.
    Outer,
    /// Writing the file; counts bytes.
    Write,
}

/// How far it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EncodeProgress {
    /// Doing what.
    pub stage: EncodeStage,
    /// So many of `total` are done.
    pub done: u64,
    /// All there are to do; with a memory budget partition and sub-meshes alternate.
    pub total: u64,
}

/// Whoever wants to know; called from any thread.
pub type EncodeObserver<'a> = &'a (dyn Fn(EncodeProgress) + Sync);

/// Encodes a mesh. The same bytes come out whatever the number of threads.
///
/// # Errors
/// [`EncodeError`]; bad cells are no error but are left out and counted.
pub fn encode(mesh: &UnstructuredMesh, options: EncodeOptions) -> Result<Encoded, EncodeError> {
    encode_observed(mesh, options, &|_| ())
}

/// As [`encode`], telling how far it is.
///
/// # Errors
/// As [`encode`].
pub fn encode_observed(
    mesh: &UnstructuredMesh,
    options: EncodeOptions,
    observer: EncodeObserver,
) -> Result<Encoded, EncodeError> {
    let input = Input::new(mesh);
    let mut flat = FlatArrays::new(mesh);
    let work = Work {
        options,
        memory: Memory::All,
        observer,
    };
    let mut report = work.encode_submeshes(
        &input,
        |submesh| submesh,
        |submesh| {
            flat.append(submesh, options.index_bits);
            Ok::<(), EncodeError>(())
        },
    )?;
    report.totals = flat.totals;
    let start = Instant::now();
    let outer = match options.variant {
        Variant::MultiLeaves => work.outer_tree(flat.multi_leaf_boxes())?,
        Variant::MultiNodes | Variant::Small => {
            work.outer_tree(flat.submeshes.iter().map(|s| (s.lo, s.hi)))?
        }
    };
    report.outer_secs = start.elapsed().as_secs_f64();
    Ok(flat.finish(options, outer, report))
}

/// What may be in memory at a time.
pub(crate) enum Memory {
    /// The centres of all cells.
    All,
    /// Those of so many cells; the others are in a folder.
    Cells(usize, SpillFolder),
}

/// An encoding to be.
pub(crate) struct Work<'a> {
    pub options: EncodeOptions,
    pub memory: Memory,
    pub observer: EncodeObserver<'a>,
}

impl Work<'_> {
    /// Encodes all sub-meshes, some at a time: `finish` is called for each on any thread, `append`
    /// with what comes out in order. The report lacks totals and what happens afterwards.
    pub fn encode_submeshes<R: Send, E>(
        &self,
        input: &Input,
        finish: impl Fn(EncodedSubmesh) -> R + Sync,
        mut append: impl FnMut(R) -> Result<(), E>,
    ) -> Result<EncodeReport, E>
    where
        E: From<EncodeError> + Send,
    {
        let EncodeOptions {
            variant,
            index_bits,
        } = self.options;
        let actual = index_bits;
        let most = match variant {
            Variant::Small => MAX_INDEX_BITS,
            _ => *INDEX_BITS.end(),
        };
        if !(*INDEX_BITS.start()..=most).contains(&actual) {
            return Err(EncodeError::IndexBits { actual, most }.into());
        }
        let total = input.mesh().num_cells() as u64;
        let tell = |stage, done: usize| {
            let done = done as u64;
            (self.observer)(EncodeProgress { stage, done, total });
        };
        let (num_split, num_encoded) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let split = |cells| {
            let before = num_split.fetch_add(cells, Ordering::Relaxed);
            tell(EncodeStage::Partition, before + cells);
        };
        let scratch = Pool::<submesh::Scratch>::default();
        let batch = SUBMESHES_A_THREAD * rayon::current_num_threads();
        let mut submeshes_secs = 0.0;
        let mut encode_group = |group: Group| -> Result<(), E> {
            let start = Instant::now();
            for parts in group.parts.chunks(batch) {
                let encoded: Result<Vec<R>, EncodeError> = parts
                    .par_iter()
                    .map(|part| {
                        let cells: Vec<u64> = part.clone().map(|i| group.cells.get(i)).collect();
                        let encoded = scratch
                            .with(|s| submesh::encode(input, &cells, variant, index_bits, s))?;
                        let before = num_encoded.fetch_add(cells.len(), Ordering::Relaxed);
                        tell(EncodeStage::Submeshes, before + cells.len());
                        Ok(finish(encoded))
                    })
                    .collect();
                for submesh in encoded? {
                    append(submesh)?;
                }
            }
            submeshes_secs += start.elapsed().as_secs_f64();
            Ok(())
        };
        let start = Instant::now();
        tell(EncodeStage::Partition, 0);
        let splitter = Splitter::new(input, index_bits, &split);
        let left_out = match &self.memory {
            Memory::All => {
                let (group, left_out) = splitter.split_all();
                encode_group(group)?;
                left_out
            }
            Memory::Cells(most, folder) => {
                let mut each = |group| encode_group(group).map_err(Stop::Other);
                let done = splitter.split_on_disk(*most, folder, &mut each);
                done.map_err(|stop| match stop {
                    Stop::Split(error) => EncodeError::from(error).into(),
                    Stop::Other(error) => error,
                })?
            }
        };
        let LeftOut {
            num_blanked,
            num_not_finite,
        } = left_out;
        Ok(EncodeReport {
            num_blanked,
            num_not_finite,
            worst_rounding: input.worst_rounding,
            partition_secs: start.elapsed().as_secs_f64() - submeshes_secs,
            submeshes_secs,
            ..EncodeReport::default()
        })
    }

    /// The tree over everything.
    pub fn outer_tree(
        &self,
        boxes: impl ExactSizeIterator<Item = ([f32; 3], [f32; 3])>,
    ) -> Result<Vec<outer::OuterNode>, EncodeError> {
        let actual = boxes.len();
        if actual > MAX_ITEMS {
            return Err(EncodeError::TooManyItems { actual });
        }
        let total = actual as u64;
        let stage = EncodeStage::Outer;
        let tell = |done| (self.observer)(EncodeProgress { stage, done, total });
        tell(0);
        let tree = outer::build(boxes);
        tell(total);
        Ok(tree)
    }
}

/// Why a split ended early.
enum Stop<E> {
    Split(SplitError),
    Other(E),
}

impl<E> From<SplitError> for Stop<E> {
    fn from(error: SplitError) -> Self {
        Self::Split(error)
    }
}

impl From<SplitError> for EncodeError {
    fn from(error: SplitError) -> Self {
        match error {
            SplitError::Io(error) => Self::Spill(error.to_string()),
            SplitError::PartTooLarge { cells, most } => Self::Budget { cells, most },
        }
    }
}

/// The common arrays while sub-meshes are added.
struct FlatArrays {
    submeshes: Vec<SubmeshHeader>,
    multi_leaves: Vec<MultiLeaf>,
    multi_nodes: Vec<crate::layout::MultiNode>,
    positions: Vec<[f32; 3]>,
    indices: Vec<u8>,
    clusters: Vec<ClusterHeader>,
    cluster_bits: Vec<u8>,
    position_blocks: Vec<PositionBlock>,
    position_bits: Vec<u8>,
    next: Places,
    map: PackMap,
    totals: LeafTotals,
}

impl FlatArrays {
    fn new(mesh: &UnstructuredMesh) -> Self {
        Self {
            submeshes: Vec::new(),
            multi_leaves: Vec::new(),
            multi_nodes: Vec::new(),
            positions: Vec::new(),
            indices: Vec::new(),
            clusters: Vec::new(),
            cluster_bits: Vec::new(),
            position_blocks: Vec::new(),
            position_bits: Vec::new(),
            next: Places::default(),
            map: PackMap {
                points: Ids::below(mesh.num_points() as u64, 0),
                cells: Ids::below(mesh.num_cells() as u64, 0),
            },
            totals: LeafTotals::default(),
        }
    }

    fn append(&mut self, submesh: EncodedSubmesh, index_bits: u32) {
        let mut header = submesh.header;
        header.first_vertex = self.map.points.len() as u64;
        header.first_index = self.indices.len() as u64 * 8 / u64::from(index_bits);
        if let Some(clusters) = submesh.clusters {
            header.first_index = self.clusters.len() as u64;
            self.next.put(&mut header);
            self.next = clusters.next_places(&header, self.next);
            self.clusters.extend(clusters.headers);
            self.cluster_bits.extend(clusters.bits);
            self.position_blocks.extend(clusters.position_blocks);
            self.position_bits.extend(clusters.position_bits);
        }
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
    fn multi_leaf_boxes(&self) -> impl ExactSizeIterator<Item = ([f32; 3], [f32; 3])> + '_ {
        let mut boxes = Vec::with_capacity(self.multi_leaves.len());
        for header in &self.submeshes {
            let first = header.first_node as usize;
            let nodes = &self.multi_leaves[first..first + header.num_nodes as usize];
            boxes.extend(multi_leaf_boxes(header, nodes));
        }
        boxes.into_iter()
    }

    fn finish(
        mut self,
        options: EncodeOptions,
        outer: Vec<outer::OuterNode>,
        report: EncodeReport,
    ) -> Encoded {
        let clusters = (options.variant == Variant::Small).then(|| {
            self.cluster_bits.extend([0; small::bits::PADDING]);
            self.position_bits.extend([0; small::bits::PADDING]);
            Clusters::new(
                Flat::from_vec(self.clusters),
                Flat::from_vec(self.cluster_bits),
                Flat::from_vec(self.position_blocks),
                Flat::from_vec(self.position_bits),
            )
        });
        if clusters.is_none() {
            self.indices.extend([0; PADDING]);
        }
        let nodes = match options.variant {
            Variant::MultiLeaves => Nodes::MultiLeaves(Flat::from_vec(self.multi_leaves)),
            _ => Nodes::MultiNodes(Flat::from_vec(self.multi_nodes)),
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
                clusters,
            },
            map: self.map,
            report,
        }
    }
}

/// Boxes of the multi-leaves of a sub-mesh as they decode.
pub(crate) fn multi_leaf_boxes(
    header: &SubmeshHeader,
    nodes: &[MultiLeaf],
) -> impl Iterator<Item = ([f32; 3], [f32; 3])> {
    let grid = Grid::of(header);
    nodes.iter().map(move |node| {
        let at =
            |q: [u16; 3]| grid.local_from_sixteenths(q.map(|q| CHILD_DIVISIONS * u32::from(q)));
        (at(node.lo).map(below), at(node.hi).map(above))
    })
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
