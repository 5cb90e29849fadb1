//! The renderer: what is kept between frames, and what an edit redoes.
//!
//! A camera move redoes the march; an edit of the transfer function redoes table, classification and
//! what rays skip by; another macrocell size or volume redoes ranges too. All of it goes in one
//! submission with the frame, but for methods that trace rays: the host must know the number of
//! shapes first.

mod auto;
mod finder;
mod inspect;
mod job;
mod mesh;
mod options;
mod outline;
mod pipelines;
mod subgroups;
mod submit;
mod traced;

pub use inspect::Boundary;
pub use mesh::MeshSample;
pub use options::{GpuOptions, Search, StructureOptions, Tracer};

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use vacua_render::contract::{PackedCells, check};
use vacua_render::{
    Detail, Frame, RenderError, RenderReport, RenderSettings, Renderer, Rendering, Scene,
    SceneData, SkipMethod,
};
use vacua_volume::{TransferFunction, TransferTable, ValueScale, Volume};

use self::job::SkipKey;
use self::mesh::MeshPipelines;
use self::outline::Outline;
use self::pipelines::Pipelines;
pub(crate) use self::traced::MeshStructure;
use self::traced::TracedPipelines;
use crate::error::GpuError;
use crate::frame::{Picture, make_room};
use crate::mesh::DeviceMesh;
use crate::reference::MeshReference;
use crate::shared::{Parameters, TILE};
use crate::skip::DeviceMacrocells;
use crate::table::DeviceTable;
use crate::volume::{DeviceVolume, ImageLimits};
use crate::vulkan::{Buffer, Commands, Device, DeviceChoice, Instance, Layout, Place, Timings};

/// Macrocell side where nothing else is asked for or measured.
const DEFAULT_SIDE: usize = 8;

/// Stages that build what rays skip by, once macrocells are classified.
const OF_SKIPPER: [&str; 9] = [
    "distance",
    "faces",
    "cluster",
    "triangles",
    "blas",
    "tree",
    "refit",
    "compact",
    "tlas",
];

/// For how long a device must be busy until frames are timed: its clocks fall while it rests or waits for a
/// compiler, and frames then took twice as long on an H100.
const UNTIL_CLOCKS_RISE: Duration = Duration::from_millis(200);

/// Frames that are summed in one submission.
const FRAMES_AT_ONCE: u32 = 16;

/// The part of a picture that a device makes: bands of rows, dealt out in turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Share {
    /// Devices that share the picture.
    pub count: u32,
    /// Number of this one.
    pub index: u32,
}

impl Share {
    /// All of it.
    pub const WHOLE: Self = Self { count: 1, index: 0 };

    /// The rows of a picture that are in this part, in order: bands as (first, end).
    pub fn bands(self, rows: usize) -> impl Iterator<Item = (usize, usize)> {
        let band = TILE as usize;
        (self.index as usize..rows.div_ceil(band))
            .step_by(self.count as usize)
            .map(move |b| (b * band, ((b + 1) * band).min(rows)))
    }
}

/// A renderer on a GPU.
pub struct GpuRenderer {
    volume: Option<DeviceVolume>,
    /// The packed mesh, if it is one that is rendered.
    mesh: Option<DeviceMesh>,
    mesh_pipelines: MeshPipelines,
    /// How the next meshes are held, if not as they are packed.
    reference: Option<MeshReference>,
    traced_pipelines: TracedPipelines,
    macrocells: BTreeMap<usize, DeviceMacrocells>,
    look: Option<Look>,
    /// What the mask was made of, and whether distances were made of it.
    skip: Option<SkipKey>,
    has_distances: bool,
    /// What rays are traced against, kept for its memory even where it is out of date.
    outline: Option<Outline>,
    outline_is_current: bool,
    face_counts: Option<Buffer>,
    /// Where rays meet what is active, of the last picture's size at least.
    runs: Option<Buffer>,
    share: Share,
    choice: Option<(auto::Wanted, auto::Choice)>,
    /// Whether the choice is known to suit the transfer function.
    choice_is_reviewed: bool,
    picture: Option<Picture>,
    tables: Tables,
    timings: Timings,
    num_active: usize,
    pipelines: Pipelines,
    layout: Layout,
    commands: Commands,
    options: GpuOptions,
    device: Arc<Device>,
}

