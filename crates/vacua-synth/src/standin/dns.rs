//! A stand-in for DNS(4X) (2560 × 1920 × 384 u8): turbulence that fills the box, seen through its
//! rare strong structures. Eddies keep their size in voxels, so that smaller volumes are pieces of
//! the large one and have the same share of active macrocells.

use std::ops::Range;

use crate::fill::Rows;
use crate::noise::{Noise, NoiseSlice, Octave};

/// Noise of several sizes, strong in some places and weak in others.
pub(crate) struct Dns {
    len: usize,
    eddies: Noise,
    strength: Noise,
}

pub(crate) struct DnsSlice {
    eddies: NoiseSlice,
    strength: NoiseSlice,
    strength_row: Vec<f32>,
}

impl Dns {
    pub fn new(points: [usize; 3]) -> Self {
        let octave =
            |seed, voxels: f64, amplitude| Octave::new(seed, points, [voxels; 3], amplitude);
        Self {
            len: points[0],
            eddies: Noise::new(vec![octave(31, 40.0, 0.8), octave(32, 18.0, 0.5)]),
            strength: Noise::new(vec![octave(33, 80.0, 1.4)]),
        }
    }
}

impl Rows for Dns {
    type Slice<'a> = DnsSlice;

    fn slice(&self, z: usize) -> DnsSlice {
        DnsSlice {
            eddies: self.eddies.slice(z),
            strength: self.strength.slice(z),
            strength_row: vec![0.0; self.len],
        }
    }

    fn row(&self, slice: &mut DnsSlice, y: usize, row: &mut [f32]) -> Range<usize> {
        let all = 0..self.len;
        self.eddies.row(&mut slice.eddies, y, all.clone(), row);
        let strength = &mut slice.strength_row;
        self.strength
            .row(&mut slice.strength, y, all.clone(), strength);
        for (out, &strength) in row.iter_mut().zip(&*strength) {
            *out = (0.5 + *out * (0.75 + strength).max(0.2)).clamp(0.0, 1.0);
        }
        all
    }
}
