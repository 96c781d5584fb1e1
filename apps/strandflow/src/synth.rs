//! `strandflow synth`: a synthetic capture with truth.

use std::path::Path;

use indicatif::ProgressBar;
use strandflow_synth::{Style, SynthSpec, generate};

use crate::{args::SynthArgs, capture_files::write_capture, failure::Failed};

pub fn synth(args: &SynthArgs) -> Result<(), Failed> {
    let style: Style = args.style.into();
    let mut spec = match &args.spec {
        Some(path) => read_spec(path)?,
        None if args.full => SynthSpec::full(style, args.frames.unwrap_or(30)),
        None => SynthSpec::demo(style),
    };
    if let Some(frames) = args.frames {
        spec.rig.frames = frames;
    }
    if let Some(seed) = args.seed {
        spec.seed = seed;
    }
    if args.out.join("gt").exists() && !args.force {
        let error = format!("{} holds a capture already", args.out.display());
        return Err(Failed::input(error, "give another folder, or --force to write over it"));
    }
    make(&spec, &args.out)
}

/// Makes the capture of a spec in a folder.
pub fn make(spec: &SynthSpec, folder: &Path) -> Result<(), Failed> {
    let wrong = |violations: Vec<strandflow_synth::SpecViolation>| {
        let lines: Vec<String> = violations.iter().map(ToString::to_string).collect();
        Failed::input(lines.join("\n"), "correct the spec; `strandflow synth --full OUT` writes one to start from")
    };
    let spinner = ProgressBar::new_spinner().with_message("growing and simulating the hair");
    spinner.enable_steady_tick(std::time::Duration::from_millis(200));
    let scene = generate(spec).map_err(wrong)?;
    spinner.finish_and_clear();
    let bar = ProgressBar::new(spec.rig.frames as u64).with_message("frames");
    write_capture(&scene, folder, |_| bar.inc(1))?;
    bar.finish_and_clear();
    eprintln!("wrote {}: {} views, {} frames, with truth in gt/", folder.display(), spec.rig.views, spec.rig.frames);
    Ok(())
}

fn read_spec(path: &Path) -> Result<SynthSpec, Failed> {
    let wrong = |error: String| {
        Failed::input(
            format!("{}: {error}", path.display()),
            "see synth.toml of any capture made by `strandflow synth`",
        )
    };
    let text = std::fs::read_to_string(path).map_err(|error| wrong(error.to_string()))?;
    toml::from_str(&text).map_err(|error| wrong(error.to_string()))
}
