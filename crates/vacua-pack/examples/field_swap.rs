//! Swaps a field in a `.vacua` file, again and again, by the clock and by processor time:
//! `cargo run --release -p vacua-pack --example field_swap -- tet 100 FOLDER`.
#![allow(clippy::print_stdout, reason = "it is what this program is for")]

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use vacua_pack::file::{FieldInput, FieldLabel, FileOptions, PackedFile, encode_file};
use vacua_synth::meshes;
use vacua_volume::{Association, CellType, DataArray, UnstructuredMesh};

/// Swaps, of which the fastest counts.
const SWAPS: usize = 5;

/// Seconds that all threads of this process have run.
fn processor_secs() -> Result<f64, Box<dyn Error>> {
    let stat = std::fs::read_to_string("/proc/self/stat")?;
    let after_name = stat.rsplit(')').next().ok_or("no name")?;
    let ticks: Vec<&str> = after_name.split_whitespace().collect();
    // User and system time, in hundredths of a second.
    let ticks = ticks[11].parse::<f64>()? + ticks[12].parse::<f64>()?;
    Ok(ticks / 100.0)
}

fn mesh<const N: usize>(
    raw: meshes::RawMesh<N>,
    cell_type: CellType,
) -> Result<UnstructuredMesh, Box<dyn Error>> {
    let positions = DataArray::from_vec(raw.vertices.into_flattened(), 3)?;
    let cells = DataArray::from_vec(raw.cells.into_flattened(), 1)?;
    Ok(UnstructuredMesh::uniform(positions, cell_type, cells)?)
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    let n: usize = arguments.get(2).map_or(Ok(100), |n| n.parse())?;
    let folder = arguments.get(3).map_or(".", String::as_str);
    let mesh = match arguments.get(1).map(String::as_str) {
        Some("hex") => mesh(meshes::hexahedra(n, 2)?, CellType::Hexahedron)?,
        _ => mesh(meshes::tetrahedra(n, 1)?, CellType::Tetrahedron)?,
    };
    let values = |association: Association, seed: f32| -> Result<DataArray, Box<dyn Error>> {
        let len = match association {
            Association::Point => mesh.num_points(),
            Association::Cell => mesh.num_cells(),
        };
        let value = |i: usize| (i as f32 * 1e-5 + seed).sin();
        Ok(DataArray::from_vec((0..len).map(value).collect(), 1)?)
    };
    let field = |association, seed| -> Result<FieldInput, Box<dyn Error>> {
        Ok(FieldInput {
            name: format!("{association} values"),
            association,
            values: values(association, seed)?,
            label: FieldLabel::default(),
        })
    };
    let both = [
        field(Association::Point, 0.0)?,
        field(Association::Cell, 0.0)?,
    ];
    let path = Path::new(folder).join("field_swap.vacua");
    let options = FileOptions {
        keep_map: true,
        ..FileOptions::default()
    };
    encode_file(&path, &mesh, &both, options, &|_| ())?;
    println!(
        "{} points, {} cells, {} bytes",
        mesh.num_points(),
        mesh.num_cells(),
        std::fs::metadata(&path)?.len()
    );
    for association in [Association::Point, Association::Cell] {
        let new = [field(association, 1.0)?];
        let num_values = new[0].values.tuples() as f64;
        for _ in 0..SWAPS {
            let start = Instant::now();
            let file = PackedFile::open(&path)?;
            let packed = file.mesh()?;
            let opened = start.elapsed().as_secs_f64();
            let before = processor_secs()?;
            let report = file.update(&path, &packed, &new)?;
            let processor = processor_secs()? - before;
            let made = report.map_secs + report.pack_secs;
            println!(
                "{association}s: {:.1} M values/s; open {opened:.4} s, map {:.4} s, values and ranges {:.4} s, write {:.4} s; processor {processor:.2} s",
                num_values / 1e6 / made,
                report.map_secs,
                report.pack_secs,
                report.write_secs
            );
        }
    }
    std::fs::remove_file(&path)?;
    Ok(())
}
