//! The text header of NRRD: fields, axes, and where the data is.
//!
//! Source: "Definition of NRRD File Format", teem.sourceforge.net/nrrd/format.html.

use glam::DVec3;
use vacua_volume::ScalarType;

use crate::decode::{Endianness, shown};
use crate::error::Problem;
use crate::files::{FileNames, folder_of, resolve};
use crate::payload::{Encoding, Place, Skip};
use crate::source::Source;

/// Most axes a NRRD may have (`NRRD_DIM_MAX` of teem).
const MOST_AXES: usize = 16;

/// One axis, fastest first in the file.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Axis {
    pub(super) size: usize,
    /// Lower case; empty if not said.
    pub(super) kind: String,
    /// Step in world units, `None` for `none` or if not said.
    pub(super) direction: Option<DVec3>,
    pub(super) spacing: Option<f64>,
    pub(super) min: Option<f64>,
    pub(super) max: Option<f64>,
    /// Whether samples are at nodes; cells otherwise.
    pub(super) is_node_centered: bool,
}

/// Everything a header says that vacua uses.
#[derive(Debug)]
pub(super) struct Header {
    pub(super) scalar_type: ScalarType,
    pub(super) endianness: Endianness,
    pub(super) encoding: Encoding,
    pub(super) axes: Vec<Axis>,
    /// Whether any axis has a space direction.
    pub(super) is_oriented: bool,
    /// Name of the space, if it has one.
    pub(super) space: Option<String>,
    pub(super) space_origin: Option<DVec3>,
    pub(super) skip_lines: usize,
    pub(super) skip: Skip,
    pub(super) place: Place,
}

/// Field values as text, before they are understood together.
#[derive(Default)]
struct Texts<'a> {
    fields: Vec<(String, &'a str)>,
}

impl<'a> Texts<'a> {
    fn get(&self, name: &str) -> Option<&'a str> {
        self.fields.iter().find(|(n, _)| n == name).map(|(_, v)| *v)
    }

    fn need(&self, name: &str) -> Result<&'a str, Problem> {
        self.get(name).ok_or_else(|| missing(name))
    }
}

fn missing(field: &str) -> Problem {
    Problem::malformed("NRRD header", format!("the field `{field}`"), "none")
}

fn wrong(field: &str, expected: impl Into<String>, found: &str) -> Problem {
    Problem::malformed(
        format!("NRRD field `{field}`"),
        expected,
        shown(found.as_bytes()),
    )
}

/// Old and short names of fields.
fn canonical(name: &str) -> String {
    let name = name.trim().to_ascii_lowercase();
    match name.as_str() {
        "datafile" => "data file".to_owned(),
        "lineskip" => "line skip".to_owned(),
        "byteskip" => "byte skip".to_owned(),
        "axismins" => "axis mins".to_owned(),
        "axismaxs" => "axis maxs".to_owned(),
        "centerings" => "centers".to_owned(),
        _ => name,
    }
}

/// Splits text lines off the front of bytes; knows how far it is.
struct Lines<'a> {
    bytes: &'a [u8],
    at: usize,
    number: usize,
}

impl<'a> Lines<'a> {
    fn next(&mut self) -> Result<Option<&'a str>, Problem> {
        let rest = self.bytes.get(self.at..).filter(|rest| !rest.is_empty());
        let Some(rest) = rest else { return Ok(None) };
        let end = rest.iter().position(|&b| b == b'\n');
        let line = &rest[..end.unwrap_or(rest.len())];
        self.at += end.map_or(rest.len(), |end| end + 1);
        self.number += 1;
        let line = line.strip_suffix(b"\r").unwrap_or(line);
        std::str::from_utf8(line)
            .map(Some)
            .map_err(|_| Problem::malformed(format!("line {}", self.number), "text", shown(line)))
    }
}

