//! Pipelines, compiled when first needed.

use std::collections::HashMap;
use std::sync::Arc;

use vacua_render::{Integrator, RenderSettings, Shading};
use vacua_volume::Association;

use super::GpuRenderer;
use crate::error::GpuError;
use crate::shaders;
use crate::shared::{Parameters, constant, words};
use crate::volume::DeviceVolume;
use crate::vulkan::{
    ComputePipeline, Constant, DeviceInfo, DeviceKind, Layout, RayPipeline, RayShaders,
};

/// A compute shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Shader {
    Ranges,
    Classify,
    Distance,
    BoundaryCount,
    BoundaryScan,
    BoundaryWrite,
    Tree,
    Query,
    Packets(Beams),
    March,
    MarchBeams(Beams),
    MarchRuns,
    Overlay,
}

impl Shader {
    fn spirv(self) -> &'static [u8] {
        match self {
            Self::Ranges => shaders::RANGES,
            Self::Classify => shaders::CLASSIFY,
            Self::Distance => shaders::DISTANCE,
            Self::BoundaryCount => shaders::BOUNDARY_COUNT,
            Self::BoundaryScan => shaders::BOUNDARY_SCAN,
            Self::BoundaryWrite => shaders::BOUNDARY_WRITE,
            Self::Tree => shaders::TREE,
            Self::Query => shaders::QUERY,
            Self::Packets(_) => shaders::PACKETS,
            Self::March => shaders::MARCH,
            Self::MarchBeams(beams) => match (beams.ahead, beams.is_lit) {
                (Ahead::Map, false) => shaders::MARCH_BEAMS,
                (Ahead::Map, true) => shaders::MARCH_BEAMS_LIT,
                (Ahead::Runs, false) => shaders::MARCH_BEAMS_RUNS,
                (Ahead::Runs, true) => shaders::MARCH_BEAMS_RUNS_LIT,
            },
            Self::MarchRuns => shaders::MARCH_RUNS,
            Self::Overlay => shaders::OVERLAY,
        }
    }

    /// The constants that it depends on.
    fn constants(self) -> &'static [u32] {
        use constant::*;
        match self {
            Self::Ranges => &[CELL_DATA, CHECK_FINITE, BLANKED, NUM_SLABS],
            Self::Classify => &[LOG_SCALE, MAXIMUM],
            Self::Distance | Self::BoundaryCount | Self::BoundaryScan | Self::Tree => &[],
            Self::BoundaryWrite | Self::Query | Self::Packets(_) | Self::Overlay => &[RECTILINEAR],
            Self::March | Self::MarchBeams(_) | Self::MarchRuns => &[
                SKIPPING,
                CELL_DATA,
                CHECK_FINITE,
                LOG_SCALE,
                SHADED,
                MAXIMUM,
                BLANKED,
                RECTILINEAR,
                NUM_SLABS,
            ],
        }
    }
}

/// By what subgroups know what is ahead of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Ahead {
    /// The map of macrocells.
    Map,
    /// Runs that another shader has found.
    Runs,
}

/// How the subgroups of a device march over uniform grids, or walk the hierarchy over a boundary.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Beams {
    /// Lanes of one.
    lanes: u32,
    /// Of a workgroup.
    subgroups: u32,
    /// Whether surfaces are lit.
    is_lit: bool,
    ahead: Ahead,
}

impl Beams {
    /// Workgroups of a march, at most: more than a device runs at a time, as each goes on until no tile is
    /// left.
    const MOST_GROUPS: u32 = 1024;

    /// Invocations of a workgroup, if the device has as many: so that compilers give lanes few registers, and
    /// the transfer table is there once for many. An H100's gives 55 with two samples under way, for 32
    /// subgroups on a multiprocessor. Where surfaces are lit it gives 128, and with two samples under way was
    /// 40 % slower than with four.
    const INVOCATIONS: u32 = 512;

    /// The same of packets, which take tiles as they come: small, not to wait for each other.
    const IN_PACKETS: u32 = 128;