/// A transfer function as the device has it.
struct Look {
    transfer_function: TransferFunction,
    table: DeviceTable,
    threshold: f32,
    /// Whether the device has it yet.
    is_sent: bool,
}

/// Small buffers that are there from the start.
struct Tables {
    parameters: Buffer,
    entries: Buffer,
    next_active: Buffer,
    counter: Buffer,
    counted: Buffer,
    clips: Buffer,
    /// What shaders left in the header of the mesh.
    mesh_header: Buffer,
}

/// How a picture is made, once all is settled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Plan {
    method: SkipMethod,
    side: usize,
    /// How `mesh` traces rays.
    tracer: Option<Tracer>,
}

impl GpuRenderer {
    /// A renderer on the device of choice.
    ///
    /// # Errors
    /// [`GpuError`] saying why there is none.
    pub fn new(choice: DeviceChoice) -> Result<Self, GpuError> {
        Self::with_options(&Instance::new(false)?, choice, GpuOptions::default())
    }

    /// A renderer on a device of an instance.
    ///
    /// # Errors
    /// As [`GpuRenderer::new`].
    pub fn with_options(
        instance: &Arc<Instance>,
        choice: DeviceChoice,
        options: GpuOptions,
    ) -> Result<Self, GpuError> {
        Self::on_device(instance.open(choice)?, options)
    }

    /// A renderer on a device that is open.
    pub(crate) fn on_device(device: Arc<Device>, options: GpuOptions) -> Result<Self, GpuError> {
        let layout = Layout::new(&device)?;
        let commands = Commands::new(&device)?;
        let small = |bytes| Buffer::new(&device, "tables", bytes, Place::Device);
        let tables = Tables {
            parameters: small(size_of::<Parameters>() as u64)?,
            entries: small(1 << 14)?,
            next_active: small(1 << 13)?,
            counter: small(8)?,
            counted: Buffer::new(&device, "tables", 8, Place::Download)?,
            clips: small(1 << 12)?,
            mesh_header: Buffer::new(&device, "tables", 256, Place::Download)?,
        };
        Ok(Self {
            volume: None,
            mesh: None,
            mesh_pipelines: MeshPipelines::default(),
            reference: None,
            traced_pipelines: TracedPipelines::default(),
            macrocells: BTreeMap::new(),
            look: None,
            skip: None,
            has_distances: false,
            outline: None,
            outline_is_current: false,
            face_counts: None,
            runs: None,
            share: Share::WHOLE,
            choice: None,
            choice_is_reviewed: false,
            picture: None,
            tables,
            timings: Timings::default(),
            num_active: 0,
            pipelines: Pipelines::default(),
            layout,
            commands,
            options,
            device,
        })
    }

    /// The device it renders on.
    pub fn device(&self) -> &Arc<Device> {
        &self.device
    }

    /// Makes only a part of every picture.
    pub(crate) fn set_share(&mut self, share: Share) {
        if share != self.share {
            self.share = share;
            self.picture = None;
        }
    }

    /// What the stages of the last picture took on the device: `ranges`, `classify`, `distance`,
    /// `faces`, `triangles`, `blas`, `tree`, `refit`, `compact`, `tlas` where they were redone, `find` (where
    /// rays meet what is active, if they are traced) and `march` once a ray a pixel, `copy`; and on the host `cluster`.
    pub fn timings(&self) -> &Timings {
        &self.timings
    }

    /// What the stages of a picture take on the device, several times, one right after the other: nothing
    /// is sent back in between, so that the device does not rest. What is out of date is redone first, and some
    /// frames are made until the device's clocks have risen.
    ///
    /// # Errors
    /// As [`Renderer::render`].
    pub fn time_rays(
        &mut self,
        scene: &Scene,
        settings: &RenderSettings,
        repeats: usize,
    ) -> Result<Vec<Timings>, RenderError> {
        const TO_SETTLE: usize = 3;
        let mut report = self.begin(scene, settings)?;
        let plan = self.plan(scene, settings, &mut report)?;
        // More frames are to come, so that nothing is sent back.
        let mut frame = || self.submit(scene, settings, plan, 0..1, 2);
        let start = Instant::now();
        for i in 0.. {
            if i >= TO_SETTLE && start.elapsed() >= UNTIL_CLOCKS_RISE {
                break;
            }
            frame()?;
        }
        Ok((0..repeats).map(|_| frame()).collect::<Result<_, _>>()?)
    }

