//! `boxes`: active macrocells greedily clustered into proxy boxes, and a hierarchy over those
//! (Ganter and Manzke 2019, as paper A §3 describes it).

use vacua_simd::BLOCK;

use crate::bvh::{Hierarchy, Line, slack};
use crate::lattice::Lattice;
use crate::mask::ActiveMask;
use crate::ray::{BLOCKS_PER_WINDOW, SampleRay, Skipper, bits_between};

/// Clusters the active macrocells into disjoint boxes, in order: each grows along x, then y, then z
/// as far as everything in it is active and in no box yet. Boxes are macrocell ranges
/// `[lo, hi)`.
pub fn cluster_boxes(mask: &ActiveMask) -> Vec<[[usize; 3]; 2]> {
    let counts = mask.counts();
    let mut free = mask.clone();
    let mut boxes = Vec::new();
    for z in 0..counts[2] {
        for y in 0..counts[1] {
            for x in 0..counts[0] {
                if !free.get([x, y, z]) {
                    continue;
                }
                let mut hi = [x + 1, y + 1, z + 1];
                while hi[0] < counts[0] && free.get([hi[0], y, z]) {
                    hi[0] += 1;
                }
                let end_x = hi[0];
                let row = |free: &ActiveMask, y, z| (x..end_x).all(|x| free.get([x, y, z]));
                while hi[1] < counts[1] && row(&free, hi[1], z) {
                    hi[1] += 1;
                }
                while hi[2] < counts[2] && (y..hi[1]).all(|y| row(&free, y, hi[2])) {
                    hi[2] += 1;
                }
                for k in z..hi[2] {
                    for j in y..hi[1] {
                        for i in x..hi[0] {
                            free.set([i, j, k], false);
                        }
                    }
                }
                boxes.push([[x, y, z], hi]);
            }
        }
    }
    boxes
}

/// Clustered proxy boxes.
#[derive(Clone)]
pub struct BoxSkip {
    boxes: Vec<[[f32; 3]; 2]>,
    hierarchy: Hierarchy,
}

impl BoxSkip {
    /// Clusters the active macrocells and builds a hierarchy over the clusters.
    ///
    /// # Panics
    /// If the mask belongs to another lattice.
    pub fn new(lattice: &Lattice, mask: &ActiveMask) -> Self {
        assert_eq!(
            lattice.counts(),
            mask.counts(),
            "mask and lattice belong together"
        );
        Self::from_boxes(lattice, &cluster_boxes(mask))
    }

    /// Builds a hierarchy over macrocell ranges `[lo, hi)`, as [`cluster_boxes`] makes them; what
    /// reaches beyond the lattice is cut off.
    pub fn from_boxes(lattice: &Lattice, boxes: &[[[usize; 3]; 2]]) -> Self {
        let plane = |p: [usize; 3]| [0, 1, 2].map(|a| lattice.plane(a, p[a]));
        let boxes: Vec<[[f32; 3]; 2]> = boxes
            .iter()
            .map(|&[lo, hi]| [plane(lo), plane(hi)])
            .collect();
        let hierarchy = Hierarchy::new(&boxes);
        Self { boxes, hierarchy }
    }

    /// Number of boxes.
    pub fn num_boxes(&self) -> usize {
        self.boxes.len()
    }

    /// The samples of a ray that may lie in a box.
    fn samples(&self, line: &Line, index: usize) -> (f64, f64) {
        let [lo, hi] = self.boxes[index];
        let lo = lo.map(|c| f64::from(c) - f64::from(slack(c)));
        let hi = hi.map(|c| f64::from(c) + f64::from(slack(c)));
        let (enter, leave) = line.within(lo, hi);
        // Past the rounding of the division, which grows with the number.
        (enter - 1e-12 * enter.abs(), leave + 1e-12 * leave.abs())
    }

    /// The blocks of one window of a ray that may lie in a box.
    fn window_of(&self, ray: &SampleRay, first_block: u32) -> u64 {
        let end = ray.end_block().min(first_block + BLOCKS_PER_WINDOW);
        let mut from = ray.first_block().max(first_block);
        if ray.is_empty() || from >= end {
            return 0;
        }
        let line = Line::new(ray);
        let t_max = f64::from(end * BLOCK as u32);
        let mut blocks = 0;
        while from < end {
            let t_min = f64::from(from * BLOCK as u32);
            // Of the boxes that begin nearest, the one that ends farthest.
            let (mut nearest, mut until) = (f64::INFINITY, t_min);
            let enter = self.hierarchy.nearest(&line, (t_min, t_max), |i| {
                let (enter, leave) = self.samples(&line, i);
                if enter > leave || leave < t_min {
                    return None;
                }
                let enter = enter.max(t_min);
                if enter < nearest {
                    (nearest, until) = (enter, leave);
                } else if enter == nearest {
                    until = until.max(leave);
                }
                Some(enter)
            });
            let Some(enter) = enter else { break };
            let first = (enter / BLOCK as f64).floor() as u32;
            let last = (until.max(enter).min(t_max) / BLOCK as f64).floor() as u32;
            let to = (last + 1).min(end);
            blocks |= bits_between(first_block, first.max(from), to);
            from = to.max(first + 1);
        }
        blocks
    }
}

impl Skipper for BoxSkip {
    fn name(&self) -> &'static str {
        "boxes"
    }

    fn window(&self, rays: &[SampleRay], first_block: u32, blocks: &mut [u64]) {
        for (ray, blocks) in rays.iter().zip(blocks) {
            *blocks = self.window_of(ray, first_block);
        }
    }

    fn size_bytes(&self) -> usize {
        size_of_val(self.boxes.as_slice()) + self.hierarchy.size_bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn clusters_partition_the_active_macrocells(
            counts in prop::array::uniform3(1usize..9),
            bits in prop::collection::vec(any::<bool>(), 512),
        ) {
            let mut mask = ActiveMask::inactive(counts);
            let cells = |counts: [usize; 3]| {
                (0..counts[2]).flat_map(move |z| (0..counts[1])
                    .flat_map(move |y| (0..counts[0]).map(move |x| [x, y, z])))
            };
            for (at, bit) in cells(counts).zip(&bits) {
                mask.set(at, *bit);
            }
            let mut covered = ActiveMask::inactive(counts);
            for [lo, hi] in cluster_boxes(&mask) {
                for z in lo[2]..hi[2] { for y in lo[1]..hi[1] { for x in lo[0]..hi[0] {
                    prop_assert!(!covered.get([x, y, z]), "disjoint");
                    covered.set([x, y, z], true);
                }}}
            }
            prop_assert_eq!(covered, mask);
        }
    }
}
