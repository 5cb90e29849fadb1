//! `vacua synth`: procedural volumes and meshes.

use std::path::PathBuf;

use clap::builder::{PathBufValueParser, PossibleValuesParser, TypedValueParser as _};
use vacua_io::WriteOptions;
use vacua_synth::{Kind, MeshKind, MeshSpec, MeshValues, Spec};
use vacua_volume::{Dataset, FieldChoice, ScalarType};

use super::{Failure, Wrong, output};

/// What can be made.
#[derive(Clone, Copy, Debug)]
enum AnyKind {
    Volume(Kind),
    Mesh(MeshKind),
}

impl std::str::FromStr for AnyKind {
    type Err = vacua_synth::UnknownKind;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        match name.parse() {
            Ok(kind) => Ok(Self::Mesh(kind)),
            Err(_) => name.parse().map(Self::Volume),
        }
    }
}

fn names() -> impl Iterator<Item = &'static str> {
    let meshes = MeshKind::ALL.map(MeshKind::name);
    Kind::ALL.map(Kind::name).into_iter().chain(meshes)
}

/// Arguments of `vacua synth`.
#[derive(clap::Args, Debug)]
pub struct SynthArgs {
    /// What to make
    #[arg(value_name = "KIND", value_parser = PossibleValuesParser::new(names()).try_map(|name| name.parse::<AnyKind>()))]
    kind: AnyKind,
    /// Points a side, one number for a cube; of a mesh cubes a side, of five, six or (lander) twenty cells
    /// [default: the kind's own size]
    #[arg(long, value_name = "N|XxYxZ", value_parser = vacua_synth::parse_size)]
    size: Option<[usize; 3]>,
    /// Type of a number: u8 i8 u16 i16 u32 i32 u64 i64 f32 f64 [default: the kind's own]
    #[arg(long = "type", value_name = "T")]
    scalar_type: Option<ScalarType>,
    /// The file to write; its ending says the format
    #[arg(short, long, value_name = "FILE", value_parser = PathBufValueParser::new().map(output::place))]
    output: PathBuf,
    /// Compress, where the format can
    #[arg(long)]
    compress: bool,
    #[command(flatten)]
    mesh: MeshArgs,
}

/// What is done to meshes.
#[derive(clap::Args, Debug)]
#[command(next_help_heading = "Meshes")]
struct MeshArgs {
    /// The field: a bump and a wave, or a linear function of the position in f64
    #[arg(long, value_enum, default_value = "wave")]
    values: Values,
    /// Move points by up to this part of the distance to their neighbours
    #[arg(long, value_name = "F", default_value_t = 0.0, value_parser = share)]
    jitter: f64,
    /// Take this part of the cells away
    #[arg(long, value_name = "F", default_value_t = 0.0, value_parser = share)]
    holes: f64,
    /// Add so many nearly flat tetrahedra
    #[arg(long, value_name = "N", default_value_t = 0)]
    slivers: usize,
    /// Points and cells in random order
    #[arg(long)]
    shuffle: bool,
    /// Seed of everything random
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

/// Fields of meshes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Values {
    /// A bump and a wave.
    Wave,
    /// A linear function of the position.
    Linear,
}

fn share(text: &str) -> Result<f64, String> {
    let number: Option<f64> = text.parse().ok();
    number
        .filter(|v| (0.0..=1.0).contains(v))
        .ok_or_else(|| "expected a number from 0 to 1".to_owned())
}

/// Runs `vacua synth`.
pub fn run(args: &SynthArgs) -> Result<(), Failure> {
    output::check_dataset_format(&args.output)?;
    let dataset = match args.kind {
        AnyKind::Volume(kind) => volume(args, kind)?,
        AnyKind::Mesh(kind) => mesh(args, kind)?,
    };
    let options = WriteOptions {
        field: FieldChoice::Only,
        compress: args.compress,
    };
    let lost = output::during("writing", || {
        vacua_io::save(&args.output, &dataset, &options)
    })?;
    for note in lost {
        eprintln!("note: {}: {note}", args.output.display());
    }
    Ok(())
}

fn volume(args: &SynthArgs, kind: Kind) -> Result<Dataset, Failure> {
    let mut spec = Spec::new(kind);
    if let Some(points) = args.size {
        spec = spec.with_points(points);
    }
    if let Some(scalar_type) = args.scalar_type {
        spec = spec.with_type(scalar_type);
    }
    output::during("computing", || vacua_synth::generate(&spec))
        .map_err(|e| Failure::Other(Box::new(e)))
}

fn mesh(args: &SynthArgs, kind: MeshKind) -> Result<Dataset, Failure> {
    let size = match args.size {
        None => kind.default_size(),
        Some([x, y, z]) if x == y && y == z => x,
        Some(_) => {
            return Err(Wrong(format!("--size: {kind} takes one number")).into());
        }
    };
    if args.scalar_type.is_some() {
        return Err(Wrong(format!("--type: the values of {kind} have their own type")).into());
    }
    let spec = MeshSpec {
        size,
        values: match args.mesh.values {
            Values::Wave => MeshValues::Wave,
            Values::Linear => MeshValues::Linear,
        },
        jitter: args.mesh.jitter,
        holes: args.mesh.holes,
        num_slivers: args.mesh.slivers,
        shuffled: args.mesh.shuffle,
        seed: args.mesh.seed,
        ..MeshSpec::new(kind)
    };
    output::during("computing", || vacua_synth::generate_mesh(&spec))
        .map_err(|e| Failure::Other(Box::new(e)))
}
