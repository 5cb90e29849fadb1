//! Newton's method for the inverse of an element's map, on sixteen pairs of cell and place.
//!
//! In `f32`, from the same start as the scalar code (see [`crate::weights_at`]), along with a bound on
//! how far each iterate is from that of exact arithmetic: a step of length `h` makes an error `e` into
//! `c·e·(h + e)` plus rounding, with `c` the map's second derivative over the first. Where the bound
//! grows, as in cells that are folded or nearly flat, or where the search has not settled, a lane is
//! left uncertain.

use vacua_simd::{Float, Simd, per_axis};

/// Steps before a lane is left to the scalar code.
const MAX_STEPS: usize = 6;
/// A last step this small is the last.
const LAST_STEP: f32 = 1.0 / 1024.0;
/// An error this large, in local coordinates, makes a lane uncertain.
const LOST: f32 = 1.0 / 32.0;
/// Local coordinates this far out are given up.
const FAR: f32 = 3.0;
/// Bound on the rounding of a solution, divided by column length and relative determinant; corners
/// are at most 2 away along each axis.
const ROUNDING: f32 = 512.0 / (1 << 24) as f32;
/// By how much solving can enlarge a right-hand side, divided by column length and relative
/// determinant (six products), with something to spare.
const SOLVING: f32 = 8.0;

type Vec3<F> = [F; 3];

#[inline(always)]
pub(super) fn sub<F: Float>(a: Vec3<F>, b: Vec3<F>) -> Vec3<F> {
    per_axis!(i => a[i] - b[i])
}

#[inline(always)]
pub(super) fn add_scaled<F: Float>(a: Vec3<F>, s: F, b: Vec3<F>) -> Vec3<F> {
    per_axis!(i => s.mul_add(b[i], a[i]))
}

#[inline(always)]
fn cross<F: Float>(a: Vec3<F>, b: Vec3<F>) -> Vec3<F> {
    let zero = F::splat(0.0);
    [
        a[1].mul_add(b[2], zero - a[2] * b[1]),
        a[2].mul_add(b[0], zero - a[0] * b[2]),
        a[0].mul_add(b[1], zero - a[1] * b[0]),
    ]
}

