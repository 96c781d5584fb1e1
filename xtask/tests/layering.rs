//! Dependencies between the crates of the workspace point down, as drawn in `ARCHITECTURE.md`.

use std::{collections::BTreeSet, fs, path::Path};

/// Each crate and the crates of the workspace it may use outside its tests.
const ALLOWED: &[(&str, &[&str])] = &[
    ("core", &[]),
    ("geometry", &["core"]),
    ("image", &["core"]),
    ("volume", &["core", "geometry"]),
    ("dynamics", &["core"]),
    ("stages", &["core", "geometry", "image", "volume", "dynamics"]),
    ("io", &["core", "geometry"]),
    ("eval", &["core", "geometry", "io"]),
    ("render", &["core", "geometry"]),
    ("report", &["core"]),
    ("view", &["core"]),
    ("synth", &["core", "geometry", "dynamics"]),
    ("engine", &["core", "geometry", "image", "volume", "dynamics", "stages", "io"]),
    ("check", &["core", "geometry", "image", "stages", "io", "engine"]),
];

#[test]
fn dependencies_point_down() {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).join("../crates");
    let mut seen = BTreeSet::new();
    let mut wrong = Vec::new();
    for entry in fs::read_dir(&crates).expect("crates/ is readable") {
        let folder = entry.expect("crates/ is readable").path();
        let name = folder.file_name().expect("a folder has a name").to_string_lossy().into_owned();
        let text = fs::read_to_string(folder.join("Cargo.toml")).expect("every crate has a manifest");
        let manifest: toml::Table = text.parse().expect("manifests are TOML");
        let Some((_, allowed)) = ALLOWED.iter().find(|(crate_name, _)| *crate_name == name) else {
            wrong.push(format!("crate `{name}` is not in the table of this test"));
            continue;
        };
        seen.insert(name.clone());
        let dependencies = manifest.get("dependencies").and_then(|d| d.as_table()).cloned().unwrap_or_default();
        for dependency in dependencies.keys().filter_map(|key| key.strip_prefix("strandflow-")) {
            if !allowed.contains(&dependency) {
                wrong.push(format!("`{name}` may not depend on `{dependency}`"));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    assert_eq!(seen.len(), ALLOWED.len(), "a crate of the table is gone");
}

#[test]
fn only_the_application_prints_or_parses_arguments() {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).join("../crates");
    for (name, _) in ALLOWED {
        let text = fs::read_to_string(crates.join(name).join("Cargo.toml")).expect("every crate has a manifest");
        let manifest: toml::Table = text.parse().expect("manifests are TOML");
        let dependencies = manifest.get("dependencies").and_then(|d| d.as_table()).cloned().unwrap_or_default();
        for application_only in ["clap", "miette", "anyhow", "indicatif"] {
            assert!(!dependencies.contains_key(application_only), "`{name}` may not use `{application_only}`");
        }
    }
}
