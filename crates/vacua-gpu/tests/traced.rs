//! `mesh` and `boxes`: pictures by tracing rays are those without skipping, to the bit.

mod common;

use common::*;
use glam::DVec3;
use vacua_gpu::{GpuOptions, GpuRenderer, Preference, Search, StructureOptions, Tracer};
use vacua_render::{
    Camera, ClipPlane, Frame, Integrator, Jitter, Projection, RenderSettings, Renderer, Scene,
    Shading, SkipMethod,
};
use vacua_volume::{Association, Geometry, OpacityPoint, TransferFunction, ValueScale};

const POINTS: [usize; 3] = [31, 29, 26];

/// All ways to trace rays.
const WAYS: [(SkipMethod, Tracer); 4] = [
    (SkipMethod::Mesh, Tracer::Pipeline),
    (SkipMethod::Mesh, Tracer::Query),
    (SkipMethod::Mesh, Tracer::Packets),
    (SkipMethod::Boxes, Tracer::Pipeline),
];

/// Whether a device can do so; where all must be tested, it has to.
fn has(gpu: &GpuRenderer, tracer: Tracer) -> bool {
    let is_there = gpu.tracers().contains(&tracer);
    if !is_there {
        assert!(
            std::env::var_os("VACUA_GPU_REQUIRED").is_none(),
            "{} cannot trace rays by {tracer:?}",
            gpu.device().name()
        );
        eprintln!("SKIPPED: {} by {tracer:?}", gpu.device().name());
    }
    is_there
}

fn small() -> RenderSettings {
    RenderSettings {
        width: 48,
        height: 40,
        macrocell_side: Some(4),
        ..settings()
    }
}

fn bytes(geometry: Geometry, association: Association) -> Scene {
    let volume = volume(geometry, association, shells, |v| (255.0 * v) as u8);
    scene(volume, look(0.0, 255.0, 12.0, ValueScale::Linear))
}

fn picture(gpu: &mut GpuRenderer, scene: &Scene, settings: &RenderSettings) -> Frame {
    gpu.render(scene, settings).expect("a good scene").frame
}

/// Every way to trace rays makes the picture of `none`, from fewer samples.
fn check(gpu: &mut GpuRenderer, what: &str, scene: &Scene, settings: &RenderSettings) {
    let with = |skip| RenderSettings {
        skip,
        ..settings.clone()
    };
    let whole = picture(gpu, scene, &with(SkipMethod::None));
    assert!(!whole.is_blank(), "{what}: something is seen");
    for (method, tracer) in WAYS {
        if !has(gpu, tracer) {
            continue;
        }
        gpu.set_tracer(Some(tracer));
        let what = format!("{what}: {} by {tracer:?}", method.name());
        let traced = picture(gpu, scene, &with(method));
        assert_same_bits(&what, &traced, &whole);
        assert!(
            traced.total_samples() < whole.total_samples(),
            "{what}: something is skipped"
        );
        assert!(gpu.num_outlined() > 0, "{what}");
    }
    assert_valid(gpu);
}

#[test]
fn every_kind_of_grid() {
    let Some(mut gpu) = renderer(GpuOptions::default()) else {
        return;
    };
    for association in [Association::Point, Association::Cell] {
        let scene = bytes(uniform(POINTS), association);
        check(&mut gpu, "uniform", &scene, &small());
        let scene = bytes(stretched(POINTS), association);
        check(&mut gpu, "stretched", &scene, &small());
    }
}

/// Uniform grids are marched by subgroups together where these can; here each ray is marched alone.
#[test]
fn rays_marched_alone() {
    let options = GpuOptions {
        rays: Search::Alone,
        ..GpuOptions::default()
    };
    let Some(mut gpu) = renderer(options) else {
        return;
    };
    let scene = bytes(uniform(POINTS), Association::Point);
    for shading in [Shading::None, Shading::Gradient] {
        let settings = RenderSettings { shading, ..small() };
        check(&mut gpu, &format!("{shading:?}"), &scene, &settings);
    }
}

#[test]
fn every_setting() {
    let Some(mut gpu) = renderer(GpuOptions::default()) else {
        return;
    };
    let scene = bytes(uniform(POINTS), Association::Point);
    let all = [
        (
            "shaded",
            RenderSettings {
                shading: Shading::Gradient,
                ..small()
            },
        ),
        (
            "maximum",
            RenderSettings {
                integrator: Integrator::MaximumIntensity,
                ..small()
            },
        ),
        (
            "frames",
            RenderSettings {
                samples_per_pixel: 3,
                jitter: Jitter::On,
                ..small()
            },
        ),
        (
            "K 1",
            RenderSettings {
                macrocell_side: Some(1),
                ..small()
            },
        ),
        (
            "long steps",
            RenderSettings {
                step: 3.0,
                macrocell_side: Some(3),
                ..small()
            },
        ),
        (
            "early, odd size",
            RenderSettings {
                termination: 0.5,
                width: 37,
                height: 51,
                ..small()
            },
        ),
    ];
    for (what, settings) in all {
        check(&mut gpu, what, &scene, &settings);
    }
    let cut = scene.clone().clip(ClipPlane {
        point: DVec3::new(11.0, 8.0, 13.0),
        normal: DVec3::new(1.0, 0.5, -2.0),
    });
    check(&mut gpu, "clip", &cut, &small());
}

