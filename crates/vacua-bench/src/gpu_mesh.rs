//! Packed meshes on a GPU: bytes, sending, first pictures, frames with and without skipping, and
//! samples at random places: the device's part of paper B's Tables 3, 4 and 6.
//!
//! Times of stages are those of the device's own clock. A frame's pictures by all methods are
//! compared to the bit, and a smaller one with the CPU's.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Instant;

use glam::DVec3;
use serde::{Deserialize, Serialize};
use vacua_gpu::{DeviceChoice, GpuRenderer, MeshBytes, Search};
use vacua_io::picture::{Picture, write_png};
use vacua_pack::{EncodeOptions, PackedField, PackedVolume, Variant, encode};
use vacua_render::{
    Camera, CpuRenderer, Frame, Projection, RenderError, RenderSettings, Renderer, Scene, Shading,
    SkipMethod,
};
use vacua_synth::{BenchScene, MeshKind, MeshSpec, generate_mesh};
use vacua_volume::{Bounds, ComponentChoice, FieldChoice, Volume};

use crate::error::BenchError;
use crate::gpu::compare;
use crate::machine::Machine;
use crate::timing::median;

/// A mesh of a kind and size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MeshChoice {
    /// Which kind.
    pub kind: MeshKind,
    /// Cells a side, about.
    pub size: usize,
}

impl FromStr for MeshChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, size) = match text.split_once(':') {
            Some((name, size)) => (name, Some(size)),
            None => (text, None),
        };
        let kind: MeshKind = name
            .parse()
            .map_err(|e: vacua_synth::UnknownMeshKind| e.to_string())?;
        let size = match size {
            Some(size) => size
                .parse()
                .map_err(|_| format!("`{size}` is no size of a mesh"))?,
            None => kind.default_size(),
        };
        Ok(Self { kind, size })
    }
}

/// What to measure.
#[derive(Clone, Debug)]
pub struct GpuMeshOptions {
    /// On which device.
    pub device: DeviceChoice,
    /// Which meshes.
    pub meshes: Vec<MeshChoice>,
    /// Whether points and cells come in random order.
    pub shuffled: bool,
    /// Pixels a row and rows.
    pub size: (usize, usize),
    /// Frames of which the median counts.
    pub repeats: usize,
    /// Lattice cubes a side of a macrocell.
    pub sides: Vec<usize>,
    /// Whether to measure with gradient shading too.
    pub shaded: bool,
    /// Whether to measure rays that search on their own too.
    pub alone: bool,
    /// Whether to measure multi-leaves under an acceleration structure (variant 1) too.
    pub leaves: bool,
    /// Random places that are sampled at once; 0 for none.
    pub places: usize,
    /// Folder for pictures.
    pub pictures: Option<PathBuf>,
}

/// What was measured.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct GpuMeshResults {
    /// Where and when.
    pub machine: Machine,
    /// Name of the device.
    pub device: String,
    /// Pixels a row and rows.
    pub size: (usize, usize),
    /// One entry a mesh.
    pub meshes: Vec<MeshResult>,
}

/// Everything about one mesh.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct MeshResult {
    /// Kind and size.
    pub name: String,
    /// Cells.
    pub cells: u64,
    /// Points.
    pub points: u64,
    /// Bytes of the file's sections: geometry and one field.
    pub file_bytes: u64,
    /// Bytes on the device: positions, indices, nodes, values, tables, acceleration structures, links.
    pub device_bytes: [u64; 7],
    /// Seconds to send and check the mesh.
    pub send_secs: f64,
    /// Seconds of the first picture, from the encoded mesh in the host's memory to the picture there.
    pub first_secs: f64,
    /// Seconds of the first picture with skipping, after that: ranges of macrocells included.
    pub first_skipped_secs: f64,
    /// Seconds to pack the mesh on the host, before all this.
    pub pack_secs: f64,
    /// Frames.
    pub rows: Vec<MeshRow>,
    /// Samples a second at random places; `None` if not measured.
    pub random_per_sec: Option<f64>,
    /// Against the CPU's picture at a quarter of the size: dB, and the largest difference in steps of
    /// 8 bits.
    pub against_cpu: (f64, u8),
}

