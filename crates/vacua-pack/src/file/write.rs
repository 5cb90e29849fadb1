//! Writing a `.vacua` file, whole or not at all.

use std::io::Write;
use std::path::Path;

use rayon::prelude::*;
use vacua_io::{IoError, write_atomically};
use vacua_volume::{Association, ScalarType};

use super::stream::FieldInput;
use super::*;
use crate::Variant;
use crate::delta::DeltaWriter;
use crate::encode::{EncodeOptions, PackMap};
use crate::field::PackedField;
use crate::ids::Ids;
use crate::packed::PackedMesh;

/// A section to be.
pub(super) struct Section<'a> {
    pub kind: u32,
    pub field: u32,
    pub detail: u32,
    /// Its bytes, where they are known before any sub-mesh is.
    pub bytes: Option<&'a [u8]>,
}

impl Section<'_> {
    /// Its entry in the table, but for its place.
    pub fn entry(&self, length: u64, checksum: u64) -> Entry {
        Entry {
            kind: self.kind,
            field: self.field,
            offset: 0,
            length,
            checksum,
            detail: self.detail,
            reserved: [0; 7],
        }
    }
}

/// What the table says of a field.
pub(super) struct FieldHead<'a> {
    name: &'a str,
    association: Association,
    scalar_type: ScalarType,
    step: Option<(u32, [u8; 8])>,
    vector: Option<&'a VectorPart>,
}

impl<'a> FieldHead<'a> {
    fn new(
        name: &'a str,
        association: Association,
        scalar_type: ScalarType,
        label: &'a FieldLabel,
    ) -> Self {
        Self {
            name,
            association,
            scalar_type,
            step: label.step.map(|s| (s.number, s.time.to_le_bytes())),
            vector: label.vector.as_ref(),
        }
    }

    /// Of a field that is still to be packed.
    pub fn of_input(field: &'a FieldInput) -> Self {
        let scalar_type = field.values.scalar_type();
        Self::new(&field.name, field.association, scalar_type, &field.label)
    }

    /// Of a field that stays in the file.
    pub fn of_entry(entry: &'a FieldEntry) -> Self {
        let (association, scalar_type) = (entry.association, entry.scalar_type);
        Self::new(&entry.name, association, scalar_type, &entry.label)
    }

    /// Of a packed field.
    pub fn of_packed(field: &'a PackedField, label: &'a FieldLabel) -> Self {
        let scalar_type = field.values.scalar_type();
        Self::new(&field.name, field.association, scalar_type, label)
    }
}

/// The sections of a file in their order.
pub(super) fn layout_of<'a>(
    variant: Variant,
    has_map: bool,
    fields: &'a [FieldHead<'a>],
) -> Vec<Section<'a>> {
    let maps: &[u32] = if has_map {
        &[MAP_POINTS, MAP_CELLS]
    } else {
        &[]
    };
    let mut parts = vec![SUBMESHES, OUTER, node_kind(variant)];
    let is_small = variant == Variant::Small;
    if is_small {
        parts.extend([CLUSTERS, CLUSTER_BITS, POSITION_FRAMES, FRAMED_POSITIONS]);
    } else {
        parts.extend([INDICES, POSITIONS]);
    }
    let mut sections: Vec<Section> = parts
        .iter()
        .chain(maps)
        .map(|&kind| Section {
            kind,
            field: NO_FIELD,
            detail: 0,
            bytes: None,
        })
        .collect();
    for (number, field) in (0u32..).zip(fields) {
        let mut add = |kind: u32, detail: u32, bytes: Option<&'a [u8]>| {
            sections.push(Section {
                kind,
                field: number,
                detail,
                bytes,
            });
        };
        let association = match field.association {
            Association::Point => 0,
            Association::Cell => 1,
        };
        let place = ScalarType::ALL.iter().position(|&t| t == field.scalar_type);
        add(NAME, association, Some(field.name.as_bytes()));
        if let Some((step, time)) = &field.step {
            add(STEP, *step, Some(time));
        }
        if let Some(vector) = field.vector {
            let component = vector.component.detail();
            add(VECTOR, component, Some(vector.name.as_bytes()));
        }
        add(SUBMESH_RANGES, 0, None);
        add(NODE_RANGES, 0, None);
        let detail = place.unwrap_or(0) as u32;
        if is_small {
            add(VALUE_FRAMES, 0, None);
            add(FRAMED_VALUES, detail, None);
            continue;
        }
        if field.association == Association::Cell {
            add(CELLS_BEFORE, 0, None);
        }
        add(VALUES, detail, None);
    }
    sections
}

