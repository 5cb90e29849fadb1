//! The fuzz targets: real fuzzing where nightly and cargo-fuzz are, and everywhere a replay of the
//! seeds with fixed mutations, which needs neither.

use crate::command::{Failure, cargo, command, run as run_command, succeeds, workspace};

/// Runs one target for so many seconds.
fn run_target(target: &str, seconds: u32) -> Result<(), Failure> {
    let corpus = format!("fuzz/corpus/{target}");
    let seeds = format!("fuzz/seeds/{target}");
    let failed = |source| Failure::Start {
        command: format!("create {corpus}"),
        source,
    };
    std::fs::create_dir_all(workspace().join(&corpus)).map_err(failed)?;
    let time = format!("-max_total_time={seconds}");
    // New inputs go to the first folder, seeds come from all of them.
    let mut arguments = vec!["+nightly", "fuzz", "run", target, &corpus];
    if workspace().join(&seeds).is_dir() {
        arguments.push(&seeds);
    }
    arguments.extend(["--", &time, "-timeout=20", "-rss_limit_mb=2048"]);
    run_command(&mut command("cargo", &arguments))
}

/// Gives the fuzz crate, which is no member of the workspace, the workspace's versions.
fn share_lock_file() -> Result<(), Failure> {
    let lock = |folder: &str| workspace().join(folder).join("Cargo.lock");
    let copied = std::fs::copy(lock("."), lock("fuzz"));
    copied.map(drop).map_err(|source| Failure::Start {
        command: "copy Cargo.lock to fuzz/".to_owned(),
        source,
    })
}

/// Fuzzes every target, or replays the seeds where fuzzing is impossible, and says so.
pub fn run(seconds: u32) -> Result<(), Failure> {
    if !succeeds(command("cargo", &["+nightly", "fuzz", "--version"])) {
        eprintln!("xtask: no nightly or no cargo-fuzz here: replaying the seeds instead");
        return replay();
    }
    share_lock_file()?;
    let mut targets: Vec<String> = std::fs::read_dir(workspace().join("fuzz/fuzz_targets"))
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|entry| Some(entry.path().file_stem()?.to_str()?.to_owned()))
        .collect();
    targets.sort();
    if targets.is_empty() {
        return Err(Failure::Check("fuzz/fuzz_targets is empty".to_owned()));
    }
    targets
        .iter()
        .try_for_each(|target| run_target(target, seconds))
}

/// Feeds seeds and fixed mutations of them to every target, as a plain test.
pub fn replay() -> Result<(), Failure> {
    share_lock_file()?;
    let arguments = [
        "test",
        "--manifest-path",
        "fuzz/Cargo.toml",
        "--no-default-features",
    ];
    let target_dir = workspace().join("target");
    let target_dir = std::env::var_os("CARGO_TARGET_DIR").unwrap_or(target_dir.into());
    run_command(command(&cargo(), &arguments).env("CARGO_TARGET_DIR", target_dir))
}
