//! `auto`: which method and macrocell size render this scene fastest, by measurement.
//!
//! Every candidate renders the same few tiles, spread over the picture; the fastest wins. The
//! tiles are so few that all candidates together cost a few per cent of one frame, and the choice
//! is kept until the transfer function changes. A picture of few tiles is not worth measuring.
//!
//! Candidates are the walk over the mask, with three sizes of macrocells, and, where most of them
//! are active, no skipping at all. Proxy boxes and boundary mesh take several times as long on a
//! CPU in every scene of `vacua-bench auto`; measuring them would cost more than it could win.

use std::time::Instant;

use crate::error::RenderError;
use crate::scene::SkipMethod;
use crate::stage::{LookStage, Seen, SkipStage, VolumeStage};

/// Tiles that each candidate renders, at most.
const PILOT_TILES: usize = 24;

/// Least tiles of a picture for each that is measured: five candidates then cost a twentieth.
const LEAST_SHARE: usize = 100;

/// Least tiles that say anything.
const LEAST_TILES: usize = 8;

/// Macrocell sides that are tried. The first is measured twice, once to warm up.
const SIDES: [usize; 3] = [8, 4, 16];

/// The same for meshes, whose lattice has some cells in each cube already: at most 2 bytes a cell of
/// the mesh at side 1, and a quarter of one at side 2.
const MESH_SIDES: [usize; 3] = [4, 2, 1];

/// Bytes of macrocells that the finest side may take, as a share of the voxels: those of a byte.
const FINEST_SHARE: f64 = 0.13;

/// Share of active macrocells from which not to skip is measured, too.
const MANY_ACTIVE: f64 = 0.5;

/// What `auto` chose.
pub(crate) struct Choice {
    pub stage: SkipStage,
    pub reason: String,
}

/// Measures the candidates; `pilot` renders every n-th tile with a skipper.
pub(crate) fn choose(
    volume: &mut VolumeStage,
    look: &LookStage,
    seen: Seen,
    side: Option<usize>,
    num_tiles: usize,
    pilot: impl Fn(&VolumeStage, &SkipStage, usize),
) -> Result<Choice, RenderError> {
    let build =
        |volume: &mut VolumeStage, method, side| SkipStage::new(volume, look, seen, method, side);
    let every = (num_tiles / PILOT_TILES).max(LEAST_SHARE);
    if num_tiles / every < LEAST_TILES {
        let side = side.unwrap_or(crate::cpu::DEFAULT_MACROCELL_SIDE);
        let stage = build(volume, SkipMethod::Grid, side)?;
        let reason = "the picture is too small to measure".to_owned();
        return Ok(Choice { stage, reason });
    }
    let sides: Vec<usize> = match side {
        Some(side) => vec![side],
        None if volume.packed.is_some() => MESH_SIDES.to_vec(),
        None => {
            let voxel_bytes = volume.data.scalars().bytes().len();
            let affordable = |side: usize| {
                let bytes = 8.0 * volume.data.scalars().tuples() as f64 / (side as f64).powi(3);
                side == 8 || bytes <= FINEST_SHARE * voxel_bytes as f64
            };
            SIDES.into_iter().filter(|&side| affordable(side)).collect()
        }
    };
    if let Some(&finest) = sides.iter().min() {
        // Coarser macrocells are made from finer ones.
        volume.macrocells(seen.detail, finest)?;
    }
    let mut measured: Vec<(f64, SkipStage)> = Vec::new();
    let timed = |volume: &VolumeStage, stage: &SkipStage| {
        let start = Instant::now();
        pilot(volume, stage, every);
        start.elapsed().as_secs_f64()
    };
    let mut many_active = false;
    for (i, &side) in sides.iter().enumerate() {
        let stage = build(volume, SkipMethod::Grid, side)?;
        if i == 0 {
            // Brings the voxels of these tiles into the cache for all candidates alike.
            timed(volume, &stage);
            many_active = stage.num_active as f64 > MANY_ACTIVE * stage.num_macrocells as f64;
        }
        measured.push((timed(volume, &stage), stage));
    }
    if many_active {
        let stage = build(volume, SkipMethod::None, sides[0])?;
        measured.push((timed(volume, &stage), stage));
    }
    let times: Vec<String> = measured
        .iter()
        .map(|(secs, stage)| {
            let what = match stage.method {
                SkipMethod::None => "none".to_owned(),
                method => format!("{} K={}", method.name(), stage.side),
            };
            format!("{what} {:.2} ms", 1e3 * secs)
        })
        .collect();
    let reason = format!("fastest on every {every}th tile: {}", times.join(", "));
    let fastest = measured.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
    match fastest {
        Some((_, stage)) => Ok(Choice { stage, reason }),
        None => unreachable!("there is a side"),
    }
}
