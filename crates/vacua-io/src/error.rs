//! The one error of reading and writing: which file, where in it, what was wrong.

use std::path::{Path, PathBuf};

use vacua_volume::{ArrayError, DatasetError, GridError, MeshError, TransferFunctionError};

/// A file that could not be read or written.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", path.display())]
pub struct IoError {
    /// The file.
    pub path: PathBuf,
    /// What was wrong with it.
    #[source]
    pub problem: Problem,
}

/// What was wrong with a file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Problem {
    /// The operating system refused.
    #[error("{action}: {source}")]
    System {
        /// What was being done: `cannot open`, `cannot write` …
        action: &'static str,
        /// The system's error.
        #[source]
        source: std::io::Error,
    },
    /// The file ends too early.
    #[error("truncated: {what} needs bytes {from}..{to}, the file ends at {len}")]
    Truncated {
        /// What is cut off.
        what: String,
        /// First byte needed.
        from: u64,
        /// One past the last byte needed.
        to: u64,
        /// Length of the file in bytes.
        len: u64,
    },
    /// The file breaks the rules of its format.
    #[error("{place}: expected {expected}, found {found}")]
    Malformed {
        /// Where: a line, a byte, an element, a header key.
        place: String,
        /// What the format asks for there.
        expected: String,
        /// What is there.
        found: String,
    },
    /// Something legal that vacua does not read.
    #[error("{what} is not supported{}", hint.as_deref().map(|h| format!("; {h}")).unwrap_or_default())]
    Unsupported {
        /// What.
        what: String,
        /// What to do about it, if anything.
        hint: Option<String>,
    },
    /// No format recognises the file.
    #[error("not a format that vacua knows (it reads {known}){}", hint.as_deref().map(|h| format!("; {h}")).unwrap_or_default())]
    UnknownFormat {
        /// The formats there are.
        known: String,
        /// What to do about it, if anything.
        hint: Option<String>,
    },
    /// A file that this one refers to cannot be read.
    #[error("a file that it refers to: {0}")]
    Part(#[source] Box<IoError>),
    /// A library that unpacks the file's container gave up.
    #[error("{place}: {source}")]
    Container {
        /// Where: a group, an array.
        place: String,
        /// What the library says.
        #[source]
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// The numbers make no grid.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// The cells make no mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The bytes make no array.
    #[error(transparent)]
    Array(#[from] ArrayError),
    /// Geometry and fields do not fit together.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// The points make no transfer function.
    #[error(transparent)]
    TransferFunction(#[from] TransferFunctionError),
}

impl Problem {
    /// Says which file has the problem.
    pub fn in_file(self, path: &Path) -> IoError {
        IoError {
            path: path.to_owned(),
            problem: self,
        }
    }

    /// [`Problem::Malformed`] from anything that prints.
    pub fn malformed(
        place: impl Into<String>,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> Self {
        Self::Malformed {
            place: place.into(),
            expected: expected.into(),
            found: found.into(),
        }
    }

    /// [`Problem::Part`]: wraps what went wrong with a file that another refers to.
    pub fn part(error: IoError) -> Self {
        Self::Part(Box::new(error))
    }

    /// [`Problem::Unsupported`] without a hint.
    pub fn unsupported(what: impl Into<String>) -> Self {
        Self::Unsupported {
            what: what.into(),
            hint: None,
        }
    }

    /// [`Problem::Unsupported`] with what to do about it.
    pub fn unsupported_but(what: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::Unsupported {
            what: what.into(),
            hint: Some(hint.into()),
        }
    }
}
