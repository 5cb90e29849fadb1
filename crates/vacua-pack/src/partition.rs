//! Splitting a mesh into sub-meshes of few enough vertices for short indices.
//!
//! Source: paper B, §4.2: recursive splits by the surface area heuristic until a part has at most
//! 2^N vertices. Vertices that several parts use are replicated later.
//! Deviation: areas are those of the boxes around the centres of cells, which at this size differ
//! little from the boxes of the cells and take a third of the memory.

use std::ops::Range;

use rayon::prelude::*;

use crate::bvh::partition;
use crate::ids::{Id, Ids, Numbering};
use crate::input::{Input, Unfit, chunks};

/// Fewest and most bits of an index.
pub const INDEX_BITS: std::ops::RangeInclusive<u32> = 8..=32;
/// Bins an axis.
const BINS: usize = 64;
/// From here on a part is binned in parallel.
const PARALLEL_CELLS: usize = 1 << 16;
/// Deeper than this, parts are halved.
const MAX_SAH_DEPTH: usize = 64;
/// So many cells of eight indices fit 32-bit offsets.
const MAX_CELLS: usize = (u32::MAX / 8) as usize;

/// The cells that are encoded, in the order of their sub-meshes.
#[derive(Debug)]
pub struct Partition {
    /// Numbers of the cells.
    pub cells: Ids,
    /// A range of `cells` for each sub-mesh.
    pub parts: Vec<Range<usize>>,
    /// Cells left out because they are blanked.
    pub num_blanked: usize,
    /// Cells left out because a position is not finite.
    pub num_not_finite: usize,
}

/// A cell by its number and centre.
#[derive(Clone, Copy)]
struct Entry<I> {
    center: [f32; 3],
    cell: I,
}

/// Splits a mesh. Deterministic whatever the number of threads.
pub fn split(input: &Input, index_bits: u32) -> Partition {
    if input.mesh().num_cells() as u64 <= 1 << 32 {
        let (cells, parts, left_out) = split_as::<u32>(input, index_bits);
        finish(Ids::Narrow(cells), parts, left_out)
    } else {
        let (cells, parts, left_out) = split_as::<u64>(input, index_bits);
        finish(Ids::Wide(cells), parts, left_out)
    }
}

fn finish(
    cells: Ids,
    parts: Vec<Range<usize>>,
    [num_blanked, num_not_finite]: [usize; 2],
) -> Partition {
    Partition {
        cells,
        parts,
        num_blanked,
        num_not_finite,
    }
}

fn split_as<I: Id>(input: &Input, index_bits: u32) -> (Vec<I>, Vec<Range<usize>>, [usize; 2]) {
    let num_cells = input.mesh().num_cells();
    let mut entries: Vec<Entry<I>> = Vec::with_capacity(num_cells);
    let mut left_out = [0; 2];
    // In batches, so that at no time there are two copies of the whole.
    for batch in chunks(num_cells).chunks(64) {
        let found: Vec<(Vec<Entry<I>>, [usize; 2])> = batch
            .par_iter()
            .map(|range| entries_of(input, range.clone()))
            .collect();
        for (some, out) in found {
            entries.extend_from_slice(&some);
            left_out[0] += out[0];
            left_out[1] += out[1];
        }
    }
    let splitter = Splitter { input, index_bits };
    let lengths = if entries.is_empty() {
        Vec::new()
    } else {
        splitter.split(&mut entries, 0)
    };
    let mut parts = Vec::with_capacity(lengths.len());
    let mut start = 0;
    for length in lengths {
        parts.push(start..start + length);
        start += length;
    }
    (
        entries.into_iter().map(|e| e.cell).collect(),
        parts,
        left_out,
    )
}

fn entries_of<I: Id>(input: &Input, range: Range<usize>) -> (Vec<Entry<I>>, [usize; 2]) {
    let mut entries = Vec::with_capacity(range.len());
    let mut left_out = [0; 2];
    for cell in range {
        match input.center(cell) {
            Ok(center) => entries.push(Entry {
                center,
                cell: I::from_u64(cell as u64),
            }),
            Err(Unfit::Blanked) => left_out[0] += 1,
            Err(Unfit::NotFinite) => left_out[1] += 1,
        }
    }
    (entries, left_out)
}

