//! The tables of paper B at a tiny size: all come out, and their figures make sense.

use serde_json::Value;
use vacua_bench::encode::{self, EncodeOptions, EncodeResults};
use vacua_bench::meshes::{MeshSize, Scene};
use vacua_bench::sample::{self, Order, SampleOptions, SampleResults, Share};
use vacua_bench::{BenchError, paper_b};
use vacua_synth::MeshKind;

fn tiny(cells: usize) -> MeshSize {
    MeshSize {
        scale: 1.0,
        cells: Some(cells),
        shuffled: true,
    }
}

/// Cells of the rows of a printed table, without its head.
fn rows(markdown: &str, title: &str) -> Vec<Vec<String>> {
    let (_, table) = markdown.split_once(title).expect("the table is printed");
    let lines = table.lines().skip_while(|l| !l.starts_with('|'));
    lines
        .take_while(|l| l.starts_with('|'))
        .skip(2)
        .map(|l| {
            let cells = l.trim_matches('|').split('|');
            cells.map(|c| c.trim().to_owned()).collect()
        })
        .collect()
}

#[test]
fn tables_1_2_3_and_5_come_out() {
    let options = EncodeOptions {
        models: [MeshKind::Tet100, MeshKind::Hex150, MeshKind::Lander]
            .map(Scene)
            .into(),
        size: tiny(12),
        repeats: 1,
        threads: Some(2),
        index_bits: vec![32, 16, 8],
        quick: false,
    };
    let results = encode::run(&options).expect("tiny");
    let text = serde_json::to_string(&results).expect("plain data");
    let read: EncodeResults = serde_json::from_str(&text).expect("what was written");
    assert_eq!(read, results);

    for model in &results.models {
        let cells: u64 = model.cells.iter().sum();
        assert!(cells > 1000);
        let (mut packed, mut in_paper) = (Vec::new(), 0);
        for variant in &model.variants {
            let parts = variant.parts.expect("encoded");
            let per_cell = variant.bytes_per_cell.value().expect("encoded");
            assert!((parts.total() as f64 / cells as f64 - per_cell).abs() < 1e-9);
            // Between a third and three times the paper's, on a mesh that is all boundary.
            if let Some(paper) = variant.paper_bytes_per_cell {
                let ratio = per_cell / paper;
                assert!((0.33..3.0).contains(&ratio), "{ratio}");
                in_paper += 1;
            }
            assert!(variant.cells_per_sec.value().expect("encoded") > 0.0);
            packed.push(per_cell);
        }
        // The paper has no variant `small`, which lies between the two in the list.
        assert_eq!((packed.len(), in_paper), (3, 2));
        assert!(packed[1] < packed[0] && packed[1] < packed[2], "{packed:?}");
        assert_eq!(model.layouts.len(), 2);
        for layout in &model.layouts {
            let parts: u64 = layout.parts.iter().map(|p| p.1).sum();
            assert_eq!(layout.bytes.value(), Some(parts));
            let per_cell = layout.bytes_per_cell.value().expect("built");
            assert!(per_cell > 120.0 && per_cell < 260.0, "{per_cell}");
            let ratio = layout.ratio.value().expect("built");
            assert!((ratio - per_cell / packed[2]).abs() < 1e-9 * ratio);
        }
    }
    let tets = &results.models[0];
    assert_eq!(tets.cells, [6 * 12 * 12 * 12, 0, 0, 0]);
    // 32 + 8 + 40 · 2 bytes and vertices, paper B, §3.
    let min_max = tets.layouts[0].bytes_per_cell.value().expect("built");
    let vertices = 16.0 * 13f64.powi(3) / tets.cells[0] as f64;
    assert!((min_max - 120.0 - vertices).abs() < 0.1, "{min_max}");

    let bits = &results.index_bits;
    assert_eq!(bits.len(), 3);
    assert_eq!(bits[0].groups.value(), Some(1));
    assert_eq!(bits[0].replication.value(), Some(1.0));
    assert!(bits[2].groups.value() > bits[1].groups.value());
    assert!(bits[2].replication.value() > Some(1.1));
    assert!(bits[2].vertices_per_group.value().expect("encoded") <= 256.0);

    let markdown = results.markdown();
    assert_eq!(rows(&markdown, "## Table 3: the encoding").len(), 9);
    assert_eq!(rows(&markdown, "## Table 3: bytes a cell by part").len(), 9);
    let table = rows(&markdown, "## Table 1");
    assert_eq!(table.len(), 3);
    // Two nodes of 40 bytes a cell, but for one.
    assert!(table[0][3].starts_with("80.0 (77.9)"), "{:?}", table[0]);
    assert_eq!(rows(&markdown, "## Table 2").len(), 3);
    let table = rows(&markdown, "## Table 5");
    assert_eq!(table.len(), 6);
    assert!(table[4][4].ends_with("(10.8)"), "{:?}", table[4]);
}

