//! Pictures against closed forms: constant extinction against Beer–Lambert, and what a halved step
//! or a scaled world may change at most.
//!
//! A picture is the exact integral for an extinction that is constant from each sample to the next.
//! For extinction σ of total variation V along a ray (jumps at its ends included) that function
//! differs from σ by at most `dt · V` in the integral of the absolute difference, and so does
//! opacity at most; of a colour of at most 1 it is twice that. Along a straight ray through a linear
//! field σ rises from 0, is monotone, and falls to 0: V is at most twice its maximum.

use glam::{DAffine3, DMat3, DVec3};
use vacua_render::{Camera, CpuRenderer, Frame, Projection, RenderSettings, Renderer, Scene};
use vacua_volume::{
    Association, ColorPoint, ComponentChoice, DataArray, Dataset, Field, FieldChoice, Geometry,
    OpacityPoint, TransferFunction, UniformGrid, ValueScale, Volume,
};

const POINTS: [usize; 3] = [17, 14, 11];
const SIZE: (usize, usize) = (60, 44);

/// What rounding may add: sums of some hundred terms in `f32`.
const ROUNDING: f64 = 2e-5;

fn volume(scale: f64, value: impl Fn([f64; 3]) -> f32) -> Volume {
    let [nx, ny, nz] = POINTS;
    let at = |i: usize| [i % nx, i / nx % ny, i / nx / ny].map(|c| c as f64);
    let values: Vec<f32> = (0..nx * ny * nz).map(|i| value(at(i))).collect();
    let array = DataArray::from_vec(values, 1).expect("one component");
    let place = DAffine3::from_mat3_translation(
        DMat3::from_diagonal(DVec3::splat(scale)),
        DVec3::new(3.0, -2.0, 5.0) * scale,
    );
    let grid = UniformGrid::with_affine(POINTS, place).expect("a good grid");
    let field = Field::new("f", Association::Point, array);
    Dataset::new(Geometry::Uniform(grid), vec![field])
        .and_then(|d| d.volume(&FieldChoice::Only, ComponentChoice::Auto))
        .expect("it fits together")
}

/// Extinction grows with the value from nothing to that of opacity ½ a `unit`.
fn look(unit: f64) -> TransferFunction {
    let color = |value, srgb| ColorPoint { value, srgb };
    let colors = vec![color(0.0, [0.2, 0.9, 0.4]), color(1.0, [1.0, 0.3, 0.8])];
    let opacity = |value, opacity| OpacityPoint { value, opacity };
    let opacities = vec![opacity(0.0, 0.0), opacity(1.0, 0.5)];
    TransferFunction::new(colors, opacities, unit, ValueScale::Linear).expect("in order")
}

fn render(scene: &Scene, step: f64) -> Frame {
    let settings = RenderSettings {
        width: SIZE.0,
        height: SIZE.1,
        step,
        termination: 0.0,
        ..Default::default()
    };
    let mut renderer = CpuRenderer::new(Some(1)).expect("a thread");
    renderer
        .render(scene, &settings)
        .expect("a good scene")
        .frame
}

/// A linear field within 0 to 1.
fn linear(p: [f64; 3]) -> f32 {
    ((p[0] + 2.0 * p[1] + 0.5 * p[2]) / 50.0) as f32
}

const CAMERAS: [Camera; 2] = [
    Camera::Orbit {
        azimuth_degrees: 33.0,
        elevation_degrees: 21.0,
    },
    Camera::Placed {
        eye: DVec3::new(30.0, 9.0, 40.0),
        at: DVec3::new(11.0, 4.0, 10.0),
        up: DVec3::Y,
        projection: Projection::Orthographic { height: 18.0 },
    },
];