/// One way to make a picture.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct MeshRow {
    /// How space is skipped.
    pub method: String,
    /// Lattice cubes a side of a macrocell; 0 without.
    pub side: usize,
    /// Whether the rays of a subgroup search together.
    pub together: bool,
    /// Whether surfaces are lit.
    pub is_shaded: bool,
    /// Median seconds of the march on the device.
    pub march_secs: f64,
    /// Samples of a frame.
    pub samples: u64,
    /// Active macrocells, and all.
    pub active: [usize; 2],
    /// Median seconds of a frame as a caller sees it, the picture on the host.
    pub wall_secs: f64,
    /// Whether the picture is that without skipping, to the bit.
    pub is_exact: bool,
}

/// Measures everything.
///
/// # Errors
/// [`BenchError`] if there is no device, or a mesh cannot be made or rendered.
pub fn run(options: &GpuMeshOptions) -> Result<GpuMeshResults, BenchError> {
    let mut gpu = GpuRenderer::new(options.device)?;
    let mut meshes = Vec::new();
    for &choice in &options.meshes {
        meshes.push(measure(&mut gpu, options, choice, Variant::MultiNodes)?);
        if options.leaves {
            meshes.push(measure(&mut gpu, options, choice, Variant::MultiLeaves)?);
        }
    }
    Ok(GpuMeshResults {
        machine: Machine::describe(rayon::current_num_threads()),
        device: gpu.device().name().to_owned(),
        size: options.size,
        meshes,
    })
}

/// The view of a mesh: that of the benchmark scenes for those that fill a cube, whatever part of it there
/// is.
pub(crate) fn view_of(choice: MeshChoice, bounds: Bounds) -> Camera {
    match choice.kind {
        MeshKind::Tet100 | MeshKind::Hex150 => camera(Bounds {
            lo: DVec3::ZERO,
            hi: DVec3::splat(choice.size as f64),
        }),
        _ => camera(bounds),
    }
}

/// The view of the benchmark scenes: the bounding sphere just fits.
fn camera(bounds: Bounds) -> Camera {
    const FOV_DEGREES: f64 = 20.0;
    let at = bounds.center();
    let radius = 0.5 * (bounds.hi - bounds.lo).length();
    let distance = radius / (0.5 * FOV_DEGREES).to_radians().sin();
    Camera::Placed {
        eye: at + distance * DVec3::new(0.8, 0.5, 1.0).normalize(),
        at,
        up: DVec3::Y,
        projection: Projection::Perspective {
            fov_degrees: FOV_DEGREES,
        },
    }
}

/// A mesh encoded with its field, its points, and the seconds that took.
fn packed(volume: &Volume, variant: Variant) -> Result<(PackedVolume, u64, f64), BenchError> {
    let start = Instant::now();
    let mesh = volume.mesh().ok_or(RenderError::NoPositions)?;
    let options = EncodeOptions {
        variant,
        ..EncodeOptions::default()
    };
    let encoded = encode(mesh, options)?;
    let field = PackedField::pack(
        &encoded.mesh,
        &encoded.map,
        volume.name(),
        volume.association(),
        volume.scalars(),
    )?;
    let packed = PackedVolume::new(encoded.mesh, field);
    Ok((
        packed,
        mesh.num_points() as u64,
        start.elapsed().as_secs_f64(),
    ))
}

/// The same with skipping by macrocells of a size.
fn on_grid(settings: &RenderSettings, side: Option<usize>) -> RenderSettings {
    RenderSettings {
        skip: SkipMethod::Grid,
        macrocell_side: side,
        ..settings.clone()
    }
}

