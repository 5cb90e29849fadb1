//! Zarr against folders that zarr-python wrote; hostile ones; and how problems are told.
//!
//! `data/zarr/make.py` says how the folders came about and what `expected.tsv` holds.

mod common;

use std::path::{Path, PathBuf};

use common::{grid, sums};
use serde_json::{Value, json};
use vacua_io::{ReadOptions, open, open_with};
use vacua_volume::ScalarType;

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data/zarr")
        .join(name)
}

#[test]
fn folders_of_zarr_python() {
    let expected = std::fs::read_to_string(data("expected.tsv")).expect("beside the tests");
    let mut folders = 0;
    for line in expected.lines() {
        let words: Vec<&str> = line.split('\t').collect();
        let [name, scalar_type, components, numbers @ ..] = &words[..] else {
            panic!("{line}");
        };
        let number = |i: usize| numbers[i].parse::<f64>().expect("a number");
        let dataset = open(data(name)).unwrap_or_else(|e| panic!("{e}"));
        let field = &dataset.fields()[0];
        let values = field.load().unwrap_or_else(|e| panic!("{name}: {e:?}"));
        let scalar_type: ScalarType = scalar_type.parse().expect("a type");
        assert_eq!(values.scalar_type(), scalar_type, "{name}");
        assert_eq!(values.components().to_string(), *components, "{name}");
        let grid = grid(&dataset);
        let affine = grid.world_from_index();
        for a in 0..3 {
            assert_eq!(grid.points()[a] as f64, number(a), "{name}");
            let origin = affine.translation[a];
            assert!(
                (origin - number(3 + a)).abs() < 1e-9,
                "{name}: origin {origin}"
            );
            let spacing = affine.matrix3.col(a)[a];
            assert!(
                (spacing - number(6 + a)).abs() < 1e-9,
                "{name}: spacing {spacing}"
            );
        }
        assert_eq!(field.name(), numbers[9], "{name}");
        assert_eq!(dataset.fields().len() as f64, number(10), "{name}");
        assert_eq!(dataset.times().len().max(1) as f64, number(11), "{name}");
        assert_eq!(sums(values), [number(12), number(13)], "{name}");
        folders += 1;
    }
    assert!(folders > 80, "{folders}");
}

#[test]
fn numbers_that_are_none_fill_what_is_not_stored() {
    let dataset = open(data("v3/nan.zarr")).unwrap_or_else(|e| panic!("{e}"));
    let values = dataset.fields()[0].load().expect("numbers");
    let slab = 10 * 13;
    for i in 0..values.tuples() {
        assert_eq!(values.get_f64(i, 0).is_nan(), i < 4 * slab, "{i}");
    }
}

#[test]
fn steps_channels_and_notes_of_images() {
    for version in ["0.4", "0.5"] {
        let path = data(&format!("image_{version}.zarr"));
        let first = open(&path).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(first.times().len(), 3);
        assert!(
            (first.times()[2] - 0.2).abs() < 1e-12,
            "{:?}",
            first.times()
        );
        let notes = first.notes().join("; ");
        assert!(
            notes.contains("nanometer") && notes.contains("coarser ones"),
            "{notes}"
        );
        let options = ReadOptions {
            step: Some(2),
            ..ReadOptions::default()
        };
        let third = open_with(&path, &options).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(third.step(), 2);
        let [dapi, gfp] = third.fields() else {
            panic!("two channels");
        };
        assert_eq!([dapi.name(), gfp.name()], ["DAPI", "GFP"]);
        // Numbers of different channels and steps differ.
        let loaded = [&first.fields()[0], dapi, gfp].map(|f| sums(f.load().expect("numbers")));
        assert!(
            loaded[0] != loaded[1] && loaded[1] != loaded[2],
            "{loaded:?}"
        );
        let options = ReadOptions {
            step: Some(3),
            ..ReadOptions::default()
        };
        let refused = open_with(&path, &options).expect_err("no fourth step");
        assert!(refused.to_string().contains("3 steps"), "{refused}");
        // A file of metadata leads to its folder.
        let mark = if version == "0.4" {
            ".zattrs"
        } else {
            "zarr.json"
        };
        let again = open(path.join(mark)).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(again.times(), first.times());
    }
}

