//! The tables of the papers and the figures of the project, regenerated on this machine.
//!
//! [`skip::run`] measures Tables 1 to 4 of paper A (Wald, Zellmann and Morrical 2021) over
//! stand-ins for its volumes; [`render::run`] measures the benchmark scene `shells256`, [`auto::run`]
//! whether `--skip auto` chooses well, [`gpu::run`] skipping on a GPU. [`encode::run`] and
//! [`sample::run`] measure Tables 1 to 6 of paper B (Wald, Morrical and Zellmann 2022) over stand-ins
//! for its meshes. Results are plain data that serialises to JSON; every figure in a printed table is
//! in there, and a cell without a figure says why.
#![forbid(unsafe_code)]

pub mod auto;
mod cell;
pub mod command;
pub mod encode;
mod error;
pub mod gpu;
pub mod gpu_group;
pub mod gpu_mesh;
pub mod gpu_reference;
pub mod gpu_structures;
mod machine;
pub mod meshes;
pub mod paper;
pub mod paper_b;
pub mod render;
pub mod sample;
pub mod skip;
mod timing;
mod volumes;

pub use cell::Cell;
pub use error::BenchError;
pub use machine::Machine;
