//! The benchmark scene `shells256`: four thin spherical shells, bit for bit as NumPy made them.
//!
//! Positions and squared distances are `f32`; the Gaussian profile is computed in `f64` and
//! rounded, which is what NumPy's promotion rules do there.

use std::ops::Range;

use crate::fill::Rows;

const CENTERS: [[f64; 3]; 4] = [
    [0.50, 0.50, 0.50],
    [0.30, 0.35, 0.60],
    [0.68, 0.62, 0.36],
    [0.62, 0.28, 0.66],
];
const RADII: [f64; 4] = [0.44, 0.20, 0.17, 0.12];
const WIDTH: f64 = 0.0125;

/// Below this, `exp` rounds to zero in `f32`.
const LN_SMALLEST: f64 = -104.0;

/// Four shells in a lattice whose longest side has `cells` cells.
pub(crate) struct Shells {
    cells: f64,
    len: usize,
}

impl Shells {
    pub fn new(points: [usize; 3]) -> Self {
        let longest = points.into_iter().max().unwrap_or(2);
        Self {
            cells: (longest - 1) as f64,
            len: points[0],
        }
    }
}

impl Rows for Shells {
    type Slice<'a> = f32;

    fn slice(&self, z: usize) -> f32 {
        z as f32
    }

    fn row(&self, z: &mut f32, y: usize, row: &mut [f32]) -> Range<usize> {
        row.fill(0.0);
        let y = y as f32;
        let width = WIDTH * self.cells;
        for (center, radius) in CENTERS.into_iter().zip(RADII) {
            let center = center.map(|c| (c * self.cells) as f32);
            let radius = radius * self.cells;
            let (dy, dz) = (y - center[1], *z - center[2]);
            let (dy_sq, dz_sq) = (dy * dy, dz * dz);
            for (x, out) in row.iter_mut().enumerate() {
                let dx = x as f32 - center[0];
                let distance = (dx * dx + dy_sq + dz_sq).sqrt();
                let t = (f64::from(distance) - radius) / width;
                let exponent = -(t * t);
                if exponent > LN_SMALLEST {
                    *out = out.max(libm::exp(exponent) as f32);
                }
            }
        }
        0..self.len
    }
}
