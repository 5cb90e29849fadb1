//! Unstructured grids: positions, cells of one kind or mixed, values.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::Arc;

use glam::DVec3;
use vacua_volume::{DataArray, ScalarType};

use super::attributes;
use super::document::Document;
use super::item::{Item, lens};
use super::topology::{Cells, POLYHEDRON, mixed_kind, of_points};
use super::word;
use crate::error::Problem;
use crate::mesh::kind::{Treatment, kind, vtk};
use crate::mesh::{Ends, Part, PartField, SourceCells, assemble, index_at, widened};
use crate::vtk::as_float;
use crate::vtk::xml::document::Element;

/// Reads a grid with the topology that it has.
///
/// # Errors
/// [`Problem`] where it breaks the rules.
pub(super) fn read(
    document: &Arc<Document>,
    grid: &Element,
    topology: &Element,
    cells: &Cells,
    notes: &mut Vec<String>,
) -> Result<Part, Problem> {
    let positions = positions(document, document.child(grid, "Geometry")?)?;
    let num_points = positions.tuples();
    let position = |point: u64| {
        let point = usize::try_from(point).ok().filter(|&p| p < num_points)?;
        let at = |axis| positions.get_f64(point, axis);
        Some(DVec3::new(at(0), at(1), at(2)))
    };
    if topology.attribute("Order").is_some() {
        return Err(Problem::unsupported(format!(
            "{}: nodes in an order of their own",
            topology.place()
        )));
    }
    let item = document.child(topology, "DataItem")?;
    let item = Item::parse(document, item, Some(ScalarType::I64))?;
    let announced = num_elements(topology)?;
    let numbers = based(widened(item.load(1)?, &item.what)?, topology)?;
    let listed = match cells {
        Cells::Uniform(kind, width) => Listed::uniform(numbers, *kind, *width, &item.what)?,
        Cells::Mixed => Listed::mixed(&numbers, num_points, announced, &item.what)?,
    };
    if announced.is_some_and(|n| n != listed.types.len()) {
        return Err(Problem::malformed(
            topology.place(),
            format!("{} elements", announced.unwrap_or(0)),
            listed.types.len().to_string(),
        ));
    }
    let num_cells = listed.types.len();
    let faces = |cell: usize, _: &[u64]| {
        listed
            .faces
            .get(&cell)
            .cloned()
            .ok_or_else(|| Problem::malformed(format!("polyhedron {cell}"), "faces", "none"))
    };
    let cells = assemble(
        &SourceCells {
            types: Cow::Borrowed(&listed.types),
            ends: listed.ends.map(Ends::List),
            connectivity: listed.connectivity,
            faces: Some(&faces),
            what: topology.place(),
        },
        &position,
    )?;
    let attributes = attributes::list(document, grid, [num_points, num_cells], notes)?;
    let field = |attribute: attributes::Attribute| {
        let attribute = Arc::new(attribute);
        let (to_load, to_check) = (attribute.clone(), attribute.clone());
        PartField {
            name: attribute.name.clone(),
            association: attribute.association,
            scalar_type: attribute.item.scalar_type,
            components: attribute.components,
            load: Arc::new(move || to_load.item.load(to_load.components)),
            check: Arc::new(move || to_check.item.check()),
        }
    };
    Ok(Part {
        positions,
        cells,
        fields: attributes.into_iter().map(field).collect(),
        point_flags: None,
        cell_flags: None,
    })
}

/// How many elements the topology says that it has.
fn num_elements(topology: &Element) -> Result<Option<usize>, Problem> {
    for key in ["NumberOfElements", "Dimensions"] {
        if let Some(lens) = lens(topology, key)? {
            let product = lens.iter().try_fold(1usize, |n, &len| n.checked_mul(len));
            return product.map(Some).ok_or_else(|| {
                Problem::malformed(topology.place(), "fewer elements", format!("{lens:?}"))
            });
        }
    }
    Ok(None)
}

/// Node numbers from 0, where they begin elsewhere.
fn based(numbers: DataArray, topology: &Element) -> Result<DataArray, Problem> {
    let base: i64 = topology.parsed("BaseOffset", "a number")?.unwrap_or(0);
    if base == 0 {
        return Ok(numbers);
    }
    let from_zero: Option<Vec<i64>> = (0..numbers.tuples())
        .map(|i| {
            i64::try_from(index_at(&numbers, i)?)
                .ok()?
                .checked_sub(base)
        })
        .collect();
    let from_zero = from_zero.ok_or_else(|| {
        Problem::malformed(topology.place(), format!("nodes from {base} on"), "others")
    })?;
    Ok(DataArray::from_vec(from_zero, 1)?)
}

/// The cells of a grid.
struct Listed {
    types: Vec<u8>,
    ends: Option<Vec<u64>>,
    connectivity: DataArray,
    faces: BTreeMap<usize, Vec<Vec<u64>>>,
}

impl Listed {
    /// Cells of one kind.
    fn uniform(
        connectivity: DataArray,
        number: u8,
        width: usize,
        what: &str,
    ) -> Result<Self, Problem> {
        let numbers = connectivity.tuples();
        if !numbers.is_multiple_of(width) {
            return Err(Problem::malformed(
                what,
                format!("elements of {width} nodes"),
                format!("{numbers} nodes"),
            ));
        }
        let count = numbers / width;
        let is_kept = kind(number).is_some_and(|k| matches!(k.treatment, Treatment::Keep(_)));
        let end = |i: u64| i * width as u64;
        Ok(Self {
            types: vec![number; count],
            ends: (!is_kept).then(|| (1..=count as u64).map(end).collect()),
            connectivity,
            faces: BTreeMap::new(),
        })
    }

