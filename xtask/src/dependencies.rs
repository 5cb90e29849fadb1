//! The order of the crates: dependencies point down only, and nothing at or below `vacua-render`
//! may pull in a GPU, MPI or Python library.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;

use crate::command::{cargo, command};

/// Crates from bottom to top; those on one level do not know each other, except at the top.
const LEVELS: [&[&str]; 9] = [
    &["vacua-simd"],
    &["vacua-volume"],
    &["vacua-io", "vacua-synth"],
    &["vacua-skip"],
    &["vacua-pack"],
    &["vacua-render"],
    &["vacua-gpu", "vacua-cluster", "vacua-view"],
    &["vacua-bench"],
    &["vacua", "vacua-py"],
];

/// The crate at and below which only plain libraries are allowed.
const PLAIN_UP_TO: &str = "vacua-render";

/// Packages that reach for a GPU, MPI or Python.
const HEAVY: [&str; 7] = [
    "ash", "wgpu", "vulkano", "mpi", "mpi-sys", "pyo3", "pyo3-ffi",
];

fn level(name: &str) -> Option<usize> {
    LEVELS.iter().position(|crates| crates.contains(&name))
}

/// Who depends on whom, by package name; development dependencies too.
type Graph = BTreeMap<String, BTreeSet<String>>;

/// What is wrong with a graph, in words; empty if nothing is.
fn violations(graph: &Graph, members: &BTreeSet<String>) -> Vec<String> {
    let mut wrong = Vec::new();
    for from in members.iter().filter(|name| *name != "xtask") {
        let Some(from_level) = level(from) else {
            wrong.push(format!("`{from}` has no place in the order of the crates"));
            continue;
        };
        for to in graph.get(from).into_iter().flatten() {
            let Some(to_level) = level(to).filter(|_| members.contains(to)) else {
                continue;
            };
            let both_on_top = from_level == LEVELS.len() - 1 && to_level == from_level;
            if to_level >= from_level && !both_on_top {
                wrong.push(format!("`{from}` depends upward on `{to}`"));
            }
        }
        if Some(from_level) <= level(PLAIN_UP_TO) {
            for heavy in reachable(graph, from) {
                if HEAVY.contains(&heavy) {
                    wrong.push(format!("`{from}` pulls in `{heavy}`"));
                }
            }
        }
    }
    wrong
}

fn reachable<'a>(graph: &'a Graph, from: &str) -> BTreeSet<&'a str> {
    let mut seen = BTreeSet::new();
    let mut open: Vec<&str> = vec![from];
    while let Some(name) = open.pop() {
        for to in graph.get(name).into_iter().flatten() {
            if seen.insert(to.as_str()) {
                open.push(to);
            }
        }
    }
    seen
}

/// The graph that `cargo metadata` describes, and the members of the workspace.
fn graph_of(metadata: &Value) -> (Graph, BTreeSet<String>) {
    let list = |value: &Value| value.as_array().cloned().unwrap_or_default();
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let names: BTreeMap<String, String> = list(&metadata["packages"])
        .iter()
        .map(|package| (text(&package["id"]), text(&package["name"])))
        .collect();
    let name = |id: &Value| names.get(&text(id)).cloned().unwrap_or_default();
    let mut graph = Graph::new();
    for node in list(&metadata["resolve"]["nodes"]) {
        let to = list(&node["deps"]);
        graph
            .entry(name(&node["id"]))
            .or_default()
            .extend(to.iter().map(|dependency| name(&dependency["pkg"])));
    }
    let members = list(&metadata["workspace_members"]);
    (graph, members.iter().map(name).collect())
}

#[test]
fn dependencies_point_down_only() {
    let output = command(&cargo(), &["metadata", "--format-version", "1"])
        .output()
        .expect("cargo runs, as it runs this test");
    assert!(output.status.success(), "cargo metadata failed");
    let metadata = serde_json::from_slice(&output.stdout).expect("cargo writes JSON");
    let (graph, members) = graph_of(&metadata);
    assert!(members.contains("vacua-render") && members.contains("vacua"));
    assert!(graph["vacua-render"].contains("vacua-volume"));
    assert_eq!(violations(&graph, &members), Vec::<String>::new());
}

#[test]
fn wrong_graphs_are_noticed() {
    let graph = |edges: &[(&str, &str)]| {
        let mut graph = Graph::new();
        for (from, to) in edges {
            let to = (*to).to_owned();
            graph.entry((*from).to_owned()).or_default().insert(to);
        }
        graph
    };
    let members = [
        "vacua-volume",
        "vacua-io",
        "vacua-synth",
        "vacua-render",
        "vacua",
        "xtask",
    ];
    let members: BTreeSet<String> = members.map(str::to_owned).into();
    let wrong = |edges: &[(&str, &str)]| violations(&graph(edges), &members).len();
    assert_eq!(wrong(&[("vacua-render", "vacua-io"), ("vacua", "ash")]), 0);
    assert_eq!(wrong(&[("vacua-volume", "vacua-render")]), 1);
    assert_eq!(wrong(&[("vacua-io", "vacua-synth")]), 1);
    assert_eq!(wrong(&[("vacua-io", "helper"), ("helper", "ash")]), 1);
    let stranger: BTreeSet<String> = ["vacua-new".to_owned()].into();
    assert_eq!(violations(&graph(&[]), &stranger).len(), 1);
}
