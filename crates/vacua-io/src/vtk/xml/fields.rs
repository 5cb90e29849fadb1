//! Arrays of pieces, and how they become the fields of a whole.
//!
//! Where pieces overlap (shared planes, ghost levels) the value of a piece that owns the point or
//! cell stands: one whose ghost flags do not call it a duplicate.

use std::sync::Arc;

use vacua_volume::{Association, DataArray, Field, LoadError};

use super::data_array::{ArrayKind, DataArrayElement};
use super::document::{Element, XmlFile};
use crate::error::Problem;
use crate::vtk::extent::{Extent, Placement};
use crate::vtk::{GHOST_ARRAY, UNNAMED, bytes, ghost};

/// An array on the points or cells of one piece.
#[derive(Clone, Debug)]
pub(super) struct PieceArray {
    /// The name of the field.
    pub name: String,
    /// Where its numbers are.
    pub element: DataArrayElement,
}

/// The arrays of one piece with one association.
#[derive(Clone, Debug, Default)]
pub(super) struct PieceArrays {
    /// Arrays to show.
    pub fields: Vec<PieceArray>,
    /// `vtkGhostType`.
    pub ghost: Option<DataArrayElement>,
}

impl PieceArrays {
    /// Lists the arrays in `<PointData>` or `<CellData>`; what is left out is noted.
    ///
    /// # Errors
    /// [`Problem::Malformed`] for an array without type or sense.
    pub fn parse(section: Option<&Element>, notes: &mut Vec<String>) -> Result<Self, Problem> {
        let mut arrays = Self::default();
        let Some(section) = section else {
            return Ok(arrays);
        };
        for element in &section.children {
            if !matches!(element.name.as_str(), "DataArray" | "Array") {
                continue;
            }
            match DataArrayElement::parse(element)? {
                ArrayKind::Other { name, type_name } => {
                    notes.push(format!("array `{name}` of type {type_name} is left out"));
                }
                ArrayKind::Numbers(array) if array.name.as_deref() == Some(GHOST_ARRAY) => {
                    arrays.ghost = Some(array);
                }
                ArrayKind::Numbers(array) => {
                    let name = array.name.clone().unwrap_or_else(|| UNNAMED.to_owned());
                    let is_later_step = element.attribute("TimeStep").is_some()
                        && arrays.fields.iter().any(|f| f.name == name);
                    if is_later_step {
                        notes.push(format!("a later time step of array `{name}` is left out"));
                    } else {
                        arrays.fields.push(PieceArray {
                            name,
                            element: array,
                        });
                    }
                }
            }
        }
        Ok(arrays)
    }
}

/// One piece of a grid: its extent, its arrays, and the file they are in.
#[derive(Clone)]
pub(super) struct Piece {
    /// The file.
    pub file: Arc<XmlFile>,
    /// Its points within the whole.
    pub extent: Extent,
    /// Arrays on its points.
    pub point: PieceArrays,
    /// Arrays on its cells.
    pub cell: PieceArrays,
    /// Coordinates of its planes (rectilinear: x, y, z) or of its points (curvilinear: one array).
    pub geometry: Vec<DataArrayElement>,
}

impl Piece {
    fn arrays(&self, association: Association) -> &PieceArrays {
        match association {
            Association::Point => &self.point,
            Association::Cell => &self.cell,
        }
    }
}

/// One array in every piece of a grid.
pub(super) struct SplitArray {
    whole: Extent,
    association: Association,
    parts: Vec<Part>,
}

/// One array in one piece.
struct Part {
    file: Arc<XmlFile>,
    extent: Extent,
    element: DataArrayElement,
    ghost: Option<DataArrayElement>,
}

impl SplitArray {
    /// Gathers an array that `pick` finds in each piece; `None` if some piece lacks it.
    ///
    /// # Errors
    /// [`Problem::Malformed`] if its type differs between pieces.
    pub fn gather(
        whole: Extent,
        association: Association,
        pieces: &[Piece],
        pick: impl Fn(&Piece) -> Option<&DataArrayElement>,
    ) -> Result<Option<Self>, Problem> {
        let mut parts: Vec<Part> = Vec::with_capacity(pieces.len());
        for piece in pieces {
            let Some(element) = pick(piece) else {
                return Ok(None);
            };
            if let Some(first) = parts.first().map(|p| &p.element) {
                let types = [first, element].map(|e| (e.scalar_type, e.components));
                if types[0] != types[1] {
                    return Err(Problem::malformed(
                        element.what(),
                        format!("{} × {}, as in the first piece", types[0].1, types[0].0),
                        format!("{} × {}", types[1].1, types[1].0),
                    ));
                }
            }
            parts.push(Part {
                file: piece.file.clone(),
                extent: piece.extent,
                element: element.clone(),
                ghost: piece.arrays(association).ghost.clone(),
            });
        }
        Ok((!parts.is_empty()).then_some(Self {
            whole,
            association,
            parts,
        }))
    }