    /// Cells of different kinds; each begins with its kind.
    fn mixed(
        stream: &DataArray,
        num_points: usize,
        announced: Option<usize>,
        what: &str,
    ) -> Result<Self, Problem> {
        let mut stream = Stream {
            numbers: stream,
            at: 0,
            num_points,
            what,
        };
        let (mut types, mut ends, mut faces) = (Vec::new(), Vec::new(), BTreeMap::new());
        let mut connectivity: Vec<u64> = Vec::new();
        while !stream.is_over() && announced.is_none_or(|n| types.len() < n) {
            let number = stream.next("a kind of element")?;
            if number == POLYHEDRON {
                let count = stream.next("a number of faces")?;
                let of_cell = (0..count).map(|_| {
                    let count = stream.next("a number of nodes")?;
                    (0..count).map(|_| stream.node()).collect()
                });
                faces.insert(types.len(), of_cell.collect::<Result<_, Problem>>()?);
                types.push(vtk::POLYHEDRON);
            } else {
                let (kind, width) = mixed_kind(number).ok_or_else(|| {
                    Problem::unsupported(format!("{what}: elements of kind {number}"))
                })?;
                let width = match width {
                    0 => stream.next("a number of nodes")?,
                    width => width as u64,
                };
                for _ in 0..width {
                    connectivity.push(stream.node()?);
                }
                types.push(of_points(kind, usize::try_from(width).unwrap_or(0)));
            }
            ends.push(connectivity.len() as u64);
        }
        let connectivity = match u32::try_from(num_points) {
            Ok(_) => {
                let narrow: Vec<u32> = connectivity.iter().map(|&n| n as u32).collect();
                DataArray::from_vec(narrow, 1)?
            }
            Err(_) => DataArray::from_vec(connectivity, 1)?,
        };
        Ok(Self {
            types,
            ends: Some(ends),
            connectivity,
            faces,
        })
    }
}

/// The numbers of mixed cells, one after the other.
struct Stream<'a> {
    numbers: &'a DataArray,
    at: usize,
    num_points: usize,
    what: &'a str,
}

impl Stream<'_> {
    fn is_over(&self) -> bool {
        self.at >= self.numbers.tuples()
    }

    fn next(&mut self, expected: &str) -> Result<u64, Problem> {
        let number = index_at(self.numbers, self.at).ok_or_else(|| {
            let found = if self.is_over() {
                "the end"
            } else {
                "a negative number"
            };
            Problem::malformed(
                format!("{}: number {}", self.what, self.at),
                expected,
                found,
            )
        })?;
        self.at += 1;
        Ok(number as u64)
    }

    fn node(&mut self) -> Result<u64, Problem> {
        let node = self.next("a node")?;
        if node < self.num_points as u64 {
            return Ok(node);
        }
        Err(Problem::malformed(
            format!("{}: number {}", self.what, self.at - 1),
            format!("a node below {}", self.num_points),
            node.to_string(),
        ))
    }
}

/// Positions of all points, 3 × `f32` or `f64`.
///
/// # Errors
/// [`Problem`] if the geometry is of another form.
pub(super) fn positions(
    document: &Arc<Document>,
    geometry: &Element,
) -> Result<DataArray, Problem> {
    let kind = word(geometry, &["GeometryType", "Type"], "XYZ");
    let items = document.children(geometry, "DataItem")?;
    let parse = |element: &&Element| Item::parse(document, element, None);
    let items: Vec<Item> = items.iter().map(parse).collect::<Result<_, _>>()?;
    let wrong = |expected: &str| {
        Problem::malformed(
            geometry.place(),
            expected,
            format!("{} items of {:?} numbers", items.len(), {
                items.iter().map(Item::numbers).collect::<Vec<_>>()
            }),
        )
    };
    match (kind.as_str(), items.as_slice()) {
        ("XYZ", [all]) if all.numbers().is_multiple_of(3) => as_float(all.load(3)?),
        ("XYZ", _) => Err(wrong("one item of 3 numbers a point")),
        ("XY", [all]) if all.numbers().is_multiple_of(2) => {
            let pairs = as_float(all.load(2)?)?;
            columns(pairs.tuples(), |point, axis| match axis {
                0 | 1 => pairs.get_f64(point, axis),
                _ => 0.0,
            })
        }
        ("XY", _) => Err(wrong("one item of 2 numbers a point")),
        ("X_Y_Z" | "X_Y", all) if all.len() == if kind == "X_Y" { 2 } else { 3 } => {
            let count = all.first().map_or(0, Item::numbers);
            if all.iter().any(|item| item.numbers() != count) {
                return Err(wrong("as many numbers for each axis"));
            }
            let all: Vec<DataArray> = all.iter().map(|i| i.load(1)).collect::<Result<_, _>>()?;
            columns(count, |point, axis| {
                all.get(axis).map_or(0.0, |a| a.get_f64(point, 0))
            })
        }
        ("X_Y_Z" | "X_Y", _) => Err(wrong("one item for each axis")),
        _ => Err(Problem::unsupported(format!(
            "{}: the geometry `{kind}` for this topology",
            geometry.place()
        ))),
    }
}

/// Positions number by number, in `f64`.
fn columns(count: usize, at: impl Fn(usize, usize) -> f64) -> Result<DataArray, Problem> {
    let numbers = (0..count).flat_map(|point| [0, 1, 2].map(|axis| at(point, axis)));
    Ok(DataArray::from_vec(numbers.collect::<Vec<f64>>(), 3)?)
}
