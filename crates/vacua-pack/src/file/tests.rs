use std::path::Path;
use std::sync::OnceLock;

use super::*;
use crate::{BlockSampler, EncodeOptions, Encoded, PackedField, Variant, encode};
use proptest::prelude::*;
use vacua_io::{IoError, Problem, Source};
use vacua_volume::{Association, CellType, DataArray, UnstructuredMesh};

const VARIANTS: [Variant; 3] = [Variant::MultiLeaves, Variant::MultiNodes, Variant::Small];

/// A strip of tetrahedra with a field on points and one on cells.
fn example(variant: Variant) -> (Encoded, Vec<PackedField>) {
    let n = 300u32;
    let positions = (0..n + 3).flat_map(|i| [i as f32, (i * i % 7) as f32, (i % 5) as f32]);
    let corners = (0..n).flat_map(|i| [i, i + 1, i + 2, i + 3]);
    let mesh = UnstructuredMesh::uniform(
        DataArray::from_vec(positions.collect(), 3).expect("triples"),
        CellType::Tetrahedron,
        DataArray::from_vec(corners.collect(), 1).expect("column"),
    );
    let options = EncodeOptions {
        variant,
        index_bits: 8,
    };
    let encoded = encode(&mesh.expect("valid"), options).expect("encodable");
    let on_points = DataArray::from_vec((0..n + 3).map(f64::from).collect(), 1).expect("column");
    let on_cells = DataArray::from_vec((0..n).map(|i| i as u16).collect(), 1).expect("column");
    let pack = |name, association, values| {
        PackedField::pack(&encoded.mesh, &encoded.map, name, association, values).expect("fits")
    };
    let fields = vec![
        pack("Temperatur/°C", Association::Point, &on_points),
        pack("", Association::Cell, &on_cells),
    ];
    (encoded, fields)
}

fn written(variant: Variant) -> Vec<u8> {
    let (encoded, fields) = example(variant);
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().join("example.vacua");
    let step = FieldStep {
        number: 0,
        time: 0.25,
    };
    let labels = [
        FieldLabel::default(),
        FieldLabel {
            step: Some(step),
            vector: None,
        },
    ];
    let fields: Vec<_> = fields.into_iter().zip(labels).collect();
    write_file_with(&path, &encoded.mesh, Some(&encoded.map), &fields).expect("writable");
    std::fs::read(&path).expect("readable")
}

fn written_once(variant: Variant) -> Vec<u8> {
    static FILES: [OnceLock<Vec<u8>>; 3] = [const { OnceLock::new() }; 3];
    let file = &FILES[variant as usize];
    file.get_or_init(|| written(variant)).clone()
}

fn open(bytes: Vec<u8>) -> Result<PackedFile, IoError> {
    PackedFile::from_source(Source::from_bytes(Path::new("example.vacua"), bytes))
}

/// Opens, reads and samples everything.
fn use_all(bytes: Vec<u8>) -> Result<usize, IoError> {
    let file = open(bytes)?;
    let mesh = file.mesh()?;
    let fields = file.fields()?;
    let fields: Result<Vec<_>, _> = (0..fields.len()).map(|f| file.field(&mesh, f)).collect();
    let fields = fields?;
    if let Some(map) = file.map(&mesh)? {
        for association in [Association::Point, Association::Cell] {
            let values = DataArray::from_vec(vec![1u8; 303], 1).expect("column");
            // What a hostile map leads to is told, never read.
            let _ = PackedField::pack(&mesh, &map, "new", association, &values);
        }
    }
    let mut locator = mesh.locator();
    let samplers: Vec<_> = (fields.iter())
        .map(|field| BlockSampler::new(&mesh, field, None))
        .collect();
    for i in 0..100 {
        let p = [f64::from(i) * 3.0, f64::from(i % 6), f64::from(i % 4)];
        let places = p.map(|c| std::array::from_fn(|k| c as f32 + 0.1 * k as f32));
        for sampler in &samplers {
            let sampled = sampler.sample(&places, u16::MAX);
            sampler.gradients(&places, &sampled.located);
        }
        if let Some(location) = locator.locate(p) {
            for field in &fields {
                field.value_at(&mesh, &location);
            }
        }
    }
    Ok(mesh.cells().count())
}

