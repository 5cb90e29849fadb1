//! The pyramid's map, VTK's: bilinear on the base, shrinking linearly to the apex.
//!
//! At the apex the base's coordinates `r`, `s` mean nothing and the map's derivative vanishes. In
//! `w = 1 − t`, `u = w·r`, `v = w·s` the map from the apex is homogeneous: scaling the distance to the
//! apex scales all three. So it is solved for a distance of 1, which keeps Newton's method away from
//! the apex, and scaled back.

use super::linear::{Vec3, add_scaled, largest, newton, scaled, solve, sub};
use super::{TOLERANCE, Weights};

/// The weights at the origin.
pub fn weights(p: [Vec3; 5]) -> Option<Weights> {
    let apex = p[4];
    let from_apex = scaled(-1.0, apex);
    let corner = sub(p[0], apex);
    let (a, b) = (sub(p[1], p[0]), sub(p[3], p[0]));
    let bend = sub(sub(p[2], p[3]), a);
    // The middle of the base as seen from the apex says how far is far.
    let size = largest(corner).max(largest(a)).max(largest(b));
    let distance = largest(from_apex) / size;
    if distance == 0.0 {
        let flat = solve([corner, a, b], from_apex).is_none();
        return (!flat).then_some([0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
    }
    let target = scaled(1.0 / distance, from_apex);
    // w·corner + u·a + v·b + (u·v/w)·bend = target
    let map = |[w, u, v]: Vec3| {
        let (r, s) = (u / w, v / w);
        let value = add_scaled(scaled(w, corner), u, a);
        let value = sub(add_scaled(add_scaled(value, v, b), u * s, bend), target);
        let by_w = add_scaled(corner, -r * s, bend);
        (
            value,
            [by_w, add_scaled(a, s, bend), add_scaled(b, r, bend)],
        )
    };
    let accept = |[w, u, v]: Vec3| {
        let (r, s, w) = (u / w, v / w, w * distance);
        let range = -TOLERANCE..=1.0 + TOLERANCE;
        let near = w >= 0.0 && range.contains(&w) && range.contains(&r) && range.contains(&s);
        near.then(|| corner_weights([r, s, w].map(|c| c.clamp(0.0, 1.0))))
    };
    // The first step starts from a guess for u·v/w that is right at these places of the base.
    let starts = [[0.5, 0.5], [0.1, 0.1], [0.9, 0.1], [0.1, 0.9], [0.9, 0.9]];
    for (k, [r, s]) in starts.into_iter().enumerate() {
        let columns = [
            add_scaled(corner, -r * s, bend),
            add_scaled(a, s, bend),
            add_scaled(b, r, bend),
        ];
        let Some(start) = solve(columns, target) else {
            continue;
        };
        match newton(start, map) {
            Some(x) if k == 0 => return accept(x),
            found => {
                if let Some(weights) = found.and_then(accept) {
                    return Some(weights);
                }
            }
        }
    }
    None
}

fn corner_weights([r, s, w]: Vec3) -> Weights {
    let (q, u) = (1.0 - r, 1.0 - s);
    [
        q * u * w,
        r * u * w,
        r * s * w,
        q * s * w,
        1.0 - w,
        0.0,
        0.0,
        0.0,
    ]
}
