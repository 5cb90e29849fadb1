//! Splitting a mesh into sub-meshes of few enough vertices for short indices.
//!
//! Source: paper B, §4.2: recursive splits by the surface area heuristic until a part has at most
//! 2^N vertices. Vertices that several parts use are replicated later.
//! Deviation: areas are those of the boxes around the centres of cells, which at this size differ
//! little from the boxes of the cells and take a third of the memory.

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use crate::bvh::partition;
use crate::ids::{Id, Ids};
use crate::input::{Input, Unfit};
use crate::pool::Pool;

mod spilled;

pub use spilled::SplitError;

/// Fewest and most bits of an index.
pub const INDEX_BITS: std::ops::RangeInclusive<u32> = 8..=32;
/// Bins an axis.
const BINS: usize = 64;
/// Of more cells than twice this a sample is binned, about so many.
const SAMPLES: u64 = 1 << 16;
/// Cells of a work item.
const CHUNK: usize = 1 << 14;
/// So many cells are between two that are looked at one after the other when points are counted:
/// neighbours share points, and parts with too many should be known soon.
const STRIDE: usize = 64;
/// So many cells ahead memory is asked for.
const AHEAD: usize = 16;
/// Deeper than this, parts are halved.
const MAX_SAH_DEPTH: usize = 64;
/// So many cells of eight indices fit 32-bit offsets.
const MAX_CELLS: usize = (u32::MAX / 8) as usize;

/// Cells in the order of their sub-meshes, and in that of the input in each.
#[derive(Debug)]
pub struct Group {
    /// Numbers of the cells.
    pub cells: Ids,
    /// A range of `cells` for each sub-mesh.
    pub parts: Vec<Range<usize>>,
}

/// Cells that are not encoded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LeftOut {
    /// Because they are blanked.
    pub num_blanked: usize,
    /// Because a position is not finite.
    pub num_not_finite: usize,
}

/// A cell by its number and centre.
#[derive(Clone, Copy)]
struct Entry<I> {
    center: [f32; 3],
    cell: I,
}

/// Splits a mesh into parts of few enough vertices. What comes out depends on the mesh and the bits
/// alone, not on threads, and not on what is in memory at a time.
pub struct Splitter<'a, 'b> {
    input: &'a Input<'b>,
    index_bits: u32,
    sets: Pool<PointSet>,
    /// Called with the number of cells whose part is found.
    done: &'a (dyn Fn(usize) + Sync),
}

impl<'a, 'b> Splitter<'a, 'b> {
    /// For sub-meshes of at most two to so many vertices.
    pub fn new(input: &'a Input<'b>, index_bits: u32, done: &'a (dyn Fn(usize) + Sync)) -> Self {
        Self {
            input,
            index_bits,
            sets: Pool::default(),
            done,
        }
    }

    /// Splits all cells in memory.
    pub fn split_all(&self) -> (Group, LeftOut) {
        let num_cells = self.input.mesh().num_cells();
        if num_cells as u64 <= 1 << 32 {
            let (entries, left_out) = self.entries::<u32>(0..num_cells);
            (self.group(entries, 0), left_out)
        } else {
            let (entries, left_out) = self.entries::<u64>(0..num_cells);
            (self.group(entries, 0), left_out)
        }
    }

    /// The cells of a range that are encoded, with their centres.
    fn entries<I: Id>(&self, range: Range<usize>) -> (Vec<Entry<I>>, LeftOut) {
        let left_out = [const { AtomicUsize::new(0) }; 2];
        let entry = |cell: usize| {
            let center = self.input.center(cell).unwrap_or_else(|why| {
                left_out[usize::from(why == Unfit::NotFinite)].fetch_add(1, Ordering::Relaxed);
                [f32::NAN; 3]
            });
            Entry {
                center,
                cell: I::from_u64(cell as u64),
            }
        };
        let mut entries = Vec::new();
        range
            .into_par_iter()
            .with_min_len(CHUNK)
            .map(entry)
            .collect_into_vec(&mut entries);
        let [num_blanked, num_not_finite] = left_out.map(AtomicUsize::into_inner);
        if num_blanked + num_not_finite > 0 {
            entries.retain(|e| !e.center[0].is_nan());
        }
        let left_out = LeftOut {
            num_blanked,
            num_not_finite,
        };
        (entries, left_out)
    }

    /// Splits cells that were `depth` splits away from all of them.
    fn group<I: Id>(&self, mut entries: Vec<Entry<I>>, depth: usize) -> Group {
        let lengths = if entries.is_empty() {
            Vec::new()
        } else {
            self.split(&mut entries, depth)
        };
        let mut parts = Vec::with_capacity(lengths.len());
        let mut start = 0;
        for length in lengths {
            parts.push(start..start + length);
            start += length;
        }
        let mut cells: Vec<I> = entries.into_iter().map(|e| e.cell).collect();
        cells.shrink_to_fit();
        let mut rest = cells.as_mut_slice();
        let mut slices = Vec::with_capacity(parts.len());
        for part in &parts {
            let (slice, after) = std::mem::take(&mut rest).split_at_mut(part.len());
            slices.push(slice);
            rest = after;
        }
        slices.into_par_iter().for_each(<[I]>::sort_unstable);
        let cells = I::list(cells);
        Group { cells, parts }
    }

