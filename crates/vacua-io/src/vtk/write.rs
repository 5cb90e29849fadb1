//! Writes grids and meshes as VTK XML: `.vti`, `.vtr`, `.vts`, `.vtu`, appended raw data with 64-bit
//! headers in native byte order, fields in their native type. Blanked cells become `vtkGhostType`.
//! The first array of one component is marked as the active scalars, the first of three as the active
//! vectors, so that filters that ask for "the scalars" find some.

use std::borrow::Cow;
use std::fmt::Write as _;
use std::io::{self, Write};
use std::path::Path;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use glam::DMat3;
use rayon::prelude::*;
use vacua_volume::{
    Association, CellType, DataArray, Dataset, DatasetError, Geometry, Indices, ScalarType,
    UniformGrid, UnstructuredMesh,
};

use super::{GHOST_ARRAY, ghost};
use crate::atomic::write_atomically;
use crate::error::{IoError, Problem};
use crate::mesh::kind::vtk;

/// Uncompressed size of a compressed block in bytes.
const BLOCK_BYTES: usize = 1 << 18;

/// Arrays start at multiples of this many bytes of the file, so that they can be mapped.
const ALIGN_BYTES: usize = 8;

/// How numbers are stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum WriteEncoding {
    /// As they are: large, and memory-mapped when read again.
    Raw,
    /// In zlib blocks.
    #[default]
    Zlib,
}

/// How a file is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WriteOptions {
    /// How numbers are stored.
    pub encoding: WriteEncoding,
}

/// Writes a uniform grid with all its fields as `.vti`.
///
/// # Errors
/// [`Problem::Unsupported`] for another grid or one whose axes are sheared, [`Problem::Dataset`]
/// if a field cannot be loaded, [`Problem::System`] if the file cannot be written.
pub fn write_vti(path: &Path, dataset: &Dataset, options: &WriteOptions) -> Result<(), IoError> {
    let head = match &**dataset.geometry() {
        Geometry::Uniform(grid) => uniform_head(grid),
        other => Err(wrong_grid(other, "VTI", "uniform")),
    };
    let head = head.map_err(|p| p.in_file(path))?;
    let shape = Shape::of_grid("ImageData", dataset, &head, None);
    write(path, dataset, options, &shape)
}

/// Writes a rectilinear grid with all its fields as `.vtr`.
///
/// # Errors
/// As [`write_vti`].
pub fn write_vtr(path: &Path, dataset: &Dataset, options: &WriteOptions) -> Result<(), IoError> {
    let coordinates = match &**dataset.geometry() {
        Geometry::Rectilinear(grid) => [0, 1, 2]
            .into_iter()
            .map(|axis| Ok(DataArray::from_vec(grid.coordinates(axis).to_vec(), 1)?))
            .collect(),
        other => Err(wrong_grid(other, "VTR", "rectilinear")),
    };
    let coordinates: Vec<DataArray> = coordinates.map_err(|p: Problem| p.in_file(path))?;
    let geometry: Vec<Array> = ["x", "y", "z"].into_iter().zip(coordinates).collect();
    let shape = Shape::of_grid(
        "RectilinearGrid",
        dataset,
        "",
        Some(("Coordinates", geometry)),
    );
    write(path, dataset, options, &shape)
}

/// Writes a curvilinear grid with all its fields as `.vts`.
///
/// # Errors
/// As [`write_vti`].
pub fn write_vts(path: &Path, dataset: &Dataset, options: &WriteOptions) -> Result<(), IoError> {
    let positions = match &**dataset.geometry() {
        Geometry::Curvilinear(grid) => grid.positions().clone(),
        other => return Err(wrong_grid(other, "VTS", "curvilinear").in_file(path)),
    };
    let geometry = ("Points", vec![("Points", positions)]);
    let shape = Shape::of_grid("StructuredGrid", dataset, "", Some(geometry));
    write(path, dataset, options, &shape)
}

