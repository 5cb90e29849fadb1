//! Skipping on a GPU: frames by method and macrocell size, and what an edit of the transfer function
//! costs. Times of stages are those of the device's own clock; a frame's pictures with and without
//! skipping are compared to the bit, and one with the CPU's.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Instant;

use glam::DVec3;
use serde::{Deserialize, Serialize};
use vacua_gpu::{DeviceChoice, GpuRenderer, Timings, Tracer};
use vacua_io::picture::{Picture, write_png};
use vacua_render::{
    Camera, CpuRenderer, Frame, Projection, RenderSettings, Renderer, Scene, Shading, SkipMethod,
};
use vacua_synth::{Kind, Spec};
use vacua_volume::{OpacityPoint, TransferFunction, TransferFunctionError};

use crate::error::BenchError;
use crate::gpu_group::{self, GroupRow};
use crate::gpu_structures::{self, StructureRow};
use crate::machine::Machine;
use crate::timing::median;
use crate::volumes;

/// A way to skip empty space on a GPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GpuMethod {
    /// A walk over the distance map.
    Grid,
    /// The triangulated boundary, on a ray tracing pipeline.
    Mesh,
    /// The triangulated boundary, through ray queries in a compute shader.
    Query,
    /// The triangulated boundary under our own hierarchy, in a compute shader.
    Packets,
    /// Clustered boxes, on a ray tracing pipeline.
    Boxes,
    /// Whichever the renderer finds fastest.
    Auto,
}

impl GpuMethod {
    const ALL: [(Self, &'static str); 6] = [
        (Self::Grid, "grid"),
        (Self::Mesh, "mesh"),
        (Self::Query, "query"),
        (Self::Packets, "packets"),
        (Self::Boxes, "boxes"),
        (Self::Auto, "auto"),
    ];

    /// What the renderer is asked for.
    const fn skip(self) -> (SkipMethod, Option<Tracer>) {
        match self {
            Self::Grid => (SkipMethod::Grid, None),
            Self::Mesh => (SkipMethod::Mesh, Some(Tracer::Pipeline)),
            Self::Query => (SkipMethod::Mesh, Some(Tracer::Query)),
            Self::Packets => (SkipMethod::Mesh, Some(Tracer::Packets)),
            Self::Boxes => (SkipMethod::Boxes, None),
            Self::Auto => (SkipMethod::Auto, None),
        }
    }
}

impl FromStr for GpuMethod {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let found = Self::ALL.iter().find(|(_, name)| *name == text);
        found.map(|(method, _)| *method).ok_or_else(|| {
            format!("`{text}` is no method, expected grid, mesh, query, packets, boxes or auto")
        })
    }
}

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
    /// Ways to skip, besides none.
    pub methods: Vec<GpuMethod>,
    /// Whether to measure how acceleration structures are built.
    pub structures: bool,
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
    /// Pictures by several devices, if they were asked for: of the first scene.
    pub groups: Vec<GroupRow>,
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
    /// How acceleration structures over the boundary are built.
    pub structures: Vec<StructureRow>,
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
    /// Faces of the boundary, or boxes, that rays are traced against.
    pub shapes: usize,
    /// Seconds after an edit until these are there: on the device, or clustering on the host.
    pub outline_secs: f64,
    /// Seconds on the device: acceleration structures after an edit.
    pub hierarchy_secs: f64,
    /// Seconds of a whole edit with its frame as a caller sees it, the picture on the host.
    pub edit_wall_secs: f64,
    /// Whether the picture is that without skipping, to the bit.
    pub is_exact: bool,
}

/// Reach of the distance map where it does not matter.
const DEFAULT_REACH: u8 = 16;

