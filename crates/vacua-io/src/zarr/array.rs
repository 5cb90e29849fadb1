//! Numbers of an array: its chunks are unpacked some at a time, in parallel, and put where they belong.

use std::collections::HashMap;
use std::io::ErrorKind;
use std::path::PathBuf;

use rayon::prelude::*;
use vacua_volume::{ArrayError, DataArray};

use super::metadata::{ArrayMeta, Shards, Stored};
use super::unpack::unpack;
use crate::decode::{Endianness, Layout, swap_chunk};
use crate::error::Problem;
use crate::source::Source;

/// Bytes of chunks that are unpacked at a time, if a row of them has no more.
const BATCH_BYTES: usize = 256 << 20;

/// Chunks that are unpacked at a time, if a row of them has no more.
const BATCH_CHUNKS: usize = 1 << 14;

/// Chunks that an array may have, and a row of them.
const MOST_CHUNKS: usize = 1 << 30;
const MOST_IN_A_ROW: usize = 1 << 20;

/// An array in a folder.
#[derive(Clone, Debug)]
pub(super) struct Array {
    pub folder: PathBuf,
    pub meta: ArrayMeta,
}

/// What is read of an array.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Cut {
    /// The axes that x, y and z run along.
    pub space: [usize; 3],
    /// The axis that components do, if there are any.
    pub components: Option<usize>,
    /// Where it is held on all other axes; 0 on these.
    pub at: Vec<usize>,
}

/// A shard: its file, and where each of its chunks lies.
struct Shard {
    source: Source,
    /// First byte and number of bytes, both of all ones for a chunk that is not stored.
    index: Vec<[u64; 2]>,
}

/// A chunk in memory: where it is among all, and its numbers as they are stored, if they are.
struct Chunk {
    place: Vec<usize>,
    bytes: Option<Vec<u8>>,
}

impl Array {
    /// Numbers along x, y and z, and of a tuple, in a cut.
    pub fn size_of(&self, cut: &Cut) -> ([usize; 3], usize) {
        let points = cut.space.map(|axis| self.meta.shape[axis]);
        (
            points,
            cut.components.map_or(1, |axis| self.meta.shape[axis]),
        )
    }

    /// The numbers of a cut before they become what they are read as.
    fn layout(&self, cut: &Cut) -> Result<Layout, Problem> {
        let scalar_type = self.meta.stored.as_moved();
        let ([nx, ny, nz], components) = self.size_of(cut);
        let tuples = nx.checked_mul(ny).and_then(|n| n.checked_mul(nz));
        let layout = Layout {
            scalar_type,
            endianness: Endianness::NATIVE,
            components,
            tuples: tuples.unwrap_or(usize::MAX),
        };
        layout.len_bytes()?;
        Ok(layout)
    }

    /// Checks that a cut is one that memory could hold, before anything is read; its tuples.
    ///
    /// # Errors
    /// [`Problem::Array`], [`Problem::Unsupported`] for too many chunks.
    pub fn check(&self, cut: &Cut) -> Result<usize, Problem> {
        let layout = self.layout(cut)?;
        let chunks = self.counts(cut);
        let num = chunks.iter().try_fold(1usize, |n, &c| n.checked_mul(c));
        let [columns, _, _, of_components] = chunks;
        let in_a_row = columns.saturating_mul(of_components);
        if num.is_none_or(|num| num > MOST_CHUNKS) || in_a_row > MOST_IN_A_ROW {
            return Err(Problem::unsupported(format!(
                "an array of {chunks:?} chunks"
            )));
        }
        Ok(layout.tuples)
    }

    /// Chunks along x, y, z and components.
    fn counts(&self, cut: &Cut) -> [usize; 4] {
        let along = |axis: usize| self.meta.shape[axis].div_ceil(self.meta.chunk[axis]);
        let [x, y, z] = cut.space.map(along);
        [x, y, z, cut.components.map_or(1, along)]
    }

