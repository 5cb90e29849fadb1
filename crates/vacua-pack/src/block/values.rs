//! Values of a field at the corners of cells.
//!
//! In `f32`, of values as rendering sees them ([`WideMap`]). What is interpolated is the first
//! corner's plus weighted differences to it, which keeps small signals on large offsets and constants
//! exact, and never outside the range of the corners' values, whatever the rounding.

use vacua_simd::{Float, LANES, Portable, Simd, Voxel, WideMap};
use vacua_volume::{Association, ScalarType, dispatch_scalar};

use super::{BlockSampler, MAX_CORNERS, Sampled};
use crate::field::PackedField;
use crate::layout::SubmeshHeader;
use crate::locate::Location;
use crate::packed::PackedMesh;
use crate::small::{FramedValues, block_of_cell, block_of_vertex};

/// Values of a field in a sub-mesh.
pub(super) enum Values<'a> {
    /// On points.
    Points(PointValues<'a>),
    /// On points, of one decoded cluster.
    Cluster(ClusterValues<'a>),
    /// On cells.
    Cells(CellValues<'a>),
}

/// Values on points.
pub(super) struct PointValues<'a> {
    scalar_type: ScalarType,
    bytes: &'a [u8],
    /// Where they are instead, in the variant `small`.
    framed: Option<&'a FramedValues>,
    map: Option<WideMap>,
}

/// Values at the vertices of a decoded cluster.
pub(super) struct ClusterValues<'a> {
    /// By vertex within the cluster.
    pub at_vertices: &'a [f32],
}

impl ClusterValues<'_> {
    /// Values at the corners of some cells of the cluster, corner by corner.
    #[inline(always)]
    pub fn at_corners<const CELLS: usize, const CORNERS: usize>(
        &self,
        corners: &[[u32; CELLS]; CORNERS],
        len: usize,
        found: &mut [[f32; CELLS]; CORNERS],
    ) {
        for k in 0..CORNERS {
            for (found, &corner) in found[k][..len.min(CELLS)].iter_mut().zip(&corners[k]) {
                let value = self.at_vertices.get(corner as usize);
                *found = value.copied().unwrap_or(f32::NAN);
            }
        }
    }
}

/// Values on cells of a sub-mesh.
pub(super) struct CellValues<'a> {
    mesh: &'a PackedMesh,
    field: &'a PackedField,
    map: Option<WideMap>,
    submesh: usize,
}

impl<'a> Values<'a> {
    pub fn new(
        mesh: &'a PackedMesh,
        field: &'a PackedField,
        map: Option<WideMap>,
        submesh: usize,
    ) -> Self {
        match field.association() {
            Association::Point => Self::Points(PointValues {
                scalar_type: field.values().scalar_type(),
                bytes: field.values().bytes(),
                framed: field.framed(),
                map,
            }),
            Association::Cell => Self::Cells(CellValues {
                mesh,
                field,
                map,
                submesh,
            }),
        }
    }
}

impl Values<'_> {
    /// Asks for the value at a vertex that will be read soon, if there are such.
    #[inline(always)]
    pub fn prefetch(&self, header: &SubmeshHeader, vertex: u32) {
        if let Self::Points(values) = self {
            let place = header.first_vertex.wrapping_add(u64::from(vertex)) as usize;
            let byte = place.wrapping_mul(values.scalar_type.size_bytes());
            vacua_simd::prefetch(values.bytes, byte);
        }
    }
}

impl PointValues<'_> {
    /// Values at the corners of some cells of a sub-mesh, corner by corner; NaN where a file has
    /// none.
    #[inline(always)]
    pub fn at_vertices<S: Simd, const CELLS: usize, const CORNERS: usize>(
        &self,
        header: &SubmeshHeader,
        corners: &[[u32; CELLS]; CORNERS],
        len: usize,
        found: &mut [[f32; CELLS]; CORNERS],
    ) {
        if let Some(framed) = self.framed {
            self.fetch_frames(framed, header, corners, len.min(CELLS), found);
            return;
        }
        let first = usize::try_from(header.first_vertex).unwrap_or(usize::MAX);
        if let (ScalarType::F32, None) = (self.scalar_type, self.map) {
            let values: &[f32] = bytemuck::cast_slice(self.bytes);
            gather::<S, CELLS, CORNERS>(values.get(first..).unwrap_or(&[]), corners, len, found);
            return;
        }
        dispatch_scalar!(self.scalar_type, T => {
            let values: &[T] = bytemuck::cast_slice(self.bytes);
            let values = values.get(first..).unwrap_or(&[]);
            self.fetch(values, corners, len.min(CELLS), found);
        });
    }

    /// As [`Self::at_vertices`] where values are in frames: for single cells, as clusters have theirs.
    #[cold]
    #[inline(never)]
    fn fetch_frames<const CELLS: usize, const CORNERS: usize>(
        &self,
        framed: &FramedValues,
        header: &SubmeshHeader,
        corners: &[[u32; CELLS]; CORNERS],
        len: usize,
        found: &mut [[f32; CELLS]; CORNERS],
    ) {
        dispatch_scalar!(framed.scalar_type(), T => {
            for k in 0..CORNERS {
                for (found, &corner) in found[k][..len].iter_mut().zip(&corners[k]) {
                    let value = framed.get::<T>(block_of_vertex(header, corner), corner as usize);
                    *found = value.map_or(f32::NAN, |v| v.rendered(self.map));
                }
            }
        });
    }

    #[inline(always)]
    fn fetch<T: Voxel, const CELLS: usize, const CORNERS: usize>(
        &self,
        values: &[T],
        corners: &[[u32; CELLS]; CORNERS],
        len: usize,
        found: &mut [[f32; CELLS]; CORNERS],
    ) {
        for k in 0..CORNERS {
            for (found, &corner) in found[k][..len].iter_mut().zip(&corners[k]) {
                let value = values.get(corner as usize);
                *found = value.map_or(f32::NAN, |v| v.rendered(self.map));
            }
        }
    }
}

