//! NetCDF classic files (CDF-1, CDF-2 and CDF-5): dimensions, variables, and where their numbers are.
//!
//! Source: *The NetCDF Classic Format Specification*, Unidata. Only what meshes need is read: numbers,
//! text, and text attributes. Numbers are big-endian. Variables whose first dimension is the record
//! dimension lie record after record, those of one record one after the other.

mod header;

use vacua_volume::{DataArray, ScalarType};

use crate::error::Problem;
use crate::source::Source;
use crate::vtk::array_in_file;

/// The first bytes of every classic file, before the version.
pub(crate) const MARK: &[u8] = b"CDF";

/// Whether bytes begin as a classic file does.
pub(crate) fn is_classic(bytes: &[u8]) -> bool {
    bytes.starts_with(MARK) && matches!(bytes.get(3), Some(1 | 2 | 5))
}

/// A file's description of itself.
pub(crate) struct Classic {
    source: Source,
    dimensions: Vec<Dimension>,
    variables: Vec<Variable>,
    num_records: usize,
    record_bytes: usize,
}

#[derive(Debug)]
struct Dimension {
    name: String,
    /// `None` for the record dimension.
    len: Option<usize>,
}

#[derive(Debug)]
struct Variable {
    name: String,
    dimensions: Vec<usize>,
    texts: Vec<(String, String)>,
    number_type: NumberType,
    /// First byte.
    begin: usize,
}

/// What a variable consists of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum NumberType {
    Text,
    Number(ScalarType),
}

impl NumberType {
    fn size_bytes(self) -> usize {
        match self {
            Self::Text => 1,
            Self::Number(scalar_type) => scalar_type.size_bytes(),
        }
    }
}

/// What a variable looks like.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Shape {
    /// Type of a number; `None` for text.
    pub scalar_type: Option<ScalarType>,
    /// Lengths; the number of records first if there are records.
    pub lens: Vec<usize>,
    /// Whether there are records.
    pub has_records: bool,
}

impl Classic {
    /// Reads the header.
    ///
    /// # Errors
    /// [`Problem`] where it breaks the rules.
    pub fn parse(source: &Source) -> Result<Self, Problem> {
        header::parse(source)
    }

    /// The length of a dimension, if there is one of that name.
    pub fn dimension(&self, name: &str) -> Option<usize> {
        let found = self.dimensions.iter().find(|d| d.name == name)?;
        Some(found.len.unwrap_or(self.num_records))
    }

    fn find(&self, name: &str) -> Option<&Variable> {
        self.variables.iter().find(|v| v.name == name)
    }

    /// What a variable looks like, if there is one of that name.
    pub fn shape(&self, name: &str) -> Option<Shape> {
        let variable = self.find(name)?;
        let len = |&d: &usize| self.dimensions.get(d)?.len.or(Some(self.num_records));
        Some(Shape {
            scalar_type: match variable.number_type {
                NumberType::Text => None,
                NumberType::Number(scalar_type) => Some(scalar_type),
            },
            lens: variable.dimensions.iter().map(len).collect::<Option<_>>()?,
            has_records: self.has_records(variable),
        })
    }

    fn has_records(&self, variable: &Variable) -> bool {
        let first = variable.dimensions.first();
        first.is_some_and(|&d| self.dimensions.get(d).is_some_and(|d| d.len.is_none()))
    }

    /// A text attribute of a variable.
    pub fn text_of(&self, variable: &str, attribute: &str) -> Option<&str> {
        let texts = &self.find(variable)?.texts;
        let found = texts.iter().find(|(name, _)| name == attribute)?;
        Some(&found.1)
    }

    /// Where part of a variable lies: of one record if it has records, the whole otherwise; then
    /// `count` elements from element `first`.
    fn place(
        &self,
        name: &str,
        record: usize,
        first: usize,
        count: usize,
    ) -> Result<(usize, NumberType), Problem> {
        let what = || format!("variable `{name}`");
        let wrong = |expected: String, found: String| Problem::malformed(what(), expected, found);
        let variable = self
            .find(name)
            .ok_or_else(|| wrong("a variable of this name".to_owned(), "none".to_owned()))?;
        let has_records = self.has_records(variable);
        let (skip, whole) = self.elements(variable);
        if has_records && record >= self.num_records {
            return Err(wrong(
                format!("record {record}"),
                format!("{} records", self.num_records),
            ));
        }
        let whole = whole.filter(|&n| first.checked_add(count).is_some_and(|end| end <= n));
        let Some(_) = whole else {
            return Err(wrong(
                format!("elements {first} to {}", first.saturating_add(count)),
                "fewer of them".to_owned(),
            ));
        };
        let size = variable.number_type.size_bytes();
        let place = usize::from(skip)
            .checked_mul(record)
            .and_then(|r| r.checked_mul(self.record_bytes))
            .and_then(|r| r.checked_add(variable.begin))
            .and_then(|r| r.checked_add(first.checked_mul(size)?))
            .ok_or_else(|| {
                wrong(
                    "a place in the file".to_owned(),
                    "one far beyond".to_owned(),
                )
            })?;
        Ok((place, variable.number_type))
    }

    /// Whether a variable has records, and its number of elements, in one record if so.
    fn elements(&self, variable: &Variable) -> (bool, Option<usize>) {
        let has_records = self.has_records(variable);
        let own = &variable.dimensions[usize::from(has_records)..];
        let count = own
            .iter()
            .try_fold(1usize, |n, &d| n.checked_mul(self.dimensions.get(d)?.len?));
        (has_records, count)
    }

    /// `tuples × components` numbers of a variable, from number `first` of a record, or of the whole
    /// where there are no records.
    ///
    /// # Errors
    /// [`Problem`] if the file has not so many, or they are no numbers.
    pub fn numbers(
        &self,
        name: &str,
        record: usize,
        first: usize,
        components: usize,
        tuples: usize,
    ) -> Result<DataArray, Problem> {
        let what = format!("variable `{name}`");
        let count = tuples.saturating_mul(components);
        let (place, number_type) = self.place(name, record, first, count)?;
        let NumberType::Number(scalar_type) = number_type else {
            return Err(Problem::malformed(what, "numbers", "text"));
        };
        let shape = (scalar_type, components, tuples);
        array_in_file(&self.source, &what, place, true, shape)
    }

    /// Texts of `len` characters each, their ends trimmed.
    ///
    /// # Errors
    /// [`Problem`] if the variable is not there or is no list of texts.
    pub fn texts(&self, name: &str) -> Result<Vec<String>, Problem> {
        let what = format!("variable `{name}`");
        let shape = self.shape(name);
        let Some([count, len]) = shape.as_ref().map(|s| s.lens.as_slice()) else {
            return Err(Problem::malformed(
                what,
                "a list of texts",
                "something else",
            ));
        };
        let bytes_needed = count.saturating_mul(*len);
        let (place, number_type) = self.place(name, 0, 0, bytes_needed)?;
        if number_type != NumberType::Text {
            return Err(Problem::malformed(what, "text", "numbers"));
        }
        let bytes = self.source.piece(&what, place, bytes_needed)?;
        if *len == 0 {
            return Ok(vec![String::new(); (*count).min(self.source.len())]);
        }
        let text = |bytes: &[u8]| {
            let end = bytes.iter().position(|&b| b == 0).unwrap_or(bytes.len());
            String::from_utf8_lossy(&bytes[..end]).trim().to_owned()
        };
        Ok(bytes.chunks_exact(*len).map(text).collect())
    }
}
