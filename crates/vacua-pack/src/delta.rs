//! Lists of numbers in few bits: the map from packed to original order in a file.
//!
//! ```text
//! blocks of 128 numbers, the last of what is left:
//! byte 0  bits a number takes, 0 to 56; 128 more if they are differences
//!      1  base   u64   the smallest number; with differences, the first
//!      9  so many bits for each number, lowest first, filled up to a whole byte:
//!         the number less the base; or, from the second on, the difference to the one before,
//!         doubled, or for a negative one doubled and inverted (zigzag)
//! ```

use rayon::prelude::*;
use vacua_io::Problem;

use crate::ids::Ids;

/// Numbers in a block.
const BLOCK: usize = 128;
/// Bytes of a block before its bits.
const HEAD_BYTES: usize = 9;
/// Most bits a number may take: with up to seven before them they are within eight bytes.
const MAX_WIDTH: u32 = 56;
/// Marks blocks of differences.
const DIFFERENCES: u8 = 128;

/// Encodes numbers below 2^55 as they come.
#[derive(Default)]
pub struct DeltaWriter {
    pending: Vec<u64>,
}

impl DeltaWriter {
    /// Appends numbers; blocks that are full go to `out`.
    pub fn append(&mut self, ids: &Ids, out: &mut Vec<u8>) {
        for place in 0..ids.len() {
            self.pending.push(ids.get(place));
            if self.pending.len() == BLOCK {
                self.flush(out);
            }
        }
    }

    /// Ends the list.
    pub fn flush(&mut self, out: &mut Vec<u8>) {
        if !self.pending.is_empty() {
            encode_block(&self.pending, out);
            self.pending.clear();
        }
    }
}

fn bits_of(value: u64) -> u32 {
    u64::BITS - value.leading_zeros()
}

fn zigzag(from: u64, to: u64) -> u64 {
    let difference = to.wrapping_sub(from) as i64;
    ((difference << 1) ^ (difference >> 63)) as u64
}

fn encode_block(ids: &[u64], out: &mut Vec<u8>) {
    let smallest = ids.iter().copied().min().unwrap_or(0);
    let largest = ids.iter().copied().max().unwrap_or(0);
    let width = bits_of(largest - smallest);
    let differences = || ids.windows(2).map(|w| zigzag(w[0], w[1]));
    let difference_width = differences().map(bits_of).max().unwrap_or(0);
    if difference_width < width {
        out.push(difference_width as u8 | DIFFERENCES);
        out.extend_from_slice(&ids[0].to_le_bytes());
        push_bits(differences(), difference_width, out);
    } else {
        out.push(width as u8);
        out.extend_from_slice(&smallest.to_le_bytes());
        push_bits(ids.iter().map(|id| id - smallest), width, out);
    }
}

fn push_bits(values: impl Iterator<Item = u64>, width: u32, out: &mut Vec<u8>) {
    let (mut pending, mut num_pending) = (0u128, 0);
    for value in values {
        pending |= u128::from(value) << num_pending;
        num_pending += width;
        while num_pending >= 8 {
            out.push(pending as u8);
            pending >>= 8;
            num_pending -= 8;
        }
    }
    if num_pending > 0 {
        out.push(pending as u8);
    }
}

/// A block in the list.
struct Block<'a> {
    has_differences: bool,
    width: u32,
    base: u64,
    /// Its bits, and those of the blocks after it.
    bits: &'a [u8],
}

/// The first block of a list with so many numbers left, and the rest.
fn block(bytes: &[u8], left: usize) -> Option<(Block<'_>, &[u8])> {
    let head = bytes.get(..HEAD_BYTES)?;
    let has_differences = head[0] & DIFFERENCES != 0;
    let width = u32::from(head[0] & !DIFFERENCES);
    if width > MAX_WIDTH {
        return None;
    }
    let num_values = left.min(BLOCK) - usize::from(has_differences);
    let end = HEAD_BYTES + (num_values * width as usize).div_ceil(8);
    let rest = bytes.get(end..)?;
    let block = Block {
        has_differences,
        width,
        base: bytemuck::pod_read_unaligned(&head[1..]),
        bits: &bytes[HEAD_BYTES..],
    };
    Some((block, rest))
}

