//! A stand-in for LLNL (2048 × 2048 × 1920 u8): two fluids, 0 below and 1 above, and between them a
//! turbulent mixing layer. Bubbles and spikes scale with the volume; the fine eddies inside the
//! layer keep their size in voxels.

use std::ops::Range;

use crate::fill::Rows;
use crate::noise::{Noise, NoiseSlice, Octave};

/// Half the thickness of the mixing layer, in sides of the volume.
const HALF_THICKNESS: f32 = 0.135;
/// How far bubbles and spikes move the layer, in sides of the volume.
const WAVES: f32 = 0.2;
/// How much eddies change the mixture.
const EDDIES: f32 = 2.4;

/// A mixing layer across z.
pub(crate) struct Llnl {
    step_z: f32,
    len: usize,
    waves: Noise,
    eddies: Noise,
}

pub(crate) struct LlnlSlice {
    height: f32,
    waves: NoiseSlice,
    eddies: NoiseSlice,
    waves_row: Vec<f32>,
}

impl Llnl {
    pub fn new(points: [usize; 3]) -> Self {
        let relative = |seed, part: f64, amplitude| {
            let wavelength = points.map(|n| part * n as f64);
            Octave::new(seed, points, wavelength, amplitude)
        };
        let fixed = |seed, voxels: f64, amplitude| {
            Octave::new(seed, points, [voxels; 3], amplitude * EDDIES)
        };
        Self {
            step_z: 1.0 / points[2] as f32,
            len: points[0],
            waves: Noise::new(vec![
                relative(41, 0.12, 0.7 * WAVES),
                relative(42, 0.04, 0.3 * WAVES),
            ]),
            eddies: Noise::new(vec![fixed(43, 18.0, 0.7), fixed(44, 8.0, 0.3)]),
        }
    }
}

impl Rows for Llnl {
    type Slice<'a> = LlnlSlice;

    fn slice(&self, z: usize) -> LlnlSlice {
        let height = (z as f32 + 0.5) * self.step_z - 0.5;
        let quiet = height.abs() > HALF_THICKNESS + WAVES;
        let none = Noise::new(Vec::new());
        LlnlSlice {
            height,
            waves: if quiet { &none } else { &self.waves }.slice(z),
            eddies: if quiet { &none } else { &self.eddies }.slice(z),
            waves_row: vec![0.0; self.len],
        }
    }

    fn row(&self, slice: &mut LlnlSlice, y: usize, row: &mut [f32]) -> Range<usize> {
        let all = 0..self.len;
        if slice.height < -HALF_THICKNESS - WAVES {
            return 0..0;
        }
        if slice.height > HALF_THICKNESS + WAVES {
            row.fill(1.0);
            return all;
        }
        let waves = &mut slice.waves_row;
        self.waves.row(&mut slice.waves, y, all.clone(), waves);
        self.eddies.row(&mut slice.eddies, y, all.clone(), row);
        for (out, &wave) in row.iter_mut().zip(&*waves) {
            let place = (slice.height + wave) * (1.0 / HALF_THICKNESS);
            let fade = (1.0 - place * place).max(0.0);
            *out = (0.5 + 0.5 * place + *out * fade).clamp(0.0, 1.0);
        }
        all
    }
}
