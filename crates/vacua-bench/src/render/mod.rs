//! The benchmark scene `shells256` with every method, and the stages that the project has targets
//! for: macrocells a second, and transfer-function edit to ready.

mod markdown;

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use vacua_render::{
    Camera, CpuRenderer, Projection, RenderSettings, Renderer, Scene, Shading as RenderShading,
};
use vacua_synth::{BenchScene, Kind, Spec, unit_scale};
use vacua_volume::{ScalarType, Volume};

use crate::cell::Cell;
use crate::error::BenchError;
use crate::machine::Machine;
pub use crate::skip::Method;
use crate::skip::check_common;
use crate::timing::{median, timed};
use crate::volumes::{self, Built, Ready, StageTimes};

/// Points a side of the benchmark scene.
const SHELLS_POINTS: usize = 256;
/// Points a side of the volume whose macrocells are timed.
const MACROCELL_POINTS: usize = 512;

/// Edits are short: so many times more of them are measured.
const EDIT_REPEATS: usize = 3;

/// Edits: stand-in, part of its full size, K, method, seconds to stay within. A quarter of the
/// size with a quarter of K has the paper's macrocells at K = 16.
const EDITS: [(Kind, f64, usize, Method, f64); 4] = [
    (Kind::Llnl, 0.25, 4, Method::Grid, 1e-3),
    (Kind::Flower, 0.25, 4, Method::Grid, 1e-3),
    (Kind::Flower, 0.25, 4, Method::Mesh, 10e-3),
    (Kind::Llnl, 0.25, 4, Method::Mesh, 50e-3),
];

/// Types that the scene is stored in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Voxel {
    /// 32-bit floating point.
    F32,
    /// 8 bits, values times 255.
    U8,
    /// 16 bits, values times 65535.
    U16,
}

impl Voxel {
    /// All three.
    pub const ALL: [Self; 3] = [Self::F32, Self::U8, Self::U16];

    const fn scalar_type(self) -> ScalarType {
        match self {
            Self::F32 => ScalarType::F32,
            Self::U8 => ScalarType::U8,
            Self::U16 => ScalarType::U16,
        }
    }

    const fn name(self) -> &'static str {
        match self {
            Self::F32 => "f32",
            Self::U8 => "u8",
            Self::U16 => "u16",
        }
    }
}

/// Whether surfaces are lit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Shading {
    /// Colours as the transfer function gives them.
    Unshaded,
    /// Lit with gradients.
    Gradient,
}

impl Shading {
    const fn name(self) -> &'static str {
        match self {
            Self::Unshaded => "unshaded",
            Self::Gradient => "gradient",
        }
    }
}

/// What to measure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RenderOptions {
    /// Part of the sizes a side, above 0 and at most 1.
    pub scale: f64,
    /// Pixels a row and rows.
    pub size: (usize, usize),
    /// Runs of which the median counts, after one that does not.
    pub repeats: usize,
    /// Threads; all that the machine has if not given.
    pub threads: Option<usize>,
    /// Cells a side of a macrocell.
    pub sides: Vec<usize>,
    /// Leaves out gradient shading.
    pub quick: bool,
}

impl Default for RenderOptions {
    fn default() -> Self {
        Self {
            scale: 1.0,
            size: (1024, 1024),
            repeats: 5,
            threads: None,
            sides: vec![4, 8, 16],
            quick: false,
        }
    }
}

impl RenderOptions {
    /// Small pictures, unshaded.
    pub fn quick() -> Self {
        Self {
            size: (512, 512),
            repeats: 3,
            quick: true,
            ..Self::default()
        }
    }
}

/// What was measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RenderResults {
    /// Where and when.
    pub machine: Machine,
    /// How.
    pub options: RenderOptions,
    /// The scene with every method.
    pub frames: Vec<FrameResult>,
    /// Macrocells computed from voxels.
    pub macrocells: Vec<MacrocellResult>,
    /// Transfer-function edits.
    pub edits: Vec<EditResult>,
}

