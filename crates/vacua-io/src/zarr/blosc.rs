//! Blosc 1 containers: blocks whose bytes are shuffled by significance and compressed, the usual packing
//! of Zarr chunks.
//!
//! Ours because the crates that read them bind C with its own copies of codecs that we have in Rust. The
//! container, both shuffles and BloscLZ are read here, LZ4, zlib and Zstandard by their crates. Source: c-blosc 1.21,
//! `README_HEADER.rst`, `blosc.c`, `shuffle-generic.h`, `bitshuffle-generic.c` and `blosclz.c`.

use super::unpack::{inflate, lz4_block, zstd};
use crate::error::Problem;

/// Bytes of the header.
const HEADER_BYTES: usize = 16;

/// The version of the container.
const VERSION: u8 = 2;

/// How the bytes of numbers are rearranged within a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shuffle {
    None,
    /// First bytes of all numbers, then second ones …
    Bytes,
    /// First bits of all numbers, then second ones …
    Bits,
}

/// What compresses a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Method {
    BloscLz,
    Lz4,
    Zlib,
    Zstd,
}

struct Header {
    shuffle: Shuffle,
    method: Method,
    /// Whether nothing is compressed.
    is_copy: bool,
    /// Whether each byte of numbers has a stream of its own in whole blocks.
    is_split: bool,
    type_bytes: usize,
    unpacked_bytes: usize,
    block_bytes: usize,
    packed_bytes: usize,
}

fn wrong(expected: impl Into<String>, found: impl Into<String>) -> Problem {
    Problem::malformed("Blosc container", expected, found)
}

impl Header {
    fn read(packed: &[u8]) -> Result<Self, Problem> {
        let Some((header, _)) = packed.split_first_chunk::<HEADER_BYTES>() else {
            return Err(wrong(
                format!("a header of {HEADER_BYTES} bytes"),
                format!("{} bytes", packed.len()),
            ));
        };
        let [version, _, flags, type_bytes, sizes @ ..] = *header;
        if version != VERSION {
            return Err(wrong(format!("version {VERSION}"), version.to_string()));
        }
        let size = |i: usize| {
            let at = 4 * i;
            u32::from_le_bytes([sizes[at], sizes[at + 1], sizes[at + 2], sizes[at + 3]]) as usize
        };
        let header = Self {
            shuffle: match flags & 0b101 {
                0 => Shuffle::None,
                1 => Shuffle::Bytes,
                4 => Shuffle::Bits,
                _ => return Err(wrong("one shuffle", "both")),
            },
            method: match flags >> 5 {
                0 => Method::BloscLz,
                1 => Method::Lz4,
                2 => return Err(Problem::unsupported("Snappy in a Blosc container")),
                3 => Method::Zlib,
                4 => Method::Zstd,
                other => return Err(wrong("a method up to 4", other.to_string())),
            },
            is_copy: flags & 2 != 0,
            is_split: flags & 16 == 0,
            type_bytes: usize::from(type_bytes).max(1),
            unpacked_bytes: size(0),
            block_bytes: size(1),
            packed_bytes: size(2),
        };
        if header.packed_bytes > packed.len() || header.packed_bytes < HEADER_BYTES {
            return Err(wrong(
                format!("{} bytes", header.packed_bytes),
                format!("{} bytes", packed.len()),
            ));
        }
        if header.block_bytes == 0 && header.unpacked_bytes > 0 {
            return Err(wrong("blocks", "blocks of no bytes"));
        }
        Ok(header)
    }
}

