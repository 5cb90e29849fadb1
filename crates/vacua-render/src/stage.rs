//! The stages between a volume and its picture, each a value built from the one before.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use vacua_simd::WideMap;
use vacua_skip::{
    ActiveMask, Activity, BoxSkip, GridSkip, Lattice, Macrocells, MeshSkip, NoSkip, PointSource,
    Skipper,
};
use vacua_volume::{TransferFunction, TransferTable, ValueMap, ValueRange, ValueScale};

use crate::blocks::Strides;
use crate::data::SceneData;
use crate::error::RenderError;
use crate::packed::PackedCells;
use crate::scene::{Detail, Integrator, RenderSettings, SkipMethod};
use crate::space::RaySpace;

/// What depends on the volume alone.
#[derive(Debug)]
pub(crate) struct VolumeStage {
    pub data: SceneData,
    pub scale: ValueScale,
    pub space: RaySpace,
    /// The cells, if they lie otherwise than between axis-aligned planes.
    pub packed: Option<PackedCells>,
    pub strides: Strides,
    /// Range of the finite values; `None` if there are none.
    pub range: Option<ValueRange>,
    /// Whether nothing computed from the values can be infinite, no number or subnormal.
    pub plain: bool,
    pub map: ValueMap,
    macrocells: BTreeMap<(Detail, usize), Arc<Macrocells>>,
    /// Seconds spent on macrocells.
    pub macrocell_secs: f64,
}

impl VolumeStage {
    /// Prepares data for transfer functions of one scale.
    pub fn new(data: SceneData, scale: ValueScale) -> Result<Self, RenderError> {
        let packed = PackedCells::of_data(&data)?;
        let space = match &packed {
            Some(cells) => Some(cells.space.clone()),
            None => data.geometry().and_then(RaySpace::of_planes),
        };
        let space = space.ok_or(RenderError::NoPositions)?;
        let profile = data.profile();
        let range = profile.range;
        let map = match (scale, range) {
            (ValueScale::Linear, Some(range)) => {
                ValueMap::for_range(data.scalars().scalar_type(), range)
            }
            _ => ValueMap::IDENTITY,
        };
        let strides = match &packed {
            Some(cells) => cells.strides.clone(),
            None => Strides::new(&space.axes, space.finest.to_array()),
        };
        let macrocells = BTreeMap::new();
        Ok(Self {
            data,
            scale,
            space,
            packed,
            strides,
            range,
            plain: profile.plain,
            map,
            macrocells,
            macrocell_secs: 0.0,
        })
    }

    /// The macrocells of one size, computed when first asked for, from finer ones if there are any.
    pub fn macrocells(
        &mut self,
        detail: Detail,
        side: usize,
    ) -> Result<Arc<Macrocells>, RenderError> {
        if let Some(cells) = self.macrocells.get(&(detail, side)) {
            return Ok(cells.clone());
        }
        let start = Instant::now();
        let finer = self
            .macrocells
            .iter()
            .rev()
            .find(|((of, finer), _)| *of == detail && side.is_multiple_of(*finer));
        let cells = match finer {
            Some(((_, finer), cells)) => cells.coarser(side / finer)?,
            None => {
                let lattice = Lattice::new(self.space.axes.clone(), side)?;
                if let Some(cells) = &self.packed {
                    let cells = match detail {
                        Detail::Exact => cells.macrocells(lattice, self.map),
                        Detail::Level(level) => cells.macrocells_of(level, lattice, self.map),
                    };
                    let cells = Arc::new(cells);
                    return Ok(self.keep((detail, side), cells, start));
                }
                let source = PointSource {
                    scalars: self.data.scalars(),
                    association: self.data.association(),
                    points: self.space.axes.each_ref().map(|axis| axis.cells() + 1),
                    map: self.map,
                    blanked_cells: self.data.blanked_cells(),
                };
                Macrocells::of_grid(lattice, source)
            }
        };
        Ok(self.keep((detail, side), Arc::new(cells), start))
    }

