//! `vacua render`: one picture.

mod heatmap;
mod report;

use std::path::PathBuf;
use std::time::Instant;

use clap::builder::{PathBufValueParser, TypedValueParser as _};
use etcetera::BaseStrategy as _;
use vacua::{
    Backend, Camera, ClipPlane, Detail, Device, Integrator, Overlay, RenderSettings, Shading,
    SkipMethod,
};
use vacua_io::picture::{Picture, PictureFormat, write_picture};
use vacua_io::{is_standard_output, is_stream};
use vacua_render::{Jitter, Progressive, Renderer as _, Rendering, Scene, SceneData};
use vacua_volume::Bounds;

use self::report::Report;
use super::choice::{FieldArgs, LookArgs};
use super::input::InputArgs;
use super::packed;
use super::values::{self, Background, CameraChoice, ClipChoice, Projection, Stand};
use super::{Failure, Wrong, output};

/// Arguments of `vacua render`.
#[derive(clap::Args, Debug)]
pub struct RenderArgs {
    #[command(flatten)]
    input: InputArgs,
    /// The picture: .png, or .exr with linear RGBA and depth; `-` for a PNG on standard output
    #[arg(short, long, value_name = "OUT", value_parser = PathBufValueParser::new().map(output::place))]
    output: PathBuf,
    /// Print one JSON object about how the picture came to be
    #[arg(long)]
    json: bool,
    /// A second picture, of how many samples each pixel took
    #[arg(long, value_name = "OUT", value_parser = PathBufValueParser::new().map(output::place))]
    heatmap: Option<PathBuf>,
    /// Show the left half of the heat map as it is without skipping
    #[arg(long, requires = "heatmap")]
    heatmap_halves: bool,
    /// Draw something over the picture
    #[arg(long, value_enum)]
    overlay: Option<OverlayChoice>,
    #[command(flatten)]
    field: FieldArgs,
    #[command(flatten)]
    look: LookArgs,
    #[command(flatten)]
    appearance: AppearanceArgs,
    #[command(flatten)]
    view: ViewArgs,
    #[command(flatten)]
    method: MethodArgs,
}

/// Light and background.
#[derive(clap::Args, Debug)]
#[command(next_help_heading = "How it looks")]
struct AppearanceArgs {
    /// Light surfaces by the gradient of the field
    #[arg(long, value_enum, default_value = "none")]
    shading: ShadingChoice,
    /// Colour behind a .png: a CSS colour, or transparent
    #[arg(long, value_name = "C", default_value = "black")]
    background: Background,
}

/// From where, and how much of it.
#[derive(clap::Args, Debug)]
#[command(next_help_heading = "View")]
struct ViewArgs {
    /// Pixels
    #[arg(long, value_name = "WxH", value_parser = values::picture_size, default_value = "1024x1024")]
    size: [usize; 2],
    /// eye=x,y,z;at=x,y,z;up=x,y,z;fov=deg (or ortho=height), or orbit=azimuth,elevation
    #[arg(long, value_name = "CAMERA", default_value = "orbit=30,20")]
    camera: CameraChoice,
    /// Cut along a plane x,y,z;nx,ny,nz; keeps the side the normal points to (may be repeated)
    #[arg(long, value_name = "PLANE", allow_hyphen_values = true)]
    clip: Vec<ClipChoice>,
    /// Show only what is in a world box x0,x1,y0,y1,z0,z1
    #[arg(long, value_name = "BOX", value_parser = values::region, allow_hyphen_values = true)]
    roi: Option<Bounds>,
}

