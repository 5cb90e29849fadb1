//! The cells of one piece of a file, made into what a mesh has.
//!
//! Where all cells stay as they are the connectivity is used as it lies in the file; otherwise it is
//! built anew, with the cell of the file that each cell comes from.

use std::borrow::Cow;
use std::collections::BTreeMap;

use glam::DVec3;
use vacua_volume::{CellType, DataArray, LeftOut, Scalar, ScalarType, dispatch_scalar};

use super::decompose::{convex_point_set, polyhedron, prism};
use super::kind::{Kind, Treatment, kind};
use crate::error::Problem;

/// Most points of a convex point set: filling it costs the square of them.
const MAX_CONVEX_POINTS: usize = 512;

/// Cells as a file gives them.
pub(crate) struct SourceCells<'a> {
    /// VTK's number for each cell.
    pub types: Cow<'a, [u8]>,
    /// Where each cell's points end in the connectivity; `None` if all cells are of the kind of the
    /// first, which stays as it is.
    pub ends: Option<Ends<'a>>,
    /// Points of all cells, one column of integers of 32 or 64 bits ([`widened`]).
    pub connectivity: DataArray,
    /// The faces of a polyhedron, each one's points; from the cell's number and what the connectivity
    /// says of it.
    pub faces: Option<&'a Faces<'a>>,
    /// What to call the cells in messages.
    pub what: String,
}

impl SourceCells<'_> {
    /// No cells.
    ///
    /// # Errors
    /// None in practice.
    pub fn none(what: String) -> Result<Self, Problem> {
        Ok(Self {
            types: Cow::Borrowed(&[]),
            ends: None,
            connectivity: DataArray::from_vec(Vec::<u32>::new(), 1)?,
            faces: None,
            what,
        })
    }
}

/// Finds the faces of a polyhedron.
pub(crate) type Faces<'a> = dyn Fn(usize, &[u64]) -> Result<Vec<Vec<u64>>, Problem> + 'a;

/// Where cells end in the connectivity.
pub(crate) enum Ends<'a> {
    /// One column of integers; the first `skip` are left out (1 where they begin with 0).
    Array {
        /// The integers.
        array: &'a DataArray,
        /// How many are left out.
        skip: usize,
    },
    /// As they are.
    List(Vec<u64>),
}

impl Ends<'_> {
    fn get(&self, cell: usize) -> Option<usize> {
        match self {
            Self::Array { array, skip } => index_at(array, cell + skip),
            Self::List(ends) => usize::try_from(*ends.get(cell)?).ok(),
        }
    }

    fn len(&self) -> usize {
        match self {
            Self::Array { array, skip } => array.tuples().saturating_sub(*skip),
            Self::List(ends) => ends.len(),
        }
    }
}

/// An integer that is not negative; `None` if it is, or is not there.
pub(crate) fn index_at(array: &DataArray, place: usize) -> Option<usize> {
    if place >= array.tuples() {
        return None;
    }
    match array.scalar_type() {
        ScalarType::I64 => usize::try_from(*array.as_slice::<i64>()?.get(place)?).ok(),
        ScalarType::I32 => usize::try_from(*array.as_slice::<i32>()?.get(place)?).ok(),
        ScalarType::U64 => usize::try_from(*array.as_slice::<u64>()?.get(place)?).ok(),
        ScalarType::U32 => usize::try_from(*array.as_slice::<u32>()?.get(place)?).ok(),
        _ => None,
    }
}

/// VTK's stream of the faces of one polyhedron: their number, then for each its number of points and
/// the points.
///
/// # Errors
/// [`Problem::Malformed`] if it says more than it has.
pub(crate) fn faces_of_stream(place: &str, stream: &[u64]) -> Result<Vec<Vec<u64>>, Problem> {
    let wrong = || {
        Problem::malformed(
            place,
            "faces, each with its number of points and as many points",
            format!("{} numbers that say otherwise", stream.len()),
        )
    };
    let (&count, mut rest) = stream.split_first().ok_or_else(wrong)?;
    let mut faces = Vec::new();
    for _ in 0..count {
        let (&len, after) = rest.split_first().ok_or_else(wrong)?;
        let len = usize::try_from(len).map_err(|_| wrong())?;
        let (face, after) = after.split_at_checked(len).ok_or_else(wrong)?;
        faces.push(face.to_vec());
        rest = after;
    }
    Ok(faces)
}

