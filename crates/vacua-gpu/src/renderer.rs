//! The renderer: what is kept between frames, and what an edit redoes.
//!
//! A camera move redoes the march; an edit of the transfer function redoes table, classification and
//! what rays skip by; another macrocell size or volume redoes ranges too. All of it goes in one
//! submission with the frame, but for methods that trace rays: the host must know the number of
//! shapes first.

mod auto;
mod job;
mod mesh;
mod outline;
mod pipelines;
mod submit;

pub use mesh::MeshSample;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use vacua_render::contract::{PackedCells, check};
use vacua_render::{
    Frame, RenderError, RenderReport, RenderSettings, Renderer, Rendering, Scene, SceneData,
    SkipMethod,
};
use vacua_skip::Quad;
use vacua_volume::{TransferFunction, TransferTable, ValueScale, Volume};

use self::job::SkipKey;
use self::mesh::MeshPipelines;
use self::outline::Outline;
use self::pipelines::Pipelines;
use crate::error::GpuError;
use crate::frame::{Picture, blank};
use crate::mesh::DeviceMesh;
use crate::shared::{FACE_NUMBERS, FACE_WORDS, Parameters, TILE};
use crate::skip::DeviceMacrocells;
use crate::table::DeviceTable;
use crate::volume::{DeviceVolume, ImageLimits};
use crate::vulkan::{
    Buffer, Commands, Device, DeviceChoice, Instance, Layout, Place, Preference, Timings,
};

/// Macrocell side where nothing else is asked for or measured.
const DEFAULT_SIDE: usize = 8;

/// Stages that build what rays skip by, once macrocells are classified.
const OF_SKIPPER: [&str; 8] = [
    "distance",
    "faces",
    "cluster",
    "triangles",
    "blas",
    "refit",
    "compact",
    "tlas",
];

/// Frames that are summed in one submission.
const FRAMES_AT_ONCE: u32 = 16;

/// How rays are traced against acceleration structures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Tracer {
    /// By a ray tracing pipeline, as the paper does it.
    Pipeline,
    /// By compute shaders that ask the structures.
    Query,
}

/// How acceleration structures are made (paper A §4.2.3).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StructureOptions {
    /// What they are built for.
    pub preference: Preference,
    /// Whether those over the boundary are copied to where they take less memory.
    pub compact: bool,
    /// Whether after an edit the shapes are moved instead of built anew, as long as they fit.
    pub refit: bool,
}

/// How the renderer works; pictures do not depend on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GpuOptions {
    /// Farthest distance in the distance map, in macrocells, 1 to 255; 1 makes it a plain mask.
    pub reach: u8,
    /// Slices an image may have, if fewer than the device allows.
    pub max_layers: Option<u32>,
    /// How rays are traced by `mesh`; on a pipeline, where there is one, if not given.
    pub tracer: Option<Tracer>,
    /// How acceleration structures are made.
    pub structures: StructureOptions,
    /// Pictures of fewer pixels are not worth measuring for `auto`.
    pub least_pixels: usize,
    /// Bytes a part of a packed mesh may have in one buffer, if fewer than the device allows.
    pub max_buffer_bytes: Option<u64>,
    /// Whether the rays of a subgroup search a packed mesh together.
    pub together: bool,
}

impl Default for GpuOptions {
    fn default() -> Self {
        Self {
            reach: 16,
            max_layers: None,
            tracer: None,
            structures: StructureOptions::default(),
            least_pixels: 1 << 18,
            max_buffer_bytes: None,
            together: true,
        }
    }
}

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
    macrocells: BTreeMap<usize, DeviceMacrocells>,
    look: Option<Look>,
    /// What the mask was made of, and whether distances were made of it.
    skip: Option<SkipKey>,
    has_distances: bool,
    /// What rays are traced against, kept for its memory even where it is out of date.
    outline: Option<Outline>,
    outline_is_current: bool,
    face_counts: Option<Buffer>,
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

