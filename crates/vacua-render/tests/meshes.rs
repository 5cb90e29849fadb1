//! Unstructured meshes: skipping changes no bit of any picture, the picture of a constant field is
//! Beer and Lambert's, and cells of every kind show the same linear field.

use glam::DVec3;
use proptest::prelude::*;
use vacua_pack::{DetailLevel, EncodeOptions, PackedField, PackedVolume, Variant, encode};
use vacua_render::{
    Camera, ClipPlane, CpuRenderer, Detail, Frame, Integrator, Jitter, Progressive, Projection,
    RenderSettings, Renderer, Scene, SceneData, Shading, SkipMethod,
};
use vacua_volume::{
    Association, CellMask, CellType, ColorPoint, ComponentChoice, DataArray, Dataset, Field,
    FieldChoice, Geometry, OpacityPoint, TransferFunction, UnstructuredMesh, ValueScale,
};

/// Corners of a cube in VTK's order, as bits x, y, z.
const CUBE: [[usize; 3]; 8] = CellType::HEXAHEDRON_CORNERS;
const TETS: [[usize; 4]; 6] = [
    [0, 1, 2, 6],
    [0, 2, 3, 6],
    [0, 3, 7, 6],
    [0, 7, 4, 6],
    [0, 4, 5, 6],
    [0, 5, 1, 6],
];
const WEDGES: [[usize; 6]; 2] = [[0, 1, 3, 4, 5, 7], [1, 2, 3, 5, 6, 7]];

fn hash(i: usize, seed: u32) -> u32 {
    let h = (i as u32 ^ seed)
        .wrapping_mul(2_654_435_761)
        .rotate_left(15);
    h.wrapping_mul(0x9E37_79B1) >> 8
}

/// Values that occur: few, so that knots meet them.
const LEVELS: [f32; 9] = [1.0, 2.0, 3.0, 5.0, 8.0, 20.0, 40.0, 70.0, 100.0];

#[derive(Clone, Debug)]
struct Case {
    cubes: [usize; 3],
    /// Which cell each cube is cut into: tetrahedra, wedges, a hexahedron, or any.
    cut: usize,
    disorder: f64,
    growth: f64,
    scale: f64,
    seed: u32,
    sparsity: u32,
    holes: bool,
    cell_data: bool,
    knots: Vec<(usize, f64)>,
    eye: [f64; 3],
    along: usize,
    orthographic: bool,
    step: f64,
    side: usize,
    jitter: bool,
    clip: Option<[f64; 3]>,
    maximum: bool,
    gradient: bool,
}

fn case() -> impl Strategy<Value = Case> {
    let data = (
        prop::array::uniform3(1usize..7),
        0usize..4,
        prop_oneof![Just(0.0), 0.0f64..0.4, 0.0f64..2.0],
        prop_oneof![2 => Just(1.0), 1 => 1.0f64..1.8],
        prop::sample::select(vec![1e-9, 1.0, 1e7]),
        any::<u32>(),
        1u32..30,
        prop::bool::weighted(0.2),
        prop::bool::weighted(0.2),
    );
    let look = prop::collection::vec(
        (0usize..9, prop_oneof![2 => Just(0.0), 1 => 0.0..0.9]),
        1..6,
    );
    let view = (
        prop::array::uniform3(-1.0f64..2.0),
        0usize..4,
        any::<bool>(),
        prop_oneof![Just(0.5), Just(1.0), 0.2f64..4.0],
        1usize..4,
        any::<bool>(),
        prop::option::weighted(0.3, prop::array::uniform3(-1.0f64..1.0)),
        prop::bool::weighted(0.2),
        prop::bool::weighted(0.3),
    );
    (data, look, view).prop_map(|(d, knots, v)| Case {
        cubes: d.0,
        cut: d.1,
        disorder: d.2,
        growth: d.3,
        scale: d.4,
        seed: d.5,
        sparsity: d.6,
        holes: d.7,
        cell_data: d.8,
        knots,
        eye: v.0,
        along: v.1,
        orthographic: v.2,
        step: v.3,
        side: v.4,
        jitter: v.5,
        clip: v.6,
        maximum: v.7,
        gradient: v.8,
    })
}

