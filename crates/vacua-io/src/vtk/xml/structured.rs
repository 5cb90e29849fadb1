//! Structured grids from VTK XML: `.vti`, `.vtr`, `.vts`, of one piece or many.

use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3};
use vacua_volume::{
    Association, CurvilinearGrid, DataArray, Dataset, Geometry, RectilinearGrid, ScalarType,
    UniformGrid,
};

use super::data_array::DataArrayElement;
use super::document::{Element, XmlFile};
use super::fields::{Piece, PieceArrays, SplitArray, fields, ghost_flags};
use crate::error::Problem;
use crate::vtk::extent::{Extent, check_cover};
use crate::vtk::ghost;

/// Which grid a file holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum GridKind {
    /// `ImageData`.
    Image,
    /// `RectilinearGrid`.
    Rectilinear,
    /// `StructuredGrid`.
    Curvilinear,
}

impl GridKind {
    /// By the `type` of a serial file.
    pub fn from_type(type_name: &str) -> Option<Self> {
        match type_name {
            "ImageData" => Some(Self::Image),
            "RectilinearGrid" => Some(Self::Rectilinear),
            "StructuredGrid" => Some(Self::Curvilinear),
            _ => None,
        }
    }
}

/// A grid as files describe it: its extent, its placement, its pieces.
pub(super) struct Structured {
    kind: GridKind,
    whole: Extent,
    world_from_structured: DAffine3,
    pieces: Vec<Piece>,
    notes: Vec<String>,
}

impl Structured {
    /// A grid without pieces, from the element that describes the whole.
    ///
    /// # Errors
    /// [`Problem::Malformed`] for an extent or placement without sense.
    pub fn new(kind: GridKind, data_set: &Element) -> Result<Self, Problem> {
        let whole = parse_extent(data_set, "WholeExtent")?;
        whole.refuse_flat()?;
        let origin = data_set.numbers::<3>("Origin")?.unwrap_or([0.0; 3]);
        let spacing = data_set.numbers::<3>("Spacing")?.unwrap_or([1.0; 3]);
        let rows = data_set
            .numbers::<9>("Direction")?
            .unwrap_or(DMat3::IDENTITY.to_cols_array());
        let direction = DMat3::from_cols_array(&rows).transpose();
        let axes = direction * DMat3::from_diagonal(DVec3::from_array(spacing));
        Ok(Self {
            kind,
            whole,
            world_from_structured: DAffine3::from_mat3_translation(axes, DVec3::from_array(origin)),
            pieces: Vec::new(),
            notes: Vec::new(),
        })
    }

    /// A grid from a serial file with all its pieces.
    ///
    /// # Errors
    /// [`Problem::Malformed`] where the file breaks the rules.
    pub fn from_file(file: XmlFile, kind: GridKind) -> Result<Self, Problem> {
        let file = Arc::new(file);
        let mut grid = Self::new(kind, file.data_set()?)?;
        grid.add_pieces(&file)?;
        Ok(grid)
    }

    /// Adds the pieces of a serial file and returns the extent around them; `None` without any.
    ///
    /// # Errors
    /// [`Problem::Malformed`] where the file breaks the rules.
    pub fn add_pieces(&mut self, file: &Arc<XmlFile>) -> Result<Option<Extent>, Problem> {
        let mut around: Option<Extent> = None;
        for element in file.data_set()?.children_named("Piece") {
            let extent = parse_extent(element, "Extent")?;
            if extent.is_empty() {
                continue;
            }
            around = Some(around.map_or(extent, |a| a.union(&extent)));
            self.pieces.push(Piece {
                file: file.clone(),
                extent,
                point: PieceArrays::parse(element.child("PointData"), &mut self.notes)?,
                cell: PieceArrays::parse(element.child("CellData"), &mut self.notes)?,
                geometry: self.geometry_arrays(element)?,
            });
        }
        Ok(around)
    }

    fn geometry_arrays(&self, piece: &Element) -> Result<Vec<DataArrayElement>, Problem> {
        match self.kind {
            GridKind::Image => Ok(Vec::new()),
            GridKind::Curvilinear => Ok(vec![DataArrayElement::first_in(
                piece.required_child("Points")?,
            )?]),
            GridKind::Rectilinear => {
                let coordinates = piece.required_child("Coordinates")?;
                let arrays: Vec<_> = coordinates.children_named("DataArray").collect();
                if arrays.len() != 3 {
                    return Err(Problem::malformed(
                        coordinates.place(),
                        "3 coordinate arrays",
                        arrays.len().to_string(),
                    ));
                }
                arrays
                    .into_iter()
                    .map(DataArrayElement::parse_numbers)
                    .collect()
            }
        }
    }