    /// Reorders the entries part after part; returns the length of each part. Depends on the set of
    /// entries alone.
    fn split<I: Id>(&self, entries: &mut [Entry<I>], depth: usize) -> Vec<usize> {
        if self.fits(entries) {
            (self.done)(entries.len());
            return vec![entries.len()];
        }
        let middle = if depth < MAX_SAH_DEPTH {
            split_by_area(entries)
        } else {
            halve(entries)
        };
        let (left, right) = entries.split_at_mut(middle);
        let (mut left, right) = rayon::join(
            || self.split(left, depth + 1),
            || self.split(right, depth + 1),
        );
        left.extend(right);
        left
    }

    /// Whether the cells have few enough vertices.
    fn fits<I: Id>(&self, entries: &[Entry<I>]) -> bool {
        if entries.len() > MAX_CELLS {
            return false;
        }
        self.sets.with(|points| {
            points.clear(self.input.mesh().num_points());
            self.count(entries, points)
        })
    }

    /// As [`Self::fits`], with an empty set of points.
    fn count<I: Id>(&self, entries: &[Entry<I>], points: &mut PointSet) -> bool {
        for first in 0..STRIDE.min(entries.len()) {
            for place in (first..entries.len()).step_by(STRIDE) {
                vacua_simd::prefetch(entries, place + 2 * AHEAD * STRIDE);
                if let Some(soon) = entries.get(place + AHEAD * STRIDE) {
                    self.input.prefetch_cell(soon.cell.to_u64());
                }
                if !self.has_room(entries[place].cell.to_u64(), points) {
                    return false;
                }
            }
        }
        true
    }

    /// Adds the points of a cell; whether there are still few enough.
    #[inline(always)]
    fn has_room(&self, cell: u64, points: &mut PointSet) -> bool {
        let most = (1u64 << self.index_bits).min(u64::from(u32::MAX) - 1);
        let cell_type = self.input.visit_points(cell, |point| points.insert(point));
        points.has_marker |= matches!(cell_type.num_points(), 5 | 6);
        points.len + u64::from(points.has_marker) <= most
    }
}

/// A set of points, a bit each.
#[derive(Default)]
struct PointSet {
    words: Vec<u64>,
    /// Words with a bit.
    used: Vec<usize>,
    len: u64,
    /// Whether an index is reserved.
    has_marker: bool,
}

impl PointSet {
    /// Makes it empty, for points below a number.
    fn clear(&mut self, num_points: usize) {
        self.used.drain(..).for_each(|word| self.words[word] = 0);
        self.words.resize(num_points.div_ceil(64), 0);
        self.len = 0;
        self.has_marker = false;
    }

    #[inline(always)]
    fn insert(&mut self, point: u64) {
        let place = (point / 64) as usize;
        let word = &mut self.words[place];
        let bit = 1 << (point % 64);
        if *word == 0 {
            self.used.push(place);
        }
        self.len += u64::from(*word & bit == 0);
        *word |= bit;
    }
}

/// Puts the cells in the order of the input; gives half of their number.
fn halve<I: Id>(entries: &mut [Entry<I>]) -> usize {
    entries.sort_unstable_by_key(|e| e.cell);
    entries.len() / 2
}

type Bin = ([f32; 3], [f32; 3], u64);
const EMPTY_BIN: Bin = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3], 0);

fn join_bins(a: &Bin, b: &Bin) -> Bin {
    (
        [0, 1, 2].map(|i| a.0[i].min(b.0[i])),
        [0, 1, 2].map(|i| a.1[i].max(b.1[i])),
        a.2 + b.2,
    )
}

fn half_area(bin: &Bin) -> f64 {
    let d = [0, 1, 2].map(|i| (f64::from(bin.1[i]) - f64::from(bin.0[i])).max(0.0));
    d[0] * d[1] + d[1] * d[2] + d[2] * d[0]
}

/// Whether a cell is in the sample of so many: it depends on the set of cells alone. Numbers of cells,
/// scrambled, are as good as chance.
#[inline(always)]
fn is_sampled(cell: u64, num_cells: u64) -> bool {
    let step = (num_cells / SAMPLES).max(1);
    cell.wrapping_mul(0x9E37_79B9_7F4A_7C15) <= u64::MAX / step
}

/// The centres of cells, or of a sample.
fn sample<I: Id>(entries: &[Entry<I>]) -> Vec<[f32; 3]> {
    let all = entries.len() as u64;
    let is_in = |e: &&Entry<I>| is_sampled(e.cell.to_u64(), all);
    entries
        .par_chunks(8 * CHUNK)
        .flat_map_iter(|some| some.iter().filter(is_in).map(|e| e.center))
        .collect()
}