/// A lattice of cubes cut into cells; growing along x, its inner points moved.
fn mesh(case: &Case) -> UnstructuredMesh {
    let points = case.cubes.map(|n| n + 1);
    let number = |at: [usize; 3]| at[0] + points[0] * (at[1] + points[1] * at[2]);
    let mut positions = Vec::new();
    for i in 0..points.iter().product() {
        let at = [
            i % points[0],
            i / points[0] % points[1],
            i / points[0] / points[1],
        ];
        for a in 0..3 {
            let at_edge = at[a] == 0 || at[a] == case.cubes[a];
            let noise = f64::from(hash(3 * i + a, case.seed)) / f64::from(1 << 24) - 0.5;
            let place = if a == 0 {
                case.growth.powi(at[a] as i32) * (at[a] as f64)
            } else {
                at[a] as f64
            };
            let moved = if at_edge { 0.0 } else { case.disorder * noise };
            positions.push((case.scale * (place + moved)) as f32);
        }
    }
    let (mut types, mut cells) = (Vec::new(), Vec::new());
    for i in 0..case.cubes.iter().product() {
        let low = [
            i % case.cubes[0],
            i / case.cubes[0] % case.cubes[1],
            i / case.cubes[0] / case.cubes[1],
        ];
        let corners = CUBE.map(|c| number([0, 1, 2].map(|a| low[a] + c[a])) as u32);
        let mut add = |cell_type, cell: &[usize]| {
            types.push(cell_type);
            cells.extend(cell.iter().map(|&k| corners[k]));
        };
        let cut = if case.cut == 3 {
            hash(i, case.seed) as usize % 3
        } else {
            case.cut
        };
        match cut {
            0 => TETS.iter().for_each(|t| add(CellType::Tetrahedron, t)),
            1 => WEDGES.iter().for_each(|w| add(CellType::Wedge, w)),
            _ => add(CellType::Hexahedron, &[0, 1, 2, 3, 4, 5, 6, 7]),
        }
    }
    let positions = DataArray::from_vec(positions, 3).expect("triples");
    let cells = DataArray::from_vec(cells, 1).expect("one column");
    UnstructuredMesh::mixed(positions, types, cells).expect("valid")
}

fn look(knots: &[(f64, f64)], unit: f64) -> TransferFunction {
    let colors = [(1.0, [0.1, 0.2, 0.9]), (100.0, [0.9, 0.7, 0.1])];
    let colors = colors.map(|(value, srgb)| ColorPoint { value, srgb });
    let opacities = knots
        .iter()
        .map(|&(value, opacity)| OpacityPoint { value, opacity });
    TransferFunction::new(
        colors.to_vec(),
        opacities.collect(),
        unit,
        ValueScale::Linear,
    )
    .expect("sorted knots")
}

fn scene_of(
    mesh: UnstructuredMesh,
    association: Association,
    values: Vec<f32>,
    look: TransferFunction,
) -> Scene {
    let values = DataArray::from_vec(values, 1).expect("one column");
    let field = Field::new("f", association, values);
    let volume = Dataset::new(Geometry::Unstructured(mesh), vec![field])
        .and_then(|d| d.volume(&FieldChoice::Only, ComponentChoice::Auto))
        .expect("it fits together");
    Scene::new(volume, look)
}

