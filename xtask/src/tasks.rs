//! The tasks `test` and `ci`.

use std::path::PathBuf;

use crate::command::{Failure, cargo, command, run, succeeds};
use crate::fuzz;
use crate::shaders::shaders;

/// Debian packages that tests need beyond Rust and a C compiler: the Vulkan loader, and the layer
/// that checks every call.
const SYSTEM_PACKAGES: &[&str] = &["libvulkan1", "vulkan-validationlayers"];

/// The package with lavapipe, a Vulkan device that runs on the CPU; Debian 12 has one that is new
/// enough among its backports.
const LAVAPIPE_PACKAGE: &str = "mesa-vulkan-drivers";

/// Where drivers describe themselves.
const DRIVERS: &str = "/usr/share/vulkan/icd.d";

/// The pieces of `ci`, in order; the tests come last so that their results end the log.
const PIECES: [(&str, fn() -> Result<(), Failure>); 8] = [
    ("fmt", fmt),
    ("deny", deny),
    ("shaders", || shaders(true)),
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
    let driver = lavapipe()?;
    let cargo = cargo();
    // Tests on a device run on lavapipe, the same everywhere; where it is, they may not be left out.
    let on_lavapipe = |mut command: std::process::Command| {
        if let Some(driver) = &driver {
            command
                .env("VK_DRIVER_FILES", driver)
                .env("VACUA_GPU_REQUIRED", "1");
        }
        command
    };
    if succeeds(command(&cargo, &["nextest", "--version"])) {
        run(&mut on_lavapipe(command(
            &cargo,
            &[
                "nextest",
                "run",
                "--workspace",
                "--no-tests=pass",
                "--no-fail-fast",
            ],
        )))?;
        run(&mut on_lavapipe(command(
            &cargo,
            &["test", "--workspace", "--doc"],
        )))?;
    } else {
        run(&mut on_lavapipe(command(&cargo, &["test", "--workspace"])))?;
    }
    fuzz::replay()
}

/// The file that describes lavapipe. On Debian it is installed if it is not there, with the packages
/// that tests on a device need; elsewhere what is missing is said, and none comes back.
fn lavapipe() -> Result<Option<PathBuf>, Failure> {
    let find = || {
        let entries = std::fs::read_dir(DRIVERS).into_iter().flatten().flatten();
        let is_lavapipe = |path: &PathBuf| {
            let name = path.file_name().and_then(|n| n.to_str());
            name.is_some_and(|n| n.starts_with("lvp_icd") && n.ends_with(".json"))
        };
        entries.map(|e| e.path()).find(is_lavapipe)
    };
    if !succeeds(command("dpkg", &["--version"])) {
        let found = find();
        if found.is_none() {
            eprintln!(
                "xtask: no lavapipe in {DRIVERS}, and this is no Debian on which to install it: tests on a \
                 GPU run only if there is one. They want a Vulkan loader, Mesa's lavapipe and Khronos' \
                 validation layers (in Debian: {} {LAVAPIPE_PACKAGE})",
                SYSTEM_PACKAGES.join(" ")
            );
        }
        return Ok(found);
    }
    install(SYSTEM_PACKAGES, &[])?;
    if find().is_none() {
        install(&[LAVAPIPE_PACKAGE], add_backports()?)?;
    }
    match find() {
        Some(found) => Ok(Some(found)),
        None => Err(Failure::Check(format!(
            "{LAVAPIPE_PACKAGE} brought no lavapipe to {DRIVERS}"
        ))),
    }
}

/// On Debian 12, makes its backports known; gives what tells apt to take a package from there, and with it
/// those that it needs in a newer version than the one installed.
fn add_backports() -> Result<&'static [&'static str], Failure> {
    let release = std::fs::read_to_string("/etc/os-release").unwrap_or_default();
    if !release.contains("VERSION_CODENAME=bookworm") {
        return Ok(&[]);
    }
    let script = "\
        echo 'deb http://deb.debian.org/debian bookworm-backports main' \
            > /etc/apt/sources.list.d/vacua-backports.list";
    run(&mut as_root("sh", &["-c", script]))?;
    Ok(&["--target-release", "bookworm-backports"])
}

/// A command with the rights to install packages.
fn as_root(program: &str, arguments: &[&str]) -> std::process::Command {
    let is_root = std::env::var("USER").is_ok_and(|user| user == "root")
        || !succeeds(command("sudo", &["-n", "true"]));
    if is_root {
        return command(program, arguments);
    }
    let mut sudo = command("sudo", &[program]);
    sudo.args(arguments);
    sudo
}

/// Installs Debian packages that are not there yet, with more options for apt; does nothing for an empty list.
pub fn install(packages: &[&str], options: &[&str]) -> Result<(), Failure> {
    let missing: Vec<&str> = packages
        .iter()
        .copied()
        .filter(|package| !succeeds(command("dpkg", &["-s", package])))
        .collect();
    if missing.is_empty() {
        return Ok(());
    }
    // Fresh machines have no lists of packages; where they cannot be had, older ones may do.
    let _ = run(&mut as_root("apt-get", &["update"]));
    let mut arguments = vec!["install", "-y", "--no-install-recommends"];
    arguments.extend(options);
    arguments.extend(missing);
    run(&mut as_root("apt-get", &arguments))
}

fn fmt() -> Result<(), Failure> {
    run(&mut command(&cargo(), &["fmt", "--all", "--check"]))
}

/// Licences, bans and sources of all dependencies, where cargo-deny is installed. Advisories need the
/// network and change by themselves: `cargo deny check` tells them.
fn deny() -> Result<(), Failure> {
    let cargo = cargo();
    if !succeeds(command(&cargo, &["deny", "--version"])) {
        eprintln!("xtask: cargo-deny is not installed; dependencies' licences were not checked");
        return Ok(());
    }
    let arguments = ["deny", "check", "licenses", "bans", "sources"];
    run(&mut command(&cargo, &arguments))
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
