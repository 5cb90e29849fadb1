//! Prints Tables 1 to 4.

use super::{BuildResult, FrameResult, Method, Model, SkipResults, StageTimes};
use crate::cell::{Cell, Footnotes, count, digits, head, line, seconds};
use crate::paper::PaperTimes;

/// All tables.
pub(super) fn all(results: &SkipResults) -> String {
    let options = &results.options;
    let mut text = String::from("# Empty-space skipping: Tables 1 to 4 of paper A\n\n");
    text += &results.machine.markdown();
    text += &format!(
        "\nStand-ins for the paper's volumes at {} of its sizes a side, pictures of {}×{} (the \
         paper's: 3840×2160 on an RTX 8000), gradient shading, medians of {}. In brackets: the \
         paper.\n",
        options.scale, options.size.0, options.size.1, options.repeats,
    );
    if let Some(device) = &results.device {
        text += &format!(
            "Rendered on {device}: stages and frames by its own clock (clustering by the host's), \
             T_total as a caller sees it.\n"
        );
    }
    if options.scale < 1.0 {
        text += &format!(
            "Counts compare at scale 1 only: here macrocells of K = 8 cover as much of the object \
             as those of K = {} in the paper.\n",
            digits(8.0 / options.scale)
        );
    }
    for model in &results.models {
        let [x, y, z] = model.points;
        text += &format!("\n- {}: {x} × {y} × {z} voxels", model.model);
    }
    text.push('\n');
    text += &build_table(results);
    text += &stages_table(
        results,
        "Table 2: rebuild of `boxes` (Ganter and Manzke)",
        ["T_tris (clustering)", "#boxes"],
        |b| (&b.boxes, &b.boxes_count),
        |b| b.paper.map(|p| p.boxes),
    );
    text += &stages_table(
        results,
        "Rebuild of `grid`, which the paper does not have",
        ["T_tris (dilated masks)", "#active"],
        |b| (&b.grid, &b.active),
        |_| None,
    );
    for rays in [1, 4] {
        text += &frame_table(results, rays, "frames per second", false);
        text += &frame_table(results, rays, "times as fast as without skipping", true);
    }
    text += &rebuild_table(results);
    text
}

/// Rows in the paper's order: by K, then by model.
fn rows(results: &SkipResults) -> impl Iterator<Item = (Model, &BuildResult)> {
    (0..results.options.sides.len())
        .flat_map(move |i| results.models.iter().map(move |m| (m.model, &m.builds[i])))
}

fn times(notes: &mut Footnotes, ours: &StageTimes, paper: Option<PaperTimes>) -> [String; 4] {
    [
        notes.cell(&ours.classify_secs, paper.map(|p| p.classify_secs), seconds),
        notes.cell(&ours.shape_secs, paper.map(|p| p.shape_secs), seconds),
        notes.cell(
            &ours.hierarchy_secs,
            paper.map(|p| p.hierarchy_secs),
            seconds,
        ),
        notes.cell(&ours.total_secs, paper.map(|p| p.total_secs), seconds),
    ]
}

fn build_table(results: &SkipResults) -> String {
    let mut notes = Footnotes::default();
    let mut text = String::from("\n## Table 1: rebuild of `mesh`, the boundary mesh\n\n");
    let names = [
        "model",
        "K",
        "#macrocells",
        "#active",
        "active share",
        "#triangles",
        "T_tf",
        "T_tris",
        "T_BVH",
        "T_total",
    ];
    text += &head(&names, 1);
    for (model, build) in rows(results) {
        let paper = build.paper;
        let percent = |share: f64| format!("{} %", digits(100.0 * share));
        let share = match build.macrocells.value() {
            Some(all) => build.active.map(|n| n as f64 / all as f64),
            None => build.active.map(|_| 0.0),
        };
        let paper_share = paper.map(|p| p.active as f64 / p.macrocells as f64);
        let mut cells = vec![
            model.to_string(),
            build.side.to_string(),
            notes.cell(&build.macrocells, paper.map(|p| p.macrocells), count),
            notes.cell(&build.active, paper.map(|p| p.active), count),
            notes.cell(&share, paper_share, percent),
            notes.cell(&build.triangles, paper.map(|p| p.triangles), count),
        ];
        cells.extend(times(&mut notes, &build.mesh, paper.map(|p| p.mesh)));
        text += &line(cells);
    }
    text + &notes.text()
}