    /// Bytes of the voxels, or of the packed mesh, on the device.
    pub fn volume_bytes(&self) -> u64 {
        let mesh = self.mesh.as_ref().map_or(0, |m| m.bytes.total());
        mesh + self.volume.as_ref().map_or(0, DeviceVolume::size_bytes)
    }

    /// Renders one picture into the memory of an earlier one, of whatever size: what is rendered again and
    /// again need not ask the system for memory every time.
    ///
    /// # Errors
    /// As [`Renderer::render`]; what the frame then holds is undefined.
    pub fn render_into(
        &mut self,
        scene: &Scene,
        settings: &RenderSettings,
        frame: &mut Frame,
    ) -> Result<RenderReport, RenderError> {
        Ok(self.make(scene, settings, frame)?)
    }

    fn make(
        &mut self,
        scene: &Scene,
        settings: &RenderSettings,
        frame: &mut Frame,
    ) -> Result<RenderReport, GpuError> {
        let mut report = self.begin(scene, settings)?;
        let plan = self.plan(scene, settings, &mut report)?;
        let start = Instant::now();
        let (drawn, ()) = rayon::join(
            || self.draw(scene, settings, plan),
            || make_room(frame, settings.width, settings.height),
        );
        drawn?;
        self.fetch(frame);
        report.frame_secs = start.elapsed().as_secs_f64();
        self.finish(plan, &mut report);
        Ok(report)
    }

    /// Brings everything up to date, as far as the host can.
    pub(crate) fn begin(
        &mut self,
        scene: &Scene,
        settings: &RenderSettings,
    ) -> Result<RenderReport, GpuError> {
        check(settings)?;
        if settings.detail != Detail::Exact {
            return Err(GpuError::Detail {
                asked: settings.detail.name(),
            });
        }
        let mut report = RenderReport {
            threads: rayon::current_num_threads(),
            ..Default::default()
        };
        self.prepare(scene, settings, &mut report)?;
        Ok(report)
    }

    /// Settles how a picture is made, by measurement where that is asked for.
    pub(crate) fn plan(
        &mut self,
        scene: &Scene,
        settings: &RenderSettings,
        report: &mut RenderReport,
    ) -> Result<Plan, GpuError> {
        if settings.skip != SkipMethod::Auto {
            return Ok(Plan {
                method: settings.skip,
                side: settings.macrocell_side.unwrap_or(DEFAULT_SIDE),
                tracer: self.options.tracer,
            });
        }
        let start = Instant::now();
        let (plan, reason, is_new) = self.choose(scene, settings)?;
        if is_new {
            report.auto_secs = start.elapsed().as_secs_f64();
        }
        report.reason = Some(reason);
        Ok(plan)
    }

    /// Copies this device's rows of the last picture to where they belong.
    pub(crate) fn fetch(&self, frame: &mut Frame) {
        if let Some(picture) = &self.picture {
            picture.copy_into(frame, self.share);
        }
    }

    /// Says what the last picture took.
    pub(crate) fn finish(&mut self, plan: Plan, report: &mut RenderReport) {
        report.method = plan.method;
        report.macrocell_side = plan.side;
        report.macrocells_secs = self.timings.secs("ranges");
        report.classify_secs = self.timings.secs("classify");
        report.skip_secs = OF_SKIPPER.iter().map(|s| self.timings.secs(s)).sum();
        report.macrocell_bytes = self
            .macrocells
            .values()
            .map(|m| m.ranges.size_bytes() as usize)
            .sum();
        if plan.method != SkipMethod::None
            && let Some(cells) = self.macrocells.get(&plan.side)
        {
            report.num_macrocells = cells.len() as usize;
            report.num_active = self.num_active;
            report.skip_bytes = cells.maps.iter().map(|m| m.size_bytes() as usize).sum();
            if matches!(plan.method, SkipMethod::Mesh | SkipMethod::Boxes) {
                report.skip_bytes += self.outline_bytes()[0] as usize;
            }
        }
        self.review_choice(report);
    }