fn measure(
    gpu: &mut GpuRenderer,
    options: &GpuMeshOptions,
    choice: MeshChoice,
    variant: Variant,
) -> Result<MeshResult, BenchError> {
    let MeshChoice { kind, size } = choice;
    let dataset = generate_mesh(&MeshSpec {
        size,
        shuffled: options.shuffled,
        ..MeshSpec::new(kind)
    })?;
    let volume = dataset.volume(&FieldChoice::Only, ComponentChoice::Auto)?;
    drop(dataset);
    let bounds = volume.geometry().bounds();
    let (packed, points, pack_secs) = packed(&volume, variant)?;
    drop(volume);
    let cells = packed.mesh().num_cells();
    let camera = view_of(choice, bounds);
    let scene = Scene::new(packed, BenchScene::transfer_function(1.0)?).camera(camera);
    let base = RenderSettings {
        width: options.size.0,
        height: options.size.1,
        skip: SkipMethod::None,
        ..RenderSettings::default()
    };
    let is_of_leaves = variant == Variant::MultiLeaves;
    gpu.set_search(Search::Together);
    let start = Instant::now();
    gpu.render(&scene, &base)?;
    let first_secs = start.elapsed().as_secs_f64();
    let start = Instant::now();
    let side = options.sides.first().copied();
    gpu.render(&scene, &on_grid(&base, side))?;
    let first_skipped_secs = start.elapsed().as_secs_f64();
    let send_secs = gpu.mesh_send_secs();
    let bytes = gpu.mesh_bytes().unwrap_or_default();
    let mut rows = Vec::new();
    for shading in [Shading::None, Shading::Gradient] {
        if shading == Shading::Gradient && !options.shaded {
            continue;
        }
        let none = RenderSettings {
            shading,
            ..base.clone()
        };
        let reference = gpu.render(&scene, &none)?.frame;
        if let Some(folder) = &options.pictures {
            let lit = if shading == Shading::None { "" } else { "-lit" };
            write(&folder.join(format!("{kind}-{size}{lit}.png")), &reference)?;
        }
        let mut ways = vec![(none.clone(), Search::Together)];
        ways.extend(
            options
                .sides
                .iter()
                .map(|&side| (on_grid(&none, Some(side)), Search::Together)),
        );
        if options.alone && !is_of_leaves {
            ways.push((none, Search::Alone));
        }
        for (settings, search) in ways {
            gpu.set_search(search);
            rows.push(row(gpu, options, &scene, &settings, search, &reference)?);
        }
        gpu.set_search(Search::Together);
    }
    let random_per_sec = match options.places {
        0 => None,
        _ if is_of_leaves => None,
        count => {
            let places = random_places(gpu, count);
            Some(rate(gpu, &places)?)
        }
    };
    let small = RenderSettings {
        width: options.size.0 / 4,
        height: options.size.1 / 4,
        skip: SkipMethod::Grid,
        ..base
    };
    let ours = gpu.render(&scene, &small)?.frame;
    let theirs = CpuRenderer::new(None)?.render(&scene, &small)?.frame;
    Ok(MeshResult {
        name: match variant {
            Variant::MultiNodes => format!("{kind} {size}"),
            _ => format!("{kind} {size}, multi-leaves"),
        },
        cells,
        points,
        file_bytes: gpu.mesh_file_bytes().unwrap_or(0),
        device_bytes: parts(bytes).map(|(_, n)| n),
        send_secs,
        first_secs,
        first_skipped_secs,
        pack_secs,
        rows,
        random_per_sec,
        against_cpu: compare(&ours, &theirs),
    })
}

fn row(
    gpu: &mut GpuRenderer,
    options: &GpuMeshOptions,
    scene: &Scene,
    settings: &RenderSettings,
    search: Search,
    reference: &Frame,
) -> Result<MeshRow, BenchError> {
    let first = gpu.render(scene, settings)?;
    let (mut march, mut wall) = (Vec::new(), Vec::new());
    for _ in 0..options.repeats {
        let start = Instant::now();
        gpu.render(scene, settings)?;
        wall.push(start.elapsed().as_secs_f64());
        march.push(gpu.timings().secs("march"));
    }
    let frame = &first.frame;
    Ok(MeshRow {
        method: first.report.method.name().to_owned(),
        side: match settings.skip {
            SkipMethod::None => 0,
            _ => first.report.macrocell_side,
        },
        together: search == Search::Together,
        is_shaded: settings.shading == Shading::Gradient,
        march_secs: median(march),
        samples: frame.total_samples(),
        active: [first.report.num_active, first.report.num_macrocells],
        wall_secs: median(wall),
        is_exact: frame.rgba == reference.rgba && frame.depth == reference.depth,
    })
}

