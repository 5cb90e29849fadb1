//! Pieces of a mesh joined to one: positions and cells now, fields when they are loaded.

use std::collections::BTreeMap;
use std::sync::Arc;

use vacua_volume::{
    Association, CellMask, CellType, DataArray, Dataset, DatasetError, Field, Geometry, LoadError,
    Scalar, ScalarType, UnstructuredMesh, dispatch_scalar,
};

use super::assemble::{Assembled, AssembledTypes, account};
use crate::error::Problem;

/// Bits of `vtkGhostType` that hide a cell: another piece's copy, covered by a finer one, not there.
const HIDDEN_CELL: u8 = 1 | 8 | 32;
/// The bit of `vtkGhostType` that hides a point, and every cell that uses it.
const HIDDEN_POINT: u8 = 2;

type Load = dyn Fn() -> Result<DataArray, Problem> + Send + Sync;

/// An array on the points or cells of one piece, as its file has it.
#[derive(Clone)]
pub(crate) struct PartField {
    /// Its name.
    pub name: String,
    /// On points or on cells.
    pub association: Association,
    /// Type of a number.
    pub scalar_type: ScalarType,
    /// Numbers in a tuple.
    pub components: usize,
    /// Reads the numbers.
    pub load: Arc<Load>,
    /// Fails, without decoding anything, if the file is too short for the numbers.
    pub check: Arc<dyn Fn() -> Result<(), Problem> + Send + Sync>,
}

impl PartField {
    /// A field that loads itself.
    pub fn from_field(field: Field) -> Self {
        Self {
            name: field.name().to_owned(),
            association: field.association(),
            scalar_type: field.scalar_type(),
            components: field.components(),
            load: Arc::new(move || {
                let values = field.load().cloned();
                values.map_err(|e| DatasetError::from(e).into())
            }),
            check: Arc::new(|| Ok(())),
        }
    }
}

/// One piece of a mesh.
pub(crate) struct Part {
    /// Positions, 3 × `f32` or `f64`.
    pub positions: DataArray,
    /// Its cells.
    pub cells: Assembled,
    /// Its fields.
    pub fields: Vec<PartField>,
    /// `vtkGhostType` of its points.
    pub point_flags: Option<DataArray>,
    /// `vtkGhostType` of the file's cells.
    pub cell_flags: Option<DataArray>,
}

/// Joins pieces: points and cells of the first come first.
///
/// Fields that some piece lacks, or has in another type, are left out with a note.
///
/// # Errors
/// [`Problem`] if cells use points that are not there, or arrays have the wrong shape.
pub(crate) fn join(parts: Vec<Part>, mut notes: Vec<String>) -> Result<Dataset, Problem> {
    let mut changed: BTreeMap<u8, usize> = BTreeMap::new();
    for part in &parts {
        for (&kind, &count) in &part.cells.changed {
            *changed.entry(kind).or_default() += count;
        }
    }
    let (left_out, what_changed) = account(&changed);
    notes.extend(what_changed);
    let mask = blanked(&parts)?;
    let fields = fields(&parts, &mut notes);
    let mut mesh = mesh_of(parts)?.with_left_out(left_out);
    if let Some(mask) = mask {
        mesh = mesh.with_blanked_cells(mask)?;
    }
    let dataset = Dataset::new(Geometry::Unstructured(mesh), fields)?;
    notes.sort();
    notes.dedup();
    Ok(notes.into_iter().fold(dataset, Dataset::with_note))
}

/// Joins pieces; empty ones, which often lack arrays, count only if there are no others.
///
/// # Errors
/// As [`join`].
pub(crate) fn join_full(mut parts: Vec<Part>, notes: Vec<String>) -> Result<Dataset, Problem> {
    let is_full = |part: &Part| part.positions.tuples() > 0 || part.cells.num_source_cells > 0;
    if parts.iter().any(is_full) {
        parts.retain(is_full);
    }
    join(parts, notes)
}