/// Integers as 32 or 64 bits: those that are so stay, narrower ones become `i32`.
///
/// # Errors
/// [`Problem::Malformed`] if they are no integers.
pub(crate) fn widened(array: DataArray, what: &str) -> Result<DataArray, Problem> {
    match array.scalar_type() {
        ScalarType::U32 | ScalarType::I32 | ScalarType::U64 | ScalarType::I64 => Ok(array),
        ScalarType::F32 | ScalarType::F64 => Err(Problem::malformed(
            what,
            "integers",
            format!("numbers of type {}", array.scalar_type()),
        )),
        narrow => {
            let components = array.components();
            let wide: Vec<i32> = dispatch_scalar!(narrow, T => {
                let all: &[T] = bytemuck::cast_slice(array.bytes());
                all.iter().map(|v| v.to_f64() as i32).collect()
            });
            Ok(DataArray::from_vec(wide, components)?)
        }
    }
}

/// The cells of one piece, ready for a mesh.
#[derive(Clone, Debug)]
pub(crate) struct Assembled {
    /// What they are.
    pub types: AssembledTypes,
    /// Their points.
    pub connectivity: DataArray,
    /// The cell of the file that each comes from; `None` if they are the same.
    pub sources: Option<Vec<u64>>,
    /// Cells of the file.
    pub num_source_cells: usize,
    /// Cells of the file that were changed or left out: how many of each kind.
    pub changed: BTreeMap<u8, usize>,
}

/// What cells are.
#[derive(Clone, Debug)]
pub(crate) enum AssembledTypes {
    /// All the same, so many.
    Uniform(CellType, usize),
    /// One each.
    Mixed(Vec<CellType>),
}

impl AssembledTypes {
    /// Number of cells.
    pub fn len(&self) -> usize {
        match self {
            Self::Uniform(_, n) => *n,
            Self::Mixed(types) => types.len(),
        }
    }
}

/// Makes the cells of a piece; `position` gives the place of a point, if there is one.
///
/// # Errors
/// [`Problem`] naming the first cell that breaks the rules, or that is not understood.
pub(crate) fn assemble(
    cells: &SourceCells<'_>,
    position: &dyn Fn(u64) -> Option<DVec3>,
) -> Result<Assembled, Problem> {
    if cells.connectivity.components() != 1 {
        return Err(Problem::malformed(
            format!("{}: connectivity", cells.what),
            "one column",
            format!("{}", cells.connectivity.components()),
        ));
    }
    if let Some(ends) = &cells.ends
        && ends.len() != cells.types.len()
    {
        return Err(Problem::malformed(
            format!("{}: offsets", cells.what),
            format!("one for each of the {} cells", cells.types.len()),
            ends.len().to_string(),
        ));
    }
    if let Some(unchanged) = unchanged(cells)? {
        return Ok(unchanged);
    }
    match cells.connectivity.scalar_type() {
        ScalarType::I32 => build::<i32>(cells, position),
        ScalarType::I64 => build::<i64>(cells, position),
        ScalarType::U32 => build::<u32>(cells, position),
        ScalarType::U64 => build::<u64>(cells, position),
        other => Err(Problem::malformed(
            format!("{}: connectivity", cells.what),
            "integers of 32 or 64 bits",
            format!("numbers of type {other}"),
        )),
    }
}

/// The kind of a cell.
fn kind_of(cells: &SourceCells<'_>, cell: usize) -> Result<Kind, Problem> {
    let number = cells.types[cell];
    kind(number).ok_or_else(|| {
        Problem::unsupported(format!(
            "the VTK cell type {number} (cell {cell} of {})",
            cells.what
        ))
    })
}

