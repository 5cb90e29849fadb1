//! TIFF and BigTIFF stacks (`.tif`, `.tiff`): each page is a slice of a volume.
//!
//! Pages are grey or have several samples (RGB, RGBA …), which become the components of a voxel;
//! numbers are integers or floats of whole bytes, in strips or tiles, as they are or compressed with
//! LZW, deflate or PackBits. ImageJ's description and OME-XML say which page is which slice, channel
//! and time, and the spacing; without either every page is a slice. Each channel becomes a field,
//! times become steps. Smaller copies of pages and masks are left out. All pages of a volume must be
//! of one size and type. Pages that follow each other uncompressed in the machine's byte order are
//! mapped; others are decompressed in parallel when a field is asked for.
//!
//! Index x runs along the rows of a page, y down from row to row, z from page to page. Positions do
//! the same, as with ITK and napari, and nothing is mirrored: where y points up, the first row is at
//! the bottom. Resolutions without ImageJ's or OME's word for them are those of a printer or a screen
//! and are not read. Palettes are not applied, and numbers whose zero is white stay as they are.

mod arrangement;
mod directory;
mod imagej;
mod ome;
mod page;
mod series;
mod slices;
mod unpack;

use std::sync::Arc;

use glam::DVec3;
use vacua_volume::{Dataset, Geometry, UniformGrid};

use crate::error::Problem;
use crate::registry::{Format, ReadOptions};
use crate::source::Source;

use arrangement::Arrangement;
use directory::{Container, Directory, is_tiff, tag};
use page::{Page, Places, is_copy};
use slices::{Slice, Slices};

pub use series::open_stack;

/// The TIFF format.
pub(crate) const FORMAT: Format = Format {
    name: "TIFF",
    extensions: &["tif", "tiff"],
    sniff: Some(is_tiff),
    read,
};

/// Reads the directories and what they say of the volumes.
///
/// # Errors
/// [`Problem`] naming the page and the tag, or the part of its description, that is wrong or not
/// supported.
fn read(source: &Source, options: &ReadOptions) -> Result<Dataset, Problem> {
    let (container, first) = Container::open(source)?;
    let mut directories = container.directories(first)?;
    let is_page = |directory: &Directory| !is_copy(&container, directory);
    let Some(first) = directories.iter().find(|directory| is_page(directory)) else {
        return Err(Problem::malformed("the file", "pages", "none"));
    };
    let description = first.text(&container, tag::DESCRIPTION).unwrap_or_default();
    let samples = first.number(&container, tag::SAMPLES_PER_PIXEL);
    let is_ome = ome::is_ome(&description);
    // OME-XML counts all pages.
    if !is_ome {
        let num_all = directories.len();
        directories.retain(is_page);
        let num_copies = num_all - directories.len();
        if num_copies > 0 {
            tracing::info!(
                path = %source.path().display(),
                "{num_copies} pages that are smaller copies or masks were left out"
            );
        }
    }
    let container = Arc::new(container);
    let mut budget = source.len() as u64;
    if imagej::is_imagej(&description) {
        return read_imagej(&container, &directories, &description, options);
    }
    let arrangement = if is_ome {
        let samples = samples?.and_then(|n| usize::try_from(n).ok()).unwrap_or(1);
        ome::arrange(
            &description,
            source.path(),
            directories.len(),
            samples.max(1),
        )?
    } else {
        Arrangement::slices(directories.len())
    };
    let slices = arrangement.pages.iter().map(|&index| {
        let page = Page::read(&container, &directories[index], &mut budget)?;
        let container = container.clone();
        Ok(Slice { container, page })
    });
    let slices = slices.collect::<Result<Vec<_>, Problem>>()?;
    assemble(&arrangement, slices, options)
}

/// Reads a file with ImageJ's description, whose pages need not all have a directory.
fn read_imagej(
    container: &Arc<Container>,
    directories: &[Directory],
    description: &str,
    options: &ReadOptions,
) -> Result<Dataset, Problem> {
    let description = imagej::Description::new(description);
    let first = &directories[0];
    let mut budget = container.source.len() as u64;
    let pages = directories
        .iter()
        .map(|directory| Page::read(container, directory, &mut budget));
    let mut pages = pages.collect::<Result<Vec<_>, Problem>>()?;
    let num_images = description.images()?.unwrap_or(1);
    if let ([page], true) = (&*pages, num_images > 1) {
        pages = pages_without_directories(container, page, num_images)?;
    }
    let resolution = [tag::X_RESOLUTION, tag::Y_RESOLUTION].map(|tag| first.ratio(container, tag));
    let arrangement = description.arrange(pages.len(), resolution)?;
    let slices = arrangement.pages.iter().map(|&index| Slice {
        container: container.clone(),
        page: pages[index].clone(),
    });
    assemble(&arrangement, slices.collect(), options)
}

