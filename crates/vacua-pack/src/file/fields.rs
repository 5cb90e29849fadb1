//! The fields of a `.vacua` file: which there are, of which time steps, and their values.

use vacua_io::{IoError, Problem};
use vacua_volume::{Association, ComponentChoice, DataArray, DatasetError, ScalarType};

use super::*;
use crate::Variant;
use crate::field::PackedField;
use crate::packed::PackedMesh;
use crate::small::{FramedValues, num_blocks};

/// What the table says of a field.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldEntry {
    /// Its name.
    pub name: String,
    /// On points or on cells.
    pub association: Association,
    /// Type of a value.
    pub scalar_type: ScalarType,
    /// The time step it is of, in files with several, and the vector it is a part of, if it is.
    pub label: FieldLabel,
}

/// A field as it was before it was packed: one packed field, or one for each component and the
/// magnitude.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldGroup {
    /// Its name.
    pub name: String,
    /// On points or on cells.
    pub association: Association,
    /// Type of a component.
    pub scalar_type: ScalarType,
    /// The time step it is of, in files with several.
    pub step: Option<FieldStep>,
    /// Its parts by their places in [`PackedFile::fields`]; without a component the field itself.
    pub parts: Vec<(Option<VectorComponent>, usize)>,
}

impl FieldGroup {
    /// Number of components.
    pub fn components(&self) -> usize {
        match self.parts.as_slice() {
            [(None, _)] => 1,
            parts => {
                let last = parts.iter().filter_map(|(part, _)| match part {
                    Some(VectorComponent::Index(index)) => Some(*index as usize + 1),
                    _ => None,
                });
                last.max().unwrap_or(0)
            }
        }
    }

    /// The place of a part; of the field itself for one with a single component.
    ///
    /// # Errors
    /// [`DatasetError::NoSuchComponent`] if there is no such component.
    pub fn part(&self, choice: ComponentChoice) -> Result<usize, DatasetError> {
        let wanted = match (self.parts.as_slice(), choice) {
            ([(None, place)], ComponentChoice::Index(0)) => return Ok(*place),
            ([(None, place)], ComponentChoice::Auto | ComponentChoice::Magnitude) => {
                return Ok(*place);
            }
            (_, ComponentChoice::Auto | ComponentChoice::Magnitude) => VectorComponent::Magnitude,
            (_, ComponentChoice::Index(index)) => {
                VectorComponent::Index(u32::try_from(index).unwrap_or(u32::MAX))
            }
        };
        let found = self.parts.iter().find(|(part, _)| *part == Some(wanted));
        let missing = || DatasetError::NoSuchComponent {
            name: self.name.clone(),
            asked: match choice {
                ComponentChoice::Index(asked) => asked,
                _ => self.components(),
            },
            components: self.components(),
        };
        found.map(|&(_, place)| place).ok_or_else(missing)
    }
}

impl PackedFile {
    /// What fields there are.
    ///
    /// # Errors
    /// [`IoError`] if a field's name or values are missing or their description is not understood.
    pub fn fields(&self) -> Result<Vec<FieldEntry>, IoError> {
        let numbers = self.table.iter().filter(|e| e.kind == NAME);
        numbers
            .map(|e| self.field_entry(e.field))
            .collect::<Result<_, _>>()
            .map_err(|p| p.in_file(&self.path))
    }

    /// The time steps that fields are of, by their numbers; none in a file without.
    ///
    /// # Errors
    /// As [`Self::fields`].
    pub fn steps(&self) -> Result<Vec<FieldStep>, IoError> {
        let mut steps: Vec<FieldStep> = Vec::new();
        for field in self.fields()? {
            let known = |s: FieldStep| steps.iter().any(|k| k.number == s.number);
            steps.extend(field.label.step.filter(|&s| !known(s)));
        }
        steps.sort_by_key(|s| s.number);
        Ok(steps)
    }

