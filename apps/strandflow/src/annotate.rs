//! `strandflow annotate`: markers, masks and sketches in the browser, served on the loopback only.

mod desk;
mod home;
mod labels;
mod manifest_text;
mod masks;
mod refusals;
mod sketches;
mod tracks;

use strandflow_engine::sources::read_rig;

use crate::{args::AnnotateArgs, failure::Failed, serving, view::source::Source};

use self::desk::TakeDesk;

pub fn annotate(args: &AnnotateArgs) -> Result<(), Failed> {
    let source = Source::open(&args.take, None)?;
    // Without cameras there is nothing to guide a label by.
    read_rig(&args.take, source.manifest())?;
    let about_it = "Whoever has it can see and label the take. Every stroke is saved at once; Ctrl-C ends it.";
    let server = serving::begin(args.port, about_it, source.notes())?;
    Ok(server.run_desk(Box::new(TakeDesk::open(&args.take, source)?), serving::threads())?)
}
