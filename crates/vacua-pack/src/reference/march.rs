//! From tetrahedron to tetrahedron along a ray: what shared faces and tet marching have in common.
//!
//! Marching proposes a tetrahedron for each sample. Sixteen proposals are then checked with the
//! arithmetic of [`crate::weights_at`]: a sample that is not clearly inside is settled among the
//! tetrahedra around it, of which the lowest that accepts it wins. Where tetrahedra overlap or their
//! faces do not match, marching may end in another one than a search would; paper B, §7.1, says so of
//! all such methods.

use vacua_simd::{Kernel, LANES, Simd, dispatch, per_axis};
use vacua_volume::CellType;

use super::face_tree::Line;
use super::search::weigh_tets;
use super::weigh::{self, CLEAR, Vec3, cross, dot, volume};
use super::{Found, NONE, RaySamples};
use crate::block::Places;
use crate::element::{Weights, interpolate};

/// A tetrahedron: its corners, and its neighbours opposite each; [`NONE`] where there is none.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tet {
    pub corners: [u32; 4],
    pub neighbours: [u32; 4],
}

/// What lies ahead on a line.
#[derive(Clone, Copy, Debug)]
pub(super) enum Ahead {
    /// It starts in this tetrahedron.
    In(u32),
    /// It enters this one.
    Enters { t: f64, tet: u32 },
    /// No tetrahedron any more.
    Nothing,
}

/// Tetrahedra and their neighbours.
pub(super) trait Net: Sync {
    /// A tetrahedron.
    fn tet(&self, tet: u32) -> Tet;
    /// Position and value of a vertex.
    fn vertex(&self, vertex: u32) -> [f32; 4];
    /// What lies ahead on a line from a place on it on.
    fn ahead(&self, line: &Line, from: f64) -> Ahead;
    /// About how large all is.
    fn extent(&self) -> f64;
}

/// A sample this near to where a line enters or leaves is checked, in sample distances.
const NEAR: f64 = 1e-3;
/// Steps without getting anywhere before a march is given up.
const STALLED: usize = 64;
/// Steps of a walk to one place.
const MOST_STEPS: usize = 10_000;
/// Tetrahedra around a place that are looked at.
const MOST_AROUND: usize = 256;
/// The direction of rays through places that are on none, and part of the extent that they are long.
const DIRECTION: Vec3 = [0.831_91, 0.430_37, 0.350_29];
const LENGTH: f64 = 1e-3;

#[inline(always)]
fn sub(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// The corners of each face, by the corner opposite.
pub(super) const FACES: [[usize; 3]; 4] = [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]];

/// Where a line leaves a tetrahedron that it has come to from another, and through which face.
#[inline(always)]
fn exit<N: Net>(net: &N, line: &Line, tet: &Tet, from: u32) -> (f64, u32) {
    let corner = |k: usize| {
        let vertex = net.vertex(tet.corners[k]);
        per_axis!(a => f64::from(vertex[a]) - line.origin[a])
    };
    let corners = [corner(0), corner(1), corner(2), corner(3)];
    let (mut leaves_at, mut next) = (f64::INFINITY, NONE);
    for k in 0..4 {
        let neighbour = tet.neighbours[k];
        let [a, b, c] = FACES[k];
        let (a, b, c) = (corners[a], corners[b], corners[c]);
        let normal = cross(sub(b, a), sub(c, a));
        let toward = dot(normal, sub(corners[k], a));
        let rate = dot(normal, line.direction);
        let leaves = if toward >= 0.0 {
            rate < 0.0
        } else {
            rate > 0.0
        };
        let t = dot(normal, a) / rate;
        let first = leaves & (t < leaves_at) & !((neighbour == from) & (from != NONE));
        leaves_at = if first { t } else { leaves_at };
        next = if first { neighbour } else { next };
    }
    (leaves_at, next)
}

/// Where a march is.
#[derive(Clone, Copy, Debug)]
enum State {
    /// Anywhere.
    Unknown,
    /// Before a tetrahedron.
    Before { t: f64, tet: u32 },
    /// In one, until it goes on in the next.
    In { tet: u32, until: f64, next: u32 },
    /// Behind the last.
    Behind,
}

/// A march along a line.
pub(super) struct March<'a, N> {
    net: &'a N,
    line: Line,
    state: State,
}

impl<'a, N: Net> March<'a, N> {
    fn new(net: &'a N, line: Line) -> Self {
        Self {
            net,
            line,
            state: State::Unknown,
        }
    }

