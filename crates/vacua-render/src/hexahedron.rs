//! The trilinear map of a hexahedron, from local coordinates `[0, 1]³` to space, and its inverse.
//!
//! Corner `x + 2·y + 4·z` is at local coordinates `(x, y, z)`. The inverse is Newton's method from
//! the middle of the cell; all tolerances are in local coordinates, so that the same cell in metres
//! and in nanometres gives the same answers.

use glam::DVec3;

/// How far outside `[0, 1]` local coordinates still count as inside: faces that two cells share
/// leave no gap between them.
const TOLERANCE: f64 = 1e-7;

/// Newton's method ends when it moves less than this.
const CONVERGED: f64 = 1e-10;

/// What must be reached at least: in cells so thin that rounding keeps the method from ending.
const NEARLY_CONVERGED: f64 = 1e-6;

/// Steps after which a cell is taken not to contain the point.
const MAX_STEPS: usize = 16;

/// Where the map takes local coordinates, and its derivatives along each of them.
#[inline]
pub(crate) fn map(corners: &[DVec3; 8], at: DVec3) -> (DVec3, [DVec3; 3]) {
    let lerp = |t: f64, a: DVec3, b: DVec3| a + (b - a) * t;
    let [x00, x10, x01, x11] = [0, 2, 4, 6].map(|i| lerp(at.x, corners[i], corners[i + 1]));
    let [d00, d10, d01, d11] = [0, 2, 4, 6].map(|i| corners[i + 1] - corners[i]);
    let (front, back) = (lerp(at.y, x00, x10), lerp(at.y, x01, x11));
    let along_x = lerp(at.z, lerp(at.y, d00, d10), lerp(at.y, d01, d11));
    let along_y = lerp(at.z, x10 - x00, x11 - x01);
    (lerp(at.z, front, back), [along_x, along_y, back - front])
}

/// The coefficients `c` with `c₀·a + c₁·b + c₂·c = r` for columns `[a, b, c]`; not finite if they
/// do not span space.
#[inline]
pub(crate) fn solve([a, b, c]: [DVec3; 3], r: DVec3) -> DVec3 {
    let (bc, ca, ab) = (b.cross(c), c.cross(a), a.cross(b));
    DVec3::new(r.dot(bc), r.dot(ca), r.dot(ab)) / a.dot(bc)
}

/// The gradient in space of a function with these derivatives along local coordinates, 0 where the
/// map is singular.
#[inline]
pub(crate) fn gradient([a, b, c]: [DVec3; 3], local: DVec3) -> DVec3 {
    let (bc, ca, ab) = (b.cross(c), c.cross(a), a.cross(b));
    let gradient = (bc * local.x + ca * local.y + ab * local.z) / a.dot(bc);
    if gradient.is_finite() {
        gradient
    } else {
        DVec3::ZERO
    }
}

/// Local coordinates, within `[0, 1]`, of the origin of the corners' coordinates; `None` if it is
/// not inside. Corners near 1 in size keep intermediate products from overflow and underflow.
pub(crate) fn locate(corners: &[DVec3; 8]) -> Option<DVec3> {
    let mut at = DVec3::splat(0.5);
    let mut moved = f64::INFINITY;
    for _ in 0..MAX_STEPS {
        let (position, derivatives) = map(corners, at);
        let step = solve(derivatives, position);
        if !step.is_finite() {
            return None;
        }
        // Clamped, the method cannot wander off; where it rests on the clamp it has left the cell.
        let next = (at - step).clamp(DVec3::splat(-1.0), DVec3::splat(2.0));
        moved = (next - at).abs().max_element();
        at = next;
        if moved <= CONVERGED {
            break;
        }
    }
    let inside = at.min_element() >= -TOLERANCE && at.max_element() <= 1.0 + TOLERANCE;
    (moved <= NEARLY_CONVERGED && inside).then(|| at.clamp(DVec3::ZERO, DVec3::ONE))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn cube() -> [DVec3; 8] {
        std::array::from_fn(|i| {
            DVec3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2 & 1) as f64)
        })
    }

    proptest! {
        #[test]
        fn locate_inverts_map(
            shifts in prop::array::uniform8(prop::array::uniform3(-0.2f64..0.2)),
            at in prop::array::uniform3(-0.3f64..1.3),
            scale in prop::sample::select(vec![1e-9, 1.0, 1e9]),
        ) {
            let at = DVec3::from(at);
            let mut corners = cube();
            for (corner, shift) in corners.iter_mut().zip(shifts) {
                *corner = (*corner + DVec3::from(shift)) * scale;
            }
            let (position, _) = map(&corners, at);
            let found = locate(&corners.map(|c| c - position));
            let inside = at.min_element() >= 0.0 && at.max_element() <= 1.0;
            prop_assert_eq!(found.is_some(), inside);
            if let Some(found) = found {
                prop_assert!((found - at).abs().max_element() < 1e-9, "{} for {}", found, at);
            }
        }

        #[test]
        fn any_corners_at_all_end_the_search(
            corners in prop::array::uniform8(prop::array::uniform3(
                prop_oneof![Just(0.0f64), Just(1.0), any::<f64>(), -1.0f64..1.0]
            )),
        ) {
            if let Some(at) = locate(&corners.map(DVec3::from)) {
                prop_assert!(at.min_element() >= 0.0 && at.max_element() <= 1.0);
            }
        }
    }

    #[test]
    fn the_gradient_of_a_linear_function_is_its_slope() {
        let mut corners = cube();
        corners[7] = DVec3::new(1.3, 1.2, 0.8);
        corners[2] = DVec3::new(-0.2, 1.1, 0.1);
        let slope = DVec3::new(2.0, -3.0, 0.5);
        let (_, derivatives) = map(&corners, DVec3::new(0.3, 0.7, 0.2));
        let local = DVec3::from(derivatives.map(|d| slope.dot(d)));
        let found = gradient(derivatives, local);
        assert!((found - slope).length() < 1e-12, "{found}");
        let flat = [DVec3::X, DVec3::X, DVec3::Y];
        assert_eq!(gradient(flat, DVec3::ONE), DVec3::ZERO);
    }
}
