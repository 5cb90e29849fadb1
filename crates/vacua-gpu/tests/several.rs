//! Several devices that share a picture, and `auto`. Where there is one device, it is opened several
//! times.

mod common;

use common::*;
use vacua_gpu::{DeviceChoice, GpuError, GpuGroup, GpuOptions, Instance, Tracer};
use vacua_render::{Frame, RenderSettings, Renderer, Scene, Shading, SkipMethod};
use vacua_volume::{Association, OpacityPoint, TransferFunction, ValueScale};

fn scene_of_bytes(points: [usize; 3]) -> Scene {
    let volume = volume(uniform(points), Association::Point, shells, |v| {
        (255.0 * v) as u8
    });
    scene(volume, look(0.0, 255.0, 12.0, ValueScale::Linear))
}

const POINTS: [usize; 3] = [31, 29, 26];

/// So many renderers on one device that share pictures.
fn group(count: usize, options: GpuOptions) -> Option<GpuGroup> {
    let one = renderer(GpuOptions::default())?;
    let number = one.device().info().number;
    let choices = vec![DeviceChoice::Number(number); count];
    let instance = Instance::new(true).or_else(|_| Instance::new(false));
    let made = instance.and_then(|i| GpuGroup::with_devices(&i, &choices, options));
    Some(made.expect("the device opens again"))
}

#[test]
fn any_number_of_devices_makes_the_same_picture() {
    let Some(mut one) = renderer(GpuOptions::default()) else {
        return;
    };
    let scene = scene_of_bytes(POINTS);
    let mut settings = [
        settings(),
        RenderSettings {
            samples_per_pixel: 2,
            shading: Shading::Gradient,
            height: 50,
            ..settings()
        },
        RenderSettings {
            skip: SkipMethod::None,
            ..settings()
        },
    ]
    .to_vec();
    if !one.tracers().is_empty() {
        settings.push(RenderSettings {
            skip: SkipMethod::Mesh,
            width: 40,
            height: 37,
            ..settings[0].clone()
        });
    }
    // With 7, some have no row to make.
    let packets = one.tracers().into_iter().find(|t| *t == Tracer::Packets);
    for (count, tracer) in [(1, None), (2, None), (3, None), (7, None), (7, packets)] {
        let options = GpuOptions {
            tracer,
            ..GpuOptions::default()
        };
        let Some(mut group) = group(count, options) else {
            return;
        };
        one.set_tracer(tracer);
        assert_eq!(group.members().len(), count);
        for settings in &settings {
            let expected = one.render(&scene, settings).expect("a good scene").frame;
            let found = group.render(&scene, settings).expect("a good scene");
            let what = format!("{count} devices, {}, {tracer:?}", settings.skip.name());
            assert_same_bits(&what, &found.frame, &expected);
            assert_eq!(found.frame.samples, expected.samples, "{what}");
            assert_eq!(found.report.method, settings.skip);
        }
        for member in group.members() {
            assert_valid(member);
        }
    }
}

/// Pictures in the memory of earlier ones, of the same size and of another.
#[test]
fn pictures_in_the_place_of_earlier_ones() {
    let Some(mut one) = renderer(GpuOptions::default()) else {
        return;
    };
    let Some(mut two) = group(2, GpuOptions::default()) else {
        return;
    };
    let scene = scene_of_bytes(POINTS);
    let mut frames = [Frame::empty(0, 0), Frame::empty(5, 5)];
    for (width, height) in [(40, 30), (40, 30), (24, 37)] {
        let settings = RenderSettings {
            width,
            height,
            ..settings()
        };
        let expected = one.render(&scene, &settings).expect("a good scene").frame;
        let [alone, shared] = &mut frames;
        one.render_into(&scene, &settings, alone)
            .expect("a good scene");
        two.render_into(&scene, &settings, shared)
            .expect("a good scene");
        for frame in &mut frames {
            assert_same_bits("in its place", frame, &expected);
            assert_eq!(frame.samples, expected.samples);
            // What is left of it must not be seen in the next one.
            frame.rgba.fill([7.0; 4]);
            frame.depth.fill(7.0);
            frame.samples.fill(7);
        }
    }
}

#[test]
fn all_devices_are_found() {
    if renderer(GpuOptions::default()).is_none() {
        return;
    }
    let mut all = GpuGroup::new(DeviceChoice::All).expect("there is one");
    assert!(!all.members().is_empty());
    let found = all
        .render(&scene_of_bytes(POINTS), &settings())
        .expect("a good scene");
    assert!(!found.frame.is_blank());
    let none = GpuGroup::with_devices(
        &Instance::new(false).expect("a loader"),
        &[],
        GpuOptions::default(),
    );
    assert!(matches!(none.err(), Some(GpuError::NoDevice { .. })));
}

/// The transfer function with all opacities at or above a value, none below.
fn seen_from(look: &TransferFunction, value: f64) -> TransferFunction {
    let end = |value, opacity| OpacityPoint { value, opacity };
    TransferFunction::new(
        look.colors().to_vec(),
        vec![end(value, 0.0), end(value + 30.0, 0.5)],
        look.unit_length(),
        look.scale(),
    )
    .expect("points in order")
}

#[test]
fn auto_measures_keeps_its_choice_and_drops_it() {
    let options = GpuOptions {
        least_pixels: 0,
        ..GpuOptions::default()
    };
    let Some(mut gpu) = renderer(options) else {
        return;
    };
    let base = scene_of_bytes([61; 3]);
    let with = |skip| RenderSettings {
        width: 32,
        height: 32,
        skip,
        macrocell_side: Some(4),
        ..settings()
    };
    let mut show = |value: f64| {
        let look = seen_from(&base.transfer_function, value);
        let scene = base.clone().transfer_function(look);
        let whole = gpu
            .render(&scene, &with(SkipMethod::None))
            .expect("a good scene");
        let chosen = gpu
            .render(&scene, &with(SkipMethod::Auto))
            .expect("a good scene");
        assert_same_bits("auto", &chosen.frame, &whole.frame);
        let reason = chosen.report.reason.expect("auto says why");
        (chosen.report.method, chosen.report.auto_secs > 0.0, reason)
    };
    let (_, is_measured, reason) = show(180.0);
    assert!(is_measured, "{reason}");
    assert!(reason.contains("grid K=4"), "{reason}");
    assert!(!reason.contains("none"), "little is seen: {reason}");
    let (_, is_measured, _) = show(180.0);
    assert!(!is_measured, "the same picture");
    let (_, is_measured, _) = show(181.0);
    assert!(!is_measured, "nearly as much is seen");
    // Everything is seen: the first picture is by the old choice, the next one by a new one.
    let (_, is_measured, _) = show(-100.0);
    assert!(!is_measured, "not known before the first picture");
    let (_, is_measured, reason) = show(-100.0);
    assert!(is_measured && reason.contains("none"), "{reason}");
    if gpu.device().info().has_ray_tracing() {
        assert!(reason.contains("mesh K=4"), "{reason}");
    }
    assert_valid(&gpu);
}

#[test]
fn small_pictures_are_not_measured() {
    let Some(mut gpu) = renderer(GpuOptions::default()) else {
        return;
    };
    let auto = RenderSettings {
        skip: SkipMethod::Auto,
        ..settings()
    };
    let report = gpu
        .render(&scene_of_bytes(POINTS), &auto)
        .expect("a good scene")
        .report;
    assert_eq!(report.method, SkipMethod::Grid);
    assert!(report.reason.is_some_and(|r| r.contains("too small")));
}
