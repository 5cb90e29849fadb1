//! Meshes through the command: info, encode, sample, convert, synth.

mod common;

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::{Value, json};

use common::{folder, stderr, succeed, text, vacua};

fn as_json(arguments: &[&str]) -> Value {
    serde_json::from_slice(&succeed(arguments).stdout).expect("one JSON object")
}

fn fails(arguments: &[&str], code: i32) -> String {
    let output = vacua(arguments);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}");
    stderr(&output)
}

fn data(name: &str) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../vacua-io/tests/data");
    text(&folder.join(name))
}

#[test]
fn info_counts_cells() {
    let info = as_json(&["info", &data("disk_out_ref.ex2"), "--json"]);
    assert_eq!(info["kind"], "unstructured");
    assert_eq!(info["points"], 8499);
    assert_eq!(info["cells"], json!({"hexahedron": 7472, "quad": 2952}));
    assert_eq!(info.get("dimensions"), None);
    let names: Vec<&str> = info["fields"]
        .as_array()
        .expect("a list")
        .iter()
        .filter_map(|f| f["name"].as_str())
        .collect();
    assert_eq!(names, ["Temp", "V", "Pres", "AsH3", "GaMe3", "CH4", "H2"]);
    let plain = String::from_utf8(succeed(&["info", &data("post.vtk")]).stdout).expect("text");
    assert!(plain.contains("8750 × tetrahedron"), "{plain}");
}

#[test]
fn steps_of_one_file_are_time_steps() {
    let file = data("mesh/blocks.ex2");
    let info = as_json(&["info", &file, "--time", "2.0", "--json"]);
    assert_eq!(
        (&info["time_steps"], &info["time_step"]),
        (&json!(3), &json!(2))
    );
    assert_eq!(info["fields"][3]["range"], json!([112.0, 122.0]));
    let message = fails(&["info", &file, "--time", "9"], 1);
    assert!(
        message.contains("steps 0 to 2, at times 0 to 2"),
        "{message}"
    );
}

/// Points of a table of VTK's, as the command takes them.
fn sampled(file: &str, field: &str, points: &Path) -> Vec<Option<f64>> {
    let output = succeed(&["sample", file, "--field", field, "--points", &text(points)]);
    let text = String::from_utf8(output.stdout).expect("text");
    text.lines()
        .skip(1)
        .map(|line| {
            let cells: Vec<&str> = line.split(',').collect();
            (cells[3] == "1").then(|| cells[4].parse().expect("a number"))
        })
        .collect()
}

#[test]
fn an_encoded_mesh_says_and_gives_the_same() {
    let folder = folder();
    for (file, field, table, variant) in [
        ("post.vtk", "Pressure", "probe/post_pressure.csv", "1"),
        ("warped.vtu", "wave", "probe/warped_wave.csv", "2"),
    ] {
        let packed = folder.path().join(format!("{file}.vacua"));
        let arguments = [
            "encode",
            &data(file),
            "-o",
            &text(&packed),
            "--variant",
            variant,
            "--index-bits",
            "8",
            "--json",
        ];
        let report = as_json(&arguments);
        let bytes = &report["bytes"];
        let part = |name: &str| bytes[name].as_u64().expect("a number");
        let parts = [
            "vertices",
            "indices",
            "nodes",
            "outer",
            "sub_meshes",
            "values",
            "ranges",
        ];
        assert_eq!(parts.iter().map(|p| part(p)).sum::<u64>(), part("total"));
        let file_bytes = report["file_bytes"].as_u64().expect("a number");
        assert!(file_bytes > part("total") && file_bytes < part("total") + 4096);
        // 256 vertices hold the smaller one, with 248 points, whole.
        assert_eq!(report["sub_meshes"].as_u64() > Some(1), file == "post.vtk");

        let info = as_json(&["info", &text(&packed), "--json"]);
        let plain = as_json(&["info", &data(file), "--json"]);
        assert_eq!(info["cells"], plain["cells"]);
        assert_eq!(info["kind"], "unstructured");
        assert_eq!(info["fields"], plain["fields"]);
        assert_eq!(info["packed"]["variant"].to_string(), variant);
        assert_eq!(info["packed"]["bytes"], report["bytes"]);

        let points = PathBuf::from(data(table));
        let exact = sampled(&data(file), field, &points);
        let from_packed = sampled(&text(&packed), field, &points);
        assert!(exact.iter().flatten().count() > 200);
        for (exact, packed) in exact.iter().zip(&from_packed) {
            match (exact, packed) {
                (Some(a), Some(b)) => assert!((a - b).abs() < 1e-5, "{a} {b}"),
                (a, b) => assert_eq!(a, b),
            }
        }
    }
}

