//! `strandflow export`: strands, the velocity field and fitted material in formats that other programs read.

mod material;

use std::path::Path;

use glam::DVec3;
use strandflow_core::RigidTransform;
use strandflow_engine::{Performance, Plan, Take, animation::AnimationStrands, stage_index};
use strandflow_io::{
    Cards, Carrier, ChosenStrands, Guides, Interchange, IoError, Resampled, SceneOptions, Space, StrandFrames,
    VdbOptions, write_alembic, write_bytes, write_folder, write_hair, write_npz, write_ply, write_usc_data, write_usd,
    write_velocity_vdb,
};

use crate::{
    args::{ExportArgs, ExportStage, Format},
    failure::Failed,
    status::tell_of_outdated,
};

pub fn export(args: &ExportArgs) -> Result<(), Failed> {
    check(args)?;
    match (&args.animation, args.stage) {
        (Some(name), _) => export_animation(name, args)?,
        (None, Some(stage)) => export_stage(stage, args)?,
        // clap has refused this.
        (None, None) => {}
    }
    eprintln!("wrote {}", args.out.display());
    if args.to == Format::Abc && args.target.is_none() {
        eprintln!("note: Alembic states neither unit nor axes; these are millimetres, Z up; see --for");
    }
    Ok(())
}

fn export_stage(stage: ExportStage, args: &ExportArgs) -> Result<(), Failed> {
    let take = Take::open(&args.take)?;
    let plan = take.last_plan()?;
    take.must_be_done(stage.name(), &plan)?;
    tell_of_outdated(&take, &plan, stage_index(stage.name())?)?;
    let poses = take.read_poses_of(plan.frames)?;
    let scene = Scene { gravity: take.gravity(), fps: take.manifest().fps, poses };
    match stage {
        ExportStage::Flow => write_flow(&take, &plan, args),
        ExportStage::Fit if args.to == Format::Csv => {
            make_folder(args.out.parent())?;
            Ok(write_bytes(&args.out, material::csv(&take)?.as_bytes())?)
        }
        _ => write_strands(&scene, &take.strands_of(stage.name(), plan.frames)?, args),
    }
}

/// Animations need nothing of a take but its results.
fn export_animation(name: &str, args: &ExportArgs) -> Result<(), Failed> {
    let performance = Performance::open(&args.take)?;
    let strands = AnimationStrands::open(performance.store(), name)?;
    let poses = (0..strands.frames().len()).map(|t| strands.world_from_head(t)).collect::<Result<_, _>>()?;
    write_strands(&Scene { gravity: performance.gravity(), fps: performance.fps(), poses }, &strands, args)
}

/// What files say beside the strands.
struct Scene {
    gravity: DVec3,
    fps: f64,
    /// World from head, by frame.
    poses: Vec<RigidTransform>,
}

/// What does not go together, before any work starts.
fn check(args: &ExportArgs) -> Result<(), Failed> {
    let said = |error: &str, hint: &str| Err(Failed::input(error, hint));
    let carrier = carrier(args.to);
    match (args.stage, args.to) {
        (Some(ExportStage::Flow), Format::Vdb) => {}
        (Some(ExportStage::Flow), _) => return said("the velocity field goes into vdb only", "say --to vdb"),
        (_, Format::Vdb) => return said("vdb holds the velocity field, not strands", "say --stage flow"),
        (Some(ExportStage::Fit), Format::Csv) => {}
        (_, Format::Csv) => return said("csv holds what `fit` found of each strand", "say --stage fit"),
        _ => {}
    }
    if args.to == Format::Csv && (args.strands.is_some() || args.points.is_some() || args.guides.is_some()) {
        return said("csv has a row for every strand that was fitted", "leave out --strands, --points and --guides");
    }
    if args.stage == Some(ExportStage::Flow)
        && (args.strands.is_some() || args.points.is_some() || args.guides.is_some())
    {
        return said("the velocity field has no strands", "leave out --strands, --points and --guides");
    }
    if args.target.is_some() && carrier.is_none() {
        return said("this format keeps the take's world", "--for goes with abc, usd, cards and vdb");
    }
    if args.to == Format::Cards && args.guides.is_none() {
        return said("cards run along guides", "say how many with --guides N");
    }
    Ok(())
}

/// The kind of file whose unit and axes follow the program it is for.
fn carrier(format: Format) -> Option<Carrier> {
    match format {
        Format::Abc => Some(Carrier::Alembic),
        Format::Usd => Some(Carrier::Usd),
        Format::Cards => Some(Carrier::Obj),
        Format::Vdb => Some(Carrier::Vdb),
        Format::Npz | Format::Ply | Format::Hair | Format::Data | Format::Csv => None,
    }
}

/// Whether cards go into one animated mesh rather than a folder.
fn is_usd(out: &Path) -> bool {
    out.extension().is_some_and(|ending| ["usd", "usda", "usdc"].iter().any(|usd| ending.eq_ignore_ascii_case(usd)))
}

