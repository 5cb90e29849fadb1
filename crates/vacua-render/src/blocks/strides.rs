//! How small cells are where a ray passes: what decides how far apart its samples may be.

use vacua_skip::Axis;

/// How far apart samples are, depending on the place.
#[derive(Clone, Debug)]
pub(crate) enum Strides {
    /// All cells are alike.
    Constant,
    /// The smallest cells within spans of each axis.
    Varying([SpanMinima; 3]),
    /// The smallest cells within boxes of the lattice.
    Lattice(LatticeMinima),
}

/// Answers "how small is the smallest cell among these" along one axis.
#[derive(Clone, Debug)]
pub struct SpanMinima {
    /// `levels[l][c]`: smallest of cells `c .. c + 2^l`, in units of the smallest of all.
    levels: Vec<Vec<f32>>,
}

impl SpanMinima {
    /// Prepares an axis whose smallest cell is `finest`.
    pub fn new(axis: &Axis, finest: f64) -> Self {
        let cells = axis.cells();
        let size = |c: usize| ((axis.plane(c + 1) - axis.plane(c)) as f64 / finest).max(1.0) as f32;
        let mut levels = vec![(0..cells).map(size).collect::<Vec<f32>>()];
        let mut span = 1;
        while 2 * span <= cells {
            let below = &levels[levels.len() - 1];
            let level = (0..=cells - 2 * span)
                .map(|c| below[c].min(below[c + span]))
                .collect();
            levels.push(level);
            span *= 2;
        }
        Self { levels }
    }

    /// Minima over spans of `2^l` cells, for each level `l`, in units of the smallest cell of all.
    pub fn levels(&self) -> &[Vec<f32>] {
        &self.levels
    }

    /// The smallest of the cells from `a` to `b`, both included, in either order.
    pub(super) fn smallest(&self, a: usize, b: usize) -> f32 {
        let (a, b) = (a.min(b), a.max(b));
        let level = (b - a + 1).ilog2() as usize;
        let minima = &self.levels[level];
        minima[a].min(minima[b + 1 - (1 << level)])
    }
}

/// Answers "how small is the smallest cell in this box of the lattice", from below: boxes grow to
/// at most two nodes a side of a hierarchy.
#[derive(Clone, Debug)]
pub struct LatticeMinima {
    /// Each level has half as many nodes along each axis as the one before, rounded up.
    levels: Vec<([usize; 3], Vec<f32>)>,
}

impl LatticeMinima {
    /// From the smallest cell at each place of the lattice, in units of the smallest of all.
    pub(crate) fn new(counts: [usize; 3], sizes: Vec<f32>) -> Self {
        let mut levels = vec![(counts, sizes)];
        while let Some((below, sizes)) = levels.last().filter(|(_, sizes)| sizes.len() > 1) {
            let counts = below.map(|n| n.div_ceil(2));
            let mut minima = vec![f32::INFINITY; counts.iter().product()];
            for (i, &size) in sizes.iter().enumerate() {
                let [x, y, z] = [
                    i % below[0],
                    i / below[0] % below[1],
                    i / below[0] / below[1],
                ];
                let least = &mut minima[x / 2 + counts[0] * (y / 2 + counts[1] * (z / 2))];
                *least = least.min(size);
            }
            levels.push((counts, minima));
        }
        Self { levels }
    }

    /// Nodes along each axis and minima of every level, the finest first.
    pub fn levels(&self) -> &[([usize; 3], Vec<f32>)] {
        &self.levels
    }

    /// The smallest cell between two places, both included, in either order.
    pub(super) fn smallest(&self, a: [usize; 3], b: [usize; 3]) -> f32 {
        let mut lo = [0, 1, 2].map(|i| a[i].min(b[i]));
        let mut hi = [0, 1, 2].map(|i| a[i].max(b[i]));
        let mut level = 0;
        while (0..3).any(|i| hi[i] - lo[i] > 1) {
            lo = lo.map(|i| i / 2);
            hi = hi.map(|i| i / 2);
            level += 1;
        }
        let ([nx, ny, _], minima) = &self.levels[level];
        let mut least = f32::INFINITY;
        for z in lo[2]..=hi[2] {
            for y in lo[1]..=hi[1] {
                for x in lo[0]..=hi[0] {
                    least = least.min(minima[x + nx * (y + ny * z)]);
                }
            }
        }
        least
    }
}

impl Strides {
    /// Strides over the cells between some planes, whose smallest sizes are `finest`.
    pub fn new(axes: &[Axis; 3], finest: [f64; 3]) -> Self {
        if axes.iter().all(|axis| matches!(axis, Axis::Unit { .. })) {
            return Self::Constant;
        }
        Self::Varying([0, 1, 2].map(|a| SpanMinima::new(&axes[a], finest[a])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn minima_are_minima() {
        let planes: Vec<f32> = [0.0, 3.0, 4.0, 9.0, 11.0, 18.0].to_vec();
        let axis = Axis::planes(planes);
        let minima = SpanMinima::new(&axis, 1.0);
        let sizes = [3.0f32, 1.0, 5.0, 2.0, 7.0];
        for a in 0..5 {
            for b in a..5 {
                let least = sizes[a..=b].iter().copied().fold(f32::INFINITY, f32::min);
                assert_eq!(minima.smallest(a, b), least);
                assert_eq!(minima.smallest(b, a), least);
            }
        }
    }

    #[test]
    fn minima_of_boxes_are_safe_and_exact_for_the_smallest() {
        let counts = [7, 1, 5];
        let size = |x: usize, z: usize| 1.0 + ((x * 11 + z * 5) % 13) as f32;
        let sizes = (0..35).map(|i| size(i % 7, i / 7)).collect();
        let minima = LatticeMinima::new(counts, sizes);
        for (a, b) in (0..35).flat_map(|a| (0..35).map(move |b| (a, b))) {
            let (p, q) = ([a % 7, 0, a / 7], [b % 7, 0, b / 7]);
            let mut least = f32::INFINITY;
            for z in p[2].min(q[2])..=p[2].max(q[2]) {
                for x in p[0].min(q[0])..=p[0].max(q[0]) {
                    least = least.min(size(x, z));
                }
            }
            let found = minima.smallest(p, q);
            assert!(found <= least);
            assert_eq!(found, minima.smallest(q, p));
            if p[0].abs_diff(q[0]) <= 1 && p[2].abs_diff(q[2]) <= 1 {
                assert_eq!(found, least);
            }
        }
    }
}