    /// Reads a cut.
    ///
    /// # Errors
    /// [`Problem`] naming the chunk's file and what is wrong in it.
    pub fn read(&self, cut: &Cut) -> Result<DataArray, Problem> {
        let layout = self.layout(cut)?;
        let [columns, rows, slabs, of_components] = self.counts(cut);
        let in_a_row = (columns * of_components).max(1);
        let row_bytes = self.meta.chunk_bytes().saturating_mul(in_a_row).max(1);
        let rows_at_a_time = (BATCH_BYTES / row_bytes).min(BATCH_CHUNKS / in_a_row);
        let rows_at_a_time = rows_at_a_time.clamp(1, rows.max(1));
        let values = layout.fill_array(false, |bytes| {
            for slab in 0..slabs {
                for first in (0..rows).step_by(rows_at_a_time) {
                    let batch = first..(first + rows_at_a_time).min(rows);
                    let chunks = self.chunks(cut, slab, batch)?;
                    self.place(cut, slab, &chunks, bytes);
                }
            }
            Ok(())
        });
        let values = values.map_err(|problem| match problem {
            Problem::Array(ArrayError::TooLarge { .. }) => Problem::unsupported_but(
                format!("an array of {:?} numbers", self.meta.shape),
                "it does not fit into memory; take a smaller level or part of it",
            ),
            other => other,
        })?;
        match self.meta.stored {
            Stored::Same(_) => Ok(values),
            Stored::Half => crate::npy::widen(&values),
        }
    }

    /// Unpacks some rows of chunks of a slab of them.
    fn chunks(
        &self,
        cut: &Cut,
        slab: usize,
        rows: std::ops::Range<usize>,
    ) -> Result<Vec<Chunk>, Problem> {
        let [columns, _, _, of_components] = self.counts(cut);
        let mut places = Vec::new();
        for row in rows {
            for column in 0..columns {
                for component in 0..of_components {
                    let at = cut.at.iter().zip(&self.meta.chunk);
                    let mut place: Vec<usize> = at.map(|(at, chunk)| at / chunk).collect();
                    for (axis, number) in cut.space.into_iter().zip([column, row, slab]) {
                        place[axis] = number;
                    }
                    if let Some(axis) = cut.components {
                        place[axis] = component;
                    }
                    places.push(place);
                }
            }
        }
        let shards = match &self.meta.shards {
            Some(shards) => Some(self.shards(shards, &places)?),
            None => None,
        };
        let chunks = places.into_par_iter().map(|place| {
            let bytes = match (&self.meta.shards, &shards) {
                (Some(meta), Some(shards)) => self.in_shard(meta, shards, &place)?,
                _ => self.in_file(&place)?,
            };
            Ok(Chunk { place, bytes })
        });
        chunks.collect()
    }

    /// Opens the file of a chunk or shard; `None` if there is none.
    fn open(&self, place: &[usize]) -> Result<Option<Source>, Problem> {
        let path = self.folder.join(self.meta.names.of(place));
        match Source::open(&path) {
            Ok(source) => Ok(Some(source)),
            Err(error) => match &error.problem {
                Problem::System { source, .. } if source.kind() == ErrorKind::NotFound => Ok(None),
                _ => Err(Problem::part(error)),
            },
        }
    }

    /// A chunk that has a file of its own.
    fn in_file(&self, place: &[usize]) -> Result<Option<Vec<u8>>, Problem> {
        let Some(source) = self.open(place)? else {
            return Ok(None);
        };
        self.unpacked(source.bytes())
            .map(Some)
            .map_err(|problem| in_source(problem, &source))
    }

