//! NIfTI-1 and NIfTI-2: `.nii`, `.nii.gz`, and pairs of `.hdr` and `.img`.
//!
//! Positions come from `sform`, else `qform`, else the voxel sizes alone with the first voxel at
//! the origin (method 1 of the standard). Coordinates stay in the file's space and unit; by `sform`
//! and `qform` they are RAS (x to the right, y to the front, z up), by neither they mean nothing. Values
//! are scaled by `scl_slope` and `scl_inter` unless that changes nothing: then they keep their
//! type. The first volume of a series is read. Source: `nifti1.h` and `nifti2.h` of the NIfTI
//! data format working group.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DAffine3, DMat3, DQuat, DVec3};
use rayon::prelude::*;
use vacua_volume::{
    Association, DataArray, Dataset, Field, Geometry, LoadError, Scalar, ScalarType, UniformGrid,
    WorldFrame, dispatch_scalar,
};

use crate::decode::{Endianness, Layout, shown};
use crate::error::Problem;
use crate::files::FileNames;
use crate::payload::{Encoding, Payload, Place, Skip, expand_head, is_gzip};
use crate::registry::{Format, ReadOptions};
use crate::source::Source;

/// The NIfTI format.
pub(crate) const FORMAT: Format = Format {
    name: "NIfTI",
    extensions: &["nii", "nii.gz", "hdr", "hdr.gz", "img", "img.gz"],
    sniff: Some(|bytes| version(bytes).is_some()),
    read,
};

const HEADER_1_BYTES: usize = 348;
const HEADER_2_BYTES: usize = 540;

/// Which of the two headers, in which byte order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Version {
    One,
    Two,
}

/// The header's version and byte order, if it is one.
fn version(bytes: &[u8]) -> Option<(Version, Endianness)> {
    let size: [u8; 4] = bytes.get(..4)?.try_into().ok()?;
    let (size, endianness) = match (i32::from_le_bytes(size), i32::from_be_bytes(size)) {
        (size @ (348 | 540), _) => (size, Endianness::Little),
        (_, size @ (348 | 540)) => (size, Endianness::Big),
        _ => return None,
    };
    if size == 348 {
        let magic = bytes.get(344..348)?;
        return matches!(magic, b"n+1\0" | b"ni1\0").then_some((Version::One, endianness));
    }
    let magic = bytes.get(4..8)?;
    matches!(magic, b"n+2\0" | b"ni2\0").then_some((Version::Two, endianness))
}

/// Everything a header says that vacua uses.
#[derive(Clone, Debug, PartialEq)]
struct Header {
    endianness: Endianness,
    is_pair: bool,
    dim: [i64; 8],
    datatype: i16,
    pixdim: [f64; 8],
    data_at: usize,
    slope: f64,
    inter: f64,
    qform_code: i32,
    sform_code: i32,
    quatern: DVec3,
    qoffset: DVec3,
    srow: [[f64; 4]; 3],
}

/// Numbers at fixed places; the caller has checked the length.
struct Numbers<'a>(&'a [u8], Endianness);

impl Numbers<'_> {
    fn bytes<const N: usize>(&self, at: usize) -> [u8; N] {
        let mut bytes = [0; N];
        bytes.copy_from_slice(&self.0[at..at + N]);
        if self.1 == Endianness::Big {
            bytes.reverse();
        }
        bytes
    }

    fn i16(&self, at: usize) -> i16 {
        i16::from_le_bytes(self.bytes(at))
    }

    fn i32(&self, at: usize) -> i32 {
        i32::from_le_bytes(self.bytes(at))
    }

    fn i64(&self, at: usize) -> i64 {
        i64::from_le_bytes(self.bytes(at))
    }

    fn f32(&self, at: usize) -> f64 {
        f64::from(f32::from_le_bytes(self.bytes(at)))
    }

    fn f64(&self, at: usize) -> f64 {
        f64::from_le_bytes(self.bytes(at))
    }
}

