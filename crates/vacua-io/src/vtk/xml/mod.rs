//! VTK XML files: which type a file is, and what reads it.
//!
//! `document` reads markup, `data_array` and `codec` numbers: these serve every type.
//! `structured` makes datasets of grids, `parallel` finds the pieces of a parallel file of grids;
//! `unstructured` makes meshes of both.

pub(crate) mod codec;
pub(crate) mod data_array;
pub(crate) mod document;
mod fields;
mod parallel;
mod structured;
mod unstructured;

use vacua_volume::Dataset;

use crate::error::Problem;
use crate::registry::{Format, ReadOptions};
use crate::source::Source;
use crate::vtk::UNNAMED;
use document::XmlFile;
pub(crate) use structured::as_float;
use structured::{GridKind, Structured};

/// The VTK XML formats.
pub(crate) const FORMAT: Format = Format {
    name: "VTK XML",
    extensions: &["vti", "vtr", "vts", "vtu", "pvti", "pvtr", "pvts", "pvtu"],
    sniff: Some(sniff),
    read,
};

/// Bytes in which the root element must begin.
const SNIFF_BYTES: usize = 4096;

fn sniff(bytes: &[u8]) -> bool {
    let head = &bytes[..bytes.len().min(SNIFF_BYTES)];
    memchr::memmem::find(head, b"<VTKFile").is_some()
}

/// Reads the markup and describes the fields.
fn read(source: &Source, _: &ReadOptions) -> Result<Dataset, Problem> {
    let file = XmlFile::parse(source)?;
    let field_data = field_data(&file);
    Ok(read_data_set(file)?.with_field_data(field_data))
}

/// Names of the arrays that belong to the whole data set.
fn field_data(file: &XmlFile) -> Vec<String> {
    let section = file.data_set().ok().and_then(|d| d.child("FieldData"));
    let arrays = section.into_iter().flat_map(|s| &s.children);
    arrays
        .filter(|a| matches!(a.name.as_str(), "DataArray" | "Array"))
        .map(|a| a.attribute("Name").unwrap_or(UNNAMED).to_owned())
        .collect()
}

fn read_data_set(file: XmlFile) -> Result<Dataset, Problem> {
    let type_name = file.root.required("type")?.to_owned();
    if let Some(kind) = GridKind::from_type(&type_name) {
        return Structured::from_file(file, kind)?.into_dataset();
    }
    if let Some(kind) = type_name.strip_prefix('P').and_then(GridKind::from_type) {
        return parallel::read(&file, kind)?.into_dataset();
    }
    match type_name.as_str() {
        unstructured::SERIAL => return unstructured::read(file),
        unstructured::PARALLEL => return unstructured::read_parallel(&file),
        _ => {}
    }
    Err(Problem::unsupported(format!(
        "the VTK data set type `{type_name}`"
    )))
}
