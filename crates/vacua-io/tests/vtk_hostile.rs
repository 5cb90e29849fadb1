//! Files of grids and meshes with bytes changed, cut off, spliced, and numbers replaced by absurd ones: every one is
//! read with all its fields, or refused with a clear error, without a large allocation.

use std::alloc::{GlobalAlloc, Layout, System};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use vacua_io::{Format, ReadOptions, Source, formats};

/// The system's allocator, with a note of the largest request.
struct Recording;

static LARGEST_BYTES: AtomicUsize = AtomicUsize::new(0);

// SAFETY: hands every call on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Recording {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        LARGEST_BYTES.fetch_max(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        LARGEST_BYTES.fetch_max(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, place: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        LARGEST_BYTES.fetch_max(size, Ordering::Relaxed);
        // SAFETY: the caller's promise is passed on.
        unsafe { System.realloc(place, layout, size) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise is passed on.
        unsafe { System.dealloc(place, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Recording = Recording;

/// No seed is larger than 32 KiB, and zlib gives at most 1032 times its size.
const MAX_REQUEST_BYTES: usize = 34 << 20;

const MUTANTS_A_FILE: usize = 60;

/// However few files of a format there are.
const MUTANTS_A_FORMAT: usize = 240;

/// Numbers that sizes, counts, offsets and extents are replaced by.
const ABSURD: [&str; 14] = [
    "0",
    "-1",
    "1",
    "2",
    "7",
    "255",
    "65536",
    "2147483647",
    "-2147483648",
    "4294967295",
    "9223372036854775807",
    "18446744073709551615",
    "1e308",
    "nan",
];

/// The xorshift64* generator.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }
}

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

/// Reads everything; true if that went well. Panics only if a reader does or an error is empty.
fn read_all(format: &Format, path: &Path, bytes: Vec<u8>) -> bool {
    let source = Source::from_bytes(path, bytes);
    match (format.read)(&source, &ReadOptions::default()) {
        Err(problem) => {
            assert!(!problem.to_string().is_empty());
            false
        }
        Ok(dataset) => {
            let results: Vec<bool> = dataset
                .fields()
                .iter()
                .map(|field| field.load().map(|array| array.range(0)).is_ok())
                .collect();
            results.into_iter().all(|good| good)
        }
    }
}

/// Runs of digits with their signs: where sizes, counts and offsets are.
fn numbers(bytes: &[u8]) -> Vec<std::ops::Range<usize>> {
    let mut found = Vec::new();
    let mut start = None;
    for (i, byte) in bytes.iter().enumerate() {
        match (byte.is_ascii_digit(), start) {
            (true, None) => start = Some(i),
            (false, Some(from)) => {
                found.push(from..i);
                start = None;
            }
            _ => {}
        }
    }
    found
}

fn mutate(bytes: &[u8], other: &[u8], random: &mut Random) -> Vec<u8> {
    let mut mutant = bytes.to_vec();
    match random.below(6) {
        0 => {
            for _ in 0..=random.below(8) {
                let i = random.below(mutant.len());
                mutant[i] = random.next() as u8;
            }
        }
        1 => mutant.truncate(random.below(bytes.len())),
        2 => {
            let from = random.below(other.len());
            let len = random.below(other.len() - from).min(400);
            let at = random.below(mutant.len());
            let end = (at + random.below(400)).min(mutant.len());
            mutant.splice(at..end, other[from..from + len].iter().copied());
        }
        3 => {
            let i = random.below(mutant.len());
            mutant[i] ^= 1 << random.below(8);
        }
        _ => {
            let places = numbers(bytes);
            let place = places[random.below(places.len().min(80))].clone();
            let text = ABSURD[random.below(ABSURD.len())];
            mutant.splice(place, text.bytes());
        }
    }
    mutant
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
    let largest = LARGEST_BYTES.load(Ordering::Relaxed);
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
