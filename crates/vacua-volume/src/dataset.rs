//! Datasets, as files hold them, and volumes: a dataset with one scalar field chosen to be seen.

use std::sync::Arc;

use crate::array::DataArray;
use crate::field::{Association, Field, FieldError};
use crate::frame::WorldFrame;
use crate::grid::Geometry;
use crate::mesh::UnstructuredMesh;

/// One bit a cell: set where the cell is blanked, that is, holds nothing to see.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CellMask {
    words: Vec<u32>,
    len: usize,
}

impl CellMask {
    /// A mask over `len` cells, none of them blanked.
    pub fn new(len: usize) -> Self {
        Self {
            words: vec![0; len.div_ceil(32)],
            len,
        }
    }

    /// Blanks a cell.
    ///
    /// # Panics
    /// If the cell is out of range.
    pub fn blank(&mut self, cell: usize) {
        assert!(cell < self.len, "cell {cell} of {}", self.len);
        self.words[cell / 32] |= 1 << (cell % 32);
    }

    /// Whether a cell is blanked.
    ///
    /// # Panics
    /// If the cell is out of range.
    pub fn is_blank(&self, cell: usize) -> bool {
        assert!(cell < self.len, "cell {cell} of {}", self.len);
        self.words[cell / 32] >> (cell % 32) & 1 == 1
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are no cells.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Number of blanked cells.
    pub fn num_blank(&self) -> usize {
        self.words.iter().map(|w| w.count_ones() as usize).sum()
    }

    /// The bits, cell 0 lowest in the first word.
    pub fn words(&self) -> &[u32] {
        &self.words
    }
}

/// What a file holds: geometry, fields, blanked cells, and what the reader wants the user to know.
#[derive(Clone, Debug)]
pub struct Dataset {
    geometry: Arc<Geometry>,
    fields: Vec<Field>,
    frame: WorldFrame,
    field_data: Vec<String>,
    blanked_cells: Option<Arc<CellMask>>,
    notes: Vec<String>,
    times: Vec<f64>,
    step: usize,
}

/// Why a dataset does not fit together, or has not what was asked for.
#[derive(Clone, Debug, thiserror::Error)]
pub enum DatasetError {
    /// A field with the wrong number of tuples.
    #[error("field `{name}` has {actual} tuples for {expected} {association}s")]
    FieldLength {
        /// Name of the field.
        name: String,
        /// Its association.
        association: Association,
        /// Tuples it has.
        actual: usize,
        /// Points or cells there are.
        expected: usize,
    },
    /// A blanking mask of the wrong length.
    #[error("the blanking mask covers {actual} cells of {expected}")]
    MaskLength {
        /// Cells in the mask.
        actual: usize,
        /// Cells there are.
        expected: usize,
    },
    /// No field by that name.
    #[error("there is no field `{asked}`; there {}", list(.available))]
    NoSuchField {
        /// What was asked for.
        asked: String,
        /// The names there are.
        available: Vec<String>,
    },
    /// Several fields, and none was asked for.
    #[error("which field? There {}", list(.available))]
    FieldNotChosen {
        /// The names there are.
        available: Vec<String>,
    },
    /// A component that the field does not have.
    #[error("field `{name}` has components 0 to {}, not {asked}", .components - 1)]
    NoSuchComponent {
        /// Name of the field.
        name: String,
        /// Component asked for.
        asked: usize,
        /// Number of components.
        components: usize,
    },
    /// The values could not be loaded.
    #[error(transparent)]
    Field(#[from] FieldError),
}

fn list(names: &[String]) -> String {
    match names {
        [] => "are none".to_owned(),
        names => format!("are: {}", names.join(", ")),
    }
}

/// Which field to show.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum FieldChoice {
    /// The only field; several are an error.
    #[default]
    Only,
    /// By name.
    Name(String),
    /// By position in [`Dataset::fields`].
    Index(usize),
}

impl FieldChoice {
    /// Position of the chosen field among fields of these names.
    ///
    /// # Errors
    /// [`DatasetError::NoSuchField`] or [`DatasetError::FieldNotChosen`].
    pub fn among(&self, names: &[impl AsRef<str>]) -> Result<usize, DatasetError> {
        let available = || names.iter().map(|n| n.as_ref().to_owned()).collect();
        let (found, asked) = match self {
            Self::Only if names.len() == 1 => return Ok(0),
            Self::Only => {
                return Err(DatasetError::FieldNotChosen {
                    available: available(),
                });
            }
            Self::Name(name) => (names.iter().position(|n| n.as_ref() == name), name.clone()),
            Self::Index(index) => (
                Some(*index).filter(|&i| i < names.len()),
                format!("#{index}"),
            ),
        };
        found.ok_or_else(|| DatasetError::NoSuchField {
            asked,
            available: available(),
        })
    }
}

/// Which component of a field with several.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ComponentChoice {
    /// The lone component, or the magnitude of several.
    #[default]
    Auto,
    /// One component, counted from 0.
    Index(usize),
    /// The Euclidean length.
    Magnitude,
}

