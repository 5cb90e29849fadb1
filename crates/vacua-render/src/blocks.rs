//! The blocks of the rays of a tile, each ray's in order and two at a time: which samples are
//! evaluated together.
//!
//! Rays of a tile advance together, a few blocks at a time ([`CHUNK_BLOCKS`]): neighbours then find
//! the voxels that the one before has fetched in the nearest cache, where a ray alone would have
//! pushed them out before the next ray comes by.
//!
//! Where all cells are alike, a block is eight consecutive samples. Where cell sizes vary, the ray
//! is partitioned into aligned dyadic blocks: eight samples `2^level` apart, the level as high as
//! the smallest cell within the block's extent allows. The partition depends on the ray and the
//! place alone; skipping only drops blocks of it.

mod strides;

use vacua_simd::{BLOCK, Float, Mask, Simd};
use vacua_skip::{Axis, BLOCKS_PER_WINDOW, Bundle, MAX_SAMPLES, SampleRay, Skipper};

use crate::setup::{TILE, TILE_RAYS, TileRays};

pub(crate) use strides::Strides;
pub use strides::{LatticeMinima, SpanMinima};

/// Highest level of dyadic blocks: its eight samples span a window.
pub const MAX_LEVEL: u32 = BLOCKS_PER_WINDOW.ilog2();

/// Blocks that each ray of a tile advances before the next one does: 32 samples or some sixteen
/// cells, so that what a tile touches in between stays in the first-level cache.
const CHUNK_BLOCKS: u32 = 4;

/// Rays whose blocks are sampled before they are added up, so many that a few empty ones among them
/// cost little, so few that their values stay in the first-level cache.
const GROUP_RAYS: usize = 16;

/// The same where blocks vary in length, and are made a window at a time.
const WINDOW_RAYS: usize = 2;

/// Blocks that each ray of a tile advances where the samples of all its rays are looked for together:
/// sixteen samples, so that those of a tile lie about as close together along the rays as across.
const TOGETHER_BLOCKS: u32 = 2;

/// Most pairs of blocks of a group: of each ray those of a chunk, or window, and one that waited.
pub(crate) const GROUP_PAIRS: usize = {
    let chunks = GROUP_RAYS * (CHUNK_BLOCKS as usize / 2 + 1);
    let windows = WINDOW_RAYS * (BLOCKS_PER_WINDOW as usize / 2 + 1);
    let together = TILE_RAYS * (TOGETHER_BLOCKS as usize).div_ceil(2);
    let most = if chunks > windows { chunks } else { windows };
    if most > together { most } else { together }
};

/// The rays of a tile two by two, row by row.
const QUADS: [u8; TILE_RAYS] = {
    let mut order = [0; TILE_RAYS];
    let mut i = 0;
    while i < TILE_RAYS {
        let (quad, corner) = (i / 4, i % 4);
        let quads = TILE / 2;
        let (x, y) = (quad % quads * 2 + corner % 2, quad / quads * 2 + corner / 2);
        order[i] = (y * TILE + x) as u8;
        i += 1;
    }
    order
};

/// Samples that a block of the highest level spans; rays begin at a multiple of it.
pub(crate) const ALIGNMENT: u64 = (BLOCK as u64) << MAX_LEVEL;

/// Two blocks that are evaluated in one vector.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BlockPair {
    /// First sample of each.
    pub first: [f32; 2],
    /// Distance between the samples of each, in samples.
    pub stride: [f32; 2],
}

/// First sample of a block that is not there: past the end of every ray.
const NOWHERE: f32 = 2.0 * MAX_SAMPLES as f32;

/// What is done with the blocks of rays, in two steps: values first, of many blocks of many rays
/// one after the other, without a branch that depends on them, so that they overlap; then what
/// becomes of those that may be seen.
pub(crate) trait Visit<S: Simd> {
    /// What is kept of a ray while it is marched.
    type State;
    /// Where samples are in their cells.
    type Place: Copy + Default;
    /// Whether the samples of all rays of the tile are looked for together.
    const IS_TOGETHER: bool;
    /// The values of pairs of blocks of rays of the tile, each with its ray: at most one pair a ray
    /// where they are looked for together.
    fn sample(&self, pairs: &[(u8, BlockPair)], group: &mut Group<S, Self::Place>);
    /// Asks for what samples of the rays from one number to another will read.
    fn fetch_ahead(&self, beam: &Bundle, samples: [f32; 2]);
    /// Adds two blocks to a ray; `false` to end it.
    fn add(
        &self,
        ray: usize,
        state: &mut Self::State,
        pair: BlockPair,
        sampled: Sampled<S, &Self::Place>,
    ) -> bool;
}

