//! One page of a TIFF file: its size and number type, and where its strips or tiles lie.

use std::fmt;

use vacua_volume::ScalarType;

use super::directory::{Container, Directory, Values, tag};
use crate::error::Problem;

/// How strips and tiles are compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Compression {
    None,
    Lzw,
    Deflate,
    PackBits,
}

impl Compression {
    /// The method of a tag's number.
    fn from_number(number: u64) -> Result<Self, Problem> {
        Ok(match number {
            1 => Self::None,
            5 => Self::Lzw,
            8 | 32946 => Self::Deflate,
            32773 => Self::PackBits,
            _ => {
                let name = match number {
                    2..=4 => "fax",
                    6 | 7 => "JPEG",
                    34712 | 33003..=33005 => "JPEG 2000",
                    34925 => "LZMA",
                    50000 => "Zstandard",
                    50001 => "WebP",
                    _ => "unknown",
                };
                return Err(Problem::unsupported_but(
                    format!("TIFF compression {number} ({name})"),
                    "store the pages uncompressed, or with LZW, deflate or PackBits",
                ));
            }
        })
    }

    /// The number that stands for it in a directory.
    pub fn number(self) -> u16 {
        match self {
            Self::None => 1,
            Self::Lzw => 5,
            Self::Deflate => 8,
            Self::PackBits => 32773,
        }
    }

    /// How much a byte can expand to, rounded up. LZW: codes of 12 bits for strings of up to 3838
    /// bytes; deflate: 1032; PackBits: 128 bytes from 2.
    fn most_expansion(self) -> u64 {
        match self {
            Self::None => 1,
            Self::Lzw => 2560,
            Self::Deflate => 1040,
            Self::PackBits => 64,
        }
    }
}

/// What all pages of a stack have in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Shape {
    /// Pixels across and down.
    pub size: [usize; 2],
    /// Numbers a pixel.
    pub samples: usize,
    /// Type of a number as it is stored.
    pub scalar_type: ScalarType,
    /// Whether the 16 bits of a number are a float.
    pub is_half: bool,
}

impl Shape {
    /// Bytes of a page, which the address space has room for.
    pub fn len_bytes(&self) -> Option<usize> {
        let [width, height] = self.size;
        width
            .checked_mul(height)?
            .checked_mul(self.samples)?
            .checked_mul(self.scalar_type.size_bytes())
            .filter(|&len| len <= isize::MAX as usize)
    }
}

impl fmt::Display for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [width, height] = self.size;
        let scalar_type = match self.is_half {
            true => "f16",
            false => self.scalar_type.name(),
        };
        write!(
            f,
            "{width} × {height} pixels of {} {scalar_type}",
            self.samples
        )
    }
}

/// Where the strips or tiles of a page are.
#[derive(Clone, Copy, Debug)]
pub(super) enum Places {
    /// In tables of the file.
    Listed {
        /// Bytes of the file at which they begin.
        offsets: Values,
        /// Bytes that they have there.
        counts: Values,
    },
    /// One uncompressed strip, the whole page, which begins at this byte.
    Whole(usize),
}

/// One page.
#[derive(Clone, Debug)]
pub(super) struct Page {
    /// Which one of its file, from 1.
    pub number: usize,
    /// Size and number type.
    pub shape: Shape,
    /// How strips and tiles are compressed.
    pub compression: Compression,
    /// What was done to the numbers before: 1 nothing, 2 differences, 3 differences of floats' bytes.
    pub predictor: u16,
    /// Whether samples lie in planes of their own.
    pub is_planar: bool,
    /// What the numbers mean: 0 and 1 grey, 2 colours, 3 indices into a palette.
    pub photometric: u64,
    /// Whether strips are tiles, which have this width and need not cover the page exactly.
    pub tile_width: Option<u32>,
    /// Rows of a strip or tile.
    pub chunk_rows: u32,
    /// Strips or tiles, all planes together.
    pub num_chunks: u32,
    /// Where they are.
    pub places: Places,
    /// Where the numbers are, if they lie in one piece as they are.
    pub run_at: Option<usize>,
}

/// Whether a directory holds a smaller copy of another page, or a mask.
pub(super) fn is_copy(container: &Container, directory: &Directory) -> bool {
    const REDUCED_OR_MASK: u64 = 0b101;
    let of = |tag| directory.number(container, tag).ok().flatten();
    of(tag::NEW_SUBFILE_TYPE).is_some_and(|bits| bits & REDUCED_OR_MASK != 0)
        || of(tag::SUBFILE_TYPE) == Some(2)
}

