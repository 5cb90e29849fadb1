//! The command run as a user would: helpers of the tests of it.

use std::path::Path;
use std::process::{Command, Output};

/// What becomes of some arguments; nothing is kept in the user's own folders.
pub fn vacua(arguments: &[&str]) -> Output {
    vacua_with_cache(arguments, Path::new(env!("CARGO_TARGET_TMPDIR")))
}

/// The same with a folder for what is kept from run to run.
pub fn vacua_with_cache(arguments: &[&str], cache: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_vacua"))
        .args(arguments)
        .env("XDG_CACHE_HOME", cache)
        .output()
        .expect("the command starts")
}

/// The same where it must succeed.
pub fn succeed(arguments: &[&str]) -> Output {
    let output = vacua(arguments);
    let message = stderr(&output);
    assert!(output.status.success(), "{arguments:?}: {message}");
    output
}

/// What it said on standard error.
pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A path as an argument.
pub fn text(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

/// A folder that goes with the test.
pub fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("temporary folder")
}
