//! `<DataItem>`: what numbers there are, where they lie, and pieces of them.
//!
//! Numbers are text in the element, the contents of an HDF5 array, or part of a binary file (raw, or
//! compressed by zlib or bzip2). A hyperslab is start, stride and count along each dimension of another
//! item.

use std::ops::Range;
use std::sync::Arc;

use vacua_volume::{DataArray, ScalarType, dispatch_scalar};

use super::document::Document;
use super::word;
use crate::decode::{Endianness, Layout, parse_text};
use crate::error::{IoError, Problem};
use crate::files::FileNames;
use crate::hdf5::Array;
use crate::payload::{Encoding, Payload, Place, Skip};
use crate::vtk::xml::document::Element;

/// Most dimensions of an item.
const MAX_DIMENSIONS: usize = 32;

/// Most hyperslabs of hyperslabs.
const MAX_NESTING: usize = 4;

/// Most numbers where a few are expected.
const MAX_SMALL: usize = 1 << 20;

/// An item, its numbers not read yet.
#[derive(Clone)]
pub(super) struct Item {
    document: Arc<Document>,
    /// What to call it in messages.
    pub what: String,
    /// Its lengths, the slowest dimension first.
    pub lens: Vec<usize>,
    /// Type of a number.
    pub scalar_type: ScalarType,
    numbers: usize,
    data: Data,
}

#[derive(Clone)]
enum Data {
    Text(Vec<Range<usize>>),
    Binary(Box<Payload>),
    Hdf(Box<(std::path::PathBuf, Array)>),
    Slab(Box<(Item, Slab)>),
}

/// Which numbers of another item.
#[derive(Clone)]
struct Slab {
    start: Vec<usize>,
    stride: Vec<usize>,
    count: Vec<usize>,
}

impl Item {
    /// Reads what the element says; `default` is the type of numbers that are text of no type.
    ///
    /// # Errors
    /// [`Problem`] for what is not understood, and where an HDF5 file lacks the array.
    pub fn parse(
        document: &Arc<Document>,
        element: &Element,
        default: Option<ScalarType>,
    ) -> Result<Self, Problem> {
        Self::parse_nested(document, element, default, 0)
    }

    fn parse_nested(
        document: &Arc<Document>,
        element: &Element,
        default: Option<ScalarType>,
        nesting: usize,
    ) -> Result<Self, Problem> {
        let element = document.resolved(element)?;
        let what = element.place();
        match word(element, &["ItemType", "Type"], "Uniform").as_str() {
            "UNIFORM" => {}
            "HYPERSLAB" if nesting < MAX_NESTING => {
                return Self::slab(document, element, default, nesting);
            }
            other => {
                return Err(Problem::unsupported_but(
                    format!("{what}: a data item of type `{other}`"),
                    "uniform items and hyperslabs are read",
                ));
            }
        }
        let lens = lens(element, "Dimensions")?;
        let lens = lens.ok_or_else(|| {
            Problem::malformed(&what, "an attribute `Dimensions`", "none of that name")
        })?;
        let (numbers, scalar_type) = (product(&lens, &what)?, scalar_type(element, default)?);
        let mut item = Self {
            document: document.clone(),
            what,
            lens,
            scalar_type,
            numbers,
            data: Data::Text(Vec::new()),
        };
        match word(element, &["Format"], "XML").as_str() {
            "XML" => item.data = Data::Text(element.text.clone()),
            "HDF" | "HDF5" => item.use_hdf(&document.text(element))?,
            "BINARY" => item.use_binary(element)?,
            other => {
                return Err(Problem::unsupported(format!(
                    "{}: the format `{other}`",
                    item.what
                )));
            }
        }
        item.check()?;
        Ok(item)
    }