/// The cells as they are, if none needs to be changed.
fn unchanged(cells: &SourceCells<'_>) -> Result<Option<Assembled>, Problem> {
    let keep = |number: u8| match kind(number).map(|k| k.treatment) {
        Some(Treatment::Keep(cell_type)) => Some(cell_type),
        _ => None,
    };
    let assembled = |types: AssembledTypes| {
        Some(Assembled {
            types,
            connectivity: cells.connectivity.clone(),
            sources: None,
            num_source_cells: cells.types.len(),
            changed: BTreeMap::new(),
        })
    };
    let Some(&first) = cells.types.first() else {
        // Points of no cell are no cells.
        return Ok(Some(Assembled {
            types: AssembledTypes::Mixed(Vec::new()),
            connectivity: DataArray::from_vec(Vec::<u32>::new(), 1)?,
            sources: None,
            num_source_cells: 0,
            changed: BTreeMap::new(),
        }));
    };
    let is_uniform = cells.types.iter().all(|&t| t == first);
    let mut end = 0usize;
    let mut types = Vec::with_capacity(if is_uniform { 0 } else { cells.types.len() });
    for (cell, &number) in cells.types.iter().enumerate() {
        let Some(cell_type) = keep(number) else {
            return Ok(None);
        };
        end += cell_type.num_points();
        let given = cells.ends.as_ref().map(|ends| ends.get(cell));
        if given.is_some_and(|given| given != Some(end)) {
            // What is wrong with it is found where cells are taken one by one.
            return Ok(None);
        }
        if !is_uniform {
            types.push(cell_type);
        }
    }
    if end != cells.connectivity.tuples() {
        return Err(Problem::malformed(
            format!("{}: connectivity", cells.what),
            format!("{end} point numbers for {} cells", cells.types.len()),
            cells.connectivity.tuples().to_string(),
        ));
    }
    Ok(match keep(first).filter(|_| is_uniform) {
        Some(cell_type) => assembled(AssembledTypes::Uniform(cell_type, cells.types.len())),
        None => assembled(AssembledTypes::Mixed(types)),
    })
}

/// Integers that name points.
trait PointNumber: Scalar {
    /// As a number of a point; negative ones are far out of range.
    fn to_u64(self) -> u64;
    /// Back again, from a number that came from this type or fits it.
    fn from_u64(number: u64) -> Self;
}

macro_rules! point_numbers {
    ($($t:ty)*) => {$(
        impl PointNumber for $t {
            fn to_u64(self) -> u64 { self as i64 as u64 }
            fn from_u64(number: u64) -> Self { number as Self }
        }
    )*};
}
point_numbers!(i32 i64 u32 u64);

/// Cells while they are taken one by one.
struct Builder<T> {
    types: Vec<CellType>,
    connectivity: Vec<T>,
    sources: Vec<u64>,
    changed: BTreeMap<u8, usize>,
}

impl<T: PointNumber> Builder<T> {
    fn push(&mut self, source: usize, cell_type: CellType, points: impl IntoIterator<Item = T>) {
        self.types.push(cell_type);
        self.connectivity.extend(points);
        self.sources.push(source as u64);
    }
}

