//! VTKHDF files that VTK wrote, or that follow its specification in every way that HDF5 has of
//! storing arrays (`tests/data/make_hdf_files.py`), read as VTK itself reads them; and Exodus II in
//! HDF5.

mod contents;

use std::path::{Path, PathBuf};

use contents::{check, expected_contents};
use vacua_io::{Dataset, IoError, ReadOptions};
use vacua_volume::UnstructuredMesh;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/hdf")
}

fn open_at(name: &str, step: usize) -> Result<Dataset, IoError> {
    let options = ReadOptions {
        step: Some(step),
        ..ReadOptions::default()
    };
    vacua_io::open_with(folder().join(name), &options)
}

fn open(name: &str) -> Dataset {
    vacua_io::open(folder().join(name)).unwrap_or_else(|e| panic!("{e}"))
}

fn mesh(dataset: &Dataset) -> &UnstructuredMesh {
    dataset.mesh().expect("a mesh")
}

#[test]
fn every_file_and_step_reads_as_vtk_reads_it() {
    let (mut num_files, mut num_steps) = (0, 0);
    for expected in expected_contents(&folder()) {
        for name in &expected.files {
            let dataset = open_at(name, expected.step).unwrap_or_else(|e| panic!("{e}"));
            check(name, &dataset, &expected);
            assert_eq!(dataset.step(), expected.step, "{name}");
            num_files += 1;
            if !dataset.times().is_empty() {
                assert_eq!(dataset.times(), [0.0, 0.25, 1.5], "{name}");
                num_steps += 1;
            }
        }
    }
    assert_eq!((num_files, num_steps), (24, 12));
}

#[test]
fn steps_that_are_not_there_are_refused() {
    for name in ["steps.vtkhdf", "static.vtkhdf", "image_steps.vtkhdf"] {
        let error = open_at(name, 3).expect_err("three steps").to_string();
        assert!(error.contains("3 steps"), "{error}");
    }
    for name in ["mixed.vtkhdf", "image.vtkhdf"] {
        let error = open_at(name, 1).expect_err("no steps").to_string();
        assert!(error.contains("step 1"), "{error}");
    }
}

/// The same cells as in the XML file, which `mesh_against_vtk` checks.
#[test]
fn other_cells_and_flags_are_those_of_the_xml_file() {
    for stem in ["zoo", "hidden"] {
        let xml = vacua_io::open(folder().with_file_name("mesh").join(format!("{stem}.vtu")));
        let (xml, hdf) = (xml.expect("reads"), open(&format!("{stem}.vtkhdf")));
        let (xml_mesh, hdf_mesh) = (mesh(&xml), mesh(&hdf));
        assert_eq!(xml_mesh.num_cells(), hdf_mesh.num_cells(), "{stem}");
        for cell in 0..xml_mesh.num_cells() {
            let (a, b) = (xml_mesh.cell(cell), hdf_mesh.cell(cell));
            assert_eq!(
                (a.cell_type, a.points()),
                (b.cell_type, b.points()),
                "{stem}: {cell}"
            );
        }
        assert_eq!(xml.notes(), hdf.notes(), "{stem}");
        let blank = |dataset: &Dataset| -> Option<Vec<bool>> {
            let mask = dataset.blanked_cells()?;
            Some((0..mask.len()).map(|c| mask.is_blank(c)).collect())
        };
        assert_eq!(blank(&xml), blank(&hdf), "{stem}");
        assert_eq!(blank(&hdf).is_some(), stem == "hidden");
    }
}

#[test]
fn collections_are_joined() {
    let dataset = open("collection.vtkhdf");
    let mesh = mesh(&dataset);
    assert_eq!(mesh.num_cells(), 2 * 48);
    assert_eq!(mesh.num_points(), 18 + 18 + 27);
    let numbers = dataset.fields().iter().find(|f| f.name() == "number");
    let numbers = numbers.expect("in both blocks").load().expect("loads");
    for cell in 0..48 {
        assert_eq!(numbers.get_f64(cell, 0), numbers.get_f64(48 + cell, 0));
    }
}

#[test]
fn other_types_are_refused_by_name() {
    let error = vacua_io::open(folder().join("sphere.vtkhdf")).expect_err("a surface");
    assert!(error.to_string().contains("`PolyData`"), "{error}");
    assert!(error.to_string().contains("`UnstructuredGrid`"), "{error}");
}
