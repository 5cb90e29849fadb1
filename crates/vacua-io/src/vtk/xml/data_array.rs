//! `<DataArray>`: what it announces, and its numbers in every encoding.

use std::borrow::Cow;
use std::ops::Range;

use vacua_volume::{DataArray, ScalarType};

use super::codec::{Blocks, Compressor, decode_base64};
use super::document::{AppendedEncoding, Element, XmlFile};
use crate::error::Problem;
use crate::vtk::{ascii, bytes};

/// Where an array's numbers are and in what form.
#[derive(Clone, Debug)]
enum Storage {
    /// Text in the element.
    Ascii(Vec<Range<usize>>),
    /// Base64 text in the element.
    Inline(Vec<Range<usize>>),
    /// Bytes from the start of the appended data.
    Appended(usize),
}

/// One `<DataArray>` of numbers: everything but its number of tuples, which its place implies.
#[derive(Clone, Debug)]
pub(crate) struct DataArrayElement {
    /// Its name; `None` if it has none.
    pub name: Option<String>,
    /// Type of a number.
    pub scalar_type: ScalarType,
    /// Numbers in a tuple, at least 1.
    pub components: usize,
    storage: Storage,
    what: String,
}

/// What a `<DataArray>` turns out to be.
pub(crate) enum ArrayKind {
    /// Numbers.
    Numbers(DataArrayElement),
    /// Something that holds no numbers of its own for each tuple: bits, strings.
    Other {
        /// Its name.
        name: String,
        /// Its type.
        type_name: String,
    },
}

impl DataArrayElement {
    /// Reads the tag of a `<DataArray>` (or `<PDataArray>`, which has no numbers to read).
    ///
    /// # Errors
    /// [`Problem::Malformed`] if it lacks a type or has attributes without sense.
    pub fn parse(element: &Element) -> Result<ArrayKind, Problem> {
        let name = element
            .attribute("Name")
            .filter(|name| !name.is_empty())
            .map(str::to_owned);
        let shown = name.clone().unwrap_or_else(|| "(unnamed)".to_owned());
        let type_name = element.required("type")?;
        let scalar_type = match type_name {
            "Int8" => ScalarType::I8,
            "UInt8" => ScalarType::U8,
            "Int16" => ScalarType::I16,
            "UInt16" => ScalarType::U16,
            "Int32" => ScalarType::I32,
            "UInt32" => ScalarType::U32,
            "Int64" => ScalarType::I64,
            "UInt64" => ScalarType::U64,
            "Float32" => ScalarType::F32,
            "Float64" => ScalarType::F64,
            "Bit" | "String" => {
                return Ok(ArrayKind::Other {
                    name: shown,
                    type_name: type_name.to_owned(),
                });
            }
            other => {
                return Err(Problem::malformed(
                    format!("attribute `type` of {}", element.place()),
                    "a VTK number type (Int8 … Float64)",
                    format!("`{other}`"),
                ));
            }
        };
        let components = element
            .parsed::<usize>("NumberOfComponents", "a number of components")?
            .unwrap_or(1);
        if components == 0 {
            return Err(Problem::malformed(
                element.place(),
                "at least 1 component",
                "0",
            ));
        }
        let storage = match element.attribute("format") {
            None | Some("ascii") => Storage::Ascii(element.text.clone()),
            Some("binary") => Storage::Inline(element.text.clone()),
            Some("appended") => {
                Storage::Appended(element.parsed("offset", "an offset in bytes")?.ok_or_else(
                    || Problem::malformed(element.place(), "an attribute `offset`", "none"),
                )?)
            }
            Some(other) => {
                return Err(Problem::malformed(
                    format!("attribute `format` of {}", element.place()),
                    "ascii, binary or appended",
                    format!("`{other}`"),
                ));
            }
        };
        Ok(ArrayKind::Numbers(Self {
            what: format!("array `{shown}` at byte {}", element.byte),
            name,
            scalar_type,
            components,
            storage,
        }))
    }

    /// The first array of an element such as `<Points>`, which must be of numbers.
    ///
    /// # Errors
    /// [`Problem::Malformed`] if there is none.
    pub fn first_in(element: &Element) -> Result<Self, Problem> {
        Self::parse_numbers(element.required_child("DataArray")?)
    }

    /// Reads the tag of an array that must be of numbers.
    ///
    /// # Errors
    /// As [`Self::parse`], and [`Problem::Malformed`] if it is not of numbers.
    pub fn parse_numbers(element: &Element) -> Result<Self, Problem> {
        match Self::parse(element)? {
            ArrayKind::Numbers(array) => Ok(array),
            ArrayKind::Other { type_name, .. } => Err(Problem::malformed(
                element.place(),
                "an array of numbers",
                format!("one of type {type_name}"),
            )),
        }
    }

