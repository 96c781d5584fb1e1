//! `strandflow view`: a take in the browser, served on the loopback only.

pub mod about;
mod along;
mod attributes;
mod chosen;
mod history;
pub mod layers;
mod parts;
mod ranges;
mod sets;
pub mod source;
mod stages;
mod truth;
mod viewer;

use crate::{args::ViewArgs, failure::Failed, serving};

use self::{source::Source, viewer::Viewer};

pub fn view(args: &ViewArgs) -> Result<(), Failed> {
    let source = Source::open(&args.take, args.truth.as_deref())?;
    let server = serving::begin(args.port, "Whoever has it can see the take. Ctrl-C ends the viewer.", source.notes())?;
    Ok(server.run(Box::new(Viewer::new(source)), serving::threads())?)
}