/// Values of the pairs of blocks of a group, in arrays of their own, as close together as the cache
/// likes them.
pub(crate) struct Group<S: Simd, P> {
    pub value: [S::F; GROUP_PAIRS],
    /// Which may be seen.
    pub seen: [S::M; GROUP_PAIRS],
    /// Which are samples of the ray.
    pub lanes: [S::M; GROUP_PAIRS],
    pub place: [P; GROUP_PAIRS],
}

/// Values of two blocks.
#[derive(Clone, Copy)]
pub(crate) struct Sampled<S: Simd, P> {
    pub value: S::F,
    /// Which may be seen.
    pub seen: S::M,
    pub place: P,
}

/// The rays of a tile as the partition into blocks needs them.
#[derive(Clone, Copy)]
pub(crate) struct Partition<'a> {
    pub tile: &'a TileRays,
    pub axes: &'a [Axis; 3],
    pub strides: &'a Strides,
}

/// First sample of a block and the distance between its samples.
type Block = (f32, f32);

/// No block.
const NO_BLOCK: Block = (NOWHERE, 0.0);

/// Blocks of a ray within a window, where their lengths vary.
#[derive(Clone)]
struct BlockList {
    blocks: [Block; BLOCKS_PER_WINDOW as usize],
    /// How many there are, and how many of them are done.
    len: usize,
    done: usize,
}

impl BlockList {
    const EMPTY: Self = Self {
        blocks: [NO_BLOCK; BLOCKS_PER_WINDOW as usize],
        len: 0,
        done: 0,
    };
}

/// Pairs of blocks of the rays of a group, those of each ray in order.
struct PairList {
    pairs: [(u8, BlockPair); GROUP_PAIRS],
    len: usize,
}

impl PairList {
    /// Pairs consecutive blocks of eight samples.
    #[inline(always)]
    fn push_run(&mut self, ray: usize, first_block: u32, blocks: u32) {
        for block in (first_block..first_block + blocks).step_by(2) {
            let [a, b] = [block, block + 1].map(|block| ((block * BLOCK as u32) as f32, 1.0));
            self.push(ray, a, b);
        }
    }

    #[inline(always)]
    fn push(&mut self, ray: usize, a: Block, b: Block) {
        let pair = BlockPair {
            first: [a.0, b.0],
            stride: [a.1, b.1],
        };
        self.pairs[self.len] = (ray as u8, pair);
        self.len += 1;
    }
}

