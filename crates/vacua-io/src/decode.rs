//! Stored bytes to numbers in memory: byte order, text, hexadecimal, planes to tuples.
//!
//! Little-endian data that is aligned in its file stays there ([`Source::array`]); everything else
//! is copied once, in parallel, into an allocation no larger than the checked size.

use std::str::FromStr;

use rayon::prelude::*;
use vacua_volume::{ArrayError, DataArray, Scalar, ScalarType, dispatch_scalar};

use crate::error::Problem;
use crate::source::Source;

/// Bytes that one thread copies or swaps at a time; a multiple of every number's size.
const CHUNK_BYTES: usize = 1 << 20;

/// The order of the bytes of one number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Endianness {
    /// Lowest byte first.
    Little,
    /// Highest byte first.
    Big,
}

impl Endianness {
    /// The order of this machine.
    pub(crate) const NATIVE: Self = if cfg!(target_endian = "big") {
        Self::Big
    } else {
        Self::Little
    };

    /// `Big` if `big`.
    pub(crate) fn big_if(big: bool) -> Self {
        if big { Self::Big } else { Self::Little }
    }
}

/// `tuples × components` numbers of one type, as they are stored.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Layout {
    /// Type of a number.
    pub(crate) scalar_type: ScalarType,
    /// Byte order of a number.
    pub(crate) endianness: Endianness,
    /// Numbers in a tuple.
    pub(crate) components: usize,
    /// Number of tuples.
    pub(crate) tuples: usize,
}

impl Layout {
    /// Size in bytes.
    ///
    /// # Errors
    /// [`ArrayError::TooLarge`] if that does not fit the address space.
    pub(crate) fn len_bytes(&self) -> Result<usize, Problem> {
        self.tuples
            .checked_mul(self.components)
            .and_then(|n| n.checked_mul(self.scalar_type.size_bytes()))
            .filter(|&len| len <= isize::MAX as usize)
            .ok_or_else(|| self.too_large())
    }

    /// Whether the numbers can be used where they are.
    pub(crate) fn is_native(&self) -> bool {
        self.endianness == Endianness::NATIVE || self.scalar_type.size_bytes() == 1
    }

    fn too_large(&self) -> Problem {
        ArrayError::TooLarge {
            tuples: self.tuples,
            components: self.components,
            scalar_type: self.scalar_type,
        }
        .into()
    }

    /// An array filled by `fill`, which gets its bytes, all zero. The caller has checked that the
    /// file warrants the size. `stored` bytes are swapped to native order afterwards.
    ///
    /// # Errors
    /// [`ArrayError::TooLarge`] if there is no such memory, or what `fill` fails with.
    pub(crate) fn fill_array(
        &self,
        stored: bool,
        fill: impl FnOnce(&mut [u8]) -> Result<(), Problem>,
    ) -> Result<DataArray, Problem> {
        let numbers = self.len_bytes()? / self.scalar_type.size_bytes();
        dispatch_scalar!(self.scalar_type, T => {
            let mut values = bytemuck::allocation::try_zeroed_vec::<T>(numbers)
                .map_err(|()| self.too_large())?;
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut values);
            fill(bytes)?;
            if stored && !self.is_native() {
                swap_bytes(bytes, self.scalar_type.size_bytes());
            }
            Ok(DataArray::from_vec(values, self.components)?)
        })
    }
}

/// Reverses the bytes of every number of `size_bytes` (1, 2, 4 or 8), in parallel.
pub(crate) fn swap_bytes(bytes: &mut [u8], size_bytes: usize) {
    if size_bytes > 1 {
        bytes
            .par_chunks_mut(CHUNK_BYTES)
            .for_each(|chunk| swap_chunk(chunk, size_bytes));
    }
}

/// The same by one thread.
pub(crate) fn swap_chunk(bytes: &mut [u8], size_bytes: usize) {
    match size_bytes {
        2 => bytes.as_chunks_mut().0.iter_mut().for_each(|b| {
            *b = u16::from_ne_bytes(*b).swap_bytes().to_ne_bytes();
        }),
        4 => bytes.as_chunks_mut().0.iter_mut().for_each(|b| {
            *b = u32::from_ne_bytes(*b).swap_bytes().to_ne_bytes();
        }),
        8 => bytes.as_chunks_mut().0.iter_mut().for_each(|b| {
            *b = u64::from_ne_bytes(*b).swap_bytes().to_ne_bytes();
        }),
        _ => {}
    }
}

