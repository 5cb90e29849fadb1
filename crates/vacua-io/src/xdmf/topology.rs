//! `<Topology>`: which kind of grid, which kinds of cells.

use crate::error::Problem;
use crate::mesh::kind::vtk;
use crate::vtk::xml::document::Element;

use super::word;

/// What a topology says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Topology {
    /// Cells with points of their own.
    Cells(Cells),
    /// A structured grid.
    Structured(Structured),
}

/// Which cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Cells {
    /// All the same: VTK's number, and how many points each has.
    Uniform(u8, usize),
    /// Each with its kind before it.
    Mixed,
}

/// Which structured grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Structured {
    /// Origin and spacing.
    Uniform,
    /// Coordinates along each axis.
    Rectilinear,
    /// A position for each point.
    Curvilinear,
}

/// A kind of cell: XDMF's name and number, VTK's number, its points (0 if the file says).
const KINDS: [(&str, u64, u8, usize); 20] = [
    ("POLYVERTEX", 1, vtk::POLY_VERTEX, 0),
    ("POLYLINE", 2, vtk::POLY_LINE, 0),
    ("POLYGON", 3, vtk::POLYGON, 0),
    ("TRIANGLE", 4, vtk::TRIANGLE, 3),
    ("QUADRILATERAL", 5, vtk::QUAD, 4),
    ("TETRAHEDRON", 6, vtk::TETRA, 4),
    ("PYRAMID", 7, vtk::PYRAMID, 5),
    ("WEDGE", 8, vtk::WEDGE, 6),
    ("HEXAHEDRON", 9, vtk::HEXAHEDRON, 8),
    ("EDGE_3", 34, vtk::QUADRATIC_EDGE, 3),
    ("QUADRILATERAL_9", 35, vtk::BIQUADRATIC_QUAD, 9),
    ("TRIANGLE_6", 36, vtk::QUADRATIC_TRIANGLE, 6),
    ("QUADRILATERAL_8", 37, vtk::QUADRATIC_QUAD, 8),
    ("TETRAHEDRON_10", 38, vtk::QUADRATIC_TETRA, 10),
    ("PYRAMID_13", 39, vtk::QUADRATIC_PYRAMID, 13),
    ("WEDGE_15", 40, vtk::QUADRATIC_WEDGE, 15),
    ("WEDGE_18", 41, vtk::BIQUADRATIC_QUADRATIC_WEDGE, 18),
    ("HEXAHEDRON_20", 48, vtk::QUADRATIC_HEXAHEDRON, 20),
    (
        "HEXAHEDRON_24",
        49,
        vtk::BIQUADRATIC_QUADRATIC_HEXAHEDRON,
        24,
    ),
    ("HEXAHEDRON_27", 50, vtk::TRIQUADRATIC_HEXAHEDRON, 27),
];

/// XDMF's number of polyhedra in `Mixed` cells.
pub(super) const POLYHEDRON: u64 = 16;

/// The kind of a cell in a `Mixed` stream: VTK's number and its points, 0 if their number follows.
pub(super) fn mixed_kind(number: u64) -> Option<(u8, usize)> {
    let kind = KINDS.iter().find(|kind| kind.1 == number)?;
    Some((kind.2, kind.3))
}

/// What a cell of a kind is called that has so many points.
pub(super) fn of_points(kind: u8, points: usize) -> u8 {
    match (kind, points) {
        (vtk::POLY_VERTEX, 1) => vtk::VERTEX,
        (vtk::POLY_LINE, 2) => vtk::LINE,
        _ => kind,
    }
}

impl Topology {
    /// Reads what the element says.
    ///
    /// # Errors
    /// [`Problem::Unsupported`] for a kind that is not known.
    pub fn parse(element: &Element) -> Result<Self, Problem> {
        let name = word(element, &["TopologyType", "Type"], "");
        // Some programs leave the underscore out.
        let is_same = |kind: &str| kind == name || kind.replace('_', "") == name;
        if let Some(&(_, _, number, points)) = KINDS.iter().find(|kind| is_same(kind.0)) {
            let said = element.parsed("NodesPerElement", "a number of nodes")?;
            let points = match points {
                0 => said.unwrap_or(1),
                points => points,
            };
            if points == 0 {
                return Err(Problem::malformed(
                    element.place(),
                    "nodes in each element",
                    "elements without any",
                ));
            }
            return Ok(Self::Cells(Cells::Uniform(
                of_points(number, points),
                points,
            )));
        }
        Ok(match name.as_str() {
            "MIXED" => Self::Cells(Cells::Mixed),
            "3DCORECTMESH" => Self::Structured(Structured::Uniform),
            "3DRECTMESH" => Self::Structured(Structured::Rectilinear),
            "3DSMESH" => Self::Structured(Structured::Curvilinear),
            _ => {
                return Err(Problem::unsupported(format!(
                    "{}: the topology `{name}`",
                    element.place()
                )));
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::kind::{Treatment, kind};

    #[test]
    fn kinds_have_the_points_that_vtk_gives_them() {
        for (name, _, number, points) in KINDS {
            let treatment = kind(number).expect("a number of VTK's").treatment;
            match treatment {
                Treatment::Keep(cell_type) => assert_eq!(cell_type.num_points(), points, "{name}"),
                Treatment::Corners { num_points, .. } => {
                    assert_eq!(num_points, Some(points), "{name}");
                }
                other => assert_eq!(other, Treatment::LeaveOut, "{name}"),
            }
        }
    }
}
