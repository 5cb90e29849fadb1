//! Unstructured meshes from VTK XML: `.vtu` of one piece or many, and `.pvtu`.
//!
//! Polyhedra come in two forms: one stream of `faces` with `faceoffsets` (until VTK 9.3), and since
//! then `face_connectivity`, `face_offsets`, `polyhedron_to_faces` and `polyhedron_offsets`.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

use vacua_volume::{Association, DataArray, Dataset};

use super::as_float;
use super::data_array::DataArrayElement;
use super::document::{Element, XmlFile};
use super::fields::PieceArrays;
use crate::error::Problem;
use crate::mesh::{
    Ends, Faces, ListedFaces, Part, PartField, SourceCells, assemble, cell_types, faces_of_stream,
    join_full, numbers_of, widened,
};
use crate::source::Source;

/// The `type` of a serial file.
pub(super) const SERIAL: &str = "UnstructuredGrid";
/// The `type` of a parallel file.
pub(super) const PARALLEL: &str = "PUnstructuredGrid";

/// Whether a file is one of these.
pub(super) fn is_mesh(file: &XmlFile) -> bool {
    matches!(file.root.attribute("type"), Some(SERIAL | PARALLEL))
}

/// Reads a serial or a parallel file.
///
/// # Errors
/// [`Problem`] where the file breaks the rules; [`Problem::Part`] if one that it names cannot be read.
pub(super) fn read(file: XmlFile) -> Result<Dataset, Problem> {
    let (mut parts, mut notes) = (Vec::new(), Vec::new());
    add_parts(file, &mut parts, &mut notes)?;
    join_full(parts, notes)
}

/// Adds the pieces of a serial or a parallel file.
///
/// # Errors
/// As [`read`].
pub(super) fn add_parts(
    file: XmlFile,
    parts: &mut Vec<Part>,
    notes: &mut Vec<String>,
) -> Result<(), Problem> {
    if file.root.attribute("type") == Some(PARALLEL) {
        return add_files(&file, parts, notes);
    }
    add_pieces(&Arc::new(file), parts, notes)
}

/// Adds the pieces of the serial files that a parallel one names.
fn add_files(
    file: &XmlFile,
    parts: &mut Vec<Part>,
    notes: &mut Vec<String>,
) -> Result<(), Problem> {
    let folder = file.source.path().parent().unwrap_or(Path::new(""));
    let mut seen = BTreeSet::new();
    for piece in file.data_set()?.children_named("Piece") {
        let name = piece.required("Source")?;
        if !seen.insert(name) {
            return Err(Problem::malformed(
                piece.place(),
                "a file that is not listed before",
                format!("`{name}` again"),
            ));
        }
        let path = folder.join(name);
        let source = Source::open(&path).map_err(Problem::part)?;
        let mut add = || -> Result<(), Problem> {
            let part = XmlFile::parse(&source)?;
            let type_name = part.root.required("type")?;
            if type_name != SERIAL {
                return Err(Problem::malformed(
                    "attribute `type` of <VTKFile>",
                    SERIAL,
                    format!("`{type_name}`"),
                ));
            }
            add_pieces(&Arc::new(part), parts, notes)
        };
        add().map_err(|problem| Problem::part(problem.in_file(&path)))?;
    }
    Ok(())
}

fn add_pieces(
    file: &Arc<XmlFile>,
    parts: &mut Vec<Part>,
    notes: &mut Vec<String>,
) -> Result<(), Problem> {
    for piece in file.data_set()?.children_named("Piece") {
        parts.push(read_piece(file, piece, notes)?);
    }
    Ok(())
}

