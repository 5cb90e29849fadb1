//! Encoding straight into a file: sub-meshes go to the sections of the file as they are made, their
//! fields with them, so that neither input nor output is ever whole in memory.

use std::io::Write;
use std::path::Path;
use std::time::Instant;

use rayon::prelude::*;
use vacua_io::{IoError, Problem, write_atomically};
use vacua_volume::{Association, DataArray, UnstructuredMesh, dispatch_scalar};

use super::spool::Spool;
use super::write::{FieldHead, header_of, layout_of};
use super::*;
use crate::Variant;
use crate::delta::DeltaWriter;
use crate::encode::{
    EncodeError, EncodeObserver, EncodeOptions, EncodeProgress, EncodeReport, EncodeStage, Memory,
    Work, multi_leaf_boxes,
};
use crate::field::{FieldBytes, FieldPart, PackFieldError, cells_before};
use crate::ids::Ids;
use crate::indices::PADDING;
use crate::input::Input;
use crate::layout::SubmeshHeader;
use crate::packed::PackedBytes;
use crate::small::frame::{BLOCK, pack_blocks};
use crate::small::{Places, ValueBlock, bits};
use crate::spill::SpillFolder;
use crate::submesh::{EncodedSubmesh, LeafTotals};

/// What goes into the file, and how much memory that may take.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FileOptions {
    /// How to encode.
    pub encode: EncodeOptions,
    /// Whether the map from packed to original order is written, with which fields can be added and
    /// swapped later.
    pub keep_map: bool,
    /// At most so many cells' centres are in memory at a time, the others in temporary files beside
    /// the output; `None` for all. The file is the same, byte for byte.
    pub cells_in_memory: Option<usize>,
}

/// Bytes of the process, of buffers, and of what grows slower than the mesh.
const FIXED_BYTES: u64 = 96 << 20;
/// Bytes while a cell is split: its centre twice, while lists are loaded.
const SPLIT_BYTES: u64 = 24;
/// Bytes, by estimate, while sub-meshes are encoded, a thread: 65,536 vertices, about half a million
/// cells, and what has been made of those before.
const THREAD_BYTES: u64 = 128 << 20;

impl FileOptions {
    /// With at most so many bytes of memory, those of files that are mapped not counted: the system
    /// takes them back when it needs them.
    ///
    /// # Errors
    /// The least number of bytes with which the mesh can be encoded, if it is more.
    pub fn with_memory_budget(self, bytes: u64, mesh: &UnstructuredMesh) -> Result<Self, u64> {
        let threads = rayon::current_num_threads() as u64;
        let sets = threads * mesh.num_points() as u64 / 8;
        let least = FIXED_BYTES + threads * THREAD_BYTES + sets;
        let cells = bytes.saturating_sub(least) / SPLIT_BYTES;
        // Below this, temporary files would be rewritten more often than is reasonable.
        let needed = (mesh.num_cells() as u64).min(1 << 20);
        if cells < needed {
            return Err(least + SPLIT_BYTES * needed);
        }
        Ok(Self {
            cells_in_memory: (cells < mesh.num_cells() as u64).then_some(cells as usize),
            ..self
        })
    }
}

/// A field to be packed.
#[derive(Clone, Debug)]
pub struct FieldInput {
    /// Its name in the file.
    pub name: String,
    /// On points or cells of the original mesh.
    pub association: Association,
    /// One value a point or cell.
    pub values: DataArray,
    /// Its time step, and what it is a part of.
    pub label: FieldLabel,
}

/// What was written.
#[derive(Clone, Debug, PartialEq)]
pub struct FileReport {
    /// How encoding went.
    pub encode: EncodeReport,
    /// Number of cells by [`vacua_volume::CellType`]'s number.
    pub num_cells_by_type: [u64; 4],
    /// Vertices, replicated ones included.
    pub num_vertices: u64,
    /// Sub-meshes.
    pub num_submeshes: u64,
    /// Multi-leaves or multi-nodes.
    pub num_nodes: u64,
    /// Bytes of the mesh's parts.
    pub bytes: PackedBytes,
    /// Bytes of the fields, in their order.
    pub fields: Vec<FieldBytes>,
    /// Bytes of the map, if it was written.
    pub map_bytes: u64,
    /// Time to put the file together.
    pub write_secs: f64,
}

