//! Where the command writes: links, pipes, standard output, shaders that are kept; and where it refuses to.

mod common;

use std::path::{Path, PathBuf};
use std::process::Command;

use common::{folder, stderr, succeed, text, vacua, vacua_with_cache};

fn fails(arguments: &[&str], code: i32) -> String {
    let output = vacua(arguments);
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {message}");
    message
}

/// A small mesh and a small grid.
fn inputs(folder: &Path) -> (String, String) {
    let [mesh, grid] = ["mesh.vtu", "grid.vti"].map(|name| text(&folder.join(name)));
    succeed(&["synth", "jets", "--size", "4", "-o", &mesh]);
    succeed(&["synth", "linear", "--size", "6", "-o", &grid]);
    (mesh, grid)
}

const SMALL: [&str; 2] = ["--size", "20x10"];

fn is_png(bytes: &[u8]) -> bool {
    bytes.starts_with(b"\x89PNG\r\n") && bytes.ends_with(b"IEND\xaeB`\x82")
}

#[cfg(unix)]
#[test]
fn results_on_standard_output() {
    let folder = folder();
    let (_, grid) = inputs(folder.path());
    for out in ["-", "/dev/stdout"] {
        let output = succeed(&[&["render", &grid, "-o", out][..], &SMALL].concat());
        assert!(is_png(&output.stdout), "{out}");
        let points = folder.path().join("p.csv");
        std::fs::write(&points, "x,y,z\n0,0,0\n").expect("writable");
        let points = text(&points);
        let sampled = succeed(&["sample", &grid, "--points", &points, "-o", out]);
        assert!(
            sampled.stdout.starts_with(b"x,y,z,inside,value\n0,0,0,"),
            "{out}"
        );
        assert!(fails(&["convert", &grid, out], 2).contains("ending"));
        assert!(fails(&["synth", "linear", "-o", out], 2).contains("ending"));
        fails(&["encode", &grid, "-o", out], 2);
        fails(&["render", &grid, "-o", out, "--json"], 2);
        fails(&["render", &grid, "-o", out, "--progressive"], 2);
    }
    // A file that standard output is sent to is written on, not replaced.
    let log = folder.path().join("log");
    std::fs::write(&log, "first\n").expect("writable");
    let file = std::fs::OpenOptions::new().append(true).open(&log);
    let status = Command::new(env!("CARGO_BIN_EXE_vacua"))
        .args([&["render", &grid, "-o", "-"][..], &SMALL].concat())
        .env("XDG_CACHE_HOME", folder.path())
        .stdout(file.expect("there"))
        .status();
    assert!(status.expect("the command starts").success());
    let found = std::fs::read(&log).expect("there");
    assert!(found.strip_prefix(b"first\n").is_some_and(is_png));
}

#[cfg(unix)]
#[test]
fn links_are_followed_and_devices_stay() {
    let folder = folder();
    let (_, grid) = inputs(folder.path());
    let [link, real] = ["link.png", "real.png"].map(|name| folder.path().join(name));
    std::os::unix::fs::symlink("real.png", &link).expect("writable");
    succeed(&[&["render", &grid, "-o", &text(&link)][..], &SMALL].concat());
    assert!(link.is_symlink());
    assert!(is_png(&std::fs::read(real).expect("written")));

    for pipe in ["pipe", "pipe.exr"] {
        let pipe = text(&folder.path().join(pipe));
        let made = Command::new("mkfifo").arg(&pipe).status();
        assert!(made.expect("there is such a program").success());
        let reader = std::thread::spawn({
            let pipe = pipe.clone();
            move || std::fs::read(pipe)
        });
        succeed(&[&["render", &grid, "-o", &pipe][..], &SMALL].concat());
        let found = reader.join().expect("ends").expect("readable");
        let exr = [0x76, 0x2f, 0x31, 0x01];
        assert!(is_png(&found) || (pipe.ends_with("exr") && found.starts_with(&exr)));
        assert!(!Path::new(&pipe).is_file(), "still a pipe");
    }
}

