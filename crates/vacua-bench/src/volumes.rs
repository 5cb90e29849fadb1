//! Volumes to measure on, and the stages between a volume and a skipper, one by one.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use vacua_skip::{
    ActiveMask, Activity, Axis, BoundaryMesh, BoxSkip, GridSkip, Lattice, Macrocells, MeshSkip,
    PointSource, Skipper, cluster_boxes,
};
use vacua_synth::{Kind, Spec, generate};
use vacua_volume::{
    ColorPoint, ComponentChoice, FieldChoice, OpacityPoint, TransferFunction,
    TransferFunctionError, TransferTable, ValueMap, ValueRange, Volume,
};

use crate::cell::Cell;
use crate::error::BenchError;
use crate::machine::available_bytes;
use crate::timing::{median, timed};

/// Bytes left for everything but the voxels.
const RESERVE_BYTES: u64 = 1 << 28;

/// Points a side at a part of the full size, at least 2.
pub(crate) fn scaled(points: [usize; 3], scale: f64) -> [usize; 3] {
    points.map(|n| ((n as f64 * scale).round() as usize).max(2))
}

/// Makes a volume, if memory suffices.
pub(crate) fn volume(spec: Spec, scale: f64) -> Result<Arc<Volume>, BenchError> {
    let values = spec.points.map(|n| n as u64).into_iter();
    let bytes = values.fold(spec.scalar_type.size_bytes() as u64, u64::saturating_mul);
    let available_bytes = available_bytes();
    if available_bytes > 0 && bytes.saturating_add(RESERVE_BYTES) > available_bytes {
        return Err(BenchError::Memory {
            name: spec.kind.name().to_owned(),
            needed_bytes: bytes,
            available_bytes,
            scale,
        });
    }
    let made = generate(&spec)?;
    Ok(Arc::new(
        made.volume(&FieldChoice::Only, ComponentChoice::Auto)?,
    ))
}

/// The transfer function made for a kind, its opacities per voxel of the full size: at a smaller
/// scale a ray crosses fewer voxels of the same object, each of which stands for more.
pub(crate) fn look(spec: &Spec, scale: f64) -> Result<TransferFunction, BenchError> {
    let looks = spec.kind.transfer_functions(spec.scalar_type)?;
    let (_, look) = looks.into_iter().next().ok_or(BenchError::Option {
        option: "model",
        actual: spec.kind.name().to_owned(),
        expected: "one with a transfer function",
    })?;
    Ok(look_at_scale(&look, scale)?)
}

/// A transfer function for a volume of a part of its full size.
pub(crate) fn look_at_scale(
    look: &TransferFunction,
    scale: f64,
) -> Result<TransferFunction, TransferFunctionError> {
    TransferFunction::new(
        look.colors().to_vec(),
        look.opacities().to_vec(),
        look.unit_length() * scale,
        look.scale(),
    )
}

/// A transfer function that differs so little that nothing but equality notices: with it, every
/// stage after the macrocells has to be built anew.
pub(crate) fn edited(look: &TransferFunction) -> Result<TransferFunction, TransferFunctionError> {
    let nudge = |c: &ColorPoint| ColorPoint {
        srgb: c.srgb.map(|v| if v > 0.5 { v - 1e-6 } else { v + 1e-6 }),
        ..*c
    };
    TransferFunction::new(
        look.colors().iter().map(nudge).collect(),
        look.opacities().to_vec(),
        look.unit_length(),
        look.scale(),
    )
}

/// A transfer function whose opacities lie higher by a part of its range: a little less is seen.
pub(crate) fn moved(
    look: &TransferFunction,
    part: f64,
) -> Result<TransferFunction, TransferFunctionError> {
    let domain = look.domain();
    let by = part * (domain.hi - domain.lo);
    let shift = |p: &OpacityPoint| OpacityPoint {
        value: p.value + by,
        ..*p
    };
    TransferFunction::new(
        look.colors().to_vec(),
        look.opacities().iter().map(shift).collect(),
        look.unit_length(),
        look.scale(),
    )
}

/// Seconds from an edited transfer function to a skipper that is ready, by stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StageTimes {
    /// `T_tf`: transfer table and active mask.
    pub classify_secs: Cell<f64>,
    /// `T_tris`: boundary faces (`mesh`), clustering (`boxes`), dilated masks (`grid`).
    pub shape_secs: Cell<f64>,
    /// `T_BVH`: the hierarchy over them.
    pub hierarchy_secs: Cell<f64>,
    /// `T_total`, clocked around all of them.
    pub total_secs: Cell<f64>,
}

