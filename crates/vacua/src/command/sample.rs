//! `vacua sample`: values at points.

use std::fs::File;
use std::io::{BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use glam::DVec3;
use rayon::prelude::*;
use vacua_io::write_atomically;
use vacua_pack::PackedVolume;
use vacua_render::VolumeSampler;

use super::Failure;
use super::choice::FieldArgs;
use super::input::InputArgs;
use super::packed;
use super::points::{PointReader, write_header, write_value};

/// Points that are sampled at once.
const CHUNK: usize = 1 << 16;

/// Arguments of `vacua sample`.
#[derive(clap::Args, Debug)]
pub struct SampleArgs {
    #[command(flatten)]
    input: InputArgs,
    #[command(flatten)]
    field: FieldArgs,
    /// Where: CSV with columns x, y, z; `-` for standard input
    #[arg(long, value_name = "P.csv")]
    points: PathBuf,
    /// The values as CSV [default: standard output]
    #[arg(short, long, value_name = "OUT.csv")]
    output: Option<PathBuf>,
}

/// Runs `vacua sample`.
pub fn run(args: &SampleArgs) -> Result<(), Failure> {
    let sampler = Sampler::open(args)?;
    let points = open(&args.points)?;
    match &args.output {
        Some(path) => {
            // What is wrong with the points is no trouble of the file that is written.
            let mut trouble = None;
            let written = write_atomically(path, |out| {
                sample(&sampler, points, &args.points, out).map_err(|failure| {
                    trouble = Some(failure);
                    std::io::Error::other("no values")
                })
            });
            match trouble {
                Some(failure) => Err(failure),
                None => Ok(written?),
            }
        }
        None => {
            let mut out = BufWriter::new(std::io::stdout().lock());
            sample(&sampler, points, &args.points, &mut out)
        }
    }
}

/// What gives the values.
enum Sampler {
    /// A dataset as it came.
    Volume(VolumeSampler),
    /// A `.vacua` file.
    Packed(Box<PackedVolume>),
}

impl Sampler {
    fn open(args: &SampleArgs) -> Result<Self, Failure> {
        if let Some(file) = packed::open(&args.input)? {
            let volume = packed::volume(&file, &args.input.files[0], &args.field)?;
            return Ok(Self::Packed(Box::new(volume)));
        }
        let opened = args.input.open()?;
        let volume = args.field.volume(&opened)?;
        VolumeSampler::new(&volume)
            .map(Self::Volume)
            .map_err(|e| Failure::contents(&opened.path, e))
    }

    fn at(&self, points: &[DVec3]) -> Vec<Option<f64>> {
        match self {
            Self::Volume(sampler) => points.par_iter().map(|&p| sampler.sample(p)).collect(),
            Self::Packed(values) => values.values_at(points),
        }
    }
}

/// The points' file.
fn open(path: &Path) -> Result<Box<dyn Read>, Failure> {
    if path == Path::new("-") {
        return Ok(Box::new(std::io::stdin().lock()));
    }
    let file = File::open(path).map_err(|e| Failure::contents(path, e))?;
    Ok(Box::new(file))
}

/// Reads points and writes values, in order.
fn sample(
    sampler: &Sampler,
    points: Box<dyn Read>,
    path: &Path,
    out: &mut impl Write,
) -> Result<(), Failure> {
    let io = |e: std::io::Error| Failure::plain(format!("cannot write values: {e}"));
    let mut reader = PointReader::new(points).map_err(|e| Failure::contents(path, e))?;
    write_header(out).map_err(io)?;
    loop {
        let points = reader.read(CHUNK).map_err(|e| Failure::contents(path, e))?;
        if points.is_empty() {
            return out.flush().map_err(io);
        }
        let values = sampler.at(&points);
        for (point, value) in points.iter().zip(values) {
            write_value(out, *point, value).map_err(io)?;
        }
    }
}
