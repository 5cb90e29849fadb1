//! Where the numbers of a field lie, in which encoding, and how they are fetched.
//!
//! NRRD, MetaImage and NIfTI say the same in different words: numbers follow the header or fill
//! other files, raw, compressed or as text, after some lines or bytes to skip. Raw numbers in
//! native byte order are mapped at once; everything that costs time waits until the field is asked
//! for. Sizes are checked against the files when the header is read, before any allocation; a
//! compressed file that would have to expand more than its method can is refused there too.

use std::io::Read;
use std::path::PathBuf;
use std::sync::Arc;

use bzip2::read::MultiBzDecoder;
use flate2::read::{MultiGzDecoder, ZlibDecoder};
use vacua_volume::{Association, DataArray, Field, LoadError};

use crate::decode::{Layout, copy_bytes, decode_array, interleave, parse_hex, parse_text};
use crate::error::{IoError, Problem};
use crate::files::FileNames;
use crate::source::Source;

/// Deflate cannot expand a byte to more than 1032.
const MOST_DEFLATE_EXPANSION: usize = 1040;
/// bzip2 has no such limit short of a million; data with anything to see stays far below this.
const MOST_BZIP2_EXPANSION: usize = 20_000;

/// How numbers are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Encoding {
    /// As in memory.
    Raw,
    /// A gzip or zlib stream, told apart by its first bytes.
    Deflate,
    /// A bzip2 stream.
    Bzip2,
    /// Decimal text.
    Text,
    /// Hexadecimal text.
    Hex,
}

/// Bytes between the start of a data file (or of its decompressed contents) and the numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Skip {
    /// So many.
    Bytes(usize),
    /// The numbers are the last bytes of the file, whatever comes before.
    ToTheEnd,
}

/// The files that hold the numbers.
#[derive(Clone, Debug)]
pub(crate) enum Place {
    /// The header's own file, from this byte on.
    Here(usize),
    /// Other files, each with the same share.
    Files(FileNames),
}

/// Everything needed to fetch the numbers of a field.
#[derive(Clone)]
pub(crate) struct Payload {
    /// The file with the header.
    pub(crate) source: Source,
    /// Where the numbers are.
    pub(crate) place: Place,
    /// How they are written.
    pub(crate) encoding: Encoding,
    /// Lines to skip first.
    pub(crate) skip_lines: usize,
    /// Bytes to skip after that.
    pub(crate) skip: Skip,
    /// What is fetched: all of what is stored, or the start of it.
    pub(crate) layout: Layout,
    /// Steps of the same size that are stored one after the other; the first is fetched.
    pub(crate) stored_steps: usize,
    /// Whether components are stored as planes one after the other.
    pub(crate) planar: bool,
}

impl Payload {
    /// Checks that the files can hold the numbers, and makes the field.
    ///
    /// # Errors
    /// [`Problem::Truncated`], [`Problem::Malformed`] or [`Problem::Part`].
    pub(crate) fn into_field(self, name: &str) -> Result<Field, Problem> {
        self.check()?;
        if self.is_mappable() {
            return Ok(Field::new(name, Association::Point, self.fetch()?));
        }
        let Layout {
            scalar_type,
            components,
            tuples,
            ..
        } = self.layout;
        Ok(Field::lazy(
            name,
            Association::Point,
            scalar_type,
            components,
            tuples,
            move || self.load(),
        ))
    }

    /// What to tell the user if a plain file holds more than its header says: a sign that the
    /// sizes are wrong.
    pub(crate) fn surplus_note(&self) -> Option<String> {
        let Skip::Bytes(skip) = self.skip else {
            return None;
        };
        if self.encoding != Encoding::Raw || self.skip_lines > 0 {
            return None;
        }
        let stored = match &self.place {
            Place::Here(offset) => self.source.len().checked_sub(*offset)?,
            Place::Files(names) => file_len(&names.path(0).ok()?).ok()?,
        };
        let surplus = stored.checked_sub(self.share_bytes().ok()?.checked_add(skip)?)?;
        (surplus > 0).then(|| format!("{surplus} bytes after the data were not read"))
    }

    /// Fetches the numbers, with errors as a lazy field has them.
    ///
    /// # Errors
    /// An [`IoError`] for the header's file.
    pub(crate) fn load(&self) -> Result<DataArray, LoadError> {
        self.fetch()
            .map_err(|p| Arc::new(p.in_file(self.source.path())) as LoadError)
    }

    /// Whether the numbers can stay in their file.
    fn is_mappable(&self) -> bool {
        let planes = self.planar && self.layout.components > 1;
        self.encoding == Encoding::Raw
            && self.num_parts() == 1
            && self.layout.is_native()
            && !planes
    }

    /// Bytes stored in each file.
    fn share_bytes(&self) -> Result<usize, Problem> {
        let step = self.layout.len_bytes()?;
        let parts = match &self.place {
            Place::Here(_) => 1,
            Place::Files(names) => names.len(),
        };
        step.checked_mul(self.stored_steps)
            .filter(|stored| parts > 0 && stored.is_multiple_of(parts))
            .map(|stored| stored / parts)
            .filter(|share| share.is_multiple_of(self.layout.scalar_type.size_bytes()))
            .ok_or_else(|| {
                Problem::malformed(
                    "data files",
                    "a number of files that divides the data",
                    format!("{} × {step} bytes in {parts} files", self.stored_steps),
                )
            })
    }