/// Writes a mesh with all its fields as `.vtu`. Point numbers are written as signed integers, which
/// is what other readers expect, where they fit.
///
/// # Errors
/// As [`write_vti`].
pub fn write_vtu(path: &Path, dataset: &Dataset, options: &WriteOptions) -> Result<(), IoError> {
    let mesh = dataset
        .mesh()
        .ok_or_else(|| wrong_grid(dataset.geometry(), "VTU", "unstructured").in_file(path))?;
    let cells = cell_arrays(mesh).map_err(|p| p.in_file(path))?;
    let shape = Shape {
        type_name: "UnstructuredGrid",
        data_set: String::new(),
        piece: format!(
            r#"NumberOfPoints="{}" NumberOfCells="{}""#,
            mesh.num_points(),
            mesh.num_cells()
        ),
        geometry: vec![
            ("Points", vec![("Points", mesh.positions().clone())]),
            ("Cells", cells),
        ],
    };
    write(path, dataset, options, &shape)
}

/// Connectivity, offsets and types of a mesh.
fn cell_arrays(mesh: &UnstructuredMesh) -> Result<Vec<Array<'static>>, Problem> {
    let connectivity = match mesh.indices() {
        Indices::U32(all) if mesh.num_points() <= i32::MAX as usize + 1 => {
            DataArray::from_vec(bytemuck::cast_slice::<u32, i32>(all).to_vec(), 1)?
        }
        Indices::U32(all) => DataArray::from_vec(all.iter().map(|&p| i64::from(p)).collect(), 1)?,
        Indices::U64(all) => {
            DataArray::from_vec(bytemuck::cast_slice::<u64, i64>(all).to_vec(), 1)?
        }
    };
    let cell_types = (0..mesh.num_cells()).map(|cell| mesh.cell_type(cell));
    let ends: Vec<i64> = cell_types
        .clone()
        .scan(0, |end, cell_type| {
            *end += cell_type.num_points() as i64;
            Some(*end)
        })
        .collect();
    let numbers: Vec<u8> = cell_types.map(vtk_number).collect();
    Ok(vec![
        ("connectivity", connectivity),
        ("offsets", DataArray::from_vec(ends, 1)?),
        ("types", DataArray::from_vec(numbers, 1)?),
    ])
}

/// VTK's number of a cell type.
fn vtk_number(cell_type: CellType) -> u8 {
    match cell_type {
        CellType::Tetrahedron => vtk::TETRA,
        CellType::Pyramid => vtk::PYRAMID,
        CellType::Wedge => vtk::WEDGE,
        CellType::Hexahedron => vtk::HEXAHEDRON,
    }
}

/// An array with its name.
type Array<'a> = (&'a str, DataArray);

/// What a file says besides fields.
struct Shape<'a> {
    type_name: &'a str,
    /// Attributes of the data set.
    data_set: String,
    /// Attributes of its only piece.
    piece: String,
    /// Elements with arrays that say where points and cells are.
    geometry: Vec<(&'a str, Vec<Array<'a>>)>,
}

