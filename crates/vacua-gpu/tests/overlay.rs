//! The boundary of what is active, drawn over the picture, as on the CPU.

mod common;

use common::*;
use glam::DVec3;
use vacua_gpu::GpuOptions;
use vacua_render::{Camera, Overlay, Projection, RenderSettings, Renderer, Scene, SkipMethod};
use vacua_volume::{Association, Geometry, ValueScale};

const POINTS: [usize; 3] = [44, 41, 38];

fn bytes(geometry: Geometry) -> Scene {
    let volume = volume(geometry, Association::Point, shells, |v| (255.0 * v) as u8);
    scene(volume, look(0.0, 255.0, 12.0, ValueScale::Linear))
}

#[test]
fn lines_are_where_the_cpu_has_them() {
    let Some(mut gpu) = renderer(GpuOptions::default()) else {
        return;
    };
    let placed = |eye: DVec3, projection| Camera::Placed {
        eye,
        at: DVec3::splat(16.0),
        up: DVec3::Y,
        projection,
    };
    let narrow = Projection::Perspective { fov_degrees: 50.0 };
    let parallel = Projection::Orthographic { height: 60.0 };
    let uniform = bytes(uniform(POINTS));
    let scenes = [
        ("uniform", uniform.clone()),
        ("stretched", bytes(stretched(POINTS))),
        (
            "parallel",
            uniform
                .clone()
                .camera(placed(DVec3::new(80.0, 70.0, 90.0), parallel)),
        ),
        (
            "inside",
            uniform
                .clone()
                .camera(placed(DVec3::new(4.0, 5.0, 9.0), narrow)),
        ),
    ];
    let mut methods = vec![SkipMethod::None, SkipMethod::Grid];
    if gpu.device().info().has_ray_tracing() {
        methods.push(SkipMethod::Mesh);
    }
    for (what, scene) in scenes {
        let plain = RenderSettings {
            macrocell_side: Some(6),
            width: 80,
            height: 60,
            ..settings()
        };
        let drawn = RenderSettings {
            overlay: Overlay::Boundary,
            ..plain.clone()
        };
        let expected = on_cpu(&scene, &drawn);
        let without = gpu.render(&scene, &plain).expect("a good scene").frame;
        assert!(
            compare(&without, &expected).0 < 30.0,
            "{what}: lines are seen"
        );
        for &skip in &methods {
            let what = format!("{what}, {}", skip.name());
            let settings = RenderSettings {
                skip,
                ..drawn.clone()
            };
            let found = gpu.render(&scene, &settings).expect("a good scene").frame;
            assert_alike(&what, &found, &expected);
            assert_eq!(found.depth, without.depth, "{what}: that of the volume");
        }
    }
    assert_valid(&gpu);
}
