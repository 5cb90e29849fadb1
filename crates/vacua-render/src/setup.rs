//! From pixels to the samples of their rays: world to ray space, the volume's box, clip planes,
//! jitter. A tile of rays at a time, all in `f64`; what the kernels then compute with is `f32`.

use glam::{DAffine3, DVec3};
use vacua_skip::{Lattice, MAX_SAMPLES, SampleRanges, SampleRay};
use vacua_volume::Bounds;

use crate::blocks::ALIGNMENT;
use crate::camera::View;
use crate::march::{Light, Lights};
use crate::scene::ClipPlane;
use crate::space::RaySpace;

/// Pixels a side of a tile.
pub(crate) const TILE: usize = 8;

/// Rays of a tile.
pub(crate) const TILE_RAYS: usize = TILE * TILE;

/// Everything that turns pixels into rays.
#[derive(Clone, Debug)]
pub(crate) struct RaySetup {
    pub view: View,
    pub ray_from_world: DAffine3,
    pub finest: DVec3,
    ranges: SampleRanges,
    /// Distance between samples in cells.
    pub step: f64,
    pub clip_planes: Vec<ClipPlane>,
    pub region_of_interest: Option<Bounds>,
    /// Whether sample positions differ between pixels.
    pub jitter: bool,
}

/// Pixels of the picture whose rays are set up together.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TilePixels {
    /// The upper left one.
    pub x0: usize,
    pub y0: usize,
    /// At most [`TILE`] each.
    pub columns: usize,
    pub rows: usize,
    /// Where in the pixel rays go through, in pixels from its upper left corner.
    pub offset: [f64; 2],
    /// Number of the frame among those that are averaged.
    pub frame: u32,
}

/// A ray as vector code takes it, all in `f32`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LaneRay {
    /// Position of sample 0, and from one sample to the next.
    pub start: [f32; 3],
    pub step: [f32; 3],
    /// First sample, and one past the last.
    pub begin: f32,
    pub end: f32,
    /// World distance between samples.
    pub dt: f32,
}

impl LaneRay {
    /// The same ray, with the world distance between its samples.
    pub fn new(ray: &SampleRay, dt: f64) -> Self {
        Self {
            start: ray.start,
            step: ray.step,
            begin: ray.begin as f32,
            end: ray.end as f32,
            dt: dt as f32,
        }
    }
}

/// The rays of a tile, ready to be marched: row by row, [`TILE`] a row.
pub(crate) struct TileRays {
    /// Empty where there is no pixel, or no sample lies in what is seen of the volume.
    pub rays: [SampleRay; TILE_RAYS],
    /// The same as kernels compute with them.
    pub lanes: [LaneRay; TILE_RAYS],
    /// World distance between samples.
    dt: [f64; TILE_RAYS],
    /// World distance of sample 0 from the camera.
    t_start: [f64; TILE_RAYS],
    /// Unit directions in world space.
    direction: [[f64; TILE_RAYS]; 3],
    /// Cells a sample step crosses along each axis, where cells are smallest.
    rates: [[f32; TILE_RAYS]; 3],
}

impl TileRays {
    /// A tile with a single ray of unit sample distance.
    #[cfg(test)]
    pub fn one(ray: SampleRay, rates: [f32; 3]) -> Self {
        let mut rays = [SampleRay::NONE; TILE_RAYS];
        rays[0] = ray;
        Self {
            lanes: rays.map(|ray| LaneRay::new(&ray, 1.0)),
            rays,
            dt: [1.0; TILE_RAYS],
            t_start: [0.0; TILE_RAYS],
            direction: [[0.0; TILE_RAYS]; 3],
            rates: rates.map(|rate| [rate; TILE_RAYS]),
        }
    }

    /// World distance of a sample of a ray from the camera.
    pub fn t_of(&self, ray: usize, sample: u32) -> f64 {
        self.t_start[ray] + f64::from(sample) * self.dt[ray]
    }

