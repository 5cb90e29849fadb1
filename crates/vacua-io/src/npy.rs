//! NumPy `.npy` files, versions 1 to 3: an array of shape `(z, y, x)` or `(z, y, x, components)`.
//!
//! `array[z, y, x]` is the point at index `(x, y, z)`, as NumPy, scikit-image and tifffile have
//! it. C order in the machine's byte order is mapped; Fortran order is transposed. Booleans become
//! `u8`, half precision becomes `f32`. Source: NumPy enhancement proposal 1 and `numpy.lib.format`.

use std::io::Write;
use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use half::f16;
use half::slice::HalfFloatSliceExt;
use rayon::prelude::*;
use vacua_volume::{
    Association, DataArray, Dataset, Field, Geometry, LoadError, ScalarType, UniformGrid,
    dispatch_scalar,
};

use crate::atomic::write_atomically;
use crate::decode::{Endianness, Layout, decode_array, shown};
use crate::error::{IoError, Problem};
use crate::registry::{Format, ReadOptions};
use crate::save::{DATA_ALIGN, Saved, Voxels, WriteFormat};
use crate::source::Source;

const MAGIC: &[u8] = b"\x93NUMPY";
/// Most components a voxel may have; a longer last axis is more likely space or time.
const MOST_COMPONENTS: usize = 4;

/// The NumPy format.
pub(crate) const FORMAT: Format = Format {
    name: "NumPy",
    extensions: &["npy"],
    sniff: Some(|bytes| bytes.starts_with(MAGIC)),
    read,
};

/// Writing NumPy files.
pub(crate) const WRITER: WriteFormat = WriteFormat {
    name: "NumPy",
    extensions: &["npy"],
    write,
};

/// What a number is in the file, which is not always what it becomes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stored {
    Same(ScalarType),
    Half,
}

/// The header's dictionary.
#[derive(Debug)]
struct Header {
    stored: Stored,
    endianness: Endianness,
    is_fortran_order: bool,
    shape: Vec<usize>,
}

/// Reads an array.
///
/// # Errors
/// [`Problem`] naming the part of the header that is wrong or not supported.
fn read(source: &Source, options: &ReadOptions) -> Result<Dataset, Problem> {
    let start = source.piece("the magic", 0, 8)?;
    if !start.starts_with(MAGIC) {
        return Err(Problem::malformed("byte 0", "\\x93NUMPY", shown(start)));
    }
    let (header_at, header_len) = match start[6] {
        1 => {
            let b = source.piece("the header length", 8, 2)?;
            (10, usize::from(u16::from_le_bytes([b[0], b[1]])))
        }
        2 | 3 => {
            let b = source.piece("the header length", 8, 4)?;
            (12, u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize)
        }
        other => return Err(Problem::unsupported(format!("npy version {other}"))),
    };
    let header = Header::parse(source.piece("the header", header_at, header_len)?)?;
    let (points, components) = match header.shape[..] {
        [z, y, x] => ([x, y, z], 1),
        [z, y, x, c] if (1..=MOST_COMPONENTS).contains(&c) => ([x, y, z], c),
        _ => {
            return Err(Problem::unsupported_but(
                format!("an array of shape {:?}", header.shape),
                format!("reshape it to (z, y, x), or (z, y, x, c) with c ≤ {MOST_COMPONENTS}"),
            ));
        }
    };
    let origin = DVec3::from(options.origin.unwrap_or_default());
    let spacing = DVec3::from(options.spacing.unwrap_or([1.0; 3]));
    let grid = UniformGrid::new(points, origin, spacing)?;
    let file_type = match header.stored {
        Stored::Same(scalar_type) => scalar_type,
        Stored::Half => ScalarType::U16,
    };
    let layout = Layout {
        scalar_type: file_type,
        endianness: header.endianness,
        components,
        tuples: points.iter().product(),
    };
    let data_at = header_at + header_len;
    let data_bytes = layout.len_bytes()?;
    source.piece("the data", data_at, data_bytes)?;
    let extra = source.len() - data_at - data_bytes;
    let path_of_errors = source.path().to_owned();

    let direct = header.stored != Stored::Half && !header.is_fortran_order;
    let field = if direct && layout.is_native() {
        let values = decode_array(source, "the data", data_at, &layout)?;
        Field::new("scalars", Association::Point, values)
    } else {
        let result_type = match header.stored {
            Stored::Same(scalar_type) => scalar_type,
            Stored::Half => ScalarType::F32,
        };
        let tuples = layout.tuples;
        let source = source.clone();
        let load = move || -> Result<DataArray, Problem> {
            let mut values = decode_array(&source, "the data", data_at, &layout)?;
            if header.stored == Stored::Half {
                values = widen(&values)?;
            }
            if header.is_fortran_order {
                values = transpose(&values, points)?;
            }
            Ok(values)
        };
        let path = path_of_errors;
        Field::lazy(
            "scalars",
            Association::Point,
            result_type,
            components,
            tuples,
            move || load().map_err(|p| Arc::new(p.in_file(&path)) as LoadError),
        )
    };
    let dataset = Dataset::new(Geometry::Uniform(grid), vec![field])?;
    Ok(if extra > 0 {
        dataset.with_note(format!("{extra} bytes after the array were not read"))
    } else {
        dataset
    })
}

