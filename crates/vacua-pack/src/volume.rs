//! A field on an encoded mesh: all that its pictures and its values at points need.

use glam::DVec3;
use rayon::prelude::*;
use vacua_io::IoError;
use vacua_volume::{Bounds, DatasetError, FieldChoice};

use crate::field::PackedField;
use crate::file::PackedFile;
use crate::packed::PackedMesh;

/// An encoded mesh and one of its fields. Clones share the arrays.
#[derive(Clone)]
pub struct PackedVolume {
    mesh: PackedMesh,
    field: PackedField,
}

/// Why a field of a `.vacua` file cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum PackedVolumeError {
    /// The file has no such field, or several and none was asked for.
    #[error(transparent)]
    Choice(#[from] DatasetError),
    /// A part of the file is missing or damaged.
    #[error(transparent)]
    Io(#[from] IoError),
}

impl PackedVolume {
    /// A mesh and a field that was packed for it.
    pub fn new(mesh: PackedMesh, field: PackedField) -> Self {
        Self { mesh, field }
    }

    /// A field of a file, where it is mapped.
    ///
    /// # Errors
    /// [`PackedVolumeError`] if there is no such field, or a section is missing, damaged, or
    /// contradicts the others.
    ///
    /// # Cost
    /// As [`PackedFile::mesh`] and [`PackedFile::field`].
    pub fn open(file: &PackedFile, choice: &FieldChoice) -> Result<Self, PackedVolumeError> {
        let names = file.fields()?.into_iter().map(|field| field.name);
        let field = choice.among(&names.collect::<Vec<_>>())?;
        let mesh = file.mesh()?;
        let field = file.field(&mesh, field)?;
        Ok(Self { mesh, field })
    }

    /// The mesh.
    pub fn mesh(&self) -> &PackedMesh {
        &self.mesh
    }

    /// The field.
    pub fn field(&self) -> &PackedField {
        &self.field
    }

    /// The box around all cells, world space; without a cell, a point at the origin.
    pub fn bounds(&self) -> Bounds {
        self.mesh.bounds().unwrap_or(Bounds {
            lo: DVec3::ZERO,
            hi: DVec3::ZERO,
        })
    }

    /// The values at points of the world, in order; `None` where no cell is.
    pub fn values_at(&self, points: &[DVec3]) -> Vec<Option<f64>> {
        points
            .par_iter()
            .map_init(
                || self.mesh.locator(),
                |locator, point| {
                    let location = locator.locate(point.to_array())?;
                    self.field.value_at(&self.mesh, &location)
                },
            )
            .collect()
    }
}

impl std::fmt::Debug for PackedVolume {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PackedVolume")
            .field("cells", &self.mesh.num_cells())
            .field("field", &self.field.name())
            .finish_non_exhaustive()
    }
}
