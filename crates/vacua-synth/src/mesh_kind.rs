//! The kinds of procedural meshes by name, and the function that makes them.

use std::fmt;
use std::str::FromStr;

use glam::DVec3;
use rayon::prelude::*;
use vacua_volume::{Association, CellType, DataArray, Dataset, Field, Geometry, UnstructuredMesh};

use crate::kind::SynthError;
use crate::mesh_cells::{Cells, disturb};
use crate::{delaunay, mesh_shapes, meshes, octree};

/// A kind of procedural mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MeshKind {
    /// The benchmark scene: jittered cells cut in six.
    Tet100,
    /// The benchmark scene: jittered hexahedra.
    Hex150,
    /// Tetrahedra, finer towards the middle, like paper B's Jets.
    Jets,
    /// The Delaunay tetrahedra of random points.
    Delaunay,
    /// Wedges in layers on a body, tetrahedra around them, like paper B's Mars Lander.
    Lander,
    /// Columns of wedges over a sea floor, like paper B's ocean.
    Ocean,
    /// The dual of an octree, hexahedra with cells of all types between levels, like paper B's Exa-Jet.
    Octree,
}

/// A name that is no [`MeshKind`].
#[derive(Clone, Debug, thiserror::Error, PartialEq, Eq)]
#[error("unknown kind of mesh `{asked}`, expected one of {}", MeshKind::ALL.map(MeshKind::name).join(", "))]
pub struct UnknownMeshKind {
    /// What was asked for.
    pub asked: String,
}

impl MeshKind {
    /// Every kind, in the order in which they are listed to people.
    pub const ALL: [Self; 7] = [
        Self::Tet100,
        Self::Hex150,
        Self::Jets,
        Self::Delaunay,
        Self::Lander,
        Self::Ocean,
        Self::Octree,
    ];

    /// The name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tet100 => "tet100",
            Self::Hex150 => "hex150",
            Self::Jets => "jets",
            Self::Delaunay => "delaunay",
            Self::Lander => "lander",
            Self::Ocean => "ocean",
            Self::Octree => "octree",
        }
    }

    /// The size if none is asked for: cells a side, about.
    pub const fn default_size(self) -> usize {
        match self {
            Self::Tet100 => 100,
            Self::Hex150 => 150,
            Self::Jets | Self::Lander | Self::Octree => 64,
            Self::Delaunay => 32,
            Self::Ocean => 128,
        }
    }
}

impl fmt::Display for MeshKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for MeshKind {
    type Err = UnknownMeshKind;

    fn from_str(name: &str) -> Result<Self, UnknownMeshKind> {
        Self::ALL
            .into_iter()
            .find(|kind| kind.name() == name)
            .ok_or_else(|| UnknownMeshKind {
                asked: name.to_owned(),
            })
    }
}

/// The field of a mesh, on its points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MeshValues {
    /// A bump and a wave, about 0 to 1, in `f32`: that of the benchmark scenes.
    #[default]
    Wave,
    /// `1 + 2x − 3y + z/2` of the position divided by the size, in `f64`.
    Linear,
}

/// What to make.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshSpec {
    /// Which mesh.
    pub kind: MeshKind,
    /// Cells a side, about.
    pub size: usize,
    /// Which field.
    pub values: MeshValues,
    /// How far points move at most, in parts of the distance to their neighbours, beyond what the
    /// kind does by itself.
    pub jitter: f64,
    /// The part of the cells that is taken away.
    pub holes: f64,
    /// Nearly flat tetrahedra that are added between points of cells.
    pub num_slivers: usize,
    /// Whether points and cells come in random order.
    pub shuffled: bool,
    /// Seed of everything random but the benchmark scenes, which have their own.
    pub seed: u64,
}

impl MeshSpec {
    /// A kind at its default size, undisturbed.
    pub const fn new(kind: MeshKind) -> Self {
        Self {
            kind,
            size: kind.default_size(),
            values: MeshValues::Wave,
            jitter: 0.0,
            holes: 0.0,
            num_slivers: 0,
            shuffled: false,
            seed: 1,
        }
    }
}

/// The value of [`MeshValues::Linear`] at a position of a mesh of a size.
pub fn linear_value(position: DVec3, size: usize) -> f64 {
    let q = position / size as f64;
    1.0 + 2.0 * q.x - 3.0 * q.y + 0.5 * q.z
}

/// Makes a mesh: one point field `scalars`, the same bytes every time.
///
/// # Errors
/// [`SynthError`] if the size is 0 or more than 32-bit point numbers reach.
pub fn generate_mesh(spec: &MeshSpec) -> Result<Dataset, SynthError> {
    let MeshSpec {
        kind, size, seed, ..
    } = *spec;
    if size == 0 {
        return Err(SynthError::TooSmall { points: [size; 3] });
    }
    let mut cells = match kind {
        MeshKind::Tet100 => Cells::of_raw(meshes::tetrahedra(size, 1)?, CellType::Tetrahedron),
        MeshKind::Hex150 => Cells::of_raw(meshes::hexahedra(size, 2)?, CellType::Hexahedron),
        MeshKind::Jets => mesh_shapes::jets(size, seed)?,
        MeshKind::Delaunay => delaunay::random(size, seed)?,
        MeshKind::Lander => mesh_shapes::lander(size)?,
        MeshKind::Ocean => mesh_shapes::ocean(size, seed)?,
        MeshKind::Octree => octree::dual(size)?,
    };
    disturb(&mut cells, spec);
    let scalars = match spec.values {
        MeshValues::Wave => DataArray::from_vec(meshes::smooth(&cells.points, size), 1)?,
        MeshValues::Linear => {
            let value = |p: &[f32; 3]| linear_value(DVec3::from_array(p.map(f64::from)), size);
            let values: Vec<f64> = cells.points.par_iter().map(value).collect();
            DataArray::from_vec(values, 1)?
        }
    };
    let positions = DataArray::from_vec(cells.points.into_flattened(), 3)?;
    let connectivity = DataArray::from_vec(cells.connectivity, 1)?;
    let mesh = UnstructuredMesh::mixed(positions, cells.types, connectivity)?;
    let field = Field::new("scalars", Association::Point, scalars);
    Ok(Dataset::new(Geometry::Unstructured(mesh), vec![field])?)
}
