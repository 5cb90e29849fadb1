//! A field on an encoded mesh: all that its pictures and its values at points need.

use glam::DVec3;
use rayon::prelude::*;
use vacua_io::IoError;
use vacua_volume::{Bounds, ComponentChoice, DatasetError, FieldChoice, ValueMap};

use crate::detail::{DetailLevel, DetailSampler, Estimate};
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
    /// The file has no such time step.
    #[error("there is no time step {asked}; there are {available:?}")]
    Step {
        /// The number that was asked for.
        asked: u32,
        /// The numbers that there are.
        available: Vec<u32>,
    },
    /// The magnitude of one component with negative values.
    #[error(
        "the magnitude of field `{name}`, which has one component with negative values, is not in the file"
    )]
    Magnitude {
        /// The field.
        name: String,
    },
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
        Self::open_part(file, None, choice, ComponentChoice::Auto)
    }

    /// As [`Self::open`], of a time step by its number (the first if not given), and one component, or
    /// the magnitude, of a field with several.
    ///
    /// # Errors
    /// As [`Self::open`]; [`PackedVolumeError::Step`] if there is no such step,
    /// [`PackedVolumeError::Magnitude`] if a lone component has negative values, whose magnitude is not
    /// in the file.
    pub fn open_part(
        file: &PackedFile,
        step: Option<u32>,
        field: &FieldChoice,
        component: ComponentChoice,
    ) -> Result<Self, PackedVolumeError> {
        let steps = file.steps()?;
        let step = match step {
            None => steps.first().map(|s| s.number),
            Some(asked) if steps.iter().any(|s| s.number == asked) => Some(asked),
            Some(0) if steps.is_empty() => None,
            Some(asked) => {
                let available = steps.iter().map(|s| s.number).collect();
                return Err(PackedVolumeError::Step { asked, available });
            }
        };
        let groups = file.groups_of(step)?;
        let names: Vec<&str> = groups.iter().map(|g| g.name.as_str()).collect();
        let group = &groups[field.among(&names)?];
        let place = group.part(component)?;
        let mesh = file.mesh()?;
        let mut field = file.field(&mesh, place)?;
        field.name.clone_from(&group.name);
        let volume = Self { mesh, field };
        let is_lone = matches!(group.parts.as_slice(), [(None, _)]);
        if is_lone && component == ComponentChoice::Magnitude && volume.has_negative() {
            return Err(PackedVolumeError::Magnitude {
                name: group.name.clone(),
            });
        }
        Ok(volume)
    }

    fn has_negative(&self) -> bool {
        let ranges = (0..self.mesh.submeshes().len()).filter_map(|s| self.field.submesh_range(s));
        ranges.into_iter().any(|range| range.lo < 0.0)
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

    /// Estimates of the values at points of the world, in order, at a level of detail; `None` where no
    /// box of the level is.
    pub fn estimates_at(&self, level: DetailLevel, points: &[DVec3]) -> Vec<Option<Estimate>> {
        let sampler = DetailSampler::new(&self.mesh, &self.field, level, ValueMap::IDENTITY);
        let origin = DVec3::from(self.mesh.origin());
        let estimate = |&point: &DVec3| {
            let range = sampler.range_at((point - origin).to_array())?;
            Some(Estimate::from(range))
        };
        points.par_iter().map(estimate).collect()
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
