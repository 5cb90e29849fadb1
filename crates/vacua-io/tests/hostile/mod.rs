//! Bytes changed, cut off, spliced, and numbers replaced by absurd ones; and an allocator that notes
//! the largest request.

use std::alloc::{GlobalAlloc, Layout, System};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use vacua_io::{Format, ReadOptions, Source};

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

/// The largest request so far.
pub fn largest_request_bytes() -> usize {
    LARGEST_BYTES.load(Ordering::Relaxed)
}

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

/// The same for binary numbers.
const BINARY: [u64; 8] = [
    0,
    1,
    2,
    0x40,
    0xFFFF,
    0x7FFF_FFFF,
    0x7FFF_FFFF_FFFF_FFFF,
    u64::MAX,
];

/// The xorshift64* generator.
pub struct Random(pub u64);

impl Random {
    /// Any number.
    pub fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }

    /// A number below `n`, or 0.
    pub fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }
}

/// Reads everything; true if that went well. Panics only if a reader does or an error is empty.
pub fn read_all(format: &Format, path: &Path, bytes: Vec<u8>) -> bool {
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

/// One change.
pub fn mutate(bytes: &[u8], other: &[u8], random: &mut Random) -> Vec<u8> {
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
        4 if bytes.len() > 8 => {
            // Binary numbers: where a structure has them is not known, but they are aligned.
            let size = 1 << random.below(4);
            let at = random.below(bytes.len() / size - 1) * size;
            let number = BINARY[random.below(BINARY.len())];
            mutant[at..at + size].copy_from_slice(&number.to_le_bytes()[..size]);
        }
        _ => {
            let places = numbers(bytes);
            let place = random.below(places.len().min(80));
            let text = ABSURD[random.below(ABSURD.len())];
            if let Some(place) = places.get(place) {
                mutant.splice(place.clone(), text.bytes());
            }
        }
    }
    mutant
}
