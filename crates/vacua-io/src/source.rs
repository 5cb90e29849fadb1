//! A file's bytes, memory-mapped, shared by everything that was read from it.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use memmap2::Mmap;
use vacua_volume::{ByteStore, DataArray, ScalarType};

use crate::error::{IoError, Problem};

/// An open file. Clones share one mapping.
#[derive(Clone)]
pub struct Source {
    path: PathBuf,
    store: Arc<dyn ByteStore>,
}

struct Mapping(Mmap);

impl ByteStore for Mapping {
    fn bytes(&self) -> &[u8] {
        &self.0
    }
}

impl Source {
    /// Maps a file.
    ///
    /// # Errors
    /// [`Problem::System`] if it is not there, is no regular file, or cannot be mapped.
    pub fn open(path: &Path) -> Result<Self, IoError> {
        let system = |action| move |source| Problem::System { action, source }.in_file(path);
        let file = File::open(path).map_err(system("cannot open"))?;
        let metadata = file.metadata().map_err(system("cannot open"))?;
        if !metadata.is_file() {
            return Err(Problem::unsupported("something that is not a regular file").in_file(path));
        }
        if metadata.len() == 0 {
            return Ok(Self::from_bytes(path, Vec::new()));
        }
        // SAFETY: the mapping is private and read-only. A program that truncates or rewrites the
        // file while it is mapped breaks the promise of `ByteStore`; no renderer of large data can
        // do without that promise, and the README says so.
        let mapping = unsafe { Mmap::map(&file) }.map_err(system("cannot map"))?;
        Ok(Self {
            path: path.to_owned(),
            store: Arc::new(Mapping(mapping)),
        })
    }

    /// Bytes in memory under a file's name: decompressed contents, tests, fuzzing.
    pub fn from_bytes(path: &Path, bytes: Vec<u8>) -> Self {
        Self {
            path: path.to_owned(),
            store: Arc::new(bytes),
        }
    }

    /// The file's path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// All bytes.
    pub fn bytes(&self) -> &[u8] {
        self.store.bytes()
    }

    /// Length in bytes.
    pub fn len(&self) -> usize {
        self.bytes().len()
    }

    /// Whether the file is empty.
    pub fn is_empty(&self) -> bool {
        self.bytes().is_empty()
    }

    /// A piece of the file.
    ///
    /// # Errors
    /// [`Problem::Truncated`] if the file ends before the piece does.
    pub fn piece(&self, what: &str, from: usize, len: usize) -> Result<&[u8], Problem> {
        let to = from.saturating_add(len);
        self.bytes()
            .get(from..to)
            .ok_or_else(|| Problem::Truncated {
                what: what.to_owned(),
                from: from as u64,
                to: to as u64,
                len: self.len() as u64,
            })
    }

    /// Numbers that lie in the file in native byte order, without a copy where they are aligned.
    ///
    /// # Errors
    /// [`Problem::Truncated`] or [`Problem::Array`].
    pub fn array(
        &self,
        what: &str,
        offset_bytes: usize,
        scalar_type: ScalarType,
        components: usize,
        tuples: usize,
    ) -> Result<DataArray, Problem> {
        let len = tuples
            .checked_mul(components)
            .and_then(|n| n.checked_mul(scalar_type.size_bytes()))
            .unwrap_or(usize::MAX);
        self.piece(what, offset_bytes, len)?;
        let store = self.store.clone();
        Ok(DataArray::from_store(
            store,
            offset_bytes,
            scalar_type,
            components,
            tuples,
        )?)
    }
}