/// Half to single precision; the bits come as `u16` in native order.
pub(crate) fn widen(halves: &DataArray) -> Result<DataArray, Problem> {
    let bits = halves.as_slice::<u16>().unwrap_or_default();
    let halves_f16: &[f16] = half::slice::HalfBitsSliceExt::reinterpret_cast(bits);
    let mut wide = vec![0f32; bits.len()];
    wide.par_chunks_mut(1 << 16)
        .zip(halves_f16.par_chunks(1 << 16))
        .for_each(|(to, from)| from.convert_to_f32_slice(to));
    Ok(DataArray::from_vec(wide, halves.components())?)
}

/// From Fortran order, where z is fastest and components are planes, to x fastest, interleaved.
fn transpose(values: &DataArray, points: [usize; 3]) -> Result<DataArray, Problem> {
    /// Side of the tiles in which x and z change places; a tile of f64 fits the first cache.
    const TILE: usize = 32;
    let [nx, ny, nz] = points;
    let components = values.components();
    dispatch_scalar!(values.scalar_type(), T => {
        let from = bytemuck::cast_slice::<u8, T>(values.bytes());
        let mut to = vec![T::default(); from.len()];
        let slab = nx * ny * components;
        to.par_chunks_mut(slab * TILE).enumerate().for_each(|(block, to)| {
            let z0 = block * TILE;
            let z1 = (z0 + TILE).min(nz);
            for c in 0..components {
                for y in 0..ny {
                    for x0 in (0..nx).step_by(TILE) {
                        for z in z0..z1 {
                            for x in x0..(x0 + TILE).min(nx) {
                                let stored = z + nz * (y + ny * (x + nx * c));
                                let wanted = c + components * (x + nx * (y + ny * (z - z0)));
                                to[wanted] = from[stored];
                            }
                        }
                    }
                }
            }
        });
        Ok(DataArray::from_vec(to, components)?)
    })
}

impl Header {
    /// Reads `{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4, 5), }`.
    fn parse(bytes: &[u8]) -> Result<Self, Problem> {
        let wrong = |expected: &str, found: &str| {
            Problem::malformed("npy header", expected, shown(found.as_bytes()))
        };
        let text = std::str::from_utf8(bytes)
            .map_err(|_| wrong("text", "bytes that are not text"))?
            .trim();
        let mut rest = text
            .strip_prefix('{')
            .and_then(|t| t.strip_suffix('}'))
            .ok_or_else(|| wrong("a dictionary in braces", text))?
            .trim();
        let (mut descr, mut order, mut shape) = (None, None, None);
        while !rest.is_empty() {
            let (key, after) = quoted(rest).ok_or_else(|| wrong("a quoted key", rest))?;
            let after = after
                .trim_start()
                .strip_prefix(':')
                .ok_or_else(|| wrong("a colon after the key", after))?
                .trim_start();
            let after = match key {
                "descr" => {
                    let (value, after) = quoted(after).ok_or_else(|| {
                        Problem::unsupported(format!(
                            "a structured data type ({})",
                            shown(after.as_bytes())
                        ))
                    })?;
                    descr = Some(value);
                    after
                }
                "fortran_order" => {
                    let (value, after) = [(true, "True"), (false, "False")]
                        .into_iter()
                        .find_map(|(v, word)| Some((v, after.strip_prefix(word)?)))
                        .ok_or_else(|| wrong("True or False", after))?;
                    order = Some(value);
                    after
                }
                "shape" => {
                    let (inside, after) = after
                        .strip_prefix('(')
                        .and_then(|t| t.split_once(')'))
                        .ok_or_else(|| wrong("a tuple of sizes", after))?;
                    let sizes: Result<Vec<usize>, Problem> = inside
                        .split(',')
                        .map(|n| n.trim().trim_end_matches('L'))
                        .filter(|n| !n.is_empty())
                        .map(|n| n.parse().map_err(|_| wrong("a size", n)))
                        .collect();
                    shape = Some(sizes?);
                    after
                }
                other => return Err(wrong("descr, fortran_order or shape", other)),
            };
            let after = after.trim_start();
            rest = match after.strip_prefix(',') {
                Some(next) => next.trim_start(),
                None if after.is_empty() => after,
                None => return Err(wrong("a comma", after)),
            };
        }
        let descr = descr.ok_or_else(|| wrong("the key descr", text))?;
        let (stored, endianness) = parse_descr(descr)?;
        Ok(Self {
            stored,
            endianness,
            is_fortran_order: order.ok_or_else(|| wrong("the key fortran_order", text))?,
            shape: shape.ok_or_else(|| wrong("the key shape", text))?,
        })
    }
}

