//! What the walk through the tree leaves to be tested: leaves with the lanes that fall into them, and
//! sixteen of their cells at a time.

use vacua_simd::LANES;

use crate::layout::{LeafCounts, OTHER_INDICES, PAIR_INDICES, TET_INDICES, WIDTH};
use crate::packed::Submesh;
use crate::pairs::tets_of;

use super::{Located, MAX_CORNERS};

/// Leaves that wait at most before their cells are tested.
pub(super) const LEAVES: usize = 96;

/// Pairs that are written at a time, whether or not there are so many.
const PAIRS_AT_ONCE: usize = 2;
/// Room in a batch: what is written past the last cell is overwritten, or void.
const ROOM: usize = LANES + 4;

/// A leaf that some lanes fall into.
#[derive(Clone, Copy, Default)]
pub(super) struct Leaf {
    /// Where its primitives start among the sub-mesh's indices.
    pub first_index: u32,
    /// The node it is in.
    pub node: u32,
    /// The lanes.
    pub lanes: u16,
    /// Its counts.
    pub counts: u8,
}

/// Leaves that wait.
pub(super) struct Leaves {
    entries: [[u32; 3]; LEAVES],
    /// Volume of each one's box in cubic sixteenths, widened by a sixteenth a side.
    volumes: [f32; LEAVES],
    /// How many there are.
    pub len: usize,
}

impl Leaves {
    #[inline(always)]
    pub fn new() -> Self {
        Self {
            entries: [[0; 3]; LEAVES],
            volumes: [0.0; LEAVES],
            len: 0,
        }
    }

    /// Adds one if `really`, for which there must be room.
    #[inline(always)]
    pub fn push_if(&mut self, really: bool, leaf: Leaf, volume: f32) {
        let place = self.len % LEAVES;
        let rest = u32::from(leaf.lanes) | u32::from(leaf.counts) << 16;
        self.entries[place] = [leaf.first_index, leaf.node, rest];
        self.volumes[place] = volume;
        self.len += usize::from(really);
    }

    /// One of them.
    #[inline(always)]
    fn get(&self, place: usize) -> Option<Leaf> {
        if place >= self.len {
            return None;
        }
        let [first_index, node, rest] = self.entries[place % LEAVES];
        Some(Leaf {
            first_index,
            node,
            lanes: rest as u16,
            counts: (rest >> 16) as u8,
        })
    }
}

/// Up to sixteen cells of up to `N` corners.
pub(super) struct Batch<const N: usize> {
    /// How many there are.
    pub len: usize,
    /// Vertices within the sub-mesh; any past the end.
    pub corners: [[u32; ROOM]; N],
    /// Which primitive each is.
    pub primitive: [u64; ROOM],
    /// The node each is of.
    pub node: [u32; ROOM],
    /// The kind of each, by number.
    pub cell_type: [u8; ROOM],
    /// Volume of the leaf's box.
    pub volume: [f32; ROOM],
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
            corners: [[0; ROOM]; N],
            primitive: [0; ROOM],
            node: [0; ROOM],
            cell_type: [0; ROOM],
            volume: [0.0; ROOM],
            candidates: [0; LANES],
            lanes: 0,
        }
    }

    /// The sixteen cells' corner `k`.
    #[inline(always)]
    pub fn corner(&self, k: usize) -> &[u32; LANES] {
        match self.corners[k].first_chunk() {
            Some(corners) => corners,
            None => unreachable!("there is room for more than sixteen"),
        }
    }

    /// Makes room; what was there before stays in memory, which harms nothing.
    #[inline(always)]
    fn clear(&mut self) {
        self.len = 0;
        self.candidates = [0; LANES];
        self.lanes = 0;
    }

    /// Makes cells from slot `from` on candidates of some lanes.
    #[inline(always)]
    fn offer(&mut self, from: usize, lanes: u16) {
        let slots = (u32::MAX << from) as u16 & ((1u32 << self.len) - 1) as u16;
        self.lanes |= lanes;
        let mut left = lanes;
        while left != 0 {
            let lane = left.trailing_zeros() as usize;
            left &= left - 1;
            self.candidates[lane % LANES] |= slots;
        }
    }
}

