//! Small meshes with any mix of cells, jittered and shuffled, for the tests.
#![allow(dead_code, reason = "each test program uses some of these")]

use vacua_volume::{CellType, DataArray, UnstructuredMesh};

/// A small generator of pseudo-random numbers (SplitMix64): the same numbers everywhere.
pub struct Random(pub u64);

impl Random {
    /// The next 64 bits.
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ z >> 31
    }

    /// A number in `0..1`.
    pub fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A number in `lo..hi`.
    pub fn between(&mut self, lo: f64, hi: f64) -> f64 {
        lo + (hi - lo) * self.unit()
    }

    /// Puts items in random order.
    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for i in (1..items.len()).rev() {
            items.swap(i, (self.next() % (i as u64 + 1)) as usize);
        }
    }
}

/// Points and cells, not yet a mesh.
#[derive(Clone, Default)]
pub struct Soup {
    pub points: Vec<[f64; 3]>,
    pub cells: Vec<(CellType, Vec<u64>)>,
}

/// How a cube of the lattice is cut into cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cut {
    Tetrahedra,
    Wedges,
    Pyramids,
    Hexahedra,
    /// One of the others, cube by cube: faces do not match.
    Mixed,
}

pub const CUTS: [Cut; 5] = [
    Cut::Tetrahedra,
    Cut::Wedges,
    Cut::Pyramids,
    Cut::Hexahedra,
    Cut::Mixed,
];

/// An `n`³ lattice of cubes with sides of 1, its points moved by up to `jitter`, cut into cells.
pub fn lattice(n: usize, cut: Cut, jitter: f64, seed: u64) -> Soup {
    let mut random = Random(seed);
    let mut soup = Soup::default();
    let m = n + 1;
    for k in 0..m {
        for j in 0..m {
            for i in 0..m {
                let mut move_by = |c: usize| c as f64 + random.between(-jitter, jitter);
                soup.points.push([move_by(i), move_by(j), move_by(k)]);
            }
        }
    }
    for k in 0..n {
        for j in 0..n {
            for i in 0..n {
                let at =
                    |x: usize, y: usize, z: usize| ((i + x) + m * ((j + y) + m * (k + z))) as u64;
                let c = [
                    at(0, 0, 0),
                    at(1, 0, 0),
                    at(1, 1, 0),
                    at(0, 1, 0),
                    at(0, 0, 1),
                    at(1, 0, 1),
                    at(1, 1, 1),
                    at(0, 1, 1),
                ];
                let cut = match cut {
                    Cut::Mixed => CUTS[(random.next() % 4) as usize],
                    cut => cut,
                };
                soup.cut_cube(c, cut);
            }
        }
    }
    random.shuffle(&mut soup.cells);
    soup
}

impl Soup {
    fn cut_cube(&mut self, c: [u64; 8], cut: Cut) {
        let mut add = |cell_type: CellType, corners: &[usize]| {
            let corners = corners.iter().map(|&k| c[k]).collect();
            self.cells.push((cell_type, corners));
        };
        match cut {
            Cut::Tetrahedra => {
                for ring in [[1, 2], [2, 3], [3, 7], [7, 4], [4, 5], [5, 1]] {
                    add(CellType::Tetrahedron, &[0, ring[0], ring[1], 6]);
                }
            }
            Cut::Wedges => {
                add(CellType::Wedge, &[0, 1, 3, 4, 5, 7]);
                add(CellType::Wedge, &[1, 2, 3, 5, 6, 7]);
            }
            Cut::Pyramids => {
                let center = self.points.len() as u64;
                let mut middle = [0.0; 3];
                for corner in c {
                    let p = self.points[corner as usize];
                    (0..3).for_each(|i| middle[i] += p[i] / 8.0);
                }
                self.points.push(middle);
                let faces = [
                    [0, 1, 2, 3],
                    [4, 7, 6, 5],
                    [0, 4, 5, 1],
                    [1, 5, 6, 2],
                    [2, 6, 7, 3],
                    [3, 7, 4, 0],
                ];
                for face in faces {
                    let mut corners: Vec<u64> = face.iter().map(|&k| c[k]).collect();
                    corners.push(center);
                    self.cells.push((CellType::Pyramid, corners));
                }
            }
            Cut::Hexahedra | Cut::Mixed => {
                add(CellType::Hexahedron, &[0, 1, 2, 3, 4, 5, 6, 7]);
            }
        }
    }

    /// Points scaled and then moved.
    pub fn placed(mut self, scale: f64, shift: [f64; 3]) -> Self {
        for p in &mut self.points {
            (0..3).for_each(|i| p[i] = p[i] * scale + shift[i]);
        }
        self
    }

    /// With positions of `f32` and indices of 32 bits.
    pub fn mesh(&self) -> UnstructuredMesh {
        let positions: Vec<f32> = self.points.iter().flatten().map(|&x| x as f32).collect();
        let indices: Vec<u32> = self.corners().map(|i| i as u32).collect();
        self.mesh_of(
            DataArray::from_vec(positions, 3).expect("triples"),
            DataArray::from_vec(indices, 1).expect("column"),
        )
    }

    /// With positions of `f64` and indices of 64 bits.
    pub fn wide_mesh(&self) -> UnstructuredMesh {
        let positions: Vec<f64> = self.points.iter().flatten().copied().collect();
        self.mesh_of(
            DataArray::from_vec(positions, 3).expect("triples"),
            DataArray::from_vec(self.corners().collect::<Vec<u64>>(), 1).expect("column"),
        )
    }

    fn corners(&self) -> impl Iterator<Item = u64> + '_ {
        self.cells.iter().flat_map(|c| c.1.iter().copied())
    }

    fn mesh_of(&self, positions: DataArray, indices: DataArray) -> UnstructuredMesh {
        let types = self.cells.iter().map(|c| c.0).collect();
        UnstructuredMesh::mixed(positions, types, indices).expect("a valid mesh")
    }
}

/// A cell with its points in an order that depends on its orientation alone: for tetrahedra the even
/// permutation with the smallest numbers first, for all others the order they have.
pub fn canonical(cell_type: CellType, points: &[u64]) -> (CellType, Vec<u64>) {
    let mut p = points.to_vec();
    if cell_type == CellType::Tetrahedron {
        let mut odd = false;
        for i in 0..4 {
            for j in 0..3 - i {
                if p[j] > p[j + 1] {
                    p.swap(j, j + 1);
                    odd = !odd;
                }
            }
        }
        if odd {
            p.swap(2, 3);
        }
    }
    (cell_type, p)
}
