//! Pictures that were looked at once, against those made now.
//!
//! Compared by PSNR and by structural similarity. On failure the picture made and its difference
//! from the golden one, eight times as strong, stay in the folder that the message names. To accept
//! pictures after having looked at them: run with `VACUA_BLESS=1`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec3;
use image::RgbImage;
use vacua::{
    Camera, ClipPlane, Integrator, Jitter, RenderSettings, Shading, SkipMethod, TransferFunction,
};
use vacua_render::{CpuRenderer, Renderer as _, Scene};
use vacua_synth::{Kind, Spec};
use vacua_volume::{
    ComponentChoice, Dataset, FieldChoice, Geometry, RectilinearGrid, ScalarType, Volume,
};

/// In decibel: differences far below what an eye sees, far above what another machine's libm does.
const LEAST_PSNR: f64 = 50.0;
const LEAST_SIMILARITY: f64 = 0.999;

const SIZE: (usize, usize) = (160, 120);

fn volume(kind: Kind, points: [usize; 3]) -> (Arc<Volume>, TransferFunction) {
    let spec = Spec::new(kind).with_points(points);
    let dataset = vacua_synth::generate(&spec).expect("a small volume");
    let looks = kind.transfer_functions(spec.scalar_type).expect("known");
    let (_, look) = looks.into_iter().next().expect("a transfer function");
    // As if the volume had its full size.
    let scale = points[0] as f64 / kind.default_points()[0] as f64;
    let (colors, opacities) = (look.colors().to_vec(), look.opacities().to_vec());
    let look = TransferFunction::new(colors, opacities, look.unit_length() * scale, look.scale());
    (of(&dataset), look.expect("as before"))
}

fn of(dataset: &Dataset) -> Arc<Volume> {
    let volume = dataset.volume(&FieldChoice::Only, ComponentChoice::Auto);
    Arc::new(volume.expect("one field"))
}

fn settings() -> RenderSettings {
    RenderSettings {
        width: SIZE.0,
        height: SIZE.1,
        skip: SkipMethod::Grid,
        ..Default::default()
    }
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden")
}

/// Renders and compares.
fn check(name: &str, scene: &Scene, settings: &RenderSettings) {
    let mut renderer = CpuRenderer::new(Some(2)).expect("threads");
    let frame = renderer
        .render(scene, settings)
        .expect("a good scene")
        .frame;
    let made_in = tempfile::tempdir().expect("a folder");
    let made = made_in.path().join(format!("{name}.png"));
    let picture = vacua_io::picture::Picture {
        width: frame.width,
        height: frame.height,
        rgba: &frame.rgba,
        depth: None,
        cost: None,
    };
    vacua_io::picture::write_png(&made, &picture, Some([1.0; 3])).expect("a picture");
    let golden = folder().join(format!("{name}.png"));
    if std::env::var_os("VACUA_BLESS").is_some() {
        std::fs::copy(&made, &golden).expect("the golden folder can be written");
        return;
    }
    let open = |path: &Path| image::open(path).expect("a picture").to_rgb8();
    let (expected, actual) = (open(&golden), open(&made));
    assert_eq!(expected.dimensions(), actual.dimensions());
    let psnr = psnr(&expected, &actual);
    let similarity = image_compare::rgb_similarity_structure(
        &image_compare::Algorithm::MSSIMSimple,
        &expected,
        &actual,
    )
    .expect("pictures of one size")
    .score;
    if psnr < LEAST_PSNR || similarity < LEAST_SIMILARITY {
        let kept = made_in.keep();
        let difference = kept.join(format!("{name}-difference.png"));
        stronger(&expected, &actual)
            .save(&difference)
            .expect("a picture");
        panic!(
            "{name}: PSNR {psnr:.1} dB, similarity {similarity:.5}; see {}",
            kept.display()
        );
    }
}

/// Peak signal-to-noise ratio in decibel; infinite for equal pictures.
fn psnr(a: &RgbImage, b: &RgbImage) -> f64 {
    let squares = a.as_raw().iter().zip(b.as_raw());
    let sum: f64 = squares
        .map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2))
        .sum();
    10.0 * (255.0f64.powi(2) * a.as_raw().len() as f64 / sum).log10()
}

/// Differences, eight times as strong.
fn stronger(a: &RgbImage, b: &RgbImage) -> RgbImage {
    let mut out = a.clone();
    for (o, b) in out.iter_mut().zip(b.as_raw()) {
        *o = o.abs_diff(*b).saturating_mul(8);
    }
    out
}

#[test]
fn shells() {
    let (volume, look) = volume(Kind::Shells, [64; 3]);
    check("shells", &Scene::new(volume, look), &settings());
}

#[test]
fn heptane_lit_and_clipped() {
    let (volume, look) = volume(Kind::Heptane, [75; 3]);
    let bounds = volume.geometry().bounds();
    let scene = Scene::new(volume, look)
        .camera(Camera::orbit(200.0, -15.0))
        .clip(ClipPlane {
            point: bounds.center(),
            normal: DVec3::new(1.0, 1.0, -0.5),
        });
    let settings = RenderSettings {
        shading: Shading::Gradient,
        ..settings()
    };
    check("heptane", &scene, &settings);
}

#[test]
fn flower_as_maximum_intensity() {
    let (volume, look) = volume(Kind::Flower, [64; 3]);
    let settings = RenderSettings {
        integrator: Integrator::MaximumIntensity,
        skip: SkipMethod::Mesh,
        ..settings()
    };
    check("flower", &Scene::new(volume, look), &settings);
}

#[test]
fn a_stretched_grid_with_jitter() {
    let points = [40, 30, 50];
    let spec = Spec::new(Kind::Heptane)
        .with_points(points)
        .with_type(ScalarType::U16);
    let dataset = vacua_synth::generate(&spec).expect("a small volume");
    let stretched = |n: usize| (0..n).map(|i| (i as f64 * 0.07).exp()).collect();
    let [x, y, z] = points.map(stretched);
    let grid = RectilinearGrid::new(x, y, z).expect("increasing planes");
    let dataset = Dataset::new(Geometry::Rectilinear(grid), dataset.fields().to_vec());
    let looks = Kind::Heptane.transfer_functions(ScalarType::U16);
    let (_, look) = looks
        .expect("known")
        .into_iter()
        .next()
        .expect("a transfer function");
    let (colors, opacities) = (look.colors().to_vec(), look.opacities().to_vec());
    let look = TransferFunction::new(colors, opacities, 0.2, look.scale()).expect("as before");
    let scene = Scene::new(of(&dataset.expect("it fits together")), look)
        .camera(Camera::orbit(130.0, 40.0));
    let settings = RenderSettings {
        jitter: Jitter::On,
        samples_per_pixel: 4,
        ..settings()
    };
    check("stretched", &scene, &settings);
}
