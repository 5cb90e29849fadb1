//! The task `shaders`: GLSL beside its callers, compiled to SPIR-V that is committed, so that
//! `cargo build` needs no shader compiler.

use std::path::{Path, PathBuf};

use crate::command::{Failure, command, run, succeeds, workspace};
use crate::tasks::install;

/// The shader compiler, and the Debian package that has it.
const COMPILER: &str = "glslangValidator";
const PACKAGE: &str = "glslang-tools";

/// Where shaders lie.
const FOLDER: &str = "crates/vacua-gpu/src";

/// Endings of shaders by stage; `.glsl` files are included by them.
const STAGES: [&str; 6] = ["comp", "rgen", "rmiss", "rchit", "rahit", "rint"];

/// Compiles every shader; with `check`, compares with what is committed instead.
pub fn shaders(check: bool) -> Result<(), Failure> {
    if !succeeds(command(COMPILER, &["--version"])) {
        install(&[PACKAGE], &[])?;
    }
    let sources = sources(&workspace().join(FOLDER))?;
    if sources.is_empty() {
        return Err(Failure::Check(format!("no shader in {FOLDER}")));
    }
    let folder = tempfile::tempdir().map_err(|source| Failure::Start {
        command: "a temporary folder".to_owned(),
        source,
    })?;
    let mut stale = Vec::new();
    for source in &sources {
        let committed = compiled(source);
        let target = if check {
            folder.path().join("shader.spv")
        } else {
            committed.clone()
        };
        let arguments = ["--target-env", "vulkan1.2", "-V", "--quiet", "-o"];
        run(command(COMPILER, &arguments).arg(&target).arg(source))?;
        if check && std::fs::read(&target).ok() != std::fs::read(&committed).ok() {
            stale.push(committed.display().to_string());
        }
    }
    if stale.is_empty() {
        return Ok(());
    }
    Err(Failure::Check(format!(
        "not what their sources compile to: {}; run `cargo xtask shaders`",
        stale.join(", ")
    )))
}

/// `march.comp` becomes `march.spv`, other stages keep their ending: `mesh.rgen.spv`.
fn compiled(source: &Path) -> PathBuf {
    if source.extension().is_some_and(|e| e == "comp") {
        return source.with_extension("spv");
    }
    let mut name = source.as_os_str().to_owned();
    name.push(".spv");
    name.into()
}

/// All shaders in a folder, in order.
fn sources(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let entries = std::fs::read_dir(folder).map_err(|source| Failure::Start {
        command: format!("list {}", folder.display()),
        source,
    })?;
    let is_shader = |path: &PathBuf| {
        let ending = path.extension().and_then(|e| e.to_str());
        ending.is_some_and(|e| STAGES.contains(&e))
    };
    let mut found: Vec<PathBuf> = entries
        .flatten()
        .map(|e| e.path())
        .filter(is_shader)
        .collect();
    found.sort();
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn compiled_shaders_are_named_after_their_sources() {
        assert_eq!(
            compiled(Path::new("a/march.comp")),
            Path::new("a/march.spv")
        );
        assert_eq!(compiled(Path::new("mesh.rgen")), Path::new("mesh.rgen.spv"));
    }
}