/// How it is done.
#[derive(clap::Args, Debug)]
#[command(next_help_heading = "How it is done")]
struct MethodArgs {
    /// How samples become a pixel
    #[arg(long, value_enum, default_value = "march")]
    integrator: IntegratorChoice,
    /// How empty space is skipped; the picture is the same
    #[arg(long, value_enum, default_value = "auto")]
    skip: SkipChoice,
    /// Cells a side of a macrocell [default: measured, or 8]
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u16).range(1..))]
    macrocell: Option<u16>,
    /// Distance between samples, in cells [default: 0.5, or less where cells are few]
    #[arg(long, value_name = "S", value_parser = values::positive)]
    step: Option<f64>,
    /// What is taken for the values of a mesh: submesh, multileaf, leaf (what boxes of that level say of
    /// what is in them: coarse and fast, with a bound on the error in --json) or exact
    #[arg(long, value_name = "LEVEL", value_parser = values::detail, default_value = "exact")]
    lod: Detail,
    /// Write the picture as it becomes better: of a mesh coarse levels of detail first, then exact
    /// frames one by one
    #[arg(long, conflicts_with = "repeat")]
    progressive: bool,
    /// Rays a pixel
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 16), default_value = "1")]
    spp: u32,
    /// Shift samples from pixel to pixel [default: on from two rays a pixel]
    #[arg(long, value_enum)]
    jitter: Option<Switch>,
    /// What renders: auto, cpu, gpu, gpu:N or gpu:all (each makes a part of the picture)
    #[arg(long, value_name = "DEVICE", default_value = "auto")]
    device: Device,
    /// Threads [default: all there are]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Frames to time after one to warm up
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    repeat: Option<u32>,
}

/// What is drawn over the picture.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum OverlayChoice {
    /// The boundary of the macrocells in which anything can be seen.
    Boundary,
}

/// Whether surfaces are lit.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum ShadingChoice {
    /// Colours as they are.
    None,
    /// Lit from the camera.
    Gradient,
}

/// How samples become a pixel.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum IntegratorChoice {
    /// Emission and extinction, front to back.
    March,
    /// The largest value along the ray.
    Mip,
}

/// How empty space is skipped.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum SkipChoice {
    /// By what is measured to be fastest.
    Auto,
    /// Not at all.
    None,
    /// A walk over the macrocells.
    Grid,
    /// Clustered boxes.
    Boxes,
    /// The boundary mesh of the active macrocells.
    Mesh,
}

/// On or off.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Switch {
    On,
    Off,
}

impl MethodArgs {
    /// The settings for a picture of data with a step of its own.
    fn settings(
        &self,
        [width, height]: [usize; 2],
        shading: ShadingChoice,
        default_step: f64,
    ) -> RenderSettings {
        RenderSettings {
            width,
            height,
            step: self.step.unwrap_or(default_step),
            detail: self.lod,
            integrator: match self.integrator {
                IntegratorChoice::March => Integrator::March,
                IntegratorChoice::Mip => Integrator::MaximumIntensity,
            },
            shading: match shading {
                ShadingChoice::None => Shading::None,
                ShadingChoice::Gradient => Shading::Gradient,
            },
            skip: match self.skip {
                SkipChoice::Auto => SkipMethod::Auto,
                SkipChoice::None => SkipMethod::None,
                SkipChoice::Grid => SkipMethod::Grid,
                SkipChoice::Boxes => SkipMethod::Boxes,
                SkipChoice::Mesh => SkipMethod::Mesh,
            },
            macrocell_side: self.macrocell.map(usize::from),
            samples_per_pixel: self.spp,
            jitter: match self.jitter {
                None => Jitter::Auto,
                Some(Switch::On) => Jitter::On,
                Some(Switch::Off) => Jitter::Off,
            },
            ..RenderSettings::default()
        }
    }
}

/// Field of view where nothing is said, degrees.
const DEFAULT_FOV_DEGREES: f64 = 30.0;

