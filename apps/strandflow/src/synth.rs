//! `strandflow synth`: a synthetic capture with truth.

use std::path::Path;

use indicatif::ProgressBar;
use strandflow_core::{Provenance, RigidTransform, StrandSequence};
use strandflow_io::{Interchange, write_hair, write_npz, write_usc_data};
use strandflow_synth::{SpecViolation, Style, SynthSpec, generate, groom::groom, head};

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
    if args.groom {
        return make_groom(&spec, &args.out, args.force);
    }
    if args.out.join("gt").exists() && !args.force {
        let error = format!("{} holds a capture already", args.out.display());
        return Err(Failed::input(error, "give another folder, or --force to write over it"));
    }
    make(&spec, &args.out)
}

fn wrong(violations: Vec<SpecViolation>) -> Failed {
    let lines: Vec<String> = violations.iter().map(ToString::to_string).collect();
    Failed::input(lines.join("\n"), "correct the spec; `strandflow synth --full OUT` writes one to start from")
}

/// Writes the groom of a spec, head space, as it hangs at rest.
fn make_groom(spec: &SynthSpec, file: &Path, force: bool) -> Result<(), Failed> {
    if file.exists() && !force {
        let error = format!("{} is there already", file.display());
        return Err(Failed::input(error, "give another file, or --force to write over it"));
    }
    let violations = spec.check();
    if !violations.is_empty() {
        return Err(wrong(violations));
    }
    let groom = groom(spec, &head::mesh(HEAD_LEVELS));
    let counts: Vec<u16> = groom.strands.iter().map(|s| s.len().min(usize::from(u16::MAX)) as u16).collect();
    let width = counts.iter().copied().max().unwrap_or(0).into();
    let mut sequence = StrandSequence::missing(vec![0], counts, width);
    for (n, strand) in groom.strands.iter().enumerate() {
        for (at, point) in sequence.range(0, n).zip(strand) {
            sequence.points[at] = point.as_vec3();
            (sequence.provenance[at], sequence.confidence[at]) = (Provenance::Simulated, 1.0);
        }
    }
    let ending = file.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
    match ending {
        "npz" => write_npz(file, &sequence, &[RigidTransform::IDENTITY])?,
        "data" => write_usc_data(file, &Interchange::new(&sequence)?, 0)?,
        "hair" => write_hair(file, &Interchange::new(&sequence)?, 0)?,
        _ => {
            return Err(Failed::input(
                format!("{}: is of no format of grooms", file.display()),
                "end it in .data, .hair or .npz",
            ));
        }
    }
    let particles: usize = groom.strands.iter().map(Vec::len).sum();
    eprintln!("wrote {}: {} strands, {particles} particles", file.display(), groom.strands.len());
    Ok(())
}

/// Subdivisions of the head that roots are drawn on.
const HEAD_LEVELS: usize = 5;

/// Makes the capture of a spec in a folder.
pub fn make(spec: &SynthSpec, folder: &Path) -> Result<(), Failed> {
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
