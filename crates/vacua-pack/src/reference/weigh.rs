//! Weights of corners in eight cells at once, by the very operations of [`crate::weights_at`] in
//! `f64`: lane for lane the same bits. Loops over lanes have no branches, so that they become vector
//! code.

use vacua_volume::CellType;

use crate::element::{Weights, weights_at};

/// Lanes.
pub(super) const WIDE: usize = 8;

/// A number a lane.
type Lanes = [f64; WIDE];
/// A vector or position.
pub(super) type Vec3 = [f64; 3];
/// A vector a lane, axis by axis.
type Vectors = [Lanes; 3];

/// A place this many times the rounding away from a face is rejected by the cell on its other side,
/// whose corners come in another order.
pub(super) const CLEAR: f64 = 8.0;
/// The rounding of a determinant, as in the scalar code.
const ROUNDING: f64 = 16.0 * f64::EPSILON;

/// The weights of tetrahedra, and what is known of the places.
pub(super) struct TetWeights {
    /// Weights of the four corners.
    pub weights: [Lanes; 4],
    /// The lanes whose place is inside, farther from all faces than rounding: where cells do not
    /// overlap, no other accepts it.
    pub sure: u8,
    /// The lanes whose place is accepted.
    pub accepted: u8,
}

/// Six times the signed volume between the origin and a triangle, and a bound on its rounding.
#[inline(always)]
pub(super) fn volume(a: Vec3, b: Vec3, c: Vec3) -> (f64, f64) {
    let [x, y, z] = [a[0].abs(), a[1].abs(), a[2].abs()];
    let magnitude = x * ((b[1] * c[2]).abs() + (b[2] * c[1]).abs())
        + y * ((b[2] * c[0]).abs() + (b[0] * c[2]).abs())
        + z * ((b[0] * c[1]).abs() + (b[1] * c[0]).abs());
    let cross = [
        b[1] * c[2] - b[2] * c[1],
        b[2] * c[0] - b[0] * c[2],
        b[0] * c[1] - b[1] * c[0],
    ];
    (
        a[0] * cross[0] + a[1] * cross[1] + a[2] * cross[2],
        ROUNDING * magnitude,
    )
}

/// The weights at places in tetrahedra; `corners` are relative to the place and within the boxes.
#[inline(always)]
pub(super) fn tetrahedra(corners: &[Vectors; 4]) -> TetWeights {
    let mut weights = [[0.0; WIDE]; 4];
    let (mut margin, mut slack) = ([0.0; WIDE], [0.0; WIDE]);
    let mut flatness = [0.0; WIDE];
    for l in 0..WIDE {
        let corner = |k: usize| [corners[k][0][l], corners[k][1][l], corners[k][2][l]];
        let (a, b, c, d) = (corner(0), corner(1), corner(2), corner(3));
        let (va, ra) = volume(b, d, c);
        let (vb, rb) = volume(a, c, d);
        let (vc, rc) = volume(a, d, b);
        let (vd, rd) = volume(a, b, c);
        let whole = va + vb + vc + vd;
        flatness[l] = whole.abs() - (ra + rb + rc + rd);
        let sign = if whole < 0.0 { -1.0 } else { 1.0 };
        let (va, vb, vc, vd) = (va * sign, vb * sign, vc * sign, vd * sign);
        let least = |a: f64, b: f64| if a < b { a } else { b };
        margin[l] = least(
            least(va - CLEAR * ra, vb - CLEAR * rb),
            least(vc - CLEAR * rc, vd - CLEAR * rd),
        );
        slack[l] = least(least(va + ra, vb + rb), least(vc + rc, vd + rd));
        let positive = |v: f64| if v > 0.0 { v } else { 0.0 };
        let (wa, wb, wc, wd) = (positive(va), positive(vb), positive(vc), positive(vd));
        let sum = wa + wb + wc + wd;
        weights[0][l] = wa / sum;
        weights[1][l] = wb / sum;
        weights[2][l] = wc / sum;
        weights[3][l] = wd / sum;
    }
    let (mut sure, mut accepted) = (0, 0);
    for l in 0..WIDE {
        let solid = flatness[l] > 0.0 && flatness[l] < f64::INFINITY;
        sure |= u8::from(solid && margin[l] > 0.0) << l;
        // Whether a sum is negative is decided without rounding: it is 0 only if it is.
        accepted |= u8::from(solid && slack[l] >= 0.0) << l;
    }
    TetWeights {
        weights,
        sure,
        accepted,
    }
}

