//! `UnstructuredGrid`: partitions one after the other in each array, steps one after the other.

use std::borrow::Cow;
use std::sync::Arc;

use glam::DVec3;
use vacua_volume::{Association, DataArray};

use super::arrays::StepArrays;
use super::steps::Steps;
use crate::error::Problem;
use crate::hdf5::Container;
use crate::mesh::kind::vtk::POLYHEDRON;
use crate::mesh::{
    Ends, ListedFaces, Part, PartField, SourceCells, assemble, cell_types, index_at, widened,
};
use crate::vtk::as_float;

/// Most partitions of a step.
const MAX_PARTS: usize = 1 << 20;

/// Where something begins, moved on by partition after partition.
#[derive(Clone, Copy, Debug, Default)]
struct Places {
    points: usize,
    cells: usize,
    ids: usize,
    faces: usize,
    face_ids: usize,
    polyhedron_ids: usize,
    /// Arrays of ends have one number more for each partition before.
    parts: usize,
}

/// The sizes of one partition.
#[derive(Clone, Copy, Debug, Default)]
struct Sizes {
    points: usize,
    cells: usize,
    ids: usize,
    faces: usize,
    face_ids: usize,
    polyhedron_ids: usize,
}

impl Places {
    fn after(self, part: &Sizes) -> Option<Self> {
        Some(Self {
            points: self.points.checked_add(part.points)?,
            cells: self.cells.checked_add(part.cells)?,
            ids: self.ids.checked_add(part.ids)?,
            faces: self.faces.checked_add(part.faces)?,
            face_ids: self.face_ids.checked_add(part.face_ids)?,
            polyhedron_ids: self.polyhedron_ids.checked_add(part.polyhedron_ids)?,
            parts: self.parts.checked_add(1)?,
        })
    }
}

/// Reads the partitions of a step.
///
/// # Errors
/// [`Problem`] where they break the rules.
pub(super) fn read(
    file: &Container,
    data_set: &str,
    steps: &Steps<'_>,
    step: usize,
    notes: &mut Vec<String>,
) -> Result<Vec<Part>, Problem> {
    let sizes = sizes(file, data_set, steps, step)?;
    let start = Places {
        points: steps.of("PointOffsets", step)?.unwrap_or(0),
        cells: steps.of("CellOffsets", step)?.unwrap_or(0),
        ids: steps.of("ConnectivityIdOffsets", step)?.unwrap_or(0),
        faces: steps.of("FaceOffsetsOffsets", step)?.unwrap_or(0),
        face_ids: steps.of("FaceConnectivityOffsets", step)?.unwrap_or(0),
        polyhedron_ids: steps.of("PolyhedronToFaceIdOffsets", step)?.unwrap_or(0),
        parts: steps.of("PartOffsets", step)?.unwrap_or(0),
    };
    let arrays = StepArrays::list(file, data_set, steps, step, notes)?;
    let reader = Reader {
        file,
        data_set,
        arrays,
        start,
    };
    let mut at = start;
    let mut parts = Vec::with_capacity(sizes.len());
    for part in &sizes {
        parts.push(reader.part(&at, part)?);
        at = at.after(part).ok_or_else(|| {
            Problem::malformed(
                format!("group `{data_set}`"),
                "partitions that fit the address space",
                "larger ones",
            )
        })?;
    }
    Ok(parts)
}

/// The sizes of the partitions of a step.
fn sizes(
    file: &Container,
    data_set: &str,
    steps: &Steps<'_>,
    step: usize,
) -> Result<Vec<Sizes>, Problem> {
    let points = file.need(&format!("{data_set}/NumberOfPoints"))?;
    let first = steps.of("PartOffsets", step)?.unwrap_or(0);
    let count = match steps.of("NumberOfParts", step)? {
        Some(count) => count,
        None => {
            // As many for every step, unless there are fewer than steps: then they never change.
            let (rows, steps) = (points.rows(), steps.times.len().max(1));
            if rows.is_multiple_of(steps) {
                rows / steps
            } else {
                rows
            }
        }
    };
    if count > MAX_PARTS {
        return Err(Problem::unsupported(format!("{count} partitions")));
    }
    let column = |name: &str, required: bool| -> Result<Vec<usize>, Problem> {
        let path = format!("{data_set}/{name}");
        let array = match file.array(&path)? {
            Some(array) => array,
            None if !required => return Ok(vec![0; count]),
            None => file.need(&path)?,
        };
        let numbers = widened(array.read_rows(first, count)?, array.what())?;
        let all: Option<Vec<usize>> = (0..count).map(|i| index_at(&numbers, i)).collect();
        all.ok_or_else(|| {
            Problem::malformed(array.what(), "numbers that are not negative", "others")
        })
    };
    let points = column("NumberOfPoints", true)?;
    let cells = column("NumberOfCells", true)?;
    let ids = column("NumberOfConnectivityIds", true)?;
    let faces = column("NumberOfFaces", false)?;
    let face_ids = column("NumberOfFaceConnectivityIds", false)?;
    let polyhedron_ids = column("NumberOfPolyhedronToFaceIds", false)?;
    let part = |i: usize| Sizes {
        points: points[i],
        cells: cells[i],
        ids: ids[i],
        faces: faces[i],
        face_ids: face_ids[i],
        polyhedron_ids: polyhedron_ids[i],
    };
    Ok((0..count).map(part).collect())
}

