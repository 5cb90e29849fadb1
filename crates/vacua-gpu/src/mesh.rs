//! A packed mesh on the device, as it lies in its file (paper B §4 and §5).
//!
//! Positions, indices, nodes and values are sent byte for byte; what is made for the device is where
//! the parts of each sub-mesh begin, 128 bytes a sub-mesh. Shaders follow addresses, so that a section
//! may be of any size: sections are split between sub-meshes where a device wants smaller buffers.
//! Values of wide types become the `f32` that rendering computes with.

use std::ops::Range;
use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;
use vacua_pack::layout::SubmeshHeader;
use vacua_pack::{Nodes, PackedMesh, Variant};
use vacua_render::SceneData;
use vacua_render::contract::PackedCells;
use vacua_skip::{Lattice, LatticeError, Macrocells};
use vacua_volume::{Association, ScalarType, ValueMap, ValueRange, ValueScale};

use crate::error::GpuError;
use crate::reference::{FaceShapes, Held, MIXED};
use crate::renderer::MeshStructure;
use crate::send::{Section, Sender};
use crate::vulkan::{Buffer, Commands, Device, Layout};

/// Side of macrocells whose ranges those of larger ones are joined from.
const LEAST_SIDE: usize = 2;

/// Bits of an index that shaders know.
const INDEX_BITS: u32 = 16;

/// Coordinates up to which shaders compute; beyond, products could overflow.
const LARGEST: f32 = 1e30;

/// Numbers of the constants that pipelines of meshes are specialised by, besides those of all.
pub(crate) mod mesh_constant {
    pub const VALUE_TYPE: u32 = 32;
    pub const INNER_NODES: u32 = 33;
    pub const VARYING: u32 = 34;
    pub const TOGETHER: u32 = 35;
    pub const HAS_TETS: u32 = 36;
    pub const HAS_OTHERS: u32 = 37;
    pub const HELD: u32 = 38;
    pub const ONLY_KIND: u32 = 39;
    pub const LANES: u32 = 40;
    pub const SUBGROUPS: u32 = 41;
    pub const INVOCATIONS: u32 = 42;
    pub const PLACES: u32 = 43;
}

/// What a sub-mesh holds, as bits; as in `mesh.glsl`.
pub(crate) mod kinds {
    /// Indices that fill cells up.
    pub const MARKER: u32 = 1;
    /// Other cells than tetrahedra.
    pub const OTHERS: u32 = 2;
}

/// Sub-meshes in a group that has a box of its own; as in `mesh.glsl`.
pub(crate) const GROUP_PARTS: usize = 32;

/// Nodes that wait while a subgroup searches, and quads of words of its beam; as in `mesh_search.glsl`.
pub(crate) const STACK: u32 = 128;
pub(crate) const BEAM_QUADS: u32 = 6;

/// A sub-mesh as shaders see it: `Submesh` of `mesh.glsl`, which says what each member means.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct DeviceSubmesh {
    pub lo: [f32; 4],
    pub hi: [f32; 4],
    pub base: [f32; 4],
    pub sixteenths: [f32; 4],
    pub nodes: u64,
    pub positions: u64,
    pub indices: u64,
    pub values: u64,
    pub cells_before: u64,
    pub first_value: u32,
    pub num_nodes: u32,
    pub num_vertices: u32,
    pub num_indices: u32,
    pub kinds: u32,
    pub first_node: u32,
}

/// A mesh as shaders see it: the block `Mesh` of `mesh.glsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct MeshHeader {
    pub corner: [f32; 4],
    pub slack: [f32; 4],
    pub submeshes: u64,
    pub minima: u64,
    pub groups: u64,
    pub links: u64,
    pub sides: u64,
    pub num_submeshes: u32,
    pub minima_x: u32,
    pub minima_y: u32,
    pub minima_z: u32,
    pub overflow: u32,
    pub damage: u32,
}

