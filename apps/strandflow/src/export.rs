//! `strandflow export`: strands in a format that other programs read.

use std::path::Path;

use strandflow_engine::{Plan, Take, stage_index, stage_strands::StageStrands};
use strandflow_io::{
    IoError,
    strands::{Interchange, hair::write_hair, npz::write_npz, ply::write_ply, usc_data::write_usc_data},
    usd::{UsdOptions, write_usd},
};

use crate::{
    args::{ExportArgs, Format},
    failure::Failed,
    status::tell_of_outdated,
};

pub fn export(args: &ExportArgs) -> Result<(), Failed> {
    let take = Take::open(&args.take)?;
    let plan = take.last_plan()?;
    take.must_be_done(args.stage.name(), &plan)?;
    tell_of_outdated(&take, &plan, stage_index(args.stage.name())?)?;
    let strands = take.strands_of(args.stage.name(), plan.frames)?;
    write(&take, &plan, &strands, args.to, &args.out)?;
    eprintln!("wrote {}", args.out.display());
    Ok(())
}

/// Writes strands of a take: a file, or a folder of one file a frame. Reads a few frames at a time; a file is written whole
/// or not at all.
fn write(take: &Take, plan: &Plan, strands: &StageStrands, format: Format, out: &Path) -> Result<(), Failed> {
    match format {
        Format::Npz => {
            make_folder(out.parent())?;
            let poses = (plan.frames.start..plan.frames.end).map(|frame| take.read_pose(frame));
            let head_from_world = poses.map(|pose| Ok(pose?.inverse())).collect::<Result<Vec<_>, Failed>>()?;
            write_npz(out, strands, &head_from_world)?;
        }
        Format::Usd => {
            make_folder(out.parent())?;
            let options =
                UsdOptions { fps: take.manifest().fps, gravity: Some(take.gravity()), ..UsdOptions::default() };
            write_usd(out, strands, &options)?;
        }
        Format::Ply => one_a_frame(strands, out, "ply", write_ply)?,
        Format::Hair => one_a_frame(strands, out, "hair", write_hair)?,
        Format::Data => one_a_frame(strands, out, "data", write_usc_data)?,
    }
    Ok(())
}

type FrameWriter = fn(&Path, &Interchange, usize) -> Result<(), IoError>;

/// Files `FOLDER/000012.EXTENSION`.
fn one_a_frame(strands: &StageStrands, folder: &Path, extension: &str, write: FrameWriter) -> Result<(), Failed> {
    make_folder(Some(folder))?;
    let strands = Interchange::new(strands)?;
    for (t, frame) in strands.frames().iter().enumerate() {
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