    fn use_hdf(&mut self, reference: &str) -> Result<(), Problem> {
        if reference.contains('|') {
            return Err(Problem::unsupported(format!(
                "{}: part of an array, as in `{}`",
                self.what,
                reference.chars().take(80).collect::<String>()
            )));
        }
        let parts = reference.rsplit_once(':');
        let (file, name) = parts
            .filter(|(f, n)| !f.is_empty() && !n.is_empty())
            .ok_or_else(|| {
                Problem::malformed(&self.what, "a file and an array as in `file.h5:/array`", {
                    format!("`{}`", reference.chars().take(80).collect::<String>())
                })
            })?;
        let path = self.document.path_of(file.trim())?;
        let container = self.document.container(&path)?;
        let open = || -> Result<(Array, ScalarType), Problem> {
            let array = container.need(name.trim())?;
            let scalar_type = array.scalar_type()?;
            let found: usize = array.lens().iter().product();
            if found != self.numbers {
                return Err(Problem::malformed(
                    array.what(),
                    format!("{:?} numbers", self.lens),
                    format!("{:?}", array.lens()),
                ));
            }
            Ok((array, scalar_type))
        };
        let (array, scalar_type) = open().map_err(|p| Problem::part(p.in_file(&path)))?;
        self.scalar_type = scalar_type;
        self.data = Data::Hdf(Box::new((path, array)));
        Ok(())
    }

    fn use_binary(&mut self, element: &Element) -> Result<(), Problem> {
        let path = self.document.path_of(&self.document.text(element))?;
        let endianness = match word(element, &["Endian"], "Native").as_str() {
            "NATIVE" => Endianness::NATIVE,
            "LITTLE" => Endianness::Little,
            "BIG" => Endianness::Big,
            other => {
                return Err(Problem::malformed(
                    &self.what,
                    "an `Endian` of Native, Little or Big",
                    format!("`{other}`"),
                ));
            }
        };
        let encoding = match word(element, &["Compression"], "Raw").as_str() {
            "RAW" => Encoding::Raw,
            "ZLIB" => Encoding::Deflate,
            "BZIP2" => Encoding::Bzip2,
            other => return Err(Problem::unsupported(format!("{}: `{other}`", self.what))),
        };
        let seek = element.parsed("Seek", "a number of bytes")?.unwrap_or(0);
        self.data = Data::Binary(Box::new(Payload {
            source: self.document.source.clone(),
            place: Place::Files(FileNames::List(vec![path])),
            encoding,
            skip_lines: 0,
            skip: Skip::Bytes(seek),
            layout: Layout {
                scalar_type: self.scalar_type,
                endianness,
                components: 1,
                tuples: self.numbers,
            },
            stored_steps: 1,
            planar: false,
        }));
        Ok(())
    }

    fn slab(
        document: &Arc<Document>,
        element: &Element,
        default: Option<ScalarType>,
        nesting: usize,
    ) -> Result<Self, Problem> {
        let what = element.place();
        let wrong = |found: String| {
            Problem::malformed(
                &what,
                "start, stride and count of each dimension of the item after them, inside of it",
                found,
            )
        };
        let items = document.children(element, "DataItem")?;
        let [selection, inner] = items.as_slice() else {
            return Err(wrong(format!("{} items", items.len())));
        };
        let integers = Some(ScalarType::I64);
        let selection = Self::parse_nested(document, selection, integers, nesting + 1)?.small()?;
        let inner = Self::parse_nested(document, inner, default, nesting + 1)?;
        let rank = inner.lens.len();
        let is_count = |n: &f64| n.fract() == 0.0 && (0.0..9e15).contains(n);
        if selection.len() != 3 * rank || !selection.iter().all(is_count) {
            return Err(wrong(format!(
                "{} numbers, {rank} dimensions",
                selection.len()
            )));
        }
        let row = |i: usize| -> Vec<usize> {
            selection[i * rank..][..rank]
                .iter()
                .map(|&n| n as usize)
                .collect()
        };
        let slab = Slab {
            start: row(0),
            stride: row(1),
            count: row(2),
        };
        for axis in 0..rank {
            let last = slab.count[axis]
                .checked_sub(1)
                .and_then(|n| n.checked_mul(slab.stride[axis]))
                .and_then(|n| n.checked_add(slab.start[axis]));
            if last.is_none_or(|last| last >= inner.lens[axis]) || slab.stride[axis] == 0 {
                return Err(wrong(format!("more than there is along dimension {axis}")));
            }
        }
        let numbers = product(&slab.count, &what)?;
        let lens = lens(element, "Dimensions")?.unwrap_or_else(|| slab.count.clone());
        if product(&lens, &what)? != numbers {
            return Err(wrong(format!("{lens:?} for {:?}", slab.count)));
        }
        Ok(Self {
            document: document.clone(),
            what,
            lens,
            scalar_type: inner.scalar_type,
            numbers,
            data: Data::Slab(Box::new((inner, slab))),
        })
    }

