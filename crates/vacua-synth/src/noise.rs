//! Smooth noise, cheap along rows: random numbers on a coarse lattice, quadratic B-splines between.
//!
//! The spline is separable: a slice blends three lattice layers once, a row blends three lattice
//! rows once, and a voxel costs three multiplications an octave.

/// One octave of noise.
#[derive(Clone, Debug)]
pub(crate) struct Octave {
    seed: u64,
    /// Distance between lattice points along each axis, in voxels.
    wavelength: [f64; 3],
    amplitude: f32,
    /// Lattice cell and spline weights at each x.
    taps: Vec<(u32, [f32; 3])>,
    /// Lattice points along x and y.
    lattice: [usize; 2],
}

/// Weights of the three lattice points around a position, and the first of them.
fn spline(position: f64) -> (u32, [f32; 3]) {
    let cell = position.floor();
    let t = (position - cell) as f32;
    let w0 = 0.5 * (1.0 - t) * (1.0 - t);
    let w2 = 0.5 * t * t;
    (cell as u32, [w0, 1.0 - w0 - w2, w2])
}

/// A random number in `-1..1` for a lattice point.
fn lattice_value(seed: u64, x: u64, y: u64, z: u64) -> f32 {
    let mut h = seed ^ (x | y << 21 | z << 42).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    h = (h ^ h >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    h = (h ^ h >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((h >> 40) as f32 - 8_388_607.5) / 8_388_608.0
}

impl Octave {
    /// Noise with a standard deviation of about `0.25 · amplitude`.
    pub fn new(seed: u64, points: [usize; 3], wavelength: [f64; 3], amplitude: f32) -> Self {
        let wavelength = wavelength.map(|w| w.max(1.0));
        let taps: Vec<_> = (0..points[0])
            .map(|x| spline(x as f64 / wavelength[0]))
            .collect();
        let lattice = [0, 1].map(|axis| (points[axis] as f64 / wavelength[axis]) as usize + 3);
        Self {
            seed,
            wavelength,
            amplitude,
            taps,
            lattice,
        }
    }

    /// The lattice plane of a slice, times the amplitude.
    fn plane(&self, z: usize) -> Vec<f32> {
        let (first, weights) = spline(z as f64 / self.wavelength[2]);
        let [lx, ly] = self.lattice;
        let mut plane = Vec::with_capacity(lx * ly);
        for y in 0..ly as u64 {
            for x in 0..lx as u64 {
                let value = |i: u64| lattice_value(self.seed, x, y, u64::from(first) + i);
                let blend = weights[0] * value(0) + weights[1] * value(1) + weights[2] * value(2);
                plane.push(self.amplitude * blend);
            }
        }
        plane
    }
}

/// A sum of octaves.
#[derive(Clone, Debug)]
pub(crate) struct Noise {
    octaves: Vec<Octave>,
}

/// What the rows of one slice share.
pub(crate) struct NoiseSlice {
    planes: Vec<Vec<f32>>,
    lattice_row: Vec<f32>,
}

impl Noise {
    pub fn new(octaves: Vec<Octave>) -> Self {
        Self { octaves }
    }

    /// Prepares slice `z`.
    pub fn slice(&self, z: usize) -> NoiseSlice {
        NoiseSlice {
            planes: self.octaves.iter().map(|o| o.plane(z)).collect(),
            lattice_row: Vec::new(),
        }
    }

    /// Writes the noise of row `y` over a range of x into the same range of `row`.
    pub fn row(
        &self,
        slice: &mut NoiseSlice,
        y: usize,
        range: std::ops::Range<usize>,
        row: &mut [f32],
    ) {
        row[range.clone()].fill(0.0);
        for (octave, plane) in self.octaves.iter().zip(&slice.planes) {
            let (first, weights) = spline(y as f64 / octave.wavelength[1]);
            let lx = octave.lattice[0];
            let at = |i: usize| &plane[(first as usize + i) * lx..][..lx];
            let (r0, r1, r2) = (at(0), at(1), at(2));
            let blended = &mut slice.lattice_row;
            blended.clear();
            blended.extend(
                (0..lx).map(|i| weights[0] * r0[i] + weights[1] * r1[i] + weights[2] * r2[i]),
            );
            let taps = &octave.taps[range.clone()];
            for (out, &(cell, w)) in row[range.clone()].iter_mut().zip(taps) {
                let v = &blended[cell as usize..cell as usize + 3];
                *out += w[0] * v[0] + w[1] * v[1] + w[2] * v[2];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_smooth_centred_and_bounded() {
        let points = [64, 48, 40];
        let noise = Noise::new(vec![Octave::new(3, points, [8.0, 6.0, 5.0], 1.0)]);
        let mut row = vec![0.0; 64];
        let (mut sum, mut sum_sq, mut count) = (0.0, 0.0, 0.0);
        for z in 0..40 {
            let mut slice = noise.slice(z);
            for y in 0..48 {
                noise.row(&mut slice, y, 0..64, &mut row);
                assert!(row.iter().all(|v| v.abs() <= 1.0));
                assert!(row.windows(2).all(|p| (p[1] - p[0]).abs() < 0.25));
                sum += row.iter().sum::<f32>();
                sum_sq += row.iter().map(|v| v * v).sum::<f32>();
                count += 64.0;
            }
        }
        assert!((sum / count).abs() < 0.05);
        let deviation = (sum_sq / count).sqrt();
        assert!((0.18..0.32).contains(&deviation), "{deviation}");
    }

    #[test]
    fn a_part_of_a_row_is_the_same_as_the_whole() {
        let points = [50, 50, 50];
        let noise = Noise::new(vec![
            Octave::new(1, points, [9.5; 3], 1.0),
            Octave::new(2, points, [4.2; 3], 0.5),
        ]);
        let (mut whole, mut part) = (vec![0.0; 50], vec![9.0; 50]);
        let mut slice = noise.slice(17);
        noise.row(&mut slice, 31, 0..50, &mut whole);
        noise.row(&mut slice, 31, 12..30, &mut part);
        assert_eq!(whole[12..30], part[12..30]);
        assert_eq!(part[11], 9.0);
    }
}
