//! STRUCTURED_POINTS, RECTILINEAR_GRID and STRUCTURED_GRID of legacy files.

use glam::DVec3;
use vacua_volume::{
    Association, CurvilinearGrid, DataArray, Dataset, Geometry, RectilinearGrid, UniformGrid,
};

use super::array::{ElementType, LegacyArray};
use super::attributes::{Attributes, skip_field_data};
use super::cursor::Cursor;
use crate::error::Problem;
use crate::vtk::extent::Extent;
use crate::vtk::ghost;
use crate::vtk::xml::as_float;

/// What the lines before POINT_DATA and CELL_DATA said.
#[derive(Default)]
struct Head {
    extent: Option<Extent>,
    origin: Option<[f64; 3]>,
    spacing: Option<[f64; 3]>,
    coordinates: [Option<DataArray>; 3],
    positions: Option<DataArray>,
}

impl Head {
    /// Reads up to the first section or the end of the file.
    fn read(cursor: &mut Cursor<'_>) -> Result<Self, Problem> {
        let mut head = Self::default();
        while !cursor.is_at_end() {
            let next = cursor.peek().to_ascii_lowercase();
            if matches!(next.as_slice(), b"point_data" | b"cell_data") {
                break;
            }
            let place = cursor.place();
            let keyword = cursor.keyword();
            match keyword.as_str() {
                "dimensions" => {
                    let points = cursor.numbers("three dimensions")?;
                    head.extent = Some(Extent::of_points(&place, points)?);
                }
                "extent" => {
                    let [x0, x1, y0, y1, z0, z1]: [i32; 6] = cursor.numbers("six indices")?;
                    head.extent = Some(Extent {
                        lo: [x0, y0, z0].map(i64::from),
                        hi: [x1, y1, z1].map(i64::from),
                    });
                }
                "origin" => head.origin = Some(cursor.numbers("an origin")?),
                "spacing" | "aspect_ratio" => head.spacing = Some(cursor.numbers("a spacing")?),
                "x_coordinates" => head.coordinates[0] = Some(array(cursor, &keyword, 1)?),
                "y_coordinates" => head.coordinates[1] = Some(array(cursor, &keyword, 1)?),
                "z_coordinates" => head.coordinates[2] = Some(array(cursor, &keyword, 1)?),
                "points" => head.positions = Some(array(cursor, &keyword, 3)?),
                "field" => skip_field_data(cursor)?,
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
        Ok(head)
    }

    fn extent(&self) -> Result<Extent, Problem> {
        let extent = self
            .extent
            .ok_or_else(|| Problem::malformed("the data set", "DIMENSIONS", "none"))?;
        extent.refuse_flat()?;
        Ok(extent)
    }
}

/// An array whose length and type follow, and with them its numbers.
pub(super) fn array(
    cursor: &mut Cursor<'_>,
    what: &str,
    components: usize,
) -> Result<DataArray, Problem> {
    let tuples = cursor.number("a number of tuples")?;
    let place = cursor.place();
    let element_type = ElementType::from_name(place.clone(), cursor.word())?;
    LegacyArray::locate(cursor, what, element_type, components, tuples)?
        .ok_or_else(|| Problem::malformed(place, "a number type", "bits or strings"))?
        .read(cursor.source())
}

/// Reads STRUCTURED_POINTS, whose keyword has been read.
///
/// # Errors
/// [`Problem`] where the file breaks the rules.
pub(super) fn read_points(mut cursor: Cursor<'_>) -> Result<Dataset, Problem> {
    let head = Head::read(&mut cursor)?;
    let extent = head.extent()?;
    let origin = DVec3::from_array(head.origin.unwrap_or([0.0; 3]));
    let spacing = DVec3::from_array(head.spacing.unwrap_or([1.0; 3]));
    let first = DVec3::from_array(extent.lo.map(|i| i as f64));
    let grid = UniformGrid::new(extent.points(), origin + spacing * first, spacing)?;
    finish(cursor, &extent, Geometry::Uniform(grid))
}

/// Reads RECTILINEAR_GRID, whose keyword has been read.
///
/// # Errors
/// [`Problem`] where the file breaks the rules.
pub(super) fn read_rectilinear(mut cursor: Cursor<'_>) -> Result<Dataset, Problem> {
    let head = Head::read(&mut cursor)?;
    let extent = head.extent()?;
    let coordinates = |axis: usize| {
        let name = ["X_COORDINATES", "Y_COORDINATES", "Z_COORDINATES"][axis];
        let expected = extent.points()[axis];
        let array = head.coordinates[axis]
            .as_ref()
            .ok_or_else(|| Problem::malformed("the data set", name, "none"))?;
        if array.tuples() != expected {
            return Err(Problem::malformed(
                name,
                format!("{expected} numbers, as DIMENSIONS says"),
                array.tuples().to_string(),
            ));
        }
        Ok((0..expected).map(|i| array.get_f64(i, 0)).collect())
    };
    let grid = RectilinearGrid::new(coordinates(0)?, coordinates(1)?, coordinates(2)?)?;
    finish(cursor, &extent, Geometry::Rectilinear(grid))
}

/// Reads STRUCTURED_GRID, whose keyword has been read.
///
/// # Errors
/// [`Problem`] where the file breaks the rules.
pub(super) fn read_curvilinear(mut cursor: Cursor<'_>) -> Result<Dataset, Problem> {
    let head = Head::read(&mut cursor)?;
    let extent = head.extent()?;
    let positions = head
        .positions
        .ok_or_else(|| Problem::malformed("the data set", "POINTS", "none"))?;
    let grid = CurvilinearGrid::new(extent.points(), as_float(positions)?)?;
    finish(cursor, &extent, Geometry::Curvilinear(grid))
}

/// Reads the fields and puts them onto the grid.
fn finish(mut cursor: Cursor<'_>, extent: &Extent, geometry: Geometry) -> Result<Dataset, Problem> {
    let num_points = extent.count(Association::Point)?;
    let num_cells = extent.count(Association::Cell)?;
    let attributes = Attributes::read(&mut cursor, num_points, num_cells)?;
    let mask = ghost::blanked_cells(
        extent.points(),
        attributes.point_flags.as_ref(),
        attributes.cell_flags.as_ref(),
    )?;
    let mut dataset = Dataset::new(geometry, attributes.fields)?.with_field_data(cursor.skipped);
    if let Some(mask) = mask {
        dataset = dataset.with_blanked_cells(mask)?;
    }
    Ok(attributes
        .notes
        .into_iter()
        .fold(dataset, Dataset::with_note))
}
