//! The renderer on the CPU.
//!
//! Volume → [`VolumeStage`] (ray space, value map, macrocells) → [`LookStage`] (transfer table) →
//! [`SkipStage`] (active mask, skipper) → frame. A camera move redoes only rays; a
//! transfer-function edit redoes look and skip; a new volume redoes everything. Each stage keeps
//! what it was built from and is rebuilt when that differs, so that none can be stale.

use std::cell::RefCell;
use std::time::Instant;

use vacua_pack::DetailLevel;
use vacua_skip::{ActiveMask, Lattice, MAX_SAMPLES, MeshSkip};
use vacua_volume::ValueScale;

use crate::accumulate::Accumulator;
use crate::auto::choose;
use crate::error::RenderError;
use crate::frame::Frame;
use crate::overlay;
use crate::scene::{Detail, Jitter, Overlay, RenderSettings, Scene, SkipMethod};
use crate::setup::{RaySetup, TILE};
use crate::stage::{LookStage, Seen, SkipStage, VolumeStage};
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
    wanted: Wanted,
    /// Why, if `skip` was chosen automatically.
    reason: Option<String>,
}

impl Stages {
    /// Draws the boundary of the active macrocells, of the size that was used for skipping, over a
    /// picture.
    fn draw_boundary(
        &mut self,
        frame: &mut Frame,
        scene: &Scene,
        settings: &RenderSettings,
    ) -> Result<(), RenderError> {
        let side = self.skip.side;
        let macrocells = self.volume.macrocells(settings.detail, side)?;
        let mask = ActiveMask::new(&macrocells, self.look.activity(settings.integrator));
        let lattice = macrocells.lattice();
        let boundary = MeshSkip::new(lattice.clone(), mask);
        let bounds = scene.data.bounds();
        let view = scene.camera.view(bounds, settings.width, settings.height)?;
        let ray_from_world = self.volume.space.ray_from_world;
        overlay::draw_boundary(frame, &view, ray_from_world, lattice, &boundary);
        Ok(())
    }
}

/// What was asked for when a [`SkipStage`] was made.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Wanted {
    method: SkipMethod,
    side: Option<usize>,
    seen: Seen,
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

    /// How far estimates at a level of detail may be from the values of the mesh that was rendered
    /// last, anywhere, in units of its field: a bound on all their bounds. `None` if nothing was
    /// rendered, or no mesh.
    ///
    /// # Errors
    /// [`RenderError::Lattice`] if the mesh is too long.
    ///
    /// # Cost
    /// One pass over the boxes of the level.
    pub fn largest_bound(&self, level: DetailLevel) -> Result<Option<f64>, RenderError> {
        let volume = self.stages.as_ref().map(|stages| &stages.volume);
        let Some((cells, volume)) = volume.and_then(|v| Some((v.packed.as_ref()?, v))) else {
            return Ok(None);
        };
        let largest = self
            .pool
            .install(|| cells.largest_bound(level, volume.map))?;
        tracing::info!(level = level.name(), largest, "bound of estimates");
        Ok(Some(largest))
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
            let mut ready = prepare(stages.take(), scene, settings, &mut report)?;
            let start = Instant::now();
            let mut frame = render_frames(&ready, scene, settings)?;
            report.frame_secs = start.elapsed().as_secs_f64();
            if settings.overlay == Overlay::Boundary {
                ready.draw_boundary(&mut frame, scene, settings)?;
            }
            *stages = Some(ready);
            Ok(Rendering { frame, report })
        })
    }
}