/// A folder with metadata of an array, changed, and a file for its first chunk.
fn array(change: impl FnOnce(&mut Value), chunk: &[u8]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("temporary folder");
    let mut meta = json!({
        "zarr_format": 3,
        "node_type": "array",
        "shape": [4, 4, 4],
        "data_type": "uint16",
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [4, 4, 4]}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "."}},
        "fill_value": 7,
        "codecs": [{"name": "bytes", "configuration": {"endian": "little"}}],
    });
    change(&mut meta);
    std::fs::write(folder.path().join("zarr.json"), meta.to_string()).expect("writable");
    std::fs::write(folder.path().join("c.0.0.0"), chunk).expect("writable");
    folder
}

/// What is said of a folder that cannot be read, causes included.
fn message(folder: &Path) -> String {
    let chain = |error: &dyn std::error::Error| {
        let all = std::iter::successors(Some(error), |e| e.source());
        all.map(ToString::to_string).collect::<Vec<_>>().join(": ")
    };
    let loaded = open(folder).map_err(|e| chain(&e)).and_then(|dataset| {
        let loaded = dataset.fields()[0].load();
        loaded.map(|_| ()).map_err(|e| chain(&e))
    });
    loaded
        .err()
        .unwrap_or_else(|| panic!("{} was read", folder.display()))
}

