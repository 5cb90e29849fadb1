//! From a pixel to the samples of its ray: world to ray space, the volume's box, clip planes,
//! jitter. All in `f64`, once a ray; what the kernels then compute with is `f32`.

use glam::{DAffine3, DVec3};
use vacua_skip::{Lattice, MAX_SAMPLES, SampleRay};
use vacua_volume::Bounds;

use crate::blocks::ALIGNMENT;
use crate::camera::View;
use crate::march::Light;
use crate::scene::ClipPlane;
use crate::space::RaySpace;

/// Everything that turns pixels into rays.
#[derive(Clone, Debug)]
pub(crate) struct RaySetup {
    pub view: View,
    pub ray_from_world: DAffine3,
    pub finest: DVec3,
    /// The lattice's box in ray space.
    pub box_lo: DVec3,
    pub box_hi: DVec3,
    /// Distance between samples in cells.
    pub step: f64,
    pub clip_planes: Vec<ClipPlane>,
    pub region_of_interest: Option<Bounds>,
    /// Whether sample positions differ between pixels.
    pub jitter: bool,
}

/// One ray, ready to be marched.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PreparedRay {
    pub ray: SampleRay,
    /// World distance between samples.
    pub dt: f64,
    /// World distance of sample 0 from the camera.
    pub t_start: f64,
    /// Unit direction in world space.
    pub direction: DVec3,
    /// Cells a sample step crosses along each axis, where cells are smallest.
    pub rates: [f32; 3],
}

impl PreparedRay {
    /// World distance of a sample from the camera.
    pub fn t_of(&self, sample: u32) -> f64 {
        self.t_start + f64::from(sample) * self.dt
    }
}

/// Parts of a step by which the sixteen pixels of a 4 × 4 tile are shifted (Keller and Heidrich's
/// interleaved sampling), an ordered-dither matrix so that neighbours differ most.
const INTERLEAVE: [[u8; 4]; 4] = [[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]];

/// Most steps from the camera to the volume: numbers of samples are exact in `f64` up to there.
const FARTHEST: f64 = (1u64 << 52) as f64;

/// One over the golden ratio: shifts the pattern from one frame to the next.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

impl RaySetup {
    pub fn new(view: View, space: &RaySpace, lattice: &Lattice, step: f64) -> Self {
        let plane = |last: bool| {
            let at = |a: usize| {
                let axis = &lattice.axes()[a];
                f64::from(axis.plane(if last { axis.cells() } else { 0 }))
            };
            DVec3::new(at(0), at(1), at(2))
        };
        Self {
            view,
            ray_from_world: space.ray_from_world,
            finest: space.finest,
            box_lo: plane(false),
            box_hi: plane(true),
            step,
            clip_planes: Vec::new(),
            region_of_interest: None,
            jitter: false,
        }
    }

    /// Most samples that a ray can have in the volume.
    pub fn longest_ray(&self) -> f64 {
        ((self.box_hi - self.box_lo) / self.finest).length() / self.step
    }

    /// Part of a step by which the samples of a pixel are shifted in a frame.
    #[inline(always)]
    pub fn jitter_of(&self, x: usize, y: usize, frame: u32) -> f64 {
        if !self.jitter {
            return 0.0;
        }
        let tile = (f64::from(INTERLEAVE[y % 4][x % 4]) + 0.5) / 16.0;
        (tile + f64::from(frame) * GOLDEN).fract()
    }

    /// The ray through a point of the picture (in pixels), its samples shifted by `jitter` steps;
    /// `None` if no sample lies in what is seen of the volume.
    #[inline(always)]
    pub fn ray(&self, lattice: &Lattice, x: f64, y: f64, jitter: f64) -> Option<PreparedRay> {
        let (origin_world, direction) = self.view.ray(x, y);
        let origin = self.ray_from_world.transform_point3(origin_world);
        let d = self.ray_from_world.transform_vector3(direction);
        let (t_enter, t_leave) = slab(origin, d, self.box_lo, self.box_hi)?;
        let dt = self.step / (d / self.finest).length();
        // Two samples of slack for rounding; the exact range is settled on computed positions.
        let entered = ((t_enter.max(0.0) / dt).floor() - 2.0).max(0.0);
        if t_leave < 0.0 || entered.is_nan() || entered > FARTHEST {
            return None;
        }
        let base = (entered as u64 / ALIGNMENT * ALIGNMENT) as f64 + jitter;
        let start = origin + d * (base * dt);
        let step = d * dt;
        let mut ray = SampleRay::within(
            lattice,
            start.as_vec3().to_array(),
            step.as_vec3().to_array(),
        );
        let (t_first, t_last) = self.clip(origin_world, direction)?;
        let number = |t: f64| (t / dt - base).clamp(0.0, f64::from(MAX_SAMPLES));
        ray.begin = ray.begin.max(number(t_first).ceil() as u32);
        ray.end = ray.end.min((number(t_last).floor() + 1.0) as u32);
        let rates = (step / self.finest).as_vec3().to_array();
        (!ray.is_empty()).then_some(PreparedRay {
            ray,
            dt,
            t_start: base * dt,
            direction,
            rates,
        })
    }

    /// The part of a ray that clip planes and region of interest leave, in world distance.
    #[inline(always)]
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

    /// The light for a ray: what its direction and the map of space make of gradients.
    #[inline(always)]
    pub fn light(&self, direction: DVec3) -> Light {
        let m = self.ray_from_world.matrix3;
        let toward = (m * -direction).as_vec3().to_array();
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
        Light {
            toward,
            metric: metric.map(|v| v as f32),
        }
    }
}

/// Where a line is within a box; `None` if it misses. Along an axis that it does not move on, it
/// is inside or not.
#[inline(always)]
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
    // Rays that graze the box may still have a sample whose computed position lies in it.
    (enter <= leave + 1e-9 * leave.abs()).then_some((enter, leave))
}
