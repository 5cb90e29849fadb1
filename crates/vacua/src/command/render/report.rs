//! What `vacua render --json` prints.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;
use vacua::Backend;
use vacua::gpu::GpuRenderer;
use vacua_render::{Rendering, Scene};

use super::{RenderArgs, SkipChoice};
use crate::command::output::peak_bytes;

/// How a picture came to be. All times are in seconds.
#[derive(Serialize)]
pub struct Report {
    file: String,
    output: String,
    field: String,
    width: usize,
    height: usize,
    /// Distance between samples, in cells.
    step: f64,
    /// Values that the colours span.
    color_range: [f64; 2],
    load_secs: f64,
    build_secs: BuildSecs,
    frame_secs: FrameSecs,
    /// Frames that were timed.
    frames: usize,
    /// Samples evaluated for one frame.
    samples: u64,
    skip: Skip,
    pub lod: Lod,
    /// `cpu`, or `gpu:N` and the name of the device.
    device: String,
    /// Why the CPU renders, if a GPU was looked for.
    device_reason: Option<String>,
    /// Seconds of the stages of the last frame by the GPU's own clock.
    device_secs: Option<BTreeMap<&'static str, f64>>,
    threads: usize,
    memory: Memory,
    /// The most memory that the process held, in bytes; null where the system does not say.
    peak_bytes: Option<u64>,
    /// Why the picture shows nothing; null if it shows something.
    empty: Option<String>,
}

#[derive(Serialize)]
struct BuildSecs {
    volume: f64,
    macrocells: f64,
    classify: f64,
    skip: f64,
    auto: f64,
}

#[derive(Serialize)]
struct FrameSecs {
    min: f64,
    median: f64,
}

#[derive(Serialize)]
struct Skip {
    method: &'static str,
    /// Why this method, if it was chosen automatically.
    reason: Option<String>,
    macrocell: usize,
    macrocells: usize,
    active: usize,
}

/// What was taken for the values.
#[derive(Serialize)]
pub struct Lod {
    level: &'static str,
    /// No value of the picture is farther from the exact one than this, in units of the data; null if
    /// values are exact.
    pub largest_bound: Option<f64>,
}

#[derive(Serialize)]
struct Memory {
    voxel_bytes: usize,
    macrocell_bytes: usize,
    skip_bytes: usize,
}

/// Seconds by stage, those that ran several times summed.
fn stage_secs(gpu: &GpuRenderer) -> BTreeMap<&'static str, f64> {
    let mut secs = BTreeMap::new();
    for (stage, took) in &gpu.timings().0 {
        *secs.entry(*stage).or_insert(0.0) += took;
    }
    secs
}

impl Report {
    pub fn new(
        args: &RenderArgs,
        renderer: &Backend,
        file: &Path,
        scene: &Scene,
        first: &Rendering,
        load_secs: f64,
        mut frame_secs: Vec<f64>,
        empty: Option<String>,
    ) -> Self {
        frame_secs.sort_by(f64::total_cmp);
        let report = &first.report;
        let colors = scene.transfer_function.color_range();
        let automatic = matches!(args.method.skip, SkipChoice::Auto);
        Self {
            file: file.display().to_string(),
            output: args.output.display().to_string(),
            field: scene.data.name().to_owned(),
            width: first.frame.width,
            height: first.frame.height,
            step: args
                .method
                .step
                .unwrap_or_else(|| scene.data.default_step()),
            color_range: [colors.lo, colors.hi],
            load_secs,
            build_secs: BuildSecs {
                volume: report.volume_secs,
                macrocells: report.macrocells_secs,
                classify: report.classify_secs,
                skip: report.skip_secs,
                auto: report.auto_secs,
            },
            frame_secs: FrameSecs {
                min: frame_secs[0],
                median: median(&frame_secs),
            },
            frames: frame_secs.len(),
            samples: first.frame.total_samples(),
            skip: Skip {
                method: report.method.name(),
                reason: report.reason.clone().filter(|_| automatic),
                macrocell: report.macrocell_side,
                macrocells: report.num_macrocells,
                active: report.num_active,
            },
            lod: Lod {
                level: args.method.lod.name(),
                largest_bound: None,
            },
            device: renderer.name(),
            device_reason: renderer.reason().map(str::to_owned),
            device_secs: renderer.gpu().map(stage_secs),
            threads: report.threads,
            memory: Memory {
                voxel_bytes: scene.data.value_bytes(),
                macrocell_bytes: report.macrocell_bytes,
                skip_bytes: report.skip_bytes,
            },
            peak_bytes: peak_bytes(),
            empty,
        }
    }
}

/// The middle of sorted numbers; of the two in the middle, their mean.
fn median(sorted: &[f64]) -> f64 {
    let middle = sorted.len() / 2;
    if sorted.len().is_multiple_of(2) {
        0.5 * (sorted[middle - 1] + sorted[middle])
    } else {
        sorted[middle]
    }
}
