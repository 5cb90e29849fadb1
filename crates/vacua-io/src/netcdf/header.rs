//! The header of a classic file.

use vacua_volume::ScalarType;

use super::{Classic, Dimension, NumberType, Variable};
use crate::error::Problem;
use crate::source::Source;

const DIMENSIONS: u64 = 10;
const VARIABLES: u64 = 11;
const ATTRIBUTES: u64 = 12;

/// A place in the header.
struct Cursor<'a> {
    source: &'a Source,
    byte: usize,
    /// 1, 2 or 5.
    version: u8,
}

impl Cursor<'_> {
    fn bytes(&mut self, len: usize) -> Result<&[u8], Problem> {
        let bytes = self.source.piece("the NetCDF header", self.byte, len)?;
        self.byte += len;
        Ok(bytes)
    }

    fn unsigned(&mut self, size: usize) -> Result<u64, Problem> {
        let bytes = self.bytes(size)?;
        Ok(bytes.iter().fold(0u64, |v, &b| v << 8 | u64::from(b)))
    }

    /// A tag of a list.
    fn tag(&mut self) -> Result<u64, Problem> {
        self.unsigned(4)
    }

    /// A count or a length.
    fn count(&mut self) -> Result<usize, Problem> {
        let place = self.byte;
        let size = if self.version == 5 { 8 } else { 4 };
        let value = self.unsigned(size)?;
        usize::try_from(value)
            .ok()
            .filter(|_| value >> (8 * size - 1) == 0)
            .ok_or_else(|| {
                Problem::malformed(format!("byte {place}"), "a count", value.to_string())
            })
    }

    /// A count of things of which each takes at least `bytes` bytes of what is left.
    fn list_len(&mut self, bytes: usize) -> Result<usize, Problem> {
        let place = self.byte;
        let count = self.count()?;
        let left = self.source.len().saturating_sub(self.byte);
        if count > left / bytes {
            return Err(Problem::malformed(
                format!("byte {place}"),
                format!("a count of things that fit {left} bytes"),
                count.to_string(),
            ));
        }
        Ok(count)
    }

    fn name(&mut self) -> Result<String, Problem> {
        let len = self.list_len(1)?;
        let name = String::from_utf8_lossy(self.bytes(len)?).into_owned();
        self.bytes(len.next_multiple_of(4) - len)?;
        Ok(name)
    }

    /// The head of a list: how many things of which each takes at least `bytes` bytes.
    fn list(&mut self, tag: u64, bytes: usize) -> Result<usize, Problem> {
        let place = self.byte;
        let found = self.tag()?;
        let count = self.list_len(bytes)?;
        if found != tag && (found, count) != (0, 0) {
            return Err(Problem::malformed(
                format!("byte {place}"),
                format!("a list with tag {tag}"),
                format!("tag {found}"),
            ));
        }
        Ok(count)
    }

    fn number_type(&mut self) -> Result<NumberType, Problem> {
        let place = self.byte;
        Ok(NumberType::Number(match self.tag()? {
            1 => ScalarType::I8,
            2 => return Ok(NumberType::Text),
            3 => ScalarType::I16,
            4 => ScalarType::I32,
            5 => ScalarType::F32,
            6 => ScalarType::F64,
            7 => ScalarType::U8,
            8 => ScalarType::U16,
            9 => ScalarType::U32,
            10 => ScalarType::I64,
            11 => ScalarType::U64,
            other => {
                return Err(Problem::malformed(
                    format!("byte {place}"),
                    "a NetCDF number type, 1 to 11",
                    other.to_string(),
                ));
            }
        }))
    }

    /// Attributes; those that are text.
    fn attributes(&mut self) -> Result<Vec<(String, String)>, Problem> {
        let mut texts = Vec::new();
        for _ in 0..self.list(ATTRIBUTES, 12)? {
            let name = self.name()?;
            let number_type = self.number_type()?;
            let count = self.list_len(1)?;
            let len = count.checked_mul(number_type.size_bytes()).ok_or_else(|| {
                Problem::malformed(format!("attribute `{name}`"), "a plausible length", "more")
            })?;
            let bytes = self.bytes(len)?;
            if number_type == NumberType::Text {
                let text = String::from_utf8_lossy(bytes);
                let text = text.trim_end_matches('\0').to_owned();
                texts.push((name, text));
            }
            self.bytes(len.next_multiple_of(4) - len)?;
        }
        Ok(texts)
    }
}

