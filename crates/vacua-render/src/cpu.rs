//! The renderer on the CPU.
//!
//! Volume → [`VolumeStage`] (ray space, value map, macrocells) → [`LookStage`] (transfer table) →
//! [`SkipStage`] (active mask, skipper) → frame. A camera move redoes only rays; a
//! transfer-function edit redoes look and skip; a new volume redoes everything. Each stage keeps
//! what it was built from and is rebuilt when that differs, so that none can be stale.

use std::sync::Arc;
use std::time::Instant;

use vacua_skip::{Lattice, MAX_SAMPLES};
use vacua_volume::ValueScale;

use crate::error::RenderError;
use crate::frame::Frame;
use crate::scene::{Jitter, RenderSettings, Scene, SkipMethod};
use crate::setup::RaySetup;
use crate::stage::{LookStage, SkipStage, VolumeStage};
use crate::tiles::{Pass, render_pass};

/// Makes pictures of scenes.
pub trait Renderer {
    /// Renders one picture.
    ///
    /// # Errors
    /// [`RenderError`] if scene or settings make no sense.
    fn render(
        &mut self,
        scene: &Scene,
        settings: &RenderSettings,
    ) -> Result<Rendering, RenderError>;
}

/// A picture and how it came about.
#[derive(Clone, Debug)]
pub struct Rendering {
    /// The picture.
    pub frame: Frame,
    /// How it came about.
    pub report: RenderReport,
}

/// What was built and used for a picture. Times are 0 for what was kept from an earlier one.
#[derive(Clone, Debug, Default)]
pub struct RenderReport {
    /// Seconds for the frame itself.
    pub frame_secs: f64,
    /// Seconds for value range and ray space.
    pub volume_secs: f64,
    /// Seconds for macrocells.
    pub macrocells_secs: f64,
    /// Seconds for transfer table and active mask.
    pub classify_secs: f64,
    /// Seconds for the skipping structure.
    pub skip_secs: f64,
    /// Seconds to choose method and macrocell size.
    pub auto_secs: f64,
    /// The method used.
    pub method: SkipMethod,
    /// Cells a side of a macrocell.
    pub macrocell_side: usize,
    /// Why, if the method was chosen automatically.
    pub reason: Option<String>,
    /// Macrocells in all, 0 if none were used.
    pub num_macrocells: usize,
    /// Active macrocells.
    pub num_active: usize,
    /// Bytes of macrocell ranges.
    pub macrocell_bytes: usize,
    /// Bytes of the skipping structure.
    pub skip_bytes: usize,
    /// Threads used.
    pub threads: usize,
}

/// The renderer on the CPU.
pub struct CpuRenderer {
    pool: rayon::ThreadPool,
    stages: Option<Stages>,
}

struct Stages {
    volume: VolumeStage,
    look: LookStage,
    skip: SkipStage,
}

/// Macrocell side where nothing else is asked for or measured.
pub const DEFAULT_MACROCELL_SIDE: usize = 8;

impl CpuRenderer {
    /// A renderer with `threads` threads; all that the machine has if not given.
    ///
    /// # Errors
    /// [`RenderError::Threads`] if they cannot be started.
    pub fn new(threads: Option<usize>) -> Result<Self, RenderError> {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads.unwrap_or(0))
            .thread_name(|i| format!("vacua-{i}"))
            .build()
            .map_err(|e| RenderError::Threads {
                threads: threads.unwrap_or(0),
                reason: e.to_string(),
            })?;
        Ok(Self { pool, stages: None })
    }

    /// Threads of this renderer.
    pub fn threads(&self) -> usize {
        self.pool.current_num_threads()
    }
}

impl Renderer for CpuRenderer {
    fn render(
        &mut self,
        scene: &Scene,
        settings: &RenderSettings,
    ) -> Result<Rendering, RenderError> {
        check(settings)?;
        let Self { pool, stages } = self;
        pool.install(|| {
            let mut report = RenderReport {
                threads: pool.current_num_threads(),
                ..Default::default()
            };
            let ready = prepare(stages.take(), scene, settings, &mut report)?;
            let start = Instant::now();
            let frame = render_frames(&ready, scene, settings)?;
            report.frame_secs = start.elapsed().as_secs_f64();
            *stages = Some(ready);
            Ok(Rendering { frame, report })
        })
    }
}

