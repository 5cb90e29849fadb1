//! The `.vacua` file: a packed mesh and fields on it, as they lie in memory.
//!
//! Everything is little-endian. A header, a table of sections, sections at multiples of 64 bytes:
//! flat arrays that are used where they are mapped. Checksums are XXH3-64.
//!
//! ```text
//! byte   0  magic            8 bytes  89 56 41 43 55 41 0D 0A   "\x89VACUA\r\n"
//!        8  major            u16      a reader refuses a larger one
//!       10  minor            u16      a reader may ignore a larger one
//!       12  num_sections     u32
//!       16  file_length      u64      bytes
//!       24  table_checksum   u64      of the table
//!       32  variant          u32      1, 2, or 3 for `small`
//!       36  index_bits       u32      8 to 32; to 24 in `small`
//!       40  reserved         16 bytes zero
//!       56  header_checksum  u64      of bytes 0 to 56
//!       64  table            num_sections × 64 bytes
//!
//! a section in the table:
//! byte   0  kind             u32      see below
//!        4  field            u32      which field it belongs to; 0xFFFFFFFF for the mesh
//!        8  offset           u64      from the start of the file, a multiple of 64
//!       16  length           u64      bytes
//!       24  checksum         u64      of the section
//!       32  detail           u32      values: number type, in the order u8 i8 u16 … f32 f64;
//!                                     name: 0 for a field on points, 1 on cells
//!       36  reserved         28 bytes zero
//!
//! kind   1  sub-mesh headers     176 bytes each      16  name of a field, UTF-8
//!        2  multi-leaves          48                  17  values
//!        3  multi-nodes           52                  18  ranges of sub-meshes, 16 bytes each
//!        4  outer nodes           96                  19  ranges of nodes, 16 bytes each
//!        5  positions             12                  20  cells before a node, u32 each
//!        6  indices, 8 zero bytes at the end          21  time of the field's step, f64;
//!        7  original number of each vertex                detail: number of the step
//!        8  original number of each cell              22  name of the vector field that the
//!                                                         field is a part of, UTF-8; detail:
//!                                                         number of the component, from 0, or
//!                                                         0xFFFFFFFF for the magnitude
//! ```
//!
//! A field with several components is a field for each, and one for the magnitude, whose kinds 22 name it.
//!
//! Kinds 7 and 8, the map with which fields are added later, are optional: lists of numbers in blocks
//! of 128, each with the bits it needs, differences where those are smaller:
//!
//! ```text
//! byte 0  bits a number takes, 0 to 56; 128 more if they are differences
//!      1  base   u64   the smallest number; with differences, the first
//!      9  so many bits for each number, lowest first, filled up to a whole byte:
//!         the number less the base; or, from the second on, the difference to the one before,
//!         doubled, or for a negative one doubled and inverted (zigzag)
//! ```
//!
//! Instead of 5, 6, 17 and 20 a file of variant `small`, whose arrays [`crate::small`] describes, has
//!
//! ```text
//! kind  32  headers of clusters   16 bytes each      36  frames of values, 16 bytes each
//!       33  bits of clusters                         37  values in frames; detail as of 17
//!       34  frames of positions   24
//!       35  positions in frames;  16 zero bytes at the end of 33, 35 and 37
//! ```
//!
//! Sections of kinds that a reader does not know it leaves alone. Opening checks the header and the
//! table, reading the mesh or a field checks its sections.

mod check;
mod fields;
mod read;
mod spool;
mod stream;
mod summary;
#[cfg(test)]
mod tests;
mod update;
mod write;

use bytemuck::{Pod, Zeroable};

pub use fields::{FieldEntry, FieldGroup};
pub use read::PackedFile;
pub use stream::{EncodeFileError, FieldInput, FileOptions, FileReport, encode_file};
pub use summary::{FieldSummary, FileSummary};
pub use update::{UpdateError, UpdateReport};
pub use write::{write_file, write_file_with};

use crate::Variant;

const MAGIC: [u8; 8] = *b"\x89VACUA\r\n";
/// Layouts that this version reads, and writes.
const MAJOR: u16 = 1;
const MINOR: u16 = 0;
/// Where sections may start.
const ALIGNMENT: u64 = 64;
/// The field of sections that belong to the mesh.
const NO_FIELD: u32 = u32::MAX;

const SUBMESHES: u32 = 1;
const MULTI_LEAVES: u32 = 2;
const MULTI_NODES: u32 = 3;
const OUTER: u32 = 4;
const POSITIONS: u32 = 5;
const INDICES: u32 = 6;
const MAP_POINTS: u32 = 7;
const MAP_CELLS: u32 = 8;
const NAME: u32 = 16;
const VALUES: u32 = 17;
const SUBMESH_RANGES: u32 = 18;
const NODE_RANGES: u32 = 19;
const CELLS_BEFORE: u32 = 20;
const STEP: u32 = 21;
const VECTOR: u32 = 22;
const CLUSTERS: u32 = 32;
const CLUSTER_BITS: u32 = 33;
const POSITION_FRAMES: u32 = 34;
const FRAMED_POSITIONS: u32 = 35;
const VALUE_FRAMES: u32 = 36;
const FRAMED_VALUES: u32 = 37;

