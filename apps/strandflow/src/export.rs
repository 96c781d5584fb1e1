//! `strandflow export`: strands in a format that other programs read.

use std::path::{Path, PathBuf};

use strandflow_core::StrandSequence;
use strandflow_engine::{Plan, Take};
use strandflow_io::{
    IoError,
    strands::{Interchange, hair::write_hair, npz::write_npz, ply::write_ply, usc_data::write_usc_data},
    usd::{UsdOptions, write_usd},
};

use crate::{
    args::{ExportArgs, Format},
    failure::Failed,
};

pub fn export(args: &ExportArgs) -> Result<(), Failed> {
    let take = Take::open(&args.take)?;
    let plan = take.last_plan()?;
    take.must_be_done(args.stage.name(), &plan)?;
    let sequence = take.read_sequence_part(args.stage.name(), plan.frames, 0..take.strand_count()?)?;
    let written = write(&take, &plan, &sequence, args.to, &args.out)?;
    eprintln!("wrote {}", written.display());
    Ok(())
}

/// Writes a sequence of a take; returns the file, or the folder of one file a frame.
pub fn write(
    take: &Take,
    plan: &Plan,
    sequence: &StrandSequence,
    format: Format,
    out: &Path,
) -> Result<PathBuf, Failed> {
    match format {
        Format::Npz => {
            make_folder(out.parent())?;
            let poses = (plan.frames.start..plan.frames.end).map(|frame| take.read_pose(frame));
            let head_from_world = poses.map(|pose| Ok(pose?.inverse())).collect::<Result<Vec<_>, Failed>>()?;
            write_npz(out, sequence, &head_from_world)?;
        }
        Format::Usd => {
            make_folder(out.parent())?;
            let options =
                UsdOptions { fps: take.manifest().fps, gravity: Some(take.gravity()), ..UsdOptions::default() };
            write_usd(out, sequence, &options)?;
        }
        Format::Ply => one_a_frame(sequence, out, "ply", write_ply)?,
        Format::Hair => one_a_frame(sequence, out, "hair", write_hair)?,
        Format::Data => one_a_frame(sequence, out, "data", write_usc_data)?,
    }
    Ok(out.to_owned())
}

type FrameWriter = fn(&Path, &Interchange, usize) -> Result<(), IoError>;

/// Files `FOLDER/000012.EXTENSION`.
fn one_a_frame(sequence: &StrandSequence, folder: &Path, extension: &str, write: FrameWriter) -> Result<(), Failed> {
    make_folder(Some(folder))?;
    let strands = Interchange::new(sequence);
    for (t, frame) in sequence.frames.iter().enumerate() {
        write(&folder.join(format!("{frame:06}.{extension}")), &strands, t)?;
    }
    Ok(())
}

fn make_folder(folder: Option<&Path>) -> Result<(), Failed> {
    let Some(folder) = folder.filter(|folder| !folder.as_os_str().is_empty()) else { return Ok(()) };
    std::fs::create_dir_all(folder).map_err(|error| Failed {
        error: format!("{}: {error}", folder.display()),
        hint: "give a path that you may write to".into(),
        input: true,
    })
}
