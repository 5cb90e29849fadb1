//! Curvilinear grids make the pictures that grids with straight cells make of the same field.

use std::time::Instant;

use glam::DVec3;
use vacua_render::{
    Camera, CpuRenderer, Frame, Integrator, RenderError, RenderSettings, Renderer, Scene, Shading,
    SkipMethod,
};
use vacua_volume::{
    Association, CellMask, ColorPoint, ComponentChoice, CurvilinearGrid, DataArray, Dataset, Field,
    FieldChoice, Geometry, OpacityPoint, TransferFunction, UniformGrid, ValueScale,
};

const POINTS: [usize; 3] = [12, 10, 8];

fn scene(geometry: Geometry, unit: f64, field: impl Fn(DVec3) -> f64) -> Scene {
    let values: Vec<f64> = (0..POINTS.iter().product())
        .map(|i| match &geometry {
            Geometry::Curvilinear(grid) => field(grid.position(i)),
            Geometry::Uniform(grid) => {
                let [nx, ny, _] = POINTS;
                let index = [i % nx, i / nx % ny, i / nx / ny].map(|c| c as f64);
                field(grid.world_from_index().transform_point3(index.into()))
            }
            Geometry::Rectilinear(_) | Geometry::Unstructured(_) => {
                unreachable!("not in these tests")
            }
        })
        .collect();
    let array = DataArray::from_vec(values, 1).expect("one component");
    let volume = Dataset::new(geometry, vec![Field::new("f", Association::Point, array)])
        .and_then(|d| d.volume(&FieldChoice::Only, ComponentChoice::Auto))
        .expect("it fits together");
    let color = |value, srgb| ColorPoint { value, srgb };
    let colors = vec![color(-10.0, [0.1, 0.2, 0.9]), color(10.0, [0.9, 0.7, 0.1])];
    let opacity = |value, opacity| OpacityPoint { value, opacity };
    let opacities = vec![opacity(-10.0, 0.2), opacity(10.0, 0.6)];
    let look = TransferFunction::new(colors, opacities, unit, ValueScale::Linear);
    Scene::new(volume, look.expect("sorted")).camera(Camera::orbit(30.0, 20.0))
}

/// The points of the uniform lattice, given one by one; inner ones moved if asked for.
fn positions(scale: f64, disorder: f64) -> CurvilinearGrid {
    let [nx, ny, nz] = POINTS;
    let xyz: Vec<f64> = (0..nx * ny * nz)
        .flat_map(|i| {
            let at = [i % nx, i / nx % ny, i / nx / ny];
            let inner = (0..3).all(|a| at[a] > 0 && at[a] + 1 < POINTS[a]);
            let move_by = if inner { disorder } else { 0.0 };
            [0, 1, 2].map(|a| {
                let wave = ((7 * i + 3 * a) as f64).sin();
                scale * (at[a] as f64 - 0.5 * (POINTS[a] - 1) as f64 + move_by * wave)
            })
        })
        .collect();
    let positions = DataArray::from_vec(xyz, 3).expect("three components");
    CurvilinearGrid::new(POINTS, positions).expect("a position a point")
}

fn uniform() -> Geometry {
    let origin = -0.5 * DVec3::from(POINTS.map(|n| (n - 1) as f64));
    Geometry::Uniform(UniformGrid::new(POINTS, origin, DVec3::ONE).expect("a good grid"))
}

fn linear(p: DVec3) -> f64 {
    p.dot(DVec3::new(0.9, -0.5, 1.1))
}

fn render(scene: &Scene, step: f64, shading: Shading, integrator: Integrator) -> Frame {
    let settings = RenderSettings {
        width: 64,
        height: 48,
        step,
        shading,
        integrator,
        skip: SkipMethod::Grid,
        ..Default::default()
    };
    let mut renderer = CpuRenderer::new(Some(1)).expect("a thread");
    renderer
        .render(scene, &settings)
        .expect("a good scene")
        .frame
}

/// Root mean square and largest difference.
fn difference(a: &Frame, b: &Frame) -> (f64, f64) {
    let pairs = a.rgba.iter().flatten().zip(b.rgba.iter().flatten());
    let (mut sum, mut largest) = (0.0, 0.0f64);
    for (a, b) in pairs {
        let d = f64::from((a - b).abs());
        sum += d * d;
        largest = largest.max(d);
    }
    ((sum / (4 * a.rgba.len()) as f64).sqrt(), largest)
}

#[test]
fn the_same_points_give_nearly_the_same_picture() {
    let straight = scene(uniform(), 3.0, linear);
    let bent = scene(Geometry::Curvilinear(positions(1.0, 0.0)), 3.0, linear);
    for (shading, integrator) in [
        (Shading::None, Integrator::March),
        (Shading::Gradient, Integrator::March),
        (Shading::None, Integrator::MaximumIntensity),
    ] {
        let a = render(&straight, 0.25, shading, integrator);
        let b = render(&bent, 0.25, shading, integrator);
        assert!(
            a.rgba.iter().filter(|p| p[3] > 0.2).count() > 500,
            "something is seen"
        );
        let (rms, largest) = difference(&a, &b);
        assert!(
            rms < 1e-3,
            "{shading:?} {integrator:?}: {rms}, at most {largest}"
        );
    }
}