    /// The fields with their components together, in the order of the file.
    ///
    /// # Errors
    /// As [`Self::fields`].
    pub fn groups(&self) -> Result<Vec<FieldGroup>, IoError> {
        let mut groups: Vec<FieldGroup> = Vec::new();
        for (place, entry) in self.fields()?.into_iter().enumerate() {
            let FieldLabel { step, vector } = entry.label;
            let (name, part) = match vector {
                None => (entry.name, None),
                Some(vector) => (vector.name, Some(vector.component)),
            };
            let number = step.map(|s| s.number);
            let same = |g: &&mut FieldGroup| {
                let is_part = g
                    .parts
                    .iter()
                    .all(|(p, _)| p.is_some_and(|p| Some(p) != part));
                g.name == name
                    && g.step.map(|s| s.number) == number
                    && g.association == entry.association
                    && is_part
            };
            match groups.iter_mut().find(same).filter(|_| part.is_some()) {
                Some(group) => {
                    group.parts.push((part, place));
                    // The magnitude of whole numbers has none.
                    if let Some(VectorComponent::Index(_)) = part {
                        group.scalar_type = entry.scalar_type;
                    }
                }
                None => groups.push(FieldGroup {
                    name,
                    association: entry.association,
                    scalar_type: entry.scalar_type,
                    step,
                    parts: vec![(part, place)],
                }),
            }
        }
        Ok(groups)
    }

    /// As [`Self::groups`], those of one time step, and those of none.
    ///
    /// # Errors
    /// As [`Self::fields`].
    pub fn groups_of(&self, step: Option<u32>) -> Result<Vec<FieldGroup>, IoError> {
        let mut groups = self.groups()?;
        groups.retain(|g| g.step.is_none() || g.step.map(|s| s.number) == step);
        Ok(groups)
    }

    pub(super) fn field_entry(&self, field: u32) -> Result<FieldEntry, Problem> {
        let (name, place) = self.section(NAME, field)?;
        let values = self.find_values(field)?;
        let bytes = self.store.bytes().get(place).unwrap_or(&[]);
        let bad_name =
            |_| Problem::malformed(format!("name of field {field}"), "UTF-8", "other bytes");
        let association = match name.detail {
            0 => Association::Point,
            1 => Association::Cell,
            other => {
                let place = format!("association of field {field}");
                return Err(Problem::malformed(
                    place,
                    "0 (points) or 1 (cells)",
                    other.to_string(),
                ));
            }
        };
        let scalar_type = *ScalarType::ALL
            .get(values.1.detail as usize)
            .ok_or_else(|| {
                let place = format!("number type of field {field}");
                Problem::malformed(place, "0 to 9", values.1.detail.to_string())
            })?;
        Ok(FieldEntry {
            name: std::str::from_utf8(bytes).map_err(bad_name)?.to_owned(),
            association,
            scalar_type,
            label: FieldLabel {
                step: self.step_of(field)?,
                vector: self.vector_of(field)?,
            },
        })
    }

    fn vector_of(&self, field: u32) -> Result<Option<VectorPart>, Problem> {
        if self.find(VECTOR, field).is_err() {
            return Ok(None);
        }
        let (entry, place) = self.section(VECTOR, field)?;
        let bytes = self.store.bytes().get(place).unwrap_or(&[]);
        let name = std::str::from_utf8(bytes).map_err(|_| {
            Problem::malformed(format!("vector of field {field}"), "UTF-8", "other bytes")
        })?;
        Ok(Some(VectorPart {
            name: name.to_owned(),
            component: VectorComponent::of_detail(entry.detail),
        }))
    }

    fn step_of(&self, field: u32) -> Result<Option<FieldStep>, Problem> {
        if self.find(STEP, field).is_err() {
            return Ok(None);
        }
        let (entry, place) = self.section(STEP, field)?;
        let bytes = self.store.bytes().get(place).unwrap_or(&[]);
        let time: [u8; 8] = bytes.try_into().map_err(|_| {
            let place = format!("time step of field {field}");
            Problem::malformed(place, "8 bytes", bytes.len().to_string())
        })?;
        Ok(Some(FieldStep {
            number: entry.detail,
            time: f64::from_le_bytes(time),
        }))
    }