    /// Decodes all parts into one array over the whole.
    ///
    /// # Errors
    /// [`Problem`] naming the array, of the first part that cannot be read.
    pub fn read(&self) -> Result<DataArray, Problem> {
        let tuples = self.whole.count(self.association)?;
        if let [part] = self.parts.as_slice()
            && part.extent == self.whole
        {
            return part.element.read(&part.file, tuples);
        }
        let counts: Vec<usize> = self
            .parts
            .iter()
            .map(|part| part.extent.count(self.association))
            .collect::<Result<_, _>>()?;
        for (part, &count) in self.parts.iter().zip(&counts) {
            part.element.check(&part.file, count)?;
        }
        let element = &self.parts[0].element;
        let (scalar_type, components) = (element.scalar_type, element.components);
        let tuple_bytes = components.saturating_mul(scalar_type.size_bytes());
        let numbers = tuples.checked_mul(components).ok_or_else(|| {
            Problem::malformed(element.what(), "an array that fits memory", "a larger one")
        })?;
        bytes::build_array(scalar_type, components, numbers, |to| {
            let owners: Vec<Option<DataArray>> = self
                .parts
                .iter()
                .zip(&counts)
                .map(|(part, &count)| part.duplicates(count))
                .collect::<Result<_, _>>()?;
            let mut place = |part: &Part, count, flags: Option<&[u8]>| {
                let values = part.element.read(&part.file, count)?;
                let placement = Placement::new(&self.whole, &part.extent, self.association);
                placement.scatter(to, values.bytes(), tuple_bytes, flags);
                Ok::<(), Problem>(())
            };
            let parts = || self.parts.iter().zip(&counts).zip(&owners);
            for ((part, &count), flags) in parts() {
                if flags.is_some() {
                    place(part, count, None)?;
                }
            }
            for ((part, &count), flags) in parts() {
                place(part, count, flags.as_ref().map(ghost::flags).transpose()?)?;
            }
            Ok(())
        })
    }
}

impl Part {
    /// The ghost flags of this part, if they call anything a duplicate.
    fn duplicates(&self, count: usize) -> Result<Option<DataArray>, Problem> {
        let Some(ghost) = &self.ghost else {
            return Ok(None);
        };
        let array = ghost.read(&self.file, count)?;
        let any = ghost::flags(&array)?
            .iter()
            .any(|f| ghost::is_duplicate(*f));
        Ok(any.then_some(array))
    }
}

/// The fields that every piece has, loaded when asked for; those missing somewhere are noted.
///
/// # Errors
/// [`Problem::Malformed`] if the type of an array differs between pieces.
pub(super) fn fields(
    whole: Extent,
    pieces: &[Piece],
    notes: &mut Vec<String>,
) -> Result<Vec<Field>, Problem> {
    let mut fields = Vec::new();
    let Some(first) = pieces.first() else {
        return Ok(fields);
    };
    for association in [Association::Point, Association::Cell] {
        let tuples = whole.count(association)?;
        let arrays = &first.arrays(association).fields;
        for (index, PieceArray { name, element }) in arrays.iter().enumerate() {
            let nth = arrays[..index].iter().filter(|a| a.name == *name).count();
            let split = SplitArray::gather(whole, association, pieces, |piece| {
                let same = piece.arrays(association).fields.iter();
                let mut same = same.filter(|a| a.name == *name);
                same.nth(nth).map(|a| &a.element)
            })?;
            let Some(split) = split else {
                notes.push(format!(
                    "{association} array `{name}` is missing in some piece and left out"
                ));
                continue;
            };
            let (scalar_type, components) = (element.scalar_type, element.components);
            let load = move || {
                split
                    .read()
                    .map_err(|problem| Arc::new(problem) as LoadError)
            };
            fields.push(Field::lazy(
                name.as_str(),
                association,
                scalar_type,
                components,
                tuples,
                load,
            ));
        }
    }
    Ok(fields)
}

/// The ghost flags of the whole, if every piece has some.
///
/// # Errors
/// [`Problem`] if they cannot be read.
pub(super) fn ghost_flags(
    whole: Extent,
    pieces: &[Piece],
    association: Association,
) -> Result<Option<DataArray>, Problem> {
    let pick = |piece: &Piece| piece.arrays(association).ghost.is_some();
    if !pieces.iter().all(pick) {
        return Ok(None);
    }
    SplitArray::gather(whole, association, pieces, |piece| {
        piece.arrays(association).ghost.as_ref()
    })?
    .map(|split| split.read())
    .transpose()
}
