//! Files in: one, many, a pattern or a series, and the time step that is wanted of them.

use std::path::{Path, PathBuf};

use vacua_io::{IoError, ReadOptions};
use vacua_volume::{Dataset, ScalarType};

use super::{Failure, Wrong, output, packed, values};

/// Which file, and what a file that does not say so itself contains.
#[derive(clap::Args, Debug)]
pub struct InputArgs {
    /// The data: a file, a Zarr folder, several files (time steps; TIFF files of one page make a stack), a
    /// pattern in quotes, or a ParaView .series or .pvd
    #[arg(value_name = "FILE", required = true)]
    pub files: Vec<PathBuf>,
    /// Time step: its time where the series has times, or its number from 0 (`#1` where both could be
    /// meant) [default: the first]
    #[arg(long, value_name = "N|T", allow_hyphen_values = true)]
    pub time: Option<String>,
    #[command(flatten)]
    pub raw: RawArgs,
}

/// What raw files do not say themselves.
#[derive(clap::Args, Debug, Default)]
#[command(next_help_heading = "Raw files (and grids without a place of their own)")]
pub struct RawArgs {
    /// Points a side
    #[arg(long, value_name = "XxYxZ", value_parser = values::dimensions)]
    pub dims: Option<[usize; 3]>,
    /// Type of a number: u8 i8 u16 i16 u32 i32 u64 i64 f32 f64
    #[arg(long = "type", value_name = "T")]
    pub scalar_type: Option<ScalarType>,
    /// Byte order
    #[arg(long, value_enum)]
    pub endian: Option<Endian>,
    /// Bytes to skip at the start
    #[arg(long, value_name = "BYTES", visible_alias = "header-bytes")]
    pub offset: Option<usize>,
    /// Components a voxel
    #[arg(long, value_name = "N")]
    pub components: Option<usize>,
    /// Distance between voxels
    #[arg(long, value_name = "X,Y,Z", value_parser = values::triple, allow_hyphen_values = true)]
    pub spacing: Option<[f64; 3]>,
    /// Place of the first voxel
    #[arg(long, value_name = "X,Y,Z", value_parser = values::triple, allow_hyphen_values = true)]
    pub origin: Option<[f64; 3]>,
}

/// Byte orders.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Endian {
    /// Lowest byte first.
    Little,
    /// Highest byte first.
    Big,
}

impl RawArgs {
    fn read_options(&self) -> ReadOptions {
        ReadOptions {
            dimensions: self.dims,
            scalar_type: self.scalar_type,
            big_endian: self.endian.map(|e| e == Endian::Big),
            components: self.components,
            header_bytes: self.offset,
            spacing: self.spacing,
            origin: self.origin,
            step: None,
        }
    }
}

/// One time step.
#[derive(Clone, Debug, PartialEq)]
struct Step {
    path: PathBuf,
    time: Option<f64>,
}

/// A dataset, and where it came from.
pub struct Opened {
    /// The dataset of the chosen time step.
    pub dataset: Dataset,
    /// Its file.
    pub path: PathBuf,
    /// Number of time steps there are.
    pub num_steps: usize,
    /// Which one was chosen, counted from 0.
    pub step: usize,
}

impl InputArgs {
    /// Opens the chosen time step and prints what its reader has to say.
    pub fn open(&self) -> Result<Opened, Failure> {
        if packed::open(self)?.is_some() {
            return Err(Failure::plain(format!(
                "{}: an encoded mesh can be described (info), rendered and sampled, not converted; \
                 take the file that it was encoded from",
                self.files[0].display()
            )));
        }
        let mut steps = Vec::new();
        for file in &self.files {
            steps.extend(expand(file)?);
        }
        let options = self.raw.read_options();
        if let [alone] = steps.as_slice() {
            return self.open_steps_of(&alone.path, options);
        }
        if let Some(opened) = open_stack(&steps, &options)? {
            choose(&[None], self.time.as_deref())?;
            return Ok(opened);
        }
        let times: Vec<Option<f64>> = steps.iter().map(|s| s.time).collect();
        let step = choose(&times, self.time.as_deref())?;
        let path = steps[step].path.clone();
        let dataset = open_dataset(&path, &options)?;
        Ok(Opened::new(dataset, path, steps.len(), step))
    }

