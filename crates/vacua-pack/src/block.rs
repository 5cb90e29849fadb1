//! The cells of sixteen places at once, straight from the packed form.
//!
//! Sixteen consecutive samples of a ray, or any sixteen points, go through the trees together:
//! breadth first, a mask of lanes with every node, so that what is needed next is asked for long
//! before it is. Leaves that lanes fall into give up their cells to batches of sixteen: of
//! tetrahedra, the vectors are sixteen *cells*, whose planes are set up once and then tried on one
//! lane after the other; of other cells, boxes first, then Newton's method on sixteen pairs of cell
//! and lane.
//!
//! The answer is that of [`crate::Locator`], cell for cell: among several cells the one with the
//! lowest packed index, whatever the order of the search. Vectors compute in `f32` with a bound on
//! their rounding; where that leaves the slightest doubt (a place on a face, a flat cell, a map
//! that is nearly singular), the scalar code decides in `f64`. No last cell is remembered: it could
//! answer only for cells known not to overlap.
//!
//! Source: paper B, §5.2 to §5.6, one sample at a time on a GPU. Deviation: sixteen at a time.

mod batch;
mod maps;
mod others;
mod tets;
mod values;
mod walk;

pub use values::{BlockSampler, Sampled};

use vacua_simd::{Kernel, LANES, Level, Simd, dispatch, dispatch_at};

use crate::grid::exp2;
use crate::locate::Location;
use crate::packed::PackedMesh;
use vacua_volume::CellType;

/// A place a lane, axis by axis, relative to the mesh's origin (see [`PackedMesh::origin`]).
pub type Places = [[f32; LANES]; 3];

/// Coordinates up to which vectors compute; beyond, products could overflow.
const LARGEST: f32 = 1e30;
/// Corners of a cell at most.
pub(crate) const MAX_CORNERS: usize = 8;

/// The cells of sixteen places. What belongs to lanes that are not in [`Located::found`] is void.
#[derive(Clone, Copy, Debug)]
pub struct Located {
    /// The lanes whose place is in a cell.
    pub found: u16,
    /// The lanes whose cell is no tetrahedron.
    pub others: u16,
    /// Which sub-mesh.
    pub submesh: [u32; LANES],
    /// Which primitive there; see [`crate::PackedCell::index`].
    pub primitive: [u64; LANES],
    /// What kind of cell, by [`CellType`]'s number.
    pub cell_type: [u8; LANES],
    /// Which node of the sub-mesh.
    pub node: [u32; LANES],
    /// Its corners, as vertices of the sub-mesh: four of a tetrahedron, eight of others, of which
    /// those past the end are repetitions.
    pub corners: [[u32; LANES]; MAX_CORNERS],
    /// Weights of the corners but the first, which has what is left to 1. As many as there are
    /// corners.
    pub weights: [[f32; LANES]; MAX_CORNERS],
}

impl Default for Located {
    fn default() -> Self {
        Self {
            found: 0,
            others: 0,
            submesh: [0; LANES],
            primitive: [u64::MAX; LANES],
            cell_type: [0; LANES],
            node: [0; LANES],
            corners: [[0; LANES]; MAX_CORNERS],
            weights: [[0.0; LANES]; MAX_CORNERS],
        }
    }
}

impl Located {
    /// The kind of a lane's cell.
    pub fn cell_type(&self, lane: usize) -> CellType {
        CellType::ALL[usize::from(self.cell_type[lane]) % CellType::ALL.len()]
    }

    /// How many cells of its node come before a lane's cell.
    pub fn cell_in_node(&self, mesh: &PackedMesh, lane: usize) -> u32 {
        let submesh = mesh.submesh(self.submesh[lane] as usize);
        let before = |s| batch::cells_before(&s, self.node[lane], self.primitive[lane]);
        submesh.map_or(0, before)
    }

    /// Takes over what the scalar locator found for a lane.
    fn set(&mut self, lane: usize, location: &Location) {
        let cell = &location.cell;
        self.found |= 1 << lane;
        self.submesh[lane] = cell.submesh;
        self.primitive[lane] = cell.index;
        self.cell_type[lane] = cell.cell_type as u8;
        self.others &= !(1 << lane);
        self.others |= u16::from(cell.cell_type != CellType::Tetrahedron) << lane;
        self.node[lane] = location.node;
        for corner in 0..MAX_CORNERS {
            self.corners[corner][lane] = cell.corners[corner];
            self.weights[corner][lane] = location.weights[corner] as f32;
        }
    }
}

/// What vectors need to know of a sub-mesh.
#[derive(Clone, Copy, Debug)]
struct Frame {
    /// Corner of its grid.
    base: [f32; 3],
    /// Sixteenths of a step of the grid per unit of length.
    sixteenths: [f32; 3],
    /// Bound on the rounding of scaled volumes in a leaf, per cubic sixteenth of its box.
    rounding: f32,
}

/// Sixteen boxes of sub-meshes: lower corners, then upper ones, axis by axis.
type Boxes = [[f32; LANES]; 6];

