//! Encodes a mesh from raw arrays and prints what it takes: for measuring.
//!
//! `encode_raw POSITIONS.f32 CELLS.u32 tetrahedron|pyramid|wedge|hexahedron [VARIANT] [BITS]`
#![allow(clippy::print_stdout, reason = "a program for people at a terminal")]

use std::error::Error;
use std::time::Instant;

use vacua_pack::{EncodeOptions, Variant, encode};
use vacua_volume::{CellType, DataArray, UnstructuredMesh};

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [positions, cells, kind, rest @ ..] = args.as_slice() else {
        return Err("usage: encode_raw POSITIONS.f32 CELLS.u32 TYPE [VARIANT] [BITS]".into());
    };
    let cell_type = CellType::ALL
        .into_iter()
        .find(|t| t.name() == kind)
        .ok_or("unknown cell type")?;
    let positions: Vec<f32> = bytemuck::pod_collect_to_vec(&std::fs::read(positions)?);
    let cells: Vec<u32> = bytemuck::pod_collect_to_vec(&std::fs::read(cells)?);
    let mesh = UnstructuredMesh::uniform(
        DataArray::from_vec(positions, 3)?,
        cell_type,
        DataArray::from_vec(cells, 1)?,
    )?;
    let options = EncodeOptions {
        variant: match rest.first().map(String::as_str) {
            Some("1") => Variant::MultiLeaves,
            Some("small") => Variant::Small,
            _ => Variant::MultiNodes,
        },
        index_bits: rest.get(1).map_or(Ok(16), |b| b.parse())?,
    };
    let start = Instant::now();
    let encoded = encode(&mesh, options)?;
    let secs = start.elapsed().as_secs_f64();
    let (packed, report) = (&encoded.mesh, &encoded.report);
    let cells = packed.num_cells() as f64;
    let bytes = packed.bytes();
    let vertices = packed.num_vertices();
    let parts = packed.submeshes().len();
    println!(
        "{secs:.2} s, {:.2} M cells/s (partition {:.2}, sub-meshes {:.2}, outer {:.2})",
        cells / secs / 1e6,
        report.partition_secs,
        report.submeshes_secs,
        report.outer_secs
    );
    println!(
        "{parts} sub-meshes, {:.1} K cells and {:.1} K vertices each, {vertices} vertices in all ({:+.1} %)",
        cells / parts as f64 / 1e3,
        vertices as f64 / parts as f64 / 1e3,
        100.0 * (vertices as f64 / mesh.num_points() as f64 - 1.0),
    );
    let t = report.totals;
    println!(
        "{} single tets, {} pairs, {} others in {} leaves ({:.2} cells each), {} nodes of {:.2} children, {} outer",
        t.tets,
        t.pairs,
        t.others,
        t.leaves,
        cells / t.leaves as f64,
        packed.nodes().len(),
        t.children as f64 / packed.nodes().len() as f64,
        packed.outer().len(),
    );
    let per = |b: usize| b as f64 / cells;
    let values = 4 * vertices;
    let ranges = 16 * packed.nodes().len() + 16 * parts;
    println!(
        "bytes a cell: positions {:.3} indices {:.3} nodes {:.3} outer {:.3} headers {:.3} values {:.3} ranges {:.3} sum {:.3}",
        per(bytes.positions),
        per(bytes.indices),
        per(bytes.nodes),
        per(bytes.outer),
        per(bytes.submeshes),
        per(values),
        per(ranges),
        per(bytes.total() + values + ranges),
    );
    Ok(())
}
