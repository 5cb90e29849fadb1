//! VTKHDF: unstructured meshes, collections of them, and image data in HDF5 files.
//!
//! Source: *VTKHDF format specification*, docs.vtk.org, versions 1.0 to 2.x; a minor version adds
//! types without changing others. Read are `UnstructuredGrid` of any number of partitions,
//! `ImageData`, and collections (`PartitionedDataSetCollection`, `MultiBlockDataSet`) of the former,
//! each with or without time steps. Other types are refused by name. External links and virtual
//! arrays are not followed: a file stands alone.

mod arrays;
mod image;
mod steps;
mod unstructured;

use vacua_volume::Dataset;

use crate::error::Problem;
use crate::hdf5::Container;
use crate::mesh::{Part, join_full};
use crate::registry::ReadOptions;
use steps::Steps;

/// The group of everything.
const ROOT: &str = "VTKHDF";

/// The group of a collection's hierarchy, which is not needed.
const ASSEMBLY: &str = "Assembly";

/// The newest major version of the format.
const NEWEST_MAJOR: f64 = 2.0;

/// Reads a file that has the group `VTKHDF`.
///
/// # Errors
/// [`Problem`] where it breaks the rules, or is of a type that is not read.
pub(crate) fn read(file: &Container, options: &ReadOptions) -> Result<Dataset, Problem> {
    let version = file.numbers(ROOT, "Version")?.unwrap_or_default();
    let Some(&major) = version.first() else {
        return Err(Problem::malformed(
            format!("group `{ROOT}`"),
            "an attribute `Version` of two numbers",
            "none",
        ));
    };
    if !(1.0..=NEWEST_MAJOR).contains(&major) {
        let text: Vec<String> = version.iter().map(f64::to_string).collect();
        return Err(Problem::unsupported_but(
            format!("version {} of VTKHDF", text.join(".")),
            format!("versions 1.0 to {NEWEST_MAJOR}.x are read"),
        ));
    }
    let wanted = options.step.unwrap_or(0);
    let type_name = file.text(ROOT, "Type")?.unwrap_or_default();
    match type_name.as_str() {
        "ImageData" => image::read(file, ROOT, wanted),
        "UnstructuredGrid" => {
            let steps = Steps::read(file, ROOT)?;
            steps.check(wanted)?;
            let mut notes = Vec::new();
            let parts = unstructured::read(file, ROOT, &steps, wanted, &mut notes)?;
            Ok(join_full(parts, notes)?.with_times(steps.times, wanted))
        }
        "PartitionedDataSetCollection" | "MultiBlockDataSet" => collection(file, wanted),
        other => Err(refused(other)),
    }
}

fn refused(type_name: &str) -> Problem {
    if type_name.is_empty() {
        return Problem::malformed(format!("group `{ROOT}`"), "an attribute `Type`", "none");
    }
    Problem::unsupported_but(
        format!("the VTKHDF type `{type_name}`"),
        "`UnstructuredGrid`, `ImageData` and collections of unstructured grids are read",
    )
}

/// All unstructured grids of a collection, one after the other; blocks of other types are noted.
fn collection(file: &Container, wanted: usize) -> Result<Dataset, Problem> {
    let (mut parts, mut notes): (Vec<Part>, Vec<String>) = Default::default();
    let (mut times, mut found) = (None, false);
    let (blocks, _) = file.names(ROOT)?;
    for block in blocks.iter().filter(|b| b.as_str() != ASSEMBLY) {
        let path = format!("{ROOT}/{block}");
        match file.text(&path, "Type")?.as_deref() {
            Some("UnstructuredGrid") => {
                found = true;
                let steps = Steps::read(file, &path)?;
                let step = if steps.times.is_empty() {
                    0
                } else {
                    steps.check(wanted)?;
                    wanted
                };
                parts.extend(unstructured::read(file, &path, &steps, step, &mut notes)?);
                if !steps.times.is_empty() {
                    times.get_or_insert(steps.times);
                }
            }
            Some(other) => notes.push(format!("block `{block}` of type {other} is left out")),
            None => {}
        }
    }
    if !found {
        return Err(Problem::unsupported(
            "a collection without an unstructured grid",
        ));
    }
    let times = times.unwrap_or_default();
    if wanted > 0 && times.is_empty() {
        return Err(steps::no_such_step(wanted, 0));
    }
    Ok(join_full(parts, notes)?.with_times(times, wanted))
}