/// Checks that a field has as many tuples as there are points or cells.
fn check_len(geometry: &Geometry, field: &Field) -> Result<(), DatasetError> {
    let expected = match field.association() {
        Association::Point => geometry.num_points(),
        Association::Cell => geometry.num_cells(),
    };
    if field.tuples() == expected {
        return Ok(());
    }
    Err(DatasetError::FieldLength {
        name: field.name().to_owned(),
        association: field.association(),
        actual: field.tuples(),
        expected,
    })
}

impl Dataset {
    /// Puts geometry and fields together. Cells that a mesh calls blanked are blanked in the dataset.
    ///
    /// # Errors
    /// [`DatasetError::FieldLength`] if they do not fit.
    pub fn new(geometry: Geometry, fields: Vec<Field>) -> Result<Self, DatasetError> {
        for field in &fields {
            check_len(&geometry, field)?;
        }
        let blanked_cells = geometry
            .mesh()
            .and_then(|mesh| mesh.blanked_cells().cloned());
        Ok(Self {
            geometry: Arc::new(geometry),
            fields,
            frame: WorldFrame::Unlabelled,
            field_data: Vec::new(),
            blanked_cells,
            notes: Vec::new(),
            times: Vec::new(),
            step: 0,
        })
    }

    /// The same points and cells with other fields; everything else stays.
    ///
    /// # Errors
    /// As [`Dataset::new`].
    pub fn with_fields(mut self, fields: Vec<Field>) -> Result<Self, DatasetError> {
        for field in &fields {
            check_len(&self.geometry, field)?;
        }
        self.fields = fields;
        Ok(self)
    }

    /// Says in which anatomical frame the world coordinates are; none is said before.
    pub fn with_frame(mut self, frame: WorldFrame) -> Self {
        self.frame = frame;
        self
    }

    /// Names arrays of the file that belong to neither points nor cells and are not kept.
    pub fn with_field_data(mut self, names: Vec<String>) -> Self {
        self.field_data = names;
        self
    }

    /// Marks cells that hold nothing to see, in place of those that were marked before. A mesh
    /// carries the same mask, so that encoding it leaves them out.
    ///
    /// # Errors
    /// [`DatasetError::MaskLength`] if the mask covers another number of cells.
    pub fn with_blanked_cells(mut self, mask: CellMask) -> Result<Self, DatasetError> {
        let expected = self.geometry.num_cells();
        if mask.len() != expected {
            return Err(DatasetError::MaskLength {
                actual: mask.len(),
                expected,
            });
        }
        self.blanked_cells = (mask.num_blank() > 0).then(|| Arc::new(mask));
        if let Geometry::Unstructured(mesh) = &*self.geometry {
            let mesh = mesh
                .clone()
                .with_same_blanked_cells(self.blanked_cells.clone());
            self.geometry = Arc::new(Geometry::Unstructured(mesh));
        }
        Ok(self)
    }

    /// Adds something the user should know about how the file was understood.
    pub fn with_note(mut self, note: impl Into<String>) -> Self {
        self.notes.push(note.into());
        self
    }

    /// Says which time steps the file has, and which of them this is.
    pub fn with_times(mut self, times: Vec<f64>, step: usize) -> Self {
        self.times = times;
        self.step = step;
        self
    }

    /// The times of the steps of a file that has steps.
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// Which of the file's time steps this is, from 0.
    pub fn step(&self) -> usize {
        self.step
    }

    /// Where the points and cells are.
    pub fn geometry(&self) -> &Arc<Geometry> {
        &self.geometry
    }

    /// The mesh, if the geometry is one.
    pub fn mesh(&self) -> Option<&UnstructuredMesh> {
        self.geometry.mesh()
    }

    /// The anatomical frame of the world coordinates.
    pub fn frame(&self) -> WorldFrame {
        self.frame
    }

    /// Names of the file's arrays that belong to neither points nor cells (VTK's field data). Their
    /// values are not kept.
    pub fn field_data(&self) -> &[String] {
        &self.field_data
    }

    /// All fields.
    pub fn fields(&self) -> &[Field] {
        &self.fields
    }

    /// Cells that hold nothing to see, if any.
    pub fn blanked_cells(&self) -> Option<&Arc<CellMask>> {
        self.blanked_cells.as_ref()
    }

    /// What the reader wants the user to know.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Finds a field.
    ///
    /// # Errors
    /// [`DatasetError::NoSuchField`] or [`DatasetError::FieldNotChosen`].
    pub fn field(&self, choice: &FieldChoice) -> Result<&Field, DatasetError> {
        let names: Vec<&str> = self.fields.iter().map(Field::name).collect();
        Ok(&self.fields[choice.among(&names)?])
    }