/// How values lie on the device; numbers as in `mesh.glsl`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ValueType {
    F32 = 0,
    U8 = 1,
    I8 = 2,
    U16 = 3,
    I16 = 4,
}

impl ValueType {
    fn bytes(self) -> u64 {
        match self {
            Self::F32 => 4,
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
        }
    }
}

/// Bytes of every part of a mesh on the device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MeshBytes {
    /// Positions of vertices.
    pub positions: u64,
    /// Indices of cells.
    pub indices: u64,
    /// Multi-nodes.
    pub nodes: u64,
    /// Faces and neighbours of tetrahedra, in the encodings that have them.
    pub links: u64,
    /// Values, and where those of each node's cells begin.
    pub values: u64,
    /// Where the parts of sub-meshes begin, and the smallest cells in boxes of space.
    pub tables: u64,
    /// Acceleration structures, as large as the driver says.
    pub structures: u64,
}

impl MeshBytes {
    /// The sum.
    pub fn total(&self) -> u64 {
        let of_cells = self.indices + self.nodes + self.links;
        self.positions + of_cells + self.values + self.tables + self.structures
    }
}

/// A mesh on the device, and what of it the host keeps.
pub(crate) struct DeviceMesh {
    pub data: SceneData,
    pub scale: ValueScale,
    pub cells: PackedCells,
    pub map: ValueMap,
    /// Range of the finite values; `None` if there are none.
    pub range: Option<ValueRange>,
    pub value_type: ValueType,
    pub header: Buffer,
    pub bytes: MeshBytes,
    /// How its cells are held.
    pub held: Held,
    /// The kind of all cells of a plain list, or of all but tetrahedra of packed ones.
    pub only_kind: u32,
    /// Faces that its acceleration structure is to be built over, if it is over faces.
    pub faces: Option<FaceShapes>,
    /// What rays are traced against to find its cells, where that is how they are found.
    pub structure: Option<MeshStructure>,
    /// Ranges of the smallest macrocells so far.
    pub ranges: Option<Macrocells>,
    /// Seconds to send and check it.
    pub send_secs: f64,
    /// Everything that the header leads to.
    pub _parts: Vec<Buffer>,
}

/// The smallest cells in boxes of space, on the device.
pub(crate) struct Minima {
    counts: [u32; 3],
    pub buffer: Option<Buffer>,
}

impl Minima {
    /// Sends those of a mesh whose cells vary in size.
    pub fn send(sender: &mut Sender<'_>, cells: &PackedCells) -> Result<Self, GpuError> {
        let Some(levels @ [(counts, _), ..]) = cells.minima().map(|m| m.levels()) else {
            return Ok(Self {
                counts: [0; 3],
                buffer: None,
            });
        };
        let all = levels.iter().flat_map(|(_, sizes)| sizes);
        let all: Vec<f32> = all.copied().collect();
        let sent = sender.send_whole("the mesh's cell sizes", bytemuck::cast_slice(&all))?;
        Ok(Self {
            counts: counts.map(|n| n as u32),
            buffer: Some(sent),
        })
    }

    pub fn size_bytes(&self) -> u64 {
        self.buffer.as_ref().map_or(0, Buffer::size_bytes)
    }

    /// A header that says where they are, and where the mesh is.
    pub fn header(&self, cells: &PackedCells) -> MeshHeader {
        let [x, y, z] = cells.corner();
        MeshHeader {
            corner: [x, y, z, cells.cube()],
            slack: slack(cells),
            minima: self.buffer.as_ref().map_or(0, Buffer::address),
            minima_x: self.counts[0],
            minima_y: self.counts[1],
            minima_z: self.counts[2],
            ..MeshHeader::default()
        }
    }
}

/// How values of a scene are rendered: their range, and the map from stored ones.
pub(crate) fn range_and_map(data: &SceneData, scale: ValueScale) -> (Option<ValueRange>, ValueMap) {
    let scalars = data.scalars();
    let range = scalars.range(0);
    let map = match (scale, range) {
        (ValueScale::Linear, Some(range)) => ValueMap::for_range(scalars.scalar_type(), range),
        _ => ValueMap::IDENTITY,
    };
    (range, map)
}

