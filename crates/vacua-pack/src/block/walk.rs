//! Packets through a mesh, sub-mesh after sub-mesh.

use std::cell::Cell;
use std::collections::VecDeque;

use vacua_simd::{Float, Int, LANES, Mask, Simd};

use crate::Variant;
use crate::layout::WIDTH;
use crate::packed::{PackedMesh, Submesh};
use crate::pairs::bits;
use crate::small::Cache;

use super::clusters::{Batches, Visited};
use super::descend::{Leaf, NodeLeaves, Visit, outer_items, visit_node};
use super::others::OtherBatch;
use super::packets::{InLeaves, NOT_FOUND, PacketBoxes, PacketMask, Packets, load, load_i};
use super::tets::TetBatch;
use super::values::Values;
use super::{BlockSampler, Order, Sampled};

/// Memory that a walk needs. What is in it says nothing from one walk to the next, but for decoded
/// clusters.
pub(super) struct Scratch {
    stack: VecDeque<Visit>,
    items: Vec<Visit>,
    tets: TetBatch,
    others: OtherBatch,
    in_leaves: InLeaves,
    leaves: NodeLeaves,
    /// Decoded clusters, for a mesh that has them.
    cache: Option<Box<Cache>>,
}

thread_local! {
    static SCRATCH: Cell<Option<Box<Scratch>>> = const { Cell::new(None) };
}

impl Scratch {
    fn new() -> Self {
        Self {
            cache: None,
            stack: VecDeque::new(),
            items: Vec::new(),
            tets: TetBatch::new(),
            others: OtherBatch::new(),
            in_leaves: InLeaves::new(),
            leaves: NodeLeaves {
                leaves: [Leaf::default(); WIDTH],
                len: 0,
            },
        }
    }

    /// This thread's, to be given back with [`Self::put_back`].
    pub fn take(mesh: &PackedMesh) -> Box<Self> {
        let mut scratch = SCRATCH.take().unwrap_or_else(|| Box::new(Self::new()));
        scratch.cache = mesh.clusters().map(|_| Cache::take());
        scratch
    }

    /// Leaves the memory for the next time.
    pub fn put_back(mut self: Box<Self>) {
        if let Some(cache) = self.cache.take() {
            cache.put_back();
        }
        SCRATCH.set(Some(self));
    }
}