    /// How many numbers there are.
    pub fn numbers(&self) -> usize {
        self.numbers
    }

    /// Fails, without decoding anything, if there cannot be so many numbers.
    ///
    /// # Errors
    /// [`Problem::Malformed`] or [`Problem::Truncated`].
    pub fn check(&self) -> Result<(), Problem> {
        match &self.data {
            Data::Text(ranges) => {
                let bytes: usize = ranges.iter().map(|r| r.len() + 1).sum();
                if self.numbers.saturating_mul(2) <= bytes {
                    return Ok(());
                }
                Err(Problem::malformed(
                    &self.what,
                    format!("{} numbers", self.numbers),
                    format!("{bytes} bytes of text"),
                ))
            }
            Data::Binary(payload) => payload.check(),
            Data::Hdf(_) => Ok(()),
            Data::Slab(slab) => slab.0.check(),
        }
    }

    /// All numbers, so many in a tuple.
    ///
    /// # Errors
    /// [`Problem`] if they cannot be decoded.
    pub fn load(&self, components: usize) -> Result<DataArray, Problem> {
        self.check()?;
        let all = match &self.data {
            Data::Text(ranges) => self.parse_text(ranges)?,
            Data::Binary(payload) => payload.fetch()?,
            Data::Hdf(place) => {
                let (path, array) = &**place;
                let read = array.read(0, 1, self.numbers);
                read.map_err(|p| Problem::part(p.in_file(path)))?
            }
            Data::Slab(slab) => {
                let (inner, slab) = &**slab;
                inner.take(slab)?
            }
        };
        Ok(all.with_components(components)?)
    }

    fn parse_text(&self, ranges: &[Range<usize>]) -> Result<DataArray, Problem> {
        let bytes = self.document.source.bytes();
        let joined: Vec<u8>;
        let text = match ranges {
            [one] => bytes.get(one.clone()).unwrap_or_default(),
            several => {
                let parts = several.iter().filter_map(|r| bytes.get(r.clone()));
                joined = parts.collect::<Vec<_>>().join(&b' ');
                &joined
            }
        };
        let layout = Layout {
            scalar_type: self.scalar_type,
            endianness: Endianness::NATIVE,
            components: 1,
            tuples: self.numbers,
        };
        let parsed = layout.fill_array(false, |to| parse_text(text, self.scalar_type, to));
        parsed.map_err(|problem| match problem {
            Problem::Malformed {
                place,
                expected,
                found,
            } => Problem::malformed(format!("{}: {place}", self.what), expected, found),
            other => other,
        })
    }

    /// The numbers of a slab.
    fn take(&self, slab: &Slab) -> Result<DataArray, Problem> {
        if let Data::Hdf(place) = &self.data
            && let Some((first, count)) = slab.run(&self.lens)
        {
            let (path, array) = &**place;
            let read = array.read(first, 1, count);
            return read.map_err(|p| Problem::part(p.in_file(path)));
        }
        let all = self.load(1)?;
        dispatch_scalar!(self.scalar_type, T => {
            let all = all.as_slice::<T>().unwrap_or_default();
            let mut taken: Vec<T> = Vec::new();
            slab.each(&self.lens, |place| taken.extend(all.get(place)));
            Ok(DataArray::from_vec(taken, 1)?)
        })
    }

    /// A few numbers as `f64`.
    ///
    /// # Errors
    /// [`Problem`] if they are many, or cannot be decoded.
    pub fn small(&self) -> Result<Vec<f64>, Problem> {
        if self.numbers > MAX_SMALL {
            return Err(Problem::malformed(
                &self.what,
                format!("at most {MAX_SMALL} numbers"),
                self.numbers.to_string(),
            ));
        }
        let all = self.load(1)?;
        Ok((0..all.tuples()).map(|i| all.get_f64(i, 0)).collect())
    }

