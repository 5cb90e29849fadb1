//! Frames of the benchmark meshes, with and without skipping:
//! `cargo run --release -p vacua-render --example mesh_frame -- tet 100 512 OUT.png`.
#![allow(clippy::print_stdout, reason = "it is what this program is for")]

use std::path::Path;

use vacua_io::picture::{Picture, write_picture};
use vacua_render::{
    Camera, CpuRenderer, Integrator, Projection, RenderSettings, Renderer, Scene, Shading,
    SkipMethod,
};
use vacua_synth::{BenchScene, meshes};
use vacua_volume::{
    Association, CellType, ComponentChoice, DataArray, Dataset, Field, FieldChoice, Geometry,
    UnstructuredMesh,
};

/// Frames of each kind, of which the fastest counts.
const FRAMES: usize = 4;

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
    let (n, size): (usize, usize) = (number(2, 100)?, number(3, 512)?);
    let (mesh, scalars) = match arguments.get(1).map(String::as_str) {
        Some("hex") => mesh(meshes::hexahedra(n, 2)?, CellType::Hexahedron)?,
        _ => mesh(meshes::tetrahedra(n, 1)?, CellType::Tetrahedron)?,
    };
    let field = Field::new("scalar", Association::Point, scalars);
    let dataset = Dataset::new(Geometry::Unstructured(mesh), vec![field])?;
    let volume = dataset.volume(&FieldChoice::Only, ComponentChoice::Auto)?;
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
    let mut renderer = CpuRenderer::new(None)?;
    let looks = [
        ("march", Integrator::March, Shading::None),
        ("shaded", Integrator::March, Shading::Gradient),
        ("mip", Integrator::MaximumIntensity, Shading::None),
    ];
    for (name, integrator, shading) in looks {
        for skip in [SkipMethod::None, SkipMethod::Grid, SkipMethod::Auto] {
            let settings = RenderSettings {
                width: size,
                height: size,
                integrator,
                shading,
                skip,
                ..Default::default()
            };
            let mut fastest = f64::INFINITY;
            let frames = if name == "march" { FRAMES } else { 1 };
            for i in 0..frames {
                let rendering = renderer.render(&scene, &settings)?;
                let (report, frame) = (&rendering.report, &rendering.frame);
                fastest = fastest.min(report.frame_secs);
                if i == 0 {
                    println!(
                        "{name} {}: volume {:.2} s, macrocells {:.3} s, active {} of {}, K = {}, {} samples; {}",
                        skip.name(),
                        report.volume_secs,
                        report.macrocells_secs,
                        report.num_active,
                        report.num_macrocells,
                        report.macrocell_side,
                        frame.total_samples(),
                        report.reason.as_deref().unwrap_or("")
                    );
                }
                if i + 1 == frames
                    && skip == SkipMethod::Grid
                    && let Some(out) = arguments.get(4)
                {
                    let picture = Picture {
                        width: size,
                        height: size,
                        rgba: &frame.rgba,
                        depth: None,
                        cost: None,
                    };
                    let path = format!("{}_{name}.png", out.trim_end_matches(".png"));
                    write_picture(Path::new(&path), &picture, Some([0.0; 3]))?;
                }
            }
            println!("{name} {}: {:.3} s a frame", skip.name(), fastest);
        }
    }
    Ok(())
}
