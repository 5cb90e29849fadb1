//! What packs the bytes of a chunk, undone: one method after the other, each within known bounds.

use std::io::Read;

use bzip2::read::MultiBzDecoder;
use flate2::read::{MultiGzDecoder, ZlibDecoder};
use lzma_rust2::XzReader;
use ruzstd::decoding::StreamingDecoder;
use serde_json::Value;

use super::blosc;
use crate::error::Problem;

/// A method that packs bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Packing {
    Gzip,
    Zlib,
    Zstd,
    Blosc,
    /// A length of four bytes and a block.
    Lz4,
    Bzip2,
    Xz,
    /// A checksum of four bytes at the end.
    Crc32c,
}

impl Packing {
    /// A method by its name in version 2, or in version 3, where those of version 2 are `numcodecs.NAME`.
    ///
    /// # Errors
    /// [`Problem::Unsupported`] naming it.
    pub fn of_name(name: &str, configuration: &Value) -> Result<Self, Problem> {
        let short = name.strip_prefix("numcodecs.").unwrap_or(name);
        Ok(match short {
            "gzip" => Self::Gzip,
            "zlib" => Self::Zlib,
            "zstd" => Self::Zstd,
            "blosc" => Self::Blosc,
            "lz4" => Self::Lz4,
            "bz2" => Self::Bzip2,
            "crc32c" => Self::Crc32c,
            // Its own container; without one, filters would have to be known.
            "lzma"
                if configuration["format"]
                    .as_u64()
                    .is_none_or(|format| format == 1) =>
            {
                Self::Xz
            }
            _ => return Err(Problem::unsupported(format!("the codec `{name}`"))),
        })
    }

    /// Undoes it; the result has at most so many bytes.
    ///
    /// # Errors
    /// [`Problem::Malformed`] if it cannot be undone, or there would be more.
    fn undo(self, packed: &[u8], most_bytes: usize) -> Result<Vec<u8>, Problem> {
        match self {
            Self::Gzip => read("gzip", MultiGzDecoder::new(packed), most_bytes),
            Self::Zlib => inflate(packed, most_bytes),
            Self::Bzip2 => read("bzip2", MultiBzDecoder::new(packed), most_bytes),
            Self::Xz => read("xz", XzReader::new(packed, true), most_bytes),
            Self::Zstd => zstd(packed, most_bytes),
            Self::Blosc => blosc::unpack(packed, most_bytes),
            Self::Lz4 => {
                let wrong = |expected, found| Problem::malformed("LZ4 data", expected, found);
                let Some((len, block)) = packed.split_first_chunk::<4>() else {
                    return Err(wrong(
                        "a length".to_owned(),
                        format!("{} bytes", packed.len()),
                    ));
                };
                let len = u32::from_le_bytes(*len) as usize;
                if len > most_bytes {
                    return Err(wrong(
                        format!("at most {most_bytes} bytes"),
                        len.to_string(),
                    ));
                }
                let mut unpacked = vec![0; len];
                lz4_block(block, &mut unpacked)?;
                Ok(unpacked)
            }
            Self::Crc32c => {
                let Some((data, sum)) = packed.split_last_chunk::<4>() else {
                    return Err(Problem::malformed(
                        "checksum",
                        "4 bytes",
                        format!("{} bytes", packed.len()),
                    ));
                };
                let (stored, found) = (u32::from_le_bytes(*sum), crc32c::crc32c(data));
                if stored != found {
                    return Err(Problem::malformed(
                        "data",
                        format!("CRC-32C {stored:08x}"),
                        format!("{found:08x}"),
                    ));
                }
                Ok(data.to_vec())
            }
        }
    }
}

/// Undoes all that packs a chunk, the last one first, which must then have as many bytes as expected.
///
/// # Errors
/// [`Problem::Malformed`] if one of them cannot be undone, or the result has another size.
pub(super) fn unpack(
    packing: &[Packing],
    packed: &[u8],
    expected_bytes: usize,
) -> Result<Vec<u8>, Problem> {
    // What is not yet unpacked for the last time may be a little larger than what is.
    let most_between = expected_bytes.saturating_mul(2).saturating_add(1 << 16);
    let mut bytes: Option<Vec<u8>> = None;
    for (i, method) in packing.iter().enumerate().rev() {
        let most_bytes = if i == 0 { expected_bytes } else { most_between };
        bytes = Some(method.undo(bytes.as_deref().unwrap_or(packed), most_bytes)?);
    }
    let len = bytes.as_ref().map_or(packed.len(), Vec::len);
    if len != expected_bytes {
        return Err(Problem::malformed(
            "data",
            format!("{expected_bytes} bytes"),
            format!("{len} bytes"),
        ));
    }
    Ok(bytes.unwrap_or_else(|| packed.to_vec()))
}

/// Reads to the end, which must come after so many bytes at most.
fn read(what: &str, from: impl Read, most_bytes: usize) -> Result<Vec<u8>, Problem> {
    let mut unpacked = Vec::new();
    let limit = (most_bytes as u64).saturating_add(1);
    let found = from.take(limit).read_to_end(&mut unpacked);
    found.map_err(|error| {
        Problem::malformed(format!("{what} data"), "it whole", error.to_string())
    })?;
    if unpacked.len() > most_bytes {
        let expected = format!("at most {most_bytes} bytes");
        return Err(Problem::malformed(format!("{what} data"), expected, "more"));
    }
    Ok(unpacked)
}

/// A zlib stream.
pub(super) fn inflate(packed: &[u8], most_bytes: usize) -> Result<Vec<u8>, Problem> {
    read("zlib", ZlibDecoder::new(packed), most_bytes)
}

/// Zstandard frames, one after the other.
pub(super) fn zstd(mut packed: &[u8], most_bytes: usize) -> Result<Vec<u8>, Problem> {
    let mut unpacked = Vec::new();
    loop {
        let frame = StreamingDecoder::new(&mut packed)
            .map_err(|error| Problem::malformed("Zstandard data", "a frame", error.to_string()))?;
        let left = most_bytes - unpacked.len();
        unpacked.extend(read("Zstandard", frame, left)?);
        if packed.is_empty() {
            return Ok(unpacked);
        }
    }
}

/// A block of LZ4, which must fill all of `to`.
pub(super) fn lz4_block(packed: &[u8], to: &mut [u8]) -> Result<(), Problem> {
    let expected = to.len();
    match lz4_flex::block::decompress_into(packed, to) {
        Ok(found) if found == expected => Ok(()),
        Ok(found) => Err(Problem::malformed(
            "LZ4 block",
            format!("{expected} bytes"),
            format!("{found} bytes"),
        )),
        Err(error) => Err(Problem::malformed(
            "LZ4 block",
            format!("{expected} bytes"),
            error.to_string(),
        )),
    }
}
