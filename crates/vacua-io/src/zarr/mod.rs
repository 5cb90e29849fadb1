//! Zarr arrays and groups, versions 2 and 3, and the images of OME-Zarr: folders, not files.
//!
//! An array's chunks lie in files of their own, or several in a shard; each is unpacked when a field is
//! asked for, in parallel. Of an image with several resolutions the finest is taken: a coarser one is opened by
//! its own folder, and knows where it lies. Each channel becomes a field, times become steps. In a group
//! without an image every array of three axes becomes a field, if they are of one size.
//!
//! Axes go by their names where they have any (OME's, dimension names, xarray's): `x`, `y` and `z`, or the
//! last three, the last along x. Positions are those of OME, otherwise indices; nothing is mirrored. Chunks
//! that are not stored have the array's fill value.

mod arrangement;
mod array;
mod blosc;
mod metadata;
mod ome;
mod unpack;

use std::io::ErrorKind;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use glam::DVec3;
use serde_json::Value;
use vacua_volume::{Association, Dataset, Field, Geometry, LoadError, UniformGrid};

use self::arrangement::Arrangement;
use self::array::{Array, Cut};
use self::metadata::ArrayMeta;
use self::ome::{Axis, Image, Level};
use crate::error::{IoError, Problem};
use crate::registry::ReadOptions;
use crate::source::Source;
use crate::units::converted;

/// What people call it.
pub(crate) const NAME: &str = "Zarr";

/// Bytes that a file of metadata may have.
const MOST_METADATA: usize = 64 << 20;

/// Files by which a folder is known.
const MARKS: [&str; 4] = ["zarr.json", ".zarray", ".zgroup", ".zattrs"];

/// What a folder is.
enum Node {
    Array(Box<ArrayMeta>),
    /// With its attributes.
    Group(Value),
}

/// The folder that a path leads to, or that has the file of metadata that it leads to.
pub(crate) fn folder_of(path: &Path) -> Option<PathBuf> {
    if path.is_dir() {
        return Some(path.to_owned());
    }
    let name = path.file_name()?.to_str()?;
    let folder = path.parent().filter(|_| MARKS.contains(&name))?;
    Some(match folder.as_os_str().is_empty() {
        true => PathBuf::from("."),
        false => folder.to_owned(),
    })
}

/// Opens a folder.
///
/// # Errors
/// [`IoError`] naming the folder, or the file in it, the place, and what was expected there.
pub(crate) fn open(folder: &Path, options: &ReadOptions) -> Result<Dataset, IoError> {
    read(folder, options).map_err(|problem| problem.in_file(folder))
}

fn read(folder: &Path, options: &ReadOptions) -> Result<Dataset, Problem> {
    match node(folder)? {
        None => Err(Problem::unsupported_but(
            "reading a folder",
            "only those of Zarr are read (zarr.json, .zarray or .zgroup)",
        )),
        Some(Node::Array(meta)) => {
            let array = Array {
                folder: folder.to_owned(),
                meta: *meta,
            };
            match image_of(folder)? {
                Some((image, level)) => of_image(&image, &level, array, options),
                None => of_arrays(vec![("scalars".to_owned(), array)], options),
            }
        }
        Some(Node::Group(attributes)) => match Image::of(&attributes)? {
            Some(image) => finest(folder, &image, options),
            None => of_group(folder, &attributes, options),
        },
    }
}

/// Reads a file of metadata; `None` if there is none.
fn metadata(path: &Path) -> Result<Option<Value>, Problem> {
    let source = match Source::open(path) {
        Ok(source) => source,
        Err(error) => match &error.problem {
            Problem::System { source, .. } if source.kind() == ErrorKind::NotFound => {
                return Ok(None);
            }
            _ => return Err(Problem::part(error)),
        },
    };
    let blame = |problem: Problem| Problem::part(problem.in_file(path));
    if source.len() > MOST_METADATA {
        let what = format!("a file of metadata of {} bytes", source.len());
        return Err(blame(Problem::unsupported(what)));
    }
    let value = serde_json::from_slice(source.bytes()).map_err(|error| {
        let place = format!("line {}, column {}", error.line(), error.column());
        blame(Problem::malformed(place, "JSON", error.to_string()))
    })?;
    Ok(Some(value))
}

