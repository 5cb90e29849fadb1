//! A box a cell and a wide hierarchy over them: cells as a ray tracer's user geometry, found by point
//! queries.
//!
//! Source: paper B, §6.1.1 (*user geom*; Morrical et al. 2019). Deviation: there OptiX builds and
//! walks the hierarchy; here it has the layout of Embree's BVH4, nodes of 128 bytes with exact boxes,
//! over leaves of one cell, whose number stands where the reference to a leaf would. A cell keeps as
//! many indices of 32 bits as it has corners; where types are mixed, a byte and an offset more.

use vacua_volume::CellType;

use super::search::{self, Inside, Source};
use super::tree::{self, Box3, WIDTH, WideChild, WideNode};
use super::{Cell, Cells, Found, Reference};
use crate::block::Places;

/// Cells as user geometry.
pub struct UserGeometry {
    vertices: Vec<[f32; 4]>,
    cells: CellLists,
    nodes: Vec<WideNode>,
    scale: f32,
}

/// Corners of cells, one after the other.
pub(super) struct CellLists {
    pub connectivity: Vec<u32>,
    /// Type and first index of each, unless all have one type.
    pub kinds: Kinds,
}

/// What cells are and where their corners start.
pub(super) enum Kinds {
    Uniform(CellType),
    Mixed { types: Vec<u8>, first: Vec<u32> },
}

impl CellLists {
    pub fn new(cells: &Cells) -> Self {
        let all = &cells.cells;
        let connectivity = all.iter().flat_map(|c| c.corners().iter().copied());
        let one_type = all.first().map_or(CellType::Tetrahedron, |c| c.cell_type);
        let kinds = if all.iter().all(|c| c.cell_type == one_type) {
            Kinds::Uniform(one_type)
        } else {
            Kinds::mixed(cells)
        };
        Self {
            connectivity: connectivity.collect(),
            kinds,
        }
    }

    #[inline(always)]
    pub fn get(&self, cell: u32) -> Cell {
        let (cell_type, first) = match &self.kinds {
            Kinds::Uniform(cell_type) => (*cell_type, cell as usize * cell_type.num_points()),
            Kinds::Mixed { types, first } => {
                let cell_type = usize::from(types[cell as usize]) % CellType::ALL.len();
                (CellType::ALL[cell_type], first[cell as usize] as usize)
            }
        };
        let points = &self.connectivity[first..first + cell_type.num_points()];
        let mut corners = [points[0]; 8];
        corners[..points.len()].copy_from_slice(points);
        Cell { cell_type, corners }
    }

    pub fn num_cells(&self) -> u64 {
        match &self.kinds {
            Kinds::Uniform(kind) => (self.connectivity.len() / kind.num_points()) as u64,
            Kinds::Mixed { types, .. } => types.len() as u64,
        }
    }
}

impl Kinds {
    pub fn mixed(cells: &Cells) -> Self {
        let mut next = 0;
        let first = cells.cells.iter().map(|cell| {
            next += cell.corners().len() as u32;
            next - cell.corners().len() as u32
        });
        Self::Mixed {
            first: first.collect(),
            types: cells.cells.iter().map(|c| c.cell_type as u8).collect(),
        }
    }

    pub fn num_bytes(&self) -> usize {
        match self {
            Self::Uniform(_) => 0,
            Self::Mixed { types, first } => types.len() + size_of_val(first.as_slice()),
        }
    }
}

impl UserGeometry {
    /// Builds the hierarchy.
    pub fn new(cells: &Cells) -> Self {
        let boxes: Vec<_> = cells.cells.iter().map(|c| cells.bounds(c)).collect();
        let tree = tree::build(&boxes);
        drop(boxes);
        let nodes = tree::collapse(&tree, |items| {
            items.iter().fold(0, |_, &cell| u64::from(cell))
        });
        Self {
            vertices: cells.vertices.clone(),
            cells: CellLists::new(cells),
            nodes,
            scale: search::scale_of(&cells.vertices),
        }
    }
}

impl Source for UserGeometry {
    #[inline(always)]
    fn root(&self) -> Option<u32> {
        (!self.nodes.is_empty()).then_some(0)
    }

    #[inline(always)]
    fn num_below(&self, _: u32) -> usize {
        WIDTH
    }

    #[inline(always)]
    fn below(&self, node: u32, k: usize) -> (Box3, Inside) {
        let node = &self.nodes[node as usize];
        let inside = match node.child(k) {
            WideChild::Node(below) => Inside::Node(below),
            WideChild::Leaf(leaf) => Inside::Leaf(leaf as u32),
        };
        (node.bounds(k), inside)
    }

    #[inline(always)]
    fn cell_of_leaf(&self, leaf: u32) -> u32 {
        leaf
    }

    #[inline(always)]
    fn prefetch(&self, node: u32) {
        vacua_simd::prefetch(&self.nodes, node as usize);
    }

    #[inline(always)]
    fn cell(&self, cell: u32) -> Cell {
        self.cells.get(cell)
    }

    #[inline(always)]
    fn vertex(&self, vertex: u32) -> [f32; 4] {
        self.vertices[vertex as usize]
    }

    #[inline(always)]
    fn scale(&self) -> f32 {
        self.scale
    }
}

impl Reference for UserGeometry {
    fn name(&self) -> &'static str {
        "user geometry"
    }

    fn num_cells(&self) -> u64 {
        self.cells.num_cells()
    }

    fn parts(&self) -> Vec<(&'static str, usize)> {
        vec![
            ("vertices", size_of_val(self.vertices.as_slice())),
            ("indices", size_of_val(self.cells.connectivity.as_slice())),
            ("types and offsets", self.cells.kinds.num_bytes()),
            ("nodes", size_of_val(self.nodes.as_slice())),
        ]
    }

    fn sample(&self, at: &Places, lanes: u16) -> Found {
        search::sample(self, at, lanes)
    }
}