/// Moves cells to both sides of the best plane; gives the number on the left, which is neither 0 nor
/// all.
fn split_by_area<I: Id>(entries: &mut [Entry<I>]) -> usize {
    match Plane::best(&sample(entries)) {
        Some(plane) => partition(entries, |e| plane.is_left(&e.center)),
        None => halve(entries),
    }
}

/// A plane between bins.
#[derive(Clone, Copy, Debug)]
struct Plane {
    axis: usize,
    start: f32,
    scale: f32,
    bin: usize,
}

#[inline(always)]
fn bin_of(c: f32, start: f32, scale: f32) -> usize {
    (((c - start) * scale) as usize).min(BINS - 1)
}

impl Plane {
    #[inline(always)]
    fn is_left(&self, center: &[f32; 3]) -> bool {
        bin_of(center[self.axis], self.start, self.scale) < self.bin
    }

    /// The best of the planes that have centres on both sides, whatever their order; `None` if all
    /// are in one place.
    fn best(centers: &[[f32; 3]]) -> Option<Self> {
        let add = |bin: &mut Bin, c: &[f32; 3]| {
            for i in 0..3 {
                bin.0[i] = if c[i] < bin.0[i] { c[i] } else { bin.0[i] };
                bin.1[i] = if c[i] > bin.1[i] { c[i] } else { bin.1[i] };
            }
            bin.2 += 1;
        };
        let mut all = EMPTY_BIN;
        centers.iter().for_each(|c| add(&mut all, c));
        let scale = [0, 1, 2].map(|i| {
            let scale = BINS as f32 * 0.999_99 / (all.1[i] - all.0[i]);
            if scale.is_finite() { scale } else { 0.0 }
        });
        let mut bins = [[EMPTY_BIN; BINS]; 3];
        for c in centers {
            (0..3).for_each(|i| add(&mut bins[i][bin_of(c[i], all.0[i], scale[i])], c));
        }
        let mut best = (f64::INFINITY, 0, 0);
        for (axis, bins) in bins.iter().enumerate() {
            let mut right = [EMPTY_BIN; BINS];
            right[BINS - 1] = bins[BINS - 1];
            for k in (1..BINS - 1).rev() {
                right[k] = join_bins(&bins[k], &right[k + 1]);
            }
            let mut left = EMPTY_BIN;
            for k in 1..BINS {
                left = join_bins(&left, &bins[k - 1]);
                if left.2 == 0 || right[k].2 == 0 {
                    continue;
                }
                let cost =
                    half_area(&left) * left.2 as f64 + half_area(&right[k]) * right[k].2 as f64;
                if cost < best.0 {
                    best = (cost, axis, k);
                }
            }
        }
        let (_, axis, bin) = best;
        (bin > 0).then(|| Self {
            axis,
            start: all.0[axis],
            scale: scale[axis],
            bin,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;
    use vacua_volume::{CellType, DataArray, UnstructuredMesh};

    fn tets_in_a_row(n: u32) -> UnstructuredMesh {
        let positions = (0..n + 3).flat_map(|i| [i as f32, (i % 3) as f32, (i % 2) as f32]);
        let conn = (0..n).flat_map(|i| [i, i + 1, i + 2, i + 3]);
        UnstructuredMesh::uniform(
            DataArray::from_vec(positions.collect(), 3).expect("triples"),
            CellType::Tetrahedron,
            DataArray::from_vec(conn.collect(), 1).expect("column"),
        )
        .expect("valid")
    }

    #[test]
    fn parts_cover_all_cells_within_the_limit() {
        let mesh = tets_in_a_row(5000);
        let input = Input::new(&mesh);
        for bits in [8, 10, 32] {
            let (p, left_out) = Splitter::new(&input, bits, &|_| ()).split_all();
            assert_eq!(left_out, LeftOut::default());
            let mut seen = HashSet::new();
            for part in &p.parts {
                let mut points = HashSet::new();
                for i in part.clone() {
                    assert!(seen.insert(p.cells.get(i)));
                    points.extend(mesh.cell(p.cells.get(i) as usize).points().to_vec());
                }
                assert!(points.len() <= 1 << bits);
            }
            assert_eq!(seen.len(), 5000);
        }
    }

    #[test]
    fn numbers_of_64_bits_split_alike() {
        let mesh = tets_in_a_row(3000);
        let input = Input::new(&mesh);
        let splitter = Splitter::new(&input, 9, &|_| ());
        let narrow = splitter.group(splitter.entries::<u32>(0..3000).0, 0);
        let wide = splitter.group(splitter.entries::<u64>(0..3000).0, 0);
        assert_eq!(narrow.parts, wide.parts);
        assert!((0..3000).all(|i| narrow.cells.get(i) == wide.cells.get(i)));
    }
}
