//! The cells of a packed mesh as plain lists: what reference encodings are built from.

use std::ops::Range;

use vacua_volume::{Association, CellType};

use super::{NONE, ReferenceError};
use crate::encode::PackMap;
use crate::field::PackedField;
use crate::packed::PackedMesh;

/// A cell: what it is, and its vertices in VTK's order; past those of its type, repetitions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cell {
    /// What it is.
    pub cell_type: CellType,
    /// Its vertices.
    pub corners: [u32; 8],
}

impl Cell {
    /// Its vertices, as many as it has.
    pub fn corners(&self) -> &[u32] {
        &self.corners[..self.cell_type.num_points()]
    }
}

/// Cells in packed order over vertices that none shares with a copy of itself.
#[derive(Clone, Debug, Default)]
pub struct Cells {
    pub(super) vertices: Vec<[f32; 4]>,
    pub(super) cells: Vec<Cell>,
}

impl Cells {
    /// The cells of a packed mesh, with a field on its points.
    ///
    /// # Errors
    /// [`ReferenceError`] if map or field are not the mesh's, a cell has a corner that is none, or numbers of vertices or cells do not
    /// fit 29 bits.
    pub fn new(
        mesh: &PackedMesh,
        map: &PackMap,
        field: &PackedField,
    ) -> Result<Self, ReferenceError> {
        Self::of_submeshes(mesh, map, field, 0..mesh.submeshes().len())
    }

    /// The cells of some sub-meshes.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn of_submeshes(
        mesh: &PackedMesh,
        map: &PackMap,
        field: &PackedField,
        submeshes: Range<usize>,
    ) -> Result<Self, ReferenceError> {
        // So that the corners of all cells together have numbers of 32 bits.
        const LARGEST: u64 = u32::MAX as u64 / 8;
        if field.association() != Association::Point {
            return Err(ReferenceError::Association {
                name: field.name().to_owned(),
                association: field.association(),
            });
        }
        let num_vertices = mesh.num_vertices();
        let lengths = [
            ("the map of points", map.points.len()),
            ("the field", field.values().tuples()),
            // Variant `small` has no list of them.
            ("the list of positions", mesh.positions().len()),
        ];
        for (what, actual) in lengths {
            if actual != num_vertices {
                return Err(ReferenceError::Mismatch {
                    what,
                    actual: actual as u64,
                    expected: num_vertices as u64,
                });
            }
        }
        let check = |what, actual: u64| {
            (actual < LARGEST)
                .then_some(())
                .ok_or(ReferenceError::TooMany {
                    what,
                    actual,
                    largest: LARGEST,
                })
        };
        check("cells", mesh.num_cells())?;
        check("vertices", num_vertices as u64)?;
        let last_point = (0..num_vertices).map(|v| map.points.get(v)).max();
        check("points", last_point.unwrap_or(0))?;
        let mut number_of = vec![NONE; last_point.map_or(0, |last| last as usize + 1)];
        let mut all = Self::default();
        // The first vertex after those of its sub-mesh that a cell reaches for, if one does.
        let mut beyond = None;
        for number in submeshes {
            let Some(submesh) = mesh.submesh(number) else {
                continue;
            };
            let first_vertex = submesh.header.first_vertex as usize;
            let after = first_vertex + submesh.positions.len();
            for node in 0..submesh.header.num_nodes {
                submesh.cells_of_node(node, |_, cell_type, corners| {
                    let corners = corners.map(|corner| {
                        let place = first_vertex + corner as usize;
                        if place >= after {
                            beyond = Some((place, after));
                            return 0;
                        }
                        let number = &mut number_of[map.points.get(place) as usize];
                        if *number == NONE {
                            *number = all.vertices.len() as u32;
                            let [x, y, z] = mesh.positions()[place];
                            let value = field.values().get_f64(place, 0) as f32;
                            all.vertices.push([x, y, z, value]);
                        }
                        *number
                    });
                    all.cells.push(Cell { cell_type, corners });
                });
            }
        }
        match beyond {
            Some((place, after)) => Err(ReferenceError::Corner {
                actual: place as u64,
                end: after as u64,
            }),
            None => Ok(all),
        }
    }

    /// Positions relative to the mesh's origin, and the value there; in the order in which cells come
    /// by them.
    pub fn vertices(&self) -> &[[f32; 4]] {
        &self.vertices
    }

    /// The cells.
    pub fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// The corners of the box around a cell.
    pub(super) fn bounds(&self, cell: &Cell) -> [[f32; 3]; 2] {
        let (mut lo, mut hi) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for &corner in cell.corners() {
            let vertex = self.vertices[corner as usize];
            for axis in 0..3 {
                lo[axis] = lo[axis].min(vertex[axis]);
                hi[axis] = hi[axis].max(vertex[axis]);
            }
        }
        [lo, hi]
    }

    /// The range of the values of a cell's vertices; those that are not finite do not count.
    pub(super) fn range(&self, cell: &Cell) -> [f32; 2] {
        let mut range = [f32::INFINITY, f32::NEG_INFINITY];
        for &corner in cell.corners() {
            let value = self.vertices[corner as usize][3];
            if value.is_finite() {
                range = [range[0].min(value), range[1].max(value)];
            }
        }
        range
    }

    /// The corners of all cells, each of which must be a tetrahedron.
    pub(super) fn tetrahedra(&self, name: &'static str) -> Result<Vec<[u32; 4]>, ReferenceError> {
        // Faces are numbered by tetrahedron and corner.
        const LARGEST: usize = (NONE / 4) as usize;
        if self.cells.len() >= LARGEST {
            return Err(ReferenceError::TooMany {
                what: "cells",
                actual: self.cells.len() as u64,
                largest: LARGEST as u64,
            });
        }
        let corners = self.cells.iter().enumerate().map(|(number, cell)| {
            if cell.cell_type != CellType::Tetrahedron {
                return Err(ReferenceError::NotTetrahedron {
                    cell: number,
                    cell_type: cell.cell_type,
                    name,
                });
            }
            let [a, b, c, d, ..] = cell.corners;
            Ok([a, b, c, d])
        });
        corners.collect()
    }
}
