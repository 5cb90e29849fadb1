//! Exodus II files of several blocks and steps (`tests/data/make_exodus_files.py`, which has VTK check
//! them), and a real one against what VTK 9.7 reads from it.

use std::path::{Path, PathBuf};

use glam::DVec3;
use vacua_io::{Dataset, ReadOptions, Source};
use vacua_volume::Association;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data")
}

fn open(name: &str, step: usize) -> Dataset {
    let options = ReadOptions {
        step: Some(step),
        ..ReadOptions::default()
    };
    vacua_io::open_with(folder().join(name), &options).unwrap_or_else(|e| panic!("{e}"))
}

const FILES: [&str; 4] = [
    "mesh/blocks.ex2",
    "mesh/blocks.exo",
    "mesh/blocks.e",
    "hdf/blocks.g",
];

#[test]
fn blocks_steps_and_vectors() {
    for name in FILES {
        for (step, time) in [0.0, 0.5, 2.0].into_iter().enumerate() {
            let dataset = open(name, step);
            assert_eq!(
                (dataset.times(), dataset.step()),
                (&[0.0, 0.5, 2.0][..], step)
            );
            let mesh = dataset.mesh().expect("a mesh");
            assert_eq!(mesh.num_points(), 13);
            assert_eq!(mesh.num_cells_by_type(), [1, 0, 0, 2], "{name}");
            assert_eq!(mesh.cell(1).points(), [4, 5, 7, 6, 8, 9, 11, 10]);
            assert_eq!(mesh.cell(2).points(), [8, 9, 11, 12]);
            assert_eq!(mesh.position(12), DVec3::new(0.5, 0.5, 3.0));
            // The shell and the two hexahedra's sides; the side of the tetrahedron.
            let left_out: Vec<_> = mesh.left_out().iter().map(|l| (l.name, l.count)).collect();
            assert_eq!(left_out, [("triangle", 1), ("quad", 3)], "{name}");
            let shapes: Vec<_> = dataset
                .fields()
                .iter()
                .map(|f| (f.name(), f.association(), f.components(), f.tuples()))
                .collect();
            let (point, cell) = (Association::Point, Association::Cell);
            let expected = [
                ("Temp", point, 1, 13),
                ("disp", point, 3, 13),
                ("p", point, 1, 13),
                ("stress", cell, 1, 3),
                ("gap", cell, 1, 3),
            ];
            assert_eq!(shapes, expected, "{name}");
            let line = |point| mesh.position(point).dot(DVec3::new(1.0, 2.0, 4.0));
            for (field, numbers) in dataset
                .fields()
                .iter()
                .zip([[1].as_slice(), &[2, 3, 4], &[5]])
            {
                let values = field.load().expect("loads");
                for point in 0..13 {
                    for (component, &number) in numbers.iter().enumerate() {
                        let expected = line(point) * f64::from(number) + time;
                        assert_eq!(values.get_f64(point, component), expected, "{name}");
                    }
                }
            }
            let stress = dataset.fields()[3].load().expect("loads");
            let all: Vec<f64> = (0..3).map(|c| stress.get_f64(c, 0)).collect();
            assert_eq!(all, [110.0 + time, 111.0 + time, 120.0 + time]);
            let gap = dataset.fields()[4].load().expect("loads");
            assert_eq!(gap.get_f64(1, 0), 211.0 + time);
            assert!(gap.get_f64(2, 0).is_nan(), "not in that block");
        }
        let options = ReadOptions {
            step: Some(3),
            ..ReadOptions::default()
        };
        let error = vacua_io::open_with(folder().join(name), &options).expect_err("three steps");
        assert!(error.to_string().contains("3 steps"), "{error}");
    }
}

/// Numbers as VTK 9.7 prints them; the surface cells are the faces of the side sets.
#[test]
fn a_real_file() {
    for name in ["disk_out_ref.ex2", "hdf/disk_out_ref.e"] {
        check_real_file(&open(name, 0));
    }
}

fn check_real_file(dataset: &Dataset) {
    let mesh = dataset.mesh().expect("a mesh");
    assert_eq!(mesh.num_points(), 8499);
    assert_eq!(mesh.num_cells_by_type(), [0, 0, 0, 7472]);
    let left_out: Vec<_> = mesh.left_out().iter().map(|l| (l.name, l.count)).collect();
    assert_eq!(left_out, [("quad", 2952)]);
    let bounds = mesh.bounds().expect("points");
    assert_eq!(bounds.lo, DVec3::new(-5.75, -5.75, -10.0));
    assert_eq!(bounds.hi, DVec3::new(5.75, 5.75, 10.159_999_847_412_11));
    for (name, components, lo, hi) in [
        ("Temp", 1, 293.149_993_896_484_4, 913.150_024_414_062_5),
        ("V", 3, -19.949_113_845_825_195, 19.949_113_845_825_195),
        (
            "Pres",
            1,
            0.006_785_521_749_407_053,
            0.028_818_512_335_419_655,
        ),
        (
            "AsH3",
            1,
            0.080_476_820_468_902_59,
            0.184_839_472_174_644_47,
        ),
        ("CH4", 1, 0.0, 0.001_170_239_178_463_816_6),
    ] {
        let field = dataset
            .fields()
            .iter()
            .find(|f| f.name() == name)
            .expect("there");
        let range = field.load().expect("loads").range(0).expect("finite");
        assert_eq!(
            (field.components(), range.lo, range.hi),
            (components, lo, hi),
            "{name}"
        );
    }
}

#[test]
fn other_netcdf_is_refused_by_name() {
    let mut bytes = b"CDF\x01".to_vec();
    bytes.extend([0; 28]);
    let source = Source::from_bytes(Path::new("weather.nc"), bytes);
    let error = vacua_io::open_source(&source, &ReadOptions::default()).expect_err("no mesh");
    assert!(error.to_string().contains("num_nodes"), "{error}");
}

/// A classic header that promises elements of no nodes, and so no bytes for any number of them.
#[test]
fn elements_without_nodes_are_refused() {
    let mut bytes = std::fs::read(folder().join("mesh/blocks.ex2")).expect("committed");
    let name = b"num_nod_per_el1";
    let at = bytes.windows(name.len()).position(|w| w == name);
    let at = at.expect("a dimension of that name") + name.len() + 1;
    bytes[at..at + 4].copy_from_slice(&0u32.to_be_bytes());
    let source = Source::from_bytes(Path::new("blocks.ex2"), bytes);
    let error = vacua_io::open_source(&source, &ReadOptions::default()).expect_err("no nodes");
    assert!(error.to_string().contains("connect1"), "{error}");
}