/// Refuses settings that make no sense.
///
/// # Errors
/// [`RenderError::Size`] or [`RenderError::Step`].
pub fn check(settings: &RenderSettings) -> Result<(), RenderError> {
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
        Some(s) if is_for(&s.volume, scene, scale) => {
            (Some(s.volume), Some((s.look, (s.skip, s.wanted, s.reason))))
        }
        _ => (None, None),
    };
    let mut volume = match volume {
        Some(volume) => volume,
        None => {
            let volume = VolumeStage::new(scene.data.clone(), scale)?;
            report.volume_secs = start.elapsed().as_secs_f64();
            volume
        }
    };
    if volume.packed.is_none() && settings.detail != Detail::Exact {
        return Err(RenderError::NoDetail {
            asked: settings.detail.name(),
        });
    }
    let start = Instant::now();
    let (look, kept) = match kept {
        Some((look, skip)) if look.transfer_function == scene.transfer_function => {
            (look, Some(skip))
        }
        _ => (LookStage::new(&volume, &scene.transfer_function), None),
    };
    let table_secs = start.elapsed().as_secs_f64();
    let wanted = Wanted {
        method: settings.skip,
        side: settings.macrocell_side,
        seen: Seen::of(settings),
    };
    let (skip, reason) = match kept {
        Some((skip, was, reason)) if was == wanted => (skip, reason),
        _ => {
            let before = volume.macrocell_secs;
            let start = Instant::now();
            let (skip, reason) = match settings.skip {
                SkipMethod::Auto => {
                    let rays = Rays::new(&volume, scene, settings)?;
                    let num_tiles = settings.width.div_ceil(TILE) * settings.height.div_ceil(TILE);
                    let frame = RefCell::new(Frame::empty(settings.width, settings.height));
                    let pilot = |volume: &VolumeStage, skip: &SkipStage, every: usize| {
                        let pass = Pass {
                            every,
                            ..rays.pass(volume, &look, skip, settings, 0)
                        };
                        render_pass(pass, volume, &mut frame.borrow_mut());
                    };
                    let side = settings.macrocell_side;
                    let choice = choose(&mut volume, &look, wanted.seen, side, num_tiles, pilot)?;
                    report.auto_secs = start.elapsed().as_secs_f64();
                    (choice.stage, Some(choice.reason))
                }
                method => {
                    let side = settings.macrocell_side.unwrap_or(DEFAULT_MACROCELL_SIDE);
                    (
                        SkipStage::new(&mut volume, &look, wanted.seen, method, side)?,
                        None,
                    )
                }
            };
            report.macrocells_secs = volume.macrocell_secs - before;
            report.classify_secs = table_secs + skip.classify_secs;
            report.skip_secs = skip.build_secs;
            (skip, reason)
        }
    };
    report.method = skip.method;
    report.macrocell_side = skip.side;
    report.num_active = skip.num_active;
    report.num_macrocells = skip.num_macrocells;
    report.macrocell_bytes = volume.macrocell_bytes();
    report.skip_bytes = skip.skipper.size_bytes();
    report.reason.clone_from(&reason);
    Ok(Stages {
        volume,
        look,
        skip,
        wanted,
        reason,
    })
}

fn is_for(stage: &VolumeStage, scene: &Scene, scale: ValueScale) -> bool {
    stage.data.is(&scene.data) && stage.scale == scale
}

/// The rays of a picture, for any skipper.
struct Rays {
    setup: RaySetup,
    lattice: Lattice,
}

impl Rays {
    fn new(
        volume: &VolumeStage,
        scene: &Scene,
        settings: &RenderSettings,
    ) -> Result<Self, RenderError> {
        let bounds = scene.data.bounds();
        let view = scene.camera.view(bounds, settings.width, settings.height)?;
        let space = &volume.space;
        let lattice = Lattice::new(space.axes.clone(), 1)?;
        let mut setup = RaySetup::new(view, space, &lattice, settings.step);
        setup.clip_planes.clone_from(&scene.clip_planes);
        setup.region_of_interest = scene.region_of_interest;
        setup.jitter = match settings.jitter {
            Jitter::Auto => settings.samples_per_pixel > 1 || settings.first_frame > 0,
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
        Ok(Self { setup, lattice })
    }

    /// One frame's pass over the picture.
    fn pass<'a>(
        &'a self,
        volume: &'a VolumeStage,
        look: &'a LookStage,
        skip: &'a SkipStage,
        settings: &RenderSettings,
        frame: u32,
    ) -> Pass<'a> {
        Pass {
            setup: &self.setup,
            lattice: &self.lattice,
            strides: &volume.strides,
            skipper: &*skip.skipper,
            table: &look.table,
            threshold: look.threshold,
            integrator: settings.integrator,
            detail: settings.detail,
            shading: settings.shading,
            termination: settings.termination,
            frame,
            offset: pixel_offset(frame),
            every: 1,
        }
    }
}

/// Where in the pixel the rays of a frame go through: its middle first, then the points of a
/// low-discrepancy sequence (Roberts' R2).
pub fn pixel_offset(frame: u32) -> [f64; 2] {
    const R2: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];
    R2.map(|step| (0.5 + step * f64::from(frame)).fract())
}

