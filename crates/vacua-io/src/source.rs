//! A file's bytes, memory-mapped, shared by everything that was read from it.

use std::fs::{File, FileType};
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

/// Refuses what cannot be mapped.
fn refuse_irregular(file_type: FileType) -> Result<(), Problem> {
    if file_type.is_file() {
        return Ok(());
    }
    if file_type.is_dir() {
        return Err(Problem::unsupported("reading a folder"));
    }
    Err(Problem::unsupported_but(
        format!("reading {}", kind_of(file_type)),
        "data is read where it lies, in any order: save it to a file first",
    ))
}

/// What a thing that is neither file nor folder is called.
#[cfg(unix)]
fn kind_of(file_type: FileType) -> &'static str {
    use std::os::unix::fs::FileTypeExt as _;
    if file_type.is_fifo() {
        "a pipe"
    } else if file_type.is_socket() {
        "a socket"
    } else {
        "a device"
    }
}

/// What a thing that is neither file nor folder is called.
#[cfg(not(unix))]
fn kind_of(_: FileType) -> &'static str {
    "something that is not a regular file"
}

impl ByteStore for Mapping {
    fn bytes(&self) -> &[u8] {
        &self.0
    }

    #[cfg(target_os = "linux")]
    fn release(&self, range_bytes: std::ops::Range<usize>) {
        use memmap2::UncheckedAdvice;

        let (from, len) = (range_bytes.start, range_bytes.len());
        // SAFETY: pages of a read-only mapping of a file are dropped unwritten, and Linux fills them from
        // the same file at the next access: nobody who reads them, now or later, sees other bytes.
        let advised = unsafe {
            self.0
                .unchecked_advise_range(UncheckedAdvice::DontNeed, from, len)
        };
        if let Err(error) = advised {
            tracing::debug!(%error, "pages stay in memory");
        }
    }
}

impl Source {
    /// Maps a file.
    ///
    /// # Errors
    /// [`Problem::System`] if it is not there or cannot be mapped, [`Problem::Unsupported`] if it is
    /// no regular file: such are refused without being opened, so that nothing waits for a pipe.
    pub fn open(path: &Path) -> Result<Self, IoError> {
        let system = |action| move |source| Problem::System { action, source }.in_file(path);
        // Asked before it is opened: opening a pipe waits until somebody writes into it.
        let found = std::fs::metadata(path).map_err(system("cannot open"))?;
        refuse_irregular(found.file_type()).map_err(|p| p.in_file(path))?;
        let file = File::open(path).map_err(system("cannot open"))?;
        let metadata = file.metadata().map_err(system("cannot open"))?;
        refuse_irregular(metadata.file_type()).map_err(|p| p.in_file(path))?;
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

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn what_was_released_is_there_again() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("numbers.raw");
        let numbers: Vec<u32> = (0..50_000).collect();
        std::fs::write(&path, bytemuck::cast_slice(&numbers)).expect("writable");
        let source = Source::open(&path).expect("a file");
        let all = source
            .array("numbers", 0, ScalarType::U32, 1, 50_000)
            .expect("there");
        let some = source
            .array("numbers", 40_004, ScalarType::U32, 1, 20_000)
            .expect("there");
        assert_eq!(all.as_slice(), Some(&numbers[..]));
        some.release();
        assert_eq!(some.as_slice(), Some(&numbers[10_001..30_001]));
        assert_eq!(all.as_slice(), Some(&numbers[..]));
    }

    #[test]
    fn what_is_no_file_is_refused_at_once() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let pipe = folder.path().join("pipe.vti");
        let mode = rustix::fs::Mode::RUSR | rustix::fs::Mode::WUSR;
        rustix::fs::mkfifoat(rustix::fs::CWD, &pipe, mode).expect("writable");
        let socket = folder.path().join("socket.vti");
        let _listening = std::os::unix::net::UnixListener::bind(&socket).expect("writable");
        for (path, word) in [
            (pipe.as_path(), "a pipe"),
            (socket.as_path(), "a socket"),
            (Path::new("/dev/null"), "a device"),
            (folder.path(), "a folder"),
        ] {
            let error = Source::open(path).err().expect("refused").to_string();
            assert!(error.contains(word), "{error}");
        }
    }
}