    /// Which array of which place, for messages.
    pub fn what(&self) -> &str {
        &self.what
    }

    /// How many tuples the file says it has of this array: what is to be asked of [`Self::read`]
    /// where nothing else says it.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn tuples_in_file(&self, file: &XmlFile) -> Result<usize, Problem> {
        if let Storage::Ascii(text) = &self.storage {
            return Ok(ascii::words(&joined(file, text)).count() / self.components);
        }
        if let Storage::Inline(text) = &self.storage
            && text.is_empty()
        {
            return Ok(0);
        }
        let stored = self.stored(file)?;
        let bytes = match file.compressor {
            None => stored.words(file, 1, &self.what)?[0],
            Some(_) => {
                let head = stored.words(file, 3, &self.what)?;
                Blocks::announced_bytes(&head).ok_or_else(|| {
                    Problem::malformed(&self.what, "plausible block sizes", "far larger ones")
                })?
            }
        };
        Ok(bytes / self.scalar_type.size_bytes() / self.components)
    }

    /// Checks, without decoding anything, that the file can hold this many tuples: what must be
    /// known before memory for them is allocated elsewhere.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn check(&self, file: &XmlFile, tuples: usize) -> Result<(), Problem> {
        let expected = self.size_bytes(tuples)?;
        match &self.storage {
            Storage::Ascii(text) => {
                let text = joined(file, text);
                ascii::check_room(&text, &self.what, tuples.saturating_mul(self.components))
            }
            _ if expected == 0 => Ok(()),
            _ => self.stored(file)?.layout(self, file, expected).map(drop),
        }
    }

    /// Decodes the numbers: `tuples` tuples, no more and no fewer. Uncompressed appended raw data
    /// in native byte order stays where it is in the file's mapping.
    ///
    /// # Errors
    /// [`Problem`] naming the array, what was expected of it and what was found.
    pub fn read(&self, file: &XmlFile, tuples: usize) -> Result<DataArray, Problem> {
        let shape = (self.scalar_type, self.components, tuples);
        let expected = self.size_bytes(tuples)?;
        if let Storage::Ascii(text) = &self.storage {
            return ascii::parse_array(&joined(file, text), &self.what, shape);
        }
        let numbers = tuples * self.components;
        if expected == 0 {
            return bytes::build_array(self.scalar_type, self.components, 0, |_| Ok(()));
        }
        let stored = self.stored(file)?;
        match stored.layout(self, file, expected)? {
            Layout::Plain { header_bytes } => {
                if let Stored::Raw { from } = stored {
                    let offset = from + header_bytes;
                    let source = &file.source;
                    return bytes::array_in_file(
                        source,
                        &self.what,
                        offset,
                        file.big_endian,
                        shape,
                    );
                }
                let decoded = stored.prefix(file, header_bytes + expected, &self.what)?;
                bytes::build_array(self.scalar_type, self.components, numbers, |to| {
                    to.copy_from_slice(&decoded[header_bytes..]);
                    self.to_native(file, to);
                    Ok(())
                })
            }
            Layout::Compressed {
                header_bytes,
                blocks,
                compressor,
            } => {
                let total = header_bytes.saturating_add(blocks.compressed_bytes(&self.what)?);
                let decoded = stored.prefix(file, total, &self.what)?;
                bytes::build_array(self.scalar_type, self.components, numbers, |to| {
                    blocks.decompress(compressor, &decoded[header_bytes..], to, &self.what)?;
                    self.to_native(file, to);
                    Ok(())
                })
            }
        }
    }

    fn to_native(&self, file: &XmlFile, numbers: &mut [u8]) {
        if file.big_endian != cfg!(target_endian = "big") {
            bytes::swap_in_place(numbers, self.scalar_type);
        }
    }

    fn size_bytes(&self, tuples: usize) -> Result<usize, Problem> {
        tuples
            .checked_mul(self.components)
            .and_then(|n| n.checked_mul(self.scalar_type.size_bytes()))
            .ok_or_else(|| {
                Problem::malformed(
                    &self.what,
                    "an array that fits the address space",
                    format!("{tuples} × {} {}", self.components, self.scalar_type),
                )
            })
    }

    /// Where the binary data is.
    fn stored<'a>(&self, file: &'a XmlFile) -> Result<Stored<'a>, Problem> {
        match &self.storage {
            Storage::Ascii(text) | Storage::Inline(text) => {
                Ok(Stored::Base64(without_space(joined(file, text))))
            }
            Storage::Appended(offset) => {
                let appended = file.appended.as_ref().ok_or_else(|| {
                    Problem::malformed(&self.what, "an element <AppendedData>", "none")
                })?;
                let range = &appended.range;
                let from = range
                    .start
                    .checked_add(*offset)
                    .filter(|from| *from < range.end)
                    .ok_or_else(|| {
                        Problem::malformed(
                            &self.what,
                            format!("an offset below {}", range.len()),
                            offset.to_string(),
                        )
                    })?;
                Ok(match appended.encoding {
                    AppendedEncoding::Raw => Stored::Raw { from },
                    AppendedEncoding::Base64 => {
                        let text = &file.source.bytes()[from..range.end];
                        Stored::Base64(Cow::Borrowed(text.trim_ascii_end()))
                    }
                })
            }
        }
    }
}

