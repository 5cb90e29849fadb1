//! Measures one volume: what is built at an edit, then the frames.

use std::sync::Arc;

use rayon::ThreadPool;
use vacua_gpu::GpuRenderer;
use vacua_render::{CpuRenderer, RenderError, RenderSettings, Renderer, Scene, Shading};
use vacua_synth::Spec;
use vacua_volume::{TransferFunction, Volume};

use super::{
    BuildResult, FrameResult, Method, Model, ModelResult, SkipOptions, StageTimes, device,
};
use crate::cell::Cell;
use crate::error::BenchError;
use crate::paper;
use crate::timing::{median, timed};
use crate::volumes::{self, Built, Ready};

/// Measures one volume.
pub(super) fn model(
    model: Model,
    options: &SkipOptions,
    rebuild_side: usize,
    pool: &ThreadPool,
) -> ModelResult {
    let spec = volumes::spec(model.kind(), options.scale);
    let made = pool.install(|| load(spec, options.scale));
    let value_bytes = spec.scalar_type.size_bytes() as u64;
    let sides = options.sides.iter();
    ModelResult {
        model,
        points: spec.points,
        bytes: spec.points.iter().map(|&n| n as u64).product::<u64>() * value_bytes,
        builds: match (&made, options.device) {
            (Ok(made), Some(choice)) => {
                let how = (options.sides.as_slice(), options.repeats);
                device::builds(model, made, choice, how).unwrap_or_else(|e| {
                    let why = e.to_string();
                    sides.map(|&side| empty_build(model, side, &why)).collect()
                })
            }
            (Ok((volume, look)), None) => pool.install(|| {
                sides
                    .map(|&side| {
                        tracing::info!(%model, side, "measuring what an edit rebuilds");
                        build(model, volume, look, side, options.repeats)
                            .unwrap_or_else(|e| empty_build(model, side, &e.to_string()))
                    })
                    .collect()
            }),
            (Err(e), _) => sides
                .map(|&side| empty_build(model, side, &e.to_string()))
                .collect(),
        },
        frames: frames(model, made, options, rebuild_side),
    }
}

pub(super) type Made = (Arc<Volume>, TransferFunction);

fn load(spec: Spec, scale: f64) -> Result<Made, BenchError> {
    tracing::info!(kind = %spec.kind, points = ?spec.points, "making a volume");
    Ok((volumes::volume(spec, scale)?, volumes::look(&spec, scale)?))
}

fn build(
    model: Model,
    volume: &Volume,
    look: &TransferFunction,
    side: usize,
    repeats: usize,
) -> Result<BuildResult, BenchError> {
    let ready = Ready::new(volume, look, side, repeats)?;
    let counts = ready.counts();
    Ok(BuildResult {
        side,
        macrocells: Cell::Value(ready.macrocells.lattice().len() as u64),
        active: Cell::Value(counts.active),
        triangles: Cell::Value(counts.triangles),
        boxes_count: Cell::Value(counts.boxes),
        macrocell_secs: Cell::Value(ready.macrocell_secs),
        mesh: ready.edit(Built::Mesh, repeats),
        boxes: ready.edit(Built::Boxes, repeats),
        grid: ready.edit(Built::Grid, repeats),
        paper: paper::build(model, side),
    })
}

pub(super) fn empty_build(model: Model, side: usize, why: &str) -> BuildResult {
    BuildResult {
        side,
        macrocells: Cell::empty(why),
        active: Cell::empty(why),
        triangles: Cell::empty(why),
        boxes_count: Cell::empty(why),
        macrocell_secs: Cell::empty(why),
        mesh: StageTimes::empty(why),
        boxes: StageTimes::empty(why),
        grid: StageTimes::empty(why),
        paper: paper::build(model, side),
    }
}

/// Every cell of Tables 3 and 4, in the order of measurement.
fn cells(model: Model, options: &SkipOptions, rebuild_side: usize) -> Vec<FrameResult> {
    let cell = |method: Method, side, rays_per_pixel, rebuilt| FrameResult {
        method,
        side,
        rays_per_pixel,
        rebuilt,
        secs: Cell::empty("not measured"),
        samples: Cell::empty("not measured"),
        paper_table3_fps: (!rebuilt)
            .then(|| paper::frames(model, rays_per_pixel, method.name(), side))
            .flatten(),
        paper_table4_fps: (rays_per_pixel == 1
            && side.is_none_or(|side| side == paper::DEFAULT_SIDE))
        .then(|| paper::rebuilds(model, method.name(), rebuilt))
        .flatten(),
    };
    let mut cells = Vec::new();
    for rays in [1, 4] {
        cells.push(cell(Method::None, None, rays, false));
        for method in Method::SKIPPING {
            for &side in &options.sides {
                cells.push(cell(method, Some(side), rays, false));
            }
        }
    }
    cells.push(cell(Method::None, None, 1, true));
    for method in Method::SKIPPING {
        cells.push(cell(method, Some(rebuild_side), 1, true));
    }
    cells
}

