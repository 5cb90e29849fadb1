//! Up to 64 vectors of places that go through the trees together, and what is known of each place.

use vacua_simd::{Float, Int, LANES, Mask, Simd, per_axis};

use crate::pairs::bits;

use super::descend::Leaf;
use super::{Frame, PACKETS, Places};

/// Places of all packets.
const PLACES: usize = PACKETS * LANES;
/// Room for the places in leaves: all of them in the last, after as many before. What is written past
/// the last is overwritten.
pub(super) const ROOM: usize = 2 * PLACES + LANES;
/// Of a place in no cell: above all primitives.
pub(super) const NOT_FOUND: i32 = i32::MAX;

/// Groups of sixteen packets.
pub(super) const GROUPS: usize = PACKETS / LANES;

/// A bit a packet.
pub(super) type PacketMask = u64;

/// Boxes around packets: upper corners, and lower corners with their signs turned, axis by axis.
/// Nothing is within the box of a packet without places.
#[derive(Clone)]
pub(super) struct PacketBoxes {
    pub hi: [[f32; PACKETS]; 3],
    pub turned_lo: [[f32; PACKETS]; 3],
}

/// Places and what is known of them.
pub(super) struct Packets<'a> {
    /// Relative to the mesh's origin.
    pub at: &'a [Places],
    /// Those still looked for, lane by lane.
    pub live: [u16; PACKETS],
    /// In sixteenths of a step of the grid of the sub-mesh at hand.
    grid: [[[f32; LANES]; 3]; PACKETS],
    /// The lowest primitive of the sub-mesh at hand that accepts each; [`NOT_FOUND`] if none has.
    pub primitive: [i32; PLACES],
    /// Values there.
    pub value: [f32; PLACES],
    /// Those whose cell is no tetrahedron.
    pub others: [u16; PACKETS],
    /// Whether the sub-mesh at hand has tetrahedra and other cells.
    pub is_mixed: bool,
}

/// The places in leaves, one after the other, and their numbers among those of all packets.
pub(super) struct InLeaves {
    pub at: [[f32; ROOM]; 3],
    pub number: [i32; ROOM],
    pub len: usize,
}

impl InLeaves {
    pub fn new() -> Self {
        Self {
            at: [[0.0; ROOM]; 3],
            number: [0; ROOM],
            len: 0,
        }
    }

    /// Whether there is room for the places in one more leaf, however many.
    #[inline(always)]
    pub fn has_room(&self) -> bool {
        self.len + PLACES + LANES <= ROOM
    }

    /// The sixteen from a place on: coordinates, and which of the lanes are before an end.
    #[inline(always)]
    pub fn sixteen<S: Simd>(&self, from: usize, end: usize) -> ([S::F; 3], u16) {
        let at = per_axis!(i => load::<S>(&self.at[i], from));
        let left = end - from;
        let lanes = if left < LANES {
            (1u16 << left) - 1
        } else {
            u16::MAX
        };
        (at, lanes)
    }
}

/// Sixteen numbers of an array from a place on.
#[inline(always)]
pub(super) fn load<S: Simd>(values: &[f32], from: usize) -> S::F {
    match values.get(from..).and_then(|rest| rest.first_chunk()) {
        Some(sixteen) => S::F::from_array(*sixteen),
        None => S::F::splat(0.0),
    }
}

/// Writes sixteen numbers to an array from a place on.
#[inline(always)]
pub(super) fn store<S: Simd>(values: S::F, to: &mut [f32], from: usize) {
    if let Some(sixteen) = to.get_mut(from..).and_then(|rest| rest.first_chunk_mut()) {
        *sixteen = values.to_array();
    }
}

impl<'a> Packets<'a> {
    /// Packets of which some lanes are looked for.
    pub fn new(at: &'a [Places], live: [u16; PACKETS]) -> Self {
        Self {
            at,
            live,
            grid: [[[0.0; LANES]; 3]; PACKETS],
            primitive: [NOT_FOUND; PLACES],
            value: [0.0; PLACES],
            others: [0; PACKETS],
            is_mixed: false,
        }
    }

    /// The packets that have live places.
    pub fn mask(&self) -> PacketMask {
        let live = self.live.iter().enumerate();
        live.fold(0, |mask, (i, &lanes)| {
            mask | PacketMask::from(lanes != 0) << i
        })
    }

