//! Finding the cell at a position, straight from the packed form.
//!
//! Of several cells that accept a position the one with the lowest packed index is the answer,
//! whatever the way through the trees: sub-mesh after sub-mesh, primitive after primitive.
//! This is the scalar twin that faster kernels are compared with.

use crate::Variant;
use crate::element::{Weights, weights_at};
use crate::layout::{CHILD_DIVISIONS, Child, WIDTH};
use crate::outer::OuterChild;
use crate::packed::{PackedCell, PackedMesh, Submesh};
use crate::small::{Cluster, ClusterCell, SubmeshClusters};

/// The cell at a position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Location {
    /// The cell.
    pub cell: PackedCell,
    /// Node of the sub-mesh that it is in.
    pub node: u32,
    /// How many cells of that node come before it; in variant `small`, of the sub-mesh.
    pub cell_in_node: u32,
    /// Weights of its corners.
    pub weights: Weights,
}

/// What locating has cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LocateCounters {
    /// Nodes of the outer tree visited.
    pub num_outer_nodes: u64,
    /// Nodes of sub-meshes visited.
    pub num_nodes: u64,
    /// Cells tested.
    pub num_cells: u64,
}

/// Finds cells, with the memory it needs for that.
pub struct Locator<'a> {
    mesh: &'a PackedMesh,
    origin: [f64; 3],
    outer_stack: Vec<u32>,
    items: Vec<u32>,
    stack: Vec<u32>,
    cluster: Cluster,
    counters: LocateCounters,
}

impl PackedMesh {
    /// A locator over this mesh.
    pub fn locator(&self) -> Locator<'_> {
        Locator {
            mesh: self,
            origin: self.submeshes().first().map_or([0.0; 3], |s| s.origin),
            outer_stack: Vec::new(),
            items: Vec::new(),
            stack: Vec::new(),
            cluster: Cluster::default(),
            counters: LocateCounters::default(),
        }
    }

    /// Which sub-mesh a node belongs to.
    pub(crate) fn submesh_of_node(&self, node: u64) -> Option<usize> {
        let after = self.submeshes().partition_point(|s| s.first_node <= node);
        after.checked_sub(1)
    }
}

impl Locator<'_> {
    /// What this locator has cost so far.
    pub fn counters(&self) -> LocateCounters {
        self.counters
    }

    /// The cell at a position in the world, if any accepts it.
    pub fn locate(&mut self, position_world: [f64; 3]) -> Option<Location> {
        self.locate_local(minus(position_world, self.origin))
    }

    /// The cell at a position relative to the mesh's origin (see [`PackedMesh::origin`]).
    pub fn locate_local(&mut self, position: [f64; 3]) -> Option<Location> {
        if self.mesh.outer().is_empty() || !position.iter().all(|c| c.is_finite()) {
            return None;
        }
        self.find_items(position);
        let mut best = None;
        let items = std::mem::take(&mut self.items);
        for &item in &items {
            self.visit_item(item, position, &mut best);
        }
        self.items = items;
        best
    }

    /// Collects the items of the outer tree whose boxes contain a position.
    fn find_items(&mut self, position: [f64; 3]) {
        self.items.clear();
        self.outer_stack.clear();
        self.outer_stack.push(0);
        while let Some(place) = self.outer_stack.pop() {
            let Some(node) = self.mesh.outer().get(place as usize) else {
                continue;
            };
            self.counters.num_outer_nodes += 1;
            node.children_at(position, |child| match child {
                // Children come after their parents, so that no walk is endless.
                OuterChild::Node(n) if n > place => self.outer_stack.push(n),
                OuterChild::Node(_) => {}
                OuterChild::Item(item) => self.items.push(item),
            });
        }
        self.items.sort_unstable();
    }

    fn visit_item(&mut self, item: u32, position: [f64; 3], best: &mut Option<Location>) {
        let (index, node) = match self.mesh.variant() {
            Variant::MultiNodes | Variant::Small => (Some(item as usize), 0),
            Variant::MultiLeaves => {
                let index = self.mesh.submesh_of_node(u64::from(item));
                let first = index.and_then(|i| self.mesh.submeshes().get(i));
                (index, first.map_or(0, |s| u64::from(item) - s.first_node))
            }
        };
        let Some((index, submesh)) = index.and_then(|i| Some((i, self.mesh.submesh(i)?))) else {
            return;
        };
        if best.is_some_and(|b| (b.cell.submesh as usize) < index) {
            return;
        }
        // Differences between origins, which all are the same unless a file says otherwise.
        let position = minus(position, minus(submesh.header.origin, self.origin));
        let sixteenths = submesh
            .grid
            .grid_from_local(position)
            .map(|g| g * f64::from(CHILD_DIVISIONS));
        self.stack.clear();
        self.stack.push(node as u32);
        while let Some(node) = self.stack.pop() {
            self.visit_node(&submesh, index as u32, node, position, sixteenths, best);
        }
    }

    fn visit_node(
        &mut self,
        submesh: &Submesh,
        submesh_index: u32,
        number: u32,
        position: [f64; 3],
        sixteenths: [f64; 3],
        best: &mut Option<Location>,
    ) {
        let Some((node, first_child)) = submesh.node(number) else {
            return;
        };
        self.counters.num_nodes += 1;
        let mut at = u64::from(node.first_index);
        let mut cells_before = 0;
        let mut next_child = first_child;
        for k in 0..WIDTH {
            let child = node.child(k);
            if child == Child::Absent {
                continue;
            }
            let (lo, hi) = node.child_box(k);
            let inside = (0..3).all(|axis| {
                f64::from(lo[axis]) <= sixteenths[axis] && sixteenths[axis] <= f64::from(hi[axis])
            });
            match child {
                Child::Absent => {}
                Child::Inner => {
                    if inside && next_child > number {
                        self.stack.push(next_child);
                    }
                    next_child = next_child.saturating_add(1);
                }
                Child::Leaf(counts) if submesh.clusters.is_some() => {
                    if inside {
                        self.visit_cluster(submesh, submesh_index, number, at, position, best);
                    }
                    at += counts.num_indices() as u64;
                }
                Child::Leaf(counts) => {
                    if inside {
                        let mut cell_in_node = cells_before;
                        submesh.cells_of_leaf(at, counts, |index, cell_type, corners| {
                            let cell = PackedCell {
                                submesh: submesh_index,
                                index,
                                cell_type,
                                corners,
                            };
                            self.counters.num_cells += 1;
                            offer(submesh, cell, number, cell_in_node, position, best);
                            cell_in_node += 1;
                        });
                    }
                    at += counts.num_indices() as u64;
                    cells_before += counts.num_cells() as u32;
                }
            }
        }
    }
}