impl StageTimes {
    /// No figures.
    pub(crate) fn empty(why: &str) -> Self {
        Self {
            classify_secs: Cell::empty(why),
            shape_secs: Cell::empty(why),
            hierarchy_secs: Cell::empty(why),
            total_secs: Cell::empty(why),
        }
    }
}

/// What is built at an edit, by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Built {
    Mesh,
    Boxes,
    Grid,
}

/// Macrocells with all that classifies them.
pub(crate) struct Ready<'a> {
    look: &'a TransferFunction,
    /// Of the values, known once a volume.
    range: ValueRange,
    map: ValueMap,
    lattice: Lattice,
    /// The ranges.
    pub macrocells: Macrocells,
    /// Median seconds to compute them.
    pub macrocell_secs: f64,
}

/// What a mask contains.
pub(crate) struct Counts {
    pub active: u64,
    pub triangles: u64,
    pub boxes: u64,
}

impl<'a> Ready<'a> {
    /// Computes macrocells, `repeats` times.
    pub fn new(
        volume: &Volume,
        look: &'a TransferFunction,
        side: usize,
        repeats: usize,
    ) -> Result<Self, BenchError> {
        let axes = volume
            .geometry()
            .points()
            .map(|n| Axis::Unit { cells: n - 1 });
        let lattice = Lattice::new(axes, side)?;
        let range = volume.scalars().range(0);
        let map = match range {
            Some(range) => ValueMap::for_range(volume.scalars().scalar_type(), range),
            None => ValueMap::IDENTITY,
        };
        let source = PointSource {
            scalars: volume.scalars(),
            association: volume.association(),
            points: volume.geometry().points(),
            map,
            blanked_cells: None,
        };
        let build = || timed(|| Macrocells::of_grid(lattice.clone(), source));
        let (macrocells, _) = build();
        let macrocell_secs = median((0..repeats).map(|_| build().1).collect());
        Ok(Self {
            look,
            range: range.unwrap_or(look.domain()),
            map,
            lattice,
            macrocells,
            macrocell_secs,
        })
    }

    /// Transfer table and mask, as an edit makes them.
    fn classify(&self) -> ActiveMask {
        let table = TransferTable::new(self.look, self.range, self.map);
        ActiveMask::new(&self.macrocells, Activity::Extinction(&table))
    }

    /// What the mask contains.
    pub fn counts(&self) -> Counts {
        let mask = self.classify();
        Counts {
            active: mask.num_active() as u64,
            triangles: BoundaryMesh::new(&mask).num_triangles() as u64,
            boxes: cluster_boxes(&mask).len() as u64,
        }
    }

    /// Median times of `repeats` edits, after one that does not count.
    pub fn edit(&self, built: Built, repeats: usize) -> StageTimes {
        let mut stages: [Vec<f64>; 4] = Default::default();
        self.edit_once(built);
        for _ in 0..repeats {
            let (times, total) = timed(|| self.edit_once(built));
            for (all, secs) in stages.iter_mut().zip(times.into_iter().chain([total])) {
                all.push(secs);
            }
        }
        let [classify, shape, hierarchy, total] = stages.map(median).map(Cell::Value);
        StageTimes {
            classify_secs: classify,
            shape_secs: shape,
            hierarchy_secs: match built {
                Built::Grid => Cell::empty("`grid` has no hierarchy"),
                Built::Mesh | Built::Boxes => hierarchy,
            },
            total_secs: total,
        }
    }

    /// Seconds of the three stages.
    fn edit_once(&self, built: Built) -> [f64; 3] {
        let (mask, classify) = timed(|| self.classify());
        let lattice = self.lattice.clone();
        match built {
            Built::Mesh => {
                let (mesh, shape) = timed(|| BoundaryMesh::new(&mask));
                let (skip, hierarchy) = timed(|| MeshSkip::from_boundary(lattice, mask, mesh));
                [classify, shape, kept(skip, hierarchy)]
            }
            Built::Boxes => {
                let (boxes, shape) = timed(|| cluster_boxes(&mask));
                let (skip, hierarchy) = timed(|| BoxSkip::from_boxes(&lattice, &boxes));
                [classify, shape, kept(skip, hierarchy)]
            }
            Built::Grid => {
                let (skip, shape) = timed(|| GridSkip::new(lattice, mask));
                [classify, kept(skip, shape), 0.0]
            }
        }
    }
}

/// Keeps the compiler from leaving out a skipper that nobody uses.
fn kept(skip: impl Skipper, secs: f64) -> f64 {
    std::hint::black_box(skip.size_bytes());
    secs
}

/// A kind at a part of its full size.
pub(crate) fn spec(kind: Kind, scale: f64) -> Spec {
    Spec::new(kind).with_points(scaled(kind.default_points(), scale))
}
