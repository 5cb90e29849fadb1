//! Barycentric coordinates.

use super::Weights;
use super::linear::{Vec3, cross, dot};

/// Rounding of a determinant of differences, in units of the sum of the magnitudes of its terms.
const ROUNDING: f64 = 16.0 * f64::EPSILON;

/// Six times the signed volume between the origin and a triangle, and a bound on its rounding.
#[inline(always)]
fn volume(a: Vec3, b: Vec3, c: Vec3) -> (f64, f64) {
    let [x, y, z] = a.map(f64::abs);
    let magnitude = x * ((b[1] * c[2]).abs() + (b[2] * c[1]).abs())
        + y * ((b[2] * c[0]).abs() + (b[0] * c[2]).abs())
        + z * ((b[0] * c[1]).abs() + (b[1] * c[0]).abs());
    (dot(a, cross(b, c)), ROUNDING * magnitude)
}

/// The weights at the origin. A face accepts points within the rounding of its own volume, so that
/// of two tetrahedra with a common face at least one accepts each point of it.
#[inline]
pub fn weights([a, b, c, d]: [Vec3; 4]) -> Option<Weights> {
    let volumes = [
        volume(b, d, c),
        volume(a, c, d),
        volume(a, d, b),
        volume(a, b, c),
    ];
    let whole: f64 = volumes.iter().map(|v| v.0).sum();
    let rounding: f64 = volumes.iter().map(|v| v.1).sum();
    // Flat, as far as can be told, or not finite; an inverted one is as good as any.
    if whole.abs() <= rounding || !whole.is_finite() {
        return None;
    }
    let sign = whole.signum();
    let mut weights = [0.0; 8];
    for (w, (volume, rounding)) in weights.iter_mut().zip(volumes) {
        let volume = volume * sign;
        if volume < -rounding {
            return None;
        }
        *w = volume.max(0.0);
    }
    let sum = weights[0] + weights[1] + weights[2] + weights[3];
    weights[..4].iter_mut().for_each(|w| *w /= sum);
    Some(weights)
}
