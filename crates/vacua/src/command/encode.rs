//! `vacua encode`: a mesh into a `.vacua` file, and what that takes.

use std::path::PathBuf;
use std::time::Instant;

use serde::Serialize;
use vacua_pack::file::write_file;
use vacua_pack::{EncodeOptions, Encoded, PackedField, Variant, encode};
use vacua_volume::{CellType, ComponentChoice, Dataset, FieldChoice, UnstructuredMesh};

use super::input::InputArgs;
use super::packed::{Bytes, Memory, bytes_text, cells_by_name};
use super::{Failure, Wrong, output};

/// Arguments of `vacua encode`.
#[derive(clap::Args, Debug)]
pub struct EncodeArgs {
    #[command(flatten)]
    input: InputArgs,
    /// The file to write
    #[arg(short, long, value_name = "OUT.vacua")]
    output: PathBuf,
    /// Layout of the tree: 1, multi-leaves under one outer tree; 2, inner nodes in the same format
    #[arg(long, value_name = "1|2", default_value = "2", value_parser = variant)]
    variant: Variant,
    /// Bits of an index: sub-meshes have at most two to this many vertices
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u32).range(8..=32))]
    index_bits: u32,
    /// Fields to bring along, separated by commas; NAME:0 or NAME:mag for one component
    /// [default: all]
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    fields: Option<Vec<String>>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

fn variant(text: &str) -> Result<Variant, String> {
    match text {
        "1" => Ok(Variant::MultiLeaves),
        "2" => Ok(Variant::MultiNodes),
        _ => Err("expected 1 or 2".to_owned()),
    }
}

/// What `vacua encode --json` prints.
#[derive(Serialize)]
struct Report {
    file: String,
    output: String,
    variant: u8,
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
    load: f64,
    partition: f64,
    submeshes: f64,
    outer: f64,
    fields: f64,
    write: f64,
}

/// Runs `vacua encode`.
pub fn run(args: &EncodeArgs) -> Result<(), Failure> {
    let start = Instant::now();
    let opened = args.input.open()?;
    let dataset = &opened.dataset;
    let mesh = dataset.mesh().ok_or_else(|| {
        Failure::plain(format!(
            "{}: a {} grid; only meshes are encoded",
            opened.path.display(),
            dataset.geometry().kind()
        ))
    })?;
    let choices = choices(dataset, args.fields.as_deref())?;
    let load = start.elapsed().as_secs_f64();
    let options = EncodeOptions {
        variant: args.variant,
        index_bits: args.index_bits,
    };
    let encoded = output::during("encoding the mesh", || encode(mesh, options))
        .map_err(|e| Failure::contents(&opened.path, e))?;

    let start = Instant::now();
    let mut fields = Vec::new();
    for (name, choice, component) in &choices {
        let message = format!("packing field `{name}`");
        let packed = output::during(&message, || -> Result<PackedField, Failure> {
            let fail = |e| Failure::contents(&opened.path, e);
            let volume = dataset.volume(choice, *component).map_err(fail)?;
            PackedField::pack(
                &encoded.mesh,
                &encoded.map,
                name,
                volume.association(),
                volume.scalars(),
            )
            .map_err(|e| Failure::contents(&opened.path, e))
        });
        fields.push(packed?);
    }
    let fields_secs = start.elapsed().as_secs_f64();
    let start = Instant::now();
    output::during("writing", || {
        write_file(&args.output, &encoded.mesh, &fields)
    })?;
    let write = start.elapsed().as_secs_f64();
    let secs = Secs {
        load,
        partition: encoded.report.partition_secs,
        submeshes: encoded.report.submeshes_secs,
        outer: encoded.report.outer_secs,
        fields: fields_secs,
        write,
    };
    let report = report(
        args,
        &opened.path.display().to_string(),
        mesh,
        &encoded,
        &fields,
        secs,
    );
    if args.json {
        output::print_json(&report)
    } else {
        output::print(&as_text(&report))
    }
}

/// A field to be packed: its name there, which it is, and which component.
type Choice = (String, FieldChoice, ComponentChoice);

/// The fields that are asked for; all of them without a wish.
fn choices(dataset: &Dataset, wanted: Option<&[String]>) -> Result<Vec<Choice>, Failure> {
    let Some(wanted) = wanted else {
        let all = dataset.fields().iter().enumerate().map(|(i, field)| {
            let component = ComponentChoice::Auto;
            if field.components() > 1 {
                let name = field.name();
                eprintln!(
                    "note: field `{name}` has {} components; its magnitude is packed (--fields {name}:0 packs the first)",
                    field.components()
                );
            }
            (field.name().to_owned(), FieldChoice::Index(i), component)
        });
        return Ok(all.collect());
    };
    let mut found = Vec::new();
    for text in wanted.iter().filter(|text| !text.is_empty()) {
        let is_field = |name: &str| dataset.fields().iter().any(|f| f.name() == name);
        let (name, component) = match text.rsplit_once(':') {
            Some((name, component)) if !is_field(text) => {
                let component = super::values::component(component)
                    .map_err(|e| Wrong(format!("--fields {text}: {e}")))?;
                (name, component)
            }
            _ => (text.as_str(), ComponentChoice::Auto),
        };
        let choice = FieldChoice::Name(name.to_owned());
        dataset
            .field(&choice)
            .map_err(|e| Failure::Other(Box::new(e)))?;
        found.push((text.clone(), choice, component));
    }
    Ok(found)
}

fn report(
    args: &EncodeArgs,
    file: &str,
    mesh: &UnstructuredMesh,
    encoded: &Encoded,
    fields: &[PackedField],
    secs: Secs,
) -> Report {
    let packed = &encoded.mesh;
    let indices: u64 = CellType::ALL
        .into_iter()
        .zip(mesh.num_cells_by_type())
        .map(|(cell_type, n)| (cell_type.num_points() * n) as u64)
        .sum();
    let encode_secs = secs.partition + secs.submeshes + secs.outer;
    let memory = Memory::new(
        packed.num_cells_by_type(),
        packed.num_vertices() as u64,
        packed.submeshes().len() as u64,
        packed.nodes().len() as u64,
        Bytes::new(packed.bytes(), fields.iter().map(PackedField::bytes)),
        fields.iter().map(|f| f.name().to_owned()).collect(),
    );
    Report {
        file: file.to_owned(),
        output: args.output.display().to_string(),
        variant: match args.variant {
            Variant::MultiLeaves => 1,
            Variant::MultiNodes => 2,
        },
        index_bits: args.index_bits,
        input: InputReport {
            points: mesh.num_points(),
            cells: cells_by_name(mesh.num_cells_by_type().map(|n| n as u64)),
            decoded_bytes: 12 * mesh.num_points() as u64 + 4 * indices,
        },
        cells_a_sec: packed.num_cells() as f64 / encode_secs.max(f64::MIN_POSITIVE),
        memory,
        blanked_cells: encoded.report.num_blanked,
        not_finite_cells: encoded.report.num_not_finite,
        worst_rounding: encoded.report.worst_rounding,
        file_bytes: std::fs::metadata(&args.output).map_or(0, |m| m.len()),
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
        "  {:.2} M cells/s: partition {:.2} s, sub-meshes {:.2} s, outer tree {:.2} s; fields {:.2} s, writing {:.2} s; file {}",
        report.cells_a_sec / 1e6,
        s.partition,
        s.submeshes,
        s.outer,
        s.fields,
        s.write,
        bytes_text(report.file_bytes),
    ));
    lines.join("\n")
}