/// Reads the header of a classic file.
///
/// # Errors
/// [`Problem`] where it breaks the rules.
pub(super) fn parse(source: &Source) -> Result<Classic, Problem> {
    if !super::is_classic(source.bytes()) {
        return Err(Problem::malformed(
            "byte 0",
            "`CDF` and version 1, 2 or 5",
            "another beginning",
        ));
    }
    let mut cursor = Cursor {
        source,
        byte: 4,
        version: source.bytes()[3],
    };
    let size = if cursor.version == 5 { 8 } else { 4 };
    let num_records = cursor.unsigned(size)?;
    let mut dimensions = Vec::new();
    for _ in 0..cursor.list(DIMENSIONS, 8)? {
        let name = cursor.name()?;
        let len = cursor.count()?;
        dimensions.push(Dimension {
            name,
            len: (len > 0).then_some(len),
        });
    }
    cursor.attributes()?;
    let mut variables = Vec::new();
    for _ in 0..cursor.list(VARIABLES, 28)? {
        variables.push(variable(&mut cursor, dimensions.len())?);
    }
    let mut classic = Classic {
        source: source.clone(),
        dimensions,
        variables,
        num_records: 0,
        record_bytes: 0,
    };
    let is_streaming = num_records == u64::MAX >> (64 - 8 * size);
    count_records(&mut classic, (!is_streaming).then_some(num_records))?;
    Ok(classic)
}

fn variable(cursor: &mut Cursor<'_>, num_dimensions: usize) -> Result<Variable, Problem> {
    let name = cursor.name()?;
    let mut dimensions = Vec::new();
    for _ in 0..cursor.list_len(4)? {
        let dimension = cursor.count()?;
        if dimension >= num_dimensions {
            return Err(Problem::malformed(
                format!("variable `{name}`"),
                format!("dimensions below {num_dimensions}"),
                dimension.to_string(),
            ));
        }
        dimensions.push(dimension);
    }
    let texts = cursor.attributes()?;
    let number_type = cursor.number_type()?;
    // The stored size may be wrong for large variables; it follows from the dimensions.
    cursor.unsigned(if cursor.version == 5 { 8 } else { 4 })?;
    let begin = cursor.unsigned(if cursor.version == 1 { 4 } else { 8 })?;
    Ok(Variable {
        dimensions,
        texts,
        number_type,
        begin: usize::try_from(begin).map_err(|_| {
            Problem::malformed(
                format!("variable `{name}`"),
                "a place in the file",
                begin.to_string(),
            )
        })?,
        name,
    })
}

