//! Places that lie anywhere: put in order along a curve through the mesh, then taken together where
//! they lie close enough together.
//!
//! The curve is Morton's over boxes that hold a few dozen cells each, were all cells alike. Places of
//! one box share packets, so that a batch of many places goes through the trees as compact ones do,
//! and one of few places alone. What is found depends on a place alone, hence not on the batch.

use vacua_simd::{LANES, Simd, prefetch};

use super::packets::Packets;
use super::walk::Scratch;
use super::{BlockSampler, Order, PACKETS, Places, Sampled};

/// Places that are put in order together at most, a multiple of sixteen.
const SORTED: usize = 1 << 20;
/// Cells of a box, were all alike.
const CELLS_IN_BOX: f64 = 32.0;
/// Steps of the curve along a side of a box, as a power of two.
const BOX_LEVELS: u32 = 2;
/// Steps along an axis of the mesh at most.
const MOST_STEPS: u32 = 1 << 10;
/// So many places ahead memory is asked for.
const AHEAD: usize = 32;

/// A curve through a mesh.
#[derive(Clone, Copy, Debug)]
pub(super) struct Curve {
    /// Lower corner of the mesh.
    lo: [f32; 3],
    /// Steps per unit of length.
    steps: f32,
}

/// Where along the curve a place is, above its number.
type Key = u64;

/// The number of a place.
fn number_of(key: Key) -> usize {
    key as u32 as usize
}

/// The box that a place is in.
fn box_of(key: Key) -> u32 {
    (key >> 32) as u32 >> (3 * BOX_LEVELS)
}

impl Curve {
    /// A curve through a box of so many cells.
    pub fn new(lo: [f32; 3], hi: [f32; 3], num_cells: u64) -> Self {
        let sides = [0, 1, 2].map(|a| f64::from(hi[a]) - f64::from(lo[a]));
        let longest = sides.iter().copied().fold(0.0, f64::max);
        let num_boxes = (num_cells as f64 / CELLS_IN_BOX).max(1.0);
        // Flat meshes have boxes as high as they are.
        let volume: f64 = sides
            .iter()
            .map(|s| s.max(longest / f64::from(MOST_STEPS)))
            .product();
        let side = (volume / num_boxes).cbrt();
        let steps = f64::from(1 << BOX_LEVELS) / side;
        Self {
            lo,
            steps: steps.min(f64::from(MOST_STEPS) / longest) as f32,
        }
    }

    #[inline(always)]
    fn code(&self, at: [f32; 3]) -> u32 {
        let mut code = 0;
        for axis in 0..3 {
            // What is not finite or outside becomes any number.
            let step = ((at[axis] - self.lo[axis]) * self.steps) as u32;
            code |= spread(step.min(MOST_STEPS - 1)) << axis;
        }
        code
    }

    /// The places of some lanes in order.
    #[inline(always)]
    fn sort(&self, at: &[Places], lanes: &[u16], order: &mut Vec<Key>) {
        order.clear();
        for (vector, (at, &lanes)) in at.iter().zip(lanes).enumerate() {
            for lane in (0..LANES).filter(|lane| lanes >> lane & 1 == 1) {
                let code = self.code([at[0][lane], at[1][lane], at[2][lane]]);
                order.push(u64::from(code) << 32 | (vector * LANES + lane) as u64);
            }
        }
        order.sort_unstable();
    }
}

/// The ten lowest bits of a number, each moved to three times its place.
#[inline(always)]
fn spread(number: u32) -> u32 {
    let x = number & 0x3FF;
    let x = (x | x << 16) & 0x0300_00FF;
    let x = (x | x << 8) & 0x0300_F00F;
    let x = (x | x << 4) & 0x030C_30C3;
    (x | x << 2) & 0x0924_9249
}

/// Packets of places that were in order.
struct Gathered {
    at: [Places; PACKETS],
    live: [u16; PACKETS],
    /// Number of the first place of each packet in the order.
    first: [usize; PACKETS],
    len: usize,
}

impl BlockSampler<'_> {
    /// The values at places that lie anywhere.
    #[inline(always)]
    pub(super) fn sample_scattered<S: Simd>(
        &self,
        at: &[Places],
        lanes: &[u16],
        sampled: &mut [Sampled],
        scratch: &mut Scratch,
    ) {
        let mut order = Vec::new();
        let mut found = [Sampled::default(); PACKETS];
        let mut gathered = Gathered {
            at: [[[0.0; LANES]; 3]; PACKETS],
            live: [0; PACKETS],
            first: [0; PACKETS],
            len: 0,
        };
        let vectors = SORTED / LANES;
        let chunks = at.chunks(vectors).zip(lanes.chunks(vectors));
        for ((at, lanes), sampled) in chunks.zip(sampled.chunks_mut(vectors)) {
            sampled.fill(Sampled::default());
            self.curve.sort(at, lanes, &mut order);
            let mut next = 0;
            while next < order.len() {
                next = gathered.gather(&order, next, at, sampled);
                let found = &mut found[..gathered.len];
                found.fill(Sampled::default());
                let mut packets = Packets::new(&gathered.at, gathered.live);
                self.walk::<S>(&mut packets, Order::Scattered, scratch, found);
                for (packet, found) in found.iter().enumerate() {
                    let first = gathered.first[packet];
                    deliver(found, order.get(first..).unwrap_or(&[]), sampled);
                }
            }
        }
    }
}

