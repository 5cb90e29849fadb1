//! The renderer: what is kept between frames, and what an edit redoes.
//!
//! A camera move redoes the march; an edit of the transfer function redoes table, classification and
//! distance map; another macrocell size or volume redoes ranges too. All of it goes in one
//! submission with the frame.

mod auto;
mod pipelines;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use vacua_render::contract::{GOLDEN, check, pixel_offset};
use vacua_render::{
    Integrator, Jitter, Overlay, RenderError, RenderReport, RenderSettings, Renderer, Rendering,
    Scene, SceneData, SkipMethod,
};
use vacua_skip::Lattice;
use vacua_volume::{TransferFunction, TransferTable, ValueScale, Volume};

use self::pipelines::{Pipelines, Shader};
use crate::error::GpuError;
use crate::frame::Picture;
use crate::shared::{Parameters, Push, TILE};
use crate::skip::DeviceMacrocells;
use crate::table::DeviceTable;
use crate::view;
use crate::volume::{DeviceVolume, ImageLimits};
use crate::vulkan::{Buffer, Commands, Device, DeviceChoice, Instance, Layout, Place, Timings};

/// Macrocell side where nothing else is asked for or measured.
const DEFAULT_SIDE: usize = 8;

/// Frames that are summed in one submission.
const FRAMES_AT_ONCE: u32 = 16;

/// How the renderer works; pictures do not depend on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GpuOptions {
    /// Farthest distance in the distance map, in macrocells, 1 to 255; 1 makes it a plain mask.
    pub reach: u8,
    /// Slices an image may have, if fewer than the device allows.
    pub max_layers: Option<u32>,
}

impl Default for GpuOptions {
    fn default() -> Self {
        Self {
            reach: 16,
            max_layers: None,
        }
    }
}

/// A renderer on a GPU.
pub struct GpuRenderer {
    volume: Option<DeviceVolume>,
    macrocells: BTreeMap<usize, DeviceMacrocells>,
    look: Option<Look>,
    /// What the distance map was made of.
    skip: Option<SkipKey>,
    choice: Option<(auto::Wanted, auto::Choice)>,
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

/// What a distance map depends on, besides volume and transfer function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct SkipKey {
    side: usize,
    integrator: Integrator,
}

/// Small buffers that are there from the start.
struct Tables {
    parameters: Buffer,
    entries: Buffer,
    next_active: Buffer,
    counter: Buffer,
    counted: Buffer,
    clips: Buffer,
}

