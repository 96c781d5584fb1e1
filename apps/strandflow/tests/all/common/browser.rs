//! A page as a browser shows it: Chromium without a window.
#![expect(clippy::unwrap_used, reason = "helpers of tests: a failing unwrap is a failing test")]

use std::{
    path::Path,
    process::{Command, Output},
};

use strandflow_io::read_rgb;

use super::text;

/// Widths of a window and of a telephone \[px\].
const WIDTHS: [usize; 2] = [1200, 390];

/// Asserts that a page is shown at both widths and in print without a word in the console, with nothing wider than the window,
/// asking for nothing beside itself, and not blank. Says `skipped` where there is no Chromium.
pub fn assert_shown_well(page: &Path) {
    if Command::new("chromium").arg("--version").output().is_err() {
        assert!(std::env::var_os("CI").is_none(), "no chromium, and the checks are to be whole");
        eprintln!("skipped: no chromium");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    faults_are_found(folder.path());
    for width in WIDTHS {
        let framed = folder.path().join(format!("{width}.html"));
        std::fs::write(&framed, in_frame(&std::fs::read_to_string(page).unwrap(), width)).unwrap();
        let faults = faults(&quiet(folder.path(), &["--dump-dom"], &framed));
        assert_eq!(faults, "", "of {} at {width} px", page.display());
        let picture = folder.path().join(format!("{width}.png"));
        let size = format!("--window-size={},1600", width.max(600));
        quiet(folder.path(), &[&format!("--screenshot={}", text(&picture)), &size], &framed);
        assert_not_blank(&picture);
        keep(&picture, page);
    }
    let print = folder.path().join("print.pdf");
    quiet(folder.path(), &[&format!("--print-to-pdf={}", text(&print)), "--no-pdf-header-footer"], page);
    let bytes = std::fs::read(&print).unwrap();
    assert!(bytes.starts_with(b"%PDF") && bytes.len() > 20_000, "{} bytes", bytes.len());
    keep(&print, page);
}

/// The check itself is checked by a page with every fault.
fn faults_are_found(folder: &Path) {
    let page = folder.join("faults.html");
    let bad = "<!doctype html><div style='width: 700px'>wide</div><img src='https://nowhere.invalid/a.png'>\
               <script>console.warn('loud')</script>";
    std::fs::write(&page, in_frame(bad, 390)).unwrap();
    let shown = open(folder, &["--dump-dom"], &page);
    let said = (faults(&shown), console(&shown));
    let found =
        ["DIV. wide", "scrolls to", "asks for https://nowhere.invalid/a.png"].map(|fault| said.0.contains(fault));
    assert!(found == [true; 3] && said.1.contains("loud"), "{said:?}: {}", String::from_utf8_lossy(&shown.stderr));
}

/// What the script of [`in_frame`] found.
fn faults(shown: &Output) -> String {
    let dom = String::from_utf8_lossy(&shown.stdout);
    let found = dom.split_once("<pre>").and_then(|(_, rest)| rest.split_once("</pre>"));
    found.unwrap_or_else(|| panic!("no page: {dom}")).0.to_owned()
}

/// The page in a frame of a width, beside a script that lists its faults: it has no scripts of its own.
fn in_frame(page: &str, width: usize) -> String {
    let page = serde_json::to_string(page).unwrap().replace("</", "<\\/");
    format!(
        r#"<!doctype html><meta charset="utf-8"><style>body {{ margin: 0 }} pre {{ margin: 0 }}
iframe {{ border: 0; width: {width}px; height: 1600px }}</style><iframe></iframe><pre></pre><script>
const frame = document.querySelector('iframe');
frame.onload = () => {{
  const all = frame.contentDocument, root = all.documentElement;
  const scrolls = e => e && (['auto', 'scroll', 'hidden'].includes(frame.contentWindow.getComputedStyle(e).overflowX) || scrolls(e.parentElement));
  const wide = [...all.body.querySelectorAll('*')].filter(e => e.getBoundingClientRect().right > {width} + 1 && !scrolls(e.parentElement));
  const words = wide.map(e => e.tagName + '.' + e.className + ' ' + e.textContent.slice(0, 60));
  words.push(...frame.contentWindow.performance.getEntriesByType('resource').map(e => 'asks for ' + e.name));
  if (root.scrollWidth > {width}) words.push('scrolls to ' + root.scrollWidth);
  document.querySelector('pre').textContent = words.join('; ');
}};
frame.srcdoc = {page};
</script>"#
    )
}

fn open(folder: &Path, more: &[&str], page: &Path) -> Output {
    let mut run = Command::new("chromium");
    run.args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"]);
    run.args(["--disable-background-networking", "--disable-component-update", "--disable-sync", "--hide-scrollbars"]);
    // No name is ever resolved, the browser's own neither.
    run.args(["--host-resolver-rules=MAP * ~NOTFOUND", "--enable-logging=stderr", "--v=0"]);
    run.arg(format!("--user-data-dir={}", text(&folder.join("profile")))).args(more);
    run.arg(format!("file://{}", text(page))).output().unwrap()
}

/// Opens a page about which the browser has nothing to say.
fn quiet(folder: &Path, more: &[&str], page: &Path) -> Output {
    let out = open(folder, more, page);
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    assert_eq!(console(&out), "", "the console of {}", page.display());
    out
}

fn console(out: &Output) -> String {
    String::from_utf8_lossy(&out.stderr).lines().filter(|line| line.contains("CONSOLE")).collect()
}

fn assert_not_blank(picture: &Path) {
    let image = read_rgb(picture).unwrap();
    let other = image.data.iter().filter(|pixel| **pixel != image.data[0]).count();
    assert!(other * 50 > image.data.len(), "{other} of {} pixels differ from the first", image.data.len());
}

/// For looking at: `STRANDFLOW_KEEP_PAGES` names a folder that gets what the browser made.
fn keep(made: &Path, page: &Path) {
    if let Some(folder) = std::env::var_os("STRANDFLOW_KEEP_PAGES") {
        let names = [page.file_stem(), made.file_name()].map(|name| name.unwrap().to_string_lossy().into_owned());
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::copy(made, Path::new(&folder).join(names.join("-"))).unwrap();
    }
}
