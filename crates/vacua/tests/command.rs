//! The command as people meet it: what it prints, where, and with which exit code.

mod common;

use std::path::{Path, PathBuf};
use std::process::Output;

use serde_json::Value;

use common::{folder, stderr, succeed, text, vacua};

fn data(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data")
        .join(name);
    path.to_string_lossy().into_owned()
}

fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn json(arguments: &[&str]) -> Value {
    serde_json::from_slice(&succeed(arguments).stdout).expect("one JSON object")
}

/// A ball of values from 255 in the middle to 0 at the corners, as a raw file.
fn ball(folder: &Path) -> PathBuf {
    let path = folder.join("ball_20x20x20_uint8.raw");
    let value = |i: usize| {
        let square = |n: usize| (n as f64 - 9.5).powi(2);
        let r = (square(i % 20) + square(i / 20 % 20) + square(i / 400)).sqrt();
        (255.0 * (1.0 - r / 17.0)) as u8
    };
    std::fs::write(&path, (0..8000).map(value).collect::<Vec<u8>>()).expect("writable");
    path
}

fn decode(path: &Path) -> (u32, u32, Vec<u8>) {
    let file = std::io::BufReader::new(std::fs::File::open(path).expect("was written"));
    let mut reader = png::Decoder::new(file).read_info().expect("a PNG");
    let mut bytes = vec![0; reader.output_buffer_size().expect("small")];
    let info = reader.next_frame(&mut bytes).expect("one frame");
    bytes.truncate(info.buffer_size());
    (info.width, info.height, bytes)
}

#[test]
fn info_of_a_real_file() {
    let info = json(&["info", &data("hydrogen.vti"), "--json"]);
    assert_eq!(info["kind"], "uniform");
    assert_eq!(info["dimensions"], serde_json::json!([64, 64, 64]));
    assert_eq!(
        info["bounds"],
        serde_json::json!([0.0, 63.0, 0.0, 63.0, 0.0, 63.0])
    );
    let field = &info["fields"][0];
    assert_eq!(field["association"], "point");
    assert_eq!(field["type"], "f32");
    assert_eq!(field["components"], 1);
    let ends = field["range"].as_array().expect("a range");
    assert!(ends[0].as_f64() < ends[1].as_f64(), "{ends:?}");

    let output = succeed(&["info", &data("hydrogen.vti")]);
    assert!(stdout(&output).contains("uniform grid, 64 × 64 × 64 points"));
}

#[test]
fn info_of_raw_files() {
    let folder = folder();
    let path = text(&ball(folder.path()));
    let info = json(&["info", &path, "--json"]);
    assert_eq!(info["dimensions"], serde_json::json!([20, 20, 20]));
    assert_eq!(info["fields"][0]["name"], "scalars");
    let given = json(&[
        "info",
        &path,
        "--dims",
        "20x20x10",
        "--type",
        "u16",
        "--endian",
        "big",
        "--spacing",
        "1,1,2",
        "--origin",
        "-5,0,0",
        "--json",
    ]);
    assert_eq!(
        given["bounds"],
        serde_json::json!([-5.0, 14.0, 0.0, 19.0, 0.0, 18.0])
    );
    assert_eq!(given["fields"][0]["type"], "u16");
}

/// The coordinates of medical files mean something, which converting them keeps.
#[test]
fn anatomical_frames_are_shown_and_kept() {
    let folder = folder();
    let voxels = Path::new(env!("CARGO_MANIFEST_DIR")).join("../vacua-io/tests/data/voxels");
    let brain = text(&voxels.join("nib_qform.nii.gz"));
    let before = json(&["info", &brain, "--json"]);
    assert_eq!(before["frame"], "RAS");
    assert!(stdout(&succeed(&["info", &brain])).contains("(RAS)"));
    let [nrrd, mha] = ["a.nrrd", "a.mha"].map(|name| text(&folder.path().join(name)));
    succeed(&["convert", &brain, &nrrd, "--component", "0"]);
    let info = json(&["info", &nrrd, "--json"]);
    assert_eq!(
        (&info["frame"], &info["bounds"]),
        (&before["frame"], &before["bounds"])
    );
    succeed(&["convert", &nrrd, &mha]);
    let info = json(&["info", &mha, "--json"]);
    assert_eq!(info["frame"], "LPS");
    let end = |info: &Value, i: usize| info["bounds"][i].as_f64().expect("a number");
    for (i, turned) in [(0, 1), (1, 0), (2, 3), (3, 2)] {
        assert!((end(&info, i) + end(&before, turned)).abs() < 1e-6);
    }
}

