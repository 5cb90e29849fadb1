//! Written files appear whole or not at all; what is no regular file is written straight into.

use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Error, ErrorKind, Result, Write};
use std::path::{Path, PathBuf};

use crate::error::{IoError, Problem};

/// Links that are followed before their chain counts as a circle, as Linux does.
const MOST_LINKS: usize = 40;

/// Names of temporary files start so.
const PREFIX: &str = ".vacua-";

/// The path that stands for the standard output of the process.
pub const STANDARD_OUTPUT: &str = "/dev/stdout";

/// Whether a path stands for the standard output of the process: it is then written through the
/// process's own handle, whatever that is connected to.
pub fn is_standard_output(path: &Path) -> bool {
    let names = [STANDARD_OUTPUT, "/dev/fd/1", "/proc/self/fd/1"];
    names.iter().any(|name| path == Path::new(name))
}

/// Whether what is written there goes out at once, in order, and cannot be taken back: standard
/// output, and whatever exists and is neither a regular file nor a folder (pipes, devices).
pub fn is_stream(path: &Path) -> bool {
    let is_special = |m: std::fs::Metadata| !m.is_file() && !m.is_dir();
    is_standard_output(path) || std::fs::metadata(path).is_ok_and(is_special)
}

/// Whether two paths lead to the same existing file, by whatever names and links.
pub fn is_same_file(a: &Path, b: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt as _;
        let identity = |path| std::fs::metadata(path).map(|m| (m.dev(), m.ino()));
        if let (Ok(a), Ok(b)) = (identity(a), identity(b)) {
            return a == b;
        }
    }
    match (std::fs::canonicalize(a), std::fs::canonicalize(b)) {
        (Ok(a), Ok(b)) => a == b,
        _ => false,
    }
}

/// Writes a file through `fill` into a temporary neighbour and renames it when all went well; on
/// any error the target stays as it was. A symbolic link is followed: what it leads to is written.
/// [Streams](is_stream) are written straight into.
///
/// # Errors
/// [`Problem::System`] if the folder cannot be written, or what `fill` fails with.
pub fn write_atomically(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<&File>) -> Result<()>,
) -> std::result::Result<(), IoError> {
    write(path, fill).map_err(|source| {
        Problem::System {
            action: "cannot write",
            source,
        }
        .in_file(path)
    })
}

fn write(path: &Path, fill: impl FnOnce(&mut BufWriter<&File>) -> Result<()>) -> Result<()> {
    if let Some(stream) = open_stream(path)? {
        return write_all(&stream, fill);
    }
    let path = &link_target(path)?;
    if path.is_dir() {
        return Err(ErrorKind::IsADirectory.into());
    }
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    #[cfg(target_os = "linux")]
    if let Some(file) = nameless::create(folder) {
        write_all(&file, fill)?;
        return nameless::persist(&file, folder, path);
    }
    let temporary = named(folder, |name| {
        let mut options = OpenOptions::new();
        options.read(true).write(true).create_new(true);
        // Readable by whom the process lets read its files, as with any file that a program
        // creates.
        options.open(name)
    })?;
    write_all(temporary.as_file(), fill)?;
    temporary.persist(path).map_err(|e| e.error)?;
    Ok(())
}

fn write_all(file: &File, fill: impl FnOnce(&mut BufWriter<&File>) -> Result<()>) -> Result<()> {
    let mut writer = BufWriter::with_capacity(1 << 20, file);
    fill(&mut writer).and_then(|()| writer.flush())
}

/// Opens a path for writing straight into it; `None` if it is a regular file, or not there.
fn open_stream(path: &Path) -> Result<Option<File>> {
    if is_standard_output(path) {
        return standard_output().map(Some);
    }
    if !is_stream(path) {
        return Ok(None);
    }
    OpenOptions::new().write(true).open(path).map(Some)
}

/// The standard output as a file of its own.
fn standard_output() -> Result<File> {
    #[cfg(unix)]
    {
        use std::os::fd::AsFd as _;
        Ok(std::io::stdout().as_fd().try_clone_to_owned()?.into())
    }
    #[cfg(windows)]
    {
        use std::os::windows::io::AsHandle as _;
        Ok(std::io::stdout().as_handle().try_clone_to_owned()?.into())
    }
}

/// What a path leads to when symbolic links at its end are followed, whether it is there or not.
fn link_target(path: &Path) -> Result<PathBuf> {
    let mut path = path.to_owned();
    for _ in 0..MOST_LINKS {
        if !path.is_symlink() {
            return Ok(path);
        }
        let target = std::fs::read_link(&path)?;
        path = match path.parent() {
            Some(folder) => folder.join(target),
            None => target,
        };
    }
    Err(Error::other("too many levels of symbolic links"))
}

/// A temporary file that `create` makes by a name of its own. Errors are those of the system, without
/// that name: it is none that anybody gave.
fn named<T>(
    folder: &Path,
    create: impl Fn(&Path) -> Result<T>,
) -> Result<tempfile::NamedTempFile<T>> {
    let mut reason = None;
    let made = tempfile::Builder::new()
        .prefix(PREFIX)
        .make_in(folder, |name| {
            create(name).map_err(|error| {
                let same = Error::from(error.kind());
                reason = Some(error);
                same
            })
        });
    made.map_err(|error| reason.unwrap_or_else(|| error.kind().into()))
}