/// Rays that run along planes between macrocells, or meet edges and corners, where a hit is easily
/// missed or counted twice.
#[test]
fn rays_along_planes_and_through_edges() {
    let Some(mut gpu) = renderer(GpuOptions::default()) else {
        return;
    };
    let geometry = || {
        let grid = vacua_volume::UniformGrid::new(POINTS, DVec3::ZERO, DVec3::ONE);
        Geometry::Uniform(grid.expect("a grid"))
    };
    let scene = bytes(geometry(), Association::Point);
    let placed = |eye, at, up, projection| Camera::Placed {
        eye,
        at,
        up,
        projection,
    };
    // A pixel is a quarter of a macrocell, and rays go through its corners or near them.
    let parallel = Projection::Orthographic { height: 40.0 };
    let narrow = Projection::Perspective { fov_degrees: 40.0 };
    let middle = DVec3::new(16.0, 16.0, 12.0);
    let mut cameras = Vec::new();
    for (name, forward, up) in [
        ("x", DVec3::X, DVec3::Y),
        ("y", -DVec3::Y, DVec3::Z),
        ("z", DVec3::Z, DVec3::X),
    ] {
        for nudge in [0.0, 0.5, 1e-6, -3e-5] {
            let nudge = nudge * (DVec3::ONE - forward.abs());
            let eye = middle - 60.0 * forward + nudge;
            let what = format!("along {name}, beside by {nudge}");
            cameras.push((what.clone(), placed(eye, middle + nudge, up, parallel)));
            cameras.push((what, placed(eye, middle + nudge, up, narrow)));
        }
        // Nearly along planes: a macrocell's side is crossed over the whole volume.
        let turn = 1e-5 * (up + forward.cross(up));
        let eye = middle - 60.0 * (forward + turn);
        cameras.push((
            format!("nearly along {name}"),
            placed(eye, middle, up, parallel),
        ));
    }
    for (name, diagonal) in [("face", DVec3::new(1.0, 1.0, 0.0)), ("body", DVec3::ONE)] {
        let eye = middle - 30.0 * diagonal;
        cameras.push((
            format!("diagonal of a {name}"),
            placed(eye, middle, DVec3::Z, parallel),
        ));
    }
    for (what, camera) in cameras {
        let scene = scene.clone().camera(camera);
        let settings = RenderSettings {
            width: 40,
            height: 40,
            macrocell_side: Some(2),
            ..small()
        };
        check(&mut gpu, &what, &scene, &settings);
    }
}

/// Rays so nearly along planes that a computed coordinate reaches one hundreds of samples before the line
/// does. Values of cells, which differ from one side of a plane to the other.
#[test]
fn rays_that_graze_planes() {
    let Some(mut gpu) = renderer(GpuOptions::default()) else {
        return;
    };
    let grid = vacua_volume::UniformGrid::new(POINTS, DVec3::ZERO, DVec3::ONE);
    let scene = bytes(Geometry::Uniform(grid.expect("a grid")), Association::Cell);
    let ulp = 0.5f64.powi(20);
    let middle = DVec3::new(16.0, 16.0, 12.0);
    for (name, forward, up) in [
        ("x", DVec3::X, DVec3::Y),
        ("y", -DVec3::Y, DVec3::Z),
        ("z", DVec3::Z, DVec3::X),
    ] {
        let across = up + forward.cross(up);
        for tilt in [1e-9, -1e-9, 1e-8, -1e-8, 4e-8, -4e-8] {
            for nudge in [0.5 - ulp, 0.5, 0.5 + ulp] {
                let at = middle + nudge * across.abs();
                let camera = Camera::Placed {
                    eye: at - 30.0 * (forward + tilt * across),
                    at,
                    up,
                    projection: Projection::Orthographic { height: 40.0 },
                };
                let settings = RenderSettings {
                    width: 40,
                    height: 40,
                    macrocell_side: Some(2),
                    step: 0.1,
                    ..small()
                };
                let what = format!("along {name}, tilted by {tilt}, beside by {nudge}");
                check(&mut gpu, &what, &scene.clone().camera(camera), &settings);
            }
        }
    }
}

