//! Meshes to measure on.

use serde::{Deserialize, Serialize, Serializer};
use vacua_pack::{EncodeOptions, Encoded, PackedField, Variant, encode};
use vacua_synth::{MeshKind, MeshSpec, generate_mesh};
use vacua_volume::{
    Association, ComponentChoice, DataArray, Dataset, FieldChoice, UnstructuredMesh, Volume,
};

use std::sync::Arc;

use crate::error::BenchError;
use crate::machine::available_bytes;

/// The variants of the encoding that are measured, by what the command calls them; what references
/// are built from is that of the last.
pub(crate) const VARIANTS: [(Variant, &str); 3] = [
    (Variant::MultiLeaves, "1"),
    (Variant::Small, "small"),
    (Variant::MultiNodes, "2"),
];

/// Bytes a cell that making and encoding a mesh takes, about.
const BYTES_PER_CELL: u64 = 250;

/// A kind of mesh, by its name in JSON.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scene(pub MeshKind);

impl Serialize for Scene {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.0.name())
    }
}

impl<'de> Deserialize<'de> for Scene {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = String::deserialize(deserializer)?;
        name.parse().map(Self).map_err(serde::de::Error::custom)
    }
}

/// How large meshes are, and in which order.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MeshSize {
    /// Part of each scene's size a side, above 0 and at most 1.
    pub scale: f64,
    /// Cells a side of every scene, about, instead.
    pub cells: Option<usize>,
    /// Whether points and cells come in random order.
    pub shuffled: bool,
}

impl MeshSize {
    /// Cells a side of a scene, about.
    pub fn of(&self, kind: MeshKind) -> usize {
        let scaled = (kind.default_size() as f64 * self.scale).round() as usize;
        self.cells.unwrap_or(scaled).max(2)
    }

    /// What it is, for people.
    pub(crate) fn text(&self) -> String {
        let size = match self.cells {
            Some(cells) => format!("about {cells} cells a side"),
            None => format!("{} of their sizes a side", self.scale),
        };
        let order = if self.shuffled {
            "points and cells shuffled"
        } else {
            "points and cells in order"
        };
        format!("{size}, {order}")
    }

    /// Makes a mesh with a field, if memory suffices.
    ///
    /// # Errors
    /// [`BenchError::Memory`] if it does not, or what goes wrong otherwise.
    pub fn make(&self, kind: MeshKind) -> Result<Dataset, BenchError> {
        let size = self.of(kind);
        let cells_per_cube = match kind {
            MeshKind::Hex150 => 1,
            MeshKind::Ocean | MeshKind::Octree => 2,
            _ => 7,
        };
        let cells = (size as u64)
            .saturating_pow(3)
            .saturating_mul(cells_per_cube);
        let needed_bytes = cells.saturating_mul(BYTES_PER_CELL);
        let available_bytes = available_bytes();
        if available_bytes > 0 && needed_bytes > available_bytes {
            return Err(BenchError::Memory {
                name: kind.name().to_owned(),
                needed_bytes,
                available_bytes,
                scale: self.scale,
            });
        }
        let spec = MeshSpec {
            size,
            shuffled: self.shuffled,
            ..MeshSpec::new(kind)
        };
        Ok(generate_mesh(&spec)?)
    }
}

/// The only field of a mesh, as renderers take it.
pub(crate) fn volume(dataset: &Dataset) -> Result<Arc<Volume>, BenchError> {
    Ok(Arc::new(
        dataset.volume(&FieldChoice::Only, ComponentChoice::Auto)?,
    ))
}

/// The mesh of a dataset that has one.
pub(crate) fn mesh(dataset: &Dataset) -> Result<&UnstructuredMesh, BenchError> {
    dataset.mesh().ok_or(BenchError::Option {
        option: "model",
        actual: dataset.geometry().kind().to_string(),
        expected: "a mesh",
    })
}

/// A mesh and its field, encoded.
pub(crate) struct Packed {
    pub encoded: Encoded,
    pub field: PackedField,
}

impl Packed {
    /// Encodes a mesh and values of its points.
    pub fn new(
        mesh: &UnstructuredMesh,
        values: &DataArray,
        options: EncodeOptions,
    ) -> Result<Self, BenchError> {
        let encoded = encode(mesh, options)?;
        let field = PackedField::pack(
            &encoded.mesh,
            &encoded.map,
            "scalars",
            Association::Point,
            values,
        )?;
        Ok(Self { encoded, field })
    }

    /// Bytes of everything but the map: geometry, values, ranges.
    pub fn num_bytes(&self) -> usize {
        let field = self.field.bytes();
        self.encoded.mesh.bytes().total() + field.values + field.ranges + field.cells_before
    }
}