/// What a folder is; `None` if it is nothing of Zarr.
fn node(folder: &Path) -> Result<Option<Node>, Problem> {
    let blame = |name: &str| {
        let path = folder.join(name);
        move |problem: Problem| Problem::part(problem.in_file(&path))
    };
    if let Some(meta) = metadata(&folder.join("zarr.json"))? {
        let node = match (meta["zarr_format"].as_u64(), meta["node_type"].as_str()) {
            (Some(3), Some("array")) => {
                ArrayMeta::of_version_3(&meta).map(|array| Node::Array(Box::new(array)))
            }
            (Some(3), Some("group")) => Ok(Node::Group(meta["attributes"].clone())),
            (Some(3), _) => Err(wrong("node_type", "`array` or `group`", &meta["node_type"])),
            _ => Err(wrong("zarr_format", "3", &meta["zarr_format"])),
        };
        return node.map(Some).map_err(blame("zarr.json"));
    }
    let attributes = metadata(&folder.join(".zattrs"))?;
    if let Some(meta) = metadata(&folder.join(".zarray"))? {
        let array = match meta["zarr_format"].as_u64() {
            Some(2) => ArrayMeta::of_version_2(&meta, attributes.unwrap_or_default()),
            _ => Err(wrong("zarr_format", "2", &meta["zarr_format"])),
        };
        return array
            .map(|array| Some(Node::Array(Box::new(array))))
            .map_err(blame(".zarray"));
    }
    let is_group = attributes.is_some() || metadata(&folder.join(".zgroup"))?.is_some();
    Ok(is_group.then(|| Node::Group(attributes.unwrap_or_default())))
}

/// Whether a folder is a level of an image in a folder above: then image and level.
fn image_of(folder: &Path) -> Result<Option<(Image, Level)>, Problem> {
    /// Folders up that are looked at.
    const MOST_UP: usize = 3;
    let Ok(whole) = folder.canonicalize() else {
        return Ok(None);
    };
    for above in whole.ancestors().skip(1).take(MOST_UP) {
        let Ok(Some(Node::Group(attributes))) = node(above) else {
            continue;
        };
        let Some(image) = Image::of(&attributes)? else {
            continue;
        };
        let own = whole.strip_prefix(above).ok();
        let level = image
            .levels
            .iter()
            .find(|level| own == Some(Path::new(&level.path)));
        let Some(level) = level.cloned() else {
            continue;
        };
        return Ok(Some((image, level)));
    }
    Ok(None)
}

/// The finest level of an image.
fn finest(folder: &Path, image: &Image, options: &ReadOptions) -> Result<Dataset, Problem> {
    let level = &image.levels[0];
    let dataset = of_image(image, level, array_in(folder, &level.path)?, options)?;
    let others: Vec<&str> = image.levels[1..].iter().map(|level| &*level.path).collect();
    Ok(match others.is_empty() {
        true => dataset,
        false => dataset.with_note(format!(
            "this is `{}`, the finest resolution; coarser ones are opened by their folders: {}",
            level.path,
            others.join(", ")
        )),
    })
}

/// An array that must be there.
fn array_in(folder: &Path, path: &str) -> Result<Array, Problem> {
    let folder = folder.join(path);
    match node(&folder)? {
        Some(Node::Array(meta)) => {
            let meta = *meta;
            Ok(Array { folder, meta })
        }
        _ => Err(Problem::malformed(
            format!("`{path}`"),
            "an array",
            "something else, or nothing",
        )),
    }
}

/// A level of an image.
fn of_image(
    image: &Image,
    level: &Level,
    array: Array,
    options: &ReadOptions,
) -> Result<Dataset, Problem> {
    let num_axes = array.meta.shape.len();
    if image.axes.len() != num_axes {
        return Err(Problem::malformed(
            "`axes` of the image",
            format!("{num_axes}, as the array `{}` has", level.path),
            image.axes.len().to_string(),
        ));
    }
    let arrangement = Arrangement::of_axes(&image.axes, &array.meta.shape)?;
    let Frame { grid, notes } = Frame::of_level(&arrangement, image, level, &array)?;
    let (times, step) = times(&arrangement, &array, options, |t| {
        arrangement
            .time
            .map_or(0.0, |axis| level.translation[axis] + t * level.scale[axis])
    })?;
    let mut fields = Vec::new();
    for channel in 0..arrangement.channel.map_or(1, |axis| array.meta.shape[axis]) {
        let name = channel_name(&arrangement, image, channel);
        fields.push(field(
            name,
            &array,
            arrangement.cut(step, channel, num_axes),
        )?);
    }
    let mut dataset = Dataset::new(Geometry::Uniform(grid), fields)?;
    if times.len() > 1 {
        dataset = dataset.with_times(times, step);
    }
    Ok(notes.into_iter().fold(dataset, Dataset::with_note))
}

