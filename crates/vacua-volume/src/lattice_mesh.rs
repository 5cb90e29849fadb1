//! A curvilinear grid as the mesh of hexahedra that it is: what locates, encodes and skips meshes
//! then does so for curvilinear grids too.

use std::sync::Arc;

use rayon::prelude::*;

use crate::array::DataArray;
use crate::dataset::CellMask;
use crate::grid::CurvilinearGrid;
use crate::mesh::{CellType, UnstructuredMesh};

impl UnstructuredMesh {
    /// The cells of a curvilinear grid as hexahedra: the same numbers of points and cells, so that
    /// fields and masks of the grid are those of the mesh. Positions are shared.
    ///
    /// # Cost
    /// 32 bytes a cell; 64 for grids of 2^32 points or more.
    ///
    /// # Panics
    /// If the mask is of another number of cells.
    pub fn of_curvilinear(grid: &CurvilinearGrid, blanked_cells: Option<&Arc<CellMask>>) -> Self {
        let points = grid.points();
        let num_points: usize = points.iter().product();
        let connectivity = if u32::try_from(num_points).is_ok() {
            DataArray::from_vec(hexahedra(points, |point| point as u32), 1)
        } else {
            DataArray::from_vec(hexahedra(points, |point| point as u64), 1)
        };
        let mesh = connectivity.ok().and_then(|connectivity| {
            Self::uniform(grid.positions().clone(), CellType::Hexahedron, connectivity).ok()
        });
        let mesh = mesh.expect("eight points of the grid a cell");
        if let Some(mask) = blanked_cells {
            assert_eq!(mask.len(), mesh.num_cells(), "a bit a cell");
        }
        mesh.with_same_blanked_cells(blanked_cells.cloned())
    }
}

/// Points of all hexahedra of a lattice, cells in order, x fastest.
fn hexahedra<T: Copy + Default + Send>(
    points: [usize; 3],
    number: impl Fn(usize) -> T + Sync,
) -> Vec<T> {
    let [nx, ny, _] = points;
    let [cx, cy, cz] = points.map(|n| n - 1);
    let mut all = vec![T::default(); 8 * cx * cy * cz];
    all.par_chunks_mut(8 * cx)
        .enumerate()
        .for_each(|(row, cells)| {
            let (y, z) = (row % cy, row / cy);
            for (x, cell) in cells.chunks_exact_mut(8).enumerate() {
                for (to, [i, j, k]) in cell.iter_mut().zip(CellType::HEXAHEDRON_CORNERS) {
                    *to = number(x + i + nx * (y + j + ny * (z + k)));
                }
            }
        });
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn cells_keep_their_numbers_and_corners() {
        let points = [4, 3, 5];
        let xyz = (0..60usize).flat_map(|i| [i % 4, i / 4 % 3, i / 12]);
        let positions = DataArray::from_vec(xyz.map(|c| c as f64).collect(), 3);
        let grid = CurvilinearGrid::new(points, positions.expect("three components"))
            .expect("a position a point");
        let mut mask = CellMask::new(24);
        mask.blank(7);
        let mesh = UnstructuredMesh::of_curvilinear(&grid, Some(&Arc::new(mask)));
        assert_eq!((mesh.num_points(), mesh.num_cells()), (60, 24));
        assert!(
            mesh.blanked_cells()
                .is_some_and(|m| m.is_blank(7) && m.num_blank() == 1)
        );
        for cell in 0..24 {
            let origin = DVec3::new((cell % 3) as f64, (cell / 3 % 2) as f64, (cell / 6) as f64);
            let corners = mesh.cell(cell);
            assert_eq!(corners.cell_type, CellType::Hexahedron);
            // Once around the bottom, then once around the top, as VTK has it.
            let around = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]];
            for (k, &point) in corners.points().iter().enumerate() {
                let up = DVec3::Z * (k / 4) as f64;
                let expected = origin + DVec3::from(around[k % 4]) + up;
                assert_eq!(
                    mesh.position(point as usize),
                    expected,
                    "corner {k} of {cell}"
                );
            }
        }
    }
}
