//! Three-vectors, and Newton's method for the inverse of an element's map.

/// A vector or position.
pub type Vec3 = [f64; 3];

#[inline(always)]
pub fn sub(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
pub fn add_scaled(a: Vec3, s: f64, b: Vec3) -> Vec3 {
    [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]]
}

#[inline(always)]
pub fn scaled(s: f64, a: Vec3) -> Vec3 {
    [s * a[0], s * a[1], s * a[2]]
}

#[inline(always)]
pub fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[inline(always)]
pub fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Largest component by magnitude.
#[inline(always)]
pub fn largest(a: Vec3) -> f64 {
    a[0].abs().max(a[1].abs()).max(a[2].abs())
}

/// `x` with `columns · x = right`, or `None` if the columns do not span space.
#[inline(always)]
pub fn solve(columns: [Vec3; 3], right: Vec3) -> Option<Vec3> {
    let [a, b, c] = columns;
    let bc = cross(b, c);
    let determinant = dot(a, bc);
    let x = [
        dot(right, bc) / determinant,
        dot(right, cross(c, a)) / determinant,
        dot(right, cross(a, b)) / determinant,
    ];
    (x[0].is_finite() && x[1].is_finite() && x[2].is_finite()).then_some(x)
}

/// Steps of Newton's method before a start is given up.
const MAX_STEPS: usize = 24;
/// A step this small, in local coordinates, is the last: convergence is quadratic.
const LAST_STEP: f64 = 1e-7;
/// Local coordinates this far out do not come back.
const FAR: f64 = 1e3;

/// Finds local coordinates at which `map` is zero, from `start`. `map` gives the value and its
/// derivatives by each coordinate. `None` if it does not converge.
#[inline(always)]
pub fn newton(start: Vec3, map: impl Fn(Vec3) -> (Vec3, [Vec3; 3])) -> Option<Vec3> {
    let mut x = start;
    for _ in 0..MAX_STEPS {
        let (value, derivatives) = map(x);
        let step = solve(derivatives, value)?;
        x = sub(x, step);
        let size = largest(step);
        if size < LAST_STEP {
            return Some(x);
        }
        if largest(x) > FAR {
            return None;
        }
    }
    None
}
