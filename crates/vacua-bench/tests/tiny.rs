//! Every table at a tiny size: all cells are in the JSON, and the printed tables show them.

use serde_json::Value;
use vacua_bench::paper;
use vacua_bench::render::{self, RenderOptions, RenderResults};
use vacua_bench::skip::{self, Method, Model, SkipOptions, SkipResults};
use vacua_bench::{BenchError, Cell};

fn tiny() -> SkipOptions {
    SkipOptions {
        scale: 0.04,
        size: (24, 16),
        repeats: 2,
        threads: Some(2),
        ..SkipOptions::default()
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

/// Every `Cell` below a JSON value: a number, or an object that says why there is none.
fn check_cells(value: &Value, names: &[&str]) -> usize {
    match value {
        Value::Array(items) => items.iter().map(|v| check_cells(v, names)).sum(),
        Value::Object(members) => members
            .iter()
            .map(|(name, value)| {
                if !names.contains(&name.as_str()) {
                    return check_cells(value, names);
                }
                let why = value.get("empty").and_then(Value::as_str);
                assert!(
                    value.is_number() || why.is_some_and(|w| !w.is_empty()),
                    "{name}: {value}"
                );
                1
            })
            .sum(),
        _ => 0,
    }
}

#[test]
fn all_tables_of_the_paper_come_out() {
    let options = tiny();
    let results = skip::run(&options).expect("tiny");
    assert_eq!(results.rebuild_side, 16);
    let text = serde_json::to_string(&results).expect("plain data");
    let read: SkipResults = serde_json::from_str(&text).expect("what was written");
    assert_eq!(read, results);

    for model in &results.models {
        assert_eq!(model.builds.len(), 3);
        for build in &model.builds {
            let (all, active) = (build.macrocells.value(), build.active.value());
            assert!(active.expect("measured") <= all.expect("measured"));
            let boxes = build.boxes_count.value().expect("measured");
            assert!(boxes <= active.expect("measured"));
            assert_eq!(build.triangles.value().expect("measured") % 2, 0);
            for times in [&build.mesh, &build.boxes, &build.grid] {
                let parts = times.classify_secs.value().expect("measured")
                    + times.shape_secs.value().expect("measured");
                assert!(parts > 0.0 && times.total_secs.value().expect("measured") > 0.0);
            }
            assert!(build.grid.hierarchy_secs.value().is_none());
            assert!(build.paper.is_some());
        }
        // Base and three methods at three sizes, for one and four rays; Table 4's four.
        assert_eq!(model.frames.len(), 2 * (1 + 9) + 4);
        let single = |f: &&skip::FrameResult| f.rays_per_pixel == 1 && !f.rebuilt;
        let base = model.frames.iter().find(single).expect("the base");
        assert_eq!((base.method, base.side), (Method::None, None));
        for frame in model.frames.iter().filter(single) {
            let samples = frame.samples.value().expect("measured");
            assert!(samples <= base.samples.value().expect("measured"));
        }
    }

    let value: Value = serde_json::from_str(&text).expect("JSON");
    let names = [
        "macrocells",
        "active",
        "triangles",
        "boxes_count",
        "macrocell_secs",
        "classify_secs",
        "shape_secs",
        "hierarchy_secs",
        "total_secs",
        "secs",
        "samples",
    ];
    let paper_times = 2 * 4 * 12;
    let paper_counts = 3 * 12;
    let cells = 4 * (3 * (5 + 3 * 4) + 24 * 2) + paper_times + paper_counts;
    assert_eq!(check_cells(&value, &names), cells);

    let markdown = results.markdown();
    let table = rows(&markdown, "## Table 1");
    assert_eq!(table.len(), 12);
    // Rows by K, then by model, as in the paper.
    assert_eq!(table[7][..2], ["llnl", "16"]);
    let llnl = &results.models[3].builds[1];
    let number = llnl.macrocells.value().expect("measured").to_string();
    assert_eq!(table[7][2], format!("{number} (1.97 M)"));
    assert!(table[7][9].ends_with("(6.00 ms)"), "{:?}", table[7]);
    let table = rows(&markdown, "## Table 2");
    assert_eq!(table.len(), 12);
    assert!(table[3][6].ends_with("(687 ms)"), "{:?}", table[3]);
    for rays in ["1 ray", "4 rays"] {
        for what in ["frames per second", "times as fast"] {
            let start = format!("## Table 3: {what}");
            let title = markdown
                .lines()
                .find(|l| l.starts_with(&start) && l.contains(rays));
            let table = rows(&markdown, title.expect("printed"));
            assert_eq!(table.len(), 4);
            assert!(table.iter().all(|row| row.len() == 11));
            assert!(table.iter().flatten().all(|cell| !cell.is_empty()));
        }
    }
    let table = rows(&markdown, "## Table 4");
    assert_eq!(table.len(), 4);
    assert!(table[1][5].ends_with("(83.0)"), "{:?}", table[1]);
}

#[test]
fn what_is_left_out_says_why() {
    let options = SkipOptions {
        quick: true,
        models: vec![Model::Heptane],
        sides: vec![4],
        ..tiny()
    };
    let results = skip::run(&options).expect("tiny");
    let frames = &results.models[0].frames;
    for frame in frames {
        let left_out = frame.rays_per_pixel == 4 || frame.rebuilt && frame.method == Method::None;
        match &frame.secs {
            Cell::Empty { empty } => assert!(left_out && !empty.is_empty(), "{frame:?}"),
            Cell::Value(secs) => assert!(!left_out && *secs > 0.0, "{frame:?}"),
        }
        // The paper has no K = 4.
        assert!(frame.side.is_none() || frame.paper_table3_fps.is_none());
    }
    let markdown = results.markdown();
    assert!(markdown.contains("a quick run leaves out 4 rays a pixel."));
    assert!(markdown.contains("– [1] (9.00)"), "{markdown}");
}

#[test]
fn a_failing_volume_leaves_the_others_alone() {
    // Macrocells of 0 cells are refused at once; a picture without pixels fails in its cells.
    let options = SkipOptions {
        size: (0, 4),
        models: vec![Model::Dns],
        quick: true,
        ..tiny()
    };
    let results = skip::run(&options).expect("the builds are measured");
    let model = &results.models[0];
    assert!(model.builds.iter().all(|b| b.active.value().is_some()));
    assert!(model.frames.iter().all(|f| f.secs.value().is_none()));
    assert!(results.markdown().contains("a picture of 0×4 pixels"));
}

#[test]
fn nonsense_options_are_refused() {
    let refused = |change: fn(&mut SkipOptions)| {
        let mut options = tiny();
        change(&mut options);
        matches!(skip::run(&options), Err(BenchError::Option { .. }))
    };
    assert!(refused(|o| o.scale = 0.0));
    assert!(refused(|o| o.scale = f64::NAN));
    assert!(refused(|o| o.scale = 1.5));
    assert!(refused(|o| o.repeats = 0));
    assert!(refused(|o| o.threads = Some(0)));
    assert!(refused(|o| o.sides = vec![]));
    assert!(refused(|o| o.sides = vec![8, 0]));
    assert!(refused(|o| o.models = vec![]));
    assert!("supernova".parse::<Model>().is_err());
}

#[test]
fn the_benchmark_scene_comes_out() {
    let options = RenderOptions {
        scale: 0.08,
        size: (24, 16),
        repeats: 2,
        threads: Some(2),
        ..RenderOptions::default()
    };
    let results = render::run(&options).expect("tiny");
    let text = serde_json::to_string(&results).expect("plain data");
    let read: RenderResults = serde_json::from_str(&text).expect("what was written");
    assert_eq!(read, results);
    assert_eq!(results.frames.len(), 3 * 2 * 10);
    for pair in results.frames.chunks(10) {
        let all = pair[0].samples.value().expect("measured");
        assert!(all > 0);
        for frame in pair {
            assert!(frame.samples.value().expect("measured") <= all);
            assert!(frame.samples_per_sec.value().expect("measured") > 0.0);
        }
    }
    assert_eq!(results.macrocells.len(), 3);
    assert!(
        results
            .macrocells
            .iter()
            .all(|m| m.bytes_per_sec.value().is_some())
    );
    assert_eq!(results.edits.len(), 4);
    assert!(
        results
            .edits
            .iter()
            .all(|e| e.times.total_secs.value().is_some())
    );
    let markdown = results.markdown();
    assert_eq!(rows(&markdown, "## Frames").len(), 60);
    assert_eq!(rows(&markdown, "## Macrocells").len(), 3);
    assert_eq!(rows(&markdown, "## Transfer-function edit").len(), 4);

    let quick = render::run(&RenderOptions {
        quick: true,
        ..options
    })
    .expect("tiny");
    assert!(
        quick
            .markdown()
            .contains("a quick run leaves out gradient shading.")
    );
}

#[test]
fn the_paper_is_quoted_whole() {
    for model in Model::ALL {
        for side in [8, 16, 32] {
            let build = paper::build(model, side).expect("Tables 1 and 2");
            assert!(build.active < build.macrocells);
            for times in [build.mesh, build.boxes] {
                let sum = times.classify_secs + times.shape_secs + times.hierarchy_secs;
                // The paper's totals are more than the sum of what they contain, but for rounding.
                assert!(times.total_secs > sum - 1e-3, "{model} {side} {times:?}");
            }
            for rays in [1, 4] {
                for method in [Method::None, Method::Boxes, Method::Mesh] {
                    assert!(paper::frames(model, rays, method.name(), Some(side)).is_some());
                }
                assert_eq!(paper::frames(model, rays, "grid", Some(side)), None);
            }
        }
        assert_eq!(paper::build(model, 4), None);
        assert!(paper::rebuilds(model, "none", false).is_some());
        assert_eq!(paper::rebuilds(model, "none", true), None);
        assert!(paper::rebuilds(model, "mesh", true) < paper::rebuilds(model, "mesh", false));
    }
}