/// The lanes of `lanes` whose answer so far does not come before a primitive.
#[inline(always)]
fn open(out: &Located, lanes: u16, first_primitive: u64) -> u16 {
    let mut open = lanes & !out.found;
    let mut left = lanes & out.found;
    while left != 0 {
        let lane = left.trailing_zeros() as usize;
        left &= left - 1;
        open |= u16::from(out.primitive[lane % LANES] > first_primitive) << lane;
    }
    open
}

/// How far leaves have been batched.
#[derive(Clone, Copy, Default)]
pub(super) struct Progress {
    /// Which leaf.
    leaf: usize,
    /// Primitives of it that are done.
    done: u8,
}

impl Progress {
    #[inline(always)]
    fn next(&mut self) {
        self.leaf += 1;
        self.done = 0;
    }
}

/// Fills a batch with tetrahedra from the place reached on; `false` if there was none left.
#[inline(always)]
pub(super) fn fill_tets(
    submesh: &Submesh,
    leaves: &Leaves,
    at: &mut Progress,
    out: &Located,
    batch: &mut Batch<TET_INDICES>,
) -> bool {
    batch.clear();
    while let Some(leaf) = leaves.get(at.leaf) {
        let counts = LeafCounts::unpack(leaf.counts);
        let (tets, pairs) = (usize::from(counts.tets), usize::from(counts.pairs));
        let from = batch.len;
        let first = u64::from(leaf.first_index);
        let lanes = open(out, leaf.lanes, 2 * first);
        if lanes == 0 {
            at.next();
            continue;
        }
        let volume = leaves.volumes[at.leaf % LEAVES];
        if tets + 2 * pairs > LANES - from || at.done > 0 {
            if from > 0 {
                return true;
            }
            // More than a batch holds, which is rare.
            fill_part(submesh, &leaf, volume, at, batch);
        } else {
            for tet in 0..tets {
                let place = first + (TET_INDICES * tet) as u64;
                let corners = submesh.indices.read::<TET_INDICES>(place);
                put_tet(batch, from + tet, corners, 2 * place);
            }
            let (first_pair, slot) = (first + (TET_INDICES * tets) as u64, from + tets);
            let mut pair = 0;
            while pair < pairs {
                for more in pair..pair + PAIRS_AT_ONCE {
                    let place = first_pair + (PAIR_INDICES * more) as u64;
                    let [one, two] = tets_of(submesh.indices.read::<PAIR_INDICES>(place));
                    put_tet(batch, slot + 2 * more, one, 2 * place);
                    put_tet(batch, slot + 2 * more + 1, two, 2 * place + 1);
                }
                pair += PAIRS_AT_ONCE;
            }
            batch.len = slot + 2 * pairs;
            for slot in from..batch.len {
                batch.node[slot % ROOM] = leaf.node;
                batch.volume[slot % ROOM] = volume;
            }
            at.next();
        }
        batch.offer(from, lanes);
        if batch.len == LANES {
            return true;
        }
    }
    batch.len > 0
}

/// As many primitives of a large leaf as there is room for.
#[cold]
#[inline(never)]
fn fill_part(
    submesh: &Submesh,
    leaf: &Leaf,
    volume: f32,
    at: &mut Progress,
    batch: &mut Batch<TET_INDICES>,
) {
    let counts = LeafCounts::unpack(leaf.counts);
    let (tets, pairs) = (usize::from(counts.tets), usize::from(counts.pairs));
    let mut done = usize::from(at.done);
    let first = u64::from(leaf.first_index);
    while done < tets && batch.len < LANES {
        let place = first + (TET_INDICES * done) as u64;
        let corners = submesh.indices.read::<TET_INDICES>(place);
        put_tet(batch, batch.len, corners, 2 * place);
        batch.len += 1;
        done += 1;
    }
    while done >= tets && done < tets + pairs && batch.len + 1 < LANES {
        let words = TET_INDICES * tets + PAIR_INDICES * (done - tets);
        let place = first + words as u64;
        let [one, two] = tets_of(submesh.indices.read::<PAIR_INDICES>(place));
        put_tet(batch, batch.len, one, 2 * place);
        put_tet(batch, batch.len + 1, two, 2 * place + 1);
        batch.len += 2;
        done += 1;
    }
    batch.node[..batch.len].fill(leaf.node);
    batch.volume[..batch.len].fill(volume);
    if done < tets + pairs {
        at.done = done as u8;
    } else {
        at.next();
    }
}