/// The time step that a field is of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldStep {
    /// Its number, from 0.
    pub number: u32,
    /// Its time; the number where the input has no times.
    pub time: f64,
}

/// Which part of a field with several components a packed field is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum VectorComponent {
    /// One component, from 0.
    Index(u32),
    /// The Euclidean length.
    Magnitude,
}

impl VectorComponent {
    /// The number in the file.
    fn detail(self) -> u32 {
        match self {
            Self::Index(index) => index,
            Self::Magnitude => u32::MAX,
        }
    }

    fn of_detail(detail: u32) -> Self {
        match detail {
            u32::MAX => Self::Magnitude,
            index => Self::Index(index),
        }
    }
}

/// The field with several components that a packed field is a part of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VectorPart {
    /// Name of the whole.
    pub name: String,
    /// Which part.
    pub component: VectorComponent,
}

/// What is said of a field beside its name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FieldLabel {
    /// Its time step, if there are several.
    pub step: Option<FieldStep>,
    /// What it is a part of, if it is.
    pub vector: Option<VectorPart>,
}

/// The kind of a variant's nodes.
fn node_kind(variant: Variant) -> u32 {
    match variant {
        Variant::MultiLeaves => MULTI_LEAVES,
        Variant::MultiNodes | Variant::Small => MULTI_NODES,
    }
}

/// Whether bytes begin as a `.vacua` file does.
pub fn is_packed(bytes: &[u8]) -> bool {
    bytes.starts_with(&MAGIC)
}

fn kind_name(kind: u32) -> &'static str {
    match kind {
        SUBMESHES => "sub-mesh headers",
        MULTI_LEAVES => "multi-leaves",
        MULTI_NODES => "multi-nodes",
        OUTER => "outer nodes",
        POSITIONS => "positions",
        INDICES => "indices",
        MAP_POINTS => "map of vertices",
        MAP_CELLS => "map of cells",
        STEP => "time step",
        VECTOR => "name of a vector",
        NAME => "field name",
        VALUES => "values",
        SUBMESH_RANGES => "ranges of sub-meshes",
        NODE_RANGES => "ranges of nodes",
        CELLS_BEFORE => "cells before nodes",
        CLUSTERS => "headers of clusters",
        CLUSTER_BITS => "bits of clusters",
        POSITION_FRAMES => "frames of positions",
        FRAMED_POSITIONS => "positions in frames",
        VALUE_FRAMES => "frames of values",
        FRAMED_VALUES => "values in frames",
        _ => "a section of unknown kind",
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
struct Header {
    magic: [u8; 8],
    major: u16,
    minor: u16,
    num_sections: u32,
    file_length: u64,
    table_checksum: u64,
    variant: u32,
    index_bits: u32,
    reserved: [u64; 2],
    header_checksum: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
struct Entry {
    kind: u32,
    field: u32,
    offset: u64,
    length: u64,
    checksum: u64,
    detail: u32,
    reserved: [u32; 7],
}

const _: () = {
    assert!(size_of::<Header>() == 64);
    assert!(std::mem::offset_of!(Header, header_checksum) == 56);
    assert!(size_of::<Entry>() == 64);
    assert!(
        cfg!(target_endian = "little"),
        "arrays are used as they lie in the file"
    );
};

impl Header {
    fn checksum(&self) -> u64 {
        let bytes = bytemuck::bytes_of(self);
        checksum(&bytes[..std::mem::offset_of!(Header, header_checksum)])
    }
}

fn checksum(bytes: &[u8]) -> u64 {
    twox_hash::XxHash3_64::oneshot(bytes)
}

/// Puts right checksums on a file whose bytes were changed, as a hostile file has them: for tests of
/// what comes after the checksums. What is no file stays as it is.
pub fn seal(bytes: &mut [u8]) {
    let head = size_of::<Header>();
    let Some(header) = bytes.get(..head) else {
        return;
    };
    let mut header: Header = bytemuck::pod_read_unaligned(header);
    let table_bytes = (header.num_sections as usize).saturating_mul(size_of::<Entry>());
    let end = head.saturating_add(table_bytes);
    let Some(table) = bytes.get(head..end) else {
        return;
    };
    let mut table: Vec<Entry> = bytemuck::pod_collect_to_vec(table);
    for entry in &mut table {
        let place = usize::try_from(entry.offset)
            .ok()
            .zip(usize::try_from(entry.length).ok())
            .and_then(|(offset, length)| bytes.get(offset..offset.checked_add(length)?));
        entry.checksum = place.map_or(0, checksum);
    }
    bytes[head..end].copy_from_slice(bytemuck::cast_slice(&table));
    header.table_checksum = checksum(&bytes[head..end]);
    header.header_checksum = header.checksum();
    bytes[..head].copy_from_slice(bytemuck::bytes_of(&header));
}