    #[inline(always)]
    fn enter(&mut self, tet: u32, from: u32) {
        let (until, next) = exit(self.net, &self.line, &self.net.tet(tet), from);
        self.state = State::In { tet, until, next };
    }

    /// The tetrahedron at a place, which must not lie before that of the last call; [`NONE`] if there
    /// is none near.
    #[inline(always)]
    pub fn tet_at(&mut self, t: f64) -> u32 {
        let mut stalled = 0;
        let mut restarted = false;
        loop {
            match self.state {
                State::Unknown => match self.net.ahead(&self.line, t) {
                    Ahead::In(tet) => self.enter(tet, NONE),
                    Ahead::Enters { t, tet } => self.state = State::Before { t, tet },
                    Ahead::Nothing => self.state = State::Behind,
                },
                State::Before { t: begin, tet } => {
                    if t < begin - NEAR {
                        return NONE;
                    }
                    self.enter(tet, NONE);
                    if t < begin {
                        return tet;
                    }
                }
                State::In { tet, until, next } => {
                    // Also where no face is left through, which is so in flat ones.
                    if t <= until || restarted && stalled > STALLED {
                        return tet;
                    }
                    if next == NONE {
                        if t <= until + NEAR {
                            return tet;
                        }
                        self.state = State::Unknown;
                        stalled += 1;
                        if stalled > STALLED {
                            return tet;
                        }
                        continue;
                    }
                    self.enter(next, tet);
                    if let State::In { until: later, .. } = self.state
                        && later <= until
                    {
                        stalled += 1;
                        if stalled > STALLED && !restarted {
                            restarted = true;
                            stalled = 0;
                            self.state = State::Unknown;
                        }
                    }
                }
                State::Behind => return NONE,
            }
        }
    }

    /// The tetrahedron at a place, or the last before the mesh is left.
    #[inline(always)]
    pub fn within_until(net: &'a N, line: Line, tet: u32, t: f64) -> u32 {
        let mut march = Self::new(net, line);
        march.enter(tet, NONE);
        let mut stalled = 0;
        loop {
            let State::In { tet, until, next } = march.state else {
                return tet;
            };
            if t <= until || next == NONE || stalled > STALLED {
                return tet;
            }
            march.enter(next, tet);
            if let State::In { until: later, .. } = march.state {
                stalled = if later > until { 0 } else { stalled + 1 };
            }
        }
    }
}

/// What a place is to a tetrahedron: corners relative to the place, what volumes they make with the
/// place, positive inside, and their rounding.
fn volumes<N: Net>(net: &N, tet: &Tet, place: Vec3) -> ([f64; 4], [f64; 4]) {
    let corner = |k: usize| {
        let [x, y, z, _] = net.vertex(tet.corners[k]);
        sub([x, y, z].map(f64::from), place)
    };
    let [a, b, c, d] = [corner(0), corner(1), corner(2), corner(3)];
    let all = [
        volume(b, d, c),
        volume(a, c, d),
        volume(a, d, b),
        volume(a, b, c),
    ];
    let sign = if all.iter().map(|v| v.0).sum::<f64>() < 0.0 {
        -1.0
    } else {
        1.0
    };
    (all.map(|v| v.0 * sign), all.map(|v| v.1))
}

/// The lowest tetrahedron that accepts a place, of those around where a walk from a near one ends.
#[cold]
#[inline(never)]
fn settle<N: Net>(net: &N, near: u32, place: [f32; 3]) -> Option<(u32, Weights)> {
    let position = place.map(f64::from);
    let touches = |volumes: &[f64; 4], rounding: &[f64; 4]| {
        (0..4).all(|k| volumes[k] >= -CLEAR * rounding[k])
    };
    let (mut tet, mut from) = (near, NONE);
    for _ in 0..MOST_STEPS {
        let here = net.tet(tet);
        let (volumes, rounding) = volumes(net, &here, position);
        if touches(&volumes, &rounding) {
            break;
        }
        let behind = (0..4).filter(|&k| {
            let neighbour = here.neighbours[k];
            volumes[k] < 0.0 && neighbour != NONE && neighbour != from
        });
        let Some(k) = behind.min_by(|&i, &j| volumes[i].total_cmp(&volumes[j])) else {
            break;
        };
        from = tet;
        tet = here.neighbours[k];
    }
    let mut around = vec![tet];
    let mut best: Option<(u32, Weights)> = None;
    let mut next = 0;
    while next < around.len() {
        let tet = around[next];
        let here = net.tet(tet);
        let mut corners = [[0.0; 4]; 8];
        for (corner, &vertex) in corners.iter_mut().zip(&here.corners) {
            *corner = net.vertex(vertex);
        }
        if best.is_none_or(|(lowest, _)| tet < lowest)
            && let Some(weights) = weigh::one(CellType::Tetrahedron, &corners, place)
        {
            best = Some((tet, weights));
        }
        let (volumes, rounding) = volumes(net, &here, position);
        if next == 0 || touches(&volumes, &rounding) {
            for neighbour in here.neighbours {
                let is_new = neighbour != NONE && !around.contains(&neighbour);
                if is_new && around.len() < MOST_AROUND {
                    around.push(neighbour);
                }
            }
        }
        next += 1;
    }
    best
}

