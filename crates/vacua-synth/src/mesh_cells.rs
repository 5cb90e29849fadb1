//! Cells while they are made, and what disturbs them on request.

use glam::Vec3;
use vacua_volume::CellType;

use crate::kind::SynthError;
use crate::mesh_kind::MeshSpec;
use crate::meshes::RawMesh;

/// Positions and cells of a mesh to be.
#[derive(Clone, Debug, Default)]
pub(crate) struct Cells {
    /// Positions.
    pub points: Vec<[f32; 3]>,
    /// What each cell is.
    pub types: Vec<CellType>,
    /// The points of all cells.
    pub connectivity: Vec<u32>,
}

impl Cells {
    /// From a benchmark scene.
    pub fn of_raw<const N: usize>(raw: RawMesh<N>, cell_type: CellType) -> Self {
        let points = raw.cells.iter().flatten().map(|&p| p as u32);
        Self {
            types: vec![cell_type; raw.cells.len()],
            connectivity: points.collect(),
            points: raw.vertices,
        }
    }

    /// Adds a cell.
    pub fn push(&mut self, cell_type: CellType, points: impl IntoIterator<Item = u32>) {
        self.types.push(cell_type);
        self.connectivity.extend(points);
    }

    /// The points of each cell.
    fn each(&self) -> impl Iterator<Item = (CellType, &[u32])> {
        let mut at = 0;
        self.types.iter().map(move |&cell_type| {
            let from = at;
            at += cell_type.num_points();
            (cell_type, &self.connectivity[from..at])
        })
    }
}

/// Refuses sizes whose points 32 bits do not number.
///
/// # Errors
/// [`SynthError::TooLarge`].
pub(crate) fn check_points(size: usize, points: Option<usize>) -> Result<usize, SynthError> {
    points
        .filter(|&n| n <= i32::MAX as usize)
        .ok_or(SynthError::TooLarge { points: [size; 3] })
}

/// A generator of random numbers (SplitMix64).
pub(crate) struct Random(pub u64);

impl Random {
    /// The next 64 bits.
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ z >> 31
    }

    /// From 0 to less than 1.
    pub fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// From 0 to less than `n`.
    pub fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }

    /// Numbers 0 to `n` in random order.
    pub fn permutation(&mut self, n: usize) -> Vec<u32> {
        let mut all: Vec<u32> = (0..n as u32).collect();
        for i in (1..n).rev() {
            all.swap(i, self.below(i + 1));
        }
        all
    }
}

/// Moves points, takes cells away, adds slivers, and shuffles, as asked.
pub(crate) fn disturb(cells: &mut Cells, spec: &MeshSpec) {
    let mut random = Random(spec.seed ^ 0x5EED);
    if spec.jitter > 0.0 {
        jitter(cells, spec.jitter, &mut random);
    }
    if spec.holes > 0.0 {
        let mut kept = Cells::default();
        for (cell_type, points) in cells.each() {
            if random.unit() >= spec.holes {
                kept.push(cell_type, points.iter().copied());
            }
        }
        (cells.types, cells.connectivity) = (kept.types, kept.connectivity);
    }
    slivers(cells, spec.num_slivers, &mut random);
    if spec.shuffled {
        shuffle(cells, &mut random);
    }
}

/// Moves each point by up to a part of the shortest way to a neighbour along its cells' point lists.
fn jitter(cells: &mut Cells, amount: f64, random: &mut Random) {
    let mut nearest = vec![f32::INFINITY; cells.points.len()];
    for (_, points) in cells.each() {
        for (i, &a) in points.iter().enumerate() {
            let b = points[(i + 1) % points.len()];
            let (a, b) = (a as usize, b as usize);
            let d = Vec3::from(cells.points[a]).distance(Vec3::from(cells.points[b]));
            if d > 0.0 {
                nearest[a] = nearest[a].min(d);
                nearest[b] = nearest[b].min(d);
            }
        }
    }
    for (point, near) in cells.points.iter_mut().zip(nearest) {
        if near.is_finite() {
            for c in point {
                *c += (amount * f64::from(near) * (2.0 * random.unit() - 1.0)) as f32;
            }
        }
    }
}

/// Adds tetrahedra over the first three points of cells whose fourth is almost in their plane.
fn slivers(cells: &mut Cells, count: usize, random: &mut Random) {
    const HEIGHT: f32 = 1e-5;
    if cells.types.is_empty() || cells.points.len() + count > i32::MAX as usize {
        return;
    }
    let starts: Vec<usize> = cells
        .types
        .iter()
        .scan(0, |at, t| {
            *at += t.num_points();
            Some(*at - t.num_points())
        })
        .collect();
    for _ in 0..count {
        let start = starts[random.below(starts.len())];
        let [a, b, c] = [0, 1, 2].map(|i| cells.connectivity[start + i]);
        let [p, q, r] = [a, b, c].map(|i| Vec3::from(cells.points[i as usize]));
        let top = (p + q + r) / 3.0 + HEIGHT * (q - p).cross(r - p).normalize_or_zero();
        let d = cells.points.len() as u32;
        cells.points.push(top.to_array());
        cells.push(CellType::Tetrahedron, [a, b, c, d]);
    }
}

fn shuffle(cells: &mut Cells, random: &mut Random) {
    let new_of_old = random.permutation(cells.points.len());
    let mut points = cells.points.clone();
    for (old, &new) in new_of_old.iter().enumerate() {
        points[new as usize] = cells.points[old];
    }
    let order = random.permutation(cells.types.len());
    let all: Vec<(CellType, &[u32])> = cells.each().collect();
    let mut shuffled = Cells::default();
    for &cell in &order {
        let (cell_type, old) = all[cell as usize];
        shuffled.push(cell_type, old.iter().map(|&p| new_of_old[p as usize]));
    }
    shuffled.points = points;
    *cells = shuffled;
}
