//! The wedge's map, VTK's: linear in the triangle, linear from one triangle to the other.

use super::linear::{Vec3, add_scaled, newton, sub};
use super::{TOLERANCE, Weights};

/// The weights at the origin.
pub fn weights(p: [Vec3; 6]) -> Option<Weights> {
    let edges = [sub(p[1], p[0]), sub(p[2], p[0])];
    let rise = sub(p[3], p[0]);
    let twist = [
        sub(sub(p[4], p[3]), edges[0]),
        sub(sub(p[5], p[3]), edges[1]),
    ];
    let map = |[r, s, t]: Vec3| {
        let by_r = add_scaled(edges[0], t, twist[0]);
        let by_s = add_scaled(edges[1], t, twist[1]);
        let by_t = add_scaled(add_scaled(rise, r, twist[0]), s, twist[1]);
        let value = add_scaled(add_scaled(add_scaled(p[0], t, rise), r, by_r), s, by_s);
        (value, [by_r, by_s, by_t])
    };
    let accept = |x: Vec3| accepted(x).map(corner_weights);
    const THIRD: f64 = 1.0 / 3.0;
    if let Some(x) = newton([THIRD, THIRD, 0.5], map) {
        return accept(x);
    }
    let triangle = [[0.1, 0.1], [0.8, 0.1], [0.1, 0.8]];
    let starts = [0.1, 0.9].map(|t| triangle.map(|[r, s]| [r, s, t]));
    let mut found = starts.into_iter().flatten();
    found.find_map(|start| newton(start, map).and_then(accept))
}

/// The coordinates clamped into the wedge, if they are near enough to it.
fn accepted([r, s, t]: Vec3) -> Option<Vec3> {
    let q = 1.0 - r - s;
    let near = r >= -TOLERANCE
        && s >= -TOLERANCE
        && q >= -TOLERANCE
        && (-TOLERANCE..=1.0 + TOLERANCE).contains(&t);
    if !near {
        return None;
    }
    let (q, r, s) = (q.max(0.0), r.max(0.0), s.max(0.0));
    let sum = q + r + s;
    Some([r / sum, s / sum, t.clamp(0.0, 1.0)])
}

fn corner_weights([r, s, t]: Vec3) -> Weights {
    let q = (1.0 - r - s).max(0.0);
    let u = 1.0 - t;
    [q * u, r * u, s * u, q * t, r * t, s * t, 0.0, 0.0]
}
