//! The tasks `test` and `ci`.

use crate::command::{Failure, cargo, command, run, succeeds};
use crate::fuzz;

/// Debian packages that tests need beyond Rust and a C compiler.
const SYSTEM_PACKAGES: &[&str] = &[];

/// The pieces of `ci`, in order; the tests come last so that their results end the log.
const PIECES: [(&str, fn() -> Result<(), Failure>); 6] = [
    ("fmt", fmt),
    ("clippy", clippy),
    ("doc", doc),
    ("build", build),
    ("demo", demo),
    ("test", test),
];

/// Runs all pieces of continuous integration, or those named.
pub fn ci(names: &[&str]) -> Result<(), Failure> {
    if let Some(unknown) = names.iter().find(|n| PIECES.iter().all(|p| p.0 != **n)) {
        let known = PIECES.map(|p| p.0).join(" ");
        return Err(Failure::Usage(format!(
            "`{unknown}` is no piece of ci, which are: {known}"
        )));
    }
    for (name, piece) in PIECES {
        if names.is_empty() || names.contains(&name) {
            piece()?;
        }
    }
    Ok(())
}

/// Runs every test of the workspace and replays the fuzz seeds.
pub fn test() -> Result<(), Failure> {
    install(SYSTEM_PACKAGES)?;
    let cargo = cargo();
    if succeeds(command(&cargo, &["nextest", "--version"])) {
        run(&mut command(
            &cargo,
            &["nextest", "run", "--workspace", "--no-tests=pass"],
        ))?;
        run(&mut command(&cargo, &["test", "--workspace", "--doc"]))?;
    } else {
        run(&mut command(&cargo, &["test", "--workspace"]))?;
    }
    fuzz::replay()
}

/// Installs Debian packages that are not there yet; does nothing for an empty list.
fn install(packages: &[&str]) -> Result<(), Failure> {
    let missing: Vec<&str> = packages
        .iter()
        .copied()
        .filter(|package| !succeeds(command("dpkg", &["-s", package])))
        .collect();
    if missing.is_empty() {
        return Ok(());
    }
    let mut arguments = vec!["install", "-y", "--no-install-recommends"];
    arguments.extend(missing);
    let is_root = std::env::var("USER").is_ok_and(|user| user == "root")
        || !succeeds(command("sudo", &["-n", "true"]));
    if is_root {
        run(&mut command("apt-get", &arguments))
    } else {
        arguments.insert(0, "apt-get");
        run(&mut command("sudo", &arguments))
    }
}

fn fmt() -> Result<(), Failure> {
    run(&mut command(&cargo(), &["fmt", "--all", "--check"]))
}

fn clippy() -> Result<(), Failure> {
    let arguments = [
        "clippy",
        "--workspace",
        "--all-targets",
        "--",
        "-D",
        "warnings",
    ];
    run(&mut command(&cargo(), &arguments))
}

fn doc() -> Result<(), Failure> {
    let arguments = [
        "doc",
        "--workspace",
        "--no-deps",
        "--document-private-items",
    ];
    run(command(&cargo(), &arguments).env("RUSTDOCFLAGS", "-D warnings"))
}

fn build() -> Result<(), Failure> {
    run(&mut command(&cargo(), &["build", "--release"]))
}

/// Runs the demo, which must write pictures, into a folder that is removed afterwards.
fn demo() -> Result<(), Failure> {
    let folder = tempfile::tempdir().map_err(|source| Failure::Start {
        command: "demo into a temporary folder".to_owned(),
        source,
    })?;
    let arguments = ["run", "--release", "--", "demo", "-o"];
    run(command(&cargo(), &arguments).arg(folder.path()))?;
    let is_picture = |path: std::path::PathBuf| {
        path.extension().is_some_and(|e| e == "png") && path.metadata().is_ok_and(|m| m.len() > 0)
    };
    let pictures = std::fs::read_dir(folder.path())
        .into_iter()
        .flatten()
        .flatten()
        .filter(|entry| is_picture(entry.path()))
        .count();
    if pictures == 0 {
        return Err(Failure::Check("the demo wrote no picture".to_owned()));
    }
    Ok(())
}
