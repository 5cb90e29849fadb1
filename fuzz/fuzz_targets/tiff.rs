//! Hostile bytes for the `tiff` target; see `vacua_fuzz::read`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let _num_loaded = vacua_fuzz::read("tiff", bytes);
});