/// Unpacks a container of at most so many bytes.
///
/// # Errors
/// [`Problem::Malformed`] naming what is wrong in it, [`Problem::Unsupported`] for Snappy.
pub(super) fn unpack(packed: &[u8], most_bytes: usize) -> Result<Vec<u8>, Problem> {
    let header = Header::read(packed)?;
    let packed = &packed[..header.packed_bytes];
    if header.unpacked_bytes > most_bytes {
        return Err(wrong(
            format!("at most {most_bytes} bytes in it"),
            format!("{} bytes", header.unpacked_bytes),
        ));
    }
    if header.is_copy {
        let all = packed[HEADER_BYTES..].get(..header.unpacked_bytes);
        let all = all.ok_or_else(|| wrong("as many bytes as it says", "fewer"))?;
        return Ok(all.to_vec());
    }
    if header.unpacked_bytes == 0 {
        return Ok(Vec::new());
    }
    let num_blocks = header.unpacked_bytes.div_ceil(header.block_bytes);
    let starts = num_blocks
        .checked_mul(4)
        .and_then(|len| packed[HEADER_BYTES..].get(..len));
    let Some(starts) = starts else {
        return Err(wrong(
            format!("where its {num_blocks} blocks begin"),
            format!("{} bytes in all", packed.len()),
        ));
    };
    let mut unpacked = vec![0; header.unpacked_bytes];
    let mut shuffled = Vec::new();
    let blocks = unpacked.chunks_mut(header.block_bytes);
    for (to, start) in blocks.zip(starts.as_chunks::<4>().0) {
        let start = u32::from_le_bytes(*start) as usize;
        let from = packed
            .get(start..)
            .filter(|_| start >= HEADER_BYTES)
            .ok_or_else(|| wrong("a block within it", format!("one at byte {start}")))?;
        if header.shuffle == Shuffle::None
            || header.type_bytes == 1 && header.shuffle == Shuffle::Bytes
        {
            unpack_block(&header, from, to)?;
            continue;
        }
        shuffled.resize(to.len(), 0);
        unpack_block(&header, from, &mut shuffled)?;
        match header.shuffle {
            Shuffle::Bits => unshuffle_bits(&shuffled, header.type_bytes, to),
            _ => unshuffle_bytes(&shuffled, header.type_bytes, to),
        }
    }
    Ok(unpacked)
}

/// Unpacks the streams of a block.
fn unpack_block(header: &Header, mut from: &[u8], to: &mut [u8]) -> Result<(), Problem> {
    /// Blocks with fewer numbers are not split.
    const LEAST_NUMBERS: usize = 128;
    /// Numbers of more bytes are not split.
    const MOST_STREAMS: usize = 16;
    let is_whole = to.len() == header.block_bytes;
    let streams = if header.is_split
        && is_whole
        && header.type_bytes <= MOST_STREAMS
        && to.len() / header.type_bytes >= LEAST_NUMBERS
    {
        header.type_bytes
    } else {
        1
    };
    let stream_bytes = to.len() / streams;
    // What the last stream has beyond that is a container's own fault.
    for to in to.chunks_exact_mut(stream_bytes.max(1)) {
        let cut = || wrong("streams of a block", "the container's end");
        let (len, rest) = from.split_first_chunk::<4>().ok_or_else(cut)?;
        let len = u32::from_le_bytes(*len) as usize;
        let (stream, rest) = rest.split_at_checked(len).ok_or_else(cut)?;
        from = rest;
        if len == to.len() {
            to.copy_from_slice(stream);
            continue;
        }
        match header.method {
            Method::BloscLz => blosclz(stream, to)?,
            Method::Lz4 => lz4_block(stream, to)?,
            Method::Zlib => to.copy_from_slice(&exactly(inflate(stream, to.len())?, to.len())?),
            Method::Zstd => to.copy_from_slice(&exactly(zstd(stream, to.len())?, to.len())?),
        }
    }
    Ok(())
}

fn exactly(bytes: Vec<u8>, len: usize) -> Result<Vec<u8>, Problem> {
    if bytes.len() == len {
        return Ok(bytes);
    }
    Err(wrong(
        format!("a stream of {len} bytes"),
        format!("{} bytes", bytes.len()),
    ))
}

/// Puts the bytes of each number together again.
fn unshuffle_bytes(from: &[u8], type_bytes: usize, to: &mut [u8]) {
    let numbers = from.len() / type_bytes;
    let whole = numbers * type_bytes;
    for (byte, plane) in from[..whole].chunks_exact(numbers.max(1)).enumerate() {
        for (to, &from) in to[byte..].iter_mut().step_by(type_bytes).zip(plane) {
            *to = from;
        }
    }
    to[whole..].copy_from_slice(&from[whole..]);
}

/// Puts the bits of each number together again. Blocks whose numbers do not come in eights are left as they
/// are.
fn unshuffle_bits(from: &[u8], type_bytes: usize, to: &mut [u8]) {
    let numbers = from.len() / type_bytes;
    if !numbers.is_multiple_of(8) {
        to.copy_from_slice(from);
        return;
    }
    let whole = numbers * type_bytes;
    // A plane has a bit of each number.
    let plane_bytes = numbers / 8;
    for eight in 0..plane_bytes {
        for byte in 0..type_bytes {
            let mut bits = 0u64;
            for bit in 0..8 {
                let plane = from[(8 * byte + bit) * plane_bytes + eight];
                bits |= u64::from(plane) << (8 * bit);
            }
            for (i, turned) in transposed(bits).to_le_bytes().into_iter().enumerate() {
                to[(8 * eight + i) * type_bytes + byte] = turned;
            }
        }
    }
    to[whole..].copy_from_slice(&from[whole..]);
}

