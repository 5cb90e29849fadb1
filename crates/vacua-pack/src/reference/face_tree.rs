//! A wide hierarchy over triangles, and the first of them that a ray meets.
//!
//! The layout is Embree's: nodes of 128 bytes, and leaves of four triangles whose corners are copied,
//! 160 bytes (16 less than there, for there is but one geometry). Rays are `f64`; a triangle is met a little beyond its edges too, so that no ray passes
//! between two that share one.

use vacua_simd::per_axis;

use super::NONE;
use super::tree::{self, Box3, WIDTH, WideChild, WideNode};
use super::weigh::{Vec3, cross, dot};

/// Triangles of a leaf.
const TRIANGLES: usize = 4;
/// How far beyond its edges a triangle is met, in parts of its sides.
const BEYOND: f64 = 1e-9;
/// How far beyond its faces a box is met, in parts of the distance.
const SLACK: f64 = 1e-12;

/// Four triangles.
///
/// ```text
/// byte   0  corners   3 × 3 × 4 × f32   corner, axis, triangle
///      144  face      4 × u32           2^32 − 1: none
/// ```
#[derive(Clone, Copy, Debug)]
#[repr(C)]
struct Triangles {
    corners: [[[f32; TRIANGLES]; 3]; 3],
    face: [u32; TRIANGLES],
}

const _: () = assert!(size_of::<Triangles>() == 160);

/// A line, in units of its direction.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line {
    pub origin: Vec3,
    pub direction: Vec3,
}

/// What a ray meets.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hit {
    /// Where.
    pub t: f64,
    /// Which face.
    pub face: u32,
    /// Whether the line goes the way that the face's normal points.
    pub along_normal: bool,
}

/// The hierarchy.
pub(super) struct FaceTree {
    nodes: Vec<WideNode>,
    leaves: Vec<Triangles>,
}

impl FaceTree {
    /// Builds the hierarchy over the triangles with these corners.
    pub fn new(count: u32, corners: impl Fn(u32) -> [[f32; 3]; 3]) -> Self {
        let boxes: Vec<Box3> = (0..count)
            .map(|face| {
                let [a, b, c] = corners(face);
                tree::union(&tree::union(&[a, a], &[b, b]), &[c, c])
            })
            .collect();
        let tree = tree::build(&boxes).with_leaves_of(TRIANGLES as u32);
        drop(boxes);
        let mut leaves = Vec::new();
        let nodes = tree::collapse(&tree, |faces| {
            let mut four = Triangles {
                corners: [[[f32::NAN; TRIANGLES]; 3]; 3],
                face: [NONE; TRIANGLES],
            };
            for (i, &face) in faces.iter().enumerate() {
                four.face[i] = face;
                for (k, corner) in corners(face).into_iter().enumerate() {
                    for axis in 0..3 {
                        four.corners[k][axis][i] = corner[axis];
                    }
                }
            }
            leaves.push(four);
            leaves.len() as u64 - 1
        });
        Self { nodes, leaves }
    }

    /// Bytes of nodes and leaves.
    pub fn num_bytes(&self) -> [usize; 2] {
        [
            size_of_val(self.nodes.as_slice()),
            size_of_val(self.leaves.as_slice()),
        ]
    }

    /// The first triangle that a line meets from `from` on.
    #[inline(always)]
    pub fn first_hit(&self, line: &Line, from: f64) -> Option<Hit> {
        // A huge number instead of infinity: 0 · ∞ is no number.
        let inverse = per_axis!(a => {
            let d = line.direction[a];
            if d == 0.0 { 1e300 } else { 1.0 / d }
        });
        let mut best = Hit {
            t: f64::INFINITY,
            face: NONE,
            along_normal: false,
        };
        let mut stack = Vec::with_capacity(64);
        if !self.nodes.is_empty() {
            stack.push((f64::NEG_INFINITY, WideChild::Node(0)));
        }
        while let Some((enter, child)) = stack.pop() {
            if enter > best.t {
                continue;
            }
            let number = match child {
                WideChild::Leaf(leaf) => {
                    self.leaves[leaf as usize].meet(line, from, &mut best);
                    continue;
                }
                WideChild::Node(number) => number,
            };
            let node = &self.nodes[number as usize];
            let (mut enter, mut leave) = ([f64::NEG_INFINITY; WIDTH], [f64::INFINITY; WIDTH]);
            for axis in 0..3 {
                for k in 0..WIDTH {
                    let lo = (f64::from(node.lo[axis][k]) - line.origin[axis]) * inverse[axis];
                    let hi = (f64::from(node.hi[axis][k]) - line.origin[axis]) * inverse[axis];
                    let (near, far) = if lo < hi { (lo, hi) } else { (hi, lo) };
                    enter[k] = if near > enter[k] { near } else { enter[k] };
                    leave[k] = if far < leave[k] { far } else { leave[k] };
                }
            }
            let first = stack.len();
            for k in 0..WIDTH {
                let slack = SLACK * (enter[k].abs() + leave[k].abs());
                // An empty child's box is inside out.
                let there = node.lo[0][k] <= node.hi[0][k];
                let meets = (enter[k] - slack <= leave[k] + slack)
                    & (leave[k] + slack >= from)
                    & (enter[k] - slack <= best.t);
                if there & meets {
                    stack.push((enter[k] - slack, node.child(k)));
                }
            }
            // The nearest is the next.
            stack[first..].sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
        }
        (best.face != NONE).then_some(best)
    }
}

impl Triangles {
    /// Möller and Trumbore's test on four triangles.
    #[inline(always)]
    fn meet(&self, line: &Line, from: f64, best: &mut Hit) {
        let mut t = [f64::INFINITY; TRIANGLES];
        let mut along = [0.0; TRIANGLES];
        for i in 0..TRIANGLES {
            let a = per_axis!(axis => f64::from(self.corners[0][axis][i]));
            let b = per_axis!(axis => f64::from(self.corners[1][axis][i]) - a[axis]);
            let c = per_axis!(axis => f64::from(self.corners[2][axis][i]) - a[axis]);
            let o = per_axis!(axis => line.origin[axis] - a[axis]);
            let p = cross(line.direction, c);
            let q = cross(o, b);
            // b · (d × c) = −d · (b × c)
            along[i] = -dot(b, p);
            let inverse = -1.0 / along[i];
            let u = dot(o, p) * inverse;
            let v = dot(line.direction, q) * inverse;
            let at = dot(c, q) * inverse;
            let inside = (u >= -BEYOND) & (v >= -BEYOND) & (u + v <= 1.0 + BEYOND);
            t[i] = if inside & (at >= from) { at } else { t[i] };
        }
        for i in 0..TRIANGLES {
            let closer = t[i] < best.t || t[i] == best.t && self.face[i] < best.face;
            if self.face[i] != NONE && closer {
                *best = Hit {
                    t: t[i],
                    face: self.face[i],
                    along_normal: along[i] > 0.0,
                };
            }
        }
    }
}
