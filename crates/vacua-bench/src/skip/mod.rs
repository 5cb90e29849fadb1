//! Tables 1 to 4 of paper A on this machine.
//!
//! Stand-ins of `vacua-synth` take the place of the paper's volumes. At scale 1 they have its sizes;
//! at a smaller scale S, macrocells of K cells cover as much of the object as macrocells of K / S
//! do in the paper, so that counts compare at scale 1 only, and shares between rows.

mod device;
mod markdown;
mod measure;

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use vacua_gpu::{DeviceChoice, GpuRenderer};
use vacua_render::SkipMethod;
use vacua_synth::Kind;

use crate::cell::Cell;
use crate::error::BenchError;
use crate::machine::Machine;
use crate::paper::{self, PaperBuild};
pub use crate::volumes::StageTimes;

/// A volume of the paper's evaluation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Model {
    /// HEPTANE, 302³.
    Heptane,
    /// FLOWER, 1024³.
    Flower,
    /// DNS(4X), 2560 × 1920 × 384.
    Dns,
    /// LLNL, 2048 × 2048 × 1920.
    Llnl,
}

impl Model {
    /// All four, in the paper's order.
    pub const ALL: [Self; 4] = [Self::Heptane, Self::Flower, Self::Dns, Self::Llnl];

    /// The stand-in.
    pub const fn kind(self) -> Kind {
        match self {
            Self::Heptane => Kind::Heptane,
            Self::Flower => Kind::Flower,
            Self::Dns => Kind::Dns,
            Self::Llnl => Kind::Llnl,
        }
    }
}

impl fmt::Display for Model {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.kind().name())
    }
}

impl FromStr for Model {
    type Err = BenchError;

    fn from_str(name: &str) -> Result<Self, BenchError> {
        let model = Self::ALL.into_iter().find(|m| m.kind().name() == name);
        model.ok_or_else(|| BenchError::Model {
            asked: name.to_owned(),
        })
    }
}

/// A way to skip empty space, or none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// Not at all: the paper's base.
    None,
    /// Clustered boxes: the paper's "Ganter".
    Boxes,
    /// The boundary mesh: the paper's "Ours".
    Mesh,
    /// The walk over the mask, which the paper does not have.
    Grid,
}

impl Method {
    /// Those that skip.
    pub const SKIPPING: [Self; 3] = [Self::Boxes, Self::Mesh, Self::Grid];

    /// The renderer's method.
    pub const fn skip(self) -> SkipMethod {
        match self {
            Self::None => SkipMethod::None,
            Self::Boxes => SkipMethod::Boxes,
            Self::Mesh => SkipMethod::Mesh,
            Self::Grid => SkipMethod::Grid,
        }
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        self.skip().name()
    }
}

/// What to measure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SkipOptions {
    /// Part of the paper's sizes a side, above 0 and at most 1.
    pub scale: f64,
    /// Pixels a row and rows.
    pub size: (usize, usize),
    /// Runs of which the median counts, after one that does not.
    pub repeats: usize,
    /// Threads; all that the machine has if not given.
    pub threads: Option<usize>,
    /// Cells a side of a macrocell.
    pub sides: Vec<usize>,
    /// Which volumes.
    pub models: Vec<Model>,
    /// Leaves out four rays a pixel.
    pub quick: bool,
    /// On which GPU; on the CPU if not given.
    #[serde(skip)]
    pub device: Option<DeviceChoice>,
}

impl Default for SkipOptions {
    fn default() -> Self {
        Self {
            scale: 0.5,
            size: (3840, 2160),
            repeats: 3,
            threads: None,
            sides: vec![8, 16, 32],
            models: Model::ALL.to_vec(),
            quick: false,
            device: None,
        }
    }
}

impl SkipOptions {
    /// A quarter of the paper's sizes, small pictures, one ray a pixel.
    pub fn quick() -> Self {
        Self {
            scale: 0.25,
            size: (960, 540),
            quick: true,
            ..Self::default()
        }
    }

    fn check(&self) -> Result<(), BenchError> {
        check_common(self.scale, self.repeats, self.threads, &self.sides)?;
        if self.models.is_empty() {
            return Err(BenchError::Option {
                option: "models",
                actual: "empty".to_owned(),
                expected: "one model or more",
            });
        }
        Ok(())
    }
}

