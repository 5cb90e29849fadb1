//! The kinds of cells.

/// The linear three-dimensional cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(u8)]
pub enum CellType {
    /// Four points.
    Tetrahedron = 0,
    /// A quadrilateral base (points 0 to 3) and an apex (point 4).
    Pyramid = 1,
    /// Two triangles (0, 1, 2 and 3, 4, 5).
    Wedge = 2,
    /// Two quadrilaterals (0 to 3 and 4 to 7).
    Hexahedron = 3,
}

/// The most points a cell has.
pub const MAX_CELL_POINTS: usize = 8;

impl CellType {
    /// Corners of a hexahedron in VTK's order, by their places along the axes of a lattice cell.
    pub const HEXAHEDRON_CORNERS: [[usize; 3]; 8] = [
        [0, 0, 0],
        [1, 0, 0],
        [1, 1, 0],
        [0, 1, 0],
        [0, 0, 1],
        [1, 0, 1],
        [1, 1, 1],
        [0, 1, 1],
    ];

    /// All cell types, by their number.
    pub const ALL: [Self; 4] = [
        Self::Tetrahedron,
        Self::Pyramid,
        Self::Wedge,
        Self::Hexahedron,
    ];

    /// Points of a cell.
    pub const fn num_points(self) -> usize {
        match self {
            Self::Tetrahedron => 4,
            Self::Pyramid => 5,
            Self::Wedge => 6,
            Self::Hexahedron => 8,
        }
    }

    /// The word `info` prints.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tetrahedron => "tetrahedron",
            Self::Pyramid => "pyramid",
            Self::Wedge => "wedge",
            Self::Hexahedron => "hexahedron",
        }
    }
}