impl Locator<'_> {
    /// Tests the cells of a cluster, leaf by leaf.
    fn visit_cluster(
        &mut self,
        submesh: &Submesh,
        submesh_index: u32,
        node: u32,
        first_index: u64,
        position: [f64; 3],
        best: &mut Option<Location>,
    ) {
        let Some(clusters) = &submesh.clusters else {
            return;
        };
        let cluster = &mut self.cluster;
        cluster.decode(
            submesh,
            clusters,
            SubmeshClusters::cluster_of_leaf(first_index),
        );
        let all = submesh.header.total_cells();
        for leaf in &cluster.leaves {
            let inside = (0..3).all(|axis| {
                f64::from(leaf.lo[axis]) <= position[axis]
                    && position[axis] <= f64::from(leaf.hi[axis])
            });
            let first = leaf.first_cell as usize;
            let num_cells = (leaf.num_tets + leaf.num_others) as usize;
            for i in (first..first + num_cells).filter(|_| inside) {
                self.counters.num_cells += 1;
                let index = cluster.index_of(i);
                let before =
                    best.is_some_and(|b| (b.cell.submesh, b.cell.index) <= (submesh_index, index));
                let ClusterCell { corners, cell_type } = cluster.cells[i];
                let positions = corners.map(|c| cluster.positions[usize::from(c)]);
                // No cell beyond those that the header counts has a value.
                if before || index / 2 >= all {
                    continue;
                }
                let Some(weights) = weights_at(cell_type, &positions, position) else {
                    continue;
                };
                *best = Some(Location {
                    cell: PackedCell {
                        submesh: submesh_index,
                        index,
                        cell_type,
                        corners: corners.map(|c| cluster.vertices[usize::from(c)]),
                    },
                    node,
                    cell_in_node: (index / 2) as u32,
                    weights,
                });
            }
        }
    }
}

/// Makes a cell the answer if it accepts the position and comes before the answer so far.
#[inline]
fn offer(
    submesh: &Submesh,
    cell: PackedCell,
    node: u32,
    cell_in_node: u32,
    position: [f64; 3],
    best: &mut Option<Location>,
) {
    let order = |c: &PackedCell| (c.submesh, c.index);
    if best.is_some_and(|b| order(&b.cell) <= order(&cell)) {
        return;
    }
    if let Some(corners) = submesh.corner_positions(&cell)
        && let Some(weights) = weights_at(cell.cell_type, &corners, position)
    {
        *best = Some(Location {
            cell,
            node,
            cell_in_node,
            weights,
        });
    }
}

#[inline(always)]
fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}
