//! Structured grids: uniform, rectilinear and curvilinear. Lengths are written z first, and so are the
//! origin and the spacing.

use std::sync::Arc;

use glam::DVec3;
use vacua_volume::{
    Association, CurvilinearGrid, Dataset, Field, Geometry, LoadError, RectilinearGrid, UniformGrid,
};

use super::attributes;
use super::document::Document;
use super::item::{Item, lens};
use super::topology::Structured;
use super::unstructured::positions;
use super::word;
use crate::error::Problem;
use crate::vtk::xml::document::Element;

/// Reads a grid with the topology that it has.
///
/// # Errors
/// [`Problem`] where it breaks the rules.
pub(super) fn read(
    document: &Arc<Document>,
    grid: &Element,
    topology: &Element,
    kind: Structured,
    mut notes: Vec<String>,
) -> Result<Dataset, Problem> {
    let points = points(topology)?;
    let geometry = document.child(grid, "Geometry")?;
    let geometry = match kind {
        Structured::Uniform => Geometry::Uniform(uniform(document, geometry, points)?),
        Structured::Rectilinear => Geometry::Rectilinear(rectilinear(document, geometry, points)?),
        Structured::Curvilinear => {
            let positions = positions(document, geometry)?;
            Geometry::Curvilinear(CurvilinearGrid::new(points, positions)?)
        }
    };
    let cells = points.map(|n| n.saturating_sub(1));
    let count = |n: [usize; 3]| n[0].saturating_mul(n[1]).saturating_mul(n[2]);
    let (num_points, num_cells) = (count(points), count(cells));
    let mut fields = Vec::new();
    for attribute in attributes::list(document, grid, [num_points, num_cells], &mut notes)? {
        let attributes::Attribute {
            name,
            association,
            components,
            item,
        } = attribute;
        let tuples = match association {
            Association::Point => num_points,
            Association::Cell => num_cells,
        };
        let scalar_type = item.scalar_type;
        let load = move || {
            let loaded = item.load(components);
            loaded.map_err(|problem| Arc::new(item.in_file(problem)) as LoadError)
        };
        fields.push(Field::lazy(
            name,
            association,
            scalar_type,
            components,
            tuples,
            load,
        ));
    }
    let dataset = Dataset::new(geometry, fields)?;
    Ok(notes.into_iter().fold(dataset, Dataset::with_note))
}

/// Points a side, x first.
fn points(topology: &Element) -> Result<[usize; 3], Problem> {
    let found = match lens(topology, "Dimensions")? {
        Some(lens) => Some(lens),
        None => lens(topology, "NumberOfElements")?,
    };
    match found.as_deref() {
        Some(&[z, y, x]) => Ok([x, y, z]),
        other => Err(Problem::malformed(
            topology.place(),
            "`Dimensions` of three lengths",
            format!("{:?}", other.unwrap_or_default()),
        )),
    }
}

/// The items of a geometry that must be of one form.
fn items(
    document: &Arc<Document>,
    geometry: &Element,
    form: &str,
    count: usize,
) -> Result<Vec<Item>, Problem> {
    let kind = word(geometry, &["GeometryType", "Type"], "XYZ");
    if kind != form {
        return Err(Problem::unsupported_but(
            format!(
                "{}: the geometry `{kind}` for this topology",
                geometry.place()
            ),
            format!("`{form}` is what fits it"),
        ));
    }
    let elements = document.children(geometry, "DataItem")?;
    if elements.len() != count {
        return Err(Problem::malformed(
            geometry.place(),
            format!("{count} data items"),
            elements.len().to_string(),
        ));
    }
    let parse = |element: &&Element| Item::parse(document, element, None);
    elements.iter().map(parse).collect()
}

fn uniform(
    document: &Arc<Document>,
    geometry: &Element,
    points: [usize; 3],
) -> Result<UniformGrid, Problem> {
    let items = items(document, geometry, "ORIGIN_DXDYDZ", 2)?;
    let three = |item: &Item| -> Result<DVec3, Problem> {
        match item.small()?.as_slice() {
            &[z, y, x] => Ok(DVec3::new(x, y, z)),
            other => Err(Problem::malformed(
                &item.what,
                "3 numbers",
                other.len().to_string(),
            )),
        }
    };
    Ok(UniformGrid::new(
        points,
        three(&items[0])?,
        three(&items[1])?,
    )?)
}

fn rectilinear(
    document: &Arc<Document>,
    geometry: &Element,
    points: [usize; 3],
) -> Result<RectilinearGrid, Problem> {
    let items = items(document, geometry, "VXVYVZ", 3)?;
    let mut axes: [Vec<f64>; 3] = Default::default();
    for ((axis, item), points) in axes.iter_mut().zip(&items).zip(points) {
        *axis = item.small()?;
        if axis.len() != points {
            return Err(Problem::malformed(
                &item.what,
                format!("{points} coordinates"),
                axis.len().to_string(),
            ));
        }
    }
    let [x, y, z] = axes;
    Ok(RectilinearGrid::new(x, y, z)?)
}