/// The camera that the flag describes, for data within `bounds`.
fn camera(choice: CameraChoice, bounds: Bounds) -> Result<Camera, Failure> {
    use vacua_render::Projection as Rays;
    let projection = |default| match choice.projection.unwrap_or(default) {
        Projection::Perspective(fov_degrees) => Rays::Perspective { fov_degrees },
        Projection::Orthographic(height) => Rays::Orthographic { height },
    };
    let perspective = Projection::Perspective(DEFAULT_FOV_DEGREES);
    match choice.stand {
        Stand::Place { eye, at, up } => Ok(Camera::Placed {
            eye,
            at: at.unwrap_or(bounds.center()),
            up: up.unwrap_or(glam::DVec3::Y),
            projection: projection(perspective),
        }),
        Stand::Orbit(azimuth, elevation) => {
            let orbit = Camera::orbit(azimuth, elevation);
            let Some(wanted) = choice.projection else {
                return Ok(orbit);
            };
            // The middle ray and the one above it tell where this orbit is and what is up there.
            let view = orbit
                .view(bounds, 2, 2)
                .map_err(|e| Failure::Other(Box::new(e)))?;
            let (eye, forward) = view.ray(1.0, 1.0);
            let up = view.ray(1.0, 0.0).1 - forward;
            Ok(match wanted {
                Projection::Perspective(fov) => Camera::framing(bounds, -forward, up, fov),
                Projection::Orthographic(_) => Camera::Placed {
                    eye,
                    at: bounds.center(),
                    up,
                    projection: projection(wanted),
                },
            })
        }
    }
}

/// The file of the chosen time step, and the chosen field of it.
fn open(args: &RenderArgs) -> Result<(PathBuf, SceneData), Failure> {
    if let Some(file) = packed::open(&args.input)? {
        let path = args.input.files[0].clone();
        let read = || packed::volume(&file, &args.input, &args.field);
        let volume = output::during("checking the encoded mesh", read)?;
        return Ok((path, volume.into()));
    }
    let opened = args.input.open()?;
    let volume = output::during("reading", || args.field.volume(&opened))?;
    Ok((opened.path, volume.into()))
}

/// Checks that what is written has its format and its own place.
fn check_outputs(args: &RenderArgs) -> Result<(), Wrong> {
    let heatmap = args.heatmap.as_ref();
    for path in std::iter::once(&args.output).chain(heatmap) {
        PictureFormat::of(path).map_err(|e| Wrong(format!("{}: {e}", path.display())))?;
        if args.json && is_standard_output(path) {
            return Err(Wrong(
                "--json prints to standard output, where the picture goes".to_owned(),
            ));
        }
    }
    if args.method.progressive && is_stream(&args.output) {
        return Err(Wrong(format!(
            "--progressive writes several pictures, {} takes one",
            args.output.display()
        )));
    }
    heatmap.map_or(Ok(()), |path| output::refuse_twice(&args.output, path))
}

