//! What paper B compares its encoding with, in the same program.
//!
//! Each of these holds the same cells in the same order with the same vertices and values, finds the
//! cells of places, and interpolates with the arithmetic of [`crate::weights_at`] and
//! [`crate::interpolate`]: cell and value are those of [`crate::Locator`] to the bit. Every part's
//! bytes are counted ([`Reference::parts`]). None is a strawman: hierarchies come from a library,
//! places go through them sixteen at a time, cells are tested in vectors, and cells and vertices lie
//! in packed order, which is kind to caches.
//!
//! | type | what it stands for | paper B |
//! |---|---|---|
//! | [`MinMaxBvh`] | OSPRay 1.8.5: 32-byte records, a binary min-max hierarchy, item lists | §3, Tables 1 and 5 |
//! | [`LinkedBvh`] | OSPRay 2.x, that is Open VKL: the caller's arrays, linked nodes and leaves | Table 5 |
//! | [`UserGeometry`] | Embree's or OptiX' user geometry: a box a cell, a wide hierarchy | Tables 4 and 6 |
//! | [`SharedFaces`] | each face once, with the tetrahedra on its sides; rays find faces | Tables 4 and 6 |
//! | [`TetMarch`] | tetrahedra and their neighbours; rays march from one to the next | Table 6 |
//!
//! Source: paper B, §3, §6.1.1 and §6.3; Morrical, Usher, Wald and Pascucci 2019 and 2020 for the
//! methods that the paper calls *user geom* and *shared faces*.

mod cells;
mod face_tree;
mod faces;
mod linked;
mod march;
mod min_max;
mod search;
mod shared_faces;
mod tet_march;
mod tree;
mod user_geometry;
mod weigh;

pub use cells::{Cell, Cells};
pub use faces::{Faces, Neighbours};
pub use linked::LinkedBvh;
pub use min_max::MinMaxBvh;
pub use shared_faces::SharedFaces;
pub use tet_march::TetMarch;
pub use user_geometry::UserGeometry;

use vacua_simd::LANES;
use vacua_volume::{Association, CellType};

pub use crate::block::Places;

/// No cell, tetrahedron or face.
pub(crate) const NONE: u32 = u32::MAX;

/// Why a mesh cannot be held in a reference encoding.
#[derive(Clone, Debug, thiserror::Error, PartialEq, Eq)]
pub enum ReferenceError {
    /// More of something than 32-bit numbers reach.
    #[error("{actual} {what}, this encoding reaches {largest}")]
    TooMany {
        /// Cells or vertices.
        what: &'static str,
        /// How many there are.
        actual: u64,
        /// How many it reaches.
        largest: u64,
    },
    /// Something else than tetrahedra, for an encoding that has only those.
    #[error("cell {cell} is a {}, {name} holds tetrahedra only", cell_type.name())]
    NotTetrahedron {
        /// Which cell, in packed order.
        cell: usize,
        /// What it is.
        cell_type: CellType,
        /// Which encoding.
        name: &'static str,
    },
    /// A field that is not on points.
    #[error("field `{name}` is on {association}s, reference encodings hold values of points")]
    Association {
        /// Name of the field.
        name: String,
        /// What it is on.
        association: Association,
    },
    /// Parts that are not of one mesh.
    #[error("{what} has {actual} entries, the packed mesh has {expected}")]
    Mismatch {
        /// Which part.
        what: &'static str,
        /// Its entries.
        actual: u64,
        /// Entries expected.
        expected: u64,
    },
    /// A cell of a damaged mesh.
    #[error("a cell reaches for vertex {actual}, its sub-mesh ends at {end}")]
    Corner {
        /// The vertex.
        actual: u64,
        /// One past the last.
        end: u64,
    },
}

/// The cells of sixteen places and the values there. What belongs to lanes that are not in
/// [`Found::valid`] is void.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// Values.
    pub values: [f32; LANES],
    /// Cells, by packed order.
    pub cells: [u32; LANES],
    /// The lanes in a cell all of whose values are finite.
    pub valid: u16,
}

impl Found {
    /// Nothing anywhere.
    const NOTHING: Self = Self {
        values: [0.0; LANES],
        cells: [NONE; LANES],
        valid: 0,
    };
}

/// Consecutive samples of a ray: number `k` lies at `fma(k, step, start)`, axis by axis, relative to
/// the mesh's origin (see [`crate::PackedMesh::origin`]).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RaySamples {
    /// Where sample 0 is.
    pub start: [f32; 3],
    /// From one sample to the next.
    pub step: [f32; 3],
    /// The first sample.
    pub first: u32,
}

impl RaySamples {
    /// Where a sample is.
    #[inline(always)]
    pub fn at(&self, k: u32) -> [f32; 3] {
        [0, 1, 2].map(|a| (k as f32).mul_add(self.step[a], self.start[a]))
    }

    /// Where sixteen samples are, from a given one on.
    #[inline(always)]
    pub fn places(&self, first: u32) -> Places {
        let mut places = [[0.0; LANES]; 3];
        for (axis, places) in places.iter_mut().enumerate() {
            for (lane, place) in places.iter_mut().enumerate() {
                *place = ((first + lane as u32) as f32).mul_add(self.step[axis], self.start[axis]);
            }
        }
        places
    }
}

/// A mesh in a reference encoding.
pub trait Reference: Sync {
    /// A short name.
    fn name(&self) -> &'static str;

    /// Number of cells.
    fn num_cells(&self) -> u64;

    /// Bytes of every part, by name.
    fn parts(&self) -> Vec<(&'static str, usize)>;

    /// The values at the places of some lanes.
    fn sample(&self, at: &Places, lanes: u16) -> Found;

    /// The values of consecutive samples of a ray; NaN where there is none.
    fn sample_ray(&self, ray: &RaySamples, values: &mut [f32]) {
        for (i, sixteen) in (0u32..).zip(values.chunks_mut(LANES)) {
            let lanes = ((1u32 << sixteen.len()) - 1) as u16;
            let found = self.sample(&ray.places(ray.first + LANES as u32 * i), lanes);
            for (lane, value) in sixteen.iter_mut().enumerate() {
                let valid = found.valid >> lane & 1 == 1;
                *value = if valid { found.values[lane] } else { f32::NAN };
            }
        }
    }

    /// Bytes of all parts.
    fn num_bytes(&self) -> usize {
        self.parts().iter().map(|part| part.1).sum()
    }
}