    /// Boxes around the live places of packets.
    #[inline(always)]
    pub fn boxes<S: Simd>(&self) -> PacketBoxes {
        let nothing = [f32::NEG_INFINITY; PACKETS];
        let mut boxes = PacketBoxes {
            hi: [nothing; 3],
            turned_lo: [nothing; 3],
        };
        let (zero, nowhere) = (S::F::splat(0.0), S::F::splat(f32::NEG_INFINITY));
        for packet in bits(self.mask()) {
            let live = S::M::from_bits(self.live[packet]);
            for axis in 0..3 {
                let at = S::F::from_array(self.at[packet][axis]);
                boxes.hi[axis][packet] = at.select(live, nowhere).highest();
                boxes.turned_lo[axis][packet] = (zero - at).select(live, nowhere).highest();
            }
        }
        boxes
    }

    /// Brings the places of some packets to the grid of a sub-mesh. Rounding is monotone and planes
    /// are exact, so that no place changes its side of a plane.
    #[inline(always)]
    pub fn enter<S: Simd>(&mut self, frame: &Frame, mask: PacketMask) {
        for packet in bits(mask) {
            for axis in 0..3 {
                let at = S::F::from_array(self.at[packet][axis]);
                let at = (at - S::F::splat(frame.base[axis])) * S::F::splat(frame.sixteenths[axis]);
                self.grid[packet][axis] = at.to_array();
            }
        }
    }

    /// Collects the live places in a leaf that no primitive before `first` has accepted, after those
    /// in other leaves; their coordinates are multiplied by `scale`. There must be room for them.
    #[inline(always)]
    pub fn collect<S: Simd>(&self, leaf: &Leaf, scale: f32, first: i32, found: &mut InLeaves) {
        let (lo, hi) = (
            per_axis!(a => S::F::splat(leaf.lo[a])),
            per_axis!(a => S::F::splat(leaf.hi[a])),
        );
        let (first, scale) = (S::I::splat(first), S::F::splat(scale));
        let lane_numbers = S::I::from_array([0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15]);
        let mut len = found.len;
        for packet in bits(leaf.packets) {
            let grid = &self.grid[packet];
            let within = per_axis!(a => {
                let at = S::F::from_array(grid[a]);
                lo[a].le(at) & at.le(hi[a])
            });
            let best = load_i::<S>(&self.primitive, packet * LANES);
            let within = within[0] & within[1] & within[2] & first.lt(best);
            // None as a rule as often as some: written without a branch.
            let lanes = within.to_bits() & self.live[packet];
            let kept = S::M::from_bits(lanes);
            for axis in 0..3 {
                let at = (S::F::from_array(self.at[packet][axis]) * scale).compress(kept);
                store::<S>(at, &mut found.at[axis], len);
            }
            let numbers = lane_numbers + S::I::splat((packet * LANES) as i32);
            let numbers = S::f_from_bits(numbers).compress(kept).to_bits();
            store_i::<S>(numbers, &mut found.number, len);
            len += lanes.count_ones() as usize;
        }
        found.len = len;
    }

    /// One of the places.
    pub fn place(&self, number: i32) -> [f32; 3] {
        let (packet, lane) = (number as usize / LANES, number as usize % LANES);
        let at = self.at.get(packet);
        [0, 1, 2].map(|axis| at.map_or(f32::NAN, |at| at[axis][lane]))
    }

    /// Notes that a primitive accepts a place, and the value there, unless a lower one does; says whether
    /// none did.
    #[inline(always)]
    pub fn note(&mut self, number: i32, primitive: i32, value: f32) -> bool {
        let number = number as usize % PLACES;
        let (best, best_value) = (self.primitive[number], self.value[number]);
        let is_lower = primitive < best;
        self.primitive[number] = if is_lower { primitive } else { best };
        self.value[number] = if is_lower { value } else { best_value };
        is_lower
    }

    /// Notes whether the cell of a place is no tetrahedron.
    #[inline(always)]
    pub fn note_kind(&mut self, number: i32, is_other: bool) {
        let (packet, lane) = (number as usize / LANES % PACKETS, number as usize % LANES);
        self.others[packet] &= !(1 << lane);
        self.others[packet] |= u16::from(is_other) << lane;
    }
}

/// As [`load`] for integers.
#[inline(always)]
pub(super) fn load_i<S: Simd>(values: &[i32], from: usize) -> S::I {
    match values.get(from..).and_then(|rest| rest.first_chunk()) {
        Some(sixteen) => S::I::from_array(*sixteen),
        None => S::I::splat(0),
    }
}

/// As [`store`] for integers.
#[inline(always)]
pub(super) fn store_i<S: Simd>(values: S::I, to: &mut [i32], from: usize) {
    if let Some(sixteen) = to.get_mut(from..).and_then(|rest| rest.first_chunk_mut()) {
        *sixteen = values.to_array();
    }
}
