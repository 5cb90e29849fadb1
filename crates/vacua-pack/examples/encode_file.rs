//! Encodes a mesh file into a `.vacua` file, within a memory budget if one is given: for measuring.
//!
//! `encode_file MESH OUT.vacua [VARIANT] [BITS] [BUDGET_MIB]`; a budget of 0 is none.
#![allow(clippy::print_stdout, reason = "a program for people at a terminal")]

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use vacua_pack::file::{FieldInput, FieldLabel, FileOptions, PackedFile, encode_file};
use vacua_pack::{EncodeOptions, PackedField, Variant};
use vacua_volume::{ComponentChoice, FieldChoice};

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [mesh, out, rest @ ..] = args.as_slice() else {
        return Err("usage: encode_file MESH OUT.vacua [VARIANT] [BITS] [BUDGET_MIB]".into());
    };
    let start = Instant::now();
    let dataset = vacua_io::open(Path::new(mesh))?;
    let mesh = dataset.mesh().ok_or("no mesh")?;
    let mut fields = Vec::new();
    for (i, field) in dataset.fields().iter().enumerate() {
        let volume = dataset.volume(&FieldChoice::Index(i), ComponentChoice::Auto)?;
        fields.push(FieldInput {
            name: field.name().to_owned(),
            association: volume.association(),
            values: volume.scalars().clone(),
            label: FieldLabel::default(),
        });
    }
    let options = FileOptions {
        encode: EncodeOptions {
            variant: match rest.first().map(String::as_str) {
                Some("1") => Variant::MultiLeaves,
                _ => Variant::MultiNodes,
            },
            index_bits: rest.get(1).map_or(Ok(16), |b| b.parse())?,
        },
        keep_map: true,
        cells_in_memory: None,
    };
    let budget: u64 = rest.get(2).map_or(Ok(0), |b| b.parse())?;
    let options = match budget {
        0 => options,
        budget => options
            .with_memory_budget(budget << 20, mesh)
            .map_err(|least| format!("at least {} MiB", least >> 20))?,
    };
    println!(
        "opened in {:.2} s; cells in memory at a time: {:?}",
        start.elapsed().as_secs_f64(),
        options.cells_in_memory
    );
    let start = Instant::now();
    let report = encode_file(Path::new(out), mesh, &fields, options, &|_| ())?;
    let secs = start.elapsed().as_secs_f64();
    let cells = report.num_cells_by_type.iter().sum::<u64>() as f64;
    let of_fields = report.fields.iter();
    let total = report.bytes.total()
        + of_fields
            .map(|f| f.values + f.ranges + f.cells_before)
            .sum::<usize>();
    println!(
        "{secs:.2} s, {:.2} M cells/s (partition {:.2}, sub-meshes {:.2}, outer {:.2}, write {:.2}); {} sub-meshes; {:.3} B a cell; map {:.3} B a cell",
        cells / secs / 1e6,
        report.encode.partition_secs,
        report.encode.submeshes_secs,
        report.encode.outer_secs,
        report.write_secs,
        report.num_submeshes,
        total as f64 / cells,
        report.map_bytes as f64 / cells,
    );
    for line in std::fs::read_to_string("/proc/self/status")?.lines() {
        if ["VmHWM", "RssAnon", "VmData"]
            .iter()
            .any(|k| line.starts_with(k))
        {
            println!("{line}");
        }
    }
    let file = PackedFile::open(Path::new(out))?;
    let packed = file.mesh()?;
    for field in &fields {
        let values = field.values.tuples() as f64;
        let (mut best, before) = (f64::INFINITY, cpu_secs()?);
        for _ in 0..REPEATS {
            let start = Instant::now();
            let map = file.map(&packed)?.ok_or("kept")?;
            let (name, values) = (&field.name, &field.values);
            PackedField::pack(&packed, &map, name, field.association, values)?;
            best = best.min(start.elapsed().as_secs_f64());
        }
        let cpu = (cpu_secs()? - before) / f64::from(REPEATS);
        println!(
            "swap `{}` on {}s, map included: best {best:.4} s, {:.0} M values/s; {cpu:.4} s of processor time, {:.0} M values/s a core",
            field.name,
            field.association,
            values / best / 1e6,
            values / cpu / 1e6,
        );
    }
    Ok(())
}

/// Times that a swap is measured.
const REPEATS: u32 = 10;

/// Processor time of this process so far, user's and system's.
fn cpu_secs() -> Result<f64, Box<dyn Error>> {
    const TICKS_A_SEC: f64 = 100.0;
    let stat = std::fs::read_to_string("/proc/self/stat")?;
    let after_name = stat.rsplit(") ").next().unwrap_or("");
    let ticks = after_name
        .split(' ')
        .skip(11)
        .take(2)
        .map(str::parse::<f64>);
    Ok(ticks.sum::<Result<f64, _>>()? / TICKS_A_SEC)
}
