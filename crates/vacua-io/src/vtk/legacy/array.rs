//! Arrays of numbers in legacy files: found while walking through the file, read when asked for.

use std::ops::Range;

use vacua_volume::{DataArray, ScalarType};

use super::cursor::{Cursor, shown};
use crate::error::Problem;
use crate::source::Source;
use crate::vtk::{ascii, bytes};

/// What the elements of an array are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ElementType {
    /// Numbers.
    Number(ScalarType),
    /// Bits, eight a byte in binary files.
    Bit,
    /// Strings.
    Text,
}

impl ElementType {
    /// By the name in the file. `long` has eight bytes, and `vtkIdType` is stored as `int`, as VTK
    /// on today's systems has it.
    ///
    /// # Errors
    /// [`Problem::Malformed`] for any other name.
    pub fn from_name(place: String, name: &[u8]) -> Result<Self, Problem> {
        let lower = name.to_ascii_lowercase();
        Ok(Self::Number(match lower.as_slice() {
            b"bit" => return Ok(Self::Bit),
            b"string" | b"utf8_string" => return Ok(Self::Text),
            b"char" | b"signed_char" => ScalarType::I8,
            b"unsigned_char" => ScalarType::U8,
            b"short" => ScalarType::I16,
            b"unsigned_short" => ScalarType::U16,
            b"int" | b"vtkidtype" => ScalarType::I32,
            b"unsigned_int" => ScalarType::U32,
            b"long" | b"vtktypeint64" => ScalarType::I64,
            b"unsigned_long" | b"vtktypeuint64" => ScalarType::U64,
            b"float" => ScalarType::F32,
            b"double" => ScalarType::F64,
            _ => {
                return Err(Problem::malformed(
                    place,
                    "a VTK number type (char … double)",
                    format!("`{}`", shown(name)),
                ));
            }
        }))
    }
}

/// An array of numbers in a legacy file.
#[derive(Clone, Debug)]
pub(super) struct LegacyArray {
    /// Type of a number.
    pub scalar_type: ScalarType,
    /// Numbers in a tuple.
    pub components: usize,
    /// Number of tuples.
    pub tuples: usize,
    what: String,
    range: Range<usize>,
    is_binary: bool,
}

impl LegacyArray {
    /// Notes where an array is that starts after the line's end (binary) or with the next word
    /// (ASCII), and moves past it; `None` for bits and strings, which are only passed.
    ///
    /// # Errors
    /// [`Problem`] if the file ends before the array does.
    pub fn locate(
        cursor: &mut Cursor<'_>,
        what: &str,
        element_type: ElementType,
        components: usize,
        tuples: usize,
    ) -> Result<Option<Self>, Problem> {
        let what = format!("{what} at byte {}", cursor.byte());
        let count = tuples.checked_mul(components).ok_or_else(|| {
            Problem::malformed(
                &what,
                "an array that fits the address space",
                format!("{tuples} × {components}"),
            )
        })?;
        if components == 0 {
            return Err(Problem::malformed(what, "at least 1 component", "0"));
        }
        if cursor.is_binary() {
            cursor.line();
        }
        let start = cursor.byte();
        match element_type {
            ElementType::Text if cursor.is_binary() => skip_binary_strings(cursor, &what, count)?,
            ElementType::Text => skip_ascii_strings(cursor, &what, count)?,
            ElementType::Bit if cursor.is_binary() => {
                cursor.skip_bytes(&what, count.div_ceil(8))?
            }
            ElementType::Number(scalar_type) if cursor.is_binary() => {
                let len = count.saturating_mul(scalar_type.size_bytes());
                cursor.skip_bytes(&what, len)?;
            }
            ElementType::Bit | ElementType::Number(_) => cursor.skip_words(&what, count)?,
        }
        let ElementType::Number(scalar_type) = element_type else {
            return Ok(None);
        };
        Ok(Some(Self {
            scalar_type,
            components,
            tuples,
            what,
            range: start..cursor.byte(),
            is_binary: cursor.is_binary(),
        }))
    }

    /// The same numbers said to be of another type, one that text can be parsed as.
    pub fn parsed_as(mut self, scalar_type: ScalarType) -> Self {
        self.scalar_type = scalar_type;
        self
    }

    /// Whether the numbers are text.
    pub fn is_text(&self) -> bool {
        !self.is_binary
    }

    /// Reads the numbers.
    ///
    /// # Errors
    /// [`Problem::Malformed`] if text holds a word that is no number of this type.
    pub fn read(&self, source: &Source) -> Result<DataArray, Problem> {
        let shape = (self.scalar_type, self.components, self.tuples);
        if self.is_binary {
            return bytes::array_in_file(source, &self.what, self.range.start, true, shape);
        }
        let text = source.piece(&self.what, self.range.start, self.range.len())?;
        ascii::parse_array(text, &self.what, shape)
    }
}

/// Strings in ASCII files: one a line.
fn skip_ascii_strings(cursor: &mut Cursor<'_>, what: &str, count: usize) -> Result<(), Problem> {
    cursor.line();
    for i in 0..count {
        if cursor.byte() == cursor.source().len() {
            return Err(Problem::malformed(
                what,
                format!("{count} strings"),
                format!("the end of the file after {i}"),
            ));
        }
        cursor.line();
    }
    Ok(())
}

/// Strings in binary files: a length whose first two bits tell its own size, then the characters.
fn skip_binary_strings(cursor: &mut Cursor<'_>, what: &str, count: usize) -> Result<(), Problem> {
    for _ in 0..count {
        let first = cursor.source().piece(what, cursor.byte(), 1)?[0];
        let length_bytes = [8, 4, 2, 1][usize::from(first >> 6)];
        let length = cursor.source().piece(what, cursor.byte(), length_bytes)?;
        let length = length[1..]
            .iter()
            .fold(u64::from(first & 0x3f), |v, &b| v << 8 | u64::from(b));
        cursor.skip_bytes(what, length_bytes)?;
        cursor.skip_bytes(what, usize::try_from(length).unwrap_or(usize::MAX))?;
    }
    Ok(())
}
