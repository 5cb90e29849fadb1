//! The three variants of a procedural mesh side by side: bytes a cell by part, samples a second in
//! ray order and at random taking turns, and whether all give the same bits:
//! `cargo run --release -p vacua-pack --example variants -- tet100 [SIZE] [ordered] [flat] [bytes]`.
//!
//! `ordered` leaves cells and points as they were made, `flat` moves points back onto the lattice,
//! `bytes` leaves out the samples.
#![allow(clippy::print_stdout, reason = "it is what this program is for")]

use std::error::Error;
use std::time::Instant;

use vacua_pack::{
    BlockSampler, EncodeOptions, Encoded, Order, PackedField, Sampled, Variant, encode,
};
use vacua_synth::{MeshKind, MeshSpec, generate_mesh};
use vacua_volume::{Association, DataArray, FieldChoice, UnstructuredMesh};

const LANES: usize = 16;
/// Vectors in a row before the next variant has its turn.
const CHUNK: usize = 512;
/// Turns, of which the best counts, chunk by chunk.
const TURNS: usize = 3;
const VARIANTS: [(&str, Variant); 3] = [
    ("1", Variant::MultiLeaves),
    ("2", Variant::MultiNodes),
    ("small", Variant::Small),
];

type Places = [[f32; LANES]; 3];

fn random(state: &mut u64) -> f32 {
    *state = state
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*state >> 40) as f32 / (1u64 << 24) as f32
}

/// Rays through a box in tiles of 8 × 8, sixteen consecutive samples at a time.
fn ray_places(lo: [f32; 3], size: [f32; 3], step: f32, side: usize) -> Vec<Places> {
    let direction = [-0.8f32, -0.5, -1.0].map(|d| d / 1.375);
    let tiles = side / 8;
    let reach = (size.iter().fold(0f32, |m, &s| m.max(s)) / (step * LANES as f32)) as i32;
    let mut all = Vec::new();
    for tile in 0..tiles * tiles {
        for pixel in 0..64 {
            let x = (tile % tiles * 8 + pixel % 8) as f32 / side as f32;
            let y = (tile / tiles * 8 + pixel / 8) as f32 / side as f32;
            let part = [0.1 + 0.8 * x, 0.1 + 0.8 * y, 0.5];
            for block in -reach..reach {
                let at: Places = std::array::from_fn(|i| {
                    std::array::from_fn(|k| {
                        let t = step * (block * LANES as i32 + k as i32) as f32;
                        lo[i] + part[i] * size[i] + t * direction[i]
                    })
                });
                let inside =
                    |k: usize| (0..3).all(|i| (lo[i]..=lo[i] + size[i]).contains(&at[i][k]));
                if inside(0) && inside(LANES - 1) {
                    all.push(at);
                }
            }
        }
    }
    all
}

fn report(name: &str, encoded: &Encoded, field: &PackedField, points: usize) {
    let mesh = &encoded.mesh;
    let cells = mesh.num_cells() as f64;
    let (bytes, of_field) = (mesh.bytes(), field.bytes());
    let rest = bytes.nodes + bytes.outer + bytes.submeshes;
    let per = |b: usize| b as f64 / cells;
    println!(
        "  {name:5} {:7.3} B a cell: positions {:.3} values {:.3} indices {:.3} tree {:.3} ranges {:.3}  ({:+.1} % vertices, {:.1} s)",
        per(bytes.total() + of_field.values + of_field.ranges),
        per(bytes.positions),
        per(of_field.values),
        per(bytes.indices),
        per(rest),
        per(of_field.ranges),
        100.0 * (mesh.num_vertices() as f64 / points as f64 - 1.0),
        encoded.report.submeshes_secs,
    );
    if let Some(clusters) = mesh.clusters() {
        let n = clusters.len() as f64;
        println!(
            "        {:.1} cells and {:.1} own vertices a cluster, {:.2} cells a leaf",
            cells / n,
            mesh.num_vertices() as f64 / n,
            cells / encoded.report.totals.leaves as f64
        );
    }
}

