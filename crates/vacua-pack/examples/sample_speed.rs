//! Samples a second from the packed form, in the order of a picture's rays, along a Morton curve and at
//! random, of the benchmark scenes:
//! `cargo run --release -p vacua-pack --example sample_speed -- tet 100 [shuffled] [batch=131072]`, or
//! `hex 150`, or the first field of `FILE.vacua`, a cube from the origin on. Places at random are
//! asked for so many at a time, and once all together.
#![allow(clippy::print_stdout, reason = "it is what this program is for")]

use std::path::Path;
use std::time::Instant;

use rayon::prelude::*;
use vacua_pack::file::PackedFile;
use vacua_pack::{
    BlockSampler, EncodeOptions, Order, PackedField, PackedMesh, Places, Sampled, encode,
};
use vacua_synth::meshes;
use vacua_volume::{Association, CellType, DataArray, UnstructuredMesh};

const LANES: usize = 16;
/// Vectors that are timed together where they lie close together.
const CHUNK: usize = 128;
/// Places at random.
const RANDOM: usize = 1 << 20;
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

/// Samples of a benchmark, sixteen places a vector, and which of them count.
struct Samples {
    at: Vec<Places>,
    lanes: Vec<u16>,
}

impl Samples {
    fn new() -> Self {
        Self {
            at: Vec::new(),
            lanes: Vec::new(),
        }
    }

    /// Adds a vector; only what is in the cube counts.
    fn push(&mut self, n: f32, places: [[f32; 3]; LANES]) {
        let at = [0, 1, 2].map(|i| places.map(|p| p[i]));
        let inside = |k: usize| (0..3).all(|i| (0.0..=n).contains(&at[i][k]));
        let lanes = (0..LANES).fold(0, |lanes, k| lanes | u16::from(inside(k)) << k);
        self.at.push(at);
        self.lanes.push(lanes);
    }
}

/// Rays of a picture of 512 × 512 pixels in tiles of 8 × 8, sixteen consecutive samples of each half a
/// cell apart; a vector holds four samples of 2 × 2 rays. Every so many tiles, so that it does not
/// take long.
fn ray_samples(n: f32) -> Samples {
    const SIDE: usize = 512;
    const EVERY: usize = 61;
    let mut samples = Samples::new();
    let forward = [-0.8f32, -0.5, -1.0].map(|d| d / 1.89f32.sqrt());
    let right = [forward[2], 0.0, -forward[0]].map(|d| d / 1.64f32.sqrt() * 1.89f32.sqrt());
    let up = [
        right[1] * forward[2] - right[2] * forward[1],
        right[2] * forward[0] - right[0] * forward[2],
        right[0] * forward[1] - right[1] * forward[0],
    ];
    let pixel = n * 3f32.sqrt() / SIDE as f32;
    let tiles = SIDE / 8;
    let half = (n * 3f32.sqrt()) as i32 / 16 + 1;
    for tile in (0..tiles * tiles).step_by(EVERY) {
        for block in -2 * half..2 * half {
            for vector in 0..64 {
                let (group, quarter) = (vector % 16, vector / 16);
                let place = |lane: usize| {
                    let (ray, k) = (lane / 4, quarter * 4 + lane % 4);
                    let x = tile % tiles * 8 + group % 4 * 2 + ray % 2;
                    let y = tile / tiles * 8 + group / 4 * 2 + ray / 2;
                    let u = (x as f32 - 0.5 * SIDE as f32) * pixel;
                    let v = (y as f32 - 0.5 * SIDE as f32) * pixel;
                    let t = 0.5 * (block * LANES as i32 + k as i32) as f32;
                    [0, 1, 2].map(|i| 0.5 * n + u * right[i] + v * up[i] + t * forward[i])
                };
                samples.push(n, std::array::from_fn(place));
            }
            let from = samples.at.len() - 64;
            if samples.lanes[from..].iter().all(|&lanes| lanes == 0) {
                samples.at.truncate(from);
                samples.lanes.truncate(from);
            }
        }
    }
    samples
}

