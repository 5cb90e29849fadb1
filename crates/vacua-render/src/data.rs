//! What a scene shows: one scalar field, on a grid or mesh as it came, or on an encoded mesh.

use std::borrow::Cow;
use std::sync::Arc;

use glam::DVec3;
use vacua_pack::PackedVolume;
use vacua_volume::{
    Association, Bounds, CellMask, DataArray, Geometry, PERCENTILE_SAMPLES, ValueProfile, Volume,
};

/// The longest default distance between samples, in cells.
const MOST_STEP: f64 = 0.5;
/// Samples along the longest side at least, by default.
const SAMPLES_ALONG: f64 = 200.0;
/// Cells that a cube is cut into, by [`vacua_volume::CellType`]'s number.
const CELLS_IN_CUBE: [f64; 4] = [6.0, 3.0, 2.0, 1.0];

/// The most cells along an axis of a grid.
fn longest(points: [usize; 3]) -> f64 {
    points.into_iter().max().unwrap_or(1).max(2) as f64 - 1.0
}

/// Cells along the longest side of a box of so many cells of each type, were all alike.
fn cells_along(size: DVec3, counts: [u64; 4]) -> f64 {
    let cubes: f64 = (0..4).map(|t| counts[t] as f64 / CELLS_IN_CUBE[t]).sum();
    let cubes = cubes.max(1.0);
    let longest = size.max_element();
    let shortest = size.min_element();
    let middle = size.element_sum() - longest - shortest;
    // A solid, a sheet one cell thick, a row: where a side is nothing the next of these tells.
    let cell = (longest * middle * shortest / cubes)
        .cbrt()
        .max((longest * middle / cubes).sqrt())
        .max(longest / cubes);
    if cell > 0.0 { longest / cell } else { 1.0 }
}

/// What a scene shows. Clones share the data.
#[derive(Clone, Debug)]
pub enum SceneData {
    /// A field on a grid, or on a mesh that renderers encode for themselves.
    Volume(Arc<Volume>),
    /// A field on a mesh that is encoded already.
    Packed(Arc<PackedVolume>),
}

impl SceneData {
    /// Name of the field.
    pub fn name(&self) -> &str {
        match self {
            Self::Volume(volume) => volume.name(),
            Self::Packed(packed) => packed.field().name(),
        }
    }

    /// Whether values are those of points or of cells.
    pub fn association(&self) -> Association {
        match self {
            Self::Volume(volume) => volume.association(),
            Self::Packed(packed) => packed.field().association(),
        }
    }

    /// The values, of one component; those of an encoded mesh in its own order, or none if they are
    /// [in frames](vacua_pack::PackedField::framed).
    pub fn scalars(&self) -> &DataArray {
        match self {
            Self::Volume(volume) => volume.scalars(),
            Self::Packed(packed) => packed.field().values(),
        }
    }

    /// What is known of all values together.
    pub fn profile(&self) -> ValueProfile {
        match self {
            Self::Volume(volume) => volume.scalars().profile(0),
            Self::Packed(packed) => packed.field().profile(packed.mesh()),
        }
    }

