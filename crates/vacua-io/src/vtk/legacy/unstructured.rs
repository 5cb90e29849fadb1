//! UNSTRUCTURED_GRID of legacy files: CELLS as lists that begin with their length (until 4.2), or as
//! OFFSETS and CONNECTIVITY (5.x).

use std::borrow::Cow;

use glam::DVec3;
use vacua_volume::{DataArray, Dataset, ScalarType};

use super::array::{ElementType, LegacyArray};
use super::attributes::{Attributes, skip_field_data};
use super::cursor::Cursor;
use super::structured::array;
use crate::error::Problem;
use crate::mesh::{
    Ends, Faces, Part, PartField, SourceCells, assemble, faces_of_stream, index_at, join, widened,
};
use crate::vtk::as_float;

/// Cells before their types are known.
struct Cells {
    /// Where each ends.
    ends: Vec<u64>,
    /// The points of all.
    connectivity: DataArray,
}

/// Reads UNSTRUCTURED_GRID, whose keyword has been read, from a file of a major version.
///
/// # Errors
/// [`Problem`] where the file breaks the rules.
pub(super) fn read(mut cursor: Cursor<'_>, major: u32) -> Result<Dataset, Problem> {
    let (mut positions, mut cells, mut types) = (None, None, None);
    while !cursor.is_at_end() {
        let next = cursor.peek().to_ascii_lowercase();
        if matches!(next.as_slice(), b"point_data" | b"cell_data") {
            break;
        }
        let place = cursor.place();
        let keyword = cursor.keyword();
        match keyword.as_str() {
            "points" => positions = Some(as_float(array(&mut cursor, "points", 3)?)?),
            "cells" if major >= 5 => cells = Some(read_offsets(&mut cursor)?),
            "cells" => cells = Some(read_lists(&mut cursor)?),
            "cell_types" => {
                let count = cursor.number("a number of cells")?;
                types = Some(read_types(&integers(&mut cursor, "cell types", count)?)?);
            }
            "field" => skip_field_data(&mut cursor)?,
            "metadata" => cursor.skip_metadata(),
            other => {
                return Err(Problem::malformed(
                    place,
                    "a keyword of the data set's head",
                    format!("`{other}`"),
                ));
            }
        }
    }
    let missing = |what: &str| Problem::malformed("the data set", what, "none");
    let positions = match positions {
        Some(positions) => positions,
        None => return Err(missing("POINTS")),
    };
    let (ends, connectivity, types) = match (cells, types) {
        (Some(Cells { ends, connectivity }), Some(types)) => (ends, connectivity, types),
        (None, None) => (
            Vec::new(),
            DataArray::from_vec(Vec::<u32>::new(), 1)?,
            Vec::new(),
        ),
        (None, _) => return Err(missing("CELLS")),
        (_, None) => return Err(missing("CELL_TYPES")),
    };
    let num_points = positions.tuples();
    let at = |point: u64| {
        let point = usize::try_from(point).ok().filter(|&p| p < num_points)?;
        let at = |axis| positions.get_f64(point, axis);
        Some(DVec3::new(at(0), at(1), at(2)))
    };
    let faces =
        |cell: usize, stream: &[u64]| faces_of_stream(&format!("polyhedron {cell}"), stream);
    let faces: &Faces<'_> = &faces;
    let cells = assemble(
        &SourceCells {
            types: Cow::Owned(types),
            ends: Some(Ends::List(ends)),
            connectivity,
            faces: Some(faces),
            what: "CELLS".to_owned(),
        },
        &at,
    )?;
    let attributes = Attributes::read(&mut cursor, num_points, cells.num_source_cells)?;
    let fields = attributes.fields.into_iter().map(PartField::from_field);
    let part = Part {
        fields: fields.collect(),
        positions,
        cells,
        point_flags: attributes.point_flags,
        cell_flags: attributes.cell_flags,
    };
    Ok(join(vec![part], attributes.notes)?.with_field_data(cursor.skipped))
}