/// Random places, in the order that they come or along a Morton curve.
fn random_samples(n: f32, count: usize, is_sorted: bool) -> Samples {
    let mut state = 99;
    let mut places: Vec<[f32; 3]> = (0..count * LANES)
        .map(|_| [0; 3].map(|_| n * random(&mut state)))
        .collect();
    if is_sorted {
        let spread = |c: f32| {
            let bits = (c / n * 1024.0) as u64;
            (0..10).fold(0, |code, bit| code | (bits >> bit & 1) << (3 * bit))
        };
        places.sort_by_cached_key(|p| spread(p[0]) | spread(p[1]) << 1 | spread(p[2]) << 2);
    }
    let mut samples = Samples::new();
    for sixteen in places.chunks_exact(LANES) {
        samples.push(n, std::array::from_fn(|k| sixteen[k]));
    }
    samples
}

/// Seconds that this thread has had of a core, which other processes hardly change.
fn core_secs() -> f64 {
    #[cfg(unix)]
    {
        use rustix::time::{ClockId, clock_gettime};
        let time = clock_gettime(ClockId::ThreadCPUTime);
        time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
    }
    #[cfg(not(unix))]
    {
        use std::sync::LazyLock;
        static START: LazyLock<Instant> = LazyLock::new(Instant::now);
        START.elapsed().as_secs_f64()
    }
}

/// A mesh with a field, from a file or made here, and its side.
fn packed(
    arguments: &[String],
) -> Result<(PackedMesh, PackedField, f32), Box<dyn std::error::Error>> {
    let kind = arguments.first().map_or("tet", String::as_str);
    if kind.ends_with(".vacua") {
        let file = PackedFile::open(Path::new(kind))?;
        let mesh = file.mesh()?;
        let field = file.field(&mesh, 0)?;
        let side = mesh.bounds().ok_or("no cells")?.hi.x as f32;
        return Ok((mesh, field, side));
    }
    let n: usize = arguments.get(1).map_or(Ok(100), |n| n.parse())?;
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
    Ok((encoded.mesh, field, n as f32))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (mesh, field, side) = packed(&arguments)?;
    let batch = arguments.iter().find_map(|a| a.strip_prefix("batch="));
    let batch: usize = batch.map_or(Ok(1 << 17), str::parse)?;
    let only = arguments.iter().find_map(|a| a.strip_prefix("only="));
    let sampler = BlockSampler::new(&mesh, &field, None);
    let random = random_samples(side, RANDOM / LANES, false);
    let orders = [
        ("rays", Order::Compact, CHUNK, &ray_samples(side)),
        (
            "Morton",
            Order::Compact,
            CHUNK,
            &random_samples(side, 100_000, true),
        ),
        ("random", Order::Scattered, batch.div_ceil(LANES), &random),
        ("random, all", Order::Scattered, RANDOM / LANES, &random),
    ];
    for (name, order, chunk, samples) in orders {
        if only.is_some_and(|only| only != name) {
            continue;
        }
        // The best of several runs, chunk by chunk.
        let chunks = || {
            samples
                .at
                .par_chunks(chunk)
                .zip(samples.lanes.par_chunks(chunk))
        };
        let mut best = vec![f64::INFINITY; chunks().len()];
        let mut fastest = f64::INFINITY;
        let (mut sum, mut found) = (0.0, 0);
        for _ in 0..RUNS {
            let start = Instant::now();
            (sum, found) = chunks()
                .zip(&mut best)
                .map_init(
                    || vec![Sampled::default(); chunk],
                    |sampled, ((at, lanes), best)| {
                        let before = core_secs();
                        sampler.sample_all(order, at, lanes, sampled);
                        *best = best.min(core_secs() - before);
                        let (mut sum, mut found) = (0.0, 0);
                        for sampled in &sampled[..at.len()] {
                            sum += f64::from(sampled.values.iter().sum::<f32>());
                            found += u64::from(sampled.valid.count_ones());
                        }
                        (sum, found)
                    },
                )
                .reduce(|| (0.0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
            fastest = fastest.min(start.elapsed().as_secs_f64());
        }
        let secs: f64 = best.iter().sum();
        let lanes = samples.lanes.iter();
        let count: u64 = lanes.map(|l| u64::from(l.count_ones())).sum();
        println!(
            "{name}: {:.2} Msamples/s, {:.2} a core ({count} samples, {found} inside, mean {:.4})",
            count as f64 / fastest * 1e-6,
            count as f64 / secs * 1e-6,
            sum / count as f64
        );
    }
    Ok(())
}
