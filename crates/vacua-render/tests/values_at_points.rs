//! Values at points of the world: as VTK's probe filter finds them in real files, and exact for
//! linear fields in grids of every kind.

use std::path::{Path, PathBuf};

use glam::{DAffine3, DMat3, DVec3};
use proptest::prelude::*;
use vacua_render::{RenderError, VolumeSampler};
use vacua_volume::{
    Association, CellMask, ComponentChoice, CurvilinearGrid, DataArray, Dataset, Field,
    FieldChoice, Geometry, RectilinearGrid, UniformGrid, Volume,
};

fn data_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../vacua-io/tests/data")
}

/// Compares with a table of VTK's; gives the largest error in parts of the field's range and how
/// many points were inside.
fn compare(file: &str, table: &str) -> (f64, usize) {
    let dataset = vacua_io::open(data_folder().join(file)).expect("readable");
    let volume = dataset
        .volume(&FieldChoice::Index(0), ComponentChoice::Auto)
        .expect("a field");
    let sampler = VolumeSampler::new(&volume).expect("positions");
    let width = volume.scalars().range(0).expect("finite values").width();
    let text = std::fs::read_to_string(data_folder().join("probe").join(table)).expect("committed");
    let (mut worst, mut num_inside, mut num_points) = (0.0f64, 0, 0);
    for line in text.lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |i: usize| cells[i].parse::<f64>().expect("a number");
        let at = DVec3::new(number(0), number(1), number(2));
        let found = sampler.sample(at);
        assert_eq!(found.is_some(), cells[3] == "1", "{file} at {at}");
        if let Some(found) = found {
            worst = worst.max((found - number(4)).abs() / width);
            num_inside += 1;
        }
        num_points += 1;
    }
    assert_eq!(num_points, 200);
    (worst, num_inside)
}

#[test]
fn are_those_that_vtk_finds() {
    for (file, table) in [
        ("hydrogen.vti", "hydrogen.csv"),
        ("ironProt.vtk", "ironProt.csv"),
        ("viscous_fingers_060.vti", "viscous_fingers_060.csv"),
        ("stretched.vtr", "stretched.csv"),
        ("curved.vts", "curved.csv"),
        ("voxels/avg152T1_RL_nifti.nii.gz", "avg152T1_RL_nifti.csv"),
    ] {
        let (worst, num_inside) = compare(file, table);
        assert!(worst <= 1e-6, "{file}: off by {worst} of the range");
        assert!(num_inside >= 20, "{file}: only {num_inside} points inside");
    }
}

#[test]
fn a_wrong_table_fails() {
    let outcome = std::panic::catch_unwind(|| compare("hydrogen.vti", "viscous_fingers_060.csv"));
    assert!(outcome.map_or(true, |(worst, _)| worst > 1e-6));
}

/// A field on the points of a grid.
fn volume(geometry: Geometry, association: Association, values: Vec<f64>) -> Volume {
    let array = DataArray::from_vec(values, 1).expect("one component");
    Dataset::new(geometry, vec![Field::new("f", association, array)])
        .and_then(|d| d.volume(&FieldChoice::Only, ComponentChoice::Auto))
        .expect("it fits together")
}

/// World positions of all points.
fn positions(geometry: &Geometry) -> Vec<DVec3> {
    let [nx, ny, _] = geometry.points();
    (0..geometry.num_points())
        .map(|i| {
            let index = [i % nx, i / nx % ny, i / nx / ny];
            match geometry {
                Geometry::Uniform(grid) => grid
                    .world_from_index()
                    .transform_point3(DVec3::from(index.map(|i| i as f64))),
                Geometry::Rectilinear(grid) => {
                    DVec3::from([0, 1, 2].map(|a| grid.coordinates(a)[index[a]]))
                }
                Geometry::Curvilinear(grid) => grid.position(i),
                Geometry::Unstructured(mesh) => mesh.position(i),
            }
        })
        .collect()
}

/// A lattice that turns about z as it rises and bulges a little.
fn twisted(points: [usize; 3], scale: f64, turn: f64) -> CurvilinearGrid {
    let [nx, ny, _] = points;
    let xyz: Vec<f64> = (0..points.iter().product())
        .flat_map(|i: usize| {
            let at = [i % nx, i / nx % ny, i / nx / ny];
            let [x, y, z] = [0, 1, 2].map(|a| at[a] as f64 - 0.5 * (points[a] - 1) as f64);
            let (sin, cos) = (turn * z).sin_cos();
            let bulge = 1.0 + 0.1 * (0.7 * y).sin();
            [
                scale * bulge * (cos * x - sin * y),
                scale * bulge * (sin * x + cos * y),
                scale * (z + 0.1 * (x + y).sin()),
            ]
        })
        .collect();
    let positions = DataArray::from_vec(xyz, 3).expect("three components");
    CurvilinearGrid::new(points, positions).expect("a position a point")
}

