//! Decoded clusters that a thread keeps.

use std::cell::Cell;

use super::{Cluster, SubmeshClusters};
use crate::packed::Submesh;

/// Clusters kept, a power of two: about a mebibyte.
const SLOTS: usize = 256;

/// Which cluster is in a slot: mesh, sub-mesh by its first cell, cluster; and whose values.
type Key = (u64, u64, usize, ValuesKey);

/// Whose values are kept: field, and how they become those wanted.
pub type ValuesKey = (u64, Option<[u64; 2]>);

#[derive(Default)]
struct Slot {
    key: Option<Key>,
    cluster: Cluster,
    values: Vec<f32>,
}

/// Decoded clusters, each in the one slot that its number gives it.
pub struct Cache {
    slots: Vec<Slot>,
}

thread_local! {
    static CACHE: Cell<Option<Box<Cache>>> = const { Cell::new(None) };
}

impl Cache {
    /// This thread's, to be given back with [`Self::put_back`].
    pub fn take() -> Box<Self> {
        CACHE.take().unwrap_or_else(|| {
            let mut slots = Vec::new();
            slots.resize_with(SLOTS, Slot::default);
            Box::new(Self { slots })
        })
    }

    /// Leaves the clusters for the next time.
    pub fn put_back(self: Box<Self>) {
        CACHE.set(Some(self));
    }

    /// A cluster and the values at its vertices, decoded unless they are there.
    #[inline(always)]
    pub fn get(
        &mut self,
        submesh: &Submesh,
        clusters: &SubmeshClusters,
        number: usize,
        values: ValuesKey,
        fetch: impl FnOnce(&Cluster, &mut Vec<f32>),
    ) -> (&Cluster, &[f32]) {
        let key = (clusters.id, submesh.header.first_cell, number, values);
        let mixed = (submesh.header.first_cell ^ clusters.id.rotate_left(32))
            .wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let place = ((mixed >> 40) as usize).wrapping_add(number) % SLOTS;
        let slot = &mut self.slots[place];
        if slot.key != Some(key) {
            slot.key = Some(key);
            slot.cluster.decode(submesh, clusters, number);
            fetch(&slot.cluster, &mut slot.values);
        }
        (&slot.cluster, &slot.values)
    }
}