impl Header {
    /// Reads a header from the first bytes of a file, decompressed.
    fn parse(bytes: &[u8]) -> Result<Self, Problem> {
        let (version, endianness) = version(bytes).ok_or_else(|| {
            let analyze = matches!(bytes.get(..4), Some([0x5c, 1, 0, 0] | [0, 0, 1, 0x5c]));
            if analyze && bytes.len() >= HEADER_1_BYTES {
                Problem::unsupported_but("an ANALYZE 7.5 header", "convert it to NIfTI")
            } else {
                let head = shown(&bytes[..bytes.len().min(8)]);
                Problem::malformed("NIfTI header", "size 348 or 540 and its magic", head)
            }
        })?;
        let len = match version {
            Version::One => HEADER_1_BYTES,
            Version::Two => HEADER_2_BYTES,
        };
        let header = bytes.get(..len).ok_or_else(|| Problem::Truncated {
            what: "the NIfTI header".to_owned(),
            from: 0,
            to: len as u64,
            len: bytes.len() as u64,
        })?;
        let n = Numbers(header, endianness);
        let offset = match version {
            Version::One => n.f32(108),
            Version::Two => n.i64(168) as f64,
        };
        let is_pair = match version {
            Version::One => header[345] == b'i',
            Version::Two => header[5] == b'i',
        };
        // In a file of its own the data starts where it likes; in one file, after the header and
        // four bytes that announce extensions.
        let least = if is_pair { 0.0 } else { (len + 4) as f64 };
        if offset.is_nan() || offset.fract() != 0.0 || offset > (1u64 << 53) as f64 {
            return Err(Problem::malformed(
                "vox_offset",
                "a number of bytes",
                offset.to_string(),
            ));
        }
        let data_at = offset.max(least) as usize;
        let list = |from: usize, step: usize, get: &dyn Fn(usize) -> f64| -> [f64; 8] {
            std::array::from_fn(|i| get(from + i * step))
        };
        Ok(match version {
            Version::One => {
                let f = |at| n.f32(at);
                Self {
                    endianness,
                    is_pair,
                    dim: std::array::from_fn(|i| i64::from(n.i16(40 + 2 * i))),
                    datatype: n.i16(70),
                    pixdim: list(76, 4, &f),
                    data_at,
                    slope: f(112),
                    inter: f(116),
                    qform_code: i32::from(n.i16(252)),
                    sform_code: i32::from(n.i16(254)),
                    quatern: DVec3::new(f(256), f(260), f(264)),
                    qoffset: DVec3::new(f(268), f(272), f(276)),
                    srow: std::array::from_fn(|row| {
                        std::array::from_fn(|column| f(280 + 16 * row + 4 * column))
                    }),
                }
            }
            Version::Two => {
                let f = |at| n.f64(at);
                Self {
                    endianness,
                    is_pair,
                    dim: std::array::from_fn(|i| n.i64(16 + 8 * i)),
                    datatype: n.i16(12),
                    pixdim: list(104, 8, &f),
                    data_at,
                    slope: f(176),
                    inter: f(184),
                    qform_code: n.i32(344),
                    sform_code: n.i32(348),
                    quatern: DVec3::new(f(352), f(360), f(368)),
                    qoffset: DVec3::new(f(376), f(384), f(392)),
                    srow: std::array::from_fn(|row| {
                        std::array::from_fn(|column| f(400 + 32 * row + 8 * column))
                    }),
                }
            }
        })
    }

