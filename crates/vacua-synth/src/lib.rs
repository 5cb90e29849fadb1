//! Procedural volumes and meshes of any size with known answers.
//!
//! What the demo, the tests and the benchmarks feed on: linear fields that every interpolation
//! must reproduce ([`LinearField`] is the answer), a constant box for Beer–Lambert, the benchmark
//! scenes of the project ([`BenchScene`], [`meshes`]), meshes like those of paper B ([`MeshKind`]),
//! and stand-ins for the data sets of paper A
//! (Wald, Zellmann and Morrical 2021, Table 1). Everything is deterministic: the same [`Spec`]
//! gives the same bytes on every machine and number of threads.
#![forbid(unsafe_code)]

mod bench_scene;
mod delaunay;
mod fill;
mod kind;
mod linear;
mod mesh_cells;
mod mesh_kind;
mod mesh_shapes;
pub mod meshes;
mod noise;
mod numpy;
mod octree;
mod shells;
mod standin;

pub use bench_scene::{BenchCamera, BenchScene};
pub use fill::unit_scale;
pub use kind::{Kind, Spec, SynthError, UnknownKind, generate, parse_size};
pub use linear::LinearField;
pub use mesh_kind::{MeshKind, MeshSpec, MeshValues, UnknownMeshKind, generate_mesh, linear_value};