#[test]
fn what_is_wrong_is_told() {
    let whole = [1; 128];
    assert!(open(array(|_| {}, &whole).path()).is_ok());
    let bytes = json!({"name": "bytes", "configuration": {"endian": "little"}});
    let shards = |chunk: Value| {
        json!([{"name": "sharding_indexed", "configuration": {
            "chunk_shape": chunk,
            "codecs": [bytes],
            "index_codecs": [bytes, {"name": "crc32c"}],
        }}])
    };
    let set = |key: &'static str, value: Value| move |meta: &mut Value| meta[key] = value;
    let cases: Vec<(&str, tempfile::TempDir)> = vec![
        ("zarr_format", array(set("zarr_format", json!(4)), &whole)),
        ("node_type", array(set("node_type", json!("table")), &whole)),
        ("`shape`", array(set("shape", json!([4, -1, 4])), &whole)),
        ("`shape`", array(set("shape", json!([])), &whole)),
        ("[4, 0, 4]", array(set("shape", json!([4, 0, 4])), &whole)),
        ("flat", array(set("shape", json!([1, 4, 4])), &whole)),
        ("chunk_shape", array(set("shape", json!([4, 4])), &whole)),
        (
            "more than this machine can address",
            array(
                set("shape", json!([1u64 << 40, 1u64 << 30, 1 << 20])),
                &whole,
            ),
        ),
        (
            "complex64",
            array(set("data_type", json!("complex64")), &whole),
        ),
        ("fill_value", array(set("fill_value", json!(70000)), &whole)),
        (
            "fill_value",
            array(set("fill_value", json!("0xffff")), &whole),
        ),
        (
            "wavelet",
            array(set("codecs", json!([bytes, {"name": "wavelet"}])), &whole),
        ),
        (
            "makes bytes",
            array(
                set(
                    "codecs",
                    json!([{"name": "transpose", "configuration": {"order": [0, 1, 2]}}]),
                ),
                &whole,
            ),
        ),
        (
            "order",
            array(
                set(
                    "codecs",
                    json!([{"name": "transpose", "configuration": {"order": [0, 1, 1]}}, bytes]),
                ),
                &whole,
            ),
        ),
        (
            "divisors",
            array(set("codecs", shards(json!([3, 4, 4]))), &whole),
        ),
        (
            "above 0",
            array(set("codecs", shards(json!([0, 4, 4]))), &whole),
        ),
        (
            "shard's index",
            array(set("codecs", shards(json!([2, 2, 2]))), &whole),
        ),
        (
            "CRC-32C",
            array(set("codecs", shards(json!([4, 4, 4]))), &whole),
        ),
        ("128 bytes", array(|_| {}, &whole[..100])),
        (
            "gzip",
            array(set("codecs", json!([bytes, {"name": "gzip"}])), &whole),
        ),
        (
            "Zstandard",
            array(set("codecs", json!([bytes, {"name": "zstd"}])), &whole),
        ),
        (
            "Blosc",
            array(set("codecs", json!([bytes, {"name": "blosc"}])), &whole),
        ),
        (
            "[2097152, 4, 4, 1] chunks",
            array(
                |meta| {
                    meta["shape"] = json!([4, 4, 1 << 21]);
                    meta["chunk_grid"]["configuration"]["chunk_shape"] = json!([1, 1, 1]);
                },
                &whole,
            ),
        ),
        (
            "chunks of",
            array(
                |meta| {
                    meta["chunk_grid"]["configuration"]["chunk_shape"] =
                        json!([1u64 << 20, 1u64 << 20, 1u64 << 20]);
                },
                &whole,
            ),
        ),
    ];
    for (expected, folder) in &cases {
        let message = message(folder.path());
        assert!(message.contains(expected), "{expected}: {message}");
    }
    let folder = tempfile::tempdir().expect("temporary folder");
    let nothing = open(folder.path()).expect_err("refused").to_string();
    assert!(nothing.contains("a folder"), "{nothing}");
    std::fs::write(folder.path().join(".zgroup"), r#"{"zarr_format": 2}"#).expect("writable");
    let empty = open(folder.path()).expect_err("refused").to_string();
    assert!(empty.contains("without arrays"), "{empty}");
    std::fs::write(folder.path().join("zarr.json"), "{").expect("writable");
    let broken = open(folder.path()).expect_err("refused").to_string();
    assert!(
        broken.contains("zarr.json") && broken.contains("line 1"),
        "{broken}"
    );
}

/// Any byte of a chunk or of metadata may be wrong: never a panic, and never numbers that are not there.
#[test]
fn damage_is_survived() {
    let folders = [
        "v3/shards.zarr",
        "v3/blosc.zarr",
        "v3/gzip_crc.zarr",
        "v2/lz4.zarr",
        "blosc/blosclz_1_f4.zarr",
        "blosc/zlib_2_u2.zarr",
    ];
    let mut state = 1u32;
    let mut random = move |n: usize| {
        state = state.wrapping_mul(1664525).wrapping_add(1013904223);
        (state >> 8) as usize % n
    };
    for name in folders {
        let folder = tempfile::tempdir().expect("temporary folder");
        copy(&data(name), folder.path());
        let mut files = Vec::new();
        list(folder.path(), &mut files);
        for round in 0..300 {
            let file = &files[round % files.len()];
            let whole = std::fs::read(file).expect("readable");
            let mut damaged = whole.clone();
            match random(3) {
                0 => damaged.truncate(random(whole.len())),
                1 => {
                    let at = random(whole.len());
                    damaged[at] = random(256) as u8;
                }
                _ => {
                    let at = random(whole.len());
                    let value = [0, 255, 127, 128][random(4)];
                    let end = (at + 4).min(whole.len());
                    damaged[at..end].fill(value);
                }
            }
            std::fs::write(file, &damaged).expect("writable");
            if let Ok(dataset) = open(folder.path()) {
                // Sizes that are read from damaged metadata may be any.
                let points = grid(&dataset).points();
                if points.iter().product::<usize>() < 1 << 24 {
                    let _ = dataset.fields()[0].load();
                }
            }
            std::fs::write(file, &whole).expect("writable");
        }
    }
}

fn copy(from: &Path, to: &Path) {
    for entry in std::fs::read_dir(from).expect("a folder") {
        let entry = entry.expect("an entry");
        let to = to.join(entry.file_name());
        if entry.path().is_dir() {
            std::fs::create_dir(&to).expect("writable");
            copy(&entry.path(), &to);
        } else {
            std::fs::copy(entry.path(), &to).expect("writable");
        }
    }
}

fn list(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        match path.is_dir() {
            true => list(&path, files),
            false => files.push(path),
        }
    }
}
