//! `strandflow new`: a take for a capture folder.

use strandflow_engine::{Take, scaffold};

use crate::{args::NewArgs, failure::Failed};

pub fn new(args: &NewArgs) -> Result<(), Failed> {
    let manifest = scaffold::new_take(&args.take, &args.capture, &args.hold_out)?;
    eprintln!("wrote {}", manifest.display());
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