impl DeviceMesh {
    /// Sends a mesh to the device, for transfer functions of one scale; no buffer takes more than
    /// `max_bytes` unless a sub-mesh alone does.
    pub fn new(
        device: &Arc<Device>,
        commands: &mut Commands,
        layout: &Layout,
        data: SceneData,
        scale: ValueScale,
        cells: PackedCells,
        max_bytes: u64,
    ) -> Result<Self, GpuError> {
        check(device, cells.mesh())?;
        let (range, map) = range_and_map(&data, scale);
        let (mesh, field) = (cells.mesh(), cells.field());
        let value_type = match (map.is_identity(), field.values().scalar_type()) {
            (true, ScalarType::U8) => ValueType::U8,
            (true, ScalarType::I8) => ValueType::I8,
            (true, ScalarType::U16) => ValueType::U16,
            (true, ScalarType::I16) => ValueType::I16,
            _ => ValueType::F32,
        };
        let is_as_stored = map.is_identity()
            && (value_type != ValueType::F32 || field.values().scalar_type() == ScalarType::F32);
        let needed = mesh.bytes().total() as u64
            + field.values().tuples() as u64 * value_type.bytes()
            + field.bytes().cells_before as u64;
        if needed > device.free_bytes() {
            return Err(device.too_little("the mesh", needed));
        }
        let mut sender = Sender::new(device, commands, layout, max_bytes)?;
        let headers = mesh.submeshes();
        let parts = |of: &dyn Fn(&SubmeshHeader) -> Range<u64>| -> Vec<Range<u64>> {
            headers.iter().map(of).collect()
        };
        let vertices =
            |h: &SubmeshHeader| h.first_vertex..h.first_vertex + u64::from(h.num_vertices);
        let times = |r: Range<u64>, bytes: u64| r.start * bytes..r.end * bytes;
        let positions = sender.send_bytes(
            "the mesh's positions",
            bytemuck::cast_slice(mesh.positions()),
            &parts(&|h| times(vertices(h), 12)),
        )?;
        let indices = sender.send_bytes(
            "the mesh's indices",
            mesh.indices().bytes(),
            &parts(&|h| times(h.first_index..h.first_index + h.num_indices, 2)),
        )?;
        let node_bytes = match mesh.nodes() {
            Nodes::MultiLeaves(_) => 48,
            Nodes::MultiNodes(_) => 52,
        };
        let nodes = sender.send_bytes(
            "the mesh's nodes",
            mesh.nodes().bytes(),
            &parts(&|h| times(h.nodes(), node_bytes)),
        )?;
        let size = value_type.bytes();
        let of_values = |h: &SubmeshHeader| match field.association() {
            Association::Point => vertices(h),
            Association::Cell => h.first_cell..h.first_cell + h.total_cells(),
        };
        // From a multiple of four on, as shaders read words.
        let value_parts = parts(&|h| {
            let part = times(of_values(h), size);
            part.start / 4 * 4..part.end
        });
        let values = if is_as_stored {
            sender.send_bytes("the mesh's values", field.values().bytes(), &value_parts)?
        } else {
            let len = 4 * field.values().tuples() as u64;
            sender.send("the mesh's values", len, &value_parts, |first, to| {
                const CHUNK: usize = 1 << 18;
                let chunks = to.par_chunks_mut(4 * CHUNK).enumerate();
                chunks.for_each(|(i, to)| {
                    let first = first as usize / 4 + i * CHUNK;
                    for (k, to) in to.chunks_exact_mut(4).enumerate() {
                        let value = map.rendered(field.values().get_f64(first + k, 0));
                        to.copy_from_slice(&value.to_le_bytes());
                    }
                });
            })?
        };
        let cells_before = match field.cells_before() {
            Some(before) => Some(sender.send_bytes(
                "the mesh's cells",
                bytemuck::cast_slice(before),
                &parts(&|h| times(h.nodes(), 4)),
            )?),
            None => None,
        };
        let table: Vec<DeviceSubmesh> = headers
            .iter()
            .map(|h| {
                let first_value = of_values(h).start * size;
                DeviceSubmesh {
                    lo: extended(h.lo),
                    hi: extended(h.hi),
                    base: extended(h.grid_base.map(|b| b as f32)),
                    sixteenths: extended(h.grid_exponent.map(|e| f64::from(4 - e).exp2() as f32)),
                    nodes: nodes.address(h.first_node * node_bytes),
                    positions: positions.address(12 * h.first_vertex),
                    indices: indices.address(2 * h.first_index),
                    values: values.address(first_value / 4 * 4),
                    cells_before: cells_before
                        .as_ref()
                        .map_or(0, |s| s.address(4 * h.first_node)),
                    first_value: (first_value % 4 / size) as u32,
                    num_nodes: h.num_nodes,
                    num_vertices: h.num_vertices,
                    num_indices: h.num_indices as u32,
                    kinds: kinds_of(h),
                    first_node: h.first_node as u32,
                }
            })
            .collect();
        let groups: Vec<[[f32; 4]; 2]> = headers.chunks(GROUP_PARTS).map(box_around).collect();
        let groups = sender.send_whole("the mesh's groups", bytemuck::cast_slice(&groups))?;
        let table = sender.send_whole("the mesh's parts", bytemuck::cast_slice(&table))?;
        let minima = Minima::send(&mut sender, &cells)?;
        let header = MeshHeader {
            submeshes: table.address(),
            groups: groups.address(),
            num_submeshes: headers.len() as u32,
            ..minima.header(&cells)
        };
        let header = sender.send_whole("the mesh", bytemuck::bytes_of(&header))?;
        let bytes = MeshBytes {
            positions: positions.size_bytes(),
            indices: indices.size_bytes(),
            nodes: nodes.size_bytes(),
            values: values.size_bytes() + cells_before.as_ref().map_or(0, Section::size_bytes),
            tables: table.size_bytes()
                + groups.size_bytes()
                + header.size_bytes()
                + minima.size_bytes(),
            ..MeshBytes::default()
        };
        let sections = [
            Some(positions),
            Some(indices),
            Some(nodes),
            Some(values),
            cells_before,
        ];
        let mut all: Vec<Buffer> = sections
            .into_iter()
            .flatten()
            .flat_map(Section::into_buffers)
            .collect();
        all.extend([table, groups]);
        all.extend(minima.buffer);
        Ok(Self {
            scale,
            map,
            range,
            value_type,
            header,
            bytes,
            held: Held::Packed,
            only_kind: only_kind(cells.mesh()),
            faces: None,
            structure: None,
            ranges: None,
            send_secs: 0.0,
            _parts: all,
            cells,
            data,
        })
    }

