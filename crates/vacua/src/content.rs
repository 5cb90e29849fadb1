//! What a file gives: a dataset, or a mesh that was encoded before; and what a scene is made of.

use std::path::Path;
use std::sync::Arc;

use vacua_io::{IoError, Problem, ReadOptions, Source};
use vacua_pack::PackedVolume;
use vacua_pack::file::{PackedFile, is_packed};
use vacua_render::SceneData;
use vacua_volume::{ComponentChoice, Dataset, FieldChoice, Volume};

use crate::quick::Error;

/// What a scene shows: a dataset or an encoded mesh, one field of which is chosen later, or one
/// field.
#[derive(Clone, Debug)]
pub enum Content {
    /// All that a file holds.
    Dataset(Dataset),
    /// A `.vacua` file, used where it is mapped, and the number of a time step of it; the first if not
    /// given.
    Encoded(Arc<PackedFile>, Option<u32>),
    /// One scalar field.
    Data(SceneData),
}

/// Opens any file that vacua reads, `.vacua` files included.
///
/// # Errors
/// [`IoError`] naming the file, the place in it and what was expected there.
pub fn open(path: impl AsRef<Path>) -> Result<Content, IoError> {
    open_with(path, &ReadOptions::default())
}

/// As [`open`], with what a file does not say of itself.
///
/// # Errors
/// As [`open`].
pub fn open_with(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Content, IoError> {
    let path = path.as_ref();
    if path.is_file() {
        let source = Source::open(path)?;
        if is_packed(source.bytes()) {
            let file = PackedFile::from_source(source)?;
            let step = options.step.map(|s| u32::try_from(s).unwrap_or(u32::MAX));
            return Ok(Content::Encoded(Arc::new(file), step));
        }
    }
    let dataset = vacua_io::open_with(path, options);
    dataset.map(Content::Dataset).map_err(with_own_format)
}

/// Adds `.vacua` files, of which `vacua-io` knows nothing, to the formats that an error lists.
pub fn with_own_format(mut error: IoError) -> IoError {
    if let Problem::UnknownFormat { known, .. } = &mut error.problem {
        known.push_str(", .vacua");
    }
    error
}

impl Content {
    /// Names of the fields that can be chosen.
    ///
    /// # Errors
    /// [`IoError`] if those of a `.vacua` file are damaged.
    pub fn field_names(&self) -> Result<Vec<String>, IoError> {
        Ok(match self {
            Self::Dataset(dataset) => {
                let names = dataset.fields().iter().map(|field| field.name().to_owned());
                names.collect()
            }
            Self::Encoded(file, step) => {
                let first = file.steps()?.first().map(|s| s.number);
                let groups = file.groups_of(step.or(first))?;
                groups.into_iter().map(|group| group.name).collect()
            }
            Self::Data(data) => vec![data.name().to_owned()],
        })
    }

    /// One scalar field, loaded.
    ///
    /// # Errors
    /// [`Error::Dataset`] if there is no such field or component, or several and no choice;
    /// [`Error::Dataset`] or [`Error::Io`] if it cannot be read.
    pub fn data(
        &self,
        field: &FieldChoice,
        component: ComponentChoice,
    ) -> Result<SceneData, Error> {
        match self {
            Self::Dataset(dataset) => Ok(dataset.volume(field, component)?.into()),
            Self::Encoded(file, step) => {
                Ok(PackedVolume::open_part(file, *step, field, component)?.into())
            }
            Self::Data(data) => Ok(data.clone()),
        }
    }
}

impl From<Dataset> for Content {
    fn from(dataset: Dataset) -> Self {
        Self::Dataset(dataset)
    }
}

impl From<PackedFile> for Content {
    fn from(file: PackedFile) -> Self {
        Self::Encoded(Arc::new(file), None)
    }
}

impl From<SceneData> for Content {
    fn from(data: SceneData) -> Self {
        Self::Data(data)
    }
}

impl From<PackedVolume> for Content {
    fn from(packed: PackedVolume) -> Self {
        Self::Data(packed.into())
    }
}

impl From<Volume> for Content {
    fn from(volume: Volume) -> Self {
        Self::Data(volume.into())
    }
}

impl From<Arc<Volume>> for Content {
    fn from(volume: Arc<Volume>) -> Self {
        Self::Data(volume.into())
    }
}