/// Faces of the boundary, and the corners of the two triangles of each.
pub type Boundary = (Vec<Quad>, Vec<[[f32; 3]; 6]>);

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
            macrocells: BTreeMap::new(),
            look: None,
            skip: None,
            has_distances: false,
            outline: None,
            outline_is_current: false,
            face_counts: None,
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

    /// Changes how far the distance map reaches, in macrocells; 1 makes it a plain mask.
    pub fn set_reach(&mut self, reach: u8) {
        if reach != self.options.reach {
            self.options.reach = reach;
            self.skip = None;
        }
    }

    /// How `mesh` traces rays, if that was chosen.
    pub fn tracer(&self) -> Option<Tracer> {
        self.options.tracer
    }

    /// Changes how `mesh` traces rays.
    pub fn set_tracer(&mut self, tracer: Option<Tracer>) {
        self.options.tracer = tracer;
    }

    /// Changes how acceleration structures are made.
    pub fn set_structures(&mut self, structures: StructureOptions) {
        self.options.structures = structures;
    }

    /// Makes only a part of every picture.
    pub(crate) fn set_share(&mut self, share: Share) {
        if share != self.share {
            self.share = share;
            self.picture = None;
        }
    }

    /// Bytes of what rays are traced against, and of the acceleration structure over it alone.
    pub fn outline_bytes(&self) -> [u64; 2] {
        let outline = self.outline.as_ref();
        outline.map_or([0; 2], |o| [o.size_bytes(), o.lower.size_bytes()])
    }

    /// Faces of the boundary, or boxes, that rays are traced against.
    pub fn num_outlined(&self) -> usize {
        self.outline.as_ref().map_or(0, |o| o.num as usize)
    }

    /// What the stages of the last picture took on the device: `ranges`, `classify`, `distance`,
    /// `faces`, `triangles`, `blas`, `refit`, `compact`, `tlas` where they were redone, `march` once a
    /// ray a pixel, `copy`; and on the host `cluster`.
    pub fn timings(&self) -> &Timings {
        &self.timings
    }

    /// Bytes of the voxels, or of the packed mesh, on the device.
    pub fn volume_bytes(&self) -> u64 {
        let mesh = self.mesh.as_ref().map_or(0, |m| m.bytes.total());
        mesh + self.volume.as_ref().map_or(0, DeviceVolume::size_bytes)
    }

    /// The ranges of macrocells of a size as the device has them, for tests: lower and upper ends;
    /// `None` if they were never needed.
    ///
    /// # Errors
    /// What the driver says.
    pub fn ranges(&mut self, side: usize) -> Result<Option<Vec<[f32; 2]>>, GpuError> {
        let Some(cells) = self.macrocells.get(&side).filter(|m| m.is_ready) else {
            return Ok(None);
        };
        let len = 8 * cells.len() as usize;
        let bytes = self.read(&side, |m| &m.ranges, len)?;
        Ok(Some(bytemuck::pod_collect_to_vec(&bytes)))
    }

    /// The distance map of the last picture that was made with one, as the device has it, for tests.
    ///
    /// # Errors
    /// What the driver says.
    pub fn distances(&mut self) -> Result<Option<Vec<u8>>, GpuError> {
        let Some(SkipKey { side, .. }) = self.skip.filter(|_| self.has_distances) else {
            return Ok(None);
        };
        let len = self.macrocells.get(&side).map_or(0, DeviceMacrocells::len);
        Ok(Some(self.read(&side, |m| &m.maps[1], len as usize)?))
    }

    /// Which macrocells are active, as the device has it, for tests.
    ///
    /// # Errors
    /// What the driver says.
    pub fn active(&mut self) -> Result<Option<Vec<bool>>, GpuError> {
        let Some(SkipKey { side, .. }) = self.skip else {
            return Ok(None);
        };
        let len = self.macrocells.get(&side).map_or(0, DeviceMacrocells::len);
        let map = self.read(&side, |m| &m.maps[0], len as usize)?;
        Ok(Some(map.iter().map(|&distance| distance == 0).collect()))
    }

    /// The boundary of the last picture by `mesh` as the device has it, for tests: its faces, and
    /// the corners of their triangles.
    ///
    /// # Errors
    /// What the driver says.
    pub fn boundary(&mut self) -> Result<Option<Boundary>, GpuError> {
        let outline = self.outline.as_ref();
        let Some(outline) = outline.filter(|o| o.method() == SkipMethod::Mesh) else {
            return Ok(None);
        };
        let num = outline.num as usize;
        let words = download(
            &self.device,
            &mut self.commands,
            &self.layout,
            (&outline.faces, 4 * FACE_WORDS as usize * num),
        )?;
        let corners = download(
            &self.device,
            &mut self.commands,
            &self.layout,
            (&outline.corners, 4 * FACE_NUMBERS as usize * num),
        )?;
        let words: Vec<u32> = bytemuck::pod_collect_to_vec(&words);
        let quad = |face: &[u32]| Quad {
            axis: (face[0] & 3) as u8,
            faces_up: face[0] >> 2 & 1 == 1,
            plane: face[0] >> 3,
            at: [face[1], face[2]],
        };
        let faces = words.chunks_exact(FACE_WORDS as usize).map(quad).collect();
        let triangles = bytemuck::pod_collect_to_vec(&corners);
        Ok(Some((faces, triangles)))
    }

    fn read(
        &mut self,
        side: &usize,
        buffer: impl Fn(&DeviceMacrocells) -> &Buffer,
        len: usize,
    ) -> Result<Vec<u8>, GpuError> {
        let Some(cells) = self.macrocells.get(side) else {
            return Ok(Vec::new());
        };
        download(
            &self.device,
            &mut self.commands,
            &self.layout,
            (buffer(cells), len),
        )
    }

    fn make(&mut self, scene: &Scene, settings: &RenderSettings) -> Result<Rendering, GpuError> {
        let mut report = self.begin(scene, settings)?;
        let plan = self.plan(scene, settings, &mut report)?;
        let start = Instant::now();
        self.draw(scene, settings, plan)?;
        let mut frame = blank(settings.width, settings.height);
        self.fetch(&mut frame);
        report.frame_secs = start.elapsed().as_secs_f64();
        self.finish(plan, &mut report);
        Ok(Rendering { frame, report })
    }

    /// Brings everything up to date, as far as the host can.
    pub(crate) fn begin(
        &mut self,
        scene: &Scene,
        settings: &RenderSettings,
    ) -> Result<RenderReport, GpuError> {
        check(settings)?;
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
    fn forget(&mut self) {
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
        Ok(self.make(scene, settings)?)
    }
}

/// The first bytes of a buffer.
fn download(
    device: &Arc<Device>,
    commands: &mut Commands,
    layout: &Layout,
    (from, len): (&Buffer, usize),
) -> Result<Vec<u8>, GpuError> {
    let to = Buffer::new(device, "reading", from.size_bytes(), Place::Download)?;
    commands.run(layout, |recorder| {
        recorder.copy(from, &to, 0, from.size_bytes());
        recorder.barrier();
        Ok(())
    })?;
    Ok(to.bytes()[..len].to_vec())
}