    /// The numbers of a chunk, in native byte order.
    fn unpacked(&self, packed: &[u8]) -> Result<Vec<u8>, Problem> {
        let codecs = &self.meta.codecs;
        let mut bytes = unpack(&codecs.packing, packed, self.meta.chunk_bytes())?;
        let size = self.meta.stored.as_moved().size_bytes();
        if codecs.endianness != Endianness::NATIVE && size > 1 {
            swap_chunk(&mut bytes, size);
        }
        Ok(bytes)
    }

    /// The shards that chunks lie in, by their places.
    fn shards(
        &self,
        meta: &Shards,
        places: &[Vec<usize>],
    ) -> Result<HashMap<Vec<usize>, Option<Shard>>, Problem> {
        let mut shards = HashMap::new();
        for place in places {
            let of_shard = self.shard_of(meta, place);
            if shards.contains_key(&of_shard) {
                continue;
            }
            let shard = match self.open(&of_shard)? {
                Some(source) => Some(self.shard(meta, source)?),
                None => None,
            };
            shards.insert(of_shard, shard);
        }
        Ok(shards)
    }

    fn shard_of(&self, meta: &Shards, place: &[usize]) -> Vec<usize> {
        let sides = self.meta.chunk.iter().zip(&meta.shape);
        let of_axis = |(place, (chunk, shard)): (&usize, (&usize, &usize))| place / (shard / chunk);
        place.iter().zip(sides).map(of_axis).collect()
    }

    /// Reads where the chunks of a shard lie.
    fn shard(&self, meta: &Shards, source: Source) -> Result<Shard, Problem> {
        let sides = self.meta.chunk.iter().zip(&meta.shape);
        let num = sides
            .map(|(chunk, shard)| shard / chunk)
            .try_fold(1usize, |n, side| n.checked_mul(side));
        let unpacked_bytes = num.and_then(|num| num.checked_mul(16));
        let index_bytes = unpacked_bytes.and_then(|n| n.checked_add(4 * meta.index_packing.len()));
        let (unpacked_bytes, index_bytes) = (
            unpacked_bytes.unwrap_or(usize::MAX),
            index_bytes.unwrap_or(usize::MAX),
        );
        let at = match meta.index_is_last {
            true => source.len().saturating_sub(index_bytes),
            false => 0,
        };
        let index = source
            .piece("the shard's index", at, index_bytes)
            .and_then(|packed| unpack(&meta.index_packing, packed, unpacked_bytes))
            .map_err(|problem| in_source(problem, &source))?;
        let number = |bytes: &[u8; 8]| match meta.index_endianness {
            Endianness::Little => u64::from_le_bytes(*bytes),
            Endianness::Big => u64::from_be_bytes(*bytes),
        };
        let numbers: Vec<u64> = index.as_chunks().0.iter().map(number).collect();
        let index = numbers.as_chunks().0.to_vec();
        Ok(Shard { source, index })
    }

    /// A chunk that lies in a shard.
    fn in_shard(
        &self,
        meta: &Shards,
        shards: &HashMap<Vec<usize>, Option<Shard>>,
        place: &[usize],
    ) -> Result<Option<Vec<u8>>, Problem> {
        let Some(Some(shard)) = shards.get(&self.shard_of(meta, place)) else {
            return Ok(None);
        };
        let sides = self
            .meta
            .chunk
            .iter()
            .zip(&meta.shape)
            .map(|(chunk, shard)| shard / chunk);
        let number = place
            .iter()
            .zip(sides)
            .fold(0, |n, (place, side)| n * side + place % side);
        let Some(&[first, len]) = shard.index.get(number) else {
            return Ok(None);
        };
        if [first, len] == [u64::MAX; 2] {
            return Ok(None);
        }
        let (first, len) = (
            usize::try_from(first).unwrap_or(usize::MAX),
            usize::try_from(len).unwrap_or(usize::MAX),
        );
        let what = format!("chunk {number} of the shard");
        shard
            .source
            .piece(&what, first, len)
            .and_then(|packed| self.unpacked(packed))
            .map(Some)
            .map_err(|problem| in_source(problem, &shard.source))
    }

