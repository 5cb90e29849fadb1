//! Two blocks of samples at a time: what becomes of their values.
//!
//! Compositing (the contract's point 2): within a block of eight, transmittance is a prefix product
//! in a fixed order; across blocks it multiplies front to back. Samples without extinction multiply
//! by 1 and add 0, exactly, so that leaving out blocks that hold nothing else changes no bit.

use std::marker::PhantomData;

use vacua_simd::math::opacity_of_depth;
use vacua_simd::{BLOCK, Float, IN_BLOCK, Int, LANES, Mask, Simd, per_axis};
use vacua_skip::Bundle;
use vacua_volume::{TRANSFER_BINS, TransferTable, ValueScale};

use crate::blocks::{BlockPair, Group, Sampled, Visit};
use crate::light::LIGHT;
use crate::sampler::Sampler;
use crate::setup::{LaneRay, TILE_RAYS, TileRays};

/// What one ray gives.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RayResult {
    pub rgba: [f32; 4],
    /// Number of the sample that depth refers to.
    pub depth_sample: Option<u32>,
    /// Samples evaluated.
    pub samples: u32,
}

impl RayResult {
    /// Of a ray without samples.
    pub const NOTHING: Self = Self {
        rgba: [0.0; 4],
        depth_sample: None,
        samples: 0,
    };
}

/// Sixteen sample numbers.
#[inline(always)]
fn numbers<S: Simd>(pair: BlockPair) -> S::F {
    let first = S::F::of_blocks(pair.first[0], pair.first[1]);
    let stride = S::F::of_blocks(pair.stride[0], pair.stride[1]);
    S::F::from_array(IN_BLOCK).mul_add(stride, first)
}

/// Which numbers are those of samples of a ray.
#[inline(always)]
fn of_ray<S: Simd>(ray: &LaneRay, k: S::F) -> S::M {
    S::F::splat(ray.begin).le(k) & k.lt(S::F::splat(ray.end))
}

/// Positions of samples in ray space.
#[inline(always)]
fn positions<S: Simd>(ray: &LaneRay, k: S::F) -> [S::F; 3] {
    per_axis!(a => k.mul_add(S::F::splat(ray.step[a]), S::F::splat(ray.start[a])))
}

/// Of some values those that may be seen: all, or those whose bin of a transfer table has extinction.
#[inline(always)]
fn seen<S: Simd>(table: Option<&TransferTable>, value: S::F, valid: S::M) -> S::M {
    let Some(table) = table else {
        return valid;
    };
    let bin = table_coordinate::<S>(table, value)
        .to_i()
        .min_unsigned(S::I::splat(LAST_BIN));
    valid & S::bit_of_1024(table.active_bins(), bin)
}

/// Values of pairs of blocks, and which may be seen.
#[inline(always)]
fn sample<S: Simd, V: Sampler>(
    sampler: &V,
    tile: &TileRays,
    pairs: &[(u8, BlockPair)],
    group: &mut Group<S, V::Place>,
    table: Option<&TransferTable>,
) {
    let mut places = Vec::new();
    if V::IS_TOGETHER {
        places.reserve_exact(pairs.len());
    }
    for (n, (i, pair)) in pairs.iter().enumerate() {
        let i = usize::from(*i) % TILE_RAYS;
        let ray = &tile.lanes[i];
        let k = numbers::<S>(*pair);
        let at = positions::<S>(ray, k);
        group.lanes[n] = of_ray::<S>(ray, k);
        if V::IS_TOGETHER {
            places.push((i, at));
            continue;
        }
        let (value, valid, place) = sampler.sample::<S>(at, group.lanes[n]);
        group.value[n] = value;
        group.seen[n] = seen::<S>(table, value, valid);
        group.place[n] = place;
    }
    if V::IS_TOGETHER {
        sampler.sample_tile::<S>(&places, group);
        for n in 0..pairs.len() {
            group.seen[n] = seen::<S>(table, group.value[n], group.seen[n]);
        }
    }
}

/// Where values lie in a transfer table: bins, and fractions of the way through them.
#[derive(Clone, Copy)]
struct TablePlace<S: Simd> {
    bin: S::I,
    fraction: S::F,
}

/// The last bin of a table.
const LAST_BIN: i32 = TRANSFER_BINS as i32 - 1;

/// The vector twin of [`TransferTable::coordinate`], not yet limited from above.
#[inline(always)]
fn table_coordinate<S: Simd>(table: &TransferTable, value: S::F) -> S::F {
    let lo = S::F::splat(table.lo());
    let key = match table.scale() {
        ValueScale::Linear => value - lo,
        ValueScale::Log => S::f_from_i(value.max(lo).to_bits() - lo.to_bits()),
    };
    (key * S::F::splat(table.bins_per_key())).max(S::F::splat(0.0))
}

