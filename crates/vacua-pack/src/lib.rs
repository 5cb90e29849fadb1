//! Paper B on the CPU.
#![forbid(unsafe_code)]

pub mod bvh;
pub mod collapse;
pub mod grid;
pub mod ids;
pub mod input;
pub mod layout;
pub mod pairs;
pub mod partition;
pub use grid::Grid;