    /// Unit direction of a ray in world space.
    pub fn direction(&self, ray: usize) -> DVec3 {
        DVec3::from_array([0, 1, 2].map(|a| self.direction[a][ray]))
    }

    /// Cells a sample step of a ray crosses along each axis, where cells are smallest.
    pub fn rates(&self, ray: usize) -> [f32; 3] {
        [0, 1, 2].map(|a| self.rates[a][ray])
    }
}

/// Parts of a step by which the sixteen pixels of a 4 × 4 tile are shifted (Keller and Heidrich's
/// interleaved sampling), an ordered-dither matrix so that neighbours differ most.
const INTERLEAVE: [[u8; 4]; 4] = [[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]];

/// Most steps from the camera to the volume: numbers of samples are exact in `f64` up to there.
const FARTHEST: f64 = (1u64 << 52) as f64;

/// One over the golden ratio: shifts the pattern of jitter from one frame to the next.
pub const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// Numbers of the rays of a tile, an array a coordinate.
type Coordinates = [[f64; TILE_RAYS]; 3];

impl RaySetup {
    pub fn new(view: View, space: &RaySpace, lattice: &Lattice, step: f64) -> Self {
        Self {
            view,
            ray_from_world: space.ray_from_world,
            finest: space.finest,
            ranges: SampleRanges::new(lattice),
            step,
            clip_planes: Vec::new(),
            region_of_interest: None,
            jitter: false,
        }
    }

    /// Most samples that a ray can have in the volume.
    pub fn longest_ray(&self) -> f64 {
        let (lo, hi) = self.ranges.bounds();
        let diagonal = DVec3::from_array([0, 1, 2].map(|a| f64::from(hi[a]) - f64::from(lo[a])));
        (diagonal / self.finest).length() / self.step
    }

    /// Part of a step by which the samples of a pixel are shifted in a frame.
    #[inline(always)]
    fn jitter_of(&self, x: usize, y: usize, frame: u32) -> f64 {
        if !self.jitter {
            return 0.0;
        }
        let tile = (f64::from(INTERLEAVE[y % 4][x % 4]) + 0.5) / 16.0;
        (tile + f64::from(frame) * GOLDEN).fract()
    }

