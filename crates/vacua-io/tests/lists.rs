//! Files that list others: collections of time steps (`.pvd`) and multi-block sets (`.vtm`).
//!
//! `data/lists/make.py` says what is in them.

use std::path::{Path, PathBuf};

use vacua_io::{Dataset, IoError, ReadOptions, open, open_with};

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data/lists")
        .join(name)
}

fn step(step: usize) -> Result<Dataset, IoError> {
    let options = ReadOptions {
        step: Some(step),
        ..ReadOptions::default()
    };
    open_with(data("series.pvd"), &options)
}

/// Values on the points, and the x of the first point.
fn values(dataset: &Dataset) -> (Vec<f64>, f64) {
    let field = dataset.fields().first().expect("a field");
    assert_eq!(field.name(), "u");
    let all = field.load().expect("whole");
    let mesh = dataset.mesh().expect("a mesh");
    assert_eq!(mesh.num_points(), all.tuples());
    let values = (0..all.tuples()).map(|i| all.get_f64(i, 0)).collect();
    (values, mesh.positions().get_f64(0, 0))
}

fn range(from: usize, len: usize) -> Vec<f64> {
    (from..from + len).map(|v| v as f64).collect()
}

#[test]
fn time_steps_of_a_collection_are_in_the_order_of_their_times() {
    let first = open(data("series.pvd")).expect("readable");
    assert_eq!(first.times(), [0.5, 2.5, 3.0, 4.0, 5.0, 6.0, 7.0]);
    assert_eq!(first.step(), 0);
    assert_eq!(values(&first), (range(10, 8), 10.0));
    let second = step(1).expect("readable");
    assert_eq!((second.step(), second.times().len()), (1, 7));
    assert_eq!(values(&second), (range(0, 4), 0.0));
    assert_eq!(step(5).expect("a grid").geometry().kind(), "uniform");
    let message = step(7).expect_err("not there").to_string();
    assert!(message.contains("7 steps"), "{message}");
}

#[test]
fn meshes_of_a_step_or_of_blocks_are_joined() {
    let joined = [range(0, 4), range(10, 8)].concat();
    for dataset in [
        step(2).expect("two parts"),
        step(3).expect("a multi-block set"),
        open(data("two.vtm")).expect("blocks"),
    ] {
        assert_eq!(values(&dataset), (joined.clone(), 0.0));
        assert_eq!(dataset.mesh().expect("a mesh").num_cells(), 3);
    }
    let blocks = open(data("two.vtm")).expect("blocks");
    let note = blocks.notes().first().expect("what was joined");
    assert!(
        note.contains("air (two/two_0.vtu), wall/solid (two/two_2.vtu)"),
        "{note}"
    );
}

#[test]
fn what_cannot_be_joined_is_listed() {
    for (error, parts) in [
        (
            step(4),
            ["lid (two/two_0.vtu)", "part 1 (unlike/unlike_1.vti)"],
        ),
        (
            open(data("unlike.vtm")),
            [
                "box (unlike/unlike_1.vti)",
                "wall/solid (unlike/unlike_2.vtu)",
            ],
        ),
    ] {
        let message = error.expect_err("unlike parts").to_string();
        for part in parts {
            assert!(message.contains(part), "{message}");
        }
    }
    let nested = step(6)
        .expect_err("a collection in a collection")
        .to_string();
    assert!(nested.contains("a list of files in another"), "{nested}");

    let folder = tempfile::tempdir().expect("temporary folder");
    for (text, word) in [
        ("<Collection/>", "0 steps"),
        (
            r#"<Collection><DataSet timestep="x" file="a.vtu"/></Collection>"#,
            "timestep",
        ),
        (
            r#"<Collection><DataSet timestep="inf" file="a.vtu"/></Collection>"#,
            "finite",
        ),
        (
            r#"<Collection><DataSet timestep="1"/></Collection>"#,
            "`file`",
        ),
        (
            r#"<Collection><DataSet timestep="1" file="a.vtu"/></Collection>"#,
            "a.vtu",
        ),
    ] {
        let path = folder.path().join("a.pvd");
        std::fs::write(
            &path,
            format!(r#"<VTKFile type="Collection">{text}</VTKFile>"#),
        )
        .expect("writable");
        let message = open(&path).expect_err("wrong").to_string();
        assert!(message.contains(word), "{message}");
    }
    let twice = folder.path().join("twice.pvd");
    let mesh = data("two/two_0.vtu");
    let part = format!(r#"<DataSet timestep="1" file="{}"/>"#, mesh.display());
    let text =
        format!(r#"<VTKFile type="Collection"><Collection>{part}{part}</Collection></VTKFile>"#);
    std::fs::write(&twice, text).expect("writable");
    let message = open(&twice).expect_err("listed twice").to_string();
    assert!(message.contains("again"), "{message}");

    let empty = folder.path().join("a.vtm");
    let text = r#"<VTKFile type="vtkMultiBlockDataSet"><vtkMultiBlockDataSet>
        <DataSet index="0"/></vtkMultiBlockDataSet></VTKFile>"#;
    std::fs::write(&empty, text).expect("writable");
    assert!(open(&empty).is_err());
}