impl Block<'_> {
    #[inline(always)]
    fn value(&self, place: usize) -> u64 {
        let bit = place * self.width as usize;
        let byte = bit / 8;
        let eight = match self.bits.get(byte..byte + 8) {
            Some(eight) => bytemuck::pod_read_unaligned(eight),
            None => {
                let rest = self.bits.get(byte..).unwrap_or(&[]);
                let fold = rest.iter().rev();
                fold.fold(0u64, |sum, &b| sum << 8 | u64::from(b))
            }
        };
        eight >> (bit % 8) & ((1u64 << self.width) - 1)
    }

    #[inline(always)]
    fn decode(&self, ids: &mut [u64]) {
        if !self.has_differences {
            for (place, id) in ids.iter_mut().enumerate() {
                *id = self.base.wrapping_add(self.value(place));
            }
            return;
        }
        let mut last = self.base;
        let Some((first, rest)) = ids.split_first_mut() else {
            return;
        };
        *first = last;
        for (place, id) in rest.iter_mut().enumerate() {
            let z = self.value(place);
            last = last.wrapping_add((z >> 1) ^ (z & 1).wrapping_neg());
            *id = last;
        }
    }
}

/// A list where it lies, decoded as it is read.
pub struct Blocks<'a> {
    blocks: Vec<Block<'a>>,
    len: usize,
}

impl<'a> Blocks<'a> {
    /// Finds the blocks of a list of so many numbers.
    ///
    /// # Errors
    /// [`Problem`] if the bytes are no such list.
    pub fn new(what: &str, bytes: &'a [u8], len: usize) -> Result<Self, Problem> {
        let num_blocks = len.div_ceil(BLOCK);
        let too_short = |found: usize| {
            Problem::malformed(
                format!("block {found} of the {what}"),
                format!("{num_blocks} blocks of at most {MAX_WIDTH} bits a number"),
                format!("{} bytes", bytes.len()),
            )
        };
        // Each block has a head: no more are looked for than there can be.
        if num_blocks > bytes.len() / HEAD_BYTES {
            return Err(too_short(bytes.len() / HEAD_BYTES));
        }
        let mut blocks = Vec::with_capacity(num_blocks);
        let mut rest = bytes;
        for number in 0..num_blocks {
            let (block, after) =
                block(rest, len - number * BLOCK).ok_or_else(|| too_short(number))?;
            blocks.push(block);
            rest = after;
        }
        if !rest.is_empty() {
            let expected = format!("{num_blocks} blocks");
            let found = format!("{} bytes more", rest.len());
            return Err(Problem::malformed(
                format!("end of the {what}"),
                expected,
                found,
            ));
        }
        Ok(Self { blocks, len })
    }

    /// How many numbers there are.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Decodes the block of a place; gives how many numbers it has.
    #[inline(always)]
    fn decode_block(&self, number: usize, ids: &mut [u64; BLOCK]) -> usize {
        let len = (self.len - number * BLOCK).min(BLOCK);
        self.blocks[number].decode(&mut ids[..len]);
        len
    }

    /// The largest number; 0 without any.
    pub fn largest(&self) -> u64 {
        let mut ids = [0; BLOCK];
        let blocks = 0..self.blocks.len();
        let largest = blocks.map(|number| {
            let len = self.decode_block(number, &mut ids);
            ids[..len].iter().copied().max().unwrap_or(0)
        });
        largest.max().unwrap_or(0)
    }

    /// The values at the numbers from a place on, as many as `picked` has room for.
    ///
    /// # Errors
    /// A number that no value has.
    pub fn pick<T: Copy>(&self, first: usize, all: &[T], picked: &mut [T]) -> Result<(), u64> {
        let end = (first + picked.len()).min(self.len);
        if first >= end {
            return Ok(());
        }
        let mut left = picked;
        let mut from = first % BLOCK;
        // The values of the next block are asked for while those of one are fetched.
        let mut both = [[0; BLOCK]; 2];
        let last = (end - 1) / BLOCK;
        let mut len = self.decode_block(first / BLOCK, &mut both[0]);
        for number in first / BLOCK..=last {
            let [here, next] = &mut both;
            let mut next_len = 0;
            if number < last {
                next_len = self.decode_block(number + 1, next);
                for &id in &next[..next_len] {
                    vacua_simd::prefetch(all, id as usize);
                }
            }
            let ids = &here[from..len];
            let (now, rest) = left.split_at_mut(ids.len().min(left.len()));
            for (picked, &id) in now.iter_mut().zip(ids) {
                *picked = *all.get(id as usize).ok_or(id)?;
            }
            left = rest;
            (from, len) = (0, next_len);
            both.swap(0, 1);
        }
        Ok(())
    }

