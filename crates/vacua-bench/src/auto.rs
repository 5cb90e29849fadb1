//! Does `auto` choose well? Twenty-one scenes with every fixed choice and with `auto`.
//!
//! Each picture is the first one after an edit of the transfer function: masks and, for `auto`, the
//! measurement that it chooses by are included, macrocells (once a volume) are not. Choices take
//! turns within a round, in an order that moves on by one every round: none always comes after the
//! same other. Ratios are taken within rounds, so that a slow moment of the machine hits both sides.

use std::sync::Arc;
use std::time::Instant;

use serde::{Deserialize, Serialize};
use vacua_render::{Camera, CpuRenderer, RenderSettings, Renderer, Scene, SkipMethod};
use vacua_synth::{Kind, Spec};
use vacua_volume::{TransferFunction, Volume};

use crate::cell::{head, line};
use crate::error::BenchError;
use crate::machine::Machine;
use crate::timing::median;
use crate::volumes;

/// What to measure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AutoOptions {
    /// Points a side of every volume.
    pub points: usize,
    /// Pixels a row and rows.
    pub size: (usize, usize),
    /// Rounds of which the median counts.
    pub repeats: usize,
    /// Threads; all that the machine has if not given.
    pub threads: Option<usize>,
}

impl Default for AutoOptions {
    fn default() -> Self {
        Self {
            points: 256,
            size: (1024, 1024),
            repeats: 5,
            threads: None,
        }
    }
}

/// What was measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AutoResults {
    /// Where and when.
    pub machine: Machine,
    /// How.
    pub options: AutoOptions,
    /// Scene by scene.
    pub scenes: Vec<AutoScene>,
}

/// One scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AutoScene {
    /// Volume, transfer function and point of view.
    pub name: String,
    /// Median seconds from an edit to its picture with each fixed choice.
    pub fixed_secs: Vec<(String, f64)>,
    /// The same with `auto`.
    pub auto_secs: f64,
    /// Of these, seconds of the frame itself.
    pub auto_frame_secs: f64,
    /// Median over the rounds of `auto` over the best fixed choice (that of the least median).
    pub ratio: f64,
    /// What `auto` chose most recently.
    pub chosen: String,
}

impl AutoScene {
    /// The fastest fixed choice.
    fn best(&self) -> (&str, f64) {
        let fastest = self.fixed_secs.iter().min_by(|a, b| a.1.total_cmp(&b.1));
        fastest.map_or(("", f64::NAN), |(name, secs)| (name, *secs))
    }
}

/// Every fixed choice.
const FIXED: [(SkipMethod, usize); 6] = [
    (SkipMethod::None, 8),
    (SkipMethod::Grid, 4),
    (SkipMethod::Grid, 8),
    (SkipMethod::Grid, 16),
    (SkipMethod::Mesh, 16),
    (SkipMethod::Boxes, 16),
];

/// Measures all scenes.
///
/// # Errors
/// [`BenchError`] if a volume cannot be made or a scene not be rendered.
pub fn run(options: &AutoOptions) -> Result<AutoResults, BenchError> {
    let mut scenes = Vec::new();
    let kinds = [
        Kind::Shells,
        Kind::Heptane,
        Kind::Flower,
        Kind::Dns,
        Kind::Llnl,
        Kind::Blobs,
    ];
    for kind in kinds {
        let spec = Spec::new(kind).with_points([options.points; 3]);
        let scale = options.points as f64 / kind.default_points()[0] as f64;
        let volume = volumes::volume(spec, scale)?;
        for (look_name, look) in kind.transfer_functions(spec.scalar_type)? {
            let look = volumes::look_at_scale(&look, scale)?;
            for (view, camera) in [
                ("far", Camera::orbit(30.0, 20.0)),
                ("near", close_up(&volume)),
                ("above", Camera::orbit(200.0, 65.0)),
            ] {
                let name = format!("{kind}, {look_name}, {view}");
                tracing::info!(name, "measuring");
                scenes.push(scene(name, &volume, &look, camera, options)?);
            }
        }
    }
    let threads = CpuRenderer::new(options.threads)?.threads();
    Ok(AutoResults {
        machine: Machine::describe(threads),
        options: options.clone(),
        scenes,
    })
}

