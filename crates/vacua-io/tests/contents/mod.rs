//! What VTK found in files, and the check that a dataset is the same.

use std::path::Path;

use glam::DVec3;
use vacua_io::Dataset;
use vacua_volume::{Association, Geometry, Scalar, dispatch_scalar};

/// What VTK found in some files.
#[derive(Default)]
pub struct Contents {
    /// Bounds and points a side of a uniform grid.
    image: Option<(Vec<f64>, Vec<usize>)>,
    positions: Vec<f64>,
    /// Type and points.
    pub cells: Vec<(String, Vec<u64>)>,
    left_out: Vec<String>,
    /// Association, type, components, name, values.
    fields: Vec<(String, String, usize, String, Vec<String>)>,
    /// Files that hold all this.
    pub files: Vec<String>,
    /// At which step.
    pub step: usize,
}

/// Reads `expected.txt`.
pub fn expected_contents(folder: &Path) -> Vec<Contents> {
    let text = std::fs::read_to_string(folder.join("expected.txt")).expect("committed");
    let mut all: Vec<Contents> = Vec::new();
    for line in text.lines() {
        let (key, rest) = line.split_once(' ').unwrap_or((line, ""));
        let mut words = rest.split_whitespace();
        if key == "contents" || key == "image" {
            all.push(Contents::default());
            continue;
        }
        let contents = all.last_mut().expect("`contents` comes first");
        match key {
            "bounds" => {
                let bounds = words.map(|w| w.parse().unwrap()).collect();
                contents.image = Some((bounds, Vec::new()));
            }
            "points" => {
                let points = words.map(|w| w.parse().unwrap()).collect();
                contents.image.as_mut().expect("`bounds` comes first").1 = points;
            }
            "step" => contents.step = rest.parse().expect("a number"),
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

/// Fails unless a dataset is what is expected.
pub fn check(name: &str, dataset: &Dataset, expected: &Contents) {
    match &expected.image {
        None => check_mesh(name, dataset, expected),
        Some((bounds, points)) => check_image(name, dataset, bounds, points),
    }
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

fn check_image(name: &str, dataset: &Dataset, bounds: &[f64], points: &[usize]) {
    let Geometry::Uniform(grid) = &**dataset.geometry() else {
        panic!("{name}: no uniform grid");
    };
    assert_eq!(grid.points().to_vec(), points, "{name}");
    let first = grid.world_from_index().translation;
    let last = grid.points().map(|n| (n - 1) as f64);
    let last = grid.world_from_index().transform_point3(last.into());
    let found = [first.x, last.x, first.y, last.y, first.z, last.z];
    assert_eq!(found.to_vec(), bounds, "{name}");
}

fn check_mesh(name: &str, dataset: &Dataset, expected: &Contents) {
    let mesh = dataset.mesh().expect("a mesh");
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
}
