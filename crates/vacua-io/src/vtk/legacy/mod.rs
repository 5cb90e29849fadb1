//! Legacy VTK files (`.vtk`), versions 1.0 to 5.1, ASCII and big-endian binary.
//!
//! `cursor` walks through words and lines, `array` finds and reads arrays of numbers,
//! `attributes` the fields on points and cells: these serve every data set type. `structured`
//! reads the three grids, `unstructured` meshes.

mod array;
mod attributes;
mod cursor;
mod structured;
mod unstructured;

use vacua_volume::Dataset;

use crate::error::Problem;
use crate::registry::{Format, ReadOptions};
use crate::source::Source;
use cursor::Cursor;

/// The legacy VTK format.
pub(crate) const FORMAT: Format = Format {
    name: "VTK legacy",
    extensions: &["vtk"],
    sniff: Some(sniff),
    read,
};

/// How every legacy file begins.
const MARK: &[u8] = b"# vtk DataFile";

fn sniff(bytes: &[u8]) -> bool {
    bytes.starts_with(MARK)
}

/// Reads the header and finds what reads the rest.
fn read(source: &Source, _: &ReadOptions) -> Result<Dataset, Problem> {
    let mut cursor = Cursor::new(source);
    let first = cursor.line();
    if !first.starts_with(MARK) {
        return Err(Problem::malformed(
            "line 1",
            "`# vtk DataFile Version …`",
            cursor::shown(first),
        ));
    }
    let major = major_version(first)?;
    cursor.line();
    match cursor.keyword().as_str() {
        "ascii" => cursor.set_binary(false),
        "binary" => cursor.set_binary(true),
        other => {
            return Err(Problem::malformed(
                "line 3",
                "ASCII or BINARY",
                format!("`{other}`"),
            ));
        }
    }
    loop {
        let place = cursor.place();
        match cursor.keyword().as_str() {
            "dataset" => break,
            "field" => attributes::skip_field_data(&mut cursor)?,
            "metadata" => cursor.skip_metadata(),
            other => return Err(Problem::malformed(place, "DATASET", format!("`{other}`"))),
        }
    }
    let place = cursor.place();
    match cursor.keyword().as_str() {
        "structured_points" => structured::read_points(cursor),
        "rectilinear_grid" => structured::read_rectilinear(cursor),
        "structured_grid" => structured::read_curvilinear(cursor),
        "unstructured_grid" => unstructured::read(cursor, major),
        other @ ("polydata" | "table" | "field" | "tree" | "directed_graph"
        | "undirected_graph" | "molecule") => Err(Problem::unsupported(format!(
            "the legacy VTK data set type {}",
            other.to_uppercase()
        ))),
        other => Err(Problem::malformed(
            place,
            "a data set type",
            format!("`{other}`"),
        )),
    }
}

/// The major version; versions after the 5 series are refused.
fn major_version(first: &[u8]) -> Result<u32, Problem> {
    let text = String::from_utf8_lossy(first);
    let version = text.split_whitespace().last().unwrap_or("");
    let major = version.split('.').next().and_then(|m| m.parse().ok());
    major.filter(|m| matches!(m, 1..=5u32)).ok_or_else(|| {
        Problem::unsupported(format!(
            "legacy VTK version `{}`",
            cursor::shown(version.as_bytes())
        ))
    })
}
