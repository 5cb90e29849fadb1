//! Files of one page each, which together are a stack.

use std::path::PathBuf;
use std::sync::Arc;

use vacua_volume::Dataset;

use super::arrangement::Arrangement;
use super::assemble;
use super::directory::{Container, is_tiff, tag};
use super::imagej;
use super::page::{Page, is_copy};
use super::slices::Slice;
use crate::error::{IoError, Problem};
use crate::registry::ReadOptions;
use crate::source::Source;

/// Opens TIFF files of one page each as the slices of one volume, in the order given. Pixel sizes
/// come from ImageJ's description in the first file, where it has one, and else from the options.
/// `None` if the first file is no TIFF file of one page: then the files are something else.
///
/// # Errors
/// [`IoError`] if a file after the first cannot be read, is no TIFF file, has another number of pages,
/// or a page of another size or type.
pub fn open_stack(paths: &[PathBuf], options: &ReadOptions) -> Result<Option<Dataset>, IoError> {
    let Some(first_path) = paths.first() else {
        return Ok(None);
    };
    let first = Source::open(first_path)?;
    if !is_tiff(first.bytes()) {
        return Ok(None);
    }
    let mut arrangement = Arrangement::slices(paths.len());
    match describe(&first).map_err(|problem| problem.in_file(first_path))? {
        Some(Some(own)) => {
            arrangement.spacing = own.spacing;
            arrangement.unit = own.unit;
            arrangement.notes = own.notes;
        }
        Some(None) => {}
        None => return Ok(None),
    }
    let mut slices = vec![slice(&first).map_err(|problem| problem.in_file(first_path))?];
    for path in &paths[1..] {
        let source = Source::open(path)?;
        slices.push(slice(&source).map_err(|problem| problem.in_file(path))?);
    }
    let dataset = assemble(&arrangement, slices, options);
    dataset
        .map(Some)
        .map_err(|problem| problem.in_file(first_path))
}

/// Whether a file has one page and no images without a page: `None` if not, otherwise what ImageJ says
/// of it, if that is all there is to it.
fn describe(source: &Source) -> Result<Option<Option<Arrangement>>, Problem> {
    let (container, first) = Container::open(source)?;
    let mut directories = container.directories(first)?;
    directories.retain(|directory| !is_copy(&container, directory));
    let [page] = &*directories else {
        return Ok(None);
    };
    let text = page.text(&container, tag::DESCRIPTION).unwrap_or_default();
    if !imagej::is_imagej(&text) {
        return Ok(Some(None));
    }
    let description = imagej::Description::new(&text);
    if description.images()?.is_some_and(|images| images > 1) {
        return Ok(None);
    }
    let resolution = [tag::X_RESOLUTION, tag::Y_RESOLUTION].map(|tag| page.ratio(&container, tag));
    description
        .arrange(1, resolution)
        .map(|own| Some(Some(own)))
}

/// The only page of a file.
fn slice(source: &Source) -> Result<Slice, Problem> {
    let (container, first) = Container::open(source)?;
    let mut directories = container.directories(first)?;
    directories.retain(|directory| !is_copy(&container, directory));
    let [directory] = &*directories else {
        return Err(Problem::malformed(
            "the file",
            "one page, as in the first file of the stack",
            format!("{} pages", directories.len()),
        ));
    };
    let mut budget = source.len() as u64;
    let page = Page::read(&container, directory, &mut budget)?;
    Ok(Slice {
        container: Arc::new(container),
        page,
    })
}