/// From within the volume, a quarter of its size before the middle.
fn close_up(volume: &Volume) -> Camera {
    let bounds = volume.geometry().bounds();
    Camera::Placed {
        eye: bounds.center() + 0.25 * bounds.size(),
        at: bounds.center(),
        up: glam::DVec3::Y,
        projection: vacua_render::Projection::Perspective { fov_degrees: 50.0 },
    }
}

fn scene(
    name: String,
    volume: &Arc<Volume>,
    look: &TransferFunction,
    camera: Camera,
    options: &AutoOptions,
) -> Result<AutoScene, BenchError> {
    let edits = [look.clone(), volumes::edited(look)?];
    let scenes = edits.map(|look| Scene::new(volume.clone(), look).camera(camera));
    // One renderer each, which keeps its macrocells.
    let choices = std::iter::once((SkipMethod::Auto, None));
    let choices = choices.chain(FIXED.map(|(skip, side)| (skip, Some(side))));
    let mut runs = Vec::new();
    for (skip, macrocell_side) in choices {
        let settings = RenderSettings {
            width: options.size.0,
            height: options.size.1,
            skip,
            macrocell_side,
            ..Default::default()
        };
        runs.push((CpuRenderer::new(options.threads)?, settings, Vec::new()));
    }
    let mut auto_frame = Vec::new();
    let mut chosen = String::new();
    // The first round brings macrocells and voxels into memory and does not count.
    for round in 0..=options.repeats {
        for turn in 0..runs.len() {
            let num_runs = runs.len();
            let (renderer, settings, times) = &mut runs[(round + turn) % num_runs];
            let start = Instant::now();
            let report = renderer.render(&scenes[round % 2], settings)?.report;
            let secs = start.elapsed().as_secs_f64();
            if round > 0 {
                times.push(secs);
            }
            if settings.skip == SkipMethod::Auto {
                chosen = choice_name(report.method, report.macrocell_side);
                auto_frame.push(report.frame_secs);
            }
        }
    }
    let times: Vec<Vec<f64>> = runs.into_iter().map(|(_, _, times)| times).collect();
    let medians: Vec<f64> = times.iter().cloned().map(median).collect();
    let best = (1..times.len())
        .min_by(|&a, &b| medians[a].total_cmp(&medians[b]))
        .unwrap_or(0);
    let in_rounds = times[0].iter().zip(&times[best]);
    Ok(AutoScene {
        name,
        ratio: median(in_rounds.map(|(auto, best)| auto / best).collect()),
        fixed_secs: FIXED
            .into_iter()
            .zip(&medians[1..])
            .map(|((skip, side), secs)| (choice_name(skip, side), *secs))
            .collect(),
        auto_secs: medians[0],
        auto_frame_secs: median(auto_frame),
        chosen,
    })
}

fn choice_name(method: SkipMethod, side: usize) -> String {
    match method {
        SkipMethod::None => "none".to_owned(),
        method => format!("{} K={side}", method.name()),
    }
}

impl AutoResults {
    /// The table.
    pub fn markdown(&self) -> String {
        let mut text = String::from("# `auto` against every fixed choice\n\n");
        text += &self.machine.markdown();
        text += &format!(
            "\nFrom an edit of the transfer function to its picture of {}×{}, over {}³ points; medians of {}.\n\n",
            self.options.size.0, self.options.size.1, self.options.points, self.options.repeats,
        );
        let names = [
            "scene",
            "best fixed",
            "ms",
            "auto",
            "ms",
            "frame alone",
            "auto ÷ best",
        ];
        text += &head(&names, 2);
        let ms = |secs: f64| format!("{:.1}", 1e3 * secs);
        for scene in &self.scenes {
            let (best, secs) = scene.best();
            text += &line([
                scene.name.clone(),
                best.to_owned(),
                ms(secs),
                scene.chosen.clone(),
                ms(scene.auto_secs),
                ms(scene.auto_frame_secs),
                format!("{:.2}", scene.ratio),
            ]);
        }
        let within = self.scenes.iter().filter(|s| s.ratio <= 1.1).count();
        text += &format!("\n{within} of {} within 10 %.\n", self.scenes.len());
        text
    }
}