/// Files that have no name until they are complete: of a process that is killed nothing is left.
#[cfg(target_os = "linux")]
mod nameless {
    use std::fs::File;
    use std::io::Result;
    use std::os::fd::AsRawFd as _;
    use std::path::Path;

    use rustix::fs::{AtFlags, CWD, Mode, OFlags, linkat, openat};

    /// `None` where the file system has no such files.
    pub fn create(folder: &Path) -> Option<File> {
        let flags = OFlags::TMPFILE | OFlags::RDWR | OFlags::CLOEXEC;
        let mode = Mode::from_raw_mode(0o666);
        openat(CWD, folder, flags, mode).ok().map(File::from)
    }

    /// Gives it the name, in place of what has it.
    pub fn persist(file: &File, folder: &Path, path: &Path) -> Result<()> {
        let own = format!("/proc/self/fd/{}", file.as_raw_fd());
        // A link replaces nothing, a renaming does: by a name of its own, for an instant.
        let temporary = super::named(folder, |name| {
            linkat(CWD, own.as_str(), CWD, name, AtFlags::SYMLINK_FOLLOW).map_err(Into::into)
        })?;
        temporary
            .into_temp_path()
            .persist(path)
            .map_err(|e| e.error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn permissions_are_those_of_any_new_file() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().expect("temporary folder");
        let (ours, plain) = (folder.path().join("ours"), folder.path().join("plain"));
        write_atomically(&ours, |w| w.write_all(b"x")).expect("writable");
        std::fs::write(&plain, b"x").expect("writable");
        let mode = |path| std::fs::metadata(path).expect("there").permissions().mode();
        assert_eq!(mode(ours), mode(plain));
    }

    #[test]
    fn a_failed_write_leaves_the_old_file() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("out");
        write_atomically(&path, |w| w.write_all(b"old")).expect("writable");
        let failed = write_atomically(&path, |w| {
            w.write_all(b"half of the new")?;
            Err(std::io::Error::other("disk full"))
        });
        assert!(failed.is_err());
        assert_eq!(std::fs::read(&path).expect("still there"), b"old");
        assert_eq!(
            std::fs::read_dir(folder.path()).expect("listable").count(),
            1
        );
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed_to_what_they_lead_to() {
        use std::os::unix::fs::symlink;
        let folder = tempfile::tempdir().expect("temporary folder");
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("below")).expect("writable");
        std::fs::write(at("below/there"), b"old").expect("writable");
        symlink("below/there", at("to_there")).expect("writable");
        symlink("to_there", at("twice")).expect("writable");
        symlink("below/new", at("to_new")).expect("writable");
        symlink("circle", at("circle")).expect("writable");
        for (link, target) in [("twice", "below/there"), ("to_new", "below/new")] {
            write_atomically(&at(link), |w| w.write_all(b"new")).expect("writable");
            assert!(at(link).is_symlink(), "{link}");
            assert!(!at(target).is_symlink(), "{link}");
            assert_eq!(std::fs::read(at(target)).expect("written"), b"new");
        }
        assert!(is_same_file(&at("twice"), &at("below/there")));
        assert!(!is_same_file(&at("twice"), &at("to_new")));
        let error = write_atomically(&at("circle"), |w| w.write_all(b"new")).unwrap_err();
        assert!(error.to_string().contains("symbolic links"), "{error}");
        let left = std::fs::read_dir(folder.path()).expect("listable").count();
        assert_eq!(left, 5);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn what_is_no_file_is_written_straight_into() {
        use std::io::Read as _;
        let folder = tempfile::tempdir().expect("temporary folder");
        let pipe = folder.path().join("pipe");
        let mode = rustix::fs::Mode::RUSR | rustix::fs::Mode::WUSR;
        rustix::fs::mkfifoat(rustix::fs::CWD, &pipe, mode).expect("writable");
        let reader = std::thread::spawn({
            let pipe = pipe.clone();
            move || {
                let mut found = Vec::new();
                let mut file = File::open(pipe).expect("there");
                file.read_to_end(&mut found).map(|_| found)
            }
        });
        write_atomically(&pipe, |w| w.write_all(b"through")).expect("writable");
        let found = reader.join().expect("ends").expect("readable");
        assert_eq!(found, b"through");
        assert!(is_stream(&pipe), "still a pipe");
        write_atomically(Path::new("/dev/null"), |w| w.write_all(b"away")).expect("writable");
    }

    #[test]
    fn errors_do_not_name_temporary_files() {
        let folder = tempfile::tempdir().expect("temporary folder");
        for path in [folder.path().join("none/out"), folder.path().to_owned()] {
            let error = write_atomically(&path, |w| w.write_all(b"x")).unwrap_err();
            let text = error.to_string();
            assert!(
                !text.contains(PREFIX) && !text.contains("at path"),
                "{text}"
            );
        }
    }
}
