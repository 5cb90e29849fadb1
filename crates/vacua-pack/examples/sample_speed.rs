//! Samples a second from the packed form, in ray order and at random, of the benchmark scenes:
//! `cargo run --release -p vacua-pack --example sample_speed -- tet 100 [shuffled] [threads]`.
#![allow(clippy::print_stdout, reason = "it is what this program is for")]

use std::time::Instant;

use rayon::prelude::*;
use vacua_pack::{BlockSampler, EncodeOptions, PackedField, encode};
use vacua_synth::meshes;
use vacua_volume::{Association, CellType, DataArray, UnstructuredMesh};

const LANES: usize = 16;
/// Vectors that are timed together.
const CHUNK: usize = 128;
/// Runs, of which the best counts.
const RUNS: usize = 9;

fn random(state: &mut u64) -> f32 {
    *state = state
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*state >> 40) as f32 / (1u64 << 24) as f32
}

/// Vertices and cells in random order.
fn shuffle<const N: usize>(mesh: &mut meshes::RawMesh<N>) {
    let mut state = 7;
    let n = mesh.vertices.len();
    let mut new_of: Vec<u32> = (0..n as u32).collect();
    for i in (1..n).rev() {
        let j = (random(&mut state) as f64 * i as f64) as usize;
        new_of.swap(i, j);
    }
    let (vertices, scalars) = (mesh.vertices.clone(), mesh.scalars.clone());
    for (old, &new) in new_of.iter().enumerate() {
        mesh.vertices[new as usize] = vertices[old];
        mesh.scalars[new as usize] = scalars[old];
    }
    for cell in &mut mesh.cells {
        *cell = cell.map(|v| new_of[v as usize] as i32);
    }
    for i in (1..mesh.cells.len()).rev() {
        let j = (random(&mut state) as f64 * i as f64) as usize;
        mesh.cells.swap(i, j);
    }
}

fn build<const N: usize>(
    mut raw: meshes::RawMesh<N>,
    cell_type: CellType,
    shuffled: bool,
) -> Result<(UnstructuredMesh, DataArray), Box<dyn std::error::Error>> {
    if shuffled {
        shuffle(&mut raw);
    }
    let positions = DataArray::from_vec(raw.vertices.into_flattened(), 3)?;
    let cells = DataArray::from_vec(raw.cells.into_flattened(), 1)?;
    let mesh = UnstructuredMesh::uniform(positions, cell_type, cells)?;
    Ok((mesh, DataArray::from_vec(raw.scalars, 1)?))
}

/// Rays of a picture in tiles of 8 × 8, 16 consecutive samples at a time.
fn ray_blocks(n: f32, side: usize) -> Vec<[[f32; LANES]; 3]> {
    let mut blocks = Vec::new();
    let direction = [-0.8f32, -0.5, -1.0].map(|d| d / 1.375);
    let tiles = side / 8;
    for tile in 0..tiles * tiles {
        for pixel in 0..64 {
            let x = (tile % tiles * 8 + pixel % 8) as f32 / side as f32;
            let y = (tile / tiles * 8 + pixel / 8) as f32 / side as f32;
            // Through a point of the middle plane, backwards and forwards.
            let through = [0.1 + 0.8 * x, 0.1 + 0.8 * y, 0.5].map(|c| c * n);
            for block in -10..10 {
                let mut at = [[0.0; LANES]; 3];
                for (i, at) in at.iter_mut().enumerate() {
                    for (k, at) in at.iter_mut().enumerate() {
                        let t = 0.5 * (block * LANES as i32 + k as i32) as f32;
                        *at = through[i] + t * direction[i];
                    }
                }
                let inside = |k: usize| (0..3).all(|i| (0.0..=n).contains(&at[i][k]));
                if inside(0) && inside(LANES - 1) {
                    blocks.push(at);
                }
            }
        }
    }
    blocks
}

fn random_blocks(n: f32, count: usize) -> Vec<[[f32; LANES]; 3]> {
    let mut state = 99;
    let mut block = || std::array::from_fn(|_| std::array::from_fn(|_| n * random(&mut state)));
    (0..count).map(|_| block()).collect()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    let kind = arguments.get(1).map_or("tet", String::as_str);
    let n: usize = arguments.get(2).map_or(Ok(100), |n| n.parse())?;
    let shuffled = arguments.iter().any(|a| a == "shuffled");
    let (mesh, values) = match kind {
        "hex" => build(meshes::hexahedra(n, 2)?, CellType::Hexahedron, shuffled)?,
        _ => build(meshes::tetrahedra(n, 1)?, CellType::Tetrahedron, shuffled)?,
    };
    let start = Instant::now();
    let encoded = encode(&mesh, EncodeOptions::default())?;
    let field = PackedField::pack(
        &encoded.mesh,
        &encoded.map,
        "scalar",
        Association::Point,
        &values,
    )?;
    println!(
        "{kind}{n}: {:.2} B a cell, encoded in {:.1} s",
        (encoded.mesh.bytes().total() + field.bytes().ranges) as f64 / mesh.num_cells() as f64,
        start.elapsed().as_secs_f64()
    );
    let sampler = BlockSampler::new(&encoded.mesh, &field, None);
    let orders = [
        ("rays", ray_blocks(n as f32, 96)),
        ("random", random_blocks(n as f32, 20_000)),
    ];
    for (order, blocks) in orders {
        // The best of several runs, chunk by chunk: what a core does that is left alone.
        let mut best = vec![f64::INFINITY; blocks.len().div_ceil(CHUNK)];
        let mut fastest = f64::INFINITY;
        let (mut sum, mut found) = (0.0, 0);
        for _ in 0..RUNS {
            let start = Instant::now();
            (sum, found) = blocks
                .par_chunks(CHUNK)
                .zip(&mut best)
                .map(|(chunk, best)| {
                    let start = Instant::now();
                    let (mut sum, mut found) = (0.0, 0);
                    for at in chunk {
                        let sampled = sampler.sample(at, u16::MAX);
                        sum += f64::from(sampled.values.iter().sum::<f32>());
                        found += u64::from(sampled.valid.count_ones());
                    }
                    *best = best.min(start.elapsed().as_secs_f64());
                    (sum, found)
                })
                .reduce(|| (0.0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
            fastest = fastest.min(start.elapsed().as_secs_f64());
        }
        let core_secs: f64 = best.iter().sum();
        let count = blocks.len() * LANES;
        println!(
            "{order}: {:.2} Msamples/s, {:.2} a core left alone ({count} samples, {found} inside, mean {:.4})",
            count as f64 / fastest * 1e-6,
            count as f64 / core_secs * 1e-6,
            sum / count as f64
        );
    }
    Ok(())
}