/// Finds the cells of sixteen places at once.
#[derive(Clone)]
pub struct BlockLocator<'a> {
    mesh: &'a PackedMesh,
    frames: Vec<Frame>,
    /// Of all sub-meshes, where they are few and each has its own tree.
    boxes: Option<Vec<Boxes>>,
    /// A power of two that makes the mesh about 1 in size.
    scale: f32,
    /// Whether vectors can be trusted with this mesh at all.
    is_tame: bool,
}

impl PackedMesh {
    /// Where positions of the first sub-mesh, and of all others unless a file says otherwise, are
    /// relative to.
    pub fn origin(&self) -> [f64; 3] {
        self.submeshes().first().map_or([0.0; 3], |s| s.origin)
    }

    /// A locator of sixteen places at once.
    pub fn block_locator(&self) -> BlockLocator<'_> {
        BlockLocator::new(self)
    }
}

impl<'a> BlockLocator<'a> {
    /// The most sub-meshes that are tried one by one instead of through a tree.
    const MAX_BOXES: usize = 256;

    /// Prepares a mesh: a few numbers a sub-mesh.
    pub fn new(mesh: &'a PackedMesh) -> Self {
        let origin = mesh.origin();
        let mut is_tame = true;
        let mut extent = 0f32;
        let mut lo = [f32::INFINITY; 3];
        let mut hi = [f32::NEG_INFINITY; 3];
        for header in mesh.submeshes() {
            for axis in 0..3 {
                lo[axis] = lo[axis].min(header.lo[axis]);
                hi[axis] = hi[axis].max(header.hi[axis]);
                let base = header.grid_base[axis];
                is_tame &= header.origin[axis] == origin[axis] && f64::from(base as f32) == base;
            }
        }
        for axis in 0..3 {
            is_tame &= lo[axis] >= -LARGEST && hi[axis] <= LARGEST;
            extent = extent.max(hi[axis] - lo[axis]);
        }
        let exponent = (-crate::grid::ceil_log2(f64::from(extent))).clamp(-100, 100);
        let scale = exp2(exponent);
        let frames = mesh.submeshes().iter().map(|header| {
            let e = header.grid_exponent;
            let cubic_sixteenth = exp2(e[0] - 4) * exp2(e[1] - 4) * exp2(e[2] - 4);
            Frame {
                base: header.grid_base.map(|b| b as f32),
                sixteenths: e.map(|e| exp2(4 - e) as f32),
                rounding: (tets::ROUNDING * cubic_sixteenth * scale.powi(3)) as f32,
            }
        });
        let few = mesh.submeshes().len() <= Self::MAX_BOXES;
        let boxes = (few && mesh.variant() == crate::Variant::MultiNodes).then(|| {
            let mut all = Vec::new();
            for sixteen in mesh.submeshes().chunks(LANES) {
                let mut boxes: Boxes = [[f32::NAN; LANES]; 6];
                for (i, header) in sixteen.iter().enumerate() {
                    for axis in 0..3 {
                        boxes[axis][i] = header.lo[axis];
                        boxes[3 + axis][i] = header.hi[axis];
                    }
                }
                all.push(boxes);
            }
            all
        });
        Self {
            mesh,
            frames: frames.collect(),
            boxes,
            scale: scale as f32,
            is_tame,
        }
    }

    /// The mesh.
    pub fn mesh(&self) -> &'a PackedMesh {
        self.mesh
    }

    /// The cells at the places of some lanes.
    pub fn locate(&self, at: &Places, lanes: u16) -> Located {
        dispatch(Locate {
            locator: self,
            at,
            lanes,
        })
    }

    /// As [`Self::locate`] on a given instruction set; the same answer on each.
    pub fn locate_at(&self, level: Level, at: &Places, lanes: u16) -> Located {
        let locate = Locate {
            locator: self,
            at,
            lanes,
        };
        dispatch_at(level, locate)
    }

    /// The answer of the scalar locator, for lanes that vectors cannot serve.
    #[cold]
    #[inline(never)]
    fn locate_one_by_one(&self, at: &Places, lanes: u16, out: &mut Located) {
        let mut locator = self.mesh.locator();
        for lane in (0..LANES).filter(|lane| lanes >> lane & 1 == 1) {
            out.found &= !(1 << lane);
            let place = [0, 1, 2].map(|axis| f64::from(at[axis][lane]));
            if let Some(location) = locator.locate_local(place) {
                out.set(lane, &location);
            }
        }
    }
}

/// Sixteen places through a mesh.
struct Locate<'a> {
    locator: &'a BlockLocator<'a>,
    at: &'a Places,
    lanes: u16,
}

impl Kernel for Locate<'_> {
    type Output = Located;

    #[inline(always)]
    fn run<S: Simd>(self) -> Located {
        let mut out = Located::default();
        self.locator.walk::<S>(self.at, self.lanes, &mut out);
        out
    }
}
