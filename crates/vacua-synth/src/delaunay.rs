//! The Delaunay tetrahedra of random points.
//!
//! Source: Bowyer 1981 and Watson 1981: each point takes away the tetrahedra whose spheres it lies in
//! and is joined to the faces around the hole. Predicates are exact (crate `robust`). Points are added
//! along a space-filling curve, each search starts where the last one ended.

use std::collections::HashMap;

use robust::{Coord3D, insphere, orient3d};
use vacua_volume::CellType;

use crate::kind::SynthError;
use crate::mesh_cells::{Cells, Random, check_points};

const NONE: u32 = u32::MAX;

/// The corners of the face opposite each corner, so that with the corner they are positive.
const FACES: [[usize; 3]; 4] = [[1, 3, 2], [0, 2, 3], [0, 3, 1], [0, 1, 2]];

/// `n³` points in a cube of side `n`, and the tetrahedra between them: six to seven a point.
pub(crate) fn random(n: usize, seed: u64) -> Result<Cells, SynthError> {
    let count = check_points(n, n.checked_pow(3))?;
    let mut random = Random(seed);
    let mut points: Vec<[f32; 3]> = (0..count)
        .map(|_| std::array::from_fn(|_| (random.unit() * n as f64) as f32))
        .collect();
    points.sort_unstable_by_key(|p| morton(p.map(|c| (f64::from(c) / n as f64 * 1024.0) as u64)));
    let mut mesh = Delaunay::new(n as f64);
    for p in &points {
        mesh.insert(p.map(f64::from));
    }
    let mut cells = Cells::default();
    for tetrahedron in mesh.tetrahedra() {
        cells.push(CellType::Tetrahedron, tetrahedron);
    }
    cells.points = points;
    Ok(cells)
}

/// Bits of three numbers below 1024 in turn.
fn morton(at: [u64; 3]) -> u64 {
    let spread = |v: u64| (0..10).map(|bit| (v >> bit & 1) << (3 * bit)).sum::<u64>();
    spread(at[0]) | spread(at[1]) << 1 | spread(at[2]) << 2
}

#[derive(Clone, Copy)]
struct Tetrahedron {
    /// The first four of all points are those of the tetrahedron around everything.
    corners: [u32; 4],
    /// Across the face opposite each corner.
    neighbours: [u32; 4],
}

struct Delaunay {
    points: Vec<Coord3D<f64>>,
    /// All that there ever were.
    all: Vec<Tetrahedron>,
    /// Whether a later point took it away.
    is_gone: Vec<bool>,
    last: u32,
}

impl Delaunay {
    fn new(side: f64) -> Self {
        let far = 1000.0 * side;
        let corners = [
            [-far, -far, -far],
            [3.0 * far, -far, -far],
            [-far, 3.0 * far, -far],
            [-far, -far, 3.0 * far],
        ];
        let points: Vec<Coord3D<f64>> = corners
            .iter()
            .map(|&[x, y, z]| Coord3D { x, y, z })
            .collect();
        let positive = orient3d(points[0], points[1], points[2], points[3]) > 0.0;
        Self {
            points,
            all: vec![Tetrahedron {
                corners: if positive { [0, 1, 2, 3] } else { [1, 0, 2, 3] },
                neighbours: [NONE; 4],
            }],
            is_gone: vec![false],
            last: 0,
        }
    }

    fn at(&self, point: u32) -> Coord3D<f64> {
        self.points[point as usize]
    }

    /// Whether a point is on the inner side of a face.
    fn is_inside(&self, tetrahedron: u32, face: usize, p: Coord3D<f64>) -> bool {
        let corners = self.all[tetrahedron as usize].corners;
        let [a, b, c] = FACES[face].map(|i| self.at(corners[i]));
        orient3d(a, b, c, p) >= 0.0
    }

    /// A tetrahedron that contains a point.
    fn find(&self, p: Coord3D<f64>) -> u32 {
        let mut here = self.last;
        let mut from = NONE;
        loop {
            let neighbours = self.all[here as usize].neighbours;
            let next = (0..4).find(|&face| {
                let across = neighbours[face];
                across != NONE && across != from && !self.is_inside(here, face, p)
            });
            match next {
                Some(face) => (from, here) = (here, neighbours[face]),
                None => return here,
            }
        }
    }

