//! `vacua encode --update`: fields of a file added to, or swapped in, a `.vacua` file of the same mesh.

use std::path::Path;
use std::time::Instant;

use serde::Serialize;
use vacua_pack::file::{PackedFile, UpdateError};

use super::super::packed::bytes_text;
use super::super::{Failure, output};
use super::{EncodeArgs, fields};

/// What `vacua encode --update --json` prints.
#[derive(Serialize)]
struct Report {
    file: String,
    output: String,
    added: Vec<String>,
    swapped: Vec<String>,
    kept: Vec<String>,
    /// Values of the input that were brought into packed order, and their ranges found.
    values: u64,
    secs: Secs,
    values_a_sec: f64,
    file_bytes: u64,
    peak_bytes: Option<u64>,
}

#[derive(Serialize)]
struct Secs {
    load: f64,
    map: f64,
    pack: f64,
    write: f64,
}

/// Runs `vacua encode --update`.
pub fn run(args: &EncodeArgs, target: &Path) -> Result<(), Failure> {
    let start = Instant::now();
    let opened = args.input.open()?;
    let mesh = opened.dataset.mesh().ok_or_else(|| {
        let path = opened.path.display();
        Failure::plain(format!("{path}: no mesh, nothing to add fields from"))
    })?;
    let inputs = if args.all_steps {
        fields::load_all_steps(&args.input, &opened, mesh, args.fields.as_deref())?
    } else {
        fields::load(&opened, args.fields.as_deref(), None)?
    };
    let file = PackedFile::open(target)?;
    let packed = file.mesh()?;
    let load = start.elapsed().as_secs_f64();
    let out = args.output.as_deref().unwrap_or(target);
    let updated = output::during("updating", || file.update(out, &packed, &inputs));
    let updated = updated.map_err(|error| match error {
        UpdateError::Io(error) => error.into(),
        UpdateError::NoMap => Failure::plain(format!(
            "{}: {error}; encode the mesh again with --keep-map",
            target.display()
        )),
        error => Failure::contents(target, error),
    })?;
    let report = Report {
        file: opened.path.display().to_string(),
        output: out.display().to_string(),
        values_a_sec: updated.num_values as f64
            / (updated.map_secs + updated.pack_secs).max(f64::MIN_POSITIVE),
        added: updated.added,
        swapped: updated.swapped,
        kept: updated.kept,
        values: updated.num_values,
        secs: Secs {
            load,
            map: updated.map_secs,
            pack: updated.pack_secs,
            write: updated.write_secs,
        },
        file_bytes: std::fs::metadata(out).map_or(0, |m| m.len()),
        peak_bytes: output::peak_bytes(),
    };
    if args.json {
        return output::print_json(&report);
    }
    let list = |what: &str, names: &[String]| match names {
        [] => String::new(),
        names => format!("\n  {what}: {}", names.join(", ")),
    };
    output::print(&format!(
        "{} → {}{}{}{}\n  {:.1} M values/s: map {:.3} s, values and ranges {:.3} s; writing {:.2} s; file {}",
        report.file,
        report.output,
        list("swapped", &report.swapped),
        list("added", &report.added),
        list("kept", &report.kept),
        report.values_a_sec / 1e6,
        report.secs.map,
        report.secs.pack,
        report.secs.write,
        bytes_text(report.file_bytes),
    ))
}