    /// One field, by its place in [`Self::fields`], for the mesh of this file. Its arrays stay in the
    /// file.
    ///
    /// # Errors
    /// [`IoError`] if there is no such field, or a section of it is missing, damaged, or does not fit
    /// the mesh.
    pub fn field(&self, mesh: &PackedMesh, field: usize) -> Result<PackedField, IoError> {
        self.read_field(mesh, field)
            .map_err(|p| p.in_file(&self.path))
    }

    fn read_field(&self, mesh: &PackedMesh, field: usize) -> Result<PackedField, Problem> {
        let mut numbers = self.table.iter().filter(|e| e.kind == NAME);
        let number = numbers.nth(field).map(|e| e.field).ok_or_else(|| {
            Problem::malformed(format!("field {field}"), "a field", "fewer fields")
        })?;
        let entry = self.field_entry(number)?;
        let what = |part: &str| format!("{part} of field `{}`", entry.name);
        let expect = |part: &str, expected: u64, actual: usize| {
            if expected == actual as u64 {
                return Ok(());
            }
            Err(Problem::malformed(
                what(part),
                expected.to_string(),
                actual.to_string(),
            ))
        };
        let (values, framed) = match mesh.clusters() {
            None => {
                let (_, place) = self.section(VALUES, number)?;
                let size = entry.scalar_type.size_bytes();
                let tuples = place.len() / size;
                expect("bytes of values", (tuples * size) as u64, place.len())?;
                let (store, offset) = (self.store.clone(), place.start);
                let values = DataArray::from_store(store, offset, entry.scalar_type, 1, tuples)?;
                let needed = match entry.association {
                    Association::Point => mesh.num_vertices() as u64,
                    Association::Cell => mesh.num_cells(),
                };
                expect("number of values", needed, tuples)?;
                (values, None)
            }
            Some(_) => {
                let framed = FramedValues::new(
                    entry.scalar_type,
                    self.flat(VALUE_FRAMES, number)?,
                    self.flat(FRAMED_VALUES, number)?,
                );
                let needed = mesh
                    .submeshes()
                    .iter()
                    .map(|header| match entry.association {
                        Association::Point => num_blocks(u64::from(header.num_vertices)),
                        Association::Cell => num_blocks(header.total_cells()),
                    });
                let needed = needed.fold(0, u64::saturating_add);
                expect("number of frames of values", needed, framed.num_blocks())?;
                (framed.no_values()?, Some(framed))
            }
        };
        let field = PackedField {
            submesh_ranges: self.flat(SUBMESH_RANGES, number)?,
            node_ranges: self.flat(NODE_RANGES, number)?,
            cells_before: match entry.association {
                _ if framed.is_some() => None,
                Association::Point => None,
                Association::Cell => Some(self.flat(CELLS_BEFORE, number)?),
            },
            name: entry.name.clone(),
            association: entry.association,
            values,
            framed,
        };
        let num_nodes = mesh.nodes().len() as u64;
        let submeshes = field.submesh_ranges.as_slice().len();
        expect(
            "number of ranges of sub-meshes",
            mesh.submeshes().len() as u64,
            submeshes,
        )?;
        expect(
            "number of ranges of nodes",
            num_nodes,
            field.node_ranges.as_slice().len(),
        )?;
        if let Some(before) = &field.cells_before {
            expect("number of nodes", num_nodes, before.as_slice().len())?;
        }
        Ok(field)
    }

    /// The section of a field's values, in frames or not.
    fn find_values(&self, field: u32) -> Result<(usize, &Entry), Problem> {
        match self.variant() {
            Variant::Small => self.find(FRAMED_VALUES, field),
            _ => self.find(VALUES, field),
        }
    }
}
