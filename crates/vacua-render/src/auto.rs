//! `auto`: which method and macrocell size render this scene fastest, by measurement.
//!
//! Every candidate renders the same few tiles, spread over the picture; the fastest wins. The
//! tiles are so few that all candidates together cost a few per cent of one frame, and the choice
//! is kept until the transfer function changes. A picture of few tiles is not worth measuring.

use std::time::Instant;

use crate::error::RenderError;
use crate::scene::{Integrator, SkipMethod};
use crate::stage::{LookStage, SkipStage, VolumeStage};

/// Tiles that each candidate renders.
const PILOT_TILES: usize = 96;

/// Least tiles of a picture for each that is measured.
const LEAST_SHARE: usize = 24;

/// Macrocell sides that are tried, coarser ones made from finer ones.
const SIDES: [usize; 3] = [4, 8, 16];

/// Bytes of macrocells that the finest side may take, as a share of the voxels.
const FINEST_SHARE: f64 = 0.05;

/// What `auto` chose.
pub(crate) struct Choice {
    pub stage: SkipStage,
    pub reason: String,
}

/// Measures the candidates; `pilot` renders every n-th tile with a skipper.
pub(crate) fn choose(
    volume: &mut VolumeStage,
    look: &LookStage,
    integrator: Integrator,
    side: Option<usize>,
    num_tiles: usize,
    pilot: impl Fn(&VolumeStage, &SkipStage, usize),
) -> Result<Choice, RenderError> {
    let build = |volume: &mut VolumeStage, method, side| {
        SkipStage::new(volume, look, integrator, method, side)
    };
    let every = num_tiles / PILOT_TILES;
    if every < LEAST_SHARE {
        let side = side.unwrap_or(crate::cpu::DEFAULT_MACROCELL_SIDE);
        let stage = build(volume, SkipMethod::Grid, side)?;
        let reason = "the picture is too small to measure".to_owned();
        return Ok(Choice { stage, reason });
    }
    let voxel_bytes = volume.volume.scalars().bytes().len();
    let sides: Vec<usize> = match side {
        Some(side) => vec![side],
        None => {
            let affordable = |side: usize| {
                let bytes = 8.0 * volume.volume.scalars().tuples() as f64 / (side as f64).powi(3);
                side == 8 || bytes <= FINEST_SHARE * voxel_bytes as f64
            };
            SIDES.into_iter().filter(|&side| affordable(side)).collect()
        }
    };
    let mut candidates = vec![(SkipMethod::None, sides[0])];
    candidates.extend(sides.into_iter().map(|side| (SkipMethod::Grid, side)));
    let mut measured: Vec<(f64, SkipStage)> = Vec::new();
    for (method, side) in candidates {
        let stage = build(volume, method, side)?;
        if measured.is_empty() {
            // Brings the voxels of these tiles into the cache for all candidates alike.
            pilot(volume, &stage, every);
        }
        let start = Instant::now();
        pilot(volume, &stage, every);
        measured.push((start.elapsed().as_secs_f64(), stage));
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
        None => unreachable!("`none` is always measured"),
    }
}