/// A string in single or double quotes, and what follows it.
fn quoted(text: &str) -> Option<(&str, &str)> {
    let quote = text.chars().next().filter(|c| matches!(c, '\'' | '"'))?;
    text[1..].split_once(quote)
}

/// A data type such as `<f4`: byte order, kind, bytes.
fn parse_descr(descr: &str) -> Result<(Stored, Endianness), Problem> {
    let (endianness, code) = match descr.split_at_checked(1) {
        Some(("<", code)) => (Endianness::Little, code),
        Some((">", code)) => (Endianness::Big, code),
        Some(("|" | "=", code)) => (Endianness::NATIVE, code),
        _ => (Endianness::NATIVE, descr),
    };
    let stored = match code {
        "b1" | "u1" => Stored::Same(ScalarType::U8),
        "i1" => Stored::Same(ScalarType::I8),
        "u2" => Stored::Same(ScalarType::U16),
        "i2" => Stored::Same(ScalarType::I16),
        "u4" => Stored::Same(ScalarType::U32),
        "i4" => Stored::Same(ScalarType::I32),
        "u8" => Stored::Same(ScalarType::U64),
        "i8" => Stored::Same(ScalarType::I64),
        "f4" => Stored::Same(ScalarType::F32),
        "f8" => Stored::Same(ScalarType::F64),
        "f2" => Stored::Half,
        _ => {
            let what = match code.get(..1) {
                Some("c") => "complex numbers",
                Some("f") => "extended precision",
                Some("S" | "U" | "a") => "text",
                Some("O") => "Python objects",
                Some("m" | "M") => "dates",
                _ => "the data type",
            };
            return Err(Problem::unsupported_but(
                format!("{what} ({})", shown(descr.as_bytes())),
                "convert it with .astype",
            ));
        }
    };
    Ok((stored, endianness))
}

/// Writes version 1.0, C order, little-endian.
fn write(path: &Path, voxels: &Voxels) -> Result<Saved, IoError> {
    let values = voxels.values;
    let name = values.scalar_type().name();
    let size = values.scalar_type().size_bytes();
    let order = if size == 1 { '|' } else { '<' };
    let [x, y, z] = voxels.grid.points();
    let shape = match values.components() {
        1 => format!("({z}, {y}, {x})"),
        c => format!("({z}, {y}, {x}, {c})"),
    };
    let dictionary = format!(
        "{{'descr': '{order}{}{size}', 'fortran_order': False, 'shape': {shape}, }}",
        &name[..1]
    );
    let len = (10 + dictionary.len() + 1).next_multiple_of(DATA_ALIGN) - 10;
    let header_len = u16::try_from(len)
        .map_err(|_| Problem::unsupported("a header longer than 65535 bytes").in_file(path))?;
    write_atomically(path, |w| {
        w.write_all(MAGIC)?;
        w.write_all(&[1, 0])?;
        w.write_all(&header_len.to_le_bytes())?;
        writeln!(w, "{dictionary:<width$}", width = len - 1)?;
        w.write_all(&voxels.little_endian_bytes())
    })?;
    Ok(voxels.lost_placement("npy"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_in_every_spelling() {
        let header =
            Header::parse(b"{\"shape\": (3L, 4L,5), 'fortran_order':True,'descr':'>f8'}\n")
                .expect("legal");
        assert_eq!(header.shape, [3, 4, 5]);
        assert!(header.is_fortran_order);
        assert_eq!(header.stored, Stored::Same(ScalarType::F64));
        assert_eq!(header.endianness, Endianness::Big);
        for wrong in [
            "",
            "{",
            "{'descr': '<f4'}",
            "{'descr': '<f4', 'fortran_order': 1, 'shape': (2,2,2)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (2,-2,2)}",
            "{'descr': '<c8', 'fortran_order': False, 'shape': (2,2,2)}",
            "{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': (2,2,2)}",
            "{'descr': '\u{e9}', 'fortran_order': False, 'shape': (2,2,2)}",
        ] {
            assert!(Header::parse(wrong.as_bytes()).is_err(), "{wrong}");
        }
    }

    #[test]
    fn fortran_order_is_transposed() {
        let points = [3, 40, 70];
        let [nx, ny, nz] = points;
        let components = 2;
        let mut stored = vec![0u32; nx * ny * nz * components];
        let mut expected = stored.clone();
        for (i, (x, y, z, c)) in (0..nx)
            .flat_map(|x| (0..ny).map(move |y| (x, y)))
            .flat_map(|(x, y)| (0..nz).map(move |z| (x, y, z)))
            .flat_map(|(x, y, z)| (0..components).map(move |c| (x, y, z, c)))
            .enumerate()
        {
            stored[((c * nx + x) * ny + y) * nz + z] = i as u32;
            expected[((z * ny + y) * nx + x) * components + c] = i as u32;
        }
        let array = DataArray::from_vec(stored, components).expect("pairs");
        let turned = transpose(&array, points).expect("fits");
        assert_eq!(turned.as_slice::<u32>(), Some(expected.as_slice()));
    }
}
