//! Nothing. Where an example is built, cargo takes the features of the workspace as its tests have them, and what they built of
//! other people's crates serves the fuzz targets.

fn main() {}