    /// Files (or the one place) that hold what is fetched.
    fn num_parts(&self) -> usize {
        match (&self.place, self.share_bytes(), self.layout.len_bytes()) {
            (Place::Files(_), Ok(share), Ok(wanted)) if share > 0 => wanted.div_ceil(share),
            _ => 1,
        }
    }

    /// Opens one of the files; the bytes from the second value on hold the numbers.
    fn open_part(&self, part: usize) -> Result<(Source, usize), Problem> {
        match &self.place {
            Place::Here(offset) => Ok((self.source.clone(), *offset)),
            Place::Files(names) => {
                let source = Source::open(&names.path(part)?).map_err(in_data_file)?;
                Ok((source, 0))
            }
        }
    }

    /// Checks the sizes of all files that will be read, without reading them.
    ///
    /// # Errors
    /// As [`Payload::into_field`].
    pub(crate) fn check(&self) -> Result<(), Problem> {
        let share = self.share_bytes()?;
        let mut wanted = self.layout.len_bytes()?;
        for part in 0..self.num_parts() {
            let len = wanted.min(share);
            match &self.place {
                Place::Here(offset) => {
                    self.check_size(self.source.len().saturating_sub(*offset), *offset, len)?;
                }
                Place::Files(names) => {
                    let path = names.path(part)?;
                    let stored = file_len(&path).map_err(in_data_file)?;
                    self.check_size(stored, 0, len)
                        .map_err(|p| in_data_file(p.in_file(&path)))?;
                }
            }
            wanted -= len;
        }
        Ok(())
    }

    /// Whether `stored` bytes can hold `wanted` bytes of numbers.
    fn check_size(&self, stored: usize, offset: usize, wanted: usize) -> Result<(), Problem> {
        let skip = match self.skip {
            Skip::Bytes(n) => n,
            Skip::ToTheEnd => 0,
        };
        let needed = wanted.saturating_add(skip);
        let least = match self.encoding {
            Encoding::Raw => needed.saturating_add(self.skip_lines),
            Encoding::Hex => wanted.saturating_mul(2).saturating_add(skip),
            Encoding::Text => {
                let numbers = wanted / self.layout.scalar_type.size_bytes();
                numbers
                    .saturating_mul(2)
                    .saturating_add(skip)
                    .saturating_sub(1)
            }
            Encoding::Deflate => needed.div_ceil(MOST_DEFLATE_EXPANSION),
            Encoding::Bzip2 => needed.div_ceil(MOST_BZIP2_EXPANSION),
        };
        if least <= stored {
            return Ok(());
        }
        let what = match self.encoding {
            Encoding::Raw => format!("data of {wanted} bytes"),
            Encoding::Text | Encoding::Hex => format!("text for {wanted} bytes of data"),
            Encoding::Deflate | Encoding::Bzip2 => {
                format!("compressed data that could expand to {needed} bytes")
            }
        };
        Err(Problem::Truncated {
            what,
            from: offset as u64,
            to: offset.saturating_add(least) as u64,
            len: offset.saturating_add(stored) as u64,
        })
    }

    /// Fetches the numbers. Sizes are checked again: files may have changed.
    ///
    /// # Errors
    /// As [`Payload::into_field`].
    pub(crate) fn fetch(&self) -> Result<DataArray, Problem> {
        self.check()?;
        let array = if self.encoding == Encoding::Raw && self.num_parts() == 1 {
            let (source, start) = self.open_part(0)?;
            self.skip_lines(&source, start)
                .and_then(|start| self.skip_raw(&source, start, self.share_bytes()?))
                .and_then(|start| decode_array(&source, "data", start, &self.layout))
                .map_err(|p| self.of_part(p, &source))?
        } else {
            let stored = self.encoding != Encoding::Text;
            let share = self.share_bytes()?;
            self.layout.fill_array(stored, |bytes| {
                for (part, to) in bytes.chunks_mut(share.max(1)).enumerate() {
                    let (source, start) = self.open_part(part)?;
                    self.skip_lines(&source, start)
                        .and_then(|start| self.fill(&source, start, to, share))
                        .map_err(|p| self.of_part(p, &source))?;
                }
                Ok(())
            })?
        };
        if self.planar && self.layout.components > 1 {
            return interleave(&array, self.layout.components);
        }
        Ok(array)
    }

    /// Says which data file has the problem, if it is not the header's.
    fn of_part(&self, problem: Problem, source: &Source) -> Problem {
        match self.place {
            Place::Here(_) => problem,
            Place::Files(_) => in_data_file(problem.in_file(source.path())),
        }
    }