/// Integers that `f64` does not hold.
#[test]
fn info_of_large_integers() {
    let folder = folder();
    let unsigned = [u64::MAX, u64::MAX - 1, (1 << 53) + 1].map(u64::to_le_bytes);
    let signed = [i64::MIN + 1, i64::MAX - 1, 0].map(i64::to_le_bytes);
    for (name, values, range) in [
        (
            "u_2x2x3_uint64.raw",
            unsigned,
            "9007199254740993 to 18446744073709551615",
        ),
        (
            "i_2x2x3_int64.raw",
            signed,
            "-9223372036854775807 to 9223372036854775806",
        ),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, values.concat().repeat(4)).expect("writable");
        let shown = stdout(&succeed(&["info", &text(&path)]));
        assert!(shown.contains(range), "{shown}");
    }
}

#[test]
fn wrong_usage_is_2() {
    for arguments in [
        &["info"][..],
        &["nonsense"],
        &["render", "a.vti"],
        &["render", "a.vti", "-o", "a.png", "--size", "0x0"],
        &["render", "a.vti", "-o", "a.jpg"],
        &["render", "a.vti", "-o", "a.png", "--range", "2,1"],
        &["render", "a.vti", "-o", "a.png", "--camera", "eye=1"],
        &["render", "a.vti", "-o", "a.png", "--colormap", "virdis"],
        &["render", "a.vti", "-o", "a.png", "--log", "--range", "0,1"],
        &["render", "a.vti", "-o", "a.png", "--heatmap-halves"],
        &["info", "a.raw", "--dims", "3x4"],
        &["synth", "sphere", "-o", "a.raw"],
        &["synth", "linear", "--size", "3x4", "-o", "a.raw"],
    ] {
        let output = vacua(arguments);
        assert_eq!(
            output.status.code(),
            Some(2),
            "{arguments:?}: {}",
            stderr(&output)
        );
        assert!(output.stdout.is_empty(), "{arguments:?}");
        assert!(!output.stderr.is_empty(), "{arguments:?}");
    }
}

