//! `mesh`: rays find where they enter and leave the active region by tracing its triangulated
//! boundary (paper A §4.3), made exact.
//!
//! The paper toggles between inside and outside at every hit. Here a hit only says at which sample
//! the state *may* change; what it is from there on is read from the mask, at that very sample.
//! From a sample in an active macrocell the next back face is sought, else the next front face:
//! between two samples of different state the line crosses such a face. Faces are merged into
//! axis-aligned rectangles and tested as such, `t = (plane − origin) · inverse`, in `f64`, a little
//! wider than they are, so that none is missed along edges; one hit too many costs a look at the
//! mask.

use vacua_simd::BLOCK;

use crate::boundary::BoundaryMesh;
use crate::bvh::{Hierarchy, Line, slack};
use crate::lattice::Lattice;
use crate::mask::ActiveMask;
use crate::ray::{BLOCKS_PER_WINDOW, SampleRay, Skipper, bits_between};
use crate::rectangles::{Rectangle, merged};

/// The triangulated boundary of the active macrocells.
#[derive(Clone)]
pub struct MeshSkip {
    lattice: Lattice,
    mask: ActiveMask,
    mesh: BoundaryMesh,
    faces: Vec<Face>,
    hierarchy: Hierarchy,
}

/// A rectangle of the boundary in ray space.
#[derive(Clone, Copy)]
struct Face {
    axis: u8,
    faces_up: bool,
    /// Lattice plane that it lies on.
    plane: f32,
    /// Extent along `(axis + 1) % 3` and `(axis + 2) % 3`.
    lo: [f32; 2],
    hi: [f32; 2],
}

impl Face {
    fn new(lattice: &Lattice, rectangle: &Rectangle) -> Self {
        let axis = usize::from(rectangle.axis);
        let corner = |[i, j]: [u32; 2]| {
            [
                lattice.plane((axis + 1) % 3, i as usize),
                lattice.plane((axis + 2) % 3, j as usize),
            ]
        };
        Self {
            axis: rectangle.axis,
            faces_up: rectangle.faces_up,
            plane: lattice.plane(axis, rectangle.plane as usize),
            lo: corner(rectangle.lo),
            hi: corner(rectangle.hi),
        }
    }

    fn corners(&self) -> [[f32; 3]; 2] {
        let axis = usize::from(self.axis);
        let corner = |c: [f32; 2]| {
            let mut p = [self.plane; 3];
            (p[(axis + 1) % 3], p[(axis + 2) % 3]) = (c[0], c[1]);
            p
        };
        [corner(self.lo), corner(self.hi)]
    }
}

/// Where a line meets the boundary.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundaryHit {
    /// The axis that the face is perpendicular to.
    pub axis: usize,
    /// The point, in ray space.
    pub position: [f64; 3],
}

impl MeshSkip {
    /// Extracts the boundary of a mask and builds a hierarchy over it.
    ///
    /// # Panics
    /// If the mask belongs to another lattice.
    pub fn new(lattice: Lattice, mask: ActiveMask) -> Self {
        let mesh = BoundaryMesh::new(&mask);
        Self::from_boundary(lattice, mask, mesh)
    }

    /// Builds a hierarchy over a boundary that has been extracted already, which must be that of
    /// `mask`.
    ///
    /// # Panics
    /// If mask or boundary belong to another lattice.
    pub fn from_boundary(lattice: Lattice, mask: ActiveMask, mesh: BoundaryMesh) -> Self {
        let counts = lattice.counts();
        assert_eq!(counts, mask.counts(), "mask and lattice belong together");
        assert_eq!(counts, mesh.counts(), "mesh and lattice belong together");
        let faces: Vec<Face> = merged(&mesh)
            .iter()
            .map(|r| Face::new(&lattice, r))
            .collect();
        let boxes: Vec<[[f32; 3]; 2]> = faces.iter().map(Face::corners).collect();
        let hierarchy = Hierarchy::new(&boxes);
        Self {
            lattice,
            mask,
            mesh,
            faces,
            hierarchy,
        }
    }

    /// The boundary.
    pub fn boundary(&self) -> &BoundaryMesh {
        &self.mesh
    }