/// Renders as many frames as there are samples a pixel and averages them.
fn render_frames(
    stages: &Stages,
    scene: &Scene,
    settings: &RenderSettings,
) -> Result<Frame, RenderError> {
    let rays = Rays::new(&stages.volume, scene, settings)?;
    let render = |frame_number| {
        let mut frame = Frame::empty(settings.width, settings.height);
        let pass = rays.pass(
            &stages.volume,
            &stages.look,
            &stages.skip,
            settings,
            frame_number,
        );
        render_pass(pass, &stages.volume, &mut frame);
        frame
    };
    let first = settings.first_frame;
    let mut mean = Accumulator::new(render(first));
    for more in 1..settings.samples_per_pixel.max(1) {
        mean.add(&render(first.wrapping_add(more)));
    }
    Ok(mean.mean())
}

#[cfg(test)]
mod tests {
    use super::*;
    use vacua_skip::{GridSkip, Macrocells, PointSource};
    use vacua_volume::{
        Association, ColorPoint, ComponentChoice, DataArray, Dataset, Field, FieldChoice, Geometry,
        OpacityPoint, TransferFunction, UniformGrid,
    };

    use crate::camera::Camera;

    const SIDE: usize = 3;

    /// A few bright voxels in the dark.
    fn sparse_scene(seed: u32) -> Scene {
        let points = [13, 11, 12];
        let voxel = |i: u32| {
            let hash = (i ^ seed).wrapping_mul(2_654_435_761) >> 16;
            if hash.is_multiple_of(97) { 200u8 } else { 0 }
        };
        let voxels: Vec<u8> = (0..points.iter().product::<usize>() as u32)
            .map(voxel)
            .collect();
        let array = DataArray::from_vec(voxels, 1).expect("one component");
        let grid = UniformGrid::new(points, glam::DVec3::ZERO, glam::DVec3::ONE).expect("a grid");
        let field = Field::new("f", Association::Point, array);
        let volume = Dataset::new(Geometry::Uniform(grid), vec![field])
            .and_then(|d| d.volume(&FieldChoice::Only, ComponentChoice::Auto))
            .expect("it fits together");
        let colors = vec![ColorPoint {
            value: 0.0,
            srgb: [1.0; 3],
        }];
        let opacities = [(0.0, 0.0), (1.0, 0.0), (200.0, 0.9)]
            .map(|(value, opacity)| OpacityPoint { value, opacity });
        let look = TransferFunction::new(colors, opacities.to_vec(), 1.0, ValueScale::Linear);
        Scene::new(volume, look.expect("in order")).camera(Camera::orbit(f64::from(seed), 20.0))
    }

    /// Whether a picture differs when macrocells count `apron` points beyond their cells.
    fn differs(seed: u32, apron: bool) -> bool {
        let scene = sparse_scene(seed);
        let settings = RenderSettings {
            width: 24,
            height: 24,
            skip: SkipMethod::None,
            ..Default::default()
        };
        let mut report = RenderReport::default();
        let mut stages = prepare(None, &scene, &settings, &mut report).expect("a good scene");
        let reference = render_frames(&stages, &scene, &settings).expect("a good scene");
        assert!(!reference.is_blank(), "something is there to be lost");
        let lattice = Lattice::new(stages.volume.space.axes.clone(), SIDE).expect("cells");
        let points = [0, 1, 2].map(|a| stages.volume.space.axes[a].cells() + 1);
        // As if the voxels were values of cells: each belongs to one macrocell alone.
        let (association, points) = if apron {
            (Association::Point, points)
        } else {
            (Association::Cell, points.map(|n| n + 1))
        };
        let source = PointSource {
            scalars: scene.data.scalars(),
            association,
            points,
            map: stages.volume.map,
            blanked_cells: None,
        };
        let macrocells = Macrocells::of_grid(lattice.clone(), source);
        let mask = ActiveMask::new(&macrocells, stages.look.activity(settings.integrator));
        stages.skip.skipper = Box::new(GridSkip::new(lattice, mask));
        let skipped = render_frames(&stages, &scene, &settings).expect("a good scene");
        assert!(
            skipped.total_samples() < reference.total_samples(),
            "something is skipped"
        );
        skipped.rgba != reference.rgba
    }

    /// The negative control of `tests/skipping_is_invisible.rs`: a mistake in the ranges shows.
    #[test]
    fn without_the_apron_skipping_is_visible() {
        for seed in 0..20 {
            assert!(!differs(seed, true), "seed {seed} with the apron");
        }
        let visible = (0..20).filter(|&seed| differs(seed, false)).count();
        assert!(
            visible >= 15,
            "only {visible} of 20 pictures show the mistake"
        );
    }
}