#[test]
fn constant_extinction_obeys_beer_and_lambert() {
    let unit = 4.0;
    let sigma = std::f64::consts::LN_2 / unit;
    for camera in CAMERAS {
        let scene = Scene::new(volume(1.0, |_| 1.0), look(unit)).camera(camera);
        let bounds = scene.data.bounds();
        let view = camera.view(bounds, SIZE.0, SIZE.1).expect("a good camera");
        let step = 0.5;
        let frame = render(&scene, step);
        let mut hits = 0;
        for (i, pixel) in frame.rgba.iter().enumerate() {
            let (x, y) = ((i % SIZE.0) as f64 + 0.5, (i / SIZE.0) as f64 + 0.5);
            let (origin, direction) = view.ray(x, y);
            let (a, b) = (
                (bounds.lo - origin) / direction,
                (bounds.hi - origin) / direction,
            );
            let length = (a.max(b).min_element() - a.min(b).max_element()).max(0.0);
            let alpha = f64::from(pixel[3]);
            let through = (-sigma * length).exp();
            // As many samples as fit, one more or one fewer.
            let bound = through * ((sigma * step).exp() - 1.0) + ROUNDING;
            assert!((1.0 - alpha - through).abs() <= bound, "pixel {i}: {alpha}");
            let exact = -(-sigma * step * f64::from(frame.samples[i])).exp_m1();
            assert!(
                (alpha - exact).abs() < ROUNDING,
                "pixel {i}: {alpha}, {exact}"
            );
            let white = vacua_volume::linear_from_srgb(1.0);
            assert!((f64::from(pixel[0]) - white * alpha).abs() < ROUNDING);
            hits += usize::from(alpha > 0.1);
        }
        assert!(hits > frame.rgba.len() / 5, "{hits} pixels show the box");
    }
}

/// The largest difference of opacity and of a colour.
fn differences(a: &Frame, b: &Frame) -> [f64; 2] {
    let mut worst = [0.0f64; 2];
    for (p, q) in a.rgba.iter().zip(&b.rgba) {
        for c in 0..4 {
            let kind = usize::from(c < 3);
            worst[kind] = worst[kind].max(f64::from((p[c] - q[c]).abs()));
        }
    }
    worst
}

#[test]
fn a_halved_step_changes_no_more_than_the_quadrature_error() {
    let unit = 3.0;
    let sigma_max = std::f64::consts::LN_2 / unit;
    let mut last = f64::INFINITY;
    for camera in CAMERAS {
        let scene = Scene::new(volume(1.0, linear), look(unit)).camera(camera);
        for step in [1.0, 0.5, 0.25] {
            let found = differences(&render(&scene, step), &render(&scene, step / 2.0));
            let bound = (step + step / 2.0) * 2.0 * sigma_max;
            assert!(
                found[0] <= bound + ROUNDING,
                "step {step}: {found:?} of {bound}"
            );
            assert!(found[1] <= 2.0 * bound + ROUNDING, "step {step}: {found:?}");
            assert!(found[0] > 0.0, "a coarser step is another picture");
            last = last.min(found[0]);
        }
    }
    assert!(last < 0.06, "errors shrink with the step: {last}");
}

#[test]
fn the_size_of_the_world_does_not_matter() {
    let unit = 3.0;
    let camera = CAMERAS[0];
    let of_scale = |scale: f64| {
        let scene = Scene::new(volume(scale, linear), look(unit * scale)).camera(camera);
        render(&scene, 0.5)
    };
    let one = of_scale(1.0);
    // A power of two is exact throughout.
    let exact = of_scale(1024.0);
    assert_eq!(one.rgba, exact.rgba);
    for (a, b) in one.depth.iter().zip(&exact.depth) {
        assert_eq!(a * 1024.0, *b);
    }
    // Any other number may move a sample across the boundary: one sample more or less.
    let sigma_max = std::f64::consts::LN_2 / unit;
    for scale in [1e3, 1e-3] {
        let other = of_scale(scale);
        let found = differences(&one, &other);
        let one_sample = -(-0.5 * sigma_max).exp_m1();
        assert!(found[0] <= one_sample + ROUNDING, "{scale}: {found:?}");
        let off = one.rgba.iter().zip(&other.rgba);
        let off = off.filter(|(p, q)| (p[3] - q[3]).abs() > ROUNDING as f32);
        assert!(off.count() < 20, "all but a few pixels are the same");
    }
}
