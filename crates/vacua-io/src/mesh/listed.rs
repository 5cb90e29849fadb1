//! Arrays that files have for cells: their types, and the faces of polyhedra by number.

use std::cell::Cell;

use vacua_volume::{DataArray, Scalar, ScalarType, dispatch_scalar};

use super::index_at;
use crate::error::Problem;

/// The faces of polyhedra, each with a number: cells name their faces, faces their points.
pub(crate) struct ListedFaces {
    points: DataArray,
    point_ends: DataArray,
    faces: DataArray,
    face_ends: DataArray,
    /// How many more points of faces there may be: a face has two sides.
    points_left: Cell<usize>,
}

impl ListedFaces {
    /// The points of all faces, where each face's end, the faces of all cells, where each cell's end.
    pub fn new(
        points: DataArray,
        point_ends: DataArray,
        faces: DataArray,
        face_ends: DataArray,
    ) -> Self {
        let points_left = Cell::new(points.tuples().saturating_mul(2));
        Self {
            points,
            point_ends,
            faces,
            face_ends,
            points_left,
        }
    }

    /// The faces of one cell; `None` if the arrays say nonsense.
    pub fn of_cell(&self, cell: usize) -> Option<Vec<Vec<u64>>> {
        let face = |&face: &u64| {
            let span = span(&self.points, &self.point_ends, usize::try_from(face).ok()?)?;
            let left = self.points_left.get().checked_sub(span.len())?;
            self.points_left.set(left);
            numbers(&self.points, span)
        };
        numbers_of(&self.faces, &self.face_ends, cell)?
            .iter()
            .map(face)
            .collect()
    }
}

/// What part of an array belongs to one place, by where parts end.
fn span(array: &DataArray, ends: &DataArray, place: usize) -> Option<std::ops::Range<usize>> {
    let end = index_at(ends, place)?;
    // Negative ends are those of cells without faces.
    let start = (0..place)
        .rev()
        .find_map(|p| index_at(ends, p))
        .unwrap_or(0);
    (start <= end && end <= array.tuples()).then_some(start..end)
}

fn numbers(array: &DataArray, span: std::ops::Range<usize>) -> Option<Vec<u64>> {
    span.map(|i| index_at(array, i).map(|n| n as u64)).collect()
}

/// The numbers that belong to one place, by where those of each place end; negative ends are those of
/// places without any. `None` if the ends lead out of the array.
pub(crate) fn numbers_of(array: &DataArray, ends: &DataArray, place: usize) -> Option<Vec<u64>> {
    numbers(array, span(array, ends, place)?)
}

/// VTK's numbers of cell types, in whatever integers.
///
/// # Errors
/// [`Problem::Malformed`] if these are no integers from 0 to 255.
pub(crate) fn cell_types(array: &DataArray, what: &str) -> Result<Vec<u8>, Problem> {
    let wrong = || Problem::malformed(what, "numbers of VTK cell types, 0 to 255", "others");
    if matches!(array.scalar_type(), ScalarType::F32 | ScalarType::F64) || array.components() != 1 {
        return Err(wrong());
    }
    if let Some(bytes) = array.as_slice::<u8>() {
        return Ok(bytes.to_vec());
    }
    dispatch_scalar!(array.scalar_type(), T => {
        let all: &[T] = bytemuck::cast_slice(array.bytes());
        let byte = |v: &T| {
            let v = Scalar::to_f64(*v);
            (0.0..=255.0).contains(&v).then_some(v as u8).ok_or_else(wrong)
        };
        all.iter().map(byte).collect()
    })
}