#[inline(always)]
fn dot<F: Float>(a: Vec3<F>, b: Vec3<F>) -> F {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

#[inline(always)]
pub(super) fn largest<F: Float>(a: Vec3<F>) -> F {
    a[0].abs().max(a[1].abs()).max(a[2].abs())
}

/// `x` with `columns · x = right`; the determinant over the columns' lengths; the shortest column.
#[inline(always)]
pub(super) fn solve<F: Float>([a, b, c]: [Vec3<F>; 3], right: Vec3<F>) -> (Vec3<F>, F, F) {
    let bc = cross(b, c);
    let determinant = dot(a, bc);
    let inverse = F::splat(1.0).div(determinant);
    let x = [
        dot(right, bc) * inverse,
        dot(right, cross(c, a)) * inverse,
        dot(right, cross(a, b)) * inverse,
    ];
    let lengths = [largest(a), largest(b), largest(c)];
    let relative = determinant.abs().div(lengths[0] * lengths[1] * lengths[2]);
    (x, relative, lengths[0].min(lengths[1]).min(lengths[2]))
}

/// A map from local coordinates to space, and its derivatives by each of them.
pub(super) trait Map<S: Simd> {
    /// Value and derivatives.
    fn at(&self, x: Vec3<S::F>) -> (Vec3<S::F>, [Vec3<S::F>; 3]);
    /// Bound on the second derivatives around some coordinates, none of which is beyond [`FAR`].
    fn bend(&self, x: Vec3<S::F>) -> S::F;
}

/// What Newton's method gives.
pub(super) struct Root<S: Simd> {
    /// Local coordinates.
    pub x: Vec3<S::F>,
    /// How far they may be off.
    pub margin: S::F,
    /// The lanes for which that is certain.
    pub certain: S::M,
}

/// Finds where a map is zero, from a start that may be off by `error`.
#[inline(always)]
pub(super) fn newton<S: Simd>(
    start: Vec3<S::F>,
    mut error: S::F,
    map: &impl Map<S>,
    lanes: S::M,
) -> Root<S> {
    use vacua_simd::Mask;
    let mut x = start;
    let mut certain = lanes;
    let mut margin = S::F::splat(f32::INFINITY);
    // A lane that has settled stays as it is, so that its answer does not depend on the others.
    let mut under_way = lanes;
    for _ in 0..MAX_STEPS {
        let (value, derivatives) = map.at(x);
        let (step, determinant, shortest) = solve(derivatives, value);
        let inverse = S::F::splat(1.0).div(shortest * determinant);
        let growth = map.bend(x) * (inverse * S::F::splat(SOLVING));
        let moved = sub(x, step);
        x = per_axis!(i => moved[i].select(under_way, x[i]));
        let size = largest(step);
        error = (growth * error).mul_add(size + error, inverse * S::F::splat(ROUNDING));
        // Comparisons with what is not a number fail.
        let close = error.lt(S::F::splat(LOST)) & largest(x).lt(S::F::splat(FAR));
        certain = certain & (close | !under_way);
        margin = (growth * size)
            .mul_add(size, error)
            .select(under_way, margin);
        let settled = size.lt(S::F::splat(LAST_STEP)) & margin.lt(S::F::splat(LOST));
        under_way = under_way & certain & !settled;
        if !under_way.any() {
            break;
        }
    }
    Root {
        x,
        margin,
        certain: certain & margin.lt(S::F::splat(LOST)),
    }
}

/// The trilinear map of a hexahedron, its corners seen from the place.
pub(super) struct Hexahedron<S: Simd> {
    /// Coefficients of 1, r, s, t, rs, st, tr, rst.
    d: Vec3<S::F>,
    a: Vec3<S::F>,
    b: Vec3<S::F>,
    c: Vec3<S::F>,
    rs: Vec3<S::F>,
    st: Vec3<S::F>,
    tr: Vec3<S::F>,
    rst: Vec3<S::F>,
    bend: S::F,
}

impl<S: Simd> Hexahedron<S> {
    #[inline(always)]
    pub fn new(p: &[Vec3<S::F>; 8]) -> Self {
        let (a, b, c) = (sub(p[1], p[0]), sub(p[3], p[0]), sub(p[4], p[0]));
        let rs = sub(sub(p[2], p[3]), a);
        let st = sub(sub(p[7], p[4]), b);
        let tr = sub(sub(p[5], p[4]), a);
        let rst = sub(sub(sub(p[6], p[7]), sub(p[5], p[4])), rs);
        let pairs = largest(rs) + largest(st) + largest(tr);
        // Each of the three products of two coordinates comes with the third, up to FAR.
        let bend = S::F::splat(3.0 * FAR).mul_add(largest(rst), pairs);
        Self {
            bend,
            d: p[0],
            a,
            b,
            c,
            rs,
            st,
            tr,
            rst,
        }
    }
}

impl<S: Simd> Map<S> for Hexahedron<S> {
    #[inline(always)]
    fn at(&self, [r, s, t]: Vec3<S::F>) -> (Vec3<S::F>, [Vec3<S::F>; 3]) {
        let rs_t = add_scaled(self.rs, t, self.rst);
        let by_r = add_scaled(add_scaled(self.a, t, self.tr), s, rs_t);
        let by_s = add_scaled(add_scaled(self.b, t, self.st), r, rs_t);
        let tr_s = add_scaled(self.tr, s, self.rst);
        let by_t = add_scaled(add_scaled(self.c, s, self.st), r, tr_s);
        let plane = add_scaled(self.d, s, add_scaled(self.b, t, self.st));
        let plane = add_scaled(plane, t, self.c);
        (add_scaled(plane, r, by_r), [by_r, by_s, by_t])
    }

    #[inline(always)]
    fn bend(&self, _: Vec3<S::F>) -> S::F {
        self.bend
    }
}

/// The map of a wedge: linear in the triangle, linear from one to the other.
pub(super) struct Wedge<S: Simd> {
    corner: Vec3<S::F>,
    edges: [Vec3<S::F>; 2],
    rise: Vec3<S::F>,
    twist: [Vec3<S::F>; 2],
}

impl<S: Simd> Wedge<S> {
    #[inline(always)]
    pub fn new(p: &[Vec3<S::F>; 8]) -> Self {
        let edges = [sub(p[1], p[0]), sub(p[2], p[0])];
        Self {
            corner: p[0],
            edges,
            rise: sub(p[3], p[0]),
            twist: [
                sub(sub(p[4], p[3]), edges[0]),
                sub(sub(p[5], p[3]), edges[1]),
            ],
        }
    }
}

impl<S: Simd> Map<S> for Wedge<S> {
    #[inline(always)]
    fn at(&self, [r, s, t]: Vec3<S::F>) -> (Vec3<S::F>, [Vec3<S::F>; 3]) {
        let by_r = add_scaled(self.edges[0], t, self.twist[0]);
        let by_s = add_scaled(self.edges[1], t, self.twist[1]);
        let by_t = add_scaled(add_scaled(self.rise, r, self.twist[0]), s, self.twist[1]);
        let value = add_scaled(
            add_scaled(add_scaled(self.corner, t, self.rise), r, by_r),
            s,
            by_s,
        );
        (value, [by_r, by_s, by_t])
    }

    #[inline(always)]
    fn bend(&self, _: Vec3<S::F>) -> S::F {
        largest(self.twist[0]) + largest(self.twist[1])
    }
}

/// The map of a pyramid from its apex in `w = 1 − t`, `u = w·r`, `v = w·s`, less a target that is
/// the place at distance 1.
pub(super) struct Pyramid<S: Simd> {
    corner: Vec3<S::F>,
    a: Vec3<S::F>,
    b: Vec3<S::F>,
    bend: Vec3<S::F>,
    target: Vec3<S::F>,
    /// How far from the apex the place is.
    pub distance: S::F,
}

impl<S: Simd> Pyramid<S> {
    #[inline(always)]
    pub fn new(p: &[Vec3<S::F>; 8]) -> Self {
        let apex = p[4];
        let corner = sub(p[0], apex);
        let (a, b) = (sub(p[1], p[0]), sub(p[3], p[0]));
        let bend = sub(sub(p[2], p[3]), a);
        let size = largest(corner).max(largest(a)).max(largest(b));
        let distance = largest(apex).div(size);
        let inverse = (S::F::splat(0.0) - S::F::splat(1.0)).div(distance);
        Self {
            corner,
            a,
            b,
            bend,
            target: per_axis!(i => apex[i] * inverse),
            distance,
        }
    }

    /// The place if the base's coordinates were both a half, and how far rounding may put it off.
    #[inline(always)]
    pub fn start(&self) -> (Vec3<S::F>, S::F) {
        let half = S::F::splat(0.5);
        let columns = [
            add_scaled(self.corner, S::F::splat(-0.25), self.bend),
            add_scaled(self.a, half, self.bend),
            add_scaled(self.b, half, self.bend),
        ];
        let (start, determinant, shortest) = solve(columns, self.target);
        (start, S::F::splat(ROUNDING).div(shortest * determinant))
    }
}

impl<S: Simd> Map<S> for Pyramid<S> {
    #[inline(always)]
    fn at(&self, [w, u, v]: Vec3<S::F>) -> (Vec3<S::F>, [Vec3<S::F>; 3]) {
        let zero = S::F::splat(0.0);
        let (r, s) = (u.div(w), v.div(w));
        let value = per_axis!(i => {
            u.mul_add(self.a[i], w * self.corner[i])
        });
        let value = add_scaled(add_scaled(value, v, self.b), u * s, self.bend);
        let by_w = add_scaled(self.corner, zero - r * s, self.bend);
        (
            sub(value, self.target),
            [
                by_w,
                add_scaled(self.a, s, self.bend),
                add_scaled(self.b, r, self.bend),
            ],
        )
    }

    #[inline(always)]
    fn bend(&self, [w, u, v]: Vec3<S::F>) -> S::F {
        // Of u·v/w, with half of w to spare for the way of a step: nothing for w that is not positive.
        let one = S::F::splat(1.0);
        let (r, s) = (u.abs().div(w) + one, v.abs().div(w) + one);
        let bend = largest(self.bend) * (S::F::splat(8.0) * r * s).div(w);
        bend.select(S::F::splat(1.0 / 64.0).lt(w), S::F::splat(f32::INFINITY))
    }
}
