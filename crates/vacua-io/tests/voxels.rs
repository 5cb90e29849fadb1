//! Voxel formats against files that other programs wrote, and the writers against the readers.
//!
//! `data/voxels/make.py` says how the files came about and what `expected.tsv` holds.

mod common;

use std::path::{Path, PathBuf};

use common::{grid, sums};
use glam::{DAffine3, DMat3, DVec3};
use vacua_io::{Dataset, ReadOptions, Source, WriteOptions, open, open_source, open_with, save};
use vacua_volume::{
    Association, DataArray, Field, Geometry, Scalar, ScalarType, UniformGrid, WorldFrame,
    dispatch_scalar,
};

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data/voxels")
        .join(name)
}

#[test]
fn files_of_other_programs() {
    let expected = std::fs::read_to_string(data("expected.tsv")).expect("beside the tests");
    let mut files = 0;
    for line in expected.lines() {
        let mut words = line.split('\t');
        let name = words.next().expect("a name");
        let scalar_type: ScalarType = words.next().and_then(|t| t.parse().ok()).expect("a type");
        let numbers: Vec<f64> = words.map(|n| n.parse().expect("a number")).collect();
        let dataset = open(data(name)).unwrap_or_else(|e| panic!("{e}"));
        let values = dataset.fields()[0]
            .load()
            .unwrap_or_else(|e| panic!("{name}: {e:?}"));

        assert_eq!(values.scalar_type(), scalar_type, "{name}");
        assert_eq!(values.components() as f64, numbers[0], "{name}");
        assert_eq!(
            grid(&dataset).points().map(|n| n as f64),
            numbers[1..4],
            "{name}"
        );
        let affine = grid(&dataset).world_from_index();
        for row in 0..3 {
            for column in 0..4 {
                let found = match column {
                    3 => affine.translation[row],
                    _ => affine.matrix3.col(column)[row],
                };
                let wanted = numbers[4 + 4 * row + column];
                // Headers print or store a few digits less than the library computed with.
                assert!(
                    (found - wanted).abs() < 1e-6,
                    "{name}: {row},{column}: {found} ≠ {wanted}"
                );
            }
        }
        assert_eq!(sums(values), numbers[16..18], "{name}");
        files += 1;
    }
    assert_eq!(files, 73);
}

#[test]
fn notes_say_what_was_left_out() {
    let steps = open(data("nib_steps.nii.gz")).expect("readable");
    assert!(
        steps.notes().iter().any(|n| n.contains("first of 2 steps")),
        "{:?}",
        steps.notes()
    );
    let space = open(data("pynrrd_raw.nrrd")).expect("readable");
    assert!(
        space
            .notes()
            .iter()
            .any(|n| n.contains("left-posterior-superior"))
    );
}

#[test]
fn either_file_of_a_pair_opens() {
    let header = open(data("nib_pair.hdr")).expect("readable");
    let image = open(data("nib_pair.img")).expect("readable");
    assert_eq!(grid(&header), grid(&image));
    assert_eq!(
        sums(header.fields()[0].load().expect("whole")),
        sums(image.fields()[0].load().expect("whole"))
    );
}

#[test]
fn raw_files_by_name_and_by_options() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let values: Vec<u16> = (0..60).map(|i| i * 321).collect();
    let big: Vec<u8> = values.iter().flat_map(|v| v.to_be_bytes()).collect();
    let little: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();

    let named = folder.path().join("a_b_5x4x3_uint16.raw");
    std::fs::write(&named, &little).expect("writable");
    let dataset = open(&named).expect("sizes in the name");
    let loaded = dataset.fields()[0].load().expect("whole");
    assert_eq!(loaded.as_slice::<u16>(), Some(values.as_slice()));

    let other = folder.path().join("data.bin");
    std::fs::write(&other, [b"head!".as_slice(), &big].concat()).expect("writable");
    let unknown = open(&other).expect_err("no sizes").to_string();
    assert!(
        unknown.contains("--dims XxYxZ --type T or sizes in its name"),
        "{unknown}"
    );
    let options = ReadOptions {
        dimensions: Some([5, 4, 3]),
        scalar_type: Some(ScalarType::U16),
        big_endian: Some(true),
        spacing: Some([1.0, 2.0, 3.0]),
        origin: Some([7.0, 8.0, 9.0]),
        ..ReadOptions::default()
    };
    let surplus = open_with(&other, &options)
        .expect_err("five bytes too many")
        .to_string();
    for part in [
        "120 bytes",
        "125 bytes",
        "5 bytes too many",
        "--header-bytes 5",
    ] {
        assert!(surplus.contains(part), "{surplus}");
    }
    let options = ReadOptions {
        header_bytes: Some(5),
        ..options
    };
    let dataset = open_with(&other, &options).expect("described");
    let loaded = dataset.fields()[0].load().expect("whole");
    assert_eq!(loaded.as_slice::<u16>(), Some(values.as_slice()));
    assert_eq!(grid(&dataset).spacing(), DVec3::new(1.0, 2.0, 3.0));
    assert_eq!(
        grid(&dataset).world_from_index().translation,
        DVec3::new(7.0, 8.0, 9.0)
    );

    let wrong = folder.path().join("a_5x4x4_uint16.raw");
    std::fs::write(&wrong, &little).expect("writable");
    let wrong = open(&wrong).expect_err("too short").to_string();
    assert!(
        wrong.contains("160 bytes") && wrong.contains("120 bytes"),
        "{wrong}"
    );
}

