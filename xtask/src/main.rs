//! Developer tasks for vacua: `cargo xtask <task>`.
//!
//! One command runs all checks, and continuous integration calls the same one.

mod command;
#[cfg(test)]
mod dependencies;
mod fuzz;
mod shaders;
mod tasks;

use std::process::ExitCode;

use command::Failure;

const USAGE: &str = "\
usage: cargo xtask <task>

  test             unit, integration and doc tests of the workspace, and the fuzz seeds
  ci [PIECE...]    everything that must pass: fmt deny shaders clippy doc build demo test (or some)
  shaders          compile the shaders of vacua-gpu; with --check: prove that they are
  fuzz [SECONDS]   every fuzz target for so long (default 60); needs nightly and cargo-fuzz";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let outcome = match arguments[..] {
        ["test"] => tasks::test(),
        ["ci", ref pieces @ ..] => tasks::ci(pieces),
        ["shaders"] => shaders::shaders(false),
        ["shaders", "--check"] => shaders::shaders(true),
        ["fuzz"] => fuzz::run(60),
        ["fuzz", seconds] => match seconds.parse() {
            Ok(seconds) => fuzz::run(seconds),
            Err(_) => Err(Failure::Usage(format!(
                "`{seconds}` is no number of seconds"
            ))),
        },
        _ => Err(Failure::Usage(USAGE.to_owned())),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("xtask: {failure}");
            ExitCode::from(if matches!(failure, Failure::Usage(_)) {
                2
            } else {
                1
            })
        }
    }
}
