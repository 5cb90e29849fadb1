//! HDF5 containers: groups, attributes and arrays, for the formats that are written in them.
//!
//! The container itself is read by the crate `hdf5-reader`: superblocks 0 to 3, old and new groups,
//! compact, contiguous and chunked arrays with every kind of index, deflate, shuffle, Fletcher-32,
//! n-bit, scale-offset and szip. This module is what stands between it and the rest: it names what is
//! not understood, never lets a file ask for more memory than its size warrants, maps
//! contiguous arrays in native byte order instead of copying them, and follows no links to other
//! files. A panic of the library on a damaged file is an error here as any other.

mod array;
mod netcdf4;

use std::panic::AssertUnwindSafe;

use hdf5_reader::error::Error;
use hdf5_reader::group::Group;
use hdf5_reader::{Attribute, Datatype, Hdf5File, OpenOptions};
use vacua_volume::{ByteStore, Dataset};

pub(crate) use array::{Array, ArrayKind};

use crate::error::Problem;
use crate::registry::{Format, ReadOptions};
use crate::source::Source;

/// HDF5 files: VTKHDF, and Exodus II where there is no group `VTKHDF`.
pub(crate) const FORMAT: Format = Format {
    name: "VTKHDF",
    extensions: &["vtkhdf", "hdf", "h5", "hdf5"],
    sniff: Some(is_hdf5),
    read,
};

/// The first bytes of the superblock.
const MARK: &[u8] = b"\x89HDF\r\n\x1a\n";

/// Deflate cannot expand a byte to more than 1032; nor does any other filter in honest files.
const MOST_EXPANSION: usize = 1040;

/// Most bytes of one chunk, however large the file.
const MOST_CHUNK_BYTES: usize = 1 << 30;

/// Most bytes of all messages about one object.
const MOST_HEADER_BYTES: usize = 16 << 20;

/// Chunks that are kept for the next piece of the same array.
const CHUNK_CACHE_BYTES: usize = 16 << 20;

/// Whether bytes are an HDF5 file: the superblock is at the start or after a user block, whose
/// length is a power of two from 512.
pub(crate) fn is_hdf5(bytes: &[u8]) -> bool {
    let user_blocks = (9..usize::BITS).map(|shift| 1usize << shift);
    std::iter::once(0)
        .chain(user_blocks)
        .take_while(|&at| at < bytes.len())
        .any(|at| bytes[at..].starts_with(MARK))
}

/// Reads an HDF5 file of whichever format is in it.
pub(crate) fn read(source: &Source, options: &ReadOptions) -> Result<Dataset, Problem> {
    let container = Container::open(source)?;
    if container.has_group("VTKHDF")? {
        return crate::vtk::hdf::read(&container, options);
    }
    netcdf4::read(container, options)
}

/// An open HDF5 file. Clones share it.
#[derive(Clone)]
pub(crate) struct Container {
    file: Hdf5File,
    source: Source,
}

/// Lends the bytes of the mapping to the library.
struct Lent(Source);

impl AsRef<[u8]> for Lent {
    fn as_ref(&self) -> &[u8] {
        self.0.bytes()
    }
}

impl ByteStore for Lent {
    fn bytes(&self) -> &[u8] {
        self.0.bytes()
    }
}

impl Container {
    /// Reads the superblock.
    ///
    /// # Errors
    /// [`Problem`] if it is damaged or of an unknown version.
    pub(crate) fn open(source: &Source) -> Result<Self, Problem> {
        let most = source.len().saturating_mul(MOST_EXPANSION);
        let options = OpenOptions::default()
            .with_chunk_cache_bytes(CHUNK_CACHE_BYTES)
            .with_max_chunk_bytes(most.min(MOST_CHUNK_BYTES))
            .with_max_read_bytes(most)
            .with_max_object_header_bytes(MOST_HEADER_BYTES.min(source.len()));
        let owner = Lent(source.clone());
        let file = guarded("the superblock", || Hdf5File::from_owner(owner, options))?;
        Ok(Self {
            file,
            source: source.clone(),
        })
    }

    /// A group; `None` if there is none of that name.
    fn group(&self, path: &str) -> Result<Option<Group>, Problem> {
        let what = format!("group `{path}`");
        if_there(guarded_raw(&what, || self.file.group(path))?, &what)
    }