#[test]
fn failures_are_1_and_say_what_once() {
    let output = vacua(&["info", "no/such/file.vti"]);
    assert_eq!(output.status.code(), Some(1));
    let message = stderr(&output);
    assert!(
        message.starts_with("error: no/such/file.vti: "),
        "{message}"
    );
    assert_eq!(message.matches("No such file").count(), 1, "{message}");

    let folder = folder();
    let path = folder.path().join("plain.raw");
    std::fs::write(&path, [0; 100]).expect("writable");
    let output = vacua(&["info", &text(&path)]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("--dims"), "{}", stderr(&output));

    let empty = text(&folder.path().join("empty.dat"));
    std::fs::write(&empty, []).expect("writable");
    let message = stderr(&vacua(&["info", &empty]));
    assert!(
        message.contains("raw, .vacua") && message.contains("empty"),
        "{message}"
    );

    let output = vacua(&["info", "no/such/*.vti"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(
        stderr(&output).contains("no file matches"),
        "{}",
        stderr(&output)
    );

    let file = data("hydrogen.vti");
    let target = text(&folder.path().join("a.png"));
    let output = vacua(&["render", &file, "-o", &target, "--field", "nothing"]);
    assert_eq!(output.status.code(), Some(1));
    let message = stderr(&output);
    assert!(
        message.contains("no field `nothing`; there are:"),
        "{message}"
    );
    assert!(!Path::new(&target).exists());
}

#[test]
fn a_series_has_steps() {
    let folder = folder();
    let path = ball(folder.path());
    for (i, name) in ["s_9_20x20x20_uint8.raw", "s_10_20x20x20_uint8.raw"]
        .iter()
        .enumerate()
    {
        let mut bytes = std::fs::read(&path).expect("readable");
        bytes[0] = 250 + i as u8;
        std::fs::write(folder.path().join(name), bytes).expect("writable");
    }
    let pattern = text(&folder.path().join("s_*.raw"));
    let info = json(&["info", &pattern, "--time", "1", "--json"]);
    assert_eq!(info["time_steps"], 2);
    assert!(
        info["file"].as_str().expect("text").contains("s_10_"),
        "{info}"
    );

    let series = folder.path().join("s.raw.series");
    let list = r#"{"file-series-version": "1.0", "files": [
        {"name": "s_9_20x20x20_uint8.raw", "time": 0.5},
        {"name": "s_10_20x20x20_uint8.raw", "time": 1.5}]}"#;
    std::fs::write(&series, list).expect("writable");
    let info = json(&["info", &text(&series), "--time", "1.5", "--json"]);
    assert_eq!(info["time_step"], 1);
    let collection = folder.path().join("s.pvd");
    let list = r#"<VTKFile type="Collection"><Collection>
        <DataSet timestep="1.5" file="s_10_20x20x20_uint8.raw"/>
        <DataSet timestep="0.5" file="s_9_20x20x20_uint8.raw"/></Collection></VTKFile>"#;
    std::fs::write(&collection, list).expect("writable");
    for time in ["1.5", "1"] {
        let info = json(&["info", &text(&collection), "--time", time, "--json"]);
        assert_eq!(
            (&info["time_step"], &info["time_steps"]),
            (&1.into(), &2.into())
        );
        // The first voxel says which file it is of.
        assert_eq!(info["fields"][0]["range"][1], 251);
    }
    let output = vacua(&["info", &text(&series), "--time", "7"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(
        stderr(&output).contains("times 0.5 to 1.5"),
        "{}",
        stderr(&output)
    );
}

#[test]
fn a_picture_and_how_it_came_to_be() {
    let folder = folder();
    let file = text(&ball(folder.path()));
    let picture = folder.path().join("ball.png");
    let heat = folder.path().join("heat.png");
    let report = json(&[
        "render",
        &file,
        "-o",
        &text(&picture),
        "--size",
        "60x40",
        "--repeat",
        "2",
        "--threads",
        "1",
        "--heatmap",
        &text(&heat),
        "--heatmap-halves",
        "--json",
    ]);
    for key in [
        "frame_secs",
        "load_secs",
        "build_secs",
        "samples",
        "skip",
        "device",
        "threads",
        "peak_bytes",
    ] {
        assert!(report.get(key).is_some(), "{key}");
    }
    assert!(report["frame_secs"]["min"].as_f64() <= report["frame_secs"]["median"].as_f64());
    assert!(report["samples"].as_u64() > Some(0));
    assert_eq!(report["threads"], 1);
    assert_eq!(report["empty"], Value::Null);
    let (width, height, pixels) = decode(&picture);
    assert_eq!((width, height), (60, 40));
    assert_eq!(&pixels[..3], [0, 0, 0]);
    let middle = 3 * (20 * 60 + 30);
    assert!(pixels[middle..middle + 3].iter().any(|&c| c > 100));
    assert_eq!(decode(&heat).0, 60);
}

#[test]
fn devices_are_chosen_and_named() {
    let folder = folder();
    let file = text(&ball(folder.path()));
    let picture = folder.path().join("a.png");
    let target = text(&picture);
    let on = |device| {
        let mut arguments = vec!["render", &file, "-o", &target, "--size", "60x40", "--json"];
        arguments.extend(["--device", device]);
        vacua(&arguments)
    };
    let report = |output: &Output| -> Value {
        serde_json::from_slice(&output.stdout).expect("one JSON object")
    };
    let cpu = on("cpu");
    assert!(cpu.status.success(), "{}", stderr(&cpu));
    assert_eq!(report(&cpu)["device"], "cpu");
    let pixels = decode(&picture).2;
    assert_eq!(on("gpu:999").status.code(), Some(1));
    assert_eq!(on("gpu:x").status.code(), Some(2));
    let gpu = on("gpu");
    if !gpu.status.success() {
        let is_required = std::env::var_os("VACUA_GPU_REQUIRED").is_some();
        assert!(!is_required, "{}", stderr(&gpu));
        assert_eq!(gpu.status.code(), Some(1));
        eprintln!("SKIPPED: no Vulkan device to test on: {}", stderr(&gpu));
        return;
    }
    let report = report(&gpu);
    let name = report["device"].as_str().expect("a name");
    assert!(name.starts_with("gpu:"), "{name}");
    assert!(
        report["device_secs"]["march"].as_f64() > Some(0.0),
        "{report}"
    );
    let found = decode(&picture).2;
    assert!(found.iter().zip(&pixels).all(|(a, b)| a.abs_diff(*b) <= 1));
}

#[test]
fn skipping_and_threads_are_invisible() {
    let folder = folder();
    let file = text(&ball(folder.path()));
    let mut pictures = Vec::new();
    for (skip, threads) in [("none", "1"), ("grid", "2"), ("auto", "1")] {
        let path = folder.path().join(format!("{skip}.exr"));
        succeed(&[
            "render",
            &file,
            "-o",
            &text(&path),
            "--size",
            "64x64",
            "--skip",
            skip,
            "--threads",
            threads,
            "--opacity",
            "150:0,250:0.5",
            "--shading",
            "gradient",
        ]);
        pictures.push(std::fs::read(path).expect("was written"));
    }
    assert!(pictures.iter().all(|p| *p == pictures[0]));
}

#[test]
fn an_empty_picture_says_why() {
    let folder = folder();
    let file = text(&ball(folder.path()));
    let target = text(&folder.path().join("a.png"));
    let cases: [(&[&str], &str); 6] = [
        (
            &["--opacity", "1000:0,2000:1"],
            "opacity is 0 for every value",
        ),
        (
            &["--camera", "eye=100,100,100;at=200,200,200"],
            "does not see the data",
        ),
        (&["--roi", "50,60,50,60,50,60"], "region of interest"),
        (&["--clip", "0,0,100;0,0,1"], "clip plane 0"),
        (
            &["--integrator", "mip", "--range", "255,300"],
            "maximum intensity",
        ),
        (&["--opacity", "0:1e-9,255:1e-9"], "add up to"),
    ];
    for (flags, expected) in cases {
        let mut arguments = vec!["render", &file, "-o", &target, "--size", "32x32"];
        arguments.extend(flags);
        let message = stderr(&succeed(&arguments));
        assert!(
            message.contains("the picture is empty"),
            "{flags:?}: {message}"
        );
        assert!(message.contains(expected), "{flags:?}: {message}");
    }
    let nothing = folder.path().join("nan_2x2x2_float32.raw");
    let bytes: Vec<u8> = [f32::NAN; 8].iter().flat_map(|v| v.to_le_bytes()).collect();
    std::fs::write(&nothing, bytes).expect("writable");
    let output = succeed(&["render", &text(&nothing), "-o", &target, "--size", "8x8"]);
    assert!(stderr(&output).contains("finite"), "{}", stderr(&output));
}

#[test]
fn converted_and_read_again() {
    let folder = folder();
    let made = text(&folder.path().join("made.nrrd"));
    let converted = text(&folder.path().join("converted.vti"));
    succeed(&["convert", &data("hydrogen.vti"), &made]);
    succeed(&["convert", &made, &converted, "--compress"]);
    let original = json(&["info", &data("hydrogen.vti"), "--json"]);
    for file in [&made, &converted] {
        let info = json(&["info", file, "--json"]);
        assert_eq!(info["dimensions"], original["dimensions"]);
        assert_eq!(info["bounds"], original["bounds"]);
        assert_eq!(info["fields"][0]["range"], original["fields"][0]["range"]);
    }
}

#[test]
fn made_and_read_again() {
    let folder = folder();
    let made = text(&folder.path().join("made.nrrd"));
    succeed(&["synth", "linear", "--size", "6x5x4", "-o", &made]);
    let info = json(&["info", &made, "--json"]);
    assert_eq!(info["dimensions"], serde_json::json!([6, 5, 4]));
    assert_eq!(info["fields"][0]["type"], "f32");
}

#[test]
fn transfer_functions_from_files() {
    let folder = folder();
    let file = text(&ball(folder.path()));
    let map = folder.path().join("map.json");
    let target = folder.path().join("a.png");
    std::fs::write(
        &map,
        r#"[{"ColorSpace": "RGB", "RGBPoints": [0,1,0,0, 255,1,0,0], "Points": [0,0,0.5,0, 255,1,0.5,0]}]"#,
    )
    .expect("writable");
    let arguments = [
        "render",
        &file,
        "-o",
        &text(&target),
        "--size",
        "9x9",
        "--tf",
        &text(&map),
    ];
    succeed(&arguments);
    let (_, _, pixels) = decode(&target);
    let middle = &pixels[3 * 40..3 * 41];
    assert!(
        middle[0] > 200 && middle[1] == 0 && middle[2] == 0,
        "{middle:?}"
    );
    std::fs::write(&map, "[{\"RGBPoints\": [0]}]").expect("writable");
    let output = vacua(&arguments);
    assert_eq!(output.status.code(), Some(1));
    assert!(
        stderr(&output).contains("map.json: colour map 0: `RGBPoints`"),
        "{}",
        stderr(&output)
    );
}

#[test]
fn sample_gives_values_at_points() {
    let folder = tempfile::tempdir().expect("a folder");
    let points = folder.path().join("points.csv");
    std::fs::write(&points, "x,y,z\n1,2,3\n1.5,2,3\n-5,0,0\n").expect("written");
    let file = folder.path().join("ramp_4x4x5_uint8.raw");
    let voxels: Vec<u8> = (0..80u8).map(|i| 10 * (i % 4)).collect();
    std::fs::write(&file, voxels).expect("written");
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_vacua"))
        .arg("sample")
        .arg(&file)
        .arg("--points")
        .arg(&points)
        .output()
        .expect("it runs");
    assert!(output.status.success(), "{output:?}");
    let text = String::from_utf8(output.stdout).expect("text");
    assert_eq!(
        text,
        "x,y,z,inside,value\n1,2,3,1,10\n1.5,2,3,1,15\n-5,0,0,0,\n"
    );
}