/// Finds how long a record is, and how many there are where the header does not say.
fn count_records(classic: &mut Classic, announced: Option<u64>) -> Result<(), Problem> {
    let mut sizes = Vec::new();
    let mut first_byte = usize::MAX;
    for variable in &classic.variables {
        let (has_records, elements) = classic.elements(variable);
        if has_records {
            let size = elements.and_then(|n| n.checked_mul(variable.number_type.size_bytes()));
            let size = size.filter(|&n| n <= isize::MAX as usize).ok_or_else(|| {
                Problem::malformed(
                    format!("variable `{}`", variable.name),
                    "a record that fits memory",
                    "a larger one",
                )
            })?;
            sizes.push(size);
            first_byte = first_byte.min(variable.begin);
        }
    }
    // A lone variable of short numbers is not padded.
    classic.record_bytes = match sizes.as_slice() {
        [alone] => *alone,
        sizes => sizes
            .iter()
            .try_fold(0usize, |sum, size| {
                sum.checked_add(size.next_multiple_of(4))
            })
            .ok_or_else(|| Problem::malformed("records", "a plausible length", "a larger one"))?,
    };
    let left = classic.source.len().saturating_sub(first_byte);
    let fit = left.div_ceil(classic.record_bytes.max(1));
    let announced = announced.map(|n| usize::try_from(n).unwrap_or(usize::MAX));
    classic.num_records = match announced {
        Some(n) if n <= fit || sizes.is_empty() => n,
        Some(n) => {
            return Err(Problem::malformed(
                "the number of records",
                format!("at most the {fit} that the file has room for"),
                n.to_string(),
            ));
        }
        None => left / classic.record_bytes.max(1),
    };
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn parse_bytes(bytes: &[u8]) -> Result<Classic, Problem> {
        parse(&Source::from_bytes(Path::new("t.nc"), bytes.to_vec()))
    }

    /// Two dimensions (one of records), a fixed and a record variable.
    fn small(version: u8) -> Vec<u8> {
        let wide = if version == 5 { 8 } else { 4 };
        let place = if version == 1 { 4 } else { 8 };
        let mut out = b"CDF".to_vec();
        out.push(version);
        let put = |out: &mut Vec<u8>, value: u64, size: usize| {
            out.extend(&value.to_be_bytes()[8 - size..]);
        };
        let name = |out: &mut Vec<u8>, text: &str| {
            put(out, text.len() as u64, wide);
            out.extend(text.bytes());
            out.extend(std::iter::repeat_n(
                0,
                text.len().next_multiple_of(4) - text.len(),
            ));
        };
        put(&mut out, 2, wide);
        put(&mut out, DIMENSIONS, 4);
        put(&mut out, 2, wide);
        name(&mut out, "time");
        put(&mut out, 0, wide);
        name(&mut out, "n");
        put(&mut out, 3, wide);
        put(&mut out, 0, 4);
        put(&mut out, 0, wide);
        put(&mut out, VARIABLES, 4);
        put(&mut out, 2, wide);
        let mut begins = Vec::new();
        for (text, dims, kind) in [("fixed", &[1u64][..], 4u64), ("steps", &[0, 1], 3)] {
            name(&mut out, text);
            put(&mut out, dims.len() as u64, wide);
            dims.iter().for_each(|&d| put(&mut out, d, wide));
            put(&mut out, ATTRIBUTES, 4);
            put(&mut out, 1, wide);
            name(&mut out, "units");
            put(&mut out, 2, 4);
            put(&mut out, 1, wide);
            out.extend(b"m\0\0\0");
            put(&mut out, kind, 4);
            put(&mut out, 12, wide);
            begins.push(out.len());
            put(&mut out, 0, place);
        }
        let fixed = out.len() as u64;
        for (at, value) in begins.into_iter().zip([fixed, fixed + 12]) {
            out[at..at + place].copy_from_slice(&value.to_be_bytes()[8 - place..]);
        }
        for value in [7i32, 8, -9] {
            out.extend(value.to_be_bytes());
        }
        for value in 1i16..7 {
            out.extend(value.to_be_bytes());
        }
        out
    }

    #[test]
    fn all_three_versions() {
        for version in [1, 2, 5] {
            let file = parse_bytes(&small(version)).expect("valid");
            assert_eq!(file.dimension("n"), Some(3));
            assert_eq!(file.dimension("time"), Some(2));
            assert_eq!(file.dimension("m"), None);
            assert_eq!(file.text_of("fixed", "units"), Some("m"));
            let fixed = file.numbers("fixed", 0, 0, 1, 3).expect("there");
            assert_eq!(fixed.as_slice::<i32>(), Some(&[7, 8, -9][..]));
            // A lone record variable of short numbers is not padded.
            let second = file.numbers("steps", 1, 0, 1, 3).expect("there");
            assert_eq!(second.as_slice::<i16>(), Some(&[4, 5, 6][..]));
            let shape = file.shape("steps").expect("there");
            assert_eq!((shape.lens, shape.has_records), (vec![2, 3], true));
            assert!(file.numbers("steps", 2, 0, 1, 3).is_err());
            assert!(file.numbers("fixed", 0, 1, 1, 3).is_err());
            assert!(file.numbers("none", 0, 0, 1, 1).is_err());
            assert!(file.texts("fixed").is_err());
        }
    }

    #[test]
    fn lies_are_refused() {
        for version in [1, 2, 5] {
            let good = small(version);
            for len in 0..good.len() {
                if let Ok(file) = parse_bytes(&good[..len]) {
                    assert!(file.numbers("steps", 1, 0, 1, 3).is_err(), "{len}");
                }
            }
            let mut many = good.clone();
            many[4..8].fill(0x7f);
            assert!(parse_bytes(&many).is_err());
        }
        assert!(parse_bytes(b"CDF\x03").is_err());
        assert!(parse_bytes(b"").is_err());
    }
}
