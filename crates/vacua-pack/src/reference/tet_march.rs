//! Tetrahedra with their neighbours, through which rays march from one to the next.
//!
//! A tetrahedron takes 32 bytes: its corners and its neighbours opposite each. Rays enter through the
//! faces that have a tetrahedron on one side only, which have a hierarchy of their own.
//!
//! Source: paper B, Table 6, whose *reference tetrahedra marcher* is not described further; the
//! method is that of Garrity (1990). A place that is on no ray is found from where a ray from it
//! leaves the mesh: marching is no point query.

use rayon::prelude::*;

use super::face_tree::{FaceTree, Line};
use super::march::{self, Ahead, FACES, March, Net, Tet};
use super::weigh::dot;
use super::{Cells, Found, NONE, RaySamples, Reference, ReferenceError};
use crate::block::Places;

/// Tetrahedra and their neighbours.
pub struct TetMarch {
    vertices: Vec<[f32; 4]>,
    corners: Vec<[u32; 4]>,
    neighbours: Vec<[u32; 4]>,
    /// Faces without a neighbour: four times the tetrahedron, and the corner opposite.
    boundary: Vec<u32>,
    tree: FaceTree,
    extent: f64,
}

/// A face of a tetrahedron: its vertices in order, and four times the tetrahedron plus the corner
/// opposite.
type HalfFace = ([u32; 3], u32);

/// All faces of all tetrahedra, those with the same vertices side by side.
pub(super) fn half_faces(tets: &[[u32; 4]]) -> Vec<HalfFace> {
    let of_tet = |(tet, corners): (usize, &[u32; 4])| {
        let corners = *corners;
        (0..4).map(move |k| {
            let mut face = FACES[k].map(|c| corners[c]);
            face.sort_unstable();
            (face, 4 * tet as u32 + k as u32)
        })
    };
    let mut all: Vec<HalfFace> = tets.iter().enumerate().flat_map(of_tet).collect();
    all.par_sort_unstable();
    all
}

/// Calls `visit` with each face that tetrahedra have in common, and each that one has alone. Of more
/// than two with the same face the first two have it in common.
pub(super) fn pair_faces(all: &[HalfFace], mut visit: impl FnMut(&HalfFace, Option<&HalfFace>)) {
    let mut rest = all;
    while let [first, more @ ..] = rest {
        match more {
            [second, more @ ..] if first.0 == second.0 => {
                visit(first, Some(second));
                rest = more;
            }
            _ => {
                visit(first, None);
                rest = more;
            }
        }
    }
}

/// The longest side of the box around all vertices.
pub(super) fn extent(vertices: &[[f32; 4]]) -> f64 {
    f64::from(super::search::scale_of(vertices)).recip()
}

impl TetMarch {
    const NAME: &'static str = "tet marching";

    /// Finds neighbours, and builds the hierarchy over the boundary.
    ///
    /// # Errors
    /// [`ReferenceError`] if there is anything but tetrahedra.
    pub fn new(cells: &Cells) -> Result<Self, ReferenceError> {
        let corners = cells.tetrahedra(Self::NAME)?;
        let mut neighbours = vec![[NONE; 4]; corners.len()];
        let mut boundary = Vec::new();
        let all = half_faces(&corners);
        pair_faces(&all, |a, b| match b {
            Some(b) => {
                neighbours[(a.1 / 4) as usize][(a.1 % 4) as usize] = b.1 / 4;
                neighbours[(b.1 / 4) as usize][(b.1 % 4) as usize] = a.1 / 4;
            }
            None => boundary.push(a.1),
        });
        drop(all);
        let tree = FaceTree::new(boundary.len() as u32, |face| {
            let half = boundary[face as usize];
            let tet = corners[(half / 4) as usize];
            FACES[(half % 4) as usize].map(|c| {
                let [x, y, z, _] = cells.vertices[tet[c] as usize];
                [x, y, z]
            })
        });
        Ok(Self {
            extent: extent(&cells.vertices),
            vertices: cells.vertices.clone(),
            corners,
            neighbours,
            boundary,
            tree,
        })
    }
}

impl Net for TetMarch {
    #[inline(always)]
    fn tet(&self, tet: u32) -> Tet {
        Tet {
            corners: self.corners[tet as usize],
            neighbours: self.neighbours[tet as usize],
        }
    }

    #[inline(always)]
    fn vertex(&self, vertex: u32) -> [f32; 4] {
        self.vertices[vertex as usize]
    }

    #[inline(always)]
    fn ahead(&self, line: &Line, from: f64) -> Ahead {
        let Some(hit) = self.tree.first_hit(line, from) else {
            return Ahead::Nothing;
        };
        let half = self.boundary[hit.face as usize];
        let tet = half / 4;
        let corners = self.corners[tet as usize].map(|v| {
            let [x, y, z, _] = self.vertices[v as usize];
            [x, y, z].map(f64::from)
        });
        let [a, b, c] = FACES[(half % 4) as usize].map(|k| corners[k]);
        let sub = |p: [f64; 3], q: [f64; 3]| [0, 1, 2].map(|i| p[i] - q[i]);
        let normal = super::weigh::cross(sub(b, a), sub(c, a));
        let inward = dot(normal, sub(corners[(half % 4) as usize], a));
        if dot(normal, line.direction) * inward > 0.0 {
            return Ahead::Enters { t: hit.t, tet };
        }
        // The line leaves here: back to where it came from.
        let back = Line {
            origin: [0, 1, 2].map(|i| line.origin[i] + hit.t * line.direction[i]),
            direction: line.direction.map(|d| -d),
        };
        Ahead::In(March::within_until(self, back, tet, hit.t - from))
    }

    fn extent(&self) -> f64 {
        self.extent
    }
}

impl Reference for TetMarch {
    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn num_cells(&self) -> u64 {
        self.corners.len() as u64
    }

    fn parts(&self) -> Vec<(&'static str, usize)> {
        let [nodes, leaves] = self.tree.num_bytes();
        vec![
            ("vertices", size_of_val(self.vertices.as_slice())),
            ("indices", size_of_val(self.corners.as_slice())),
            ("neighbours", size_of_val(self.neighbours.as_slice())),
            ("boundary faces", size_of_val(self.boundary.as_slice())),
            ("nodes", nodes),
            ("leaves", leaves),
        ]
    }

    fn sample(&self, at: &Places, lanes: u16) -> Found {
        march::sample(self, at, lanes)
    }

    fn sample_ray(&self, ray: &RaySamples, values: &mut [f32]) {
        march::sample_ray(self, ray, values);
    }
}
