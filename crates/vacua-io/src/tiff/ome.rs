//! OME-XML in the description of the first page: which page is which plane, and their spacing.
//!
//! Every page must be in the same file. Of several images the first is read. `SizeC` counts the
//! samples of colour pages; each page is one channel of so many components.
//! Source: the OME-TIFF specification and OME schema 2016-06 (openmicroscopy.org).

use std::path::Path;

use super::arrangement::Arrangement;
use crate::error::Problem;
use crate::units::converted;
use crate::vtk::xml::document::{Element, parse_markup};

/// Whether a description is OME-XML.
pub(super) fn is_ome(description: &str) -> bool {
    let text = description.trim_start();
    text.starts_with('<') && (text.contains("<OME") || text.contains(":OME"))
}

/// An element's name without its namespace.
fn plain_name(element: &Element) -> &str {
    element.name.rsplit(':').next().unwrap_or_default()
}

fn children<'a>(element: &'a Element, name: &'a str) -> impl Iterator<Item = &'a Element> {
    element
        .children
        .iter()
        .filter(move |child| plain_name(child) == name)
}

fn child<'a>(element: &'a Element, name: &'a str) -> Result<&'a Element, Problem> {
    children(element, name).next().ok_or_else(|| {
        Problem::malformed(
            format!("OME-XML, {}", element.place()),
            format!("an element <{name}>"),
            "none",
        )
    })
}

/// Slices, channels and times, in the order in which planes are counted.
struct Order {
    /// Positions in `sizes`, fastest first.
    axes: [usize; 3],
    /// Slices, channels, times.
    sizes: [usize; 3],
}

impl Order {
    fn parse(text: &str, sizes: [usize; 3]) -> Option<Self> {
        let letters = text.strip_prefix("XY")?.as_bytes();
        let letters: [u8; 3] = letters.try_into().ok()?;
        let axes = letters.map(|letter| b"ZCT".iter().position(|l| *l == letter));
        let [Some(a), Some(b), Some(c)] = axes else {
            return None;
        };
        let mut sorted = [a, b, c];
        sorted.sort_unstable();
        let axes = [a, b, c];
        (sorted == [0, 1, 2]).then_some(Self { axes, sizes })
    }

    /// The number of a plane.
    fn number(&self, plane: [usize; 3]) -> usize {
        let [a, b, c] = self.axes;
        plane[a] + self.sizes[a] * (plane[b] + self.sizes[b] * plane[c])
    }

    /// The plane of a number.
    fn plane(&self, number: usize) -> [usize; 3] {
        let [a, b, c] = self.axes;
        let mut plane = [0; 3];
        plane[a] = number % self.sizes[a];
        plane[b] = number / self.sizes[a] % self.sizes[b];
        plane[c] = number / self.sizes[a] / self.sizes[b];
        plane
    }
}

