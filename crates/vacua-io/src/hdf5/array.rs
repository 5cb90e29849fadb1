//! One array of an HDF5 file: its shape, and pieces of it.

use hdf5_reader::messages::HdfMessage;
use hdf5_reader::messages::layout::DataLayout;
use hdf5_reader::{ByteOrder, Dataset, Datatype, H5Type, SliceInfo, SliceInfoElem, StringSize};
use vacua_volume::{DataArray, Scalar, ScalarType, dispatch_scalar};

use super::{Container, guarded, guarded_raw, if_there};
use crate::error::Problem;

/// What an array consists of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum ArrayKind {
    /// Numbers.
    Numbers(ScalarType),
    /// Texts of so many bytes each.
    Text(usize),
    /// Something else, by name.
    Other(String),
}

/// An array, its numbers not read yet.
#[derive(Clone)]
pub(crate) struct Array {
    container: Container,
    dataset: Dataset,
    what: String,
    lens: Vec<usize>,
    kind: ArrayKind,
}

/// What to call a type of data.
pub(super) fn named(datatype: &Datatype) -> String {
    match datatype {
        Datatype::FixedPoint { size, .. } => format!("integers of {size} bytes"),
        Datatype::FloatingPoint { size, .. } => format!("floating-point numbers of {size} bytes"),
        Datatype::String { .. } => "text".to_owned(),
        Datatype::Compound { .. } => "compounds".to_owned(),
        Datatype::Array { .. } => "arrays in arrays".to_owned(),
        Datatype::Enum { .. } => "named values".to_owned(),
        Datatype::VarLen { .. } => "lists of varying length".to_owned(),
        Datatype::Opaque { .. } => "opaque bytes".to_owned(),
        Datatype::Reference { .. } => "references".to_owned(),
        Datatype::Bitfield { .. } => "bits".to_owned(),
    }
}

fn kind(datatype: &Datatype) -> ArrayKind {
    let numbers = match datatype {
        Datatype::FloatingPoint { size, .. } => match size {
            4 => Some(ScalarType::F32),
            8 => Some(ScalarType::F64),
            _ => None,
        },
        Datatype::FixedPoint { size, signed, .. } => match (size, signed) {
            (1, false) => Some(ScalarType::U8),
            (1, true) => Some(ScalarType::I8),
            (2, false) => Some(ScalarType::U16),
            (2, true) => Some(ScalarType::I16),
            (4, false) => Some(ScalarType::U32),
            (4, true) => Some(ScalarType::I32),
            (8, false) => Some(ScalarType::U64),
            (8, true) => Some(ScalarType::I64),
            _ => None,
        },
        Datatype::String {
            size: StringSize::Fixed(len),
            ..
        } => return ArrayKind::Text(*len as usize),
        _ => None,
    };
    numbers.map_or_else(|| ArrayKind::Other(named(datatype)), ArrayKind::Numbers)
}

impl Array {
    pub(super) fn new(container: Container, dataset: Dataset, path: &str) -> Result<Self, Problem> {
        let what = format!("array `{path}`");
        let lens: Option<Vec<usize>> = dataset
            .shape()
            .iter()
            .map(|&len| usize::try_from(len).ok())
            .collect();
        let lens = lens
            .filter(|lens| {
                let product = lens.iter().try_fold(1usize, |n, &len| n.checked_mul(len));
                product.is_some()
            })
            .ok_or_else(|| {
                Problem::malformed(
                    &what,
                    "a shape that fits the address space",
                    format!("{:?}", dataset.shape()),
                )
            })?;
        let kind = kind(dataset.dtype());
        Ok(Self {
            container,
            dataset,
            what,
            lens,
            kind,
        })
    }

    /// What to call it in messages.
    pub(crate) fn what(&self) -> &str {
        &self.what
    }

    /// Its lengths, the slowest dimension first; none for a single value.
    pub(crate) fn lens(&self) -> &[usize] {
        &self.lens
    }

    /// What it consists of.
    pub(crate) fn kind(&self) -> &ArrayKind {
        &self.kind
    }

    /// Its length along the slowest dimension; 1 for a single value.
    pub(crate) fn rows(&self) -> usize {
        self.lens.first().copied().unwrap_or(1)
    }