/// One way to make the picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameResult {
    /// How voxels are stored.
    pub voxel: Voxel,
    /// Whether surfaces are lit.
    pub shading: Shading,
    /// How empty space was skipped.
    pub method: Method,
    /// Cells a side of a macrocell, if there were any.
    pub side: Option<usize>,
    /// Samples evaluated a frame.
    pub samples: Cell<u64>,
    /// Seconds a frame.
    pub secs: Cell<f64>,
    /// Samples a second.
    pub samples_per_sec: Cell<f64>,
}

/// Macrocells of one size.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MacrocellResult {
    /// Points a side of the volume, 8 bits each.
    pub points: [usize; 3],
    /// Cells a side of a macrocell.
    pub side: usize,
    /// Seconds for all.
    pub secs: Cell<f64>,
    /// Bytes of voxels a second.
    pub bytes_per_sec: Cell<f64>,
}

/// From an edited transfer function to a skipper that is ready.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EditResult {
    /// Name of the stand-in.
    pub volume: String,
    /// Cells a side of a macrocell.
    pub side: usize,
    /// What is built.
    pub method: Method,
    /// Macrocells.
    pub macrocells: Cell<u64>,
    /// Active macrocells.
    pub active: Cell<u64>,
    /// Boundary triangles.
    pub triangles: Cell<u64>,
    /// Seconds by stage.
    pub times: StageTimes,
    /// Seconds to stay within, at scale 1.
    pub target_secs: f64,
}

impl RenderResults {
    /// All tables.
    pub fn markdown(&self) -> String {
        markdown::all(self)
    }
}

/// Measures everything; what fails for one cell is said in it.
///
/// # Errors
/// [`BenchError::Option`] if an option is out of range, [`BenchError::Threads`].
pub fn run(options: &RenderOptions) -> Result<RenderResults, BenchError> {
    check_common(
        options.scale,
        options.repeats,
        options.threads,
        &options.sides,
    )?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(options.threads.unwrap_or(0))
        .build()?;
    let machine = Machine::describe(pool.current_num_threads());
    let frames = Voxel::ALL.into_iter().flat_map(|v| frames(v, options));
    Ok(RenderResults {
        machine,
        frames: frames.collect(),
        macrocells: pool.install(|| macrocells(options)),
        edits: EDITS
            .into_iter()
            .map(|edit| pool.install(|| self::edit(edit, options)))
            .collect(),
        options: options.clone(),
    })
}

/// The scene in one type.
fn frames(voxel: Voxel, options: &RenderOptions) -> Vec<FrameResult> {
    let mut stage = stage(voxel, options);
    let mut results = Vec::new();
    for shading in [Shading::Unshaded, Shading::Gradient] {
        let none = [(Method::None, None)].into_iter();
        let skipping = Method::SKIPPING.into_iter();
        let skipping = skipping.flat_map(|m| options.sides.iter().map(move |&k| (m, Some(k))));
        for (method, side) in none.chain(skipping) {
            let measured = match &mut stage {
                Err(e) => Err(e.to_string()),
                Ok(_) if options.quick && shading == Shading::Gradient => {
                    Err("a quick run leaves out gradient shading".to_owned())
                }
                Ok((renderer, scene)) => {
                    let name = method.name();
                    tracing::info!(?voxel, ?shading, name, side, "measuring frames");
                    measure(renderer, scene, options, shading, method, side)
                        .map_err(|e| e.to_string())
                }
            };
            let (secs, samples) = match measured {
                Ok((secs, samples)) => (Cell::Value(secs), Cell::Value(samples)),
                Err(why) => (Cell::empty(&why), Cell::empty(&why)),
            };
            let count = samples.value().unwrap_or(0) as f64;
            results.push(FrameResult {
                voxel,
                shading,
                method,
                side,
                samples,
                samples_per_sec: secs.map(|secs| count / secs),
                secs,
            });
        }
    }
    results
}