    /// The rays of a tile; `None` if no sample of any lies in what is seen of the volume.
    ///
    /// All rays count their samples from the same one: block numbers then mean nearly the same
    /// place for all of them. Loops are over all rays and without branches, so that they become
    /// vector code.
    #[inline(always)]
    pub fn tile(&self, pixels: TilePixels) -> Option<TileRays> {
        let (mut px, mut py) = ([0.0f64; TILE_RAYS], [0.0f64; TILE_RAYS]);
        let mut jitter = [0.0f64; TILE_RAYS];
        for i in 0..TILE_RAYS {
            let (x, y) = (pixels.x0 + i % TILE, pixels.y0 + i / TILE);
            px[i] = x as f64 + pixels.offset[0];
            py[i] = y as f64 + pixels.offset[1];
            jitter[i] = self.jitter_of(x, y, pixels.frame);
        }
        let (origin_world, direction) = self.view.rays(&px, &py);
        let m = self.ray_from_world.matrix3.to_cols_array_2d();
        let moved = self.ray_from_world.translation.to_array();
        let (mut origin, mut d) = ([[0.0f64; TILE_RAYS]; 3], [[0.0f64; TILE_RAYS]; 3]);
        for a in 0..3 {
            for i in 0..TILE_RAYS {
                let (o, v) = (&origin_world, &direction);
                origin[a][i] = m[0][a] * o[0][i] + m[1][a] * o[1][i] + m[2][a] * o[2][i] + moved[a];
                d[a][i] = m[0][a] * v[0][i] + m[1][a] * v[1][i] + m[2][a] * v[2][i];
            }
        }
        let per_finest = (1.0 / self.finest).to_array();
        let mut dt = [0.0f64; TILE_RAYS];
        for i in 0..TILE_RAYS {
            let [x, y, z] = [0, 1, 2].map(|a| d[a][i] * per_finest[a]);
            dt[i] = self.step / (x * x + y * y + z * z).sqrt();
        }
        let entered = self.samples_before(&origin, &d, &dt);
        let mut least = f64::INFINITY;
        for i in 0..TILE_RAYS {
            let there = i % TILE < pixels.columns && i / TILE < pixels.rows;
            least = if there && entered[i] < least {
                entered[i]
            } else {
                least
            };
        }
        if least > FARTHEST {
            return None;
        }
        let base = (least as u64 / ALIGNMENT * ALIGNMENT) as f64;
        let mut t_start = [0.0f64; TILE_RAYS];
        for i in 0..TILE_RAYS {
            t_start[i] = (base + jitter[i]) * dt[i];
        }
        let (mut start, mut step) = ([[0.0f32; TILE_RAYS]; 3], [[0.0f32; TILE_RAYS]; 3]);
        let mut rates = [[0.0f32; TILE_RAYS]; 3];
        for a in 0..3 {
            for i in 0..TILE_RAYS {
                start[a][i] = (origin[a][i] + d[a][i] * t_start[i]) as f32;
                step[a][i] = (d[a][i] * dt[i]) as f32;
                rates[a][i] = (d[a][i] * dt[i] * per_finest[a]) as f32;
            }
        }
        let (begin, end) = self.ranges.of(&start, &step);
        let mut rays = [SampleRay::NONE; TILE_RAYS];
        for i in 0..TILE_RAYS {
            let there = i % TILE < pixels.columns && i / TILE < pixels.rows;
            if there && entered[i] <= FARTHEST {
                rays[i] = SampleRay {
                    start: [start[0][i], start[1][i], start[2][i]],
                    step: [step[0][i], step[1][i], step[2][i]],
                    begin: begin[i],
                    end: end[i],
                };
            }
        }
        let mut tile = TileRays {
            lanes: std::array::from_fn(|i| LaneRay::new(&rays[i], dt[i])),
            rays,
            dt,
            t_start,
            direction,
            rates,
        };
        if !self.clip_planes.is_empty() || self.region_of_interest.is_some() {
            for i in 0..TILE_RAYS {
                let origin = DVec3::from_array([0, 1, 2].map(|a| origin_world[a][i]));
                self.clip_ray(&mut tile, i, origin);
                tile.lanes[i] = LaneRay::new(&tile.rays[i], tile.dt[i]);
            }
        }
        tile.rays.iter().any(|ray| !ray.is_empty()).then_some(tile)
    }

    /// Samples between the camera and the volume, with two of slack for rounding (the exact range
    /// is settled on computed positions); infinitely many if the ray misses it.
    #[inline(always)]
    fn samples_before(
        &self,
        origin: &Coordinates,
        d: &Coordinates,
        dt: &[f64; TILE_RAYS],
    ) -> [f64; TILE_RAYS] {
        let (lo, hi) = self.ranges.bounds();
        let mut enter = [f64::NEG_INFINITY; TILE_RAYS];
        let mut leave = [f64::INFINITY; TILE_RAYS];
        for a in 0..3 {
            let (lo, hi) = (f64::from(lo[a]), f64::from(hi[a]));
            for i in 0..TILE_RAYS {
                let (o, d) = (origin[a][i], d[a][i]);
                let inverse = 1.0 / d;
                let (t0, t1) = ((lo - o) * inverse, (hi - o) * inverse);
                let (near, far) = if d > 0.0 { (t0, t1) } else { (t1, t0) };
                // Along an axis that a ray does not move on, it is inside or not.
                let inside = (lo <= o) & (o <= hi);
                let (near, far) = if d != 0.0 {
                    (near, far)
                } else if inside {
                    (f64::NEG_INFINITY, f64::INFINITY)
                } else {
                    (f64::INFINITY, f64::NEG_INFINITY)
                };
                enter[i] = if near > enter[i] { near } else { enter[i] };
                leave[i] = if far < leave[i] { far } else { leave[i] };
            }
        }
        let mut before = [0.0f64; TILE_RAYS];
        for i in 0..TILE_RAYS {
            let t = if enter[i] > 0.0 { enter[i] } else { 0.0 };
            let samples = (t / dt[i]).floor() - 2.0;
            let samples = if samples > 0.0 { samples } else { 0.0 };
            // Rays that graze the box may still have a sample whose computed position lies in it.
            let hits = (enter[i] <= leave[i] + 1e-9 * leave[i].abs()) & (leave[i] >= 0.0);
            let sensible = hits & (t < f64::INFINITY) & (dt[i] > 0.0);
            before[i] = if sensible { samples } else { f64::INFINITY };
        }
        before
    }