    /// Elements in a row.
    pub(crate) fn row_len(&self) -> usize {
        self.lens.iter().skip(1).product()
    }

    /// Whether it may grow along the slowest dimension.
    pub(crate) fn is_unlimited(&self) -> bool {
        let most = self.dataset.max_dims();
        most.and_then(|dims| dims.first()) == Some(&u64::MAX)
    }

    /// A text attribute; `None` if there is none of that name, or it is no text.
    pub(crate) fn text_of(&self, attribute: &str) -> Option<String> {
        let found = guarded_raw(&self.what, || self.dataset.attribute(attribute)).ok()?;
        let found = if_there(found, &self.what).ok()??;
        super::text(&found, &self.what).ok()
    }

    /// Type of its numbers.
    ///
    /// # Errors
    /// [`Problem::Unsupported`] if it has none.
    pub(crate) fn scalar_type(&self) -> Result<ScalarType, Problem> {
        match &self.kind {
            ArrayKind::Numbers(scalar_type) => Ok(*scalar_type),
            ArrayKind::Text(_) => Err(Problem::malformed(&self.what, "numbers", "text")),
            ArrayKind::Other(name) => Err(Problem::unsupported(format!(
                "{}: an array of {name}",
                self.what
            ))),
        }
    }

    /// Some rows, each of them a tuple.
    ///
    /// # Errors
    /// [`Problem`] if there are not so many, or they cannot be decoded.
    pub(crate) fn read_rows(&self, first: usize, rows: usize) -> Result<DataArray, Problem> {
        let components = self.row_len();
        let start = first.saturating_mul(components);
        self.read(start, components, rows)
    }

    /// All rows, each of them a tuple.
    ///
    /// # Errors
    /// [`Problem`] if they cannot be decoded.
    pub(crate) fn read_all(&self) -> Result<DataArray, Problem> {
        self.read_rows(0, self.rows())
    }

    /// `tuples × components` numbers from number `first` on, in the order of C.
    ///
    /// # Errors
    /// [`Problem`] if there are not so many, or they cannot be decoded.
    pub(crate) fn read(
        &self,
        first: usize,
        components: usize,
        tuples: usize,
    ) -> Result<DataArray, Problem> {
        let scalar_type = self.scalar_type()?;
        self.check(first, components, tuples)?;
        let count = tuples * components;
        if count == 0 {
            return dispatch_scalar!(scalar_type, T => {
                Ok(DataArray::from_vec(Vec::<T>::new(), components.max(1))?)
            });
        }
        if let Some(place) = self.place()? {
            let from = place.saturating_add(first.saturating_mul(scalar_type.size_bytes()));
            let source = &self.container.source;
            return source.array(&self.what, from, scalar_type, components, tuples);
        }
        dispatch_scalar!(scalar_type, T => {
            Ok(DataArray::from_vec(self.decode::<T>(first, count)?, components)?)
        })
    }

    /// Fails if there are not so many numbers.
    ///
    /// # Errors
    /// [`Problem::Malformed`].
    pub(crate) fn check(
        &self,
        first: usize,
        components: usize,
        tuples: usize,
    ) -> Result<(), Problem> {
        let all: usize = self.lens.iter().product();
        let end = tuples
            .checked_mul(components)
            .and_then(|n| n.checked_add(first));
        if end.is_some_and(|end| end <= all) {
            return Ok(());
        }
        Err(Problem::malformed(
            &self.what,
            format!("{tuples} × {components} numbers from number {first} on"),
            format!("{all} numbers"),
        ))
    }

    fn len_bytes(&self) -> u64 {
        let ArrayKind::Numbers(scalar_type) = self.kind else {
            return 0;
        };
        let numbers: usize = self.lens.iter().product();
        (numbers as u64).saturating_mul(scalar_type.size_bytes() as u64)
    }

