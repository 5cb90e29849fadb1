//! Reading a `.vacua` file where it is mapped.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use bytemuck::Pod;
use vacua_io::{IoError, Problem, Source};
use vacua_volume::{Association, ByteStore, DataArray, ScalarType};

use super::*;
use crate::Variant;
use crate::delta;
use crate::encode::PackMap;
use crate::field::PackedField;
use crate::indices::{ALIGNMENT as INDEX_ALIGNMENT, PADDING};
use crate::layout::SubmeshHeader;
use crate::packed::{Nodes, PackedMesh};
use crate::partition::INDEX_BITS;
use crate::section::Flat;
use crate::small::{Clusters, FramedValues, MAX_INDEX_BITS, Places, num_blocks};

/// The file's bytes as the arrays over them share them.
struct FileBytes(Source);

impl ByteStore for FileBytes {
    fn bytes(&self) -> &[u8] {
        self.0.bytes()
    }
}

/// What the table says of a field.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldEntry {
    /// Its name.
    pub name: String,
    /// On points or on cells.
    pub association: Association,
    /// Type of a value.
    pub scalar_type: ScalarType,
    /// The time step it is of, in files with several.
    pub step: Option<FieldStep>,
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
        match check(&source) {
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
            check_submeshes(&mesh)?;
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
        check_submeshes(&mesh)?;
        Ok(mesh)
    }

    /// What fields there are.
    ///
    /// # Errors
    /// [`IoError`] if a field's name or values are missing or their description is not understood.
    pub fn fields(&self) -> Result<Vec<FieldEntry>, IoError> {
        let numbers = self.table.iter().filter(|e| e.kind == NAME);
        numbers
            .map(|e| self.field_entry(e.field))
            .collect::<Result<_, _>>()
            .map_err(|p| p.in_file(&self.path))
    }

    pub(super) fn field_entry(&self, field: u32) -> Result<FieldEntry, Problem> {
        let (name, place) = self.section(NAME, field)?;
        let values = self.find_values(field)?;
        let bytes = self.store.bytes().get(place).unwrap_or(&[]);
        let bad_name =
            |_| Problem::malformed(format!("name of field {field}"), "UTF-8", "other bytes");
        let association = match name.detail {
            0 => Association::Point,
            1 => Association::Cell,
            other => {
                let place = format!("association of field {field}");
                return Err(Problem::malformed(
                    place,
                    "0 (points) or 1 (cells)",
                    other.to_string(),
                ));
            }
        };
        let scalar_type = *ScalarType::ALL
            .get(values.1.detail as usize)
            .ok_or_else(|| {
                let place = format!("number type of field {field}");
                Problem::malformed(place, "0 to 9", values.1.detail.to_string())
            })?;
        Ok(FieldEntry {
            name: std::str::from_utf8(bytes).map_err(bad_name)?.to_owned(),
            association,
            scalar_type,
            step: self.step_of(field)?,
        })
    }

    fn step_of(&self, field: u32) -> Result<Option<FieldStep>, Problem> {
        if self.find(STEP, field).is_err() {
            return Ok(None);
        }
        let (entry, place) = self.section(STEP, field)?;
        let bytes = self.store.bytes().get(place).unwrap_or(&[]);
        let time: [u8; 8] = bytes.try_into().map_err(|_| {
            let place = format!("time step of field {field}");
            Problem::malformed(place, "8 bytes", bytes.len().to_string())
        })?;
        Ok(Some(FieldStep {
            number: entry.detail,
            time: f64::from_le_bytes(time),
        }))
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
        let list = |kind: u32, len: u64| {
            let (_, place) = self.section(kind, NO_FIELD)?;
            let bytes = self.store.bytes().get(place).unwrap_or(&[]);
            let len = usize::try_from(len).unwrap_or(usize::MAX);
            delta::decode(kind_name(kind), bytes, len)
        };
        Ok(Some(PackMap {
            points: list(MAP_POINTS, mesh.num_vertices() as u64)?,
            cells: list(MAP_CELLS, mesh.num_cells())?,
        }))
    }

    /// One field, by its place in [`Self::fields`], for the mesh of this file. Its arrays stay in the
    /// file.
    ///
    /// # Errors
    /// [`IoError`] if there is no such field, or a section of it is missing, damaged, or does not fit
    /// the mesh.
    pub fn field(&self, mesh: &PackedMesh, field: usize) -> Result<PackedField, IoError> {
        self.read_field(mesh, field)
            .map_err(|p| p.in_file(&self.path))
    }

    fn read_field(&self, mesh: &PackedMesh, field: usize) -> Result<PackedField, Problem> {
        let mut numbers = self.table.iter().filter(|e| e.kind == NAME);
        let number = numbers.nth(field).map(|e| e.field).ok_or_else(|| {
            Problem::malformed(format!("field {field}"), "a field", "fewer fields")
        })?;
        let entry = self.field_entry(number)?;
        let what = |part: &str| format!("{part} of field `{}`", entry.name);
        let expect = |part: &str, expected: u64, actual: usize| {
            if expected == actual as u64 {
                return Ok(());
            }
            Err(Problem::malformed(
                what(part),
                expected.to_string(),
                actual.to_string(),
            ))
        };
        let (values, framed) = match mesh.clusters() {
            None => {
                let (_, place) = self.section(VALUES, number)?;
                let size = entry.scalar_type.size_bytes();
                let tuples = place.len() / size;
                expect("bytes of values", (tuples * size) as u64, place.len())?;
                let (store, offset) = (self.store.clone(), place.start);
                let values = DataArray::from_store(store, offset, entry.scalar_type, 1, tuples)?;
                let needed = match entry.association {
                    Association::Point => mesh.num_vertices() as u64,
                    Association::Cell => mesh.num_cells(),
                };
                expect("number of values", needed, tuples)?;
                (values, None)
            }
            Some(_) => {
                let framed = FramedValues::new(
                    entry.scalar_type,
                    self.flat(VALUE_FRAMES, number)?,
                    self.flat(FRAMED_VALUES, number)?,
                );
                let needed = mesh
                    .submeshes()
                    .iter()
                    .map(|header| match entry.association {
                        Association::Point => num_blocks(u64::from(header.num_vertices)),
                        Association::Cell => num_blocks(header.total_cells()),
                    });
                let needed = needed.fold(0, u64::saturating_add);
                expect("number of frames of values", needed, framed.num_blocks())?;
                (framed.no_values()?, Some(framed))
            }
        };
        let field = PackedField {
            submesh_ranges: self.flat(SUBMESH_RANGES, number)?,
            node_ranges: self.flat(NODE_RANGES, number)?,
            cells_before: match entry.association {
                _ if framed.is_some() => None,
                Association::Point => None,
                Association::Cell => Some(self.flat(CELLS_BEFORE, number)?),
            },
            name: entry.name.clone(),
            association: entry.association,
            values,
            framed,
        };
        let num_nodes = mesh.nodes().len() as u64;
        let submeshes = field.submesh_ranges.as_slice().len();
        expect(
            "number of ranges of sub-meshes",
            mesh.submeshes().len() as u64,
            submeshes,
        )?;
        expect(
            "number of ranges of nodes",
            num_nodes,
            field.node_ranges.as_slice().len(),
        )?;
        if let Some(before) = &field.cells_before {
            expect("number of nodes", num_nodes, before.as_slice().len())?;
        }
        Ok(field)
    }

    /// The section of a field's values, in frames or not.
    fn find_values(&self, field: u32) -> Result<(usize, &Entry), Problem> {
        match self.variant() {
            Variant::Small => self.find(FRAMED_VALUES, field),
            _ => self.find(VALUES, field),
        }
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

/// Checks header and table.
fn check(source: &Source) -> Result<(Header, Vec<Entry>), Problem> {
    let available = source.len() as u64;
    if !source.bytes().starts_with(&MAGIC) {
        let found = format!("{:02x?}", &source.bytes()[..source.len().min(8)]);
        return Err(Problem::malformed(
            "byte 0",
            "the mark of a .vacua file",
            found,
        ));
    }
    let header: Header =
        bytemuck::pod_read_unaligned(source.piece("the header", 0, size_of::<Header>())?);
    if header.major > MAJOR {
        return Err(Problem::Unsupported {
            what: format!(
                "version {}.{} of the .vacua format",
                header.major, header.minor
            ),
            hint: Some(format!(
                "this program reads up to {MAJOR}; a newer one wrote the file, use that or update"
            )),
        });
    }
    let sum = |place: &str, expected: u64, actual: u64| {
        if expected == actual {
            return Ok(());
        }
        let place = format!("{place} is damaged: its checksum");
        Err(Problem::malformed(
            place,
            format!("{expected:016x}"),
            format!("{actual:016x}"),
        ))
    };
    sum("the header", header.header_checksum, header.checksum())?;
    if header.file_length > available {
        return Err(Problem::Truncated {
            what: "the file".to_owned(),
            from: 0,
            to: header.file_length,
            len: available,
        });
    }
    let is_small = header.variant == 3;
    if !(1..=3).contains(&header.variant)
        || !INDEX_BITS.contains(&header.index_bits)
        || is_small && header.index_bits > MAX_INDEX_BITS
    {
        let found = format!("{} and {}", header.variant, header.index_bits);
        return Err(Problem::malformed(
            "bytes 32 to 40",
            "variant 1 or 2 and 8 to 32 bits, or variant 3 and 8 to 24",
            found,
        ));
    }
    let table_bytes = (header.num_sections as usize).saturating_mul(size_of::<Entry>());
    let bytes = source.piece("the table of sections", size_of::<Header>(), table_bytes)?;
    sum(
        "the table of sections",
        header.table_checksum,
        checksum(bytes),
    )?;
    let table: Vec<Entry> = bytemuck::pod_collect_to_vec(bytes);
    for (number, entry) in table.iter().enumerate() {
        let end = entry.offset.checked_add(entry.length);
        let fits = end.is_some_and(|end| end <= header.file_length);
        if !fits || !entry.offset.is_multiple_of(ALIGNMENT) {
            return Err(Problem::malformed(
                format!("section {number} ({})", kind_name(entry.kind)),
                format!(
                    "a place at a multiple of {ALIGNMENT} within {} bytes",
                    header.file_length
                ),
                format!("{} bytes at {}", entry.length, entry.offset),
            ));
        }
    }
    Ok((header, table))
}

/// Checks that sub-meshes follow each other within the common arrays.
fn check_submeshes(mesh: &PackedMesh) -> Result<(), Problem> {
    let bits = u64::from(mesh.index_bits);
    let index_bytes = mesh.indices.num_bytes().saturating_sub(PADDING) as u64;
    let ends = match mesh.clusters() {
        None => [
            mesh.positions().len() as u64,
            index_bytes.saturating_mul(8) / bits,
            mesh.nodes().len() as u64,
        ],
        // Blocks of positions bound the vertices, below.
        Some(clusters) => [u64::MAX, clusters.len() as u64, mesh.nodes().len() as u64],
    };
    let mut places = Places::default();
    let mut next = [0u64; 3];
    let mut next_cell = 0u64;
    for (number, h) in mesh.submeshes().iter().enumerate() {
        let first = [h.first_vertex, h.first_index, h.first_node];
        let filled = match mesh.clusters() {
            None => h.num_indices.checked_next_multiple_of(INDEX_ALIGNMENT),
            Some(clusters) => {
                places = check_places(clusters, h, places, number)?;
                Some(h.num_indices)
            }
        };
        let length = [
            u64::from(h.num_vertices),
            filled.unwrap_or(u64::MAX),
            u64::from(h.num_nodes),
        ];
        let names = match mesh.clusters() {
            None => ["vertex", "index", "node"],
            Some(_) => ["vertex", "cluster", "node"],
        };
        for (part, name) in names.into_iter().enumerate() {
            let end = next[part].saturating_add(length[part]);
            if first[part] != next[part] || end > ends[part] {
                return Err(Problem::malformed(
                    format!("sub-mesh {number}"),
                    format!("{name} {} to at most {}", next[part], ends[part]),
                    format!("{} from {}", length[part], first[part]),
                ));
            }
            next[part] = end;
        }
        let finite = [h.origin, h.grid_base]
            .iter()
            .flatten()
            .all(|c| c.is_finite());
        if h.first_cell != next_cell || !finite || !has_grid(h) {
            let found = format!(
                "cell {}, {:?}, {:?}",
                h.first_cell, h.grid_base, h.grid_exponent
            );
            let expected = format!("cell {next_cell} and a finite grid");
            return Err(Problem::malformed(
                format!("sub-mesh {number}"),
                expected,
                found,
            ));
        }
        next_cell = next_cell.saturating_add(h.total_cells());
    }
    Ok(())
}

/// Checks that a sub-mesh's bits and blocks follow those of the one before it; gives the least places
/// of the next.
fn check_places(
    clusters: &Clusters,
    header: &SubmeshHeader,
    least: Places,
    number: usize,
) -> Result<Places, Problem> {
    let found = Places::of(header);
    let ends = Places {
        first_byte: clusters.bits.num_bytes() as u64,
        first_block: clusters.position_blocks.as_slice().len() as u64,
        first_position_byte: clusters.position_bits.num_bytes() as u64,
        first_cell_block: u32::MAX,
    };
    let next_cell_block =
        u64::from(found.first_cell_block).saturating_add(num_blocks(header.total_cells()));
    let next_block = found
        .first_block
        .saturating_add(num_blocks(u64::from(header.num_vertices)));
    let fits = (least.first_byte..=ends.first_byte).contains(&found.first_byte)
        && (least.first_position_byte..=ends.first_position_byte)
            .contains(&found.first_position_byte)
        && found.first_block == least.first_block
        && found.first_cell_block == least.first_cell_block
        && next_block <= ends.first_block;
    if !fits {
        return Err(Problem::malformed(
            format!("sub-mesh {number}"),
            format!("places from {least:?} to at most {ends:?}"),
            format!("{found:?} and {} vertices", header.num_vertices),
        ));
    }
    Ok(Places {
        first_block: next_block,
        first_cell_block: u32::try_from(next_cell_block).unwrap_or(u32::MAX),
        ..found
    })
}

fn has_grid(header: &SubmeshHeader) -> bool {
    header
        .grid_exponent
        .iter()
        .all(|e| (-126..=127).contains(e))
}
