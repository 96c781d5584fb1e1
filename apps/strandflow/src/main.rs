//! The `strandflow` command.
fn main() {}
