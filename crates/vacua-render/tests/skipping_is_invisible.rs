//! The first contract: skipping changes no bit of any picture.
//!
//! Random small scenes, each rendered without skipping and with every method, compared bit by bit:
//! colour, alpha and depth. Cameras are inside, outside, aligned with the axes or grazing faces of
//! macrocells; transfer functions have knots exactly on data values.

use glam::DVec3;
use proptest::prelude::*;
use vacua_render::{
    Camera, ClipPlane, CpuRenderer, Frame, Integrator, Jitter, Projection, RenderSettings,
    Renderer, Scene, Shading, SkipMethod,
};
use vacua_volume::{
    Association, Bounds, CellMask, ColorPoint, ComponentChoice, CurvilinearGrid, DataArray,
    Dataset, Field, FieldChoice, Geometry, OpacityPoint, RectilinearGrid, Scalar, ScalarType,
    TransferFunction, UniformGrid, ValueScale, dispatch_scalar,
};

#[derive(Clone, Debug)]
struct Case {
    points: [usize; 3],
    scalar_type: ScalarType,
    association: Association,
    stretch: Option<f64>,
    /// Turn from layer to layer and disorder of a curvilinear grid.
    twist: Option<[f64; 2]>,
    spacing: [f64; 3],
    seed: u32,
    sparsity: u32,
    holes: bool,
    knots: Vec<(usize, f64)>,
    log: bool,
    view: usize,
    eye: [f64; 3],
    snap: bool,
    orthographic: bool,
    step: f64,
    side: usize,
    jitter: bool,
    clip: Option<[f64; 3]>,
    roi: bool,
    maximum: bool,
    gradient: bool,
}

fn case() -> impl Strategy<Value = Case> {
    let data = (
        prop::array::uniform3(2usize..16),
        prop::sample::select(ScalarType::ALL.to_vec()),
        prop_oneof![4 => Just(Association::Point), 1 => Just(Association::Cell)],
        prop::option::weighted(0.3, 1.01f64..1.6),
        prop::array::uniform3(prop_oneof![2 => Just(1.0), 1 => 0.1f64..10.0]),
        any::<u32>(),
        1u32..30,
        prop::bool::weighted(0.2),
    );
    let look = (
        prop::collection::vec(
            (0usize..9, prop_oneof![2 => Just(0.0), 1 => 0.0..0.9]),
            1..6,
        ),
        prop::bool::weighted(0.15),
        prop::bool::weighted(0.2),
        prop::bool::weighted(0.3),
    );
    let view = (
        0usize..5,
        prop::array::uniform3(-1.0f64..2.0),
        any::<bool>(),
        any::<bool>(),
        prop_oneof![Just(0.5), Just(1.0), 0.05f64..4.0],
        1usize..10,
        any::<bool>(),
        prop::option::weighted(0.3, prop::array::uniform3(-1.0f64..1.0)),
        prop::bool::weighted(0.2),
    );
    (data, look, view).prop_map(|(d, l, v)| Case {
        points: d.0,
        scalar_type: d.1,
        association: d.2,
        stretch: d.3,
        twist: None,
        spacing: d.4,
        seed: d.5,
        sparsity: d.6,
        holes: d.7,
        knots: l.0,
        log: l.1,
        maximum: l.2,
        gradient: l.3,
        view: v.0,
        eye: v.1,
        snap: v.2,
        orthographic: v.3,
        step: v.4,
        side: v.5,
        jitter: v.6,
        clip: v.7,
        roi: v.8,
    })
}

/// The same on curvilinear grids, from neat to so disordered that cells overlap and fold.
fn curvilinear_case() -> impl Strategy<Value = Case> {
    let twist = (
        -0.2f64..0.2,
        prop_oneof![Just(0.0), 0.0f64..0.4, 0.0f64..3.0],
    );
    (case(), twist).prop_map(|(case, (turn, disorder))| Case {
        points: case.points.map(|n| n.min(9)),
        twist: Some([turn, disorder]),
        step: case.step.max(0.3),
        ..case
    })
}

