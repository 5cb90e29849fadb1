//! The trilinear map.

use super::linear::{Vec3, add_scaled, newton, sub};
use super::{TOLERANCE, Weights};

/// The weights at the origin.
pub fn weights(p: [Vec3; 8]) -> Option<Weights> {
    // Coefficients of 1, r, s, t, rs, st, tr, rst.
    let (a, b, c, d) = (sub(p[1], p[0]), sub(p[3], p[0]), sub(p[4], p[0]), p[0]);
    let rs = sub(sub(p[2], p[3]), a);
    let st = sub(sub(p[7], p[4]), b);
    let tr = sub(sub(p[5], p[4]), a);
    let rst = sub(sub(sub(p[6], p[7]), sub(p[5], p[4])), rs);
    let map = |[r, s, t]: Vec3| {
        let by_r = add_scaled(add_scaled(add_scaled(a, s, rs), t, tr), s * t, rst);
        let by_s = add_scaled(add_scaled(add_scaled(b, t, st), r, rs), r * t, rst);
        let by_t = add_scaled(add_scaled(add_scaled(c, r, tr), s, st), r * s, rst);
        // All terms with r, then those with s and t alone.
        let plane = add_scaled(add_scaled(add_scaled(d, s, b), t, c), s * t, st);
        (add_scaled(plane, r, by_r), [by_r, by_s, by_t])
    };
    let accept = |x: Vec3| {
        let near = x.iter().all(|c| (-TOLERANCE..=1.0 + TOLERANCE).contains(c));
        near.then(|| corner_weights(x.map(|c| c.clamp(0.0, 1.0))))
    };
    if let Some(x) = newton([0.5; 3], map) {
        return accept(x);
    }
    let corner = |k: usize| [0, 1, 2].map(|axis| if k >> axis & 1 == 1 { 0.9 } else { 0.1 });
    (0..8).find_map(|k| newton(corner(k), map).and_then(accept))
}

fn corner_weights([r, s, t]: Vec3) -> Weights {
    let (q, u, v) = (1.0 - r, 1.0 - s, 1.0 - t);
    [
        q * u * v,
        r * u * v,
        r * s * v,
        q * s * v,
        q * u * t,
        r * u * t,
        r * s * t,
        q * s * t,
    ]
}
