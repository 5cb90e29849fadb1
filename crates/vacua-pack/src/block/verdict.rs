//! Whether places are inside pyramids, wedges and hexahedra, and the weights there: sixteen pairs of
//! cell and place at a time.

use vacua_simd::{Float, Int, LANES, Mask, Simd, per_axis};
use vacua_volume::CellType;

use super::MAX_CORNERS;
use super::maps::{Hexahedron, Pyramid, Wedge, largest, newton};

/// A pyramid's apex, in units of its size, within which base coordinates mean too little.
const NEAR_APEX: f32 = 1.0 / 64.0;

/// What vectors say of sixteen pairs.
pub(super) struct Verdict<S: Simd> {
    pub inside: S::M,
    pub outside: S::M,
    pub weights: [S::F; MAX_CORNERS],
}

/// Inverts the maps of sixteen cells, given by their corners relative to the place.
#[inline(always)]
pub(super) fn judge<S: Simd>(
    mut p: [[S::F; 3]; MAX_CORNERS],
    cell_type: &[u8; LANES],
    lanes: u16,
) -> Verdict<S> {
    let zero = S::F::splat(0.0);
    let mut size = zero;
    for k in 0..MAX_CORNERS {
        size = size.max(largest(p[k]));
    }
    // The power of two that brings sizes to between 1 and 2, for those that are normal numbers.
    let exponent = size.to_bits().and(S::I::splat(0x7F80_0000));
    let scale = S::f_from_bits(S::I::splat(0x7F00_0000) - exponent);
    for k in 0..MAX_CORNERS {
        p[k] = per_axis!(i => p[k][i] * scale);
    }
    let tame = S::F::splat(1e-30).lt(size) & size.lt(S::F::splat(1e30));
    let tame = tame & S::M::from_bits(lanes);
    let mut of_kind = [0u16; 4];
    for pair in 0..LANES {
        of_kind[usize::from(cell_type[pair] & 3)] |= 1 << pair;
    }
    let none = S::M::from_bits(0);
    let mut verdict = Verdict::<S> {
        inside: none,
        outside: none,
        weights: [zero; MAX_CORNERS],
    };
    let hexahedra = of_kind[CellType::Hexahedron as usize] & lanes;
    if hexahedra != 0 {
        hexahedron::<S>(&p, tame & S::M::from_bits(hexahedra), &mut verdict);
    }
    let wedges = of_kind[CellType::Wedge as usize] & lanes;
    if wedges != 0 {
        wedge::<S>(&p, tame & S::M::from_bits(wedges), &mut verdict);
    }
    let pyramids = of_kind[CellType::Pyramid as usize] & lanes;
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