impl BlockSampler<'_> {
    /// Finds the values at the live places.
    #[inline(always)]
    pub(super) fn walk<S: Simd>(
        &self,
        packets: &mut Packets,
        order: Order,
        scratch: &mut Scratch,
        sampled: &mut [Sampled],
    ) {
        let largest = S::F::splat(f32::MAX);
        for (at, live) in packets.at.iter().zip(&mut packets.live) {
            let finite = S::F::from_array(at[0]).abs().le(largest)
                & S::F::from_array(at[1]).abs().le(largest)
                & S::F::from_array(at[2]).abs().le(largest);
            *live &= finite.to_bits();
        }
        let mut mask = packets.mask();
        if mask == 0 || self.mesh.outer().is_empty() {
            return;
        }
        if !self.is_tame {
            self.sample_one_by_one(packets, sampled);
            return;
        }
        let boxes = packets.boxes::<S>();
        scratch.items.clear();
        scratch.stack.clear();
        outer_items::<S>(
            self.mesh.outer(),
            &boxes,
            mask,
            &mut scratch.stack,
            &mut scratch.items,
        );
        let mut next = 0;
        while next < scratch.items.len() && mask != 0 {
            let Some(number) = self.enter(&mut next, mask, scratch) else {
                continue;
            };
            let Some(submesh) = self.mesh.submesh(number) else {
                continue;
            };
            let there = self.visit_submesh::<S>(number, &submesh, &boxes, order, packets, scratch);
            // Boxes stay as they are, now too large for some packets, which is safe.
            mask &= !deliver::<S>(number, there, packets, sampled);
        }
    }

    /// Puts the nodes of the next sub-mesh among the items, with the packets that are to visit them,
    /// on the stack, and says which sub-mesh that is.
    #[inline(always)]
    fn enter(&self, next: &mut usize, mask: PacketMask, scratch: &mut Scratch) -> Option<usize> {
        scratch.stack.clear();
        let item = scratch.items[*next];
        *next += 1;
        if self.mesh.variant() != Variant::MultiLeaves {
            scratch.stack.push_back(Visit {
                number: 0,
                packets: item.packets & mask,
            });
            return Some(item.number as usize);
        }
        let number = self.mesh.submesh_of_node(u64::from(item.number))?;
        let nodes = self.mesh.submeshes()[number].nodes();
        let first = *next - 1;
        while scratch
            .items
            .get(*next)
            .is_some_and(|item| nodes.contains(&u64::from(item.number)))
        {
            *next += 1;
        }
        for item in scratch.items[first..*next].iter().rev() {
            scratch.stack.push_back(Visit {
                number: (u64::from(item.number) - nodes.start) as u32,
                packets: item.packets & mask,
            });
        }
        Some(number)
    }

    /// Finds the cells of a sub-mesh in which live places are; gives the packets that were there.
    #[inline(always)]
    fn visit_submesh<S: Simd>(
        &self,
        number: usize,
        submesh: &Submesh,
        boxes: &PacketBoxes,
        order: Order,
        packets: &mut Packets,
        scratch: &mut Scratch,
    ) -> PacketMask {
        let all = scratch
            .stack
            .iter()
            .fold(0, |all, visit| all | visit.packets);
        if all == 0 {
            return 0;
        }
        let frame = &self.frames[number];
        packets.enter::<S>(frame, all);
        let cells = &submesh.header.num_cells;
        packets.is_mixed = cells[0] > 0 && cells[1..].iter().any(|&n| n > 0);
        let boxes = boxes.in_sixteenths::<S>(frame);
        let values = Values::new(self.mesh, self.field, self.map, number);
        let Scratch {
            stack,
            tets,
            others,
            in_leaves,
            leaves,
            cache,
            ..
        } = scratch;
        // Depth first, or, where every node is likely to be far away, breadth first, so that it is
        // asked for long before it is visited.
        loop {
            let visit = match order {
                Order::Compact => stack.pop_back(),
                Order::Scattered => stack.pop_front(),
            };
            leaves.len = 0;
            if let Some(visit) = visit.filter(|visit| visit.packets != 0) {
                visit_node::<S>(submesh, &boxes, visit, stack, leaves);
            }
            if let (Some(clusters), Some(cache)) = (&submesh.clusters, cache.as_mut()) {
                for leaf in &leaves.leaves[..leaves.len] {
                    let visited = Visited {
                        number,
                        submesh,
                        clusters,
                        leaf,
                    };
                    let batches = Batches {
                        tets,
                        others,
                        in_leaves,
                    };
                    self.visit_cluster::<S>(&visited, &boxes, packets, batches, cache);
                }
                leaves.len = 0;
            }
            let is_last = stack.is_empty();
            let mut next = 0;
            loop {
                while let Some(leaf) = leaves.leaves[..leaves.len].get(next)
                    && tets.has_room(leaf)
                    && others.has_room(leaf)
                {
                    tets.add::<S>(leaf, self.scale, packets);
                    others.add(leaf);
                    next += 1;
                }
                let is_full = next < leaves.len;
                if is_full || is_last {
                    let is_far = order == Order::Scattered;
                    if tets.len > 0 {
                        tets.read(submesh, self.frames[number].rounding, &values, is_far);
                        self.test_tets::<S>(submesh, &values, tets, packets);
                    }
                    if others.len > 0 {
                        others.read(submesh, &values, is_far);
                        others.test::<S>(submesh, &values, packets, in_leaves);
                        others.clear();
                    }
                }
                if !is_full {
                    break;
                }
            }
            if is_last {
                return all;
            }
        }
    }

    /// Tries places on tetrahedra that have been read, and forgets those.
    #[inline(always)]
    pub(super) fn test_tets<S: Simd>(
        &self,
        submesh: &Submesh,
        values: &Values,
        tets: &mut TetBatch,
        packets: &mut Packets,
    ) {
        tets.set_up::<S>(submesh, self.scale, values);
        tets.test::<S>(submesh, packets);
        tets.clear();
    }

    /// The answer of the scalar locator, for meshes that vectors cannot serve.
    #[cold]
    #[inline(never)]
    fn sample_one_by_one(&self, packets: &Packets, sampled: &mut [Sampled]) {
        let mut locator = self.mesh.locator();
        for packet in bits(packets.mask()) {
            for lane in (0..LANES).filter(|lane| packets.live[packet] >> lane & 1 == 1) {
                let place = packets.place((packet * LANES + lane) as i32);
                let location = locator.locate_local(place.map(f64::from));
                if let (Some(location), Some(sampled)) = (location, sampled.get_mut(packet)) {
                    self.set(&location, lane, sampled);
                }
            }
        }
    }
}

/// Writes down what was found in a sub-mesh, and looks for that no longer; gives the packets of
/// which all was found.
#[inline(always)]
fn deliver<S: Simd>(
    number: usize,
    there: PacketMask,
    packets: &mut Packets,
    sampled: &mut [Sampled],
) -> PacketMask {
    let (not_found, finite) = (S::I::splat(NOT_FOUND), S::F::splat(f32::MAX));
    let mut done = 0;
    for packet in bits(there) {
        let primitive = load_i::<S>(&packets.primitive, packet * LANES);
        let found = packets.live[packet] & !primitive.eq(not_found).to_bits();
        packets.live[packet] &= !found;
        done |= PacketMask::from(packets.live[packet] == 0) << packet;
        let Some(sampled) = sampled.get_mut(packet).filter(|_| found != 0) else {
            continue;
        };
        let value = load::<S>(&packets.value, packet * LANES);
        let valid = S::M::from_bits(found) & value.abs().le(finite);
        let values = value.select(valid, S::F::from_array(sampled.values));
        sampled.values = values.to_array();
        sampled.valid |= valid.to_bits();
        let located = &mut sampled.located;
        let primitive = primitive.to_array();
        let kept = located.found;
        for lane in 0..LANES {
            // Of lanes in neither nothing is said.
            let is_kept = kept >> lane & 1 == 1;
            let (submesh, primitive) = (number as u32, u64::from(primitive[lane] as u32));
            located.submesh[lane] = if is_kept {
                located.submesh[lane]
            } else {
                submesh
            };
            located.primitive[lane] = if is_kept {
                located.primitive[lane]
            } else {
                primitive
            };
        }
        located.found |= found;
        located.others |= packets.others[packet] & found;
    }
    done
}
