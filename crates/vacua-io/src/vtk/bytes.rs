//! Numbers from bytes in either byte order.

use rayon::prelude::*;
use vacua_volume::{DataArray, ScalarType, dispatch_scalar};

use crate::error::Problem;
use crate::source::Source;

/// Bytes that one task reverses.
const CHUNK_BYTES: usize = 1 << 20;

/// Reverses the bytes of every number, in parallel.
pub(crate) fn swap_in_place(bytes: &mut [u8], scalar_type: ScalarType) {
    let size = scalar_type.size_bytes();
    if size > 1 {
        bytes.par_chunks_mut(CHUNK_BYTES).for_each(|chunk| {
            for number in chunk.chunks_exact_mut(size) {
                number.reverse();
            }
        });
    }
}

/// Makes an array of numbers whose bytes `fill` writes, aligned for their type.
///
/// The caller has checked that the file is large enough to hold this many numbers.
///
/// # Errors
/// What `fill` fails with, or [`Problem::Array`] if `len` is no multiple of `components`.
pub(crate) fn build_array(
    scalar_type: ScalarType,
    components: usize,
    len: usize,
    fill: impl FnOnce(&mut [u8]) -> Result<(), Problem>,
) -> Result<DataArray, Problem> {
    dispatch_scalar!(scalar_type, T => {
        let mut numbers: Vec<T> = bytemuck::allocation::zeroed_vec(len);
        fill(bytemuck::cast_slice_mut(&mut numbers))?;
        Ok(DataArray::from_vec(numbers, components)?)
    })
}

/// Numbers that lie in a file: mapped if they are in native order, copied if not.
///
/// # Errors
/// [`Problem::Truncated`] if the file ends before they do.
pub(crate) fn array_in_file(
    source: &Source,
    what: &str,
    offset_bytes: usize,
    big_endian: bool,
    (scalar_type, components, tuples): (ScalarType, usize, usize),
) -> Result<DataArray, Problem> {
    let native = cfg!(target_endian = "big") == big_endian || scalar_type.size_bytes() == 1;
    if native {
        return source.array(what, offset_bytes, scalar_type, components, tuples);
    }
    let numbers = tuples.saturating_mul(components);
    let len_bytes = numbers.saturating_mul(scalar_type.size_bytes());
    let bytes = source.piece(what, offset_bytes, len_bytes)?;
    build_array(scalar_type, components, numbers, |to| {
        to.copy_from_slice(bytes);
        swap_in_place(to, scalar_type);
        Ok(())
    })
}
