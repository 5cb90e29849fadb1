//! Sixteen tetrahedra at a time: their planes in vectors, tried on one lane after the other.
//!
//! With edges `b, c, d` from corner `a` and the place `p` seen from there, the volumes that `p`
//! makes with the faces are `p·(c×d)`, `p·(d×b)`, `p·(b×c)` and what they leave of the whole,
//! `b·(c×d)`. A place is inside if all have the whole's sign. Every product of an x, a y and a z
//! difference within the leaf's box is at most that box's volume, which bounds all rounding: only
//! volumes above the bound decide, the rest is left to [`crate::weights_at`].

use vacua_simd::{Float, LANES, Mask, Simd, per_axis};
use vacua_volume::CellType;

use crate::element::weights_at;
use crate::layout::PAIR_INDICES;
use crate::packed::Submesh;
use crate::pairs::tets_of;

use super::batch::Batch;
use super::{Located, Places};

/// Bound on the rounding of a volume, in units of the volume of the leaf's box: the last of the
/// four, a difference of four sums of three products of differences, is off by 264 · 2⁻²⁴ at most.
pub(super) const ROUNDING: f64 = 512.0 / (1 << 24) as f64;

/// Where products of scaled differences may be subnormal and lose digits.
const SMALLEST: f32 = f32::MIN_POSITIVE;

/// A tetrahedron this flat, box volume by volume, gets its weights in `f64`.
const FLAT: f32 = 32.0;

#[inline(always)]
fn cross<F: Float>(a: [F; 3], b: [F; 3]) -> [F; 3] {
    let zero = F::splat(0.0);
    [
        a[1].mul_add(b[2], zero - a[2] * b[1]),
        a[2].mul_add(b[0], zero - a[0] * b[2]),
        a[0].mul_add(b[1], zero - a[1] * b[0]),
    ]
}