fn flattened(mesh: &UnstructuredMesh) -> Result<UnstructuredMesh, Box<dyn Error>> {
    let positions = (0..mesh.num_points())
        .flat_map(|p| mesh.position(p).to_array().map(|c| c.round() as f32))
        .collect();
    let corners = (0..mesh.num_cells()).flat_map(|c| mesh.cell(c).points().to_vec());
    let connectivity: Vec<u64> = corners.collect();
    let types = (0..mesh.num_cells()).map(|c| mesh.cell(c).cell_type);
    Ok(UnstructuredMesh::mixed(
        DataArray::from_vec(positions, 3)?,
        types.collect(),
        DataArray::from_vec(connectivity, 1)?,
    )?)
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let has = |word: &str| arguments.iter().any(|a| a == word);
    let kind: MeshKind = arguments.first().map_or("tet100", String::as_str).parse()?;
    let size = arguments.get(1).and_then(|n| n.parse().ok());
    let spec = MeshSpec {
        size: size.unwrap_or(kind.default_size()),
        shuffled: !has("ordered"),
        ..MeshSpec::new(kind)
    };
    let dataset = generate_mesh(&spec)?;
    let volume = dataset.volume(&FieldChoice::Only, vacua_volume::ComponentChoice::Auto)?;
    let mesh = dataset.mesh().ok_or("a mesh")?.clone();
    let mesh = if has("flat") { flattened(&mesh)? } else { mesh };
    println!(
        "{kind} {}: {} cells, {} points",
        spec.size,
        mesh.num_cells(),
        mesh.num_points()
    );
    let mut all = Vec::new();
    for (name, variant) in VARIANTS {
        let options = EncodeOptions {
            variant,
            ..EncodeOptions::default()
        };
        let encoded = encode(&mesh, options)?;
        let field = PackedField::pack(
            &encoded.mesh,
            &encoded.map,
            "scalars",
            Association::Point,
            volume.scalars(),
        )?;
        report(name, &encoded, &field, mesh.num_points());
        all.push((encoded, field));
    }
    if has("bytes") {
        return Ok(());
    }
    let samplers: Vec<BlockSampler> = all
        .iter()
        .map(|(encoded, field)| BlockSampler::new(&encoded.mesh, field, None))
        .collect();
    let bounds = mesh.bounds().ok_or("bounds")?;
    let lo = bounds.lo.to_array().map(|c| c as f32);
    let extent = (bounds.hi - bounds.lo).to_array().map(|c| c as f32);
    let volume: f32 = extent.iter().product();
    let step = 0.5 * (volume / mesh.num_points() as f32).cbrt();
    let mut state = 99;
    let mut anywhere = || -> Places {
        std::array::from_fn(|i| std::array::from_fn(|_| lo[i] + extent[i] * random(&mut state)))
    };
    let orders = [
        ("rays", Order::Compact, ray_places(lo, extent, step, 64)),
        (
            "random",
            Order::Scattered,
            (0..8000).map(|_| anywhere()).collect(),
        ),
    ];
    let lanes = [u16::MAX; CHUNK];
    for (name, order, places) in orders {
        let mut best = vec![[f64::INFINITY; 3]; places.len().div_ceil(CHUNK)];
        let (mut found, mut differ) = (0u64, 0u64);
        for turn in 0..TURNS {
            for (chunk, best) in places.chunks(CHUNK).zip(&mut best) {
                let mut sampled = [(); 3].map(|()| vec![Sampled::default(); chunk.len()]);
                for (i, sampler) in samplers.iter().enumerate() {
                    let start = Instant::now();
                    sampler.sample_all(order, chunk, &lanes[..chunk.len()], &mut sampled[i]);
                    best[i] = best[i].min(start.elapsed().as_secs_f64());
                }
                if turn > 0 {
                    continue;
                }
                let [one, two, small] = sampled;
                for ((one, two), small) in one.iter().zip(&two).zip(&small) {
                    found += u64::from(one.valid.count_ones());
                    let other = |k: &usize| {
                        small.values[*k] != one.values[*k] || small.values[*k] != two.values[*k]
                    };
                    differ += (0..LANES).filter(other).count() as u64;
                    differ += u64::from(small.valid != one.valid || small.valid != two.valid);
                }
            }
        }
        let count = (places.len() * LANES) as f64;
        let speed = |i: usize| count / best.iter().map(|b| b[i]).sum::<f64>() * 1e-6;
        println!(
            "  {name}: Msamples/s on one core: variant 1 {:.2}, 2 {:.2}, small {:.2} ({count} samples, {found} inside; {differ} values differ)",
            speed(0),
            speed(1),
            speed(2)
        );
    }
    Ok(())
}