/// Where the numbers of a level lie.
struct Frame {
    grid: UniformGrid,
    notes: Vec<String>,
}

impl Frame {
    fn of_level(
        arrangement: &Arrangement,
        image: &Image,
        level: &Level,
        array: &Array,
    ) -> Result<Self, Problem> {
        let units = arrangement
            .space
            .map(|axis| image.axes[axis].unit.as_deref());
        let unit = units.into_iter().flatten().next();
        let lengths = |numbers: &[f64]| {
            let mut lengths = arrangement.space.map(|axis| numbers[axis]);
            if let Some(unit) = unit {
                for (length, own) in lengths.iter_mut().zip(units) {
                    *length = converted(*length, own.unwrap_or(unit), unit)?;
                }
            }
            Ok::<_, Problem>(DVec3::from(lengths))
        };
        let (spacing, origin) = (lengths(&level.scale)?, lengths(&level.translation)?);
        let points = arrangement.space.map(|axis| array.meta.shape[axis]);
        let grid = UniformGrid::new(points, origin, spacing)?;
        let notes = unit.map(|unit| format!("lengths are in {unit}"));
        Ok(Self {
            grid,
            notes: notes.into_iter().collect(),
        })
    }
}

fn channel_name(arrangement: &Arrangement, image: &Image, channel: usize) -> String {
    if arrangement.channel.is_none() {
        return "scalars".to_owned();
    }
    let names = &image.channels;
    let own = names.get(channel).cloned().flatten();
    own.filter(|own| names.iter().flatten().filter(|name| *name == own).count() == 1)
        .unwrap_or_else(|| format!("channel_{}", channel + 1))
}

/// All times, and the step that is asked for.
fn times(
    arrangement: &Arrangement,
    array: &Array,
    options: &ReadOptions,
    time_of: impl Fn(f64) -> f64,
) -> Result<(Vec<f64>, usize), Problem> {
    /// Steps whose times are listed.
    const MOST_STEPS: usize = 1 << 20;
    let num = arrangement.time.map_or(1, |axis| array.meta.shape[axis]);
    let step = options.step.unwrap_or(0);
    if step >= num || num > MOST_STEPS {
        let steps = format!("{num} steps");
        return Err(Problem::malformed(
            "the time steps",
            format!("step {step}"),
            steps,
        ));
    }
    Ok(((0..num).map(|t| time_of(t as f64)).collect(), step))
}

/// A part of an array that is read when it is asked for.
fn field(name: String, array: &Array, cut: Cut) -> Result<Field, Problem> {
    let tuples = array.check(&cut)?;
    let (_, components) = array.size_of(&cut);
    let scalar_type = array.meta.stored.as_read();
    let array = array.clone();
    let load = move || {
        array
            .read(&cut)
            .map_err(|problem| Arc::new(problem.in_file(&array.folder)) as LoadError)
    };
    Ok(Field::lazy(
        &name,
        Association::Point,
        scalar_type,
        components,
        tuples,
        load,
    ))
}