fn scene(case: &Case) -> Scene {
    let mesh = mesh(case);
    let association = if case.cell_data {
        Association::Cell
    } else {
        Association::Point
    };
    let n = match association {
        Association::Point => mesh.num_points(),
        Association::Cell => mesh.num_cells(),
    };
    let value = |i: usize| {
        let h = hash(31 * i, case.seed);
        if case.holes && h % 29 == 7 {
            f32::NAN
        } else if h.is_multiple_of(case.sparsity) {
            LEVELS[hash(i, case.seed) as usize % 9]
        } else {
            LEVELS[0]
        }
    };
    let mut mask = CellMask::new(mesh.num_cells());
    for cell in (0..mask.len()).filter(|&c| case.holes && hash(c, 7).is_multiple_of(5)) {
        mask.blank(cell);
    }
    let bounds = mesh.bounds().expect("points");
    let mesh = mesh.with_blanked_cells(mask).expect("fits");
    let mut knots: Vec<(f64, f64)> = case
        .knots
        .iter()
        .map(|k| (f64::from(LEVELS[k.0]), k.1))
        .collect();
    knots.sort_by(|a, b| a.0.total_cmp(&b.0));
    let look = look(&knots, 0.1 * bounds.diagonal());
    let eye = bounds.lo + DVec3::from(case.eye) * bounds.size();
    let at = match case.along {
        0 => eye + bounds.size() * DVec3::X,
        1 => eye - bounds.size() * DVec3::Y,
        2 => eye + bounds.size() * DVec3::Z,
        _ => bounds.center() + 1e-3 * bounds.size(),
    };
    let projection = if case.orthographic {
        Projection::Orthographic {
            height: bounds.diagonal(),
        }
    } else {
        Projection::Perspective { fov_degrees: 60.0 }
    };
    let scene = scene_of(mesh, association, (0..n).map(value).collect(), look);
    let scene = scene.camera(Camera::Placed {
        eye,
        at,
        up: DVec3::new(0.1, 1.0, 0.3),
        projection,
    });
    match case.clip {
        None => scene,
        Some(normal) => scene.clip(ClipPlane {
            point: bounds.center(),
            normal: DVec3::from(normal),
        }),
    }
}

