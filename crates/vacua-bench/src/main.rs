//! `vacua-bench skip`, `encode`, `sample` and so on: the tables on this machine, as `vacua bench` has
//! them.

use std::io::Write;
use std::process::ExitCode;

use clap::Parser;
use vacua_bench::command::{Command, run};

/// The tables of the papers, regenerated on this machine.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

fn main() -> ExitCode {
    let Arguments { command } = Arguments::parse();
    let written = run(command).and_then(|text| Ok(writeln!(std::io::stdout(), "{text}")?));
    match written {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            // There is nobody left to tell if this fails.
            let _ = writeln!(std::io::stderr(), "error: {e}");
            ExitCode::FAILURE
        }
    }
}
