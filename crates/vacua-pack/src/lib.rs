//! Paper B on the CPU: unstructured meshes, encoded small and sampled where they lie.
#![forbid(unsafe_code)]

mod bvh;
mod collapse;
mod element;
mod encode;
mod field;
pub mod file;
mod grid;
mod ids;
mod indices;
mod input;
pub mod layout;
mod locate;
mod outer;
mod packed;
mod pairs;
mod partition;
mod section;
mod submesh;

pub use element::{Weights, interpolate, weights_at};
pub use encode::{EncodeError, EncodeOptions, EncodeReport, Encoded, PackMap, Variant, encode};
pub use field::{FieldBytes, PackFieldError, PackedField};
pub use grid::Grid;
pub use ids::Ids;
pub use indices::IndexList;
pub use locate::{LocateCounters, Location, Locator};
pub use outer::{OuterChild, OuterNode};
pub use packed::{Nodes, PackedBytes, PackedCell, PackedMesh, Submesh};
pub use section::Flat;
pub use submesh::LeafTotals;
