//! Paper B on the CPU: unstructured meshes, encoded small and sampled where they lie.
#![forbid(unsafe_code)]

mod bvh;
mod collapse;
mod encode;
mod grid;
mod ids;
mod indices;
mod input;
pub mod layout;
mod outer;
mod packed;
mod pairs;
mod partition;
mod section;
mod submesh;

pub use encode::{EncodeError, EncodeOptions, EncodeReport, Encoded, PackMap, Variant, encode};
pub use grid::Grid;
pub use ids::Ids;
pub use indices::IndexList;
pub use outer::{OuterChild, OuterNode};
pub use packed::{Nodes, PackedBytes, PackedCell, PackedMesh, Submesh};
pub use section::Flat;
pub use submesh::LeafTotals;
