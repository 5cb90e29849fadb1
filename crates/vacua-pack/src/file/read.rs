//! Reading a `.vacua` file where it is mapped.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use bytemuck::Pod;
use vacua_io::{IoError, Problem, Source};
use vacua_volume::{Association, ByteStore};

use super::*;
use crate::Variant;
use crate::delta;
use crate::encode::PackMap;
use crate::packed::{Nodes, PackedMesh};
use crate::section::Flat;
use crate::small::Clusters;

/// The file's bytes as the arrays over them share them.
struct FileBytes(Source);

impl ByteStore for FileBytes {
    fn bytes(&self) -> &[u8] {
        self.0.bytes()
    }
}

/// An open `.vacua` file: header and table are checked, sections when they are first used.
pub struct PackedFile {
    pub(super) path: PathBuf,
    pub(super) store: Arc<dyn ByteStore>,
    pub(super) header: Header,
    pub(super) table: Vec<Entry>,
    /// Whether a section's checksum was right, once that has been asked.
    intact: Vec<OnceLock<bool>>,
}

impl std::fmt::Debug for PackedFile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PackedFile")
            .field("path", &self.path)
            .finish_non_exhaustive()
    }
}

impl PackedFile {
    /// Opens and maps a file.
    ///
    /// # Errors
    /// [`IoError`] if it is not there, no `.vacua` file, of a newer major version, truncated, or its
    /// header or table is damaged.
    ///
    /// # Cost
    /// Independent of the size of the mesh.
    pub fn open(path: &Path) -> Result<Self, IoError> {
        Self::from_source(Source::open(path)?)
    }

    /// As [`Self::open`] for a file that is mapped already, or bytes in memory.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn from_source(source: Source) -> Result<Self, IoError> {
        let path = source.path().to_owned();
        match check::head(&source) {
            Ok((header, table)) => Ok(Self {
                path,
                store: Arc::new(FileBytes(source)),
                header,
                intact: table.iter().map(|_| OnceLock::new()).collect(),
                table,
            }),
            Err(problem) => Err(problem.in_file(&path)),
        }
    }

    /// Which layout the mesh has.
    pub fn variant(&self) -> Variant {
        match self.header.variant {
            1 => Variant::MultiLeaves,
            3 => Variant::Small,
            _ => Variant::MultiNodes,
        }
    }

    /// Length of the file in bytes.
    pub fn num_bytes(&self) -> u64 {
        self.header.file_length
    }

    /// The mesh. Its arrays stay in the file.
    ///
    /// # Errors
    /// [`IoError`] if a section is missing, damaged, or contradicts the others.
    ///
    /// # Cost
    /// Reads the geometry once, for its checksums, at the first call.
    pub fn mesh(&self) -> Result<PackedMesh, IoError> {
        self.read_mesh().map_err(|p| p.in_file(&self.path))
    }

    fn read_mesh(&self) -> Result<PackedMesh, Problem> {
        let variant = self.variant();
        let nodes = match variant {
            Variant::MultiLeaves => Nodes::MultiLeaves(self.flat(MULTI_LEAVES, NO_FIELD)?),
            _ => Nodes::MultiNodes(self.flat(MULTI_NODES, NO_FIELD)?),
        };
        if variant == Variant::Small {
            let clusters = Clusters::new(
                self.flat(CLUSTERS, NO_FIELD)?,
                self.flat(CLUSTER_BITS, NO_FIELD)?,
                self.flat(POSITION_FRAMES, NO_FIELD)?,
                self.flat(FRAMED_POSITIONS, NO_FIELD)?,
            );
            let mesh = PackedMesh {
                variant,
                index_bits: self.header.index_bits,
                submeshes: self.flat(SUBMESHES, NO_FIELD)?,
                nodes,
                outer: self.flat(OUTER, NO_FIELD)?,
                positions: Flat::from_vec(Vec::new()),
                indices: Flat::from_vec(Vec::new()),
                clusters: Some(clusters),
            };
            check::submeshes(&mesh)?;
            return Ok(mesh);
        }
        let mesh = PackedMesh {
            variant,
            index_bits: self.header.index_bits,
            submeshes: self.flat(SUBMESHES, NO_FIELD)?,
            nodes,
            outer: self.flat(OUTER, NO_FIELD)?,
            positions: self.flat(POSITIONS, NO_FIELD)?,
            indices: self.flat(INDICES, NO_FIELD)?,
            clusters: None,
        };
        check::submeshes(&mesh)?;
        Ok(mesh)
    }

    /// The map from packed to original order, with which fields are added; `None` if the file was
    /// written without.
    ///
    /// # Errors
    /// [`IoError`] if it is damaged or does not fit the mesh.
    ///
    /// # Cost
    /// Decodes it at every call: 4 bytes of memory a vertex and a cell, 8 for more than 2^32 cells.
    pub fn map(&self, mesh: &PackedMesh) -> Result<Option<PackMap>, IoError> {
        self.read_map(mesh).map_err(|p| p.in_file(&self.path))
    }

    fn read_map(&self, mesh: &PackedMesh) -> Result<Option<PackMap>, Problem> {
        if self.find(MAP_POINTS, NO_FIELD).is_err() {
            return Ok(None);
        }
        Ok(Some(PackMap {
            points: self.order(mesh, Association::Point)?.decode(),
            cells: self.order(mesh, Association::Cell)?.decode(),
        }))
    }

    /// The original numbers of vertices or cells where they lie.
    pub(super) fn order(
        &self,
        mesh: &PackedMesh,
        association: Association,
    ) -> Result<delta::Blocks<'_>, Problem> {
        let (kind, len) = match association {
            Association::Point => (MAP_POINTS, mesh.num_vertices() as u64),
            Association::Cell => (MAP_CELLS, mesh.num_cells()),
        };
        let (_, place) = self.section(kind, NO_FIELD)?;
        let bytes = self.store.bytes().get(place).unwrap_or(&[]);
        let len = usize::try_from(len).unwrap_or(usize::MAX);
        delta::Blocks::new(kind_name(kind), bytes, len)
    }

    pub(super) fn find(&self, kind: u32, field: u32) -> Result<(usize, &Entry), Problem> {
        let mut all = self.table.iter().enumerate();
        all.find(|(_, e)| e.kind == kind && e.field == field)
            .ok_or_else(|| Problem::malformed("section table", kind_name(kind), "none"))
    }

    /// A section whose checksum is right.
    pub(super) fn section(&self, kind: u32, field: u32) -> Result<(&Entry, Range<usize>), Problem> {
        let (number, entry) = self.find(kind, field)?;
        let place = entry.offset as usize..(entry.offset + entry.length) as usize;
        let bytes = self.store.bytes().get(place.clone()).unwrap_or(&[]);
        if !self.intact[number].get_or_init(|| checksum(bytes) == entry.checksum) {
            return Err(Problem::malformed(
                format!(
                    "section {number} ({}) is damaged: its checksum",
                    kind_name(kind)
                ),
                format!("{:016x}", entry.checksum),
                format!("{:016x}", checksum(bytes)),
            ));
        }
        Ok((entry, place))
    }

    pub(super) fn flat<T: Pod + Send + Sync>(
        &self,
        kind: u32,
        field: u32,
    ) -> Result<Flat<T>, Problem> {
        let (entry, place) = self.section(kind, field)?;
        Flat::from_store(self.store.clone(), place).ok_or_else(|| {
            Problem::malformed(
                kind_name(kind),
                format!("records of {} bytes", size_of::<T>()),
                format!("{} bytes", entry.length),
            )
        })
    }
}