/// The pages of a stack of which only the first has a directory: the others follow it.
fn pages_without_directories(
    container: &Container,
    first: &Page,
    num_images: usize,
) -> Result<Vec<Page>, Problem> {
    /// Images that may be described whatever the size of the file.
    const FEW_IMAGES: usize = 1 << 14;
    let page_bytes = first.shape.len_bytes().unwrap_or(usize::MAX);
    // What describes the images must not take more memory than they.
    if num_images > FEW_IMAGES && page_bytes < size_of::<Page>() {
        return Err(Problem::unsupported(format!(
            "a stack of {num_images} images of {page_bytes} bytes"
        )));
    }
    let at = first.run_at.ok_or_else(|| {
        Problem::malformed(
            "ImageJ's `images`",
            "1, as many as the file has pages, since they are compressed or in tiles",
            num_images.to_string(),
        )
    })?;
    let len = page_bytes.saturating_mul(num_images);
    container
        .source
        .piece(&format!("the data of {num_images} images"), at, len)?;
    let page = |index: usize| {
        let at = at + index * page_bytes;
        Page {
            number: index + 1,
            chunk_rows: first.shape.size[1] as u32,
            num_chunks: 1,
            places: Places::Whole(at),
            run_at: Some(at),
            ..first.clone()
        }
    };
    Ok((0..num_images).map(page).collect())
}

/// Makes the volumes of one time step. `all` are the pages in the order of the arrangement.
fn assemble(
    arrangement: &Arrangement,
    all: Vec<Slice>,
    options: &ReadOptions,
) -> Result<Dataset, Problem> {
    let step = options.step.unwrap_or(0);
    if step >= arrangement.frames {
        return Err(Problem::malformed(
            "the time steps",
            format!("step {step}"),
            format!("{} steps", arrangement.frames),
        ));
    }
    let first = &all[0].page;
    for slice in &all {
        if slice.page.shape != first.shape {
            let problem = Problem::malformed(
                format!("page {}", slice.page.number),
                format!("{} as on page {}", first.shape, first.number),
                slice.page.shape.to_string(),
            );
            return Err(slice.blame(&all[0], problem));
        }
    }
    let [width, height] = first.shape.size;
    refuse_flat(arrangement, width, height)?;
    let default_spacing = options.spacing.unwrap_or([1.0; 3]);
    let spacing = [0, 1, 2].map(|i| arrangement.spacing[i].unwrap_or(default_spacing[i]));
    let origin = DVec3::from(options.origin.unwrap_or_default());
    let points = [width, height, arrangement.slices];
    let grid = UniformGrid::new(points, origin, DVec3::from(spacing))?;

    let mut notes = arrangement.notes.clone();
    match first.photometric {
        0 => notes.push("zero is white: larger numbers are darker".to_owned()),
        3 => notes.push("numbers are indices into a palette, which was not applied".to_owned()),
        _ => {}
    }
    if let Some(unit) = &arrangement.unit {
        notes.push(format!("lengths are in {unit}"));
    }
    let mut fields = Vec::new();
    for channel in 0..arrangement.channels {
        let slices = Slices::new(all[arrangement.volume(channel, step)].to_vec());
        fields.push(slices.into_field(&name_of(arrangement, channel))?);
    }
    let mut dataset = Dataset::new(Geometry::Uniform(grid), fields)?;
    if arrangement.frames > 1 {
        dataset = dataset.with_times(arrangement.times(), step);
    }
    Ok(notes.into_iter().fold(dataset, Dataset::with_note))
}

/// Refuses what has one slice only, and says what to do.
fn refuse_flat(arrangement: &Arrangement, width: usize, height: usize) -> Result<(), Problem> {
    if arrangement.slices > 1 {
        return Ok(());
    }
    let hint = match (arrangement.channels, arrangement.frames) {
        (1, 1) => "a volume is a stack of at least 2 pages".to_owned(),
        (channels, frames) => format!(
            "a volume needs at least 2 slices, and the file's description makes {channels} channels \
             and {frames} times of its pages"
        ),
    };
    Err(Problem::unsupported_but(
        format!("a flat picture ({width} × {height} pixels)"),
        hint,
    ))
}

/// What the field of a channel is called: as the file does, if that tells it from the others.
fn name_of(arrangement: &Arrangement, channel: usize) -> String {
    if arrangement.channels == 1 {
        return "scalars".to_owned();
    }
    let names = &arrangement.channel_names;
    let own = names.get(channel).cloned().flatten();
    own.filter(|own| names.iter().flatten().filter(|name| *name == own).count() == 1)
        .unwrap_or_else(|| format!("channel_{}", channel + 1))
}
