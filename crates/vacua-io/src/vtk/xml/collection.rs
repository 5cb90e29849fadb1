//! Files that list files: ParaView's collections of time steps (`.pvd`) and VTK's multi-block sets
//! (`.vtm`).
//!
//! A collection is a series: its data sets with one `timestep` are the parts of one time step, and
//! steps are in the order of their times. Blocks are the parts of a multi-block set, however deep they
//! lie. Parts that are unstructured meshes are joined as the pieces of a `.pvtu` are; a lone part may
//! be of any kind. A collection may list multi-block sets; nothing else nests.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use vacua_volume::Dataset;

use super::document::{Element, XmlFile};
use super::{read_file, sniff, unstructured};
use crate::error::Problem;
use crate::registry::{ReadOptions, open_source};
use crate::source::Source;

/// The `type` of a collection.
pub(super) const COLLECTION: &str = "Collection";
/// The `type` of a multi-block set.
pub(super) const MULTI_BLOCK: &str = "vtkMultiBlockDataSet";

/// Parts that an error names.
const MOST_NAMED: usize = 20;

/// One file of several.
struct Listed {
    /// What people call it: a part's number, a block's name.
    label: String,
    /// The file, as it is named.
    name: String,
}

/// Reads one time step of a collection; the first if none is asked for.
///
/// # Errors
/// [`Problem::Part`] if a file of the step cannot be read, [`Problem::Unsupported`] if it has several
/// that are not all unstructured meshes, [`Problem::Malformed`] if there is no such step.
pub(super) fn read_collection(file: &XmlFile, options: &ReadOptions) -> Result<Dataset, Problem> {
    let mut entries: Vec<(f64, Listed)> = Vec::new();
    for element in file.data_set()?.children_named("DataSet") {
        let time: f64 = element.parsed("timestep", "a time")?.unwrap_or(0.0);
        if !time.is_finite() {
            return Err(Problem::malformed(
                element.place(),
                "a finite time",
                time.to_string(),
            ));
        }
        let part = element.attribute("part").unwrap_or("0");
        let label = match element.attribute("name") {
            Some(name) if !name.is_empty() => name.to_owned(),
            _ => format!("part {part}"),
        };
        let name = element.required("file")?.to_owned();
        entries.push((time, Listed { label, name }));
    }
    // Stable: parts of a step stay in their order.
    entries.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut times: Vec<f64> = entries.iter().map(|(time, _)| *time).collect();
    times.dedup();
    let step = options.step.unwrap_or(0);
    let Some(&time) = times.get(step) else {
        return Err(Problem::malformed(
            "the time steps of the collection",
            format!("step {step}"),
            format!("{} steps", times.len()),
        ));
    };
    let of_step = entries.into_iter().filter(|(t, _)| *t == time);
    let parts: Vec<Listed> = of_step.map(|(_, listed)| listed).collect();
    let dataset = read_listed(file, "parts of a time step", &parts, true)?;
    Ok(dataset.with_times(times, step))
}

/// Reads a multi-block set.
///
/// # Errors
/// [`Problem::Part`] if a file cannot be read, [`Problem::Unsupported`] if there is none, or several
/// that are not all unstructured meshes.
pub(super) fn read_blocks(file: &XmlFile) -> Result<Dataset, Problem> {
    let mut blocks = Vec::new();
    list_blocks(file.data_set()?, "", &mut blocks);
    read_listed(file, "blocks", &blocks, false)
}

/// The files in an element and in those within it. Blocks without a file are empty.
fn list_blocks(element: &Element, around: &str, blocks: &mut Vec<Listed>) {
    for (number, child) in element.children.iter().enumerate() {
        let own = match child.attribute("name") {
            Some(name) if !name.is_empty() => name.to_owned(),
            _ => child
                .attribute("index")
                .map_or(number.to_string(), str::to_owned),
        };
        let label = match around {
            "" => own,
            around => format!("{around}/{own}"),
        };
        match child.name.as_str() {
            "Block" | "Piece" => list_blocks(child, &label, blocks),
            "DataSet" => {
                if let Some(name) = child.attribute("file").filter(|n| !n.is_empty()) {
                    let name = name.to_owned();
                    blocks.push(Listed { label, name });
                }
            }
            _ => {}
        }
    }
}

/// Reads the files that are listed: a lone one as it is, several as pieces of one mesh.
fn read_listed(
    file: &XmlFile,
    what: &str,
    listed: &[Listed],
    may_nest: bool,
) -> Result<Dataset, Problem> {
    let folder = file.source.path().parent().unwrap_or(Path::new(""));
    let open = |part: &Listed| -> Result<(PathBuf, Source), Problem> {
        let path = folder.join(&part.name);
        let source = Source::open(&path).map_err(Problem::part)?;
        Ok((path, source))
    };
    if listed.is_empty() {
        return Err(Problem::malformed("the list", "files", "none"));
    }
    if let [alone] = listed {
        let (path, source) = open(alone)?;
        return read_alone(&source, may_nest)
            .map_err(|problem| Problem::part(problem.in_file(&path)));
    }
    let mut files = Vec::with_capacity(listed.len());
    let mut all_meshes = true;
    let mut seen = BTreeSet::new();
    for part in listed {
        if !seen.insert(part.name.as_str()) {
            return Err(Problem::malformed(
                format!("the {what}"),
                "files that are not listed before",
                format!("`{}` again", part.name),
            ));
        }
        let (path, source) = open(part)?;
        let parsed = if sniff(source.bytes()) {
            let parsed = XmlFile::parse(&source);
            Some(parsed.map_err(|problem| Problem::part(problem.in_file(&path)))?)
        } else {
            None
        };
        all_meshes &= parsed.as_ref().is_some_and(unstructured::is_mesh);
        files.push((path, parsed));
    }
    if !all_meshes {
        return Err(Problem::unsupported_but(
            format!("joining {what} that are not all unstructured meshes"),
            format!("open one of them by its file: {}", names(listed)),
        ));
    }
    let (mut parts, mut notes) = (Vec::new(), Vec::new());
    for (path, parsed) in files {
        let Some(parsed) = parsed else { continue };
        unstructured::add_parts(parsed, &mut parts, &mut notes)
            .map_err(|problem| Problem::part(problem.in_file(&path)))?;
    }
    notes.push(format!(
        "{} {what} are joined to one mesh: {}",
        listed.len(),
        names(listed)
    ));
    crate::mesh::join_full(parts, notes)
}

/// A file that is the only one.
fn read_alone(source: &Source, may_nest: bool) -> Result<Dataset, Problem> {
    if !sniff(source.bytes()) {
        return open_source(source, &ReadOptions::default()).map_err(|error| error.problem);
    }
    let file = XmlFile::parse(source)?;
    match file.root.required("type")? {
        MULTI_BLOCK if may_nest => read_blocks(&file),
        COLLECTION | MULTI_BLOCK => Err(Problem::unsupported("a list of files in another")),
        _ => read_file(file, &ReadOptions::default()),
    }
}

/// Labels and files for people.
fn names(listed: &[Listed]) -> String {
    let mut names: Vec<String> = listed
        .iter()
        .take(MOST_NAMED)
        .map(|part| format!("{} ({})", part.label, part.name))
        .collect();
    if listed.len() > MOST_NAMED {
        names.push(format!("{} more", listed.len() - MOST_NAMED));
    }
    names.join(", ")
}
