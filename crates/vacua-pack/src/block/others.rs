//! Sixteen pyramids, wedges and hexahedra at a time: their boxes tried on one lane after the other,
//! then the inverse of their maps on sixteen pairs of cell and lane.

use vacua_simd::{Float, Int, LANES, Mask, Simd, per_axis};
use vacua_volume::CellType;

use crate::element::weights_at;
use crate::packed::Submesh;

use super::batch::Batch;
use super::maps::{Hexahedron, Pyramid, Wedge, largest, newton};
use super::{Located, MAX_CORNERS, Places};

/// A pyramid's apex, in units of its size, within which base coordinates mean too little.
const NEAR_APEX: f32 = 1.0 / 64.0;

/// Pairs of cell and lane that a batch can give.
const PAIRS: usize = LANES * LANES;

/// What vectors say of sixteen pairs.
struct Verdict<S: Simd> {
    inside: S::M,
    outside: S::M,
    weights: [S::F; MAX_CORNERS],
}

/// Tests a batch and keeps, for each lane, the lowest primitive that accepts its place.
#[inline(always)]
pub(super) fn test<S: Simd>(
    submesh: &Submesh,
    batch: &Batch<MAX_CORNERS>,
    at: &Places,
    out: &mut Located,
) {
    let zero = S::F::splat(0.0);
    let mut corners = [[zero; 3]; MAX_CORNERS];
    for k in 0..MAX_CORNERS {
        corners[k] = S::gather_points(submesh.positions, batch.corner(k));
    }
    let mut lo = corners[0];
    let mut hi = corners[0];
    for k in 1..MAX_CORNERS {
        lo = per_axis!(i => corners[k][i].min(lo[i]));
        hi = per_axis!(i => corners[k][i].max(hi[i]));
    }
    let mut slots = [0i32; PAIRS];
    let mut lanes = [0i32; PAIRS];
    let mut num_pairs = 0;
    let mut left = batch.lanes;
    while left != 0 {
        let lane = left.trailing_zeros() as usize;
        left &= left - 1;
        let within = per_axis!(i => {
            let p = S::F::splat(at[i][lane]);
            lo[i].le(p) & p.le(hi[i])
        });
        let within = within[0] & within[1] & within[2];
        let mut bits = within.to_bits() & batch.candidates[lane];
        while bits != 0 {
            slots[num_pairs % PAIRS] = bits.trailing_zeros() as i32;
            lanes[num_pairs % PAIRS] = lane as i32;
            num_pairs += 1;
            bits &= bits - 1;
        }
    }
    let mut first = 0;
    while first < num_pairs {
        let mut slot_of = [0; LANES];
        let mut lane_of = [0; LANES];
        let len = (num_pairs - first).min(LANES);
        slot_of[..len].copy_from_slice(&slots[first..first + len]);
        lane_of[..len].copy_from_slice(&lanes[first..first + len]);
        first += len;
        let verdict = judge::<S>(batch, &corners, at, slot_of, lane_of, len);
        let (inside, outside) = (verdict.inside.to_bits(), verdict.outside.to_bits());
        let mut weights = [[0.0; LANES]; MAX_CORNERS];
        for k in 1..MAX_CORNERS {
            weights[k] = verdict.weights[k].to_array();
        }
        for pair in 0..len {
            if outside >> pair & 1 == 1 {
                continue;
            }
            let (slot, lane) = (
                slot_of[pair] as usize % LANES,
                lane_of[pair] as usize % LANES,
            );
            let primitive = batch.primitive[slot];
            if out.found >> lane & 1 == 1 && out.primitive[lane] <= primitive {
                continue;
            }
            if inside >> pair & 1 == 1 {
                for k in 1..MAX_CORNERS {
                    out.weights[k][lane] = weights[k][pair];
                }
            } else if !decide(submesh, batch, slot, at, lane, out) {
                continue;
            }
            out.found |= 1 << lane;
            out.others |= 1 << lane;
            out.primitive[lane] = primitive;
            out.cell_type[lane] = batch.cell_type[slot];
            out.node[lane] = batch.node[slot];
            for k in 0..MAX_CORNERS {
                out.corners[k][lane] = batch.corners[k][slot];
            }
        }
    }
}

/// The kind of a cell in a slot.
#[inline(always)]
fn kind(batch: &Batch<MAX_CORNERS>, slot: usize) -> CellType {
    CellType::ALL[usize::from(batch.cell_type[slot]) % CellType::ALL.len()]
}

/// The scalar code's answer for a cell and a lane, with the weights if it accepts.
#[cold]
#[inline(never)]
fn decide(
    submesh: &Submesh,
    batch: &Batch<MAX_CORNERS>,
    slot: usize,
    at: &Places,
    lane: usize,
    out: &mut Located,
) -> bool {
    let mut positions = [[0.0; 3]; MAX_CORNERS];
    for k in 0..MAX_CORNERS {
        let Some(position) = submesh.positions.get(batch.corners[k][slot] as usize) else {
            return false;
        };
        positions[k] = *position;
    }
    let place = [0, 1, 2].map(|axis| f64::from(at[axis][lane]));
    let Some(weights) = weights_at(kind(batch, slot), &positions, place) else {
        return false;
    };
    for k in 1..MAX_CORNERS {
        out.weights[k][lane] = weights[k] as f32;
    }
    true
}

