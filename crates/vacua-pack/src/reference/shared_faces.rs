//! Each face once, with the tetrahedra on its two sides: a ray from a place finds the first face, and
//! the face says which tetrahedron the place is in.
//!
//! A face takes 8 bytes: the tetrahedra on the side its normal points to and on the other. A
//! tetrahedron takes 32: its corners, and its faces opposite each. All faces are in a ray tracer's
//! hierarchy over triangles, which has their corners. Rays march from face to face.
//!
//! Source: paper B, §6.1.1 (*shared faces*; Morrical et al. 2019 and 2020). Deviation: there OptiX
//! traces a ray a sample, on hardware made for that; here the hierarchy is Embree's in layout, and a
//! ray asks it once where it begins.

use super::face_tree::{FaceTree, Line};
use super::faces::Faces;
use super::march::{self, Ahead, Net, Tet};
use super::tet_march::extent;
use super::{Cells, Found, NONE, RaySamples, Reference, ReferenceError};
use crate::block::Places;

/// A face: the tetrahedra on the side that its normal points to, and on the other. Its vertices
/// stand in rising order, which says where that is.
type Face = [u32; 2];

/// Tetrahedra that share faces.
pub struct SharedFaces {
    vertices: Vec<[f32; 4]>,
    faces: Vec<Face>,
    corners: Vec<[u32; 4]>,
    /// The faces of each tetrahedron, by the corner opposite.
    tets: Vec<[u32; 4]>,
    tree: FaceTree,
    extent: f64,
}

impl SharedFaces {
    const NAME: &'static str = "shared faces";

    /// Finds the faces, and builds the hierarchy over them.
    ///
    /// # Errors
    /// [`ReferenceError`] if there is anything but tetrahedra.
    pub fn new(cells: &Cells) -> Result<Self, ReferenceError> {
        let Faces {
            corners,
            faces_of: tets,
            sides: faces,
            vertices: vertices_of,
        } = Faces::new(cells, Self::NAME)?;
        let tree = FaceTree::new(faces.len() as u32, |face| {
            vertices_of[face as usize].map(|v| {
                let [x, y, z, _] = cells.vertices[v as usize];
                [x, y, z]
            })
        });
        Ok(Self {
            extent: extent(&cells.vertices),
            vertices: cells.vertices.clone(),
            faces,
            corners,
            tets,
            tree,
        })
    }
}

impl Net for SharedFaces {
    #[inline(always)]
    fn tet(&self, tet: u32) -> Tet {
        let [f, g, h, i] = self.tets[tet as usize];
        let neighbour = |face: u32| {
            let [one, other] = self.faces[face as usize];
            if one == tet { other } else { one }
        };
        Tet {
            corners: self.corners[tet as usize],
            neighbours: [neighbour(f), neighbour(g), neighbour(h), neighbour(i)],
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
        let face = self.faces[hit.face as usize];
        let before = usize::from(hit.along_normal);
        match (face[before], face[1 - before]) {
            (NONE, NONE) => Ahead::Nothing,
            (NONE, tet) => Ahead::Enters { t: hit.t, tet },
            (tet, _) => Ahead::In(tet),
        }
    }

    fn extent(&self) -> f64 {
        self.extent
    }
}

impl Reference for SharedFaces {
    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn num_cells(&self) -> u64 {
        self.tets.len() as u64
    }

    fn parts(&self) -> Vec<(&'static str, usize)> {
        let [nodes, leaves] = self.tree.num_bytes();
        vec![
            ("vertices", size_of_val(self.vertices.as_slice())),
            ("indices", size_of_val(self.corners.as_slice())),
            ("faces of tetrahedra", size_of_val(self.tets.as_slice())),
            ("faces", size_of_val(self.faces.as_slice())),
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