struct Reader<'a> {
    file: &'a Container,
    data_set: &'a str,
    arrays: StepArrays,
    /// Where the step begins.
    start: Places,
}

impl Reader<'_> {
    fn rows(&self, name: &str, first: usize, rows: usize) -> Result<DataArray, Problem> {
        let array = self.file.need(&format!("{}/{name}", self.data_set))?;
        array.read_rows(first, rows)
    }

    /// One column of integers.
    fn integers(&self, name: &str, first: usize, rows: usize) -> Result<DataArray, Problem> {
        let what = format!("array `{}/{name}`", self.data_set);
        let array = self.rows(name, first, rows)?;
        if array.components() != 1 {
            return Err(Problem::malformed(
                what,
                "one column",
                array.components().to_string(),
            ));
        }
        widened(array, &what)
    }

    fn part(&self, at: &Places, size: &Sizes) -> Result<Part, Problem> {
        let positions = as_float(self.rows("Points", at.points, size.points)?)?;
        if positions.components() != 3 {
            return Err(Problem::malformed(
                format!("array `{}/Points`", self.data_set),
                "3 numbers a point",
                positions.components().to_string(),
            ));
        }
        let position = |point: u64| {
            let point = usize::try_from(point)
                .ok()
                .filter(|&p| p < positions.tuples())?;
            let at = |axis| positions.get_f64(point, axis);
            Some(DVec3::new(at(0), at(1), at(2)))
        };
        let what = format!("array `{}/Types`", self.data_set);
        let types = cell_types(&self.rows("Types", at.cells, size.cells)?, &what)?;
        let ends = self.ends("Offsets", at, size.cells)?;
        let faces = if types.contains(&POLYHEDRON) {
            Some(self.faces(at, size)?)
        } else {
            None
        };
        let of_cell = |cell: usize, _: &[u64]| {
            let found = faces.as_ref().and_then(|faces| faces.of_cell(cell));
            found.ok_or_else(|| {
                Problem::malformed(
                    format!("polyhedron {cell}"),
                    "faces in their arrays",
                    "places outside them",
                )
            })
        };
        let cells = assemble(
            &SourceCells {
                types: Cow::Owned(types),
                ends: Some(Ends::Array {
                    array: &ends,
                    skip: 0,
                }),
                connectivity: self.integers("Connectivity", at.ids, size.ids)?,
                faces: Some(&of_cell),
                what: format!("group `{}`", self.data_set),
            },
            &position,
        )?;
        let [point_flags, cell_flags] = self.flags(at, size)?;
        Ok(Part {
            fields: self.fields(at, size),
            positions,
            cells,
            point_flags,
            cell_flags,
        })
    }

    /// Where things end; the 0 before the first one is left out.
    fn ends(&self, name: &str, at: &Places, cells: usize) -> Result<DataArray, Problem> {
        let first = at.cells.saturating_add(at.parts).saturating_add(1);
        self.integers(name, first, cells)
    }

    fn faces(&self, at: &Places, size: &Sizes) -> Result<ListedFaces, Problem> {
        let first_end = at.faces.saturating_add(at.parts).saturating_add(1);
        Ok(ListedFaces::new(
            self.integers("FaceConnectivity", at.face_ids, size.face_ids)?,
            self.integers("FaceOffsets", first_end, size.faces)?,
            self.integers("PolyhedronToFaces", at.polyhedron_ids, size.polyhedron_ids)?,
            self.ends("PolyhedronOffsets", at, size.cells)?,
        ))
    }

    /// How many points or cells of the step come before a partition, the place where those of the
    /// step begin, and how many the partition has.
    fn span(&self, association: Association, at: &Places, size: &Sizes) -> (usize, usize, usize) {
        match association {
            Association::Point => (
                at.points - self.start.points,
                self.start.points,
                size.points,
            ),
            Association::Cell => (at.cells - self.start.cells, self.start.cells, size.cells),
        }
    }

    fn flags(&self, at: &Places, size: &Sizes) -> Result<[Option<DataArray>; 2], Problem> {
        let mut both = [None, None];
        for (found, array) in both.iter_mut().zip(&self.arrays.flags) {
            if let Some(array) = array {
                let (before, start, rows) = self.span(array.association, at, size);
                *found = Some(array.read(array.rows(start, before), rows)?);
            }
        }
        Ok(both)
    }

    fn fields(&self, at: &Places, size: &Sizes) -> Vec<PartField> {
        let mut fields = Vec::with_capacity(self.arrays.fields.len());
        for field in &self.arrays.fields {
            let Ok(scalar_type) = field.array.scalar_type() else {
                continue;
            };
            let (before, start, rows) = self.span(field.association, at, size);
            let first = field.rows(start, before);
            let (to_load, to_check) = (field.array.clone(), field.array.clone());
            let components = field.array.row_len();
            fields.push(PartField {
                name: field.name.clone(),
                association: field.association,
                scalar_type,
                components,
                load: Arc::new(move || to_load.read_rows(first, rows)),
                check: Arc::new(move || {
                    to_check.check(first.saturating_mul(components), components, rows)
                }),
            });
        }
        fields
    }
}