/// Integers of legacy 32 bits.
fn integers(cursor: &mut Cursor<'_>, what: &str, count: usize) -> Result<DataArray, Problem> {
    let place = cursor.place();
    let element_type = ElementType::Number(ScalarType::I32);
    LegacyArray::locate(cursor, what, element_type, 1, count)?
        .ok_or_else(|| Problem::malformed(place, "integers", "none"))?
        .read(cursor.source())
}

/// CELLS n size: for each cell its number of points, and the points.
fn read_lists(cursor: &mut Cursor<'_>) -> Result<Cells, Problem> {
    let [count, size]: [usize; 2] = cursor.numbers("a number of cells and one of integers")?;
    let place = cursor.place();
    let all = integers(cursor, "cells", size)?;
    let all = all.as_slice::<i32>().unwrap_or_default();
    let wrong = |cell: usize| {
        Problem::malformed(
            &place,
            format!("the points of {count} cells in {size} integers"),
            format!("another length at cell {cell}"),
        )
    };
    if count > size {
        return Err(wrong(size));
    }
    let mut connectivity = Vec::with_capacity(size - count);
    let mut ends = Vec::with_capacity(count);
    let mut rest = all;
    for cell in 0..count {
        let (&len, after) = rest.split_first().ok_or_else(|| wrong(cell))?;
        let len = usize::try_from(len).map_err(|_| wrong(cell))?;
        let (points, after) = after.split_at_checked(len).ok_or_else(|| wrong(cell))?;
        connectivity.extend_from_slice(points);
        ends.push(connectivity.len() as u64);
        rest = after;
    }
    if !rest.is_empty() {
        return Err(wrong(count));
    }
    Ok(Cells {
        ends,
        connectivity: DataArray::from_vec(connectivity, 1)?,
    })
}

/// CELLS n+1 m, OFFSETS, CONNECTIVITY.
fn read_offsets(cursor: &mut Cursor<'_>) -> Result<Cells, Problem> {
    let [num_offsets, size]: [usize; 2] =
        cursor.numbers("a number of offsets and one of points")?;
    let mut numbers = |keyword: &str, count: usize| -> Result<DataArray, Problem> {
        let place = cursor.place();
        let found = cursor.keyword();
        if found != keyword {
            return Err(Problem::malformed(
                place,
                keyword.to_uppercase(),
                format!("`{found}`"),
            ));
        }
        let place = cursor.place();
        let element_type = ElementType::from_name(place.clone(), cursor.word())?;
        let numbers = LegacyArray::locate(cursor, keyword, element_type, 1, count)?
            .ok_or_else(|| Problem::malformed(place, "an integer type", "bits or strings"))?
            .read(cursor.source())?;
        widened(numbers, keyword)
    };
    if num_offsets == 0 {
        return Ok(Cells {
            ends: Vec::new(),
            connectivity: DataArray::from_vec(Vec::<u32>::new(), 1)?,
        });
    }
    let offsets = numbers("offsets", num_offsets)?;
    let connectivity = numbers("connectivity", size)?;
    if index_at(&offsets, 0) != Some(0) {
        return Err(Problem::malformed("OFFSETS", "0 first", "another number"));
    }
    let ends = (1..num_offsets).map(|i| {
        let end = index_at(&offsets, i).map(|end| end as u64);
        end.ok_or_else(|| {
            Problem::malformed("OFFSETS", "no negative number", format!("one at {i}"))
        })
    });
    Ok(Cells {
        ends: ends.collect::<Result<_, _>>()?,
        connectivity,
    })
}

fn read_types(array: &DataArray) -> Result<Vec<u8>, Problem> {
    let all = array.as_slice::<i32>().unwrap_or_default();
    all.iter()
        .map(|&t| {
            u8::try_from(t).map_err(|_| {
                Problem::malformed("CELL_TYPES", "numbers from 0 to 255", t.to_string())
            })
        })
        .collect()
}
