//! Fields on a packed mesh: values in packed order in their native type, and conservative ranges of
//! sub-meshes, nodes and leaves, kept apart from the geometry.
//!
//! Source: paper B, §5.8.
//! Deviation: ranges are quantised, outward, to 8 bits within the sub-mesh's; a node's own range is
//! the union of its children's and not stored again.
//!
//! ```text
//! a sub-mesh's range:  lo f64, hi f64; lo > hi without any finite value
//! a node's ranges:     8 × (lo u8, hi u8), by child, leaf or inner; lo > hi where there is none
//! ```

mod all;
mod part;
mod span;

pub(crate) use part::{FieldPart, cells_before};

use part::{Scratch, find_ranges};
use rayon::prelude::*;
use vacua_volume::{Association, DataArray, Scalar, ValueRange, dispatch_scalar};

use crate::element::interpolate;
use crate::encode::PackMap;
use crate::ids::Order;
use crate::layout::{Child, SubmeshHeader, WIDTH};
use crate::locate::Location;
use crate::packed::{PackedMesh, Submesh};
use crate::section::Flat;
use crate::small::{Cluster, FramedValues, SubmeshClusters, block_of_cell, block_of_vertex};

/// A child without any finite value: no range.
const NO_RANGE: [u8; 2] = [u8::MAX, 0];
/// Steps of a sub-mesh's range.
const STEPS: f64 = u8::MAX as f64;

/// Why values do not make a field of a packed mesh.
#[derive(Clone, Debug, thiserror::Error, PartialEq, Eq)]
pub enum PackFieldError {
    /// More than one component.
    #[error("field `{name}` has {components} components, a packed field has one")]
    Components {
        /// Name of the field.
        name: String,
        /// Its components.
        components: usize,
    },
    /// Fewer values than the mesh's points or cells reach.
    #[error(
        "field `{name}` has {actual} values, the mesh's {association}s need at least {}: the field is of another mesh",
        .needed.saturating_add(1)
    )]
    TooShort {
        /// Name of the field.
        name: String,
        /// Points or cells.
        association: Association,
        /// Values given.
        actual: usize,
        /// The largest number of a point or cell, from 0.
        needed: u64,
    },
    /// A map of another mesh.
    #[error("the map is of {actual} {association}s, the packed mesh has {expected}")]
    MapLength {
        /// Points or cells.
        association: Association,
        /// Length of the map.
        actual: usize,
        /// Vertices or cells of the packed mesh.
        expected: u64,
    },
}

/// A scalar field in packed order. Clones share the values.
#[derive(Clone)]
pub struct PackedField {
    pub(crate) name: String,
    pub(crate) association: Association,
    /// Empty where the values are in frames.
    pub(crate) values: DataArray,
    /// The values, for a mesh of variant `small`.
    pub(crate) framed: Option<FramedValues>,
    pub(crate) submesh_ranges: Flat<[f64; 2]>,
    pub(crate) node_ranges: Flat<[[u8; 2]; WIDTH]>,
    /// Cells of the sub-mesh before each node; fields on cells only.
    pub(crate) cells_before: Option<Flat<u32>>,
}

/// Bytes of every part of a packed field.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct FieldBytes {
    /// Values.
    pub values: usize,
    /// Ranges of sub-meshes and nodes.
    pub ranges: usize,
    /// Where nodes' cells start, for fields on cells.
    pub cells_before: usize,
}

impl PackedField {
    /// Brings values of the original mesh into packed order and finds their ranges.
    ///
    /// # Errors
    /// [`PackFieldError`] if values or map do not fit the mesh.
    pub fn pack(
        mesh: &PackedMesh,
        map: &PackMap,
        name: &str,
        association: Association,
        values: &DataArray,
    ) -> Result<Self, PackFieldError> {
        let ids = match association {
            Association::Point => &map.points,
            Association::Cell => &map.cells,
        };
        Self::pack_in_order(mesh, &Order::List(ids), name, association, values)
    }

