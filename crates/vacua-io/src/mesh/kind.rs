//! The kinds of cells that files have, by VTK's number.
//!
//! Source: vtkCellType.h of VTK 9.7.

use vacua_volume::CellType;

/// What is done with a kind of cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Treatment {
    /// It stays as it is.
    Keep(CellType),
    /// A hexahedron whose corners are numbered x fastest.
    Voxel,
    /// A prism over a polygon of so many sides: 5 or 6.
    Prism(usize),
    /// A curved cell: the linear cell of its corners, which come first.
    Corners {
        /// The linear cell.
        linear: CellType,
        /// The points it must have; `None` for any number that is not fewer than its corners.
        num_points: Option<usize>,
    },
    /// Filled with tetrahedra between its points.
    ConvexPointSet,
    /// Filled with tetrahedra between its faces.
    Polyhedron,
    /// Below three dimensions: counted and left out.
    LeaveOut,
}

/// A kind of cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Kind {
    /// What it is called.
    pub name: &'static str,
    /// What is done with it.
    pub treatment: Treatment,
}

/// VTK's numbers of the cells that other formats speak of.
pub(crate) mod vtk {
    /// One point.
    pub const VERTEX: u8 = 1;
    /// Several points.
    pub const POLY_VERTEX: u8 = 2;
    /// Two points.
    pub const LINE: u8 = 3;
    /// A chain of lines.
    pub const POLY_LINE: u8 = 4;
    /// Three points.
    pub const TRIANGLE: u8 = 5;
    /// Any number of points in a plane.
    pub const POLYGON: u8 = 7;
    /// Four points around.
    pub const QUAD: u8 = 9;
    /// Four points.
    pub const TETRA: u8 = 10;
    /// Eight points.
    pub const HEXAHEDRON: u8 = 12;
    /// Six points.
    pub const WEDGE: u8 = 13;
    /// Five points.
    pub const PYRAMID: u8 = 14;
    /// A curved line of three points.
    pub const QUADRATIC_EDGE: u8 = 21;
    /// A curved triangle of six points.
    pub const QUADRATIC_TRIANGLE: u8 = 22;
    /// A curved quadrilateral of eight points.
    pub const QUADRATIC_QUAD: u8 = 23;
    /// A curved tetrahedron of ten points.
    pub const QUADRATIC_TETRA: u8 = 24;
    /// A curved hexahedron of twenty points.
    pub const QUADRATIC_HEXAHEDRON: u8 = 25;
    /// A curved wedge of fifteen points.
    pub const QUADRATIC_WEDGE: u8 = 26;
    /// A curved pyramid of thirteen points.
    pub const QUADRATIC_PYRAMID: u8 = 27;
    /// A curved quadrilateral of nine points.
    pub const BIQUADRATIC_QUAD: u8 = 28;
    /// A curved hexahedron of 27 points.
    pub const TRIQUADRATIC_HEXAHEDRON: u8 = 29;
    /// A curved wedge of eighteen points.
    pub const BIQUADRATIC_QUADRATIC_WEDGE: u8 = 32;
    /// A curved hexahedron of 24 points.
    pub const BIQUADRATIC_QUADRATIC_HEXAHEDRON: u8 = 33;
    /// A tetrahedron of any order.
    pub const LAGRANGE_TETRAHEDRON: u8 = 71;
    /// A hexahedron of any order.
    pub const LAGRANGE_HEXAHEDRON: u8 = 72;
    /// A wedge of any order.
    pub const LAGRANGE_WEDGE: u8 = 73;
    /// A pyramid of any order.
    pub const LAGRANGE_PYRAMID: u8 = 74;
    /// Faces around a volume.
    pub const POLYHEDRON: u8 = 42;
}

const TETRA: CellType = CellType::Tetrahedron;
const HEXAHEDRON: CellType = CellType::Hexahedron;
const WEDGE: CellType = CellType::Wedge;
const PYRAMID: CellType = CellType::Pyramid;

/// The kind of cell with a number; `None` if there is none.
pub(crate) fn kind(number: u8) -> Option<Kind> {
    use Treatment::{ConvexPointSet, Corners, Keep, LeaveOut, Polyhedron, Prism, Voxel};
    let quadratic = |linear, points| Corners {
        linear,
        num_points: Some(points),
    };
    let any_order = |linear| Corners {
        linear,
        num_points: None,
    };
    let (name, treatment) = match number {
        0 => ("empty", LeaveOut),
        1 => ("vertex", LeaveOut),
        2 => ("poly_vertex", LeaveOut),
        3 => ("line", LeaveOut),
        4 => ("poly_line", LeaveOut),
        5 => ("triangle", LeaveOut),
        6 => ("triangle_strip", LeaveOut),
        7 => ("polygon", LeaveOut),
        8 => ("pixel", LeaveOut),
        9 => ("quad", LeaveOut),
        10 => ("tetrahedron", Keep(TETRA)),
        11 => ("voxel", Voxel),
        12 => ("hexahedron", Keep(HEXAHEDRON)),
        13 => ("wedge", Keep(WEDGE)),
        14 => ("pyramid", Keep(PYRAMID)),
        15 => ("pentagonal_prism", Prism(5)),
        16 => ("hexagonal_prism", Prism(6)),
        21 => ("quadratic_edge", LeaveOut),
        22 => ("quadratic_triangle", LeaveOut),
        23 => ("quadratic_quad", LeaveOut),
        24 => ("quadratic_tetrahedron", quadratic(TETRA, 10)),
        25 => ("quadratic_hexahedron", quadratic(HEXAHEDRON, 20)),
        26 => ("quadratic_wedge", quadratic(WEDGE, 15)),
        27 => ("quadratic_pyramid", quadratic(PYRAMID, 13)),
        28 => ("biquadratic_quad", LeaveOut),
        29 => ("triquadratic_hexahedron", quadratic(HEXAHEDRON, 27)),
        30 => ("quadratic_linear_quad", LeaveOut),
        31 => ("quadratic_linear_wedge", quadratic(WEDGE, 12)),
        32 => ("biquadratic_quadratic_wedge", quadratic(WEDGE, 18)),
        33 => (
            "biquadratic_quadratic_hexahedron",
            quadratic(HEXAHEDRON, 24),
        ),
        34 => ("biquadratic_triangle", LeaveOut),
        35 => ("cubic_line", LeaveOut),
        36 => ("quadratic_polygon", LeaveOut),
        37 => ("triquadratic_pyramid", quadratic(PYRAMID, 19)),
        41 => ("convex_point_set", ConvexPointSet),
        42 => ("polyhedron", Polyhedron),
        68 => ("lagrange_curve", LeaveOut),
        69 => ("lagrange_triangle", LeaveOut),
        70 => ("lagrange_quadrilateral", LeaveOut),
        71 => ("lagrange_tetrahedron", any_order(TETRA)),
        72 => ("lagrange_hexahedron", any_order(HEXAHEDRON)),
        73 => ("lagrange_wedge", any_order(WEDGE)),
        74 => ("lagrange_pyramid", any_order(PYRAMID)),
        75 => ("bezier_curve", LeaveOut),
        76 => ("bezier_triangle", LeaveOut),
        77 => ("bezier_quadrilateral", LeaveOut),
        78 => ("bezier_tetrahedron", any_order(TETRA)),
        79 => ("bezier_hexahedron", any_order(HEXAHEDRON)),
        80 => ("bezier_wedge", any_order(WEDGE)),
        81 => ("bezier_pyramid", any_order(PYRAMID)),
        _ => return None,
    };
    Some(Kind { name, treatment })
}