    /// The values, or enough of them to find percentiles: see [`PackedField::some_values`].
    ///
    /// [`PackedField::some_values`]: vacua_pack::PackedField::some_values
    pub fn typical_scalars(&self) -> Cow<'_, DataArray> {
        match self {
            Self::Volume(volume) => Cow::Borrowed(volume.scalars()),
            Self::Packed(packed) => packed
                .field()
                .some_values(packed.mesh(), PERCENTILE_SAMPLES),
        }
    }

    /// Number of cells, blanked ones too.
    pub fn num_cells(&self) -> u64 {
        match self {
            Self::Volume(volume) => volume.geometry().num_cells() as u64,
            Self::Packed(packed) => packed.mesh().num_cells(),
        }
    }

    /// Bytes of the values, as they lie in memory.
    pub fn value_bytes(&self) -> usize {
        match self {
            Self::Volume(volume) => volume.scalars().bytes().len(),
            Self::Packed(packed) => packed.field().bytes().values,
        }
    }

    /// The box around everything, world space.
    pub fn bounds(&self) -> Bounds {
        match self {
            Self::Volume(volume) => volume.geometry().bounds(),
            Self::Packed(packed) => packed.bounds(),
        }
    }

    /// Where the points are; `None` for an encoded mesh.
    pub fn geometry(&self) -> Option<&Geometry> {
        match self {
            Self::Volume(volume) => Some(volume.geometry()),
            Self::Packed(_) => None,
        }
    }

    /// Which cells are not there; those of an encoded mesh were left out when it was encoded.
    pub fn blanked_cells(&self) -> Option<&CellMask> {
        match self {
            Self::Volume(volume) => volume.blanked_cells().map(|mask| &**mask),
            Self::Packed(_) => None,
        }
    }

    /// A distance between samples, in cells, at which no picture of this data shows its samples as
    /// bands: half a cell, or less where there are so few cells that half of one is more than half of
    /// the length that opacity holds over by default, a hundredth of the longest side.
    pub fn default_step(&self) -> f64 {
        let size = self.bounds().size();
        let cells_along = match self {
            Self::Volume(volume) => match &**volume.geometry() {
                Geometry::Uniform(grid) => longest(grid.points()),
                Geometry::Rectilinear(grid) => longest(grid.points()),
                Geometry::Curvilinear(grid) => longest(grid.points()),
                Geometry::Unstructured(mesh) => {
                    cells_along(size, mesh.num_cells_by_type().map(|n| n as u64))
                }
            },
            Self::Packed(packed) => {
                let headers = packed.mesh().submeshes().iter();
                let counts = headers.fold([0; 4], |sum: [u64; 4], header| {
                    [0, 1, 2, 3].map(|t| sum[t] + u64::from(header.num_cells[t]))
                });
                cells_along(size, counts)
            }
        };
        (cells_along / SAMPLES_ALONG).min(MOST_STEP)
    }

    /// Whether both are the same data, at the same place in memory.
    pub fn is(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Volume(a), Self::Volume(b)) => Arc::ptr_eq(a, b),
            (Self::Packed(a), Self::Packed(b)) => Arc::ptr_eq(a, b),
            _ => false,
        }
    }
}

impl From<Volume> for SceneData {
    fn from(volume: Volume) -> Self {
        Self::Volume(Arc::new(volume))
    }
}

impl From<Arc<Volume>> for SceneData {
    fn from(volume: Arc<Volume>) -> Self {
        Self::Volume(volume)
    }
}

impl From<PackedVolume> for SceneData {
    fn from(packed: PackedVolume) -> Self {
        Self::Packed(Arc::new(packed))
    }
}

impl From<Arc<PackedVolume>> for SceneData {
    fn from(packed: Arc<PackedVolume>) -> Self {
        Self::Packed(packed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_cells_are_sampled_more_often() {
        let unit = DVec3::ONE;
        // One hexahedron; a hundred cubes of six tetrahedra each a side; a sheet one cell thick.
        assert_eq!(cells_along(unit, [0, 0, 0, 1]), 1.0);
        let fine = cells_along(unit, [6_000_000, 0, 0, 0]);
        assert!((fine - 100.0).abs() < 1e-9, "{fine}");
        let sheet = cells_along(DVec3::new(1.0, 1.0, 0.0), [0, 0, 0, 400]);
        assert!((sheet - 20.0).abs() < 1e-9, "{sheet}");
        let row = cells_along(DVec3::X, [0, 0, 0, 7]);
        assert!((row - 7.0).abs() < 1e-9, "{row}");
        assert_eq!(cells_along(unit, [0; 4]), 1.0);
        assert_eq!(cells_along(DVec3::ZERO, [1, 0, 0, 0]), 1.0);
    }
}
