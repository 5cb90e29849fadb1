//! What the walk through the tree leaves to be tested: leaves with the lanes that fall into them, and
//! sixteen of their cells at a time.

use vacua_simd::LANES;

use crate::layout::{LeafCounts, OTHER_INDICES, PAIR_INDICES, TET_INDICES};
use crate::packed::Submesh;
use crate::pairs::tets_of;

use super::{Located, MAX_CORNERS};

/// A leaf that some lanes fall into.
#[derive(Clone, Copy, Default)]
pub(super) struct Leaf {
    /// Where its primitives start among the sub-mesh's indices.
    pub first_index: u32,
    /// The node it is in.
    pub node: u32,
    /// Cells of the node before it.
    pub cells_before: u16,
    /// The lanes.
    pub lanes: u16,
    /// Its counts.
    pub counts: u8,
    /// Volume of its box in cubic sixteenths, widened by a sixteenth a side.
    pub volume: f32,
}

/// Up to sixteen cells of up to `N` corners.
pub(super) struct Batch<const N: usize> {
    /// How many there are.
    pub len: usize,
    /// Vertices within the sub-mesh; 0 past the end.
    pub corners: [[u32; LANES]; N],
    /// Which primitive each is.
    pub primitive: [u64; LANES],
    /// Its place among the cells of its node.
    pub cell_in_node: [u32; LANES],
    /// The leaf each is of.
    pub leaf: [u8; LANES],
    /// The kind of each, by number.
    pub cell_type: [u8; LANES],
    /// Volume of the leaf's box.
    pub volume: [f32; LANES],
    /// For each lane the cells that it may be in.
    pub candidates: [u16; LANES],
    /// The lanes that have any.
    pub lanes: u16,
}

impl<const N: usize> Batch<N> {
    #[inline(always)]
    pub fn new() -> Self {
        Self {
            len: 0,
            corners: [[0; LANES]; N],
            primitive: [0; LANES],
            cell_in_node: [0; LANES],
            leaf: [0; LANES],
            cell_type: [0; LANES],
            volume: [0.0; LANES],
            candidates: [0; LANES],
            lanes: 0,
        }
    }

    /// Makes room; what was there before stays in memory, which harms nothing.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.len = 0;
        self.candidates = [0; LANES];
        self.lanes = 0;
    }

    /// Makes cells from slot `from` on candidates of some lanes.
    #[inline(always)]
    pub fn offer(&mut self, from: usize, lanes: u16) {
        let slots = (u32::MAX << from) as u16 & ((1u32 << self.len) - 1) as u16;
        if slots == 0 {
            return;
        }
        self.lanes |= lanes;
        let mut left = lanes;
        while left != 0 {
            let lane = left.trailing_zeros() as usize;
            left &= left - 1;
            self.candidates[lane] |= slots;
        }
    }

    /// The lanes of `lanes` whose answer so far does not come before a primitive.
    #[inline(always)]
    pub fn open(out: &Located, lanes: u16, first_primitive: u64) -> u16 {
        let mut open = lanes & !out.found;
        let mut left = lanes & out.found;
        while left != 0 {
            let lane = left.trailing_zeros() as usize;
            left &= left - 1;
            open |= u16::from(out.primitive[lane] > first_primitive) << lane;
        }
        open
    }
}

/// How far a leaf's tetrahedra have been batched.
#[derive(Clone, Copy, Default)]
pub(super) struct Progress {
    /// Which leaf.
    pub leaf: usize,
    /// Primitives of it that are done.
    pub done: u8,
}