/// A lattice that turns about z as it rises, stretched along x, its points moved at random; a few
/// are nowhere if there are to be holes.
fn twisted(case: &Case, [turn, disorder]: [f64; 2]) -> CurvilinearGrid {
    let [nx, ny, _] = case.points;
    let ratio = case.stretch.unwrap_or(1.0);
    let xyz: Vec<f64> = (0..case.points.iter().product())
        .flat_map(|i: usize| {
            let noise = |a: usize| {
                let h = (i as u32 * 3 + a as u32) ^ case.seed;
                let h = h
                    .wrapping_mul(2_654_435_761)
                    .rotate_left(13)
                    .wrapping_mul(0x9e37_79b1);
                disorder * (f64::from(h >> 8) / f64::from(1 << 24) - 0.5)
            };
            let at = [i % nx, i / nx % ny, i / nx / ny].map(|c| c as f64);
            let x = case.spacing[0] * (ratio.powf(at[0]) * (at[0] + 1.0) + noise(0));
            let y = case.spacing[1] * (at[1] + noise(1));
            let z = case.spacing[2] * (at[2] + noise(2));
            let (sin, cos) = (turn * at[2]).sin_cos();
            let nowhere = case.holes && i % 37 == 5;
            let z = if nowhere { f64::NAN } else { z };
            [100.0 + cos * x - sin * y, sin * x + cos * y, z]
        })
        .collect();
    let positions = DataArray::from_vec(xyz, 3).expect("three components");
    CurvilinearGrid::new(case.points, positions).expect("a position a point")
}

/// Values that occur: few, so that knots meet them.
const LEVELS: [f64; 9] = [1.0, 2.0, 3.0, 5.0, 8.0, 20.0, 40.0, 70.0, 100.0];

fn scene(case: &Case) -> Scene {
    let n = match case.association {
        Association::Point => case.points,
        Association::Cell => case.points.map(|p| p - 1),
    };
    let hash = |i: usize| {
        (i as u32 ^ case.seed)
            .wrapping_mul(2_654_435_761)
            .rotate_left(15)
            >> 8
    };
    let value = |i: usize| {
        let h = hash(i.wrapping_mul(31));
        if case.holes && h % 29 == 7 {
            f64::NAN
        } else if h.is_multiple_of(case.sparsity) {
            LEVELS[(hash(i) % 9) as usize]
        } else {
            LEVELS[0]
        }
    };
    let array = dispatch_scalar!(case.scalar_type, T => {
        let values = (0..n.iter().product()).map(value);
        DataArray::from_vec(values.map(<T as Scalar>::from_f64).collect::<Vec<T>>(), 1)
    })
    .expect("one component");
    let geometry = match (case.twist, case.stretch) {
        (Some(twist), _) => Geometry::Curvilinear(twisted(case, twist)),
        (None, None) => Geometry::Uniform(
            UniformGrid::new(
                case.points,
                DVec3::new(-3.0, 0.5, 10.0),
                case.spacing.into(),
            )
            .expect("a good grid"),
        ),
        (None, Some(ratio)) => {
            let planes = |a: usize| {
                let mut x = vec![-1.0];
                for i in 1..case.points[a] {
                    x.push(x[i - 1] + case.spacing[a] * ratio.powi(i as i32));
                }
                x
            };
            Geometry::Rectilinear(
                RectilinearGrid::new(planes(0), planes(1), planes(2)).expect("increasing"),
            )
        }
    };
    let bounds = geometry.bounds();
    let field = Field::new("f", case.association, array);
    let mut mask = CellMask::new(geometry.num_cells());
    for cell in (0..mask.len()).filter(|&c| case.holes && hash(c + 7).is_multiple_of(5)) {
        mask.blank(cell);
    }
    let volume = Dataset::new(geometry, vec![field])
        .and_then(|d| d.with_blanked_cells(mask))
        .and_then(|d| d.volume(&FieldChoice::Only, ComponentChoice::Auto))
        .expect("it fits together");
    let mut knots: Vec<(f64, f64)> = case.knots.iter().map(|k| (LEVELS[k.0], k.1)).collect();
    knots.sort_by(|a, b| a.0.total_cmp(&b.0));
    let unit = 0.1 * bounds.diagonal();
    let scale = if case.log {
        ValueScale::Log
    } else {
        ValueScale::Linear
    };
    let colors = vec![
        ColorPoint {
            value: 1.0,
            srgb: [0.1, 0.2, 0.9],
        },
        ColorPoint {
            value: 100.0,
            srgb: [0.9, 0.7, 0.1],
        },
    ];
    let opacities = knots
        .iter()
        .map(|k| OpacityPoint {
            value: k.0,
            opacity: k.1,
        })
        .collect();
    let look = TransferFunction::new(colors, opacities, unit, scale).expect("sorted knots");
    let in_box = |f: [f64; 3]| bounds.lo + DVec3::from(f) * bounds.size();
    let mut eye = in_box(case.eye);
    if case.snap {
        // On a lattice point, and often in line with a face or an edge of macrocells.
        let cell = bounds.size() / DVec3::from(case.points.map(|n| (n - 1) as f64));
        eye = bounds.lo + ((eye - bounds.lo) / cell).round() * cell;
    }
    let at = match case.view {
        0 => eye + DVec3::X,
        1 => eye - DVec3::Y,
        2 => eye + DVec3::Z,
        3 => eye + DVec3::new(1.0, 1.0, 0.0),
        _ => bounds.center() + DVec3::splat(1e-3),
    };
    let projection = if case.orthographic {
        Projection::Orthographic {
            height: bounds.diagonal(),
        }
    } else {
        Projection::Perspective { fov_degrees: 60.0 }
    };
    let up = DVec3::new(0.1, 1.0, 0.3);
    let mut scene = Scene::new(volume, look).camera(Camera::Placed {
        eye,
        at,
        up,
        projection,
    });
    if let Some(normal) = case.clip {
        let plane = ClipPlane {
            point: bounds.center(),
            normal: DVec3::from(normal),
        };
        scene = scene.clip(plane);
    }
    if case.roi {
        let roi = Bounds {
            lo: in_box([0.2, 0.0, 0.3]),
            hi: in_box([0.9, 0.8, 1.0]),
        };
        scene = scene.region_of_interest(roi);
    }
    scene
}

