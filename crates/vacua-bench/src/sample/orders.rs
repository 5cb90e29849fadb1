//! Places in the orders in which samples are asked for, and the time that they take.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use vacua_pack::reference::Places;
use vacua_simd::LANES;

use super::peers::Peer;
use super::picture::Rays;
use crate::cell::Cell;
use crate::timing::{Took, clocked, medians};

/// In which order places are asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Order {
    /// Along the rays of a picture.
    Rays,
    /// As they come.
    Random,
    /// The same places along a curve that fills space.
    Morton,
}

impl Order {
    /// All three.
    pub const ALL: [Self; 3] = [Self::Rays, Self::Random, Self::Morton];

    /// A word for it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Rays => "rays",
            Self::Random => "random",
            Self::Morton => "Morton",
        }
    }
}

/// Why there is no time of a core.
pub(super) const NO_CLOCK: &str = "this system has no clock of a process's own";
/// Blocks of sixteen that a thread takes at a time: of places side by side, and of scattered ones,
/// which what samples may sort.
const CHUNK: usize = 256;
const SCATTERED_CHUNK: usize = 1 << 16;
/// Bits a coordinate of a place on the curve.
const MORTON_BITS: u32 = 16;

/// Work to be timed.
pub(super) enum Work {
    /// Rays of a picture.
    Rays(Rays),
    /// Sixteen places at a time, which lie close together or anywhere.
    Blocks(Vec<Places>, vacua_pack::Order),
}

impl Work {
    /// How many samples it is.
    pub fn num_samples(&self) -> usize {
        match self {
            Self::Rays(rays) => rays.num_samples(),
            Self::Blocks(blocks, _) => blocks.len() * LANES,
        }
    }

    fn num_chunks(&self) -> usize {
        match self {
            Self::Rays(rays) => rays.tiles.len(),
            Self::Blocks(blocks, _) => blocks.len().div_ceil(self.blocks_a_chunk()),
        }
    }

    /// Blocks of a piece, a piece a thread or more.
    fn blocks_a_chunk(&self) -> usize {
        match self {
            Self::Blocks(blocks, vacua_pack::Order::Scattered) => {
                let share = blocks.len().div_ceil(rayon::current_num_threads());
                share.clamp(1, SCATTERED_CHUNK)
            }
            _ => CHUNK,
        }
    }

    /// One of its pieces. The sum keeps the compiler from leaving anything out.
    fn chunk(&self, peer: &Peer, chunk: usize) -> f32 {
        match self {
            Self::Rays(rays) => {
                let mut values = Vec::new();
                if let Some(tile) = rays.tiles.get(chunk) {
                    peer.sample_tile(tile, &mut values);
                }
                values.iter().filter(|v| !v.is_nan()).sum()
            }
            Self::Blocks(blocks, order) => {
                let chunk = blocks.chunks(self.blocks_a_chunk()).nth(chunk);
                chunk.map_or(0.0, |blocks| peer.sum(blocks, *order))
            }
        }
    }
}

/// Random places in a box, and if wished along a curve that fills it.
pub(super) fn places(lo: [f64; 3], hi: [f64; 3], count: usize, sorted: bool) -> Vec<Places> {
    let mut state = 0x9E37_79B9_7F4A_7C15u64;
    let mut unit = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut all: Vec<[f64; 3]> = (0..count.div_ceil(LANES) * LANES)
        .map(|_| [unit(), unit(), unit()])
        .collect();
    if sorted {
        all.par_sort_by_cached_key(|p| morton(*p));
    }
    let place = |p: &[f64; 3], axis: usize| (lo[axis] + p[axis] * (hi[axis] - lo[axis])) as f32;
    let sixteen = |sixteen: &[[f64; 3]]| {
        let mut places = [[0.0; LANES]; 3];
        for (lane, p) in sixteen.iter().enumerate() {
            (0..3).for_each(|axis| places[axis][lane] = place(p, axis));
        }
        places
    };
    all.chunks(LANES).map(sixteen).collect()
}

/// Where a place in the unit cube comes on the curve.
fn morton(place: [f64; 3]) -> u64 {
    let cell = place.map(|c| (c * f64::from(1u32 << MORTON_BITS)) as u64);
    let mut key = 0;
    for bit in (0..MORTON_BITS).rev() {
        for coordinate in cell {
            key = key << 1 | coordinate >> bit & 1;
        }
    }
    key
}

/// Samples a second of several peers that take turns: as time passes, and of a core.
pub(super) fn rates(peers: &[&Peer], work: &Work, repeats: usize) -> Vec<(Cell<f64>, Cell<f64>)> {
    let samples = work.num_samples() as f64;
    let mut all = vec![Vec::new(); peers.len()];
    for _ in 0..repeats {
        for (peer, took) in peers.iter().zip(&mut all) {
            let chunks = (0..work.num_chunks()).into_par_iter();
            let sum = || chunks.map(|chunk| work.chunk(peer, chunk)).sum::<f32>();
            let (sum, this) = clocked(sum);
            std::hint::black_box(sum);
            took.push(this);
        }
    }
    let of_peer = |took: Vec<Took>| {
        let Took { secs, core_secs } = medians(&took);
        let rate = |secs: f64| {
            if secs > 0.0 && samples > 0.0 {
                Cell::Value(samples / secs)
            } else {
                Cell::empty("no sample lies in the mesh")
            }
        };
        (rate(secs), core_secs.map_or(Cell::empty(NO_CLOCK), rate))
    };
    all.into_iter().map(of_peer).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn morton_order_keeps_neighbours_together() {
        let distance = |blocks: &[Places]| {
            let all = blocks.iter().flat_map(|b| (0..LANES).map(|l| b[0][l]));
            let all: Vec<f32> = all.collect();
            all.windows(2).map(|w| (w[0] - w[1]).abs()).sum::<f32>()
        };
        let [random, sorted] = [false, true].map(|s| places([0.0; 3], [1.0; 3], 1 << 12, s));
        assert_eq!(random.len(), 256);
        assert!(distance(&sorted) < 0.2 * distance(&random));
        let sum = |blocks: &[Places]| {
            blocks
                .iter()
                .flatten()
                .flatten()
                .map(|c| f64::from(*c))
                .sum::<f64>()
        };
        assert!((sum(&random) - sum(&sorted)).abs() < 1e-6);
    }
}