struct Splitter<'a, 'b> {
    input: &'a Input<'b>,
    index_bits: u32,
}

impl Splitter<'_, '_> {
    /// Reorders the entries part after part; returns the length of each part.
    fn split<I: Id>(&self, entries: &mut [Entry<I>], depth: usize) -> Vec<usize> {
        if self.fits(entries) {
            return vec![entries.len()];
        }
        let middle = if depth < MAX_SAH_DEPTH {
            split_by_area(entries)
        } else {
            entries.len() / 2
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
        let most = (1u64 << self.index_bits).min(u64::from(u32::MAX) - 1);
        let mut numbering = Numbering::new();
        let mut marker = 0;
        for entry in entries {
            let (_, points) = self.input.cell(entry.cell.to_u64());
            let n = points.as_slice().len();
            marker |= u64::from(n == 5 || n == 6);
            for &point in points.as_slice() {
                numbering.number(point);
            }
            if numbering.points().len() as u64 + marker > most {
                return false;
            }
        }
        true
    }
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

/// Folds over entries, in parallel where there are many; `join` must be associative and commutative.
fn fold<I: Id, A: Send + Sync + Clone>(
    entries: &[Entry<I>],
    empty: A,
    add: impl Fn(&mut A, &Entry<I>) + Sync,
    join: impl Fn(A, A) -> A + Sync,
) -> A {
    let some = |entries: &[Entry<I>]| {
        let mut sum = empty.clone();
        entries.iter().for_each(|e| add(&mut sum, e));
        sum
    };
    if entries.len() < PARALLEL_CELLS {
        return some(entries);
    }
    entries
        .par_chunks(PARALLEL_CELLS / 4)
        .map(some)
        .reduce(|| empty.clone(), &join)
}

/// Moves cells to both sides of the best plane between bins; gives the number on the left, which is
/// neither 0 nor all.
fn split_by_area<I: Id>(entries: &mut [Entry<I>]) -> usize {
    let add = |bin: &mut Bin, e: &Entry<I>| {
        for i in 0..3 {
            let c = e.center[i];
            bin.0[i] = if c < bin.0[i] { c } else { bin.0[i] };
            bin.1[i] = if c > bin.1[i] { c } else { bin.1[i] };
        }
        bin.2 += 1;
    };
    let all = fold(entries, EMPTY_BIN, add, |a, b| join_bins(&a, &b));
    let scale = [0, 1, 2].map(|i| {
        let scale = BINS as f32 * 0.999_99 / (all.1[i] - all.0[i]);
        if scale.is_finite() { scale } else { 0.0 }
    });
    let bin_of =
        |e: &Entry<I>, i: usize| (((e.center[i] - all.0[i]) * scale[i]) as usize).min(BINS - 1);
    let bins = fold(
        entries,
        [[EMPTY_BIN; BINS]; 3],
        |bins, e| (0..3).for_each(|i| add(&mut bins[i][bin_of(e, i)], e)),
        |mut a, b| {
            for i in 0..3 {
                for k in 0..BINS {
                    a[i][k] = join_bins(&a[i][k], &b[i][k]);
                }
            }
            a
        },
    );
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
            let cost = half_area(&left) * left.2 as f64 + half_area(&right[k]) * right[k].2 as f64;
            if cost < best.0 {
                best = (cost, axis, k);
            }
        }
    }
    let (_, axis, plane) = best;
    if plane == 0 {
        return entries.len() / 2;
    }
    partition(entries, |e| bin_of(e, axis) < plane)
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
            let p = split(&input, bits);
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
        let narrow = split_as::<u32>(&input, 9);
        let wide = split_as::<u64>(&input, 9);
        assert_eq!(narrow.1, wide.1);
        assert!(narrow.0.iter().map(|&c| u64::from(c)).eq(wide.0));
    }
}