/// Bins and fractions of values.
#[inline(always)]
fn table_place<S: Simd>(table: &TransferTable, value: S::F) -> TablePlace<S> {
    let end = S::F::splat(TRANSFER_BINS as f32);
    let coordinate = table_coordinate::<S>(table, value).min(end);
    let bin = coordinate.to_i().min(S::I::splat(LAST_BIN));
    TablePlace {
        bin,
        fraction: coordinate - S::f_from_i(bin),
    }
}

impl<S: Simd> TablePlace<S> {
    /// Linear-light colour and extinction.
    #[inline(always)]
    fn look_up(self, table: &TransferTable) -> ([S::F; 3], S::F) {
        let entries = table.entries();
        debug_assert_eq!(entries.len(), TRANSFER_BINS + 1);
        // SAFETY: bins are at most `TRANSFER_BINS − 1`, of which there is one entry more.
        let [a, b] = unsafe { S::gather_rows(entries, self.bin) };
        let at = |c: usize| self.fraction.mul_add(b[c] - a[c], a[c]);
        ([at(0), at(1), at(2)], at(3))
    }
}

/// How lit surfaces look: a light at the camera, Blinn–Phong.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Light {
    /// Unit vector from surface to camera and light, times the transpose of the map from world to
    /// ray directions: its dot product with a ray-space gradient is that of the world's.
    pub toward: [f32; 3],
    /// World gradients squared as a form on ray-space gradients: xx, yy, zz, 2xy, 2xz, 2yz.
    pub metric: [f32; 6],
}

impl Light {
    /// Factor on the colour and white added to it. Where there is no gradient, there is no surface
    /// and the colour stays.
    #[inline(always)]
    fn shade<S: Simd>(&self, g: [S::F; 3]) -> (S::F, S::F) {
        let m = &self.metric;
        let length_sq = g[0]
            * (g[0] * S::F::splat(m[0]) + g[1] * S::F::splat(m[3]) + g[2] * S::F::splat(m[4]))
            + g[1] * (g[1] * S::F::splat(m[1]) + g[2] * S::F::splat(m[5]))
            + g[2] * g[2] * S::F::splat(m[2]);
        let t = &self.toward;
        let along = g[0] * S::F::splat(t[0]) + g[1] * S::F::splat(t[1]) + g[2] * S::F::splat(t[2]);
        let lit = S::F::splat(f32::MIN_POSITIVE).lt(length_sq);
        let cosine = along.abs().div(length_sq.sqrt()).min(S::F::splat(1.0));
        let factor = cosine.mul_add(S::F::splat(LIGHT.diffuse), S::F::splat(LIGHT.ambient));
        let mut shine = cosine;
        for _ in 0..LIGHT.shininess.ilog2() {
            shine = shine * shine;
        }
        (
            factor.select(lit, S::F::splat(1.0)),
            (shine * S::F::splat(LIGHT.specular)).or_zero(lit),
        )
    }
}

/// What lights the rays of a tile.
pub(crate) type Lights = [Light; TILE_RAYS];

/// Front-to-back compositing.
pub(crate) struct Composite<'a, S, V> {
    pub sampler: &'a V,
    pub tile: &'a TileRays,
    pub table: &'a TransferTable,
    /// Transmittance below which a ray ends.
    pub termination: f32,
    pub lights: Option<&'a Lights>,
    pub simd: PhantomData<S>,
}

/// What has been composited of a ray.
#[derive(Clone, Copy)]
pub(crate) struct Composited {
    transmittance: f32,
    /// A sum a lane of a block.
    color: [[f32; BLOCK]; 3],
    depth_sample: Option<u32>,
}

impl Composited {
    /// Nothing so far.
    #[inline(always)]
    pub fn new() -> Self {
        Self {
            transmittance: 1.0,
            color: [[0.0; BLOCK]; 3],
            depth_sample: None,
        }
    }

    #[inline(always)]
    pub fn finish(&self, samples: u32) -> RayResult {
        let [r, g, b] = per_axis!(i => {
            let [a, b, c, d, e, f, g, h] = self.color[i];
            ((a + b) + (c + d)) + ((e + f) + (g + h))
        });
        RayResult {
            rgba: [r, g, b, 1.0 - self.transmittance],
            depth_sample: self.depth_sample,
            samples,
        }
    }

    /// The first sample of a block at which less than half of the light comes through.
    #[cold]
    fn find_depth(
        &mut self,
        pair: BlockPair,
        block: usize,
        front: f32,
        exclusive: [f32; BLOCK],
        clear: [f32; BLOCK],
    ) {
        let lane = (0..BLOCK).find(|&i| front * (exclusive[i] * clear[i]) <= 0.5);
        let lane = lane.unwrap_or(BLOCK - 1) as u32;
        self.depth_sample = Some(pair.first[block] as u32 + lane * pair.stride[block] as u32);
    }
}

