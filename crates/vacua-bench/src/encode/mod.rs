//! Tables 1, 2, 3 and 5 of paper B on this machine: what meshes take when they are encoded, by part,
//! how long that takes, and what OSPRay's layouts take of the same cells.
//!
//! Stand-ins of `vacua-synth` take the place of the paper's meshes, which are larger: figures compare
//! by the cell.

mod markdown;
mod measure;

pub(crate) use measure::check_memory;

use serde::{Deserialize, Serialize};
use vacua_synth::MeshKind;

use crate::cell::Cell;
use crate::error::BenchError;
use crate::machine::Machine;
use crate::meshes::{MeshSize, Scene};
use crate::skip::check_common;

/// What to measure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EncodeOptions {
    /// On which meshes.
    pub models: Vec<Scene>,
    /// How large.
    pub size: MeshSize,
    /// Runs of which the median counts.
    pub repeats: usize,
    /// Threads; all that the machine has if not given.
    pub threads: Option<usize>,
    /// Bits of an index for Table 2, which is measured on the first mesh.
    pub index_bits: Vec<u32>,
    /// Leaves out OSPRay's layouts.
    pub quick: bool,
}

impl Default for EncodeOptions {
    fn default() -> Self {
        use MeshKind::{Delaunay, Hex150, Jets, Lander, Ocean, Octree, Tet100};
        Self {
            models: [Tet100, Hex150, Jets, Lander, Ocean, Octree, Delaunay]
                .map(Scene)
                .into(),
            size: MeshSize {
                scale: 1.0,
                cells: None,
                shuffled: true,
            },
            repeats: 3,
            threads: None,
            index_bits: vec![32, 20, 16, 14, 12, 10, 8],
            quick: false,
        }
    }
}

impl EncodeOptions {
    /// What `--quick` stands for.
    pub fn quick() -> Self {
        Self {
            models: [MeshKind::Tet100, MeshKind::Hex150].map(Scene).into(),
            size: MeshSize {
                scale: 0.3,
                ..Self::default().size
            },
            repeats: 1,
            index_bits: vec![32, 16, 12],
            quick: true,
            ..Self::default()
        }
    }

    fn check(&self) -> Result<(), BenchError> {
        check_common(self.size.scale, self.repeats, self.threads, &[1])?;
        if self.models.is_empty() {
            return Err(BenchError::Option {
                option: "models",
                actual: "empty".to_owned(),
                expected: "one mesh or more",
            });
        }
        if let Some(bits) = self.index_bits.iter().find(|b| !(8..=32).contains(*b)) {
            return Err(BenchError::Option {
                option: "index bits",
                actual: bits.to_string(),
                expected: "8 to 32",
            });
        }
        Ok(())
    }
}

/// Bytes of the parts of an encoded mesh.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PackedParts {
    /// Positions of vertices.
    pub positions: u64,
    /// Values of vertices.
    pub values: u64,
    /// Indices.
    pub indices: u64,
    /// Multi-leaves or multi-nodes.
    pub nodes: u64,
    /// The tree above them.
    pub outer: u64,
    /// Headers of sub-meshes.
    pub headers: u64,
    /// Ranges of values.
    pub ranges: u64,
    /// The map to the original order, which is not part of the sum.
    pub map: u64,
}

impl PackedParts {
    /// The sum, without the map.
    pub fn total(&self) -> u64 {
        self.positions
            + self.values
            + self.indices
            + self.nodes
            + self.outer
            + self.headers
            + self.ranges
    }
}

/// One variant of one mesh.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct VariantResult {
    /// 1, multi-leaves; 2, multi-nodes.
    pub variant: String,
    /// Vertices, replicated ones included.
    pub vertices: Cell<u64>,
    /// Sub-meshes.
    pub submeshes: Cell<u64>,
    /// Multi-leaves or multi-nodes.
    pub nodes: Cell<u64>,
    /// Bytes by part.
    pub parts: Option<PackedParts>,
    /// Bytes a cell, all but the map.
    pub bytes_per_cell: Cell<f64>,
    /// Median seconds to encode and to bring the field along.
    pub secs: Cell<f64>,
    /// Cells a second.
    pub cells_per_sec: Cell<f64>,
    /// Cells a second of a core, by the clock of the process's threads.
    pub cells_per_core_sec: Cell<f64>,
    /// Bytes a cell to stay within.
    pub target_bytes_per_cell: Option<f64>,
    /// Bytes a cell of the paper's model.
    pub paper_bytes_per_cell: Option<f64>,
}

/// One uncompressed layout of one mesh.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LayoutResult {
    /// Its name.
    pub name: String,
    /// Bytes by part.
    pub parts: Vec<(String, u64)>,
    /// Bytes of all parts.
    pub bytes: Cell<u64>,
    /// Bytes a cell.
    pub bytes_per_cell: Cell<f64>,
    /// Bytes over those of variant 2.
    pub ratio: Cell<f64>,
    /// Bytes a cell of the paper's model.
    pub paper_bytes_per_cell: Option<f64>,
    /// Bytes over those of variant 2 there.
    pub paper_ratio: Option<f64>,
}

/// One mesh.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelResult {
    /// Which.
    pub model: Scene,
    /// Cells a side, about.
    pub size: usize,
    /// The paper's model that it is compared with.
    pub paper_model: String,
    /// Points.
    pub points: Cell<u64>,
    /// Tetrahedra, pyramids, wedges and hexahedra.
    pub cells: [u64; 4],
    /// Variants 1 and 2.
    pub variants: Vec<VariantResult>,
    /// OSPRay's layouts.
    pub layouts: Vec<LayoutResult>,
}

/// One number of index bits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BitsResult {
    /// Bits of an index.
    pub bits: u32,
    /// Sub-meshes.
    pub groups: Cell<u64>,
    /// Cells a sub-mesh.
    pub cells_per_group: Cell<f64>,
    /// Vertices a sub-mesh.
    pub vertices_per_group: Cell<f64>,
    /// Vertices, replicated ones included.
    pub vertices: Cell<u64>,
    /// The same over those of the mesh.
    pub replication: Cell<f64>,
    /// Vertices (16 bytes each) and indices, bytes a cell.
    pub bytes_per_cell: Cell<f64>,
    /// All but the map, bytes a cell.
    pub total_bytes_per_cell: Cell<f64>,
    /// Seconds to encode.
    pub secs: Cell<f64>,
}

/// What was measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EncodeResults {
    /// Where and when.
    pub machine: Machine,
    /// How.
    pub options: EncodeOptions,
    /// Tables 1, 3 and 5, mesh by mesh.
    pub models: Vec<ModelResult>,
    /// Table 2.
    pub index_bits: Vec<BitsResult>,
}

impl EncodeResults {
    /// The tables for people.
    pub fn markdown(&self) -> String {
        markdown::all(self)
    }
}

/// Measures all tables.
///
/// # Errors
/// [`BenchError::Option`] and [`BenchError::Threads`]; all else is said in the cells that it empties.
pub fn run(options: &EncodeOptions) -> Result<EncodeResults, BenchError> {
    options.check()?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(options.threads.unwrap_or(0))
        .build()?;
    Ok(pool.install(|| EncodeResults {
        machine: Machine::describe(rayon::current_num_threads()),
        options: options.clone(),
        models: options
            .models
            .iter()
            .map(|&model| measure::model(model, options))
            .collect(),
        index_bits: measure::index_bits(options),
    }))
}
