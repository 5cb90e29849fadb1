//! The `vacua` command: arguments in two stages (what clap reads, then what it builds), one module a
//! subcommand, no algorithm of its own.
//!
//! Exit code 0 if what was asked was done, 2 for wrong usage, 1 for everything else. Results go to
//! standard output, everything about how they came to be to standard error.

mod choice;
mod convert;
mod demo;
mod encode;
mod info;
mod input;
mod output;
mod packed;
mod points;
mod render;
mod sample;
mod synth;
mod values;

use std::error::Error;
use std::io::Write as _;
use std::path::Path;
use std::process::ExitCode;

use clap::{ArgAction, Parser, Subcommand};
use vacua_io::IoError;

/// Scientific volume rendering that skips what is empty and packs what is not.
#[derive(Parser, Debug)]
#[command(name = "vacua", version, max_term_width = 100)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
    /// Say more about what is done (-vv, -vvv: even more)
    #[arg(short, long, action = ArgAction::Count, global = true)]
    verbose: u8,
}

#[derive(Subcommand, Debug)]
enum Command {
    /// Pictures with nothing to bring: makes volumes and renders them with and without skipping
    Demo(demo::DemoArgs),
    /// What is in a file: kind, size, bounds, fields with type and range
    Info(info::InfoArgs),
    /// One picture of a file's data
    Render(Box<render::RenderArgs>),
    /// Values at points, as CSV
    Sample(Box<sample::SampleArgs>),
    /// From one file format to another
    Convert(Box<convert::ConvertArgs>),
    /// A mesh into a small .vacua file, and what it takes by part
    Encode(Box<encode::EncodeArgs>),
    /// Procedural volumes and meshes of any size
    Synth(synth::SynthArgs),
}

/// Wrong usage that only shows when arguments meet each other.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{0}")]
pub struct Wrong(pub String);

/// Why a command failed.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// The arguments make no sense.
    #[error(transparent)]
    Usage(#[from] Wrong),
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] IoError),
    /// Something about the contents of a file.
    #[error("{file}")]
    Contents {
        /// The file.
        file: String,
        /// What about it.
        #[source]
        source: Box<dyn Error + Send + Sync>,
    },
    /// Anything else.
    #[error(transparent)]
    Other(Box<dyn Error + Send + Sync>),
}

impl Failure {
    /// A failure that is all said in one sentence.
    pub fn plain(message: String) -> Self {
        Self::Other(message.into())
    }

    /// A failure about the contents of a file.
    pub fn contents(path: &Path, source: impl Error + Send + Sync + 'static) -> Self {
        Self::Contents {
            file: path.display().to_string(),
            source: Box::new(source),
        }
    }

    /// Whether the user asked for something that cannot be asked for.
    pub fn is_usage(&self) -> bool {
        matches!(self, Self::Usage(_))
    }

    /// The message with everything that caused it, nothing said twice.
    fn explain(&self) -> String {
        let mut text = self.to_string();
        let mut cause = self.source();
        while let Some(error) = cause {
            let message = error.to_string();
            if !text.ends_with(&message) {
                text.push_str(": ");
                text.push_str(&message);
            }
            cause = error.source();
        }
        text
    }
}

/// Runs the command with the arguments of the process.
pub fn main() -> ExitCode {
    let arguments = Arguments::parse();
    start_logging(arguments.verbose);
    let done = match arguments.command {
        Command::Demo(args) => demo::run(&args),
        Command::Info(args) => info::run(&args),
        Command::Render(args) => render::run(&args),
        Command::Sample(args) => sample::run(&args),
        Command::Convert(args) => convert::run(*args),
        Command::Encode(args) => encode::run(&args),
        Command::Synth(args) => synth::run(&args),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            // A closed standard error leaves nobody to tell.
            let _ = writeln!(std::io::stderr(), "error: {}", failure.explain());
            ExitCode::from(if failure.is_usage() { 2 } else { 1 })
        }
    }
}

/// Sends what the libraries have to say to standard error: warnings always, more if asked for.
fn start_logging(verbose: u8) {
    use tracing_subscriber::filter::LevelFilter;
    let level = match verbose {
        0 => LevelFilter::WARN,
        1 => LevelFilter::INFO,
        2 => LevelFilter::DEBUG,
        _ => LevelFilter::TRACE,
    };
    tracing_subscriber::fmt()
        .with_max_level(level)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::IsTerminal::is_terminal(&std::io::stderr()))
        .with_target(verbose > 1)
        .without_time()
        .init();
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn arguments_are_consistent() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn causes_are_said_once() {
        let io = vacua_io::open("/no/such/file.vti").unwrap_err();
        let text = Failure::from(io).explain();
        assert_eq!(text.matches("No such file").count(), 1, "{text}");
        assert_eq!(text.matches("cannot open").count(), 1, "{text}");
        let nested = Failure::contents(Path::new("a.vti"), Wrong("deep".to_owned()));
        assert_eq!(nested.explain(), "a.vti: deep");
    }
}
