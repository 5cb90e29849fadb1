//! Written files appear whole or not at all.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use crate::error::{IoError, Problem};

/// Writes a file through `fill` into a temporary neighbour and renames it when all went well; on
/// any error the target stays as it was.
///
/// # Errors
/// [`Problem::System`] if the folder cannot be written, or what `fill` fails with.
pub fn write_atomically(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<&File>) -> std::io::Result<()>,
) -> Result<(), IoError> {
    let system = |source| {
        Problem::System {
            action: "cannot write",
            source,
        }
        .in_file(path)
    };
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    #[cfg(target_os = "linux")]
    if let Some(file) = nameless::create(folder) {
        write_all(&file, fill).map_err(system)?;
        return nameless::persist(&file, folder, path).map_err(system);
    }
    let mut builder = tempfile::Builder::new();
    builder.prefix(PREFIX);
    // Readable by whom the process lets read its files, as with any file that a program creates;
    // without this only the owner could.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let temporary = builder.tempfile_in(folder).map_err(system)?;
    write_all(temporary.as_file(), fill).map_err(system)?;
    temporary.persist(path).map_err(|e| system(e.error))?;
    Ok(())
}

/// Names of temporary files start so.
const PREFIX: &str = ".vacua-";

fn write_all(
    file: &File,
    fill: impl FnOnce(&mut BufWriter<&File>) -> std::io::Result<()>,
) -> std::io::Result<()> {
    let mut writer = BufWriter::with_capacity(1 << 20, file);
    fill(&mut writer).and_then(|()| writer.flush())
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
        let temporary = tempfile::Builder::new()
            .prefix(super::PREFIX)
            .make_in(folder, |name| {
                linkat(CWD, own.as_str(), CWD, name, AtFlags::SYMLINK_FOLLOW).map_err(Into::into)
            })?;
        temporary.into_temp_path().persist(path)?;
        Ok(())
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
}