/// Arrays of one size, at their indices.
fn of_arrays(arrays: Vec<(String, Array)>, options: &ReadOptions) -> Result<Dataset, Problem> {
    let (_, first) = &arrays[0];
    let num_axes = first.meta.shape.len();
    let arrangement = match &first.meta.axes {
        Some(names) => {
            let axis = |name: &String| Axis {
                name: name.clone(),
                ..Axis::default()
            };
            let axes: Vec<Axis> = names.iter().map(axis).collect();
            Arrangement::of_axes(&axes, &first.meta.shape)?
        }
        None => Arrangement::without_names(&first.meta.shape)?,
    };
    let points = arrangement.space.map(|axis| first.meta.shape[axis]);
    let origin = DVec3::from(options.origin.unwrap_or_default());
    let spacing = DVec3::from(options.spacing.unwrap_or([1.0; 3]));
    let grid = UniformGrid::new(points, origin, spacing)?;
    let (times, step) = times(&arrangement, first, options, |t| t)?;
    let mut fields = Vec::new();
    for (name, array) in &arrays {
        for channel in 0..arrangement.channel.map_or(1, |axis| array.meta.shape[axis]) {
            let name = match arrangement.channel {
                None => name.clone(),
                Some(_) => format!("{name}_{}", channel + 1),
            };
            fields.push(field(
                name,
                array,
                arrangement.cut(step, channel, num_axes),
            )?);
        }
    }
    let mut dataset = Dataset::new(Geometry::Uniform(grid), fields)?;
    if times.len() > 1 {
        dataset = dataset.with_times(times, step);
    }
    Ok(dataset)
}

/// A group that is no image: its arrays, if they belong together.
fn of_group(folder: &Path, attributes: &Value, options: &ReadOptions) -> Result<Dataset, Problem> {
    let (mut arrays, mut groups) = (Vec::new(), Vec::new());
    for name in children(folder)? {
        let folder = folder.join(&name);
        match node(&folder)? {
            Some(Node::Array(meta)) => {
                let meta = *meta;
                arrays.push((name, Array { folder, meta }));
            }
            Some(Node::Group(_)) if name != "OME" => groups.push(name),
            _ => {}
        }
    }
    let num_arrays = arrays.len();
    let has_volume = |array: &Array| array.meta.shape.iter().filter(|&&n| n > 1).count() >= 3;
    arrays.retain(|(_, array)| has_volume(array));
    let Some((_, first)) = arrays.first() else {
        if let ([only], 0) = (&*groups, num_arrays) {
            return read(&folder.join(only), options);
        }
        let what = match ome::of_attributes(attributes)["plate"] {
            Value::Object(_) => "a plate of images",
            _ => "a group without arrays of three axes",
        };
        return Err(Problem::unsupported_but(what, open_one_of(&groups)));
    };
    let (shape, axes) = (first.meta.shape.clone(), first.meta.axes.clone());
    let belongs = |array: &Array| array.meta.shape == shape && array.meta.axes == axes;
    if let Some((other, array)) = arrays.iter().find(|(_, array)| !belongs(array)) {
        let what = format!(
            "a group of arrays of several sizes ({shape:?}, `{other}` {:?})",
            array.meta.shape
        );
        let names: Vec<String> = arrays.iter().map(|(name, _)| name.clone()).collect();
        return Err(Problem::unsupported_but(what, open_one_of(&names)));
    }
    of_arrays(arrays, options)
}

fn open_one_of(names: &[String]) -> String {
    /// Names that are listed.
    const MOST_NAMES: usize = 20;
    match names {
        [] => "it has no groups either".to_owned(),
        names => {
            let listed = names
                .iter()
                .take(MOST_NAMES)
                .cloned()
                .collect::<Vec<_>>()
                .join(", ");
            let more = if names.len() > MOST_NAMES {
                ", …"
            } else {
                ""
            };
            format!("open one of its folders: {listed}{more}")
        }
    }
}

/// Folders in a folder, by name.
fn children(folder: &Path) -> Result<Vec<String>, Problem> {
    let system = |source| Problem::System {
        action: "cannot list",
        source,
    };
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(system)? {
        let entry = entry.map_err(system)?;
        let name = entry.file_name().into_string();
        if let (Ok(name), true) = (name, entry.path().is_dir())
            && Path::new(&name)
                .components()
                .all(|c| matches!(c, Component::Normal(_)))
        {
            names.push(name);
        }
    }
    names.sort_unstable();
    Ok(names)
}

/// A problem with a member of some metadata.
fn wrong(member: &str, expected: &str, found: &Value) -> Problem {
    /// Letters of what was found that are shown.
    const MOST_SHOWN: usize = 60;
    let mut found = found.to_string();
    if let Some((cut, _)) = found.char_indices().nth(MOST_SHOWN) {
        found.truncate(cut);
        found.push('…');
    }
    Problem::malformed(format!("`{member}`"), expected, found)
}
