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
use super::march::{self, Ahead, Net, Tet};
use super::tet_march::{extent, half_faces, pair_faces};
use super::weigh::{cross, dot};
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

type Vec3 = [f64; 3];

fn sub(p: Vec3, q: Vec3) -> Vec3 {
    [0, 1, 2].map(|i| p[i] - q[i])
}

impl SharedFaces {
    const NAME: &'static str = "shared faces";

    /// Finds the faces, and builds the hierarchy over them.
    ///
    /// # Errors
    /// [`ReferenceError`] if there is anything but tetrahedra.
    pub fn new(cells: &Cells) -> Result<Self, ReferenceError> {
        let corners = cells.tetrahedra(Self::NAME)?;
        let position = |v: u32| {
            let [x, y, z, _] = cells.vertices[v as usize];
            [x, y, z]
        };
        let mut faces: Vec<Face> = Vec::with_capacity(2 * corners.len());
        let mut vertices_of = Vec::with_capacity(2 * corners.len());
        let mut tets = vec![[NONE; 4]; corners.len()];
        let all = half_faces(&corners);
        pair_faces(&all, |first, second| {
            let [a, b, c] = first.0.map(|v| position(v).map(f64::from));
            let normal = cross(sub(b, a), sub(c, a));
            let mut face = [NONE; 2];
            for half in [Some(first), second].into_iter().flatten() {
                let (tet, corner) = (half.1 / 4, (half.1 % 4) as usize);
                let apex = position(corners[tet as usize][corner]).map(f64::from);
                let side = usize::from(dot(normal, sub(apex, a)) < 0.0);
                // Two on one side, where tetrahedra overlap: the second takes what is left.
                let side = if face[side] == NONE { side } else { 1 - side };
                face[side] = tet;
                tets[tet as usize][corner] = faces.len() as u32;
            }
            faces.push(face);
            vertices_of.push(first.0);
        });
        drop(all);
        let tree = FaceTree::new(faces.len() as u32, |face| {
            vertices_of[face as usize].map(position)
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