    /// Refuses to write over one of the files.
    pub fn refuse_output(&self, path: &Path) -> Result<(), Failure> {
        for file in &self.files {
            output::refuse_input(path, file)?;
            for step in expand(file)? {
                output::refuse_input(path, &step.path)?;
            }
        }
        Ok(())
    }

    /// Opens a time step by its number, among those that [`Self::open`] counted.
    pub fn open_step(&self, step: usize) -> Result<Opened, Failure> {
        let mut steps = Vec::new();
        for file in &self.files {
            steps.extend(expand(file)?);
        }
        let num_steps = steps.len();
        let mut options = self.raw.read_options();
        if let Some(opened) = open_stack(&steps, &options)?.filter(|_| step == 0) {
            return Ok(opened);
        }
        let path = match steps.as_slice() {
            [alone] => {
                options.step = Some(step);
                alone.path.clone()
            }
            steps => match steps.get(step) {
                Some(found) => found.path.clone(),
                None => return Err(Failure::plain(format!("there is no step {step}"))),
            },
        };
        let dataset = open_dataset(&path, &options)?;
        let num_steps = num_steps.max(dataset.times().len());
        Ok(Opened::new(dataset, path, num_steps, step))
    }

    /// Opens the chosen time step of a file that may have several.
    fn open_steps_of(&self, path: &Path, options: ReadOptions) -> Result<Opened, Failure> {
        let mut dataset = open_dataset(path, &options)?;
        let times: Vec<Option<f64>> = match dataset.times() {
            [] => vec![None],
            times => times.iter().copied().map(Some).collect(),
        };
        let step = choose(&times, self.time.as_deref())?;
        if step != dataset.step() {
            let step = Some(step);
            dataset = open_dataset(path, &ReadOptions { step, ..options })?;
        }
        Ok(Opened::new(dataset, path.to_owned(), times.len(), step))
    }
}

impl Opened {
    /// Prints what the reader has to say.
    fn new(dataset: Dataset, path: PathBuf, num_steps: usize, step: usize) -> Self {
        for note in dataset.notes() {
            eprintln!("note: {}: {note}", path.display());
        }
        Self {
            dataset,
            path,
            num_steps,
            step,
        }
    }
}

/// Opens several files that are the slices of one volume rather than steps.
fn open_stack(steps: &[Step], options: &ReadOptions) -> Result<Option<Opened>, Failure> {
    if steps.len() < 2 || steps.iter().any(|step| step.time.is_some()) {
        return Ok(None);
    }
    let paths: Vec<PathBuf> = steps.iter().map(|step| step.path.clone()).collect();
    let dataset = vacua_io::open_stack(&paths, options)?;
    Ok(dataset.map(|dataset| Opened::new(dataset, paths[0].clone(), 1, 0)))
}

/// Opens a file that is no `.vacua` file.
fn open_dataset(path: &Path, options: &ReadOptions) -> Result<Dataset, IoError> {
    vacua_io::open_with(path, options).map_err(vacua::with_own_format)
}

/// The steps that one argument stands for.
fn expand(file: &Path) -> Result<Vec<Step>, Failure> {
    if file.extension().is_some_and(|e| e == "series") && file.is_file() {
        return series(file);
    }
    let text = file.to_string_lossy();
    if file.exists() || !text.contains(['*', '?', '[']) {
        return Ok(vec![Step {
            path: file.to_owned(),
            time: None,
        }]);
    }
    let matches = glob::glob(&text).map_err(|e| Wrong(format!("the pattern `{text}`: {e}")))?;
    let mut paths: Vec<PathBuf> = matches
        .filter_map(Result::ok)
        .filter(|path| path.is_file())
        .collect();
    if paths.is_empty() {
        return Err(Failure::plain(format!(
            "{text}: no file matches this pattern"
        )));
    }
    paths.sort_by_cached_key(|path| natural_key(&path.to_string_lossy()));
    Ok(paths
        .into_iter()
        .map(|path| Step { path, time: None })
        .collect())
}

