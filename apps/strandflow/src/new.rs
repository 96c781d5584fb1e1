//! `strandflow new`: a take for footage and a calibration.

use strandflow_engine::{
    Take,
    scaffold::{self, NewTake},
};

use crate::{args::NewArgs, failure::Failed};

pub fn new(args: &NewArgs) -> Result<(), Failed> {
    let made = scaffold::new_take(&NewTake {
        take: args.take.clone(),
        capture: args.capture.clone(),
        calibration: args.calibration.clone(),
        unit_mm: args.unit,
        convention: args.convention.unwrap_or_default(),
        fps: args.fps,
        up: args.up.map(glam::DVec3::from),
        held_out: args.hold_out.clone(),
    })?;
    for line in &made.said {
        eprintln!("{line}");
    }
    eprintln!("wrote {}", made.manifest.display());
    if !made.missing.is_empty() {
        for line in &made.missing {
            eprintln!("still to be made: {line}");
        }
        eprintln!("see docs/capture.md; then: strandflow run {}", args.take.display());
        return Ok(());
    }
    // The take is opened at once, so that what is wrong with the capture is said now.
    let take = Take::open(&args.take)?;
    eprintln!(
        "{} views, frames {}; next: strandflow run {}",
        take.rig().view_count(),
        take.frames(),
        args.take.display()
    );
    Ok(())
}
