//! MetaImage (`.mha`, `.mhd` with data elsewhere), the format of ITK's tools.
//!
//! The header is `Key = value` lines, the last of them `ElementDataFile`. `Offset` is the centre of
//! the first voxel, the rows of `TransformMatrix` are the directions of the index axes.
//! Coordinates are LPS (x to the left, y to the back, z up) as ITK takes them, whatever the key
//! `AnatomicalOrientation` says, which ITK does not read either; labelled ones are written so.
//! Four-dimensional images are series, of which the first step is read.
//! Source: itk.org/Wiki/MetaIO/Documentation, and MetaIO's `metaImage.cxx` where that is silent
//! (`MET_LONG` has 4 bytes; a negative `HeaderSize` counts from the end).

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use glam::{DAffine3, DMat3, DVec3};
use vacua_volume::{Dataset, Geometry, ScalarType, UniformGrid, WorldFrame};

use crate::atomic::write_atomically;
use crate::decode::{Endianness, Layout, shown};
use crate::error::{IoError, Problem};
use crate::files::{FileNames, folder_of, resolve};
use crate::payload::{Encoding, Payload, Place, Skip};
use crate::registry::{Format, ReadOptions};
use crate::save::{DATA_ALIGN, Saved, Voxels, WriteFormat};
use crate::source::Source;

/// The MetaImage format.
pub(crate) const FORMAT: Format = Format {
    name: "MetaImage",
    extensions: &["mha", "mhd"],
    sniff: Some(sniff),
    read,
};

/// Writing MetaImage files.
pub(crate) const WRITER: WriteFormat = WriteFormat {
    name: "MetaImage",
    extensions: &["mha"],
    write,
};

fn sniff(bytes: &[u8]) -> bool {
    let rest = bytes.strip_prefix(b"ObjectType").unwrap_or_default();
    let line = rest.split(|&b| b == b'\n').next().unwrap_or_default();
    line.trim_ascii_start()
        .strip_prefix(b"=")
        .is_some_and(|v| v.trim_ascii() == b"Image")
}

/// The `Key = value` lines.
struct Header<'a> {
    lines: Vec<(&'a str, &'a str)>,
    /// The lines after `ElementDataFile = LIST`.
    listed: Vec<&'a str>,
    /// The byte after the header.
    data_at: usize,
}

impl<'a> Header<'a> {
    fn parse(bytes: &'a [u8]) -> Result<Self, Problem> {
        let mut header = Self {
            lines: Vec::new(),
            listed: Vec::new(),
            data_at: 0,
        };
        let mut lists = false;
        for (number, line) in bytes.split_inclusive(|&b| b == b'\n').enumerate() {
            header.data_at += line.len();
            let text = std::str::from_utf8(line).map_err(|_| {
                Problem::malformed(format!("line {}", number + 1), "text", shown(line))
            })?;
            let text = text.trim();
            if text.is_empty() {
                continue;
            }
            if lists {
                header.listed.push(text);
                continue;
            }
            let (key, value) = text.split_once('=').ok_or_else(|| {
                Problem::malformed(
                    format!("line {}", number + 1),
                    "`Key = value`",
                    shown(text.as_bytes()),
                )
            })?;
            let (key, value) = (key.trim(), value.trim());
            header.lines.push((key, value));
            if key == "ElementDataFile" {
                lists = value.split_whitespace().next() == Some("LIST");
                if !lists {
                    return Ok(header);
                }
            }
        }
        if lists {
            return Ok(header);
        }
        Err(Problem::malformed(
            "MetaImage header",
            "the key ElementDataFile",
            "the end",
        ))
    }

    /// The value of the first of several names for the same thing.
    fn get(&self, keys: &[&str]) -> Option<&'a str> {
        keys.iter()
            .find_map(|key| self.lines.iter().find(|(k, _)| k == key))
            .map(|(_, value)| *value)
    }

    fn need(&self, key: &str) -> Result<&'a str, Problem> {
        self.get(&[key])
            .ok_or_else(|| Problem::malformed("MetaImage header", format!("the key {key}"), "none"))
    }

    fn flag(&self, keys: &[&str], default: bool) -> Result<bool, Problem> {
        match self.get(keys) {
            None => Ok(default),
            Some(text) => match text.chars().next() {
                Some('T' | 't' | '1' | 'Y' | 'y') => Ok(true),
                Some('F' | 'f' | '0' | 'N' | 'n') => Ok(false),
                _ => Err(wrong(keys[0], "True or False", text)),
            },
        }
    }

    /// Exactly `count` numbers, if the key is there.
    fn numbers(&self, keys: &[&str], count: usize) -> Result<Option<Vec<f64>>, Problem> {
        let Some(text) = self.get(keys) else {
            return Ok(None);
        };
        let numbers: Option<Vec<f64>> = text.split_whitespace().map(|n| n.parse().ok()).collect();
        numbers
            .filter(|numbers| numbers.len() == count)
            .map(Some)
            .ok_or_else(|| wrong(keys[0], format!("{count} numbers"), text))
    }
}

