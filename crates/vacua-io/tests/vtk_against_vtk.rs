//! Every file that VTK wrote (`tests/data/make_vtk_files.py`) reads as VTK itself reads it: exactly
//! for values, within rounding for positions.

use std::panic::AssertUnwindSafe;
use std::path::{Path, PathBuf};

use glam::DVec3;
use vacua_io::Dataset;
use vacua_volume::{Association, Geometry, Scalar, dispatch_scalar};

fn data_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data")
}

/// What VTK found in some files.
#[derive(Default)]
struct Contents {
    kind: String,
    dimensions: Vec<usize>,
    positions: Vec<f64>,
    /// Association, type, components, name, values.
    fields: Vec<(String, String, usize, String, Vec<String>)>,
    blanked: Vec<usize>,
    files: Vec<String>,
}

fn expected_contents() -> Vec<Contents> {
    let text = std::fs::read_to_string(data_folder().join("vtk/expected.txt")).expect("committed");
    let mut all: Vec<Contents> = Vec::new();
    for line in text.lines() {
        let (key, rest) = line.split_once(' ').unwrap_or((line, ""));
        let words = || rest.split_whitespace();
        if key == "contents" {
            all.push(Contents::default());
            continue;
        }
        let contents = all.last_mut().expect("`contents` comes first");
        match key {
            "kind" => contents.kind = rest.to_owned(),
            "dimensions" => contents.dimensions = words().map(|w| w.parse().unwrap()).collect(),
            "positions" => contents.positions = words().map(|w| w.parse().unwrap()).collect(),
            "field" => {
                let mut parts = rest.splitn(4, ' ');
                let mut part = || parts.next().expect("four parts").to_owned();
                let (association, scalar_type, components) = (part(), part(), part());
                let components = components.parse().expect("a number");
                contents
                    .fields
                    .push((association, scalar_type, components, part(), Vec::new()));
            }
            "values" => {
                let field = contents.fields.last_mut().expect("`field` comes first");
                field.4 = words().map(str::to_owned).collect();
            }
            "blanked" => contents.blanked = words().map(|w| w.parse().unwrap()).collect(),
            "file" => contents.files = words().map(str::to_owned).collect(),
            other => panic!("unknown key {other}"),
        }
    }
    all
}

fn position(geometry: &Geometry, point: usize) -> DVec3 {
    let [nx, ny, _] = geometry.points();
    let index = [point % nx, point / nx % ny, point / (nx * ny)];
    match geometry {
        Geometry::Uniform(grid) => grid
            .world_from_index()
            .transform_point3(DVec3::from_array(index.map(|i| i as f64))),
        Geometry::Rectilinear(grid) => {
            DVec3::from_array([0, 1, 2].map(|axis| grid.coordinates(axis)[index[axis]]))
        }
        Geometry::Curvilinear(grid) => grid.position(point),
        Geometry::Unstructured(mesh) => mesh.position(point),
    }
}

fn check(name: &str, dataset: &Dataset, expected: &Contents) {
    let geometry = dataset.geometry();
    assert_eq!(geometry.kind(), expected.kind, "{name}");
    assert_eq!(geometry.points()[..], expected.dimensions[..], "{name}");
    for (point, xyz) in expected.positions.chunks_exact(3).enumerate() {
        let expected = DVec3::from_slice(xyz);
        let actual = position(geometry, point);
        let error = (actual - expected).abs().max_element();
        assert!(
            error <= 1e-14 * 16.0,
            "{name}: point {point}: {actual} for {expected}"
        );
    }
    let names: Vec<_> = dataset
        .fields()
        .iter()
        .map(|f| f.name().to_owned())
        .collect();
    assert_eq!(
        dataset.fields().len(),
        expected.fields.len(),
        "{name}: {names:?}"
    );
    for (association, scalar_type, components, field_name, values) in &expected.fields {
        let association = match association.as_str() {
            "point" => Association::Point,
            _ => Association::Cell,
        };
        let field = dataset
            .fields()
            .iter()
            .find(|f| f.name() == field_name && f.association() == association)
            .unwrap_or_else(|| panic!("{name}: no `{field_name}` among {names:?}"));
        let array = field.load().unwrap_or_else(|e| panic!("{name}: {e:?}"));
        assert_eq!(array.components(), *components, "{name}: {field_name}");
        let is_id = scalar_type == "i64" && array.scalar_type().name() == "i32";
        assert!(
            is_id || array.scalar_type().name() == scalar_type,
            "{name}: {field_name}: {} for {scalar_type}",
            array.scalar_type()
        );
        dispatch_scalar!(array.scalar_type(), T => {
            let actual = array.as_slice::<T>().expect("of its own type");
            assert_eq!(actual.len(), values.len(), "{name}: {field_name}");
            for (i, (actual, expected)) in actual.iter().zip(values).enumerate() {
                let expected: T = expected.parse().expect("a number");
                assert!(
                    *actual == expected || actual.to_f64().is_nan() && expected.to_f64().is_nan(),
                    "{name}: {field_name}[{i}] is {actual}, VTK reads {expected}"
                );
            }
        });
    }
    let blanked: Vec<usize> = dataset.blanked_cells().map_or(Vec::new(), |mask| {
        (0..mask.len()).filter(|&c| mask.is_blank(c)).collect()
    });
    assert_eq!(blanked, expected.blanked, "{name}");
}

#[test]
fn every_file_reads_as_vtk_reads_it() {
    let mut num_files = 0;
    for expected in expected_contents() {
        for name in &expected.files {
            let dataset = vacua_io::open(data_folder().join("vtk").join(name))
                .unwrap_or_else(|e| panic!("{e}"));
            check(name, &dataset, &expected);
            num_files += 1;
        }
    }
    assert!(num_files >= 100, "only {num_files} files were compared");
}

#[test]
fn a_wrong_expectation_fails() {
    let mut expected = expected_contents().swap_remove(0);
    let name = expected.files[0].clone();
    let dataset = vacua_io::open(data_folder().join("vtk").join(&name)).expect("readable");
    check(&name, &dataset, &expected);
    expected.fields[0].4[7] = "12345".to_owned();
    let outcome = std::panic::catch_unwind(AssertUnwindSafe(|| check(&name, &dataset, &expected)));
    assert!(outcome.is_err());
}

/// Ranges as VTK 9.7 prints them.
#[test]
fn real_files() {
    for (file, field, kind, range) in [
        ("hydrogen.vti", "probability_density", "f32", (0.0, 1.0)),
        ("ironProt.vtk", "scalars", "u8", (0.0, 255.0)),
        (
            "viscous_fingers_060.vti",
            "ImageFile",
            "f32",
            (0.0, 110.957_572_937_011_72),
        ),
    ] {
        let dataset = vacua_io::open(data_folder().join(file)).expect("readable");
        let n = if file == "ironProt.vtk" { 68 } else { 64 };
        assert_eq!(dataset.geometry().points(), [n; 3]);
        assert_eq!(dataset.fields().len(), 1);
        let array = dataset.fields()[0].load().expect("loads");
        assert_eq!(dataset.fields()[0].name(), field);
        assert_eq!(array.scalar_type().name(), kind);
        let found = array.range(0).expect("finite values");
        assert_eq!((found.lo, found.hi), range, "{file}");
    }
}