impl Page {
    /// Reads what a directory says about its page and checks it against the file. `budget` are the
    /// bytes of the file that no page has claimed yet: pages that share them could be far more data
    /// than the file has.
    ///
    /// # Errors
    /// [`Problem`] naming the page and the tag.
    pub fn read(
        container: &Container,
        directory: &Directory,
        budget: &mut u64,
    ) -> Result<Self, Problem> {
        let number = |tag| directory.number(container, tag);
        let wrong = |tag, expected: &str, found: String| {
            Problem::malformed(directory.place(tag), expected, found)
        };
        let side = |tag, expected: &str| -> Result<u32, Problem> {
            let found = number(tag)?;
            found
                .and_then(|n| u32::try_from(n).ok())
                .filter(|&n| n > 0)
                .ok_or_else(|| {
                    let found = found.map_or("none".to_owned(), |n| n.to_string());
                    wrong(tag, expected, found)
                })
        };
        let width = side(tag::WIDTH, "pixels")?;
        let height = side(tag::HEIGHT, "rows")?;
        let samples = number(tag::SAMPLES_PER_PIXEL)?.unwrap_or(1);
        let samples = u16::try_from(samples)
            .ok()
            .filter(|&n| n > 0)
            .ok_or_else(|| wrong(tag::SAMPLES_PER_PIXEL, "1 to 65535", samples.to_string()))?;
        let photometric = number(tag::PHOTOMETRIC)?.unwrap_or(1);
        if photometric > 3 {
            return Err(Problem::unsupported_but(
                format!("{} {photometric}", directory.place(tag::PHOTOMETRIC)),
                "save grey or RGB pages",
            ));
        }
        let (scalar_type, is_half) = number_type(
            number(tag::BITS_PER_SAMPLE)?.unwrap_or(1),
            number(tag::SAMPLE_FORMAT)?.unwrap_or(1),
            directory,
        )?;
        let compression = Compression::from_number(number(tag::COMPRESSION)?.unwrap_or(1))?;
        let predictor = match (compression, number(tag::PREDICTOR)?.unwrap_or(1)) {
            (Compression::None | Compression::PackBits, _) => 1,
            (_, found @ 1..=2) => found as u16,
            (_, 3) if is_half || matches!(scalar_type, ScalarType::F32 | ScalarType::F64) => 3,
            (_, found) => {
                return Err(wrong(
                    tag::PREDICTOR,
                    "1, 2, or 3 for floats",
                    found.to_string(),
                ));
            }
        };
        let shape = Shape {
            size: [width as usize, height as usize],
            samples: usize::from(samples),
            scalar_type,
            is_half,
        };
        if shape.len_bytes().is_none() {
            return Err(Problem::unsupported(format!(
                "page {}: {shape}, more than this machine can address",
                directory.number
            )));
        }
        let is_tiled = directory.get(tag::TILE_OFFSETS).is_some();
        let (tile_width, chunk_rows) = if is_tiled {
            let width = side(tag::TILE_WIDTH, "pixels")?;
            (Some(width), side(tag::TILE_HEIGHT, "rows")?)
        } else {
            let rows = number(tag::ROWS_PER_STRIP)?.unwrap_or(u64::from(height));
            let rows = u32::try_from(rows).unwrap_or(height).min(height);
            if rows == 0 {
                return Err(wrong(tag::ROWS_PER_STRIP, "rows", "0".to_owned()));
            }
            (None, rows)
        };
        let mut page = Self {
            number: directory.number,
            shape,
            compression,
            predictor,
            is_planar: samples > 1 && number(tag::PLANAR_CONFIGURATION)? == Some(2),
            photometric,
            tile_width,
            chunk_rows,
            num_chunks: 0,
            places: Places::Whole(0),
            run_at: None,
        };
        page.find_chunks(container, directory)?;
        page.check_chunks(container, directory, budget)?;
        Ok(page)
    }

    /// Finds the tables of strips or tiles, and how many there must be.
    fn find_chunks(&mut self, container: &Container, directory: &Directory) -> Result<(), Problem> {
        let [width, height] = self.shape.size;
        let across = self.tile_width.map_or(1, |w| width.div_ceil(w as usize));
        let down = height.div_ceil(self.chunk_rows as usize);
        let planes = if self.is_planar {
            self.shape.samples
        } else {
            1
        };
        let needed = across.saturating_mul(down).saturating_mul(planes);
        let (offsets_tag, counts_tag) = match self.tile_width {
            Some(_) => (tag::TILE_OFFSETS, tag::TILE_BYTE_COUNTS),
            None => (tag::STRIP_OFFSETS, tag::STRIP_BYTE_COUNTS),
        };
        let table = |tag| -> Result<Values, Problem> {
            let missing = || format!("{needed} numbers");
            let values = directory
                .get(tag)
                .ok_or_else(|| Problem::malformed(directory.place(tag), missing(), "none"))?;
            if values.len != needed {
                let found = values.len.to_string();
                return Err(Problem::malformed(directory.place(tag), missing(), found));
            }
            Ok(values)
        };
        let offsets = table(offsets_tag)?;
        self.num_chunks = u32::try_from(needed).map_err(|_| {
            Problem::unsupported(format!("page {} in {needed} strips or tiles", self.number))
        })?;
        // Writers of one uncompressed strip may leave out its length.
        let is_plain = self.tile_width.is_none() && self.compression == Compression::None;
        if needed == 1 && is_plain && directory.get(counts_tag).is_none() {
            let at = container.integer(&offsets, 0).ok_or_else(|| {
                Problem::malformed(directory.place(offsets_tag), "a place", "something else")
            })?;
            self.places = Places::Whole(usize::try_from(at).unwrap_or(usize::MAX));
            return Ok(());
        }
        let counts = table(counts_tag)?;
        self.places = Places::Listed { offsets, counts };
        Ok(())
    }