    /// As [`Self::pack`], with the numbers of points or cells alone.
    pub(crate) fn pack_in_order(
        mesh: &PackedMesh,
        order: &Order,
        name: &str,
        association: Association,
        values: &DataArray,
    ) -> Result<Self, PackFieldError> {
        if values.components() != 1 {
            return Err(PackFieldError::Components {
                name: name.to_owned(),
                components: values.components(),
            });
        }
        let expected = match association {
            Association::Point => mesh.num_vertices() as u64,
            Association::Cell => mesh.num_cells(),
        };
        if order.len() as u64 != expected {
            return Err(PackFieldError::MapLength {
                association,
                actual: order.len(),
                expected,
            });
        }
        let packed = dispatch_scalar!(values.scalar_type(), T => {
            pack_parts::<T>(mesh, order, association, bytemuck::cast_slice(values.bytes()))
        });
        let (packed, submesh_ranges, node_ranges) =
            packed.map_err(|_| PackFieldError::TooShort {
                name: name.to_owned(),
                association,
                actual: values.tuples(),
                needed: order.largest(),
            })?;
        let needs_places = association == Association::Cell && mesh.clusters().is_none();
        let cells_before = needs_places.then(|| Flat::from_vec(count_cells_before(mesh)));
        let framed = mesh.clusters().map(|_| {
            let runs = mesh.submeshes().iter().map(|header| match association {
                Association::Point => header.num_vertices as usize,
                Association::Cell => header.total_cells() as usize,
            });
            FramedValues::pack(&packed, runs)
        });
        let values = match &framed {
            None => packed,
            // An array of nothing is always one.
            Some(framed) => framed.no_values().unwrap_or(packed),
        };
        Ok(Self {
            name: name.to_owned(),
            association,
            values,
            framed,
            submesh_ranges: Flat::from_vec(submesh_ranges),
            node_ranges: Flat::from_vec(node_ranges),
            cells_before,
        })
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// On points or on cells.
    pub fn association(&self) -> Association {
        self.association
    }

    /// Values in packed order; none in variant `small`, see [`Self::framed`].
    pub fn values(&self) -> &DataArray {
        &self.values
    }

    /// The values of a field on a mesh of variant `small`.
    pub fn framed(&self) -> Option<&FramedValues> {
        self.framed.as_ref()
    }

    /// The value at a vertex of a sub-mesh, for fields on points.
    pub fn point_value(&self, header: &SubmeshHeader, vertex: u32) -> Option<f64> {
        match &self.framed {
            Some(framed) => framed.get_f64(block_of_vertex(header, vertex), vertex as usize),
            None => self.flat_value(header.first_vertex.checked_add(u64::from(vertex))?),
        }
    }

    /// The value of a cell by its number in a sub-mesh, in packed order, for fields on cells.
    pub fn cell_value(&self, header: &SubmeshHeader, cell: u32) -> Option<f64> {
        match &self.framed {
            Some(framed) => framed.get_f64(block_of_cell(header, cell), cell as usize),
            None => self.flat_value(header.first_cell.checked_add(u64::from(cell))?),
        }
    }

    fn flat_value(&self, place: u64) -> Option<f64> {
        let place = usize::try_from(place).ok()?;
        (place < self.values.tuples()).then(|| self.values.get_f64(place, 0))
    }

    /// For each node the cells of its sub-mesh in nodes before it; only for fields on cells.
    pub fn cells_before(&self) -> Option<&[u32]> {
        self.cells_before.as_ref().map(Flat::as_slice)
    }

    /// Bytes of every part.
    pub fn bytes(&self) -> FieldBytes {
        FieldBytes {
            values: match &self.framed {
                None => self.values.bytes().len(),
                Some(framed) => framed.num_bytes(),
            },
            ranges: self.submesh_ranges.num_bytes() + self.node_ranges.num_bytes(),
            cells_before: self.cells_before.as_ref().map_or(0, Flat::num_bytes),
        }
    }

    /// The range of a sub-mesh's finite values; `None` without any.
    pub fn submesh_range(&self, submesh: usize) -> Option<ValueRange> {
        let &[lo, hi] = self.submesh_ranges.as_slice().get(submesh)?;
        (lo <= hi).then_some(ValueRange { lo, hi })
    }

    /// A range that contains all that interpolation gives in a child of a node; `None` if that is
    /// nothing.
    pub fn child_range(
        &self,
        mesh: &PackedMesh,
        submesh: usize,
        node: u32,
        child: usize,
    ) -> Option<ValueRange> {
        let whole = self.submesh_range(submesh)?;
        let slots = self.slots(mesh, submesh, node)?;
        decode_range(whole, *slots.get(child)?)
    }

    /// As [`Self::child_range`] for all children of a node together.
    pub fn node_range(&self, mesh: &PackedMesh, submesh: usize, node: u32) -> Option<ValueRange> {
        let whole = self.submesh_range(submesh)?;
        let slots = self.slots(mesh, submesh, node)?;
        decode_range(whole, union(slots))
    }

    /// Calls `visit` with the box of every leaf of a sub-mesh, relative to its origin, and a range that
    /// contains all that interpolation gives there; leaves without any value are left out.
    ///
    /// Cost: in variant `small` leaves have no ranges of their own; all clusters are decoded.
    pub fn leaf_ranges(
        &self,
        mesh: &PackedMesh,
        submesh: usize,
        mut visit: impl FnMut([[f64; 3]; 2], ValueRange),
    ) {
        let Some(parts) = mesh.submesh(submesh) else {
            return;
        };
        if let Some(clusters) = &parts.clusters {
            return self.cluster_leaf_ranges(&parts, clusters, visit);
        }
        for number in 0..parts.header.num_nodes {
            let Some((node, _)) = parts.node(number) else {
                continue;
            };
            for child in (0..WIDTH).filter(|&c| matches!(node.child(c), Child::Leaf(_))) {
                if let Some(range) = self.child_range(mesh, submesh, number, child) {
                    let (lo, hi) = node.child_box(child);
                    let at = |place| parts.grid.local_from_sixteenths(place);
                    visit([at(lo), at(hi)], range);
                }
            }
        }
    }

    fn cluster_leaf_ranges(
        &self,
        submesh: &Submesh,
        clusters: &SubmeshClusters,
        mut visit: impl FnMut([[f64; 3]; 2], ValueRange),
    ) {
        let header = submesh.header;
        let one = |v: Option<f64>| {
            let v = v.filter(|v| v.is_finite())?;
            Some(ValueRange { lo: v, hi: v })
        };
        let mut cluster = Cluster::default();
        let mut at_vertices = Vec::new();
        for number in 0..clusters.len() {
            cluster.decode(submesh, clusters, number);
            at_vertices.clear();
            if self.association == Association::Point {
                let values = cluster.vertices.iter();
                at_vertices.extend(values.map(|&v| one(self.point_value(header, v))));
            }
            for leaf in &cluster.leaves {
                let first = leaf.first_cell as usize;
                let mut range = None;
                for i in first..first + (leaf.num_tets + leaf.num_others) as usize {
                    let of_cell = match self.association {
                        Association::Point => {
                            let cell = &cluster.cells[i];
                            let corners = cell.corners[..cell.cell_type.num_points()].iter();
                            let values = corners.map(|&c| at_vertices[usize::from(c)]);
                            values.fold(None, join)
                        }
                        Association::Cell => {
                            one(self.cell_value(header, (cluster.index_of(i) / 2) as u32))
                        }
                    };
                    range = join(range, of_cell);
                }
                if let Some(range) = range {
                    visit([leaf.lo.map(f64::from), leaf.hi.map(f64::from)], range);
                }
            }
        }
    }

    /// The ranges of a node's children in steps of the sub-mesh's.
    pub(crate) fn slots(
        &self,
        mesh: &PackedMesh,
        submesh: usize,
        node: u32,
    ) -> Option<&[[u8; 2]; WIDTH]> {
        let header = mesh.submeshes().get(submesh)?;
        let place = header.first_node.checked_add(u64::from(node))?;
        self.node_ranges
            .as_slice()
            .get(usize::try_from(place).ok()?)
    }

    /// The value at a location; `None` if a value of the cell is no finite number.
    pub fn value_at(&self, mesh: &PackedMesh, location: &Location) -> Option<f64> {
        let cell = &location.cell;
        let header = mesh.submeshes().get(cell.submesh as usize)?;
        match self.association {
            Association::Point => {
                let mut values = [0.0; 8];
                for (value, &corner) in values.iter_mut().zip(cell.corners()) {
                    *value = self.point_value(header, corner)?;
                }
                interpolate(&location.weights, &values[..cell.corners().len()])
            }
            Association::Cell => {
                let value = if self.framed.is_some() {
                    // There, cells are numbered through the sub-mesh.
                    self.cell_value(header, location.cell_in_node)
                } else {
                    let submesh = cell.submesh as usize;
                    let (node, cell) = (location.node, location.cell_in_node);
                    self.flat_value(self.place_of_cell(mesh, submesh, node, cell)? as u64)
                };
                value.filter(|v| v.is_finite())
            }
        }
    }

    /// Where the value of a cell is, for fields on cells.
    #[inline]
    pub(crate) fn place_of_cell(
        &self,
        mesh: &PackedMesh,
        submesh: usize,
        node: u32,
        cell_in_node: u32,
    ) -> Option<usize> {
        let header = mesh.submeshes().get(submesh)?;
        let node = usize::try_from(header.first_node.checked_add(u64::from(node))?).ok()?;
        let before = *self.cells_before.as_ref()?.as_slice().get(node)?;
        let cell = u64::from(before) + u64::from(cell_in_node);
        usize::try_from(header.first_cell.checked_add(cell)?).ok()
    }
}

fn join(a: Option<ValueRange>, b: Option<ValueRange>) -> Option<ValueRange> {
    match (a, b) {
        (Some(a), Some(b)) => Some(a.union(b)),
        (a, b) => a.or(b),
    }
}

/// The smallest slot that contains all of them.
fn union(slots: &[[u8; 2]; WIDTH]) -> [u8; 2] {
    let all = slots.iter();
    all.fold(NO_RANGE, |a, b| [a[0].min(b[0]), a[1].max(b[1])])
}

/// The value of a step of a sub-mesh's range.
pub(crate) fn decode_step(whole: ValueRange, step: u8) -> f64 {
    match step {
        0 => whole.lo,
        u8::MAX => whole.hi,
        _ => {
            let t = f64::from(step) / STEPS;
            (whole.lo * (1.0 - t) + whole.hi * t).clamp(whole.lo, whole.hi)
        }
    }
}

/// The range of a slot; `None` if it contains nothing.
pub(crate) fn decode_range(whole: ValueRange, [lo, hi]: [u8; 2]) -> Option<ValueRange> {
    (lo <= hi).then(|| ValueRange {
        lo: decode_step(whole, lo),
        hi: decode_step(whole, hi),
    })
}

/// For every node the number of cells of its sub-mesh in nodes before it.
fn count_cells_before(mesh: &PackedMesh) -> Vec<u32> {
    let submeshes = (0..mesh.submeshes().len()).into_par_iter();
    let parts: Vec<Vec<u32>> = submeshes
        .map(|s| mesh.submesh(s).map_or(Vec::new(), |s| cells_before(&s)))
        .collect();
    parts.concat()
}

/// Values in packed order, and ranges of sub-meshes and nodes.
type Packed = (DataArray, Vec<[f64; 2]>, Vec<[[u8; 2]; WIDTH]>);

/// Brings values into packed order, sub-mesh by sub-mesh in parallel, and finds their ranges.
///
/// # Errors
/// A number in the list that no value has.
fn pack_parts<T: Scalar>(
    mesh: &PackedMesh,
    order: &Order,
    association: Association,
    all: &[T],
) -> Result<Packed, u64> {
    struct Part<'a, T> {
        submesh: Submesh<'a>,
        first: usize,
        values: &'a mut [T],
        slots: &'a mut [[[u8; 2]; WIDTH]],
    }
    let mut values = vec![T::zeroed(); order.len()];
    let mut slots = vec![[NO_RANGE; WIDTH]; mesh.nodes().len()];
    let mut parts = Vec::with_capacity(mesh.submeshes().len());
    let (mut first, mut values_left, mut slots_left) = (0, &mut values[..], &mut slots[..]);
    for number in 0..mesh.submeshes().len() {
        let Some(submesh) = mesh.submesh(number) else {
            continue;
        };
        let header = submesh.header;
        let len = match association {
            Association::Point => u64::from(header.num_vertices),
            Association::Cell => header.total_cells(),
        };
        // Sub-meshes follow each other; no more than there is.
        let len = usize::try_from(len)
            .unwrap_or(usize::MAX)
            .min(values_left.len());
        let num_nodes = (header.num_nodes as usize).min(slots_left.len());
        let (own, rest) = std::mem::take(&mut values_left).split_at_mut(len);
        values_left = rest;
        let (own_slots, rest) = std::mem::take(&mut slots_left).split_at_mut(num_nodes);
        slots_left = rest;
        parts.push(Part {
            submesh,
            first,
            values: own,
            slots: own_slots,
        });
        first += len;
    }
    let ends: Result<Vec<[f64; 2]>, u64> = parts
        .into_par_iter()
        .map_init(Scratch::default, |scratch, part| {
            let Part {
                submesh, values, ..
            } = part;
            order.pick(part.first, all, values)?;
            Ok(find_ranges(
                &submesh,
                association,
                values,
                part.slots,
                scratch,
            ))
        })
        .collect();
    let ends = ends?;
    let values = DataArray::from_vec(values, 1).expect("one column divides any length");
    Ok((values, ends, slots))
}
