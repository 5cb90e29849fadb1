//! Skipping on a GPU: frames by method and macrocell size, and what an edit of the transfer function
//! costs. Times of stages are those of the device's own clock; a frame's pictures with and without
//! skipping are compared to the bit, and one with the CPU's.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::time::Instant;

use glam::DVec3;
use serde::{Deserialize, Serialize};
use vacua_gpu::{DeviceChoice, GpuRenderer};
use vacua_io::picture::{Picture, write_png};
use vacua_render::{
    Camera, CpuRenderer, Frame, Projection, RenderSettings, Renderer, Scene, Shading, SkipMethod,
};
use vacua_synth::{Kind, Spec};
use vacua_volume::{OpacityPoint, TransferFunction, TransferFunctionError};

use crate::error::BenchError;
use crate::machine::Machine;
use crate::timing::median;
use crate::volumes;

/// What to measure.
#[derive(Clone, Debug)]
pub struct GpuOptions {
    /// On which device.
    pub device: DeviceChoice,
    /// Which volumes.
    pub kinds: Vec<Kind>,
    /// Points a side; each kind's own if not given.
    pub points: Option<[usize; 3]>,
    /// Pixels a row and rows.
    pub size: (usize, usize),
    /// Frames of which the median counts.
    pub repeats: usize,
    /// Cells a side of a macrocell.
    pub sides: Vec<usize>,
    /// Reaches of the distance map.
    pub reaches: Vec<u8>,
    /// Whether to measure with gradient shading too.
    pub shaded: bool,
    /// Folder for pictures.
    pub pictures: Option<PathBuf>,
}

/// What was measured.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct GpuResults {
    /// Where and when.
    pub machine: Machine,
    /// Name of the device.
    pub device: String,
    /// Pixels a row and rows.
    pub size: (usize, usize),
    /// One entry a volume and look.
    pub scenes: Vec<SceneResult>,
}

/// Everything about one scene.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SceneResult {
    /// Volume, look, view.
    pub name: String,
    /// Points a side.
    pub points: [usize; 3],
    /// Bytes of the voxels on the device.
    pub device_bytes: u64,
    /// Seconds to send the volume.
    pub upload_secs: f64,
    /// Rows of the table.
    pub rows: Vec<Row>,
    /// Against the CPU's picture at a quarter of the size: dB, and the largest difference in steps
    /// of 8 bits.
    pub against_cpu: (f64, u8),
}

/// One method.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Row {
    /// Its name.
    pub method: String,
    /// Macrocell side; 0 without.
    pub side: usize,
    /// Reach of the distance map; 0 without.
    pub reach: u8,
    /// Whether surfaces are lit.
    pub is_shaded: bool,
    /// Median seconds of the march on the device.
    pub march_secs: f64,
    /// Samples of a frame.
    pub samples: u64,
    /// Active macrocells, and all.
    pub active: [usize; 2],
    /// Seconds on the device: macrocell ranges, once a volume.
    pub ranges_secs: f64,
    /// Seconds on the device: classification after an edit.
    pub classify_secs: f64,
    /// Seconds on the device: distance map after an edit.
    pub distance_secs: f64,
    /// Seconds of a whole edit with its frame as a caller sees it, the picture on the host.
    pub edit_wall_secs: f64,
    /// Whether the picture is that without skipping, to the bit.
    pub is_exact: bool,
}