    /// The byte after the lines to skip.
    fn skip_lines(&self, source: &Source, start: usize) -> Result<usize, Problem> {
        let mut at = start;
        for line in 0..self.skip_lines {
            let rest = source.bytes().get(at..).unwrap_or_default();
            let end = rest.iter().position(|&b| b == b'\n').ok_or_else(|| {
                Problem::malformed(
                    "data",
                    format!("{} lines to skip", self.skip_lines),
                    format!("{line} lines"),
                )
            })?;
            at += end + 1;
        }
        Ok(at)
    }

    /// The byte after the bytes to skip, in a file that is not compressed.
    fn skip_raw(&self, source: &Source, start: usize, wanted: usize) -> Result<usize, Problem> {
        match self.skip {
            Skip::Bytes(n) => Ok(start.saturating_add(n)),
            Skip::ToTheEnd => source
                .len()
                .checked_sub(wanted)
                .filter(|&from| from >= start)
                .ok_or_else(|| Problem::Truncated {
                    what: format!("the last {wanted} bytes"),
                    from: start as u64,
                    to: start.saturating_add(wanted) as u64,
                    len: source.len() as u64,
                }),
        }
    }

    /// Decodes one file, which holds `share` bytes, into as many of them as are wanted.
    fn fill(
        &self,
        source: &Source,
        start: usize,
        to: &mut [u8],
        share: usize,
    ) -> Result<(), Problem> {
        match self.encoding {
            Encoding::Raw => {
                let from = self.skip_raw(source, start, share)?;
                copy_bytes(to, source.piece("data", from, to.len())?);
                Ok(())
            }
            Encoding::Text | Encoding::Hex => {
                let from = self.skip_raw(source, start, 0)?;
                let text = source.piece("data", from, source.len().saturating_sub(from))?;
                if self.encoding == Encoding::Hex {
                    parse_hex(text, to)
                } else {
                    parse_text(text, self.layout.scalar_type, to)
                }
            }
            Encoding::Deflate | Encoding::Bzip2 => {
                let skip = match self.skip {
                    Skip::Bytes(n) => n,
                    Skip::ToTheEnd => {
                        return Err(Problem::unsupported("compressed data counted from the end"));
                    }
                };
                let packed = source.bytes().get(start..).unwrap_or_default();
                expand(self.encoding, packed, skip, to, to.len() == share)
            }
        }
    }
}

fn in_data_file(error: IoError) -> Problem {
    Problem::Part(Box::new(error))
}

/// Length in bytes of a regular file.
fn file_len(path: &PathBuf) -> Result<usize, IoError> {
    let metadata = std::fs::metadata(path).map_err(|source| {
        Problem::System {
            action: "cannot open",
            source,
        }
        .in_file(path)
    })?;
    Ok(usize::try_from(metadata.len()).unwrap_or(usize::MAX))
}

/// Whether bytes begin like a gzip stream.
pub(crate) fn is_gzip(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0x1f, 0x8b])
}

/// A reader of compressed bytes.
fn expander(encoding: Encoding, packed: &[u8]) -> Box<dyn Read + '_> {
    if encoding == Encoding::Bzip2 {
        Box::new(MultiBzDecoder::new(packed))
    } else if is_gzip(packed) {
        Box::new(MultiGzDecoder::new(packed))
    } else {
        Box::new(ZlibDecoder::new(packed))
    }
}

/// Decompresses the bytes from `skip` on into `to`. If they are the `whole` stream it is read to
/// its end, so that its checksum is verified.
fn expand(
    encoding: Encoding,
    packed: &[u8],
    skip: usize,
    to: &mut [u8],
    whole: bool,
) -> Result<(), Problem> {
    let damaged = |error: std::io::Error| {
        Problem::malformed("compressed data", "an intact stream", error.to_string())
    };
    let short = |found: usize, needed: usize| {
        Problem::malformed(
            "compressed data",
            format!("{needed} bytes once decompressed"),
            format!("{found} bytes"),
        )
    };
    let needed = skip.saturating_add(to.len());
    let mut reader = expander(encoding, packed);
    let skipped = std::io::copy(&mut reader.by_ref().take(skip as u64), &mut std::io::sink())
        .map_err(damaged)?;
    if (skipped as usize) < skip {
        return Err(short(skipped as usize, needed));
    }
    let mut filled = 0;
    while filled < to.len() {
        match reader.read(&mut to[filled..]).map_err(damaged)? {
            0 => return Err(short(skip + filled, needed)),
            n => filled += n,
        }
    }
    if whole {
        reader.read(&mut [0]).map_err(damaged)?;
    }
    Ok(())
}

/// The first `most` bytes of a gzip stream, or fewer if it is shorter.
///
/// # Errors
/// [`Problem::Malformed`] if the stream is damaged.
pub(crate) fn expand_head(packed: &[u8], most: usize) -> Result<Vec<u8>, Problem> {
    let mut head = Vec::new();
    MultiGzDecoder::new(packed)
        .take(most as u64)
        .read_to_end(&mut head)
        .map_err(|error| {
            Problem::malformed(
                "compressed data",
                "an intact gzip stream",
                error.to_string(),
            )
        })?;
    Ok(head)
}
