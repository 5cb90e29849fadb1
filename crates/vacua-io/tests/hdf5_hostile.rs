//! HDF5 files (VTKHDF and Exodus II) and XDMF files with their heavy data, changed as hostile hands
//! would: read with all their fields, or refused with a clear error, without a large allocation.

mod hostile;

use std::path::{Path, PathBuf};

use hostile::{Random, largest_request_bytes, mutate, read_all};
use vacua_io::{Format, formats};

/// Deflate gives at most 1032 times what it takes; no seed is larger than this.
const MAX_SEED_BYTES: usize = 80 << 10;
const MAX_REQUEST_BYTES: usize = MAX_SEED_BYTES * 1040;

const MUTANTS_A_FILE: usize = 60;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data")
}

fn files(folder: &Path, extensions: &[&str]) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found: Vec<_> = std::fs::read_dir(folder)
        .expect("committed")
        .map(|entry| entry.expect("listable").path())
        .filter(|path| {
            let extension = path.extension().unwrap_or_default().to_string_lossy();
            extensions.contains(&&*extension)
        })
        .map(|path| (path.clone(), std::fs::read(path).expect("readable")))
        .filter(|(_, bytes)| bytes.len() <= MAX_SEED_BYTES)
        .collect();
    found.sort();
    found
}

fn format(name: &str) -> &'static Format {
    formats()
        .iter()
        .find(|f| f.name == name)
        .expect("registered")
}

fn check_mutants(format: &Format, seeds: &[(PathBuf, Vec<u8>)], seed: u64) -> [usize; 2] {
    let mut random = Random(seed);
    let mut counts = [0; 2];
    for (path, bytes) in seeds {
        for _ in 0..MUTANTS_A_FILE {
            let other = &seeds[random.below(seeds.len())].1;
            let mutant = mutate(bytes, other, &mut random);
            counts[usize::from(read_all(format, path, mutant))] += 1;
        }
    }
    let largest = largest_request_bytes();
    assert!(largest < MAX_REQUEST_BYTES, "a request for {largest} bytes");
    counts
}

#[test]
fn mutants_of_hdf5_are_read_or_refused() {
    let seeds = files(&folder().join("hdf"), &["vtkhdf", "g"]);
    assert!(seeds.len() >= 20, "{}", seeds.len());
    let [refused, read] = check_mutants(format("VTKHDF"), &seeds, 0x5EED_0005);
    assert!(
        refused > 300 && read > 100,
        "{refused} refused, {read} read"
    );
}

#[test]
fn mutants_of_xdmf_are_read_or_refused() {
    let seeds = files(&folder().join("xdmf"), &["xmf", "xdmf"]);
    assert!(seeds.len() >= 12, "{}", seeds.len());
    let [refused, read] = check_mutants(format("XDMF"), &seeds, 0x5EED_0006);
    assert!(refused > 300 && read > 20, "{refused} refused, {read} read");
}

/// The files that an XDMF file names, in a folder of their own, one of them changed.
#[test]
fn mutants_of_heavy_data_are_read_or_refused() {
    let mut random = Random(0x5EED_0007);
    for (light, heavy) in [
        ("mixed.xmf", "mixed.h5"),
        ("meshio_hdf.xdmf", "meshio_hdf.h5"),
        ("slabs.xdmf", "slabs.h5"),
        ("hand.xmf", "hand.bin"),
    ] {
        let here = folder().join("xdmf");
        let text = std::fs::read(here.join(light)).expect("committed");
        let bytes = std::fs::read(here.join(heavy)).expect("committed");
        for _ in 0..MUTANTS_A_FILE {
            // A new folder each time: the file before is still mapped.
            let there = tempfile::tempdir().expect("a folder");
            let mutant = mutate(&bytes, &bytes, &mut random);
            std::fs::write(there.path().join(heavy), mutant).expect("writable");
            read_all(format("XDMF"), &there.path().join(light), text.clone());
        }
    }
}

#[test]
fn every_truncation_is_refused_or_harmless() {
    for name in ["mixed_flat.vtkhdf", "mixed_shuffle.vtkhdf", "image.vtkhdf"] {
        let path = folder().join("hdf").join(name);
        let bytes = std::fs::read(&path).expect("committed");
        for len in (0..bytes.len()).step_by(7) {
            read_all(format("VTKHDF"), &path, bytes[..len].to_vec());
        }
        assert!(read_all(format("VTKHDF"), &path, bytes));
    }
}
