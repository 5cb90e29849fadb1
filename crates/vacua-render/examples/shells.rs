//! Times shells256.
#![allow(clippy::print_stdout, missing_docs)]
use glam::DVec3;
use vacua_render::*;
use vacua_volume::*;
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let bytes = std::fs::read(&args[1]).expect("file");
    let ty: ScalarType = args[2].parse().expect("type");
    let scale = match ty {
        ScalarType::U8 => 255.0,
        ScalarType::U16 => 65535.0,
        _ => 1.0,
    };
    let array =
        DataArray::from_store(std::sync::Arc::new(bytes), 0, ty, 1, 256 * 256 * 256).expect("size");
    let grid = UniformGrid::new([256; 3], DVec3::ZERO, DVec3::ONE).expect("grid");
    let ds = Dataset::new(
        Geometry::Uniform(grid),
        vec![Field::new("v", Association::Point, array)],
    )
    .expect("ds");
    let volume = ds
        .volume(&FieldChoice::Only, ComponentChoice::Auto)
        .expect("volume");
    let x = [0.0, 0.25, 0.30, 0.70, 1.0];
    let rgb = [
        [0., 0., 1.],
        [0., 0.4, 1.],
        [0., 1., 0.6],
        [1., 0.8, 0.],
        [1., 0.1, 0.],
    ];
    let a = [0.0, 0.0, 0.01, 0.03, 0.06];
    let tf = TransferFunction::new(
        (0..5)
            .map(|i| ColorPoint {
                value: x[i] * scale,
                srgb: rgb[i],
            })
            .collect(),
        (0..5)
            .map(|i| OpacityPoint {
                value: x[i] * scale,
                opacity: a[i],
            })
            .collect(),
        1.0,
        ValueScale::Linear,
    )
    .expect("tf");
    let bounds = volume.geometry().bounds();
    let scene = Scene::new(volume, tf).camera(Camera::framing(
        bounds,
        DVec3::new(0.8, 0.5, 1.0),
        DVec3::Y,
        20.0,
    ));
    let mut renderer = CpuRenderer::new(Some(2)).expect("threads");
    let mut reference: Option<Frame> = None;
    for shading in [Shading::None, Shading::Gradient] {
        let only = std::env::var("ONLY").unwrap_or_default();
        for (skip, k) in [
            (SkipMethod::None, 8),
            (SkipMethod::Grid, 4),
            (SkipMethod::Grid, 8),
            (SkipMethod::Grid, 16),
        ] {
            if !only.is_empty() && only != format!("{skip:?}{k}{shading:?}") {
                continue;
            }
            let settings = RenderSettings {
                skip,
                macrocell_side: Some(k),
                shading,
                ..Default::default()
            };
            let mut times = Vec::new();
            let mut last = None;
            for i in 0..6 {
                let r = renderer.render(&scene, &settings).expect("render");
                if i == 0 {
                    println!("{:?}", r.report);
                } else {
                    times.push(r.report.frame_secs);
                }
                last = Some(r.frame);
            }
            times.sort_by(f64::total_cmp);
            let f = last.expect("frame");
            let samples = f.total_samples();
            println!(
                "{skip:?} K{k} {shading:?}: median {:.1} ms min {:.1} samples {:.1}M  {:.0} Ms/s  dist",
                times[2] * 1e3,
                times[0] * 1e3,
                samples as f64 / 1e6,
                samples as f64 / times[2] / 1e6
            );
            if skip == SkipMethod::None {
                let lum: f64 =
                    f.rgba.iter().map(|p| p[3] as f64).sum::<f64>() / f.rgba.len() as f64;
                println!("mean alpha {lum}");
                let hit = f.samples.iter().filter(|s| **s > 0).count();
                println!("hit {:.1}%", 100.0 * hit as f64 / f.samples.len() as f64);
                let px: Vec<u8> = f
                    .rgba
                    .iter()
                    .flat_map(|p| {
                        [0, 1, 2, 3].map(|c| {
                            if c == 3 {
                                255
                            } else {
                                (p[c].clamp(0.0, 1.0).powf(1.0 / 2.2) * 255.0) as u8
                            }
                        })
                    })
                    .collect();
                std::fs::write(format!("/work/scratch/{shading:?}.rgba"), px).expect("write");
                reference = Some(f);
            } else {
                let Some(r) = reference.as_ref() else {
                    continue;
                };
                let same = r
                    .rgba
                    .iter()
                    .zip(&f.rgba)
                    .all(|(a, b)| a.map(f32::to_bits) == b.map(f32::to_bits))
                    && r.depth
                        .iter()
                        .zip(&f.depth)
                        .all(|(a, b)| a.to_bits() == b.to_bits());
                println!("identical: {same}");
            }
        }
    }
}