    /// Says which file has a problem when the numbers are loaded later.
    pub fn in_file(&self, problem: Problem) -> IoError {
        problem.in_file(self.document.source.path())
    }
}

impl Slab {
    /// The first number and how many, if these are one after the other.
    fn run(&self, lens: &[usize]) -> Option<(usize, usize)> {
        let mut first = 0;
        for axis in 0..lens.len() {
            first = first * lens[axis] + self.start[axis];
        }
        // One row of one row of …, then some rows, then all of everything.
        let cut = (0..lens.len()).find(|&axis| self.count[axis] != 1)?;
        let is_whole = (cut + 1..lens.len()).all(|axis| self.count[axis] == lens[axis]);
        (is_whole && self.stride[cut] == 1).then(|| (first, self.count.iter().product()))
    }

    /// Calls back with the place of each number in turn.
    fn each(&self, lens: &[usize], mut take: impl FnMut(usize)) {
        let mut at = vec![0usize; lens.len()];
        if self.count.contains(&0) {
            return;
        }
        loop {
            let mut place = 0;
            for axis in 0..lens.len() {
                place = place * lens[axis] + self.start[axis] + at[axis] * self.stride[axis];
            }
            take(place);
            let Some(axis) = (0..lens.len()).rev().find(|&a| at[a] + 1 < self.count[a]) else {
                return;
            };
            at[axis] += 1;
            at[axis + 1..].fill(0);
        }
    }
}

/// Lengths in an attribute.
pub(super) fn lens(element: &Element, key: &str) -> Result<Option<Vec<usize>>, Problem> {
    let Some(text) = element.attribute(key) else {
        return Ok(None);
    };
    let lens: Option<Vec<usize>> = text
        .split_whitespace()
        .take(MAX_DIMENSIONS + 1)
        .map(|w| w.parse().ok())
        .collect();
    lens.filter(|l| (1..=MAX_DIMENSIONS).contains(&l.len()))
        .map(Some)
        .ok_or_else(|| {
            Problem::malformed(
                format!("attribute `{key}` of {}", element.place()),
                format!("1 to {MAX_DIMENSIONS} lengths"),
                format!("`{}`", text.chars().take(80).collect::<String>()),
            )
        })
}

fn product(lens: &[usize], what: &str) -> Result<usize, Problem> {
    let product = lens.iter().try_fold(1usize, |n, &len| n.checked_mul(len));
    product.ok_or_else(|| {
        Problem::malformed(
            what,
            "dimensions that fit the address space",
            format!("{lens:?}"),
        )
    })
}

/// The type that the element names.
fn scalar_type(element: &Element, default: Option<ScalarType>) -> Result<ScalarType, Problem> {
    let keys = ["NumberType", "DataType"];
    let is_named = keys.iter().any(|key| element.attribute(key).is_some());
    if !is_named && let Some(default) = default {
        return Ok(default);
    }
    let name = word(element, &keys, "Float");
    let precision: Option<usize> = element.parsed("Precision", "a number of bytes")?;
    let found = match (name.as_str(), precision) {
        ("FLOAT", None | Some(4)) => Some(ScalarType::F32),
        ("FLOAT", Some(8)) => Some(ScalarType::F64),
        ("INT", None | Some(4)) => Some(ScalarType::I32),
        ("INT", Some(8)) => Some(ScalarType::I64),
        ("UINT", None | Some(4)) => Some(ScalarType::U32),
        ("UINT", Some(8)) => Some(ScalarType::U64),
        ("SHORT", None | Some(2)) | ("INT", Some(2)) => Some(ScalarType::I16),
        ("USHORT", None | Some(2)) | ("UINT", Some(2)) => Some(ScalarType::U16),
        ("CHAR", None | Some(1)) | ("INT", Some(1)) => Some(ScalarType::I8),
        ("UCHAR", None | Some(1)) | ("UINT", Some(1)) => Some(ScalarType::U8),
        _ => None,
    };
    found.ok_or_else(|| {
        Problem::unsupported(format!(
            "{}: numbers of type `{name}` and precision {}",
            element.place(),
            precision.unwrap_or(0)
        ))
    })
}
