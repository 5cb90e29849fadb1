//! `vacua sample`: values at points.

use std::fs::File;
use std::io::{BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use clap::builder::{PathBufValueParser, TypedValueParser as _};
use glam::DVec3;
use rayon::prelude::*;
use vacua::Detail;
use vacua_io::write_atomically;
use vacua_pack::{DetailLevel, Estimate, PackedVolume};
use vacua_render::VolumeSampler;

use super::Failure;
use super::choice::FieldArgs;
use super::input::InputArgs;
use super::packed;
use super::points::{Columns, PointReader, write_estimate, write_header, write_value};
use super::{Wrong, output, values};

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
    /// What is taken for the values of an encoded mesh: submesh, multileaf, leaf (a further column then
    /// says how far the exact value may be) or exact
    #[arg(long, value_name = "LEVEL", value_parser = values::detail, default_value = "exact")]
    lod: Detail,
    /// The values as CSV [default: standard output, also `-`]
    #[arg(short, long, value_name = "OUT.csv", value_parser = PathBufValueParser::new().map(output::place))]
    output: Option<PathBuf>,
}

/// Runs `vacua sample`.
pub fn run(args: &SampleArgs) -> Result<(), Failure> {
    if let Some(path) = &args.output {
        args.input.refuse_output(path)?;
        output::refuse_input(path, &args.points)?;
    }
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
    /// The same at a level of detail.
    Estimates(Box<PackedVolume>, DetailLevel),
}

/// What is said of the points of a piece.
enum Sampled {
    /// Values.
    Values(Vec<Option<f64>>),
    /// Values and their bounds.
    Estimates(Vec<Option<Estimate>>),
}

impl Sampler {
    fn open(args: &SampleArgs) -> Result<Self, Failure> {
        if let Some(file) = packed::open(&args.input)? {
            let volume = packed::volume(&file, &args.input, &args.field)?;
            return Ok(match args.lod {
                Detail::Exact => Self::Packed(Box::new(volume)),
                Detail::Level(level) => Self::Estimates(Box::new(volume), level),
            });
        }
        if args.lod != Detail::Exact {
            return Err(Wrong(format!(
                "--lod {}: only encoded meshes have levels of detail (vacua encode makes one)",
                args.lod.name()
            ))
            .into());
        }
        let opened = args.input.open()?;
        let volume = args.field.volume(&opened)?;
        VolumeSampler::new(&volume)
            .map(Self::Volume)
            .map_err(|e| Failure::contents(&opened.path, e))
    }

    fn at(&self, points: &[DVec3]) -> Sampled {
        match self {
            Self::Volume(sampler) => {
                Sampled::Values(points.par_iter().map(|&p| sampler.sample(p)).collect())
            }
            Self::Packed(values) => Sampled::Values(values.values_at(points)),
            Self::Estimates(values, level) => {
                Sampled::Estimates(values.estimates_at(*level, points))
            }
        }
    }

    fn columns(&self) -> Columns {
        match self {
            Self::Estimates(..) => Columns::Bounds,
            _ => Columns::Values,
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
    write_header(out, sampler.columns()).map_err(io)?;
    loop {
        let points = reader.read(CHUNK).map_err(|e| Failure::contents(path, e))?;
        if points.is_empty() {
            return out.flush().map_err(io);
        }
        match sampler.at(&points) {
            Sampled::Values(values) => {
                for (point, value) in points.iter().zip(values) {
                    write_value(out, *point, value).map_err(io)?;
                }
            }
            Sampled::Estimates(estimates) => {
                for (point, estimate) in points.iter().zip(estimates) {
                    write_estimate(out, *point, estimate).map_err(io)?;
                }
            }
        }
    }
}
