//! Encoding straight into a file gives the file that encoding in memory gives, whatever is in memory
//! at a time; the map in it is the map, and fields that are added later are those that could have been
//! there from the start.

mod common;

use std::path::Path;
use std::sync::Mutex;

use common::{CUTS, Cut, Random, lattice};
use vacua_pack::file::{
    FieldInput, FieldLabel, FieldStep, FileOptions, PackedFile, encode_file, write_file,
    write_file_with,
};
use vacua_pack::{EncodeOptions, EncodeStage, PackedField, Variant, encode};
use vacua_volume::{Association, CellMask, DataArray, UnstructuredMesh};

fn fields_of(mesh: &UnstructuredMesh, seed: u64) -> Vec<FieldInput> {
    let mut random = Random(seed);
    let mut on_points: Vec<f32> = (0..mesh.num_points())
        .map(|_| random.unit() as f32)
        .collect();
    on_points.iter_mut().step_by(97).for_each(|v| *v = f32::NAN);
    let on_cells: Vec<i16> = (0..mesh.num_cells())
        .map(|_| random.next() as i16)
        .collect();
    let field = |name: &str, association, values| FieldInput {
        name: name.to_owned(),
        association,
        values,
        label: FieldLabel::default(),
    };
    let column = "one column";
    vec![
        field(
            "p",
            Association::Point,
            DataArray::from_vec(on_points, 1).expect(column),
        ),
        field(
            "c",
            Association::Cell,
            DataArray::from_vec(on_cells, 1).expect(column),
        ),
    ]
}

fn encoded(mesh: &UnstructuredMesh, fields: &[FieldInput], options: FileOptions) -> Vec<u8> {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().join("out.vacua");
    let report = encode_file(&path, mesh, fields, options, &|_| ()).expect("encodable");
    let bytes = std::fs::read(&path).expect("readable");
    let file = PackedFile::open(&path).expect("a .vacua file");
    let summary = file.summary().expect("intact");
    assert_eq!(report.bytes, summary.bytes);
    assert_eq!(report.num_cells_by_type, summary.num_cells_by_type);
    assert_eq!(report.num_vertices, summary.num_vertices);
    assert_eq!(report.num_nodes, summary.num_nodes);
    assert_eq!(report.num_submeshes, summary.num_submeshes);
    let of_fields: Vec<_> = summary.fields.iter().map(|f| f.bytes).collect();
    assert_eq!(report.fields, of_fields);
    let entries = folder.path().read_dir().expect("there").count();
    assert_eq!(entries, 1, "nothing is left beside the output");
    bytes
}

fn options(variant: Variant, index_bits: u32) -> FileOptions {
    FileOptions {
        encode: EncodeOptions {
            variant,
            index_bits,
        },
        keep_map: true,
        cells_in_memory: None,
    }
}

/// What encoding in memory and writing gives.
fn written(mesh: &UnstructuredMesh, fields: &[FieldInput], options: FileOptions) -> Vec<u8> {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().join("out.vacua");
    let whole = encode(mesh, options.encode).expect("encodable");
    let pack = |f: &FieldInput| {
        PackedField::pack(&whole.mesh, &whole.map, &f.name, f.association, &f.values).expect("fits")
    };
    let packed: Vec<_> = fields.iter().map(|f| (pack(f), f.label.clone())).collect();
    let map = options.keep_map.then_some(&whole.map);
    write_file_with(&path, &whole.mesh, map, &packed).expect("writable");
    std::fs::read(&path).expect("readable")
}

#[test]
fn the_file_is_the_same_whatever_is_in_memory() {
    for cut in CUTS {
        let soup = lattice(12, cut, 0.2, 7);
        let mut mask = CellMask::new(soup.cells.len());
        mask.blank(3);
        let mesh = soup.mesh().with_blanked_cells(mask).expect("fits");
        let fields = fields_of(&mesh, 1);
        for variant in [Variant::MultiLeaves, Variant::MultiNodes, Variant::Small] {
            for bits in [8, 9, 16] {
                let mut options = options(variant, bits);
                let expected = written(&mesh, &fields, options);
                assert!(
                    expected == encoded(&mesh, &fields, options),
                    "{cut:?} {bits}"
                );
                if bits == 16 {
                    continue;
                }
                for most in [mesh.num_cells() / 4 + 100, mesh.num_cells() * 2 / 3] {
                    options.cells_in_memory = Some(most);
                    assert!(
                        expected == encoded(&mesh, &fields, options),
                        "{cut:?} {bits} {most}"
                    );
                }
            }
        }
    }
}