    /// Cuts a ray to what clip planes and region of interest leave.
    fn clip_ray(&self, tile: &mut TileRays, i: usize, origin_world: DVec3) {
        let (t_start, dt) = (tile.t_start[i], tile.dt[i]);
        let direction = tile.direction(i);
        let ray = &mut tile.rays[i];
        let Some((t_first, t_last)) = self.clip(origin_world, direction) else {
            *ray = SampleRay::NONE;
            return;
        };
        let number = |t: f64| ((t - t_start) / dt).clamp(0.0, f64::from(MAX_SAMPLES));
        ray.begin = ray.begin.max(number(t_first).ceil() as u32);
        if t_last < t_start {
            ray.end = 0;
        } else {
            ray.end = ray.end.min((number(t_last).floor() + 1.0) as u32);
        }
    }

    /// The part of a ray that clip planes and region of interest leave, in world distance.
    fn clip(&self, origin: DVec3, direction: DVec3) -> Option<(f64, f64)> {
        let (mut lo, mut hi) = (0.0, f64::INFINITY);
        for plane in &self.clip_planes {
            let height = (origin - plane.point).dot(plane.normal);
            let rate = direction.dot(plane.normal);
            if rate == 0.0 {
                if height < 0.0 {
                    return None;
                }
            } else if rate > 0.0 {
                lo = f64::max(lo, -height / rate);
            } else {
                hi = f64::min(hi, -height / rate);
            }
        }
        if let Some(roi) = self.region_of_interest {
            let (t0, t1) = slab(origin, direction, roi.lo, roi.hi)?;
            (lo, hi) = (lo.max(t0), hi.min(t1));
        }
        (lo <= hi).then_some((lo, hi))
    }

    /// The light for each ray: what its direction and the map of space make of gradients.
    pub fn lights(&self, tile: &TileRays) -> Lights {
        let m = self.ray_from_world.matrix3;
        let rows = m.transpose();
        let (x, y, z) = (rows.x_axis, rows.y_axis, rows.z_axis);
        let metric = [
            x.dot(x),
            y.dot(y),
            z.dot(z),
            2.0 * x.dot(y),
            2.0 * x.dot(z),
            2.0 * y.dot(z),
        ];
        let metric = metric.map(|v| v as f32);
        std::array::from_fn(|i| Light {
            toward: (m * -tile.direction(i)).as_vec3().to_array(),
            metric,
        })
    }
}

/// Where a line is within a box; `None` if it misses. Along an axis that it does not move on, it
/// is inside or not.
fn slab(origin: DVec3, d: DVec3, lo: DVec3, hi: DVec3) -> Option<(f64, f64)> {
    let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
    for axis in 0..3 {
        if d[axis] == 0.0 {
            if origin[axis] < lo[axis] || origin[axis] > hi[axis] {
                return None;
            }
            continue;
        }
        let t = [
            (lo[axis] - origin[axis]) / d[axis],
            (hi[axis] - origin[axis]) / d[axis],
        ];
        enter = f64::max(enter, t[0].min(t[1]));
        leave = f64::min(leave, t[0].max(t[1]));
    }
    (enter <= leave).then_some((enter, leave))
}