    /// The first face that a half-line meets, from `start` in a `direction` in ray space.
    pub fn first_hit(&self, start: [f64; 3], direction: [f64; 3]) -> Option<BoundaryHit> {
        let line = Line::through(start, direction);
        let (mut nearest, mut hit) = (f64::INFINITY, None);
        self.hierarchy.nearest(&line, (0.0, f64::INFINITY), |i| {
            let face = &self.faces[i];
            let axis = usize::from(face.axis);
            if direction[axis] == 0.0 {
                return None;
            }
            let t = (f64::from(face.plane) - start[axis]) * line.inverse[axis];
            let mut position = [0, 1, 2].map(|a| start[a] + t * direction[a]);
            position[axis] = face.plane.into();
            let within = |side: usize| {
                let at = position[(axis + 1 + side) % 3];
                f64::from(face.lo[side]) <= at && at <= f64::from(face.hi[side])
            };
            if t < 0.0 || !within(0) || !within(1) {
                return None;
            }
            if t < nearest {
                (nearest, hit) = (t, Some(BoundaryHit { axis, position }));
            }
            Some(t)
        });
        hit
    }

    /// Whether the macrocell of a sample is active.
    fn is_active(&self, ray: &SampleRay, k: u32) -> bool {
        self.mask
            .get([0, 1, 2].map(|a| self.lattice.macrocell_of(a, ray.at(a, k))))
    }

    /// The first of the samples `k + 1..end` at which the state may differ from `active`, that of
    /// sample `k`.
    fn next_change(
        &self,
        ray: &SampleRay,
        line: &Line,
        (k, end): (u32, u32),
        active: bool,
    ) -> Option<u32> {
        let mut change = u32::MAX;
        let (t_min, t_max) = (f64::from(k) - 0.5, f64::from(end) + 0.5);
        self.hierarchy.nearest(line, (t_min, t_max), |i| {
            let face = &self.faces[i];
            let axis = usize::from(face.axis);
            let upward = line.step[axis] > 0.0;
            // Leaving means passing a face from its active side.
            if line.step[axis] == 0.0 || (face.faces_up == upward) != active {
                return None;
            }
            // Computed coordinates reach a plane when the line passes half-way from the number
            // before it.
            let plane = 0.5 * (f64::from(face.plane) + f64::from(face.plane.next_down()));
            let t = (plane - line.start[axis]) * line.inverse[axis];
            if t < t_min {
                return None;
            }
            for (side, a) in [(axis + 1) % 3, (axis + 2) % 3].into_iter().enumerate() {
                let at = line.start[a] + t * line.step[a];
                let (lo, hi) = (face.lo[side], face.hi[side]);
                let below = at < f64::from(lo) - f64::from(slack(lo)) - 1e-9 * at.abs();
                let above = at > f64::from(hi) + f64::from(slack(hi)) + 1e-9 * at.abs();
                if below || above {
                    return None;
                }
            }
            let passed = |k: u32| (ray.at(axis, k) >= face.plane) == upward;
            let mut first = t.ceil().clamp(0.0, f64::from(ray.end)) as u32;
            while first > 0 && passed(first - 1) {
                first -= 1;
            }
            while first < ray.end && !passed(first) {
                first += 1;
            }
            if first <= k {
                return None;
            }
            change = change.min(first);
            // The box of the face may begin a little before `t`.
            Some(t)
        })?;
        Some(change)
    }

    /// The blocks of one window of a ray with a sample in an active macrocell.
    fn window_of(&self, ray: &SampleRay, first_block: u32) -> u64 {
        let block = |k: u32| k / BLOCK as u32;
        let mut k = ray.begin.max(first_block * BLOCK as u32);
        let end = ray
            .end
            .min((first_block + BLOCKS_PER_WINDOW) * BLOCK as u32);
        if k >= end {
            return 0;
        }
        let line = Line::new(ray);
        let mut blocks = 0;
        while k < end {
            let active = self.is_active(ray, k);
            let change = self.next_change(ray, &line, (k, end), active);
            let change = change.unwrap_or(end).min(end);
            if active {
                blocks |= bits_between(first_block, block(k), block(change - 1) + 1);
            }
            k = change;
        }
        blocks
    }
}

impl Skipper for MeshSkip {
    fn name(&self) -> &'static str {
        "mesh"
    }

    fn window(&self, rays: &[SampleRay], first_block: u32, blocks: &mut [u64]) {
        for (ray, blocks) in rays.iter().zip(blocks) {
            *blocks = self.window_of(ray, first_block);
        }
    }

    fn size_bytes(&self) -> usize {
        self.mask.size_bytes()
            + size_of_val(self.faces.as_slice())
            + size_of_val(self.mesh.quads())
            + self.hierarchy.size_bytes()
    }
}
