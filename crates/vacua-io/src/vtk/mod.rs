//! The file formats of the Visualization Toolkit (VTK): XML (`.vti .vtr .vts .vtu` and their
//! parallel `.pvti .pvtr .pvts .pvtu`, and lists of them, `.pvd .vtm`), legacy (`.vtk`) and VTKHDF (`.vtkhdf`).
//!
//! Sources: *VTK File Formats*, docs.vtk.org; where that page is silent, what VTK 9.7 writes and
//! reads. What is common to these families lives here: extents, number text (`ascii`), byte order
//! (`bytes`) and ghost flags (`ghost`).

mod ascii;
mod bytes;
mod extent;
mod ghost;
pub(crate) mod hdf;
pub(crate) mod legacy;
mod write;
pub(crate) mod xml;

pub use write::{WriteEncoding, WriteOptions, write_vti, write_vtr, write_vts, write_vtu};

pub(crate) use bytes::array_in_file;
pub(crate) use ghost::flags as ghost_flags;
pub(crate) use xml::as_float;

/// Name of an array that has none in its file.
const UNNAMED: &str = "scalars";

/// Name of the arrays that flag ghost and hidden points and cells.
const GHOST_ARRAY: &str = "vtkGhostType";
