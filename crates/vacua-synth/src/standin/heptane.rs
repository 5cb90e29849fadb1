//! A stand-in for HEPTANE (302³ u8): a fire plume that widens as it rises and breaks into billows.

use std::ops::Range;

use crate::fill::Rows;
use crate::noise::{Noise, NoiseSlice, Octave};

/// A plume along z in the unit cube, stretched to the volume.
pub(crate) struct Heptane {
    step: [f32; 3],
    len: usize,
    noise: Noise,
}

pub(crate) struct PlumeSlice {
    center: [f32; 2],
    radius: f32,
    noise: NoiseSlice,
    noise_row: Vec<f32>,
}

/// Noise changes a value by at most this much.
const ROUGHNESS: f32 = 1.5;

impl Heptane {
    pub fn new(points: [usize; 3]) -> Self {
        let octave = |seed, part: f64, amplitude| {
            let wavelength = points.map(|n| part * n as f64);
            Octave::new(seed, points, wavelength, amplitude)
        };
        Self {
            step: points.map(|n| 1.0 / n as f32),
            len: points[0],
            noise: Noise::new(vec![
                octave(11, 0.16, 0.7 * ROUGHNESS),
                octave(12, 0.045, 0.3 * ROUGHNESS),
            ]),
        }
    }
}

impl Rows for Heptane {
    type Slice<'a> = PlumeSlice;

    fn slice(&self, z: usize) -> PlumeSlice {
        let height = (z as f32 + 0.5) * self.step[2];
        let sway = 0.06 * height * (libm::sinf(9.0 * height) - 0.3);
        PlumeSlice {
            center: [0.5 + sway, 0.5 - 0.7 * sway],
            radius: 0.11 + 0.30 * height.sqrt(),
            noise: self.noise.slice(z),
            noise_row: vec![0.0; self.len],
        }
    }

    fn row(&self, slice: &mut PlumeSlice, y: usize, row: &mut [f32]) -> Range<usize> {
        let dy = (y as f32 + 0.5) * self.step[1] - slice.center[1];
        let widest = slice.radius * (1.0 + ROUGHNESS);
        let half_sq = widest * widest - dy * dy;
        if half_sq <= 0.0 {
            return 0..0;
        }
        let half = half_sq.sqrt();
        let at = |x: f32| ((x / self.step[0]).max(0.0) as usize).min(self.len);
        let range = at(slice.center[0] - half)..at(slice.center[0] + half + self.step[0]);
        let noise = &mut slice.noise_row;
        self.noise.row(&mut slice.noise, y, range.clone(), noise);
        let first = range.start as f32;
        let values = row[range.clone()].iter_mut().zip(&noise[range.clone()]);
        for (i, (out, &noise)) in values.enumerate() {
            let dx = (first + i as f32 + 0.5) * self.step[0] - slice.center[0];
            let distance = (dx * dx + dy * dy).sqrt() / slice.radius;
            *out = (1.0 - distance + noise).clamp(0.0, 1.0);
        }
        range
    }
}
