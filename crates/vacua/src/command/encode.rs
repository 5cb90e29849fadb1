//! `vacua encode`: a mesh into a `.vacua` file, and what that takes.

mod fields;
mod progress;
mod update;

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::builder::{PathBufValueParser, TypedValueParser as _};
use serde::Serialize;
use vacua_pack::file::{EncodeFileError, FieldInput, FileOptions, FileReport, encode_file};
use vacua_pack::{EncodeOptions, Variant};
use vacua_volume::{CellType, UnstructuredMesh};

use super::input::InputArgs;
use super::packed::{Bytes, Memory, VariantName, bytes_text, cells_by_name};
use super::{Failure, Wrong, output, values};
use progress::Progress;

/// Arguments of `vacua encode`.
#[derive(clap::Args, Debug)]
pub struct EncodeArgs {
    #[command(flatten)]
    input: InputArgs,
    /// The file to write; with --update, that file if not given
    #[arg(
        short,
        long,
        value_name = "OUT.vacua",
        value_parser = PathBufValueParser::new().map(output::place),
        required_unless_present = "update"
    )]
    output: Option<PathBuf>,
    /// Layout: 1, multi-leaves under one outer tree; 2, inner nodes in the same format; small, half
    /// the bytes of 2 (clusters that are decoded when they are needed), the same numbers
    #[arg(long, value_name = "1|2|small", default_value = "2", value_parser = variant)]
    variant: Variant,
    /// Bits of an index: sub-meshes have at most two to this many vertices; at most 24 in variant
    /// small, whose indices are shorter than that
    #[arg(long, visible_alias = "vertices-log2", value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u32).range(8..=32))]
    index_bits: u32,
    /// Fields to bring along, separated by commas, vectors with each component and the magnitude;
    /// NAME:0 or NAME:mag for one component or the magnitude alone [default: all]
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    fields: Option<Vec<String>>,
    /// The fields of all time steps, on the one mesh
    #[arg(long, conflicts_with = "time")]
    all_steps: bool,
    /// Also write the map from packed to original order, with which fields are added later
    #[arg(long)]
    keep_map: bool,
    /// Use at most so much memory, mapped files not counted; what is more goes to temporary files
    /// beside the output
    #[arg(long, visible_alias = "memory", value_name = "2GiB", value_parser = values::num_bytes)]
    memory_budget: Option<u64>,
    /// Add or swap the fields of FILE, which has the same mesh, in this file written with --keep-map
    #[arg(long, value_name = "ENCODED.vacua", conflicts_with_all = ["variant", "index_bits", "keep_map", "memory_budget"])]
    update: Option<PathBuf>,
    /// Threads [default: all there are]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

fn variant(text: &str) -> Result<Variant, String> {
    match text {
        "1" => Ok(Variant::MultiLeaves),
        "2" => Ok(Variant::MultiNodes),
        "small" => Ok(Variant::Small),
        _ => Err("expected 1, 2 or small".to_owned()),
    }
}

/// What `vacua encode --json` prints.
#[derive(Serialize)]
struct Report {
    file: String,
    output: String,
    variant: VariantName,
    index_bits: u32,
    input: InputReport,
    #[serde(flatten)]
    memory: Memory,
    /// Cells left out: blanked ones, and those with a position that is not finite.
    blanked_cells: usize,
    not_finite_cells: usize,
    /// The largest distance along an axis by which a stored position is off.
    worst_rounding: f64,
    file_bytes: u64,
    secs: Secs,
    cells_a_sec: f64,
    peak_bytes: Option<u64>,
}

#[derive(Serialize)]
struct InputReport {
    points: usize,
    cells: serde_json::Map<String, serde_json::Value>,
    /// Positions as `f32` and indices of 32 bits.
    decoded_bytes: u64,
}

/// Seconds by stage.
#[derive(Serialize)]
struct Secs {
    /// The mesh, its checks, and fields that are not mapped.
    load: f64,
    partition: f64,
    /// With their fields.
    submeshes: f64,
    outer: f64,
    write: f64,
}

/// Checks that the output is named as a `.vacua` file and is none of the inputs.
fn check_output(args: &EncodeArgs, path: &Path) -> Result<(), Failure> {
    if !output::is_named_vacua(path) {
        return Err(Wrong(format!(
            "{}: encoded meshes are written to files whose names end in .vacua",
            path.display()
        ))
        .into());
    }
    args.input.refuse_output(path)
}

/// Runs `vacua encode`.
pub fn run(args: &EncodeArgs) -> Result<(), Failure> {
    if let Some(path) = &args.output {
        check_output(args, path)?;
    }
    let Some(threads) = args.threads else {
        return encode(args);
    };
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(usize::from(threads))
        .build()
        .map_err(|e| Failure::Other(Box::new(e)))?;
    pool.install(|| encode(args))
}