/// Values at the corners of some cells as they are, sixteen at a time.
#[inline(always)]
fn gather<S: Simd, const CELLS: usize, const CORNERS: usize>(
    values: &[f32],
    corners: &[[u32; CELLS]; CORNERS],
    len: usize,
    found: &mut [[f32; CELLS]; CORNERS],
) {
    for k in 0..CORNERS {
        let (sixteens, rest) = corners[k].as_chunks::<LANES>();
        let (found_sixteens, found_rest) = found[k].as_chunks_mut::<LANES>();
        let needed = len.div_ceil(LANES);
        for (corners, found) in sixteens.iter().zip(found_sixteens).take(needed) {
            *found = S::gather_values(values, corners).to_array();
        }
        for (&corner, found) in rest.iter().zip(found_rest) {
            let value = values.get(corner as usize);
            *found = value.map_or(f32::NAN, |v| v.rendered(None));
        }
    }
}

impl CellValues<'_> {
    /// The value of a cell of a node; NaN where a file has none.
    pub fn at_cell(&self, node: u32, cell_in_node: u32) -> f32 {
        let values = self.field.values();
        let place = self
            .field
            .place_of_cell(self.mesh, self.submesh, node, cell_in_node);
        dispatch_scalar!(values.scalar_type(), T => {
            let values: &[T] = bytemuck::cast_slice(values.bytes());
            let value = match self.field.framed() {
                None => place.and_then(|place| values.get(place).copied()),
                // There, cells are numbered through the sub-mesh.
                Some(framed) => self.mesh.submeshes().get(self.submesh).and_then(|header| {
                    framed.get::<T>(block_of_cell(header, cell_in_node), cell_in_node as usize)
                }),
            };
            value.map_or(f32::NAN, |v| v.rendered(self.map))
        })
    }
}

impl BlockSampler<'_> {
    /// Values at the corners of a cell, as many as it has.
    pub(super) fn corner_values(&self, location: &Location) -> [f32; MAX_CORNERS] {
        let cell = &location.cell;
        let submesh = cell.submesh as usize;
        let mut found = [[f32::NAN]; MAX_CORNERS];
        match Values::new(self.mesh, self.field, self.map, submesh) {
            Values::Points(values) => {
                if let Some(header) = self.mesh.submeshes().get(submesh) {
                    let corners = cell.corners.map(|c| [c]);
                    values.at_vertices::<Portable, 1, MAX_CORNERS>(header, &corners, 1, &mut found);
                }
            }
            Values::Cluster(_) => {}
            Values::Cells(values) => {
                found = [[values.at_cell(location.node, location.cell_in_node)]; MAX_CORNERS];
            }
        }
        found.map(|[value]| value)
    }

    /// Takes over what the scalar locator found for a lane.
    pub(super) fn set(&self, location: &Location, lane: usize, sampled: &mut Sampled) {
        let cell = &location.cell;
        let located = &mut sampled.located;
        located.found |= 1 << lane;
        located.others |= u16::from(cell.cell_type != vacua_volume::CellType::Tetrahedron) << lane;
        located.submesh[lane] = cell.submesh;
        located.primitive[lane] = cell.index;
        let corners = self.corner_values(location);
        let corners = &corners[..cell.corners().len()];
        if !corners.iter().all(|v| v.is_finite()) {
            return;
        }
        let first = corners[0];
        let (mut value, mut least, mut largest) = (first, first, first);
        for (&corner, &weight) in corners.iter().zip(&location.weights).skip(1) {
            value = (weight as f32).mul_add(corner - first, value);
            (least, largest) = (least.min(corner), largest.max(corner));
        }
        sampled.valid |= 1 << lane;
        sampled.values[lane] = value.max(least).min(largest);
    }
}
