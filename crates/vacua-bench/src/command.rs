//! The subcommands of `vacua bench`, the same as those of `vacua-bench`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use serde::Serialize;
use vacua_gpu::DeviceChoice;
use vacua_synth::{Kind, MeshKind, parse_size};

use crate::auto::{self, AutoOptions};
use crate::encode::{self, EncodeOptions};
use crate::gpu::{self, GpuMethod, GpuOptions};
use crate::gpu_mesh::{self, GpuMeshOptions, MeshChoice};
use crate::gpu_reference::{self, GpuReferenceOptions};
use crate::meshes::{MeshSize, Scene};
use crate::render::{self, RenderOptions};
use crate::sample::{self, SampleOptions, Share, shares_of_tables};
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
        /// Ways to skip, besides none: grid, mesh, query, packets, boxes, auto.
        #[arg(long, value_delimiter = ',', default_value = "grid,auto")]
        methods: Vec<GpuMethod>,
        /// Measures how acceleration structures over the boundary are built.
        #[arg(long)]
        structures: bool,
        /// Measures gradient shading too.
        #[arg(long)]
        shaded: bool,
        /// Packed meshes to measure on instead, as tet100 or hex150:300 (a kind and its size).
        #[arg(long, value_delimiter = ',')]
        meshes: Vec<MeshChoice>,
        /// Takes points and cells of meshes in random order.
        #[arg(long)]
        shuffled: bool,
        /// Measures rays that search meshes on their own too.
        #[arg(long)]
        alone: bool,
        /// Measures meshes of multi-leaves under an acceleration structure (variant 1) too.
        #[arg(long)]
        leaves: bool,
        /// Paper B's Tables 3, 4 and 6 instead: meshes in the encodings that it compares.
        #[arg(long, requires = "meshes")]
        references: bool,
        /// The first I of N equal parts of the first mesh, instead of those of Tables 4 and 6.
        #[arg(
            long,
            value_name = "I/N",
            value_delimiter = ',',
            requires = "references"
        )]
        part: Option<Vec<Share>>,
        /// Random places of meshes that are sampled at once; 0 for none.
        #[arg(long, default_value = "4000000")]
        places: usize,
        /// Folder for pictures.
        #[arg(long)]
        pictures: Option<PathBuf>,
        /// What all take.
        #[command(flatten)]
        common: Common,
    },
    /// Tables 1, 2, 3 and 5 of paper B: bytes a cell by part, encoding times, OSPRay's layouts.
    Encode {
        /// Bits of an index for Table 2, 8 to 32.
        #[arg(long, value_delimiter = ',')]
        index_bits: Option<Vec<u32>>,
        /// Which meshes.
        #[command(flatten)]
        meshes: Meshes,
        /// What all take.
        #[command(flatten)]
        common: Common,
    },
    /// Samples a second, pictures, and Tables 4 and 6 of paper B: the packed form and its rivals.
    Sample {
        /// The first I of N equal parts of the first mesh, instead of those of Tables 4 and 6.
        #[arg(long, value_name = "I/N", value_delimiter = ',')]
        part: Option<Vec<Share>>,
        /// Random places, and places in Morton order.
        #[arg(long)]
        places: Option<usize>,
        /// Which meshes.
        #[command(flatten)]
        meshes: Meshes,
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

/// Meshes to measure on.
#[derive(Args, Debug)]
pub struct Meshes {
    /// tet100, hex150, jets, delaunay, lander, ocean, octree.
    #[arg(long, value_delimiter = ',')]
    models: Vec<MeshKind>,
    /// Cells a side of every mesh, about; instead of --scale.
    #[arg(long)]
    cells: Option<usize>,
    /// Points and cells in the order in which they are made, not shuffled.
    #[arg(long)]
    in_order: bool,
}

impl Meshes {
    fn models(&self, default: Vec<Scene>) -> Vec<Scene> {
        if self.models.is_empty() {
            return default;
        }
        self.models.iter().copied().map(Scene).collect()
    }

    fn size(&self, scale: Option<f64>, default: MeshSize) -> MeshSize {
        MeshSize {
            scale: scale.unwrap_or(default.scale),
            cells: self.cells,
            shuffled: !self.in_order,
        }
    }
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
        Command::Encode {
            index_bits,
            meshes,
            common,
        } => run_encode(index_bits, &meshes, common),
        Command::Sample {
            part,
            places,
            meshes,
            common,
        } => run_sample(part, places, &meshes, common),
        Command::Gpu {
            device,
            meshes,
            shuffled,
            references: true,
            part,
            places,
            common,
            ..
        } => gpu_reference::run(&GpuReferenceOptions {
            device,
            meshes,
            shuffled,
            size: common.size.unwrap_or((1024, 1024)),
            repeats: common.repeats.unwrap_or(10),
            places,
            shares: part.unwrap_or_else(shares_of_tables),
        })
        .map_err(Into::into)
        .and_then(|results| text(&results, common.json, || results.markdown())),
        Command::Gpu {
            device,
            meshes,
            shuffled,
            shaded,
            alone,
            leaves,
            places,
            pictures,
            common,
            ..
        } if !meshes.is_empty() => gpu_mesh::run(&GpuMeshOptions {
            device,
            meshes,
            shuffled,
            size: common.size.unwrap_or((1024, 1024)),
            repeats: common.repeats.unwrap_or(10),
            sides: common.sides.unwrap_or(vec![2, 4, 8]),
            shaded,
            alone,
            leaves,
            places,
            pictures,
        })
        .map_err(Into::into)
        .and_then(|results| text(&results, common.json, || results.markdown())),
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
            ..
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

fn run_encode(index_bits: Option<Vec<u32>>, meshes: &Meshes, common: Common) -> Outcome {
    let defaults = if common.quick {
        EncodeOptions::quick()
    } else {
        EncodeOptions::default()
    };
    let results = encode::run(&EncodeOptions {
        models: meshes.models(defaults.models),
        size: meshes.size(common.scale, defaults.size),
        repeats: common.repeats.unwrap_or(defaults.repeats),
        threads: common.threads,
        index_bits: index_bits.unwrap_or(defaults.index_bits),
        quick: common.quick,
    })?;
    text(&results, common.json, || results.markdown())
}

fn run_sample(
    part: Option<Vec<Share>>,
    places: Option<usize>,
    meshes: &Meshes,
    common: Common,
) -> Outcome {
    let defaults = if common.quick {
        SampleOptions::quick()
    } else {
        SampleOptions::default()
    };
    let results = sample::run(&SampleOptions {
        models: meshes.models(defaults.models),
        size: meshes.size(common.scale, defaults.size),
        pixels: common.size.map_or(defaults.pixels, |(width, _)| width),
        places: places.unwrap_or(defaults.places),
        repeats: common.repeats.unwrap_or(defaults.repeats),
        threads: common.threads,
        shares: part.unwrap_or(defaults.shares),
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
