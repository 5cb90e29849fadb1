//! Fields: named values on the points or the cells of a dataset, loaded when first asked for.

use std::error::Error;
use std::fmt;
use std::sync::{Arc, OnceLock};

use crate::array::DataArray;
use crate::scalar::ScalarType;

/// Where the values of a field live.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Association {
    /// One tuple a point; linear within a cell.
    Point,
    /// One tuple a cell; constant within it.
    Cell,
}

impl fmt::Display for Association {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Point => "point",
            Self::Cell => "cell",
        })
    }
}

/// What a lazy loader may fail with: the reader's own error.
pub type LoadError = Arc<dyn Error + Send + Sync>;

type Loader = dyn Fn() -> Result<DataArray, LoadError> + Send + Sync;

/// A named array on the points or cells of a dataset. Clones share the loaded values.
#[derive(Clone)]
pub struct Field {
    name: String,
    association: Association,
    scalar_type: ScalarType,
    components: usize,
    tuples: usize,
    values: Arc<OnceLock<DataArray>>,
    loader: Option<Arc<Loader>>,
}

/// Values that could not be had.
#[derive(Clone, Debug, thiserror::Error)]
pub enum FieldError {
    /// The reader failed.
    #[error("cannot load field `{name}`")]
    Load {
        /// Name of the field.
        name: String,
        /// The reader's error.
        #[source]
        source: LoadError,
    },
    /// The reader gave something else than its header had promised.
    #[error("field `{name}` was announced as {expected}, loaded as {actual}")]
    Mismatch {
        /// Name of the field.
        name: String,
        /// What the header said.
        expected: String,
        /// What came.
        actual: String,
    },
}

impl Field {
    /// A field whose values are in memory (or mapped) already.
    pub fn new(name: impl Into<String>, association: Association, values: DataArray) -> Self {
        Self {
            name: name.into(),
            association,
            scalar_type: values.scalar_type(),
            components: values.components(),
            tuples: values.tuples(),
            values: Arc::new(OnceLock::from(values)),
            loader: None,
        }
    }

    /// A field whose values are read when first asked for.
    pub fn lazy(
        name: impl Into<String>,
        association: Association,
        scalar_type: ScalarType,
        components: usize,
        tuples: usize,
        loader: impl Fn() -> Result<DataArray, LoadError> + Send + Sync + 'static,
    ) -> Self {
        Self {
            name: name.into(),
            association,
            scalar_type,
            components,
            tuples,
            values: Arc::new(OnceLock::new()),
            loader: Some(Arc::new(loader)),
        }
    }

    /// The name it has in the file; `scalars` if it has none there.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// On points or on cells.
    pub fn association(&self) -> Association {
        self.association
    }

    /// Type of a number.
    pub fn scalar_type(&self) -> ScalarType {
        self.scalar_type
    }

    /// Numbers in a tuple.
    pub fn components(&self) -> usize {
        self.components
    }

    /// Number of tuples.
    pub fn tuples(&self) -> usize {
        self.tuples
    }

    /// The values, loaded at the first call.
    ///
    /// # Errors
    /// [`FieldError`] if the reader fails or contradicts its own header.
    pub fn load(&self) -> Result<&DataArray, FieldError> {
        if let Some(values) = self.values.get() {
            return Ok(values);
        }
        let Some(loader) = &self.loader else {
            unreachable!("a field has values or a loader")
        };
        let values = loader().map_err(|source| FieldError::Load {
            name: self.name.clone(),
            source,
        })?;
        let shape = (values.scalar_type(), values.components(), values.tuples());
        if shape != (self.scalar_type, self.components, self.tuples) {
            return Err(FieldError::Mismatch {
                name: self.name.clone(),
                expected: format!("{} × {} {}", self.tuples, self.components, self.scalar_type),
                actual: format!("{} × {} {}", shape.2, shape.1, shape.0),
            });
        }
        Ok(self.values.get_or_init(|| values))
    }
}

impl fmt::Debug for Field {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "Field({:?} on {}s: {} × {} {})",
            self.name, self.association, self.tuples, self.components, self.scalar_type
        )
    }
}