    /// Keeps macrocells that took from `start` until now.
    fn keep(
        &mut self,
        key: (Detail, usize),
        cells: Arc<Macrocells>,
        start: Instant,
    ) -> Arc<Macrocells> {
        self.macrocells.insert(key, cells.clone());
        self.macrocell_secs += start.elapsed().as_secs_f64();
        cells
    }

    /// How stored values become those rendered; `None` for the identity.
    pub fn wide_map(&self) -> Option<WideMap> {
        (!self.map.is_identity()).then_some(WideMap {
            offset: self.map.offset,
            factor: self.map.factor,
        })
    }

    /// Bytes of all macrocells.
    pub fn macrocell_bytes(&self) -> usize {
        self.macrocells.values().map(|m| m.size_bytes()).sum()
    }
}

/// What depends on volume and transfer function.
pub(crate) struct LookStage {
    pub transfer_function: TransferFunction,
    pub table: TransferTable,
    /// Maximum intensity shows values above this rendered value.
    pub threshold: f32,
}

impl LookStage {
    /// Compiles a transfer function for a volume.
    pub fn new(volume: &VolumeStage, transfer_function: &TransferFunction) -> Self {
        let range = volume.range.unwrap_or(transfer_function.domain());
        Self {
            transfer_function: transfer_function.clone(),
            table: TransferTable::new(transfer_function, range, volume.map),
            threshold: volume.map.rendered(transfer_function.color_range().lo),
        }
    }

    /// What an integrator sees of a macrocell.
    pub fn activity(&self, integrator: Integrator) -> Activity<'_> {
        match integrator {
            Integrator::March => Activity::Extinction(&self.table),
            Integrator::MaximumIntensity => Activity::Above(self.threshold),
        }
    }
}

/// What is seen of a macrocell: which values, and what becomes of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Seen {
    pub integrator: Integrator,
    pub detail: Detail,
}

impl Seen {
    /// What settings ask for.
    pub fn of(settings: &RenderSettings) -> Self {
        Self {
            integrator: settings.integrator,
            detail: settings.detail,
        }
    }
}

/// A skipper and what it took to build it.
pub(crate) struct SkipStage {
    pub method: SkipMethod,
    pub side: usize,
    pub skipper: Box<dyn Skipper>,
    /// Seconds to classify the macrocells.
    pub classify_secs: f64,
    /// Seconds to build what follows.
    pub build_secs: f64,
    pub num_active: usize,
    pub num_macrocells: usize,
}

impl SkipStage {
    /// Builds one method's structure.
    pub fn new(
        volume: &mut VolumeStage,
        look: &LookStage,
        seen: Seen,
        method: SkipMethod,
        side: usize,
    ) -> Result<Self, RenderError> {
        if matches!(method, SkipMethod::None) {
            return Ok(Self {
                method,
                side,
                skipper: Box::new(NoSkip),
                classify_secs: 0.0,
                build_secs: 0.0,
                num_active: 0,
                num_macrocells: 0,
            });
        }
        let macrocells = volume.macrocells(seen.detail, side)?;
        let start = Instant::now();
        let mask = ActiveMask::new(&macrocells, look.activity(seen.integrator));
        let classify_secs = start.elapsed().as_secs_f64();
        let num_active = mask.num_active();
        let lattice = macrocells.lattice().clone();
        let start = Instant::now();
        let skipper: Box<dyn Skipper> = match method {
            SkipMethod::None | SkipMethod::Auto | SkipMethod::Grid => {
                Box::new(GridSkip::new(lattice, mask))
            }
            SkipMethod::Boxes => Box::new(BoxSkip::new(&lattice, &mask)),
            SkipMethod::Mesh => Box::new(MeshSkip::new(lattice, mask)),
        };
        let build_secs = start.elapsed().as_secs_f64();
        let num_macrocells = macrocells.lattice().len();
        Ok(Self {
            method,
            side,
            skipper,
            classify_secs,
            build_secs,
            num_active,
            num_macrocells,
        })
    }
}