#[test]
fn what_would_be_lost_is_refused() {
    let folder = folder();
    let (mesh, grid) = inputs(folder.path());
    let before = std::fs::read(&mesh).expect("there");
    let copy = text(&folder.path().join("copy.vtu"));
    std::fs::hard_link(&mesh, &copy).expect("writable");
    for out in [&mesh, &copy] {
        assert!(fails(&["convert", &mesh, out], 2).contains("the file that is read"));
    }
    assert!(fails(&["encode", &mesh, "-o", &mesh], 2).contains(".vacua"));
    let vacua_mesh = text(&folder.path().join("mesh.vacua"));
    std::fs::hard_link(&mesh, &vacua_mesh).expect("writable");
    assert!(fails(&["encode", &mesh, "-o", &vacua_mesh], 2).contains("is read"));
    assert_eq!(std::fs::read(&mesh).expect("there"), before);

    let points = folder.path().join("p.csv");
    std::fs::write(&points, "x,y,z\n0,0,0\n").expect("writable");
    let points = text(&points);
    fails(&["sample", &grid, "--points", &points, "-o", &points], 2);

    let [one, same] = ["one.png", "./one.png"].map(|name| text(&folder.path().join(name)));
    let twice = ["render", &grid, "-o", &one, "--heatmap", &same];
    assert!(fails(&twice, 2).contains("one file"));
    assert!(!PathBuf::from(one).exists());

    let bare = text(&folder.path().join("bare"));
    assert!(fails(&["render", &grid, "-o", &bare], 2).contains("without an ending"));
    let message = fails(&["convert", &grid, &bare], 1);
    assert!(
        message.contains("without an ending") && message.contains(".vti"),
        "{message}"
    );
    let message = fails(&["convert", &mesh, &vacua_mesh], 2);
    assert!(message.contains("vacua encode"), "{message}");

    let nowhere = text(&folder.path().join("none/a.png"));
    let message = fails(&["render", &grid, "-o", &nowhere], 1);
    assert!(!message.contains(".vacua-"), "{message}");
    let nowhere = text(&folder.path().join("none/a.vacua"));
    let message = fails(&["encode", &mesh, "-o", &nowhere], 1);
    assert!(!message.contains("at path"), "{message}");
}

/// A picture on any Vulkan device, with a folder for what is kept; `None` (said aloud) without a device.
fn picture(target: &Path, cache: &Path) -> Option<Vec<u8>> {
    let grid = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/hydrogen.vti");
    let target_text = text(target);
    let arguments = [
        "render",
        grid,
        "-o",
        &target_text,
        "--size",
        "40x30",
        "--device",
        "gpu",
    ];
    let output = vacua_with_cache(&arguments, cache);
    if !output.status.success() {
        let is_required = std::env::var_os("VACUA_GPU_REQUIRED").is_some();
        assert!(!is_required, "{}", stderr(&output));
        eprintln!("SKIPPED: no Vulkan device to test on: {}", stderr(&output));
        return None;
    }
    Some(std::fs::read(target).expect("a picture"))
}

fn kept(cache: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(cache.join("vacua")).expect("a folder");
    entries
        .map(|entry| entry.expect("an entry").path())
        .collect()
}

#[test]
fn shaders_are_kept_and_damage_is_survived() {
    let folder = folder();
    let target = folder.path().join("a.png");
    let cache = folder.path().join("cache");
    let Some(first) = picture(&target, &cache) else {
        return;
    };
    let [file] = &kept(&cache)[..] else {
        panic!("one file of one device: {:?}", kept(&cache));
    };
    assert_eq!(file.extension(), Some("shaders".as_ref()));
    let shaders = std::fs::read(file).expect("kept");
    assert_eq!(
        picture(&target, &cache).as_ref(),
        Some(&first),
        "by shaders that were kept"
    );

    let mut flipped = shaders.clone();
    *flipped.last_mut().expect("bytes") ^= 0x40;
    for damaged in [
        &shaders[..shaders.len() / 2],
        &flipped,
        &[],
        b"no shaders at all",
    ] {
        std::fs::write(file, damaged).expect("writable");
        assert_eq!(
            picture(&target, &cache).as_ref(),
            Some(&first),
            "by damaged ones"
        );
        let mended = std::fs::read(file).expect("kept");
        assert_eq!(mended.len(), shaders.len(), "the file is whole again");
    }
}

#[test]
fn a_place_that_cannot_be_written_is_survived() {
    let folder = folder();
    let cache = folder.path().join("no folder");
    std::fs::write(&cache, "a file").expect("writable");
    picture(&folder.path().join("a.png"), &cache);
}