impl Header {
    /// Reads the header at the start of a file.
    ///
    /// # Errors
    /// [`Problem`] naming the line or field that is wrong or not supported.
    pub(super) fn read(source: &Source) -> Result<Self, Problem> {
        let mut lines = Lines {
            bytes: source.bytes(),
            at: 0,
            number: 0,
        };
        let magic = lines.next()?.unwrap_or_default();
        if !matches!(magic.trim_end(), m if m.len() == 8 && m.starts_with("NRRD000")) {
            return Err(Problem::malformed(
                "line 1",
                "NRRD000n",
                shown(magic.as_bytes()),
            ));
        }
        let mut texts = Texts::default();
        let mut listed = None;
        while let Some(line) = lines.next()? {
            if line.is_empty() {
                break;
            }
            if line.starts_with('#') {
                continue;
            }
            let Some((name, value)) = line.split_once(':') else {
                return Err(Problem::malformed(
                    format!("line {}", lines.number),
                    "`field: value`",
                    shown(line.as_bytes()),
                ));
            };
            if value.starts_with('=') {
                continue;
            }
            let name = canonical(name);
            let value = value.trim();
            if name == "data file" && value.split_whitespace().next() == Some("LIST") {
                let mut names = Vec::new();
                while let Some(line) = lines.next()? {
                    if !line.trim().is_empty() {
                        names.push(line.trim());
                    }
                }
                listed = Some(names);
            }
            texts.fields.push((name, value));
        }
        Self::understand(source, &texts, listed, lines.at)
    }

    fn understand(
        source: &Source,
        texts: &Texts,
        listed: Option<Vec<&str>>,
        data_at: usize,
    ) -> Result<Self, Problem> {
        let scalar_type = parse_type(texts.need("type")?)?;
        let encoding = parse_encoding(texts.need("encoding")?)?;
        let binary = encoding != Encoding::Text && scalar_type.size_bytes() > 1;
        let endianness = match texts.get("endian") {
            Some("little") => Endianness::Little,
            Some("big") => Endianness::Big,
            Some(other) => return Err(wrong("endian", "little or big", other)),
            None if binary => return Err(missing("endian")),
            None => Endianness::NATIVE,
        };
        let axes = parse_axes(texts)?;
        let count = |field: &str| {
            texts.get(field).map_or(Ok(0), |text| {
                text.parse::<usize>()
                    .map_err(|_| wrong(field, "a number of zero or more", text))
            })
        };
        let skip = match texts.get("byte skip") {
            Some("-1") if encoding == Encoding::Raw => Skip::ToTheEnd,
            Some("-1") => {
                return Err(Problem::unsupported(
                    "`byte skip: -1` with an encoding other than raw",
                ));
            }
            _ => Skip::Bytes(count("byte skip")?),
        };
        let place = match texts.get("data file") {
            None => Place::Here(data_at),
            Some(text) => Place::Files(parse_data_file(source, text, listed, &axes)?),
        };
        if let Some(dimension) = texts.get("space dimension").filter(|d| *d != "3") {
            return Err(Problem::unsupported(format!(
                "a space of {dimension} dimensions"
            )));
        }
        Ok(Self {
            scalar_type,
            endianness,
            encoding,
            is_oriented: axes.iter().any(|axis| axis.direction.is_some()),
            axes,
            space: texts.get("space").map(str::to_owned),
            space_origin: match texts.get("space origin") {
                Some(text) => parse_vectors("space origin", text)?
                    .first()
                    .copied()
                    .flatten(),
                None => None,
            },
            skip_lines: count("line skip")?,
            skip,
            place,
        })
    }
}

/// All spellings of the number types.
fn parse_type(text: &str) -> Result<ScalarType, Problem> {
    let words: Vec<String> = text
        .split_whitespace()
        .map(str::to_ascii_lowercase)
        .collect();
    Ok(match words.join(" ").as_str() {
        "signed char" | "int8" | "int8_t" => ScalarType::I8,
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => ScalarType::U8,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => {
            ScalarType::I16
        }
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => {
            ScalarType::U16
        }
        "int" | "signed int" | "int32" | "int32_t" => ScalarType::I32,
        "uint" | "unsigned int" | "uint32" | "uint32_t" => ScalarType::U32,
        "longlong"
        | "long long"
        | "long long int"
        | "signed long long"
        | "signed long long int"
        | "int64"
        | "int64_t" => ScalarType::I64,
        "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => {
            ScalarType::U64
        }
        "float" => ScalarType::F32,
        "double" => ScalarType::F64,
        "block" => return Err(Problem::unsupported("NRRD type `block`")),
        _ => return Err(wrong("type", "a number type", text)),
    })
}

fn parse_encoding(text: &str) -> Result<Encoding, Problem> {
    Ok(match text.to_ascii_lowercase().as_str() {
        "raw" => Encoding::Raw,
        "txt" | "text" | "ascii" => Encoding::Text,
        "hex" => Encoding::Hex,
        "gz" | "gzip" => Encoding::Deflate,
        "bz2" | "bzip2" => Encoding::Bzip2,
        _ => {
            return Err(Problem::unsupported(format!(
                "NRRD encoding {}",
                shown(text.as_bytes())
            )));
        }
    })
}

