//! Runs of active samples: more than a ray has room for, and longer ones than their numbers hold.

mod common;

use common::*;
use glam::DVec3;
use vacua_gpu::{GpuOptions, GpuRenderer};
use vacua_render::{Frame, RenderSettings, Renderer, Scene, SkipMethod};
use vacua_volume::{Association, ValueScale};

const POINTS: [usize; 3] = [97, 21, 18];

/// Sheets across x, as many as there are.
fn sheets(num: f64) -> Scene {
    let field = move |p: DVec3| if (num * p.x).fract() < 0.3 { 1.0 } else { 0.0 };
    let volume = volume(uniform(POINTS), Association::Point, field, |v| {
        (255.0 * v) as u8
    });
    scene(volume, look(0.0, 255.0, 60.0, ValueScale::Linear))
}

/// The pictures without skipping and by each method; all must be the same.
fn check(
    gpu: &mut GpuRenderer,
    what: &str,
    scene: &Scene,
    settings: &RenderSettings,
) -> [Frame; 2] {
    let mut methods = vec![(SkipMethod::Grid, None)];
    methods.extend(
        gpu.tracers()
            .into_iter()
            .map(|t| (SkipMethod::Mesh, Some(t))),
    );
    if gpu.device().info().has_ray_tracing() {
        methods.push((SkipMethod::Boxes, None));
    }
    let mut picture = |(skip, tracer)| -> Frame {
        gpu.set_tracer(tracer);
        let settings = RenderSettings {
            skip,
            ..settings.clone()
        };
        gpu.render(scene, &settings).expect("a good scene").frame
    };
    let without = picture((SkipMethod::None, None));
    assert!(!without.is_blank(), "{what}: something is seen");
    let frames: Vec<Frame> = methods.iter().map(|&m| picture(m)).collect();
    for ((method, tracer), frame) in methods.iter().zip(&frames) {
        let what = format!("{what}: {} by {tracer:?}", method.name());
        assert_same_bits(&what, frame, &without);
    }
    assert_valid(gpu);
    let [with, ..] = &frames[..] else {
        panic!("one method at least");
    };
    [with.clone(), without]
}

#[test]
fn more_runs_than_there_is_room_for() {
    let Some(mut gpu) = renderer(GpuOptions::default()) else {
        return;
    };
    let settings = RenderSettings {
        width: 40,
        height: 24,
        step: 0.1,
        macrocell_side: Some(1),
        ..settings()
    };
    let part =
        |[with, without]: [Frame; 2]| with.total_samples() as f64 / without.total_samples() as f64;
    let few = part(check(&mut gpu, "few", &sheets(4.0), &settings));
    let many = part(check(&mut gpu, "many", &sheets(16.0), &settings));
    assert!(few < 0.6, "every gap is skipped: {few}");
    // What follows the last run is one with it.
    assert!(many > few, "{many} against {few}");
}

#[test]
fn longer_rays_than_numbers_hold() {
    let Some(mut gpu) = renderer(GpuOptions::default()) else {
        return;
    };
    let settings = RenderSettings {
        // A row through the middle of what is flat.
        width: 3,
        height: 3,
        step: 4e-5,
        macrocell_side: Some(8),
        ..settings()
    };
    let [_, without] = check(&mut gpu, "long", &sheets(2.0), &settings);
    let most = without.samples.iter().max().copied().unwrap_or(0);
    assert!(most > 8 * 0xffff, "{most} samples");
}
