//! Frames of a benchmark mesh at each level of detail, by one thread's processor time:
//! `cargo run --release -p vacua-render --example detail_frame -- tet 60 512 OUT.png`.
#![allow(clippy::print_stdout, reason = "it is what this program is for")]

use std::path::Path;

use vacua_io::picture::{Picture, write_picture};
use vacua_pack::{DetailLevel, EncodeOptions, PackedField, PackedVolume, encode};
use vacua_render::{
    Camera, CpuRenderer, Detail, Projection, RenderSettings, Renderer, Scene, SkipMethod,
};
use vacua_synth::{BenchScene, meshes};
use vacua_volume::{Association, CellType, DataArray, UnstructuredMesh};

/// Frames of each kind, of which the fastest counts.
const FRAMES: usize = 3;

/// Seconds that all threads of this process have run.
fn processor_secs() -> Result<f64, Box<dyn std::error::Error>> {
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
) -> Result<(UnstructuredMesh, DataArray), Box<dyn std::error::Error>> {
    let positions = DataArray::from_vec(raw.vertices.into_flattened(), 3)?;
    let cells = DataArray::from_vec(raw.cells.into_flattened(), 1)?;
    let mesh = UnstructuredMesh::uniform(positions, cell_type, cells)?;
    Ok((mesh, DataArray::from_vec(raw.scalars, 1)?))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    let number = |i: usize, default| arguments.get(i).map_or(Ok(default), |n| n.parse());
    let (n, size): (usize, usize) = (number(2, 60)?, number(3, 512)?);
    let (mesh, scalars) = match arguments.get(1).map(String::as_str) {
        Some("hex") => mesh(meshes::hexahedra(n, 2)?, CellType::Hexahedron)?,
        _ => mesh(meshes::tetrahedra(n, 1)?, CellType::Tetrahedron)?,
    };
    let encoded = encode(&mesh, EncodeOptions::default())?;
    let (map, point) = (&encoded.map, Association::Point);
    let field = PackedField::pack(&encoded.mesh, map, "scalar", point, &scalars)?;
    let volume = PackedVolume::new(encoded.mesh, field);
    println!(
        "{} cells in {} sub-meshes",
        volume.mesh().num_cells(),
        volume.mesh().submeshes().len()
    );
    let bench = BenchScene::new(n as f64, 1.0)?;
    let camera = Camera::Placed {
        eye: bench.camera.eye,
        at: bench.camera.at,
        up: bench.camera.up,
        projection: Projection::Perspective {
            fov_degrees: bench.camera.fov_deg,
        },
    };
    let scene = Scene::new(volume, bench.transfer_function).camera(camera);
    let mut renderer = CpuRenderer::new(Some(1))?;
    let details = DetailLevel::ALL.map(Detail::Level).into_iter();
    for detail in details.chain([Detail::Exact]) {
        for skip in [SkipMethod::None, SkipMethod::Grid] {
            let settings = RenderSettings {
                width: size,
                height: size,
                detail,
                skip,
                ..Default::default()
            };
            let mut fastest = (f64::INFINITY, f64::INFINITY);
            let mut samples = 0;
            for _ in 0..FRAMES {
                let before = processor_secs()?;
                let rendering = renderer.render(&scene, &settings)?;
                let took = processor_secs()? - before;
                fastest.0 = fastest.0.min(rendering.report.frame_secs);
                fastest.1 = fastest.1.min(took);
                let frame = &rendering.frame;
                samples = frame.total_samples();
                if skip == SkipMethod::Grid
                    && let Some(out) = arguments.get(4)
                {
                    let picture = Picture {
                        width: size,
                        height: size,
                        rgba: &frame.rgba,
                        depth: None,
                        cost: None,
                    };
                    let stem = out.trim_end_matches(".png");
                    let path = format!("{stem}_{}.png", detail.name());
                    write_picture(Path::new(&path), &picture, Some([0.0; 3]))?;
                }
            }
            println!(
                "{} {}: {:.3} s by the wall, {:.2} s of one processor, {:.1} M samples/s",
                detail.name(),
                skip.name(),
                fastest.0,
                fastest.1,
                samples as f64 / 1e6 / fastest.1.max(0.005)
            );
        }
        if let Detail::Level(level) = detail {
            println!("  largest bound {:?}", renderer.largest_bound(level)?);
        }
    }
    Ok(())
}