#[test]
fn moving_inner_points_leaves_the_picture_of_a_linear_field() {
    let straight = render(
        &scene(uniform(), 3.0, linear),
        0.03,
        Shading::None,
        Integrator::March,
    );
    let moved = scene(Geometry::Curvilinear(positions(1.0, 0.3)), 3.0, linear);
    let moved = render(&moved, 0.03, Shading::None, Integrator::March);
    let (rms, largest) = difference(&straight, &moved);
    assert!(rms < 5e-3, "{rms}, at most {largest}");
    let other = render(
        &scene(uniform(), 3.0, |p| linear(p) + 2.0),
        0.03,
        Shading::None,
        Integrator::March,
    );
    assert!(
        difference(&straight, &other).0 > 5e-3,
        "another field is seen to differ"
    );
}

#[test]
fn metres_and_nanometres_give_the_same_picture() {
    let picture = |scale: f64| {
        let grid = Geometry::Curvilinear(positions(scale, 0.3));
        let scene = scene(grid, 3.0 * scale, |p| linear(p / scale));
        render(&scene, 0.25, Shading::Gradient, Integrator::March)
    };
    let (rms, _) = difference(&picture(1.0), &picture(1e-9));
    assert!(rms < 1e-3, "{rms}");
}

#[test]
fn without_a_cell_there_is_nothing_to_see() {
    let picture = |blanked: bool, nowhere: bool| {
        let mut scene = scene(Geometry::Curvilinear(positions(1.0, 0.0)), 3.0, linear);
        let grid = if nowhere {
            let num = POINTS.iter().product::<usize>();
            let xyz = DataArray::from_vec(vec![f64::NAN; 3 * num], 3).expect("three components");
            CurvilinearGrid::new(POINTS, xyz).expect("a position a point")
        } else {
            positions(1.0, 0.0)
        };
        let num_cells = POINTS.iter().map(|n| n - 1).product();
        let mut mask = CellMask::new(num_cells);
        (0..num_cells)
            .filter(|_| blanked)
            .for_each(|cell| mask.blank(cell));
        let values = vec![1.0f32; num_cells];
        let array = DataArray::from_vec(values, 1).expect("one component");
        let field = Field::new("f", Association::Cell, array);
        let volume = Dataset::new(Geometry::Curvilinear(grid), vec![field])
            .and_then(|d| d.with_blanked_cells(mask))
            .and_then(|d| d.volume(&FieldChoice::Only, ComponentChoice::Auto))
            .expect("it fits together");
        scene.data = volume.into();
        let settings = RenderSettings {
            width: 16,
            height: 16,
            ..Default::default()
        };
        let mut renderer = CpuRenderer::new(Some(1)).expect("a thread");
        let rendering = renderer.render(&scene, &settings);
        rendering.map(|r| r.frame.is_blank())
    };
    assert_eq!(picture(false, false).ok(), Some(false), "not blanked");
    assert_eq!(picture(true, false).ok(), Some(true), "blanked");
    assert!(matches!(
        picture(false, true),
        Err(RenderError::NoPositions)
    ));
}

#[test]
fn a_tangle_takes_no_longer_than_it_must() {
    let n = 24;
    let noise = |i: usize| {
        f64::from(
            (i as u32)
                .wrapping_mul(2_654_435_761)
                .rotate_left(13)
                .wrapping_mul(0x9e37_79b1)
                >> 8,
        )
    };
    let xyz: Vec<f64> = (0..3 * n * n * n).map(noise).collect();
    let positions = DataArray::from_vec(xyz, 3).expect("three components");
    let grid = CurvilinearGrid::new([n; 3], positions).expect("a position a point");
    let array = DataArray::from_vec(vec![1.0f32; n * n * n], 1).expect("one component");
    let field = Field::new("f", Association::Point, array);
    let volume = Dataset::new(Geometry::Curvilinear(grid), vec![field])
        .and_then(|d| d.volume(&FieldChoice::Only, ComponentChoice::Auto))
        .expect("it fits together");
    let mut scene = scene(uniform(), 3.0, linear);
    scene.data = volume.into();
    let settings = RenderSettings {
        width: 2,
        height: 2,
        step: 4.0,
        ..Default::default()
    };
    let start = Instant::now();
    let mut renderer = CpuRenderer::new(Some(1)).expect("a thread");
    renderer.render(&scene, &settings).expect("a picture");
    assert!(start.elapsed().as_secs() < 60);
}
