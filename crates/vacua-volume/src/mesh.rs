//! Unstructured meshes: tetrahedra, pyramids, wedges and hexahedra in any mix.
//!
//! A mesh is positions and, cell after cell, the points of each cell in VTK's order. Nothing is
//! assumed about how cells join: duplicate points, hanging nodes, faces that do not match, cells
//! that overlap, are degenerate or inverted are all allowed. Arrays may lie in a mapped file; the
//! only things computed when a mesh is made are sums over its cell types.
//!
//! Points of a cell, VTK order (a tetrahedron with positive volume has point 3 on the side to which
//! the right-handed normal of 0, 1, 2 points):
//!
//! ```text
//!   tetrahedron        pyramid            wedge              hexahedron
//!        3                4              3-------5            7-------6
//!       /|\              /|\\            |\     /|           /|      /|
//!      / | \            / | \ \          | \   / |          4-------5 |
//!     0--|--2          3---------2       |   4   |          | 3-----|-2
//!      \ | /          / /     \ /        0---|---2          |/      |/
//!        1           0---------1           \ 1 /            0-------1
//! ```

mod cell_type;
mod error;

use std::sync::Arc;

use glam::DVec3;
use rayon::prelude::*;

use crate::array::DataArray;
use crate::dataset::CellMask;
use crate::grid::Bounds;
use crate::scalar::ScalarType;

pub use cell_type::{CellType, MAX_CELL_POINTS};
pub use error::MeshError;

/// Cells between two stored offsets of a mixed mesh.
const OFFSET_BLOCK: usize = 16;

/// What the cells are, and where each one's points start.
#[derive(Clone, Debug)]
enum Layout {
    Uniform(CellType),
    /// A type a cell, and where every [`OFFSET_BLOCK`]-th cell starts.
    Mixed {
        types: Arc<[CellType]>,
        block_starts: Arc<[u64]>,
    },
}

/// One cell: its type and its points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cell {
    /// What it is.
    pub cell_type: CellType,
    points: [u64; MAX_CELL_POINTS],
}

impl Cell {
    /// Its points in VTK's order.
    pub fn points(&self) -> &[u64] {
        &self.points[..self.cell_type.num_points()]
    }
}

/// Positions, cells and blanking. Immutable; clones share the arrays.
#[derive(Clone, Debug)]
pub struct UnstructuredMesh {
    positions: DataArray,
    connectivity: DataArray,
    layout: Layout,
    num_cells: usize,
    blanked_cells: Option<Arc<CellMask>>,
    left_out: Arc<[LeftOut]>,
}

/// Cells of one kind that a file has and a mesh has not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LeftOut {
    /// What they are: `quad`, `line` …
    pub name: &'static str,
    /// How many.
    pub count: usize,
}

impl UnstructuredMesh {
    /// A mesh whose cells are all of one type.
    ///
    /// `positions` are 3 × `f32` or `f64` a point; `connectivity` is one column of `u32`, `i32`,
    /// `u64` or `i64`, [`CellType::num_points`] a cell.
    ///
    /// # Errors
    /// [`MeshError`] if an array has the wrong shape or an index is out of range.
    ///
    /// # Cost
    /// One parallel pass over the connectivity.
    pub fn uniform(
        positions: DataArray,
        cell_type: CellType,
        connectivity: DataArray,
    ) -> Result<Self, MeshError> {
        let width = cell_type.num_points();
        let num_cells = connectivity.tuples() / width;
        check_length(
            num_cells,
            (num_cells * width) as u64,
            connectivity.tuples() as u64,
        )?;
        Self::checked(
            positions,
            connectivity,
            Layout::Uniform(cell_type),
            num_cells,
        )
    }

