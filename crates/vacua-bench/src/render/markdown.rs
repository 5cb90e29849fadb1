//! Prints the figures of the benchmark scene.

use super::{EDIT_REPEATS, EditResult, FrameResult, MacrocellResult, RenderResults};
use crate::cell::{Footnotes, count, digits, head, line, seconds};

/// All tables.
pub(super) fn all(results: &RenderResults) -> String {
    let options = &results.options;
    let mut text = String::from("# The benchmark scene `shells256`\n\n");
    text += &results.machine.markdown();
    text += &format!(
        "\nPictures of {}×{}, step 0.5, volumes at {} of their sizes a side, medians of {} (of edits: {}).\n",
        options.size.0,
        options.size.1,
        options.scale,
        options.repeats,
        EDIT_REPEATS * options.repeats,
    );
    text += &frames(&results.frames);
    text += &macrocells(&results.macrocells);
    text += &edits(&results.edits);
    text
}

fn frames(results: &[FrameResult]) -> String {
    let mut notes = Footnotes::default();
    let mut text = String::from("\n## Frames\n\n");
    let names = [
        "voxels",
        "shading",
        "skip",
        "K",
        "samples",
        "frame",
        "Msamples/s",
    ];
    text += &head(&names, 3);
    for frame in results {
        text += &line([
            frame.voxel.name().to_owned(),
            frame.shading.name().to_owned(),
            frame.method.name().to_owned(),
            frame.side.map_or_else(String::new, |k| k.to_string()),
            notes.cell(&frame.samples, None, count),
            notes.cell(&frame.secs, None, seconds),
            notes.cell(&frame.samples_per_sec, None, |s| digits(s * 1e-6)),
        ]);
    }
    text + &notes.text()
}

fn macrocells(results: &[MacrocellResult]) -> String {
    let mut notes = Footnotes::default();
    let mut text = String::from("\n## Macrocells from 8-bit voxels (target: 5 GB/s)\n\n");
    text += &head(&["points", "K", "time", "GB/s"], 1);
    for built in results {
        let [x, y, z] = built.points;
        text += &line([
            format!("{x} × {y} × {z}"),
            built.side.to_string(),
            notes.cell(&built.secs, None, seconds),
            notes.cell(&built.bytes_per_sec, None, |b| digits(b * 1e-9)),
        ]);
    }
    text + &notes.text()
}

fn edits(results: &[EditResult]) -> String {
    let mut notes = Footnotes::default();
    let mut text = String::from("\n## Transfer-function edit to ready\n\n");
    let names = [
        "volume",
        "skip",
        "K",
        "#macrocells",
        "#active",
        "#triangles",
        "T_tf",
        "T_tris",
        "T_BVH",
        "T_total",
        "target at scale 1",
    ];
    text += &head(&names, 2);
    for edit in results {
        text += &line([
            edit.volume.clone(),
            edit.method.name().to_owned(),
            edit.side.to_string(),
            notes.cell(&edit.macrocells, None, count),
            notes.cell(&edit.active, None, count),
            notes.cell(&edit.triangles, None, count),
            notes.cell(&edit.times.classify_secs, None, seconds),
            notes.cell(&edit.times.shape_secs, None, seconds),
            notes.cell(&edit.times.hierarchy_secs, None, seconds),
            notes.cell(&edit.times.total_secs, None, seconds),
            seconds(edit.target_secs),
        ]);
    }
    text + &notes.text()
}
