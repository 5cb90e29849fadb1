//! POINT_DATA and CELL_DATA: the fields of a legacy file.

use std::sync::Arc;

use vacua_volume::{Association, DataArray, Field, LoadError, ScalarType};

use super::array::{ElementType, LegacyArray};
use super::cursor::Cursor;
use crate::error::Problem;
use crate::source::Source;
use crate::vtk::GHOST_ARRAY;

/// Everything that lies on points or cells.
#[derive(Default)]
pub(super) struct Attributes {
    /// The fields, in file order.
    pub fields: Vec<Field>,
    /// `vtkGhostType` on points.
    pub point_flags: Option<DataArray>,
    /// `vtkGhostType` on cells.
    pub cell_flags: Option<DataArray>,
    /// What was left out.
    pub notes: Vec<String>,
}

impl Attributes {
    /// Reads the sections from here to the end of the file.
    ///
    /// # Errors
    /// [`Problem::Malformed`] where the file breaks the rules or has other numbers of points or
    /// cells than the grid.
    pub fn read(
        cursor: &mut Cursor<'_>,
        num_points: usize,
        num_cells: usize,
    ) -> Result<Self, Problem> {
        let mut attributes = Self::default();
        let mut section: Option<(Association, usize)> = None;
        while !cursor.is_at_end() {
            let place = cursor.place();
            let keyword = cursor.keyword();
            let opened = match keyword.as_str() {
                "point_data" => Some((Association::Point, num_points)),
                "cell_data" => Some((Association::Cell, num_cells)),
                _ => None,
            };
            if let Some((_, expected)) = opened {
                let found: usize = cursor.number("a number of tuples")?;
                if found != expected {
                    return Err(Problem::malformed(
                        place,
                        format!("{} {expected}", keyword.to_uppercase()),
                        found.to_string(),
                    ));
                }
                section = opened;
                continue;
            }
            match (keyword.as_str(), section) {
                ("metadata", _) => cursor.skip_metadata(),
                ("field", None) => skip_field_data(cursor)?,
                (_, Some((association, tuples))) => {
                    attributes.read_one(cursor, &keyword, place, association, tuples)?;
                }
                (other, None) => {
                    return Err(Problem::malformed(
                        place,
                        "POINT_DATA or CELL_DATA",
                        format!("`{other}`"),
                    ));
                }
            }
        }
        Ok(attributes)
    }

    /// Reads one attribute, whose keyword has been read.
    fn read_one(
        &mut self,
        cursor: &mut Cursor<'_>,
        keyword: &str,
        place: String,
        association: Association,
        tuples: usize,
    ) -> Result<(), Problem> {
        match keyword {
            "field" => return self.read_field(cursor, association, tuples),
            "lookup_table" => return skip_lookup_table(cursor),
            "color_scalars" => return self.read_colors(cursor, association, tuples),
            _ => {}
        }
        let components = match keyword {
            "vectors" | "normals" => Some(3),
            "tensors" => Some(9),
            "tensors6" => Some(6),
            "global_ids" | "pedigree_ids" | "edge_flags" => Some(1),
            "scalars" | "texture_coordinates" => None,
            other => {
                return Err(Problem::malformed(
                    place,
                    "an attribute (SCALARS, VECTORS, FIELD …)",
                    format!("`{other}`"),
                ));
            }
        };
        let name = cursor.name();
        let components = match components {
            Some(components) => components,
            None if keyword == "texture_coordinates" => cursor.number("a number of dimensions")?,
            None => 1,
        };
        let type_place = cursor.place();
        let element_type = ElementType::from_name(type_place, cursor.word())?;
        let components = if keyword == "scalars" {
            let components = match cursor.peek() {
                word if word.first().is_some_and(u8::is_ascii_digit) && !cursor.is_line_over() => {
                    cursor.number("a number of components")?
                }
                _ => components,
            };
            if cursor.peek().eq_ignore_ascii_case(b"lookup_table") {
                cursor.word();
                cursor.word();
            }
            components
        } else {
            components
        };
        let array = LegacyArray::locate(
            cursor,
            &format!("array `{name}`"),
            element_type,
            components,
            tuples,
        )?;
        self.add(cursor.source(), name, association, array)
    }

    /// Reads FIELD: arrays that each say how long they are.
    fn read_field(
        &mut self,
        cursor: &mut Cursor<'_>,
        association: Association,
        expected: usize,
    ) -> Result<(), Problem> {
        walk_field_data(cursor, |cursor, name, tuples, array| {
            if tuples == expected {
                return self.add(cursor.source(), name, association, array);
            }
            self.notes.push(format!(
                "array `{name}` has {tuples} tuples for {expected} {association}s and is left out"
            ));
            Ok(())
        })
    }