/// Colour, alpha and depth as bits.
fn bits(frame: &Frame) -> Vec<[u32; 5]> {
    let depth = frame.depth.iter().map(|d| d.to_bits());
    let pixels = frame.rgba.iter().zip(depth);
    pixels
        .map(|(p, d)| {
            let [r, g, b, a] = p.map(f32::to_bits);
            [r, g, b, a, d]
        })
        .collect()
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

#[test]
fn skipping_is_invisible() {
    let renderers = [Some(1), Some(3)].map(|n| CpuRenderer::new(n).expect("threads"));
    let renderers = std::cell::RefCell::new(renderers);
    let visible = std::cell::Cell::new(0);
    let config = ProptestConfig {
        cases: 300,
        failure_persistence: None,
        ..ProptestConfig::default()
    };
    let mut runner = proptest::test_runner::TestRunner::new(config);
    let result = runner.run(&case(), |case| {
        let scene = scene(&case);
        let settings = |skip| settings(&case, skip);
        let mut renderers = renderers.borrow_mut();
        let reference = renderers[0].render(&scene, &settings(SkipMethod::None));
        let reference = match reference {
            Ok(rendering) => rendering.frame,
            // All cells blanked.
            Err(_) => return Ok(()),
        };
        visible.set(visible.get() + usize::from(!reference.is_blank()));
        for (i, renderer) in renderers.iter_mut().enumerate() {
            for method in [SkipMethod::Grid, SkipMethod::Boxes, SkipMethod::Mesh] {
                let rendering = renderer.render(&scene, &settings(method));
                let frame = rendering.expect("a good scene").frame;
                prop_assert!(
                    bits(&frame) == bits(&reference),
                    "{method:?} with renderer {i}"
                );
                prop_assert!(frame.total_samples() <= reference.total_samples());
            }
        }
        Ok(())
    });
    if let Err(error) = result {
        panic!("{error}");
    }
    assert!(
        visible.get() > 60,
        "{} pictures with anything",
        visible.get()
    );
}

/// The scene with its mesh encoded in a variant, into sub-meshes of few vertices.
fn encoded(scene: Scene, variant: Variant) -> Scene {
    let SceneData::Volume(volume) = &scene.data else {
        return scene;
    };
    let options = EncodeOptions {
        variant,
        index_bits: 8,
    };
    let mesh = volume.mesh().expect("a mesh");
    let encoded = encode(mesh, options).expect("encodable");
    let (name, association) = (volume.name(), volume.association());
    let scalars = volume.scalars();
    let field = PackedField::pack(&encoded.mesh, &encoded.map, name, association, scalars);
    let volume = PackedVolume::new(encoded.mesh, field.expect("fits"));
    Scene {
        data: volume.into(),
        ..scene
    }
}

#[test]
fn skipping_is_invisible_at_every_level_of_detail() {
    let renderer = std::cell::RefCell::new(CpuRenderer::new(Some(1)).expect("threads"));
    let visible = std::cell::Cell::new(0);
    let skipped = std::cell::Cell::new(0);
    let config = ProptestConfig {
        cases: 150,
        failure_persistence: None,
        ..ProptestConfig::default()
    };
    let mut runner = proptest::test_runner::TestRunner::new(config);
    let result = runner.run(&(case(), 0usize..3), |(case, variant)| {
        let variants = [Variant::MultiLeaves, Variant::MultiNodes, Variant::Small];
        let scene = encoded(scene(&case), variants[variant]);
        let mut renderer = renderer.borrow_mut();
        for level in DetailLevel::ALL {
            let settings = |skip| RenderSettings {
                detail: Detail::Level(level),
                ..settings(&case, skip)
            };
            let reference = match renderer.render(&scene, &settings(SkipMethod::None)) {
                Ok(rendering) => rendering.frame,
                // All cells blanked.
                Err(_) => return Ok(()),
            };
            visible.set(visible.get() + usize::from(!reference.is_blank()));
            for method in [SkipMethod::Grid, SkipMethod::Boxes, SkipMethod::Mesh] {
                let rendering = renderer.render(&scene, &settings(method));
                let frame = rendering.expect("a good scene").frame;
                prop_assert!(bits(&frame) == bits(&reference), "{method:?} at {level:?}");
                prop_assert!(frame.total_samples() <= reference.total_samples());
                let fewer = frame.total_samples() < reference.total_samples();
                skipped.set(skipped.get() + usize::from(fewer));
            }
        }
        Ok(())
    });
    if let Err(error) = result {
        panic!("{error}");
    }
    assert!(visible.get() > 60, "{} pictures", visible.get());
    assert!(skipped.get() > 60, "{} pictures", skipped.get());
}

/// The last of the pictures on the way is the picture, and coarse ones come before it.
#[test]
fn a_progressive_picture_ends_as_it_should() {
    let mut renderer = CpuRenderer::new(Some(2)).expect("threads");
    let case = Case {
        knots: vec![(0, 0.0), (6, 0.2), (8, 0.8)],
        ..plain(3, 1.0)
    };
    let scene = scene(&case);
    for (samples_per_pixel, jitter) in [(1, Jitter::Auto), (3, Jitter::Auto), (2, Jitter::Off)] {
        let settings = RenderSettings {
            samples_per_pixel,
            jitter,
            ..settings(&case, SkipMethod::Auto)
        };
        let whole = renderer.render(&scene, &settings).expect("renders").frame;
        let mut pictures = Progressive::new(&mut renderer, &scene, settings);
        let mut all = Vec::new();
        while pictures.remaining() > 0 {
            let picture = pictures.next().expect("as many as remain");
            all.push(picture.expect("renders").frame);
        }
        assert!(pictures.next().is_none());
        assert_eq!(all.len(), 2 + samples_per_pixel as usize);
        let last = all.last().expect("pictures");
        assert!(bits(last) == bits(&whole));
        assert_eq!(last.samples, whole.samples);
        for coarse in &all[..2] {
            assert!(!coarse.is_blank() && bits(coarse) != bits(&whole));
        }
    }
}

#[test]
fn grids_have_no_levels_of_detail() {
    let grid = vacua_volume::UniformGrid::new([3; 3], DVec3::ZERO, DVec3::ONE).expect("a grid");
    let values = DataArray::from_vec((0..27u8).collect(), 1).expect("one column");
    let field = Field::new("f", Association::Point, values);
    let volume = Dataset::new(Geometry::Uniform(grid), vec![field])
        .and_then(|d| d.volume(&FieldChoice::Only, ComponentChoice::Auto))
        .expect("it fits together");
    let scene = Scene::new(volume, look(&[(0.0, 0.5)], 1.0));
    let mut renderer = CpuRenderer::new(Some(1)).expect("threads");
    let settings = RenderSettings {
        width: 8,
        height: 8,
        detail: Detail::Level(DetailLevel::Leaf),
        ..Default::default()
    };
    let error = renderer.render(&scene, &settings).expect_err("no levels");
    assert!(error.to_string().contains("only meshes"), "{error}");
    let all: Vec<_> = Progressive::new(&mut renderer, &scene, RenderSettings::default())
        .map(|picture| picture.expect("renders"))
        .collect();
    assert_eq!(all.len(), 1);
}

fn plain(cut: usize, scale: f64) -> Case {
    Case {
        cubes: [5; 3],
        cut,
        disorder: 0.3,
        growth: 1.0,
        scale,
        seed: 5,
        sparsity: 1,
        holes: false,
        cell_data: false,
        knots: Vec::new(),
        eye: [0.0; 3],
        along: 0,
        orthographic: true,
        step: 0.5,
        side: 2,
        jitter: false,
        clip: None,
        maximum: false,
        gradient: false,
    }
}

/// Straight through a cube of side 5 of constant opacity, in units of any size.
#[test]
fn a_constant_field_absorbs_as_beer_and_lambert_say() {
    let mut renderer = CpuRenderer::new(Some(2)).expect("threads");
    for (cut, scale) in [(0, 1.0), (1, 1e-9), (2, 1e9), (3, 1.0)] {
        let mesh = mesh(&plain(cut, scale));
        let bounds = mesh.bounds().expect("points");
        let values = vec![50.0; mesh.num_points()];
        // A fifth of the light is lost on each unit of length.
        let look = look(&[(0.0, 0.2), (100.0, 0.2)], scale);
        let center = bounds.center();
        let scene = scene_of(mesh, Association::Point, values, look).camera(Camera::Placed {
            eye: center - 20.0 * scale * DVec3::Z,
            at: center,
            up: DVec3::Y,
            projection: Projection::Orthographic {
                height: 4.0 * scale,
            },
        });
        let settings = RenderSettings {
            width: 8,
            height: 8,
            step: 0.05,
            termination: 0.0,
            skip: SkipMethod::Grid,
            ..Default::default()
        };
        let frame = renderer.render(&scene, &settings).expect("renders").frame;
        let expected = 1.0 - 0.8f64.powi(5);
        for pixel in &frame.rgba {
            let alpha = f64::from(pixel[3]);
            // One sample more or less at the end.
            assert!(
                (alpha - expected).abs() < 0.01,
                "{cut}: {alpha} for {expected}"
            );
        }
    }
}

/// The same linear field in tetrahedra, wedges, hexahedra and a mix of them.
#[test]
fn every_kind_of_cell_shows_the_same_linear_field() {
    let mut renderer = CpuRenderer::new(Some(2)).expect("threads");
    let mut pictures: Vec<Frame> = Vec::new();
    for cut in 0..4 {
        let mut case = plain(cut, 1.0);
        if cut == 3 {
            // Bent faces of different cells would leave gaps between them.
            case.disorder = 0.0;
        }
        let mesh = mesh(&case);
        let value = |i: usize| {
            let p = mesh.position(i);
            (10.0 + 8.0 * p.x + 4.0 * p.y - 2.0 * p.z) as f32
        };
        let values = (0..mesh.num_points()).map(value).collect();
        let look = look(&[(0.0, 0.0), (20.0, 0.0), (25.0, 0.4), (60.0, 0.1)], 1.0);
        let scene = scene_of(mesh.clone(), Association::Point, values, look);
        let settings = RenderSettings {
            width: 32,
            height: 32,
            // The steps follow the cells' sizes: fine enough not to matter.
            step: 0.02,
            shading: Shading::Gradient,
            ..Default::default()
        };
        pictures.push(renderer.render(&scene, &settings).expect("renders").frame);
    }
    assert!(!pictures[0].is_blank());
    for (cut, picture) in pictures.iter().enumerate() {
        for (a, b) in picture.rgba.iter().zip(&pictures[0].rgba) {
            for c in 0..4 {
                assert!((a[c] - b[c]).abs() < 0.01, "{cut}: {a:?} {b:?}");
            }
        }
    }
}
