//! `vacua-bench skip` and `vacua-bench render`: the tables on this machine.

use std::io::Write;
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};
use serde::Serialize;
use vacua_bench::auto::{self, AutoOptions};
use vacua_bench::render::{self, RenderOptions};
use vacua_bench::skip::{self, Model, SkipOptions};

/// The tables of the papers, regenerated on this machine.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Tables 1 to 4 of paper A: rebuild times and frames per second, each beside the paper's.
    Skip {
        /// Volumes to measure on: heptane, flower, dns, llnl; all if none are named.
        #[arg(long, value_delimiter = ',')]
        models: Vec<Model>,
        #[command(flatten)]
        common: Common,
    },
    /// First pictures of many scenes, with `auto` and with every fixed choice.
    Auto {
        /// Points a side of every volume.
        #[arg(long, default_value = "256")]
        points: usize,
        #[command(flatten)]
        common: Common,
    },
    /// The benchmark scene with every method, macrocells a second, transfer-function edits.
    Render {
        #[command(flatten)]
        common: Common,
    },
}

/// What both take; defaults depend on `--quick`.
#[derive(Args)]
struct Common {
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

fn main() -> ExitCode {
    let Arguments { command } = Arguments::parse();
    let outcome = match command {
        Command::Skip { models, common } => run_skip(models, common),
        Command::Auto { points, common } => run_auto(points, common),
        Command::Render { common } => run_render(common),
    };
    let written = outcome.and_then(|text| Ok(writeln!(std::io::stdout(), "{text}")?));
    match written {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            // There is nobody left to tell if this fails.
            let _ = writeln!(std::io::stderr(), "error: {e}");
            ExitCode::FAILURE
        }
    }
}

type Outcome = Result<String, Box<dyn std::error::Error>>;

fn run_skip(models: Vec<Model>, common: Common) -> Outcome {
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
