//! Meshes that VTK wrote (`tests/data/make_mesh_files.py`) read as VTK itself reads them: points,
//! cells with their points, values; and cells of every other kind fill what they fill.

mod contents;

use std::panic::AssertUnwindSafe;
use std::path::{Path, PathBuf};

use contents::{check, expected_contents};
use glam::DVec3;
use vacua_io::Dataset;
use vacua_volume::UnstructuredMesh;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/mesh")
}

fn open(name: &str) -> Dataset {
    vacua_io::open(folder().join(name)).unwrap_or_else(|e| panic!("{e}"))
}

fn mesh(dataset: &Dataset) -> &UnstructuredMesh {
    dataset.mesh().expect("a mesh")
}

#[test]
fn every_file_reads_as_vtk_reads_it() {
    let mut num_files = 0;
    for expected in expected_contents(&folder()) {
        for name in &expected.files {
            check(name, &open(name), &expected);
            num_files += 1;
        }
    }
    assert_eq!(num_files, 27);
}

#[test]
fn a_wrong_expectation_fails() {
    let mut expected = expected_contents(&folder()).swap_remove(0);
    let name = expected.files[0].clone();
    let dataset = open(&name);
    check(&name, &dataset, &expected);
    expected.cells[3].1.swap(0, 1);
    let outcome = std::panic::catch_unwind(AssertUnwindSafe(|| check(&name, &dataset, &expected)));
    assert!(outcome.is_err());
}

/// The volume of a mesh whose cells have plane faces.
fn volume(mesh: &UnstructuredMesh, cell: usize) -> f64 {
    let cell = mesh.cell(cell);
    let at: Vec<DVec3> = cell
        .points()
        .iter()
        .map(|&p| mesh.position(p as usize))
        .collect();
    let tetrahedra: &[[usize; 4]] = match at.len() {
        4 => &[[0, 1, 2, 3]],
        5 => &[[0, 1, 2, 4], [0, 2, 3, 4]],
        6 => &[[0, 1, 2, 3], [1, 2, 3, 4], [2, 3, 4, 5]],
        _ => &[
            [0, 1, 2, 6],
            [0, 2, 3, 6],
            [0, 3, 7, 6],
            [0, 7, 4, 6],
            [0, 4, 5, 6],
            [0, 5, 1, 6],
        ],
    };
    let one = |t: &[usize; 4]| {
        let [a, b, c, d] = t.map(|i| at[i]);
        ((b - a).cross(c - a).dot(d - a) / 6.0).abs()
    };
    tetrahedra.iter().map(one).sum()
}

/// Voxels, prisms, curved cells, convex point sets and polyhedra: each cell of the file stands alone,
/// and what is made of it has its volume and its number.
#[test]
fn other_cells_fill_what_they_fill() {
    let pentagon = 0.4755; // VTK's own corners, as printed in vtkPentagonalPrism.cxx: (area)
    for name in ["zoo.vtu", "zoo_51.vtk", "zoo_42.vtk"] {
        let dataset = open(name);
        let mesh = mesh(&dataset);
        let numbers = dataset
            .fields()
            .iter()
            .find(|f| f.name() == "number")
            .expect("there");
        let numbers = numbers.load().expect("loads");
        assert_eq!(numbers.tuples(), mesh.num_cells(), "{name}");
        let mut volumes = [0.0; 14];
        for cell in 0..mesh.num_cells() {
            volumes[numbers.get_f64(cell, 0) as usize] += volume(mesh, cell);
        }
        let (sixth, half, third) = (1.0 / 6.0, 0.5, 1.0 / 3.0);
        let roof = third * 0.7;
        let expected = [
            1.0,
            volumes[1],
            volumes[2],
            sixth,
            1.0,
            half,
            third,
            1.0,
            half,
            half,
            1.0,
            1.0 + roof,
            1.0,
            1.0,
        ];
        for (number, (found, expected)) in volumes.iter().zip(expected).enumerate() {
            assert!(
                (found - expected).abs() < 1e-6,
                "{name}: cell {number}: {found} for {expected}"
            );
        }
        // A regular hexagon and a regular pentagon in the unit square.
        assert!((volumes[1] - pentagon).abs() < 0.2, "{}", volumes[1]);
        assert!((volumes[2] - 0.75).abs() < 0.11, "{}", volumes[2]);
        let notes = dataset.notes().join("\n");
        for word in [
            "curved",
            "quadratic_tetrahedron",
            "polyhedron",
            "convex_point_set",
            "prism",
        ] {
            assert!(notes.contains(word), "{name}: {notes}");
        }
        let line = dataset
            .fields()
            .iter()
            .find(|f| f.name() == "line")
            .expect("there");
        assert_eq!(line.tuples(), mesh.num_points());
    }
}

#[test]
fn flagged_cells_are_blanked() {
    for name in ["hidden.vtu", "hidden.vtk"] {
        let dataset = open(name);
        let mesh = mesh(&dataset);
        let mask = dataset.blanked_cells().expect("some");
        let blank: Vec<usize> = (0..mask.len()).filter(|&c| mask.is_blank(c)).collect();
        let uses_hidden_point = |c: &usize| mesh.cell(*c).points().contains(&26);
        let expected: Vec<usize> = (0..mask.len())
            .filter(|c| [2, 5].contains(c) || uses_hidden_point(c))
            .collect();
        assert_eq!(blank, expected, "{name}");
        assert!(blank.len() > 2, "{name}");
        assert!(dataset.fields().iter().all(|f| f.name() != "vtkGhostType"));
    }
}

#[test]
fn pieces_are_joined_and_their_copies_blanked() {
    let whole = open("tets_raw.vtu");
    let pieces = open("pieces.pvtu");
    let (whole_mesh, pieces_mesh) = (mesh(&whole), mesh(&pieces));
    let blank = pieces.blanked_cells().expect("copies");
    assert_eq!(blank.num_blank(), 3 * 3);
    let seen: Vec<usize> = (0..blank.len()).filter(|&c| !blank.is_blank(c)).collect();
    assert_eq!(seen.len(), whole_mesh.num_cells());
    assert!(
        pieces_mesh.num_points() > whole_mesh.num_points(),
        "each piece has its own"
    );
    // Cell by cell: positions of corners and values, in any order of cells.
    let describe = |dataset: &Dataset, mesh: &UnstructuredMesh, cell: usize| {
        let of = |name: &str| {
            dataset
                .fields()
                .iter()
                .find(|f| f.name() == name)
                .expect("there")
                .load()
        };
        let number = of("number").expect("loads").get_f64(cell, 0);
        let wave = of("wave").expect("loads").clone();
        let cell = mesh.cell(cell);
        let corners: Vec<_> = cell
            .points()
            .iter()
            .map(|&p| {
                (
                    mesh.position(p as usize).to_array(),
                    wave.get_f64(p as usize, 0),
                )
            })
            .collect();
        (number as i64, format!("{corners:?}"))
    };
    let all = |dataset: &Dataset, mesh: &UnstructuredMesh, cells: &[usize]| {
        let mut all: Vec<_> = cells.iter().map(|&c| describe(dataset, mesh, c)).collect();
        all.sort();
        all
    };
    let every: Vec<usize> = (0..whole_mesh.num_cells()).collect();
    assert_eq!(
        all(&pieces, pieces_mesh, &seen),
        all(&whole, whole_mesh, &every)
    );
}