/// Copies in parallel; both slices have the same length.
pub(crate) fn copy_bytes(to: &mut [u8], from: &[u8]) {
    to.par_chunks_mut(CHUNK_BYTES)
        .zip(from.par_chunks(CHUNK_BYTES))
        .for_each(|(to, from)| to.copy_from_slice(from));
}

/// Numbers that lie uncompressed in a file: mapped where they are in native order, otherwise
/// copied and swapped.
///
/// # Errors
/// [`Problem::Truncated`] or [`Problem::Array`].
pub(crate) fn decode_array(
    source: &Source,
    what: &str,
    offset_bytes: usize,
    layout: &Layout,
) -> Result<DataArray, Problem> {
    if layout.is_native() {
        return source.array(
            what,
            offset_bytes,
            layout.scalar_type,
            layout.components,
            layout.tuples,
        );
    }
    let stored = source.piece(what, offset_bytes, layout.len_bytes()?)?;
    decode_bytes(stored, layout)
}

/// Stored bytes, exactly as many as the layout says, as an array.
///
/// # Errors
/// [`Problem::Malformed`] if there are more or fewer, [`Problem::Array`] without memory.
pub(crate) fn decode_bytes(stored: &[u8], layout: &Layout) -> Result<DataArray, Problem> {
    let expected = layout.len_bytes()?;
    if stored.len() != expected {
        return Err(Problem::malformed(
            "data",
            format!("{expected} bytes"),
            format!("{} bytes", stored.len()),
        ));
    }
    let swap = !layout.is_native();
    layout.fill_array(false, |bytes| {
        bytes
            .par_chunks_mut(CHUNK_BYTES)
            .zip(stored.par_chunks(CHUNK_BYTES))
            .for_each(|(to, from)| {
                to.copy_from_slice(from);
                if swap {
                    swap_chunk(to, layout.scalar_type.size_bytes());
                }
            });
        Ok(())
    })
}

/// Numbers written as text, into native bytes. Separators are white space and commas.
///
/// # Errors
/// [`Problem::Malformed`] naming the number that is missing, unreadable or out of its type's range.
pub(crate) fn parse_text(
    text: &[u8],
    scalar_type: ScalarType,
    bytes: &mut [u8],
) -> Result<(), Problem> {
    dispatch_scalar!(scalar_type, T => {
        let mut tokens = text
            .split(|b| b.is_ascii_whitespace() || *b == b',')
            .filter(|token| !token.is_empty());
        let (numbers, _) = bytes.as_chunks_mut::<{ size_of::<T>() }>();
        let total = numbers.len();
        for (i, place) in numbers.iter_mut().enumerate() {
            let token = tokens.next().unwrap_or_default();
            let value: T = parse_number(token).ok_or_else(|| {
                let found = if token.is_empty() { "the end".to_owned() } else { shown(token) };
                Problem::malformed(
                    format!("number {} of {total}", i + 1),
                    format!("a {scalar_type} as text"),
                    found,
                )
            })?;
            *place = value.to_ne_bytes();
        }
        Ok(())
    })
}

/// A number as C++ streams print it: integers may come as `1e+06` or `3.0`.
fn parse_number<T: Scalar + FromStr>(token: &[u8]) -> Option<T> {
    let token = std::str::from_utf8(token).ok()?;
    token.parse().ok().or_else(|| {
        let value: f64 = token.parse().ok()?;
        let number = T::from_f64(value);
        (number.to_f64() == value).then_some(number)
    })
}

/// Bytes written as pairs of hexadecimal digits, white space anywhere.
///
/// # Errors
/// [`Problem::Malformed`] at the first wrong or missing digit.
pub(crate) fn parse_hex(text: &[u8], bytes: &mut [u8]) -> Result<(), Problem> {
    let mut digits = text
        .iter()
        .enumerate()
        .filter(|(_, b)| !b.is_ascii_whitespace());
    let mut digit = || match digits.next() {
        Some((at, &b)) => char::from(b).to_digit(16).map(|d| d as u8).ok_or_else(|| {
            Problem::malformed(
                format!("byte {at} of the data"),
                "a hexadecimal digit",
                shown(&[b]),
            )
        }),
        None => Err(Problem::malformed(
            "data",
            "more hexadecimal digits",
            "the end",
        )),
    };
    for byte in bytes {
        *byte = digit()? << 4 | digit()?;
    }
    Ok(())
}

