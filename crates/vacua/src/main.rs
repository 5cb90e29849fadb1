//! The `vacua` command.

fn main() {}