    /// A mesh of any mix of cells: a type a cell, and the points of all cells one after the other.
    ///
    /// # Errors
    /// As [`Self::uniform`].
    ///
    /// # Cost
    /// As [`Self::uniform`], and half a byte a cell for the places where cells start.
    pub fn mixed(
        positions: DataArray,
        types: Vec<CellType>,
        connectivity: DataArray,
    ) -> Result<Self, MeshError> {
        let num_cells = types.len();
        if let Some(&first) = types.first()
            && types.iter().all(|&t| t == first)
            && (num_cells as u64).checked_mul(first.num_points() as u64)
                == Some(connectivity.tuples() as u64)
        {
            return Self::uniform(positions, first, connectivity);
        }
        let mut block_starts = Vec::with_capacity(num_cells / OFFSET_BLOCK + 1);
        let mut next = 0u64;
        for block in types.chunks(OFFSET_BLOCK) {
            block_starts.push(next);
            next += block.iter().map(|t| t.num_points() as u64).sum::<u64>();
        }
        check_length(num_cells, next, connectivity.tuples() as u64)?;
        let layout = Layout::Mixed {
            types: types.into(),
            block_starts: block_starts.into(),
        };
        Self::checked(positions, connectivity, layout, num_cells)
    }

    /// As [`Self::mixed`], and checks the offsets that a file gives: one more than there are cells,
    /// from 0, each the end of the cell before it.
    ///
    /// # Errors
    /// As [`Self::uniform`], and if an offset contradicts the types.
    pub fn mixed_with_offsets(
        positions: DataArray,
        types: Vec<CellType>,
        offsets: &DataArray,
        connectivity: DataArray,
    ) -> Result<Self, MeshError> {
        if !is_index_type(offsets) || Some(offsets.tuples()) != types.len().checked_add(1) {
            return Err(MeshError::Offsets {
                cells: types.len(),
                tuples: offsets.tuples(),
                components: offsets.components(),
                scalar_type: offsets.scalar_type(),
            });
        }
        let mut expected = 0u64;
        for position in 0..offsets.tuples() {
            let actual = signed_index(offsets, position);
            if actual != i128::from(expected) {
                return Err(MeshError::Offset {
                    position,
                    actual,
                    expected,
                });
            }
            expected += types.get(position).map_or(0, |t| t.num_points() as u64);
        }
        Self::mixed(positions, types, connectivity)
    }

    fn checked(
        positions: DataArray,
        connectivity: DataArray,
        layout: Layout,
        num_cells: usize,
    ) -> Result<Self, MeshError> {
        let float = matches!(positions.scalar_type(), ScalarType::F32 | ScalarType::F64);
        if positions.components() != 3 || !float {
            return Err(MeshError::Positions {
                components: positions.components(),
                scalar_type: positions.scalar_type(),
            });
        }
        if !is_index_type(&connectivity) {
            return Err(MeshError::Connectivity {
                components: connectivity.components(),
                scalar_type: connectivity.scalar_type(),
            });
        }
        let mesh = Self {
            positions,
            connectivity,
            layout,
            num_cells,
            blanked_cells: None,
            left_out: Arc::new([]),
        };
        match mesh.first_index_out_of_range() {
            None => Ok(mesh),
            Some(place) => {
                let cell = mesh.cell_of_place(place);
                Err(MeshError::PointOutOfRange {
                    cell,
                    cell_type: mesh.cell_type(cell),
                    index: signed_index(&mesh.connectivity, place),
                    points: mesh.num_points(),
                })
            }
        }
    }

    /// The first place in the connectivity that names no point.
    fn first_index_out_of_range(&self) -> Option<usize> {
        const CHUNK: usize = 1 << 16;
        let points = self.num_points() as u64;
        match self.indices() {
            Indices::U32(all) => all
                .par_chunks(CHUNK)
                .enumerate()
                .find_map_first(|(c, chunk)| {
                    let bad = |&i: &u32| u64::from(i) >= points;
                    chunk.iter().position(bad).map(|k| c * CHUNK + k)
                }),
            Indices::U64(all) => all
                .par_chunks(CHUNK)
                .enumerate()
                .find_map_first(|(c, chunk)| {
                    chunk
                        .iter()
                        .position(|&i| i >= points)
                        .map(|k| c * CHUNK + k)
                }),
        }
    }

    /// The cell that a place in the connectivity belongs to.
    fn cell_of_place(&self, place: usize) -> usize {
        match &self.layout {
            Layout::Uniform(cell_type) => place / cell_type.num_points(),
            Layout::Mixed { block_starts, .. } => {
                let block = block_starts.partition_point(|&s| s <= place as u64) - 1;
                let first = block * OFFSET_BLOCK;
                let last = (first + OFFSET_BLOCK).min(self.num_cells) - 1;
                (first..=last)
                    .rfind(|&cell| self.cell_start(cell) <= place)
                    .unwrap_or(first)
            }
        }
    }