fn settings(case: &Case, skip: SkipMethod) -> RenderSettings {
    RenderSettings {
        width: 9,
        height: 7,
        step: case.step,
        integrator: if case.maximum {
            Integrator::MaximumIntensity
        } else {
            Integrator::March
        },
        shading: if case.gradient {
            Shading::Gradient
        } else {
            Shading::None
        },
        skip,
        macrocell_side: Some(case.side),
        jitter: if case.jitter { Jitter::On } else { Jitter::Off },
        ..Default::default()
    }
}

/// Colour, alpha and depth as bits.
fn bits(frame: &Frame) -> Vec<[u32; 5]> {
    let depth = frame.depth.iter().map(|d| d.to_bits());
    frame
        .rgba
        .iter()
        .zip(depth)
        .map(|(p, d)| {
            let [r, g, b, a] = p.map(f32::to_bits);
            [r, g, b, a, d]
        })
        .collect()
}

/// Samples of a ray that are looked up before the ones before them are composited.
const SAMPLES_AT_A_TIME: u32 = 32;

fn check(renderers: &mut [CpuRenderer], case: &Case) -> Result<(), TestCaseError> {
    let scene = scene(case);
    let reference = renderers[0].render(&scene, &settings(case, SkipMethod::None));
    let reference = reference.expect("a good scene").frame;
    for (i, renderer) in renderers.iter_mut().enumerate() {
        for method in [SkipMethod::Grid, SkipMethod::Boxes, SkipMethod::Mesh] {
            let rendering = renderer
                .render(&scene, &settings(case, method))
                .expect("a good scene");
            prop_assert_eq!(rendering.report.method, method);
            let same = bits(&rendering.frame) == bits(&reference);
            prop_assert!(same, "{:?} differs with renderer {}", method, i);
            let counts = rendering.frame.samples.iter().zip(&reference.samples);
            for ((&with, &without), pixel) in counts.zip(&reference.rgba) {
                // A ray that ends early has its last samples looked up some blocks at a time, which
                // are others where blocks before them were skipped.
                let ended = pixel[3] > 0.99;
                let most = without + if ended { SAMPLES_AT_A_TIME } else { 0 };
                prop_assert!(with <= most, "{} samples instead of {}", with, without);
            }
        }
    }
    Ok(())
}

/// Checks that many random scenes.
fn check_all(cases: u32, case: impl Strategy<Value = Case>) {
    let mut renderers = [
        CpuRenderer::new(Some(1)).expect("a thread"),
        CpuRenderer::new(Some(3)).expect("threads"),
    ];
    let config = ProptestConfig {
        cases,
        ..ProptestConfig::default()
    };
    let mut runner = proptest::test_runner::TestRunner::new(config);
    let renderers = std::cell::RefCell::new(&mut renderers);
    let result = runner.run(&case, |case| check(&mut **renderers.borrow_mut(), &case));
    if let Err(error) = result {
        panic!("{error}");
    }
}

#[test]
fn in_ten_thousand_random_scenes() {
    check_all(10_000, case());
}

#[test]
fn in_random_curvilinear_scenes() {
    check_all(400, curvilinear_case());
}