    /// Whether there is a group of that name.
    ///
    /// # Errors
    /// [`Problem`] if the way to it is damaged.
    pub(crate) fn has_group(&self, path: &str) -> Result<bool, Problem> {
        Ok(self.group(path)?.is_some())
    }

    /// Names of the groups, and of the arrays, in a group; none if it is not there.
    ///
    /// # Errors
    /// [`Problem`] if the group is damaged.
    pub(crate) fn names(&self, path: &str) -> Result<(Vec<String>, Vec<String>), Problem> {
        match self.group(path)? {
            None => Ok((Vec::new(), Vec::new())),
            Some(group) => guarded(&format!("group `{path}`"), || group.member_names()),
        }
    }

    /// An array; `None` if there is none of that name.
    ///
    /// # Errors
    /// [`Problem`] if what describes it is damaged.
    pub(crate) fn array(&self, path: &str) -> Result<Option<Array>, Problem> {
        let what = format!("array `{path}`");
        match if_there(guarded_raw(&what, || self.file.dataset(path))?, &what)? {
            None => Ok(None),
            Some(dataset) => Array::new(self.clone(), dataset, path).map(Some),
        }
    }

    /// An array that has to be there.
    ///
    /// # Errors
    /// [`Problem`] if it is not, or what describes it is damaged.
    pub(crate) fn need(&self, path: &str) -> Result<Array, Problem> {
        self.array(path)?.ok_or_else(|| {
            Problem::malformed("the HDF5 file", format!("an array `{path}`"), "none")
        })
    }

    fn attribute(&self, group: &str, name: &str) -> Result<Option<Attribute>, Problem> {
        let what = format!("attribute `{name}` of group `{group}`");
        match self.group(group)? {
            None => Ok(None),
            Some(found) => if_there(guarded_raw(&what, || found.attribute(name))?, &what),
        }
    }

    /// A text attribute of a group; `None` if there is none of that name.
    ///
    /// # Errors
    /// [`Problem`] if it is no text.
    pub(crate) fn text(&self, group: &str, name: &str) -> Result<Option<String>, Problem> {
        let what = format!("attribute `{name}` of group `{group}`");
        let attribute = self.attribute(group, name)?;
        attribute.map(|a| text(&a, &what)).transpose()
    }

    /// The numbers of an attribute of a group; `None` if there is none of that name.
    ///
    /// # Errors
    /// [`Problem`] if these are no numbers.
    pub(crate) fn numbers(&self, group: &str, name: &str) -> Result<Option<Vec<f64>>, Problem> {
        let what = format!("attribute `{name}` of group `{group}`");
        let Some(attribute) = self.attribute(group, name)? else {
            return Ok(None);
        };
        macro_rules! as_f64 {
            ($t:ty) => {{
                let numbers = guarded(&what, || attribute.read_1d::<$t>())?;
                numbers.into_iter().map(|v| v as f64).collect()
            }};
        }
        let numbers: Vec<f64> = match attribute.datatype {
            Datatype::FloatingPoint { size: 4, .. } => as_f64!(f32),
            Datatype::FloatingPoint { size: 8, .. } => as_f64!(f64),
            Datatype::FixedPoint { size, signed, .. } => match (size, signed) {
                (1, true) => as_f64!(i8),
                (2, true) => as_f64!(i16),
                (4, true) => as_f64!(i32),
                (8, true) => as_f64!(i64),
                (1, false) => as_f64!(u8),
                (2, false) => as_f64!(u16),
                (4, false) => as_f64!(u32),
                (8, false) => as_f64!(u64),
                _ => return Err(Problem::malformed(what, "numbers", "integers of odd size")),
            },
            other => return Err(Problem::malformed(what, "numbers", array::named(&other))),
        };
        Ok(Some(numbers))
    }
}

/// The text of an attribute, without padding.
fn text(attribute: &Attribute, what: &str) -> Result<String, Problem> {
    let text = guarded(what, || attribute.read_string())?;
    Ok(text.trim_end_matches(['\0', ' ']).to_owned())
}

/// Calls the library; what it fails with, or panics with, is an error that names the place.
fn guarded<T>(what: &str, call: impl FnOnce() -> Result<T, Error>) -> Result<T, Problem> {
    guarded_raw(what, call)?.map_err(|error| problem(what, error))
}