/// How the pages of a file are arranged: `num_pages` of them, with so many samples a pixel.
///
/// # Errors
/// [`Problem`] naming the element that is wrong, or another file that has some of the planes.
pub(super) fn arrange(
    description: &str,
    path: &Path,
    num_pages: usize,
    samples: usize,
) -> Result<Arrangement, Problem> {
    let top = parse_markup(description, false)?;
    let root = child(&top, "OME")?;
    if let Some(elsewhere) = children(root, "BinaryOnly").next() {
        let file = elsewhere
            .attribute("MetadataFile")
            .unwrap_or("another file");
        return Err(Problem::unsupported_but(
            format!("an OME-TIFF whose description is in {file}"),
            "store all planes and their description in one file",
        ));
    }
    let image = child(root, "Image")?;
    let pixels = child(image, "Pixels")?;
    let size = |key: &str| -> Result<usize, Problem> {
        let found = pixels.parsed::<usize>(key, "a whole number above 0")?;
        found.filter(|&n| n > 0).ok_or_else(|| {
            Problem::malformed(
                format!("OME-XML, `{key}` of {}", pixels.place()),
                "a whole number above 0",
                found.map_or("none", |_| "0"),
            )
        })
    };
    let (slices, colours, frames) = (size("SizeZ")?, size("SizeC")?, size("SizeT")?);
    if !colours.is_multiple_of(samples) {
        return Err(Problem::malformed(
            format!("OME-XML, `SizeC` of {}", pixels.place()),
            format!("a multiple of the {samples} samples a pixel"),
            colours.to_string(),
        ));
    }
    let channels = colours / samples;
    let planes = slices
        .checked_mul(channels)
        .and_then(|n| n.checked_mul(frames))
        .filter(|&n| n <= num_pages)
        .ok_or_else(|| {
            Problem::malformed(
                format!("OME-XML, {}", pixels.place()),
                format!("at most {num_pages} planes, as many as the file has pages"),
                format!("{slices} slices × {channels} channels × {frames} times"),
            )
        })?;
    let text = pixels.attribute("DimensionOrder").unwrap_or("XYZCT");
    let order = Order::parse(text, [slices, channels, frames]).ok_or_else(|| {
        Problem::malformed(
            format!("OME-XML, `DimensionOrder` of {}", pixels.place()),
            "XY and the letters Z, C and T",
            format!("`{}`", text.chars().take(40).collect::<String>()),
        )
    })?;
    let mut pages = vec![usize::MAX; planes];
    let mut blocks = children(pixels, "TiffData").peekable();
    if blocks.peek().is_none() {
        for (number, page) in (0..planes).enumerate() {
            place(&mut pages, &order, number, page);
        }
    }
    for block in blocks {
        refuse_other_file(block, root, description, path)?;
        let read = |key: &str| block.parsed::<usize>(key, "a whole number");
        let (page, count) = match (read("IFD")?, read("PlaneCount")?) {
            (page, Some(count)) => (page.unwrap_or(0), count),
            (Some(page), None) => (page, 1),
            (None, None) => (0, planes),
        };
        let first = [
            read("FirstZ")?.unwrap_or(0),
            read("FirstC")?.unwrap_or(0) / samples,
            read("FirstT")?.unwrap_or(0),
        ];
        let is_inside = (0..3).all(|axis| first[axis] < order.sizes[axis]);
        let end = page.checked_add(count).filter(|&end| end <= num_pages);
        let number = if is_inside {
            order.number(first)
        } else {
            planes
        };
        if end.is_none() || number.checked_add(count).is_none_or(|n| n > planes) {
            return Err(Problem::malformed(
                format!("OME-XML, {}", block.place()),
                format!("planes among {planes}, on pages among {num_pages}"),
                format!("{count} from plane {number} and page {page} on"),
            ));
        }
        for i in 0..count {
            place(&mut pages, &order, number + i, page + i);
        }
    }
    if let Some(missing) = pages.iter().position(|&page| page == usize::MAX) {
        let (z, c, t) = (
            missing % slices,
            missing / slices % channels,
            missing / slices / channels,
        );
        return Err(Problem::malformed(
            format!("OME-XML, {}", pixels.place()),
            "a page for every plane",
            format!("none for slice {z}, channel {c}, time {t}"),
        ));
    }
    let (spacing, unit) = spacing(pixels)?;
    let mut notes = Vec::new();
    let num_images = children(root, "Image").count();
    if num_images > 1 {
        let name = image.attribute("Name").unwrap_or("without a name");
        notes.push(format!(
            "the first of {num_images} images was read ({name})"
        ));
    }
    let names = children(pixels, "Channel").map(|channel| {
        let name = channel.attribute("Name").map(str::trim);
        name.filter(|name| !name.is_empty()).map(str::to_owned)
    });
    Ok(Arrangement {
        slices,
        channels,
        frames,
        pages,
        spacing,
        unit,
        channel_names: names.collect(),
        interval: distance(pixels, "TimeIncrement")?,
        notes,
    })
}

/// Puts a page at its place in an [`Arrangement`].
fn place(pages: &mut [usize], order: &Order, number: usize, page: usize) {
    let [z, c, t] = order.plane(number);
    let [slices, channels, _] = order.sizes;
    pages[z + slices * (c + channels * t)] = page;
}

/// A number above zero, if the attribute is there.
fn distance(pixels: &Element, key: &str) -> Result<Option<f64>, Problem> {
    let expected = "a finite number above 0";
    let found = pixels.parsed::<f64>(key, expected)?;
    match found {
        Some(n) if !n.is_finite() || n <= 0.0 => Err(Problem::malformed(
            format!("OME-XML, `{key}` of {}", pixels.place()),
            expected,
            n.to_string(),
        )),
        found => Ok(found),
    }
}

/// Distances of pixels, rows and slices, and the unit of the first.
fn spacing(pixels: &Element) -> Result<([Option<f64>; 3], Option<String>), Problem> {
    const KEYS: [[&str; 2]; 3] = [
        ["PhysicalSizeX", "PhysicalSizeXUnit"],
        ["PhysicalSizeY", "PhysicalSizeYUnit"],
        ["PhysicalSizeZ", "PhysicalSizeZUnit"],
    ];
    let mut unit: Option<&str> = None;
    let mut spacing = [None; 3];
    for (axis, [key, unit_key]) in KEYS.into_iter().enumerate() {
        let Some(length) = distance(pixels, key)? else {
            continue;
        };
        let own = pixels.attribute(unit_key).unwrap_or("µm");
        let shared = *unit.get_or_insert(own);
        spacing[axis] = Some(converted(length, own, shared)?);
    }
    Ok((spacing, unit.map(str::to_owned)))
}