impl Gathered {
    /// Fills packets with places from one in the order on; gives the first that was left over.
    #[inline(always)]
    fn gather(
        &mut self,
        order: &[Key],
        mut next: usize,
        at: &[Places],
        sampled: &[Sampled],
    ) -> usize {
        let axes = at.as_flattened();
        self.live = [0; PACKETS];
        self.len = 0;
        while self.len < PACKETS && next < order.len() {
            let (packet, here) = (self.len % PACKETS, box_of(order[next]));
            self.first[packet] = next;
            let mut lane = 0;
            while lane < LANES && order.get(next).is_some_and(|&key| box_of(key) == here) {
                if let Some(&soon) = order.get(next + AHEAD) {
                    let number = number_of(soon);
                    for axis in 0..3 {
                        prefetch(axes, 3 * (number / LANES) + axis);
                    }
                    prefetch_sampled(sampled, number);
                }
                let number = number_of(order[next]);
                for axis in 0..3 {
                    let from = axes.get(3 * (number / LANES) + axis);
                    self.at[packet][axis][lane] = from.map_or(f32::NAN, |f| f[number % LANES]);
                }
                self.live[packet] |= 1 << lane;
                lane += 1;
                next += 1;
            }
            self.len += 1;
        }
        next
    }
}

/// Asks for the memory that the answer for a place goes to.
#[inline(always)]
fn prefetch_sampled(sampled: &[Sampled], number: usize) {
    if let Some(sampled) = sampled.get(number / LANES) {
        prefetch(&sampled.values, number % LANES);
        prefetch(&sampled.located.submesh, number % LANES);
        prefetch(&sampled.located.primitive, number % LANES);
    }
}

/// Writes down what was found for the places of a packet, the first ones of an order.
#[inline(always)]
fn deliver(found: &Sampled, order: &[Key], sampled: &mut [Sampled]) {
    let located = &found.located;
    let mut left = located.found;
    while left != 0 {
        let lane = left.trailing_zeros() as usize;
        left &= left - 1;
        let number = order.get(lane).map_or(usize::MAX, |&key| number_of(key));
        let Some(home) = sampled.get_mut(number / LANES) else {
            continue;
        };
        let to = number % LANES;
        home.values[to] = found.values[lane];
        home.valid |= (found.valid >> lane & 1) << to;
        home.located.found |= 1 << to;
        home.located.others |= (located.others >> lane & 1) << to;
        home.located.submesh[to] = located.submesh[lane];
        home.located.primitive[to] = located.primitive[lane];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_spread() {
        for number in 0..1024 {
            let expected = (0..10).fold(0, |code, bit| code | (number >> bit & 1) << (3 * bit));
            assert_eq!(spread(number), expected);
        }
    }

    #[test]
    fn places_are_in_the_boxes_of_a_lattice() {
        // 2^15 cells in boxes of 2^5: 2^10 boxes, some ten along each axis.
        let curve = Curve::new([-1.0; 3], [1.0; 3], 1 << 15);
        let boxes_along = 1024f64.cbrt();
        let lattice = |c: f32| ((f64::from(c) + 1.0) / 2.0 * boxes_along) as u32;
        let mut at = [[0.0; LANES]; 3];
        for lane in 0..LANES {
            for axis in 0..3 {
                at[axis][lane] = ((lane * 7 + axis * 5) % 16) as f32 / 8.0 - 0.96;
            }
        }
        let mut order = Vec::new();
        curve.sort(&[at], &[0x7FFF], &mut order);
        assert_eq!(order.len(), 15);
        let place = |key: Key| at.map(|c| c[number_of(key)]);
        for &a in &order {
            for &b in &order {
                let same = (0..3).all(|i| lattice(place(a)[i]) == lattice(place(b)[i]));
                assert_eq!(box_of(a) == box_of(b), same);
            }
        }
    }

    #[test]
    fn no_mesh_is_too_small_for_a_curve() {
        for (lo, hi, cells) in [([0.0; 3], [0.0; 3], 1), ([1.0; 3], [1.0, 2.0, 1.0], 9)] {
            let curve = Curve::new(lo, hi, cells);
            let mut order = Vec::new();
            let mut at = [[1.5; LANES]; 3];
            at[0][0] = f32::NAN;
            at[1][1] = f32::INFINITY;
            at[2][2] = f32::NEG_INFINITY;
            curve.sort(&[at, at], &[0xFFFF, 1], &mut order);
            assert_eq!(order.len(), 17);
        }
    }
}
