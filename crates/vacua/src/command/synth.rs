//! `vacua synth`: procedural volumes.

use std::path::PathBuf;

use clap::builder::{PossibleValuesParser, TypedValueParser as _};
use vacua_io::WriteOptions;
use vacua_synth::{Kind, Spec};
use vacua_volume::{FieldChoice, ScalarType};

use super::{Failure, output};

/// Arguments of `vacua synth`.
#[derive(clap::Args, Debug)]
pub struct SynthArgs {
    /// What to make
    #[arg(value_name = "KIND", value_parser = PossibleValuesParser::new(Kind::ALL.map(Kind::name)).try_map(|name| name.parse::<Kind>()))]
    kind: Kind,
    /// Points a side, one number for a cube [default: the kind's own size]
    #[arg(long, value_name = "N|XxYxZ", value_parser = vacua_synth::parse_size)]
    size: Option<[usize; 3]>,
    /// Type of a number: u8 i8 u16 i16 u32 i32 u64 i64 f32 f64 [default: the kind's own]
    #[arg(long = "type", value_name = "T")]
    scalar_type: Option<ScalarType>,
    /// The file to write; its ending says the format
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Compress, where the format can
    #[arg(long)]
    compress: bool,
}

/// Runs `vacua synth`.
pub fn run(args: &SynthArgs) -> Result<(), Failure> {
    let mut spec = Spec::new(args.kind);
    if let Some(points) = args.size {
        spec = spec.with_points(points);
    }
    if let Some(scalar_type) = args.scalar_type {
        spec = spec.with_type(scalar_type);
    }
    let dataset = output::during("computing", || vacua_synth::generate(&spec))
        .map_err(|e| Failure::Other(Box::new(e)))?;
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