fn parse_axes(texts: &Texts) -> Result<Vec<Axis>, Problem> {
    let text = texts.need("dimension")?;
    let dimension = text
        .parse::<usize>()
        .ok()
        .filter(|n| (1..=MOST_AXES).contains(n))
        .ok_or_else(|| wrong("dimension", format!("1 to {MOST_AXES}"), text))?;
    let mut axes = vec![Axis::default(); dimension];
    let words = |field: &'static str| -> Result<Option<Vec<&str>>, Problem> {
        let Some(text) = texts.get(field) else {
            return Ok(None);
        };
        let words: Vec<&str> = text.split_whitespace().collect();
        if words.len() != dimension {
            return Err(wrong(field, format!("{dimension} values"), text));
        }
        Ok(Some(words))
    };
    let sizes = words("sizes")?.ok_or_else(|| wrong("sizes", "a value for each axis", ""))?;
    for (axis, size) in axes.iter_mut().zip(sizes) {
        axis.size = size
            .parse()
            .ok()
            .filter(|&n| n > 0)
            .ok_or_else(|| wrong("sizes", "positive whole numbers", size))?;
    }
    for (axis, kind) in axes.iter_mut().zip(words("kinds")?.unwrap_or_default()) {
        axis.kind = match kind {
            "none" | "???" => String::new(),
            kind => kind.to_ascii_lowercase(),
        };
    }
    for field in ["centers", "centerings"] {
        for (axis, center) in axes.iter_mut().zip(words(field)?.unwrap_or_default()) {
            axis.is_node_centered = center == "node";
        }
    }
    // `nan` is how NRRD says that an axis has no such number.
    for (field, set) in [
        (
            "spacings",
            (|a, v| a.spacing = v) as fn(&mut Axis, Option<f64>),
        ),
        ("axis mins", |a, v| a.min = v),
        ("axis maxs", |a, v| a.max = v),
    ] {
        for (axis, word) in axes.iter_mut().zip(words(field)?.unwrap_or_default()) {
            let number: f64 = word.parse().map_err(|_| wrong(field, "numbers", word))?;
            set(axis, (!number.is_nan()).then_some(number));
        }
    }
    if let Some(text) = texts.get("space directions") {
        let vectors = parse_vectors("space directions", text)?;
        if vectors.len() != dimension {
            return Err(wrong(
                "space directions",
                format!("{dimension} vectors"),
                text,
            ));
        }
        for (axis, direction) in axes.iter_mut().zip(vectors) {
            axis.direction = direction;
        }
    }
    Ok(axes)
}

/// Reads `(1,0,0) none (0,1,0)`.
fn parse_vectors(field: &str, text: &str) -> Result<Vec<Option<DVec3>>, Problem> {
    let mut vectors = Vec::new();
    let mut rest = text.trim();
    while !rest.is_empty() {
        if let Some(after) = rest.strip_prefix("none") {
            vectors.push(None);
            rest = after.trim_start();
            continue;
        }
        let (inside, after) = rest
            .strip_prefix('(')
            .and_then(|t| t.split_once(')'))
            .ok_or_else(|| wrong(field, "vectors in parentheses, or none", rest))?;
        let numbers: Vec<f64> = inside
            .split(',')
            .map(|n| n.trim().parse().map_err(|_| wrong(field, "numbers", n)))
            .collect::<Result<_, _>>()?;
        let [x, y, z] = numbers[..] else {
            return Err(Problem::unsupported(format!(
                "a {}-dimensional vector in NRRD field `{field}`",
                numbers.len()
            )));
        };
        // teem writes an axis that is not of space as a vector of NaN.
        let vector = DVec3::new(x, y, z);
        vectors.push((!vector.is_nan()).then_some(vector));
        rest = after.trim_start();
    }
    Ok(vectors)
}