impl Partition<'_> {
    /// Visits every block that the skipper does not rule out, those of each ray in order; gives the
    /// number of samples of each.
    #[inline(always)]
    pub fn visit<S: Simd, V: Visit<S>>(
        &self,
        skipper: &dyn Skipper,
        visit: &V,
        states: &mut [V::State; TILE_RAYS],
    ) -> [u32; TILE_RAYS] {
        let mut rays = self.tile.rays;
        let mut waiting = [NO_BLOCK; TILE_RAYS];
        let mut samples = [0; TILE_RAYS];
        let mut set = [0u64; TILE_RAYS];
        let nothing = BlockPair {
            first: [NOWHERE; 2],
            stride: [0.0; 2],
        };
        let mut pairs = PairList {
            pairs: [(0, nothing); GROUP_PAIRS],
            len: 0,
        };
        let mut maybe_seen = [0u8; GROUP_PAIRS];
        let mut sampled = Group {
            value: [S::F::splat(0.0); GROUP_PAIRS],
            seen: [S::M::from_bits(0); GROUP_PAIRS],
            lanes: [S::M::from_bits(0); GROUP_PAIRS],
            place: [V::Place::default(); GROUP_PAIRS],
        };
        // Where all blocks are alike there are no lists.
        let mut lists = Vec::new();
        if !matches!(self.strides, Strides::Constant) {
            lists.resize(TILE_RAYS, BlockList::EMPTY);
        }
        let Some(beam) = Bundle::of(&self.tile.rays) else {
            return samples;
        };
        let [begin, end] = beam.blocks;
        let (chunk_blocks, group_rays) = match self.strides {
            _ if V::IS_TOGETHER => (TOGETHER_BLOCKS, TILE_RAYS),
            Strides::Constant => (CHUNK_BLOCKS, GROUP_RAYS),
            Strides::Varying(_) | Strides::Lattice(_) => (BLOCKS_PER_WINDOW, WINDOW_RAYS),
        };
        let mut first_block = begin - begin % BLOCKS_PER_WINDOW;
        loop {
            // After the last window, blocks that still wait are evaluated alone.
            let last = first_block >= end;
            if !last {
                skipper.window(&rays, first_block, &mut set);
            }
            let any = if last {
                0
            } else {
                set.iter().fold(0, |any, bits| any | bits)
            };
            let mut chunk = 0;
            // Bits of a chunk's blocks; none past the window.
            let blocks_of = |chunk: u32| (u64::MAX >> (64 - chunk_blocks)).unbounded_shl(chunk);
            let fetch = |chunk: u32| {
                if any & blocks_of(chunk) != 0 {
                    let first = first_block + chunk;
                    let samples = [first, first + chunk_blocks].map(|b| (b * BLOCK as u32) as f32);
                    visit.fetch_ahead(&beam, samples);
                }
            };
            while chunk < BLOCKS_PER_WINDOW && (last || any >> chunk != 0) {
                let in_chunk = blocks_of(chunk);
                if chunk == 0 {
                    fetch(0);
                }
                fetch(chunk + chunk_blocks);
                let mut group = 0;
                while group < TILE_RAYS {
                    pairs.len = 0;
                    for &i in &QUADS[group..TILE_RAYS.min(group + group_rays)] {
                        let i = usize::from(i) % TILE_RAYS;
                        if last {
                            if waiting[i].1 > 0.0 {
                                pairs.push(i, waiting[i], NO_BLOCK);
                                waiting[i] = NO_BLOCK;
                            }
                        } else if let Some(list) = lists.get_mut(i) {
                            if chunk == 0 {
                                (list.len, list.done) = (0, 0);
                                self.split(i, first_block, MAX_LEVEL, set[i], list);
                            }
                            let end = (first_block + chunk + chunk_blocks) * BLOCK as u32;
                            waiting[i] = pair_up_list(i, list, end as f32, waiting[i], &mut pairs);
                        } else if set[i] & in_chunk == in_chunk && waiting[i].1 == 0.0 {
                            pairs.push_run(i, first_block + chunk, chunk_blocks);
                        } else if set[i] & in_chunk != 0 {
                            let bits = set[i] & in_chunk;
                            waiting[i] = pair_up(i, first_block, bits, waiting[i], &mut pairs);
                        }
                        // With a later block it would be far from its neighbours' samples.
                        if V::IS_TOGETHER && waiting[i].1 > 0.0 {
                            pairs.push(i, waiting[i], NO_BLOCK);
                            waiting[i] = NO_BLOCK;
                        }
                    }
                    let pairs = &pairs.pairs[..pairs.len];
                    if !pairs.is_empty() {
                        visit.sample(pairs, &mut sampled);
                    }
                    let mut num_seen = 0;
                    for (n, (i, _)) in pairs.iter().enumerate() {
                        let i = usize::from(*i) % TILE_RAYS;
                        samples[i] += sampled.lanes[n].to_bits().count_ones();
                        maybe_seen[num_seen] = n as u8;
                        num_seen += usize::from(sampled.seen[n].any());
                    }
                    for &n in &maybe_seen[..num_seen] {
                        let n = usize::from(n);
                        let (i, pair) = pairs[n];
                        let i = usize::from(i) % TILE_RAYS;
                        if rays[i].is_empty() {
                            continue;
                        }
                        let sampled = Sampled {
                            value: sampled.value[n],
                            seen: sampled.seen[n],
                            place: &sampled.place[n],
                        };
                        if !visit.add(i, &mut states[i], pair, sampled) {
                            (rays[i], set[i], waiting[i]) = (SampleRay::NONE, 0, NO_BLOCK);
                            if let Some(list) = lists.get_mut(i) {
                                list.done = list.len;
                            }
                        }
                    }
                    group += group_rays;
                }
                if last {
                    return samples;
                }
                chunk += chunk_blocks;
            }
            if last {
                return samples;
            }
            first_block += BLOCKS_PER_WINDOW;
        }
    }

    /// Emits the dyadic blocks within `block .. block + 2^level` of which any bit is set.
    fn split(&self, ray: usize, block: u32, level: u32, bits: u64, list: &mut BlockList) {
        let span = 1u32 << level;
        let here = bits >> (block % BLOCKS_PER_WINDOW);
        if here & (u64::MAX >> (64 - span)) == 0 {
            return;
        }
        let (first, last) = (block * BLOCK as u32, (block + span) * BLOCK as u32 - 1);
        let cell = |a: usize, k| self.axes[a].cell_of(self.tile.rays[ray].at(a, k));
        let cells = |k| [cell(0, k), cell(1, k), cell(2, k)];
        let sizes = match self.strides {
            Strides::Constant => [1.0; 3],
            Strides::Varying(minima) => {
                [0, 1, 2].map(|a| minima[a].smallest(cell(a, first), cell(a, last)))
            }
            Strides::Lattice(minima) => [minima.smallest(cells(first), cells(last)); 3],
        };
        let rates = self.tile.rates(ray);
        let rate_sq: f32 = (0..3).map(|a| (rates[a] / sizes[a]).powi(2)).sum();
        let finest_sq: f32 = rates.iter().map(|r| r * r).sum();
        if level == 0 || rate_sq * (span as f32).powi(2) <= finest_sq {
            list.blocks[list.len] = (first as f32, span as f32);
            list.len += 1;
        } else {
            self.split(ray, block, level - 1, bits, list);
            self.split(ray, block + span / 2, level - 1, bits, list);
        }
    }
}

