//! Clusters of the variant `small`: decoded whole, kept by the thread, then tested leaf by leaf by
//! what tests leaves of the other variants, whose answers depend on place and cell alone.

use vacua_simd::{LANES, Simd, WideMap, per_axis};
use vacua_volume::{Association, dispatch_scalar};

use super::descend::{Leaf, meeting};
use super::others::OtherBatch;
use super::packets::{InLeaves, PacketBoxes, Packets};
use super::tets::{SLOTS, TetBatch};
use super::values::{ClusterValues, Values};
use super::{BlockSampler, Frame};
use crate::field::PackedField;
use crate::packed::Submesh;
use crate::small::{Cache, Cluster, ClusterLeaf, SubmeshClusters, block_of_vertex};

/// Bits of a leaf's counts that are of tetrahedra and pairs.
const COUNTS_OF_TETS: u8 = 0x3F;

/// A cluster to be tested, and where in its sub-mesh.
pub(super) struct Visited<'a> {
    pub number: usize,
    pub submesh: &'a Submesh<'a>,
    pub clusters: &'a SubmeshClusters<'a>,
    /// The leaf of the tree that it is.
    pub leaf: &'a Leaf,
}

/// Memory that testing needs.
pub(super) struct Batches<'a> {
    pub tets: &'a mut TetBatch,
    pub others: &'a mut OtherBatch,
    pub in_leaves: &'a mut InLeaves,
}

impl BlockSampler<'_> {
    /// Finds the cells of a cluster in which live places are.
    #[inline(always)]
    pub(super) fn visit_cluster<S: Simd>(
        &self,
        visited: &Visited,
        boxes: &PacketBoxes,
        packets: &mut Packets,
        batches: Batches,
        cache: &mut Cache,
    ) {
        let Visited {
            number,
            submesh,
            clusters,
            leaf,
        } = *visited;
        let place = SubmeshClusters::cluster_of_leaf(u64::from(leaf.first_index));
        let map = self.map.map(|m| [m.offset.to_bits(), m.factor.to_bits()]);
        let key = (self.field.framed().map_or(0, |f| f.id), map);
        let (cluster, at_vertices) = cache.get(submesh, clusters, place, key, |cluster, found| {
            values_at_vertices(self.field, self.map, submesh, cluster, found);
        });
        let values = match self.field.association() {
            Association::Point => Values::Cluster(ClusterValues { at_vertices }),
            Association::Cell => Values::new(self.mesh, self.field, self.map, number),
        };
        let local = &submesh.with_cluster(cluster);
        let frame = &self.frames[number];
        let Batches {
            tets,
            others,
            in_leaves,
        } = batches;
        let mut next = 0;
        loop {
            let found = cluster.leaves.get(next);
            let (num_tets, num_others) = found.map_or((SLOTS, LANES), |f| {
                (f.num_tets as usize, f.num_others as usize)
            });
            // In one place: what tests is long.
            if tets.len > 0 && (tets.len + num_tets > SLOTS || !tets.places.has_room()) {
                tets.read(local, frame.rounding, &values, false);
                self.test_tets::<S>(local, &values, tets, packets);
            }
            if others.len > 0 && others.len + num_others > LANES {
                others.test::<S>(local, &values, packets, in_leaves);
                others.clear();
            }
            let Some(found) = found else {
                return;
            };
            next += 1;
            let mut part = leaf_of(frame, cluster, found, leaf);
            let turned_hi = per_axis!(a => -part.hi[a]);
            part.packets = meeting::<S>(boxes, leaf.packets, part.lo, turned_hi);
            if part.packets == 0 {
                continue;
            }
            let first = found.first_cell as usize;
            if num_tets > 0 {
                part.counts = found.counts & COUNTS_OF_TETS;
                tets.add::<S>(&part, self.scale, packets);
            }
            if num_others > 0 {
                part.counts = found.counts & !COUNTS_OF_TETS;
                part.first_index = part.first_index.saturating_add(found.num_tets);
                part.cells_before = part.first_index;
                let first = first + num_tets;
                let cells = cluster.cells.get(first..first + num_others);
                others.add_cells(cells.unwrap_or(&[]), &part);
            }
        }
    }
}

/// A leaf of a cluster as a leaf of the tree: its box in sixteenths (rounding is monotone), and cells
/// of the sub-mesh where others count indices.
#[inline(always)]
fn leaf_of(frame: &Frame, cluster: &Cluster, found: &ClusterLeaf, whole: &Leaf) -> Leaf {
    let lo = per_axis!(a => (found.lo[a] - frame.base[a]) * frame.sixteenths[a]);
    let hi = per_axis!(a => (found.hi[a] - frame.base[a]) * frame.sixteenths[a]);
    // A sixteenth for the rounding of each corner, and one a side.
    let side = per_axis!(a => hi[a] - lo[a] + 3.0);
    let first_cell = cluster.first_cell.saturating_add(found.first_cell);
    Leaf {
        packets: 0,
        lo,
        hi,
        volume: side[0] * side[1] * side[2],
        first_index: first_cell,
        node: whole.node,
        cells_before: first_cell,
        counts: found.counts,
    }
}

/// Values at the vertices of a cluster, as rendering sees them; NaN where a file has none.
#[inline(never)]
fn values_at_vertices(
    field: &PackedField,
    map: Option<WideMap>,
    submesh: &Submesh,
    cluster: &Cluster,
    found: &mut Vec<f32>,
) {
    found.clear();
    let Some(framed) = field
        .framed()
        .filter(|_| field.association() == Association::Point)
    else {
        return;
    };
    dispatch_scalar!(framed.scalar_type(), T => {
        let value = |&vertex: &u32| {
            let block = block_of_vertex(submesh.header, vertex);
            let value = framed.get::<T>(block, vertex as usize);
            value.map_or(f32::NAN, |v| vacua_simd::Voxel::rendered(v, map))
        };
        found.extend(cluster.vertices[..cluster.num_vertices].iter().map(value));
    });
    found.resize(cluster.vertices.len(), f32::NAN);
}
