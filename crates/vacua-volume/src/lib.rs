//! What vacua renders, and nothing about how: grids, fields in their native type, transfer
//! functions and value ranges. No input or output, no rendering.
//!
//! A [`Dataset`] is what a file holds: a [`Geometry`] and any number of [`Field`]s. Choosing one
//! scalar field makes a [`Volume`], which renderers take. A [`TransferFunction`] says what its
//! values look like; compiled to a [`TransferTable`], it is what both sampling and empty-space
//! classification evaluate.
#![forbid(unsafe_code)]

mod array;
mod color_space;
mod dataset;
mod field;
mod frame;
mod grid;
mod lattice_mesh;
mod mesh;
pub mod presets;
mod range;
mod scalar;
mod style;
mod transfer;

pub use array::{ArrayError, ByteStore, DataArray, ValueProfile};
pub use color_space::{ColorSpace, srgb_from_linear};
pub use dataset::{CellMask, ComponentChoice, Dataset, DatasetError, FieldChoice, Volume};
pub use field::{Association, Field, FieldError, LoadError};
pub use frame::WorldFrame;
pub use grid::{Bounds, CurvilinearGrid, Geometry, GridError, RectilinearGrid, UniformGrid};
pub use mesh::{Cell, CellType, Indices, LeftOut, MAX_CELL_POINTS, MeshError, UnstructuredMesh};
pub use range::{ValueMap, ValueRange};
pub use scalar::{Scalar, ScalarType, UnknownScalarType};
pub use style::{
    DEFAULT_RAMP_OPACITY, OpacityStyle, PERCENTILE_SAMPLES, StyleError, TransferStyle,
    default_transfer_function, default_unit_length, percentile_range,
};
pub use transfer::{
    ColorPoint, OpacityPoint, TRANSFER_BINS, TransferFunction, TransferFunctionError,
    TransferTable, ValueScale, linear_from_srgb,
};
