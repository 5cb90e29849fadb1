//! VTK XML files: which type a file is, and what reads it.
//!
//! `document` reads markup, `data_array` and `codec` numbers: these serve every type.
//! `structured` makes datasets of grids, `parallel` finds the pieces of a parallel file of grids;
//! `unstructured` makes meshes of both; `collection` reads files that list others.

pub(crate) mod codec;
mod collection;
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
    extensions: &[
        "vti", "vtr", "vts", "vtu", "pvti", "pvtr", "pvts", "pvtu", "pvd", "vtm", "vtmb",
    ],
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
fn read(source: &Source, options: &ReadOptions) -> Result<Dataset, Problem> {
    read_file(XmlFile::parse(source)?, options)
}

/// Describes the fields of a file whose markup is read.
fn read_file(file: XmlFile, options: &ReadOptions) -> Result<Dataset, Problem> {
    let own = field_data(&file);
    let dataset = read_data_set(file, options)?;
    let all = [dataset.field_data(), &own].concat();
    Ok(dataset.with_field_data(all))
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

fn read_data_set(file: XmlFile, options: &ReadOptions) -> Result<Dataset, Problem> {
    let type_name = file.root.required("type")?.to_owned();
    if let Some(kind) = GridKind::from_type(&type_name) {
        return Structured::from_file(file, kind)?.into_dataset();
    }
    if let Some(kind) = type_name.strip_prefix('P').and_then(GridKind::from_type) {
        return parallel::read(&file, kind)?.into_dataset();
    }
    match type_name.as_str() {
        unstructured::SERIAL | unstructured::PARALLEL => unstructured::read(file),
        collection::COLLECTION => collection::read_collection(&file, options),
        collection::MULTI_BLOCK => collection::read_blocks(&file),
        _ => Err(Problem::unsupported(format!(
            "the VTK data set type `{type_name}`"
        ))),
    }
}
