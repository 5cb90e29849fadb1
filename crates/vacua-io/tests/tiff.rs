//! TIFF stacks against files that tifffile wrote, and against damage that a fuzzer rarely finds.
//!
//! `data/tiff/make.py` says how the files came about and what `expected.tsv` holds.

mod common;

use std::path::{Path, PathBuf};

use common::{grid, sums};
use glam::{DMat3, DVec3};
use vacua_io::{Dataset, IoError, ReadOptions, Source, open, open_source, open_stack, open_with};
use vacua_volume::{FieldChoice, ScalarType};

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data/tiff")
        .join(name)
}

#[test]
fn files_of_tifffile() {
    let expected = std::fs::read_to_string(data("expected.tsv")).expect("beside the tests");
    let mut num_fields = 0;
    for line in expected.lines() {
        let words: Vec<&str> = line.split('\t').collect();
        let [name, step, field, scalar_type] = words[..4] else {
            panic!("{line}");
        };
        let numbers: Vec<f64> = words[4..]
            .iter()
            .map(|n| n.parse().expect("a number"))
            .collect();
        let options = ReadOptions {
            step: step.parse().ok(),
            ..ReadOptions::default()
        };
        let dataset = open_with(data(name), &options).unwrap_or_else(|e| panic!("{e}"));
        let choice = FieldChoice::Name(field.to_owned());
        let field = dataset
            .field(&choice)
            .unwrap_or_else(|e| panic!("{name}: {e}"));
        let values = field.load().unwrap_or_else(|e| panic!("{name}: {e:?}"));

        assert_eq!(
            Ok(values.scalar_type()),
            scalar_type.parse::<ScalarType>(),
            "{name}"
        );
        assert_eq!(values.components() as f64, numbers[0], "{name}");
        let points = grid(&dataset).points().map(|n| n as f64);
        assert_eq!(points, numbers[1..4], "{name}");
        let affine = grid(&dataset).world_from_index();
        assert_eq!(affine.translation, DVec3::ZERO, "{name}");
        let wanted = DMat3::from_diagonal(DVec3::from_slice(&numbers[4..7]));
        assert!(
            affine.matrix3.abs_diff_eq(wanted, 1e-12),
            "{name}: {affine:?}"
        );
        assert_eq!(sums(values), numbers[7..9], "{name}");
        num_fields += 1;
    }
    assert_eq!(num_fields, expected.lines().count());
    assert!(num_fields >= 26, "{num_fields}");
}

#[test]
fn times_channels_and_units_are_told() {
    let imagej = open(data("imagej_hyperstack.tif")).expect("readable");
    assert_eq!(imagej.times(), [0.0, 0.25]);
    assert_eq!(imagej.fields().len(), 2);
    assert!(
        imagej.notes().iter().any(|n| n.contains("in um")),
        "{:?}",
        imagej.notes()
    );
    let ome = open(data("ome_rgb_times.ome.tif")).expect("readable");
    assert_eq!(ome.times(), [0.0, 2.0]);
    let late = ReadOptions {
        step: Some(2),
        ..ReadOptions::default()
    };
    let error = open_with(data("ome_rgb_times.ome.tif"), &late).expect_err("two steps");
    assert!(error.to_string().contains("2 steps"), "{error}");
    let white = open(data("white_is_zero.tif")).expect("readable");
    assert!(
        white.notes().iter().any(|n| n.contains("darker")),
        "{:?}",
        white.notes()
    );
}

#[test]
fn spacing_of_the_command_line_fills_gaps() {
    let options = ReadOptions {
        spacing: Some([2.0, 3.0, 4.0]),
        origin: Some([1.0, 1.0, 1.0]),
        ..ReadOptions::default()
    };
    let plain = open_with(data("signed.tif"), &options).expect("readable");
    assert_eq!(grid(&plain).spacing(), DVec3::new(2.0, 3.0, 4.0));
    assert_eq!(grid(&plain).world_from_index().translation, DVec3::ONE);
    let own = open_with(data("imagej_hyperstack.tif"), &options).expect("readable");
    assert_eq!(grid(&own).spacing(), DVec3::new(0.25, 0.5, 1.5));
}

#[test]
fn what_makes_no_volume_is_refused() {
    for (name, parts) in [
        (
            "flat.tif",
            ["flat picture (6 × 5 pixels)", "at least 2 pages"],
        ),
        ("imagej_frames.tif", ["flat picture", "4 times"]),
        ("other_size.tif", ["page 3: expected 6 × 5", "found 5 × 6"]),
        ("zstd.tif", ["Zstandard", "LZW"]),
        (
            "bits.tif",
            ["page 1: unsigned integers of 1 bits", "save integers"],
        ),
    ] {
        let error = open(data(name)).expect_err(name).to_string();
        for part in parts {
            assert!(error.contains(part), "{name}: {error}");
        }
    }
}

