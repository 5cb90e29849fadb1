//! Estimates at sixteen places at a time.
//!
//! The box around the places goes through the tree: all eight children of a node are tried on it in
//! three comparisons. Only boxes of the level are tried on the places themselves. Places of a vector
//! should lie close together.

use vacua_simd::{Float, Kernel, LANES, Level, Mask, Simd, dispatch_at, per_axis};

use super::{DetailLevel, DetailSampler, NO_SLOT, OVERHANG, Part, WHOLE_SLOT};
use crate::block::{Places, child_boxes, nonzero_bytes, ordered_nibbles};
use crate::layout::{CHILD_DIVISIONS, WIDTH};
use crate::outer::OuterChild;
use crate::packed::Submesh;
use crate::pairs::bits;

/// Estimates at sixteen places.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Estimates {
    /// As rendering sees them; 0 where there is none.
    pub values: [f32; LANES],
    /// The lanes that have one.
    pub valid: u16,
}

impl DetailSampler<'_> {
    /// Estimates at the places of some lanes of many vectors, as many as the shortest list has.
    pub fn sample_all(&self, at: &[Places], lanes: &[u16], estimates: &mut [Estimates]) {
        self.sample_all_at(Level::best(), at, lanes, estimates);
    }

    /// As [`Self::sample_all`] on a given instruction set; the same answer on each.
    pub fn sample_all_at(
        &self,
        level: Level,
        at: &[Places],
        lanes: &[u16],
        estimates: &mut [Estimates],
    ) {
        let sample = SampleAll {
            sampler: self,
            at,
            lanes,
            estimates,
        };
        dispatch_at(level, sample);
    }

    /// The estimate at a place, as [`Self::sample_all`] gives it: its scalar twin.
    pub fn rendered_at(&self, place: [f32; 3]) -> Option<f32> {
        let mut found = Ends::default();
        let in_grid = |submesh: &Submesh, local: [f64; 3]| {
            let grid = submesh.grid;
            [0, 1, 2].map(|a| {
                if self.is_tame {
                    let base = grid.base[a] as f32;
                    let sixteenths = crate::grid::exp2(4 - grid.exponent[a]) as f32;
                    f64::from((local[a] as f32 - base) * sixteenths)
                } else {
                    grid.grid_from_local(local)[a] * f64::from(CHILD_DIVISIONS)
                }
            })
        };
        self.visit_slots(place.map(f64::from), in_grid, |number, slot| {
            found.join(&self.parts[number], slot, 0);
        });
        let estimates = found.estimates();
        (estimates.valid & 1 == 1).then_some(estimates.values[0])
    }
}

/// The ends of the ranges so far.
struct Ends {
    lo: [f32; LANES],
    hi: [f32; LANES],
}

impl Default for Ends {
    fn default() -> Self {
        Self {
            lo: [f32::INFINITY; LANES],
            hi: [f32::NEG_INFINITY; LANES],
        }
    }
}

impl Ends {
    /// Widens a lane's range.
    #[inline(always)]
    fn join(&mut self, part: &Part, slot: [u8; 2], lane: usize) {
        let Some(steps) = part.steps.as_ref().filter(|_| slot[0] <= slot[1]) else {
            return;
        };
        let [lo, hi] = steps.ends(slot);
        self.lo[lane] = self.lo[lane].min(lo);
        self.hi[lane] = self.hi[lane].max(hi);
    }

    /// The middles.
    #[inline(always)]
    fn estimates(&self) -> Estimates {
        let mut estimates = Estimates::default();
        for lane in 0..LANES {
            let value = 0.5 * self.lo[lane] + 0.5 * self.hi[lane];
            // Infinite ends of nothing have no middle.
            let valid = value.is_finite() && self.lo[lane] <= self.hi[lane];
            estimates.values[lane] = if valid { value } else { 0.0 };
            estimates.valid |= u16::from(valid) << lane;
        }
        estimates
    }
}

/// Estimates at many places.
struct SampleAll<'a> {
    sampler: &'a DetailSampler<'a>,
    at: &'a [Places],
    lanes: &'a [u16],
    estimates: &'a mut [Estimates],
}

impl Kernel for SampleAll<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        let sampler = self.sampler;
        let mut walk = Walk {
            sampler,
            outer: Vec::new(),
            nodes: Vec::new(),
        };
        let places = self.at.iter().zip(self.lanes);
        for ((at, &lanes), estimates) in places.zip(self.estimates) {
            *estimates = if sampler.is_tame {
                walk.sample::<S>(at, lanes)
            } else {
                sampler.one_by_one(at, lanes)
            };
        }
    }
}

