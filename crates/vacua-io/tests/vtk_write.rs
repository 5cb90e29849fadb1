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