impl<'a> Shape<'a> {
    fn of_grid(
        type_name: &'a str,
        dataset: &Dataset,
        head: &str,
        geometry: Option<(&'a str, Vec<Array<'a>>)>,
    ) -> Self {
        let [nx, ny, nz] = dataset.geometry().points().map(|n| n - 1);
        let extent = format!("0 {nx} 0 {ny} 0 {nz}");
        Self {
            type_name,
            data_set: format!(r#" WholeExtent="{extent}"{head}"#),
            piece: format!(r#"Extent="{extent}""#),
            geometry: geometry.into_iter().collect(),
        }
    }
}

fn wrong_grid(geometry: &Geometry, format: &str, kind: &str) -> Problem {
    Problem::Unsupported {
        what: format!("{} points and cells in a {format} file", geometry.kind()),
        hint: Some(format!("{format} holds {kind} ones")),
    }
}

/// Origin, spacing and direction of a uniform grid as attributes.
fn uniform_head(grid: &UniformGrid) -> Result<String, Problem> {
    let world_from_index = grid.world_from_index();
    let axes = world_from_index.matrix3;
    let spacing = grid.spacing();
    let direction = DMat3::from_cols(
        axes.x_axis / spacing.x,
        axes.y_axis / spacing.y,
        axes.z_axis / spacing.z,
    );
    let origin = world_from_index.translation;
    let mut head = format!(
        r#" Origin="{} {} {}" Spacing="{} {} {}""#,
        origin.x, origin.y, origin.z, spacing.x, spacing.y, spacing.z
    );
    if direction != DMat3::IDENTITY {
        let is_sheared = !(direction.transpose() * direction).abs_diff_eq(DMat3::IDENTITY, 1e-9);
        if is_sheared {
            return Err(Problem::Unsupported {
                what: "a sheared uniform grid in a VTI file".to_owned(),
                hint: Some("VTI holds grids whose axes are at right angles".to_owned()),
            });
        }
        let rows = direction.transpose().to_cols_array();
        let rows = rows.map(|v| v.to_string()).join(" ");
        let _ = write!(head, r#" Direction="{rows}""#);
    }
    Ok(head)
}

/// Writes a data set: tags first, then the arrays in the order of their tags.
fn write(
    path: &Path,
    dataset: &Dataset,
    options: &WriteOptions,
    shape: &Shape<'_>,
) -> Result<(), IoError> {
    let mut arrays = Vec::new();
    for field in dataset.fields() {
        let values = field
            .load()
            .map_err(|e| Problem::from(DatasetError::from(e)).in_file(path))?;
        arrays.push((field.association(), (field.name(), values.clone())));
    }
    if let Some(mask) = dataset.blanked_cells() {
        let flags = (0..mask.len()).map(|cell| u8::from(mask.is_blank(cell)) * ghost::HIDDEN_CELL);
        let flags = DataArray::from_vec(flags.collect::<Vec<u8>>(), 1)
            .map_err(|e| Problem::from(e).in_file(path))?;
        arrays.push((Association::Cell, (GHOST_ARRAY, flags)));
    }
    let of = |wanted: Association| -> Vec<&Array<'_>> {
        let matching = arrays.iter().filter(|(a, _)| *a == wanted);
        matching.map(|(_, array)| array).collect()
    };
    let mut sections = vec![
        ("PointData", of(Association::Point)),
        ("CellData", of(Association::Cell)),
    ];
    let geometry = shape.geometry.iter();
    sections.extend(geometry.map(|(tag, arrays)| (*tag, arrays.iter().collect())));

    write_atomically(path, |to| {
        let payloads = sections
            .iter()
            .flat_map(|(_, arrays)| arrays)
            .map(|(_, array)| Payload::new(array, options.encoding))
            .collect::<io::Result<Vec<_>>>()?;
        let mut tags = Vec::new();
        write_tags(&mut tags, options, shape, &sections, &payloads)?;
        let underscore = b"_";
        let padding = (tags.len() + underscore.len()).next_multiple_of(ALIGN_BYTES)
            - (tags.len() + underscore.len());
        to.write_all(&tags)?;
        to.write_all(&[b' '; ALIGN_BYTES][..padding])?;
        to.write_all(underscore)?;
        for payload in &payloads {
            payload.write(to)?;
        }
        to.write_all(b"\n  </AppendedData>\n</VTKFile>\n")
    })
}

/// Writes everything up to the underscore.
fn write_tags(
    to: &mut Vec<u8>,
    options: &WriteOptions,
    shape: &Shape<'_>,
    sections: &[(&str, Vec<&Array<'_>>)],
    payloads: &[Payload<'_>],
) -> io::Result<()> {
    let byte_order = if cfg!(target_endian = "big") {
        "BigEndian"
    } else {
        "LittleEndian"
    };
    let compressor = match options.encoding {
        WriteEncoding::Raw => "",
        WriteEncoding::Zlib => r#" compressor="vtkZLibDataCompressor""#,
    };
    let Shape {
        type_name,
        data_set,
        piece,
        ..
    } = shape;
    writeln!(to, r#"<?xml version="1.0"?>"#)?;
    writeln!(
        to,
        r#"<VTKFile type="{type_name}" version="1.0" byte_order="{byte_order}" header_type="UInt64"{compressor}>"#
    )?;
    writeln!(to, "  <{type_name}{data_set}>")?;
    writeln!(to, "    <Piece {piece}>")?;
    let mut offset = 0;
    let mut payload = payloads.iter();
    for (tag, arrays) in sections {
        let active = match *tag {
            "PointData" | "CellData" => active_attributes(arrays),
            _ => String::new(),
        };
        writeln!(to, "      <{tag}{active}>")?;
        for (name, array) in arrays {
            writeln!(
                to,
                r#"        <DataArray type="{}" Name="{}" NumberOfComponents="{}" format="appended" offset="{offset}"/>"#,
                type_name_of(array.scalar_type()),
                quick_xml::escape::escape(*name),
                array.components(),
            )?;
            offset += payload.next().map_or(0, Payload::len);
        }
        writeln!(to, "      </{tag}>")?;
    }
    writeln!(to, "    </Piece>\n  </{type_name}>")?;
    write!(to, "  <AppendedData encoding=\"raw\">\n   ")
}

/// Which arrays are the scalars and the vectors, as attributes. Three integers are a colour rather
/// than a vector; where there is neither a number nor a vector, the first array is the scalars.
fn active_attributes(arrays: &[&Array<'_>]) -> String {
    let shown = || arrays.iter().filter(|(name, _)| *name != GHOST_ARRAY);
    let is_vector = |array: &DataArray| {
        let float = matches!(array.scalar_type(), ScalarType::F32 | ScalarType::F64);
        float && array.components() == 3
    };
    let scalars = shown().find(|(_, array)| array.components() == 1);
    let vectors = shown().find(|(_, array)| is_vector(array));
    let scalars = scalars.or_else(|| shown().next().filter(|_| vectors.is_none()));
    let attribute = |(key, array): (&str, &&Array<'_>)| {
        format!(r#" {key}="{}""#, quick_xml::escape::escape(array.0))
    };
    let scalars = scalars.map(|array| ("Scalars", array));
    let vectors = vectors.map(|array| ("Vectors", array));
    scalars.into_iter().chain(vectors).map(attribute).collect()
}

/// VTK's name of a number type.
fn type_name_of(scalar_type: ScalarType) -> &'static str {
    match scalar_type {
        ScalarType::U8 => "UInt8",
        ScalarType::I8 => "Int8",
        ScalarType::U16 => "UInt16",
        ScalarType::I16 => "Int16",
        ScalarType::U32 => "UInt32",
        ScalarType::I32 => "Int32",
        ScalarType::U64 => "UInt64",
        ScalarType::I64 => "Int64",
        ScalarType::F32 => "Float32",
        ScalarType::F64 => "Float64",
    }
}

/// One array as it is stored: integers of the header, then stretches of bytes, then zeros so that
/// the next array starts where the reader can map it.
struct Payload<'a> {
    header: Vec<u64>,
    blocks: Vec<Cow<'a, [u8]>>,
}

impl<'a> Payload<'a> {
    fn new(array: &'a DataArray, encoding: WriteEncoding) -> io::Result<Self> {
        let bytes = array.bytes();
        match encoding {
            WriteEncoding::Raw => Ok(Self {
                header: vec![bytes.len() as u64],
                blocks: vec![bytes.into()],
            }),
            WriteEncoding::Zlib => {
                let blocks = bytes
                    .par_chunks(BLOCK_BYTES)
                    .map(|chunk| {
                        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
                        encoder.write_all(chunk)?;
                        encoder.finish().map(Cow::from)
                    })
                    .collect::<io::Result<Vec<_>>>()?;
                let last = bytes.len() % BLOCK_BYTES;
                let mut header = vec![blocks.len() as u64, BLOCK_BYTES as u64, last as u64];
                header.extend(blocks.iter().map(|b| b.len() as u64));
                Ok(Self { header, blocks })
            }
        }
    }

    /// Size without the zeros at its end.
    fn filled_bytes(&self) -> usize {
        self.header.len() * 8 + self.blocks.iter().map(|b| b.len()).sum::<usize>()
    }

    fn len(&self) -> usize {
        self.filled_bytes().next_multiple_of(ALIGN_BYTES)
    }

    fn write(&self, to: &mut impl Write) -> io::Result<()> {
        for word in &self.header {
            to.write_all(&word.to_ne_bytes())?;
        }
        self.blocks.iter().try_for_each(|b| to.write_all(b))?;
        to.write_all(&[0; ALIGN_BYTES][..self.len() - self.filled_bytes()])
    }
}
