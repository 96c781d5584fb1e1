//! `strandflow render`: stills, folders, videos; bad input is a located error with a hint and leaves nothing behind.
#![expect(clippy::unwrap_used, reason = "a failing unwrap is a failing test")]

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use crate::common::{assert_bad_input, assert_not_written, on_full_disk, stderr, strandflow, take, text};
use glam::Vec3;
use strandflow_core::{Provenance, StrandSequence};
use strandflow_io::{Interchange, read_rgb, write_hair};

/// A take, and strands of its frames 0 to 2 that fall in front of its cameras.
fn scene(root: &Path) -> (PathBuf, PathBuf) {
    let (_, take) = take(root);
    let folder = root.join("hair");
    std::fs::create_dir(&folder).unwrap();
    let mut sequence = StrandSequence::missing(vec![0, 1, 2], vec![12; 60], 12);
    for t in 0..3 {
        for n in 0..60 {
            for (k, at) in sequence.range(t, n).enumerate() {
                let around = n as f32 * 0.1;
                sequence.points[at] =
                    Vec3::new(80.0 * around.cos() + t as f32, 80.0 * around.sin(), 60.0 - 9.0 * k as f32);
                sequence.provenance[at] = Provenance::Observed;
                sequence.confidence[at] = 1.0;
            }
        }
    }
    let strands = Interchange::new(&sequence).unwrap();
    (0..3).for_each(|t| write_hair(&folder.join(format!("{t:06}.hair")), &strands, t).unwrap());
    (take, folder)
}

fn render(take: &Path, hair: &Path, more: &[&str], out: &Path) -> std::process::Output {
    let mut args = vec!["render", text(take), "--strands", text(hair), "--density", "4"];
    args.extend(more);
    args.push(text(out));
    strandflow(&args)
}

#[test]
fn stills_folders_turntables_and_videos() {
    let root = tempfile::tempdir().unwrap();
    let (take, hair) = scene(root.path());
    let done = |more: &[&str], name: &str| {
        let out = root.path().join(name);
        let run = render(&take, &hair, more, &out);
        assert!(run.status.success(), "{}", stderr(&run));
        out
    };
    let one = done(&["--view", "cam1", "--frames", "1..2", "--background", "plate", "--threads", "1"], "one.png");
    let two = done(&["--view", "cam1", "--frames", "1..2", "--background", "plate", "--threads", "2"], "two.png");
    assert_eq!(std::fs::read(&one).unwrap(), std::fs::read(two).unwrap(), "threads change nothing");
    let (still, plate) = (read_rgb(&one).unwrap(), read_rgb(&root.path().join("capture/clean/cam1.png")).unwrap());
    assert_eq!((still.width, still.height, still[(0, 0)]), (64, 48, plate[(0, 0)]));
    assert!(still != plate);
    let folder = done(&["--view", "cam2", "--background", "none", "--size", "80x60"], "all");
    assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 3);
    assert_eq!(read_rgb(&folder.join("000002.png")).unwrap().width, 80);
    let turns = done(&["--turntable", "4", "--size", "40x50", "--colour", "#a05020"], "turns");
    assert_eq!(std::fs::read_dir(&turns).unwrap().count(), 4);
    if strandflow_io::source::probe::ffmpeg_is_installed() {
        assert!(done(&["--background", "footage", "--view", "cam0"], "a.mp4").metadata().unwrap().len() > 500);
    } else {
        eprintln!("skipped: no ffmpeg");
    }
    let hidden = |name: &str| name.starts_with('.');
    let left = std::fs::read_dir(root.path()).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
    assert!(!left.into_iter().any(|name| hidden(&name)), "nothing half done is left");
}

#[test]
fn bad_input_says_what_and_leaves_nothing() {
    let root = tempfile::tempdir().unwrap();
    let (take, hair) = scene(root.path());
    let out = root.path().join("out.png");
    let bad = |more: &[&str], words: &[&str]| {
        let run = render(&take, &hair, more, &out);
        assert_bad_input(&run, words);
        assert!(!out.exists());
    };
    bad(&["--view", "cam9"], &["no view `cam9`"]);
    bad(&["--frames", "2..7"], &["2..7"]);
    bad(&["--frames", "0..2"], &["2 pictures", "one PNG"]);
    bad(&["--size", "900000x2"], &["900000x2"]);
    bad(&["--size", "wide"], &["wide"]);
    bad(&["--colour", "mauve"], &["mauve"]);
    bad(&["--background", "beach"], &["beach"]);
    bad(&["--turntable", "1", "--background", "plate"], &["needs a view"]);
    bad(&["--motion-blur", "7"], &["motion blur is 7", "0..=1"]);
    bad(&["--motion-blur", "nan"], &["motion blur is NaN"]);
    bad(&["--polish", "101"], &["polish is 101"]);
    let gif = root.path().join("a.gif");
    assert_bad_input(&render(&take, &hair, &[], &gif), &["a.gif", "no format that is written"]);
    let mut run = Command::new(env!("CARGO_BIN_EXE_strandflow"));
    let run = run
        .env("PATH", "")
        .arg("render")
        .arg(&take)
        .arg("--strands")
        .arg(&hair)
        .arg(root.path().join("a.mp4"))
        .output()
        .unwrap();
    assert_bad_input(&run, &["ffmpeg", "was not found"]);
    // Not written to where nobody may, and not over what is there.
    assert_bad_input(&render(&take, &hair, &[], Path::new("/proc/no/out.png")), &["/proc/no"]);
    assert_bad_input(&render(&take, &hair, &[], &hair), &["not an empty folder"]);
    assert_bad_input(&render(&take, &hair, &["--background", "none"], &root.path().join("a.mp4")), &["transparency"]);
    assert_bad_input(&strandflow(&["render", text(&take), text(&out)]), &["not done"]);
    assert_bad_input(&render(&take, &root.path().join("bald.npz"), &[], &out), &["no such file"]);
}

#[cfg(unix)]
#[test]
fn a_full_disk_is_told_and_leaves_nothing() {
    let root = tempfile::tempdir().unwrap();
    let (take, hair) = scene(root.path());
    let out = root.path().join("out");
    std::fs::create_dir(&out).unwrap();
    let mut outputs = vec!["a.png", "folder"];
    if strandflow_io::source::probe::ffmpeg_is_installed() {
        outputs.push("a.mp4");
    } else {
        eprintln!("skipped: no ffmpeg");
    }
    for name in outputs {
        let to = out.join(name);
        let args = ["render", text(&take), "--strands", text(&hair), "--density", "2", text(&to)];
        assert_not_written(&on_full_disk(1, &args), &to);
        assert_eq!(std::fs::read_dir(&out).unwrap().count(), 0, "{name}");
        let below_a_file = hair.join("000000.hair").join(name);
        let run = strandflow(&["render", text(&take), "--strands", text(&hair), text(&below_a_file)]);
        assert_bad_input(&run, &["000000.hair"]);
    }
}
