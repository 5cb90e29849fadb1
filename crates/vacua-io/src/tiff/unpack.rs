//! The numbers of one page, decompressed into memory.
//!
//! The crate `tiff` decodes strips and tiles. It is not given the file's own directory but one that
//! says only what was checked already ([`Page::read`]), placed before the file: so it meets no tag
//! that it could stumble over, follows no chain, allocates nothing beyond the page, and hands over
//! the numbers as they are stored, whatever they mean as colours.

use std::io::{self, Read, Seek, SeekFrom};

use tiff::TiffError;
use tiff::decoder::{Decoder, Limits};
use vacua_volume::ScalarType;

use super::directory::{Container, tag};
use super::page::Page;
use crate::decode::Endianness;
use crate::error::Problem;

/// Types of values in the directory that is made here.
const SHORT: u16 = 3;
const LONG: u16 = 4;
const LONG8: u16 = 16;

/// A made directory, followed by the whole file.
struct Joined<'a> {
    head: &'a [u8],
    file: &'a [u8],
    at: u64,
}

impl Read for Joined<'_> {
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        let at = usize::try_from(self.at).unwrap_or(usize::MAX);
        let rest = match self.head.get(at..).filter(|rest| !rest.is_empty()) {
            Some(rest) => rest,
            None => self
                .file
                .get(at.saturating_sub(self.head.len())..)
                .unwrap_or_default(),
        };
        let len = rest.len().min(to.len());
        to[..len].copy_from_slice(&rest[..len]);
        self.at += len as u64;
        Ok(len)
    }
}

impl Seek for Joined<'_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let len = (self.head.len() + self.file.len()) as u64;
        let at = match to {
            SeekFrom::Start(at) => Some(at),
            SeekFrom::Current(by) => self.at.checked_add_signed(by),
            SeekFrom::End(by) => len.checked_add_signed(by),
        };
        self.at = at.ok_or_else(|| io::Error::from(io::ErrorKind::InvalidInput))?;
        Ok(self.at)
    }
}

/// Writes numbers in the file's byte order.
struct Writer {
    bytes: Vec<u8>,
    endianness: Endianness,
}

impl Writer {
    fn put<const N: usize>(&mut self, mut little: [u8; N]) {
        if self.endianness == Endianness::Big {
            little.reverse();
        }
        self.bytes.extend(little);
    }

    fn entry(&mut self, tag: u16, kind: u16, len: u64, value: u64) {
        let end = self.bytes.len() + ENTRY_BYTES;
        self.put(tag.to_le_bytes());
        self.put(kind.to_le_bytes());
        self.put(len.to_le_bytes());
        match kind {
            SHORT => self.put((value as u16).to_le_bytes()),
            LONG => self.put((value as u32).to_le_bytes()),
            _ => self.put(value.to_le_bytes()),
        }
        // A value shorter than its place stands at the start of it.
        self.bytes.resize(end, 0);
    }
}

/// Bytes of a BigTIFF header.
const HEADER_BYTES: usize = 16;
/// Bytes of an entry in a BigTIFF directory.
const ENTRY_BYTES: usize = 20;

/// Strips or tiles of one plane, all samples of a page that has no planes.
#[derive(Clone, Copy)]
struct Plane {
    first_chunk: u32,
    num_chunks: u32,
    samples: usize,
}