/// Renderer and scene for one type.
fn stage(voxel: Voxel, options: &RenderOptions) -> Result<(CpuRenderer, Scene), BenchError> {
    let scalar_type = voxel.scalar_type();
    let spec = Spec::new(Kind::Shells)
        .with_points(volumes::scaled([SHELLS_POINTS; 3], options.scale))
        .with_type(scalar_type);
    let volume = volumes::volume(spec, options.scale)?;
    let scene = BenchScene::new((spec.points[0] - 1) as f64, unit_scale(scalar_type))?;
    let camera = Camera::Placed {
        eye: scene.camera.eye,
        at: scene.camera.at,
        up: scene.camera.up,
        projection: Projection::Perspective {
            fov_degrees: scene.camera.fov_deg,
        },
    };
    let scene = Scene::new(volume, scene.transfer_function).camera(camera);
    Ok((CpuRenderer::new(options.threads)?, scene))
}

/// Median seconds and the samples of a frame.
fn measure(
    renderer: &mut CpuRenderer,
    scene: &Scene,
    options: &RenderOptions,
    shading: Shading,
    method: Method,
    side: Option<usize>,
) -> Result<(f64, u64), BenchError> {
    let (width, height) = options.size;
    let settings = RenderSettings {
        width,
        height,
        shading: match shading {
            Shading::Unshaded => RenderShading::None,
            Shading::Gradient => RenderShading::Gradient,
        },
        skip: method.skip(),
        macrocell_side: side,
        ..RenderSettings::default()
    };
    let mut samples = renderer.render(scene, &settings)?.frame.total_samples();
    let mut times = Vec::new();
    for _ in 0..options.repeats {
        let (rendering, secs) = timed(|| renderer.render(scene, &settings));
        samples = rendering?.frame.total_samples();
        times.push(secs);
    }
    Ok((median(times), samples))
}

/// Macrocells of an 8-bit volume.
fn macrocells(options: &RenderOptions) -> Vec<MacrocellResult> {
    let points = volumes::scaled([MACROCELL_POINTS; 3], options.scale);
    let spec = Spec::new(Kind::Blobs).with_points(points);
    tracing::info!(?points, "measuring macrocells");
    let made = volumes::volume(spec, options.scale)
        .and_then(|volume| Ok((volume, volumes::look(&spec, options.scale)?)));
    let bytes = points.iter().product::<usize>() as f64;
    let sides = options.sides.iter();
    sides
        .map(|&side| {
            let secs = match &made {
                Ok((volume, look)) => match Ready::new(volume, look, side, options.repeats) {
                    Ok(ready) => Cell::Value(ready.macrocell_secs),
                    Err(e) => Cell::empty(e.to_string()),
                },
                Err(e) => Cell::empty(e.to_string()),
            };
            MacrocellResult {
                points,
                side,
                bytes_per_sec: secs.map(|secs| bytes / secs),
                secs,
            }
        })
        .collect()
}

/// One edit.
fn edit(
    (kind, part, side, method, target_secs): (Kind, f64, usize, Method, f64),
    options: &RenderOptions,
) -> EditResult {
    let scale = part * options.scale;
    let spec = volumes::spec(kind, scale);
    tracing::info!(%kind, method = method.name(), "measuring an edit");
    let measured = || -> Result<EditResult, BenchError> {
        let volume: Arc<Volume> = volumes::volume(spec, scale)?;
        let look = volumes::look(&spec, scale)?;
        let ready = Ready::new(&volume, &look, side, 1)?;
        let counts = ready.counts();
        let built = match method {
            Method::Boxes => Built::Boxes,
            Method::Mesh => Built::Mesh,
            Method::Grid | Method::None => Built::Grid,
        };
        Ok(EditResult {
            volume: kind.name().to_owned(),
            side,
            method,
            macrocells: Cell::Value(ready.macrocells.lattice().len() as u64),
            active: Cell::Value(counts.active),
            triangles: Cell::Value(counts.triangles),
            times: ready.edit(built, EDIT_REPEATS * options.repeats),
            target_secs,
        })
    };
    measured().unwrap_or_else(|e| {
        let why = e.to_string();
        EditResult {
            volume: kind.name().to_owned(),
            side,
            method,
            macrocells: Cell::empty(&why),
            active: Cell::empty(&why),
            triangles: Cell::empty(&why),
            times: StageTimes::empty(&why),
            target_secs,
        }
    })
}