/// One piece of a serial file.
fn read_piece(
    file: &Arc<XmlFile>,
    piece: &Element,
    notes: &mut Vec<String>,
) -> Result<Part, Problem> {
    let count = |key: &str| -> Result<usize, Problem> {
        piece.required(key)?;
        Ok(piece
            .parsed(key, "a number that is not negative")?
            .unwrap_or(0))
    };
    let (num_points, num_cells) = (count("NumberOfPoints")?, count("NumberOfCells")?);
    let positions = match piece.child("Points").and_then(|p| p.child("DataArray")) {
        Some(element) => {
            as_float(DataArrayElement::parse_numbers(element)?.read(file, num_points)?)?
        }
        None if num_points == 0 => DataArray::from_vec(Vec::<f32>::new(), 3)?,
        None => {
            return Err(Problem::malformed(
                piece.place(),
                "an element <Points> with positions",
                "none",
            ));
        }
    };
    let at = |point: u64| {
        let point = usize::try_from(point)
            .ok()
            .filter(|&p| p < positions.tuples())?;
        let at = |axis| positions.get_f64(point, axis);
        (positions.components() == 3).then(|| glam::DVec3::new(at(0), at(1), at(2)))
    };
    let cells = match piece.child("Cells") {
        Some(element) => {
            let cells = CellArrays::read(file, element, num_cells)?;
            let faces = |cell: usize, _: &[u64]| cells.faces(cell);
            let faces: &Faces<'_> = &faces;
            let assembled = assemble(
                &SourceCells {
                    types: Cow::Borrowed(&cells.types),
                    ends: Some(Ends::Array {
                        array: &cells.ends,
                        skip: 0,
                    }),
                    connectivity: cells.connectivity.clone(),
                    faces: cells.has_faces().then_some(faces),
                    what: piece.place(),
                },
                &at,
            )?;
            // As long as two of the four points of a tetrahedron, and of no use any more.
            cells.ends.release();
            assembled
        }
        None if num_cells == 0 => assemble(&SourceCells::none(piece.place())?, &at)?,
        None => {
            return Err(Problem::malformed(
                piece.place(),
                "an element <Cells>",
                "none",
            ));
        }
    };
    let point = PieceArrays::parse(piece.child("PointData"), notes)?;
    let cell = PieceArrays::parse(piece.child("CellData"), notes)?;
    let flags = |arrays: &PieceArrays, tuples| {
        let ghost = arrays.ghost.as_ref();
        ghost.map(|array| array.read(file, tuples)).transpose()
    };
    let (point_flags, cell_flags) = (flags(&point, num_points)?, flags(&cell, num_cells)?);
    let of_points = point
        .fields
        .into_iter()
        .map(|f| (Association::Point, num_points, f));
    let of_cells = cell
        .fields
        .into_iter()
        .map(|f| (Association::Cell, num_cells, f));
    let fields = of_points
        .chain(of_cells)
        .map(|(association, tuples, array)| {
            let (file_to_load, file_to_check) = (file.clone(), file.clone());
            let (element, to_check) = (array.element.clone(), array.element);
            PartField {
                name: array.name,
                association,
                scalar_type: element.scalar_type,
                components: element.components,
                load: Arc::new(move || element.read(&file_to_load, tuples)),
                check: Arc::new(move || to_check.check(&file_to_check, tuples)),
            }
        });
    Ok(Part {
        fields: fields.collect(),
        positions,
        cells,
        point_flags,
        cell_flags,
    })
}

/// The arrays in `<Cells>`.
struct CellArrays {
    types: Vec<u8>,
    ends: DataArray,
    connectivity: DataArray,
    polyhedra: Option<Polyhedra>,
}

/// Where the faces of polyhedra are.
enum Polyhedra {
    /// One stream, and where each cell's part of it ends; negative for other cells.
    Stream { faces: DataArray, ends: DataArray },
    /// Faces by number.
    Listed(ListedFaces),
}

impl CellArrays {
    fn read(file: &XmlFile, cells: &Element, num_cells: usize) -> Result<Self, Problem> {
        let find = |name: &str| -> Result<Option<DataArrayElement>, Problem> {
            let mut arrays = cells.children_named("DataArray");
            let found = arrays.find(|a| a.attribute("Name") == Some(name));
            found.map(DataArrayElement::parse_numbers).transpose()
        };
        let integers = |name: &str, tuples: Option<usize>| -> Result<Option<DataArray>, Problem> {
            let Some(element) = find(name)? else {
                return Ok(None);
            };
            let tuples = match tuples {
                Some(tuples) => tuples,
                None => element.tuples_in_file(file)?,
            };
            if element.components != 1 {
                return Err(Problem::malformed(
                    element.what(),
                    "1 component",
                    element.components.to_string(),
                ));
            }
            widened(element.read(file, tuples)?, element.what()).map(Some)
        };
        let required = |name: &str, tuples: Option<usize>| {
            integers(name, tuples)?.ok_or_else(|| {
                Problem::malformed(cells.place(), format!("an array `{name}`"), "none")
            })
        };
        let types = find("types")?
            .ok_or_else(|| Problem::malformed(cells.place(), "an array `types`", "none"))?;
        let given = types.read(file, num_cells)?;
        let types = cell_types(&given, types.what())?;
        given.release();
        let ends = required("offsets", Some(num_cells))?;
        let connectivity = required("connectivity", None)?;
        let polyhedra = if let Some(faces) = integers("faces", None)? {
            let ends = required("faceoffsets", Some(num_cells))?;
            Some(Polyhedra::Stream { faces, ends })
        } else if let Some(points) = integers("face_connectivity", None)? {
            Some(Polyhedra::Listed(ListedFaces::new(
                points,
                required("face_offsets", None)?,
                required("polyhedron_to_faces", None)?,
                required("polyhedron_offsets", None)?,
            )))
        } else {
            None
        };
        Ok(Self {
            types,
            ends,
            connectivity,
            polyhedra,
        })
    }

    fn has_faces(&self) -> bool {
        self.polyhedra.is_some()
    }

    /// The faces of one cell.
    fn faces(&self, cell: usize) -> Result<Vec<Vec<u64>>, Problem> {
        let place = format!("polyhedron {cell}");
        let wrong = || Problem::malformed(&place, "faces in their arrays", "places outside them");
        match &self.polyhedra {
            None => Err(wrong()),
            Some(Polyhedra::Stream { faces, ends }) => {
                let stream = numbers_of(faces, ends, cell).ok_or_else(wrong)?;
                faces_of_stream(&place, &stream)
            }
            Some(Polyhedra::Listed(faces)) => faces.of_cell(cell).ok_or_else(wrong),
        }
    }
}
