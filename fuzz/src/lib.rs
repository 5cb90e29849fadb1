//! Hostile bytes for every reader: one target a format, all with the same body.
//!
//! Real fuzzing runs [`read`] under cargo-fuzz (`cargo xtask fuzz`); the test of this crate replays
//! seeds and fixed mutations of them on any machine (part of `cargo xtask test`).
#![forbid(unsafe_code)]

use std::path::Path;

use vacua_io::{Format, ReadOptions, Source, formats};

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
pub const TARGETS: [Target; 16] = [
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
    target("raw", "fuzz_4x3x5_uint16.raw"),
];

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
    let format = format_of(target).unwrap_or_else(|| panic!("no reader for {}", target.file));
    let source = Source::from_bytes(Path::new(target.file), bytes.to_vec());
    let dataset = (format.read)(&source, &ReadOptions::default()).ok()?;
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
    Some(num_loaded)
}