#[test]
fn tables_4_and_6_and_rates_come_out() {
    let options = SampleOptions {
        models: [MeshKind::Tet100, MeshKind::Hex150].map(Scene).into(),
        size: tiny(12),
        pixels: 40,
        places: 4096,
        repeats: 2,
        threads: Some(2),
        shares: vec![
            Share { part: 4, of: 64 },
            Share { part: 2, of: 8 },
            Share { part: 8, of: 8 },
        ],
        quick: false,
    };
    let results = sample::run(&options).expect("tiny");
    let text = serde_json::to_string(&results).expect("plain data");
    let read: SampleResults = serde_json::from_str(&text).expect("what was written");
    assert_eq!(read, results);

    for (scene, num_references) in results.scenes.iter().zip([5, 3]) {
        assert!(scene.samples > 5000, "{}", scene.samples);
        assert_eq!(scene.peers.len(), 8);
        let measured = scene
            .peers
            .iter()
            .filter(|p| p.build_secs.value().is_some());
        assert_eq!(measured.clone().count(), 3 + num_references);
        for peer in measured {
            assert_eq!(peer.rates.len(), Order::ALL.len());
            for rate in &peer.rates {
                assert!(rate.samples_per_sec.value().expect("measured") > 0.0);
                assert!(rate.samples_per_core_sec.value().expect("measured") > 0.0);
            }
            assert!(peer.picture_secs.value().expect("rendered") > 0.0);
            // The same picture, but for weights that the packed form computes in `f32`.
            let off = peer.picture_difference.value().expect("rendered");
            assert!(off < 1e-4, "{}: {off}", peer.name);
        }
        // The references' pictures are the same to the bit.
        let mut offs = scene.peers[3..]
            .iter()
            .filter_map(|p| p.picture_difference.value());
        let first = offs.next().expect("rendered");
        assert!(offs.all(|off| off == first));
        for frame in &scene.frames {
            assert!(frame.samples.value().expect("rendered") > 0);
        }
    }
    // Hexahedra do not march, and it is said.
    let marching = &results.scenes[1].peers[7];
    let value = serde_json::to_value(marching).expect("plain data");
    let why = value["bytes_per_cell"]["empty"].as_str().expect("a reason");
    assert!(why.contains("tetrahedra only"), "{why}");

    let cells = |i: usize| results.shares[i].cells.value().expect("cut") as f64;
    assert_eq!(
        cells(2),
        results.scenes[0].cells.value().expect("made") as f64
    );
    assert!((cells(0) / cells(2) - 4.0 / 64.0).abs() < 0.02);
    assert!((cells(1) / cells(2) - 2.0 / 8.0).abs() < 0.05);
    for share in &results.shares {
        let [packed, user, faces, march] = &share.peers[..] else {
            panic!("four peers: {share:?}");
        };
        let bytes = [packed, user, faces, march].map(|p| p.bytes.value().expect("built"));
        assert!(
            bytes[0] < bytes[3] && bytes[3] < bytes[1] && bytes[1] < bytes[2],
            "{bytes:?}"
        );
    }

    let markdown = results.markdown();
    let table = rows(&markdown, "## tet100 (12): Msamples/s");
    // Eight peers, the target, and Open VKL.
    assert_eq!(table.len(), 10);
    assert_eq!(table[8][3..5], ["25.0", "4.00"]);
    assert_eq!(rows(&markdown, "## hex150 (12): frames").len(), 2);
    assert_eq!(rows(&markdown, "## Table 4").len(), 1);
    let table = rows(&markdown, "## Table 6");
    assert_eq!(table.len(), 2);
    assert!(table[1][4].ends_with("(4.96 s)"), "{:?}", table[1]);
    assert!(table[1][5].ends_with("(72.6)"), "{:?}", table[1]);
}