/// The text of an element, in one piece.
fn joined<'a>(file: &'a XmlFile, text: &[Range<usize>]) -> Cow<'a, [u8]> {
    let bytes = file.source.bytes();
    match text {
        [] => Cow::Borrowed(&[]),
        [range] => Cow::Borrowed(&bytes[range.clone()]),
        ranges => {
            let parts: Vec<&[u8]> = ranges.iter().map(|r| &bytes[r.clone()]).collect();
            Cow::Owned(parts.join(&b' '))
        }
    }
}

/// Base64 text without the line breaks that some programs put into it.
fn without_space(text: Cow<'_, [u8]>) -> Cow<'_, [u8]> {
    if text.iter().any(u8::is_ascii_whitespace) {
        let dense = text.iter().copied().filter(|b| !b.is_ascii_whitespace());
        return Cow::Owned(dense.collect());
    }
    text
}

/// Binary data as it is stored: header, then numbers or compressed blocks.
enum Stored<'a> {
    /// Bytes of the file from this one.
    Raw {
        /// First byte.
        from: usize,
    },
    /// Base64 text.
    Base64(Cow<'a, [u8]>),
}

/// What the header of binary data says.
enum Layout {
    /// Numbers follow.
    Plain {
        /// Size of the header.
        header_bytes: usize,
    },
    /// Compressed blocks follow.
    Compressed {
        /// Size of the header.
        header_bytes: usize,
        /// The blocks.
        blocks: Blocks,
        /// What compressed them.
        compressor: Compressor,
    },
}

impl Stored<'_> {
    /// The first `len` bytes, decoded.
    fn prefix<'b>(
        &'b self,
        file: &'b XmlFile,
        len: usize,
        what: &str,
    ) -> Result<Cow<'b, [u8]>, Problem> {
        match self {
            Self::Raw { from } => Ok(Cow::Borrowed(file.source.piece(what, *from, len)?)),
            Self::Base64(text) => Ok(Cow::Owned(decode_base64(text, len, what)?)),
        }
    }

    /// The first `count` integers of the header.
    fn words(&self, file: &XmlFile, count: usize, what: &str) -> Result<Vec<usize>, Problem> {
        let size = file.header_type.size_bytes();
        let header = self.prefix(file, count.saturating_mul(size), what)?;
        let word = |bytes: &[u8]| {
            let value = if file.big_endian {
                bytes.iter().fold(0u64, |v, &b| v << 8 | u64::from(b))
            } else {
                bytes.iter().rfold(0u64, |v, &b| v << 8 | u64::from(b))
            };
            usize::try_from(value).unwrap_or(usize::MAX)
        };
        Ok(header.chunks_exact(size).map(word).collect())
    }

    /// Reads the header and checks that `expected` bytes follow from it, and are there.
    fn layout(
        &self,
        array: &DataArrayElement,
        file: &XmlFile,
        expected: usize,
    ) -> Result<Layout, Problem> {
        let what = array.what.as_str();
        let word_bytes = file.header_type.size_bytes();
        let Some(compressor) = file.compressor else {
            let announced = self.words(file, 1, what)?[0];
            if announced != expected {
                return Err(Problem::malformed(
                    what,
                    format!("{expected} bytes of data"),
                    format!("a header that announces {announced}"),
                ));
            }
            self.check_len(file, word_bytes.saturating_add(expected), what)?;
            return Ok(Layout::Plain {
                header_bytes: word_bytes,
            });
        };
        let blocks = Blocks::read(expected, compressor, what, |count| {
            self.words(file, count, what)
        })?;
        let header_bytes = (blocks.compressed.len() + 3) * word_bytes;
        let stored_bytes = header_bytes.saturating_add(blocks.compressed_bytes(what)?);
        self.check_len(file, stored_bytes, what)?;
        Ok(Layout::Compressed {
            header_bytes,
            blocks,
            compressor,
        })
    }

    /// Checks that `len` bytes are there.
    fn check_len(&self, file: &XmlFile, len: usize, what: &str) -> Result<(), Problem> {
        match self {
            Self::Raw { from } => file.source.piece(what, *from, len).map(drop),
            Self::Base64(text) if len <= text.len() / 4 * 3 => Ok(()),
            Self::Base64(text) => Err(Problem::malformed(
                what,
                format!("base64 text of {len} bytes"),
                format!("{} characters", text.len()),
            )),
        }
    }
}
