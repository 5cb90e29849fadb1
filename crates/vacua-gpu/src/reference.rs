//! Meshes on the device in the encodings that the packed one is compared with (paper B §6.1.1 and §6.3):
//! plain lists of cells with indices of 32 bits, whose cells rays find in an acceleration structure, and
//! tetrahedra that know their faces or their neighbours.
//!
//! | encoding | lists | rays are traced against |
//! |---|---|---|
//! | user geometry | corners; four bytes more a cell where kinds are mixed | a box a cell |
//! | shared faces | corners, faces of tetrahedra, tetrahedra of faces | every face |
//! | tet marching | corners, neighbours, tetrahedra of the boundary's faces | faces of the boundary |
//!
//! Cells are numbered as they are packed and their arithmetic is that of packed ones, so that pictures
//! are the same.

use std::sync::Arc;

use vacua_pack::reference::{Cells, Faces, Neighbours, ReferenceError};
use vacua_render::SceneData;
use vacua_render::contract::PackedCells;
use vacua_volume::{CellType, ValueScale};

use crate::error::GpuError;
use crate::mesh::{
    DeviceMesh, DeviceSubmesh, MeshBytes, MeshHeader, Minima, ValueType, box_around, kinds,
    range_and_map,
};
use crate::send::{Section, Sender};
use crate::vulkan::{Buffer, Commands, Device, Layout, Shapes};

/// Kinds of cells are mixed; as in `mesh.glsl`.
pub(crate) const MIXED: u32 = 4;

/// An encoding that the packed one is compared with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MeshEncoding {
    /// A box a cell in an acceleration structure; an intersection shader tries the cell.
    UserGeometry,
    /// Faces with the tetrahedra on their sides, all in an acceleration structure; tetrahedra only.
    SharedFaces,
    /// Tetrahedra with their neighbours, through which rays march; tetrahedra only.
    TetMarch,
}

impl MeshEncoding {
    /// Its name, as in the paper.
    pub const fn name(self) -> &'static str {
        match self {
            Self::UserGeometry => "user geometry",
            Self::SharedFaces => "shared faces",
            Self::TetMarch => "tet marching",
        }
    }
}

/// A mesh in such an encoding.
#[derive(Clone, Debug)]
pub struct MeshReference {
    /// The encoding.
    pub encoding: MeshEncoding,
    /// Its cells, as they are packed.
    pub cells: Arc<Cells>,
}

/// How a mesh's cells are held; numbers as in `mesh.glsl`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Held {
    Packed = 0,
    InBoxes = 1,
    ByFaces = 2,
    ByNeighbours = 3,
}

/// Faces that an acceleration structure is built over, until it is.
pub(crate) struct FaceShapes {
    pub shapes: Shapes,
    /// Their vertices.
    _vertices: Buffer,
}

/// What tetrahedra know of each other, on its way to the device: words by four of tetrahedra, words
/// of faces, and the vertices of faces.
struct Links {
    of_tets: Vec<[u32; 4]>,
    of_faces: Vec<u32>,
    vertices: Vec<[u32; 3]>,
}

impl Links {
    fn new(encoding: MeshEncoding, cells: &Cells) -> Result<Option<Self>, ReferenceError> {
        let name = encoding.name();
        Ok(match encoding {
            MeshEncoding::UserGeometry => None,
            MeshEncoding::SharedFaces => {
                let faces = Faces::new(cells, name)?;
                Some(Self {
                    of_tets: faces.faces_of,
                    of_faces: faces.sides.into_flattened(),
                    vertices: faces.vertices,
                })
            }
            MeshEncoding::TetMarch => {
                let found = Neighbours::new(cells, name)?;
                let faces = (0..found.boundary.len()).map(|i| found.boundary_face(cells, i));
                let (of_faces, vertices) = faces.unzip();
                Some(Self {
                    of_tets: found.neighbours,
                    of_faces,
                    vertices,
                })
            }
        })
    }
}

/// The kind of all cells, or where each one's indices begin, by four, and its kind.
fn starts(cells: &Cells) -> Result<(u32, Vec<u32>), ReferenceError> {
    const LARGEST: usize = 1 << 30;
    let all = cells.cells();
    let first = all.first().map_or(CellType::Tetrahedron, |c| c.cell_type);
    if all.iter().all(|c| c.cell_type == first) {
        return Ok((first as u32, Vec::new()));
    }
    let mut next = 0usize;
    let starts = all.iter().map(|cell| {
        next += cell.corners().len();
        ((next - cell.corners().len()) as u32) << 2 | cell.cell_type as u32
    });
    let starts = starts.collect();
    if next > LARGEST {
        return Err(ReferenceError::TooMany {
            what: "indices",
            actual: next as u64,
            largest: LARGEST as u64,
        });
    }
    Ok((MIXED, starts))
}