    /// Marks cells that hold nothing to see.
    ///
    /// # Errors
    /// [`MeshError::MaskLength`] if the mask covers another number of cells.
    pub fn with_blanked_cells(mut self, mask: CellMask) -> Result<Self, MeshError> {
        if mask.len() != self.num_cells {
            return Err(MeshError::MaskLength {
                actual: mask.len(),
                expected: self.num_cells,
            });
        }
        self.blanked_cells = (mask.num_blank() > 0).then(|| Arc::new(mask));
        Ok(self)
    }

    /// As [`Self::with_blanked_cells`] with a mask of the right length.
    pub(crate) fn with_same_blanked_cells(mut self, mask: Option<Arc<CellMask>>) -> Self {
        self.blanked_cells = mask;
        self
    }

    /// Says which cells of the file are not among those of the mesh: those below three dimensions.
    pub fn with_left_out(mut self, left_out: Vec<LeftOut>) -> Self {
        self.left_out = left_out.into();
        self
    }

    /// Cells of the file that are not among those of the mesh.
    pub fn left_out(&self) -> &[LeftOut] {
        &self.left_out
    }

    /// One position a point, in the type it came in.
    pub fn positions(&self) -> &DataArray {
        &self.positions
    }

    /// The points of all cells, one cell after the other.
    pub fn connectivity(&self) -> &DataArray {
        &self.connectivity
    }

    /// The points of all cells, one cell after the other, as unsigned integers.
    pub fn indices(&self) -> Indices<'_> {
        match self.connectivity.scalar_type().size_bytes() {
            4 => Indices::U32(bytemuck::cast_slice(self.connectivity.bytes())),
            _ => Indices::U64(bytemuck::cast_slice(self.connectivity.bytes())),
        }
    }

    /// Cells that hold nothing to see, if any.
    pub fn blanked_cells(&self) -> Option<&Arc<CellMask>> {
        self.blanked_cells.as_ref()
    }

    /// Number of points.
    pub fn num_points(&self) -> usize {
        self.positions.tuples()
    }

    /// Number of cells, blanked ones included.
    pub fn num_cells(&self) -> usize {
        self.num_cells
    }

    /// The type that all cells have, if the mesh is stored as such.
    pub fn uniform_type(&self) -> Option<CellType> {
        match self.layout {
            Layout::Uniform(cell_type) => Some(cell_type),
            Layout::Mixed { .. } => None,
        }
    }

    /// Number of cells of each type, by [`CellType`]'s number.
    pub fn num_cells_by_type(&self) -> [usize; 4] {
        let mut counts = [0; 4];
        match &self.layout {
            Layout::Uniform(cell_type) => counts[*cell_type as usize] = self.num_cells,
            Layout::Mixed { types, .. } => types.iter().for_each(|&t| counts[t as usize] += 1),
        }
        counts
    }

    /// What a cell is.
    ///
    /// # Panics
    /// If the cell is out of range.
    #[inline]
    pub fn cell_type(&self, cell: usize) -> CellType {
        assert!(cell < self.num_cells, "cell {cell} of {}", self.num_cells);
        match &self.layout {
            Layout::Uniform(cell_type) => *cell_type,
            Layout::Mixed { types, .. } => types[cell],
        }
    }

    /// Where a cell's points start in the connectivity.
    #[inline]
    fn cell_start(&self, cell: usize) -> usize {
        match &self.layout {
            Layout::Uniform(cell_type) => cell * cell_type.num_points(),
            Layout::Mixed {
                types,
                block_starts,
            } => {
                let block = cell / OFFSET_BLOCK;
                let before = types[block * OFFSET_BLOCK..cell].iter();
                block_starts[block] as usize + before.map(|t| t.num_points()).sum::<usize>()
            }
        }
    }

    /// One cell.
    ///
    /// # Panics
    /// If the cell is out of range.
    #[inline]
    pub fn cell(&self, cell: usize) -> Cell {
        let cell_type = self.cell_type(cell);
        let start = self.cell_start(cell);
        let mut points = [0; MAX_CELL_POINTS];
        let place = start..start + cell_type.num_points();
        match self.indices() {
            Indices::U32(all) => {
                for (to, &from) in points.iter_mut().zip(&all[place]) {
                    *to = u64::from(from);
                }
            }
            Indices::U64(all) => points[..place.len()].copy_from_slice(&all[place]),
        }
        Cell { cell_type, points }
    }

    /// Position of one point in the world.
    ///
    /// # Panics
    /// If the point is out of range.
    #[inline]
    pub fn position(&self, point: usize) -> DVec3 {
        match self.positions.as_slice::<f32>() {
            Some(p) => DVec3::new(
                f64::from(p[3 * point]),
                f64::from(p[3 * point + 1]),
                f64::from(p[3 * point + 2]),
            ),
            None => DVec3::new(
                self.positions.get_f64(point, 0),
                self.positions.get_f64(point, 1),
                self.positions.get_f64(point, 2),
            ),
        }
    }

    /// The box around all points, used by a cell or not; `None` without any finite point.
    pub fn bounds(&self) -> Option<Bounds> {
        const CHUNK: usize = 1 << 16;
        let chunks = self.num_points().div_ceil(CHUNK);
        (0..chunks)
            .into_par_iter()
            .map(|c| {
                let end = ((c + 1) * CHUNK).min(self.num_points());
                Bounds::of_points((c * CHUNK..end).map(|i| self.position(i)))
            })
            .reduce(
                || None,
                |a, b| match (a, b) {
                    (Some(a), Some(b)) => Some(Bounds {
                        lo: a.lo.min(b.lo),
                        hi: a.hi.max(b.hi),
                    }),
                    (a, b) => a.or(b),
                },
            )
    }
}

