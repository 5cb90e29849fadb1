//! `vacua convert`: from one file format to another.

use std::path::PathBuf;

use clap::builder::{PathBufValueParser, TypedValueParser as _};
use vacua_io::WriteOptions;
use vacua_volume::{ComponentChoice, FieldChoice};

use super::choice::FieldArgs;
use super::input::{InputArgs, RawArgs};
use super::{Failure, output, values};

/// Arguments of `vacua convert`.
#[derive(clap::Args, Debug)]
pub struct ConvertArgs {
    /// The file to read
    #[arg(value_name = "IN")]
    input: PathBuf,
    /// The file to write; its ending says the format
    #[arg(value_name = "OUT", value_parser = PathBufValueParser::new().map(output::place))]
    output: PathBuf,
    /// One field by name, or by number as `#0` [default: all, where the format holds several]
    #[arg(long, value_name = "NAME|#N", value_parser = values::field)]
    field: Option<FieldChoice>,
    /// One component of a field with several, from 0, or `mag` for the magnitude [default: all]
    #[arg(long, value_name = "N|mag", value_parser = values::component)]
    component: Option<ComponentChoice>,
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
    output::check_dataset_format(&args.output)?;
    input.refuse_output(&args.output)?;
    let opened = input.open()?;
    let field = FieldArgs {
        field: args.field,
        component: args.component,
    };
    let dataset = field.dataset(&opened)?;
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
