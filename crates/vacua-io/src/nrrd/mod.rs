//! NRRD and NHDR: raster data of any dimension with a text header, attached or detached.
//!
//! Three axes must be of space. One more may hold components, as the fastest or the slowest axis;
//! a slowest axis of time or of a list is a series, of which the first step is read. Coordinates
//! stay in the space that the file names; nothing is mirrored, and the name becomes the dataset's
//! frame. Detached data may be one file, a
//! list, or a numbered series (see [`crate::files`] on where it may lie).

mod header;
mod write;

use glam::{DAffine3, DMat3, DVec3};
use vacua_volume::{Dataset, Geometry, UniformGrid, WorldFrame};

use crate::decode::Layout;
use crate::error::Problem;
use crate::payload::Payload;
use crate::registry::{Format, ReadOptions};
use crate::source::Source;

use header::{Axis, Header};
pub(crate) use write::WRITER;

/// The NRRD format.
pub(crate) const FORMAT: Format = Format {
    name: "NRRD",
    extensions: &["nrrd", "nhdr"],
    sniff: Some(|bytes| bytes.starts_with(b"NRRD000")),
    read,
};

/// What the axes beside the three of space are.
#[derive(Debug, PartialEq)]
struct Roles {
    /// Position of the first axis of space.
    first_space: usize,
    components: usize,
    /// Whether components are planes one after the other.
    planar: bool,
    /// Steps of a series.
    steps: usize,
}

/// Reads header and, where it costs nothing, data.
///
/// # Errors
/// [`Problem`] naming the field or the place that is wrong or not supported.
fn read(source: &Source, options: &ReadOptions) -> Result<Dataset, Problem> {
    let header = Header::read(source)?;
    let roles = roles(&header)?;
    let space = &header.axes[roles.first_space..roles.first_space + 3];
    let points = [space[0].size, space[1].size, space[2].size];
    let grid = UniformGrid::with_affine(points, placement(&header, space, options)?)?;
    let payload = Payload {
        source: source.clone(),
        place: header.place,
        encoding: header.encoding,
        skip_lines: header.skip_lines,
        skip: header.skip,
        layout: Layout {
            scalar_type: header.scalar_type,
            endianness: header.endianness,
            components: roles.components,
            tuples: points.iter().product(),
        },
        stored_steps: roles.steps,
        planar: roles.planar,
    };
    let surplus = payload.surplus_note();
    let mut dataset = Dataset::new(
        Geometry::Uniform(grid),
        vec![payload.into_field("scalars")?],
    )?;
    if let Some(note) = surplus {
        dataset = dataset.with_note(note);
    }
    if roles.steps > 1 {
        dataset = dataset.with_note(format!("the first of {} steps was read", roles.steps));
    }
    if let Some(space) = &header.space {
        dataset = dataset
            .with_frame(frame_of_space(space))
            .with_note(format!("coordinates are those of the file ({space})"));
    }
    Ok(dataset)
}

/// The spaces that say where the axes point in a body: name, short name, frame.
const SPACES: [(&str, &str, WorldFrame); 3] = [
    ("right-anterior-superior", "RAS", WorldFrame::Ras),
    ("left-anterior-superior", "LAS", WorldFrame::Las),
    ("left-posterior-superior", "LPS", WorldFrame::Lps),
];

/// What the field `space` says. Spaces that are not of a body (`scanner-xyz` …) are no frame.
fn frame_of_space(space: &str) -> WorldFrame {
    let is_named = |(name, short, _): &&(&str, &str, WorldFrame)| {
        space.eq_ignore_ascii_case(name) || space.eq_ignore_ascii_case(short)
    };
    let found = SPACES.iter().find(is_named);
    found.map_or(WorldFrame::Unlabelled, |(.., frame)| *frame)
}

/// What the field `space` must say for a frame.
fn space_name(frame: WorldFrame) -> Option<&'static str> {
    let found = SPACES.iter().find(|(.., known)| *known == frame);
    found.map(|(name, ..)| *name)
}

/// Whether an axis is one of space. Directions decide, then kinds; without either all axes are.
fn is_space(header: &Header, axis: &Axis) -> bool {
    if header.is_oriented {
        return axis.direction.is_some();
    }
    matches!(axis.kind.as_str(), "" | "domain" | "space")
}