/// Point indices as they are stored; checked to be in range.
#[derive(Clone, Copy, Debug)]
pub enum Indices<'a> {
    /// 32 bits each.
    U32(&'a [u32]),
    /// 64 bits each.
    U64(&'a [u64]),
}

fn check_length(cells: usize, expected: u64, actual: u64) -> Result<(), MeshError> {
    if expected == actual {
        return Ok(());
    }
    Err(MeshError::ConnectivityLength {
        cells,
        expected,
        actual,
    })
}

fn is_index_type(array: &DataArray) -> bool {
    let integer = matches!(
        array.scalar_type(),
        ScalarType::U32 | ScalarType::I32 | ScalarType::U64 | ScalarType::I64
    );
    integer && array.components() == 1
}

/// An index as the file has it, sign included. The array is one column of integers.
fn signed_index(array: &DataArray, place: usize) -> i128 {
    let size = array.scalar_type().size_bytes();
    let bytes = &array.bytes()[place * size..(place + 1) * size];
    match array.scalar_type() {
        ScalarType::U32 => i128::from(bytemuck::pod_read_unaligned::<u32>(bytes)),
        ScalarType::I32 => i128::from(bytemuck::pod_read_unaligned::<i32>(bytes)),
        ScalarType::U64 => i128::from(bytemuck::pod_read_unaligned::<u64>(bytes)),
        _ => i128::from(bytemuck::pod_read_unaligned::<i64>(bytes)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn column<T: crate::Scalar>(values: Vec<T>) -> DataArray {
        DataArray::from_vec(values, 1).expect("one column")
    }

    fn positions(n: usize) -> DataArray {
        let all = (0..3 * n).map(|i| i as f32).collect::<Vec<_>>();
        DataArray::from_vec(all, 3).expect("triples")
    }

    #[test]
    fn a_mixed_mesh_gives_its_cells_back() {
        let types: Vec<CellType> = (0..100).map(|i| CellType::ALL[i * 7 % 4]).collect();
        let total: usize = types.iter().map(|t| t.num_points()).sum();
        let conn: Vec<i64> = (0..total as i64).collect();
        let mut offsets = vec![0i32];
        for t in &types {
            offsets.push(offsets[offsets.len() - 1] + t.num_points() as i32);
        }
        let mesh = UnstructuredMesh::mixed_with_offsets(
            positions(total),
            types.clone(),
            &column(offsets.clone()),
            column(conn),
        )
        .expect("valid");
        for (i, t) in types.iter().enumerate() {
            let cell = mesh.cell(i);
            assert_eq!(cell.cell_type, *t);
            let expected: Vec<u64> = (offsets[i] as u64..offsets[i + 1] as u64).collect();
            assert_eq!(cell.points(), expected);
            assert_eq!(mesh.cell_of_place(offsets[i] as usize), i);
            assert_eq!(mesh.cell_of_place(offsets[i + 1] as usize - 1), i);
        }
        assert_eq!(mesh.num_cells_by_type().iter().sum::<usize>(), 100);
        assert_eq!(
            mesh.bounds().map(|b| (b.lo, b.hi)),
            Some((DVec3::new(0.0, 1.0, 2.0), mesh.position(total - 1)))
        );
        offsets[50] += 1;
        let err = UnstructuredMesh::mixed_with_offsets(
            positions(total),
            types,
            &column(offsets),
            column((0..total as u64).collect()),
        );
        assert!(matches!(err, Err(MeshError::Offset { position: 50, .. })));
    }

    #[test]
    fn types_that_are_all_the_same_are_stored_as_one() {
        let mesh = UnstructuredMesh::mixed(
            positions(4),
            vec![CellType::Tetrahedron; 2],
            column(vec![0u32, 1, 2, 3, 3, 2, 1, 0]),
        )
        .expect("valid");
        assert_eq!(mesh.uniform_type(), Some(CellType::Tetrahedron));
        assert_eq!(mesh.cell(1).points(), [3, 2, 1, 0]);
    }

    #[test]
    fn an_empty_mesh_is_a_mesh() {
        let mesh = UnstructuredMesh::mixed(positions(0), Vec::new(), column(Vec::<u32>::new()))
            .expect("valid");
        assert_eq!((mesh.num_cells(), mesh.num_points()), (0, 0));
        assert_eq!(mesh.bounds(), None);
    }

    #[test]
    fn lies_are_named() {
        let tet = CellType::Tetrahedron;
        let err = UnstructuredMesh::uniform(positions(4), tet, column(vec![0i32, 1, 2, -1]));
        assert_eq!(
            err.expect_err("negative").to_string(),
            "tetrahedron 0 uses point -1, but points go from 0 to 3, 4 in all"
        );
        let err = UnstructuredMesh::uniform(positions(4), tet, column(vec![0u64, 1, 2, 4]));
        assert!(matches!(
            err,
            Err(MeshError::PointOutOfRange { index: 4, .. })
        ));
        let err = UnstructuredMesh::uniform(positions(4), tet, column(vec![0u64, 1, 2]));
        assert!(matches!(err, Err(MeshError::ConnectivityLength { .. })));
        let err = UnstructuredMesh::uniform(positions(4), tet, column(vec![0.0f32; 4]));
        assert!(matches!(err, Err(MeshError::Connectivity { .. })));
        let flat = DataArray::from_vec(vec![0.0f32; 8], 2).expect("pairs");
        let err = UnstructuredMesh::uniform(flat, tet, column(vec![0u32; 4]));
        assert!(matches!(err, Err(MeshError::Positions { .. })));
        let mesh = UnstructuredMesh::uniform(positions(4), tet, column(vec![0u32; 4]));
        let err = mesh.expect("valid").with_blanked_cells(CellMask::new(2));
        assert!(matches!(err, Err(MeshError::MaskLength { .. })));
    }

    proptest! {
        #[test]
        fn exactly_the_indices_out_of_range_are_refused(
            points in 1usize..20,
            conn in prop::collection::vec(-2i64..22, 0..40),
        ) {
            let whole = conn.len() / 4 * 4;
            let conn = conn[..whole].to_vec();
            let bad = conn.iter().position(|&i| i < 0 || i >= points as i64);
            let mesh = UnstructuredMesh::uniform(
                positions(points), CellType::Tetrahedron, column(conn.clone()));
            match (bad, mesh) {
                (None, Ok(mesh)) => prop_assert_eq!(mesh.num_cells(), whole / 4),
                (Some(k), Err(MeshError::PointOutOfRange { cell, index, .. })) => {
                    prop_assert_eq!((cell, index), (k / 4, i128::from(conn[k])));
                }
                (bad, mesh) => prop_assert!(false, "{:?} {:?}", bad, mesh.map(|_| ())),
            }
        }
    }
}
