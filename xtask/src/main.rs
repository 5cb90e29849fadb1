//! Developer tasks for vacua: `cargo xtask <task>`.

fn main() {}
