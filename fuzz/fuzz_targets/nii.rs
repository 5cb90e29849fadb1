//! See `vacua_fuzz::read`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| vacua_fuzz::read("nii", bytes));
