//! `strandflow report`: one page for a finished, an unfinished and a broken take, readable without a network.
#![expect(clippy::unwrap_used, reason = "a failing unwrap is a failing test")]

use std::path::Path;

use crate::common::{assert_bad_input, browser, bytes_below, stderr, strandflow, synthetic, take, text};

/// The page of a take, written to `out`.
fn page(take: &Path, out: &Path, more: &[&str]) -> String {
    let run = strandflow(&[&["report", text(take), text(out)], more].concat());
    assert!(run.status.success(), "{}", stderr(&run));
    let page = std::fs::read_to_string(out).unwrap();
    assert_self_contained(&page);
    page
}

/// No address of a network, no script, every tag closed in order, every picture described.
fn assert_self_contained(page: &str) {
    for outside in ["http", "<script", "<link", "url(", "@import", "<iframe"] {
        assert!(!page.contains(outside), "the page has `{outside}`");
    }
    let style = page.find("<style>").unwrap()..page.find("</style>").unwrap();
    let without_style = [&page[..style.start], &page[style.end + "</style>".len()..]].concat();
    let (mut open, mut rest) = (Vec::new(), without_style.as_str());
    while let Some((_, after)) = rest.split_once('<') {
        let (tag, after) = after.split_once('>').unwrap();
        let name = tag.split([' ', '/']).find(|part| !part.is_empty()).unwrap_or_default();
        match tag {
            _ if tag.starts_with('!') || tag.ends_with('/') || ["meta", "img", "br"].contains(&name) => {}
            _ if tag.starts_with('/') => assert_eq!(open.pop().as_deref(), Some(name), "before {:.80}", after),
            _ => open.push(name.to_owned()),
        }
        assert!(name != "img" || tag.contains("alt=\""), "{tag:.80}");
        rest = after;
    }
    assert!(open.is_empty(), "{open:?}");
    for section in page.split("href=\"#").skip(1).map(|part| part.split('"').next().unwrap()) {
        assert!(page.contains(&format!("id=\"{section}\"")), "no section {section}");
    }
}

/// `evaluate --sketch-truth`: drawings lie at the truth, the stages are compared with them, and lengths are plotted.
fn true_strands_are_drawn_and_compared(capture: &Path, take: &Path) {
    let plot = capture.with_file_name("lengths.svg");
    let gt = capture.join("gt");
    let draw = ["evaluate", text(take), "--truth", text(&gt), "--sketch-truth", "3", "--plot", text(&plot)];
    let said = strandflow(&draw);
    assert!(said.status.success(), "{}", stderr(&said));
    let printed = String::from_utf8_lossy(&said.stdout).into_owned();
    let mean = |stage: &str| -> f64 {
        let row = printed.lines().find(|line| line.starts_with(stage)).unwrap_or_else(|| panic!("{printed}"));
        row.split_whitespace().nth(2).unwrap().parse().unwrap()
    };
    // A pixel is 7 mm here; three views, smoothed along a strand, halve it.
    assert!(mean("truth ") < 5.0 && mean("blend ") > 0.0, "{printed}");
    let svg = std::fs::read_to_string(&plot).unwrap();
    assert!(svg.starts_with("<svg xmlns=") && ["truth", "smooth", "blend"].iter().all(|name| svg.contains(name)));
    let alone = strandflow(&["evaluate", text(take), "--plot", text(&plot)]);
    assert_eq!(alone.status.code(), Some(2));
    assert!(stderr(&alone).contains("--sketches"), "a plot asks for drawings: {}", stderr(&alone));
}

#[test]
fn a_finished_take_then_without_its_footage() {
    let root = tempfile::tempdir().unwrap();
    let capture = root.path().join("capture");
    synthetic::capture(&capture);
    let take = synthetic::take_of(&capture, "take", &[]);
    let run = strandflow(&["run", text(&take), "--json"]);
    assert!(run.status.success(), "{}", stderr(&run));

    let before = bytes_below(&take);
    let (one, two) = (root.path().join("one.html"), root.path().join("two.html"));
    let whole = page(&take, &one, &["--frame", "1", "--frame", "3", "--view", "cam02"]);
    page(&take, &two, &["--frame", "1", "--frame", "3", "--view", "cam02"]);
    assert_eq!(bytes_below(&take), before, "a report changes nothing in the take");
    assert!(whole == std::fs::read_to_string(&two).unwrap(), "the same take gives the same bytes");
    true_strands_are_drawn_and_compared(&capture, &take);
    assert_eq!(bytes_below(&take), before, "nor does a comparison with drawings");
    // Footage, strands, provenance and orientation map of one view in two frames.
    assert_eq!(whole.matches("<img").count(), 8);
    let parts =
        ["Every stage is done", "Provenance after blend", "The longest strands, after (blend)", "bend stiffness"];
    for part in parts.iter().chain(&["Peak memory", "hull.voxel_mm", "fit/fit", "No spectrum can be taken"]) {
        assert!(whole.contains(part), "`{part}` is not in the page");
    }
    assert!(whole.len() < 5_000_000);

    browser::assert_shown_well(&one);

    // By default into the take; then pictures of footage are gone, the rest stays.
    assert!(strandflow(&["report", text(&take)]).status.success() && take.join("report.html").is_file());
    std::fs::rename(capture.join("images"), capture.join("elsewhere")).unwrap();
    let without = page(&take, &one, &["--frame", "1", "--view", "cam02"]);
    assert!(without.contains("The footage cannot be opened") && without.contains("Provenance after blend"));
    assert_eq!(without.matches("<img").count(), 1, "the orientation map needs no footage");
}

#[test]
fn an_unfinished_take_is_told_not_failed() {
    let root = tempfile::tempdir().unwrap();
    let (_, take) = take(root.path());
    let out = root.path().join("page.html");
    let bare = page(&take, &out, &[]);
    assert!(bare.contains("has not been run yet") && bare.contains("stage smooth is not done"));
    let run = strandflow(&["run", text(&take), "--to", "orient"]);
    let begun = page(&take, &out, &[]);
    assert!(
        begun.contains("unfinished from stage") || !run.status.success() && begun.contains("failed"),
        "{begun:.3000}"
    );
    assert!(begun.contains("not begun"));
    browser::assert_shown_well(&out);
}

#[test]
fn bad_input_says_what_and_leaves_nothing() {
    let root = tempfile::tempdir().unwrap();
    let (_, take) = take(root.path());
    let out = root.path().join("page.html");
    let bad = |args: &[&str], words: &[&str]| {
        assert_bad_input(&strandflow(&[&["report"], args].concat()), words);
        assert!(!out.exists());
    };
    bad(&[text(&root.path().join("nothing")), text(&out)], &["nothing"]);
    bad(&[text(&take), text(&out), "--view", "cam9"], &["no view `cam9`"]);
    bad(&[text(&take), text(&out), "--frame", "0"], &["frame 0"]);
    for target in ["/proc/no/page.html", text(root.path())] {
        let run = strandflow(&["report", text(&take), target]);
        let said = stderr(&run);
        assert!(!run.status.success() && said.contains(target) && said.contains("hint: "), "{said}");
    }
}
