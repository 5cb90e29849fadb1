//! Writing a `.vacua` file, whole or not at all.

use std::io::Write;
use std::path::Path;

use rayon::prelude::*;
use vacua_io::{IoError, write_atomically};
use vacua_volume::{Association, ScalarType};

use super::*;
use crate::Variant;
use crate::field::PackedField;
use crate::packed::{Nodes, PackedMesh};

/// A section to be.
struct Section<'a> {
    kind: u32,
    field: u32,
    detail: u32,
    bytes: &'a [u8],
}

/// Writes a mesh and fields on it. The file appears whole, or stays as it was.
///
/// # Errors
/// [`IoError`] if the folder cannot be written.
pub fn write_file(path: &Path, mesh: &PackedMesh, fields: &[PackedField]) -> Result<(), IoError> {
    let sections = sections_of(mesh, fields);
    let mut offset = (size_of::<Header>() + sections.len() * size_of::<Entry>()) as u64;
    let sums: Vec<u64> = sections.par_iter().map(|s| checksum(s.bytes)).collect();
    let mut table = Vec::with_capacity(sections.len());
    for (section, sum) in sections.iter().zip(sums) {
        offset = offset.next_multiple_of(ALIGNMENT);
        table.push(Entry {
            kind: section.kind,
            field: section.field,
            offset,
            length: section.bytes.len() as u64,
            checksum: sum,
            detail: section.detail,
            reserved: [0; 7],
        });
        offset += section.bytes.len() as u64;
    }
    let mut header = Header {
        magic: MAGIC,
        major: MAJOR,
        minor: MINOR,
        num_sections: table.len() as u32,
        file_length: offset,
        table_checksum: checksum(bytemuck::cast_slice(&table)),
        variant: match mesh.variant {
            Variant::MultiLeaves => 1,
            Variant::MultiNodes => 2,
        },
        index_bits: mesh.index_bits,
        reserved: [0; 2],
        header_checksum: 0,
    };
    header.header_checksum = header.checksum();
    write_atomically(path, |file| {
        file.write_all(bytemuck::bytes_of(&header))?;
        file.write_all(bytemuck::cast_slice(&table))?;
        let mut at = (size_of::<Header>() + size_of_val(table.as_slice())) as u64;
        for (entry, section) in table.iter().zip(&sections) {
            let gap = (entry.offset - at) as usize;
            file.write_all(&[0; ALIGNMENT as usize][..gap])?;
            file.write_all(section.bytes)?;
            at = entry.offset + entry.length;
        }
        Ok(())
    })
}

fn sections_of<'a>(mesh: &'a PackedMesh, fields: &'a [PackedField]) -> Vec<Section<'a>> {
    let nodes = match mesh.nodes {
        Nodes::MultiLeaves(_) => MULTI_LEAVES,
        Nodes::MultiNodes(_) => MULTI_NODES,
    };
    let parts = [
        (SUBMESHES, mesh.submeshes.bytes()),
        (OUTER, mesh.outer.bytes()),
        (nodes, mesh.nodes.bytes()),
        (INDICES, mesh.indices.bytes()),
        (POSITIONS, mesh.positions.bytes()),
    ];
    let mut sections: Vec<Section> = parts
        .into_iter()
        .map(|(kind, bytes)| Section {
            kind,
            field: NO_FIELD,
            detail: 0,
            bytes,
        })
        .collect();
    for (number, field) in (0u32..).zip(fields) {
        let mut add = |kind: u32, detail: u32, bytes: &'a [u8]| {
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
        let number_type = field.values.scalar_type();
        let place = ScalarType::ALL.iter().position(|&t| t == number_type);
        add(NAME, association, field.name.as_bytes());
        add(SUBMESH_RANGES, 0, field.submesh_ranges.bytes());
        add(NODE_RANGES, 0, field.node_ranges.bytes());
        if let Some(before) = &field.cells_before {
            add(CELLS_BEFORE, 0, before.bytes());
        }
        add(VALUES, place.unwrap_or(0) as u32, field.values.bytes());
    }
    sections
}
