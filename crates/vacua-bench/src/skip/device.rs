//! The same tables on a GPU: times of the device's own clock, and of edits also as a caller sees them.

use std::time::Instant;

use vacua_gpu::{DeviceChoice, GpuRenderer, Timings};
use vacua_render::{RenderError, RenderReport, RenderSettings, Renderer, Scene};

use super::measure::{Made, empty_build};
use super::{BuildResult, Method, Model, StageTimes};
use crate::cell::Cell;
use crate::error::BenchError;
use crate::paper;
use crate::timing::median;
use crate::volumes;

/// Stages by the column of Tables 1 and 2 that they belong to.
const CLASSIFY: &[&str] = &["classify"];
const SHAPE: &[&str] = &["faces", "triangles", "cluster", "boxes", "mask", "distance"];
const HIERARCHY: &[&str] = &["blas", "refit", "compact", "tlas"];

fn sum(timings: &Timings, stages: &[&str]) -> f64 {
    stages.iter().map(|stage| timings.secs(stage)).sum()
}

/// Seconds of a frame without its way to the host.
pub(super) fn frame_secs(timings: &Timings) -> f64 {
    timings.total_secs() - timings.secs("copy")
}

/// Tables 1 and 2 of one volume, a row a macrocell side.
pub(super) fn builds(
    model: Model,
    (volume, look): &Made,
    device: DeviceChoice,
    (sides, repeats): (&[usize], usize),
) -> Result<Vec<BuildResult>, BenchError> {
    let mut gpu = GpuRenderer::new(device)?;
    let other = volumes::edited(look)?;
    let scenes = [look.clone(), other].map(|look| Scene::new(volume.clone(), look));
    let rows = sides.iter().map(|&side| {
        tracing::info!(%model, side, "measuring what an edit rebuilds");
        build(&mut gpu, model, &scenes, side, repeats)
            .unwrap_or_else(|e| empty_build(model, side, &e.to_string()))
    });
    Ok(rows.collect())
}

fn build(
    gpu: &mut GpuRenderer,
    model: Model,
    scenes: &[Scene; 2],
    side: usize,
    repeats: usize,
) -> Result<BuildResult, RenderError> {
    let (grid, report) = edits(gpu, scenes, (Method::Grid, side), repeats)?;
    let mut row = BuildResult {
        side,
        macrocells: Cell::Value(report.num_macrocells as u64),
        active: Cell::Value(report.num_active as u64),
        triangles: Cell::empty("not measured"),
        boxes_count: Cell::empty("not measured"),
        macrocell_secs: Cell::Value(report.macrocells_secs),
        mesh: StageTimes::empty("not measured"),
        boxes: StageTimes::empty("not measured"),
        grid: StageTimes {
            hierarchy_secs: Cell::empty("`grid` has no hierarchy"),
            ..grid
        },
        paper: paper::build(model, side),
    };
    let tell = |e: RenderError| StageTimes::empty(&e.to_string());
    match edits(gpu, scenes, (Method::Mesh, side), repeats) {
        Ok((mesh, _)) => {
            row.mesh = mesh;
            row.triangles = Cell::Value(2 * gpu.num_outlined() as u64);
        }
        Err(e) => row.mesh = tell(e),
    }
    match edits(gpu, scenes, (Method::Boxes, side), repeats) {
        Ok((boxes, _)) => {
            row.boxes = boxes;
            row.boxes_count = Cell::Value(gpu.num_outlined() as u64);
        }
        Err(e) => row.boxes = tell(e),
    }
    Ok(row)
}

/// Median times of edits after the first picture, which is that of the report. Pictures are tiny, so
/// that the whole of an edit as a caller sees it is what is rebuilt, and the submissions.
fn edits(
    gpu: &mut GpuRenderer,
    scenes: &[Scene; 2],
    (method, side): (Method, usize),
    repeats: usize,
) -> Result<(StageTimes, RenderReport), RenderError> {
    let settings = RenderSettings {
        width: 8,
        height: 8,
        skip: method.skip(),
        macrocell_side: Some(side),
        ..RenderSettings::default()
    };
    let report = gpu.render(&scenes[1], &settings)?.report;
    let mut stages: [Vec<f64>; 4] = Default::default();
    for i in 0..=repeats {
        let start = Instant::now();
        gpu.render(&scenes[i % 2], &settings)?;
        let total = start.elapsed().as_secs_f64();
        if i == 0 {
            continue;
        }
        let timings = gpu.timings();
        let times = [CLASSIFY, SHAPE, HIERARCHY].map(|stages| sum(timings, stages));
        for (all, secs) in stages.iter_mut().zip(times.into_iter().chain([total])) {
            all.push(secs);
        }
    }
    let [classify, shape, hierarchy, total] = stages.map(median).map(Cell::Value);
    let times = StageTimes {
        classify_secs: classify,
        shape_secs: shape,
        hierarchy_secs: hierarchy,
        total_secs: total,
    };
    Ok((times, report))
}