/// One name, `LIST [subdim]` with names below, or `pattern min max step [subdim]`.
fn parse_data_file(
    source: &Source,
    text: &str,
    listed: Option<Vec<&str>>,
    axes: &[Axis],
) -> Result<FileNames, Problem> {
    let folder = folder_of(source.path());
    let words: Vec<&str> = text.split_whitespace().collect();
    let (names, sub_dimension) = match (listed, words.as_slice()) {
        (Some(names), [_, more @ ..]) => {
            let paths: Result<Vec<_>, _> = names.iter().map(|n| resolve(&folder, n)).collect();
            (FileNames::List(paths?), more.first())
        }
        (None, [pattern, first, last, step, more @ ..]) if pattern.contains('%') => {
            let number = |text: &str| {
                text.parse::<i64>()
                    .map_err(|_| wrong("data file", "a whole number", text))
            };
            let (first, last, step) = (number(first)?, number(last)?, number(step)?);
            let names = FileNames::series(source.path(), pattern, first, last, step)?;
            (names, more.first())
        }
        _ => return Ok(FileNames::List(vec![resolve(&folder, text)?])),
    };
    let dimension = axes.len();
    let sub_dimension = match sub_dimension {
        Some(text) => text
            .parse::<usize>()
            .ok()
            .filter(|n| (1..=dimension).contains(n))
            .ok_or_else(|| {
                wrong(
                    "data file",
                    format!("a dimension of 1 to {dimension}"),
                    text,
                )
            })?,
        None => dimension.saturating_sub(1).max(1),
    };
    let slabs = axes[sub_dimension.min(dimension)..]
        .iter()
        .try_fold(1usize, |n, axis| n.checked_mul(axis.size));
    let whole_slowest = sub_dimension == dimension
        && names.len() > 0
        && axes[dimension - 1].size.is_multiple_of(names.len());
    if slabs != Some(names.len()) && !whole_slowest {
        return Err(Problem::malformed(
            "NRRD field `data file`",
            format!("{} files", slabs.unwrap_or(usize::MAX)),
            format!("{} files", names.len()),
        ));
    }
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn header(fields: &str) -> Result<Header, Problem> {
        let text = format!("NRRD0004\n# comment\nkey:=value\n{fields}\n\n");
        Header::read(&Source::from_bytes(
            Path::new("/d/h.nhdr"),
            text.into_bytes(),
        ))
    }

    #[test]
    fn fields_are_understood() {
        let h = header(
            "type: unsigned short\ndimension: 4\nsizes: 3 4 5 6\nencoding: gz\nendian: big\n\
             kinds: vector space space space\nspace: left-posterior-superior\n\
             space directions: none (1,0,0) (0,2,0) (0, 0, 3)\nspace origin: (1,2,3)\nbyteskip: 7",
        )
        .expect("legal");
        assert_eq!(h.scalar_type, ScalarType::U16);
        assert_eq!(h.endianness, Endianness::Big);
        assert_eq!(h.encoding, Encoding::Deflate);
        assert_eq!(h.axes[0].direction, None);
        assert_eq!(h.axes[3].direction, Some(DVec3::new(0.0, 0.0, 3.0)));
        assert_eq!(h.space_origin, Some(DVec3::new(1.0, 2.0, 3.0)));
        assert_eq!(h.skip, Skip::Bytes(7));
    }

    #[test]
    fn every_type_spelling() {
        assert_eq!(
            parse_type("signed  long long int").expect("legal"),
            ScalarType::I64
        );
        assert!(parse_type("char").is_err());
        let error = parse_type("block").expect_err("not numbers").to_string();
        assert!(error.contains("block"), "{error}");
    }

    #[test]
    fn data_files() {
        let base = "type: uchar\ndimension: 3\nsizes: 4 4 6\nencoding: raw\n";
        let count = |more: &str| match header(&format!("{base}{more}")).map(|h| h.place) {
            Ok(Place::Files(names)) => names.len(),
            Ok(Place::Here(_)) => 0,
            Err(_) => usize::MAX,
        };
        assert_eq!(count("data file: some name.raw"), 1);
        assert_eq!(count("data file: s%03d.raw 1 6 1"), 6);
        assert_eq!(count("data file: s%03d.raw 1 5 1"), usize::MAX);
        assert_eq!(count("data file: s%03d.raw 1 2 1 3"), 2);
        assert_eq!(count("data file: LIST\na\nb\nc\nd\ne\nf"), 6);
        assert_eq!(count("data file: LIST 3\na\nb\nc"), 3);
        assert_eq!(count("data file: LIST\na\nb"), usize::MAX);
        assert_eq!(count("data file: ../up.raw"), usize::MAX);
        assert_eq!(count("byte skip: -1"), 0);
    }
}
