//! `vacua demo`: the main job with nothing to bring. Makes volumes and a mesh, renders each with and
//! without skipping, checks that the pictures are the same, prints the timings and writes the PNGs.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use vacua::{Camera, RenderSettings, SkipMethod};
use vacua_io::picture::{Picture, write_png};
use vacua_render::{CpuRenderer, Frame, Renderer as _, Scene};
use vacua_synth::{Kind, MeshKind, MeshSpec, Spec};
use vacua_volume::{ComponentChoice, Dataset, FieldChoice, TransferFunction, Volume};

use super::{Failure, output};

/// Arguments of `vacua demo`.
#[derive(clap::Args, Debug)]
pub struct DemoArgs {
    /// Folder for the pictures, made if it is not there
    #[arg(short, long, value_name = "DIR", default_value = "vacua-demo")]
    output: PathBuf,
}

/// Points a side of each volume: large enough to time, small enough to wait for.
const POINTS: [usize; 3] = [256; 3];
/// Pixels a side of each picture.
const PIXELS: usize = 768;
/// Frames that are timed after one to warm up.
const FRAMES: usize = 3;
const KINDS: [Kind; 3] = [Kind::Shells, Kind::Heptane, Kind::Flower];
/// The mesh: tetrahedra around layers of wedges.
const MESH: MeshKind = MeshKind::Lander;
/// Its cells a side, about.
const MESH_SIZE: usize = 48;

/// Runs `vacua demo`.
pub fn run(args: &DemoArgs) -> Result<(), Failure> {
    std::fs::create_dir_all(&args.output).map_err(|e| Failure::contents(&args.output, e))?;
    let mut renderer = CpuRenderer::new(None).map_err(|e| Failure::Other(Box::new(e)))?;
    output::print(&format!(
        "{PIXELS} × {PIXELS} pixels, {} threads, best of {FRAMES} frames",
        renderer.threads()
    ))?;
    for kind in KINDS {
        one(grid(kind)?, &args.output, &mut renderer)?;
    }
    one(mesh()?, &args.output, &mut renderer)
}

/// What is rendered, how it looks, and what to say of it.
struct Subject {
    name: String,
    volume: Volume,
    look: TransferFunction,
    shape: String,
    made_secs: f64,
}

fn other(error: impl std::error::Error + Send + Sync + 'static) -> Failure {
    Failure::Other(Box::new(error))
}

fn only_field(dataset: &Dataset) -> Result<Volume, Failure> {
    dataset
        .volume(&FieldChoice::Only, ComponentChoice::Auto)
        .map_err(other)
}

fn grid(kind: Kind) -> Result<Subject, Failure> {
    let spec = Spec::new(kind).with_points(POINTS);
    let start = Instant::now();
    let dataset =
        output::during("making a volume", || vacua_synth::generate(&spec)).map_err(other)?;
    let made_secs = start.elapsed().as_secs_f64();
    let looks = kind.transfer_functions(spec.scalar_type).map_err(other)?;
    let (_, look) = looks
        .into_iter()
        .next()
        .ok_or_else(|| Failure::plain(format!("{kind} has no transfer function")))?;
    let [x, y, z] = POINTS;
    Ok(Subject {
        name: kind.to_string(),
        volume: only_field(&dataset)?,
        look,
        shape: format!("{x} × {y} × {z} {}", spec.scalar_type),
        made_secs,
    })
}

fn mesh() -> Result<Subject, Failure> {
    let spec = MeshSpec {
        size: MESH_SIZE,
        ..MeshSpec::new(MESH)
    };
    let start = Instant::now();
    let dataset =
        output::during("making a mesh", || vacua_synth::generate_mesh(&spec)).map_err(other)?;
    let made_secs = start.elapsed().as_secs_f64();
    let cells = dataset.mesh().map_or(0, |mesh| mesh.num_cells());
    let volume = only_field(&dataset)?;
    // Only the upper half of the values is seen, so that there is something to skip.
    let style = TransferFunction::preset("plasma").opacity_ramp_to(0.5..=1.0, 0.3);
    Ok(Subject {
        name: MESH.to_string(),
        look: style.resolve(&volume).map_err(other)?,
        volume,
        shape: format!("{cells} tetrahedra and wedges"),
        made_secs,
    })
}

fn one(subject: Subject, folder: &Path, renderer: &mut CpuRenderer) -> Result<(), Failure> {
    let Subject {
        name,
        volume,
        look,
        shape,
        made_secs,
    } = subject;
    let scene = Scene::new(Arc::new(volume), look).camera(Camera::orbit(30.0, 20.0));
    let (without, without_secs, _) = timed(renderer, &scene, SkipMethod::None)?;
    let (with, with_secs, method) = timed(renderer, &scene, SkipMethod::Auto)?;
    if with != without {
        return Err(Failure::plain(format!(
            "{name}: skipping changed the picture, which must never happen; please report it"
        )));
    }
    let path = folder.join(format!("{name}.png"));
    let picture = Picture {
        width: with.width,
        height: with.height,
        rgba: &with.rgba,
        depth: None,
        cost: None,
    };
    write_png(&path, &picture, Some([0.0; 3]))?;
    output::print(&format!(
        "{name}: {shape}, made in {made_secs:.1} s\n  \
         without skipping {:7.1} ms\n  \
         with skipping    {:7.1} ms ({}), {:.1} times as fast, the same picture to the bit\n  \
         {}",
        1e3 * without_secs,
        1e3 * with_secs,
        method.name(),
        without_secs / with_secs,
        path.display()
    ))
}

/// A frame, the seconds of the fastest of some, and the method that was used. Counters, which differ
/// between methods, are taken out of the frame.
fn timed(
    renderer: &mut CpuRenderer,
    scene: &Scene,
    skip: SkipMethod,
) -> Result<(Frame, f64, SkipMethod), Failure> {
    let settings = RenderSettings {
        width: PIXELS,
        height: PIXELS,
        skip,
        ..RenderSettings::default()
    };
    let mut render = || {
        output::during("rendering", || renderer.render(scene, &settings))
            .map_err(|e| Failure::Other(Box::new(e)))
    };
    let mut rendering = render()?;
    let mut secs = f64::INFINITY;
    for _ in 0..FRAMES {
        rendering = render()?;
        secs = secs.min(rendering.report.frame_secs);
    }
    let mut frame = rendering.frame;
    frame.samples.clear();
    Ok((frame, secs, rendering.report.method))
}