/// Finds the axes of space and what the others mean.
fn roles(header: &Header) -> Result<Roles, Problem> {
    let axes = &header.axes;
    let mut roles = Roles {
        first_space: 0,
        components: 1,
        planar: false,
        steps: 1,
    };
    let described = || {
        let sizes: Vec<String> = axes
            .iter()
            .map(|a| format!("{} {}", a.size, a.kind))
            .collect();
        format!("a NRRD with axes {}", sizes.join(" × "))
    };
    let is_series = |axis: &Axis| matches!(axis.kind.as_str(), "time" | "list");
    let of_space: Vec<bool> = axes.iter().map(|axis| is_space(header, axis)).collect();
    match of_space[..] {
        [true, true, true] => {}
        [false, true, true, true] if axes[0].kind != "time" => {
            roles.first_space = 1;
            roles.components = axes[0].size;
        }
        [true, true, true, false] if is_series(&axes[3]) => roles.steps = axes[3].size,
        [true, true, true, false] => {
            roles.components = axes[3].size;
            roles.planar = true;
        }
        [true, true, true, true] if axes[3].size == 1 => {}
        [true, true, true, true] if axes[0].size == 1 => roles.first_space = 1,
        _ => {
            return Err(Problem::unsupported_but(
                described(),
                "three axes must be of space, and one more at most may come first or last; \
                 `kinds` or `space directions` say which (for example `kinds: vector domain \
                 domain domain`)",
            ));
        }
    }
    Ok(roles)
}