    /// Brings volume, transfer function and picture up to date, as far as the host can.
    fn prepare(
        &mut self,
        scene: &Scene,
        settings: &RenderSettings,
        report: &mut RenderReport,
    ) -> Result<(), GpuError> {
        let scale = scene.transfer_function.scale();
        let is_for = |v: &DeviceVolume| match &scene.data {
            SceneData::Volume(volume) => Arc::ptr_eq(&v.volume, volume) && v.scale == scale,
            SceneData::Packed(_) => false,
        };
        let is_mesh_for = |m: &DeviceMesh| m.data.is(&scene.data) && m.scale == scale;
        if !self.volume.as_ref().is_some_and(is_for) && !self.mesh.as_ref().is_some_and(is_mesh_for)
        {
            let start = Instant::now();
            self.forget();
            match (PackedCells::of_data(&scene.data)?, &scene.data) {
                (Some(cells), data) => self.upload_mesh(data, scale, cells)?,
                (None, SceneData::Volume(volume)) => self.upload(volume, scale)?,
                (None, SceneData::Packed(_)) => {}
            }
            report.volume_secs = start.elapsed().as_secs_f64();
        }
        let (range, map) = match (&self.volume, &self.mesh) {
            (Some(volume), _) => (volume.range, volume.map),
            (None, Some(mesh)) => (mesh.range, mesh.map),
            (None, None) => return Ok(()),
        };
        let is_current = |l: &Look| l.transfer_function == scene.transfer_function;
        if !self.look.as_ref().is_some_and(is_current) {
            let function = &scene.transfer_function;
            let range = range.unwrap_or(function.domain());
            let table = TransferTable::new(function, range, map);
            self.look = Some(Look {
                transfer_function: function.clone(),
                table: DeviceTable::new(&table),
                threshold: map.rendered(function.color_range().lo),
                is_sent: false,
            });
            self.skip = None;
            self.outline_is_current = false;
            self.choice_is_reviewed = false;
        }
        let (width, height) = (settings.width, settings.height);
        let rows = self
            .share
            .bands(height)
            .map(|(first, end)| end - first)
            .sum();
        let fits = |p: &Picture| p.width == width && p.rows == rows;
        if !self.picture.as_ref().is_some_and(fits) {
            self.picture = None;
            self.picture = Some(Picture::new(&self.device, width, rows)?);
        }
        Ok(())
    }

    /// Frees what belongs to a volume.
    pub(crate) fn forget(&mut self) {
        self.volume = None;
        self.mesh = None;
        self.macrocells.clear();
        self.look = None;
        self.skip = None;
        self.outline = None;
        self.outline_is_current = false;
        self.choice = None;
    }

    fn upload(&mut self, volume: &Arc<Volume>, scale: ValueScale) -> Result<(), GpuError> {
        let info = self.device.info();
        // What a device says of the size of allocations is advice that some exceed: one image is
        // faster than several.
        let advised = info.max_allocation_bytes.max(1 << 28);
        let mut made = Err(self.device.too_little("the volume", 0));
        for bytes in [u64::MAX, advised] {
            let limits = ImageLimits {
                side: info.max_side,
                layers: self.options.max_layers.unwrap_or(u32::MAX),
                bytes,
            };
            made = DeviceVolume::new(
                &self.device,
                &mut self.commands,
                &self.layout,
                volume.clone(),
                scale,
                limits,
            );
            if !matches!(made, Err(GpuError::Memory { .. })) {
                break;
            }
        }
        let volume = made?;
        self.layout.bind(&self.tables.parameters, &volume.images);
        self.volume = Some(volume);
        Ok(())
    }

    /// Renders a picture as planned; it stays where the device has sent it.
    pub(crate) fn draw(
        &mut self,
        scene: &Scene,
        settings: &RenderSettings,
        plan: Plan,
    ) -> Result<(), GpuError> {
        let num_frames = settings.samples_per_pixel.max(1);
        let mut timings = Timings::default();
        for first in (0..num_frames).step_by(FRAMES_AT_ONCE as usize) {
            let frames = first..(first + FRAMES_AT_ONCE).min(num_frames);
            let found = self.submit(scene, settings, plan, frames, num_frames)?;
            timings.0.extend(found.0);
        }
        self.timings = timings;
        Ok(())
    }
}

impl Renderer for GpuRenderer {
    fn render(
        &mut self,
        scene: &Scene,
        settings: &RenderSettings,
    ) -> Result<Rendering, RenderError> {
        let mut frame = Frame::empty(0, 0);
        let report = self.make(scene, settings, &mut frame)?;
        Ok(Rendering { frame, report })
    }
}