/// Runs `vacua render`.
pub fn run(args: &RenderArgs) -> Result<(), Failure> {
    args.look.check()?;
    check_outputs(args)?;
    let start = Instant::now();
    let (path, data) = open(args)?;
    let load_secs = start.elapsed().as_secs_f64();
    let transfer_function = output::during("looking at the values", || {
        args.look.transfer_function(&data)
    })?;
    let step = data.default_step();
    let mut settings = args
        .method
        .settings(args.view.size, args.appearance.shading, step);
    let bounds = data.bounds();
    let mut scene = Scene::new(data, transfer_function).camera(camera(args.view.camera, bounds)?);
    for clip in &args.view.clip {
        scene = scene.clip(ClipPlane {
            point: clip.point,
            normal: clip.normal,
        });
    }
    scene.region_of_interest = args.view.roi;

    let threads = args.method.threads.map(usize::from);
    settings.overlay = match args.overlay {
        None => Overlay::None,
        Some(OverlayChoice::Boundary) => Overlay::Boundary,
    };
    let mut renderer =
        Backend::new(args.method.device, threads).map_err(|e| Failure::Other(Box::new(e)))?;
    if let Some(folder) = cache_folder() {
        renderer.keep_shaders_in(folder);
    }
    let early = if args.method.progressive {
        Some(render_progressively(
            args,
            &mut renderer,
            &scene,
            &settings,
        )?)
    } else {
        None
    };
    let mut render = |settings: &RenderSettings| {
        renderer
            .render(&scene, settings)
            .map_err(|e| Failure::Other(Box::new(e)))
    };
    let first = match early {
        Some(last) => last,
        None => output::during("rendering", || render(&settings))?,
    };
    let mut frame_secs = Vec::new();
    for _ in 0..args.method.repeat.unwrap_or(0) {
        frame_secs.push(
            output::during("rendering again", || render(&settings))?
                .report
                .frame_secs,
        );
    }
    if frame_secs.is_empty() {
        frame_secs.push(first.report.frame_secs);
    }

    write(args, &first)?;
    if let Some(path) = &args.heatmap {
        let without = if args.heatmap_halves {
            let settings = RenderSettings {
                skip: SkipMethod::None,
                ..settings.clone()
            };
            Some(render(&settings)?.frame)
        } else {
            None
        };
        let most = heatmap::write(path, &first.frame, without.as_ref())?;
        if !args.json {
            eprintln!("{}: 0 to {most} samples a pixel", path.display());
        }
    }
    let empty = vacua::explain_blank(&scene, &settings, &first.frame);
    if let Some(reason) = &empty {
        eprintln!(
            "warning: {}: the picture is empty: {reason}",
            args.output.display()
        );
    }
    if args.json {
        let mut report = Report::new(
            args, &renderer, &path, &scene, &first, load_secs, frame_secs, empty,
        );
        report.lod.largest_bound = largest_bound(args, &renderer)?;
        output::print_json(&report)?;
    }
    Ok(())
}

/// Where the system wants files that only save time, if it says so.
fn cache_folder() -> Option<PathBuf> {
    let folders = etcetera::choose_base_strategy().ok()?;
    Some(folders.cache_dir().join("vacua"))
}

/// How far the values of the picture may be from the exact ones.
fn largest_bound(args: &RenderArgs, renderer: &Backend) -> Result<Option<f64>, Failure> {
    match (args.method.lod, renderer.cpu()) {
        (Detail::Level(level), Some(cpu)) => {
            let bound =
                output::during("looking for the largest error", || cpu.largest_bound(level));
            bound.map_err(|e| Failure::Other(Box::new(e)))
        }
        _ => Ok(None),
    }
}

/// Renders a picture that is written each time it has become better; gives the last.
fn render_progressively(
    args: &RenderArgs,
    renderer: &mut Backend,
    scene: &Scene,
    settings: &RenderSettings,
) -> Result<Rendering, Failure> {
    let mut pictures = Progressive::new(renderer, scene, settings.clone());
    loop {
        let rendered = output::during("rendering", || pictures.next());
        let rendering = match rendered {
            Some(rendered) => rendered.map_err(|e| Failure::Other(Box::new(e)))?,
            None => return Err(Failure::plain("no picture".to_owned())),
        };
        if pictures.remaining() == 0 {
            return Ok(rendering);
        }
        write(args, &rendering)?;
        tracing::info!(
            secs = rendering.report.frame_secs,
            remaining = pictures.remaining(),
            "a picture"
        );
    }
}

fn write(args: &RenderArgs, rendering: &Rendering) -> Result<(), Failure> {
    let frame = &rendering.frame;
    let picture = Picture {
        width: frame.width,
        height: frame.height,
        rgba: &frame.rgba,
        depth: Some(&frame.depth),
        cost: None,
    };
    let background = match args.appearance.background {
        Background::Transparent => None,
        Background::Color(srgb) => {
            Some(srgb.map(|c| vacua_volume::linear_from_srgb(f64::from(c)) as f32))
        }
    };
    Ok(write_picture(&args.output, &picture, background)?)
}