#[inline(always)]
fn dot<F: Float>(a: [F; 3], b: [F; 3]) -> F {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

/// Tests a batch and keeps, for each lane, the lowest primitive that accepts its place.
#[inline(always)]
pub(super) fn test<S: Simd>(
    submesh: &Submesh,
    batch: &Batch<4>,
    scale: f32,
    rounding: f32,
    at: &Places,
    out: &mut Located,
) {
    let scale = S::F::splat(scale);
    let a = S::gather_points(submesh.positions, batch.corner(0));
    let b = S::gather_points(submesh.positions, batch.corner(1));
    let c = S::gather_points(submesh.positions, batch.corner(2));
    let d = S::gather_points(submesh.positions, batch.corner(3));
    let b = per_axis!(i => (b[i] - a[i]) * scale);
    let c = per_axis!(i => (c[i] - a[i]) * scale);
    let d = per_axis!(i => (d[i] - a[i]) * scale);
    let (cd, db, bc) = (cross(c, d), cross(d, b), cross(b, c));
    let whole = dot(b, cd);
    let mut volume = [0.0; LANES];
    volume.copy_from_slice(&batch.volume[..LANES]);
    let bound = S::F::from_array(volume) * S::F::splat(rounding) + S::F::splat(SMALLEST);
    // With the sign of the whole all volumes inside are positive, whichever way the cell is turned.
    let zero = S::F::splat(0.0);
    let factor = scale.select(zero.le(whole), zero - scale);
    let cd = per_axis!(i => cd[i] * factor);
    let db = per_axis!(i => db[i] * factor);
    let bc = per_axis!(i => bc[i] * factor);
    let whole = whole.abs();
    // Of a cell that may be flat or turned either way nothing is certain.
    let four_bounds = bound * S::F::splat(4.0);
    let bound = bound.select(four_bounds.lt(whole), S::F::splat(f32::INFINITY));
    let below = zero - bound;

    let mut left = batch.lanes;
    while left != 0 {
        let lane = left.trailing_zeros() as usize;
        left &= left - 1;
        let p = per_axis!(i => S::F::splat(at[i][lane]) - a[i]);
        let (u, v, w) = (dot(p, cd), dot(p, db), dot(p, bc));
        let least = u.min(v).min(w.min(whole - (u + v + w)));
        let candidates = batch.candidates[lane];
        let inside = bound.lt(least).to_bits() & candidates;
        let outside = least.lt(below).to_bits();
        let accepted = candidates & !outside;
        if accepted & !inside != 0 || accepted & accepted.wrapping_sub(1) != 0 {
            decide(submesh, batch, inside, accepted, at, lane, out);
            continue;
        }
        // One cell or none, without doubt: no branch, which would be guessed wrong half of the time.
        let slot = (accepted.trailing_zeros() as usize).min(LANES - 1);
        let primitive = batch.primitive[slot];
        let is_found = out.found >> lane & 1 == 1;
        let better = (accepted != 0) & !(is_found & (out.primitive[lane] <= primitive));
        out.primitive[lane] = if better {
            primitive
        } else {
            out.primitive[lane]
        };
        out.node[lane] = if better {
            batch.node[slot]
        } else {
            out.node[lane]
        };
        out.found |= u16::from(better) << lane;
        out.others &= !(u16::from(better) << lane);
    }
}

/// Several cells, or some in doubt, one after the other.
#[cold]
#[inline(never)]
fn decide(
    submesh: &Submesh,
    batch: &Batch<4>,
    inside: u16,
    accepted: u16,
    at: &Places,
    lane: usize,
    out: &mut Located,
) {
    for slot in (0..LANES).filter(|slot| accepted >> slot & 1 == 1) {
        let primitive = batch.primitive[slot];
        if out.found >> lane & 1 == 1 && out.primitive[lane] <= primitive {
            continue;
        }
        let corners = [0, 1, 2, 3].map(|k| batch.corners[k][slot]);
        let sure = inside >> slot & 1 == 1;
        if sure || scalar_weights(submesh, corners, at, lane).is_some() {
            out.primitive[lane] = primitive;
            out.node[lane] = batch.node[slot];
            out.found |= 1 << lane;
            out.others &= !(1 << lane);
        }
    }
}

/// What the scalar code says of a cell and a lane.
#[cold]
#[inline(never)]
fn scalar_weights(
    submesh: &Submesh,
    corners: [u32; 4],
    at: &Places,
    lane: usize,
) -> Option<crate::Weights> {
    let mut positions = [[0.0; 3]; 8];
    for (position, corner) in positions.iter_mut().zip(corners) {
        *position = *submesh.positions.get(corner as usize)?;
    }
    let place = [0, 1, 2].map(|axis| f64::from(at[axis][lane]));
    weights_at(CellType::Tetrahedron, &positions, place)
}

/// The weights of lanes that ended in tetrahedra of this sub-mesh.
#[inline(always)]
pub(super) fn weigh<S: Simd>(
    submesh: &Submesh,
    scale: f32,
    at: &Places,
    lanes: u16,
    out: &mut Located,
) {
    let mut corners = [[0u32; LANES]; 4];
    let mut left = lanes;
    while left != 0 {
        let lane = left.trailing_zeros() as usize;
        left &= left - 1;
        // A tetrahedron on its own reads one index too many, which the padding allows for.
        let primitive = out.primitive[lane];
        let five = submesh.indices.read::<PAIR_INDICES>(primitive / 2);
        let tet = tets_of(five)[(primitive % 2) as usize];
        for k in 0..4 {
            corners[k][lane] = tet[k];
            out.corners[k][lane] = tet[k];
        }
        out.cell_type[lane] = CellType::Tetrahedron as u8;
    }
    let scale = S::F::splat(scale);
    let a = S::gather_points(submesh.positions, &corners[0]);
    let b = S::gather_points(submesh.positions, &corners[1]);
    let c = S::gather_points(submesh.positions, &corners[2]);
    let d = S::gather_points(submesh.positions, &corners[3]);
    let b = per_axis!(i => (b[i] - a[i]) * scale);
    let c = per_axis!(i => (c[i] - a[i]) * scale);
    let d = per_axis!(i => (d[i] - a[i]) * scale);
    let p = per_axis!(i => (S::F::from_array(at[i]) - a[i]) * scale);
    let cd = cross(c, d);
    let whole = dot(b, cd);
    let (zero, one) = (S::F::splat(0.0), S::F::splat(1.0));
    let largest = per_axis!(i => b[i].abs().max(c[i].abs().max(d[i].abs())));
    let volume = largest[0] * largest[1] * largest[2];
    let round = volume.lt(whole.abs() * S::F::splat(FLAT)) & S::F::splat(1e-30).lt(whole.abs());
    let inverse = one.div(whole);
    let u = (dot(p, cd) * inverse).max(zero).min(one);
    let v = (dot(p, cross(d, b)) * inverse).max(zero).min(one);
    let w = (dot(p, cross(b, c)) * inverse).max(zero).min(one);
    let mask = S::M::from_bits(lanes & round.to_bits());
    out.weights[1] = u.select(mask, S::F::from_array(out.weights[1])).to_array();
    out.weights[2] = v.select(mask, S::F::from_array(out.weights[2])).to_array();
    out.weights[3] = w.select(mask, S::F::from_array(out.weights[3])).to_array();
    let mut flat = lanes & !round.to_bits();
    while flat != 0 {
        let lane = flat.trailing_zeros() as usize;
        flat &= flat - 1;
        let corners = [0, 1, 2, 3].map(|k| corners[k][lane]);
        if let Some(weights) = scalar_weights(submesh, corners, at, lane) {
            for k in 1..4 {
                out.weights[k][lane] = weights[k] as f32;
            }
        }
    }
}