#[test]
fn what_is_written_is_read() {
    for variant in VARIANTS {
        let (encoded, fields) = example(variant);
        let bytes = written(variant);
        assert_eq!(bytes, written(variant), "the same bytes every time");
        let file = open(bytes).expect("a .vacua file");
        let mesh = file.mesh().expect("intact");
        assert!(mesh.submeshes().len() > 1);
        assert!(mesh.cells().eq(encoded.mesh.cells()));
        assert_eq!(mesh.bytes(), encoded.mesh.bytes());
        assert_eq!(mesh.bounds(), encoded.mesh.bounds());
        let entries = file.fields().expect("named");
        assert_eq!(entries.len(), 2);
        assert_eq!(entries[0].label.step, None);
        assert_eq!(
            entries[1].label.step.map(|s| (s.number, s.time)),
            Some((0, 0.25))
        );
        assert_eq!(file.map(&mesh).expect("intact"), Some(encoded.map));
        for (i, field) in fields.iter().enumerate() {
            let read = file.field(&mesh, i).expect("intact");
            assert_eq!(entries[i].name, field.name());
            assert_eq!(read.association(), field.association());
            assert_eq!(read.values().bytes(), field.values().bytes());
            assert_eq!(read.values().scalar_type(), field.values().scalar_type());
            let header = &mesh.submeshes()[1];
            assert_eq!(read.point_value(header, 3), field.point_value(header, 3));
            assert_eq!(read.cell_value(header, 3), field.cell_value(header, 3));
            assert_eq!(read.bytes(), field.bytes());
            for s in 0..mesh.submeshes().len() {
                assert_eq!(read.submesh_range(s), field.submesh_range(s));
                assert_eq!(read.node_range(&mesh, s, 0), field.node_range(&mesh, s, 0));
            }
        }
        assert!(file.field(&mesh, 2).is_err());
    }
}

/// More bits than a number of the map may take.
const MAX_WIDTH_AND_ONE: u8 = 57;

fn section_of(bytes: &[u8], kind: u32) -> Entry {
    let header: Header = bytemuck::pod_read_unaligned(&bytes[..64]);
    let end = 64 + header.num_sections as usize * 64;
    let table: Vec<Entry> = bytemuck::pod_collect_to_vec(&bytes[64..end]);
    let found = table.into_iter().find(|e| e.kind == kind);
    found.expect("there is one")
}

#[test]
fn damage_is_named() {
    let good = written(Variant::MultiNodes);
    let error = |bytes: Vec<u8>| use_all(bytes).expect_err("damaged").to_string();
    assert!(error(b"solid".to_vec()).contains("the mark of a .vacua file"));
    assert!(error(Vec::new()).contains("the mark of a .vacua file"));
    let cut = good[..good.len() - 1].to_vec();
    let expected = format!(
        "needs bytes 0..{}, the file ends at {}",
        good.len(),
        good.len() - 1
    );
    assert!(error(cut).contains(&expected));
    assert!(error(good[..20].to_vec()).contains("truncated: the header"));

    let mut newer = good.clone();
    newer[8] = 2;
    let problem = open(newer).expect_err("newer").problem;
    assert!(matches!(problem, Problem::Unsupported { .. }), "{problem}");
    assert!(problem.to_string().contains("version 2.0"));

    let mut header = good.clone();
    header[36] ^= 1;
    assert!(error(header).contains("the header is damaged"));
    let mut table = good.clone();
    table[64 + 8] ^= 64;
    assert!(error(table).contains("the table of sections is damaged"));
    let mut map = good.clone();
    let place = section_of(&map, MAP_CELLS).offset as usize;
    map[place] = MAX_WIDTH_AND_ONE;
    assert!(error(map.clone()).contains("(map of cells) is damaged"));
    seal(&mut map);
    assert!(error(map).contains("block 0 of the map of cells"));
    let mut last = good.clone();
    *last.last_mut().expect("a byte") ^= 1;
    assert!(error(last).contains("(values) is damaged"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn mutated_files_are_refused(
        variant in prop::sample::select(VARIANTS.to_vec()),
        place in any::<prop::sample::Index>(),
        flip in 1u8..,
        cut in any::<prop::sample::Index>(),
    ) {
        let good = written_once(variant);
        prop_assert_eq!(use_all(good.clone()).expect("intact"), 300);
        let mut bad = good.clone();
        let place = place.index(bad.len());
        bad[place] ^= flip;
        // Bytes between sections belong to none.
        if use_all(bad).is_ok() {
            prop_assert_eq!(good[place], 0);
        }
        let cut = cut.index(good.len());
        prop_assert!(use_all(good[..cut].to_vec()).is_err());
    }

    /// Wrong bytes with right checksums: any answer or error, but no panic and no endless walk.
    #[test]
    fn hostile_files_do_no_harm(
        variant in prop::sample::select(VARIANTS.to_vec()),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..40),
    ) {
        let mut bytes = written_once(variant);
        let end = bytes.len() - 1536;
        for (place, byte) in changes {
            let place = 1536 + place.index(end);
            bytes[place] = byte;
        }
        seal(&mut bytes);
        let _ = use_all(bytes);
    }
}
