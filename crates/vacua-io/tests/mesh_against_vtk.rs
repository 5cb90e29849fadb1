//! Meshes that VTK wrote (`tests/data/make_mesh_files.py`) read as VTK itself reads them: points,
//! cells with their points, values; and cells of every other kind fill what they fill.

use std::panic::AssertUnwindSafe;
use std::path::{Path, PathBuf};

use glam::DVec3;
use vacua_io::Dataset;
use vacua_volume::{Association, Scalar, UnstructuredMesh, dispatch_scalar};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/mesh")
}

fn open(name: &str) -> Dataset {
    vacua_io::open(folder().join(name)).unwrap_or_else(|e| panic!("{e}"))
}

fn mesh(dataset: &Dataset) -> &UnstructuredMesh {
    dataset.mesh().expect("a mesh")
}

/// What VTK found in some files.
#[derive(Default)]
struct Contents {
    positions: Vec<f64>,
    cells: Vec<(String, Vec<u64>)>,
    left_out: Vec<String>,
    /// Association, type, components, name, values.
    fields: Vec<(String, String, usize, String, Vec<String>)>,
    files: Vec<String>,
}

fn expected_contents() -> Vec<Contents> {
    let text = std::fs::read_to_string(folder().join("expected.txt")).expect("committed");
    let mut all: Vec<Contents> = Vec::new();
    for line in text.lines() {
        let (key, rest) = line.split_once(' ').unwrap_or((line, ""));
        let mut words = rest.split_whitespace();
        if key == "contents" {
            all.push(Contents::default());
            continue;
        }
        let contents = all.last_mut().expect("`contents` comes first");
        match key {
            "positions" => contents.positions = words.map(|w| w.parse().unwrap()).collect(),
            "cell" => {
                let name = words.next().expect("a type").to_owned();
                let points = words.map(|w| w.parse().unwrap()).collect();
                contents.cells.push((name, points));
            }
            "left_out" => contents.left_out.push(rest.to_owned()),
            "field" => {
                let mut part = || words.next().expect("four parts").to_owned();
                let (association, scalar_type, components) = (part(), part(), part());
                let components = components.parse().expect("a number");
                let field = (association, scalar_type, components, part(), Vec::new());
                contents.fields.push(field);
            }
            "values" => {
                let field = contents.fields.last_mut().expect("`field` comes first");
                field.4 = words.map(str::to_owned).collect();
            }
            "file" => contents.files.push(rest.to_owned()),
            other => panic!("unknown key {other}"),
        }
    }
    all
}

fn check(name: &str, dataset: &Dataset, expected: &Contents) {
    let mesh = mesh(dataset);
    assert_eq!(dataset.geometry().kind(), "unstructured");
    assert_eq!(mesh.num_points(), expected.positions.len() / 3, "{name}");
    for (point, xyz) in expected.positions.chunks_exact(3).enumerate() {
        assert_eq!(
            mesh.position(point),
            DVec3::from_slice(xyz),
            "{name}: point {point}"
        );
    }
    assert_eq!(mesh.num_cells(), expected.cells.len(), "{name}");
    for (number, (cell_type, points)) in expected.cells.iter().enumerate() {
        let cell = mesh.cell(number);
        assert_eq!(cell.cell_type.name(), cell_type, "{name}: cell {number}");
        assert_eq!(cell.points(), points, "{name}: cell {number}");
    }
    let mut left_out: Vec<String> = Vec::new();
    for kind in mesh.left_out() {
        left_out.extend(std::iter::repeat_n(kind.name.to_owned(), kind.count));
    }
    let mut expected_left_out = expected.left_out.clone();
    left_out.sort();
    expected_left_out.sort();
    assert_eq!(left_out, expected_left_out, "{name}");
    assert_eq!(dataset.fields().len(), expected.fields.len(), "{name}");
    for (association, scalar_type, components, field_name, values) in &expected.fields {
        let association = match association.as_str() {
            "point" => Association::Point,
            _ => Association::Cell,
        };
        let field = dataset
            .fields()
            .iter()
            .find(|f| f.name() == field_name && f.association() == association)
            .unwrap_or_else(|| panic!("{name}: no `{field_name}`"));
        let array = field.load().unwrap_or_else(|e| panic!("{name}: {e:?}"));
        assert_eq!(array.components(), *components, "{name}: {field_name}");
        assert_eq!(
            array.scalar_type().name(),
            scalar_type,
            "{name}: {field_name}"
        );
        dispatch_scalar!(array.scalar_type(), T => {
            let actual = array.as_slice::<T>().expect("of its own type");
            assert_eq!(actual.len(), values.len(), "{name}: {field_name}");
            for (i, (actual, expected)) in actual.iter().zip(values).enumerate() {
                let expected: f64 = expected.parse().expect("a number");
                assert_eq!(actual.to_f64(), expected, "{name}: {field_name}[{i}]");
            }
        });
    }
}

#[test]
fn every_file_reads_as_vtk_reads_it() {
    let mut num_files = 0;
    for expected in expected_contents() {
        for name in &expected.files {
            check(name, &open(name), &expected);
            num_files += 1;
        }
    }
    assert_eq!(num_files, 27);
}

#[test]
fn a_wrong_expectation_fails() {
    let mut expected = expected_contents().swap_remove(0);
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
