//! Binary data of VTK XML files: base64 text, and compressed blocks.
//!
//! Compressed data is `[#blocks][block size][last block's size or 0][compressed size …]` followed
//! by the blocks, which are independent and decompress in parallel. VTK writes zlib streams, raw
//! LZ4 blocks and xz streams.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use rayon::prelude::*;

use crate::error::Problem;

/// Base64 text that one task decodes; a multiple of 4.
const CHUNK_CHARS: usize = 1 << 18;

/// Dictionary of the strongest xz preset, and the decoder's own needs, in KiB.
const LZMA_MEMORY_KIB: u32 = (64 << 10) + 512;

/// Decodes the first `wanted` bytes. Padding may occur anywhere: headers and data are often
/// encoded one after the other.
///
/// # Errors
/// [`Problem::Malformed`] for characters that are not base64, or too few of them.
pub(super) fn decode_base64(text: &[u8], wanted: usize, what: &str) -> Result<Vec<u8>, Problem> {
    let too_few = |found: usize| {
        Problem::malformed(
            what,
            format!("base64 text of {wanted} bytes"),
            format!("{found} bytes"),
        )
    };
    if wanted > text.len() / 4 * 3 {
        return Err(too_few(text.len() / 4 * 3));
    }
    let mut bytes = Vec::with_capacity(wanted + 3);
    let mut rest = text;
    while bytes.len() < wanted {
        let quads = (wanted - bytes.len()).div_ceil(3);
        let chars = (quads * 4).min(rest.len() / 4 * 4);
        let stretch = match memchr::memchr(b'=', &rest[..chars]) {
            Some(padding) => (padding / 4 + 1) * 4,
            None => chars,
        };
        if stretch == 0 {
            return Err(too_few(bytes.len()));
        }
        decode_stretch(&rest[..stretch], &mut bytes, what)?;
        rest = &rest[stretch..];
    }
    bytes.truncate(wanted);
    Ok(bytes)
}

/// Appends the bytes of base64 text whose length is a multiple of 4, padded at its end at most.
fn decode_stretch(text: &[u8], bytes: &mut Vec<u8>, what: &str) -> Result<(), Problem> {
    let start = bytes.len();
    bytes.resize(start + text.len() / 4 * 3, 0);
    let decoded: Vec<usize> = text
        .par_chunks(CHUNK_CHARS)
        .zip(bytes[start..].par_chunks_mut(CHUNK_CHARS / 4 * 3))
        .map(|(text, to)| STANDARD.decode_slice(text, to))
        .collect::<Result<_, _>>()
        .map_err(|e| Problem::malformed(what, "base64 text", e.to_string()))?;
    bytes.truncate(start + decoded.iter().sum::<usize>());
    Ok(())
}

/// What compressed the data of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Compressor {
    /// `vtkZLibDataCompressor`: a zlib stream a block.
    Zlib,
    /// `vtkLZ4DataCompressor`: a bare LZ4 block a block.
    Lz4,
    /// `vtkLZMADataCompressor`: an xz stream a block.
    Lzma,
}

impl Compressor {
    /// By VTK's class name.
    ///
    /// # Errors
    /// [`Problem::Unsupported`] for any other.
    pub fn from_name(name: &str) -> Result<Self, Problem> {
        match name {
            "vtkZLibDataCompressor" => Ok(Self::Zlib),
            "vtkLZ4DataCompressor" => Ok(Self::Lz4),
            "vtkLZMADataCompressor" => Ok(Self::Lzma),
            other => Err(Problem::Unsupported {
                what: format!("the compressor `{other}`"),
                hint: Some("vacua reads VTK's zlib, LZ4 and LZMA compressors".to_owned()),
            }),
        }
    }

    /// More bytes than this many times its size no stream of this kind can give. Zlib and LZ4: by
    /// format. LZMA: 64 MiB of zeros compress 6,900 times with the strongest preset; twice that
    /// and some.
    pub fn max_ratio(self) -> usize {
        match self {
            Self::Zlib => 1032,
            Self::Lz4 => 255,
            Self::Lzma => 1 << 14,
        }
    }

    /// Decompresses one block, which must fill `to` exactly.
    fn decompress(self, block: &[u8], to: &mut [u8]) -> Result<(), String> {
        let wanted = to.len();
        let got = match self {
            Self::Zlib => {
                let mut stream = flate2::Decompress::new(true);
                let status = stream
                    .decompress(block, to, flate2::FlushDecompress::Finish)
                    .map_err(|e| e.to_string())?;
                if status != flate2::Status::StreamEnd {
                    return Err(format!("a zlib stream that does not end at {wanted} bytes"));
                }
                stream.total_out() as usize
            }
            Self::Lz4 => lz4_flex::block::decompress_into(block, to).map_err(|e| e.to_string())?,
            Self::Lzma => {
                let mut stream = lzma_rust2::XzReader::new_mem_limit(block, false, LZMA_MEMORY_KIB);
                std::io::Read::read_exact(&mut stream, to).map_err(|e| e.to_string())?;
                wanted
            }
        };
        if got != wanted {
            return Err(format!("{got} bytes"));
        }
        Ok(())
    }
}

/// Shape of compressed data: what stands in front of its blocks.
#[derive(Clone, Debug)]
pub(super) struct Blocks {
    /// Size of every block but the last, uncompressed, in bytes.
    pub block_bytes: usize,
    /// Compressed size of each block in bytes.
    pub compressed: Vec<usize>,
}

