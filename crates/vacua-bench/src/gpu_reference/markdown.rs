//! Prints the tables, each figure with the paper's in brackets behind it.

use super::{DevicePeer, GpuReferenceResults, ReferenceMesh};
use crate::cell::{Cell, Footnotes, count, digits, head, line, seconds};
use crate::paper_b;
use crate::sample::markdown::{table_4, table_6};

/// All tables.
pub(super) fn all(results: &GpuReferenceResults) -> String {
    let mut text = String::from("# Meshes on a GPU: Tables 3, 4 and 6 of paper B\n\n");
    let (width, height) = results.size;
    text += &results.machine.markdown();
    text += &format!(
        "\nOn {}; pictures of {width} × {height} pixels without skipping, samples half a cell apart; \
         {} random places. Bytes are those on the device, acceleration structures as its driver \
         compacts them; in brackets the paper's.\n",
        results.device,
        count(results.places as u64),
    );
    text += &table_3(&results.meshes);
    for mesh in &results.meshes {
        text += &rates(mesh);
    }
    let of = results.meshes.first().map_or_else(String::new, name);
    text += &table_4(&results.shares, &of);
    let what = "seconds of the GPU for a picture";
    text += &table_6(&results.shares, &of, what, |peer| &peer.secs);
    text
}

fn name(mesh: &ReferenceMesh) -> String {
    format!("{} ({})", mesh.model.0.name(), mesh.size)
}

/// Bytes of a part, by name.
fn bytes_of(peer: &DevicePeer, names: &[&str]) -> f64 {
    let parts = peer.parts.iter();
    let named = parts.filter(|(name, _)| names.contains(&&**name));
    named.map(|&(_, n)| n as f64).sum()
}

fn table_3(meshes: &[ReferenceMesh]) -> String {
    let mut text = String::from("\n## Table 3: bytes a cell on the device\n\n");
    let names = [
        "mesh",
        "paper's model",
        "variant",
        "cells",
        "sub-meshes",
        "nodes",
        "positions and values",
        "indices",
        "nodes",
        "structure over them",
        "tables",
        "sum",
        "all",
        "sections of the file",
    ];
    text += &head(&names, 3);
    for mesh in meshes {
        let paper = paper_b::model(mesh.model.0);
        let cells = mesh.cells.value().unwrap_or(1) as f64;
        let packed = mesh.peers.iter().zip(["2", "1"]);
        for (peer, variant) in packed.filter(|(peer, _)| peer.nodes.is_some()) {
            let is_first = variant == "1";
            let cell = |parts: &[&str], paper_bytes: Option<f64>| {
                let ours = digits(bytes_of(peer, parts) / cells);
                match paper_bytes {
                    Some(n) => format!("{ours} ({})", digits(n / paper.cells)),
                    None => ours,
                }
            };
            let optix = is_first.then_some(paper.optix_bytes);
            let all: Vec<&str> = peer.parts.iter().map(|(name, _)| &**name).collect();
            text += &line([
                name(mesh),
                paper.name.to_owned(),
                variant.to_owned(),
                count(mesh.cells.value().unwrap_or(0)),
                count(peer.submeshes.unwrap_or(0)),
                count(peer.nodes.unwrap_or(0)),
                cell(&["positions", "values"], Some(paper.vertex_bytes)),
                cell(&["indices"], Some(paper.index_bytes)),
                cell(&["nodes"], Some(paper.node_bytes[usize::from(!is_first)])),
                cell(&["structures"], optix),
                cell(&["tables"], None),
                cell(&all, paper.variant_bytes(variant)),
                megabytes(bytes_of(peer, &all)),
                megabytes(peer.file_bytes.unwrap_or(0) as f64),
            ]);
        }
    }
    text
}

fn megabytes(bytes: f64) -> String {
    format!("{} MB", digits(bytes / paper_b::MB))
}

fn rates(mesh: &ReferenceMesh) -> String {
    let mut notes = Footnotes::default();
    let mut text = format!("\n## {}: pictures and Gsamples/s\n\n", name(mesh));
    let names = [
        "",
        "bytes a cell",
        "of it structures",
        "times variant 2",
        "sent and built in",
        "picture",
        "along rays",
        "at random",
        "pixels unlike variant 2's",
        "off by",
    ];
    text += &head(&names, 1);
    let cells = mesh.cells.value().unwrap_or(1) as f64;
    let base = mesh.peers.first().and_then(|p| p.bytes.value());
    for peer in &mesh.peers {
        let giga = |n: f64| digits(n * 1e-9);
        let ratio = match base {
            Some(base) => peer.bytes.map(|n| n as f64 / base as f64),
            None => Cell::empty("variant 2 was not measured"),
        };
        let structures = bytes_of(peer, &["structures"]);
        text += &line([
            peer.name.clone(),
            notes.cell(&peer.bytes.map(|n| n as f64 / cells), None, digits),
            notes.cell(&peer.bytes.map(|_| structures / cells), None, digits),
            notes.cell(&ratio, None, digits),
            notes.cell(&peer.send_secs, None, seconds),
            notes.cell(&peer.march_secs, None, seconds),
            notes.cell(&peer.rays_per_sec, None, giga),
            notes.cell(&peer.random_per_sec, None, giga),
            notes.cell(&peer.num_different, None, |n| n.to_string()),
            notes.cell(&peer.difference, None, |d| format!("{d:.1e}")),
        ]);
    }
    text += &notes.text();
    text += &format!("\n{} samples a picture.\n", count(mesh.samples));
    if let Cell::Empty { empty } = &mesh.cells {
        text += &format!("\nNot measured: {empty}.\n");
    }
    text
}
