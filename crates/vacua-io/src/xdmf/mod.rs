//! XDMF (`.xdmf`, `.xmf`): light data in XML, heavy data in it, in HDF5 files or in plain binary ones.
//!
//! Source: *XDMF Model and Format*, xdmf.org, versions 2 and 3; where that page is silent, what VTK 9.7
//! and meshio 5.3 write and VTK reads. Read are unstructured grids of every linear and quadratic cell,
//! `Mixed` ones and polyhedra in them; uniform, rectilinear and curvilinear grids; attributes on nodes
//! and cells; collections over time, of which one step is read; spatial collections and trees of
//! unstructured grids; references by XPath and `xi:include` ([`document`]); hyperslabs ([`item`]).
//! Functions, coordinates and sub-sets are refused by name.
//!
//! Names of other files are relative to this one and stay in its folder or below it; an absolute name
//! is taken at its word.

mod attributes;
mod document;
mod item;
mod structured;
mod topology;
mod unstructured;

use std::sync::Arc;

use vacua_volume::Dataset;

use crate::error::Problem;
use crate::mesh::join_full;
use crate::registry::{Format, ReadOptions};
use crate::source::Source;
use crate::vtk::xml::document::Element;
use document::Document;
use item::Item;
use topology::Topology;

/// The XDMF format.
pub(crate) const FORMAT: Format = Format {
    name: "XDMF",
    extensions: &["xdmf", "xmf", "xdmf2", "xdmf3"],
    sniff: Some(sniff),
    read,
};

/// Bytes in which the root element must begin.
const SNIFF_BYTES: usize = 4096;

/// Most grids of one step.
const MAX_GRIDS: usize = 1 << 16;

/// Most grids within each other.
const MAX_DEPTH: usize = 16;

fn sniff(bytes: &[u8]) -> bool {
    let head = &bytes[..bytes.len().min(SNIFF_BYTES)];
    memchr::memmem::find(head, b"<Xdmf").is_some()
}

fn read(source: &Source, options: &ReadOptions) -> Result<Dataset, Problem> {
    let document = Arc::new(Document::parse(source)?);
    let domain = document.domain()?;
    let mut notes = Vec::new();
    let grids: Vec<&Element> = document.children(domain, "Grid")?;
    let mut temporal = grids.iter().filter(|grid| is_temporal(grid));
    let chosen = temporal.next().copied();
    let others = temporal.count();
    if others > 0 {
        notes.push(format!(
            "{others} more collections over time are left out: the first one is read"
        ));
    }
    let wanted = options.step.unwrap_or(0);
    let (times, roots) = match chosen {
        None => (Vec::new(), grids),
        Some(collection) => {
            let steps = document.children(collection, "Grid")?;
            let times = times(&document, collection, &steps)?;
            (times, steps.get(wanted).copied().into_iter().collect())
        }
    };
    if (wanted > 0 || chosen.is_some()) && wanted >= times.len() {
        return Err(Problem::malformed(
            "the time steps",
            format!("step {wanted}"),
            format!("{} steps", times.len()),
        ));
    }
    let mut walk = Walk {
        document: &document,
        leaves: Vec::new(),
        visits_left: MAX_GRIDS,
    };
    for root in roots {
        walk.gather(root, 0)?;
    }
    let dataset = assemble(&document, &walk.leaves, notes)?;
    Ok(dataset.with_times(times, wanted))
}

/// An attribute whose values are words of any case.
fn word(element: &Element, keys: &[&str], default: &str) -> String {
    let found = keys.iter().find_map(|key| element.attribute(key));
    found.unwrap_or(default).trim().to_ascii_uppercase()
}

fn grid_type(grid: &Element) -> String {
    word(grid, &["GridType", "Type"], "Uniform")
}

fn is_temporal(grid: &Element) -> bool {
    grid_type(grid) == "COLLECTION" && word(grid, &["CollectionType"], "Spatial") == "TEMPORAL"
}

/// A walk through trees of grids, which references may make endless.
struct Walk<'a> {
    document: &'a Document,
    /// The grids that have cells.
    leaves: Vec<&'a Element>,
    visits_left: usize,
}

impl<'a> Walk<'a> {
    fn gather(&mut self, grid: &'a Element, depth: usize) -> Result<(), Problem> {
        self.visits_left = self
            .visits_left
            .checked_sub(1)
            .filter(|_| depth < MAX_DEPTH)
            .ok_or_else(|| {
                Problem::unsupported(format!(
                    "more than {MAX_GRIDS} grids, or more than {MAX_DEPTH} within each other"
                ))
            })?;
        match grid_type(grid).as_str() {
            "UNIFORM" => self.leaves.push(grid),
            "COLLECTION" | "TREE" if !is_temporal(grid) => {
                for child in self.document.children(grid, "Grid")? {
                    self.gather(child, depth + 1)?;
                }
            }
            "COLLECTION" => {
                return Err(Problem::unsupported(format!(
                    "{}: a collection over time within another grid",
                    grid.place()
                )));
            }
            other => {
                return Err(Problem::unsupported(format!(
                    "{}: a grid of type `{other}`",
                    grid.place()
                )));
            }
        }
        Ok(())
    }
}

/// The grids of a step as one data set.
fn assemble(
    document: &Arc<Document>,
    leaves: &[&Element],
    mut notes: Vec<String>,
) -> Result<Dataset, Problem> {
    let mut parts = Vec::with_capacity(leaves.len());
    for grid in leaves {
        let element = document.child(grid, "Topology")?;
        match Topology::parse(element)? {
            Topology::Cells(cells) => {
                parts.push(unstructured::read(
                    document, grid, element, &cells, &mut notes,
                )?);
            }
            Topology::Structured(kind) if leaves.len() == 1 => {
                return structured::read(document, grid, element, kind, notes);
            }
            Topology::Structured(_) => {
                return Err(Problem::unsupported(format!(
                    "{}: several structured grids",
                    grid.place()
                )));
            }
        }
    }
    if parts.is_empty() {
        return Err(Problem::malformed("<Domain>", "a grid", "none"));
    }
    join_full(parts, notes)
}

/// The times of the grids of a collection: its own list, or each grid's, or else their numbers.
fn times(
    document: &Arc<Document>,
    collection: &Element,
    steps: &[&Element],
) -> Result<Vec<f64>, Problem> {
    let by_number = || (0..steps.len()).map(|i| i as f64).collect();
    if let Some(time) = collection.child("Time") {
        let kind = word(time, &["TimeType", "Type"], "Single");
        let numbers = match document.children(time, "DataItem")?.first() {
            Some(item) => Item::parse(document, item, None)?.small()?,
            None => Vec::new(),
        };
        match (kind.as_str(), numbers.as_slice()) {
            ("LIST", all) if all.len() == steps.len() => return Ok(numbers),
            ("HYPERSLAB", [start, stride, _]) => {
                let time = |i: usize| start + stride * i as f64;
                return Ok((0..steps.len()).map(time).collect());
            }
            ("SINGLE", _) => {}
            _ => {
                return Err(Problem::malformed(
                    time.place(),
                    format!("the times of {} grids", steps.len()),
                    format!("{} numbers of type `{kind}`", numbers.len()),
                ));
            }
        }
    }
    let mut times = Vec::with_capacity(steps.len());
    for step in steps {
        let Some(time) = step.child("Time") else {
            return Ok(by_number());
        };
        match time.parsed::<f64>("Value", "a time")? {
            Some(value) => times.push(value),
            None => return Ok(by_number()),
        }
    }
    Ok(times)
}