    /// Reads COLOR_SCALARS: bytes in binary files, numbers from 0 to 1 in ASCII files, which
    /// become bytes as VTK makes them (255 times the number, rounded).
    fn read_colors(
        &mut self,
        cursor: &mut Cursor<'_>,
        association: Association,
        tuples: usize,
    ) -> Result<(), Problem> {
        let name = cursor.name();
        let components = cursor.number("a number of components")?;
        let what = format!("array `{name}`");
        let element_type = ElementType::Number(ScalarType::U8);
        let array = LegacyArray::locate(cursor, &what, element_type, components, tuples)?;
        let array = match array {
            Some(array) if array.is_text() => array.parsed_as(ScalarType::F32),
            array => return self.add(cursor.source(), name, association, array),
        };
        let source = cursor.source().clone();
        let load = move || {
            let values = array.read(&source)?;
            let values = values.as_slice::<f32>().unwrap_or_default();
            let bytes = values
                .iter()
                .map(|v| (255.0 * f64::from(*v) + 0.5) as u8)
                .collect::<Vec<u8>>();
            Ok(DataArray::from_vec(bytes, components)?)
        };
        let load = move || load().map_err(|problem: Problem| Arc::new(problem) as LoadError);
        self.fields.push(Field::lazy(
            name,
            association,
            ScalarType::U8,
            components,
            tuples,
            load,
        ));
        Ok(())
    }

    /// Adds an array that was found: as ghost flags, as a field, or as a note.
    fn add(
        &mut self,
        source: &Source,
        name: String,
        association: Association,
        array: Option<LegacyArray>,
    ) -> Result<(), Problem> {
        let Some(array) = array else {
            self.notes.push(format!(
                "array `{name}` holds bits or strings and is left out"
            ));
            return Ok(());
        };
        if name == GHOST_ARRAY {
            let flags = Some(array.read(source)?);
            match association {
                Association::Point => self.point_flags = flags,
                Association::Cell => self.cell_flags = flags,
            }
            return Ok(());
        }
        let source = source.clone();
        self.fields.push(Field::lazy(
            name,
            association,
            array.scalar_type,
            array.components,
            array.tuples,
            move || {
                array
                    .read(&source)
                    .map_err(|problem| Arc::new(problem) as LoadError)
            },
        ));
        Ok(())
    }
}

/// Moves over FIELD data that belongs to the whole data set, whose keyword has been read; the cursor
/// keeps the names.
///
/// # Errors
/// [`Problem`] where it breaks the rules.
pub(super) fn skip_field_data(cursor: &mut Cursor<'_>) -> Result<(), Problem> {
    let mut names = Vec::new();
    walk_field_data(cursor, |_, name, _, _| {
        names.push(name);
        Ok(())
    })?;
    cursor.skipped.append(&mut names);
    Ok(())
}

/// Walks over the arrays of FIELD, whose keyword has been read.
fn walk_field_data<'a>(
    cursor: &mut Cursor<'a>,
    mut found: impl FnMut(&Cursor<'a>, String, usize, Option<LegacyArray>) -> Result<(), Problem>,
) -> Result<(), Problem> {
    cursor.word();
    let count: usize = cursor.number("a number of arrays")?;
    for _ in 0..count {
        if cursor.peek().eq_ignore_ascii_case(b"metadata") {
            cursor.word();
            cursor.skip_metadata();
        }
        let name = cursor.name();
        if name == "NULL_ARRAY" {
            continue;
        }
        let [components, tuples] = cursor.numbers("a number of components or tuples")?;
        let place = cursor.place();
        let element_type = ElementType::from_name(place, cursor.word())?;
        let what = format!("array `{name}`");
        if components == 0 || tuples == 0 {
            cursor.line();
            continue;
        }
        let array = LegacyArray::locate(cursor, &what, element_type, components, tuples)?;
        found(cursor, name, tuples, array)?;
    }
    Ok(())
}

/// Moves over a lookup table, whose keyword has been read: RGBA, bytes or numbers from 0 to 1.
fn skip_lookup_table(cursor: &mut Cursor<'_>) -> Result<(), Problem> {
    let name = cursor.name();
    let entries: usize = cursor.number("a number of colours")?;
    let what = format!("lookup table `{name}`");
    let element_type = ElementType::Number(ScalarType::U8);
    LegacyArray::locate(cursor, &what, element_type, 4, entries).map(drop)
}