    /// Points a side, steps of a series, and values a voxel in the fifth dimension.
    fn shape(&self) -> Result<([usize; 3], usize, usize), Problem> {
        let wrong = |found: String| {
            Problem::malformed("NIfTI dim", "3 to 5 dimensions, all positive", found)
        };
        let dimension = usize::try_from(self.dim[0])
            .ok()
            .filter(|n| (1..=7).contains(n))
            .ok_or_else(|| wrong(format!("{} dimensions", self.dim[0])))?;
        let mut sizes = [1usize; 7];
        for (i, size) in sizes.iter_mut().enumerate().take(dimension) {
            *size = usize::try_from(self.dim[i + 1])
                .ok()
                .filter(|&n| n > 0)
                .ok_or_else(|| wrong(format!("dim[{}] = {}", i + 1, self.dim[i + 1])))?;
        }
        let [x, y, z, steps, values, more @ ..] = sizes;
        if more != [1, 1] || (steps > 1 && values > 1) {
            return Err(Problem::unsupported_but(
                format!("a NIfTI image of {sizes:?}"),
                "three dimensions of space, then time or several values a voxel",
            ));
        }
        Ok(([x, y, z], steps, values))
    }

    /// Number type and components of one stored voxel.
    fn voxel(&self) -> Result<(ScalarType, usize), Problem> {
        let name = match self.datatype {
            2 => return Ok((ScalarType::U8, 1)),
            4 => return Ok((ScalarType::I16, 1)),
            8 => return Ok((ScalarType::I32, 1)),
            16 => return Ok((ScalarType::F32, 1)),
            64 => return Ok((ScalarType::F64, 1)),
            128 => return Ok((ScalarType::U8, 3)),
            256 => return Ok((ScalarType::I8, 1)),
            512 => return Ok((ScalarType::U16, 1)),
            768 => return Ok((ScalarType::U32, 1)),
            1024 => return Ok((ScalarType::I64, 1)),
            1280 => return Ok((ScalarType::U64, 1)),
            2304 => return Ok((ScalarType::U8, 4)),
            1 => "BINARY",
            32 => "COMPLEX64",
            1536 => "FLOAT128",
            1792 => "COMPLEX128",
            2048 => "COMPLEX256",
            _ => "of no known kind",
        };
        Err(Problem::unsupported(format!(
            "NIfTI datatype {} ({name})",
            self.datatype
        )))
    }

    /// Index space to the file's space.
    fn world_from_index(&self) -> DAffine3 {
        if self.sform_code > 0 {
            let column = |c: usize| DVec3::new(self.srow[0][c], self.srow[1][c], self.srow[2][c]);
            let axes = DMat3::from_cols(column(0), column(1), column(2));
            return DAffine3::from_mat3_translation(axes, column(3));
        }
        let sizes = DVec3::new(self.pixdim[1], self.pixdim[2], self.pixdim[3]).abs();
        if self.qform_code > 0 {
            let b = self.quatern;
            // The real part is what is missing to length 1; rounding may leave nothing.
            let rest = 1.0 - b.length_squared();
            let rotation = if rest < 1e-7 {
                DQuat::from_xyzw(b.x, b.y, b.z, 0.0).normalize()
            } else {
                DQuat::from_xyzw(b.x, b.y, b.z, rest.sqrt())
            };
            let flip = if self.pixdim[0] < 0.0 { -1.0 } else { 1.0 };
            let scale = DMat3::from_diagonal(DVec3::new(sizes.x, sizes.y, flip * sizes.z));
            let axes = DMat3::from_quat(rotation) * scale;
            return DAffine3::from_mat3_translation(axes, self.qoffset);
        }
        DAffine3::from_mat3(DMat3::from_diagonal(sizes))
    }

    /// What the file's space means.
    fn frame(&self) -> WorldFrame {
        if self.sform_code > 0 || self.qform_code > 0 {
            WorldFrame::Ras
        } else {
            WorldFrame::Unlabelled
        }
    }

    /// The scaling of values, if it changes any.
    fn scaling(&self) -> Result<Option<(f64, f64)>, Problem> {
        let (slope, inter) = (self.slope, self.inter);
        if slope == 0.0 || !slope.is_finite() || (slope == 1.0 && inter == 0.0) {
            return Ok(None);
        }
        if !inter.is_finite() {
            return Err(Problem::malformed(
                "scl_inter",
                "a finite number",
                inter.to_string(),
            ));
        }
        Ok(Some((slope, inter)))
    }
}