#[test]
fn fields_are_chosen_by_name_and_component() {
    let folder = folder();
    let packed = text(&folder.path().join("can.vacua"));
    let can = data("can.vtu");
    succeed(&[
        "encode",
        &can,
        "-o",
        &packed,
        "--fields",
        "EQPS,DISPL:2,VEL:mag",
    ]);
    let info = as_json(&["info", &packed, "--json"]);
    let fields: Vec<&str> = info["fields"]
        .as_array()
        .expect("a list")
        .iter()
        .filter_map(|f| f["name"].as_str())
        .collect();
    assert_eq!(fields, ["EQPS", "DISPL:2", "VEL:mag"]);
    assert_eq!(
        info["fields"][1]["range"],
        json!([-17.810230255126953, 0.0506276935338974])
    );
    let message = fails(&["encode", &can, "-o", &packed, "--fields", "nothing"], 1);
    assert!(message.contains("no field `nothing`"), "{message}");
    fails(&["encode", &can, "-o", &packed, "--fields", "DISPL:x"], 2);
    fails(&["encode", &can, "-o", &packed, "--variant", "3"], 2);
    fails(&["encode", &can, "-o", &packed, "--index-bits", "7"], 2);
    fails(&["encode", &can, "-o", &packed, "--threads", "0"], 2);
    succeed(&["encode", &can, "-o", &packed]);
    let by_all = std::fs::read(&packed).expect("written");
    succeed(&["encode", &can, "-o", &packed, "--threads", "1"]);
    assert!(std::fs::read(&packed).expect("written") == by_all);
    let grid = fails(&["encode", &data("hydrogen.vti"), "-o", &packed], 1);
    assert!(grid.contains("uniform grid"), "{grid}");
}

#[test]
fn fields_are_added_and_swapped_without_encoding_again() {
    let folder = folder();
    let path = |name: &str| text(&folder.path().join(name).with_extension("vacua"));
    let can = data("can.vtu");
    let paths = [path("plain"), path("updated"), path("fresh")];
    let [plain, updated, fresh] = [0, 1, 2].map(|i| paths[i].as_str());
    succeed(&["encode", &can, "-o", plain, "--fields", "EQPS"]);
    let message = fails(&["encode", &can, "--update", plain], 1);
    assert!(message.contains("--keep-map"), "{message}");
    let kept = ["encode", &can, "--keep-map", "-o"];
    succeed(&[&kept[..], &[updated, "--fields", "DISPL:2,EQPS"]].concat());
    let swap = ["encode", &can, "--update", updated, "--json"];
    let report = as_json(&[&swap[..], &["--fields", "EQPS,VEL:all"]].concat());
    assert_eq!(report["swapped"], json!(["EQPS"]));
    assert_eq!(report["added"], json!(["VEL", "VEL:0", "VEL:1", "VEL:2"]));
    assert_eq!(report["kept"], json!(["DISPL:2"]));
    succeed(&[&kept[..], &[fresh, "--fields", "DISPL:2,EQPS,VEL:all"]].concat());
    let read = |path: &str| std::fs::read(path).expect("written");
    assert!(read(updated) == read(fresh), "the file of a fresh encoding");
    let info = as_json(&["info", fresh, "--json"]);
    assert!(info["packed"]["bytes"]["map"].as_u64() > Some(0));
    let message = fails(&["encode", &data("post.vtk"), "--update", updated], 1);
    assert!(message.contains("values, the mesh's"), "{message}");
    assert!(message.contains("points need at least 6724:"), "{message}");
}

#[test]
fn time_steps_share_the_mesh() {
    let folder = folder();
    let packed = text(&folder.path().join("steps.vacua"));
    let can = data("can.vtu");
    let both = ["encode", &can, &can, "-o", &packed, "--all-steps"];
    succeed(&[&both[..], &["--fields", "EQPS,DISPL:2"]].concat());
    let info = as_json(&["info", &packed, "--json"]);
    assert_eq!(info["time_steps"], 2);
    let fields = info["fields"].as_array().expect("a list");
    let steps: Vec<_> = fields.iter().map(|f| (&f["name"], &f["step"])).collect();
    assert_eq!(steps.len(), 4);
    assert_eq!(steps[3], (&json!("DISPL:2"), &json!(1)));
    assert_eq!(fields[0]["range"], fields[2]["range"]);
    let other = [
        "encode",
        &can,
        &data("post.vtk"),
        "-o",
        &packed,
        "--all-steps",
    ];
    let message = fails(&other, 1);
    assert!(message.contains("another mesh"), "{message}");
}

