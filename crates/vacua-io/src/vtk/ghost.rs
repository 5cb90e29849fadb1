//! `vtkGhostType`: flags of points and cells that are copies of another rank's, or hidden.
//!
//! Source: vtkDataSetAttributes.h, `CellGhostTypes` and `PointGhostTypes`.

use vacua_volume::{CellMask, DataArray};

use crate::error::Problem;

/// A point or cell that another piece owns.
const DUPLICATE: u8 = 1;
/// A point that is not there: no cell that uses it is shown.
const HIDDEN_POINT: u8 = 2;
/// A cell that is not there.
pub(crate) const HIDDEN_CELL: u8 = 32;

/// Whether flags say that another piece owns the point or cell.
pub(crate) fn is_duplicate(flags: u8) -> bool {
    flags & DUPLICATE != 0
}

/// The cells of a grid with `points` a side that its ghost flags hide; `None` if none is.
/// The flags cover all points or all cells of the grid.
///
/// # Errors
/// [`Problem::Malformed`] if the flags are not bytes.
pub(crate) fn blanked_cells(
    points: [usize; 3],
    point_flags: Option<&DataArray>,
    cell_flags: Option<&DataArray>,
) -> Result<Option<CellMask>, Problem> {
    let point_flags = point_flags.map(flags).transpose()?.unwrap_or_default();
    let cell_flags = cell_flags.map(flags).transpose()?.unwrap_or_default();
    let any_hidden = point_flags.iter().any(|f| f & HIDDEN_POINT != 0)
        || cell_flags.iter().any(|f| f & HIDDEN_CELL != 0);
    if !any_hidden {
        return Ok(None);
    }
    let [nx, ny, nz] = points;
    let [cx, cy, cz] = points.map(|n| n - 1);
    let mut mask = CellMask::new(cx * cy * cz);
    for (cell, _) in cell_flags
        .iter()
        .enumerate()
        .filter(|(_, f)| *f & HIDDEN_CELL != 0)
    {
        mask.blank(cell);
    }
    for (point, _) in point_flags
        .iter()
        .enumerate()
        .filter(|(_, f)| *f & HIDDEN_POINT != 0)
    {
        let [x, y, z] = [point % nx, point / nx % ny, point / (nx * ny)];
        for k in z.saturating_sub(1)..(z + 1).min(nz - 1) {
            for j in y.saturating_sub(1)..(y + 1).min(ny - 1) {
                for i in x.saturating_sub(1)..(x + 1).min(nx - 1) {
                    mask.blank(i + cx * (j + cy * k));
                }
            }
        }
    }
    Ok(Some(mask))
}

/// The flags of one array.
///
/// # Errors
/// [`Problem::Malformed`] if they are not one byte each.
pub(crate) fn flags(array: &DataArray) -> Result<&[u8], Problem> {
    array
        .as_slice::<u8>()
        .filter(|_| array.components() == 1)
        .ok_or_else(|| {
            Problem::malformed(
                format!("array `{}`", super::GHOST_ARRAY),
                "one u8 a point or cell",
                format!("{} × {}", array.components(), array.scalar_type()),
            )
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hidden_points_take_their_cells_along() {
        let mut point = vec![0u8; 27];
        point[0] = HIDDEN_POINT;
        let mut cell = vec![DUPLICATE; 8];
        cell[7] = HIDDEN_CELL | DUPLICATE;
        let point = DataArray::from_vec(point, 1).expect("one each");
        let cell = DataArray::from_vec(cell, 1).expect("one each");
        let mask = blanked_cells([3, 3, 3], Some(&point), Some(&cell))
            .expect("bytes")
            .expect("some hidden");
        let blank: Vec<usize> = (0..8).filter(|&c| mask.is_blank(c)).collect();
        assert_eq!(blank, [0, 7]);
        let mut centre = vec![0u8; 27];
        centre[13] = HIDDEN_POINT;
        let centre = DataArray::from_vec(centre, 1).expect("one each");
        let mask = blanked_cells([3, 3, 3], Some(&centre), None).expect("bytes");
        assert_eq!(mask.map(|m| m.num_blank()), Some(8));
        assert_eq!(blanked_cells([3, 3, 3], None, None).expect("none"), None);
    }
}