    /// Whether its nodes are multi-leaves alone (variant 1).
    pub fn is_of_leaves(&self) -> bool {
        self.held == Held::Packed && matches!(self.cells.mesh().nodes(), Nodes::MultiLeaves(_))
    }

    /// Whether rays are traced to find its cells.
    pub fn is_traced(&self) -> bool {
        self.is_of_leaves() || self.held != Held::Packed
    }

    /// Ranges of macrocells. They are found from all leaves once; those of multiples of that side are
    /// joined from them, and the same.
    pub fn macrocells(&mut self, lattice: &Lattice) -> Result<Macrocells, LatticeError> {
        let side = lattice.side();
        let base = match self.ranges.take() {
            Some(ranges) if side.is_multiple_of(ranges.lattice().side()) => ranges,
            _ => {
                let least = if side.is_multiple_of(LEAST_SIDE) {
                    LEAST_SIDE
                } else {
                    side
                };
                let lattice = Lattice::new(self.cells.space.axes.clone(), least)?;
                self.cells.macrocells(lattice, self.map)
            }
        };
        let ranges = base.coarser(side / base.lattice().side());
        self.ranges = Some(base);
        ranges
    }
}

/// The kind of all cells but tetrahedra, if there is one.
fn only_kind(mesh: &PackedMesh) -> u32 {
    let [_, others @ ..] = mesh.num_cells_by_type();
    let mut kinds = (1..).zip(others).filter(|&(_, n)| n > 0);
    match (kinds.next(), kinds.next()) {
        (Some((kind, _)), None) => kind,
        _ => MIXED,
    }
}