    /// Where in the file its numbers lie one after the other as they are in memory; `None` if they
    /// do not.
    fn place(&self) -> Result<Option<usize>, Problem> {
        let native = match self.dataset.dtype() {
            Datatype::FixedPoint {
                size, byte_order, ..
            }
            | Datatype::FloatingPoint { size, byte_order } => {
                *size == 1 || (*byte_order == ByteOrder::BigEndian) == cfg!(target_endian = "big")
            }
            _ => false,
        };
        if !native {
            return Ok(None);
        }
        let file = &self.container.file;
        let header = guarded(&self.what, || {
            file.get_or_parse_header(self.dataset.address())
        })?;
        let mut place = None;
        for message in &header.messages {
            match message {
                HdfMessage::ExternalFiles(_) | HdfMessage::FilterPipeline(_) => return Ok(None),
                HdfMessage::DataLayout(message) => {
                    let DataLayout::Contiguous { address, size } = message.layout else {
                        return Ok(None);
                    };
                    if size < self.len_bytes() {
                        return Ok(None);
                    }
                    let base = file.superblock().base_address;
                    place = address
                        .checked_add(base)
                        .and_then(|at| usize::try_from(at).ok())
                        .filter(|&at| at < self.container.source.len());
                }
                _ => {}
            }
        }
        Ok(place)
    }

    fn decode<T: Scalar + H5Type>(&self, first: usize, count: usize) -> Result<Vec<T>, Problem> {
        let array = if self.lens.is_empty() {
            guarded(&self.what, || self.dataset.read_array::<T>())?
        } else {
            let selections = self.selection(first, count)?;
            let selection = SliceInfo { selections };
            guarded(&self.what, || {
                self.dataset.read_slice_parallel::<T>(&selection)
            })?
        };
        let found = array.len();
        let (values, from) = array.into_raw_vec_and_offset();
        if found != count || values.len() != count || from.unwrap_or(0) != 0 {
            return Err(Problem::malformed(
                &self.what,
                format!("{count} numbers"),
                found.to_string(),
            ));
        }
        Ok(values)
    }

    /// A run of numbers as a box.
    fn selection(&self, first: usize, count: usize) -> Result<Vec<SliceInfoElem>, Problem> {
        let mut selections = Vec::with_capacity(self.lens.len());
        let mut first = first;
        for axis in 0..self.lens.len() {
            let stride = self.lens[axis + 1..].iter().product::<usize>().max(1);
            let row = first / stride;
            if first.is_multiple_of(stride) && count.is_multiple_of(stride) {
                selections.push(SliceInfoElem::Slice {
                    start: row as u64,
                    end: (row + count / stride) as u64,
                    step: 1,
                });
                let rest = self.lens[axis + 1..].iter();
                selections.extend(rest.map(|&len| SliceInfoElem::Slice {
                    start: 0,
                    end: len as u64,
                    step: 1,
                }));
                return Ok(selections);
            }
            if (first + count - 1) / stride != row {
                return Err(Problem::malformed(
                    &self.what,
                    format!("rows that {count} numbers from {first} on fill"),
                    format!("rows of {stride}"),
                ));
            }
            selections.push(SliceInfoElem::Index(row as u64));
            first -= row * stride;
        }
        Ok(selections)
    }

    /// A list of texts, one a row, their ends trimmed.
    ///
    /// # Errors
    /// [`Problem`] if it is no list of texts.
    pub(crate) fn texts(&self) -> Result<Vec<String>, Problem> {
        let trimmed = |bytes: &[u8]| {
            let end = bytes.iter().position(|&b| b == 0).unwrap_or(bytes.len());
            String::from_utf8_lossy(&bytes[..end]).trim().to_owned()
        };
        let ArrayKind::Text(len) = self.kind else {
            if !matches!(
                self.dataset.dtype(),
                Datatype::VarLen { .. } | Datatype::String { .. }
            ) {
                return Err(Problem::malformed(
                    &self.what,
                    "text",
                    named(self.dataset.dtype()),
                ));
            }
            let texts = guarded(&self.what, || self.dataset.read_strings())?;
            return Ok(texts.iter().map(|t| trimmed(t.as_bytes())).collect());
        };
        let width = self.row_len().saturating_mul(len);
        let bytes = guarded(&self.what, || self.dataset.read_raw_bytes())?;
        if width == 0 {
            return Err(Problem::malformed(&self.what, "texts", "empty ones"));
        }
        Ok(bytes.chunks_exact(width).map(trimmed).collect())
    }
}
