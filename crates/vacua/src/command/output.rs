//! What a command says while and after it works: results on standard output, progress on a terminal
//! only. And where it may write.

use std::io::{IsTerminal as _, Write as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget};
use vacua_io::{STANDARD_OUTPUT, is_same_file, is_standard_output, is_stream};

use super::{Failure, Wrong};

/// The file to write that an argument means: `-` is standard output.
pub fn place(path: PathBuf) -> PathBuf {
    if path == Path::new("-") {
        return PathBuf::from(STANDARD_OUTPUT);
    }
    path
}

/// Whether a path ends as those of encoded meshes do.
pub fn is_named_vacua(path: &Path) -> bool {
    path.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("vacua"))
}

/// Refuses what no dataset can be written to, and says why: standard output, which has no ending to say
/// the format, and `.vacua` files.
pub fn check_dataset_format(path: &Path) -> Result<(), Wrong> {
    if is_standard_output(path) {
        return Err(Wrong(
            "standard output has no ending that says the format; give a file name".to_owned(),
        ));
    }
    if is_named_vacua(path) {
        return Err(Wrong(format!(
            "{}: .vacua files are made by `vacua encode`, from a file with a mesh",
            path.display()
        )));
    }
    Ok(())
}

/// Refuses to write over a file that is read.
pub fn refuse_input(output: &Path, input: &Path) -> Result<(), Wrong> {
    if is_stream(output) || !is_same_file(output, input) {
        return Ok(());
    }
    let (output, input) = (output.display(), input.display());
    Err(Wrong(format!(
        "{output}: this is the file that is read ({input}); give another to write"
    )))
}

/// Refuses two outputs to the same place.
pub fn refuse_twice(first: &Path, second: &Path) -> Result<(), Wrong> {
    let whole = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let both_standard = is_standard_output(first) && is_standard_output(second);
    let same = is_same_file(first, second) || whole(first) == whole(second);
    if both_standard || (same && !is_stream(first)) {
        let path = second.display();
        return Err(Wrong(format!("{path}: two results cannot be one file")));
    }
    Ok(())
}

/// Prints a result, line break included. A reader that has seen enough is no failure.
pub fn print(text: &str) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    match writeln!(out, "{text}").and_then(|()| out.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(Failure::plain(
            format!("cannot write to standard output: {error}"),
        )),
        _ => Ok(()),
    }
}

/// Prints a result as JSON.
pub fn print_json(value: &impl serde::Serialize) -> Result<(), Failure> {
    let text =
        serde_json::to_string_pretty(value).map_err(|error| Failure::Other(Box::new(error)))?;
    print(&text)
}

/// Runs a long step under a spinner that says what is being done; silent unless standard error is a
/// terminal.
pub fn during<T>(what: &str, work: impl FnOnce() -> T) -> T {
    const TICK: Duration = Duration::from_millis(120);
    if !std::io::stderr().is_terminal() {
        return work();
    }
    let spinner = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
    spinner.set_message(what.to_owned());
    spinner.enable_steady_tick(TICK);
    let done = work();
    spinner.finish_and_clear();
    done
}

/// The most memory that this process held so far, in bytes; `None` where the system does not say.
pub fn peak_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes * 1024)
}