    /// All numbers.
    pub fn decode(&self) -> Ids {
        let mut ids = vec![0u32; self.len];
        let pieces = ids.par_chunks_mut(BLOCK).zip(&self.blocks);
        let largest = pieces.map(|(piece, block)| {
            let mut wide = [0; BLOCK];
            block.decode(&mut wide[..piece.len()]);
            let mut largest = 0;
            for (id, &wide) in piece.iter_mut().zip(&wide) {
                *id = wide as u32;
                largest = largest.max(wide);
            }
            largest
        });
        if largest.max().is_none_or(|largest| largest < 1 << 32) {
            return Ids::Narrow(ids);
        }
        let mut ids = vec![0u64; self.len];
        let pieces = ids.par_chunks_mut(BLOCK).zip(&self.blocks);
        pieces.for_each(|(piece, block)| block.decode(piece));
        Ids::Wide(ids)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn decode(what: &str, bytes: &[u8], len: usize) -> Result<Ids, Problem> {
        Blocks::new(what, bytes, len).map(|blocks| blocks.decode())
    }

    fn encode(ids: &[u64], pieces: usize) -> Vec<u8> {
        let (mut writer, mut out) = (DeltaWriter::default(), Vec::new());
        for piece in ids.chunks(ids.len().div_ceil(pieces).max(1)) {
            let mut list = Ids::below(u64::MAX, piece.len());
            piece.iter().for_each(|&id| list.push(id));
            writer.append(&list, &mut out);
        }
        writer.flush(&mut out);
        out
    }

    #[test]
    fn neighbours_take_few_bytes() {
        let ids: Vec<u64> = (0..10_000).map(|i| 5_000_000 + i).collect();
        assert!(encode(&ids, 1).len() < 4000);
        assert!(encode(&[7; 1000], 1).len() < 100);
    }

    proptest! {
        #[test]
        fn numbers_come_back(
            ids in prop::collection::vec(prop_oneof![0u64..1 << 55, 0u64..300, 1u64 << 40..(1 << 40) + 9], 0..600),
            pieces in 1usize..5,
        ) {
            let bytes = encode(&ids, pieces);
            let back = decode("map", &bytes, ids.len()).expect("a list");
            prop_assert!((0..back.len()).map(|i| back.get(i)).eq(ids.iter().copied()));
            let blocks = Blocks::new("map", &bytes, ids.len()).expect("a list");
            prop_assert_eq!(blocks.largest(), ids.iter().copied().max().unwrap_or(0));
            // Values that are their numbers, from any place on.
            let few: Vec<u64> = ids.iter().map(|id| id % 251).collect();
            let bytes_of_few = encode(&few, pieces);
            let blocks = Blocks::new("map", &bytes_of_few, few.len()).expect("a list");
            let all: Vec<u16> = (0..251).collect();
            for first in [0, 1, BLOCK - 1, BLOCK, few.len() / 2] {
                let mut picked = vec![0; few.len().saturating_sub(first) / 2];
                prop_assert_eq!(blocks.pick(first, &all, &mut picked), Ok(()));
                prop_assert!(picked.iter().map(|&v| u64::from(v)).eq(few[first.min(few.len())..].iter().copied().take(picked.len())));
            }
            if few.contains(&250) {
                let mut picked = vec![0; few.len()];
                prop_assert_eq!(blocks.pick(0, &all[..250], &mut picked), Err(250));
            }
            if !ids.is_empty() {
                prop_assert!(decode("map", &bytes[..bytes.len() - 1], ids.len()).is_err());
            }
        }

        #[test]
        fn any_bytes_are_a_list_or_none(
            bytes in prop::collection::vec(any::<u8>(), 0..300),
            len in prop_oneof![0usize..1000, Just(usize::MAX)],
        ) {
            if let Ok(ids) = decode("map", &bytes, len) {
                prop_assert_eq!(ids.len(), len);
            }
        }
    }
}
