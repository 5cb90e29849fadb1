//! What a `.vacua` file holds, from its table and the headers of its sub-meshes alone.

use glam::DVec3;
use vacua_io::{IoError, Problem};
use vacua_volume::{Bounds, ValueRange};

use super::*;
use crate::Variant;
use crate::field::FieldBytes;
use crate::layout::SubmeshHeader;
use crate::packed::PackedBytes;
use crate::section::Flat;

/// What a file holds.
#[derive(Clone, Debug, PartialEq)]
pub struct FileSummary {
    /// Which layout.
    pub variant: Variant,
    /// Bits of an index.
    pub index_bits: u32,
    /// Vertices, replicated ones included.
    pub num_vertices: u64,
    /// Number of cells by [`vacua_volume::CellType`]'s number.
    pub num_cells_by_type: [u64; 4],
    /// Number of sub-meshes.
    pub num_submeshes: u64,
    /// Multi-leaves or multi-nodes.
    pub num_nodes: u64,
    /// The box around all cells; `None` without any.
    pub bounds: Option<Bounds>,
    /// Bytes of the mesh's parts.
    pub bytes: PackedBytes,
    /// Bytes of the map from packed to original order; 0 without.
    pub map_bytes: u64,
    /// The fields.
    pub fields: Vec<FieldSummary>,
}

/// What a file holds of a field.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldSummary {
    /// Name, association, type.
    pub entry: FieldEntry,
    /// Range of the finite values of all cells; `None` without any.
    pub range: Option<ValueRange>,
    /// Bytes of its parts.
    pub bytes: FieldBytes,
}

impl PackedFile {
    /// What the file holds.
    ///
    /// # Errors
    /// [`IoError`] if a section that this needs is missing or damaged.
    ///
    /// # Cost
    /// That of the headers and ranges of sub-meshes: a few hundred bytes for each 65,536 vertices.
    pub fn summary(&self) -> Result<FileSummary, IoError> {
        self.summarise().map_err(|p| p.in_file(&self.path))
    }

    fn summarise(&self) -> Result<FileSummary, Problem> {
        let variant = self.variant();
        let (nodes, node_bytes) = match variant {
            Variant::MultiLeaves => (MULTI_LEAVES, size_of::<crate::layout::MultiLeaf>()),
            _ => (MULTI_NODES, size_of::<crate::layout::MultiNode>()),
        };
        let length = |kind, field| -> Result<usize, Problem> {
            Ok(self.find(kind, field)?.1.length as usize)
        };
        let submeshes: Flat<SubmeshHeader> = self.flat(SUBMESHES, NO_FIELD)?;
        let mut cells = [0u64; 4];
        let mut bounds: Option<Bounds> = None;
        for header in submeshes.as_slice() {
            for (sum, &n) in cells.iter_mut().zip(&header.num_cells) {
                *sum = sum.saturating_add(u64::from(n));
            }
            let corner = |c: [f32; 3]| {
                DVec3::from_array([0, 1, 2].map(|i| header.origin[i] + f64::from(c[i])))
            };
            let of_header = Bounds::of_points([corner(header.lo), corner(header.hi)]);
            bounds = match (bounds, of_header) {
                (Some(a), Some(b)) => Bounds::of_points([a.lo, a.hi, b.lo, b.hi]),
                (a, b) => a.or(b),
            };
        }
        let (positions, indices) = match variant {
            Variant::Small => (
                length(POSITION_FRAMES, NO_FIELD)? + length(FRAMED_POSITIONS, NO_FIELD)?,
                length(CLUSTERS, NO_FIELD)? + length(CLUSTER_BITS, NO_FIELD)?,
            ),
            _ => (length(POSITIONS, NO_FIELD)?, length(INDICES, NO_FIELD)?),
        };
        let bytes = PackedBytes {
            positions,
            indices,
            nodes: length(nodes, NO_FIELD)?,
            outer: length(OUTER, NO_FIELD)?,
            submeshes: length(SUBMESHES, NO_FIELD)?,
        };
        let names = self.table.iter().filter(|e| e.kind == NAME);
        let fields = names.map(|e| self.summarise_field(e.field));
        Ok(FileSummary {
            variant,
            index_bits: self.header.index_bits,
            num_vertices: submeshes
                .as_slice()
                .iter()
                .map(|h| u64::from(h.num_vertices))
                .sum(),
            num_cells_by_type: cells,
            num_submeshes: submeshes.as_slice().len() as u64,
            num_nodes: (bytes.nodes / node_bytes) as u64,
            bounds,
            bytes,
            map_bytes: [MAP_POINTS, MAP_CELLS]
                .iter()
                .map(|&kind| length(kind, NO_FIELD).unwrap_or(0) as u64)
                .sum(),
            fields: fields.collect::<Result<_, _>>()?,
        })
    }

    fn summarise_field(&self, number: u32) -> Result<FieldSummary, Problem> {
        let ranges: Flat<[f64; 2]> = self.flat(SUBMESH_RANGES, number)?;
        let range = ranges
            .as_slice()
            .iter()
            .filter(|[lo, hi]| lo <= hi)
            .map(|&[lo, hi]| ValueRange { lo, hi })
            .reduce(ValueRange::union);
        let length = |kind| self.find(kind, number).map(|(_, e)| e.length as usize);
        Ok(FieldSummary {
            entry: self.field_entry(number)?,
            range,
            bytes: FieldBytes {
                values: match self.variant() {
                    Variant::Small => length(VALUE_FRAMES)? + length(FRAMED_VALUES)?,
                    _ => length(VALUES)?,
                },
                ranges: length(SUBMESH_RANGES)? + length(NODE_RANGES)?,
                cells_before: length(CELLS_BEFORE).unwrap_or(0),
            },
        })
    }
}