#[test]
fn cameras_inside_and_far_away() {
    let Some(mut gpu) = renderer(GpuOptions::default()) else {
        return;
    };
    let scene = bytes(uniform(POINTS), Association::Point);
    let placed = |eye, fov_degrees| Camera::Placed {
        eye,
        at: DVec3::new(12.0, 8.0, 13.0),
        up: DVec3::Y,
        projection: Projection::Perspective { fov_degrees },
    };
    let inside = scene
        .clone()
        .camera(placed(DVec3::new(4.0, 5.0, 9.0), 70.0));
    check(&mut gpu, "inside", &inside, &small());
    let far = scene.camera(placed(DVec3::new(3e6, 2e6, 4e6), 5e-4));
    check(&mut gpu, "far away", &far, &small());
}

/// A transfer function with its opacities moved up or down the values.
fn moved(look: &TransferFunction, by: f64) -> TransferFunction {
    let shift = |p: &OpacityPoint| OpacityPoint {
        value: p.value + by,
        ..*p
    };
    TransferFunction::new(
        look.colors().to_vec(),
        look.opacities().iter().map(shift).collect(),
        look.unit_length(),
        look.scale(),
    )
    .expect("points in order")
}

/// Nothing is active in the first picture of all, so that runs were never found.
#[test]
fn nothing_to_be_seen() {
    let scene = bytes(uniform(POINTS), Association::Point);
    let look = moved(&scene.transfer_function, 300.0);
    let scene = scene.transfer_function(look);
    for (method, tracer) in WAYS {
        for rays in [Search::Together, Search::Alone] {
            let options = GpuOptions {
                tracer: Some(tracer),
                rays,
                ..GpuOptions::default()
            };
            let Some(mut gpu) = renderer(options) else {
                return;
            };
            if !has(&gpu, tracer) {
                continue;
            }
            let settings = RenderSettings {
                skip: method,
                ..small()
            };
            let frame = picture(&mut gpu, &scene, &settings);
            let what = format!("{} by {tracer:?}, {rays:?}", method.name());
            assert!(frame.is_blank() && frame.total_samples() == 0, "{what}");
            assert_valid(&gpu);
        }
    }
}

/// After every edit of the transfer function the picture is the one that a new renderer makes,
/// however structures are kept up to date.
#[test]
fn edits_of_the_transfer_function() {
    let options = |preference, compact, refit| GpuOptions {
        structures: StructureOptions {
            preference,
            compact,
            refit,
        },
        ..GpuOptions::default()
    };
    let scene = bytes(uniform(POINTS), Association::Point);
    for options in [
        options(Preference::FastTrace, false, false),
        options(Preference::FastBuild, true, false),
        options(Preference::FastTrace, false, true),
    ] {
        let Some(mut gpu) = renderer(options) else {
            return;
        };
        let mut refits = 0;
        // Triangles are moved only where there were triangles before.
        let ways = if options.structures.refit {
            &WAYS[..2]
        } else {
            &WAYS[..]
        };
        // Less is seen, then more, then nothing, then as at first.
        for by in [0.0, 60.0, 10.0, -40.0, 300.0, 0.0] {
            let look = moved(&scene.transfer_function, by);
            let scene = scene.clone().transfer_function(look);
            let whole = RenderSettings {
                skip: SkipMethod::None,
                ..small()
            };
            let whole = picture(&mut gpu, &scene, &whole);
            for &(method, tracer) in ways {
                if !has(&gpu, tracer) {
                    continue;
                }
                gpu.set_tracer(Some(tracer));
                let settings = RenderSettings {
                    skip: method,
                    ..small()
                };
                let what = format!("{options:?}, by {by}: {} by {tracer:?}", method.name());
                let traced = picture(&mut gpu, &scene, &settings);
                assert_same_bits(&what, &traced, &whole);
                let took = |stage| gpu.timings().0.iter().any(|(name, _)| *name == stage);
                let is_active = !whole.is_blank();
                assert_eq!(took("find"), is_active, "{what}: nothing to be met");
                assert_eq!(traced.total_samples() > 0, is_active, "{what}");
                refits += usize::from(took("refit"));
                let is_built = took("blas") || took("refit");
                assert_eq!(is_built, tracer == Tracer::Pipeline, "{what}: once an edit");
                assert_eq!(took("tree"), tracer == Tracer::Packets, "{what}");
                assert_eq!(
                    took("compact"),
                    options.structures.compact && is_built && method == SkipMethod::Mesh,
                    "{what}"
                );
            }
            let grid = RenderSettings {
                skip: SkipMethod::Grid,
                ..small()
            };
            let grid = picture(&mut gpu, &scene, &grid);
            assert_same_bits("grid", &grid, &whole);
        }
        // Edits move triangles as long as there is room for as many as they leave.
        let moves = options.structures.refit && has(&gpu, Tracer::Pipeline);
        assert_eq!(refits > 0, moves, "{options:?}");
        assert_valid(&gpu);
    }
}
