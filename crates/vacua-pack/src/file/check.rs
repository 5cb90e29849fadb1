//! What a `.vacua` file must not get wrong: header, table, and the places of sub-meshes.

use vacua_io::{Problem, Source};

use super::*;
use crate::indices::{ALIGNMENT as INDEX_ALIGNMENT, PADDING};
use crate::layout::SubmeshHeader;
use crate::packed::PackedMesh;
use crate::partition::INDEX_BITS;
use crate::small::{Clusters, MAX_INDEX_BITS, Places, num_blocks};

/// Checks header and table.
pub(super) fn head(source: &Source) -> Result<(Header, Vec<Entry>), Problem> {
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
pub(super) fn submeshes(mesh: &PackedMesh) -> Result<(), Problem> {
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
                places = places_of(clusters, h, places, number)?;
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
fn places_of(
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
