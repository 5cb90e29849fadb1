//! Raw voxels without a header: sizes come from the command line or from the file's name.
//!
//! The Open SciVis data sets name their files `name_XxYxZ_type.raw`, for example
//! `heptane_302x302x302_uint8.raw`. What the command line says wins over the name. Numbers in the
//! machine's byte order are mapped, others are swapped when first asked for.

use std::io::Write;
use std::path::Path;

use glam::DVec3;
use vacua_volume::{Dataset, Geometry, ScalarType, UniformGrid};

use crate::atomic::write_atomically;
use crate::decode::{Endianness, Layout};
use crate::error::{IoError, Problem};
use crate::payload::{Encoding, Payload, Place, Skip};
use crate::registry::{Format, ReadOptions};
use crate::save::{Saved, Voxels, WriteFormat};
use crate::source::Source;

/// What raw data needs, for errors.
pub(crate) const NEEDS: &str =
    "raw data needs --dims XxYxZ --type T or sizes in its name (name_XxYxZ_type.raw)";

/// The raw format.
pub(crate) const FORMAT: Format = Format {
    name: "raw",
    extensions: &["raw"],
    sniff: None,
    read,
};

/// Writing raw files.
pub(crate) const WRITER: WriteFormat = WriteFormat {
    name: "raw",
    extensions: &["raw"],
    write,
};

/// Sizes in a name such as `heptane_302x302x302_uint8.raw`: the last `XxYxZ` between underscores,
/// and the number type right after it.
fn sizes_in_name(path: &Path) -> (Option<[usize; 3]>, Option<ScalarType>) {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let mut parts = stem.rsplit('_');
    let mut after = None;
    for part in parts.by_ref() {
        let sizes: Vec<Option<usize>> = part.split('x').map(|n| n.parse().ok()).collect();
        if let [Some(x), Some(y), Some(z)] = sizes[..] {
            let scalar_type = after.and_then(|name: &str| name.parse().ok());
            return (Some([x, y, z]), scalar_type);
        }
        after = Some(part);
    }
    (None, None)
}

/// Reads a raw file.
///
/// # Errors
/// [`Problem::Unsupported`] without sizes, [`Problem::Malformed`] if they do not fit the file.
fn read(source: &Source, options: &ReadOptions) -> Result<Dataset, Problem> {
    let (named_dimensions, named_type) = sizes_in_name(source.path());
    let dimensions = options.dimensions.or(named_dimensions);
    let scalar_type = options.scalar_type.or(named_type);
    let (dimensions, scalar_type) = match (dimensions, scalar_type) {
        (Some(dimensions), Some(scalar_type)) => (dimensions, scalar_type),
        (None, _) => return Err(Problem::unsupported_but("raw data of unknown size", NEEDS)),
        (_, None) => return Err(Problem::unsupported_but("raw data of unknown type", NEEDS)),
    };
    let components = options.components.unwrap_or(1);
    if components == 0 {
        return Err(Problem::malformed("components", "at least 1", "0"));
    }
    let origin = DVec3::from(options.origin.unwrap_or_default());
    let spacing = DVec3::from(options.spacing.unwrap_or([1.0; 3]));
    let grid = UniformGrid::new(dimensions, origin, spacing)?;
    let layout = Layout {
        scalar_type,
        endianness: Endianness::big_if(options.big_endian.unwrap_or(false)),
        components,
        tuples: dimensions.iter().product(),
    };

    let header_bytes = options.header_bytes.unwrap_or(0);
    let data_bytes = layout.len_bytes()?;
    let needed = data_bytes.saturating_add(header_bytes);
    let [x, y, z] = dimensions;
    let extra = source.len().checked_sub(needed);
    let extra = match extra {
        Some(extra) if extra == 0 || options.header_bytes.is_some() => extra,
        _ => {
            let surplus = match extra {
                Some(extra) => format!(
                    ", {extra} bytes too many; if they are a header, say --header-bytes {extra}"
                ),
                None => String::new(),
            };
            return Err(Problem::malformed(
                "size of the file",
                format!(
                    "{needed} bytes for {x} × {y} × {z} × {components} {scalar_type}{}",
                    if header_bytes > 0 {
                        format!(" after a header of {header_bytes}")
                    } else {
                        String::new()
                    }
                ),
                format!("{} bytes{surplus}", source.len()),
            ));
        }
    };
    let payload = Payload {
        source: source.clone(),
        place: Place::Here(header_bytes),
        encoding: Encoding::Raw,
        skip_lines: 0,
        skip: Skip::Bytes(0),
        layout,
        stored_steps: 1,
        planar: false,
    };
    let dataset = Dataset::new(
        Geometry::Uniform(grid),
        vec![payload.into_field("scalars")?],
    )?;
    Ok(if extra > 0 {
        dataset.with_note(format!("{extra} bytes after the data were not read"))
    } else {
        dataset
    })
}

/// Writes voxels in little-endian order; the name must say what they are, or nobody can read them.
fn write(path: &Path, voxels: &Voxels) -> Result<Saved, IoError> {
    let [x, y, z] = voxels.grid.points();
    let scalar_type = voxels.values.scalar_type();
    if voxels.values.components() != 1 {
        return Err(Problem::unsupported_but(
            format!(
                "a raw file with {} components a voxel",
                voxels.values.components()
            ),
            "choose one component, or a format that can say so (.npy, .nrrd, .mha)",
        )
        .in_file(path));
    }
    if sizes_in_name(path) != (Some([x, y, z]), Some(scalar_type)) {
        return Err(Problem::malformed(
            "name of the raw file",
            format!(
                "its sizes, as in name_{x}x{y}x{z}_{}.raw",
                long_name(scalar_type)
            ),
            "none or others",
        )
        .in_file(path));
    }
    write_atomically(path, |w| w.write_all(&voxels.little_endian_bytes()))?;
    Ok(voxels.lost_placement("raw"))
}

/// The spelling of the Open SciVis data sets.
fn long_name(scalar_type: ScalarType) -> String {
    let name = scalar_type.name();
    let kind = match &name[..1] {
        "u" => "uint",
        "i" => "int",
        _ => "float",
    };
    format!("{kind}{}", &name[1..])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_come_from_the_name() {
        let sizes = |name: &str| sizes_in_name(Path::new(name));
        assert_eq!(
            sizes("/d/heptane_302x302x302_uint8.raw"),
            (Some([302; 3]), Some(ScalarType::U8))
        );
        assert_eq!(
            sizes("magnetic_reconnection_512x256x128_float32.raw"),
            (Some([512, 256, 128]), Some(ScalarType::F32))
        );
        assert_eq!(sizes("a_4x4x4.raw"), (Some([4; 3]), None));
        assert_eq!(sizes("a_4x4_uint8.raw"), (None, None));
        assert_eq!(sizes("box.raw"), (None, None));
        for scalar_type in ScalarType::ALL {
            assert_eq!(long_name(scalar_type).parse(), Ok(scalar_type));
        }
    }
}