/// Bytes of a mesh on the device, by part.
pub(crate) fn parts(bytes: MeshBytes) -> [(&'static str, u64); 7] {
    [
        ("positions", bytes.positions),
        ("indices", bytes.indices),
        ("nodes", bytes.nodes),
        ("values", bytes.values),
        ("tables", bytes.tables),
        ("structures", bytes.structures),
        ("links", bytes.links),
    ]
}

/// Random places in the box of the mesh that a device has.
pub(crate) fn random_places(gpu: &GpuRenderer, count: usize) -> Vec<[f32; 3]> {
    let mut state = 1u64;
    let mut next = || {
        state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (state >> 40) as f32 / (1 << 24) as f32
    };
    let Some([lo, hi]) = gpu.mesh_box() else {
        return Vec::new();
    };
    let place = |_| [0, 1, 2].map(|a| lo[a] + (hi[a] - lo[a]) * next());
    (0..count).map(place).collect()
}

/// Samples a second at places.
pub(crate) fn rate(gpu: &mut GpuRenderer, places: &[[f32; 3]]) -> Result<f64, BenchError> {
    gpu.sample_mesh(places)?;
    gpu.sample_mesh(places)?;
    Ok(places.len() as f64 / gpu.timings().secs("sample"))
}

fn write(path: &std::path::Path, frame: &Frame) -> Result<(), BenchError> {
    let picture = Picture {
        width: frame.width,
        height: frame.height,
        rgba: &frame.rgba,
        depth: None,
        cost: None,
    };
    Ok(write_png(path, &picture, Some([0.0; 3]))?)
}

impl GpuMeshResults {
    /// A table a mesh.
    pub fn markdown(&self) -> String {
        let mut out = String::new();
        let (width, height) = self.size;
        let _ = writeln!(out, "{} at {width} × {height}\n", self.device);
        let _ = writeln!(out, "{}", self.machine.markdown());
        for mesh in &self.meshes {
            let (psnr, apart) = mesh.against_cpu;
            let total: u64 = mesh.device_bytes.iter().sum();
            let [positions, indices, nodes, values, tables, structures, _] =
                mesh.device_bytes.map(|b| b as f64 / 1e6);
            let _ = writeln!(
                out,
                "## {}: {} cells, {} points\n\n\
                 On the device {:.1} MB, {:.2} B a cell (positions {positions:.1}, indices \
                 {indices:.1}, nodes {nodes:.1}, values {values:.1}, tables {tables:.1}, \
                 structures {structures:.1} MB); file \
                 sections {:.1} MB; sent and checked in {:.3} s, first picture in {:.2} s, {:.2} s more with \
                 skipping; packed on the host in {:.1} s; against the CPU {psnr:.1} dB, at most {apart} of 255.\n",
                mesh.name,
                mesh.cells,
                mesh.points,
                total as f64 / 1e6,
                total as f64 / mesh.cells.max(1) as f64,
                mesh.file_bytes as f64 / 1e6,
                mesh.send_secs,
                mesh.first_secs,
                mesh.first_skipped_secs,
                mesh.pack_secs,
            );
            if let Some(rate) = mesh.random_per_sec {
                let _ = writeln!(out, "Random places: {:.3} Gsamples/s.\n", rate / 1e9);
            }
            out.push_str(
                "| method | K | search | lit | march ms | frame, wall ms | Msamples | Gsamples/s \
                 | active % | exact |\n|---|---|---|---|---|---|---|---|---|---|\n",
            );
            for r in &mesh.rows {
                let active = 100.0 * r.active[0] as f64 / r.active[1].max(1) as f64;
                let _ = writeln!(
                    out,
                    "| {} | {} | {} | {} | {:.3} | {:.2} | {:.1} | {:.2} | {active:.1} | {} |",
                    r.method,
                    r.side,
                    if r.together { "together" } else { "alone" },
                    if r.is_shaded { "yes" } else { "" },
                    1e3 * r.march_secs,
                    1e3 * r.wall_secs,
                    r.samples as f64 / 1e6,
                    r.samples as f64 / 1e9 / r.march_secs,
                    if r.is_exact { "yes" } else { "NO" },
                );
            }
            out.push('\n');
        }
        out
    }
}