#[test]
fn a_budget_is_kept_or_refused() {
    let folder = folder();
    let path = |name: &str| text(&folder.path().join(name));
    let can = data("can.vtu");
    let (all, some) = (path("all.vacua"), path("some.vacua"));
    succeed(&["encode", &can, "-o", &all, "--vertices-log2", "9"]);
    let bits = ["--index-bits", "9", "--memory-budget", "4GiB"];
    succeed(&[&["encode", &can, "-o", &some][..], &bits].concat());
    let read = |path: &str| std::fs::read(path).expect("written");
    assert!(read(&all) == read(&some));
    let message = fails(&["encode", &can, "-o", &some, "--memory", "1M"], 1);
    assert!(
        message.contains("cannot be encoded within 1.00 MB"),
        "{message}"
    );
    fails(&["encode", &can, "-o", &some, "--memory", "lots"], 2);
}

/// Killed at any time, the command leaves nothing, or the whole file.
#[cfg(target_os = "linux")]
#[test]
fn a_killed_encoding_leaves_no_half_file() {
    let folder = folder();
    let mesh = text(&folder.path().join("mesh.vtu"));
    succeed(&["synth", "jets", "--size", "40", "-o", &mesh]);
    let whole = text(&folder.path().join("whole.vacua"));
    succeed(&["encode", &mesh, "-o", &whole]);
    let expected = std::fs::read(&whole).expect("written");
    let out = folder.path().join("killed").join("out.vacua");
    std::fs::create_dir(folder.path().join("killed")).expect("a folder");
    for millis in [1, 5, 10, 20, 40, 80, 120, 160, 200, 250, 300, 400] {
        let mut child = Command::new(env!("CARGO_BIN_EXE_vacua"))
            .args(["encode", &mesh, "-o", &text(&out)])
            .stdout(std::process::Stdio::null())
            .spawn()
            .expect("the command starts");
        std::thread::sleep(std::time::Duration::from_millis(millis));
        child.kill().expect("it can be killed");
        child.wait().expect("it ends");
        let left: Vec<PathBuf> = std::fs::read_dir(out.parent().expect("a folder"))
            .expect("listable")
            .map(|entry| entry.expect("an entry").path())
            .collect();
        match left.as_slice() {
            [] => {}
            [one] => assert!(
                std::fs::read(one).expect("readable") == expected,
                "{millis}"
            ),
            more => panic!("after {millis} ms there are {more:?}"),
        }
    }
}

#[test]
fn a_damaged_file_is_named_as_such() {
    let folder = folder();
    let path = folder.path().join("post.vacua");
    succeed(&["encode", &data("post.vtk"), "-o", &text(&path)]);
    let mut bytes = std::fs::read(&path).expect("written");
    let len = bytes.len();
    bytes[40] ^= 1;
    std::fs::write(&path, &bytes).expect("writable");
    assert!(fails(&["info", &text(&path)], 1).contains("damaged"));
    bytes[40] ^= 1;
    std::fs::write(&path, &bytes[..len / 2]).expect("writable");
    assert!(fails(&["info", &text(&path)], 1).contains("truncated"));
}

#[test]
fn meshes_are_made_and_converted() {
    let folder = folder();
    let made = text(&folder.path().join("octree.vtu"));
    succeed(&[
        "synth",
        "octree",
        "--size",
        "16",
        "--values",
        "linear",
        "--shuffle",
        "-o",
        &made,
    ]);
    let info = as_json(&["info", &made, "--json"]);
    assert!(info["cells"]["pyramid"].as_u64() > Some(0), "{info}");
    assert_eq!(info["fields"][0]["type"], "f64");
    let converted = text(&folder.path().join("converted.vtu"));
    succeed(&["convert", &made, &converted, "--compress"]);
    let again = as_json(&["info", &converted, "--json"]);
    for key in ["points", "cells", "bounds", "fields"] {
        assert_eq!(info[key], again[key], "{key}");
    }
    let wrong = text(&folder.path().join("mesh.vti"));
    let message = fails(&["convert", &made, &wrong], 1);
    assert!(message.contains("VTI holds uniform"), "{message}");
    fails(&["synth", "octree", "--size", "3x4x5", "-o", &made], 2);
    fails(&["synth", "octree", "--holes", "2", "-o", &made], 2);
}