#[test]
fn large_plain_files_stay_mapped() {
    let raw = ReadOptions {
        dimensions: Some([5, 4, 3]),
        scalar_type: Some(ScalarType::U16),
        header_bytes: Some(128),
        ..ReadOptions::default()
    };
    for (name, options) in [
        ("c_lu2.npy", ReadOptions::default()),
        ("c_lf8.npy", ReadOptions::default()),
        ("c_lu2.npy", raw),
        ("nib_f4.nii", ReadOptions::default()),
    ] {
        let source = Source::open(&data(name)).expect("there");
        let dataset = open_source(&source, &options).expect("readable");
        let values = dataset.fields()[0]
            .load()
            .expect("whole")
            .bytes()
            .as_ptr_range();
        let file = source.bytes().as_ptr_range();
        assert!(
            file.start <= values.start && values.end <= file.end,
            "{name} was copied"
        );
    }
}

#[test]
fn written_files_can_be_mapped() {
    let folder = tempfile::tempdir().expect("temporary folder");
    for name in ["a.nrrd", "a.mha", "a.npy"] {
        let path = folder.path().join(name);
        let dataset = written(ScalarType::F64, 1);
        save(&path, &dataset, &WriteOptions::default()).expect("written");
        let source = Source::open(&path).expect("there");
        let dataset = open_source(&source, &ReadOptions::default()).expect("readable");
        let values = dataset.fields()[0]
            .load()
            .expect("whole")
            .bytes()
            .as_ptr_range();
        let file = source.bytes().as_ptr_range();
        assert!(file.contains(&values.start), "{name} was copied");
    }
}

/// A tilted, mirrored grid with values of one type.
fn written(scalar_type: ScalarType, components: usize) -> Dataset {
    let points = [5, 4, 3];
    let axes = DMat3::from_rotation_x(0.4) * DMat3::from_diagonal(DVec3::new(-0.5, 2.0, 0.125));
    let place = DAffine3::from_mat3_translation(axes, DVec3::new(0.1, -20.0, 3e-7));
    let grid = UniformGrid::with_affine(points, place).expect("invertible");
    let values = dispatch_scalar!(scalar_type, T => {
        let values = (0..60 * components).map(|i| T::from_f64(i as f64 * 0.7 - 20.0)).collect();
        DataArray::from_vec::<T>(values, components)
    });
    let field = Field::new("v", Association::Point, values.expect("whole tuples"));
    Dataset::new(Geometry::Uniform(grid), vec![field]).expect("fits")
}

#[test]
fn what_is_written_reads_back() {
    let folder = tempfile::tempdir().expect("temporary folder");
    for scalar_type in ScalarType::ALL {
        for (components, compress) in [(1, false), (3, true)] {
            let dataset = written(scalar_type, components);
            let before = dataset.fields()[0].load().expect("in memory");
            let options = WriteOptions {
                compress,
                ..WriteOptions::default()
            };
            for (name, keeps_place) in [("a.nrrd", true), ("a.mha", true), ("a.npy", false)] {
                let path = folder.path().join(name);
                let lost = save(&path, &dataset, &options).expect("written");
                assert_eq!(lost.is_empty(), keeps_place, "{name}: {lost:?}");
                let back = open(&path).expect("readable");
                let after = back.fields()[0].load().expect("whole");
                assert_eq!(after.scalar_type(), scalar_type, "{name}");
                assert_eq!(after.components(), components, "{name}");
                assert_eq!(after.bytes(), before.bytes(), "{name} {scalar_type}");
                if keeps_place {
                    let difference = (grid(&back).world_from_index().matrix3
                        - grid(&dataset).world_from_index().matrix3)
                        .to_cols_array();
                    assert!(difference.iter().all(|d| d.abs() < 1e-15), "{name}");
                    assert_eq!(
                        grid(&back).world_from_index().translation,
                        grid(&dataset).world_from_index().translation
                    );
                }
            }
        }
        let dataset = written(scalar_type, 1);
        let path = folder.path().join(format!("a_5x4x3_{scalar_type}.raw"));
        save(&path, &dataset, &WriteOptions::default()).expect("written");
        let back = open(&path).expect("sizes in the name");
        let before = dataset.fields()[0].load().expect("in memory");
        assert_eq!(
            back.fields()[0].load().expect("whole").bytes(),
            before.bytes()
        );
    }
}

