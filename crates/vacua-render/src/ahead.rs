//! Memory asked for before it is needed.
//!
//! The rays of a tile advance together, so that the voxels which they touch next are known from two of
//! their samples. Those of the next chunk are asked for while this one is computed: found only when they
//! are gathered, they hold up the processor, the longer the larger the volume. It is a hint alone; nothing
//! is read, and nothing depends on it.

use vacua_simd::prefetch;
use vacua_skip::Bundle;

/// Bytes that a processor fetches together.
const LINE_BYTES: usize = 64;

/// Most rows of voxels that a tile may be wide: where rays are further apart than two voxels or so, they
/// leave most of what lies between them alone.
const MOST_ROWS: i64 = 16;

/// Most voxels of a row.
const MOST_VOXELS: i64 = 64;

/// Way to the next sample along an axis, in the middle of a beam.
fn speed(beam: &Bundle, axis: usize) -> f32 {
    0.5 * (beam.step[axis][0] + beam.step[axis][1])
}

/// One side of a beam along an axis, as it moves from plane to plane; in parts of 2⁻³² cells, which need
/// no rounding.
#[derive(Clone, Copy)]
struct Side {
    position: i64,
    per_plane: i64,
}

impl Side {
    /// Of a beam that enters the cells before the first plane at one sample and has left those after it at
    /// another, each `samples_a_plane` later for the next: as far outside as it comes in between.
    fn of(beam: &Bundle, axis: usize, end: usize, samples: [f32; 2], samples_a_plane: f32) -> Self {
        let moves_out = (beam.step[axis][end] > 0.0) == (end == 1);
        let parts = |cells: f32| (cells * (1u64 << 32) as f32) as i64;
        Self {
            position: parts(beam.at(axis, end, samples[usize::from(moves_out)])),
            per_plane: parts(beam.step[axis][end] * samples_a_plane),
        }
    }

    /// The point before it, among those up to a last one; moves on to the next plane.
    #[inline(always)]
    fn next(&mut self, last: i64) -> i64 {
        let point = (self.position >> 32).clamp(0, last);
        self.position = self.position.wrapping_add(self.per_plane);
        point
    }
}

/// Values at the points of a uniform grid, x fastest, as they lie in memory.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PointMemory<'a> {
    pub bytes: &'a [u8],
    pub points: [usize; 3],
}

