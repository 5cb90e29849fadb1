//! Prints the tables, each figure with the paper's or the peer's in brackets behind it.

use super::{Order, SampleResults, SceneResult, SharePeer, ShareResult};
use crate::cell::{Cell, Footnotes, count, digits, head, line, seconds};
use crate::paper_b;

/// All tables.
pub(super) fn all(results: &SampleResults) -> String {
    let options = &results.options;
    let mut text = String::from("# Sampling meshes: targets, and Tables 4 and 6 of paper B\n\n");
    text += &results.machine.markdown();
    text += &format!(
        "\nMeshes: {}; rays and pictures of {}² pixels, samples half a cell apart; {} random places; medians of {}, all taking turns.\n",
        options.size.text(),
        options.pixels,
        count(options.places as u64),
        options.repeats,
    );
    for scene in &results.scenes {
        text += &rates(scene);
        text += &frames(scene);
    }
    let of = results.scenes.first().map_or_else(String::new, name);
    text += &table_4(&results.shares, &of);
    let what = "seconds of a core for a picture";
    text += &table_6(&results.shares, &of, what, |peer| &peer.core_secs);
    text
}

fn name(scene: &SceneResult) -> String {
    format!("{} ({})", scene.model.0.name(), scene.size)
}

fn rates(scene: &SceneResult) -> String {
    let mut notes = Footnotes::default();
    let kind = scene.model.0;
    let mut text = format!(
        "\n## {}: Msamples/s, of a core in brackets\n\n",
        name(scene)
    );
    let mut names = vec!["", "bytes a cell", "built in"];
    names.extend(Order::ALL.map(Order::name));
    names.extend(["picture (of a core)", "off by"]);
    text += &head(&names, 1);
    for peer in &scene.peers {
        let mut row = vec![
            peer.name.clone(),
            notes.cell(&peer.bytes_per_cell, None, digits),
            notes.cell(&peer.build_secs, None, seconds),
        ];
        for rate in &peer.rates {
            let millions = |n: f64| digits(n * 1e-6);
            let alone = rate.samples_per_core_sec.value();
            row.push(notes.cell(&rate.samples_per_sec, alone, millions));
        }
        let core_secs = peer.picture_core_secs.value();
        row.push(notes.cell(&peer.picture_secs, core_secs, seconds));
        row.push(notes.cell(&peer.picture_difference, None, |d| format!("{d:.1e}")));
        text += &line(row);
    }
    if let Some([rays, random]) = paper_b::sampling_target(kind) {
        let (rays, random) = (digits(rays * 1e-6), digits(random * 1e-6));
        text += &line(["target", "", "", &rays, &random, "", "", ""]);
    }
    if let Some((rates, bytes)) = paper_b::open_vkl(kind) {
        let [rays, random, morton] = rates.map(|n| digits(n * 1e-6));
        let bytes = digits(bytes);
        let cells = ["Open VKL 2.0, full size, measured before", &bytes, ""];
        text += &line(
            cells
                .into_iter()
                .chain([&*rays, &*random, &*morton, "", ""]),
        );
    }
    text += &notes.text();
    text += &format!(
        "\n{} samples a picture; ray order is measured on every seventh tile of it.\n",
        count(scene.samples)
    );
    if let Cell::Empty { empty } = &scene.cells {
        text += &format!("\nNot measured: {empty}.\n");
    }
    text
}

fn frames(scene: &SceneResult) -> String {
    let mut notes = Footnotes::default();
    let mut text = format!(
        "\n## {}: frames of the renderer, packed variant 2\n\n",
        name(scene)
    );
    text += &head(&["skip", "samples", "frame", "of a core"], 1);
    for frame in &scene.frames {
        text += &line([
            frame.skip.clone(),
            notes.cell(&frame.samples, None, count),
            notes.cell(&frame.secs, None, seconds),
            notes.cell(&frame.core_secs, None, seconds),
        ]);
    }
    text + &notes.text()
}

fn bytes(n: u64) -> String {
    format!("{} MB", digits(n as f64 / paper_b::MB))
}

pub(crate) fn table_4(shares: &[ShareResult], of: &str) -> String {
    let mut notes = Footnotes::default();
    let mut text = format!("\n## Table 4: bytes of parts, {of} (the big Mars Lander)\n\n");
    let names = [
        "part",
        "cells",
        "packed",
        "user geometry",
        "times",
        "shared faces",
        "times",
    ];
    text += &head(&names, 1);
    let mut is_empty = true;
    for result in shares {
        let share = result.share;
        let paper = paper_b::TABLE_4.iter().find(|row| row.0 == share.part);
        let paper = paper.filter(|_| share.of == paper_b::TABLE_4_SHARES);
        let [packed, user, faces, ..] = &result.peers[..] else {
            continue;
        };
        if paper.is_none() && share.of == paper_b::TABLE_6_SHARES {
            continue;
        }
        is_empty = false;
        let ratio = |peer: fn(&(usize, f64, f64, Option<f64>)) -> Option<f64>| {
            paper.and_then(|row| Some(peer(row)? / row.1))
        };
        text += &line([
            format!("{}/{}", share.part, share.of),
            notes.cell(&result.cells, None, count),
            notes.cell(&packed.bytes, paper.map(|p| p.1 as u64), bytes),
            notes.cell(&user.bytes, paper.map(|p| p.2 as u64), bytes),
            notes.cell(&user.ratio, ratio(|p| Some(p.2)), digits),
            notes.cell(
                &faces.bytes,
                paper.and_then(|p| p.3).map(|n| n as u64),
                bytes,
            ),
            notes.cell(&faces.ratio, ratio(|p| p.3), digits),
        ]);
    }
    if is_empty {
        return String::new();
    }
    text + &notes.text()
}

/// Table 6, of times that `what` says and `secs` gives.
pub(crate) fn table_6(
    shares: &[ShareResult],
    of: &str,
    what: &str,
    secs: impl Fn(&SharePeer) -> &Cell<f64>,
) -> String {
    let mut notes = Footnotes::default();
    let mut text = format!("\n## Table 6: {what}, and bytes, {of} (Jets, seconds)\n\n");
    let mut names = vec!["part".to_owned(), "cells".to_owned()];
    for (peer, ..) in paper_b::TABLE_6 {
        names.push(peer.to_owned());
        names.push("bytes a cell".to_owned());
    }
    text += &head(&names, 1);
    let mut is_empty = true;
    for result in shares
        .iter()
        .filter(|r| r.share.of == paper_b::TABLE_6_SHARES)
    {
        is_empty = false;
        let part = result.share.part.clamp(1, paper_b::TABLE_6_SHARES);
        let cells = result.cells.value().unwrap_or(1) as f64;
        let mut row = vec![
            format!("{part}/{}", result.share.of),
            notes.cell(&result.cells, None, count),
        ];
        for (peer, (_, paper_secs, paper_mb)) in result.peers.iter().zip(paper_b::TABLE_6) {
            let paper_cells = paper_b::TABLE_6_CELLS * part as f64 / result.share.of as f64;
            let paper_bytes = paper_mb[part - 1] * paper_b::MB / paper_cells;
            row.push(notes.cell(secs(peer), Some(paper_secs[part - 1]), seconds));
            let per_cell = peer.bytes.map(|n| n as f64 / cells);
            row.push(notes.cell(&per_cell, Some(paper_bytes), digits));
        }
        text += &line(row);
    }
    if is_empty {
        return String::new();
    }
    text + &notes.text()
}
