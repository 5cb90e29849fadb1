//! The list of formats, and the choice among them: by content first, then by extension.

use std::path::Path;

use vacua_volume::{Dataset, ScalarType};

use crate::error::{IoError, Problem};
use crate::source::Source;
use crate::vtk;

/// What the command line may say about a file that does not say it itself.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReadOptions {
    /// Points a side of a raw file.
    pub dimensions: Option<[usize; 3]>,
    /// Type of a number in a raw file.
    pub scalar_type: Option<ScalarType>,
    /// Whether a raw file is big-endian; little-endian if not said.
    pub big_endian: Option<bool>,
    /// Components a tuple of a raw file; 1 if not said.
    pub components: Option<usize>,
    /// Bytes to skip at the start of a raw file.
    pub header_bytes: Option<usize>,
    /// Spacing of a grid that has none of its own (raw, npy, tiff).
    pub spacing: Option<[f64; 3]>,
    /// Time step of a file that has several, from 0; the first if not said.
    pub step: Option<usize>,
    /// Origin of a grid that has none of its own (raw, npy, tiff).
    pub origin: Option<[f64; 3]>,
}

/// One file format.
pub struct Format {
    /// What people call it.
    pub name: &'static str,
    /// Extensions, lower case, without the first dot (`nii.gz`).
    pub extensions: &'static [&'static str],
    /// Whether the first bytes are certainly this format; `None` if it has no mark of its own.
    pub sniff: Option<fn(&[u8]) -> bool>,
    /// Reads the header and describes the fields.
    pub read: fn(&Source, &ReadOptions) -> Result<Dataset, Problem>,
}

/// All formats that vacua reads, in the order in which they are asked.
pub fn formats() -> &'static [Format] {
    &[
        vtk::xml::FORMAT,
        vtk::legacy::FORMAT,
        crate::exodus::FORMAT,
        crate::hdf5::FORMAT,
        crate::xdmf::FORMAT,
        crate::mesh_dump::FORMAT,
        crate::nrrd::FORMAT,
        crate::metaimage::FORMAT,
        crate::nifti::FORMAT,
        crate::npy::FORMAT,
        crate::tiff::FORMAT,
        crate::raw::FORMAT,
    ]
}

/// Opens a file that says itself what it is.
///
/// # Errors
/// [`IoError`] naming the file, the place in it, and what was expected there.
pub fn open(path: impl AsRef<Path>) -> Result<Dataset, IoError> {
    open_with(path, &ReadOptions::default())
}

/// Opens a file with help from the command line.
///
/// # Errors
/// As [`open`].
pub fn open_with(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Dataset, IoError> {
    let path = path.as_ref();
    if let Some(folder) = crate::zarr::folder_of(path) {
        tracing::debug!(format = crate::zarr::NAME, path = %folder.display(), "reading");
        return crate::zarr::open(&folder, options);
    }
    open_source(&Source::open(path)?, options)
}

/// Opens a file that is in memory already, or mapped.
///
/// # Errors
/// As [`open`].
pub fn open_source(source: &Source, options: &ReadOptions) -> Result<Dataset, IoError> {
    let path = source.path();
    let format = choose(source, options).map_err(|p| p.in_file(path))?;
    tracing::debug!(format = format.name, path = %path.display(), "reading");
    (format.read)(source, options).map_err(|p| p.in_file(path))
}

/// Picks the format of a file: raw if the command line gives its dimensions, otherwise by its
/// first bytes, then by its extension (the longest that fits: `nii.gz` before `gz`).
fn choose(source: &Source, options: &ReadOptions) -> Result<&'static Format, Problem> {
    let bytes = source.bytes();
    let name = source
        .path()
        .file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .to_lowercase();
    let by_options = || {
        let raw = formats().iter().find(|f| f.name == crate::raw::FORMAT.name);
        raw.filter(|_| options.dimensions.is_some())
    };
    let by_content = || {
        formats()
            .iter()
            .find(|f| f.sniff.is_some_and(|sniff| sniff(bytes)))
    };
    let by_extension = || {
        formats()
            .iter()
            .filter_map(|f| {
                let fits = |e: &&&str| name.ends_with(&format!(".{e}"));
                Some((f, f.extensions.iter().filter(fits).map(|e| e.len()).max()?))
            })
            .max_by_key(|(_, len)| *len)
            .map(|(f, _)| f)
    };
    by_options()
        .or_else(by_content)
        .or_else(by_extension)
        .ok_or_else(|| Problem::UnknownFormat {
            known: formats()
                .iter()
                .map(|f| f.name)
                .collect::<Vec<_>>()
                .join(", "),
            hint: Some(hint(bytes, &name)),
        })
}

/// What to do about a file that nothing recognises.
fn hint(bytes: &[u8], name: &str) -> String {
    if bytes.is_empty() {
        return "the file is empty".to_owned();
    }
    if bytes.starts_with(b"PK") && name.ends_with(".npz") {
        return "save the array on its own with numpy.save".to_owned();
    }
    if crate::payload::is_gzip(bytes) {
        return "it is compressed with gzip: decompress it first".to_owned();
    }
    crate::raw::NEEDS.to_owned()
}