/// As [`guarded`], with the library's own error still to be looked at.
fn guarded_raw<T>(
    what: &str,
    call: impl FnOnce() -> Result<T, Error>,
) -> Result<Result<T, Error>, Problem> {
    // Nothing that a panic leaves half done is used afterwards but the library's caches, which it
    // fills with finished values.
    std::panic::catch_unwind(AssertUnwindSafe(call)).map_err(|_| {
        Problem::malformed(
            what,
            "an HDF5 structure that makes sense",
            "one that cannot be decoded",
        )
    })
}

fn problem(what: &str, error: Error) -> Problem {
    let is_unsupported = |error: &Error| {
        matches!(
            error,
            Error::UnsupportedFilter(_)
                | Error::UnsupportedEncoding(_)
                | Error::UnsupportedDatatypeClass(_)
                | Error::UnsupportedSuperblockVersion(_)
        )
    };
    let mut innermost = &error;
    while let Error::Context { source, .. } = innermost {
        innermost = source;
    }
    if is_unsupported(innermost) {
        return Problem::unsupported(format!("{what}: {innermost}"));
    }
    Problem::Container {
        place: what.to_owned(),
        source: Box::new(error),
    }
}

/// Tells what is not there from what is damaged.
fn if_there<T>(result: Result<T, Error>, what: &str) -> Result<Option<T>, Problem> {
    match result {
        Ok(found) => Ok(Some(found)),
        Err(error) => {
            let mut innermost = &error;
            while let Error::Context { source, .. } = innermost {
                innermost = source;
            }
            match innermost {
                Error::GroupNotFound(_)
                | Error::DatasetNotFound(_)
                | Error::AttributeNotFound(_) => Ok(None),
                _ => Err(problem(what, error)),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn contiguous_arrays_stay_where_they_are() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/hdf");
        for (name, is_mapped) in [
            ("mixed_flat.vtkhdf", true),
            ("mixed_user_block.vtkhdf", true),
            ("mixed_chunk.vtkhdf", false),
            ("mixed_shuffle.vtkhdf", false),
        ] {
            let source = Source::open(&folder.join(name)).expect("committed");
            let container = Container::open(&source).expect("HDF5");
            let types = container.need("VTKHDF/Types").expect("there");
            let types = types.read_rows(3, 5).expect("24 cells");
            assert_eq!(types.tuples(), 5);
            let inside = source.bytes().as_ptr_range();
            assert_eq!(
                inside.contains(&types.bytes().as_ptr()),
                is_mapped,
                "{name}"
            );
        }
    }

    #[test]
    fn pieces_in_the_order_of_c() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/hdf");
        for name in ["mixed_flat.vtkhdf", "mixed_growing_both.vtkhdf"] {
            let source = Source::open(&folder.join(name)).expect("committed");
            let container = Container::open(&source).expect("HDF5");
            let points = container.need("VTKHDF/Points").expect("there");
            let all = points.read_all().expect("27 points");
            for (first, components, tuples) in [(0, 3, 27), (6, 3, 2), (7, 1, 2), (9, 1, 0)] {
                let piece = points.read(first, components, tuples).expect("inside");
                for i in 0..tuples * components {
                    let expected = all.get_f64((first + i) / 3, (first + i) % 3);
                    let found = piece.get_f64(i / components, i % components);
                    assert_eq!(found, expected, "{name}: {first}");
                }
            }
            assert!(points.read(80, 1, 2).is_err());
            assert!(points.read(usize::MAX, 3, usize::MAX).is_err());
            assert!(container.array("VTKHDF/None").expect("no damage").is_none());
            assert!(container.need("VTKHDF/Points/x").is_err());
        }
    }

    #[test]
    fn marks_are_found_after_user_blocks() {
        assert!(is_hdf5(MARK));
        assert!(!is_hdf5(b""));
        assert!(!is_hdf5(b"\x89HDF"));
        for (at, found) in [(512, true), (1024, true), (700, false), (256, false)] {
            let mut bytes = vec![0u8; at];
            bytes.extend(MARK);
            assert_eq!(is_hdf5(&bytes), found, "{at}");
        }
    }
}