/// Refuses planes that are in another file.
fn refuse_other_file(
    block: &Element,
    root: &Element,
    description: &str,
    path: &Path,
) -> Result<(), Problem> {
    let Some(uuid) = children(block, "UUID").next() else {
        return Ok(());
    };
    let text: String = uuid
        .text
        .iter()
        .filter_map(|range| description.get(range.clone()))
        .collect();
    let is_own_id = root
        .attribute("UUID")
        .is_some_and(|own| own.trim() == text.trim());
    let file = uuid.attribute("FileName");
    let is_own_name = file.is_some_and(|name| path.file_name().is_some_and(|own| own == name));
    if is_own_id || is_own_name {
        return Ok(());
    }
    Err(Problem::unsupported_but(
        format!(
            "an OME-TIFF of several files (planes are in {})",
            file.unwrap_or("another file")
        ),
        "store all planes in one file",
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is made of `<Pixels>` with these attributes and this content, in the file `own.tif` of 12
    /// pages.
    fn pixels(attributes: &str, content: &str) -> Result<Arrangement, Problem> {
        let text = format!(
            "<?xml version=\"1.0\"?><OME UUID=\"urn:uuid:1\"><Image><Pixels {attributes}>{content}\
             </Pixels></Image></OME>"
        );
        assert!(is_ome(&text));
        arrange(&text, Path::new("folder/own.tif"), 12, 1)
    }

    const SIZES: &str = "SizeZ='3' SizeC='2' SizeT='2' DimensionOrder";

    #[test]
    fn dimension_order_says_which_page() {
        for (order, [z, c, t]) in [
            ("XYZCT", [1, 3, 6]),
            ("XYCZT", [2, 1, 6]),
            ("XYTZC", [2, 6, 1]),
            ("XYTCZ", [4, 2, 1]),
        ] {
            let found = pixels(&format!("{SIZES}='{order}'"), "").expect(order);
            for i in 0..12 {
                let expected = i % 3 * z + i / 3 % 2 * c + i / 6 * t;
                assert_eq!(found.pages[i], expected, "{order}: {i}");
            }
        }
    }

    #[test]
    fn blocks_say_which_page() {
        let sizes = "SizeZ='2' SizeC='1' SizeT='2' DimensionOrder='XYZTC'";
        let blocks = "<TiffData IFD='5' FirstZ='1'/><TiffData FirstT='1' IFD='7' PlaneCount='2'/>\
                      <TiffData IFD='0'><UUID FileName='own.tif'>urn:uuid:9</UUID></TiffData>";
        let found = pixels(sizes, blocks).expect("all there");
        assert_eq!(found.pages, [0, 5, 7, 8]);
        let renamed = "<TiffData><UUID FileName='old.tif'>urn:uuid:1</UUID></TiffData>";
        assert_eq!(pixels(sizes, renamed).expect("own").pages, [0, 1, 2, 3]);
    }

    #[test]
    fn sizes_come_in_one_unit() {
        let sizes = "SizeZ='2' SizeC='1' SizeT='1' PhysicalSizeX='300' PhysicalSizeXUnit='nm' \
                     PhysicalSizeZ='2'";
        let found = pixels(sizes, "").expect("legal");
        assert_eq!(found.unit.as_deref(), Some("nm"));
        assert_eq!(found.spacing[..2], [Some(300.0), None]);
        assert!((found.spacing[2].expect("said") - 2000.0).abs() < 1e-9);
    }

    #[test]
    fn what_is_wrong_or_elsewhere_is_named() {
        let good = "SizeZ='2' SizeC='1' SizeT='2'";
        for (attributes, content, part) in [
            ("SizeZ='2' SizeC='1'", "", "SizeT"),
            ("SizeZ='0' SizeC='1' SizeT='1'", "", "SizeZ"),
            ("SizeZ='9' SizeC='9' SizeT='9'", "", "at most 12 planes"),
            (&format!("{SIZES}='XYZZT'"), "", "DimensionOrder"),
            (&format!("{good} PhysicalSizeX='NaN'"), "", "PhysicalSizeX"),
            (&format!("{good} PhysicalSizeZ='-1'"), "", "PhysicalSizeZ"),
            (good, "<TiffData IFD='12'/>", "on pages among 12"),
            (good, "<TiffData FirstZ='2'/>", "planes among 4"),
            (good, "<TiffData IFD='0'/>", "none for slice 1"),
            (
                good,
                "<TiffData IFD='0'><UUID FileName='b.tif'>urn:uuid:2</UUID></TiffData>",
                "planes are in b.tif",
            ),
            (
                good,
                "<TiffData IFD='18446744073709551615' PlaneCount='9'/>",
                "on pages",
            ),
        ] {
            let error = pixels(attributes, content)
                .expect_err(attributes)
                .to_string();
            assert!(error.contains(part), "{part}: {error}");
        }
        let text = "<OME><BinaryOnly MetadataFile='a.ome'/></OME>";
        let error = arrange(text, Path::new("b.tif"), 1, 1).expect_err("elsewhere");
        assert!(error.to_string().contains("a.ome"), "{error}");
    }
}
