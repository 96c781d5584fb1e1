//! Puts the built pages into the program, where there is one. Needs no Node: what is not built is replaced by a note.

use std::{env, fs, io, path::Path};

const FILES: [(&str, &str); 6] = [
    ("VIEW_INDEX", "index.html"),
    ("VIEW_SCRIPT", "app.js"),
    ("VIEW_STYLE", "app.css"),
    ("ANNOTATE_INDEX", "annotate.html"),
    ("ANNOTATE_SCRIPT", "annotate.js"),
    ("ANNOTATE_STYLE", "annotate.css"),
];

fn main() -> io::Result<()> {
    let own = env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default();
    let out = env::var_os("OUT_DIR").unwrap_or_default();
    let (own, out) = (Path::new(&own), Path::new(&out));
    let web = own.join("../../web");
    let dist = web.join("dist");
    let built = FILES.iter().all(|(_, file)| dist.join(file).is_file());
    // A path that does not exist counts as changed every time.
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=src/missing.html");
    if let Some(watched) = [&dist, &web].into_iter().find(|folder| folder.is_dir()) {
        println!("cargo::rerun-if-changed={}", watched.display());
    }
    let mut code = format!("/// Whether the pages were built.\npub const IS_BUILT: bool = {built};\n");
    for (name, file) in FILES {
        let bytes = match (built, file) {
            (true, _) => fs::read(dist.join(file))?,
            (false, name) if name.ends_with(".html") => fs::read(own.join("src/missing.html"))?,
            (false, _) => Vec::new(),
        };
        fs::write(out.join(file), bytes)?;
        code += &format!("const {name}: &[u8] = include_bytes!(concat!(env!(\"OUT_DIR\"), \"/{file}\"));\n");
    }
    fs::write(out.join("page.rs"), code)
}
