//! The subcommands: `vacua bench skip`, `auto`, `render` and `gpu`, the same as those of `vacua-bench`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use serde::Serialize;
use vacua_gpu::DeviceChoice;
use vacua_synth::{Kind, parse_size};

use crate::auto::{self, AutoOptions};
use crate::gpu::{self, GpuMethod, GpuOptions};
use crate::render::{self, RenderOptions};
use crate::skip::{self, Model, SkipOptions};

/// What to measure.
#[derive(Subcommand, Debug)]
pub enum Command {
    /// Tables 1 to 4 of paper A: rebuild times and frames per second, each beside the paper's.
    Skip {
        /// Volumes to measure on: heptane, flower, dns, llnl; all if none are named.
        #[arg(long, value_delimiter = ',')]
        models: Vec<Model>,
        /// Measure on a GPU: gpu, or gpu:N. On the CPU if not given.
        #[arg(long)]
        device: Option<DeviceChoice>,
        /// What all take.
        #[command(flatten)]
        common: Common,
    },
    /// First pictures of many scenes, with `auto` and with every fixed choice.
    Auto {
        /// Points a side of every volume.
        #[arg(long, default_value = "256")]
        points: usize,
        /// What all take.
        #[command(flatten)]
        common: Common,
    },
    /// Skipping on a GPU: frames by method and macrocell size, and edits of the transfer function.
    Gpu {
        /// gpu, gpu:N, or gpu:all to measure several devices together too.
        #[arg(long, default_value = "gpu")]
        device: DeviceChoice,
        /// Volumes to measure on.
        #[arg(long, value_delimiter = ',', default_value = "blobs")]
        kinds: Vec<Kind>,
        /// Points a side, as 1024 or 512x256x64; each volume's own by default.
        #[arg(long, value_parser = parse_size)]
        points: Option<[usize; 3]>,
        /// Reaches of the distance map.
        #[arg(long, value_delimiter = ',', default_value = "1,16")]
        reaches: Vec<u8>,
        /// Ways to skip, besides none: grid, mesh, query, boxes, auto.
        #[arg(long, value_delimiter = ',', default_value = "grid,auto")]
        methods: Vec<GpuMethod>,
        /// Measures how acceleration structures over the boundary are built.
        #[arg(long)]
        structures: bool,
        /// Measures gradient shading too.
        #[arg(long)]
        shaded: bool,
        /// Folder for pictures.
        #[arg(long)]
        pictures: Option<PathBuf>,
        /// What all take.
        #[command(flatten)]
        common: Common,
    },
    /// The benchmark scene with every method, macrocells a second, transfer-function edits.
    Render {
        /// What all take.
        #[command(flatten)]
        common: Common,
    },
}

/// What all take; defaults depend on `--quick`.
#[derive(Args, Debug)]
pub struct Common {
    /// Print JSON instead of tables.
    #[arg(long)]
    json: bool,
    /// Small pictures and volumes, and not every cell.
    #[arg(long)]
    quick: bool,
    /// Part of the full sizes a side, above 0 and at most 1.
    #[arg(long)]
    scale: Option<f64>,
    /// Picture size in pixels, as 1920x1080.
    #[arg(long, value_parser = size)]
    size: Option<(usize, usize)>,
    /// Runs of which the median counts.
    #[arg(long)]
    repeats: Option<usize>,
    /// Threads; all that the machine has by default.
    #[arg(long)]
    threads: Option<usize>,
    /// Cells a side of a macrocell, as 8,16,32.
    #[arg(long, value_delimiter = ',')]
    sides: Option<Vec<usize>>,
}

fn size(text: &str) -> Result<(usize, usize), String> {
    let sides = text.split_once('x');
    let sides = sides.and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    sides.ok_or_else(|| format!("`{text}` is no size, expected as 1920x1080"))
}

/// Measures, and gives tables or JSON.
///
/// # Errors
/// If it cannot be measured at all; what fails for one cell of a table is said in that cell.
pub fn run(command: Command) -> Outcome {
    match command {
        Command::Skip {
            models,
            device,
            common,
        } => run_skip(models, device, common),
        Command::Auto { points, common } => run_auto(points, common),
        Command::Render { common } => run_render(common),
        Command::Gpu {
            device,
            kinds,
            points,
            reaches,
            methods,
            structures,
            shaded,
            pictures,
            common,
        } => gpu::run(&GpuOptions {
            device,
            kinds,
            points,
            size: common.size.unwrap_or((3840, 2160)),
            repeats: common.repeats.unwrap_or(10),
            sides: common.sides.unwrap_or(vec![8, 16]),
            reaches,
            methods,
            structures,
            shaded,
            pictures,
        })
        .map_err(Into::into)
        .and_then(|results| text(&results, common.json, || results.markdown())),
    }
}

/// Text to print.
type Outcome = Result<String, Box<dyn std::error::Error + Send + Sync>>;

fn run_skip(models: Vec<Model>, device: Option<DeviceChoice>, common: Common) -> Outcome {
    let defaults = if common.quick {
        SkipOptions::quick()
    } else {
        SkipOptions::default()
    };
    let results = skip::run(&SkipOptions {
        scale: common.scale.unwrap_or(defaults.scale),
        size: common.size.unwrap_or(defaults.size),
        repeats: common.repeats.unwrap_or(defaults.repeats),
        threads: common.threads,
        sides: common.sides.unwrap_or(defaults.sides),
        models: if models.is_empty() {
            defaults.models
        } else {
            models
        },
        quick: common.quick,
        device,
    })?;
    text(&results, common.json, || results.markdown())
}

fn run_auto(points: usize, common: Common) -> Outcome {
    let defaults = AutoOptions::default();
    let results = auto::run(&AutoOptions {
        points,
        size: common.size.unwrap_or(defaults.size),
        repeats: common.repeats.unwrap_or(defaults.repeats),
        threads: common.threads,
    })?;
    text(&results, common.json, || results.markdown())
}

fn run_render(common: Common) -> Outcome {
    let defaults = if common.quick {
        RenderOptions::quick()
    } else {
        RenderOptions::default()
    };
    let results = render::run(&RenderOptions {
        scale: common.scale.unwrap_or(defaults.scale),
        size: common.size.unwrap_or(defaults.size),
        repeats: common.repeats.unwrap_or(defaults.repeats),
        threads: common.threads,
        sides: common.sides.unwrap_or(defaults.sides),
        quick: common.quick,
    })?;
    text(&results, common.json, || results.markdown())
}

fn text(results: &impl Serialize, json: bool, markdown: impl FnOnce() -> String) -> Outcome {
    Ok(if json {
        serde_json::to_string_pretty(results)?
    } else {
        markdown()
    })
}