/// The values at places for which tetrahedra are proposed.
#[inline(always)]
fn evaluate<N: Net>(net: &N, at: &Places, proposed: &[u32; LANES], lanes: u16) -> Found {
    let mut found = Found {
        cells: *proposed,
        ..Found::NOTHING
    };
    let mut there = 0;
    for lane in 0..LANES {
        there |= u16::from(proposed[lane] != NONE) << lane;
    }
    let there = there & lanes;
    let corners = |lane: usize| {
        let tet = net.tet(proposed[lane]);
        [0, 1, 2, 3].map(|k| net.vertex(tet.corners[k]))
    };
    let sure = weigh_tets(at, there, corners, &mut found);
    let mut left = there & !sure;
    found.valid &= sure;
    while left != 0 {
        let lane = left.trailing_zeros() as usize % LANES;
        left &= left - 1;
        let place = [0, 1, 2].map(|axis| at[axis][lane]);
        found.cells[lane] = NONE;
        if let Some((tet, weights)) = settle(net, proposed[lane], place) {
            found.cells[lane] = tet;
            let values = net.tet(tet).corners.map(|v| f64::from(net.vertex(v)[3]));
            if let Some(value) = interpolate(&weights, &values) {
                found.values[lane] = value as f32;
                found.valid |= 1 << lane;
            }
        }
    }
    found
}

/// The values at places by themselves, each with a ray of its own.
pub(super) fn sample<N: Net>(net: &N, at: &Places, lanes: u16) -> Found {
    dispatch(OneByOne { net, at, lanes })
}

struct OneByOne<'a, N> {
    net: &'a N,
    at: &'a Places,
    lanes: u16,
}

impl<N: Net> Kernel for OneByOne<'_, N> {
    type Output = Found;

    #[inline(always)]
    fn run<S: Simd>(self) -> Found {
        let mut proposed = [NONE; LANES];
        for lane in (0..LANES).filter(|lane| self.lanes >> lane & 1 == 1) {
            let origin = [0, 1, 2].map(|axis| f64::from(self.at[axis][lane]));
            if origin.iter().all(|c| c.is_finite()) {
                let length = LENGTH * self.net.extent();
                let line = Line {
                    origin,
                    direction: DIRECTION.map(|d| d * length),
                };
                proposed[lane] = March::new(self.net, line).tet_at(0.0);
            }
        }
        evaluate(self.net, self.at, &proposed, self.lanes)
    }
}

/// The values of consecutive samples of a ray; NaN where there is none.
pub(super) fn sample_ray<N: Net>(net: &N, ray: &RaySamples, values: &mut [f32]) {
    dispatch(AlongRay { net, ray, values });
}

struct AlongRay<'a, N> {
    net: &'a N,
    ray: &'a RaySamples,
    values: &'a mut [f32],
}

impl<N: Net> Kernel for AlongRay<'_, N> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        let line = Line {
            origin: self.ray.start.map(f64::from),
            direction: self.ray.step.map(f64::from),
        };
        let mut march = March::new(self.net, line);
        let mut first = self.ray.first;
        for sixteen in self.values.chunks_mut(LANES) {
            let mut proposed = [NONE; LANES];
            for lane in 0..sixteen.len() {
                proposed[lane] = march.tet_at(f64::from(first + lane as u32));
            }
            let lanes = ((1u32 << sixteen.len()) - 1) as u16;
            let found = evaluate(self.net, &self.ray.places(first), &proposed, lanes);
            for (lane, value) in sixteen.iter_mut().enumerate() {
                let valid = found.valid >> lane & 1 == 1;
                *value = if valid { found.values[lane] } else { f32::NAN };
            }
            first += LANES as u32;
        }
    }
}
