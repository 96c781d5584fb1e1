//! `strandflow overlay`: strands drawn over footage.

use strandflow_engine::Take;
use strandflow_eval::overlay::{OverlayColour, overlay as draw};
use strandflow_io::write_rgb_png;

use crate::{args::OverlayArgs, failure::Failed};

pub fn overlay(args: &OverlayArgs) -> Result<(), Failed> {
    let take = Take::open(&args.take)?;
    let Some(view) = take.rig().view_named(&args.view) else {
        let names: Vec<&str> = take.rig().cameras.iter().map(|camera| camera.name.as_str()).collect();
        return Err(Failed::input(format!("no view `{}`", args.view), format!("views: {}", names.join(", "))));
    };
    let sequence = take.read_sequence(args.stage.name())?;
    let Some(t) = sequence.frames.iter().position(|&frame| frame as usize == args.frame) else {
        let hint = "run the stage for that frame, or name another frame";
        return Err(Failed::input(format!("stage {} has no frame {}", args.stage.name(), args.frame), hint));
    };
    let image = take.images().image(view, args.frame).map_err(|error| Failed::input(error.to_string(), error.hint))?;
    let colour = if args.provenance { OverlayColour::Provenance } else { OverlayColour::Strand };
    write_rgb_png(&args.out, &draw(&image, &take.rig().cameras[view], &sequence, t, args.every, colour))?;
    eprintln!("wrote {}", args.out.display());
    Ok(())
}