/// Number of points in pieces before each one, and in all.
fn mesh_of(mut parts: Vec<Part>) -> Result<UnstructuredMesh, Problem> {
    if parts.len() == 1
        && let Some(part) = parts.pop()
    {
        let Assembled {
            types,
            connectivity,
            ..
        } = part.cells;
        return Ok(match types {
            AssembledTypes::Uniform(cell_type, _) => {
                UnstructuredMesh::uniform(part.positions, cell_type, connectivity)?
            }
            AssembledTypes::Mixed(types) => {
                UnstructuredMesh::mixed(part.positions, types, connectivity)?
            }
        });
    }
    let wide = parts
        .iter()
        .any(|p| p.positions.scalar_type() == ScalarType::F64);
    let positions = if wide {
        joined_positions::<f64>(&parts)?
    } else {
        joined_positions::<f32>(&parts)?
    };
    let mut types: Vec<CellType> = Vec::new();
    let mut connectivity: Vec<u64> = Vec::new();
    let mut first_point = 0u64;
    for part in &parts {
        let points = part.positions.tuples() as u64;
        match &part.cells.types {
            AssembledTypes::Uniform(cell_type, n) => {
                types.resize(types.len() + n, *cell_type);
            }
            AssembledTypes::Mixed(of_part) => types.extend(of_part),
        }
        let numbers = &part.cells.connectivity;
        for place in 0..numbers.tuples() {
            let number = super::assemble::index_at(numbers, place)
                .map(|n| n as u64)
                .filter(|&n| n < points)
                .ok_or_else(|| {
                    Problem::malformed(
                        "the connectivity of a piece",
                        format!("numbers of points below {points}"),
                        format!("another at place {place}"),
                    )
                })?;
            connectivity.push(first_point + number);
        }
        first_point += points;
    }
    let connectivity = match u32::try_from(first_point) {
        Ok(_) => {
            let narrow: Vec<u32> = connectivity.iter().map(|&n| n as u32).collect();
            DataArray::from_vec(narrow, 1)?
        }
        Err(_) => DataArray::from_vec(connectivity, 1)?,
    };
    Ok(UnstructuredMesh::mixed(positions, types, connectivity)?)
}

fn joined_positions<T: Scalar>(parts: &[Part]) -> Result<DataArray, Problem> {
    let mut all: Vec<T> = Vec::new();
    for part in parts {
        let positions = &part.positions;
        if positions.components() != 3 {
            return Err(Problem::malformed(
                "the positions of a piece",
                "3 numbers a point",
                positions.components().to_string(),
            ));
        }
        match positions.as_slice::<T>() {
            Some(same) => all.extend_from_slice(same),
            None => dispatch_scalar!(positions.scalar_type(), S => {
                let of_part = positions.as_slice::<S>().unwrap_or_default();
                all.extend(of_part.iter().map(|v| T::from_f64(v.to_f64())));
            }),
        }
    }
    Ok(DataArray::from_vec(all, 3)?)
}

/// Cells of the mesh that ghost flags hide; `None` if none is.
fn blanked(parts: &[Part]) -> Result<Option<CellMask>, Problem> {
    let num_cells = parts.iter().map(|p| p.cells.types.len()).sum();
    let mut mask: Option<CellMask> = None;
    let mut first = 0;
    for part in parts {
        let flags = |array: &Option<DataArray>| -> Result<Vec<u8>, Problem> {
            let array = array.as_ref();
            Ok(array
                .map(crate::vtk::ghost_flags)
                .transpose()?
                .unwrap_or_default()
                .to_vec())
        };
        let (points, cells) = (flags(&part.point_flags)?, flags(&part.cell_flags)?);
        let n = part.cells.types.len();
        let mut blank = |cell: usize| {
            mask.get_or_insert_with(|| CellMask::new(num_cells))
                .blank(first + cell);
        };
        if cells.iter().any(|f| f & HIDDEN_CELL != 0) {
            for cell in 0..n {
                let source = part
                    .cells
                    .sources
                    .as_ref()
                    .map_or(cell, |s| s[cell] as usize);
                if cells.get(source).is_some_and(|f| f & HIDDEN_CELL != 0) {
                    blank(cell);
                }
            }
        }
        if points.iter().any(|f| f & HIDDEN_POINT != 0) {
            let mut place = 0;
            for cell in 0..n {
                let width = match &part.cells.types {
                    AssembledTypes::Uniform(cell_type, _) => cell_type.num_points(),
                    AssembledTypes::Mixed(types) => types[cell].num_points(),
                };
                let hidden = (place..place + width).any(|i| {
                    let point = super::assemble::index_at(&part.cells.connectivity, i);
                    let flags = point.and_then(|p| points.get(p));
                    flags.is_some_and(|f| f & HIDDEN_POINT != 0)
                });
                if hidden {
                    blank(cell);
                }
                place += width;
            }
        }
        first += n;
    }
    Ok(mask)
}