/// Bit i of byte j becomes bit j of byte i (Hacker's Delight, §7-3).
fn transposed(mut bits: u64) -> u64 {
    for (shift, mask) in [
        (7, 0x00aa_00aa_00aa_00aa),
        (14, 0x0000_cccc_0000_cccc),
        (28, 0x0000_0000_f0f0_f0f0),
    ] {
        let swapped = (bits ^ bits >> shift) & mask;
        bits ^= swapped ^ swapped << shift;
    }
    bits
}

/// Unpacks BloscLZ, a kind of FastLZ: literals, and copies of what came before.
fn blosclz(packed: &[u8], to: &mut [u8]) -> Result<(), Problem> {
    /// Copies from farther back have two more bytes of distance.
    const MOST_NEAR: usize = 8191;
    let cut = || wrong("a BloscLZ stream", "its end too early");
    let mut bytes = packed.iter().copied();
    let mut next = || bytes.next().map(usize::from).ok_or_else(cut);
    let mut at = 0;
    let mut control = next()? & 31;
    loop {
        if control < 32 {
            let literals = to.get_mut(at..at + control + 1).ok_or_else(cut)?;
            for to in literals.iter_mut() {
                *to = next()? as u8;
            }
            at += control + 1;
        } else {
            let mut len = (control >> 5) - 1;
            let mut distance = (control & 31) << 8;
            if len == 6 {
                loop {
                    let more = next()?;
                    len += more;
                    if more != 255 {
                        break;
                    }
                }
            }
            let low = next()?;
            len += 3;
            distance += low;
            if low == 255 && distance == (31 << 8) + 255 {
                distance = (next()? << 8) + next()? + MOST_NEAR;
            }
            distance += 1;
            if distance > at || len > to.len() - at {
                return Err(wrong("a copy of what came before", "one of what did not"));
            }
            for i in at..at + len {
                to[i] = to[i - distance];
            }
            at += len;
        }
        if at == to.len() {
            return Ok(());
        }
        control = next()?;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shuffles_are_undone() {
        let numbers: Vec<u8> = (0..64u32)
            .flat_map(|i| (i * 0x0102_0408).to_le_bytes())
            .collect();
        let mut shuffled = vec![0; numbers.len()];
        for (i, number) in numbers.chunks(4).enumerate() {
            for (byte, &b) in number.iter().enumerate() {
                shuffled[64 * byte + i] = b;
            }
        }
        let mut found = vec![0; numbers.len()];
        unshuffle_bytes(&shuffled, 4, &mut found);
        assert_eq!(found, numbers);

        let mut shuffled = vec![0u8; numbers.len()];
        for (i, number) in numbers.chunks(4).enumerate() {
            for bit in 0..32 {
                shuffled[8 * bit + i / 8] |= (number[bit / 8] >> (bit % 8) & 1) << (i % 8);
            }
        }
        unshuffle_bits(&shuffled, 4, &mut found);
        assert_eq!(found, numbers);
    }

    #[test]
    fn headers_that_lie_are_refused() {
        let header = |flags: u8, sizes: [u32; 3]| {
            let mut bytes = vec![VERSION, 1, flags, 4];
            sizes.iter().for_each(|n| bytes.extend(n.to_le_bytes()));
            bytes
        };
        for (what, bytes) in [
            ("nothing", vec![]),
            ("no blocks", header(0x21, [1000, 0, 16])),
            ("more than there is", header(0x21, [1000, 100, 500])),
            ("less than a header", header(0x21, [1000, 100, 4])),
            ("no starts", header(0x21, [1000, 10, 16])),
            ("too large", header(0x23, [u32::MAX, 10, 16])),
            ("a copy that is not there", header(0x23, [100, 10, 16])),
            ("snappy", header(0x41, [100, 100, 16])),
            ("unknown", header(0xe1, [100, 100, 16])),
        ] {
            assert!(unpack(&bytes, 4000).is_err(), "{what}");
        }
    }
}
