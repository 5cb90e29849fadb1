//! Whether a point is in a cell, and the weights of its corners there.
//!
//! A cell accepts a point that lies in the box around its corners *and* whose local coordinates are
//! those of the element, up to a tolerance that depends on rounding and on nothing with a unit: the
//! same mesh in metres and in nanometres gives the same answers. The coordinates are clamped into the
//! element before they become weights, so that what is interpolated never leaves the corners' values.
//!
//! All in `f64`; corners are relative to the point, which is exact enough for positions of `f32`.

mod gradient;
mod hexahedron;
mod linear;
mod pyramid;
mod tetrahedron;
mod wedge;

use vacua_volume::CellType;

pub use gradient::gradient_at;

use linear::Vec3;

/// Local coordinates this far outside the element, which is 1 wide, are still its own: the bound on
/// what Newton's method leaves.
const TOLERANCE: f64 = 1e-9;

/// Weights of a cell's corners in VTK's order: none negative, 1 in sum; 0 past its corners.
pub type Weights = [f64; 8];

/// The weights at a position, or `None` if the cell does not accept it.
///
/// `corners` are the cell's corners in VTK's order, as many as its type has (others are not looked
/// at); both are relative to the same origin. A cell that is flat accepts nothing.
#[inline]
pub fn weights_at(
    cell_type: CellType,
    corners: &[[f32; 3]; 8],
    position: [f64; 3],
) -> Option<Weights> {
    let n = cell_type.num_points();
    let inside = (0..3).all(|axis| {
        let (mut lo, mut hi) = (f32::INFINITY, f32::NEG_INFINITY);
        for corner in &corners[..n] {
            lo = lo.min(corner[axis]);
            hi = hi.max(corner[axis]);
        }
        f64::from(lo) <= position[axis] && position[axis] <= f64::from(hi)
    });
    if !inside {
        return None;
    }
    let at = |k: usize| -> Vec3 {
        let c = corners[k];
        [
            f64::from(c[0]) - position[0],
            f64::from(c[1]) - position[1],
            f64::from(c[2]) - position[2],
        ]
    };
    weights_from(cell_type, at)
}

/// As [`weights_at`] for corners in `f64`: those of a mesh that is not packed.
pub fn weights_at_f64(
    cell_type: CellType,
    corners: &[[f64; 3]; 8],
    position: [f64; 3],
) -> Option<Weights> {
    let n = cell_type.num_points();
    let inside = (0..3).all(|axis| {
        let of_axis = corners[..n].iter().map(|c| c[axis]);
        let lo = of_axis.clone().fold(f64::INFINITY, f64::min);
        let hi = of_axis.fold(f64::NEG_INFINITY, f64::max);
        lo <= position[axis] && position[axis] <= hi
    });
    let at = |k: usize| linear::sub(corners[k], position);
    inside.then(|| weights_from(cell_type, at))?
}

/// The weights at the origin, of corners relative to it.
#[inline(always)]
fn weights_from(cell_type: CellType, at: impl Fn(usize) -> Vec3) -> Option<Weights> {
    match cell_type {
        CellType::Tetrahedron => tetrahedron::weights([at(0), at(1), at(2), at(3)]),
        CellType::Pyramid => pyramid::weights([at(0), at(1), at(2), at(3), at(4)]),
        CellType::Wedge => wedge::weights([at(0), at(1), at(2), at(3), at(4), at(5)]),
        CellType::Hexahedron => hexahedron::weights(std::array::from_fn(at)),
    }
}

/// The value that weights make of the corners' values: within their range whatever the rounding, and
/// `None` if one of them is no finite number.
#[inline]
pub fn interpolate(weights: &Weights, values: &[f64]) -> Option<f64> {
    let (mut lo, mut hi, mut sum) = (f64::INFINITY, f64::NEG_INFINITY, 0.0);
    let &first = values.first()?;
    for (&w, &v) in weights.iter().zip(values) {
        if !v.is_finite() {
            return None;
        }
        lo = lo.min(v);
        hi = hi.max(v);
        // Differences to one corner keep small signals on large offsets, and constants exact.
        sum += w * (v - first);
    }
    Some((first + sum).clamp(lo, hi))
}

#[cfg(test)]
mod tests;