/// Does so on the threads at hand.
fn encode(args: &EncodeArgs) -> Result<(), Failure> {
    if let Some(target) = &args.update {
        return update::run(args, target);
    }
    let Some(path) = &args.output else {
        return Err(Failure::plain("no file to write".to_owned()));
    };
    let start = Instant::now();
    let opened = args.input.open()?;
    let mesh = opened.dataset.mesh().ok_or_else(|| {
        Failure::plain(format!(
            "{}: a {} grid; only meshes are encoded",
            opened.path.display(),
            opened.dataset.geometry().kind()
        ))
    })?;
    let fields = if args.all_steps {
        fields::load_all_steps(&args.input, &opened, mesh, args.fields.as_deref())?
    } else {
        fields::load(&opened, args.fields.as_deref(), None)?
    };
    let load = start.elapsed().as_secs_f64();
    let options = FileOptions {
        encode: EncodeOptions {
            variant: args.variant,
            index_bits: args.index_bits,
        },
        keep_map: args.keep_map,
        cells_in_memory: None,
    };
    let options = match args.memory_budget {
        None => options,
        Some(bytes) => options.with_memory_budget(bytes, mesh).map_err(|least| {
            Failure::plain(format!(
                "{}: cannot be encoded within {}; {} are needed with {} threads (--threads 1 needs less)",
                opened.path.display(),
                bytes_text(bytes),
                bytes_text(least),
                rayon::current_num_threads()
            ))
        })?,
    };
    let progress = Progress::new();
    let written = encode_file(path, mesh, &fields, options, &|p| progress.show(p));
    progress.finish();
    let written = written.map_err(|error| match error {
        EncodeFileError::Io(error) => Failure::from(error),
        other => Failure::contents(&opened.path, other),
    })?;
    let file = opened.path.display().to_string();
    let report = report(args, &file, mesh, &fields, &written, load);
    if args.json {
        output::print_json(&report)
    } else {
        output::print(&as_text(&report))
    }
}

fn report(
    args: &EncodeArgs,
    file: &str,
    mesh: &UnstructuredMesh,
    fields: &[FieldInput],
    written: &FileReport,
    load: f64,
) -> Report {
    let indices: u64 = CellType::ALL
        .into_iter()
        .zip(mesh.num_cells_by_type())
        .map(|(cell_type, n)| (cell_type.num_points() * n) as u64)
        .sum();
    let encode = &written.encode;
    let secs = Secs {
        load,
        partition: encode.partition_secs,
        submeshes: encode.submeshes_secs,
        outer: encode.outer_secs,
        write: written.write_secs,
    };
    let encode_secs = secs.partition + secs.submeshes + secs.outer;
    let num_cells: u64 = written.num_cells_by_type.iter().sum();
    let bytes = Bytes::new(written.bytes, written.fields.iter().copied());
    let output = args.output.clone().unwrap_or_default();
    Report {
        file: file.to_owned(),
        output: output.display().to_string(),
        variant: args.variant.into(),
        index_bits: args.index_bits,
        input: InputReport {
            points: mesh.num_points(),
            cells: cells_by_name(mesh.num_cells_by_type().map(|n| n as u64)),
            decoded_bytes: 12 * mesh.num_points() as u64 + 4 * indices,
        },
        cells_a_sec: num_cells as f64 / encode_secs.max(f64::MIN_POSITIVE),
        memory: Memory::new(
            written.num_cells_by_type,
            written.num_vertices,
            written.num_submeshes,
            written.num_nodes,
            bytes.with_map(written.map_bytes),
            fields.iter().map(|f| f.name.clone()).collect(),
        ),
        blanked_cells: encode.num_blanked,
        not_finite_cells: encode.num_not_finite,
        worst_rounding: encode.worst_rounding,
        file_bytes: std::fs::metadata(&output).map_or(0, |m| m.len()),
        secs,
        peak_bytes: output::peak_bytes(),
    }
}

fn as_text(report: &Report) -> String {
    let mut lines = vec![format!(
        "{} → {}, variant {}, {} index bits",
        report.file, report.output, report.variant, report.index_bits
    )];
    lines.push(format!(
        "  input: {} points, {}",
        report.input.points,
        report.memory.cells_text()
    ));
    lines.extend(report.memory.table());
    if report.blanked_cells > 0 {
        lines.push(format!("  {} blanked cells left out", report.blanked_cells));
    }
    if report.not_finite_cells > 0 {
        lines.push(format!(
            "  {} cells without a finite place left out",
            report.not_finite_cells
        ));
    }
    if report.worst_rounding > 0.0 {
        lines.push(format!(
            "  positions are rounded by at most {:.3e}",
            report.worst_rounding
        ));
    }
    let s = &report.secs;
    lines.push(format!(
        "  {:.2} M cells/s: partition {:.2} s, sub-meshes with fields {:.2} s, outer tree {:.2} s; writing {:.2} s; file {}",
        report.cells_a_sec / 1e6,
        s.partition,
        s.submeshes,
        s.outer,
        s.write,
        bytes_text(report.file_bytes),
    ));
    lines.join("\n")
}
