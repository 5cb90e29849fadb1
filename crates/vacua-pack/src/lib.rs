//! Paper B on the CPU: unstructured meshes, encoded small and sampled where they lie.
//!
//! Source: Wald, Morrical, Zellmann, *A Memory Efficient Encoding for Ray Tracing Large Unstructured
//! Data* ("paper B").
//!
//! [`encode()`] turns a [`vacua_volume::UnstructuredMesh`] into a [`PackedMesh`]: sub-meshes of at most
//! 2^N vertices, tetrahedra in pairs of five indices, leaves without item lists, nodes of eight
//! children with boxes quantised twice. Geometry is immutable; [`PackedField`]s bring values and
//! their ranges along, each on its own. [`file::encode_file`] encodes straight into a file, within a
//! memory budget if need be. [`Locator`] finds the cell at a position and the weights of
//! its corners, [`BlockSampler`] the values of a field at many positions at once; [`file`](mod@file) is the `.vacua` file, used where it is mapped.
//!
//! What the paper says, and where it is:
//!
//! | paper B | here |
//! |---|---|
//! | §4.1 indices by cell type, tet pairs | `pairs`, `submesh`, [`layout`] |
//! | §4.2 sub-meshes, Table 2 | `partition`, `indices` |
//! | §5.1 no item lists, 2/4/2-bit counters | [`layout::LeafCounts`] |
//! | §5.2, §5.5 eight children, bottom up; multi-leaves alone | `collapse` |
//! | §5.3 to §5.6 nodes, Figure 3 | [`layout`], [`Grid`] |
//! | §5.5 the tree over multi-leaves (OptiX there) | `outer` |
//! | §5.7 surface area heuristic, 2 : 1 | `bvh` |
//! | §5.8 value ranges; level of detail | `field`, [`detail`] |
//! | §6.2 encoding, out of core | `encode`, `spill`, [`file::encode_file`] |
//! | §3, §6.1, §6.3 what it is compared with | [`reference`](mod@reference) |
//!
//! ```
//! use vacua_pack::{EncodeOptions, PackedField, encode};
//! use vacua_volume::{Association, CellType, DataArray, UnstructuredMesh};
//!
//! let mesh = UnstructuredMesh::uniform(
//!     DataArray::from_vec(vec![0f32, 0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 1.], 3)?,
//!     CellType::Tetrahedron,
//!     DataArray::from_vec(vec![0u32, 1, 2, 3], 1)?,
//! )?;
//! let heights = DataArray::from_vec(vec![0f32, 0., 0., 1.], 1)?;
//! let encoded = encode(&mesh, EncodeOptions::default())?;
//! let field =
//!     PackedField::pack(&encoded.mesh, &encoded.map, "height", Association::Point, &heights)?;
//! let location = encoded.mesh.locator().locate([0.25, 0.25, 0.25]).ok_or("outside")?;
//! assert_eq!(field.value_at(&encoded.mesh, &location), Some(0.25));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]

pub mod block;
mod bvh;
mod collapse;
mod delta;
pub mod detail;
mod element;
mod encode;
mod exact;
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
mod pool;
pub mod reference;
mod section;
pub mod small;
mod spill;
mod submesh;
mod volume;

pub use block::{BlockSampler, Located, Order, Places, Sampled};
pub use detail::{DetailLevel, DetailSampler, Estimate, Estimates};
pub use element::{Weights, gradient_at, interpolate, weights_at, weights_at_f64};
pub use encode::{
    EncodeError, EncodeObserver, EncodeOptions, EncodeProgress, EncodeReport, EncodeStage, Encoded,
    PackMap, Variant, encode, encode_observed,
};
pub use exact::MeshLocator;
pub use field::{FieldBytes, PackFieldError, PackedField};
pub use grid::Grid;
pub use ids::Ids;
pub use indices::IndexList;
pub use locate::{LocateCounters, Location, Locator};
pub use outer::{OuterChild, OuterNode};
pub use packed::{Nodes, PackedBytes, PackedCell, PackedMesh, Submesh};
pub use section::Flat;
pub use submesh::LeafTotals;
pub use volume::{PackedVolume, PackedVolumeError};
