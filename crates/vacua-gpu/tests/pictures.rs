//! Pictures of the device against those of the CPU, and against its own without skipping.

mod common;

use common::*;
use glam::DVec3;
use vacua_gpu::GpuOptions;
use vacua_render::{
    Camera, ClipPlane, Frame, Integrator, Jitter, Projection, RenderSettings, Renderer, Scene,
    Shading, SkipMethod,
};
use vacua_volume::{Association, Bounds, Scalar, ValueScale};

const POINTS: [usize; 3] = [44, 41, 38];

/// Renders with and without skipping, compares both and each with the CPU; the picture.
fn check(what: &str, scene: &Scene, settings: &RenderSettings, options: GpuOptions) {
    let Some(mut gpu) = renderer(options) else {
        return;
    };
    let mut picture = |skip| -> Frame {
        let settings = RenderSettings {
            skip,
            ..settings.clone()
        };
        gpu.render(scene, &settings).expect("a good scene").frame
    };
    let (with, without) = (picture(SkipMethod::Grid), picture(SkipMethod::None));
    assert_same_bits(what, &with, &without);
    assert!(
        with.total_samples() < without.total_samples(),
        "{what}: something is skipped"
    );
    let cpu = on_cpu(scene, settings);
    assert_alike(what, &with, &cpu);
    assert_valid(&gpu);
}

fn check_type<T: Scalar>(what: &str, lo: f64, hi: f64, to: impl Fn(f64) -> T) {
    let volume = volume(uniform(POINTS), Association::Point, shells, to);
    let look = look(lo, hi, 12.0, ValueScale::Linear);
    check(
        what,
        &scene(volume, look),
        &settings(),
        GpuOptions::default(),
    );
}

#[test]
fn small_integers() {
    check_type("u8", 0.0, 255.0, |v| (255.0 * v) as u8);
    check_type("i8", -128.0, 127.0, |v| (255.0 * v - 128.0) as i8);
    check_type("u16", 0.0, 6e4, |v| (6e4 * v) as u16);
    check_type("i16", -3e4, 3e4, |v| (6e4 * v - 3e4) as i16);
}

#[test]
fn wide_types() {
    check_type("f32", -1.0, 3.0, |v| (4.0 * v - 1.0) as f32);
    check_type("f64 on a large offset", 1e9, 1e9 + 1.0, |v| 1e9 + v);
    check_type("i32", -1e9, 1e9, |v| (2e9 * v - 1e9) as i32);
    check_type("u64", 0.0, 1e15, |v| (1e15 * v) as u64);
}

#[test]
fn holes_of_values_that_are_no_numbers() {
    check_type("NaN", 0.0, 1.0, |v| {
        if (0.4..0.45).contains(&v) {
            f32::NAN
        } else {
            v as f32
        }
    });
}

#[test]
fn logarithmic_scale() {
    let to = |v: f64| (1e-3 * 10f64.powf(6.0 * v)) as f32;
    let volume = volume(uniform(POINTS), Association::Point, shells, to);
    let scene = scene(volume, look(1e-3, 1e3, 12.0, ValueScale::Log));
    check("log", &scene, &settings(), GpuOptions::default());
}

fn bytes() -> Scene {
    let volume = volume(uniform(POINTS), Association::Point, shells, |v| {
        (255.0 * v) as u8
    });
    scene(volume, look(0.0, 255.0, 12.0, ValueScale::Linear))
}

#[test]
fn cell_data() {
    let cells = volume(uniform(POINTS), Association::Cell, shells, |v| {
        (255.0 * v) as u8
    });
    let scene = scene(cells, look(0.0, 255.0, 12.0, ValueScale::Linear));
    check("cells", &scene, &settings(), GpuOptions::default());
}

#[test]
fn stretched_grids() {
    for association in [Association::Point, Association::Cell] {
        let volume = volume(stretched(POINTS), association, shells, |v| {
            (255.0 * v) as u8
        });
        let scene = scene(volume, look(0.0, 255.0, 40.0, ValueScale::Linear));
        check("stretched", &scene, &settings(), GpuOptions::default());
        let shaded = RenderSettings {
            shading: Shading::Gradient,
            ..settings()
        };
        check("stretched, shaded", &scene, &shaded, GpuOptions::default());
    }
}

