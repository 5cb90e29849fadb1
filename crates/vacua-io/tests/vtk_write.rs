//! What is written reads back the same: geometry, every field bit for bit, blanked cells.

use glam::{DAffine3, DMat3, DVec3};
use vacua_io::vtk::{WriteEncoding, WriteOptions, write_vti, write_vtr, write_vts, write_vtu};
use vacua_io::{ReadOptions, Source, formats};
use vacua_volume::{
    Association, CellMask, CurvilinearGrid, DataArray, Dataset, Field, Geometry, RectilinearGrid,
    UniformGrid,
};

const POINTS: [usize; 3] = [40, 50, 35];

fn fields() -> Vec<Field> {
    let num_points = POINTS.iter().product::<usize>();
    let num_cells = POINTS.map(|n| n - 1).iter().product::<usize>();
    let bytes: Vec<u8> = (0..num_points * 3).map(|i| ((i * i) >> 5) as u8).collect();
    let waves: Vec<f64> = (0..num_points).map(|i| (i as f64 * 0.01).sin()).collect();
    let mut small: Vec<f32> = (0..num_cells).map(|i| i as f32 / 3.0).collect();
    small[5] = f32::NAN;
    let array = |name: &str, association, array: Result<DataArray, _>| {
        Field::new(name, association, array.expect("a whole number of tuples"))
    };
    vec![
        array(
            "three \"bytes\" <&>",
            Association::Point,
            DataArray::from_vec(bytes, 3),
        ),
        array("waves", Association::Point, DataArray::from_vec(waves, 1)),
        array("cells", Association::Cell, DataArray::from_vec(small, 1)),
    ]
}

fn assert_same(written: &Dataset, read: &Dataset) {
    assert_eq!(written.geometry().kind(), read.geometry().kind());
    assert_eq!(written.geometry().points(), read.geometry().points());
    assert_eq!(written.fields().len(), read.fields().len());
    for (a, b) in written.fields().iter().zip(read.fields()) {
        assert_eq!((a.name(), a.association()), (b.name(), b.association()));
        let (a, b) = (a.load().expect("loads"), b.load().expect("loads"));
        assert_eq!(
            (a.scalar_type(), a.components()),
            (b.scalar_type(), b.components())
        );
        assert!(a.bytes() == b.bytes());
    }
    assert_eq!(written.blanked_cells(), read.blanked_cells());
}

fn blanked(dataset: Dataset) -> Dataset {
    let mut mask = CellMask::new(dataset.geometry().num_cells());
    for cell in [0, 77, 4000] {
        mask.blank(cell);
    }
    dataset
        .with_blanked_cells(mask)
        .expect("of the right length")
}

fn both_encodings() -> [WriteOptions; 2] {
    [WriteEncoding::Raw, WriteEncoding::Zlib].map(|encoding| WriteOptions { encoding })
}

#[test]
fn uniform_grids() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().join("out.vti");
    let (s, c) = 0.3f64.sin_cos();
    let turned = DMat3::from_cols_array(&[c, s, 0.0, -s, c, 0.0, 0.0, 0.0, 1.0]);
    let placements = [
        DMat3::from_diagonal(DVec3::new(0.1, 3.0, 1e-9)),
        DMat3::from_diagonal(DVec3::new(-2.0, 1.0, 0.3)),
        turned * DMat3::from_diagonal(DVec3::new(1.5, 2.5, 0.5)),
    ];
    for axes in placements {
        let placement = DAffine3::from_mat3_translation(axes, DVec3::new(0.1, -7.0, 1e5));
        let grid = UniformGrid::with_affine(POINTS, placement).expect("a box");
        let dataset = Dataset::new(Geometry::Uniform(grid), fields()).expect("fits");
        let dataset = blanked(dataset);
        for options in both_encodings() {
            write_vti(&path, &dataset, &options).expect("written");
            let read = vacua_io::open(&path).expect("readable");
            assert_same(&dataset, &read);
            let Geometry::Uniform(grid) = &**read.geometry() else {
                panic!("a uniform grid");
            };
            let error = (grid.world_from_index().matrix3 - axes).to_cols_array();
            let largest = error.iter().fold(0.0f64, |a, b| a.max(b.abs()));
            assert!(largest <= 1e-15, "{largest}");
            assert_eq!(grid.world_from_index().translation, placement.translation);
        }
    }
}

#[test]
fn rectilinear_and_curvilinear_grids() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let coordinates = POINTS.map(|n| (0..n).map(|i| (i as f64).powf(1.3)).collect::<Vec<f64>>());
    let [x, y, z] = coordinates.clone();
    let grid = RectilinearGrid::new(x, y, z).expect("increasing");
    let dataset = Dataset::new(Geometry::Rectilinear(grid), fields()).expect("fits");
    let path = folder.path().join("out.vtr");
    for options in both_encodings() {
        write_vtr(&path, &dataset, &options).expect("written");
        let read = vacua_io::open(&path).expect("readable");
        assert_same(&dataset, &read);
        let Geometry::Rectilinear(grid) = &**read.geometry() else {
            panic!("a rectilinear grid");
        };
        assert_eq!(
            [0, 1, 2].map(|axis| grid.coordinates(axis).to_vec()),
            coordinates
        );
    }

    let num_points = POINTS.iter().product::<usize>();
    let positions: Vec<f32> = (0..num_points * 3).map(|i| (i as f32).sqrt()).collect();
    let positions = DataArray::from_vec(positions, 3).expect("triples");
    let grid = CurvilinearGrid::new(POINTS, positions.clone()).expect("fits");
    let dataset = blanked(Dataset::new(Geometry::Curvilinear(grid), fields()).expect("fits"));
    let path = folder.path().join("out.vts");
    for options in both_encodings() {
        write_vts(&path, &dataset, &options).expect("written");
        let read = vacua_io::open(&path).expect("readable");
        assert_same(&dataset, &read);
        let Geometry::Curvilinear(grid) = &**read.geometry() else {
            panic!("a curvilinear grid");
        };
        assert!(grid.positions().bytes() == positions.bytes());
    }
    let refused = write_vti(&path, &dataset, &WriteOptions::default());
    assert!(refused.unwrap_err().to_string().contains("curvilinear"));
}