impl Blocks {
    /// Reads the sizes of the blocks and checks that they give `expected` bytes. `words(n)` gives
    /// the first `n` integers of the header, or fails if there are not that many.
    ///
    /// # Errors
    /// [`Problem::Malformed`] if they give another number, or one that so few bytes cannot give.
    pub fn read(
        expected: usize,
        compressor: Compressor,
        what: &str,
        words: impl Fn(usize) -> Result<Vec<usize>, Problem>,
    ) -> Result<Self, Problem> {
        let head = words(3)?;
        let (num_blocks, block_bytes, last) = (head[0], head[1], head[2]);
        let total = Self::announced_bytes(&head);
        if total != Some(expected) {
            return Err(Problem::malformed(
                what,
                format!("compressed blocks of {expected} bytes in all"),
                format!("{num_blocks} blocks of {block_bytes}, the last of {last}"),
            ));
        }
        let count = num_blocks.checked_add(3).ok_or_else(|| {
            Problem::malformed(what, "a plausible number of blocks", num_blocks.to_string())
        })?;
        let compressed = words(count)?.split_off(3);
        let plausible = compressed.iter().enumerate().all(|(i, &size)| {
            let begin = i.saturating_mul(block_bytes);
            let bytes = block_bytes.min(expected.saturating_sub(begin));
            bytes <= size.saturating_mul(compressor.max_ratio())
        });
        if !plausible {
            return Err(Problem::malformed(
                what,
                format!("compressed blocks that can give {expected} bytes"),
                "blocks too small for that",
            ));
        }
        Ok(Self {
            block_bytes,
            compressed,
        })
    }

    /// The uncompressed size that the first three integers of the header give; `None` if it does
    /// not fit the address space.
    pub fn announced_bytes(head: &[usize]) -> Option<usize> {
        let &[num_blocks, block_bytes, last] = head else {
            return None;
        };
        match (num_blocks, last) {
            (0, _) => Some(0),
            (n, 0) => n.checked_mul(block_bytes),
            (n, last) => (n - 1)
                .checked_mul(block_bytes)
                .and_then(|b| b.checked_add(last))
                .filter(|_| last <= block_bytes),
        }
    }

    /// Compressed size of all blocks in bytes.
    ///
    /// # Errors
    /// [`Problem::Malformed`] if it does not fit the address space.
    pub fn compressed_bytes(&self, what: &str) -> Result<usize, Problem> {
        self.compressed
            .iter()
            .try_fold(0usize, |sum, &size| sum.checked_add(size))
            .ok_or_else(|| Problem::malformed(what, "plausible block sizes", "far larger ones"))
    }

    /// Decompresses all blocks, in parallel.
    ///
    /// # Errors
    /// [`Problem::Malformed`] naming the first block that fails.
    pub fn decompress(
        &self,
        compressor: Compressor,
        mut stored: &[u8],
        to: &mut [u8],
        what: &str,
    ) -> Result<(), Problem> {
        let mut blocks = Vec::with_capacity(self.compressed.len());
        for &size in &self.compressed {
            let (block, rest) = stored.split_at_checked(size).ok_or_else(|| {
                Problem::malformed(
                    what,
                    format!("a block of {size} bytes"),
                    "the end of the data",
                )
            })?;
            blocks.push(block);
            stored = rest;
        }
        if to.is_empty() {
            return Ok(());
        }
        to.par_chunks_mut(self.block_bytes)
            .zip(blocks)
            .enumerate()
            .try_for_each(|(i, (chunk, block))| {
                let wanted = chunk.len();
                compressor.decompress(block, chunk).map_err(|found| {
                    Problem::malformed(
                        format!("{what}, block {i}"),
                        format!("{compressor:?} data of {wanted} bytes"),
                        found,
                    )
                })
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn padding_in_the_middle() {
        let text = b"AAEC/w==BAUG";
        assert_eq!(decode_base64(text, 4, "t").expect("four"), [0, 1, 2, 255]);
        assert_eq!(
            decode_base64(text, 7, "t").expect("seven"),
            [0, 1, 2, 255, 4, 5, 6]
        );
        assert_eq!(decode_base64(text, 5, "t").expect("five").len(), 5);
        assert!(decode_base64(text, 8, "t").is_err());
        assert!(decode_base64(b"A\x80B*", 3, "t").is_err());
        assert!(decode_base64(b"====", 1, "t").is_err());
    }

    #[test]
    fn long_text_decodes_in_parallel() {
        let bytes: Vec<u8> = (0..1_000_003u32)
            .map(|i| (i.wrapping_mul(7919) >> 3) as u8)
            .collect();
        let text = STANDARD.encode(&bytes);
        assert_eq!(
            decode_base64(text.as_bytes(), bytes.len(), "t").expect("all"),
            bytes
        );
    }

    #[test]
    fn implausible_blocks_are_refused_before_any_allocation() {
        let words = |n: usize| Ok([1usize, 1 << 40, 0, 50].into_iter().take(n).collect());
        assert!(Blocks::read(1 << 40, Compressor::Zlib, "t", words).is_err());
        let words = |n: usize| Ok([2usize, 10, 20, 50, 50].into_iter().take(n).collect());
        assert!(Blocks::read(30, Compressor::Zlib, "t", words).is_err());
    }
}