fn space(args: &ExportArgs) -> Space {
    let carrier = match args.to {
        Format::Cards if is_usd(&args.out) => Some(Carrier::Usd),
        format => carrier(format),
    };
    let target = args.target.zip(carrier);
    target.map_or_else(Space::default, |(target, carrier)| strandflow_io::Target::from(target).space(carrier))
}

/// Writes strands as they are asked for: fewer of them, then with other points, then their guides. Reads a few frames at a
/// time.
fn write_strands(scene: &Scene, strands: &dyn StrandFrames, args: &ExportArgs) -> Result<(), Failed> {
    let mut strands = strands;
    let (chosen, resampled, leading);
    if let Some(count) = args.strands {
        chosen = ChosenStrands::evenly(strands, count as usize)?;
        strands = &chosen;
    }
    if let Some(points) = args.points {
        resampled = Resampled::new(strands, points)?;
        strands = &resampled;
    }
    let guides = args.guides.map(|count| Guides::of(strands, count as usize)).transpose()?;
    if let (Some(guides), false) = (&guides, matches!(args.to, Format::Abc | Format::Cards)) {
        leading = ChosenStrands::new(strands, &guides.strands);
        strands = &leading;
    }
    write(scene, strands, guides.as_ref(), args)
}

/// Writes a file, or a folder of one file a frame; whole or not at all.
fn write(scene: &Scene, strands: &dyn StrandFrames, guides: Option<&Guides>, args: &ExportArgs) -> Result<(), Failed> {
    let out = &args.out;
    let gravity = Some(scene.gravity);
    let options = SceneOptions { fps: scene.fps, gravity, space: space(args), ..SceneOptions::default() };
    match (args.to, guides) {
        (Format::Npz, _) => {
            make_folder(out.parent())?;
            let head_from_world: Vec<RigidTransform> = scene.poses.iter().map(RigidTransform::inverse).collect();
            write_npz(out, strands, &head_from_world)?;
        }
        (Format::Usd, _) => {
            make_folder(out.parent())?;
            write_usd(out, strands, &options)?;
        }
        (Format::Abc, _) => {
            make_folder(out.parent())?;
            write_alembic(out, strands, guides, &options)?;
        }
        (Format::Cards, Some(guides)) => {
            let cards = Cards::new(out, strands, guides, &options)?;
            if is_usd(out) {
                make_folder(out.parent())?;
                return Ok(cards.write_usd(out)?);
            }
            one_a_frame(cards.frames(), out, "obj", |path, t| Ok(cards.write_obj(path, t)?))?;
        }
        (Format::Ply, _) => strands_a_frame(strands, out, "ply", write_ply)?,
        (Format::Hair, _) => strands_a_frame(strands, out, "hair", write_hair)?,
        (Format::Data, _) => strands_a_frame(strands, out, "data", write_usc_data)?,
        // `check` has refused these.
        (Format::Cards | Format::Vdb | Format::Csv, _) => {}
    }
    Ok(())
}

/// The velocity field of every frame.
fn write_flow(take: &Take, plan: &Plan, args: &ExportArgs) -> Result<(), Failed> {
    let options = VdbOptions { gravity: Some(take.gravity()), space: space(args), ..VdbOptions::default() };
    let frames: Vec<u32> = (plan.frames.start as u32..plan.frames.end as u32).collect();
    one_a_frame(&frames, &args.out, "vdb", |path, t| {
        Ok(write_velocity_vdb(path, &take.read_flow(frames[t] as usize)?, &options)?)
    })
}

type FrameWriter = fn(&Path, &Interchange, usize) -> Result<(), IoError>;

fn strands_a_frame(strands: &dyn StrandFrames, out: &Path, extension: &str, write: FrameWriter) -> Result<(), Failed> {
    let strands = Interchange::new(strands)?;
    one_a_frame(strands.frames(), out, extension, |path, t| Ok(write(path, &strands, t)?))
}

/// Files `FOLDER/000012.EXTENSION`, all or none.
fn one_a_frame(
    frames: &[u32],
    folder: &Path,
    extension: &str,
    write: impl Fn(&Path, usize) -> Result<(), Failed>,
) -> Result<(), Failed> {
    make_folder(folder.parent())?;
    write_folder(folder, |folder| {
        let mut files = frames.iter().enumerate();
        files.try_for_each(|(t, frame)| write(&folder.join(format!("{frame:06}.{extension}")), t))
    })
}

fn make_folder(folder: Option<&Path>) -> Result<(), Failed> {
    let Some(folder) = folder.filter(|folder| !folder.as_os_str().is_empty()) else { return Ok(()) };
    std::fs::create_dir_all(folder).map_err(|error| Failed {
        error: format!("{}: {error}", folder.display()),
        hint: "give a path that you may write to".into(),
        input: true,
    })
}
