//! Tables 4 and 6 of paper B and the project's sampling targets on this machine: samples a second in
//! ray order, at random and in Morton order, pictures and bytes, of the packed form and of what it is
//! compared with.
//!
//! All take turns: each run measures every one of them once, and the median of the runs counts. Beside
//! it stands what a core does, by the clock of the process's threads, which other work on the machine
//! changes little.
//! Pictures here come from one plain integrator without skipping, the same for all ("all evaluations in
//! our own, thus guaranteeing all variants to use the exact same samples", §6.3); frames of the
//! renderer, with and without skipping, stand beside those of the packed form.

pub(crate) mod markdown;
mod measure;
mod orders;
pub(crate) mod parts;
mod peers;
mod picture;

pub use orders::Order;
pub use picture::{Picture, Rays, Tile};

use serde::{Deserialize, Serialize};
use vacua_synth::MeshKind;

use crate::cell::Cell;
use crate::error::BenchError;
use crate::machine::Machine;
use crate::meshes::{MeshSize, Scene};
use crate::paper_b;
use crate::skip::check_common;

/// So many parts of a mesh out of so many equal ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Share {
    /// How many are taken, from the first on.
    pub part: usize,
    /// How many there are.
    pub of: usize,
}

impl std::str::FromStr for Share {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once('/');
        let share = numbers.and_then(|(part, of)| {
            let (part, of) = (part.parse().ok()?, of.parse().ok()?);
            Some(Self { part, of })
        });
        let is_share = |s: &Self| (1..=s.of).contains(&s.part) && s.of <= 4096;
        share
            .filter(is_share)
            .ok_or_else(|| format!("`{text}` is no share, expected as 3/8"))
    }
}

/// What to measure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SampleOptions {
    /// On which meshes.
    pub models: Vec<Scene>,
    /// How large.
    pub size: MeshSize,
    /// Pixels a side of pictures, and of the rays that ray order is made of.
    pub pixels: usize,
    /// Random places, and places in Morton order.
    pub places: usize,
    /// Runs of which the median counts.
    pub repeats: usize,
    /// Threads; all that the machine has if not given.
    pub threads: Option<usize>,
    /// Shares of the first mesh for Tables 4 and 6.
    pub shares: Vec<Share>,
    /// Leaves out the layouts of OSPRay, and frames of the renderer.
    pub quick: bool,
}

/// The shares of Tables 4 and 6.
pub(crate) fn shares_of_tables() -> Vec<Share> {
    let table_6 = (1..=paper_b::TABLE_6_SHARES).map(|part| Share {
        part,
        of: paper_b::TABLE_6_SHARES,
    });
    let table_4 = paper_b::TABLE_4.map(|(part, ..)| Share {
        part,
        of: paper_b::TABLE_4_SHARES,
    });
    table_4.into_iter().chain(table_6).collect()
}

impl Default for SampleOptions {
    fn default() -> Self {
        Self {
            models: [MeshKind::Tet100, MeshKind::Hex150].map(Scene).into(),
            size: MeshSize {
                scale: 1.0,
                cells: None,
                shuffled: true,
            },
            pixels: 512,
            places: 1 << 20,
            repeats: 5,
            threads: None,
            shares: shares_of_tables(),
            quick: false,
        }
    }
}

impl SampleOptions {
    /// What `--quick` stands for.
    pub fn quick() -> Self {
        Self {
            size: MeshSize {
                scale: 0.3,
                ..Self::default().size
            },
            pixels: 96,
            places: 1 << 17,
            repeats: 3,
            shares: vec![Share { part: 4, of: 8 }],
            quick: true,
            ..Self::default()
        }
    }

    fn check(&self) -> Result<(), BenchError> {
        check_common(self.size.scale, self.repeats, self.threads, &[1])?;
        let error = |option, actual: usize, expected| {
            Err(BenchError::Option {
                option,
                actual: actual.to_string(),
                expected,
            })
        };
        if self.models.is_empty() {
            return error("models", 0, "one mesh or more");
        }
        if !(1..=1 << 14).contains(&self.pixels) {
            return error("pixels", self.pixels, "1 to 16384");
        }
        if !(1..=1 << 28).contains(&self.places) {
            return error("places", self.places, "1 to 268435456");
        }
        Ok(())
    }
}

/// How fast samples come.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rate {
    /// In which order.
    pub order: Order,
    /// Samples a second: all threads, median of the runs.
    pub samples_per_sec: Cell<f64>,
    /// Samples a second of a core, by the clock of the process's threads: median.
    pub samples_per_core_sec: Cell<f64>,
}

/// One way to hold a mesh.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PeerResult {
    /// Its name.
    pub name: String,
    /// Bytes by part, values and ranges counted.
    pub parts: Vec<(String, u64)>,
    /// Bytes a cell.
    pub bytes_per_cell: Cell<f64>,
    /// Seconds to build.
    pub build_secs: Cell<f64>,
    /// Samples a second, order by order.
    pub rates: Vec<Rate>,
    /// Seconds for a picture.
    pub picture_secs: Cell<f64>,
    /// The same of all threads together.
    pub picture_core_secs: Cell<f64>,
    /// The largest difference of a channel to the first peer's picture.
    pub picture_difference: Cell<f64>,
}

/// One frame of the renderer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameResult {
    /// How empty space is skipped.
    pub skip: String,
    /// Samples evaluated.
    pub samples: Cell<u64>,
    /// Median seconds.
    pub secs: Cell<f64>,
    /// The same of all threads together.
    pub core_secs: Cell<f64>,
}

/// One mesh.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneResult {
    /// Which.
    pub model: Scene,
    /// Cells a side, about.
    pub size: usize,
    /// Its cells.
    pub cells: Cell<u64>,
    /// Samples of a picture.
    pub samples: u64,
    /// Packed variants and references.
    pub peers: Vec<PeerResult>,
    /// Frames of the renderer, packed variant 2.
    pub frames: Vec<FrameResult>,
}

/// One way to hold a part of a mesh.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SharePeer {
    /// Its name.
    pub name: String,
    /// Bytes.
    pub bytes: Cell<u64>,
    /// Bytes over those of the packed form.
    pub ratio: Cell<f64>,
    /// Seconds for a picture.
    pub secs: Cell<f64>,
    /// The same of all threads together.
    pub core_secs: Cell<f64>,
}

/// A part of a mesh.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShareResult {
    /// Which part.
    pub share: Share,
    /// Its cells.
    pub cells: Cell<u64>,
    /// The packed form, user geometry, shared faces and tet marching.
    pub peers: Vec<SharePeer>,
}

/// What was measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SampleResults {
    /// Where and when.
    pub machine: Machine,
    /// How.
    pub options: SampleOptions,
    /// Mesh by mesh.
    pub scenes: Vec<SceneResult>,
    /// Tables 4 and 6, of the first mesh.
    pub shares: Vec<ShareResult>,
}

impl SampleResults {
    /// The tables for people.
    pub fn markdown(&self) -> String {
        markdown::all(self)
    }
}

/// Measures all tables.
///
/// # Errors
/// [`BenchError::Option`] and [`BenchError::Threads`]; all else is said in the cells that it empties.
pub fn run(options: &SampleOptions) -> Result<SampleResults, BenchError> {
    options.check()?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(options.threads.unwrap_or(0))
        .build()?;
    Ok(pool.install(|| SampleResults {
        machine: Machine::describe(rayon::current_num_threads()),
        options: options.clone(),
        scenes: options
            .models
            .iter()
            .map(|&model| measure::scene(model, options))
            .collect(),
        shares: parts::all(options),
    }))
}