proptest! {
    #[test]
    fn of_linear_fields_are_exact(
        points in prop::array::uniform3(2usize..9),
        kind in 0usize..3,
        scale in prop::sample::select(vec![1e-9, 1.0, 1e6]),
        ratio in 1.0f64..1.5,
        turn in -0.1f64..0.1,
        slope in prop::array::uniform3(-1.0f64..1.0),
        picks in prop::collection::vec(
            (any::<prop::sample::Index>(), prop::array::uniform3(0.001f64..0.999)), 20),
    ) {
        let geometry = match kind {
            0 => {
                let turned = DMat3::from_rotation_y(turn * 7.0)
                    * DMat3::from_rotation_x(turn * 13.0)
                    * DMat3::from_diagonal(scale * DVec3::new(1.0, ratio, -0.7));
                let map = DAffine3::from_mat3_translation(turned, scale * DVec3::new(-3.0, 2.0, 1.0));
                Geometry::Uniform(UniformGrid::with_affine(points, map).expect("invertible"))
            }
            1 => {
                let planes = |n: usize| (0..n).map(|i| scale * (ratio.powi(i as i32) * (1.0 + i as f64) - 4.0)).collect();
                Geometry::Rectilinear(
                    RectilinearGrid::new(planes(points[0]), planes(points[1]), planes(points[2]))
                        .expect("increasing"),
                )
            }
            _ => Geometry::Curvilinear(twisted(points, scale, turn)),
        };
        let slope = DVec3::from(slope) / scale;
        let at = positions(&geometry);
        let values: Vec<f64> = at.iter().map(|p| slope.dot(*p)).collect();
        // The size of the terms of the field: their sum may be small by cancellation.
        let size = at.iter().map(|p| (slope * *p).abs().element_sum()).fold(0.0, f64::max);
        let sampler = VolumeSampler::new(&volume(geometry, Association::Point, values)).expect("positions");
        let cells = points.map(|n| n - 1);
        for (pick, local) in picks {
            let cell = pick.index(cells.iter().product());
            let [x, y, z] = [cell % cells[0], cell / cells[0] % cells[1], cell / cells[0] / cells[1]];
            let corner = |i: usize| {
                at[x + (i & 1) + points[0] * (y + (i >> 1 & 1) + points[1] * (z + (i >> 2)))]
            };
            let weight = |i: usize| -> f64 {
                (0..3).map(|a| if i >> a & 1 == 1 { local[a] } else { 1.0 - local[a] }).product()
            };
            let world: DVec3 = (0..8).map(|i| corner(i) * weight(i)).sum();
            let found = sampler.sample(world);
            prop_assert!(found.is_some(), "{} is inside", world);
            let error = (found.unwrap_or(0.0) - slope.dot(world)).abs();
            prop_assert!(error <= 8.0 * f64::EPSILON * size, "{} ulp", error / (f64::EPSILON * size));
        }
        // Points of the grid, outer ones included, are in it.
        for p in &at {
            let found = sampler.sample(*p);
            prop_assert!(found.is_some(), "{} is a point of the grid", p);
        }
    }
}

#[test]
fn where_there_are_none() {
    let grid = |points| twisted(points, 1.0, 0.05);
    let mut values = vec![1.0; 64];
    values[63] = f64::NAN;
    let at = |grid: &CurvilinearGrid, i| grid.position(i) * 0.999;
    let g = grid([4, 4, 4]);
    let sampler = VolumeSampler::new(&volume(
        Geometry::Curvilinear(g.clone()),
        Association::Point,
        values,
    ))
    .expect("positions");
    assert_eq!(sampler.sample(at(&g, 63)), None, "a corner is not a number");
    assert_eq!(sampler.sample(at(&g, 0)), Some(1.0));
    assert_eq!(sampler.sample(DVec3::splat(9.0)), None, "outside");
    assert_eq!(sampler.sample(DVec3::NAN), None);

    let numbers: Vec<f64> = (0..27).map(f64::from).collect();
    let array = DataArray::from_vec(numbers, 1).expect("one component");
    let mut mask = CellMask::new(27);
    mask.blank(26);
    let blanked = Dataset::new(
        Geometry::Curvilinear(g.clone()),
        vec![Field::new("f", Association::Cell, array)],
    )
    .and_then(|d| d.with_blanked_cells(mask))
    .and_then(|d| d.volume(&FieldChoice::Only, ComponentChoice::Auto))
    .expect("it fits together");
    let sampler = VolumeSampler::new(&blanked).expect("positions");
    assert_eq!(sampler.sample(at(&g, 63)), None, "blanked");
    assert_eq!(sampler.sample(DVec3::ZERO), Some(13.0));
    assert_eq!(sampler.sample(at(&g, 0)), Some(0.0));

    let nowhere = DataArray::from_vec(vec![f64::NAN; 24], 3).expect("three components");
    let nowhere = CurvilinearGrid::new([2, 2, 2], nowhere).expect("a position a point");
    let nowhere = volume(Geometry::Curvilinear(nowhere), Association::Cell, vec![1.0]);
    assert!(matches!(
        VolumeSampler::new(&nowhere),
        Err(RenderError::NoPositions)
    ));
}