/// Reads header and, where it costs nothing, data.
///
/// # Errors
/// [`Problem`] naming the part of the header that is wrong or not supported.
fn read(source: &Source, _options: &ReadOptions) -> Result<Dataset, Problem> {
    if let Some(header_path) = partner(source.path(), "img", "hdr") {
        let header = Source::open(&header_path).map_err(|e| Problem::Part(Box::new(e)))?;
        return read_from(&header);
    }
    read_from(source)
}

fn read_from(source: &Source) -> Result<Dataset, Problem> {
    let is_packed = is_gzip(source.bytes());
    let header = if is_packed {
        Header::parse(&expand_head(source.bytes(), HEADER_2_BYTES)?)?
    } else {
        Header::parse(&source.bytes()[..source.len().min(HEADER_2_BYTES)])?
    };
    let (points, steps, values) = header.shape()?;
    let (scalar_type, channels) = header.voxel()?;
    if channels > 1 && values > 1 {
        return Err(Problem::unsupported("several colours a voxel"));
    }
    let grid = UniformGrid::with_affine(points, header.world_from_index())?;
    let (place, is_packed) = if header.is_pair {
        let path = partner(source.path(), "hdr", "img").ok_or_else(|| {
            Problem::malformed("NIfTI header", "a data file `.img` beside it", "none")
        })?;
        let is_packed = path.extension().is_some_and(|e| e == "gz");
        (Place::Files(FileNames::List(vec![path])), is_packed)
    } else {
        (Place::Here(0), is_packed)
    };
    let payload = Payload {
        source: source.clone(),
        place,
        encoding: if is_packed {
            Encoding::Deflate
        } else {
            Encoding::Raw
        },
        skip_lines: 0,
        skip: Skip::Bytes(header.data_at),
        layout: Layout {
            scalar_type,
            endianness: header.endianness,
            components: channels * values,
            tuples: points.iter().product(),
        },
        stored_steps: steps,
        planar: values > 1,
    };
    let surplus = payload.surplus_note();
    let scaling = header.scaling()?.filter(|_| channels == 1);
    let field = match scaling {
        None => payload.into_field("scalars")?,
        Some((slope, inter)) => scaled_field(payload, slope, inter)?,
    };
    let mut dataset =
        Dataset::new(Geometry::Uniform(grid), vec![field])?.with_frame(header.frame());
    if let Some(note) = surplus {
        dataset = dataset.with_note(note);
    }
    if steps > 1 {
        dataset = dataset.with_note(format!("the first of {steps} steps was read"));
    }
    if let Some((slope, inter)) = scaling {
        dataset = dataset.with_note(format!("values are stored × {slope} + {inter}"));
    }
    Ok(dataset)
}

/// The other file of a pair: for `brain.img.gz` and `img` to `hdr`, the first of `brain.hdr` and
/// `brain.hdr.gz` that is there.
fn partner(path: &Path, from: &str, to: &str) -> Option<PathBuf> {
    let name = path.file_name()?.to_str()?;
    let lower = name.to_ascii_lowercase();
    let stem_len = [format!(".{from}"), format!(".{from}.gz")]
        .iter()
        .find_map(|ending| Some(lower.strip_suffix(ending.as_str())?.len()))?;
    let stem = name.get(..stem_len)?;
    [to.to_owned(), format!("{to}.gz"), to.to_uppercase()]
        .iter()
        .map(|extension| path.with_file_name(format!("{stem}.{extension}")))
        .find(|candidate| candidate.is_file())
}