/// Where index space lies: directions and origin, or spacings and axis bounds.
fn placement(header: &Header, space: &[Axis], options: &ReadOptions) -> Result<DAffine3, Problem> {
    let mut origin = DVec3::from(options.origin.unwrap_or_default());
    let mut axes = DMat3::IDENTITY;
    let default_spacing = options.spacing.unwrap_or([1.0; 3]);
    for (i, axis) in space.iter().enumerate() {
        if let Some(direction) = axis.direction {
            *axes.col_mut(i) = direction;
            continue;
        }
        // Cells reach from bound to bound, nodes lie on the bounds.
        let intervals = if axis.is_node_centered {
            axis.size.saturating_sub(1).max(1)
        } else {
            axis.size
        };
        let from_bounds = axis
            .min
            .zip(axis.max)
            .map(|(min, max)| (max - min) / intervals as f64);
        let spacing = axis.spacing.or(from_bounds).unwrap_or(default_spacing[i]);
        *axes.col_mut(i) = DVec3::AXES[i] * spacing;
        if let Some(min) = axis.min {
            origin[i] = min
                + if axis.is_node_centered {
                    0.0
                } else {
                    0.5 * spacing
                };
        }
    }
    if let Some(first_sample) = header.space_origin {
        origin = first_sample;
    }
    Ok(DAffine3::from_mat3_translation(axes, origin))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::payload::Place;
    use std::path::Path;
    use vacua_volume::DataArray;

    fn open(fields: &str, data: &[u8]) -> Result<Dataset, Problem> {
        let mut bytes = format!("NRRD0005\n{fields}\n\n").into_bytes();
        bytes.extend_from_slice(data);
        let source = Source::from_bytes(Path::new("test.nrrd"), bytes);
        read(&source, &ReadOptions::default())
    }

    fn values(dataset: &Dataset) -> DataArray {
        dataset.fields()[0].load().expect("whole").clone()
    }

    fn affine(dataset: &Dataset) -> DAffine3 {
        match &**dataset.geometry() {
            Geometry::Uniform(grid) => grid.world_from_index(),
            other => panic!("uniform, not {}", other.kind()),
        }
    }

    const EIGHT: &str = "type: uchar\nencoding: raw\ndimension: 3\nsizes: 2 2 2\n";

    #[test]
    fn vector_axis_first_last_and_time() {
        let data: Vec<u8> = (0..16).collect();
        let base = "type: uchar\nencoding: raw\ndimension: 4\n";
        let first = open(
            &format!("{base}sizes: 2 2 2 2\nkinds: vector domain domain domain"),
            &data,
        )
        .expect("legal");
        assert_eq!(values(&first).as_slice::<u8>(), Some(data.as_slice()));
        let last = open(
            &format!("{base}sizes: 2 2 2 2\nkinds: domain domain domain vector"),
            &data,
        )
        .expect("legal");
        assert_eq!(values(&last).components(), 2);
        assert_eq!(
            values(&last).as_slice::<u8>(),
            Some([0, 8, 1, 9, 2, 10, 3, 11, 4, 12, 5, 13, 6, 14, 7, 15].as_slice())
        );
        let time = open(
            &format!("{base}sizes: 2 2 2 2\nkinds: space space space time"),
            &data,
        )
        .expect("legal");
        assert_eq!(values(&time).as_slice::<u8>(), Some(&data[..8]));
        assert!(time.notes()[0].contains("first of 2"));
        let ended = open(
            &format!("{base}sizes: 2 2 2 2\nkinds: space space space time\nbyte skip: -1"),
            &[b"skipped".as_slice(), &data].concat(),
        )
        .expect("legal");
        assert_eq!(values(&ended).as_slice::<u8>(), Some(&data[..8]));
        let longer = [data.as_slice(), &[0; 3]].concat();
        let longer = open(
            &format!("{base}sizes: 2 2 2 2\nkinds: space space space time"),
            &longer,
        )
        .expect("legal");
        assert!(longer.notes()[0].contains("3 bytes"));
        let unclear = open(&format!("{base}sizes: 2 2 2 2"), &data).expect_err("ambiguous");
        assert!(unclear.to_string().contains("kinds"), "{unclear}");
    }

    #[test]
    fn bounds_and_centers_place_the_samples() {
        let cell = open(
            &format!("{EIGHT}axis mins: 0 10 0\naxis maxs: 4 20 1\ncenters: cell cell node"),
            &[0; 8],
        )
        .expect("legal");
        assert_eq!(affine(&cell).translation, DVec3::new(1.0, 12.5, 0.0));
        assert_eq!(
            affine(&cell).matrix3,
            DMat3::from_diagonal(DVec3::new(2.0, 5.0, 1.0))
        );
        let spacings = open(&format!("{EIGHT}spacings: 2 NaN 0.5"), &[0; 8]).expect("legal");
        assert_eq!(
            affine(&spacings).matrix3,
            DMat3::from_diagonal(DVec3::new(2.0, 1.0, 0.5))
        );
    }

    #[test]
    fn text_hex_and_skips() {
        let fields = EIGHT.replace("raw", "ascii");
        let text = open(&fields, b"1 2 3 4\n5 6 7 8\n").expect("legal");
        assert_eq!(
            values(&text).as_slice::<u8>(),
            Some([1, 2, 3, 4, 5, 6, 7, 8].as_slice())
        );
        let fields = EIGHT.replace("raw", "hex");
        let hex = open(&fields, b"01020304\n05060708\n").expect("legal");
        assert_eq!(
            values(&hex).as_slice::<u8>(),
            Some([1, 2, 3, 4, 5, 6, 7, 8].as_slice())
        );
        let data = b"line\nxx12345678";
        let skipped = open(&format!("{EIGHT}line skip: 1\nbyte skip: 2"), data).expect("legal");
        assert_eq!(values(&skipped).bytes(), b"12345678");
        let ended = open(&format!("{EIGHT}byte skip: -1"), data).expect("legal");
        assert_eq!(values(&ended).bytes(), b"12345678");
    }

    #[test]
    fn lying_sizes_are_refused_before_reading() {
        let short = open(EIGHT.trim_end(), &[0; 7]).expect_err("one byte short");
        assert!(matches!(short, Problem::Truncated { .. }), "{short}");
        let fields =
            "type: double\nendian: little\nencoding: gzip\ndimension: 3\nsizes: 900 900 900";
        let bomb = open(fields, &[0x1f; 4000]).expect_err("4000 bytes hold no 5.8 GB");
        assert!(bomb.to_string().contains("expand"), "{bomb}");
        let huge = fields.replace("900", "4000000000");
        assert!(matches!(open(&huge, &[0; 10]), Err(Problem::Grid(_))));
    }

    #[test]
    fn missing_data_files_are_named() {
        let error = open(&format!("{EIGHT}data file: not-there.raw"), &[]).expect_err("missing");
        assert!(error.to_string().contains("not-there.raw"), "{error}");
        let header = Header::read(&Source::from_bytes(
            Path::new("x.nhdr"),
            format!("NRRD0004\n{EIGHT}data file: s%d 0 1 1\n").into_bytes(),
        ))
        .expect("legal");
        assert!(matches!(header.place, Place::Files(_)));
    }
}
