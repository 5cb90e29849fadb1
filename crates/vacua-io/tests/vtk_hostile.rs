//! Files of grids and meshes with bytes changed, cut off, spliced, and numbers replaced by absurd ones: every one is
//! read with all its fields, or refused with a clear error, without a large allocation.

mod hostile;

use std::path::{Path, PathBuf};

use hostile::{Random, largest_request_bytes, mutate, read_all};
use vacua_io::{Format, formats};

/// No seed is larger than 32 KiB, and zlib gives at most 1032 times its size.
const MAX_REQUEST_BYTES: usize = 34 << 20;

const MUTANTS_A_FILE: usize = 60;

/// However few files of a format there are.
const MUTANTS_A_FORMAT: usize = 240;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/vtk")
}

fn seeds() -> Vec<(PathBuf, Vec<u8>)> {
    let mut seeds: Vec<_> = [folder(), folder().with_file_name("mesh")]
        .iter()
        .flat_map(|folder| std::fs::read_dir(folder).expect("committed"))
        .map(|entry| entry.expect("listable").path())
        .filter(|path| path.extension().is_some_and(|e| e != "txt"))
        .map(|path| (path.clone(), std::fs::read(path).expect("readable")))
        .collect();
    seeds.sort();
    seeds
}

fn format_of(path: &Path) -> &'static Format {
    let extension = path.extension().expect("has one").to_string_lossy();
    formats()
        .iter()
        .find(|f| f.extensions.contains(&&*extension))
        .expect("registered")
}

#[test]
fn mutants_are_read_or_refused() {
    let seeds = seeds();
    let mut random = Random(0x5EED_0001);
    let (mut num_read, mut num_refused) = (0, 0);
    for (path, bytes) in &seeds {
        assert!(bytes.len() <= 32 << 10, "{}", path.display());
        let same = |(other, _): &&(PathBuf, Vec<u8>)| other.extension() == path.extension();
        let files = seeds.iter().filter(same).count();
        for _ in 0..MUTANTS_A_FILE.max(MUTANTS_A_FORMAT.div_ceil(files)) {
            let other = &seeds[random.below(seeds.len())].1;
            let mutant = mutate(bytes, other, &mut random);
            if read_all(format_of(path), path, mutant) {
                num_read += 1;
            } else {
                num_refused += 1;
            }
        }
    }
    let largest = largest_request_bytes();
    assert!(largest < MAX_REQUEST_BYTES, "a request for {largest} bytes");
    assert!(num_refused > 1000, "{num_refused} refused, {num_read} read");
    assert!(num_read > 100, "{num_refused} refused, {num_read} read");
}

#[test]
fn every_truncation_is_refused_or_harmless() {
    for name in [
        "raw_zlib_64_little.vti",
        "inline_none_32_little.vts",
        "legacy_vtr_binary_51.vtk",
        "../mesh/mixed_raw_zlib_64_little.vtu",
        "../mesh/zoo_51.vtk",
        "../mesh/mixed_binary_42.vtk",
        "../mesh/blocks.ex2",
    ] {
        let path = folder().join(name);
        let bytes = std::fs::read(&path).expect("committed");
        for len in 0..bytes.len() {
            read_all(format_of(&path), &path, bytes[..len].to_vec());
        }
        assert!(read_all(format_of(&path), &path, bytes));
    }
}
