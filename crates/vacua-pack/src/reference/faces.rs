//! The faces of tetrahedra: which of them share one, and which faces nobody shares.

use rayon::prelude::*;

use super::march::FACES;
use super::weigh::{Vec3, cross, dot};
use super::{Cells, NONE, ReferenceError};

/// Tetrahedra that share faces; `2^32 − 1` stands for no tetrahedron.
#[derive(Clone, Debug, Default)]
pub struct Faces {
    /// The corners of each tetrahedron.
    pub corners: Vec<[u32; 4]>,
    /// The faces of each tetrahedron, by the corner opposite.
    pub faces_of: Vec<[u32; 4]>,
    /// Of each face the tetrahedra on the side that its normal points to, and on the other.
    pub sides: Vec<[u32; 2]>,
    /// The vertices of each face `a b c`, whose normal is `(b − a) × (c − a)`, in rising order.
    pub vertices: Vec<[u32; 3]>,
}

/// Tetrahedra and their neighbours; `2^32 − 1` stands for no neighbour.
#[derive(Clone, Debug, Default)]
pub struct Neighbours {
    /// The corners of each tetrahedron.
    pub corners: Vec<[u32; 4]>,
    /// The neighbours of each tetrahedron, by the corner opposite.
    pub neighbours: Vec<[u32; 4]>,
    /// Faces without a neighbour: four times the tetrahedron, and the corner opposite.
    pub boundary: Vec<u32>,
}

/// A face of a tetrahedron: its vertices in order, and four times the tetrahedron plus the corner
/// opposite.
type HalfFace = ([u32; 3], u32);

/// All faces of all tetrahedra, those with the same vertices side by side.
fn half_faces(tets: &[[u32; 4]]) -> Vec<HalfFace> {
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
fn pair_faces(all: &[HalfFace], mut visit: impl FnMut(&HalfFace, Option<&HalfFace>)) {
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

fn sub(p: Vec3, q: Vec3) -> Vec3 {
    [0, 1, 2].map(|i| p[i] - q[i])
}

fn position(cells: &Cells, vertex: u32) -> Vec3 {
    let [x, y, z, _] = cells.vertices[vertex as usize];
    [x, y, z].map(f64::from)
}

/// Whether a vertex lies behind a face: where its normal does not point.
fn is_behind(cells: &Cells, face: [u32; 3], vertex: u32) -> bool {
    let [a, b, c] = face.map(|v| position(cells, v));
    let normal = cross(sub(b, a), sub(c, a));
    dot(normal, sub(position(cells, vertex), a)) < 0.0
}

impl Faces {
    /// Finds the faces of all cells, for an encoding of a name.
    ///
    /// # Errors
    /// [`ReferenceError`] if there is anything but tetrahedra.
    pub fn new(cells: &Cells, name: &'static str) -> Result<Self, ReferenceError> {
        let corners = cells.tetrahedra(name)?;
        let mut found = Self {
            faces_of: vec![[NONE; 4]; corners.len()],
            sides: Vec::with_capacity(2 * corners.len()),
            vertices: Vec::with_capacity(2 * corners.len()),
            corners,
        };
        pair_faces(&half_faces(&found.corners), |first, second| {
            let mut sides = [NONE; 2];
            for half in [Some(first), second].into_iter().flatten() {
                let (tet, corner) = ((half.1 / 4) as usize, (half.1 % 4) as usize);
                let apex = found.corners[tet][corner];
                let side = usize::from(is_behind(cells, first.0, apex));
                // Two on one side, where tetrahedra overlap: the second takes what is left.
                let side = if sides[side] == NONE { side } else { 1 - side };
                sides[side] = tet as u32;
                found.faces_of[tet][corner] = found.sides.len() as u32;
            }
            found.sides.push(sides);
            found.vertices.push(first.0);
        });
        Ok(found)
    }
}

impl Neighbours {
    /// Finds the neighbours of all cells, for an encoding of a name.
    ///
    /// # Errors
    /// [`ReferenceError`] if there is anything but tetrahedra.
    pub fn new(cells: &Cells, name: &'static str) -> Result<Self, ReferenceError> {
        let corners = cells.tetrahedra(name)?;
        let mut neighbours = vec![[NONE; 4]; corners.len()];
        let mut boundary = Vec::new();
        pair_faces(&half_faces(&corners), |a, b| match b {
            Some(b) => {
                neighbours[(a.1 / 4) as usize][(a.1 % 4) as usize] = b.1 / 4;
                neighbours[(b.1 / 4) as usize][(b.1 % 4) as usize] = a.1 / 4;
            }
            None => boundary.push(a.1),
        });
        Ok(Self {
            corners,
            neighbours,
            boundary,
        })
    }

    /// The tetrahedron of a face of the boundary, and the face's vertices `a b c`, whose normal
    /// `(b − a) × (c − a)` points out of it.
    pub fn boundary_face(&self, cells: &Cells, face: usize) -> (u32, [u32; 3]) {
        let half = self.boundary[face];
        let (tet, corner) = (half / 4, (half % 4) as usize);
        let corners = self.corners[tet as usize];
        let [a, b, c] = FACES[corner].map(|k| corners[k]);
        if is_behind(cells, [a, b, c], corners[corner]) {
            (tet, [a, b, c])
        } else {
            (tet, [a, c, b])
        }
    }
}