fn wrong(key: &str, expected: impl Into<String>, found: &str) -> Problem {
    Problem::malformed(
        format!("MetaImage key {key}"),
        expected,
        shown(found.as_bytes()),
    )
}

fn parse_type(text: &str) -> Result<ScalarType, Problem> {
    Ok(match text.strip_suffix("_ARRAY").unwrap_or(text) {
        "MET_CHAR" | "MET_ASCII_CHAR" => ScalarType::I8,
        "MET_UCHAR" => ScalarType::U8,
        "MET_SHORT" => ScalarType::I16,
        "MET_USHORT" => ScalarType::U16,
        "MET_INT" | "MET_LONG" => ScalarType::I32,
        "MET_UINT" | "MET_ULONG" => ScalarType::U32,
        "MET_LONG_LONG" => ScalarType::I64,
        "MET_ULONG_LONG" => ScalarType::U64,
        "MET_FLOAT" => ScalarType::F32,
        "MET_DOUBLE" => ScalarType::F64,
        _ => {
            return Err(Problem::unsupported(format!(
                "MetaImage element type {}",
                shown(text.as_bytes())
            )));
        }
    })
}

/// Reads header and, where it costs nothing, data.
///
/// # Errors
/// [`Problem`] naming the key or the place that is wrong or not supported.
fn read(source: &Source, _options: &ReadOptions) -> Result<Dataset, Problem> {
    let header = Header::parse(source.bytes())?;
    if let Some(kind) = header.get(&["ObjectType"]).filter(|kind| *kind != "Image") {
        return Err(Problem::unsupported(format!(
            "a MetaIO object of type {kind}"
        )));
    }
    let text = header.need("NDims")?;
    let dimension = match text.parse::<usize>() {
        Ok(n @ 3..=4) => n,
        Ok(n) => {
            return Err(Problem::unsupported_but(
                format!("a MetaImage of {n} dimensions"),
                "it must have 3, or 4 with time as the last; slices can be listed as \
                 `ElementDataFile = LIST` with NDims = 3",
            ));
        }
        Err(_) => return Err(wrong("NDims", "a whole number", text)),
    };
    let text = header.need("DimSize")?;
    let sizes: Vec<usize> = text
        .split_whitespace()
        .map(|n| n.parse().ok().filter(|&n: &usize| n > 0))
        .collect::<Option<_>>()
        .filter(|sizes: &Vec<usize>| sizes.len() == dimension)
        .ok_or_else(|| {
            wrong(
                "DimSize",
                format!("{dimension} positive whole numbers"),
                text,
            )
        })?;
    let points = [sizes[0], sizes[1], sizes[2]];
    let steps = sizes.get(3).copied().unwrap_or(1);
    let grid = UniformGrid::with_affine(points, placement(&header, dimension)?)?;

    let components = match header.get(&["ElementNumberOfChannels"]) {
        None => 1,
        Some(text) => text
            .parse()
            .ok()
            .filter(|&n: &usize| n > 0)
            .ok_or_else(|| wrong("ElementNumberOfChannels", "at least 1", text))?,
    };
    let is_binary = header.flag(&["BinaryData"], true)?;
    let is_compressed = header.flag(&["CompressedData"], false)?;
    let is_big = header.flag(&["BinaryDataByteOrderMSB", "ElementByteOrderMSB"], false)?;
    let skip = match header.get(&["HeaderSize"]) {
        None => Skip::Bytes(0),
        Some("-1") => Skip::ToTheEnd,
        Some(text) => Skip::Bytes(
            text.parse()
                .map_err(|_| wrong("HeaderSize", "-1, or a number of bytes", text))?,
        ),
    };
    let encoding = match (is_binary, is_compressed) {
        (true, true) => Encoding::Deflate,
        (true, false) => Encoding::Raw,
        (false, false) => Encoding::Text,
        (false, true) => return Err(Problem::unsupported("compressed text in a MetaImage")),
    };
    if skip == Skip::ToTheEnd && encoding != Encoding::Raw {
        return Err(Problem::unsupported(
            "`HeaderSize = -1` with compressed data or text",
        ));
    }
    let place = data_files(source, &header, &sizes)?;
    let payload = Payload {
        source: source.clone(),
        place,
        encoding,
        skip_lines: 0,
        skip,
        layout: Layout {
            scalar_type: parse_type(header.need("ElementType")?)?,
            endianness: Endianness::big_if(is_big),
            components,
            tuples: points.iter().product(),
        },
        stored_steps: steps,
        planar: false,
    };
    let surplus = payload.surplus_note();
    let mut dataset = Dataset::new(
        Geometry::Uniform(grid),
        vec![payload.into_field("scalars")?],
    )?
    .with_frame(WorldFrame::Lps);
    if let Some(note) = surplus {
        dataset = dataset.with_note(note);
    }
    if steps > 1 {
        dataset = dataset.with_note(format!("the first of {steps} steps was read"));
    }
    if let Some(orientation) = header
        .get(&["AnatomicalOrientation"])
        .filter(|o| *o != "???")
    {
        dataset = dataset.with_note(format!("anatomical orientation {orientation}"));
    }
    Ok(dataset)
}

