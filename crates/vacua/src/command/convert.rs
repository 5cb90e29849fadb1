//! `vacua convert`: from one file format to another.

use std::path::PathBuf;

use clap::builder::{PathBufValueParser, TypedValueParser as _};
use vacua_io::WriteOptions;
use vacua_volume::FieldChoice;

use super::choice::FieldArgs;
use super::input::{InputArgs, RawArgs};
use super::{Failure, output};

/// Arguments of `vacua convert`.
#[derive(clap::Args, Debug)]
pub struct ConvertArgs {
    /// The file to read
    #[arg(value_name = "IN")]
    input: PathBuf,
    /// The file to write; its ending says the format
    #[arg(value_name = "OUT", value_parser = PathBufValueParser::new().map(output::place))]
    output: PathBuf,
    #[command(flatten)]
    field: FieldArgs,
    /// Time step: its number from 0, or its time [default: the first]
    #[arg(long, value_name = "N|T", allow_hyphen_values = true)]
    time: Option<String>,
    /// Compress, where the format can
    #[arg(long)]
    compress: bool,
    #[command(flatten)]
    raw: RawArgs,
}

/// Runs `vacua convert`.
pub fn run(args: ConvertArgs) -> Result<(), Failure> {
    let input = InputArgs {
        files: vec![args.input],
        time: args.time,
        raw: args.raw,
    };
    output::refuse_standard_output(&args.output)?;
    input.refuse_output(&args.output)?;
    let opened = input.open()?;
    let dataset = args.field.dataset(&opened)?;
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