impl PointMemory<'_> {
    /// Asks for the values around the samples of a beam from one number to another, but for those that
    /// the sample before the first needs as well.
    pub fn fetch(&self, beam: &Bundle, samples: [f32; 2]) {
        self.lines(beam, samples, |line| {
            prefetch(self.bytes, line * LINE_BYTES)
        });
    }

    /// The lines of memory of these values, plane by plane across y or z, whichever the beam crosses more
    /// of. None if it mostly follows the rows, which processors foresee by themselves, or if samples or
    /// rays are so far apart that they leave most voxels alone.
    fn lines(&self, beam: &Bundle, [first, end]: [f32; 2], mut each: impl FnMut(usize)) {
        let [x_speed, y_speed, z_speed] = [0, 1, 2].map(|axis| speed(beam, axis).abs());
        let (along, across) = if y_speed > z_speed { (1, 2) } else { (2, 1) };
        let samples_a_plane = 1.0 / speed(beam, along).abs();
        if !(samples_a_plane >= 1.0 && samples_a_plane * x_speed < 4.0) {
            return;
        }
        let up = speed(beam, along) > 0.0;
        let front = |sample| beam.at(along, usize::from(up), sample);
        let [from, to] = [first, end].map(|sample| front(sample).floor().clamp(-1e9, 1e9) as i64);
        let num_planes = (to - from).abs();
        if num_planes > (end - first) as i64 {
            return;
        }
        let to_first = if up {
            from as f32 + 1.0 - front(first)
        } else {
            front(first) - from as f32
        };
        let entered = to_first.mul_add(samples_a_plane, first);
        // The last ray is as far behind as the beam is long.
        let length = beam.at(along, 1, entered) - beam.at(along, 0, entered);
        let left = (length + 2.0).mul_add(samples_a_plane, entered);
        let side = |axis, end| Side::of(beam, axis, end, [entered, left], samples_a_plane);
        let (mut x_lo, mut x_hi) = (side(0, 0), side(0, 1));
        let (mut row_lo, mut row_hi) = (side(across, 0), side(across, 1));
        let last = self.points.map(|points| points as i64 - 1);
        let [nx, ny, nz] = self.points;
        let value_bytes = self.bytes.len() / (nx * ny * nz).max(1);
        let strides = [value_bytes, value_bytes * nx, value_bytes * nx * ny];
        for i in 0..num_planes {
            let plane = if up { from + 2 + i } else { from - 1 - i };
            let (x0, x1) = (x_lo.next(last[0]), x_hi.next(last[0] - 1) + 1);
            let (row0, row1) = (row_lo.next(last[across]), row_hi.next(last[across] - 1) + 1);
            if row1 - row0 > MOST_ROWS || x1 - x0 > MOST_VOXELS {
                return;
            }
            if !(0..=last[along]).contains(&plane) {
                continue;
            }
            let plane = plane as usize * strides[along];
            for row in row0..=row1 {
                let row = plane + row as usize * strides[across];
                let line_of = |x: i64| (row + x as usize * value_bytes) / LINE_BYTES;
                for line in line_of(x0)..=line_of(x1) {
                    each(line);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;
    use vacua_skip::{Axis, Lattice, SampleRay};

    use crate::setup::{LaneRay, TileRays};

    /// A volume of 64³ points of two bytes.
    static MEMORY: PointMemory<'_> = PointMemory {
        bytes: &[0; 2 * 64 * 64 * 64],
        points: [64; 3],
    };

    /// Sixty-four rays side by side through it.
    fn tile(direction: [f32; 3], spacing: f32) -> TileRays {
        let lattice = Lattice::new([0, 1, 2].map(|_| Axis::Unit { cells: 63 }), 8).expect("cells");
        let mut tile = TileRays::one(SampleRay::NONE, [0.5; 3]);
        for i in 0..tile.rays.len() {
            let (u, v) = ((i % 8) as f32 - 3.5, (i / 8) as f32 - 3.5);
            // Two directions across the rays.
            let [x, y, z] = direction;
            let sides = [[z, 0.0, -x], [0.0, z, -y]];
            let start = [0, 1, 2].map(|a| {
                31.5 + spacing * (u * sides[0][a] + v * sides[1][a]) - 120.0 * direction[a]
            });
            tile.rays[i] = SampleRay::within(&lattice, start, direction.map(|d| 0.5 * d));
            tile.lanes[i] = LaneRay::new(&tile.rays[i], 1.0);
        }
        tile
    }

    /// Lines that samples of a tile touch from one number to another.
    fn touched(tile: &TileRays, samples: [u32; 2]) -> HashSet<usize> {
        let mut lines = HashSet::new();
        for ray in &tile.rays {
            for k in samples[0].max(ray.begin)..samples[1].min(ray.end) {
                let cell = [0, 1, 2].map(|a| (ray.at(a, k) as usize).min(62));
                for corner in 0..8 {
                    let [x, y, z] = [0, 1, 2].map(|a| cell[a] + (corner >> a & 1));
                    lines.insert(((z * 64 + y) * 64 + x) * 2 / LINE_BYTES);
                }
            }
        }
        lines
    }

    #[test]
    fn what_samples_touch_has_been_asked_for() {
        for direction in [
            [0.0, 0.0, 1.0],
            [0.1, -0.2, -0.97],
            [-0.58, -0.36, -0.73],
            [0.3, 0.9, -0.3],
            [0.6, -0.7, 0.38],
        ] {
            let tile = tile(direction, 0.25);
            let beam = Bundle::of(&tile.rays).expect("rays");
            let mut asked = HashSet::new();
            let (mut needed, mut missed, mut count) = (0, 0, 0);
            for chunk in 0..16 {
                let samples = [32 * chunk, 32 * (chunk + 1)];
                MEMORY.lines(&beam, samples.map(|k| k as f32), |line| {
                    count += 1;
                    asked.insert(line);
                });
                let lines = touched(&tile, samples);
                needed += lines.len();
                missed += lines.difference(&asked).count();
            }
            assert!(needed > 200, "{direction:?}: {needed}");
            assert!(
                missed * 50 <= needed,
                "{direction:?}: {missed} of {needed} lines missed"
            );
            assert!(
                count <= 2 * needed,
                "{direction:?}: {count} asked for, {needed} needed"
            );
        }
    }

    #[test]
    fn nothing_is_asked_for_where_little_of_it_would_be_read() {
        let lines = |direction, spacing, speed: f32| {
            let mut tile = tile(direction, spacing);
            for ray in &mut tile.rays {
                ray.step = ray.step.map(|step| speed * step);
            }
            let mut count = 0;
            let beam = Bundle::of(&tile.rays).expect("rays");
            MEMORY.lines(&beam, [240.0, 272.0], |_| count += 1);
            count
        };
        assert!(lines([0.0, 0.0, 1.0], 0.25, 1.0) > 0);
        assert_eq!(lines([0.0, 0.0, 1.0], 3.0, 1.0), 0, "rays far apart");
        assert_eq!(lines([0.0, 0.0, 1.0], 0.25, 4.0), 0, "samples far apart");
        assert_eq!(lines([1.0, 0.0, 0.0], 0.25, 1.0), 0, "along the rows");
        assert_eq!(lines([0.0; 3], 0.25, 1.0), 0, "nowhere");
    }
}