/// Origin, directions and spacing of the first three dimensions.
fn placement(header: &Header, dimension: usize) -> Result<DAffine3, Problem> {
    let origin = header.numbers(&["Offset", "Position", "Origin"], dimension)?;
    let spacing = header.numbers(&["ElementSpacing", "ElementSize"], dimension)?;
    let matrix = header.numbers(
        &["TransformMatrix", "Rotation", "Orientation"],
        dimension * dimension,
    )?;
    let axis = |i: usize| {
        let direction = match &matrix {
            Some(m) => DVec3::from_slice(&m[i * dimension..][..3]),
            None => DVec3::AXES[i],
        };
        direction * spacing.as_ref().map_or(1.0, |s| s[i])
    };
    let origin = origin.map_or(DVec3::ZERO, |o| DVec3::from_slice(&o[..3]));
    let axes = DMat3::from_cols(axis(0), axis(1), axis(2));
    Ok(DAffine3::from_mat3_translation(axes, origin))
}

/// `LOCAL`, a name, `LIST [nD]` with names below, or `pattern first last [step]`.
fn data_files(source: &Source, header: &Header, sizes: &[usize]) -> Result<Place, Problem> {
    let text = header.need("ElementDataFile")?;
    let folder = folder_of(source.path());
    let words: Vec<&str> = text.split_whitespace().collect();
    let dimension = sizes.len();
    let (names, file_dimension) = match words.as_slice() {
        ["LOCAL" | "Local" | "local"] => return Ok(Place::Here(header.data_at)),
        ["LIST", more @ ..] => {
            let paths: Result<Vec<_>, _> =
                header.listed.iter().map(|n| resolve(&folder, n)).collect();
            let file_dimension = match more.first() {
                None => dimension - 1,
                Some(text) => text
                    .trim_end_matches(['D', 'd'])
                    .parse()
                    .ok()
                    .filter(|n| (1..=dimension).contains(n))
                    .ok_or_else(|| wrong("ElementDataFile", "LIST nD", text))?,
            };
            (FileNames::List(paths?), file_dimension)
        }
        [pattern, first, last, more @ ..] if pattern.contains('%') => {
            let number = |text: &str| {
                text.parse::<i64>()
                    .map_err(|_| wrong("ElementDataFile", "a whole number", text))
            };
            let step = more.first().map_or(Ok(1), |step| number(step))?;
            let names =
                FileNames::series(source.path(), pattern, number(first)?, number(last)?, step)?;
            (names, dimension - 1)
        }
        _ => return Ok(Place::Files(FileNames::List(vec![resolve(&folder, text)?]))),
    };
    let expected = sizes[file_dimension..]
        .iter()
        .try_fold(1usize, |n, size| n.checked_mul(*size));
    if expected != Some(names.len()) {
        return Err(Problem::malformed(
            "MetaImage key ElementDataFile",
            format!("{} files", expected.unwrap_or(usize::MAX)),
            format!("{} files", names.len()),
        ));
    }
    Ok(Place::Files(names))
}

/// Writes header and data in one file, raw or zlib.
fn write(path: &Path, voxels: &Voxels) -> Result<Saved, IoError> {
    let data = voxels.little_endian_bytes();
    let packed = if voxels.compress {
        let mut packer = ZlibEncoder::new(Vec::new(), Compression::default());
        let packed = packer.write_all(&data).and_then(|()| packer.finish());
        Some(packed.map_err(|source| {
            Problem::System {
                action: "cannot compress",
                source,
            }
            .in_file(path)
        })?)
    } else {
        None
    };
    let header = header_text(voxels, packed.as_ref().map(Vec::len));
    write_atomically(path, |w| {
        w.write_all(header.as_bytes())?;
        w.write_all(packed.as_deref().unwrap_or(&data))
    })?;
    Ok(Vec::new())
}

/// The letters of where each axis starts, by the direction that it runs in most: MetaIO's
/// `AnatomicalOrientation`. A body's axes are `RAI` in LPS coordinates that are not turned.
fn anatomical_orientation(axes_lps: [DVec3; 3]) -> String {
    const STARTS: [[char; 2]; 3] = [['R', 'L'], ['A', 'P'], ['I', 'S']];
    axes_lps
        .map(|axis| {
            let most = axis.abs().max_position();
            STARTS[most][usize::from(axis[most] < 0.0)]
        })
        .iter()
        .collect()
}

