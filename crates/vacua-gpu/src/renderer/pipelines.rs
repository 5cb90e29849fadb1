//! Pipelines, compiled when first needed.

use std::collections::HashMap;
use std::sync::Arc;

use vacua_render::{Integrator, RenderSettings, Shading};
use vacua_volume::Association;

use crate::error::GpuError;
use crate::shaders;
use crate::shared::{constant, words};
use crate::volume::DeviceVolume;
use crate::vulkan::{ComputePipeline, Constant, Layout};

/// A shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Shader {
    Ranges,
    Classify,
    Distance,
    March,
}

impl Shader {
    fn spirv(self) -> &'static [u8] {
        match self {
            Self::Ranges => shaders::RANGES,
            Self::Classify => shaders::CLASSIFY,
            Self::Distance => shaders::DISTANCE,
            Self::March => shaders::MARCH,
        }
    }

    /// The constants that it depends on.
    fn constants(self) -> &'static [u32] {
        use constant::*;
        match self {
            Self::Ranges => &[CELL_DATA, CHECK_FINITE, BLANKED, NUM_SLABS],
            Self::Classify => &[LOG_SCALE, MAXIMUM],
            Self::Distance => &[],
            Self::March => &[
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

/// What pipelines are specialised for, in the order of the constants' numbers.
pub(super) type Special = [u32; 9];

/// The specialisation for a volume and settings.
pub(super) fn special(
    volume: &DeviceVolume,
    is_log: bool,
    settings: &RenderSettings,
    is_skipping: bool,
) -> Special {
    let mut special = [0; 9];
    let mut set = |id: u32, value: u32| special[id as usize] = value;
    set(constant::SKIPPING, u32::from(is_skipping));
    let is_cell_data = volume.volume.association() == Association::Cell;
    set(constant::CELL_DATA, u32::from(is_cell_data));
    set(constant::CHECK_FINITE, u32::from(volume.check_finite));
    set(constant::LOG_SCALE, u32::from(is_log));
    let is_shaded = settings.shading == Shading::Gradient;
    set(constant::SHADED, u32::from(is_shaded));
    let is_maximum = settings.integrator == Integrator::MaximumIntensity;
    set(constant::MAXIMUM, u32::from(is_maximum));
    set(constant::BLANKED, u32::from(volume.blanked.is_some()));
    set(constant::RECTILINEAR, u32::from(volume.planes.is_some()));
    set(constant::NUM_SLABS, volume.images.len() as u32);
    special
}

/// All pipelines so far.
#[derive(Default)]
pub(super) struct Pipelines(HashMap<(Shader, Vec<Constant>), Arc<ComputePipeline>>);

impl Pipelines {
    /// A pipeline, compiled if it is new.
    pub fn get(
        &mut self,
        layout: &Layout,
        shader: Shader,
        special: Special,
    ) -> Result<Arc<ComputePipeline>, GpuError> {
        let constants: Vec<Constant> = shader
            .constants()
            .iter()
            .map(|&id| Constant {
                id,
                bits: special[id as usize],
            })
            .collect();
        let key = (shader, constants);
        if let Some(found) = self.0.get(&key) {
            return Ok(found.clone());
        }
        let spirv = words(shader.spirv()).unwrap_or_default();
        let pipeline = Arc::new(ComputePipeline::new(layout, &spirv, &key.1)?);
        self.0.insert(key, pipeline.clone());
        Ok(pipeline)
    }
}
