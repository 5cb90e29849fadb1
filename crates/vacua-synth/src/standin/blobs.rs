//! The large benchmark scene: noisy blobs, each a thin shell around a dense core in a wide haze.
//!
//! A blob's value falls linearly with its noisy distance: 1 at the centre, 0 at the rim of the
//! haze. The default transfer function picks the core and one thin level in between, the `haze`
//! one nearly everything.

use std::ops::Range;

use crate::fill::Rows;
use crate::noise::{Noise, NoiseSlice, Octave};
use crate::numpy::Pcg64;

const NUM_BLOBS: usize = 22;
const SEED: u32 = 22;

/// Noise moves a surface by at most this part of its distance.
const ROUGHNESS: f32 = 0.28;

/// Radius of the haze, in sides of the volume.
const RADII: Range<f64> = 0.125..0.18;

struct Blob {
    center: [f32; 3],
    radius: f32,
}

/// Blobs in the unit cube, stretched to the volume.
pub(crate) struct Blobs {
    blobs: Vec<Blob>,
    step: [f32; 3],
    len: usize,
    noise: Noise,
}

pub(crate) struct BlobSlice {
    z: f32,
    noise: NoiseSlice,
    noise_row: Vec<f32>,
}

impl Blobs {
    pub fn new(points: [usize; 3]) -> Self {
        let mut rng = Pcg64::new(SEED);
        let mut blobs: Vec<Blob> = Vec::with_capacity(NUM_BLOBS);
        // Centres keep apart while there is room; the demand falls with every failure.
        let mut apart = 1.0f32;
        while blobs.len() < NUM_BLOBS {
            let radius = rng.uniform(RADII.start, RADII.end) as f32;
            let margin = f64::from(radius);
            let center = [0; 3].map(|_| rng.uniform(margin, 1.0 - margin) as f32);
            let free = blobs.iter().all(|other| {
                let d_sq: f32 = (0..3)
                    .map(|axis| (center[axis] - other.center[axis]).powi(2))
                    .sum();
                d_sq > (apart * (radius + other.radius)).powi(2)
            });
            if free {
                blobs.push(Blob { center, radius });
            } else {
                apart *= 0.999;
            }
        }
        let octave = |seed, part: f64, amplitude| {
            let wavelength = points.map(|n| part * n as f64);
            Octave::new(seed, points, wavelength, amplitude)
        };
        Self {
            blobs,
            step: points.map(|n| 1.0 / n as f32),
            len: points[0],
            noise: Noise::new(vec![
                octave(1, 0.06, 0.7 * ROUGHNESS),
                octave(2, 0.02, 0.3 * ROUGHNESS),
            ]),
        }
    }
}

impl Rows for Blobs {
    type Slice<'a> = BlobSlice;

    fn slice(&self, z: usize) -> BlobSlice {
        BlobSlice {
            z: (z as f32 + 0.5) * self.step[2],
            noise: self.noise.slice(z),
            noise_row: vec![0.0; self.len],
        }
    }

    fn row(&self, slice: &mut BlobSlice, y: usize, row: &mut [f32]) -> Range<usize> {
        let row_y = (y as f32 + 0.5) * self.step[1];
        let reach = |blob: &Blob| {
            let (dy, dz) = (row_y - blob.center[1], slice.z - blob.center[2]);
            let across_sq = dy * dy + dz * dz;
            let half_sq = (blob.radius / (1.0 - ROUGHNESS)).powi(2) - across_sq;
            (half_sq > 0.0).then(|| {
                let half = half_sq.sqrt();
                let at = |x: f32| ((x / self.step[0]).max(0.0) as usize).min(self.len);
                let range = at(blob.center[0] - half)..at(blob.center[0] + half + self.step[0]);
                (range, across_sq)
            })
        };
        let all = self
            .blobs
            .iter()
            .filter_map(reach)
            .map(|(range, _)| range)
            .reduce(|a, b| a.start.min(b.start)..a.end.max(b.end));
        let Some(all) = all else { return 0..0 };
        row[all.clone()].fill(0.0);
        let noise = &mut slice.noise_row;
        self.noise.row(&mut slice.noise, y, all.clone(), noise);
        for blob in &self.blobs {
            let Some((range, across_sq)) = reach(blob) else {
                continue;
            };
            let first = range.start as f32;
            let per_radius = 1.0 / blob.radius;
            let values = row[range.clone()].iter_mut().zip(&noise[range]);
            for (i, (out, &noise)) in values.enumerate() {
                let dx = (first + i as f32 + 0.5) * self.step[0] - blob.center[0];
                let distance = (dx * dx + across_sq).sqrt() * per_radius;
                *out = out.max(1.0 - distance * (1.0 + noise));
            }
        }
        all
    }
}
