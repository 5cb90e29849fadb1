//! The directories of a TIFF file: a chain of them, one a page, each a table of tagged values.
//!
//! Classic TIFF counts and points with 4 bytes, BigTIFF with 8; either comes in both byte orders.
//! A value lies in its table entry if it fits there and elsewhere in the file if not; where the file
//! ends before a value does is an error at once, so that whoever asks for one finds it whole.
//! Sources: TIFF 6.0 (Adobe 1992), section 2; the BigTIFF design (bigtiff.org).

use std::collections::HashSet;

use crate::decode::Endianness;
use crate::error::Problem;
use crate::source::Source;

/// The tags that are read, with their names.
const TAGS: [(u16, &str); 21] = [
    (tag::NEW_SUBFILE_TYPE, "NewSubfileType"),
    (tag::SUBFILE_TYPE, "SubfileType"),
    (tag::WIDTH, "ImageWidth"),
    (tag::HEIGHT, "ImageLength"),
    (tag::BITS_PER_SAMPLE, "BitsPerSample"),
    (tag::COMPRESSION, "Compression"),
    (tag::PHOTOMETRIC, "PhotometricInterpretation"),
    (tag::DESCRIPTION, "ImageDescription"),
    (tag::STRIP_OFFSETS, "StripOffsets"),
    (tag::SAMPLES_PER_PIXEL, "SamplesPerPixel"),
    (tag::ROWS_PER_STRIP, "RowsPerStrip"),
    (tag::STRIP_BYTE_COUNTS, "StripByteCounts"),
    (tag::X_RESOLUTION, "XResolution"),
    (tag::Y_RESOLUTION, "YResolution"),
    (tag::PLANAR_CONFIGURATION, "PlanarConfiguration"),
    (tag::PREDICTOR, "Predictor"),
    (tag::TILE_WIDTH, "TileWidth"),
    (tag::TILE_HEIGHT, "TileLength"),
    (tag::TILE_OFFSETS, "TileOffsets"),
    (tag::TILE_BYTE_COUNTS, "TileByteCounts"),
    (tag::SAMPLE_FORMAT, "SampleFormat"),
];

/// Numbers of tags.
pub(super) mod tag {
    pub const NEW_SUBFILE_TYPE: u16 = 254;
    pub const SUBFILE_TYPE: u16 = 255;
    pub const WIDTH: u16 = 256;
    pub const HEIGHT: u16 = 257;
    pub const BITS_PER_SAMPLE: u16 = 258;
    pub const COMPRESSION: u16 = 259;
    pub const PHOTOMETRIC: u16 = 262;
    pub const DESCRIPTION: u16 = 270;
    pub const STRIP_OFFSETS: u16 = 273;
    pub const SAMPLES_PER_PIXEL: u16 = 277;
    pub const ROWS_PER_STRIP: u16 = 278;
    pub const STRIP_BYTE_COUNTS: u16 = 279;
    pub const X_RESOLUTION: u16 = 282;
    pub const Y_RESOLUTION: u16 = 283;
    pub const PLANAR_CONFIGURATION: u16 = 284;
    pub const PREDICTOR: u16 = 317;
    pub const TILE_WIDTH: u16 = 322;
    pub const TILE_HEIGHT: u16 = 323;
    pub const TILE_OFFSETS: u16 = 324;
    pub const TILE_BYTE_COUNTS: u16 = 325;
    pub const SAMPLE_FORMAT: u16 = 339;
}

/// What a tag is called.
fn name_of(tag: u16) -> &'static str {
    let found = TAGS.iter().find(|(number, _)| *number == tag);
    found.map_or("tag", |(_, name)| name)
}

/// Whether bytes begin like a TIFF or BigTIFF file.
pub(super) fn is_tiff(bytes: &[u8]) -> bool {
    [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"]
        .iter()
        .any(|magic| bytes.starts_with(*magic))
}

/// The values of one tag: of which type, how many, and where they lie; all of them in the file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Values {
    kind: u16,
    /// How many.
    pub len: usize,
    at: usize,
}

