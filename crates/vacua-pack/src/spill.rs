//! Lists that are too long for memory, in temporary files without a name: whatever ends the process,
//! nothing is left of them.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Result, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Bytes of a buffer.
const BUFFER_BYTES: usize = 1 << 18;

/// Where lists may be written: beside the output.
#[derive(Clone, Debug)]
pub struct SpillFolder(PathBuf);

impl SpillFolder {
    /// The folder of a file.
    pub fn of(path: &Path) -> Self {
        match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => Self(folder.to_owned()),
            _ => Self(PathBuf::from(".")),
        }
    }

    /// A new file.
    ///
    /// # Errors
    /// If the system gives none.
    pub fn file(&self) -> Result<File> {
        std::fs::metadata(&self.0)?;
        // Without the temporary name, which is none that anybody gave.
        tempfile::tempfile_in(&self.0).map_err(|error| error.kind().into())
    }
}

/// The centre and the number of a cell.
pub type CellCenter = ([f32; 3], u64);

/// Bytes of one on disk.
const RECORD_BYTES: usize = 20;

/// A list that grows.
pub struct SpillWriter {
    file: BufWriter<File>,
    len: u64,
}

/// A list that is complete.
pub struct Spilled {
    file: File,
    /// Its length.
    pub len: u64,
}

impl SpillWriter {
    /// An empty list.
    ///
    /// # Errors
    /// If there is no place for it.
    pub fn new(folder: &SpillFolder) -> Result<Self> {
        Ok(Self {
            file: BufWriter::with_capacity(BUFFER_BYTES, folder.file()?),
            len: 0,
        })
    }

    /// Appends a cell.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn push(&mut self, (center, cell): CellCenter) -> Result<()> {
        let mut record = [0; RECORD_BYTES];
        record[..12].copy_from_slice(bytemuck::bytes_of(&center));
        record[12..].copy_from_slice(&cell.to_le_bytes());
        self.len += 1;
        self.file.write_all(&record)
    }

    /// Completes the list.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn finish(self) -> Result<Spilled> {
        let file = self.file.into_inner().map_err(|e| e.into_error())?;
        Ok(Spilled {
            file,
            len: self.len,
        })
    }
}

impl Spilled {
    /// Visits the cells in the order in which they were written, until `visit` has seen enough.
    ///
    /// # Errors
    /// If they cannot be read, or what `visit` fails with.
    pub fn visit(&mut self, mut visit: impl FnMut(CellCenter) -> Result<bool>) -> Result<()> {
        self.file.seek(SeekFrom::Start(0))?;
        let mut file = BufReader::with_capacity(BUFFER_BYTES, &mut self.file);
        let mut record = [0; RECORD_BYTES];
        for _ in 0..self.len {
            file.read_exact(&mut record)?;
            let mut cell = [0; 8];
            cell.copy_from_slice(&record[12..]);
            let center = bytemuck::pod_read_unaligned(&record[..12]);
            if !visit((center, u64::from_le_bytes(cell)))? {
                break;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_comes_back_and_leaves_nothing() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let spill = SpillFolder::of(&folder.path().join("out.vacua"));
        let mut list = SpillWriter::new(&spill).expect("a file");
        let all: Vec<CellCenter> = (0..50_000u64).map(|i| ([i as f32; 3], i << 30)).collect();
        all.iter().for_each(|&c| list.push(c).expect("written"));
        let mut list = list.finish().expect("written");
        for most in [all.len(), 7] {
            let mut back = Vec::new();
            let visit = |c| {
                back.push(c);
                Ok(back.len() < most)
            };
            list.visit(visit).expect("read");
            assert_eq!(back, all[..most]);
        }
        assert_eq!(folder.path().read_dir().expect("there").count(), 0);
    }
}
