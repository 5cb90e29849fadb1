//! Hostile bytes for every reader: one target a format, all with the same body.
//!
//! Real fuzzing runs [`read`] under cargo-fuzz (`cargo xtask fuzz`); the test of this crate replays
//! seeds and fixed mutations of them on any machine (part of `cargo xtask test`).
#![forbid(unsafe_code)]

use std::path::Path;

use vacua_io::{Dataset, Format, ReadOptions, Source, formats};
use vacua_pack::file::PackedFile;

/// A fuzz target: its name and the file name under which it presents its bytes.
pub struct Target {
    /// Name of the target, and of its folder of seeds.
    pub name: &'static str,
    /// Name of the file that the bytes pretend to be.
    pub file: &'static str,
}

const fn target(name: &'static str, file: &'static str) -> Target {
    Target { name, file }
}

/// All targets. Formats that need a second file (`.nhdr`, `.mhd`, `.pvt*`) share the parsers of
/// those that do not.
pub const TARGETS: [Target; 19] = [
    target("vti", "fuzz.vti"),
    target("vtr", "fuzz.vtr"),
    target("vts", "fuzz.vts"),
    target("vtk", "fuzz.vtk"),
    target("vtu", "fuzz.vtu"),
    target("vtk_mesh", "fuzz.vtk"),
    target("exodus", "fuzz.ex2"),
    target("vtkhdf", "fuzz.vtkhdf"),
    target("xdmf", "fuzz.xdmf"),
    target("vmesh", "fuzz.vmesh"),
    target("nrrd", "fuzz.nrrd"),
    target("mha", "fuzz.mha"),
    target("nii", "fuzz.nii"),
    target("nii_gz", "fuzz.nii.gz"),
    target("npy", "fuzz.npy"),
    target("tiff", "fuzz.tif"),
    target("raw", "fuzz_4x3x5_uint16.raw"),
    target(PACKED, "fuzz.vacua"),
    target(ZARR, "fuzz.zarr"),
];

/// The target of encoded meshes, which have a reader of their own.
const PACKED: &str = "vacua";

/// The target of Zarr arrays, which are folders: metadata, a line of [`BETWEEN`], and the first chunk.
const ZARR: &str = "zarr";

/// What parts metadata from a chunk.
const BETWEEN: &[u8] = b"\n----\n";

/// The format that reads a target's files, by extension.
pub fn format_of(target: &Target) -> Option<&'static Format> {
    formats().iter().find(|format| {
        let is_of_file = |e: &&str| target.file.ends_with(&format!(".{e}"));
        format.extensions.iter().any(is_of_file)
    })
}

/// Reads bytes as the format of a target and loads every field; any outcome but a panic is fine.
/// Returns the number of fields that could be loaded, or `None` if the file was refused.
///
/// # Panics
/// If there is no such target, no reader for it, or the reader has a bug.
pub fn read(name: &str, bytes: &[u8]) -> Option<usize> {
    let target = TARGETS
        .iter()
        .find(|target| target.name == name)
        .unwrap_or_else(|| panic!("no fuzz target `{name}`"));
    if name == PACKED {
        return read_packed(target.file, bytes);
    }
    if name == ZARR {
        return read_zarr(bytes);
    }
    let format = format_of(target).unwrap_or_else(|| panic!("no reader for {}", target.file));
    let source = Source::from_bytes(Path::new(target.file), bytes.to_vec());
    let dataset = (format.read)(&source, &ReadOptions::default()).ok()?;
    Some(load(&dataset))
}

/// Loads all fields; how many could be.
fn load(dataset: &Dataset) -> usize {
    let bounds = dataset.geometry().bounds();
    assert!(!bounds.lo.is_nan() && !bounds.hi.is_nan());
    let mut num_loaded = 0;
    for field in dataset.fields() {
        if let Ok(values) = field.load() {
            num_loaded += 1;
            for component in 0..values.components() {
                let _range = values.range(component);
            }
        }
    }
    num_loaded
}

/// Makes a folder of metadata and a chunk, under all names that it may have, and reads it.
fn read_zarr(bytes: &[u8]) -> Option<usize> {
    /// Numbers of arrays that are loaded: those of which most is not stored may have any.
    const MOST_LOADED: usize = 1 << 20;
    let at = bytes
        .windows(BETWEEN.len())
        .position(|piece| piece == BETWEEN)?;
    let (metadata, chunk) = (&bytes[..at], &bytes[at + BETWEEN.len()..]);
    let folder = tempfile::tempdir().expect("temporary folder");
    let deep = folder.path().join("c/0/0");
    std::fs::create_dir_all(&deep).expect("writable");
    let is_of_version_2 = metadata.windows(8).any(|piece| piece == b"\"chunks\"");
    let name = if is_of_version_2 {
        ".zarray"
    } else {
        "zarr.json"
    };
    for (path, bytes) in [
        (folder.path().join(name), metadata),
        (folder.path().join("0.0.0"), chunk),
        (folder.path().join("c.0.0.0"), chunk),
        (deep.join("0"), chunk),
    ] {
        std::fs::write(path, bytes).expect("writable");
    }
    let dataset = vacua_io::open(folder.path()).ok()?;
    let is_small = dataset
        .fields()
        .iter()
        .all(|field| field.tuples() <= MOST_LOADED);
    Some(if is_small { load(&dataset) } else { 0 })
}

/// Reads an encoded mesh with all that is in it, as it is and then with right checksums: without, few
/// mutations come past them.
fn read_packed(name: &str, bytes: &[u8]) -> Option<usize> {
    let plain = read_packed_once(name, bytes.to_vec());
    let mut sealed = bytes.to_vec();
    vacua_pack::file::seal(&mut sealed);
    plain.or(read_packed_once(name, sealed))
}

fn read_packed_once(name: &str, bytes: Vec<u8>) -> Option<usize> {
    let source = Source::from_bytes(Path::new(name), bytes);
    let file = PackedFile::from_source(source).ok()?;
    let _summary = file.summary();
    let mesh = file.mesh().ok()?;
    let num_fields = file.fields().ok()?.len();
    let mut fields = Vec::new();
    fields.extend((0..num_fields).filter_map(|f| file.field(&mesh, f).ok()));
    let _map = file.map(&mesh);
    let mut locator = mesh.locator();
    if let Some(bounds) = mesh.bounds() {
        for i in 0..40u32 {
            let along = |k: u32| f64::from(i * k % 41) / 40.0;
            let at = bounds.lo
                + (bounds.hi - bounds.lo) * glam::DVec3::new(along(1), along(7), along(17));
            if let Some(location) = locator.locate(at.to_array()) {
                for field in &fields {
                    let _value = field.value_at(&mesh, &location);
                }
            }
        }
    }
    Some(fields.len())
}
