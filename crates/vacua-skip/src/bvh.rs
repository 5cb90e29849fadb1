//! Nearest-first traversal of a bounding volume hierarchy that `obvhs` builds.
//!
//! Boxes are widened by a few units in the last place of `f32` and tested in `f64`: a ray that
//! touches a primitive's box in exact arithmetic is never turned away.

use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;

use crate::ray::SampleRay;

/// Nodes on the traversal stack before it moves to the heap.
const STACK: usize = 64;

/// A hierarchy over boxes in ray space.
#[derive(Clone)]
pub(crate) struct Hierarchy {
    bvh: Bvh2,
}

/// A ray in `f64`, in units of samples: exactly the line on which computed samples are rounded.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Line {
    pub start: [f64; 3],
    pub step: [f64; 3],
    pub inverse: [f64; 3],
}

impl Line {
    /// The line of a ray.
    pub fn new(ray: &SampleRay) -> Self {
        Self::through(ray.start.map(f64::from), ray.step.map(f64::from))
    }

    /// The line through a point in a direction.
    pub fn through(start: [f64; 3], step: [f64; 3]) -> Self {
        // A huge number instead of infinity: 0 · ∞ is no number, 0 · 10³⁰⁰ is where one stands.
        let inverse = step.map(|s| if s == 0.0 { 1e300 } else { 1.0 / s });
        Self {
            start,
            step,
            inverse,
        }
    }

    /// Where the line is within a box.
    #[inline]
    pub fn within(&self, lo: [f64; 3], hi: [f64; 3]) -> (f64, f64) {
        let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
        for a in 0..3 {
            let t0 = (lo[a] - self.start[a]) * self.inverse[a];
            let t1 = (hi[a] - self.start[a]) * self.inverse[a];
            enter = enter.max(t0.min(t1));
            leave = leave.min(t0.max(t1));
        }
        (enter, leave)
    }
}

/// How far a box must reach beyond a coordinate so that rounding to `f32` cannot leave it.
pub(crate) fn slack(coordinate: f32) -> f32 {
    coordinate.abs() * (4.0 * f32::EPSILON) + f32::MIN_POSITIVE
}

impl Hierarchy {
    /// Builds a hierarchy over boxes, given by their corners.
    pub fn new(boxes: &[[[f32; 3]; 2]]) -> Self {
        let widened: Vec<Aabb> = boxes
            .iter()
            .map(|[lo, hi]| {
                let lo = lo.map(|c| c - slack(c));
                let hi = hi.map(|c| c + slack(c));
                Aabb::new(lo.into(), hi.into())
            })
            .collect();
        let mut build_time = std::time::Duration::ZERO;
        Self {
            bvh: build_bvh2(&widened, BvhBuildParams::very_fast_build(), &mut build_time),
        }
    }

    /// Bytes of the nodes and the primitive list.
    pub fn size_bytes(&self) -> usize {
        size_of_val(self.bvh.nodes.as_slice()) + size_of_val(self.bvh.primitive_indices.as_slice())
    }

    /// The least `t` in `t_min..t_max` that `test` gives for any primitive whose box the line
    /// touches; `test` may leave out primitives, and what it gives must not lie before their box.
    pub fn nearest(
        &self,
        line: &Line,
        (t_min, t_max): (f64, f64),
        mut test: impl FnMut(usize) -> Option<f64>,
    ) -> Option<f64> {
        let nodes = &self.bvh.nodes;
        if nodes.is_empty() {
            return None;
        }
        let mut best = t_max;
        let touch = |node: u32, best: f64| {
            let aabb = &nodes[node as usize].aabb;
            let (lo, hi) = (
                aabb.min.to_array().map(f64::from),
                aabb.max.to_array().map(f64::from),
            );
            let (enter, leave) = line.within(lo, hi);
            (enter <= leave && leave >= t_min && enter <= best).then_some(enter)
        };
        let mut stack = [0u32; STACK];
        let mut depth = 0;
        let mut overflow: Vec<u32> = Vec::new();
        let mut next = touch(0, best).map(|_| 0u32);
        loop {
            let node = match next.take() {
                Some(node) => node,
                None => {
                    let popped = overflow.pop().or_else(|| {
                        depth = usize::checked_sub(depth, 1)?;
                        Some(stack[depth])
                    });
                    let Some(node) = popped else { break };
                    if touch(node, best).is_none() {
                        continue;
                    }
                    node
                }
            };
            let node = &nodes[node as usize];
            if node.prim_count > 0 {
                let first = node.first_index as usize;
                for &primitive in
                    &self.bvh.primitive_indices[first..first + node.prim_count as usize]
                {
                    if let Some(t) = test(primitive as usize) {
                        best = best.min(t);
                    }
                }
                continue;
            }
            let children = [node.first_index, node.first_index + 1];
            match children.map(|child| touch(child, best)) {
                [None, None] => {}
                [Some(_), None] => next = Some(children[0]),
                [None, Some(_)] => next = Some(children[1]),
                [Some(a), Some(b)] => {
                    let (near, far) = if a <= b { (0, 1) } else { (1, 0) };
                    next = Some(children[near]);
                    if depth < STACK && overflow.is_empty() {
                        stack[depth] = children[far];
                        depth += 1;
                    } else {
                        overflow.push(children[far]);
                    }
                }
            }
        }
        (best < t_max).then_some(best)
    }
}