impl DetailSampler<'_> {
    /// The answer of the scalar twin, for meshes that vectors cannot serve.
    #[cold]
    #[inline(never)]
    fn one_by_one(&self, at: &Places, lanes: u16) -> Estimates {
        let mut estimates = Estimates::default();
        for lane in (0..LANES).filter(|lane| lanes >> lane & 1 == 1) {
            if let Some(value) = self.rendered_at([at[0][lane], at[1][lane], at[2][lane]]) {
                estimates.values[lane] = value;
                estimates.valid |= 1 << lane;
            }
        }
        estimates
    }
}

/// Places on their way through the trees.
struct Walk<'a> {
    sampler: &'a DetailSampler<'a>,
    outer: Vec<u32>,
    nodes: Vec<u32>,
}

/// Some of sixteen places, and the box around them.
#[derive(Clone, Copy)]
struct Packet<S: Simd> {
    at: [S::F; 3],
    lanes: S::M,
    lo: [f32; 3],
    hi: [f32; 3],
}

impl<S: Simd> Packet<S> {
    /// Some lanes, at least one, of places.
    #[inline(always)]
    fn new(at: [S::F; 3], lanes: S::M) -> Self {
        let (none, all) = (S::F::splat(f32::INFINITY), S::F::splat(f32::NEG_INFINITY));
        Self {
            at,
            lanes,
            lo: per_axis!(a => at[a].select(lanes, none).lowest()),
            hi: per_axis!(a => at[a].select(lanes, all).highest()),
        }
    }

    /// The lanes whose place is in a box.
    #[inline(always)]
    fn inside(&self, lo: [f32; 3], hi: [f32; 3]) -> S::M {
        let inside = per_axis!(a => {
            S::F::splat(lo[a]).le(self.at[a]) & self.at[a].le(S::F::splat(hi[a]))
        });
        self.lanes & inside[0] & inside[1] & inside[2]
    }
}

/// The smallest slots that contain those found in a sub-mesh so far, lower and upper steps apart.
#[derive(Clone, Copy)]
struct Slots<S: Simd> {
    lo: S::F,
    hi: S::F,
}

impl<S: Simd> Slots<S> {
    #[inline(always)]
    fn join(&mut self, lanes: S::M, slot: [u8; 2]) {
        let (lo, hi) = (
            S::F::splat(f32::from(slot[0])),
            S::F::splat(f32::from(slot[1])),
        );
        self.lo = self.lo.min(lo).select(lanes, self.lo);
        self.hi = self.hi.max(hi).select(lanes, self.hi);
    }
}