/// One array in every piece.
struct Joined {
    parts: Vec<JoinedPart>,
    scalar_type: ScalarType,
    components: usize,
    tuples: usize,
}

struct JoinedPart {
    field: PartField,
    sources: Option<Arc<[u64]>>,
}

impl Joined {
    fn load(&self) -> Result<DataArray, Problem> {
        if let [part] = self.parts.as_slice()
            && part.sources.is_none()
        {
            return (part.field.load)();
        }
        for part in &self.parts {
            (part.field.check)()?;
        }
        dispatch_scalar!(self.scalar_type, T => {
            let mut all: Vec<T> = Vec::new();
            for part in &self.parts {
                let values = (part.field.load)()?;
                let of_part = values.as_slice::<T>().unwrap_or_default();
                let Some(sources) = &part.sources else {
                    all.extend_from_slice(of_part);
                    continue;
                };
                let width = self.components;
                all.reserve(sources.len() * width);
                for &source in sources.iter() {
                    let from = source as usize * width;
                    let tuple = of_part.get(from..from + width).ok_or_else(|| {
                        Problem::malformed(
                            format!("array `{}`", part.field.name),
                            format!("a value for cell {source}"),
                            format!("{} values", values.tuples()),
                        )
                    })?;
                    all.extend_from_slice(tuple);
                }
            }
            if all.len() != self.tuples.saturating_mul(self.components) {
                let name = self.parts.first().map_or("", |p| p.field.name.as_str());
                return Err(Problem::malformed(
                    format!("array `{name}`"),
                    format!("{} × {} numbers", self.tuples, self.components),
                    all.len().to_string(),
                ));
            }
            Ok(DataArray::from_vec(all, self.components)?)
        })
    }
}

/// The fields that every piece has.
fn fields(parts: &[Part], notes: &mut Vec<String>) -> Vec<Field> {
    let sources: Vec<Option<Arc<[u64]>>> = parts
        .iter()
        .map(|part| part.cells.sources.as_deref().map(Arc::from))
        .collect();
    let Some(first) = parts.first() else {
        return Vec::new();
    };
    let mut fields = Vec::new();
    for (index, wanted) in first.fields.iter().enumerate() {
        let is_same = |f: &&PartField| f.name == wanted.name && f.association == wanted.association;
        let nth = first.fields[..index].iter().filter(is_same).count();
        let mut of_parts = Vec::with_capacity(parts.len());
        for (part, sources) in parts.iter().zip(&sources) {
            let found = part.fields.iter().filter(is_same).nth(nth);
            let same_type = |f: &&PartField| {
                (f.scalar_type, f.components) == (wanted.scalar_type, wanted.components)
            };
            let Some(field) = found.filter(same_type) else {
                break;
            };
            let on_cells = wanted.association == Association::Cell;
            of_parts.push(JoinedPart {
                field: field.clone(),
                sources: sources.clone().filter(|_| on_cells),
            });
        }
        if of_parts.len() < parts.len() {
            notes.push(format!(
                "{} array `{}` is missing in some piece, or of another type there, and left out",
                wanted.association, wanted.name
            ));
            continue;
        }
        let tuples = match wanted.association {
            Association::Point => parts.iter().map(|p| p.positions.tuples()).sum(),
            Association::Cell => parts.iter().map(|p| p.cells.types.len()).sum(),
        };
        let joined = Joined {
            parts: of_parts,
            scalar_type: wanted.scalar_type,
            components: wanted.components,
            tuples,
        };
        fields.push(Field::lazy(
            wanted.name.as_str(),
            wanted.association,
            wanted.scalar_type,
            wanted.components,
            tuples,
            move || {
                joined
                    .load()
                    .map_err(|problem| Arc::new(problem) as LoadError)
            },
        ));
    }
    fields
}