    fn is_in_sphere(&self, tetrahedron: u32, p: Coord3D<f64>) -> bool {
        let [a, b, c, d] = self.all[tetrahedron as usize].corners.map(|i| self.at(i));
        insphere(a, b, c, d, p) > 0.0
    }

    fn insert(&mut self, [x, y, z]: [f64; 3]) {
        let p = Coord3D { x, y, z };
        let number = self.points.len() as u32;
        self.points.push(p);
        let first = self.find(p);
        let mut hole = vec![first];
        let mut is_in_hole = HashMap::from([(first, true)]);
        let mut around = Vec::new();
        let mut next = 0;
        while let Some(&here) = hole.get(next) {
            next += 1;
            let Tetrahedron {
                corners,
                neighbours,
            } = self.all[here as usize];
            for face in 0..4 {
                let across = neighbours[face];
                let inside = across != NONE
                    && *is_in_hole.entry(across).or_insert_with(|| {
                        let inside = self.is_in_sphere(across, p);
                        if inside {
                            hole.push(across);
                        }
                        inside
                    });
                if !inside {
                    around.push((FACES[face].map(|i| corners[i]), across, here));
                }
            }
        }
        for &gone in &hole {
            self.is_gone[gone as usize] = true;
        }
        let mut open: HashMap<[u32; 2], (u32, usize)> = HashMap::new();
        for (face, across, gone) in around {
            let [a, b, c] = face;
            let new = self.place(Tetrahedron {
                corners: [a, b, c, number],
                neighbours: [NONE, NONE, NONE, across],
            });
            if across != NONE {
                let across = &mut self.all[across as usize];
                for (corner, neighbour) in across.corners.into_iter().zip(&mut across.neighbours) {
                    if *neighbour == gone && !face.contains(&corner) {
                        *neighbour = new;
                    }
                }
            }
            for (slot, [u, v]) in [[b, c], [a, c], [a, b]].into_iter().enumerate() {
                let edge = [u.min(v), u.max(v)];
                match open.remove(&edge) {
                    None => {
                        open.insert(edge, (new, slot));
                    }
                    Some((other, other_slot)) => {
                        self.all[new as usize].neighbours[slot] = other;
                        self.all[other as usize].neighbours[other_slot] = new;
                    }
                }
            }
            self.last = new;
        }
    }

    /// Adds a tetrahedron.
    fn place(&mut self, tetrahedron: Tetrahedron) -> u32 {
        self.all.push(tetrahedron);
        self.is_gone.push(false);
        self.all.len() as u32 - 1
    }

    /// All tetrahedra between points, of positive volume in VTK's order.
    fn tetrahedra(&self) -> impl Iterator<Item = [u32; 4]> {
        let all = self.all.iter().zip(&self.is_gone);
        all.filter(|(t, is_gone)| !**is_gone && t.corners.iter().all(|&c| c >= 4))
            .map(|(t, _)| {
                let [a, b, c, d] = t.corners.map(|c| c - 4);
                [b, a, c, d]
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spheres_are_empty_and_the_hull_is_filled() {
        let cells = random(5, 3).expect("small");
        let at = |i: u32| {
            let [x, y, z] = cells.points[i as usize].map(f64::from);
            Coord3D { x, y, z }
        };
        let mut volume = 0.0;
        for t in cells.connectivity.chunks_exact(4) {
            let [a, b, c, d] = [t[0], t[1], t[2], t[3]].map(at);
            let six = -orient3d(a, b, c, d);
            assert!(six > 0.0);
            volume += six / 6.0;
            for other in (0..cells.points.len() as u32).filter(|p| !t.contains(p)) {
                assert!(insphere(b, a, c, d, at(other)) <= 0.0);
            }
        }
        assert!(cells.types.len() > 4 * cells.points.len());
        assert!((60.0..125.0).contains(&volume), "{volume}");
    }
}