    /// Loads one scalar field, ready to be rendered.
    ///
    /// # Errors
    /// [`DatasetError`] if there is no such field or component, or it cannot be loaded.
    pub fn volume(
        &self,
        field: &FieldChoice,
        component: ComponentChoice,
    ) -> Result<Volume, DatasetError> {
        let field = self.field(field)?;
        let all = field.load()?;
        let scalars = match component {
            ComponentChoice::Auto if all.components() == 1 => all.clone(),
            ComponentChoice::Auto | ComponentChoice::Magnitude => all.magnitude(),
            ComponentChoice::Index(asked) if asked < all.components() => all.component(asked),
            ComponentChoice::Index(asked) => {
                return Err(DatasetError::NoSuchComponent {
                    name: field.name().to_owned(),
                    asked,
                    components: all.components(),
                });
            }
        };
        Ok(Volume {
            geometry: self.geometry.clone(),
            name: field.name().to_owned(),
            association: field.association(),
            scalars,
            blanked_cells: self.blanked_cells.clone(),
        })
    }
}

/// What a renderer shows: geometry with one scalar a point or cell, in its native type.
#[derive(Clone, Debug)]
pub struct Volume {
    geometry: Arc<Geometry>,
    name: String,
    association: Association,
    scalars: DataArray,
    blanked_cells: Option<Arc<CellMask>>,
}

impl Volume {
    /// Where the points and cells are.
    pub fn geometry(&self) -> &Arc<Geometry> {
        &self.geometry
    }

    /// The mesh, if the geometry is one.
    pub fn mesh(&self) -> Option<&UnstructuredMesh> {
        self.geometry.mesh()
    }

    /// Name of the field.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Whether the scalars are on points or cells.
    pub fn association(&self) -> Association {
        self.association
    }

    /// One number a point or cell, x fastest.
    pub fn scalars(&self) -> &DataArray {
        &self.scalars
    }

    /// Cells that hold nothing to see, if any.
    pub fn blanked_cells(&self) -> Option<&Arc<CellMask>> {
        self.blanked_cells.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::CellType;

    fn two_tetrahedra() -> UnstructuredMesh {
        let positions = (0..15).map(|i| i as f32).collect::<Vec<_>>();
        UnstructuredMesh::uniform(
            DataArray::from_vec(positions, 3).expect("triples"),
            CellType::Tetrahedron,
            DataArray::from_vec(vec![0u32, 1, 2, 3, 1, 2, 3, 4], 1).expect("one column"),
        )
        .expect("valid")
    }

    fn field(association: Association, len: usize) -> Field {
        let values = DataArray::from_vec(vec![1u8; len], 1).expect("one column");
        Field::new("f", association, values)
    }

    #[test]
    fn fields_of_a_mesh_are_as_long_as_it_has_points_or_cells() {
        let geometry = Geometry::Unstructured(two_tetrahedra());
        assert_eq!((geometry.num_points(), geometry.num_cells()), (5, 2));
        assert_eq!(
            (geometry.kind(), geometry.dimensions()),
            ("unstructured", None)
        );
        let fields = vec![field(Association::Point, 5), field(Association::Cell, 2)];
        let dataset = Dataset::new(geometry.clone(), fields).expect("fits");
        assert_eq!(dataset.mesh().map(UnstructuredMesh::num_cells), Some(2));
        for (association, actual, wanted) in [(Association::Point, 2, 5), (Association::Cell, 5, 2)]
        {
            let error = Dataset::new(geometry.clone(), vec![field(association, actual)])
                .expect_err("the wrong number");
            assert!(matches!(
                error,
                DatasetError::FieldLength { expected, .. } if expected == wanted
            ));
        }
    }

    #[test]
    fn a_mesh_and_its_dataset_blank_the_same_cells() {
        let mut mask = CellMask::new(2);
        mask.blank(1);
        let mesh = two_tetrahedra()
            .with_blanked_cells(mask.clone())
            .expect("fits");
        let dataset = Dataset::new(Geometry::Unstructured(mesh), Vec::new()).expect("fits");
        assert_eq!(dataset.blanked_cells().map(|m| &**m), Some(&mask));

        let plain = Geometry::Unstructured(two_tetrahedra());
        let dataset = Dataset::new(plain, Vec::new()).expect("fits");
        assert!(dataset.blanked_cells().is_none());
        let dataset = dataset.with_blanked_cells(mask.clone()).expect("fits");
        let of_mesh = dataset.mesh().and_then(UnstructuredMesh::blanked_cells);
        assert_eq!(of_mesh.map(|m| &**m), Some(&mask));
        let dataset = dataset.with_blanked_cells(CellMask::new(2)).expect("fits");
        assert!(dataset.mesh().is_some_and(|m| m.blanked_cells().is_none()));
        assert!(dataset.with_blanked_cells(CellMask::new(3)).is_err());
    }
}