/// A field of `stored × slope + inter`: f32 where that holds all digits of the stored type.
fn scaled_field(payload: Payload, slope: f64, inter: f64) -> Result<Field, Problem> {
    payload.check()?;
    let Layout {
        scalar_type,
        components,
        tuples,
        ..
    } = payload.layout;
    let result_type = match scalar_type {
        ScalarType::U32 | ScalarType::I32 | ScalarType::U64 | ScalarType::I64 | ScalarType::F64 => {
            ScalarType::F64
        }
        _ => ScalarType::F32,
    };
    Ok(Field::lazy(
        "scalars",
        Association::Point,
        result_type,
        components,
        tuples,
        move || {
            let stored = payload.load()?;
            let scaled = if result_type == ScalarType::F64 {
                scale::<f64>(&stored, slope, inter)
            } else {
                scale::<f32>(&stored, slope, inter)
            };
            scaled.map_err(|p| Arc::new(p.in_file(payload.source.path())) as LoadError)
        },
    ))
}

/// Computes in f64 and rounds once.
fn scale<R: Scalar>(stored: &DataArray, slope: f64, inter: f64) -> Result<DataArray, Problem> {
    let scaled: Vec<R> = dispatch_scalar!(stored.scalar_type(), T => {
        bytemuck::cast_slice::<u8, T>(stored.bytes())
            .par_iter()
            .with_min_len(1 << 16)
            .map(|v| R::from_f64(v.to_f64() * slope + inter))
            .collect()
    });
    Ok(DataArray::from_vec(scaled, stored.components())?)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A header with little in it, to be changed by a test.
    fn bytes() -> Vec<u8> {
        let mut b = vec![0u8; 352 + 8];
        b[..4].copy_from_slice(&348i32.to_le_bytes());
        for (i, n) in [3i16, 2, 2, 2].into_iter().enumerate() {
            b[40 + 2 * i..42 + 2 * i].copy_from_slice(&n.to_le_bytes());
        }
        b[70..72].copy_from_slice(&2i16.to_le_bytes());
        for i in 0..4 {
            b[76 + 4 * i..80 + 4 * i].copy_from_slice(&1f32.to_le_bytes());
        }
        b[344..348].copy_from_slice(b"n+1\0");
        b[352..].copy_from_slice(&[1, 2, 3, 4, 5, 6, 7, 8]);
        b
    }

    fn open(bytes: Vec<u8>) -> Result<Dataset, Problem> {
        read(
            &Source::from_bytes(Path::new("t.nii"), bytes),
            &ReadOptions::default(),
        )
    }

    #[test]
    fn the_smallest_file() {
        let dataset = open(bytes()).expect("legal");
        let values = dataset.fields()[0].load().expect("whole");
        assert_eq!(
            values.as_slice::<u8>(),
            Some([1, 2, 3, 4, 5, 6, 7, 8].as_slice())
        );
    }

    #[test]
    fn scaling_only_where_it_changes_something() {
        let mut b = bytes();
        b[112..116].copy_from_slice(&0.5f32.to_le_bytes());
        b[116..120].copy_from_slice(&10f32.to_le_bytes());
        let dataset = open(b.clone()).expect("legal");
        let field = &dataset.fields()[0];
        assert_eq!(field.scalar_type(), ScalarType::F32);
        assert_eq!(field.load().expect("whole").get_f64(3, 0), 12.0);
        b[116..120].copy_from_slice(&f32::NAN.to_le_bytes());
        assert!(open(b.clone()).is_err());
        b[112..116].copy_from_slice(&0f32.to_le_bytes());
        assert_eq!(
            open(b).expect("legal").fields()[0].scalar_type(),
            ScalarType::U8
        );
    }

    #[test]
    fn refused_by_name() {
        for (datatype, name) in [(32i16, "COMPLEX64"), (1536, "FLOAT128"), (1, "BINARY")] {
            let mut b = bytes();
            b[70..72].copy_from_slice(&datatype.to_le_bytes());
            let error = open(b).expect_err("not numbers").to_string();
            assert!(error.contains(name), "{error}");
        }
        let mut b = bytes();
        b[344] = 0;
        assert!(
            open(b)
                .expect_err("no magic")
                .to_string()
                .contains("ANALYZE")
        );
    }
}
