//! What a scene shows: one scalar field, on a grid or mesh as it came, or on an encoded mesh.

use std::sync::Arc;

use vacua_pack::PackedVolume;
use vacua_volume::{Association, Bounds, CellMask, DataArray, Geometry, Volume};

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

    /// The values, of one component; those of an encoded mesh in its own order.
    pub fn scalars(&self) -> &DataArray {
        match self {
            Self::Volume(volume) => volume.scalars(),
            Self::Packed(packed) => packed.field().values(),
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
