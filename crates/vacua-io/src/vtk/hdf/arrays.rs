//! Arrays on points and cells: which there are, and ghost flags among them.

use std::sync::Arc;

use vacua_volume::{Association, DataArray};

use super::steps::Steps;
use crate::error::Problem;
use crate::hdf5::{Array, ArrayKind, Container};
use crate::vtk::GHOST_ARRAY;

/// One array, and where its part for the step begins.
pub(super) struct StepArray {
    /// Its name.
    pub name: String,
    /// On points or on cells.
    pub association: Association,
    /// The array with all steps.
    pub array: Arc<Array>,
    /// What `Steps` says of its beginning.
    pub offset: Option<usize>,
}

/// The arrays of a data set, and the ghost flags of its points and cells.
#[derive(Default)]
pub(super) struct StepArrays {
    /// Arrays to show.
    pub fields: Vec<StepArray>,
    /// `vtkGhostType` of points and of cells.
    pub flags: [Option<StepArray>; 2],
}

impl StepArrays {
    /// Lists them; what are no numbers is noted.
    ///
    /// # Errors
    /// [`Problem`] if the groups are damaged.
    pub fn list(
        file: &Container,
        data_set: &str,
        steps: &Steps<'_>,
        step: usize,
        notes: &mut Vec<String>,
    ) -> Result<Self, Problem> {
        let mut all = Self::default();
        for (place, association, group) in [
            (0, Association::Point, "PointData"),
            (1, Association::Cell, "CellData"),
        ] {
            let (_, names) = file.names(&format!("{data_set}/{group}"))?;
            for name in names {
                let array = file.need(&format!("{data_set}/{group}/{name}"))?;
                let offset = steps.of(&format!("{group}Offsets/{name}"), step)?;
                if !matches!(array.kind(), ArrayKind::Numbers(_)) {
                    notes.push(format!(
                        "{association} array `{name}` has no numbers: left out"
                    ));
                    continue;
                }
                let found = StepArray {
                    association,
                    array: Arc::new(array),
                    offset,
                    name,
                };
                if found.name == GHOST_ARRAY {
                    all.flags[place] = Some(found);
                } else {
                    all.fields.push(found);
                }
            }
        }
        Ok(all)
    }
}

impl StepArray {
    /// Its rows from `first` on within the step, which begins at `default` where `Steps` is silent.
    pub fn rows(&self, default: usize, first: usize) -> usize {
        self.offset.unwrap_or(default).saturating_add(first)
    }

    /// Reads rows.
    ///
    /// # Errors
    /// [`Problem`] if there are not so many.
    pub fn read(&self, first: usize, rows: usize) -> Result<DataArray, Problem> {
        self.array.read_rows(first, rows)
    }
}