    /// Bytes of a strip or tile once it is decompressed.
    fn chunk_bytes(&self, index: usize) -> Option<u64> {
        let [width, height] = self.shape.size;
        let rows = self.chunk_rows as usize;
        let (columns, rows) = match self.tile_width {
            Some(width) => (width as usize, rows),
            None => {
                let above = index % height.div_ceil(rows) * rows;
                (width, rows.min(height - above))
            }
        };
        let samples = if self.is_planar {
            1
        } else {
            self.shape.samples
        };
        let bytes = columns
            .checked_mul(rows)?
            .checked_mul(samples)?
            .checked_mul(self.shape.scalar_type.size_bytes())?;
        u64::try_from(bytes).ok()
    }

    /// Where a strip or tile is, and how long.
    pub fn chunk(&self, container: &Container, index: usize) -> Option<(u64, u64)> {
        match &self.places {
            Places::Listed { offsets, counts } => Some((
                container.integer(offsets, index)?,
                container.integer(counts, index)?,
            )),
            Places::Whole(at) => Some((*at as u64, self.chunk_bytes(0)?)),
        }
    }

    /// Checks that every strip or tile lies in the file and can hold its share of the page.
    fn check_chunks(
        &mut self,
        container: &Container,
        directory: &Directory,
        budget: &mut u64,
    ) -> Result<(), Problem> {
        let kind = if self.tile_width.is_some() {
            "tile"
        } else {
            "strip"
        };
        let mut run: Option<(u64, u64)> = None;
        let mut is_run = self.is_run();
        for index in 0..self.num_chunks as usize {
            let what = || format!("page {}, {kind} {}", directory.number, index + 1);
            let (at, len) = self
                .chunk(container, index)
                .ok_or_else(|| Problem::malformed(what(), "a place and a length", "no numbers"))?;
            let end = at.saturating_add(len);
            if end > container.source.len() as u64 {
                return Err(Problem::Truncated {
                    what: what(),
                    from: at,
                    to: end,
                    len: container.source.len() as u64,
                });
            }
            let needed = self.chunk_bytes(index).unwrap_or(u64::MAX);
            if needed.div_ceil(self.compression.most_expansion()) > len {
                return Err(Problem::malformed(
                    what(),
                    format!("data that could expand to {needed} bytes"),
                    format!("{len} bytes"),
                ));
            }
            *budget = budget.checked_sub(len).ok_or_else(|| {
                Problem::malformed(
                    what(),
                    "strips and tiles that do not overlap",
                    "more bytes of them than the file has",
                )
            })?;
            let (first, next) = run.unwrap_or((at, at));
            is_run &= next == at;
            run = Some((first, at.saturating_add(needed)));
        }
        self.run_at = run
            .filter(|_| is_run)
            .and_then(|(first, _)| usize::try_from(first).ok());
        Ok(())
    }

    /// Whether numbers are stored as they are in memory, if strips follow each other.
    fn is_run(&self) -> bool {
        self.compression == Compression::None && self.tile_width.is_none() && !self.is_planar
    }
}

/// The type of a number, and whether it is a float of 16 bits.
fn number_type(
    bits: u64,
    format: u64,
    directory: &Directory,
) -> Result<(ScalarType, bool), Problem> {
    use ScalarType::{F32, F64, I8, I16, I32, I64, U8, U16, U32, U64};
    let scalar_type = match (bits, format) {
        (8, 1 | 4) => U8,
        (16, 1 | 4) => U16,
        (32, 1 | 4) => U32,
        (64, 1 | 4) => U64,
        (8, 2) => I8,
        (16, 2) => I16,
        (32, 2) => I32,
        (64, 2) => I64,
        (16, 3) => return Ok((U16, true)),
        (32, 3) => F32,
        (64, 3) => F64,
        _ => {
            let format = match format {
                1 | 4 => "unsigned integers",
                2 => "integers",
                3 => "floats",
                _ => "numbers of an unknown kind",
            };
            return Err(Problem::unsupported_but(
                format!("page {}: {format} of {bits} bits", directory.number),
                "save integers of 8, 16, 32 or 64 bits, or floats of 16, 32 or 64",
            ));
        }
    };
    Ok((scalar_type, false))
}