#[test]
fn quick_runs_say_what_they_leave_out() {
    let encoded = encode::run(&EncodeOptions {
        size: tiny(4),
        ..EncodeOptions::quick()
    });
    let markdown = encoded.expect("tiny").markdown();
    assert!(markdown.contains("a quick run leaves out OSPRay's layouts."));
    let sampled = sample::run(&SampleOptions {
        models: vec![Scene(MeshKind::Octree)],
        size: tiny(4),
        pixels: 8,
        places: 64,
        repeats: 1,
        ..SampleOptions::quick()
    });
    let results = sampled.expect("tiny");
    assert!(
        results
            .markdown()
            .contains("a quick run leaves out frames of the renderer.")
    );
    // One reference for cells of all types.
    let there = results.scenes[0]
        .peers
        .iter()
        .filter(|p| p.picture_secs.value().is_some());
    assert_eq!(there.count(), 4);
}

#[test]
fn nonsense_is_refused() {
    let encode = |change: fn(&mut EncodeOptions)| {
        let mut options = EncodeOptions::quick();
        change(&mut options);
        matches!(encode::run(&options), Err(BenchError::Option { .. }))
    };
    assert!(encode(|o| o.models.clear()));
    assert!(encode(|o| o.index_bits = vec![16, 7]));
    assert!(encode(|o| o.repeats = 0));
    assert!(encode(|o| o.size.scale = f64::NAN));
    let sample = |change: fn(&mut SampleOptions)| {
        let mut options = SampleOptions::quick();
        change(&mut options);
        matches!(sample::run(&options), Err(BenchError::Option { .. }))
    };
    assert!(sample(|o| o.models.clear()));
    assert!(sample(|o| o.pixels = 0));
    assert!(sample(|o| o.places = 0));
    assert!(sample(|o| o.threads = Some(0)));
    for text in ["0/8", "9/8", "1", "a/b", "1/0", "1/99999"] {
        assert!(text.parse::<Share>().is_err(), "{text}");
    }
    assert_eq!("3/8".parse(), Ok(Share { part: 3, of: 8 }));
    let unknown: Result<Scene, _> = serde_json::from_value(Value::from("supernova"));
    assert!(unknown.is_err());
}

#[test]
fn the_paper_is_quoted_whole() {
    for kind in MeshKind::ALL {
        let model = paper_b::model(kind);
        let parts = model.vertex_bytes + model.index_bytes;
        assert!(parts < model.variant_2_bytes && model.variant_2_bytes < model.variant_1_bytes);
        // §7: 4.7 to 14 times less than OSPRay.
        for ospray in [model.ospray_1_bytes, model.ospray_2_bytes]
            .into_iter()
            .flatten()
        {
            assert!((4.7..14.1).contains(&(ospray / model.variant_2_bytes)));
        }
    }
    let sum: f64 = paper_b::TABLE_1.iter().map(|p| p.1).sum();
    assert!((sum / (1u64 << 30) as f64 - 333.0).abs() < 1.0);
    for (peer, secs, megabytes) in paper_b::TABLE_6 {
        assert!(secs.is_sorted() && megabytes.is_sorted(), "{peer}");
    }
}