/// Pairs the blocks of some places of a window, the first with one that waits; gives the one that
/// remains alone.
#[inline(always)]
fn pair_up(
    ray: usize,
    first_block: u32,
    mut bits: u64,
    waiting: Block,
    pairs: &mut PairList,
) -> Block {
    let mut pop = || {
        let block = first_block + bits.trailing_zeros();
        bits &= bits - 1;
        (((block * BLOCK as u32) as f32, 1.0), bits != 0)
    };
    let mut a = waiting;
    let mut more = true;
    if a.1 == 0.0 {
        (a, more) = pop();
    }
    while more {
        let (b, after) = pop();
        more = after;
        pairs.push(ray, a, b);
        a = NO_BLOCK;
        if more {
            (a, more) = pop();
        }
    }
    a
}

/// As [`pair_up`] for the blocks of a list that begin before some sample.
#[inline(always)]
fn pair_up_list(
    ray: usize,
    list: &mut BlockList,
    end: f32,
    waiting: Block,
    pairs: &mut PairList,
) -> Block {
    let mut a = waiting;
    for &block in &list.blocks[list.done..list.len] {
        if block.0 >= end {
            break;
        }
        list.done += 1;
        if a.1 == 0.0 {
            a = block;
        } else {
            pairs.push(ray, a, block);
            a = NO_BLOCK;
        }
    }
    a
}

#[cfg(test)]
mod tests {
    use super::*;
    use vacua_simd::Portable;
    use vacua_skip::{Lattice, NoSkip};

    struct Collect<const TOGETHER: bool>;
    impl<const TOGETHER: bool> Visit<Portable> for Collect<TOGETHER> {
        type State = Vec<(u32, u32)>;
        type Place = ();
        const IS_TOGETHER: bool = TOGETHER;
        fn sample(&self, pairs: &[(u8, BlockPair)], group: &mut Group<Portable, ()>) {
            for n in 0..pairs.len() {
                group.seen[n] = Mask::from_bits(1);
                group.lanes[n] = Mask::from_bits(1);
            }
        }
        fn fetch_ahead(&self, _: &Bundle, _: [f32; 2]) {}
        fn add(
            &self,
            _: usize,
            blocks: &mut Self::State,
            pair: BlockPair,
            _: Sampled<Portable, &()>,
        ) -> bool {
            for block in 0..2 {
                if pair.stride[block] > 0.0 {
                    blocks.push((pair.first[block] as u32, pair.stride[block] as u32));
                }
            }
            true
        }
    }

    #[test]
    fn dyadic_blocks_partition_the_ray_and_respect_the_cells() {
        let mut planes = vec![0.0f32];
        for i in 0..60 {
            planes.push(planes[i] + 1.1f32.powi(i as i32));
        }
        let axes = [
            Axis::planes(planes),
            Axis::planes(vec![0.0, 1.0]),
            Axis::planes(vec![0.0, 1.0]),
        ];
        let lattice = Lattice::new(axes.clone(), 8).expect("cells on each axis");
        let strides = Strides::new(&axes, [1.0; 3]);
        let ray = SampleRay::within(&lattice, [-0.25, 0.5, 0.5], [0.5, 0.0, 0.0]);
        let tile = TileRays::one(ray, [0.5, 0.0, 0.0]);
        let partition = Partition {
            tile: &tile,
            axes: &axes,
            strides: &strides,
        };
        let mut states = std::array::from_fn(|_| Vec::new());
        let counts = partition.visit(&NoSkip, &Collect::<false>, &mut states);
        assert!(counts[0] > 0 && counts[1] == 0);
        let [blocks, ..] = states;
        let mut states = std::array::from_fn(|_| Vec::new());
        partition.visit(&NoSkip, &Collect::<true>, &mut states);
        assert_eq!(states[0], blocks, "the same blocks, in smaller chunks");
        let mut next = 0;
        let mut widest = 0;
        for (first, stride) in blocks {
            assert_eq!(first, next, "no gap");
            assert_eq!(first % (BLOCK as u32 * stride), 0, "aligned");
            next = first + BLOCK as u32 * stride;
            widest = widest.max(stride);
            if stride > 1 {
                for k in (first..next).filter(|&k| k < ray.end) {
                    let cell = axes[0].cell_of(ray.at(0, k));
                    let size = axes[0].plane(cell + 1) - axes[0].plane(cell);
                    assert!(
                        0.5 * stride as f32 <= 0.5 * size * 1.0001,
                        "{stride} in {size}"
                    );
                }
            }
        }
        assert!(next >= ray.end);
        assert!(widest >= 32, "{widest}");
    }
}
