//! Seeds, and fixed mutations of them, through every target: fuzzing for machines without fuzzers.

use std::path::{Path, PathBuf};

use vacua_fuzz::{TARGETS, read};

/// Mutations of each seed.
const NUM_MUTATIONS: u64 = 200;

/// Seeds larger than this are left to real fuzzing.
const LARGEST_SEED_BYTES: usize = 1 << 16;

/// The folder of this crate.
fn here() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Files to start from: this crate's own, and those that the readers' tests use.
fn seeds(name: &str, file: &str) -> Vec<Vec<u8>> {
    let here = here();
    let extension = file.split_once('.').map_or("", |(_, extension)| extension);
    let mut paths = Vec::new();
    files(&here.join("seeds").join(name), &mut paths);
    let own = paths.len();
    files(&here.join("../crates/vacua-io/tests/data"), &mut paths);
    let fits = |(i, path): (usize, &PathBuf)| {
        i < own || path.to_string_lossy().ends_with(&format!(".{extension}"))
    };
    let mut found: Vec<Vec<u8>> = paths
        .iter()
        .enumerate()
        .filter(|&(i, path)| fits((i, path)))
        .filter_map(|(_, path)| std::fs::read(path).ok())
        .filter(|bytes| bytes.len() <= LARGEST_SEED_BYTES)
        .collect();
    found.push(Vec::new());
    found
}

fn files(folder: &Path, into: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> = std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path())
        .collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            files(&path, into);
        } else {
            into.push(path);
        }
    }
}

/// A small generator (SplitMix64); every run mutates the same way.
fn next(state: &mut u64) -> usize {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mut z = *state;
    z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    (z ^ z >> 31) as usize
}

/// Flips, overwrites, cuts, repeats and enlarges numbers in a seed.
fn mutate(bytes: &mut Vec<u8>, random: &mut u64) {
    for _ in 0..=next(random) % 4 {
        if bytes.is_empty() {
            bytes.push(next(random) as u8);
            continue;
        }
        // Headers matter most: half of all places are near the start.
        let reach = if next(random).is_multiple_of(2) {
            bytes.len().min(512)
        } else {
            bytes.len()
        };
        let at = next(random) % reach;
        match next(random) % 6 {
            0 => bytes[at] ^= 1 << (next(random) % 8),
            1 => bytes[at] = next(random) as u8,
            2 => bytes.truncate(at),
            3 => {
                let end = (at + next(random) % 64).min(bytes.len());
                let piece = bytes[at..end].to_vec();
                bytes.splice(at..at, piece);
            }
            4 => {
                let end = (at + 8).min(bytes.len());
                bytes[at..end].fill([0x00, 0xFF, 0x7F, b'9'][next(random) % 4]);
            }
            _ => drop(bytes.remove(at)),
        }
    }
}

#[test]
fn seeds_and_mutations_are_survived() {
    for target in &TARGETS {
        for (index, seed) in seeds(target.name, target.file).into_iter().enumerate() {
            read(target.name, &seed);
            let mut random = index as u64;
            for _ in 0..NUM_MUTATIONS {
                let mut bytes = seed.clone();
                mutate(&mut bytes, &mut random);
                read(target.name, &bytes);
            }
        }
    }
}

#[test]
fn own_seeds_are_good_files() {
    for target in &TARGETS {
        let mut paths = Vec::new();
        files(&here().join("seeds").join(target.name), &mut paths);
        assert!(!paths.is_empty(), "no seed for `{}`", target.name);
        for path in paths {
            let bytes = std::fs::read(&path).expect("readable");
            let num_loaded = read(target.name, &bytes);
            assert!(num_loaded >= Some(1), "{}: {num_loaded:?}", path.display());
        }
    }
}