/// How a picture is made, once all is settled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Plan {
    method: SkipMethod,
    side: usize,
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
        let device = instance.open(choice)?;
        let layout = Layout::new(&device)?;
        let commands = Commands::new(&device)?;
        let small = |bytes| Buffer::new(&device, "tables", bytes, Place::Device);
        let tables = Tables {
            parameters: small(size_of::<Parameters>() as u64)?,
            entries: small(1 << 14)?,
            next_active: small(1 << 13)?,
            counter: small(4)?,
            counted: Buffer::new(&device, "tables", 4, Place::Download)?,
            clips: small(1 << 12)?,
        };
        Ok(Self {
            volume: None,
            macrocells: BTreeMap::new(),
            look: None,
            skip: None,
            choice: None,
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

    /// What the stages of the last picture took on the device: `ranges`, `classify`, `distance`
    /// where they were redone, `march` once a ray a pixel, `copy`.
    pub fn timings(&self) -> &Timings {
        &self.timings
    }

    /// Bytes of the voxels on the device.
    pub fn volume_bytes(&self) -> u64 {
        self.volume.as_ref().map_or(0, DeviceVolume::size_bytes)
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

    /// The distance map of the last picture as the device has it, for tests.
    ///
    /// # Errors
    /// What the driver says.
    pub fn distances(&mut self) -> Result<Option<Vec<u8>>, GpuError> {
        let Some(SkipKey { side, .. }) = self.skip else {
            return Ok(None);
        };
        let len = self.macrocells.get(&side).map_or(0, DeviceMacrocells::len);
        Ok(Some(self.read(&side, |m| &m.maps[1], len as usize)?))
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
        let from = buffer(cells);
        let to = Buffer::new(&self.device, "reading", from.size_bytes(), Place::Download)?;
        self.commands.run(&self.layout, |recorder| {
            recorder.copy(from, &to, 0, from.size_bytes());
            recorder.barrier();
            Ok(())
        })?;
        Ok(to.bytes()[..len].to_vec())
    }

    fn make(&mut self, scene: &Scene, settings: &RenderSettings) -> Result<Rendering, GpuError> {
        check(settings)?;
        let mut report = RenderReport {
            threads: rayon::current_num_threads(),
            ..Default::default()
        };
        self.prepare(scene, settings, &mut report)?;
        let plan = match settings.skip {
            SkipMethod::Auto => {
                let start = Instant::now();
                let (plan, reason, is_new) = self.choose(scene, settings)?;
                if is_new {
                    report.auto_secs = start.elapsed().as_secs_f64();
                }
                report.reason = Some(reason);
                plan
            }
            method => Plan {
                method,
                side: settings.macrocell_side.unwrap_or(DEFAULT_SIDE),
            },
        };
        let start = Instant::now();
        let frame = self.picture(scene, settings, plan)?;
        report.frame_secs = start.elapsed().as_secs_f64();
        report.method = plan.method;
        report.macrocell_side = plan.side;
        report.macrocells_secs = self.timings.secs("ranges");
        report.classify_secs = self.timings.secs("classify");
        report.skip_secs = self.timings.secs("distance");
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
        }
        Ok(Rendering { frame, report })
    }

    /// Brings volume, transfer function and picture up to date, as far as the host can.
    fn prepare(
        &mut self,
        scene: &Scene,
        settings: &RenderSettings,
        report: &mut RenderReport,
    ) -> Result<(), GpuError> {
        let scale = scene.transfer_function.scale();
        let SceneData::Volume(data) = &scene.data else {
            return Err(GpuError::Unsupported {
                what: "an encoded mesh".to_owned(),
                device: self.device.name().to_owned(),
            });
        };
        let is_for = |v: &DeviceVolume| Arc::ptr_eq(&v.volume, data) && v.scale == scale;
        if !self.volume.as_ref().is_some_and(is_for) {
            let start = Instant::now();
            self.forget();
            self.upload(data, scale)?;
            report.volume_secs = start.elapsed().as_secs_f64();
        }
        let Some(volume) = &self.volume else {
            return Ok(());
        };
        let is_current = |l: &Look| l.transfer_function == scene.transfer_function;
        if !self.look.as_ref().is_some_and(is_current) {
            let function = &scene.transfer_function;
            let range = volume.range.unwrap_or(function.domain());
            let table = TransferTable::new(function, range, volume.map);
            self.look = Some(Look {
                transfer_function: function.clone(),
                table: DeviceTable::new(&table),
                threshold: volume.map.rendered(function.color_range().lo),
                is_sent: false,
            });
            self.skip = None;
            self.choice = None;
        }
        let (width, height) = (settings.width, settings.height);
        let fits = |p: &Picture| p.width == width && p.height == height;
        if !self.picture.as_ref().is_some_and(fits) {
            self.picture = None;
            self.picture = Some(Picture::new(&self.device, width, height)?);
        }
        Ok(())
    }

    /// Frees what belongs to a volume.
    fn forget(&mut self) {
        self.volume = None;
        self.macrocells.clear();
        self.look = None;
        self.skip = None;
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

    /// Renders a picture as planned.
    fn picture(
        &mut self,
        scene: &Scene,
        settings: &RenderSettings,
        plan: Plan,
    ) -> Result<vacua_render::Frame, GpuError> {
        let num_frames = settings.samples_per_pixel.max(1);
        let mut timings = Timings::default();
        for first in (0..num_frames).step_by(FRAMES_AT_ONCE as usize) {
            let frames = first..(first + FRAMES_AT_ONCE).min(num_frames);
            let found = self.submit(scene, settings, plan, frames, num_frames)?;
            timings.0.extend(found.0);
        }
        self.timings = timings;
        match &self.picture {
            Some(picture) => Ok(picture.frame()),
            None => Err(GpuError::Render(RenderError::Size {
                width: settings.width,
                height: settings.height,
            })),
        }
    }

    /// Records and runs some frames of a picture, and all that must be redone before them. Sends
    /// the picture back after the last.
    fn submit(
        &mut self,
        scene: &Scene,
        settings: &RenderSettings,
        plan: Plan,
        frames: std::ops::Range<u32>,
        num_frames: u32,
    ) -> Result<Timings, GpuError> {
        let (Some(volume), Some(look), Some(picture)) =
            (&self.volume, &mut self.look, &self.picture)
        else {
            return Ok(Timings::default());
        };
        let unsupported = |what: &str| GpuError::Unsupported {
            what: what.to_owned(),
            device: self.device.name().to_owned(),
        };
        let is_skipping = match plan.method {
            SkipMethod::None => false,
            SkipMethod::Grid => true,
            other => return Err(unsupported(&format!("--skip {}", other.name()))),
        };
        if settings.overlay != Overlay::None {
            return Err(unsupported("--overlay"));
        }
        let lattice = Lattice::new(volume.space.axes.clone(), plan.side)
            .map_err(|e| GpuError::Render(RenderError::Lattice(e)))?;
        let mut parameters = Parameters::default();
        view::rays(&mut parameters, scene, settings, &volume.space)?;
        let clips = view::half_spaces(scene, &volume.space);
        let clip_bytes: &[u8] = bytemuck::cast_slice(&clips);
        if clip_bytes.len() as u64 > self.tables.clips.size_bytes() {
            return Err(unsupported(&format!("{} clip planes", clips.len())));
        }
        fill(&mut parameters, volume, look, &lattice, clips.len());
        parameters.picture[2] = u32::from(self.options.reach.max(1));
        if is_skipping && !self.macrocells.contains_key(&plan.side) {
            let cells = DeviceMacrocells::new(&self.device, &lattice)?;
            self.macrocells.insert(plan.side, cells);
        }
        let key = SkipKey {
            side: plan.side,
            integrator: settings.integrator,
        };
        let mut push = self.tables.push(volume, picture);
        let mut cells = self.macrocells.get_mut(&plan.side).filter(|_| is_skipping);
        let wants_ranges = cells.as_ref().is_some_and(|m| !m.is_ready);
        let wants_map = is_skipping && self.skip != Some(key);
        if let Some(cells) = &cells {
            push.ranges = cells.ranges.address();
            push.skip = cells.maps[1].address();
        }
        let special = pipelines::special(volume, look.table.is_log, settings, is_skipping);
        let mut get = |shader| self.pipelines.get(&self.layout, shader, special);
        let march = get(Shader::March)?;
        let ranges = wants_ranges.then(|| get(Shader::Ranges)).transpose()?;
        let classify = wants_map.then(|| get(Shader::Classify)).transpose()?;
        let distance = wants_map.then(|| get(Shader::Distance)).transpose()?;
        let tables = &self.tables;
        let table_is_new = !look.is_sent;
        let is_last = frames.end == num_frames;
        let timings = self.commands.run(&self.layout, |recorder| {
            recorder.stage("tables", |r| {
                r.write(&tables.parameters, bytemuck::bytes_of(&parameters));
                if !clips.is_empty() {
                    r.write(&tables.clips, clip_bytes);
                }
                if table_is_new {
                    r.write(&tables.entries, &look.table.entry_bytes());
                    r.write(
                        &tables.next_active,
                        bytemuck::cast_slice(&look.table.next_active),
                    );
                }
                if wants_map {
                    r.clear(&tables.counter);
                }
            });
            if let (Some(cells), Some(pipeline)) = (&cells, &ranges) {
                recorder.stage("ranges", |r| r.dispatch(pipeline, &push, cells.groups()));
            }
            if let (Some(cells), Some(classify), Some(distance)) = (&cells, &classify, &distance) {
                let groups = cells.word_groups();
                let maps = cells.maps.each_ref().map(Buffer::address);
                recorder.stage("classify", |r| {
                    let skip = maps[0];
                    r.dispatch(classify, &Push { skip, ..push }, groups);
                });
                recorder.stage("distance", |r| {
                    for axis in 0..3 {
                        let (from, to) = (axis % 2, (axis + 1) % 2);
                        let pass = Push {
                            skip_before: maps[from],
                            skip: maps[to],
                            axis: axis as u32,
                            ..push
                        };
                        r.dispatch(distance, &pass, groups);
                        r.barrier();
                    }
                });
            }
            for frame in frames {
                let pass = pass(push, settings, frame, num_frames);
                recorder.stage("march", |r| r.dispatch(&march, &pass, tiles(settings)));
            }
            if is_last {
                recorder.stage("copy", |r| {
                    picture.send(r);
                    r.copy(&tables.counter, &tables.counted, 0, 4);
                });
            }
            Ok(())
        })?;
        look.is_sent = true;
        if let Some(cells) = &mut cells {
            cells.is_ready = true;
        }
        if wants_map {
            self.skip = Some(key);
        }
        if is_last && is_skipping {
            let counted: &[u32] = bytemuck::cast_slice(&self.tables.counted.bytes()[..4]);
            self.num_active = counted[0] as usize;
        }
        Ok(timings)
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

impl Tables {
    /// Addresses of everything that does not depend on macrocells.
    fn push(&self, volume: &DeviceVolume, picture: &Picture) -> Push {
        Push {
            table: self.entries.address(),
            next_active: self.next_active.address(),
            counter: self.counter.address(),
            planes: volume.planes.as_ref().map_or(0, |p| p.buffer.address()),
            blanked: volume.blanked.as_ref().map_or(0, Buffer::address),
            clips: self.clips.address(),
            rgba: picture.rgba.address(),
            depth: picture.depth.address(),
            samples: picture.samples.address(),
            ..Push::default()
        }
    }
}

/// Fills in what depends on volume, transfer function and macrocells.
fn fill(
    parameters: &mut Parameters,
    volume: &DeviceVolume,
    look: &Look,
    lattice: &Lattice,
    num_clips: usize,
) {
    let [x, y] = volume.sides.map(|n| 1.0 / n as f32);
    parameters.texel = [x, y, volume.texel[0], volume.texel[1]];
    let [lo, bins_per_key, largest] = look.table.scale;
    parameters.table_scale = [lo, bins_per_key, largest, look.threshold];
    let cells = lattice.axes().each_ref().map(|a| a.cells() as u32);
    parameters.cells = [cells[0], cells[1], cells[2], volume.slab_cells];
    let last = cells.map(|n| (n - 1) as f32);
    parameters.last_cell = [last[0], last[1], last[2], 1.0 / lattice.side() as f32];
    let [cx, cy, cz] = lattice.counts().map(|n| n as u32);
    parameters.macrocells = [cx, cy, cz, lattice.side() as u32];
    parameters.axis_offset[3] = num_clips as u32;
    if let Some(planes) = &volume.planes {
        parameters.axis_offset[..3].copy_from_slice(&planes.offsets);
        parameters.bins_per_unit[..3].copy_from_slice(&planes.bins_per_unit);
    }
}

/// The push constants of one frame among those that are summed.
fn pass(push: Push, settings: &RenderSettings, frame: u32, num_frames: u32) -> Push {
    let number = settings.first_frame.wrapping_add(frame);
    let jitter = match settings.jitter {
        Jitter::Auto => settings.samples_per_pixel > 1 || settings.first_frame > 0,
        Jitter::On => true,
        Jitter::Off => false,
    };
    let is_sum = num_frames > 1 && frame + 1 == num_frames;
    Push {
        offset: pixel_offset(number).map(|v| v as f32),
        jitter: if jitter {
            (f64::from(number) * GOLDEN).fract() as f32
        } else {
            -1.0
        },
        weight: if is_sum { 1.0 / num_frames as f32 } else { 0.0 },
        frame,
        ..push
    }
}

/// Workgroups of the march.
fn tiles(settings: &RenderSettings) -> [u32; 3] {
    let across = |n: usize| (n as u32).div_ceil(TILE);
    [across(settings.width), across(settings.height), 1]
}
