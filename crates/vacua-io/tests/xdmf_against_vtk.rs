//! XDMF files that VTK and meshio wrote, and others by hand (`tests/data/make_xdmf_files.py`), read as
//! VTK reads them, or as what was written.

mod contents;

use std::path::{Path, PathBuf};

use contents::{check, expected_contents};
use glam::DVec3;
use vacua_io::{Dataset, ReadOptions, Source};
use vacua_volume::{CellType, Geometry};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/xdmf")
}

fn open(name: &str) -> Dataset {
    vacua_io::open(folder().join(name)).unwrap_or_else(|e| panic!("{e}"))
}

/// Reads a file with other text, in the folder of the test files.
fn read_text(text: String) -> Result<Dataset, String> {
    let source = Source::from_bytes(&folder().join("test.xdmf"), text.into_bytes());
    let read = vacua_io::open_source(&source, &ReadOptions::default());
    read.map_err(|error| error.to_string())
}

fn text_of(name: &str) -> String {
    std::fs::read_to_string(folder().join(name)).expect("committed")
}

#[test]
fn every_file_and_step_reads_as_it_was_written() {
    let (mut num_files, mut num_steps) = (0, 0);
    for expected in expected_contents(&folder()) {
        for name in &expected.files {
            let options = ReadOptions {
                step: Some(expected.step),
                ..ReadOptions::default()
            };
            let dataset = vacua_io::open_with(folder().join(name), &options);
            let dataset = dataset.unwrap_or_else(|e| panic!("{e}"));
            check(name, &dataset, &expected);
            num_files += 1;
            if !dataset.times().is_empty() {
                assert_eq!(dataset.times(), [0.0, 0.25, 1.5], "{name}");
                assert_eq!(dataset.step(), expected.step, "{name}");
                num_steps += 1;
            }
        }
    }
    assert_eq!((num_files, num_steps), (14, 6));
}

#[test]
fn structured_grids_are_those_of_the_xml_files() {
    for (name, other) in [
        ("rectilinear.xmf", "rectilinear.vtr"),
        ("curvilinear.xmf", "curvilinear.vts"),
    ] {
        let (xdmf, xml) = (open(name), open(other));
        match (&**xdmf.geometry(), &**xml.geometry()) {
            (Geometry::Rectilinear(a), Geometry::Rectilinear(b)) => assert_eq!(a, b),
            (Geometry::Curvilinear(a), Geometry::Curvilinear(b)) => {
                assert_eq!(a.points(), b.points());
                assert_eq!(a.positions().bytes(), b.positions().bytes());
            }
            _ => panic!("{name}: another kind of grid"),
        }
        assert_eq!(xdmf.fields().len(), 2);
        for field in xdmf.fields() {
            let same = xml
                .fields()
                .iter()
                .find(|f| f.name() == field.name() && f.association() == field.association());
            let (a, b) = (field.load().expect("loads"), same.expect("there").load());
            assert_eq!(
                a.bytes(),
                b.expect("loads").bytes(),
                "{name}: {}",
                field.name()
            );
        }
    }
}

#[test]
fn mixed_cells_with_polyhedra_and_curved_ones() {
    let dataset = open("polyhedra.xdmf");
    let mesh = dataset.mesh().expect("a mesh");
    let volume = |cell: usize| {
        let cell = mesh.cell(cell);
        let at: Vec<DVec3> = cell
            .points()
            .iter()
            .map(|&p| mesh.position(p as usize))
            .collect();
        match cell.cell_type {
            CellType::Tetrahedron => {
                ((at[1] - at[0]).cross(at[2] - at[0]).dot(at[3] - at[0]) / 6.0).abs()
            }
            _ => 0.0,
        }
    };
    let all: f64 = (0..mesh.num_cells()).map(volume).sum();
    // The polyhedron is a unit cube; the curved tetrahedron has these corners.
    let curved = {
        let at = [16, 17, 18, 19].map(|p| mesh.position(p));
        ((at[1] - at[0]).cross(at[2] - at[0]).dot(at[3] - at[0]) / 6.0).abs()
    };
    assert!((all - 1.0 - curved).abs() < 1e-12, "{all}");
    let left_out: Vec<_> = mesh.left_out().iter().map(|l| (l.name, l.count)).collect();
    assert_eq!(left_out, [("poly_line", 1)]);
    let notes = dataset.notes().join("\n");
    for word in ["polyhedron", "curved", "`one`"] {
        assert!(notes.contains(word), "{notes}");
    }
}