    /// Loads geometry and ghost flags and describes the fields.
    ///
    /// # Errors
    /// [`Problem`] if pieces do not cover the grid, or what must be loaded cannot be.
    pub fn into_dataset(mut self) -> Result<Dataset, Problem> {
        let extents: Vec<Extent> = self.pieces.iter().map(|p| p.extent).collect();
        check_cover(&self.whole, &extents)?;
        let geometry = self.geometry()?;
        let fields = fields(self.whole, &self.pieces, &mut self.notes)?;
        let point_flags = ghost_flags(self.whole, &self.pieces, Association::Point)?;
        let cell_flags = ghost_flags(self.whole, &self.pieces, Association::Cell)?;
        let mask = ghost::blanked_cells(
            self.whole.points(),
            point_flags.as_ref(),
            cell_flags.as_ref(),
        )?;
        let mut dataset = Dataset::new(geometry, fields)?;
        if let Some(mask) = mask {
            dataset = dataset.with_blanked_cells(mask)?;
        }
        self.notes.sort();
        self.notes.dedup();
        Ok(self.notes.into_iter().fold(dataset, Dataset::with_note))
    }

    fn geometry(&self) -> Result<Geometry, Problem> {
        let points = self.whole.points();
        Ok(match self.kind {
            GridKind::Image => {
                let mut world_from_index = self.world_from_structured;
                let first = DVec3::from_array(self.whole.lo.map(|i| i as f64));
                world_from_index.translation = self.world_from_structured.transform_point3(first);
                Geometry::Uniform(UniformGrid::with_affine(points, world_from_index)?)
            }
            GridKind::Rectilinear => {
                let [x, y, z] = [0, 1, 2].map(|axis| self.coordinates(axis));
                Geometry::Rectilinear(RectilinearGrid::new(x?, y?, z?)?)
            }
            GridKind::Curvilinear => {
                let split =
                    SplitArray::gather(self.whole, Association::Point, &self.pieces, |piece| {
                        piece.geometry.first()
                    })?;
                let positions = split
                    .ok_or_else(|| Problem::malformed("the grid", "positions of points", "none"))?
                    .read()?;
                Geometry::Curvilinear(CurvilinearGrid::new(points, as_float(positions)?)?)
            }
        })
    }

    /// Coordinates of the planes along one axis, from all pieces.
    fn coordinates(&self, axis: usize) -> Result<Vec<f64>, Problem> {
        let mut parts = Vec::with_capacity(self.pieces.len());
        for piece in &self.pieces {
            let element = &piece.geometry[axis];
            let array = element.read(&piece.file, piece.extent.points()[axis])?;
            parts.push((piece.extent.lo[axis] - self.whole.lo[axis], array));
        }
        let mut coordinates = vec![0.0; self.whole.points()[axis]];
        for (first, array) in parts {
            let first = usize::try_from(first).unwrap_or(0);
            for (i, place) in coordinates[first..][..array.tuples()]
                .iter_mut()
                .enumerate()
            {
                *place = array.get_f64(i, 0);
            }
        }
        Ok(coordinates)
    }
}

/// An attribute that holds an extent.
pub(super) fn parse_extent(element: &Element, key: &str) -> Result<Extent, Problem> {
    let place = format!("attribute `{key}` of {}", element.place());
    Extent::parse(&place, element.required(key)?)
}

/// Positions of points as `f32` or `f64`; integers become `f64`.
pub(crate) fn as_float(positions: DataArray) -> Result<DataArray, Problem> {
    if matches!(positions.scalar_type(), ScalarType::F32 | ScalarType::F64) {
        return Ok(positions);
    }
    let components = positions.components();
    let numbers = (0..positions.tuples())
        .flat_map(|tuple| (0..components).map(move |c| (tuple, c)))
        .map(|(tuple, c)| positions.get_f64(tuple, c))
        .collect();
    Ok(DataArray::from_vec::<f64>(numbers, components)?)
}
