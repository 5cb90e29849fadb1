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
    /// Spacing of a grid that has none of its own (raw, npy).
    pub spacing: Option<[f64; 3]>,
    /// Origin of a grid that has none of its own (raw, npy).
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
    &[vtk::xml::FORMAT, vtk::legacy::FORMAT]
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
    let source = Source::open(path)?;
    let format = choose(&source).map_err(|p| p.in_file(path))?;
    tracing::debug!(format = format.name, path = %path.display(), "reading");
    (format.read)(&source, options).map_err(|p| p.in_file(path))
}

/// Picks the format of a file: by its first bytes, then by its extension.
fn choose(source: &Source) -> Result<&'static Format, Problem> {
    let bytes = source.bytes();
    let name = source
        .path()
        .file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .to_lowercase();
    let by_content = formats()
        .iter()
        .find(|f| f.sniff.is_some_and(|sniff| sniff(bytes)));
    let by_extension = || {
        formats().iter().find(|f| {
            f.extensions
                .iter()
                .any(|e| name.ends_with(&format!(".{e}")))
        })
    };
    by_content
        .or_else(by_extension)
        .ok_or_else(|| Problem::UnknownFormat {
            known: formats()
                .iter()
                .map(|f| f.name)
                .collect::<Vec<_>>()
                .join(", "),
            hint: None,
        })
}
