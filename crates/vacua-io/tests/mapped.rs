//! A raw file of a gibibyte is mapped where it lies, not read into memory.
#![cfg(target_os = "linux")]

use vacua_volume::ScalarType;

/// Bytes of this process that belong to no file.
fn anonymous_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").expect("Linux has it");
    let line = status.lines().find(|l| l.starts_with("RssAnon:"));
    let kib = line.and_then(|l| l.split_whitespace().nth(1)?.parse::<u64>().ok());
    kib.expect("a number of KiB") << 10
}

#[test]
fn a_gibibyte_is_mapped() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("hole_1024x1024x512_uint16.raw");
    // A hole: it takes no room on the disk.
    let file = std::fs::File::create(&path).expect("a file");
    file.set_len(1 << 30).expect("a hole");
    let before = anonymous_bytes();
    let dataset = vacua_io::open(&path).expect("sizes are in the name");
    let values = dataset.fields()[0].load().expect("it can be mapped");
    assert_eq!(values.scalar_type(), ScalarType::U16);
    assert_eq!(values.bytes().len(), 1 << 30);
    assert_eq!(values.get_f64((1 << 29) - 1, 0), 0.0);
    let grown = anonymous_bytes().saturating_sub(before);
    assert!(
        grown < 16 << 20,
        "{grown} bytes of memory for a mapped file"
    );
}