/// Gives sections their places, and the header over them.
pub(super) fn header_of(options: EncodeOptions, table: &mut [Entry]) -> Header {
    let mut offset = (size_of::<Header>() + size_of_val(table)) as u64;
    for entry in table.iter_mut() {
        entry.offset = offset.next_multiple_of(ALIGNMENT);
        offset = entry.offset + entry.length;
    }
    let mut header = Header {
        magic: MAGIC,
        major: MAJOR,
        minor: MINOR,
        num_sections: table.len() as u32,
        file_length: offset,
        table_checksum: checksum(bytemuck::cast_slice(table)),
        variant: match options.variant {
            Variant::MultiLeaves => 1,
            Variant::MultiNodes => 2,
            Variant::Small => 3,
        },
        index_bits: options.index_bits,
        reserved: [0; 2],
        header_checksum: 0,
    };
    header.header_checksum = header.checksum();
    header
}

/// Writes a mesh and fields on it. The file appears whole, or stays as it was.
///
/// # Errors
/// [`IoError`] if the folder cannot be written.
pub fn write_file(path: &Path, mesh: &PackedMesh, fields: &[PackedField]) -> Result<(), IoError> {
    let unlabelled = |f: &PackedField| (f.clone(), FieldLabel::default());
    let fields: Vec<_> = fields.iter().map(unlabelled).collect();
    write_file_with(path, mesh, None, &fields)
}

/// As [`write_file`], with the map from packed to original order, and with labels of fields. The
/// file may be the one that mesh and fields are mapped from.
///
/// # Errors
/// [`IoError`] if the folder cannot be written.
pub fn write_file_with(
    path: &Path,
    mesh: &PackedMesh,
    map: Option<&PackMap>,
    fields: &[(PackedField, FieldLabel)],
) -> Result<(), IoError> {
    let heads: Vec<FieldHead> = fields
        .iter()
        .map(|(field, label)| FieldHead::of_packed(field, label))
        .collect();
    let layout = layout_of(mesh.variant, map.is_some(), &heads);
    let encoded = map.map(|map| [&map.points, &map.cells].map(encode_ids));
    let bytes_of = |section: &Section| -> &[u8] {
        let field = || fields.get(section.field as usize).map(|(field, _)| field);
        let of_map = |which: usize| encoded.as_ref().map_or(&[][..], |e| &e[which]);
        let of_clusters = |which: usize| {
            mesh.clusters()
                .map_or(&[][..], |clusters| clusters.bytes()[which])
        };
        match section.kind {
            SUBMESHES => mesh.submeshes.bytes(),
            OUTER => mesh.outer.bytes(),
            MULTI_LEAVES | MULTI_NODES => mesh.nodes.bytes(),
            INDICES => mesh.indices.bytes(),
            POSITIONS => mesh.positions.bytes(),
            MAP_POINTS => of_map(0),
            MAP_CELLS => of_map(1),
            CLUSTERS => of_clusters(0),
            CLUSTER_BITS => of_clusters(1),
            POSITION_FRAMES => of_clusters(2),
            FRAMED_POSITIONS => of_clusters(3),
            kind => field().map_or(&[][..], |field| section_bytes(kind, field)),
        }
    };
    let pieces: Vec<&[u8]> = layout
        .iter()
        .map(|section| section.bytes.unwrap_or_else(|| bytes_of(section)))
        .collect();
    let sums: Vec<u64> = pieces.par_iter().map(|bytes| checksum(bytes)).collect();
    let mut table: Vec<Entry> = layout
        .iter()
        .zip(&pieces)
        .zip(sums)
        .map(|((section, bytes), sum)| section.entry(bytes.len() as u64, sum))
        .collect();
    let options = EncodeOptions {
        variant: mesh.variant,
        index_bits: mesh.index_bits,
    };
    let header = header_of(options, &mut table);
    write_atomically(path, |file| write_sections(file, &header, &table, &pieces))
}

/// Writes header, table and sections.
pub(super) fn write_sections(
    file: &mut impl Write,
    header: &Header,
    table: &[Entry],
    pieces: &[&[u8]],
) -> std::io::Result<()> {
    file.write_all(bytemuck::bytes_of(header))?;
    file.write_all(bytemuck::cast_slice(table))?;
    let mut at = (size_of::<Header>() + size_of_val(table)) as u64;
    for (entry, bytes) in table.iter().zip(pieces) {
        let gap = (entry.offset - at) as usize;
        file.write_all(&[0; ALIGNMENT as usize][..gap])?;
        file.write_all(bytes)?;
        at = entry.offset + entry.length;
    }
    Ok(())
}

/// The bytes of a section of a field.
pub(super) fn section_bytes(kind: u32, field: &PackedField) -> &[u8] {
    match kind {
        SUBMESH_RANGES => field.submesh_ranges.bytes(),
        NODE_RANGES => field.node_ranges.bytes(),
        CELLS_BEFORE => field.cells_before.as_ref().map_or(&[], |c| c.bytes()),
        VALUE_FRAMES => field.framed.as_ref().map_or(&[], |v| v.blocks.bytes()),
        FRAMED_VALUES => field.framed.as_ref().map_or(&[], |v| v.bits.bytes()),
        _ => field.values.bytes(),
    }
}

fn encode_ids(ids: &Ids) -> Vec<u8> {
    let (mut writer, mut out) = (DeltaWriter::default(), Vec::new());
    writer.append(ids, &mut out);
    writer.flush(&mut out);
    out
}