#[test]
fn meshes_are_rendered_encoded_or_not() {
    let folder = folder();
    let in_folder = |name: &str| text(&folder.path().join(name));
    let (mesh, packed, picture) = (
        in_folder("ocean.vtu"),
        in_folder("ocean.vacua"),
        in_folder("ocean.png"),
    );
    succeed(&["synth", "ocean", "--size", "12", "-o", &mesh]);
    let report = as_json(&[
        "render",
        &mesh,
        "-o",
        &picture,
        "--size",
        "96x64",
        "--device",
        "cpu",
        "--skip",
        "mesh",
        "--overlay",
        "boundary",
        "--json",
    ]);
    assert_eq!(report["skip"]["method"], "mesh");
    assert!(report["samples"].as_u64().is_some_and(|n| n > 0));
    let pixels = image::open(&picture).expect("a picture").to_rgba8();
    assert!(pixels.pixels().any(|p| p.0[3] > 0), "something is seen");
    succeed(&["encode", &mesh, "-o", &packed]);
    let from_mesh = std::fs::read(&picture).expect("a picture");
    let from_packed = in_folder("packed.png");
    let look = ["--range", "0,1", "--opacity", "0:0,1:1", "--device", "cpu"];
    for (file, picture) in [(&mesh, &picture), (&packed, &from_packed)] {
        let view = ["render", file, "-o", picture, "--size", "96x64"];
        succeed(&[&view[..], &look[..]].concat());
    }
    let [a, b] = [&picture, &from_packed].map(|path| std::fs::read(path).expect("a picture"));
    assert!(
        a == b && a != from_mesh,
        "the same picture, in another look"
    );
    let message = fails(&["convert", &packed, &in_folder("ocean.vtk")], 1);
    assert!(
        message.contains("ocean.vacua: an encoded mesh"),
        "{message}"
    );
}

/// What `sample` says of points.
fn values_at(arguments: &[&str], points: &str) -> Vec<Option<f64>> {
    let output = succeed(&[&["sample", "--points", points], arguments].concat());
    let text = String::from_utf8(output.stdout).expect("text");
    let value = |line: &str| {
        let cell = line.split(',').nth(4).expect("five columns");
        (!cell.is_empty()).then(|| cell.parse().expect("a number"))
    };
    text.lines().skip(1).map(value).collect()
}

/// Points spread over the box of a file.
fn points_within(info: &Value, path: &Path) -> String {
    let bounds: Vec<f64> = info["bounds"]
        .as_array()
        .expect("six")
        .iter()
        .filter_map(Value::as_f64)
        .collect();
    let mut lines = String::new();
    for i in 0..400u32 {
        // Multiples of three irrational numbers spread evenly.
        let share =
            [0.819_172_51, 0.671_043_61, 0.549_700_48].map(|r: f64| (r * f64::from(i)).fract());
        let at = [0, 1, 2].map(|a| bounds[2 * a] + share[a] * (bounds[2 * a + 1] - bounds[2 * a]));
        lines += &format!("{},{},{}\n", at[0], at[1], at[2]);
    }
    std::fs::write(path, lines).expect("writable");
    text(path)
}

fn assert_close(found: &[Option<f64>], expected: &[Option<f64>], what: &str) {
    assert_eq!(found.len(), expected.len());
    assert!(expected.iter().flatten().count() > 20, "{what}");
    for (found, expected) in found.iter().zip(expected) {
        match (found, expected) {
            (Some(a), Some(b)) => {
                assert!((a - b).abs() <= 1e-5 * b.abs().max(1.0), "{what}: {a} {b}")
            }
            (a, b) => assert_eq!(a, b, "{what}"),
        }
    }
}

/// Components and magnitude of vectors are those of the file that was encoded.
#[test]
fn encoded_vectors_keep_their_components() {
    let folder = folder();
    let can = data("can.vtu");
    let plain = as_json(&["info", &can, "--json"]);
    let points = points_within(&plain, &folder.path().join("points.csv"));
    for variant in ["2", "small"] {
        let packed = text(&folder.path().join(format!("{variant}.vacua")));
        succeed(&["encode", &can, "-o", &packed, "--variant", variant]);
        let info = as_json(&["info", &packed, "--json"]);
        assert_eq!(info["fields"], plain["fields"]);
        for component in ["0", "1", "2", "mag"] {
            let choice = ["--field", "VEL", "--component", component];
            let of = |path: &str| values_at(&[&[path], &choice[..]].concat(), &points);
            assert_close(&of(&packed), &of(&can), component);
        }
        let magnitude = values_at(&[&packed, "--field", "VEL"], &points);
        let choice = ["--field", "VEL", "--component", "mag"];
        assert_eq!(
            magnitude,
            values_at(&[&[packed.as_str()], &choice[..]].concat(), &points)
        );
        let message = fails(
            &[
                "sample",
                &packed,
                "--points",
                &points,
                "--field",
                "VEL",
                "--component",
                "3",
            ],
            1,
        );
        assert!(
            message.contains("VEL") && message.contains('3'),
            "{message}"
        );
    }
}