#[inline(always)]
fn put_tet(
    batch: &mut Batch<TET_INDICES>,
    slot: usize,
    corners: [u32; TET_INDICES],
    primitive: u64,
) {
    let slot = slot.min(ROOM - 1);
    for k in 0..TET_INDICES {
        batch.corners[k][slot] = corners[k];
    }
    batch.primitive[slot] = primitive;
}

/// Fills a batch with pyramids, wedges and hexahedra; `false` if there was none left.
#[inline(always)]
pub(super) fn fill_others(
    submesh: &Submesh,
    leaves: &Leaves,
    at: &mut Progress,
    out: &Located,
    batch: &mut Batch<MAX_CORNERS>,
) -> bool {
    batch.clear();
    while let Some(leaf) = leaves.get(at.leaf) {
        let counts = LeafCounts::unpack(leaf.counts);
        let others = usize::from(counts.others);
        if others == 0 {
            at.next();
            continue;
        }
        let (tets, pairs) = (usize::from(counts.tets), usize::from(counts.pairs));
        let words = TET_INDICES * tets + PAIR_INDICES * pairs;
        let first = u64::from(leaf.first_index) + words as u64;
        let from = batch.len;
        let lanes = open(out, leaf.lanes, 2 * first);
        let mut done = if lanes == 0 {
            others
        } else {
            usize::from(at.done)
        };
        while done < others && batch.len < LANES {
            let place = first + (OTHER_INDICES * done) as u64;
            let (cell_type, corners) = submesh.other(submesh.indices.read::<OTHER_INDICES>(place));
            let slot = batch.len % ROOM;
            for k in 0..MAX_CORNERS {
                batch.corners[k][slot] = corners[k];
            }
            batch.primitive[slot] = 2 * place;
            batch.node[slot] = leaf.node;
            batch.cell_type[slot] = cell_type as u8;
            batch.len += 1;
            done += 1;
        }
        batch.offer(from, lanes);
        if done < others {
            at.done = done as u8;
            return true;
        }
        at.next();
    }
    batch.len > 0
}

/// How many cells of a node come before a primitive.
pub(super) fn cells_before(submesh: &Submesh, node: u32, primitive: u64) -> u32 {
    let Some((node, _)) = submesh.node(node) else {
        return 0;
    };
    let (place, second) = (primitive / 2, (primitive % 2) as u32);
    let mut first = u64::from(node.first_index);
    let mut cells = 0;
    for child in 0..WIDTH {
        let counts = LeafCounts::unpack(node.counts[child]);
        let words = counts.num_indices() as u64;
        if place >= first + words {
            first += words;
            cells += counts.num_cells() as u32;
            continue;
        }
        let word = place.saturating_sub(first) as u32;
        let (tets, pairs) = (u32::from(counts.tets), u32::from(counts.pairs));
        let (tet_words, pair_words) = (TET_INDICES as u32 * tets, PAIR_INDICES as u32 * pairs);
        let before = if word < tet_words {
            word / TET_INDICES as u32
        } else if word < tet_words + pair_words {
            tets + 2 * ((word - tet_words) / PAIR_INDICES as u32) + second
        } else {
            tets + 2 * pairs + (word - tet_words - pair_words) / OTHER_INDICES as u32
        };
        return cells + before;
    }
    cells
}
