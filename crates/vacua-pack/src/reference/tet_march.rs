//! Tetrahedra with their neighbours, through which rays march from one to the next.
//!
//! A tetrahedron takes 32 bytes: its corners and its neighbours opposite each. Rays enter through the
//! faces that have a tetrahedron on one side only, which have a hierarchy of their own.
//!
//! Source: paper B, Table 6, whose *reference tetrahedra marcher* is not described further; the
//! method is that of Garrity (1990). A place that is on no ray is found from where a ray from it
//! leaves the mesh: marching is no point query.

use super::face_tree::{FaceTree, Line};
use super::faces::Neighbours;
use super::march::{self, Ahead, FACES, March, Net, Tet};
use super::weigh::dot;
use super::{Cells, Found, RaySamples, Reference, ReferenceError};
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
        let Neighbours {
            corners,
            neighbours,
            boundary,
        } = Neighbours::new(cells, Self::NAME)?;
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