impl Values {
    /// Bytes of one value, if its type is known.
    fn size_of_kind(kind: u16) -> Option<usize> {
        Some(match kind {
            1 | 2 | 6 | 7 => 1,
            3 | 8 => 2,
            4 | 9 | 11 | 13 => 4,
            5 | 10 | 12 | 16 | 17 | 18 => 8,
            _ => return None,
        })
    }
}

/// One directory: the values of the tags that are read.
#[derive(Debug)]
pub(super) struct Directory {
    /// Which one of the file, from 1.
    pub number: usize,
    entries: Vec<(u16, Values)>,
}

/// A file whose numbers are read in its byte order.
#[derive(Clone)]
pub(super) struct Container {
    /// The file.
    pub source: Source,
    /// The order of the bytes of all its numbers.
    pub endianness: Endianness,
    is_big_tiff: bool,
}

impl Container {
    /// Reads the header. Gives the place of the first directory with the file.
    ///
    /// # Errors
    /// [`Problem`] if it is no TIFF file, or ends at once.
    pub fn open(source: &Source) -> Result<(Self, u64), Problem> {
        let start = source.piece("the header", 0, 8)?;
        if !is_tiff(start) {
            return Err(Problem::malformed(
                "byte 0",
                "II or MM and the number 42 or 43",
                crate::decode::shown(&start[..4]),
            ));
        }
        let container = Self {
            source: source.clone(),
            endianness: Endianness::big_if(start.starts_with(b"M")),
            is_big_tiff: start.contains(&b'+'),
        };
        if !container.is_big_tiff {
            return Ok((container.clone(), container.unsigned(4, 4)?));
        }
        let pointer_bytes = container.unsigned(4, 2)?;
        if pointer_bytes != 8 {
            return Err(Problem::malformed(
                "byte 4",
                "pointers of 8 bytes",
                format!("{pointer_bytes} bytes"),
            ));
        }
        let first = container.unsigned(8, 8)?;
        Ok((container, first))
    }

    /// The directories of the chain that begins at byte `at`.
    ///
    /// # Errors
    /// [`Problem`] for a chain that comes back to itself, or a directory that is cut off or makes no
    /// sense.
    pub fn directories(&self, mut at: u64) -> Result<Vec<Directory>, Problem> {
        let mut seen = HashSet::new();
        let mut directories = Vec::new();
        let mut num_bytes = 0usize;
        while at != 0 {
            let number = directories.len() + 1;
            if !seen.insert(at) {
                return Err(Problem::malformed(
                    format!("page {}", number - 1),
                    "another page, or the end, to follow it",
                    format!("the page at byte {at} again"),
                ));
            }
            let (directory, len, next) = self.directory(number, at)?;
            directories.push(directory);
            // Directories that share bytes could be far more than the file has room for.
            num_bytes = num_bytes.saturating_add(len);
            if num_bytes > self.source.len() {
                return Err(Problem::malformed(
                    format!("page {number}"),
                    "directories that do not overlap",
                    format!(
                        "{num_bytes} bytes of them in a file of {}",
                        self.source.len()
                    ),
                ));
            }
            at = next;
        }
        Ok(directories)
    }

    /// One directory, its length in bytes, and where the next is.
    fn directory(&self, number: usize, at: u64) -> Result<(Directory, usize, u64), Problem> {
        let what = || format!("the directory of page {number}");
        let start = usize::try_from(at).unwrap_or(usize::MAX);
        let (count_bytes, entry_bytes, pointer_bytes) = match self.is_big_tiff {
            true => (8, 20, 8),
            false => (2, 12, 4),
        };
        self.source.piece(&what(), start, count_bytes)?;
        let num_entries = self.unsigned(start, count_bytes)?;
        let table_bytes = usize::try_from(num_entries)
            .unwrap_or(usize::MAX)
            .saturating_mul(entry_bytes);
        let len = table_bytes.saturating_add(count_bytes + pointer_bytes);
        self.source.piece(&what(), start, len)?;
        let mut entries: Vec<(u16, Values)> = Vec::new();
        for entry_at in
            (start + count_bytes..start + count_bytes + table_bytes).step_by(entry_bytes)
        {
            let tag = self.unsigned(entry_at, 2)? as u16;
            let is_read = TAGS.iter().any(|(known, _)| *known == tag);
            if is_read && !entries.iter().any(|(other, _)| *other == tag) {
                entries.push((tag, self.values(number, tag, entry_at, pointer_bytes)?));
            }
        }
        let next = self.unsigned(start + len - pointer_bytes, pointer_bytes)?;
        Ok((Directory { number, entries }, len, next))
    }