impl Walk<'_> {
    #[inline(always)]
    fn sample<S: Simd>(&mut self, at: &Places, lanes: u16) -> Estimates {
        let at = per_axis!(a => S::F::from_array(at[a]));
        let largest = S::F::splat(f32::MAX);
        let finite = at[0].abs().le(largest) & at[1].abs().le(largest) & at[2].abs().le(largest);
        let lanes = S::M::from_bits(lanes) & finite;
        if !lanes.any() {
            return Estimates::default();
        }
        let packet = Packet::<S>::new(at, lanes);
        let mut ends = Ends::default();
        self.outer.clear();
        self.outer.push(0);
        while let Some(place) = self.outer.pop() {
            let Some(node) = self.sampler.tree.get(place as usize) else {
                continue;
            };
            let (base, per_unit) = node.grid();
            // Rounding is monotone.
            let lo = per_axis!(a => (packet.lo[a] - base[a]) * per_unit[a]);
            let hi = per_axis!(a => (packet.hi[a] - base[a]) * per_unit[a]);
            for k in 0..node.num_children() {
                let (from, to) = node.child_steps(k);
                let meets = (from[0] <= hi[0])
                    & (from[1] <= hi[1])
                    & (from[2] <= hi[2])
                    & (lo[0] <= to[0])
                    & (lo[1] <= to[1])
                    & (lo[2] <= to[2]);
                if !meets {
                    continue;
                }
                match node.child(k) {
                    // Children come after their parents, so that no walk is endless.
                    OuterChild::Node(below) if below > place => self.outer.push(below),
                    OuterChild::Node(_) => {}
                    OuterChild::Item(item) => self.visit_item::<S>(item, &packet, &mut ends),
                }
            }
        }
        ends.estimates()
    }

    #[inline(always)]
    fn visit_item<S: Simd>(&mut self, item: u32, packet: &Packet<S>, ends: &mut Ends) {
        let sampler = self.sampler;
        let Some((number, first)) = sampler.enter(item) else {
            return;
        };
        let Some(part) = sampler.parts.get(number).filter(|p| p.steps.is_some()) else {
            return;
        };
        let Some(submesh) = sampler.mesh.submesh(number) else {
            return;
        };
        let Some((lo, hi)) = sampler.entry_box(&submesh, first) else {
            return;
        };
        // Exact: corners of the box around some positions, or whole steps of the grid.
        let lanes = packet.inside(lo.map(|c| c as f32), hi.map(|c| c as f32));
        if !lanes.any() {
            return;
        }
        let mut slots = Slots::<S> {
            lo: S::F::splat(f32::from(NO_SLOT[0])),
            hi: S::F::splat(f32::from(NO_SLOT[1])),
        };
        if sampler.level == DetailLevel::Submesh {
            slots.join(lanes, WHOLE_SLOT);
        } else {
            let at = per_axis!(a => {
                (packet.at[a] - S::F::splat(part.base[a])) * S::F::splat(part.sixteenths[a])
            });
            let inside = Packet::<S>::new(at, lanes);
            // For all eight children at once: upper corners against their lower ones in the first
            // block, lower ones with signs turned in the second.
            let reach = per_axis!(a => S::F::of_blocks(inside.hi[a], -inside.lo[a]));
            self.nodes.clear();
            self.nodes.push(first);
            while let Some(node) = self.nodes.pop() {
                self.visit_node::<S>(number, &submesh, node, &inside, &reach, &mut slots);
            }
        }
        let (lo, hi) = (slots.lo.to_array(), slots.hi.to_array());
        for lane in bits(u64::from(lanes.to_bits())) {
            ends.join(part, [lo[lane] as u8, hi[lane] as u8], lane);
        }
    }

    #[inline(always)]
    fn visit_node<S: Simd>(
        &mut self,
        number: usize,
        submesh: &Submesh,
        place: u32,
        packet: &Packet<S>,
        reach: &[S::F; 3],
        slots: &mut Slots<S>,
    ) {
        let Some((node, first_child)) = submesh.node(place) else {
            return;
        };
        let Some(ranges) = self.sampler.field.slots(self.sampler.mesh, number, place) else {
            return;
        };
        // Lower corners in the first block, upper ones with signs turned in the second.
        let corners = child_boxes::<S>(node);
        let leaves = nonzero_bytes(node.counts);
        let inner = ordered_nibbles(node.child_bounds[0]) & !leaves;
        if inner != 0 {
            let slack = S::F::splat(OVERHANG as f32);
            let meets = per_axis!(a => corners[a].le(reach[a] + slack));
            let meets = both_blocks(meets[0] & meets[1] & meets[2]);
            for child in bits(u64::from(inner & meets)) {
                let before = (inner & ((1u8 << child) - 1)).count_ones();
                let below = first_child.saturating_add(before);
                if below > place {
                    submesh.prefetch_node(below);
                    self.nodes.push(below);
                }
            }
        }
        if leaves == 0 {
            return;
        }
        let each = per_axis!(a => corners[a].to_array());
        if self.sampler.level == DetailLevel::MultiLeaf {
            let (lo, hi, slot) = around(leaves, &each, ranges);
            slots.join(packet.inside(lo, hi), slot);
            return;
        }
        let meets = per_axis!(a => corners[a].le(reach[a]));
        let meets = both_blocks(meets[0] & meets[1] & meets[2]);
        for child in bits(u64::from(leaves & meets)) {
            let lo = per_axis!(a => each[a][child]);
            let hi = per_axis!(a => -each[a][WIDTH + child]);
            slots.join(packet.inside(lo, hi), ranges[child]);
        }
    }
}

/// The children that are in both halves of a mask.
#[inline(always)]
fn both_blocks<M: Mask>(mask: M) -> u8 {
    let bits = mask.to_bits();
    bits as u8 & (bits >> WIDTH) as u8
}

/// The box around some children, and the smallest slot that contains theirs; corners as of
/// [`child_boxes`].
#[inline(always)]
fn around(
    children: u8,
    corners: &[[f32; LANES]; 3],
    ranges: &[[u8; 2]; WIDTH],
) -> ([f32; 3], [f32; 3], [u8; 2]) {
    let mut ends = [[f32::INFINITY; 2]; 3];
    let mut slot = NO_SLOT;
    for child in 0..WIDTH {
        if children >> child & 1 == 0 {
            continue;
        }
        for axis in 0..3 {
            ends[axis][0] = ends[axis][0].min(corners[axis][child]);
            ends[axis][1] = ends[axis][1].min(corners[axis][WIDTH + child]);
        }
        slot = [slot[0].min(ranges[child][0]), slot[1].max(ranges[child][1])];
    }
    (ends.map(|e| e[0]), ends.map(|e| -e[1]), slot)
}
