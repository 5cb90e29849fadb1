//! From the cells of a file to an [`UnstructuredMesh`](vacua_volume::UnstructuredMesh): what every
//! mesh format shares.
//!
//! A format names each cell by VTK's number for it ([`kind`]). Tetrahedra, pyramids, wedges and
//! hexahedra stay as they are, mapped where possible; voxels are renumbered; prisms, convex point
//! sets and polyhedra are [decomposed](decompose) into them; curved cells keep their corners; cells
//! below three dimensions are counted and left out ([`assemble`](mod@assemble)). Where mesh and file have
//! different cells, a list says which cell of the file each one of the mesh comes from, and values
//! on cells follow it when they are loaded ([`parts`]).

pub(crate) mod assemble;
mod decompose;
pub(crate) mod kind;
mod listed;
pub(crate) mod parts;

pub(crate) use assemble::{Ends, Faces, SourceCells, assemble, faces_of_stream, index_at, widened};
pub(crate) use listed::{ListedFaces, cell_types, numbers_of};
pub(crate) use parts::{Part, PartField, join, join_full};