fn build<T: PointNumber>(
    cells: &SourceCells<'_>,
    position: &dyn Fn(u64) -> Option<DVec3>,
) -> Result<Assembled, Problem> {
    let all = cells.connectivity.as_slice::<T>().unwrap_or_default();
    let mut built = Builder::<T> {
        types: Vec::new(),
        connectivity: Vec::new(),
        sources: Vec::new(),
        changed: BTreeMap::new(),
    };
    let mut start = 0;
    for cell in 0..cells.types.len() {
        let found = kind_of(cells, cell)?;
        let (name, treatment) = (found.name, found.treatment);
        let place = || format!("{name} {cell} of {}", cells.what);
        let end = match &cells.ends {
            Some(ends) => ends.get(cell),
            None => Some(start + fixed_points(treatment).unwrap_or(0)),
        };
        let points = end.and_then(|end| all.get(start..end)).ok_or_else(|| {
            let end = end.map_or("a negative number".to_owned(), |end| end.to_string());
            Problem::malformed(
                place(),
                format!("an offset from {start} to {}", all.len()),
                end,
            )
        })?;
        start += points.len();
        let needs = |wanted: usize| {
            (points.len() == wanted).then_some(()).ok_or_else(|| {
                Problem::malformed(
                    place(),
                    format!("{wanted} points"),
                    points.len().to_string(),
                )
            })
        };
        if !matches!(treatment, Treatment::Keep(_)) {
            *built.changed.entry(cells.types[cell]).or_default() += 1;
        }
        match treatment {
            Treatment::LeaveOut => {}
            Treatment::Keep(cell_type) => {
                let corners = cell_type.num_points();
                if has_curved_points(cell_type, points.len()) {
                    *built.changed.entry(cells.types[cell]).or_default() += 1;
                } else {
                    needs(corners)?;
                }
                built.push(cell, cell_type, points[..corners].iter().copied());
            }
            Treatment::Voxel => {
                needs(8)?;
                let corners = [0, 1, 3, 2, 4, 5, 7, 6].map(|i| points[i]);
                built.push(cell, CellType::Hexahedron, corners);
            }
            Treatment::Prism(sides) => {
                needs(2 * sides)?;
                for (cell_type, corners) in prism(sides) {
                    built.push(cell, cell_type, corners.iter().map(|&i| points[i]));
                }
            }
            Treatment::Corners { linear, num_points } => {
                match num_points {
                    Some(wanted) => needs(wanted)?,
                    None if points.len() < linear.num_points() => needs(linear.num_points())?,
                    None => {}
                }
                let corners = &points[..linear.num_points()];
                built.push(cell, linear, corners.iter().copied());
            }
            Treatment::ConvexPointSet => {
                if points.len() > MAX_CONVEX_POINTS {
                    return Err(Problem::unsupported(format!(
                        "{} with {} points (at most {MAX_CONVEX_POINTS})",
                        place(),
                        points.len()
                    )));
                }
                let positions: Option<Vec<DVec3>> =
                    points.iter().map(|p| position(p.to_u64())).collect();
                let positions = positions.ok_or_else(|| {
                    Problem::malformed(place(), "points that there are", "another number")
                })?;
                for corners in convex_point_set(&positions) {
                    built.push(cell, CellType::Tetrahedron, corners.map(|i| points[i]));
                }
            }
            Treatment::Polyhedron => {
                let faces = match cells.faces {
                    Some(faces) => {
                        let points: Vec<u64> = points.iter().map(|p| p.to_u64()).collect();
                        faces(cell, &points)?
                    }
                    None => {
                        return Err(Problem::malformed(place(), "faces", "none in the file"));
                    }
                };
                polyhedron(&faces, |corners| {
                    built.push(cell, CellType::Tetrahedron, corners.map(T::from_u64));
                });
            }
        }
    }
    Ok(Assembled {
        types: AssembledTypes::Mixed(built.types),
        connectivity: DataArray::from_vec(built.connectivity, 1)?,
        sources: Some(built.sources),
        num_source_cells: cells.types.len(),
        changed: built.changed,
    })
}

/// Whether a cell that is called straight has as many points as a curved one, the corners first: some
/// programs write such cells, and VTK reads them.
fn has_curved_points(cell_type: CellType, points: usize) -> bool {
    match cell_type {
        CellType::Tetrahedron => points == 10,
        CellType::Pyramid => points == 13,
        CellType::Wedge => matches!(points, 15 | 18),
        CellType::Hexahedron => matches!(points, 20 | 27),
    }
}

/// How many points a cell has where nothing says so but its kind.
fn fixed_points(treatment: Treatment) -> Option<usize> {
    match treatment {
        Treatment::Keep(cell_type) => Some(cell_type.num_points()),
        Treatment::Voxel => Some(8),
        Treatment::Prism(sides) => Some(2 * sides),
        Treatment::Corners { num_points, .. } => num_points,
        _ => None,
    }
}

/// Cells that are below three dimensions, and what else was done to cells, in words.
pub(crate) fn account(changed: &BTreeMap<u8, usize>) -> (Vec<LeftOut>, Vec<String>) {
    let (mut left_out, mut notes) = (Vec::new(), Vec::new());
    for (&number, &count) in changed {
        let Some(Kind { name, treatment }) = kind(number) else {
            continue;
        };
        match treatment {
            Treatment::LeaveOut => {
                left_out.push(LeftOut { name, count });
                notes.push(format!(
                    "{count} cells of type {name} are below three dimensions and left out"
                ));
            }
            Treatment::Corners { linear, .. } => notes.push(format!(
                "{count} curved cells of type {name} are taken as straight: a {} of their corners",
                linear.name()
            )),
            Treatment::Prism(_) | Treatment::ConvexPointSet | Treatment::Polyhedron => notes.push(
                format!("{count} cells of type {name} are cut into simpler ones"),
            ),
            Treatment::Keep(_) => notes.push(format!(
                "{count} cells of type {name} have the points of curved cells; their corners are used"
            )),
            Treatment::Voxel => {}
        }
    }
    (left_out, notes)
}
