//! Empty-space skipping for any volume that can say its value range in a box (paper A).
//!
//! The stages, each a value built from the one before: [`Macrocells`] (value ranges, once a
//! volume) → [`ActiveMask`] (once a transfer function) → a [`Skipper`], which tells a ray which
//! of its blocks of samples may contain anything: [`NoSkip`], [`GridSkip`] (a walk over the mask),
//! [`BoxSkip`] (clustered proxy boxes, Ganter and Manzke) or [`MeshSkip`] (the triangulated
//! boundary of the active region, paper A).
//!
//! # Exactness
//! Rays live in *ray space*, where macrocells are boxes between axis-aligned planes. Sample `k` of
//! a ray lies at `fma(k, step, start)` in `f32`, a monotone function of `k` on each axis: that
//! computed position, and no ideal one, decides which cell a sample is in, for the renderer and
//! for every skipper alike. A skipper therefore never has to guess about rounding: what it reports
//! as empty contains no computed sample position in an active macrocell.

mod boundary;
mod boxes;
mod bundle;
mod bvh;
mod grid;
mod lattice;
mod macrocells;
mod mask;
mod mesh;
mod near;
mod ray;
mod rectangles;

pub use boundary::{BoundaryMesh, Quad, boundary_triangle_bound};
pub use boxes::{BoxSkip, cluster_boxes};
pub use bundle::Bundle;
pub use grid::GridSkip;
pub use lattice::{Axis, Lattice, LatticeError, MAX_CELLS_PER_AXIS, locate_units};
pub use macrocells::{Macrocells, PointSource};
pub use mask::{ActiveMask, Activity};
pub use mesh::{BoundaryHit, MeshSkip};
pub use ray::{BLOCKS_PER_WINDOW, MAX_SAMPLES, NoSkip, SampleRanges, SampleRay, Skipper};