#[test]
fn cells_in_one_place_are_divided_alike_in_memory_and_on_disk() {
    let mut soup = lattice(6, Cut::Tetrahedra, 0.0, 7);
    for p in &mut soup.points {
        *p = [1.0; 3];
    }
    let mesh = soup.mesh();
    let mut options = options(Variant::MultiNodes, 8);
    let expected = encoded(&mesh, &[], options);
    options.cells_in_memory = Some(600);
    assert!(expected == encoded(&mesh, &[], options));
}

#[test]
fn threads_change_no_byte() {
    let mesh = lattice(20, Cut::Mixed, 0.2, 4).wide_mesh();
    let fields = fields_of(&mesh, 2);
    let files = [1, 2, 5].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let options = options(Variant::MultiNodes, 9);
        pool.expect("threads")
            .install(|| encoded(&mesh, &fields, options))
    });
    assert!(files[0] == files[1] && files[0] == files[2]);
}

#[test]
fn a_part_larger_than_memory_is_named() {
    let mesh = lattice(10, Cut::Tetrahedra, 0.2, 4).mesh();
    let mut options = options(Variant::MultiNodes, 16);
    options.cells_in_memory = Some(1000);
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().join("out.vacua");
    let error = encode_file(&path, &mesh, &[], options, &|_| ()).expect_err("too large");
    let text = error.to_string();
    assert!(text.contains("a sub-mesh of 6000 cells"), "{text}");
    assert!(folder.path().read_dir().expect("there").next().is_none());
    assert!(options.with_memory_budget(1 << 20, &mesh).is_err());
    assert_eq!(
        options
            .with_memory_budget(1 << 33, &mesh)
            .map(|o| o.cells_in_memory),
        Ok(None)
    );
}

#[test]
fn fields_added_later_are_those_of_a_fresh_encoding() {
    let mesh = lattice(11, Cut::Mixed, 0.2, 9).mesh();
    let options = options(Variant::MultiNodes, 9);
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().join("out.vacua");
    let old = fields_of(&mesh, 1);
    encode_file(&path, &mesh, &old, options, &|_| ()).expect("encodable");
    let file = PackedFile::open(&path).expect("a .vacua file");
    let packed = file.mesh().expect("intact");
    let map = file.map(&packed).expect("intact").expect("kept");
    let whole = encode(&mesh, options.encode).expect("encodable");
    assert_eq!(map, whole.map);

    let mut new = fields_of(&mesh, 2);
    for (number, time) in [(0, 0.5), (1, 1.5)] {
        let mut series = fields_of(&mesh, 3 + u64::from(number)).remove(0);
        series.label.step = Some(FieldStep { number, time });
        new.push(series);
    }
    let pack = |f: &FieldInput| {
        let field = PackedField::pack(&packed, &map, &f.name, f.association, &f.values);
        (field.expect("fits"), f.label.clone())
    };
    let fields: Vec<_> = new.iter().map(pack).collect();
    // In place, over the very file that is mapped.
    write_file_with(&path, &packed, Some(&map), &fields).expect("writable");
    assert!(std::fs::read(&path).expect("readable") == encoded(&mesh, &new, options));
    let again = PackedFile::open(&path).expect("a .vacua file");
    let steps: Vec<_> = again
        .fields()
        .expect("named")
        .iter()
        .map(|f| f.label.step)
        .collect();
    assert_eq!(steps[..2], [None, None]);
    assert_eq!(steps[3].map(|s| (s.number, s.time)), Some((1, 1.5)));

    let plain = folder.path().join("plain.vacua");
    write_file(&plain, &whole.mesh, &[]).expect("writable");
    let plain = PackedFile::open(&plain).expect("a .vacua file");
    let mesh = plain.mesh().expect("intact");
    assert_eq!(plain.map(&mesh).expect("intact"), None);
}

#[test]
fn progress_reaches_the_end_of_every_stage() {
    let mesh = lattice(10, Cut::Hexahedra, 0.2, 9).mesh();
    let folder = tempfile::tempdir().expect("temporary folder");
    let path: &Path = &folder.path().join("out.vacua");
    let seen = Mutex::new(Vec::new());
    let observer = |p| seen.lock().expect("no panic").push(p);
    encode_file(
        path,
        &mesh,
        &[],
        options(Variant::MultiLeaves, 9),
        &observer,
    )
    .expect("encodable");
    let seen = seen.into_inner().expect("no panic");
    for stage in [
        EncodeStage::Partition,
        EncodeStage::Submeshes,
        EncodeStage::Outer,
        EncodeStage::Write,
    ] {
        let of_stage = seen.iter().filter(|p| p.stage == stage);
        let last = of_stage.max_by_key(|p| p.done).expect("told");
        assert_eq!(last.done, last.total, "{stage:?}");
    }
}