#[test]
fn what_is_not_read_is_named() {
    let good = text_of("meshio_xml.xdmf");
    assert!(read_text(good.clone()).is_ok());
    for (from, to, word) in [
        ("Version=\"3.0\"", "Version=\"4.0\"", "version `4.0`"),
        (
            "TopologyType=\"Mixed\"",
            "TopologyType=\"Wobbly\"",
            "`WOBBLY`",
        ),
        (
            "GeometryType=\"XYZ\"",
            "GeometryType=\"ORIGIN_DXDYDZ\"",
            "`ORIGIN_DXDYDZ`",
        ),
        (
            "GeometryType=\"XYZ\"",
            "GeometryType=\"XY\"",
            "2 numbers a point",
        ),
        (
            "Format=\"XML\"",
            "Format=\"XML\" ItemType=\"Function\"",
            "`FUNCTION`",
        ),
        ("Format=\"XML\"", "Format=\"MySQL\"", "`MYSQL`"),
        ("Precision=\"4\"", "Precision=\"3\"", "precision 3"),
        (
            "NumberOfElements=\"24\"",
            "NumberOfElements=\"25\"",
            "25 elements",
        ),
        ("Name=\"Grid\"", "GridType=\"SubSet\"", "`SUBSET`"),
        (
            "Dimensions=\"27 3\"",
            "Dimensions=\"99999999999 3\"",
            "numbers",
        ),
        (
            "Dimensions=\"27 3\"",
            "Dimensions=\"99999999999 99999999999\"",
            "address space",
        ),
        ("Center=\"Cell\"", "Center=\"Node\"", "attribute"),
        ("<Topology ", "<Topology Order=\"1 0 2 3\" ", "order"),
    ] {
        let text = good.replacen(from, to, 1);
        assert_ne!(text, good, "{from}");
        let error = read_text(text)
            .err()
            .unwrap_or_else(|| panic!("{to} is read"));
        assert!(error.contains(word), "{to}: {error}");
    }
}

#[test]
fn heavy_data_is_beside_the_file() {
    let good = text_of("hand.xmf");
    assert!(read_text(good.clone()).is_ok());
    let error = |text: String| read_text(text).expect_err("refused");
    let outside = error(good.replace("hand.bin", "../xdmf/hand.bin"));
    assert!(outside.contains("outside"), "{outside}");
    let missing = error(good.replace("hand.bin", "hand.bim"));
    assert!(missing.contains("hand.bim"), "{missing}");
    let absolute = folder().join("hand.bin").display().to_string();
    assert!(read_text(good.replace("hand.bin", &absolute)).is_ok());
    let late = error(good.replacen("Seek=\"0\"", "Seek=\"2100\"", 1));
    assert!(late.contains("truncated"), "{late}");
    let hdf = text_of("mixed.xmf");
    for (from, to, word) in [
        ("mixed.h5:", "../mixed.h5:", "outside"),
        ("mixed.h5:", "mixed.xmf:", "mixed.xmf"),
        ("/Geometry/Points", "/Geometry/None", "None"),
        (
            "/Geometry/Points",
            "/Geometry/Points|0 0 1 1 2 2",
            "part of an array",
        ),
        ("mixed.h5:", "", "file.h5:/array"),
        ("27 3", "26 3", "[27, 3]"),
    ] {
        let text = hdf.replacen(from, to, 1);
        assert_ne!(text, hdf, "{from}");
        let found = error(text);
        assert!(found.contains(word), "{to}: {found}");
    }
}

#[test]
fn references_in_circles_end() {
    let circle = |grids: &str| format!("<Xdmf Version='2.0'><Domain>{grids}</Domain></Xdmf>");
    let same = "<Grid GridType='Tree' Name='a'><Grid Reference='/Xdmf/Domain/Grid'/></Grid>";
    assert!(read_text(circle(same)).is_err());
    let many = "<Grid Reference='/Xdmf/Domain/Grid'/>".repeat(50);
    assert!(read_text(circle(&format!("<Grid GridType='Tree'>{many}</Grid>"))).is_err());
    let include = "<xi:include xpointer='xpointer(//Grid)'/>".repeat(50);
    assert!(read_text(circle(&format!("<Grid GridType='Tree'>{include}</Grid>"))).is_err());
    assert!(read_text(circle("<Grid Reference='/Xdmf/Domain/Grid'/>")).is_err());
}