fn check(settings: &RenderSettings) -> Result<(), RenderError> {
    let (width, height) = (settings.width, settings.height);
    if !(1..=1 << 16).contains(&width) || !(1..=1 << 16).contains(&height) {
        return Err(RenderError::Size { width, height });
    }
    if !(settings.step > 0.0 && settings.step.is_finite()) {
        return Err(RenderError::Step(settings.step));
    }
    Ok(())
}

/// Builds the stages that cannot be kept.
fn prepare(
    kept: Option<Stages>,
    scene: &Scene,
    settings: &RenderSettings,
    report: &mut RenderReport,
) -> Result<Stages, RenderError> {
    let start = Instant::now();
    let scale = scene.transfer_function.scale();
    let (volume, kept) = match kept {
        Some(s) if is_for(&s.volume, scene, scale) => (Some(s.volume), Some((s.look, s.skip))),
        _ => (None, None),
    };
    let mut volume = match volume {
        Some(volume) => volume,
        None => {
            let volume = VolumeStage::new(scene.volume.clone(), scale)?;
            report.volume_secs = start.elapsed().as_secs_f64();
            volume
        }
    };
    let start = Instant::now();
    let (look, kept) = match kept {
        Some((look, skip)) if look.transfer_function == scene.transfer_function => {
            (look, Some(skip))
        }
        _ => (LookStage::new(&volume, &scene.transfer_function), None),
    };
    let table_secs = start.elapsed().as_secs_f64();
    let side = settings.macrocell_side.unwrap_or(DEFAULT_MACROCELL_SIDE);
    let method = settings.skip;
    let fits =
        |s: &SkipStage| s.method == method && s.side == side && s.integrator == settings.integrator;
    let skip = match kept {
        Some(skip) if fits(&skip) => skip,
        _ => {
            let before = volume.macrocell_secs;
            let skip = SkipStage::new(&mut volume, &look, settings.integrator, method, side)?;
            report.macrocells_secs = volume.macrocell_secs - before;
            report.classify_secs = table_secs + skip.classify_secs;
            report.skip_secs = skip.build_secs;
            skip
        }
    };
    report.method = skip.method;
    report.macrocell_side = skip.side;
    report.num_active = skip.num_active;
    report.num_macrocells = skip.num_macrocells;
    report.macrocell_bytes = volume.macrocell_bytes();
    report.skip_bytes = skip.skipper.size_bytes();
    Ok(Stages { volume, look, skip })
}

fn is_for(stage: &VolumeStage, scene: &Scene, scale: ValueScale) -> bool {
    Arc::ptr_eq(&stage.volume, &scene.volume) && stage.scale == scale
}

/// Renders as many frames as there are samples a pixel and averages them.
fn render_frames(
    stages: &Stages,
    scene: &Scene,
    settings: &RenderSettings,
) -> Result<Frame, RenderError> {
    let bounds = scene.volume.geometry().bounds();
    let view = scene.camera.view(bounds, settings.width, settings.height)?;
    let space = &stages.volume.space;
    let lattice = Lattice::new(space.axes.clone(), 1)?;
    let mut setup = RaySetup::new(view, space, &lattice, settings.step);
    setup.clip_planes.clone_from(&scene.clip_planes);
    setup.region_of_interest = scene.region_of_interest;
    let spp = settings.samples_per_pixel.max(1);
    setup.jitter = match settings.jitter {
        Jitter::Auto => spp > 1,
        Jitter::On => true,
        Jitter::Off => false,
    };
    let samples = setup.longest_ray();
    let limit = MAX_SAMPLES / 2;
    if samples > f64::from(limit) {
        return Err(RenderError::StepTooSmall {
            step: settings.step,
            samples,
            limit,
        });
    }
    let mut frame = Frame::empty(settings.width, settings.height);
    let pass = Pass {
        setup: &setup,
        lattice: &lattice,
        strides: &stages.volume.strides,
        skipper: &*stages.skip.skipper,
        table: &stages.look.table,
        threshold: stages.look.threshold,
        integrator: settings.integrator,
        shading: settings.shading,
        termination: settings.termination,
        frame: 0,
        offset: [0.5, 0.5],
        every: 1,
    };
    render_pass(pass, &stages.volume, &stages.look, &mut frame);
    Ok(frame)
}