#[test]
fn raw_data_is_mapped_and_not_copied() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().join("out.vti");
    let grid = UniformGrid::new(POINTS, DVec3::ZERO, DVec3::ONE).expect("a box");
    let dataset = Dataset::new(Geometry::Uniform(grid), fields()).expect("fits");
    let options = WriteOptions {
        encoding: WriteEncoding::Raw,
    };
    write_vti(&path, &dataset, &options).expect("written");
    let source = Source::open(&path).expect("readable");
    let file = source.bytes().as_ptr_range();
    let format = formats().iter().find(|f| f.extensions.contains(&"vti"));
    let read = (format.expect("registered").read)(&source, &ReadOptions::default());
    let read = read.expect("readable");
    for field in read.fields() {
        let bytes = field.load().expect("loads").bytes().as_ptr_range();
        assert!(
            file.start <= bytes.start && bytes.end <= file.end,
            "{}",
            field.name()
        );
    }
}

#[test]
fn meshes_read_back_the_same() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/mesh");
    for name in [
        "mixed_ascii.vtu",
        "tets_raw.vtu",
        "hidden.vtu",
        "zoo.vtu",
        "pieces.pvtu",
    ] {
        let dataset = vacua_io::open(folder.join(name)).expect("readable");
        for options in both_encodings() {
            let out = tempfile::tempdir().expect("temporary folder");
            let path = out.path().join("out.vtu");
            write_vtu(&path, &dataset, &options).expect("writable");
            let back = vacua_io::open(&path).expect("readable");
            assert_same(&dataset, &back);
            let (a, b) = (
                dataset.mesh().expect("a mesh"),
                back.mesh().expect("a mesh"),
            );
            assert_eq!(a.positions().bytes(), b.positions().bytes(), "{name}");
            assert_eq!(a.num_cells(), b.num_cells(), "{name}");
            for cell in 0..a.num_cells() {
                assert_eq!(a.cell(cell), b.cell(cell), "{name}: {cell}");
            }
        }
        let path = folder.join("never.vti");
        assert!(write_vti(&path, &dataset, &WriteOptions::default()).is_err());
    }
}

/// VTK's filters ask for the active scalars and vectors.
#[test]
fn active_arrays_are_named() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().join("out.vti");
    let grid = UniformGrid::new([2; 3], DVec3::ZERO, DVec3::ONE).expect("a box");
    let field = |name: &str, association, components| {
        let tuples = if association == Association::Point {
            8
        } else {
            1
        };
        let values = DataArray::from_vec(vec![0f32; tuples * components], components);
        Field::new(name, association, values.expect("whole tuples"))
    };
    let colours = DataArray::from_vec(vec![0u8; 24], 3).expect("whole tuples");
    let colours = Field::new("c", Association::Point, colours);
    let (point, cell) = (Association::Point, Association::Cell);
    for (fields, expected) in [
        (
            vec![
                field("v", point, 3),
                field("<s>", point, 1),
                field("t", point, 1),
            ],
            r#"<PointData Scalars="&lt;s&gt;" Vectors="v">"#,
        ),
        (vec![field("v", point, 3)], r#"<PointData Vectors="v">"#),
        (vec![colours], r#"<PointData Scalars="c">"#),
        (vec![field("q", cell, 1)], r#"<CellData Scalars="q">"#),
        (vec![field("q", cell, 1)], "<PointData>"),
    ] {
        let mut mask = CellMask::new(1);
        mask.blank(0);
        let dataset = Dataset::new(Geometry::Uniform(grid.clone()), fields).expect("fits");
        let dataset = dataset
            .with_blanked_cells(mask)
            .expect("of the right length");
        write_vti(&path, &dataset, &WriteOptions::default()).expect("written");
        let written = std::fs::read(&path).expect("written");
        let written = String::from_utf8_lossy(&written);
        assert!(written.contains(expected), "{expected}: {written}");
    }
}

/// Arrays of the whole data set are not read; whoever converts a file is told which.
#[test]
fn lost_field_data_is_named() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let xml = r#"<VTKFile type="ImageData"><ImageData WholeExtent="0 1 0 1 0 1"><FieldData>
        <DataArray type="Float64" Name="TimeValue" NumberOfTuples="1">2</DataArray>
        <Array type="String" Name="title" NumberOfTuples="1">65 0</Array></FieldData>
        <Piece Extent="0 1 0 1 0 1"/></ImageData></VTKFile>"#;
    let legacy = "# vtk DataFile Version 3.0\nt\nASCII\nDATASET STRUCTURED_POINTS\n\
        DIMENSIONS 2 2 2\nFIELD FieldData 1\nTIME 1 1 double\n2.5\nORIGIN 0 0 0\nSPACING 1 1 1\n";
    for (name, text, names) in [
        ("a.vti", xml, vec!["TimeValue", "title"]),
        ("a.vtk", legacy, vec!["TIME"]),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, text).expect("writable");
        let dataset = vacua_io::open(&path).expect("readable");
        assert_eq!(dataset.field_data(), names);
        let out = folder.path().join("out.vti");
        let lost = vacua_io::save(&out, &dataset, &vacua_io::WriteOptions::default());
        let lost = lost.expect("written");
        assert!(lost[0].ends_with(&names.join(", ")), "{lost:?}");
    }
}