/// The fields of a time step of an encoded mesh are those of that step of the file.
#[test]
fn encoded_time_steps_are_chosen_by_number_and_time() {
    let folder = folder();
    let in_folder = |name: &str| text(&folder.path().join(name));
    let series = data("hdf/steps.vtkhdf");
    let packed = in_folder("steps.vacua");
    let encode = [
        "encode",
        &series,
        "-o",
        &packed,
        "--all-steps",
        "--fields",
        "wave",
    ];
    let encoded = vacua(&encode);
    assert!(
        encoded.status.success(),
        "{}",
        String::from_utf8_lossy(&encoded.stderr)
    );
    let info = as_json(&["info", &packed, "--json"]);
    assert_eq!(info["time_steps"], 3);
    let times: Vec<f64> = info["times"]
        .as_array()
        .expect("times")
        .iter()
        .filter_map(Value::as_f64)
        .collect();
    assert_eq!(times.len(), 3);
    let points = points_within(&info, &folder.path().join("points.csv"));
    let mut seen = Vec::new();
    for (number, time) in times.iter().enumerate() {
        let time = time.to_string();
        let of =
            |path: &str, time: &str| values_at(&[path, "--field", "wave", "--time", time], &points);
        let expected = of(&series, &time);
        assert_close(&of(&packed, &time), &expected, &time);
        let one = as_json(&["info", &packed, "--time", &time, "--json"]);
        assert_eq!(one["time_step"], json!(number));
        assert_eq!(one["fields"].as_array().map(Vec::len), Some(1));
        assert_eq!(one["fields"][0]["step"], json!(number));
        seen.push(expected);
    }
    assert!(seen[0] != seen[1] && seen[1] != seen[2], "steps differ");
    assert_eq!(
        values_at(&[&packed], &points),
        values_at(&[&packed, "--time", "0"], &points)
    );
    for command in [
        vec!["info", &packed, "--time", "77"],
        vec!["sample", &packed, "--points", &points, "--time", "77"],
        vec!["render", &packed, "-o", "never.png", "--time", "77"],
    ] {
        let message = fails(&command, 1);
        assert!(message.contains("steps 0 to 2, at times"), "{message}");
    }
    let plain = String::from_utf8(succeed(&["info", &packed]).stdout).expect("text");
    assert!(plain.contains("step 2, time"), "{plain}");
}