fn frames(
    model: Model,
    made: Result<Made, BenchError>,
    options: &SkipOptions,
    rebuild_side: usize,
) -> Vec<FrameResult> {
    let mut cells = cells(model, options, rebuild_side);
    let fail = |cells: &mut [FrameResult], why: &str| {
        for cell in cells {
            (cell.secs, cell.samples) = (Cell::empty(why), Cell::empty(why));
        }
    };
    let mut theatre = match made.and_then(|made| Theatre::new(made, options)) {
        Ok(theatre) => theatre,
        Err(e) => {
            fail(&mut cells, &e.to_string());
            return cells;
        }
    };
    for index in 0..cells.len() {
        let why = {
            let cell = &cells[index];
            let is_base = cell.method == Method::None;
            match cell {
                _ if cell.rebuilt && is_base => Some("without skipping nothing is rebuilt".into()),
                _ if cell.rays_per_pixel > 1 && options.quick => {
                    Some("a quick run leaves out 4 rays a pixel".into())
                }
                _ => {
                    tracing::info!(
                        %model,
                        method = cell.method.name(),
                        side = cell.side,
                        rays = cell.rays_per_pixel,
                        rebuilt = cell.rebuilt,
                        "measuring frames"
                    );
                    match theatre.measure(cell) {
                        Ok((secs, samples)) => {
                            let why = too_few(&cells, index, samples);
                            cells[index].secs = Cell::Value(secs);
                            cells[index].samples = Cell::Value(samples);
                            why
                        }
                        Err(e) => Some(e.to_string()),
                    }
                }
            }
        };
        if let Some(why) = why {
            fail(&mut cells[index..=index], &why);
        }
    }
    cells
}

/// Why a frame of several rays a pixel does not count: it must evaluate about as many times the
/// samples of one with a single ray.
fn too_few(cells: &[FrameResult], index: usize, samples: u64) -> Option<String> {
    let cell = &cells[index];
    let single = cells.iter().find(|c| {
        (c.method, c.side) == (cell.method, cell.side) && c.rays_per_pixel == 1 && !c.rebuilt
    })?;
    let expected = single.samples.value()? * u64::from(cell.rays_per_pixel);
    (cell.rays_per_pixel > 1 && 4 * samples < 3 * expected).then(|| {
        format!(
            "the renderer evaluated far fewer samples than {} rays a pixel need",
            cell.rays_per_pixel
        )
    })
}

/// What renders.
enum Player {
    Cpu(Box<CpuRenderer>),
    Gpu(Box<GpuRenderer>),
}

/// A renderer with two scenes that differ only in whether they are the same.
struct Theatre {
    player: Player,
    scenes: [Scene; 2],
    settings: RenderSettings,
    repeats: usize,
}

impl Theatre {
    fn new((volume, look): Made, options: &SkipOptions) -> Result<Self, BenchError> {
        let other = volumes::edited(&look)?;
        let (width, height) = options.size;
        Ok(Self {
            player: match options.device {
                None => Player::Cpu(Box::new(CpuRenderer::new(options.threads)?)),
                Some(choice) => Player::Gpu(Box::new(GpuRenderer::new(choice)?)),
            },
            scenes: [look, other].map(|look| Scene::new(volume.clone(), look)),
            settings: RenderSettings {
                width,
                height,
                shading: Shading::Gradient,
                ..RenderSettings::default()
            },
            repeats: options.repeats,
        })
    }

    /// Median seconds and the samples of a frame, after one that does not count.
    fn measure(&mut self, cell: &FrameResult) -> Result<(f64, u64), RenderError> {
        let settings = RenderSettings {
            skip: cell.method.skip(),
            macrocell_side: cell.side,
            samples_per_pixel: cell.rays_per_pixel,
            ..self.settings.clone()
        };
        let mut samples = 0;
        let mut times = Vec::new();
        for i in 0..=self.repeats {
            let scene = &self.scenes[if cell.rebuilt { i % 2 } else { 0 }];
            let (rendering, secs) = match &mut self.player {
                Player::Cpu(cpu) => timed(|| cpu.render(scene, &settings)),
                Player::Gpu(gpu) => {
                    let rendering = gpu.render(scene, &settings);
                    (rendering, device::frame_secs(gpu.timings()))
                }
            };
            samples = rendering?.frame.total_samples();
            if i > 0 {
                times.push(secs);
            }
        }
        Ok((median(times), samples))
    }
}
