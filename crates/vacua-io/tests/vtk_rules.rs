//! Rules of the VTK formats on files small enough to be written here.

use std::path::Path;

use vacua_io::{Dataset, Problem, ReadOptions, Source, formats};
use vacua_volume::GridError;

/// Reads a file made of text.
fn read_text(name: &str, text: &str) -> Result<Dataset, Problem> {
    let source = Source::from_bytes(Path::new(name), text.into());
    let format = formats()
        .iter()
        .find(|f| f.sniff.is_some_and(|sniff| sniff(text.as_bytes())))
        .expect("recognised");
    (format.read)(&source, &ReadOptions::default())
}

#[test]
fn flat_grids_and_other_types_are_refused_by_name() {
    let flat = r#"<VTKFile type="ImageData"><ImageData WholeExtent="0 9 0 9 3 3">
        <Piece Extent="0 9 0 9 3 3"/></ImageData></VTKFile>"#;
    let flat = read_text("flat.vti", flat).unwrap_err();
    assert!(
        matches!(flat, Problem::Grid(GridError::Flat(10, 10, 1))),
        "{flat}"
    );
    let legacy = |rest: &str| format!("# vtk DataFile Version 3.0\ntitle\nASCII\nDATASET {rest}\n");
    let flat = read_text("a.vtk", &legacy("STRUCTURED_POINTS\nDIMENSIONS 1 5 5")).unwrap_err();
    assert!(
        matches!(flat, Problem::Grid(GridError::Flat(1, 5, 5))),
        "{flat}"
    );
    let lines = read_text("a.vtk", &legacy("POLYDATA")).unwrap_err();
    assert!(
        lines.to_string().contains("POLYDATA is not supported"),
        "{lines}"
    );
    let mesh = read_text("a.vtk", &legacy("UNSTRUCTURED_GRID")).unwrap_err();
    assert!(mesh.to_string().contains("expected POINTS"), "{mesh}");
    let mesh = r#"<VTKFile type="PolyData"><PolyData/></VTKFile>"#;
    let mesh = read_text("a.vtp", mesh).unwrap_err();
    assert!(
        mesh.to_string().contains("`PolyData` is not supported"),
        "{mesh}"
    );
}

#[test]
fn what_is_left_out_is_noted_and_names_are_kept() {
    let text = r#"<VTKFile type="ImageData"><ImageData WholeExtent="0 1 0 1 0 1">
      <Piece Extent="0 1 0 1 0 1"><PointData>
        <DataArray type="UInt8" format="ascii" ComponentName0="a & <b>">1 2 3 4 5 6 7 8</DataArray>
        <DataArray type="Bit" Name="bits" format="ascii">1 0 1 0 1 0 1 0</DataArray>
        <Array type="String" Name="words" format="ascii">0</Array>
      </PointData></Piece></ImageData></VTKFile>"#;
    let dataset = read_text("a.vti", text).expect("readable");
    assert_eq!(dataset.fields().len(), 1);
    assert_eq!(dataset.fields()[0].name(), "scalars");
    assert_eq!(dataset.notes().len(), 2, "{:?}", dataset.notes());
    assert!(dataset.notes()[0].contains("bits") && dataset.notes()[1].contains("words"));
}

#[test]
fn headers_and_data_may_be_encoded_apart_and_broken_into_lines() {
    let text = r#"<VTKFile type="ImageData" header_type="UInt64"><ImageData WholeExtent="0 1 0 1 0 1">
      <Piece Extent="0 1 0 1 0 1"><PointData>
        <DataArray type="UInt8" Name="a" format="binary">
          CAAAAAAA
          AAA=AQID
          BAUGBwg=
        </DataArray></PointData></Piece></ImageData></VTKFile>"#;
    let dataset = read_text("a.vti", text).expect("readable");
    let array = dataset.fields()[0].load().expect("loads");
    assert_eq!(array.as_slice::<u8>(), Some(&[1, 2, 3, 4, 5, 6, 7, 8][..]));
}

#[test]
fn the_owner_of_a_shared_point_decides() {
    let piece = |extent: &str, values: &str, ghosts: &str| {
        format!(
            r#"<Piece Extent="{extent}"><PointData>
            <DataArray type="Int16" Name="a" format="ascii">{values}</DataArray>{ghosts}
            </PointData></Piece>"#
        )
    };
    let flags = |text: &str| {
        format!(r#"<DataArray type="UInt8" Name="vtkGhostType" format="ascii">{text}</DataArray>"#)
    };
    let left = piece(
        "0 2 0 1 0 1",
        "1 2 -9 1 2 -9 1 2 -9 1 2 -9",
        &flags("0 0 1 0 0 1 0 0 1 0 0 1"),
    );
    let right = piece(
        "1 3 0 1 0 1",
        "-9 3 4 -9 3 4 -9 3 4 -9 3 4",
        &flags("1 0 0 1 0 0 1 0 0 1 0 0"),
    );
    let bare = piece("2 3 0 1 0 1", "3 4 3 4 3 4 3 4", "");
    for pieces in [
        [&left, &right],
        [&right, &left],
        [&left, &bare],
        [&bare, &left],
    ] {
        let text = format!(
            r#"<VTKFile type="ImageData"><ImageData WholeExtent="0 3 0 1 0 1">{}{}</ImageData></VTKFile>"#,
            pieces[0], pieces[1]
        );
        let dataset = read_text("a.vti", &text).expect("readable");
        assert_eq!(dataset.fields().len(), 1);
        let array = dataset.fields()[0].load().expect("loads");
        assert_eq!(
            array.as_slice::<i16>(),
            Some(&[1i16, 2, 3, 4].repeat(4)[..])
        );
        assert!(dataset.blanked_cells().is_none());
    }
}

#[test]
fn parallel_files_name_the_piece_that_fails() {
    let whole = r#"<VTKFile type="PImageData"><PImageData WholeExtent="0 1 0 1 0 1" GhostLevel="0">
        <Piece Extent="0 1 0 1 0 1" Source="missing.vti"/></PImageData></VTKFile>"#;
    let message = read_text("a.pvti", whole).unwrap_err().to_string();
    assert!(message.contains("missing.vti"), "{message}");
    let gap = r#"<VTKFile type="ImageData"><ImageData WholeExtent="0 4 0 1 0 1">
        <Piece Extent="0 1 0 1 0 1"/><Piece Extent="2 4 0 1 0 1"/></ImageData></VTKFile>"#;
    let message = read_text("a.vti", gap).unwrap_err().to_string();
    assert!(
        message.contains("no piece that covers 1 2 0 1 0 1"),
        "{message}"
    );
}