/// Fills a batch with tetrahedra from the place reached on; `false` if there was none left.
#[inline(always)]
pub(super) fn fill_tets(
    submesh: &Submesh,
    leaves: &[Leaf],
    at: &mut Progress,
    out: &Located,
    batch: &mut Batch<4>,
) -> bool {
    batch.clear();
    while let Some(leaf) = leaves.get(at.leaf) {
        let counts = LeafCounts::unpack(leaf.counts);
        let (tets, pairs) = (usize::from(counts.tets), usize::from(counts.pairs));
        let from = batch.len;
        let first = u64::from(leaf.first_index);
        let lanes = Batch::<4>::open(out, leaf.lanes, 2 * first);
        if lanes == 0 {
            *at = next(at);
            continue;
        }
        let mut done = usize::from(at.done);
        while done < tets && batch.len < LANES {
            let place = first + (TET_INDICES * done) as u64;
            let corners = submesh.indices.read::<TET_INDICES>(place);
            put_tet(batch, corners, 2 * place, leaf, at.leaf, done);
            done += 1;
        }
        while done < tets + pairs && batch.len + 1 < LANES {
            let pair = done - tets;
            let place = first + (TET_INDICES * tets + PAIR_INDICES * pair) as u64;
            let [one, two] = tets_of(submesh.indices.read::<PAIR_INDICES>(place));
            let before = tets + 2 * pair;
            put_tet(batch, one, 2 * place, leaf, at.leaf, before);
            put_tet(batch, two, 2 * place + 1, leaf, at.leaf, before + 1);
            done += 1;
        }
        batch.offer(from, lanes);
        if done < tets + pairs {
            at.done = done as u8;
            return true;
        }
        *at = next(at);
    }
    batch.len > 0
}

#[inline(always)]
fn next(at: &Progress) -> Progress {
    Progress {
        leaf: at.leaf + 1,
        done: 0,
    }
}

#[inline(always)]
fn put_tet(
    batch: &mut Batch<4>,
    corners: [u32; TET_INDICES],
    primitive: u64,
    leaf: &Leaf,
    leaf_number: usize,
    before: usize,
) {
    let slot = batch.len % LANES;
    for k in 0..TET_INDICES {
        batch.corners[k][slot] = corners[k];
    }
    batch.primitive[slot] = primitive;
    batch.cell_in_node[slot] = u32::from(leaf.cells_before) + before as u32;
    batch.leaf[slot] = leaf_number as u8;
    batch.volume[slot] = leaf.volume;
    batch.len += 1;
}

/// Fills a batch with pyramids, wedges and hexahedra; `false` if there was none left.
#[inline(always)]
pub(super) fn fill_others(
    submesh: &Submesh,
    leaves: &[Leaf],
    at: &mut Progress,
    out: &Located,
    batch: &mut Batch<MAX_CORNERS>,
) -> bool {
    batch.clear();
    while let Some(leaf) = leaves.get(at.leaf) {
        let counts = LeafCounts::unpack(leaf.counts);
        let others = usize::from(counts.others);
        if others == 0 {
            *at = next(at);
            continue;
        }
        let (tets, pairs) = (usize::from(counts.tets), usize::from(counts.pairs));
        let words = TET_INDICES * tets + PAIR_INDICES * pairs;
        let first = u64::from(leaf.first_index) + words as u64;
        let from = batch.len;
        let lanes = Batch::<MAX_CORNERS>::open(out, leaf.lanes, 2 * first);
        let mut done = if lanes == 0 {
            others
        } else {
            usize::from(at.done)
        };
        while done < others && batch.len < LANES {
            let place = first + (OTHER_INDICES * done) as u64;
            let (cell_type, corners) = submesh.other(submesh.indices.read::<OTHER_INDICES>(place));
            let slot = batch.len % LANES;
            for k in 0..MAX_CORNERS {
                batch.corners[k][slot] = corners[k];
            }
            batch.primitive[slot] = 2 * place;
            batch.cell_in_node[slot] =
                u32::from(leaf.cells_before) + (tets + 2 * pairs + done) as u32;
            batch.leaf[slot] = at.leaf as u8;
            batch.cell_type[slot] = cell_type as u8;
            batch.len += 1;
            done += 1;
        }
        batch.offer(from, lanes);
        if done < others {
            at.done = done as u8;
            return true;
        }
        *at = next(at);
    }
    batch.len > 0
}