/// Leaves out what the device cannot do, and says so.
fn said<T>(made: Result<T, BenchError>) -> Result<Option<T>, BenchError> {
    match made {
        Ok(row) => Ok(Some(row)),
        Err(BenchError::Render(error)) => {
            tracing::warn!(%error, "left out");
            Ok(None)
        }
        Err(other) => Err(other),
    }
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
    let mut groups = Vec::new();
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
                if options.device == DeviceChoice::All && groups.is_empty() {
                    groups = gpu_group::measure(&scene, options)?;
                }
                scenes.push(measure(&mut gpu, options, spec, name, &scene)?);
            }
        }
    }
    Ok(GpuResults {
        machine,
        device: gpu.device().name().to_owned(),
        size: options.size,
        scenes,
        groups,
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
        for &method in &options.methods {
            let (skip, tracer) = method.skip();
            gpu.set_tracer(tracer);
            let sides = options.sides.iter().map(|&side| Some(side));
            let sides: Vec<_> = match method {
                GpuMethod::Auto => vec![None],
                _ => sides.collect(),
            };
            let reaches: &[u8] = match method {
                GpuMethod::Grid => &options.reaches,
                _ => &[DEFAULT_REACH],
            };
            for side in sides {
                for &reach in reaches {
                    gpu.set_reach(reach);
                    let settings = with(skip, side);
                    let reference = Some(&first.frame);
                    let made = row(gpu, scene, &settings, reach, options.repeats, reference);
                    rows.extend(said(made)?);
                }
            }
        }
        gpu.set_tracer(None);
        gpu.set_reach(DEFAULT_REACH);
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
        ..settings.clone()
    };
    let structures = if options.structures {
        let settings = RenderSettings {
            skip: SkipMethod::Mesh,
            ..settings.clone()
        };
        gpu_structures::measure(gpu, scene, &settings, options)?
    } else {
        Vec::new()
    };
    let ours = gpu.render(scene, &small)?.frame;
    let theirs = CpuRenderer::new(None)?.render(scene, &small)?.frame;
    Ok(SceneResult {
        name,
        points: spec.points,
        device_bytes: gpu.volume_bytes(),
        upload_secs,
        rows,
        structures,
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
    let marches = gpu.time_rays(scene, settings, repeats)?;
    let march = marches.iter().map(Timings::rays_secs).collect();
    let (mut stages, mut wall) = (Vec::new(), Vec::new());
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
            if i > 0 {
                stages.push(gpu.timings().clone());
            }
        }
        gpu.render(scene, settings)?;
    }
    let report = &first.report;
    let of = |names: &[&str]| {
        let sum = |t: &Timings| names.iter().map(|name| t.secs(name)).sum();
        median(stages.iter().map(sum).collect())
    };
    let (skip, tracer) = (settings.skip, gpu.tracer());
    let name = match (skip, tracer) {
        (SkipMethod::Auto, _) => format!("auto: {}", report.method.name()),
        (SkipMethod::Mesh, Some(Tracer::Query)) => "mesh by queries".to_owned(),
        (SkipMethod::Mesh, Some(Tracer::Packets)) => "mesh by packets".to_owned(),
        _ => report.method.name().to_owned(),
    };
    Ok(Row {
        method: name,
        side: report.macrocell_side,
        reach,
        is_shaded: settings.shading == Shading::Gradient,
        march_secs: median(march),
        samples: first.frame.total_samples(),
        active: [report.num_active, report.num_macrocells],
        ranges_secs,
        classify_secs: of(&["classify"]),
        distance_secs: of(&["distance"]),
        shapes: match report.method {
            SkipMethod::Mesh | SkipMethod::Boxes => gpu.num_outlined(),
            _ => 0,
        },
        outline_secs: of(&["faces", "triangles", "cluster", "boxes"]),
        hierarchy_secs: of(&["blas", "tree", "tlas"]),
        edit_wall_secs: median(wall),
        is_exact: reference
            .is_none_or(|r| r.rgba == first.frame.rgba && r.depth == first.frame.depth),
    })
}

/// PSNR over black in 8 bits, and the largest difference.
pub(crate) fn compare(a: &Frame, b: &Frame) -> (f64, u8) {
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
                 | classify ms | distance ms | faces or boxes | outline ms | BVH ms | edit + frame, wall ms \
                 | exact |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
            );
            for r in &scene.rows {
                let giga = r.samples as f64 / 1e9;
                let active = 100.0 * r.active[0] as f64 / r.active[1].max(1) as f64;
                let _ = writeln!(
                    out,
                    "| {} | {} | {} | {} | {:.3} | {:.3} | {:.0} | {active:.2} | {:.2} | {:.4} | {:.4} \
                     | {} | {:.4} | {:.4} | {:.2} | {} |",
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
                    r.shapes,
                    1e3 * r.outline_secs,
                    1e3 * r.hierarchy_secs,
                    1e3 * r.edit_wall_secs,
                    if r.is_exact { "yes" } else { "NO" },
                );
            }
            out.push('\n');
            out += &gpu_structures::markdown(&scene.structures);
        }
        out + &gpu_group::markdown(&self.groups)
    }
}
