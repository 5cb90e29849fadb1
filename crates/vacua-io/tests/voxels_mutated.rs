//! Damaged voxel files: never a panic, never more memory than the file's size warrants.
//!
//! Every small file in `data/voxels` and `data/tiff` is damaged a fixed number of times from a fixed seed, opened,
//! and its fields loaded. An allocator that watches sizes is the witness for memory.

use std::alloc::{GlobalAlloc, Layout, System};
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use vacua_io::{ReadOptions, Source, formats, open_source};
use vacua_volume::ScalarType;

/// Largest single allocation so far, in bytes.
static LARGEST: AtomicUsize = AtomicUsize::new(0);

struct Watching;

// SAFETY: every call goes to the system's allocator unchanged; only a number is kept.
unsafe impl GlobalAlloc for Watching {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        LARGEST.fetch_max(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller keeps the contract of `GlobalAlloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        LARGEST.fetch_max(layout.size(), Ordering::Relaxed);
        // SAFETY: as above.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(place, layout) }
    }

    unsafe fn realloc(&self, place: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        LARGEST.fetch_max(size, Ordering::Relaxed);
        // SAFETY: as above.
        unsafe { System.realloc(place, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Watching = Watching;

/// Mutations of each file; every reader has several files.
const MUTATIONS_A_FILE: usize = 150;
/// What a file of 2 KiB may expand to by deflate, and what bzip2 needs to work at all.
const MOST_BYTES: usize = 16 << 20;

/// A small generator of fixed seed (splitmix64).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }
}

/// Numbers that hurt: as text, and as bytes.
const TEXTS: [&[u8]; 10] = [
    b"0",
    b"-1",
    b"nan",
    b"inf",
    b"99999999999999999999",
    b"18446744073709551615",
    b"4000000000",
    b"1e308",
    b"",
    b"%d",
];
const WORDS: [u64; 7] = [
    0,
    1,
    0xff,
    0x7fff,
    0x8000_0000,
    u64::MAX,
    0x7ff0_0000_0000_0000,
];

fn mutate(random: &mut Random, bytes: &mut Vec<u8>) {
    // Most of what can go wrong is in the header.
    let reach = if random.below(4) > 0 {
        bytes.len().min(560)
    } else {
        bytes.len()
    };
    let at = random.below(reach);
    match random.below(8) {
        0 => bytes[at] ^= 1 << random.below(8),
        1 => bytes[at] = random.next() as u8,
        2 => bytes.truncate(at),
        3 => {
            bytes.remove(at);
        }
        4 => bytes.insert(at, random.next() as u8),
        5 => {
            let word = WORDS[random.below(WORDS.len())].to_ne_bytes();
            let len = [1, 2, 4, 8][random.below(4)].min(bytes.len() - at);
            bytes[at..at + len].copy_from_slice(&word[..len]);
        }
        6 => {
            // One number in the text becomes another.
            let digits: Vec<usize> = (0..reach).filter(|&i| bytes[i].is_ascii_digit()).collect();
            if let Some(&from) = digits.get(random.below(digits.len())) {
                let rest = &bytes[from..];
                let len = rest.iter().take_while(|b| b.is_ascii_digit()).count();
                bytes.splice(
                    from..from + len,
                    TEXTS[random.below(TEXTS.len())].iter().copied(),
                );
            }
        }
        _ => {
            let len = random.below(64).min(bytes.len() - at);
            let copy = bytes[at..at + len].to_vec();
            let to = random.below(bytes.len());
            bytes.splice(to..to, copy);
        }
    }
    if bytes.is_empty() {
        bytes.push(0);
    }
}

/// Opens and loads; says whether all went well. A failure must print.
fn read(path: &Path, bytes: Vec<u8>, options: &ReadOptions) -> bool {
    let source = Source::from_bytes(path, bytes);
    let result = open_source(&source, options).map_err(|e| e.to_string());
    let loaded = result.and_then(|dataset| {
        dataset
            .fields()
            .iter()
            .try_for_each(|field| field.load().map(|_| ()).map_err(|e| format!("{e:?}")))
    });
    loaded
        .map_err(|message| assert!(!message.is_empty()))
        .is_ok()
}

#[test]
fn damaged_files_are_errors() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let mut paths: Vec<_> = ["voxels", "tiff"]
        .iter()
        .flat_map(|folder| std::fs::read_dir(data.join(folder)).expect("beside the tests"))
        .map(|entry| entry.expect("listable").path())
        .collect();
    paths.sort();
    let mut random = Random(2);
    let mut count: BTreeMap<&str, (usize, usize)> = BTreeMap::new();
    for path in paths {
        let name = path
            .file_name()
            .expect("a name")
            .to_string_lossy()
            .into_owned();
        let format = formats().iter().find(|f| {
            f.extensions
                .iter()
                .any(|e| name.ends_with(&format!(".{e}")))
        });
        let bytes = std::fs::read(&path).expect("readable");
        let Some(format) = format.filter(|_| bytes.len() < 4096) else {
            continue;
        };
        let raw = format.name == "raw";
        for round in 0..if raw {
            3 * MUTATIONS_A_FILE
        } else {
            MUTATIONS_A_FILE
        } {
            let mut damaged = bytes.clone();
            for _ in 0..=random.below(3) {
                mutate(&mut random, &mut damaged);
            }
            // A raw file has nothing to damage but its description.
            let options = ReadOptions {
                dimensions: raw.then(|| [0; 3].map(|_| random.next() as usize >> random.below(64))),
                scalar_type: raw.then(|| ScalarType::ALL[random.below(10)]),
                components: raw.then(|| random.next() as usize >> random.below(64)),
                header_bytes: (raw && random.below(2) == 0)
                    .then(|| random.next() as usize >> random.below(64)),
                ..ReadOptions::default()
            };
            let outcome = catch_unwind(AssertUnwindSafe(|| read(&path, damaged, &options)));
            let good = outcome.unwrap_or_else(|_| panic!("{name}, round {round}: see above"));
            let counts = count.entry(format.name).or_default();
            counts.0 += 1;
            counts.1 += usize::from(good);
            let largest = LARGEST.load(Ordering::Relaxed);
            assert!(
                largest <= MOST_BYTES,
                "{name}, round {round}: allocated {largest} bytes"
            );
        }
    }
    for name in ["NRRD", "MetaImage", "NIfTI", "NumPy", "TIFF", "raw"] {
        let (all, good) = count.get(name).copied().unwrap_or_default();
        assert!(all >= 200, "{name}: only {all} mutations");
        assert!(good < all, "{name}: no mutation was noticed");
    }
}