/// One image by nibabel, pynrrd and ITK, each in its frame: readers know which, and what is written
/// is what those programs wrote.
#[test]
fn anatomical_frames_are_known_and_kept() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let place = |dataset: &Dataset| grid(dataset).world_from_index();
    let is_close = |a: DAffine3, b: DAffine3| a.abs_diff_eq(b, 1e-6);
    let itk = open(data("frame_lps.mha")).expect("readable");
    for (name, frame) in [
        ("nib_qform.nii.gz", WorldFrame::Ras),
        ("frame_ras.nrrd", WorldFrame::Ras),
        ("frame_las.nrrd", WorldFrame::Las),
        ("frame_lps.nrrd", WorldFrame::Lps),
        ("frame_lps.mha", WorldFrame::Lps),
        ("nib_pair.hdr", WorldFrame::Ras),
        ("c_lf4.npy", WorldFrame::Unlabelled),
        ("skip.nhdr", WorldFrame::Unlabelled),
    ] {
        let dataset = open(data(name)).expect("readable");
        assert_eq!(dataset.frame(), frame, "{name}");
        let nrrd = folder.path().join("a.nrrd");
        save(&nrrd, &dataset, &WriteOptions::default()).expect("written");
        let back = open(&nrrd).expect("readable");
        assert_eq!(back.frame(), frame, "{name} as NRRD");
        assert!(is_close(place(&back), place(&dataset)), "{name} as NRRD");
        let header = std::fs::read(&nrrd).expect("written");
        let named = header.windows(8).any(|w| w == b"\nspace: ");
        assert_eq!(named, frame != WorldFrame::Unlabelled, "{name} as NRRD");

        let mha = folder.path().join("a.mha");
        save(&mha, &dataset, &WriteOptions::default()).expect("written");
        let back = open(&mha).expect("readable");
        let signs = frame.signs_to(WorldFrame::Lps).unwrap_or(DVec3::ONE);
        let turned = DAffine3::from_mat3(DMat3::from_diagonal(signs)) * place(&dataset);
        assert!(is_close(place(&back), turned), "{name} as MetaImage");
        if name.starts_with("frame") || name == "nib_qform.nii.gz" {
            assert!(is_close(place(&back), place(&itk)), "{name} against ITK");
            let header =
                String::from_utf8_lossy(&std::fs::read(&mha).expect("written")).into_owned();
            // As ITK says of the same image.
            assert!(header.contains("\nAnatomicalOrientation = RPI\n"), "{name}");
        }
    }
    let brain = open(data("nib_qform.nii.gz")).expect("readable");
    let lost = save(
        folder.path().join("a.vti"),
        &brain,
        &WriteOptions::default(),
    );
    assert!(lost.expect("written")[0].contains("these are RAS"));
    assert_eq!(
        brain.clone().with_fields(Vec::new()).expect("fits").frame(),
        WorldFrame::Ras
    );
}

#[test]
fn what_cannot_be_written_is_refused() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let refused = |name: &str, dataset: &Dataset| {
        let path = folder.path().join(name);
        let error = save(&path, dataset, &WriteOptions::default()).expect_err("refused");
        assert!(!path.exists(), "{name} was left behind");
        error.to_string()
    };
    let one = written(ScalarType::U8, 1);
    assert!(refused("a.raw", &one).contains("name_5x4x3_uint8.raw"));
    assert!(refused("a_5x4x3_int8.raw", &one).contains("name_5x4x3_uint8.raw"));
    assert!(refused("a_5x4x3_uint8.raw", &written(ScalarType::U8, 2)).contains("2 components"));
    assert!(refused("a.gif", &one).contains("vacua writes"));
}

#[test]
fn the_format_is_found_by_content() {
    let folder = tempfile::tempdir().expect("temporary folder");
    for name in [
        "c_lf4.npy",
        "itk_i16.nrrd",
        "itk_i16.mha",
        "nib_2.nii",
        "nib_big.nii",
    ] {
        let disguised = folder.path().join("data.unknown");
        std::fs::copy(data(name), &disguised).expect("writable");
        open(&disguised).unwrap_or_else(|e| panic!("{name}: {e}"));
    }
    // A compressed file under the plain extension, as some programs leave it.
    let disguised = folder.path().join("brain.nii");
    std::fs::copy(data("nib_both.nii.gz"), &disguised).expect("writable");
    open(&disguised).expect("gzip by content");
}