/// Inverts the maps of sixteen pairs.
#[inline(always)]
fn judge<S: Simd>(
    batch: &Batch<MAX_CORNERS>,
    corners: &[[S::F; 3]; MAX_CORNERS],
    at: &Places,
    slot_of: [i32; LANES],
    lane_of: [i32; LANES],
    len: usize,
) -> Verdict<S> {
    let (slot, lane) = (S::I::from_array(slot_of), S::I::from_array(lane_of));
    let place = per_axis!(i => S::F::from_array(at[i]).permute(lane));
    let zero = S::F::splat(0.0);
    let mut p = [[zero; 3]; MAX_CORNERS];
    let mut size = zero;
    for k in 0..MAX_CORNERS {
        p[k] = per_axis!(i => corners[k][i].permute(slot) - place[i]);
        size = size.max(largest(p[k]));
    }
    // The power of two that brings sizes to between 1 and 2, for those that are normal numbers.
    let exponent = size.to_bits().and(S::I::splat(0x7F80_0000));
    let scale = S::f_from_bits(S::I::splat(0x7F00_0000) - exponent);
    for k in 0..MAX_CORNERS {
        p[k] = per_axis!(i => p[k][i] * scale);
    }
    let tame = S::F::splat(1e-30).lt(size) & size.lt(S::F::splat(1e30));
    let tame = tame & S::M::from_bits(((1u32 << len) - 1) as u16);
    let mut of_kind = [0u16; 4];
    for pair in 0..len {
        let kind = usize::from(batch.cell_type[slot_of[pair] as usize % LANES] & 3);
        of_kind[kind] |= 1 << pair;
    }
    let none = S::M::from_bits(0);
    let mut verdict = Verdict::<S> {
        inside: none,
        outside: none,
        weights: [zero; MAX_CORNERS],
    };
    let hexahedra = of_kind[CellType::Hexahedron as usize];
    if hexahedra != 0 {
        hexahedron::<S>(&p, tame & S::M::from_bits(hexahedra), &mut verdict);
    }
    let wedges = of_kind[CellType::Wedge as usize];
    if wedges != 0 {
        wedge::<S>(&p, tame & S::M::from_bits(wedges), &mut verdict);
    }
    let pyramids = of_kind[CellType::Pyramid as usize];
    if pyramids != 0 {
        pyramid::<S>(&p, tame & S::M::from_bits(pyramids), &mut verdict);
    }
    verdict
}

impl<S: Simd> Verdict<S> {
    /// Adds what is known of some lanes: the least of the coordinates that must not be negative, how
    /// far it may be off, and the weights.
    #[inline(always)]
    fn add(&mut self, certain: S::M, least: S::F, margin: S::F, weights: &[(usize, S::F)]) {
        let inside = certain & margin.lt(least);
        self.inside = self.inside | inside;
        self.outside = self.outside | certain & least.lt(S::F::splat(0.0) - margin);
        for &(k, weight) in weights {
            self.weights[k] = weight.select(inside, self.weights[k]);
        }
    }
}

#[inline(always)]
fn hexahedron<S: Simd>(p: &[[S::F; 3]; 8], lanes: S::M, verdict: &mut Verdict<S>) {
    let (half, one) = (S::F::splat(0.5), S::F::splat(1.0));
    let root = newton::<S>([half; 3], S::F::splat(0.0), &Hexahedron::<S>::new(p), lanes);
    let [r, s, t] = root.x;
    let (q, u, v) = (one - r, one - s, one - t);
    let least = r.min(s).min(t).min(q.min(u).min(v));
    let (uv, sv, ut, st) = (u * v, s * v, u * t, s * t);
    let weights = [
        (1, r * uv),
        (2, r * sv),
        (3, q * sv),
        (4, q * ut),
        (5, r * ut),
        (6, r * st),
        (7, q * st),
    ];
    verdict.add(root.certain, least, root.margin, &weights);
}

#[inline(always)]
fn wedge<S: Simd>(p: &[[S::F; 3]; 8], lanes: S::M, verdict: &mut Verdict<S>) {
    let (third, half) = (S::F::splat(1.0 / 3.0), S::F::splat(0.5));
    let root = newton::<S>(
        [third, third, half],
        S::F::splat(0.0),
        &Wedge::<S>::new(p),
        lanes,
    );
    let [r, s, t] = root.x;
    let one = S::F::splat(1.0);
    let (q, u) = (one - r - s, one - t);
    let least = r.min(s).min(q).min(t.min(u));
    let zero = S::F::splat(0.0);
    let weights = [
        (1, r * u),
        (2, s * u),
        (3, q * t),
        (4, r * t),
        (5, s * t),
        (6, zero),
        (7, zero),
    ];
    // The third of the triangle's coordinates is off by as much as the other two together.
    verdict.add(
        root.certain,
        least,
        root.margin * S::F::splat(2.0),
        &weights,
    );
}

#[inline(always)]
fn pyramid<S: Simd>(p: &[[S::F; 3]; 8], lanes: S::M, verdict: &mut Verdict<S>) {
    let map = Pyramid::<S>::new(p);
    let (start, error) = map.start();
    let root = newton::<S>(start, error, &map, lanes);
    let [w, u, v] = root.x;
    let (zero, one) = (S::F::splat(0.0), S::F::splat(1.0));
    let (r, s) = (u.div(w), v.div(w));
    let height = w * map.distance;
    let least = r.min(s).min((one - r).min(one - s)).min(one - height);
    // Base coordinates are quotients: of numbers up to FAR, by one that is not small.
    let margin = root.margin * S::F::splat(4.0).div(w);
    let certain = root.certain
        & S::F::splat(1.0 / 16.0).lt(w)
        & S::F::splat(NEAR_APEX).lt(map.distance)
        & r.abs().lt(S::F::splat(2.0))
        & s.abs().lt(S::F::splat(2.0))
        & height.lt(S::F::splat(4.0));
    let (q, t) = (one - r, one - s);
    let weights = [
        (1, r * t * height),
        (2, r * s * height),
        (3, q * s * height),
        (4, one - height),
        (5, zero),
        (6, zero),
        (7, zero),
    ];
    verdict.add(certain, least, margin, &weights);
}