    /// Where the values of a table entry are.
    fn values(
        &self,
        number: usize,
        tag: u16,
        entry_at: usize,
        pointer_bytes: usize,
    ) -> Result<Values, Problem> {
        let kind = self.unsigned(entry_at + 2, 2)? as u16;
        let len = self.unsigned(entry_at + 4, pointer_bytes)?;
        let len = usize::try_from(len).unwrap_or(usize::MAX);
        let place = || format!("page {number}, {}", name_of(tag));
        let size = Values::size_of_kind(kind).ok_or_else(|| {
            Problem::malformed(place(), "a type from 1 to 18", format!("type {kind}"))
        })?;
        let here = entry_at + 4 + pointer_bytes;
        let len_bytes = len.saturating_mul(size);
        let at = if len_bytes <= pointer_bytes {
            here
        } else {
            usize::try_from(self.unsigned(here, pointer_bytes)?).unwrap_or(usize::MAX)
        };
        self.source.piece(&place(), at, len_bytes)?;
        Ok(Values { kind, len, at })
    }

    /// The unsigned number of `len` bytes at a place.
    fn unsigned(&self, at: usize, len: usize) -> Result<u64, Problem> {
        let bytes = self.source.piece("a number", at, len)?;
        let join = |n: u64, b: &u8| n << 8 | u64::from(*b);
        Ok(match self.endianness {
            Endianness::Big => bytes.iter().fold(0, join),
            Endianness::Little => bytes.iter().rev().fold(0, join),
        })
    }

    /// One of the values of a tag, if they are unsigned integers and there are so many.
    pub fn integer(&self, values: &Values, index: usize) -> Option<u64> {
        let size = match values.kind {
            1 | 3 | 4 | 13 | 16 | 18 => Values::size_of_kind(values.kind)?,
            _ => return None,
        };
        if index >= values.len {
            return None;
        }
        self.unsigned(values.at + index * size, size).ok()
    }
}

impl Directory {
    /// The values of a tag, if it is there.
    pub fn get(&self, tag: u16) -> Option<Values> {
        let found = self.entries.iter().find(|(other, _)| *other == tag);
        found.map(|(_, values)| *values)
    }

    /// Where a tag is, for messages.
    pub fn place(&self, tag: u16) -> String {
        format!("page {}, {}", self.number, name_of(tag))
    }

    /// The one number that all values of a tag are, if it is there.
    ///
    /// # Errors
    /// [`Problem::Malformed`] if it is no number, [`Problem::Unsupported`] if values differ.
    pub fn number(&self, container: &Container, tag: u16) -> Result<Option<u64>, Problem> {
        let Some(values) = self.get(tag) else {
            return Ok(None);
        };
        let first = container.integer(&values, 0).ok_or_else(|| {
            Problem::malformed(self.place(tag), "a whole number", "something else")
        })?;
        if (1..values.len).any(|i| container.integer(&values, i) != Some(first)) {
            return Err(Problem::unsupported(format!(
                "{} that differs from sample to sample",
                self.place(tag)
            )));
        }
        Ok(Some(first))
    }

    /// The ratio that a tag holds, if it is there and is one.
    pub fn ratio(&self, container: &Container, tag: u16) -> Option<f64> {
        let values = self.get(tag).filter(|v| v.kind == 5 && v.len > 0)?;
        let over = container.unsigned(values.at, 4).ok()?;
        let under = container.unsigned(values.at + 4, 4).ok()?;
        Some(over as f64 / under as f64)
    }

    /// The text that a tag holds, up to its end or the first zero.
    pub fn text(&self, container: &Container, tag: u16) -> Option<String> {
        let values = self.get(tag).filter(|v| matches!(v.kind, 1 | 2 | 7))?;
        let bytes = container.source.piece("text", values.at, values.len).ok()?;
        let end = memchr::memchr(0, bytes).unwrap_or(bytes.len());
        Some(String::from_utf8_lossy(&bytes[..end]).into_owned())
    }
}
