//! What the device makes of a volume, number by number against the CPU's: ranges of macrocells, which
//! of them are active, distances, and the boundary of the active ones.

mod common;

use common::*;
use vacua_gpu::{GpuOptions, GpuRenderer, Tracer};
use vacua_render::contract::RaySpace;
use vacua_render::{Integrator, RenderSettings, Renderer, Scene, SceneData, SkipMethod};
use vacua_skip::{
    ActiveMask, Activity, BoundaryMesh, Lattice, MAX_CELLS_PER_AXIS, Macrocells, PointSource,
};
use vacua_volume::{Association, Geometry, Scalar, TransferTable, ValueMap, ValueScale, Volume};

fn volume_of(scene: &Scene) -> &Volume {
    match &scene.data {
        SceneData::Volume(volume) => volume,
        SceneData::Packed(_) => panic!("no encoded mesh here"),
    }
}

/// The CPU's macrocells and mask.
fn on_host(scene: &Scene, side: usize, integrator: Integrator) -> (Macrocells, ActiveMask) {
    let volume = volume_of(scene);
    let space = RaySpace::of_planes(volume.geometry()).expect("a grid between planes");
    let scalars = volume.scalars();
    let function = &scene.transfer_function;
    let range = scalars.range(0).expect("finite values");
    let map = match function.scale() {
        ValueScale::Linear => ValueMap::for_range(scalars.scalar_type(), range),
        ValueScale::Log => ValueMap::IDENTITY,
    };
    let source = PointSource {
        scalars,
        association: volume.association(),
        points: volume.geometry().points(),
        map,
        blanked_cells: volume.blanked_cells().map(|m| &**m),
    };
    assert!(space.axes.iter().all(|a| a.cells() <= MAX_CELLS_PER_AXIS));
    let cells = Macrocells::of_grid(Lattice::new(space.axes, side).expect("cells"), source);
    let table = TransferTable::new(function, range, map);
    let activity = match integrator {
        Integrator::March => Activity::Extinction(&table),
        Integrator::MaximumIntensity => Activity::Above(map.rendered(function.color_range().lo)),
    };
    let mask = ActiveMask::new(&cells, activity);
    (cells, mask)
}

/// Chebyshev distances to the nearest active macrocell, up to a reach, the plain way.
fn distances(mask: &ActiveMask, reach: usize) -> Vec<u8> {
    let n = mask.counts();
    let len = n.iter().product();
    let at = |i: usize| [i % n[0], i / n[0] % n[1], i / n[0] / n[1]];
    let active: Vec<[usize; 3]> = (0..len).map(at).filter(|&p| mask.get(p)).collect();
    (0..len)
        .map(|i| {
            let apart = |p: &[usize; 3]| (0..3).map(|a| p[a].abs_diff(at(i)[a])).max();
            let nearest = active.iter().filter_map(apart).min().unwrap_or(reach);
            nearest.min(reach) as u8
        })
        .collect()
}

/// What the device's map of macrocells should hold, the plain way: 0 for active ones, 128 and the distance
/// where the box of this one and the next ones upwards holds none, else a bit for each box that holds none.
fn map(mask: &ActiveMask, reach: usize) -> Vec<u8> {
    let n = mask.counts();
    let of_distance = |(i, distance): (usize, u8)| {
        if distance == 0 {
            return 0;
        }
        let at = [i % n[0], i / n[0] % n[1], i / n[0] / n[1]];
        let is_empty = |box_number: usize| {
            (0..8).all(|corner| {
                let p = [0, 1, 2].map(|a| at[a] + (corner >> a & 1));
                corner & !box_number != 0 || (0..3).any(|a| p[a] >= n[a]) || !mask.get(p)
            })
        };
        if is_empty(7) {
            return 128 + distance;
        }
        (0..8).map(|b| u8::from(is_empty(b)) << b).sum()
    };
    let distances = distances(mask, reach);
    distances.into_iter().enumerate().map(of_distance).collect()
}

