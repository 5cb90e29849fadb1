//! Values at many places at once, straight from the packed form.
//!
//! Up to 64 *packets* of places go through the trees together, each with the box around its places:
//! sixteen places that lie close together, as neighbouring samples of neighbouring rays do, or one
//! place of those that lie anywhere. A node is decoded once; the boxes of its children are tried on
//! sixteen boxes of packets at a time, and a bit a packet goes down with each. The cells of some
//! leaves are then set up, sixteen at a time, and each leaf is given its places, sixteen at a time:
//! tetrahedra are tried on them one after the other, other cells on sixteen pairs of cell and place.
//!
//! The answer is that of [`crate::Locator`], cell for cell: among several cells the one with the
//! lowest packed index, whatever the order of the search. Vectors compute in `f32` with a bound on
//! their rounding; where that leaves the slightest doubt (a place on a face, a flat cell, a map
//! that is nearly singular), the scalar code decides in `f64`. A value depends on the place and its
//! cell alone, not on what it was computed with. No last cell is remembered: it could answer only for
//! cells known not to overlap.
//!
//! Source: paper B, §5.2 to §5.6, one sample at a time on a GPU. Deviation: many at a time.

mod accepted;
mod clusters;
mod descend;
mod gradients;
mod maps;
mod others;
mod packets;
mod scattered;
mod tets;
mod trials;
mod values;
mod verdict;
mod walk;

use vacua_simd::{Kernel, LANES, Level, Simd, WideMap, dispatch_at};

use crate::field::PackedField;
use crate::grid::exp2;
use crate::packed::PackedMesh;

pub(crate) use descend::{child_boxes, nonzero_bytes, ordered_nibbles};
use packets::Packets;
use scattered::Curve;
use walk::Scratch;

/// A place a lane, axis by axis, relative to the mesh's origin (see [`PackedMesh::origin`]).
pub type Places = [[f32; LANES]; 3];

/// Coordinates up to which vectors compute; beyond, products could overflow.
const LARGEST: f32 = 1e30;
/// Indices of a sub-mesh up to which its primitives have numbers of 31 bits.
const MOST_INDICES: u64 = 1 << 30;
/// Corners of a cell at most.
const MAX_CORNERS: usize = 8;
/// Packets that go through the trees together.
const PACKETS: usize = 64;

/// How places that are sampled together lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// The sixteen of a vector lie close together, and so do neighbouring vectors.
    Compact,
    /// Anywhere.
    Scattered,
}

/// The cells of sixteen places. What belongs to lanes that are not in [`Located::found`] is void.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Located {
    /// The lanes whose place is in a cell.
    pub found: u16,
    /// The lanes whose cell is no tetrahedron.
    pub others: u16,
    /// Which sub-mesh.
    pub submesh: [u32; LANES],
    /// Which primitive there; see [`crate::PackedCell::index`].
    pub primitive: [u64; LANES],
}

/// Values at sixteen places.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sampled {
    /// The values; 0 where there is none.
    pub values: [f32; LANES],
    /// The lanes that have one: those in a cell all of whose values are finite.
    pub valid: u16,
    /// The cells.
    pub located: Located,
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

/// Gives the values of a field at many places at once.
#[derive(Clone)]
pub struct BlockSampler<'a> {
    mesh: &'a PackedMesh,
    field: &'a PackedField,
    map: Option<WideMap>,
    frames: Vec<Frame>,
    /// A power of two that makes the mesh about 1 in size.
    scale: f32,
    /// What scattered places are put in order along.
    curve: Curve,
    /// Whether vectors can be trusted with this mesh at all.
    is_tame: bool,
}

impl PackedMesh {
    /// Where positions of the first sub-mesh, and of all others unless a file says otherwise, are
    /// relative to.
    pub fn origin(&self) -> [f64; 3] {
        self.submeshes().first().map_or([0.0; 3], |s| s.origin)
    }
}

impl<'a> BlockSampler<'a> {
    /// Prepares a field of a mesh: a few numbers a sub-mesh. `map` says how stored values become
    /// those wanted.
    pub fn new(mesh: &'a PackedMesh, field: &'a PackedField, map: Option<WideMap>) -> Self {
        let origin = mesh.origin();
        let mut is_tame = true;
        let mut extent = 0f32;
        let mut lo = [f32::INFINITY; 3];
        let mut hi = [f32::NEG_INFINITY; 3];
        for header in mesh.submeshes() {
            is_tame &= header.num_indices < MOST_INDICES && header.total_cells() < MOST_INDICES;
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
        Self {
            mesh,
            field,
            map,
            frames: frames.collect(),
            scale: scale as f32,
            curve: Curve::new(lo, hi, mesh.num_cells()),
            is_tame,
        }
    }

    /// The mesh.
    pub fn mesh(&self) -> &'a PackedMesh {
        self.mesh
    }

    /// The values at the places of some lanes, wherever they lie.
    pub fn sample(&self, at: &Places, lanes: u16) -> Sampled {
        let mut sampled = [Sampled::default()];
        self.sample_all(Order::Scattered, &[*at], &[lanes], &mut sampled);
        sampled[0]
    }

    /// The values at the places of some lanes of many vectors, as many as the shortest list has.
    ///
    /// Cost: best asked for 64 compact vectors, or thousands of scattered places, at a time.
    pub fn sample_all(&self, order: Order, at: &[Places], lanes: &[u16], sampled: &mut [Sampled]) {
        self.sample_all_at(Level::best(), order, at, lanes, sampled);
    }

    /// As [`Self::sample_all`] on a given instruction set; the same answer on each.
    pub fn sample_all_at(
        &self,
        level: Level,
        order: Order,
        at: &[Places],
        lanes: &[u16],
        sampled: &mut [Sampled],
    ) {
        let sample = SampleAll {
            sampler: self,
            order,
            at,
            lanes,
            sampled,
        };
        dispatch_at(level, sample);
    }
}

/// Values at many places.
struct SampleAll<'a> {
    sampler: &'a BlockSampler<'a>,
    order: Order,
    at: &'a [Places],
    lanes: &'a [u16],
    sampled: &'a mut [Sampled],
}

impl Kernel for SampleAll<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        let Self {
            sampler,
            order,
            at,
            lanes,
            sampled,
        } = self;
        let len = at.len().min(lanes.len()).min(sampled.len());
        let (at, lanes, sampled) = (&at[..len], &lanes[..len], &mut sampled[..len]);
        let mut scratch = Scratch::take(sampler.mesh);
        match order {
            Order::Compact => sampler.sample_compact::<S>(at, lanes, sampled, &mut scratch),
            Order::Scattered => sampler.sample_scattered::<S>(at, lanes, sampled, &mut scratch),
        }
        scratch.put_back();
    }
}

impl BlockSampler<'_> {
    /// The values at places that lie close together.
    #[inline(always)]
    fn sample_compact<S: Simd>(
        &self,
        at: &[Places],
        lanes: &[u16],
        sampled: &mut [Sampled],
        scratch: &mut Scratch,
    ) {
        let chunks = at.chunks(PACKETS).zip(lanes.chunks(PACKETS));
        for ((at, lanes), sampled) in chunks.zip(sampled.chunks_mut(PACKETS)) {
            let mut live = [0; PACKETS];
            live[..lanes.len()].copy_from_slice(lanes);
            sampled.fill(Sampled::default());
            let mut packets = Packets::new(at, live);
            self.walk::<S>(&mut packets, Order::Compact, scratch, sampled);
        }
    }
}