/// What a sub-mesh holds.
fn kinds_of(header: &SubmeshHeader) -> u32 {
    let has_others = header.num_cells[1..].iter().any(|&n| n > 0);
    let marker = if header.has_marker() {
        kinds::MARKER
    } else {
        0
    };
    let others = if has_others { kinds::OTHERS } else { 0 };
    marker | others
}

/// The box around some sub-meshes.
pub(crate) fn box_around(headers: &[SubmeshHeader]) -> [[f32; 4]; 2] {
    let none = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
    let around = headers.iter().fold(none, |[lo, hi], h| {
        [
            [0, 1, 2].map(|a| lo[a].min(h.lo[a])),
            [0, 1, 2].map(|a| hi[a].max(h.hi[a])),
        ]
    });
    around.map(extended)
}

pub(crate) fn extended([x, y, z]: [f32; 3]) -> [f32; 4] {
    [x, y, z, 0.0]
}

/// What rounding can move a computed place by along each axis, and a power of two that makes the
/// mesh about 1 in size.
fn slack(cells: &PackedCells) -> [f32; 4] {
    let (mut slack, mut extent) = ([0.0f32; 3], 0.0f32);
    for (a, slack) in slack.iter_mut().enumerate() {
        let headers = cells.mesh().submeshes().iter();
        let (lo, hi) = headers.fold((f32::INFINITY, f32::NEG_INFINITY), |(lo, hi), h| {
            (lo.min(h.lo[a]), hi.max(h.hi[a]))
        });
        extent = extent.max(hi - lo);
        let farthest = lo.abs().max(hi.abs()) + cells.corner()[a].abs() + cells.cube();
        *slack = farthest * 2f32.powi(-22);
    }
    let exponent = if extent > 0.0 {
        (-extent.log2().ceil()).clamp(-100.0, 100.0)
    } else {
        0.0
    };
    [slack[0], slack[1], slack[2], exponent.exp2()]
}

/// Whether shaders can follow the mesh.
fn check(device: &Arc<Device>, mesh: &PackedMesh) -> Result<(), GpuError> {
    let unsupported = |what: String| {
        Err(GpuError::Unsupported {
            what,
            device: device.name().to_owned(),
        })
    };
    // Clusters are decoded whole, into a cache that shaders do not have.
    if mesh.variant() == Variant::Small {
        return unsupported("a mesh of variant small".to_owned());
    }
    if mesh.index_bits() != INDEX_BITS {
        return unsupported(format!("a mesh with indices of {} bits", mesh.index_bits()));
    }
    let origin = mesh.origin();
    // Shaders find the sub-mesh of a node by its number.
    if !mesh.submeshes().is_sorted_by_key(|h| h.first_node) {
        return unsupported("a mesh whose nodes are not in the order of its sub-meshes".to_owned());
    }
    for (number, h) in mesh.submeshes().iter().enumerate() {
        if mesh.submesh(number).is_none() {
            return unsupported(format!("sub-mesh {number}, whose parts are not all there,"));
        }
        let is_tame = (0..3).all(|a| {
            h.origin[a] == origin[a]
                && f64::from(h.grid_base[a] as f32) == h.grid_base[a]
                && h.lo[a] >= -LARGEST
                && h.hi[a] <= LARGEST
        });
        if !is_tame || h.num_indices >= 1 << 31 {
            return unsupported(format!("a mesh with coordinates as of sub-mesh {number}"));
        }
    }
    Ok(())
}