/// Renders by `grid` and by `mesh`, and compares all that was made on the way.
fn check(gpu: &mut GpuRenderer, what: &str, scene: &Scene, side: usize, integrator: Integrator) {
    let settings = |skip| RenderSettings {
        width: 8,
        height: 8,
        skip,
        macrocell_side: Some(side),
        integrator,
        ..settings()
    };
    let (cells, mask) = on_host(scene, side, integrator);
    let len = cells.lattice().len();
    gpu.render(scene, &settings(SkipMethod::Grid))
        .expect("a good scene");
    let found = gpu.ranges(side).expect("a device").expect("ranges");
    assert_eq!(found.len(), len, "{what}");
    // Some devices (lavapipe) give integers back with a rounding: n / 255 · 255 is not n there.
    let is_rounded = volume_of(scene).scalars().scalar_type().size_bytes() <= 2;
    let slack = if is_rounded { 2.0 * f32::EPSILON } else { 0.0 };
    for (i, [lo, hi]) in found.into_iter().enumerate() {
        let Some(expected) = cells.range(i) else {
            assert!(lo > hi, "{what}: macrocell {i} is empty: {lo}..{hi}");
            continue;
        };
        for (found, expected) in [(lo, expected.0), (hi, expected.1)] {
            // The texel was up to 65535 before an offset was added.
            let most = slack * (expected.abs() + 32768.0 * f32::from(expected < 0.0));
            let apart = (found - expected).abs();
            assert!(
                apart <= most,
                "{what}: macrocell {i}: {found}, not {expected}"
            );
        }
    }
    let found = gpu.macrocell_map().expect("a device").expect("a map");
    assert_eq!(found, map(&mask, 16), "{what}");
    let [nx, ny, _] = mask.counts();
    let expected: Vec<bool> = (0..len)
        .map(|i| mask.get([i % nx, i / nx % ny, i / nx / ny]))
        .collect();
    let with_map = gpu.active().expect("a device").expect("a mask");
    assert_eq!(with_map, expected, "{what}");
    let mesh = BoundaryMesh::new(&mask);
    let key = |q: &vacua_skip::Quad| (q.axis, q.plane, q.at, q.faces_up);
    let mut expected = mesh.quads().to_vec();
    expected.sort_by_key(key);
    for tracer in gpu.tracers() {
        let what = format!("{what}, {tracer:?}");
        gpu.set_tracer(Some(tracer));
        let rendered = gpu
            .render(scene, &settings(SkipMethod::Mesh))
            .expect("a good scene");
        assert_eq!(rendered.report.num_active, mask.num_active(), "{what}");
        let (mut faces, corners) = gpu.boundary().expect("a device").expect("a boundary");
        match tracer {
            Tracer::Packets => assert_eq!(corners.len(), 0, "{what}: nothing needs triangles"),
            _ => check_triangles(&what, &mesh, &cells, &faces, &corners),
        }
        faces.sort_by_key(key);
        assert_eq!(faces, expected, "{what}");
    }
    assert_valid(gpu);
}

/// The triangles of each face are those of the CPU, a little wider in their plane.
fn check_triangles(
    what: &str,
    mesh: &BoundaryMesh,
    cells: &Macrocells,
    faces: &[vacua_skip::Quad],
    corners: &[[[f32; 3]; 6]],
) {
    assert_eq!(faces.len(), corners.len(), "{what}");
    let (vertices, triangles) = (mesh.vertices(cells.lattice()), mesh.triangles());
    for (face, corners) in faces.iter().zip(corners) {
        let number = mesh.quads().iter().position(|q| q == face);
        let number = number.unwrap_or_else(|| panic!("{what}: {face:?} is on the boundary"));
        let expected = triangles[2 * number..2 * number + 2].as_flattened();
        for (found, &vertex) in corners.iter().zip(expected) {
            for a in 0..3 {
                let apart = (found[a] - vertices[vertex as usize][a]).abs();
                let most = if a == usize::from(face.axis) {
                    0.0
                } else {
                    1e-3
                };
                assert!(apart <= most, "{what}: {face:?}: {found:?}");
                assert_eq!(
                    apart > 0.0,
                    most > 0.0,
                    "{what}: wider all around: {face:?}"
                );
            }
        }
    }
}

fn scenes<T: Scalar>(
    gpu: &mut GpuRenderer,
    what: &str,
    (geometry, association): (Geometry, Association),
    (lo, hi, scale): (f64, f64, ValueScale),
    to: impl Fn(f64) -> T,
) {
    let volume = volume(geometry, association, shells, to);
    let scene = scene(volume, look(lo, hi, 12.0, scale));
    for side in [1, 5, 64] {
        let what = format!("{what}, K {side}");
        check(gpu, &what, &scene, side, Integrator::March);
    }
    check(gpu, what, &scene, 5, Integrator::MaximumIntensity);
}

#[test]
fn everything_on_the_device_is_what_the_cpu_makes() {
    let Some(mut gpu) = renderer(GpuOptions::default()) else {
        return;
    };
    let points = [23, 18, 20];
    let bytes = |v: f64| (255.0 * v) as u8;
    let linear = (0.0, 255.0, ValueScale::Linear);
    for association in [Association::Point, Association::Cell] {
        scenes(
            &mut gpu,
            "u8",
            (uniform(points), association),
            linear,
            bytes,
        );
        let stretched = (stretched(points), association);
        scenes(&mut gpu, "stretched", stretched, linear, bytes);
    }
    let uniform = || (uniform(points), Association::Point);
    let halves = (-3e4, 3e4, ValueScale::Linear);
    scenes(&mut gpu, "i16", uniform(), halves, |v| {
        (6e4 * v - 3e4) as i16
    });
    let offset = (1e9, 1e9 + 1.0, ValueScale::Linear);
    scenes(&mut gpu, "f64", uniform(), offset, |v| 1e9 + v);
    let log = (1e-3, 1e3, ValueScale::Log);
    scenes(&mut gpu, "log", uniform(), log, |v| {
        (1e-3 * 10f64.powf(6.0 * v)) as f32
    });
}