    /// `None` if lanes cannot vote, or are too few or too many.
    pub fn new(info: &DeviceInfo, is_lit: bool, ahead: Ahead) -> Option<Self> {
        let lanes = info.subgroup_lanes?;
        if !lanes.is_power_of_two() || !(4..=128).contains(&lanes) {
            return None;
        }
        Some(Self {
            lanes,
            subgroups: Self::subgroups(info, lanes, Self::INVOCATIONS),
            is_lit,
            ahead,
        })
    }

    /// Of packets; `None` as for `new`, or where subgroups have no lane for each level of the hierarchy.
    pub fn of_packets(info: &DeviceInfo) -> Option<Self> {
        let beams = Self::new(info, false, Ahead::Map)?;
        let subgroups = Self::subgroups(info, beams.lanes, Self::IN_PACKETS);
        (beams.lanes >= 8).then_some(Self { subgroups, ..beams })
    }

    /// Subgroups of a workgroup of about so many invocations.
    fn subgroups(info: &DeviceInfo, lanes: u32, invocations: u32) -> u32 {
        // Mesa's lavapipe has all subgroups of a workgroup wait where one does.
        match info.kind {
            DeviceKind::Cpu => 1,
            _ => (invocations.min(info.max_invocations) / lanes).max(1),
        }
    }

    /// Whether a beam is narrow enough for its look at a box of macrocells to tell much: where the middle of the
    /// data is, at most two macrocells.
    pub fn are_narrow(self, parameters: &Parameters) -> bool {
        let columns = 1 << self.lanes.ilog2().div_ceil(2);
        let across = |change: [f32; 4], pixels: u32, of_beam: u32| {
            let change = change[..3]
                .iter()
                .fold(0.0, |most: f32, c| most.max(c.abs()));
            2.0 * change / pixels.max(1) as f32 * of_beam as f32
        };
        let [width, rows, ..] = parameters.picture;
        let x = across(parameters.anchor_x, width, columns);
        let y = across(parameters.anchor_y, rows, self.lanes / columns);
        x + y <= 2.0 * parameters.macrocells[3] as f32
    }

    fn constants(self) -> [Constant; 3] {
        let constant = |id, bits| Constant { id, bits };
        [
            constant(constant::LANES, self.lanes),
            constant(constant::SUBGROUPS, self.subgroups),
            constant(constant::INVOCATIONS, self.lanes * self.subgroups),
        ]
    }

    /// Workgroups that make a picture of a device's own size.
    pub fn groups(self, [width, rows]: [u32; 2]) -> [u32; 3] {
        let pixels = u64::from(width) * u64::from(rows);
        let groups = pixels.div_ceil(u64::from(self.lanes * self.subgroups));
        [groups.min(u64::from(Self::MOST_GROUPS)) as u32, 1, 1]
    }

    /// Workgroups that have a subgroup for every tile of a picture of a device's own size.
    pub fn num_groups(self, [width, rows]: [u32; 2]) -> u64 {
        let columns = 1 << self.lanes.ilog2().div_ceil(2);
        let tiles =
            u64::from(width.div_ceil(columns)) * u64::from(rows.div_ceil(self.lanes / columns));
        tiles.div_ceil(u64::from(self.subgroups))
    }
}

/// What a ray tracing pipeline meets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Met {
    /// Faces of the boundary.
    Mesh,
    /// Proxy boxes.
    Boxes,
}

/// What pipelines are specialised for, in the order of the constants' numbers.
pub(super) type Special = [u32; 9];

/// The specialisation for a volume and settings.
pub(super) fn special(
    volume: &DeviceVolume,
    is_log: bool,
    settings: &RenderSettings,
    is_skipping: bool,
) -> Special {
    let mut special = special_of(is_log, settings, is_skipping);
    let mut set = |id: u32, value: u32| special[id as usize] = value;
    let is_cell_data = volume.volume.association() == Association::Cell;
    set(constant::CELL_DATA, u32::from(is_cell_data));
    set(constant::CHECK_FINITE, u32::from(volume.check_finite));
    set(constant::BLANKED, u32::from(volume.blanked.is_some()));
    set(constant::RECTILINEAR, u32::from(volume.planes.is_some()));
    set(constant::NUM_SLABS, volume.images.len() as u32);
    special
}

