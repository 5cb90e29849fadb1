//! Hostile bytes for the `zarr` target; see `vacua_fuzz::read`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let _num_loaded = vacua_fuzz::read("zarr", bytes);
});