/// Checks what all benchmarks are told.
pub(crate) fn check_common(
    scale: f64,
    repeats: usize,
    threads: Option<usize>,
    sides: &[usize],
) -> Result<(), BenchError> {
    let error = |option, actual: String, expected| {
        Err(BenchError::Option {
            option,
            actual,
            expected,
        })
    };
    if !(scale > 0.0 && scale <= 1.0) {
        return error("scale", scale.to_string(), "above 0 and at most 1");
    }
    if repeats == 0 {
        return error("repeats", "0".to_owned(), "1 or more");
    }
    if threads == Some(0) {
        return error("threads", "0".to_owned(), "1 or more");
    }
    if sides.is_empty() || sides.contains(&0) {
        return error(
            "sides",
            format!("{sides:?}"),
            "one or more, each at least 1",
        );
    }
    Ok(())
}

/// What was measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SkipResults {
    /// Where and when.
    pub machine: Machine,
    /// Name of the GPU; none for the CPU.
    pub device: Option<String>,
    /// How.
    pub options: SkipOptions,
    /// Macrocell side of Table 4.
    pub rebuild_side: usize,
    /// One entry a model, in the order asked for.
    pub models: Vec<ModelResult>,
}

/// Everything about one volume.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelResult {
    /// Which.
    pub model: Model,
    /// Points a side, as measured.
    pub points: [usize; 3],
    /// Bytes of its voxels.
    pub bytes: u64,
    /// Tables 1 and 2: one entry a macrocell side.
    pub builds: Vec<BuildResult>,
    /// Tables 3 and 4: one entry a cell.
    pub frames: Vec<FrameResult>,
}

/// Rows of Tables 1 and 2.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BuildResult {
    /// Cells a side of a macrocell.
    pub side: usize,
    /// Macrocells.
    pub macrocells: Cell<u64>,
    /// Active macrocells.
    pub active: Cell<u64>,
    /// Boundary triangles.
    pub triangles: Cell<u64>,
    /// Clustered boxes.
    pub boxes_count: Cell<u64>,
    /// Seconds to compute the macrocells, once a volume.
    pub macrocell_secs: Cell<f64>,
    /// Table 1.
    pub mesh: StageTimes,
    /// Table 2.
    pub boxes: StageTimes,
    /// The same for the walk over the mask.
    pub grid: StageTimes,
    /// What the paper has.
    pub paper: Option<PaperBuild>,
}

/// A cell of Table 3 or 4.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameResult {
    /// How empty space was skipped.
    pub method: Method,
    /// Cells a side of a macrocell, if there were any.
    pub side: Option<usize>,
    /// Rays a pixel.
    pub rays_per_pixel: u32,
    /// Whether the transfer function was edited before each frame.
    pub rebuilt: bool,
    /// Seconds a frame, as a caller sees it.
    pub secs: Cell<f64>,
    /// Samples evaluated a frame.
    pub samples: Cell<u64>,
    /// Frames per second in the paper's Table 3.
    pub paper_table3_fps: Option<f64>,
    /// Frames per second in the paper's Table 4.
    pub paper_table4_fps: Option<f64>,
}

impl SkipResults {
    /// Tables 1 to 4, each figure followed by the paper's in brackets.
    pub fn markdown(&self) -> String {
        markdown::all(self)
    }
}

/// Measures everything.
///
/// What fails for one volume or one cell (most often for want of memory) is said in the cells that
/// stay empty.
///
/// # Errors
/// [`BenchError::Option`] if an option is out of range, [`BenchError::Threads`].
pub fn run(options: &SkipOptions) -> Result<SkipResults, BenchError> {
    options.check()?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(options.threads.unwrap_or(0))
        .build()?;
    let machine = Machine::describe(pool.current_num_threads());
    let middle = options.sides[options.sides.len() / 2];
    let default = options.sides.contains(&paper::DEFAULT_SIDE);
    let rebuild_side = if default { paper::DEFAULT_SIDE } else { middle };
    let models = options.models.iter();
    let models = models
        .map(|&model| measure::model(model, options, rebuild_side, &pool))
        .collect();
    let device = match options.device {
        Some(choice) => Some(GpuRenderer::new(choice)?.device().name().to_owned()),
        None => None,
    };
    Ok(SkipResults {
        machine,
        device,
        options: options.clone(),
        rebuild_side,
        models,
    })
}