/// Why a mesh could not be encoded into a file.
#[derive(Debug, thiserror::Error)]
pub enum EncodeFileError {
    /// The mesh.
    #[error(transparent)]
    Encode(#[from] EncodeError),
    /// A field.
    #[error(transparent)]
    Field(#[from] PackFieldError),
    /// The file.
    #[error(transparent)]
    Io(#[from] IoError),
}

/// What a thread makes of a sub-mesh.
struct Made {
    submesh: EncodedSubmesh,
    fields: Vec<FieldBytesOfPart>,
}

/// A field's bytes on one sub-mesh, as they go to the sections.
struct FieldBytesOfPart {
    ends: [f64; 2],
    slots: Vec<[[u8; 2]; crate::layout::WIDTH]>,
    cells_before: Vec<u32>,
    /// In variant `small` within the frames.
    values: Vec<u8>,
    frames: Vec<ValueBlock>,
}

/// Encodes a mesh and fields on it into a file, which appears whole or stays as it was. The bytes
/// depend on the mesh, the fields, and what is asked to be in the file alone.
///
/// # Errors
/// [`EncodeFileError`].
pub fn encode_file(
    path: &Path,
    mesh: &UnstructuredMesh,
    fields: &[FieldInput],
    options: FileOptions,
    observer: EncodeObserver,
) -> Result<FileReport, EncodeFileError> {
    for field in fields {
        check_field(mesh, field)?;
    }
    let system = |source| {
        let action = "cannot write beside";
        Problem::System { action, source }.in_file(path)
    };
    let folder = SpillFolder::of(path);
    let heads: Vec<FieldHead> = fields.iter().map(FieldHead::of_input).collect();
    let layout = layout_of(options.encode.variant, options.keep_map, &heads);
    let mut writer = SectionWriter {
        options,
        place: layout.iter().map(|s| (s.kind, s.field)).collect(),
        spool: Spool::new(&folder, layout.len()).map_err(system)?,
        boxes: Vec::new(),
        next: SubmeshHeader::zeroed(),
        totals: LeafTotals::default(),
        counts: [0; 4],
        num_submeshes: 0,
        map: [DeltaWriter::default(), DeltaWriter::default()],
        places: Places::default(),
        value_bytes: vec![0; fields.len()],
    };
    let input = Input::new(mesh);
    let work = Work {
        options: options.encode,
        memory: match options.cells_in_memory {
            None => Memory::All,
            Some(most) => Memory::Cells(most, folder),
        },
        observer,
    };
    let finish = |submesh: EncodedSubmesh| pack_fields(submesh, fields);
    let append = |made: Made| {
        let appended = writer.append(made);
        appended.map_err(|e| EncodeFileError::Io(system(e)))
    };
    let mut report = work.encode_submeshes(&input, finish, append)?;
    report.totals = writer.totals;

    let start = Instant::now();
    let outer = work.outer_tree(std::mem::take(&mut writer.boxes).into_iter())?;
    report.outer_secs = start.elapsed().as_secs_f64();
    let start = Instant::now();
    writer.finish(&outer).map_err(system)?;
    let mut table = Vec::with_capacity(layout.len());
    for (number, section) in layout.iter().enumerate() {
        let (length, checksum) = match section.bytes {
            Some(bytes) => (bytes.len() as u64, checksum(bytes)),
            None => writer.spool.summary(number),
        };
        table.push(section.entry(length, checksum));
    }
    let header = header_of(options.encode, &mut table);
    write_atomically(path, |file| {
        let tell = |done| {
            let stage = EncodeStage::Write;
            let total = header.file_length;
            observer(EncodeProgress { stage, done, total });
        };
        file.write_all(bytemuck::bytes_of(&header))?;
        file.write_all(bytemuck::cast_slice(&table))?;
        let mut at = (size_of::<Header>() + size_of_val(table.as_slice())) as u64;
        for (number, entry) in table.iter().enumerate() {
            tell(at);
            file.write_all(&[0; ALIGNMENT as usize][..(entry.offset - at) as usize])?;
            match layout[number].bytes {
                Some(bytes) => file.write_all(bytes)?,
                None => writer.spool.copy(number, file)?,
            }
            at = entry.offset + entry.length;
        }
        tell(at);
        Ok(())
    })?;
    let length = |kind: u32, field: u32| -> u64 {
        let mut of_kind = table.iter().filter(|e| e.kind == kind && e.field == field);
        of_kind.next().map_or(0, |e| e.length)
    };
    let sum_of = |kinds: &[u32], field: u32| -> usize {
        kinds.iter().map(|&kind| length(kind, field) as usize).sum()
    };
    let nodes = node_kind(options.encode.variant);
    Ok(FileReport {
        encode: EncodeReport {
            totals: writer.totals,
            ..report
        },
        num_cells_by_type: writer.counts,
        num_vertices: writer.next.first_vertex,
        num_submeshes: writer.num_submeshes,
        num_nodes: writer.next.first_node,
        bytes: PackedBytes {
            positions: sum_of(&[POSITIONS, POSITION_FRAMES, FRAMED_POSITIONS], NO_FIELD),
            indices: sum_of(&[INDICES, CLUSTERS, CLUSTER_BITS], NO_FIELD),
            nodes: length(nodes, NO_FIELD) as usize,
            outer: length(OUTER, NO_FIELD) as usize,
            submeshes: length(SUBMESHES, NO_FIELD) as usize,
        },
        fields: (0..fields.len() as u32)
            .map(|f| FieldBytes {
                values: sum_of(&[VALUES, VALUE_FRAMES, FRAMED_VALUES], f),
                ranges: (length(SUBMESH_RANGES, f) + length(NODE_RANGES, f)) as usize,
                cells_before: length(CELLS_BEFORE, f) as usize,
            })
            .collect(),
        map_bytes: length(MAP_POINTS, NO_FIELD) + length(MAP_CELLS, NO_FIELD),
        write_secs: start.elapsed().as_secs_f64(),
    })
}

fn check_field(mesh: &UnstructuredMesh, field: &FieldInput) -> Result<(), PackFieldError> {
    if field.values.components() != 1 {
        return Err(PackFieldError::Components {
            name: field.name.clone(),
            components: field.values.components(),
        });
    }
    let needed = match field.association {
        Association::Point => mesh.num_points(),
        Association::Cell => mesh.num_cells(),
    };
    if field.values.tuples() < needed {
        return Err(PackFieldError::TooShort {
            name: field.name.clone(),
            association: field.association,
            actual: field.values.tuples(),
            needed: needed as u64 - 1,
        });
    }
    Ok(())
}

fn pack_fields(mut submesh: EncodedSubmesh, fields: &[FieldInput]) -> Made {
    submesh.indices.extend([0; PADDING]);
    if let Some(clusters) = &mut submesh.clusters {
        clusters.pad();
    }
    let view = submesh.view();
    let pack = |field: &FieldInput| {
        let ids: &Ids = match field.association {
            Association::Point => &submesh.points,
            Association::Cell => &submesh.cells,
        };
        dispatch_scalar!(field.values.scalar_type(), T => {
            let all: &[T] = bytemuck::cast_slice(field.values.bytes());
            let part = FieldPart::of(&view, field.association, ids.pick(0..ids.len(), all));
            let is_small = view.clusters.is_some();
            let (frames, values) = if is_small {
                pack_blocks(part.values.chunks(BLOCK))
            } else {
                (Vec::new(), bytemuck::allocation::pod_collect_to_vec(&part.values))
            };
            FieldBytesOfPart {
                ends: part.ends,
                slots: part.slots,
                cells_before: match field.association {
                    Association::Cell if !is_small => cells_before(&view),
                    _ => Vec::new(),
                },
                values,
                frames,
            }
        })
    };
    let fields = fields.par_iter().map(pack).collect();
    submesh.indices.truncate(submesh.indices.len() - PADDING);
    if let Some(clusters) = &mut submesh.clusters {
        clusters.unpad();
    }
    Made { submesh, fields }
}

/// Puts sub-meshes into sections.
struct SectionWriter {
    options: FileOptions,
    /// Kind and field of each section.
    place: Vec<(u32, u32)>,
    spool: Spool,
    /// Of the items of the outer tree.
    boxes: Vec<([f32; 3], [f32; 3])>,
    /// Where the next sub-mesh starts.
    next: SubmeshHeader,
    totals: LeafTotals,
    counts: [u64; 4],
    num_submeshes: u64,
    map: [DeltaWriter; 2],
    /// Where the next sub-mesh's clusters and positions start.
    places: Places,
    /// Bytes of the values of each field so far, where they are in frames.
    value_bytes: Vec<u64>,
}

impl SectionWriter {
    fn put(&mut self, kind: u32, field: u32, bytes: &[u8]) -> std::io::Result<()> {
        match self.place.iter().position(|&p| p == (kind, field)) {
            Some(section) => self.spool.append(section, bytes),
            None => Ok(()),
        }
    }

    fn append(&mut self, Made { submesh, fields }: Made) -> std::io::Result<()> {
        let mut header = submesh.header;
        header.first_vertex = self.next.first_vertex;
        header.first_index = self.next.first_index;
        header.first_node = self.next.first_node;
        header.first_cell = self.next.first_cell;
        let bits = u64::from(self.options.encode.index_bits);
        self.next.first_vertex += u64::from(header.num_vertices);
        self.next.first_index += match &submesh.clusters {
            None => submesh.indices.len() as u64 * 8 / bits,
            Some(clusters) => {
                self.places.put(&mut header);
                self.places = clusters.next_places(&header, self.places);
                clusters.headers.len() as u64
            }
        };
        self.next.first_node += u64::from(header.num_nodes);
        self.next.first_cell += submesh.cells.len() as u64;
        self.totals = self.totals.plus(submesh.num_primitives);
        for (sum, &n) in self.counts.iter_mut().zip(&header.num_cells) {
            *sum += u64::from(n);
        }
        self.num_submeshes += 1;
        match self.options.encode.variant {
            Variant::MultiLeaves => {
                let boxes = multi_leaf_boxes(&header, &submesh.multi_leaves);
                self.boxes.extend(boxes);
            }
            Variant::MultiNodes | Variant::Small => self.boxes.push((header.lo, header.hi)),
        }
        self.put(SUBMESHES, NO_FIELD, bytemuck::bytes_of(&header))?;
        let nodes: &[u8] = match self.options.encode.variant {
            Variant::MultiLeaves => bytemuck::cast_slice(&submesh.multi_leaves),
            Variant::MultiNodes | Variant::Small => bytemuck::cast_slice(&submesh.multi_nodes),
        };
        let kind = node_kind(self.options.encode.variant);
        self.put(kind, NO_FIELD, nodes)?;
        self.put(INDICES, NO_FIELD, &submesh.indices)?;
        let positions = bytemuck::cast_slice(&submesh.positions);
        self.put(POSITIONS, NO_FIELD, positions)?;
        if let Some(clusters) = &submesh.clusters {
            self.put(CLUSTERS, NO_FIELD, bytemuck::cast_slice(&clusters.headers))?;
            self.put(CLUSTER_BITS, NO_FIELD, &clusters.bits)?;
            let frames = bytemuck::cast_slice(&clusters.position_blocks);
            self.put(POSITION_FRAMES, NO_FIELD, frames)?;
            self.put(FRAMED_POSITIONS, NO_FIELD, &clusters.position_bits)?;
        }
        if self.options.keep_map {
            let lists = [(MAP_POINTS, &submesh.points), (MAP_CELLS, &submesh.cells)];
            for (which, (kind, ids)) in lists.into_iter().enumerate() {
                let mut bytes = Vec::new();
                self.map[which].append(ids, &mut bytes);
                self.put(kind, NO_FIELD, &bytes)?;
            }
        }
        for (number, field) in (0u32..).zip(&fields) {
            self.put(SUBMESH_RANGES, number, bytemuck::bytes_of(&field.ends))?;
            self.put(NODE_RANGES, number, bytemuck::cast_slice(&field.slots))?;
            let before = bytemuck::cast_slice(&field.cells_before);
            self.put(CELLS_BEFORE, number, before)?;
            if submesh.clusters.is_none() {
                self.put(VALUES, number, &field.values)?;
                continue;
            }
            let before = &mut self.value_bytes[number as usize];
            let frames: Vec<ValueBlock> = field.frames.iter().map(|f| f.moved(*before)).collect();
            *before += field.values.len() as u64;
            self.put(VALUE_FRAMES, number, bytemuck::cast_slice(&frames))?;
            self.put(FRAMED_VALUES, number, &field.values)?;
        }
        Ok(())
    }

    fn finish(&mut self, outer: &[crate::outer::OuterNode]) -> std::io::Result<()> {
        self.put(INDICES, NO_FIELD, &[0; PADDING])?;
        let padding = [0; bits::PADDING];
        self.put(CLUSTER_BITS, NO_FIELD, &padding)?;
        self.put(FRAMED_POSITIONS, NO_FIELD, &padding)?;
        for field in 0..self.value_bytes.len() as u32 {
            self.put(FRAMED_VALUES, field, &padding)?;
        }
        for (which, kind) in [MAP_POINTS, MAP_CELLS].into_iter().enumerate() {
            let mut bytes = Vec::new();
            self.map[which].flush(&mut bytes);
            self.put(kind, NO_FIELD, &bytes)?;
        }
        self.put(OUTER, NO_FIELD, bytemuck::cast_slice(outer))
    }
}