/// The part of it that depends on settings alone.
pub(super) fn special_of(is_log: bool, settings: &RenderSettings, is_skipping: bool) -> Special {
    let mut special = [0; 9];
    let mut set = |id: u32, value: u32| special[id as usize] = value;
    set(constant::SKIPPING, u32::from(is_skipping));
    set(constant::LOG_SCALE, u32::from(is_log));
    let is_shaded = settings.shading == Shading::Gradient;
    set(constant::SHADED, u32::from(is_shaded));
    let is_maximum = settings.integrator == Integrator::MaximumIntensity;
    set(constant::MAXIMUM, u32::from(is_maximum));
    set(constant::NUM_SLABS, 1);
    special
}

fn constants(numbers: &[u32], special: Special) -> Vec<Constant> {
    let constant = |&id: &u32| Constant {
        id,
        bits: special[id as usize],
    };
    numbers.iter().map(constant).collect()
}

impl GpuRenderer {
    /// All shaders compiled so far, for [`GpuRenderer::add_compiled_shaders`] of a later run: compiling them
    /// takes some drivers seconds.
    ///
    /// # Errors
    /// What the driver says.
    pub fn compiled_shaders(&self) -> Result<Vec<u8>, GpuError> {
        self.layout.shaders().sealed()
    }

    /// Takes shaders that an earlier run has compiled, as [`GpuRenderer::compiled_shaders`] gave them. Whether they
    /// are taken: not if they are damaged, or were compiled for another device, by another version of its driver
    /// or from other sources. The driver runs what it is given: take them from nowhere else.
    ///
    /// # Errors
    /// What the driver says.
    pub fn add_compiled_shaders(&mut self, shaders: &[u8]) -> Result<bool, GpuError> {
        self.layout.shaders_mut().add(shaders)
    }
}

/// All pipelines so far.
#[derive(Default)]
pub(super) struct Pipelines {
    compute: HashMap<(Shader, Vec<Constant>), Arc<ComputePipeline>>,
    rays: HashMap<(Met, Vec<Constant>), Arc<RayPipeline>>,
}

impl Pipelines {
    /// A compute pipeline, compiled if it is new.
    pub fn get(
        &mut self,
        layout: &Layout,
        shader: Shader,
        special: Special,
    ) -> Result<Arc<ComputePipeline>, GpuError> {
        let mut constants = constants(shader.constants(), special);
        let mut lanes = None;
        if let Shader::MarchBeams(beams) | Shader::Packets(beams) = shader {
            constants.extend(beams.constants());
            lanes = Some(beams.lanes);
        }
        let key = (shader, constants);
        if let Some(found) = self.compute.get(&key) {
            return Ok(found.clone());
        }
        let spirv = words(shader.spirv()).unwrap_or_default();
        let pipeline = Arc::new(ComputePipeline::new(layout, &spirv, &key.1, lanes)?);
        self.compute.insert(key, pipeline.clone());
        Ok(pipeline)
    }

    /// A ray tracing pipeline, compiled if it is new.
    pub fn rays(
        &mut self,
        layout: &Layout,
        met: Met,
        special: Special,
    ) -> Result<Arc<RayPipeline>, GpuError> {
        let key = (met, constants(&[constant::RECTILINEAR], special));
        if let Some(found) = self.rays.get(&key) {
            return Ok(found.clone());
        }
        let code = |spirv| words(spirv).unwrap_or_default();
        let (generation, intersection) = match met {
            Met::Mesh => (shaders::MESH_GENERATION, None),
            Met::Boxes => (
                shaders::BOXES_GENERATION,
                Some(code(shaders::BOXES_INTERSECTION)),
            ),
        };
        let (generation, miss) = (code(generation), code(shaders::TRACE_MISS));
        let closest_hit = code(shaders::TRACE_HIT);
        let shaders = RayShaders {
            generation: &generation,
            miss: &miss,
            closest_hit: Some(&closest_hit),
            any_hit: None,
            intersection: intersection.as_deref(),
        };
        let pipeline = Arc::new(RayPipeline::new(layout, &shaders, &key.1)?);
        self.rays.insert(key, pipeline.clone());
        Ok(pipeline)
    }
}