/// Coarse values keep their bound, and pictures are made of them.
#[test]
fn levels_of_detail_of_an_encoded_mesh() {
    let folder = folder();
    let in_folder = |name: &str| text(&folder.path().join(name));
    let (mesh, packed) = (data("post.vtk"), in_folder("post.vacua"));
    succeed(&["encode", &mesh, "-o", &packed, "--index-bits", "9"]);
    let info = as_json(&["info", &packed, "--json"]);
    let points = points_within(&info, &folder.path().join("points.csv"));
    let field = ["--field", "Pressure"];
    let exact = values_at(&[&[packed.as_str()], &field[..]].concat(), &points);
    let mut pictures = Vec::new();
    let mut largest = Vec::new();
    for level in ["submesh", "multileaf", "leaf", "exact"] {
        let picture = in_folder("picture.png");
        let render = [
            "render", &packed, "--size", "48x48", "--device", "cpu", "--json", "--lod", level,
            "-o", &picture,
        ];
        let report = as_json(&[&render[..], &field].concat());
        assert_eq!(report["lod"]["level"], level);
        pictures.push(image::open(&picture).expect("a picture").to_rgb8());
        if level == "exact" {
            assert_eq!(report["lod"]["largest_bound"], Value::Null);
            continue;
        }
        let bound = report["lod"]["largest_bound"].as_f64().expect("a bound");
        let sample = ["sample", &packed, "--points", &points, "--lod", level];
        let output = succeed(&[&sample[..], &field].concat());
        let text = String::from_utf8(output.stdout).expect("text");
        assert!(text.starts_with("x,y,z,inside,value,bound\n"), "{text}");
        for (line, exact) in text.lines().skip(1).zip(&exact) {
            let cells: Vec<&str> = line.split(',').collect();
            let Some(exact) = exact else { continue };
            let number = |i: usize| cells[i].parse::<f64>().expect("a number");
            assert!((number(4) - exact).abs() <= number(5), "{line}: {exact}");
            assert!(number(5) <= bound, "{line}: {bound}");
        }
        largest.push(bound);
    }
    assert!(
        largest[0] >= largest[1] && largest[1] >= largest[2],
        "{largest:?}"
    );
    assert!(pictures.windows(2).all(|p| p[0] != p[1]), "levels differ");
    let (slowly, at_once) = (in_folder("slowly.png"), in_folder("at_once.png"));
    let common = ["--size", "48x48", "--device", "cpu", "--spp", "2"];
    let render = |arguments: &[&str]| {
        succeed(&[&["render", &packed][..], &field, &common, arguments].concat())
    };
    render(&["-o", &slowly, "--progressive"]);
    render(&["-o", &at_once]);
    let read = |path: &str| std::fs::read(path).expect("written");
    assert!(
        read(&slowly) == read(&at_once),
        "the last picture is the picture"
    );
    let message = fails(&["render", &packed, "-o", &slowly, "--lod", "node"], 2);
    assert!(
        message.contains("submesh, multileaf, leaf or exact"),
        "{message}"
    );
    let grid = data("hydrogen.vti");
    let message = fails(
        &[
            "render", &grid, "-o", &slowly, "--lod", "leaf", "--device", "cpu",
        ],
        1,
    );
    assert!(message.contains("only meshes"), "{message}");
    let message = fails(&["sample", &mesh, "--points", &points, "--lod", "leaf"], 2);
    assert!(message.contains("encoded meshes"), "{message}");
}

/// VTKHDF, XDMF and Exodus II in HDF5, with time steps, through everything that reads.
#[test]
fn hdf5_and_xdmf_work_as_other_files_do() {
    let folder = folder();
    let in_folder = |name: &str| text(&folder.path().join(name));
    for (file, field, time, cells) in [
        ("hdf/steps.vtkhdf", "wave", "1.5", 16),
        ("xdmf/meshio_series.xdmf", "wave", "1.5", 48),
        ("hdf/blocks.g", "Temp", "2.0", 3),
    ] {
        let path = data(file);
        let info = as_json(&["info", &path, "--time", time, "--json"]);
        assert_eq!(info["kind"], "unstructured", "{file}");
        assert_eq!(
            (&info["time_steps"], &info["time_step"]),
            (&json!(3), &json!(2)),
            "{file}"
        );
        let points = in_folder("points.csv");
        std::fs::write(&points, "0.5,0.5,0.5\n9,9,9\n").expect("writable");
        let sample = |path: &str, time: &[&str]| {
            let arguments = ["sample", path, "--field", field, "--points", &points];
            let output = succeed(&[&arguments, time].concat());
            String::from_utf8(output.stdout).expect("text")
        };
        let values = sample(&path, &["--time", time]);
        assert!(values.contains("0.5,0.5,0.5,1,"), "{file}: {values}");
        assert!(values.contains("9,9,9,0,\n"), "{file}: {values}");
        let copy = in_folder("copy.vtu");
        succeed(&["convert", &path, &copy, "--time", time]);
        assert_eq!(sample(&copy, &[]), values, "{file}");
        let again = as_json(&["info", &copy, "--json"]);
        assert_eq!(again["bounds"], info["bounds"], "{file}");
        let counts = again["cells"].as_object().expect("counts");
        let sum: u64 = counts.values().filter_map(Value::as_u64).sum();
        assert_eq!(sum, cells, "{file}");
        let picture = in_folder("picture.png");
        succeed(&[
            "render", &path, "--field", field, "--size", "24x24", "--device", "cpu", "-o", &picture,
        ]);
        let pixels = image::open(&picture).expect("a picture").to_rgba8();
        assert!(pixels.pixels().any(|p| p.0[3] > 0), "{file}");
    }
    let info = as_json(&["info", &data("hdf/image.vtkhdf"), "--json"]);
    assert_eq!(info["kind"], "uniform");
    assert_eq!(info["dimensions"], json!([5, 4, 4]));
}