/// A key by which `step_9` comes before `step_10`: text as it is, numbers by length, then digits.
fn natural_key(text: &str) -> Vec<(String, usize, String)> {
    let mut key = Vec::new();
    let mut rest = text;
    while !rest.is_empty() {
        let digits_at = rest
            .find(|c: char| c.is_ascii_digit())
            .unwrap_or(rest.len());
        let (word, from) = rest.split_at(digits_at);
        let digits_end = from
            .find(|c: char| !c.is_ascii_digit())
            .unwrap_or(from.len());
        let (digits, after) = from.split_at(digits_end);
        let digits = digits.trim_start_matches('0');
        key.push((word.to_owned(), digits.len(), digits.to_owned()));
        rest = after;
    }
    key
}

/// The steps of ParaView's `.series` file: JSON with a list `files` of `name` and `time`.
fn series(file: &Path) -> Result<Vec<Step>, Failure> {
    #[derive(serde::Deserialize)]
    struct Series {
        files: Vec<Entry>,
    }
    #[derive(serde::Deserialize)]
    struct Entry {
        name: PathBuf,
        time: Option<f64>,
    }
    let source = vacua_io::Source::open(file)?;
    let series: Series = serde_json::from_slice(source.bytes())
        .map_err(|e| Failure::plain(format!("{}: {e}", file.display())))?;
    if series.files.is_empty() {
        return Err(Failure::plain(format!(
            "{}: the list `files` is empty",
            file.display()
        )));
    }
    let folder = file.parent().unwrap_or(Path::new(""));
    Ok(series
        .files
        .into_iter()
        .map(|entry| Step {
            path: folder.join(entry.name),
            time: entry.time,
        })
        .collect())
}

/// Which step `--time` means, among the times of all. In a series with times, a number that is a time
/// means that time; a whole number that is none is counted from 0.
pub fn choose(steps: &[Option<f64>], time: Option<&str>) -> Result<usize, Failure> {
    /// Times up to which an error lists them all.
    const LISTED: usize = 20;
    let Some(text) = time else {
        return Ok(0);
    };
    let wrong = || Wrong(format!("--time {text}: expected a time, or a step as `#0`"));
    let (step, number) = match text.trim().strip_prefix('#') {
        Some(number) => (None, Some(number.parse::<usize>().map_err(|_| wrong())?)),
        None => {
            let value: f64 = text.trim().parse().map_err(|_| wrong())?;
            let step = steps.iter().position(|&time| time == Some(value));
            (step, text.trim().parse().ok())
        }
    };
    if let Some(step) = step.or(number.filter(|&n| n < steps.len())) {
        return Ok(step);
    }
    let times: Vec<f64> = steps.iter().copied().flatten().collect();
    let times = match (times.first(), times.last()) {
        (Some(first), Some(last)) if times.len() <= LISTED => {
            let all: Vec<String> = times.iter().map(f64::to_string).collect();
            format!(", at times {first} to {last} ({})", all.join(", "))
        }
        (Some(first), Some(last)) => format!(", at times {first} to {last}"),
        _ => ", without times".to_owned(),
    };
    Err(Failure::plain(format!(
        "--time {text}: there are steps 0 to {}{times}",
        steps.len() - 1
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_sort_as_numbers() {
        let mut names = ["b_10.vti", "a_2.vti", "b_9.vti", "b_010.vti", "b.vti"];
        names.sort_by_cached_key(|name| natural_key(name));
        assert_eq!(
            names,
            ["a_2.vti", "b.vti", "b_9.vti", "b_10.vti", "b_010.vti"]
        );
    }

    #[test]
    fn steps_by_number_and_time() {
        let plain = [None, None];
        assert_eq!(choose(&plain, None).ok(), Some(0));
        assert_eq!(choose(&plain, Some("1")).ok(), Some(1));
        let message = choose(&plain, Some("2")).unwrap_err().to_string();
        assert!(message.contains("steps 0 to 1, without times"), "{message}");
        assert!(choose(&plain, Some("x")).unwrap_err().is_usage());

        let timed = [Some(1.0), Some(0.5), Some(2.5)];
        assert_eq!(choose(&timed, Some("2.5")).ok(), Some(2));
        assert_eq!(choose(&timed, Some("1")).ok(), Some(0));
        assert_eq!(choose(&timed, Some("2")).ok(), Some(2));
        assert_eq!(choose(&timed, Some("#1")).ok(), Some(1));
        assert!(choose(&timed, Some("#0.5")).unwrap_err().is_usage());
        let message = choose(&timed, Some("0.7")).unwrap_err().to_string();
        assert!(message.contains("times 1 to 2.5"), "{message}");
    }
}
