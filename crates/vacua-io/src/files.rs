//! The data files a header names: one, a list, or a numbered series.
//!
//! A relative name stands for a file in the header's folder or below it; one that climbs out with
//! `..` is refused, since a header from elsewhere should not reach files that it was not shipped
//! with by accident. A header that names a file absolutely is taken at its word.

use std::path::{Component, Path, PathBuf};

use crate::decode::shown;
use crate::error::Problem;

/// Widest number that a name pattern may ask for.
const MOST_DIGITS: usize = 32;

/// Names of data files, made when asked for: a header can promise more than memory holds.
#[derive(Clone, Debug)]
pub(crate) enum FileNames {
    /// Listed by name.
    List(Vec<PathBuf>),
    /// Numbered.
    Series {
        /// Folder of the header.
        folder: PathBuf,
        /// The name with its place for a number.
        pattern: Pattern,
        /// First number.
        first: i64,
        /// Distance between numbers.
        step: i64,
        /// How many there are.
        count: usize,
    },
}

impl FileNames {
    /// Number of files.
    pub(crate) fn len(&self) -> usize {
        match self {
            Self::List(paths) => paths.len(),
            Self::Series { count, .. } => *count,
        }
    }

    /// One of the files; `index < len()`.
    ///
    /// # Errors
    /// [`Problem::Unsupported`] if the name leads out of the header's folder.
    pub(crate) fn path(&self, index: usize) -> Result<PathBuf, Problem> {
        match self {
            Self::List(paths) => Ok(paths[index].clone()),
            Self::Series {
                folder,
                pattern,
                first,
                step,
                ..
            } => {
                let number = first.wrapping_add(step.wrapping_mul(index as i64));
                resolve(folder, &pattern.name(number))
            }
        }
    }

    /// A numbered series from `first` to `last`, both included.
    ///
    /// # Errors
    /// [`Problem::Malformed`] if the numbers do not run from the first to the last.
    pub(crate) fn series(
        header: &Path,
        pattern: &str,
        first: i64,
        last: i64,
        step: i64,
    ) -> Result<Self, Problem> {
        let span = i128::from(last) - i128::from(first);
        let count = (step != 0)
            .then(|| span / i128::from(step))
            .filter(|&n| n >= 0)
            .and_then(|n| usize::try_from(n + 1).ok())
            .ok_or_else(|| {
                Problem::malformed(
                    "data file pattern",
                    "numbers that lead from the first to the last",
                    format!("{first} to {last} by {step}"),
                )
            })?;
        Ok(Self::Series {
            folder: folder_of(header),
            pattern: Pattern::parse(pattern)?,
            first,
            step,
            count,
        })
    }
}

/// A file name with one `%d` in it, as C's `printf` takes it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Pattern {
    before: String,
    zeros: bool,
    width: usize,
    after: String,
}

impl Pattern {
    /// Reads `name%04d.raw`; `%d`, `%i`, `%u` with a width and leading zeros, once; `%%` is a `%`.
    ///
    /// # Errors
    /// [`Problem::Malformed`] for anything else.
    pub(crate) fn parse(text: &str) -> Result<Self, Problem> {
        let wrong = || {
            Problem::malformed(
                "data file pattern",
                "a name with one number such as %03d",
                shown(text.as_bytes()),
            )
        };
        let mut parts = [String::new(), String::new()];
        let mut number = None;
        let mut chars = text.chars().peekable();
        while let Some(c) = chars.next() {
            if c != '%' || chars.next_if_eq(&'%').is_some() {
                parts[usize::from(number.is_some())].push(c);
                continue;
            }
            let zeros = chars.next_if_eq(&'0').is_some();
            let mut width = 0usize;
            while let Some(digit) = chars.next_if(char::is_ascii_digit) {
                let digit = digit.to_digit(10).unwrap_or_default() as usize;
                width = (width * 10 + digit).min(MOST_DIGITS + 1);
            }
            let conversion = chars.next_if(|c| matches!(c, 'd' | 'i' | 'u'));
            if conversion.is_none() || width > MOST_DIGITS || number.is_some() {
                return Err(wrong());
            }
            number = Some((zeros, width));
        }
        let (zeros, width) = number.ok_or_else(wrong)?;
        let [before, after] = parts;
        Ok(Self {
            before,
            zeros,
            width,
            after,
        })
    }

    /// The name with a number in it.
    pub(crate) fn name(&self, number: i64) -> String {
        let Self {
            before,
            zeros,
            width,
            after,
        } = self;
        if *zeros {
            format!("{before}{number:0width$}{after}")
        } else {
            format!("{before}{number:width$}{after}")
        }
    }
}

/// The folder of a file.
pub(crate) fn folder_of(file: &Path) -> PathBuf {
    file.parent().unwrap_or(Path::new("")).to_owned()
}

/// The file that a header in `folder` means by `name`.
///
/// # Errors
/// [`Problem::Unsupported`] if a relative name leads out of the folder.
pub(crate) fn resolve(folder: &Path, name: &str) -> Result<PathBuf, Problem> {
    let path = Path::new(name);
    if path.is_absolute() {
        return Ok(path.to_owned());
    }
    let mut depth = 0i64;
    for component in path.components() {
        depth += match component {
            Component::Normal(_) => 1,
            Component::ParentDir => -1,
            _ => 0,
        };
        if depth < 0 {
            return Err(Problem::unsupported_but(
                format!(
                    "the data file {} outside the header's folder",
                    shown(name.as_bytes())
                ),
                "move the files together, or name the data file by its absolute path",
            ));
        }
    }
    Ok(folder.join(path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_print_as_c_does() {
        let name = |pattern: &str, number| Pattern::parse(pattern).map(|p| p.name(number));
        assert_eq!(name("a%03d.raw", 7).expect("good"), "a007.raw");
        assert_eq!(name("%%%d", 12).expect("good"), "%12");
        assert_eq!(name("%2i%%x", 5).expect("good"), " 5%x");
        for wrong in ["none", "%d%d", "%s", "%", "%0999999999999999999999d", "%5"] {
            assert!(Pattern::parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn series_count_and_number() {
        let header = Path::new("/data/head.nhdr");
        let files = FileNames::series(header, "s%02d", 9, 1, -4).expect("good");
        let paths: Vec<_> = (0..files.len())
            .map(|i| files.path(i).expect("inside"))
            .collect();
        assert_eq!(
            paths,
            ["/data/s09", "/data/s05", "/data/s01"].map(PathBuf::from)
        );
        assert!(FileNames::series(header, "s%02d", 1, 9, 0).is_err());
        assert!(FileNames::series(header, "s%02d", 1, 9, -1).is_err());
        assert!(FileNames::series(header, "s%02d", i64::MIN, i64::MAX, 1).is_err());
    }

    #[test]
    fn relative_names_stay_inside() {
        let folder = Path::new("/data");
        assert_eq!(
            resolve(folder, "a/../b").expect("inside"),
            Path::new("/data/a/../b")
        );
        assert_eq!(
            resolve(folder, "/other/b").expect("absolute"),
            Path::new("/other/b")
        );
        assert!(resolve(folder, "../b").is_err());
        assert!(resolve(folder, "a/../../b").is_err());
    }
}