const TOLERANCE: f64 = 1e-9;
const MAX_STEPS: usize = 24;
const LAST_STEP: f64 = 1e-7;
const FAR: f64 = 1e3;

/// How far Newton's method has come.
const GOING: f64 = 0.0;
const SETTLED: f64 = 1.0;
const LOST: f64 = 2.0;

#[inline(always)]
fn sub(a: &Vectors, b: &Vectors) -> Vectors {
    let mut result = [[0.0; WIDE]; 3];
    for axis in 0..3 {
        for l in 0..WIDE {
            result[axis][l] = a[axis][l] - b[axis][l];
        }
    }
    result
}

#[inline(always)]
fn add_scaled(a: Vec3, s: f64, b: Vec3) -> Vec3 {
    [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]]
}

#[inline(always)]
pub(super) fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[inline(always)]
pub(super) fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn largest(a: Vec3) -> f64 {
    let larger = |a: f64, b: f64| if a > b { a } else { b };
    larger(larger(a[0].abs(), a[1].abs()), a[2].abs())
}

/// The weights of hexahedra.
pub(super) struct HexWeights {
    /// Weights of the eight corners.
    pub weights: [Lanes; 8],
    /// The lanes whose place is accepted.
    pub accepted: u8,
    /// The lanes in which the search from the middle has failed: the scalar code starts again.
    pub lost: u8,
}

/// The weights at places in hexahedra; `p` are the corners relative to the place, which is within the
/// boxes around them. Only some lanes count.
#[inline(always)]
pub(super) fn hexahedra(p: &[Vectors; 8], lanes: u8) -> HexWeights {
    let (a, b, c, d) = (
        sub(&p[1], &p[0]),
        sub(&p[3], &p[0]),
        sub(&p[4], &p[0]),
        p[0],
    );
    let rs = sub(&sub(&p[2], &p[3]), &a);
    let st = sub(&sub(&p[7], &p[4]), &b);
    let tr = sub(&sub(&p[5], &p[4]), &a);
    let rst = sub(&sub(&sub(&p[6], &p[7]), &sub(&p[5], &p[4])), &rs);
    let mut x = [[0.5; WIDE]; 3];
    let mut state = [SETTLED; WIDE];
    for l in 0..WIDE {
        state[l] = if lanes >> l & 1 == 1 { GOING } else { SETTLED };
    }
    for _ in 0..MAX_STEPS {
        let mut going = 0.0;
        for l in 0..WIDE {
            let at = |v: &Vectors| [v[0][l], v[1][l], v[2][l]];
            let [r, s, t] = at(&x);
            let (a, b, c, d) = (at(&a), at(&b), at(&c), at(&d));
            let (rs, st, tr, rst) = (at(&rs), at(&st), at(&tr), at(&rst));
            let by_r = add_scaled(add_scaled(add_scaled(a, s, rs), t, tr), s * t, rst);
            let by_s = add_scaled(add_scaled(add_scaled(b, t, st), r, rs), r * t, rst);
            let by_t = add_scaled(add_scaled(add_scaled(c, r, tr), s, st), r * s, rst);
            let plane = add_scaled(add_scaled(add_scaled(d, s, b), t, c), s * t, st);
            let value = add_scaled(plane, r, by_r);
            let across = cross(by_s, by_t);
            let determinant = dot(by_r, across);
            let step = [
                dot(value, across) / determinant,
                dot(value, cross(by_t, by_r)) / determinant,
                dot(value, cross(by_r, by_s)) / determinant,
            ];
            let next = [r - step[0], s - step[1], t - step[2]];
            let size = largest(step);
            // False for what is no number, or infinite.
            let finite = (step[0].abs() < f64::INFINITY)
                & (step[1].abs() < f64::INFINITY)
                & (step[2].abs() < f64::INFINITY);
            let goes_on = if largest(next) > FAR { LOST } else { GOING };
            let after = if size < LAST_STEP { SETTLED } else { goes_on };
            let after = if finite { after } else { LOST };
            let is_going = state[l] == GOING;
            for axis in 0..3 {
                x[axis][l] = if is_going { next[axis] } else { x[axis][l] };
            }
            state[l] = if is_going { after } else { state[l] };
            going += if state[l] == GOING { 1.0 } else { 0.0 };
        }
        if going == 0.0 {
            break;
        }
    }
    let mut weights = [[0.0; WIDE]; 8];
    let mut off = [0.0; WIDE];
    for l in 0..WIDE {
        let [r, s, t] = [x[0][l], x[1][l], x[2][l]];
        let near = |c: f64| (-TOLERANCE..=1.0 + TOLERANCE).contains(&c);
        off[l] = if near(r) & near(s) & near(t) {
            0.0
        } else {
            1.0
        };
        let clamp = |c: f64| {
            let c = if c < 0.0 { 0.0 } else { c };
            if c > 1.0 { 1.0 } else { c }
        };
        let (r, s, t) = (clamp(r), clamp(s), clamp(t));
        let (q, u, v) = (1.0 - r, 1.0 - s, 1.0 - t);
        weights[0][l] = q * u * v;
        weights[1][l] = r * u * v;
        weights[2][l] = r * s * v;
        weights[3][l] = q * s * v;
        weights[4][l] = q * u * t;
        weights[5][l] = r * u * t;
        weights[6][l] = r * s * t;
        weights[7][l] = q * s * t;
    }
    let (mut accepted, mut lost) = (0, 0);
    for l in 0..WIDE {
        let settled = state[l] == SETTLED;
        accepted |= u8::from(settled && off[l] == 0.0) << l;
        lost |= u8::from(!settled) << l;
    }
    HexWeights {
        weights,
        accepted: accepted & lanes,
        lost: lost & lanes,
    }
}