/// A BigTIFF header and one directory, which says of a plane what its decoder must know.
fn head(page: &Page, plane: Plane, container: &Container) -> Option<Vec<u8>> {
    let mut writer = Writer {
        bytes: Vec::new(),
        endianness: container.endianness,
    };
    let magic = match container.endianness {
        Endianness::Little => b"II",
        Endianness::Big => b"MM",
    };
    writer.bytes.extend(magic);
    writer.put(43u16.to_le_bytes());
    writer.put(8u16.to_le_bytes());
    writer.put(0u16.to_le_bytes());
    writer.put((HEADER_BYTES as u64).to_le_bytes());

    let num_chunks = plane.num_chunks;
    let (offsets_tag, counts_tag) = match page.tile_width {
        Some(_) => (tag::TILE_OFFSETS, tag::TILE_BYTE_COUNTS),
        None => (tag::STRIP_OFFSETS, tag::STRIP_BYTE_COUNTS),
    };
    let format = match page.shape.scalar_type {
        _ if page.shape.is_half => 3,
        ScalarType::F32 | ScalarType::F64 => 3,
        ScalarType::I8 | ScalarType::I16 | ScalarType::I32 | ScalarType::I64 => 2,
        ScalarType::U8 | ScalarType::U16 | ScalarType::U32 | ScalarType::U64 => 1,
    };
    let [width, height] = page.shape.size.map(|n| n as u64);
    let mut entries = vec![
        (tag::WIDTH, LONG, width),
        (tag::HEIGHT, LONG, height),
        (
            tag::BITS_PER_SAMPLE,
            SHORT,
            8 * page.shape.scalar_type.size_bytes() as u64,
        ),
        (
            tag::COMPRESSION,
            SHORT,
            u64::from(page.compression.number()),
        ),
        // Grey where black is zero: numbers as they are, however many a pixel.
        (tag::PHOTOMETRIC, SHORT, 1),
        (tag::SAMPLES_PER_PIXEL, SHORT, plane.samples as u64),
        (tag::PREDICTOR, SHORT, u64::from(page.predictor)),
        (tag::SAMPLE_FORMAT, SHORT, format),
    ];
    match page.tile_width {
        Some(tile_width) => entries.extend([
            (tag::TILE_WIDTH, LONG, u64::from(tile_width)),
            (tag::TILE_HEIGHT, LONG, u64::from(page.chunk_rows)),
        ]),
        None => entries.push((tag::ROWS_PER_STRIP, LONG, u64::from(page.chunk_rows))),
    }
    let tables_at = HEADER_BYTES + 8 + ENTRY_BYTES * (entries.len() + 2) + 8;
    let table_bytes = 8 * num_chunks as usize;
    let (len, first_at) = match num_chunks {
        1 => (tables_at, None),
        _ => (tables_at + 2 * table_bytes, Some(tables_at)),
    };
    let chunk = |index: u32| -> Option<(u64, u64)> {
        let (at, count) = page.chunk(container, (plane.first_chunk + index) as usize)?;
        Some((at.checked_add(len as u64)?, count))
    };
    let (offset, count) = chunk(0)?;
    entries.push((offsets_tag, LONG8, first_at.map_or(offset, |at| at as u64)));
    let counts_at = first_at.map(|at| at + table_bytes);
    entries.push((counts_tag, LONG8, counts_at.map_or(count, |at| at as u64)));
    entries.sort_unstable_by_key(|(tag, ..)| *tag);
    writer.put((entries.len() as u64).to_le_bytes());
    for (tag, kind, value) in entries {
        let len = if kind == LONG8 { num_chunks } else { 1 };
        writer.entry(tag, kind, u64::from(len), value);
    }
    writer.put(0u64.to_le_bytes());
    if num_chunks > 1 {
        for index in 0..num_chunks {
            writer.put(chunk(index)?.0.to_le_bytes());
        }
        for index in 0..num_chunks {
            writer.put(chunk(index)?.1.to_le_bytes());
        }
    }
    Some(writer.bytes)
}

/// Fills `to`, which has the length of the page, with its numbers in native byte order.
///
/// # Errors
/// [`Problem`] naming the page if its data is damaged or there is no memory for it.
pub(super) fn unpack(page: &Page, container: &Container, to: &mut [u8]) -> Result<(), Problem> {
    let samples = page.shape.samples;
    if !page.is_planar {
        let whole = Plane {
            first_chunk: 0,
            num_chunks: page.num_chunks,
            samples,
        };
        return decode(page, whole, container, to);
    }
    let size = page.shape.scalar_type.size_bytes();
    let plane_bytes = to.len() / samples;
    let mut numbers = Vec::new();
    numbers.try_reserve_exact(plane_bytes).map_err(|_| {
        Problem::unsupported(format!("page {}: {} in memory", page.number, page.shape))
    })?;
    numbers.resize(plane_bytes, 0);
    let num_chunks = page.num_chunks / samples as u32;
    for (sample, first_chunk) in (0..page.num_chunks)
        .step_by(num_chunks as usize)
        .enumerate()
    {
        let plane = Plane {
            first_chunk,
            num_chunks,
            samples: 1,
        };
        decode(page, plane, container, &mut numbers)?;
        let tuples = to.chunks_exact_mut(samples * size);
        for (tuple, number) in tuples.zip(numbers.chunks_exact(size)) {
            tuple[sample * size..][..size].copy_from_slice(number);
        }
    }
    Ok(())
}

fn decode(page: &Page, plane: Plane, container: &Container, to: &mut [u8]) -> Result<(), Problem> {
    let failed = |source: TiffError| Problem::Container {
        place: format!("page {}", page.number),
        source: Box::new(source),
    };
    let head = head(page, plane, container).ok_or_else(|| {
        Problem::malformed(format!("page {}", page.number), "strips or tiles", "none")
    })?;
    let reader = Joined {
        head: &head,
        file: container.source.bytes(),
        at: 0,
    };
    let mut limits = Limits::default();
    limits.decoding_buffer_size = to.len();
    limits.intermediate_buffer_size = container.source.len();
    let mut decoder = Decoder::new(reader).map_err(failed)?.with_limits(limits);
    decoder.read_image_bytes(to).map_err(failed)
}