/// Cameras around a cube of a side: filling the picture, and inside.
fn views(side: DVec3) -> [(&'static str, Camera); 2] {
    let at = 0.5 * side;
    let placed = |eye, at, fov_degrees| Camera::Placed {
        eye,
        at,
        up: DVec3::Y,
        projection: Projection::Perspective { fov_degrees },
    };
    let from = DVec3::new(0.8, 0.5, 1.0).normalize();
    let outside = at + 1.35 * side.max_element() * from;
    let inside = at + 0.3 * side * DVec3::new(0.5, 0.1, 0.9);
    [
        ("outside", placed(outside, at, 30.0)),
        ("inside", placed(inside, DVec3::ZERO, 60.0)),
    ]
}

/// Measures everything.
///
/// # Errors
/// [`BenchError`] if there is no device, or a volume cannot be made or rendered.
pub fn run(options: &GpuOptions) -> Result<GpuResults, BenchError> {
    let mut gpu = GpuRenderer::new(options.device)?;
    let machine = Machine::describe(rayon::current_num_threads());
    let mut scenes = Vec::new();
    for &kind in &options.kinds {
        let mut spec = Spec::new(kind);
        spec.points = options.points.unwrap_or(spec.points);
        let volume = volumes::volume(spec, 1.0)?;
        let side = DVec3::from(spec.points.map(|n| (n - 1) as f64));
        let mut looks = kind.transfer_functions(spec.scalar_type)?;
        if let Some((_, look)) = looks.first() {
            looks.push(("clear", clear(look)?));
        }
        for (look_name, look) in looks {
            for (view_name, camera) in views(side) {
                let name = format!("{kind} {look_name} {view_name}");
                let scene = Scene::new(volume.clone(), look.clone()).camera(camera);
                scenes.push(measure(&mut gpu, options, spec, name, &scene)?);
            }
        }
    }
    Ok(GpuResults {
        machine,
        device: gpu.device().name().to_owned(),
        size: options.size,
        scenes,
    })
}

/// A look in which nothing is seen: what rays cost that meet nothing.
fn clear(look: &TransferFunction) -> Result<TransferFunction, TransferFunctionError> {
    let none = |point: &OpacityPoint| OpacityPoint {
        opacity: 0.0,
        ..*point
    };
    TransferFunction::new(
        look.colors().to_vec(),
        look.opacities().iter().map(none).collect(),
        look.unit_length(),
        look.scale(),
    )
}

fn measure(
    gpu: &mut GpuRenderer,
    options: &GpuOptions,
    spec: Spec,
    name: String,
    scene: &Scene,
) -> Result<SceneResult, BenchError> {
    let settings = RenderSettings {
        width: options.size.0,
        height: options.size.1,
        ..RenderSettings::default()
    };
    let mut rows = Vec::new();
    let mut upload_secs = 0.0;
    for shading in [Shading::None, Shading::Gradient] {
        if shading == Shading::Gradient && !options.shaded {
            continue;
        }
        let with = |skip, side| RenderSettings {
            skip,
            shading,
            macrocell_side: side,
            ..settings.clone()
        };
        let none = with(SkipMethod::None, None);
        let first = gpu.render(scene, &none)?;
        upload_secs = f64::max(upload_secs, first.report.volume_secs);
        rows.push(row(gpu, scene, &none, 0, options.repeats, None)?);
        for &side in &options.sides {
            for &reach in &options.reaches {
                gpu.set_reach(reach);
                let grid = with(SkipMethod::Grid, Some(side));
                let reference = Some(&first.frame);
                rows.push(row(gpu, scene, &grid, reach, options.repeats, reference)?);
            }
        }
        if let Some(folder) = &options.pictures {
            let shade = if shading == Shading::None { "" } else { " lit" };
            let path = folder.join(format!("{name}{shade}.png").replace(' ', "-"));
            let picture = Picture {
                width: first.frame.width,
                height: first.frame.height,
                rgba: &first.frame.rgba,
                depth: None,
                cost: None,
            };
            write_png(&path, &picture, Some([0.0; 3]))?;
        }
    }
    let small = RenderSettings {
        width: options.size.0 / 4,
        height: options.size.1 / 4,
        skip: SkipMethod::Grid,
        ..settings
    };
    let ours = gpu.render(scene, &small)?.frame;
    let theirs = CpuRenderer::new(None)?.render(scene, &small)?.frame;
    Ok(SceneResult {
        name,
        points: spec.points,
        device_bytes: gpu.volume_bytes(),
        upload_secs,
        rows,
        against_cpu: compare(&ours, &theirs),
    })
}

fn row(
    gpu: &mut GpuRenderer,
    scene: &Scene,
    settings: &RenderSettings,
    reach: u8,
    repeats: usize,
    reference: Option<&Frame>,
) -> Result<Row, BenchError> {
    let first = gpu.render(scene, settings)?;
    let ranges_secs = gpu.timings().secs("ranges");
    let mut march = Vec::new();
    for _ in 0..repeats {
        gpu.render(scene, settings)?;
        march.push(gpu.timings().secs("march"));
    }
    let (mut classify, mut distance, mut wall) = (Vec::new(), Vec::new(), Vec::new());
    if settings.skip != SkipMethod::None {
        let looks = [
            volumes::edited(&scene.transfer_function)?,
            scene.transfer_function.clone(),
        ];
        for i in 0..repeats + 1 {
            let scene = scene.clone().transfer_function(looks[i % 2].clone());
            let start = Instant::now();
            gpu.render(&scene, settings)?;
            wall.push(start.elapsed().as_secs_f64());
            classify.push(gpu.timings().secs("classify"));
            distance.push(gpu.timings().secs("distance"));
        }
        gpu.render(scene, settings)?;
    }
    let report = &first.report;
    Ok(Row {
        method: report.method.name().to_owned(),
        side: report.macrocell_side,
        reach,
        is_shaded: settings.shading == Shading::Gradient,
        march_secs: median(march),
        samples: first.frame.total_samples(),
        active: [report.num_active, report.num_macrocells],
        ranges_secs,
        classify_secs: median(classify),
        distance_secs: median(distance),
        edit_wall_secs: median(wall),
        is_exact: reference
            .is_none_or(|r| r.rgba == first.frame.rgba && r.depth == first.frame.depth),
    })
}

/// PSNR over black in 8 bits, and the largest difference.
fn compare(a: &Frame, b: &Frame) -> (f64, u8) {
    let encode = |linear: f32| {
        let srgb = vacua_volume::srgb_from_linear(f64::from(linear.clamp(0.0, 1.0)));
        (255.0 * srgb).round() as u8
    };
    let (mut sum, mut largest) = (0.0, 0);
    for (p, q) in a.rgba.iter().zip(&b.rgba) {
        for c in 0..3 {
            let apart = encode(p[c]).abs_diff(encode(q[c]));
            sum += f64::from(apart).powi(2);
            largest = largest.max(apart);
        }
    }
    let mean = sum / (3 * a.rgba.len()) as f64;
    (10.0 * (255.0f64.powi(2) / mean.max(1e-12)).log10(), largest)
}

impl GpuResults {
    /// A table a scene.
    pub fn markdown(&self) -> String {
        let mut out = String::new();
        let (width, height) = self.size;
        let _ = writeln!(out, "{} at {width} × {height}\n", self.device);
        let _ = writeln!(out, "{}", self.machine.markdown());
        for scene in &self.scenes {
            let [x, y, z] = scene.points;
            let (psnr, apart) = scene.against_cpu;
            let _ = writeln!(
                out,
                "## {}, {x} × {y} × {z}\n\n{:.2} GiB sent in {:.2} s; against the CPU {psnr:.1} dB, \
                 at most {apart} of 255\n",
                scene.name,
                scene.device_bytes as f64 / (1u64 << 30) as f64,
                scene.upload_secs,
            );
            out.push_str(
                "| method | K | reach | lit | march ms | Gsamples | Gsamples/s | active % | ranges ms \
                 | classify ms | distance ms | edit + frame, wall ms | exact |\n\
                 |---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
            );
            for r in &scene.rows {
                let giga = r.samples as f64 / 1e9;
                let active = 100.0 * r.active[0] as f64 / r.active[1].max(1) as f64;
                let _ = writeln!(
                    out,
                    "| {} | {} | {} | {} | {:.3} | {:.3} | {:.0} | {active:.2} | {:.2} | {:.4} | {:.4} \
                     | {:.2} | {} |",
                    r.method,
                    r.side,
                    r.reach,
                    if r.is_shaded { "yes" } else { "" },
                    1e3 * r.march_secs,
                    giga,
                    giga / r.march_secs,
                    1e3 * r.ranges_secs,
                    1e3 * r.classify_secs,
                    1e3 * r.distance_secs,
                    1e3 * r.edit_wall_secs,
                    if r.is_exact { "yes" } else { "NO" },
                );
            }
            out.push('\n');
        }
        out
    }
}