/// Turns `components` planes one after the other into interleaved tuples.
///
/// # Errors
/// [`Problem::Array`] if the numbers do not divide into planes, or there is no memory.
pub(crate) fn interleave(planes: &DataArray, components: usize) -> Result<DataArray, Problem> {
    const CHUNK_TUPLES: usize = 1 << 14;
    let len = planes.tuples() * planes.components();
    if components == 0 || !len.is_multiple_of(components) {
        return Err(ArrayError::Ragged { len, components }.into());
    }
    let tuples = len / components;
    dispatch_scalar!(planes.scalar_type(), T => {
        let from = bytemuck::cast_slice::<u8, T>(planes.bytes());
        let mut to = vec![T::default(); len];
        to.par_chunks_mut(CHUNK_TUPLES * components)
            .enumerate()
            .for_each(|(chunk, to)| {
                let first = chunk * CHUNK_TUPLES;
                for (t, tuple) in to.chunks_exact_mut(components).enumerate() {
                    for (c, number) in tuple.iter_mut().enumerate() {
                        *number = from[c * tuples + first + t];
                    }
                }
            });
        Ok(DataArray::from_vec(to, components)?)
    })
}

/// Bytes of a file as an error may show them: short and printable.
pub(crate) fn shown(bytes: &[u8]) -> String {
    const MOST_BYTES: usize = 40;
    let head = bytes[..bytes.len().min(MOST_BYTES)].escape_ascii();
    let dots = if bytes.len() > MOST_BYTES { "…" } else { "" };
    format!("`{head}{dots}`")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layout(scalar_type: ScalarType, endianness: Endianness, tuples: usize) -> Layout {
        Layout {
            scalar_type,
            endianness,
            components: 1,
            tuples,
        }
    }

    #[test]
    fn both_byte_orders_of_every_type_agree() {
        for scalar_type in ScalarType::ALL {
            dispatch_scalar!(scalar_type, T => {
                let values: Vec<T> = [0.0, 1.0, 77.0, 100.0].map(T::from_f64).to_vec();
                let little: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
                let big: Vec<u8> = values.iter().flat_map(|v| v.to_be_bytes()).collect();
                for (bytes, order) in [(little, Endianness::Little), (big, Endianness::Big)] {
                    let array = decode_bytes(&bytes, &layout(scalar_type, order, 4)).expect("fits");
                    assert_eq!(array.as_slice::<T>(), Some(values.as_slice()));
                }
            });
        }
    }

    #[test]
    fn swapping_crosses_chunks() {
        let values: Vec<u32> = (0..CHUNK_BYTES as u32).collect();
        let big: Vec<u8> = values.iter().flat_map(|v| v.to_be_bytes()).collect();
        let array = decode_bytes(
            &big,
            &layout(ScalarType::U32, Endianness::Big, values.len()),
        );
        assert_eq!(
            array.expect("fits").as_slice::<u32>(),
            Some(values.as_slice())
        );
    }

    #[test]
    fn text_and_hex() {
        let mut bytes = [0u8; 8];
        parse_text(b"1 -2,\n3e2\t4.0", ScalarType::I16, &mut bytes).expect("four numbers");
        assert_eq!(
            bytemuck::pod_read_unaligned::<[i16; 4]>(&bytes),
            [1, -2, 300, 4]
        );
        assert!(parse_text(b"1 2 3", ScalarType::I16, &mut bytes).is_err());
        assert!(parse_text(b"1 2 3 4.5", ScalarType::I16, &mut bytes).is_err());
        assert!(parse_text(b"1 2 3 99999", ScalarType::I16, &mut bytes).is_err());
        let mut two = [0u8; 2];
        parse_hex(b"a\n0 Ff", &mut two).expect("two bytes");
        assert_eq!(two, [0xa0, 0xff]);
        assert!(parse_hex(b"a0 f", &mut two).is_err());
        assert!(parse_hex(b"a0 gg", &mut two).is_err());
    }

    #[test]
    fn planes_become_tuples() {
        let planes = DataArray::from_vec(vec![1u8, 2, 3, 10, 20, 30], 1).expect("flat");
        let tuples = interleave(&planes, 2).expect("two planes of three");
        assert_eq!(
            tuples.as_slice::<u8>(),
            Some([1, 10, 2, 20, 3, 30].as_slice())
        );
        assert!(interleave(&planes, 4).is_err());
    }
}