#[test]
fn every_setting() {
    let scene = bytes();
    let all = [
        (
            "shaded",
            RenderSettings {
                shading: Shading::Gradient,
                ..settings()
            },
        ),
        (
            "maximum",
            RenderSettings {
                integrator: Integrator::MaximumIntensity,
                ..settings()
            },
        ),
        (
            "jitter",
            RenderSettings {
                jitter: Jitter::On,
                ..settings()
            },
        ),
        (
            "three frames",
            RenderSettings {
                samples_per_pixel: 3,
                first_frame: 2,
                ..settings()
            },
        ),
        (
            "many frames",
            RenderSettings {
                samples_per_pixel: 19,
                width: 24,
                height: 20,
                ..settings()
            },
        ),
        (
            "K 3",
            RenderSettings {
                macrocell_side: Some(3),
                ..settings()
            },
        ),
        (
            "K 1",
            RenderSettings {
                macrocell_side: Some(1),
                ..settings()
            },
        ),
        (
            "K 64",
            RenderSettings {
                macrocell_side: Some(64),
                step: 0.21,
                ..settings()
            },
        ),
        (
            "long steps",
            RenderSettings {
                step: 3.0,
                macrocell_side: Some(5),
                ..settings()
            },
        ),
        (
            "early",
            RenderSettings {
                termination: 0.5,
                ..settings()
            },
        ),
        (
            "never",
            RenderSettings {
                termination: 0.0,
                ..settings()
            },
        ),
        (
            "odd size",
            RenderSettings {
                width: 37,
                height: 61,
                ..settings()
            },
        ),
    ];
    for (what, settings) in all {
        // One macrocell: nothing to skip but the corners, so compare with the CPU alone.
        if what == "K 64" {
            let Some(mut gpu) = renderer(GpuOptions::default()) else {
                return;
            };
            let frame = gpu.render(&scene, &settings).expect("a good scene").frame;
            assert_alike(what, &frame, &on_cpu(&scene, &settings));
            continue;
        }
        check(what, &scene, &settings, GpuOptions::default());
    }
}

#[test]
fn every_view() {
    let placed = |eye, at, projection| Camera::Placed {
        eye,
        at,
        up: DVec3::Y,
        projection,
    };
    let narrow = Projection::Perspective { fov_degrees: 30.0 };
    let views = [
        (
            "inside",
            placed(
                DVec3::new(10.0, 12.0, 20.0),
                DVec3::new(20.0, 8.0, 0.0),
                narrow,
            ),
        ),
        (
            "along x",
            placed(
                DVec3::new(-60.0, 13.0, 21.5),
                DVec3::new(0.0, 13.0, 21.5),
                narrow,
            ),
        ),
        (
            "on a face",
            placed(
                DVec3::new(-3.0, 13.0, 21.5),
                DVec3::new(0.0, 13.0, 21.5),
                narrow,
            ),
        ),
        (
            "parallel",
            placed(
                DVec3::new(80.0, 70.0, 90.0),
                DVec3::splat(16.0),
                Projection::Orthographic { height: 60.0 },
            ),
        ),
        (
            "parallel along z",
            placed(
                DVec3::new(18.0, 13.0, 90.0),
                DVec3::new(18.0, 13.0, 0.0),
                Projection::Orthographic { height: 50.0 },
            ),
        ),
        (
            "wide",
            placed(
                DVec3::new(18.0, 13.0, 50.0),
                DVec3::splat(16.0),
                Projection::Perspective { fov_degrees: 140.0 },
            ),
        ),
        (
            "from afar",
            placed(
                DVec3::new(3e6, 2e6, 4e6),
                DVec3::splat(16.0),
                Projection::Perspective { fov_degrees: 7e-4 },
            ),
        ),
    ];
    for (what, camera) in views {
        check(
            what,
            &bytes().camera(camera),
            &settings(),
            GpuOptions::default(),
        );
    }
}

#[test]
fn cuts() {
    let plane = ClipPlane {
        point: DVec3::new(19.0, 13.0, 21.0),
        normal: DVec3::new(1.0, 0.5, -2.0),
    };
    check(
        "clip",
        &bytes().clip(plane),
        &settings(),
        GpuOptions::default(),
    );
    let region = Bounds {
        lo: DVec3::new(2.0, 0.0, 3.0),
        hi: DVec3::new(33.0, 20.0, 30.0),
    };
    let both = bytes().clip(plane).region_of_interest(region);
    check("clip and region", &both, &settings(), GpuOptions::default());
}

#[test]
fn volumes_in_several_images() {
    let options = GpuOptions {
        max_layers: Some(9),
        ..GpuOptions::default()
    };
    check("several images", &bytes(), &settings(), options);
    let shaded = RenderSettings {
        shading: Shading::Gradient,
        ..settings()
    };
    check("several images, shaded", &bytes(), &shaded, options);
    let Some(mut gpu) = renderer(GpuOptions::default()) else {
        return;
    };
    let Some(mut split) = renderer(options) else {
        return;
    };
    let whole = gpu.render(&bytes(), &shaded).expect("a good scene").frame;
    let split = split.render(&bytes(), &shaded).expect("a good scene").frame;
    assert_same_bits("one image and several", &whole, &split);
}

/// Negative control: the comparison notices a picture that is wrong by little.
#[test]
fn wrong_pictures_are_noticed() {
    let frame = on_cpu(&bytes(), &settings());
    let mut wrong = frame.clone();
    for pixel in &mut wrong.rgba {
        *pixel = pixel.map(|v| v * 1.1);
    }
    assert!(compare(&frame, &wrong).0 < 50.0);
    let mut speck = frame.clone();
    speck.rgba[96 * 36 + 48] = [1.0; 4];
    assert!(compare(&frame, &speck).1 > 8);
}