#[test]
fn files_of_one_page_make_a_stack() {
    let whole = open(data("big_strips.tif")).expect("readable");
    let options = ReadOptions {
        spacing: Some([1.0, 1.0, 2.5]),
        ..ReadOptions::default()
    };
    let paths: Vec<PathBuf> = (0..4).map(|i| data(&format!("slice_{i}.tif"))).collect();
    let stack = open_stack(&paths, &options)
        .expect("readable")
        .expect("pages");
    assert_eq!(grid(&stack).points(), grid(&whole).points());
    assert_eq!(grid(&stack).spacing(), DVec3::new(1.0, 1.0, 2.5));
    let values = |dataset: &Dataset| dataset.fields()[0].load().expect("whole").clone();
    assert_eq!(
        values(&stack).as_slice::<u16>(),
        values(&whole).as_slice::<u16>()
    );

    let other = [paths[0].clone(), data("flat.tif")];
    let error = open_stack(&other, &options)
        .expect_err("another size")
        .to_string();
    assert!(
        error.contains("flat.tif: page 1: expected 6 × 9"),
        "{error}"
    );
    let more = [paths[0].clone(), data("signed.tif")];
    let error = open_stack(&more, &options)
        .expect_err("a stack")
        .to_string();
    assert!(
        error.contains("signed.tif: the file: expected one page"),
        "{error}"
    );
    for several in ["signed.tif", "imagej_one_directory.tif", "expected.tsv"] {
        let files = [data(several), data(several)];
        assert!(
            open_stack(&files, &options).expect("not ours").is_none(),
            "{several}"
        );
    }
}

/// Opens bytes and loads all fields.
fn read(bytes: Vec<u8>) -> Result<(), String> {
    let source = Source::from_bytes(Path::new("test.tif"), bytes);
    let dataset =
        open_source(&source, &ReadOptions::default()).map_err(|e: IoError| e.to_string())?;
    for field in dataset.fields() {
        field.load().map_err(|e| format!("{e:?}"))?;
    }
    Ok(())
}

/// A little-endian file of uncompressed or deflated pages, 8 bits a pixel.
struct Maker {
    bytes: Vec<u8>,
    /// Where the pointer to the next directory is.
    pointer_at: usize,
}

impl Maker {
    fn new() -> Self {
        Self {
            bytes: b"II*\0\0\0\0\0".to_vec(),
            pointer_at: 4,
        }
    }

    /// Adds a directory of tags with values of type LONG.
    fn directory(&mut self, entries: &[(u16, u32)]) -> usize {
        let at = self.bytes.len();
        self.point_to(at as u32);
        self.bytes.extend((entries.len() as u16).to_le_bytes());
        for (tag, value) in entries {
            self.bytes.extend(tag.to_le_bytes());
            self.bytes.extend([4, 0, 1, 0, 0, 0]);
            self.bytes.extend(value.to_le_bytes());
        }
        self.pointer_at = self.bytes.len();
        self.bytes.extend([0; 4]);
        at
    }

    fn point_to(&mut self, at: u32) {
        self.bytes[self.pointer_at..self.pointer_at + 4].copy_from_slice(&at.to_le_bytes());
    }

    /// A page of one strip.
    fn page(&mut self, [width, height]: [u32; 2], compression: u32, strip: [u32; 2]) -> usize {
        self.directory(&[
            (256, width),
            (257, height),
            (258, 8),
            (259, compression),
            (262, 1),
            (273, strip[0]),
            (277, 1),
            (278, height),
            (279, strip[1]),
        ])
    }
}

#[test]
fn chains_that_come_back_end() {
    let mut file = Maker::new();
    let first = file.page([2, 2], 1, [0, 4]);
    file.page([2, 2], 1, [4, 4]);
    assert_eq!(read(file.bytes.clone()), Ok(()));
    file.point_to(first as u32);
    let error = read(file.bytes).expect_err("a loop");
    assert!(error.contains("page 2: expected another page"), "{error}");
}

#[test]
fn sizes_beyond_the_file_are_refused() {
    let page = |size, compression, strip| {
        let mut file = Maker::new();
        file.page(size, compression, strip);
        file.page(size, compression, strip);
        file.bytes.resize(1000, 0);
        read(file.bytes).expect_err("too large")
    };
    let plain = page([60_000, 60_000], 1, [8, 4]);
    assert!(
        plain.contains("could expand to 3600000000 bytes"),
        "{plain}"
    );
    for compression in [5, 8, 32773] {
        let bomb = page([60_000, 60_000], compression, [8, 900]);
        assert!(bomb.contains("page 1, strip 1"), "{bomb}");
    }
    let most = page([u32::MAX, u32::MAX], 8, [8, 900]);
    assert!(most.contains("page 1"), "{most}");
    let cut = page([30, 30], 1, [500, 900]);
    assert!(cut.contains("the file ends at 1000"), "{cut}");
    // Each page may be as large as that, but not all with the same bytes.
    let shared = page([800, 800], 8, [8, 900]);
    assert!(
        shared.contains("page 2, strip 1: expected strips and tiles that do not overlap"),
        "{shared}"
    );
}

#[test]
fn images_without_directories_must_be_there() {
    let whole = std::fs::read(data("imagej_one_directory.tif")).expect("readable");
    assert_eq!(read(whole.clone()), Ok(()));
    let cut = read(whole[..whole.len() - 1].to_vec()).expect_err("one byte is missing");
    assert!(cut.contains("truncated: the data of 5 images"), "{cut}");
    let at = whole
        .windows(8)
        .position(|w| w == b"images=5")
        .expect("there");
    let mut more = whole;
    more[at + 7] = b'9';
    let error = read(more).expect_err("nine images");
    assert!(error.contains("truncated: the data of 9 images"), "{error}");
}

#[test]
fn truncated_files_are_errors_everywhere() {
    for name in [
        "tiles_deflate.tif",
        "big_strips.tif",
        "imagej_hyperstack.tif",
    ] {
        let whole = std::fs::read(data(name)).expect("readable");
        for len in 0..whole.len() {
            // What is cut off the end may be padding that nobody needs.
            let result = read(whole[..len].to_vec());
            assert!(
                result.is_err() || len + 64 > whole.len(),
                "{name}: {len} bytes"
            );
        }
    }
}
