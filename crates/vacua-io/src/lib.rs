//! Files in, files out. One module a format; the [registry](formats) picks by content, then by
//! extension.
//!
//! [`open`] reads headers and gives a [`Dataset`] whose fields load when first asked for. Large
//! uncompressed data is memory-mapped, never copied. Every reader treats its file as hostile:
//! sizes are checked before anything is allocated, and what is not understood is an [`IoError`]
//! that names the file, the place and what was expected.

mod atomic;
mod decode;
mod error;
mod exodus;
mod files;
mod hdf5;
mod mesh;
mod mesh_dump;
mod metaimage;
mod netcdf;
mod nifti;
mod npy;
mod nrrd;
mod payload;
pub mod picture;
mod raw;
mod registry;
mod save;
mod source;
mod tiff;
pub mod transfer_json;
mod units;
pub mod vtk;
mod xdmf;
mod zarr;

pub use atomic::{STANDARD_OUTPUT, is_same_file, is_standard_output, is_stream, write_atomically};
pub use error::{IoError, Problem};
pub use registry::{Format, ReadOptions, formats, open, open_source, open_with};
pub use save::{Saved, WriteOptions, save};
pub use source::Source;
pub use tiff::open_stack;

pub use vacua_volume::Dataset;
