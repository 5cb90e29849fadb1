//! Prints the tables, each figure with the paper's in brackets behind it.

use super::{EncodeResults, ModelResult, VariantResult};
use crate::cell::{Cell, Footnotes, count, digits, head, line, seconds};
use crate::paper_b;

/// All tables.
pub(super) fn all(results: &EncodeResults) -> String {
    let options = &results.options;
    let mut text = String::from("# Tables 1, 2, 3 and 5 of paper B\n\n");
    text += &results.machine.markdown();
    text += &format!(
        "\nMeshes: {}; medians of {}. Bytes a cell; the paper's in brackets, of the model named.\n",
        options.size.text(),
        options.repeats,
    );
    text += &table_3(&results.models);
    text += &parts(&results.models);
    text += &table_1(&results.models);
    text += &table_2(results);
    text += &table_5(&results.models);
    text
}

fn name(model: &ModelResult) -> String {
    format!("{} ({})", model.model.0.name(), model.size)
}

fn cells_text(model: &ModelResult) -> String {
    let names = ["tets", "pyramids", "wedges", "hexes"];
    let there = names.iter().zip(model.cells).filter(|(_, n)| *n > 0);
    let texts: Vec<String> = there
        .map(|(name, n)| format!("{} {name}", count(n)))
        .collect();
    texts.join(", ")
}

fn table_3(models: &[ModelResult]) -> String {
    let mut notes = Footnotes::default();
    let mut text = String::from("\n## Table 3: the encoding\n\n");
    let names = [
        "mesh",
        "cells",
        "paper's model",
        "variant",
        "vertices",
        "sub-meshes",
        "nodes",
        "bytes a cell",
        "target",
        "encoding",
        "M cells/s (of a core)",
    ];
    text += &head(&names, 3);
    for model in models {
        for v in &model.variants {
            text += &line([
                name(model),
                cells_text(model),
                model.paper_model.clone(),
                v.variant.clone(),
                notes.cell(&v.vertices, None, count),
                notes.cell(&v.submeshes, None, count),
                notes.cell(&v.nodes, None, count),
                notes.cell(&v.bytes_per_cell, v.paper_bytes_per_cell, digits),
                v.target_bytes_per_cell.map_or_else(String::new, digits),
                notes.cell(&v.secs, None, seconds),
                notes.cell(&v.cells_per_sec, v.cells_per_core_sec.value(), |n| {
                    digits(n * 1e-6)
                }),
            ]);
        }
    }
    text + &notes.text()
}

fn parts(models: &[ModelResult]) -> String {
    let mut text = String::from("\n## Table 3: bytes a cell by part\n\n");
    let names = [
        "mesh",
        "variant",
        "positions",
        "values",
        "indices",
        "nodes",
        "outer tree",
        "headers",
        "ranges",
        "sum",
        "map, apart",
    ];
    text += &head(&names, 1);
    for model in models {
        let paper = paper_b::model(model.model.0);
        for VariantResult { variant, parts, .. } in &model.variants {
            let Some(parts) = parts else {
                continue;
            };
            let cells = model.cells.iter().sum::<u64>() as f64;
            let each = |bytes: u64| digits(bytes as f64 / cells);
            let with_paper = |bytes: u64, paper_bytes: f64| {
                format!("{} ({})", each(bytes), digits(paper_bytes / paper.cells))
            };
            text += &line([
                name(model),
                variant.clone(),
                // The paper counts positions and values together.
                with_paper(parts.positions, paper.vertex_bytes * 0.75),
                with_paper(parts.values, paper.vertex_bytes * 0.25),
                with_paper(parts.indices, paper.index_bytes),
                each(parts.nodes),
                each(parts.outer),
                each(parts.headers),
                each(parts.ranges),
                each(parts.total()),
                each(parts.map),
            ]);
        }
    }
    text
}

fn table_1(models: &[ModelResult]) -> String {
    let mut notes = Footnotes::default();
    let mut text = String::from(
        "\n## Table 1: OSPRay 1.8.5's layout, bytes a cell by part (the big Mars Lander's)\n\n",
    );
    let mut names = vec!["mesh"];
    names.extend(paper_b::TABLE_1.iter().map(|(name, _)| *name));
    names.push("sum");
    text += &head(&names, 1);
    let paper_sum: f64 = paper_b::TABLE_1.iter().map(|p| p.1).sum();
    for model in models {
        let Some(layout) = model.layouts.first() else {
            continue;
        };
        let cells = model.cells.iter().sum::<u64>() as f64;
        let mut row = vec![name(model)];
        for (part, paper_bytes) in paper_b::TABLE_1 {
            let ours = layout.parts.iter().find(|(name, _)| name == part);
            let ours = match (ours, &layout.bytes) {
                (Some((_, bytes)), _) => Cell::Value(*bytes as f64 / cells),
                (None, Cell::Empty { empty }) => Cell::empty(empty),
                (None, Cell::Value(_)) => Cell::empty("no such part"),
            };
            row.push(notes.cell(&ours, Some(paper_bytes / paper_b::TABLE_1_CELLS), digits));
        }
        row.push(notes.cell(
            &layout.bytes_per_cell,
            Some(paper_sum / paper_b::TABLE_1_CELLS),
            digits,
        ));
        text += &line(row);
    }
    text + &notes.text()
}

fn table_2(results: &EncodeResults) -> String {
    let mut notes = Footnotes::default();
    let of = results.models.first().map_or_else(String::new, name);
    let mut text = format!("\n## Table 2: bits of an index, {of} (the big Mars Lander)\n\n");
    let names = [
        "bits",
        "sub-meshes",
        "cells each",
        "vertices each",
        "vertices",
        "replication",
        "vertices and indices",
        "all",
        "encoding",
    ];
    text += &head(&names, 0);
    for row in &results.index_bits {
        let paper = paper_b::TABLE_2.iter().find(|p| p.bits == row.bits);
        let bytes = paper.map(|p| p.bytes / paper_b::TABLE_2_CELLS);
        text += &line([
            row.bits.to_string(),
            notes.cell(&row.groups, paper.map(|p| p.groups as u64), count),
            notes.cell(&row.cells_per_group.map(|n| n as u64), None, count),
            notes.cell(
                &row.vertices_per_group.map(|n| n as u64),
                paper.map(|p| p.vertices_per_group as u64),
                count,
            ),
            notes.cell(&row.vertices, None, count),
            notes.cell(&row.replication, paper.map(|p| p.replication), digits),
            notes.cell(&row.bytes_per_cell, bytes, digits),
            notes.cell(&row.total_bytes_per_cell, None, digits),
            notes.cell(&row.secs, None, seconds),
        ]);
    }
    text + &notes.text()
}

fn table_5(models: &[ModelResult]) -> String {
    let mut notes = Footnotes::default();
    let mut text = String::from("\n## Table 5: against OSPRay's layouts\n\n");
    let names = [
        "mesh",
        "paper's model",
        "layout",
        "bytes a cell",
        "times variant 2",
    ];
    text += &head(&names, 3);
    for model in models {
        for layout in &model.layouts {
            text += &line([
                name(model),
                model.paper_model.clone(),
                layout.name.clone(),
                notes.cell(&layout.bytes_per_cell, layout.paper_bytes_per_cell, digits),
                notes.cell(&layout.ratio, layout.paper_ratio, digits),
            ]);
        }
    }
    text + &notes.text()
}