fn header_text(voxels: &Voxels, packed_bytes: Option<usize>) -> String {
    let (mut axes, mut origin) = voxels.axes_and_origin();
    let mut orientation = String::new();
    if let Some(signs) = voxels.frame.signs_to(WorldFrame::Lps) {
        // Adding zero makes a positive zero of a negative one.
        axes = axes.map(|axis| signs * axis + 0.0);
        origin = signs * origin + 0.0;
        let letters = anatomical_orientation(axes);
        orientation = format!("AnatomicalOrientation = {letters}\n");
    }
    let vector = |v: DVec3| format!("{} {} {}", v.x, v.y, v.z);
    let directions = axes.map(|axis| vector(axis / axis.length())).join(" ");
    let spacing = voxels.grid.spacing();
    let [x, y, z] = voxels.grid.points();
    let element_type = match voxels.values.scalar_type() {
        ScalarType::U8 => "MET_UCHAR",
        ScalarType::I8 => "MET_CHAR",
        ScalarType::U16 => "MET_USHORT",
        ScalarType::I16 => "MET_SHORT",
        ScalarType::U32 => "MET_UINT",
        ScalarType::I32 => "MET_INT",
        ScalarType::U64 => "MET_ULONG_LONG",
        ScalarType::I64 => "MET_LONG_LONG",
        ScalarType::F32 => "MET_FLOAT",
        ScalarType::F64 => "MET_DOUBLE",
    };
    let compression = match packed_bytes {
        Some(bytes) => format!("CompressedData = True\nCompressedDataSize = {bytes}\n"),
        None => "CompressedData = False\n".to_owned(),
    };
    let channels = voxels.values.components();
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = write!(
        text,
        "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n\
         {compression}TransformMatrix = {directions}\nOffset = {}\n{orientation}ElementSpacing = {}\n\
         DimSize = {x} {y} {z}\nElementNumberOfChannels = {channels}\n\
         ElementType = {element_type}\n",
        vector(origin),
        vector(spacing),
    );
    // A comment makes the data start where it can be mapped.
    const AROUND: &str = "Comment = \nElementDataFile = LOCAL\n";
    let len = text.len() + AROUND.len();
    let comment_len = len.next_multiple_of(DATA_ALIGN) - len;
    let _ = write!(
        text,
        "Comment = {:-<comment_len$}\nElementDataFile = LOCAL\n",
        ""
    );
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open(header: &str, data: &[u8]) -> Result<Dataset, Problem> {
        let mut bytes = header.as_bytes().to_vec();
        bytes.extend_from_slice(data);
        read(
            &Source::from_bytes(Path::new("t.mha"), bytes),
            &ReadOptions::default(),
        )
    }

    const BASE: &str = "ObjectType = Image\nNDims = 3\nDimSize = 2 2 2\nElementType = MET_SHORT\n";

    #[test]
    fn text_and_byte_order() {
        let text = format!("{BASE}BinaryData = False\nElementDataFile = LOCAL\n");
        let dataset = open(&text, b"1 2 3 4 5 6 7 -8").expect("legal");
        let values = dataset.fields()[0].load().expect("whole");
        assert_eq!(
            values.as_slice::<i16>(),
            Some([1, 2, 3, 4, 5, 6, 7, -8].as_slice())
        );
        let big = format!("{BASE}ElementByteOrderMSB = True\nElementDataFile = LOCAL\n");
        let data: Vec<u8> = (1..=8i16).flat_map(i16::to_be_bytes).collect();
        let dataset = open(&big, &data).expect("legal");
        let values = dataset.fields()[0].load().expect("whole");
        assert_eq!(
            values.as_slice::<i16>(),
            Some([1, 2, 3, 4, 5, 6, 7, 8].as_slice())
        );
    }

    #[test]
    fn wrong_headers_say_what_is_wrong() {
        for (header, word) in [
            ("ObjectType = Tube\nElementDataFile = LOCAL\n", "Tube"),
            ("NDims = 2\nElementDataFile = LOCAL\n", "2 dimensions"),
            (
                "NDims = 3\nDimSize = 2 2\nElementDataFile = LOCAL\n",
                "DimSize",
            ),
            ("NDims = 3\nDimSize = 2 2 2\n", "ElementDataFile"),
            (
                "NDims = 3\nDimSize = 2 2 2\nElementType = MET_OTHER\nElementDataFile = LOCAL\n",
                "MET_OTHER",
            ),
            (
                "NDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\nElementDataFile = LIST\na\n",
                "2 files",
            ),
        ] {
            let error = open(header, &[]).expect_err("wrong").to_string();
            assert!(error.contains(word), "{error}");
        }
    }
}
