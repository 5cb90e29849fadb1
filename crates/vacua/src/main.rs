//! The `vacua` command; see `vacua --help`.

mod command;

fn main() -> std::process::ExitCode {
    command::main()
}
