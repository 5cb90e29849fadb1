//! Numbers written as text, any number of them between white space, parsed in parallel.

use rayon::prelude::*;
use vacua_volume::{DataArray, Scalar, ScalarType, dispatch_scalar};

use crate::error::Problem;

/// Text that one task parses.
const CHUNK_BYTES: usize = 1 << 18;

/// Parses exactly `tuples × components` numbers.
///
/// Floating-point text rounds to nearest in its own type; `nan` and `inf` are numbers. Integers
/// may be written with a fraction of zero (`3.0`) but must fit their type.
///
/// # Errors
/// [`Problem::Malformed`] naming the array and the first word that is no such number, or the count.
pub(crate) fn parse_array(
    text: &[u8],
    what: &str,
    (scalar_type, components, tuples): (ScalarType, usize, usize),
) -> Result<DataArray, Problem> {
    let expected = tuples.saturating_mul(components);
    check_room(text, what, expected)?;
    dispatch_scalar!(scalar_type, T => {
        let numbers = parse_numbers::<T>(text, what)?;
        check_count(what, expected, numbers.len())?;
        Ok(DataArray::from_vec(numbers, components)?)
    })
}

/// Refuses to look for more numbers than the text has room for.
///
/// # Errors
/// [`Problem::Malformed`].
pub(crate) fn check_room(text: &[u8], what: &str, expected: usize) -> Result<(), Problem> {
    if expected > text.len().div_ceil(2) {
        return Err(Problem::malformed(
            what,
            format!("{expected} numbers"),
            format!("only {} characters", text.len()),
        ));
    }
    Ok(())
}

fn check_count(what: &str, expected: usize, found: usize) -> Result<(), Problem> {
    if found != expected {
        return Err(Problem::malformed(
            what,
            format!("{expected} numbers"),
            format!("{found}"),
        ));
    }
    Ok(())
}

fn parse_numbers<T: Scalar + AsciiNumber>(text: &[u8], what: &str) -> Result<Vec<T>, Problem> {
    let chunks = split_at_space(text);
    let parsed: Vec<Vec<T>> = chunks
        .par_iter()
        .map(|chunk| {
            words(chunk)
                .map(|word| T::parse_ascii(word).ok_or_else(|| bad_word::<T>(word, what)))
                .collect::<Result<Vec<T>, Problem>>()
        })
        .collect::<Result<_, _>>()?;
    match <[Vec<T>; 1]>::try_from(parsed) {
        Ok([numbers]) => Ok(numbers),
        Err(parts) => Ok(parts.concat()),
    }
}

fn bad_word<T: Scalar>(word: &[u8], what: &str) -> Problem {
    let shown: String = String::from_utf8_lossy(word).chars().take(40).collect();
    Problem::malformed(
        what,
        format!("a number of type {}", T::TYPE),
        format!("`{shown}`"),
    )
}

/// The words of a text.
pub(crate) fn words(text: &[u8]) -> impl Iterator<Item = &[u8]> {
    text.split(|b| b.is_ascii_whitespace() || *b == 0)
        .filter(|word| !word.is_empty())
}

fn split_at_space(mut text: &[u8]) -> Vec<&[u8]> {
    let mut chunks = Vec::new();
    while text.len() > CHUNK_BYTES {
        let cut = text[CHUNK_BYTES..]
            .iter()
            .position(u8::is_ascii_whitespace)
            .map_or(text.len(), |p| p + CHUNK_BYTES);
        let (head, tail) = text.split_at(cut);
        chunks.push(head);
        text = tail;
    }
    chunks.push(text);
    chunks
}

/// A number type that reads itself from a word.
pub(crate) trait AsciiNumber: Sized {
    /// The number, or `None` if the word is none of this type.
    fn parse_ascii(word: &[u8]) -> Option<Self>;
}

/// Below this every integer has a floating-point number of its own.
const MAX_EXACT: f64 = (1u64 << 53) as f64;

macro_rules! integers {
    ($($t:ty)*) => {$(
        impl AsciiNumber for $t {
            fn parse_ascii(word: &[u8]) -> Option<Self> {
                let word = std::str::from_utf8(word).ok()?;
                word.parse().ok().or_else(|| {
                    let value: f64 = word.parse().ok()?;
                    let number = value as $t;
                    let exact = value.fract() == 0.0 && value.abs() < MAX_EXACT;
                    (exact && number as f64 == value).then_some(number)
                })
            }
        }
    )*};
}
integers!(u8 i8 u16 i16 u32 i32 u64 i64);

macro_rules! floats {
    ($($t:ty)*) => {$(
        impl AsciiNumber for $t {
            fn parse_ascii(word: &[u8]) -> Option<Self> {
                std::str::from_utf8(word).ok()?.parse().ok()
            }
        }
    )*};
}
floats!(f32 f64);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_every_kind() {
        let a = parse_array(b" 1.5 nan\n-inf\t3e2 ", "a", (ScalarType::F32, 2, 2)).expect("four");
        let values = a.as_slice::<f32>().expect("f32");
        assert_eq!(
            (values[0], values[2], values[3]),
            (1.5, f32::NEG_INFINITY, 300.0)
        );
        assert!(values[1].is_nan());
        assert!(parse_array(b"-128 127", "a", (ScalarType::I8, 1, 2)).is_ok());
        assert!(parse_array(b"3.0 1e2", "a", (ScalarType::U8, 1, 2)).is_ok());
        for bad in ["256", "-1", "1.5", "x", "nan", "1e40"] {
            assert!(
                parse_array(bad.as_bytes(), "a", (ScalarType::U8, 1, 1)).is_err(),
                "{bad}"
            );
        }
        assert!(parse_array(b"1 2", "a", (ScalarType::U8, 1, 1)).is_err());
        assert!(parse_array(b"1 2", "a", (ScalarType::U8, usize::MAX, 2)).is_err());
    }

    #[test]
    fn chunks_join_without_a_seam() {
        let text: String = (0..200_000).map(|i| format!("{i} ")).collect();
        let a = parse_array(text.as_bytes(), "a", (ScalarType::U32, 1, 200_000)).expect("all");
        let expected: Vec<u32> = (0..200_000).collect();
        assert_eq!(a.as_slice::<u32>(), Some(&expected[..]));
    }
}