    /// Puts the numbers of chunks of a slab where they belong among all.
    fn place(&self, cut: &Cut, slab: usize, chunks: &[Chunk], bytes: &mut [u8]) {
        let ([nx, ny, nz], components) = self.size_of(cut);
        let size = self.meta.stored.as_moved().size_bytes();
        let [_, _, of_z] = cut.space.map(|axis| self.meta.chunk[axis]);
        let plane_bytes = nx * ny * components * size;
        let first = slab * of_z;
        let last = (first + of_z).min(nz);
        let strides = self.strides();
        bytes[first * plane_bytes..last * plane_bytes]
            .par_chunks_exact_mut(plane_bytes.max(1))
            .enumerate()
            .for_each(|(z, plane)| {
                let part = Part {
                    array: self,
                    cut,
                    strides: &strides,
                    z,
                };
                chunks.iter().for_each(|chunk| part.place(chunk, plane));
            });
    }

    /// Numbers from one to the next along each axis in a chunk as it is stored.
    fn strides(&self) -> Vec<usize> {
        let mut strides = vec![0; self.meta.chunk.len()];
        let mut stride = 1;
        for &axis in self.meta.codecs.order.iter().rev() {
            strides[axis] = stride;
            stride *= self.meta.chunk[axis];
        }
        strides
    }
}

/// A plane that chunks reach into.
struct Part<'a> {
    array: &'a Array,
    cut: &'a Cut,
    strides: &'a [usize],
    /// The plane, from the first that the chunks have.
    z: usize,
}

impl Part<'_> {
    fn place(&self, chunk: &Chunk, plane: &mut [u8]) {
        let meta = &self.array.meta;
        let ([nx, ny, _], components) = self.array.size_of(self.cut);
        let size = meta.stored.as_moved().size_bytes();
        let is_zero = meta.fill.iter().all(|&b| b == 0);
        if chunk.bytes.is_none() && is_zero {
            // As the memory is already.
            return;
        }
        let range = |axis: usize, n: usize| {
            let first = chunk.place[axis] * meta.chunk[axis];
            first..(first + meta.chunk[axis]).min(n)
        };
        let [x_axis, y_axis, z_axis] = self.cut.space;
        let (columns, rows) = (range(x_axis, nx), range(y_axis, ny));
        let (of_tuple, component_stride) = match self.cut.components {
            Some(axis) => (range(axis, components), self.strides[axis]),
            None => (0..1, 0),
        };
        let held = self.cut.at.iter().zip(&meta.chunk).zip(self.strides);
        let base = held
            .map(|((at, chunk), stride)| at % chunk * stride)
            .sum::<usize>()
            + self.z * self.strides[z_axis];
        let x_stride = self.strides[x_axis];
        let is_run = components == 1 && x_stride == 1
            || of_tuple.len() == components && component_stride == 1 && x_stride == components;
        for (row, y) in rows.enumerate() {
            let from = base + row * self.strides[y_axis];
            let to = ((y * nx + columns.start) * components + of_tuple.start) * size;
            let run = columns.len() * components * size;
            match &chunk.bytes {
                Some(bytes) if is_run => {
                    plane[to..to + run].copy_from_slice(&bytes[from * size..][..run]);
                }
                bytes => {
                    for i in 0..columns.len() {
                        for c in 0..of_tuple.len() {
                            let to = to + (i * components + c) * size;
                            let value = match bytes {
                                Some(bytes) => {
                                    let from = from + i * x_stride + c * component_stride;
                                    &bytes[from * size..][..size]
                                }
                                None => &meta.fill,
                            };
                            plane[to..to + size].copy_from_slice(value);
                        }
                    }
                }
            }
        }
    }
}

/// Says in which file a problem is.
fn in_source(problem: Problem, source: &Source) -> Problem {
    Problem::part(problem.in_file(source.path()))
}
