//! Estimates at up to sixteen times sixteen places at a time.
//!
//! The box around all places goes through the tree: the eight children of a node are tried on it in
//! three comparisons. A box of the level is tried on the boxes of sixteen vectors of places at once,
//! then on the places of those that it meets. Places of a vector should lie close together, and so
//! should the vectors of every sixteen.

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
        let groups = self.at.chunks(LANES).zip(self.lanes.chunks(LANES));
        for ((at, lanes), estimates) in groups.zip(self.estimates.chunks_mut(LANES)) {
            if sampler.is_tame {
                walk.sample::<S>(at, lanes, estimates);
                continue;
            }
            for ((at, &lanes), estimates) in at.iter().zip(lanes).zip(estimates) {
                *estimates = sampler.one_by_one(at, lanes);
            }
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

/// Up to sixteen vectors of places, and the box around the places of each.
#[derive(Clone)]
struct Crowd<S: Simd> {
    at: [[S::F; 3]; LANES],
    /// Which places there are.
    lanes: [S::M; LANES],
    /// A lane a vector; of those without places, boxes that meet nothing.
    lo: [S::F; 3],
    hi: [S::F; 3],
}

/// A box, each corner in all lanes.
struct Bounds<S: Simd> {
    lo: [S::F; 3],
    hi: [S::F; 3],
}

impl<S: Simd> Bounds<S> {
    #[inline(always)]
    fn new(lo: [f32; 3], hi: [f32; 3]) -> Self {
        Self {
            lo: per_axis!(a => S::F::splat(lo[a])),
            hi: per_axis!(a => S::F::splat(hi[a])),
        }
    }
}

impl<S: Simd> Crowd<S> {
    /// Nobody.
    #[inline(always)]
    fn empty() -> Self {
        Self {
            at: [[S::F::splat(0.0); 3]; LANES],
            lanes: [S::M::from_bits(0); LANES],
            lo: [S::F::splat(f32::INFINITY); 3],
            hi: [S::F::splat(f32::NEG_INFINITY); 3],
        }
    }

    /// Finds the boxes of some vectors; there are no others.
    #[inline(always)]
    fn find_boxes(&mut self, vectors: u16) {
        let (none, all) = (S::F::splat(f32::INFINITY), S::F::splat(f32::NEG_INFINITY));
        let mut lo = [[f32::INFINITY; LANES]; 3];
        let mut hi = [[f32::NEG_INFINITY; LANES]; 3];
        for v in bits(u64::from(vectors)) {
            for a in 0..3 {
                lo[a][v] = self.at[v][a].select(self.lanes[v], none).lowest();
                hi[a][v] = self.at[v][a].select(self.lanes[v], all).highest();
            }
        }
        self.lo = per_axis!(a => S::F::from_array(lo[a]));
        self.hi = per_axis!(a => S::F::from_array(hi[a]));
    }

    /// The box around all places.
    #[inline(always)]
    fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        (
            per_axis!(a => self.lo[a].lowest()),
            per_axis!(a => self.hi[a].highest()),
        )
    }

    /// The vectors whose boxes meet a box.
    #[inline(always)]
    fn meeting(&self, bounds: &Bounds<S>) -> u16 {
        let meets = per_axis!(a => bounds.lo[a].le(self.hi[a]) & self.lo[a].le(bounds.hi[a]));
        (meets[0] & meets[1] & meets[2]).to_bits()
    }

    /// The places of a vector that are in a box.
    #[inline(always)]
    fn inside(&self, vector: usize, bounds: &Bounds<S>) -> S::M {
        let at = &self.at[vector];
        let inside = per_axis!(a => bounds.lo[a].le(at[a]) & at[a].le(bounds.hi[a]));
        self.lanes[vector] & inside[0] & inside[1] & inside[2]
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
    fn sample<S: Simd>(&mut self, at: &[Places], lanes: &[u16], estimates: &mut [Estimates]) {
        let largest = S::F::splat(f32::MAX);
        let mut crowd = Crowd::<S>::empty();
        let mut live = 0u16;
        for v in 0..at.len().min(lanes.len()).min(LANES) {
            let at = per_axis!(a => S::F::from_array(at[v][a]));
            let finite =
                at[0].abs().le(largest) & at[1].abs().le(largest) & at[2].abs().le(largest);
            crowd.at[v] = at;
            crowd.lanes[v] = S::M::from_bits(lanes[v]) & finite;
            live |= u16::from(crowd.lanes[v].any()) << v;
        }
        if live == 0 {
            estimates.fill(Estimates::default());
            return;
        }
        crowd.find_boxes(live);
        let bounds = crowd.bounds();
        let mut ends: [Ends; LANES] = std::array::from_fn(|_| Ends::default());
        self.outer.clear();
        self.outer.push(0);
        while let Some(place) = self.outer.pop() {
            let Some(node) = self.sampler.tree.get(place as usize) else {
                continue;
            };
            let (base, per_unit) = node.grid();
            // Rounding is monotone.
            let lo = per_axis!(a => (bounds.0[a] - base[a]) * per_unit[a]);
            let hi = per_axis!(a => (bounds.1[a] - base[a]) * per_unit[a]);
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
                    OuterChild::Item(item) => self.visit_item::<S>(item, &crowd, &mut ends),
                }
            }
        }
        for (estimates, ends) in estimates.iter_mut().zip(&ends) {
            *estimates = ends.estimates();
        }
    }

    #[inline(always)]
    fn visit_item<S: Simd>(&mut self, item: u32, crowd: &Crowd<S>, ends: &mut [Ends; LANES]) {
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
        let entry = Bounds::<S>::new(
            [lo[0] as f32, lo[1] as f32, lo[2] as f32],
            [hi[0] as f32, hi[1] as f32, hi[2] as f32],
        );
        let mut entered = 0u16;
        let mut inside = Crowd::<S>::empty();
        for v in bits(u64::from(crowd.meeting(&entry))) {
            let lanes = crowd.inside(v, &entry);
            inside.lanes[v] = lanes;
            inside.at[v] = per_axis!(a => {
                (crowd.at[v][a] - S::F::splat(part.base[a])) * S::F::splat(part.sixteenths[a])
            });
            entered |= u16::from(lanes.any()) << v;
        }
        if entered == 0 {
            return;
        }
        let none = Slots::<S> {
            lo: S::F::splat(f32::from(NO_SLOT[0])),
            hi: S::F::splat(f32::from(NO_SLOT[1])),
        };
        let mut slots = [none; LANES];
        if sampler.level == DetailLevel::Submesh {
            for v in bits(u64::from(entered)) {
                slots[v].join(inside.lanes[v], WHOLE_SLOT);
            }
        } else {
            inside.find_boxes(entered);
            let (lo, hi) = inside.bounds();
            // For all eight children at once: upper corners against their lower ones in the first
            // block, lower ones with signs turned in the second.
            let reach = per_axis!(a => S::F::of_blocks(hi[a], -lo[a]));
            self.nodes.clear();
            self.nodes.push(first);
            while let Some(node) = self.nodes.pop() {
                self.visit_node::<S>(number, &submesh, node, &inside, &reach, &mut slots);
            }
        }
        for v in bits(u64::from(entered)) {
            let (lo, hi) = (slots[v].lo.to_array(), slots[v].hi.to_array());
            for lane in bits(u64::from(inside.lanes[v].to_bits())) {
                ends[v].join(part, [lo[lane] as u8, hi[lane] as u8], lane);
            }
        }
    }

    #[inline(always)]
    fn visit_node<S: Simd>(
        &mut self,
        number: usize,
        submesh: &Submesh,
        place: u32,
        crowd: &Crowd<S>,
        reach: &[S::F; 3],
        slots: &mut [Slots<S>; LANES],
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
            join_inside(crowd, &Bounds::new(lo, hi), slot, slots);
            return;
        }
        let meets = per_axis!(a => corners[a].le(reach[a]));
        let meets = both_blocks(meets[0] & meets[1] & meets[2]);
        for child in bits(u64::from(leaves & meets)) {
            let lo = per_axis!(a => each[a][child]);
            let hi = per_axis!(a => -each[a][WIDTH + child]);
            join_inside(crowd, &Bounds::new(lo, hi), ranges[child], slots);
        }
    }
}

/// Widens the slots of all places that are in a box.
#[inline(always)]
fn join_inside<S: Simd>(
    crowd: &Crowd<S>,
    bounds: &Bounds<S>,
    slot: [u8; 2],
    slots: &mut [Slots<S>; LANES],
) {
    for v in bits(u64::from(crowd.meeting(bounds))) {
        slots[v].join(crowd.inside(v, bounds), slot);
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