fn stages_table(
    results: &SkipResults,
    title: &str,
    [shape, number]: [&str; 2],
    ours: impl Fn(&BuildResult) -> (&StageTimes, &Cell<u64>),
    paper: impl Fn(&BuildResult) -> Option<PaperTimes>,
) -> String {
    let mut notes = Footnotes::default();
    let mut text = format!("\n## {title}\n\n");
    text += &head(
        &["model", "K", number, "T_tf", shape, "T_BVH", "T_total"],
        1,
    );
    for (model, build) in rows(results) {
        let (stages, number) = ours(build);
        let mut cells = vec![
            model.to_string(),
            build.side.to_string(),
            notes.cell(number, None, count),
        ];
        cells.extend(times(&mut notes, stages, paper(build)));
        text += &line(cells);
    }
    text + &notes.text()
}

/// Table 3 for one number of rays; relative to no skipping if asked for.
fn frame_table(results: &SkipResults, rays: u32, what: &str, relative: bool) -> String {
    let mut notes = Footnotes::default();
    let plural = if rays == 1 { "ray" } else { "rays" };
    let mut text = format!("\n## Table 3: {what}, {rays} {plural} a pixel\n\n");
    let sides = &results.options.sides;
    let mut names = vec!["model".to_owned(), "none".to_owned()];
    let skipping = Method::SKIPPING.iter();
    names.extend(skipping.flat_map(|m| sides.iter().map(move |k| format!("{} K={k}", m.name()))));
    text += &head(&names, 1);
    for model in &results.models {
        let frames = || {
            let frames = model.frames.iter();
            frames.filter(|f| f.rays_per_pixel == rays && !f.rebuilt)
        };
        let base = frames().find(|f| f.method == Method::None);
        let mut cells = vec![model.model.to_string()];
        for frame in frames() {
            let (ours, paper) = if relative {
                (
                    ratio(base, frame),
                    base.and_then(|b| Some(frame.paper_table3_fps? / b.paper_table3_fps?)),
                )
            } else {
                (fps(frame), frame.paper_table3_fps)
            };
            cells.push(notes.cell(&ours, paper, digits));
        }
        text += &line(cells);
    }
    text + &notes.text()
}

fn fps(frame: &FrameResult) -> Cell<f64> {
    frame.secs.map(|secs| 1.0 / secs)
}

fn ratio(base: Option<&FrameResult>, frame: &FrameResult) -> Cell<f64> {
    match base.map(|b| &b.secs) {
        Some(Cell::Value(base)) => frame.secs.map(|secs| base / secs),
        Some(Cell::Empty { empty }) => Cell::empty(empty.clone()),
        None => Cell::empty("there is nothing to compare with"),
    }
}

fn rebuild_table(results: &SkipResults) -> String {
    let mut notes = Footnotes::default();
    let side = results.rebuild_side;
    let mut text = format!(
        "\n## Table 4: frames per second with and without a rebuild before each frame, K = {side}\n\n"
    );
    let mut names = vec!["model".to_owned(), "none".to_owned()];
    for method in Method::SKIPPING {
        names.push(method.name().to_owned());
        names.push(format!("{}, rebuilt", method.name()));
    }
    text += &head(&names, 1);
    for model in &results.models {
        let cell = |method: Method, rebuilt: bool| {
            let side = (method != Method::None).then_some(side);
            model.frames.iter().find(|f| {
                (f.method, f.side, f.rebuilt, f.rays_per_pixel) == (method, side, rebuilt, 1)
            })
        };
        let mut cells = vec![model.model.to_string()];
        let order = [(Method::None, false)].into_iter();
        let skipping = Method::SKIPPING.into_iter();
        for (method, rebuilt) in order.chain(skipping.flat_map(|m| [(m, false), (m, true)])) {
            let (ours, paper) = match cell(method, rebuilt) {
                Some(frame) => (fps(frame), frame.paper_table4_fps),
                None => (Cell::empty("not measured"), None),
            };
            cells.push(notes.cell(&ours, paper, digits));
        }
        text += &line(cells);
    }
    text + &notes.text()
}