impl DeviceMesh {
    /// Sends a mesh to the device in another encoding.
    pub fn of_reference(
        device: &Arc<Device>,
        commands: &mut Commands,
        layout: &Layout,
        (data, scale): (SceneData, ValueScale),
        cells: PackedCells,
        reference: &MeshReference,
    ) -> Result<Self, GpuError> {
        let MeshReference {
            encoding,
            cells: list,
        } = reference;
        let unsupported = |what: &str| GpuError::Unsupported {
            what: format!("a mesh as {} with {what}", encoding.name()),
            device: device.name().to_owned(),
        };
        let num_cells = list.cells().len();
        if num_cells as u64 != cells.mesh().num_cells() {
            return Err(GpuError::Reference(ReferenceError::Mismatch {
                what: "the list of cells",
                actual: num_cells as u64,
                expected: cells.mesh().num_cells(),
            }));
        }
        let (range, map) = range_and_map(&data, scale);
        if !map.is_identity() {
            return Err(unsupported("values that are mapped"));
        }
        let (only_kind, starts) = starts(list)?;
        let links = Links::new(*encoding, list)?;
        let corners = list
            .cells()
            .iter()
            .flat_map(|c| c.corners().iter().copied());
        let corners: Vec<u32> = corners.collect();
        let positions: Vec<[f32; 3]> = list
            .vertices()
            .iter()
            .map(|&[x, y, z, _]| [x, y, z])
            .collect();
        let values: Vec<f32> = list.vertices().iter().map(|v| v[3]).collect();
        let of_links = links.as_ref().map_or(0, |l| {
            size_of_val(&l.of_tets[..])
                + size_of_val(&l.of_faces[..])
                + size_of_val(&l.vertices[..])
        });
        let needed = 16 * values.len() + 4 * (corners.len() + starts.len()) + of_links;
        if needed as u64 > device.free_bytes() {
            return Err(device.too_little("the mesh", needed as u64));
        }
        // Lists of a reference are never split.
        let mut sender = Sender::new(device, commands, layout, u64::MAX)?;
        let positions = whole(&mut sender, "the mesh's positions", &positions)?;
        let indices = whole(&mut sender, "the mesh's indices", &corners)?;
        let starts = whole(&mut sender, "the mesh's cells", &starts)?;
        let values = whole(&mut sender, "the mesh's values", &values)?;
        let (of_tets, of_faces, of_triangles): (&[_], &[_], &[_]) = match &links {
            Some(links) => (&links.of_tets, &links.of_faces, &links.vertices),
            None => (&[], &[], &[]),
        };
        let of_tets = whole(&mut sender, "the mesh's links", of_tets)?;
        let of_faces = whole(&mut sender, "the mesh's faces", of_faces)?;
        let num_vertices = list.vertices().len() as u32;
        let faces = match of_triangles {
            [] => None,
            triangles => {
                let bytes = bytemuck::cast_slice(triangles);
                let buffer = sender.send_whole("the mesh's faces", bytes)?;
                Some(FaceShapes {
                    shapes: Shapes::Faces {
                        vertices: positions.address(0),
                        num_vertices,
                        indices: buffer.address(),
                        num: triangles.len() as u32,
                    },
                    _vertices: buffer,
                })
            }
        };
        let [lo, hi] = box_around(cells.mesh().submeshes());
        let has_others = only_kind != CellType::Tetrahedron as u32;
        let table = DeviceSubmesh {
            lo,
            hi,
            positions: positions.address(0),
            indices: indices.address(0),
            values: values.address(0),
            cells_before: starts.address(0),
            num_nodes: num_cells as u32,
            num_vertices,
            num_indices: corners.len() as u32,
            kinds: if has_others { kinds::OTHERS } else { 0 },
            ..DeviceSubmesh::default()
        };
        let table = sender.send_whole("the mesh's parts", bytemuck::bytes_of(&table))?;
        let minima = Minima::send(&mut sender, &cells)?;
        let header = MeshHeader {
            submeshes: table.address(),
            num_submeshes: 1,
            links: of_tets.address(0),
            sides: of_faces.address(0),
            ..minima.header(&cells)
        };
        let header = sender.send_whole("the mesh", bytemuck::bytes_of(&header))?;
        let bytes = MeshBytes {
            positions: positions.size_bytes(),
            indices: indices.size_bytes() + starts.size_bytes(),
            links: of_tets.size_bytes() + of_faces.size_bytes(),
            values: values.size_bytes(),
            tables: table.size_bytes() + header.size_bytes() + minima.size_bytes(),
            ..MeshBytes::default()
        };
        let sections = [positions, indices, starts, values, of_tets, of_faces];
        let mut parts: Vec<Buffer> = sections
            .into_iter()
            .flat_map(Section::into_buffers)
            .collect();
        parts.push(table);
        parts.extend(minima.buffer);
        Ok(Self {
            scale,
            map,
            range,
            value_type: ValueType::F32,
            header,
            bytes,
            held: match encoding {
                MeshEncoding::UserGeometry => Held::InBoxes,
                MeshEncoding::SharedFaces => Held::ByFaces,
                MeshEncoding::TetMarch => Held::ByNeighbours,
            },
            only_kind,
            faces,
            structure: None,
            ranges: None,
            send_secs: 0.0,
            _parts: parts,
            cells,
            data,
        })
    }
}

/// Sends a list as one piece.
fn whole<T: bytemuck::Pod>(
    sender: &mut Sender<'_>,
    what: &'static str,
    list: &[T],
) -> Result<Section, GpuError> {
    let bytes: &[u8] = bytemuck::cast_slice(list);
    let all = 0..bytes.len() as u64;
    sender.send_bytes(what, bytes, std::slice::from_ref(&all))
}
