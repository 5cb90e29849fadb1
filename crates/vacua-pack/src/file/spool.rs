//! Sections that grow side by side, in one temporary file without a name.

use std::fs::File;
use std::hash::Hasher as _;
use std::io::{BufWriter, Read, Result, Seek, SeekFrom, Write};

use twox_hash::XxHash3_64;

use crate::spill::SpillFolder;

/// Bytes of a section that are kept before they are written.
const PENDING_BYTES: usize = 1 << 16;

/// The sections.
pub(super) struct Spool {
    file: BufWriter<File>,
    end: u64,
    sections: Vec<Section>,
}

#[derive(Default)]
struct Section {
    /// Its pieces: place and length.
    pieces: Vec<(u64, u64)>,
    pending: Vec<u8>,
    len: u64,
    hash: XxHash3_64,
}

impl Spool {
    /// So many empty sections.
    pub fn new(folder: &SpillFolder, num_sections: usize) -> Result<Self> {
        Ok(Self {
            file: BufWriter::with_capacity(1 << 20, folder.file()?),
            end: 0,
            sections: (0..num_sections).map(|_| Section::default()).collect(),
        })
    }

    /// Appends to a section.
    pub fn append(&mut self, section: usize, bytes: &[u8]) -> Result<()> {
        let section = &mut self.sections[section];
        section.len += bytes.len() as u64;
        section.hash.write(bytes);
        if section.pending.len() + bytes.len() <= PENDING_BYTES {
            section.pending.extend_from_slice(bytes);
            return Ok(());
        }
        let first = self.end;
        for piece in [&section.pending[..], bytes] {
            self.file.write_all(piece)?;
            self.end += piece.len() as u64;
        }
        section.pending.clear();
        section.pieces.push((first, self.end - first));
        Ok(())
    }

    /// A section's length and checksum.
    pub fn summary(&self, section: usize) -> (u64, u64) {
        let section = &self.sections[section];
        (section.len, section.hash.finish())
    }

    /// Copies a section.
    pub fn copy(&mut self, section: usize, out: &mut impl Write) -> Result<()> {
        self.file.flush()?;
        let section = &self.sections[section];
        let mut file = self.file.get_ref();
        for &(first, len) in &section.pieces {
            file.seek(SeekFrom::Start(first))?;
            let copied = std::io::copy(&mut file.take(len), out)?;
            if copied != len {
                return Err(std::io::ErrorKind::UnexpectedEof.into());
            }
        }
        out.write_all(&section.pending)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sections_come_out_whole() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let spill = SpillFolder::of(&folder.path().join("x"));
        let mut spool = Spool::new(&spill, 3).expect("a file");
        let mut expected = [Vec::new(), Vec::new(), Vec::new()];
        for i in 0..200usize {
            let bytes = vec![i as u8; i * i % 9000];
            spool.append(i % 2, &bytes).expect("written");
            expected[i % 2].extend(bytes);
        }
        for (i, expected) in expected.iter().enumerate() {
            let mut back = Vec::new();
            spool.copy(i, &mut back).expect("read");
            assert_eq!(back, *expected);
            let sum = super::super::checksum(expected);
            assert_eq!(spool.summary(i), (expected.len() as u64, sum));
        }
    }
}