impl<S: Simd, V: Sampler> Visit<S> for Composite<'_, S, V> {
    type State = Composited;
    type Place = V::Place;
    const IS_TOGETHER: bool = V::IS_TOGETHER;

    #[inline(always)]
    fn sample(&self, pairs: &[(u8, BlockPair)], group: &mut Group<S, V::Place>) {
        sample::<S, V>(self.sampler, self.tile, pairs, group, Some(self.table));
    }

    #[inline(always)]
    fn fetch_ahead(&self, beam: &Bundle, samples: [f32; 2]) {
        self.sampler.fetch_ahead(beam, samples);
    }

    #[inline(always)]
    fn add(
        &self,
        i: usize,
        state: &mut Composited,
        pair: BlockPair,
        sampled: Sampled<S, &V::Place>,
    ) -> bool {
        let (mut rgb, extinction) = table_place::<S>(self.table, sampled.value).look_up(self.table);
        let seen = sampled.seen & S::F::splat(0.0).lt(extinction);
        if !seen.any() {
            return true;
        }
        let dt = self.tile.lanes[i].dt;
        let length = S::F::of_blocks(dt * pair.stride[0], dt * pair.stride[1]);
        let alpha = opacity_of_depth::<S>(extinction * length).or_zero(seen);
        let clear = S::F::splat(1.0) - alpha;
        let (exclusive, [through_a, through_b]) = clear.block_products();
        let front_a = state.transmittance;
        let front_b = front_a * through_a;
        let a_ends = front_b < self.termination;
        let front = S::F::of_blocks(front_a, if a_ends { 0.0 } else { front_b });
        let weight = (front * exclusive) * alpha;
        if let Some(lights) = self.lights {
            let at = positions::<S>(&self.tile.lanes[i], numbers::<S>(pair));
            let gradient = self.sampler.gradient::<S>(at, sampled.place);
            let (factor, white) = lights[i].shade::<S>(gradient);
            rgb = per_axis!(c => rgb[c].mul_add(factor, white));
        }
        for c in 0..3 {
            (weight * rgb[c])
                .or_zero(seen)
                .add_blocks_to(&mut state.color[c]);
        }
        state.transmittance = if a_ends { front_b } else { front_b * through_b };
        if state.depth_sample.is_none() && state.transmittance <= 0.5 {
            let (exclusive, clear) = (exclusive.blocks(), clear.blocks());
            if front_b <= 0.5 {
                state.find_depth(pair, 0, front_a, exclusive[0], clear[0]);
            } else {
                state.find_depth(pair, 1, front_b, exclusive[1], clear[1]);
            }
        }
        !(a_ends || state.transmittance < self.termination)
    }
}

/// The largest value along a ray.
pub(crate) struct Maximum<'a, S, V> {
    pub sampler: &'a V,
    pub tile: &'a TileRays,
    pub simd: PhantomData<S>,
}

/// The largest value so far.
#[derive(Clone, Copy)]
pub(crate) struct Largest<S: Simd> {
    best: S::F,
    best_k: S::F,
}

impl<S: Simd> Largest<S> {
    /// Only values above `threshold` are seen.
    #[inline(always)]
    pub fn new(threshold: f32) -> Self {
        let (best, best_k) = (S::F::splat(threshold), S::F::splat(-1.0));
        Self { best, best_k }
    }

    #[inline(always)]
    pub fn finish(&self, table: &TransferTable, samples: u32) -> RayResult {
        let (best, k) = (self.best.to_array(), self.best_k.to_array());
        let mut found: Option<(f32, f32)> = None;
        for i in (0..LANES).filter(|&i| k[i] >= 0.0) {
            let better = found.is_none_or(|(v, first)| best[i] > v || best[i] == v && k[i] < first);
            if better {
                found = Some((best[i], k[i]));
            }
        }
        let Some((value, k)) = found else {
            return RayResult {
                rgba: [0.0; 4],
                depth_sample: None,
                samples,
            };
        };
        let [r, g, b] = table.evaluate(value).1;
        RayResult {
            rgba: [r, g, b, 1.0],
            depth_sample: Some(k as u32),
            samples,
        }
    }
}

impl<S: Simd, V: Sampler> Visit<S> for Maximum<'_, S, V> {
    type State = Largest<S>;
    type Place = V::Place;
    const IS_TOGETHER: bool = V::IS_TOGETHER;

    #[inline(always)]
    fn sample(&self, pairs: &[(u8, BlockPair)], group: &mut Group<S, V::Place>) {
        sample::<S, V>(self.sampler, self.tile, pairs, group, None);
    }

    #[inline(always)]
    fn fetch_ahead(&self, beam: &Bundle, samples: [f32; 2]) {
        self.sampler.fetch_ahead(beam, samples);
    }

    #[inline(always)]
    fn add(
        &self,
        _: usize,
        state: &mut Largest<S>,
        pair: BlockPair,
        sampled: Sampled<S, &V::Place>,
    ) -> bool {
        let k = numbers::<S>(pair);
        let better = sampled.seen & state.best.lt(sampled.value);
        state.best = sampled.value.select(better, state.best);
        state.best_k = k.select(better, state.best_k);
        true
    }
}