/// The scalar code's answer for a cell of any type.
#[inline]
pub(super) fn one(
    cell_type: CellType,
    corners: &[[f32; 4]; 8],
    place: [f32; 3],
) -> Option<Weights> {
    let positions = corners.map(|[x, y, z, _]| [x, y, z]);
    weights_at(cell_type, &positions, place.map(f64::from))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Corners relative to a place, as lanes.
    fn lanes<const N: usize>(corners: &[[f32; 4]; 8], place: [f32; 3]) -> [Vectors; N] {
        let mut all = [[[0.0; WIDE]; 3]; N];
        for k in 0..N {
            for axis in 0..3 {
                let at = f64::from(corners[k][axis]) - f64::from(place[axis]);
                all[k][axis] = [at; WIDE];
            }
        }
        all
    }

    fn inside_box(corners: &[[f32; 4]], place: [f32; 3]) -> bool {
        (0..3).all(|axis| {
            let of_axis = corners.iter().map(|c| c[axis]);
            let lo = of_axis.clone().fold(f32::INFINITY, f32::min);
            let hi = of_axis.fold(f32::NEG_INFINITY, f32::max);
            lo <= place[axis] && place[axis] <= hi
        })
    }

    fn coordinate() -> impl Strategy<Value = f32> {
        prop_oneof![
            -1f32..1.0,
            (0..4i32).prop_map(|i| i as f32 / 4.0),
            Just(0.0f32)
        ]
    }

    proptest! {
        #[test]
        fn tetrahedra_have_the_weights_of_the_scalar_code(
            corners in prop::collection::vec(prop::array::uniform4(coordinate()), 8),
            place in prop::array::uniform3(coordinate()),
        ) {
            let corners: [[f32; 4]; 8] = corners.try_into().expect("eight");
            prop_assume!(inside_box(&corners[..4], place));
            let found = tetrahedra(&lanes(&corners, place));
            let expected = one(CellType::Tetrahedron, &corners, place);
            prop_assert_eq!(found.accepted & 1 == 1, expected.is_some());
            prop_assert_eq!(found.sure & !found.accepted, 0);
            if let Some(expected) = expected {
                let weights = found.weights.map(|w| w[3]);
                prop_assert_eq!(&weights[..], &expected[..4]);
            }
        }

        #[test]
        fn hexahedra_have_the_weights_of_the_scalar_code(
            moves in prop::collection::vec(prop::array::uniform3(-0.6f32..0.6), 8),
            place in prop::array::uniform3(-0.2f32..1.2),
        ) {
            let mut corners = [[0.0f32; 4]; 8];
            for (k, (corner, moved)) in corners.iter_mut().zip(moves).enumerate() {
                let unit = [[0, 3, 4, 7], [0, 1, 4, 5], [0, 1, 2, 3]];
                for axis in 0..3 {
                    let base = if unit[axis].contains(&k) { 0.0 } else { 1.0 };
                    corner[axis] = base + moved[axis];
                }
            }
            prop_assume!(inside_box(&corners, place));
            let found = hexahedra(&lanes(&corners, place), 0b100);
            let expected = one(CellType::Hexahedron, &corners, place);
            prop_assert_eq!((found.accepted | found.lost) & !0b100, 0);
            if found.lost == 0 {
                prop_assert_eq!(found.accepted != 0, expected.is_some());
                if let Some(expected) = expected {
                    prop_assert_eq!(found.weights.map(|w| w[2]), expected);
                }
            }
        }
    }
}
