//! `strandflow animate`: another groom driven by the captured motion.

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3, Vec3};
use indicatif::{ProgressBar, ProgressStyle};
use strandflow_core::{RigidTransform, SparseVoxels, TriMesh};
use strandflow_engine::{
    EngineError, Performance,
    animation::{AnimationPlan, AnimationSummary, OtherField, animate as make},
};
use strandflow_eval::truth;
use strandflow_geometry::icp::Similarity;
use strandflow_io::{Carrier, Space, Target, VdbOptions, read_obj, read_vdb};
use strandflow_stages::animate::{Alignment, AnimateSettings, Timeline};

use crate::{
    animate_groom::{groom, is},
    animate_score::{Reference, compare, field_of_truth},
    args::AnimateArgs,
    failure::Failed,
    run,
    stdout::print,
};

pub fn animate(args: &AnimateArgs) -> Result<(), Failed> {
    let performance = Performance::open(&args.take)?;
    let truth = args.truth.as_deref().map(truth::read).transpose().map_err(|error| {
        Failed::input(error.to_string(), "give the gt/ folder of the capture that the take was made from")
    })?;
    let timeline = timeline(args, &performance)?;
    let own = is(&args.groom, "captured") || is(&args.groom, "truth");
    let alignment = alignment(args, own)?;
    let groom = groom(args, &performance, truth.as_ref(), timeline.first, alignment == Alignment::Find)?;
    let name = args
        .name
        .clone()
        .unwrap_or_else(|| args.groom.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default());
    let true_field = |frame: usize| field_of_truth(truth.as_ref(), &performance, frame);
    let read_field = |frame: usize| field_in(args, &performance, frame);
    let field = match &args.field {
        Some(folder) => {
            let files = (timeline.first..=timeline.last).map(|frame| vdb_of(folder, frame)).collect();
            Some(OtherField { from: "OpenVDB", files, of: &read_field })
        }
        None => args.true_field.then_some(OtherField { from: "truth", files: Vec::new(), of: &true_field }),
    };
    let still = standing(args, &performance)?;
    let plan = AnimationPlan {
        name: &name,
        groom: &groom,
        alignment,
        fitted_springs: args.fitted_springs,
        timeline,
        field,
        still: still.as_ref(),
        settings: settings(args),
    };
    let stop = run::stop_on_ctrl_c();
    let bar = progress(timeline.frames);
    let work = || make(&performance, &plan, &stop, &|k| bar.set_position(k as u64 + 1));
    let summary = in_pool(args.threads, work)?;
    bar.finish_and_clear();
    let reference = match (&truth, own) {
        (Some(truth), _) if is(&args.groom, "truth") => Some(Reference::Truth(truth)),
        (_, true) => Some(Reference::Captured(&performance)),
        _ => None,
    };
    let scores = match reference {
        Some(reference) if !summary.interrupted && timeline.speed == 1.0 => {
            Some(compare(&performance, &name, &timeline, &reference)?)
        }
        _ => None,
    };
    if args.json {
        let text = serde_json::json!({ "animation": name, "summary": summary, "scores": scores });
        print(&format!("{text:#}\n"))?;
    } else {
        eprint!("{}", words(&name, &summary));
        scores.iter().for_each(|scores| eprint!("{scores}"));
    }
    if summary.interrupted {
        let hint = "run the same command again to go on; nothing is lost".into();
        return Err(Failed { error: "stopped".into(), hint, input: false });
    }
    Ok(())
}

fn vdb_of(folder: &Path, frame: usize) -> PathBuf {
    folder.join(format!("{frame:06}.vdb"))
}

/// The field of a frame from the user's files.
fn field_in(args: &AnimateArgs, performance: &Performance, frame: usize) -> Result<SparseVoxels<Vec3>, EngineError> {
    let file = vdb_of(args.field.as_deref().unwrap_or(Path::new("")), frame);
    let space = args.field_for.map_or_else(Space::default, |target| Target::from(target).space(Carrier::Vdb));
    let options = VdbOptions { gravity: Some(performance.gravity()), space, zip: false };
    let grids = read_vdb(&file)?;
    let hint = "write it by `export --to vdb`, and say --field-for as --for was said then";
    let said = |fact: String| EngineError::input(file.display().to_string(), fact, hint);
    let named = grids.iter().find(|grid| grid.name == "velocity").or(grids.first());
    named.ok_or_else(|| said("holds no grid of vectors".into()))?.to_velocity(&options).map_err(said)
}

/// What stands still and hair keeps out of: the mesh that is given, else the take's own shoulders.
fn standing(args: &AnimateArgs, performance: &Performance) -> Result<Option<TriMesh>, Failed> {
    if let Some(file) = &args.collide {
        return obstacle(file).map(Some);
    }
    let found = if args.no_shoulders { None } else { performance.standing()? };
    if let Some((_, litres)) = &found {
        eprintln!(
            "{litres:.1} litres stand still below the head, by the hulls: hair keeps out of them (--no-shoulders lets it in)"
        );
    }
    Ok(found.map(|(mesh, _)| mesh))
}

/// The mesh of a file; a unit that cannot be meant is named.
fn obstacle(file: &Path) -> Result<TriMesh, Failed> {
    let mesh = read_obj(file)?;
    let corners = || mesh.vertices.iter().copied();
    let low = corners().fold(DVec3::INFINITY, DVec3::min);
    let high = corners().fold(DVec3::NEG_INFINITY, DVec3::max);
    let size = (high - low).max_element();
    if (MESH_MM.0..=MESH_MM.1).contains(&size) {
        return Ok(mesh);
    }
    let unit = [("centimetres", 10.0), ("metres", 1000.0)].into_iter();
    let meant = unit.filter(|(_, mm)| (MESH_MM.0..=MESH_MM.1).contains(&(size * mm))).map(|(name, _)| name).next_back();
    let hint = match meant {
        Some(unit) => format!("it seems to be in {unit}: write it in millimetres, in the world of the take"),
        None => "write it in millimetres, in the world of the take".into(),
    };
    Err(Failed::input(format!("{}: is {size:.1} mm large", file.display()), hint))
}

/// Sizes of a body, or a part of one \[mm\].
const MESH_MM: (f64, f64) = (60.0, 4000.0);

fn timeline(args: &AnimateArgs, performance: &Performance) -> Result<Timeline, Failed> {
    let frames = args.frames.unwrap_or(performance.frames());
    if frames.is_empty() || !(args.speed > 0.0 && args.speed <= 10.0) {
        let error = format!("--frames {frames} --speed {}: nothing to show", args.speed);
        return Err(Failed::input(error, "give frames A..B of the take and a speed above 0, up to 10"));
    }
    let once = Timeline::once(frames.start, frames.end - 1, args.speed);
    Ok(args.length.map_or(once, |frames| Timeline { frames: frames.max(1), ..once }))
}

fn settings(args: &AnimateArgs) -> AnimateSettings {
    let default = AnimateSettings::default();
    AnimateSettings {
        driven: !args.undriven,
        follow_secs: args.follow.unwrap_or(default.follow_secs),
        amplitude: args.amplitude,
        stiffness: args.stiffness,
        damping: args.damping,
        drag: args.drag.unwrap_or(default.drag),
        variation: args.variation,
        seed: args.seed,
        ..default
    }
}

fn alignment(args: &AnimateArgs, own: bool) -> Result<Alignment, Failed> {
    if args.as_given || (own && args.transform.is_none()) {
        return Ok(Alignment::AsGiven);
    }
    match &args.transform {
        Some(file) => Ok(Alignment::Given(read_transform(file)?)),
        None => Ok(Alignment::Find),
    }
}

/// Four rows of four numbers: a rotation times a scale, and a translation \[mm\].
fn read_transform(file: &Path) -> Result<Similarity, Failed> {
    let wrong = |fact: &str| {
        let hint = "write 4 rows of 4 numbers: rotation times scale, translation in mm; 0 0 0 1 last";
        Failed::input(format!("{}: {fact}", file.display()), hint)
    };
    let text = std::fs::read_to_string(file).map_err(|error| wrong(&error.to_string()))?;
    let words = text.split(|c: char| c.is_whitespace() || ",[]".contains(c)).filter(|word| !word.is_empty());
    let numbers: Vec<f64> =
        words.map(str::parse).collect::<Result<_, _>>().map_err(|_| wrong("holds a word that is no number"))?;
    let [a, b, c, x, d, e, f, y, g, h, i, z, ..] = numbers[..] else {
        return Err(wrong("holds fewer than 12 numbers"));
    };
    let linear = DMat3::from_cols(DVec3::new(a, d, g), DVec3::new(b, e, h), DVec3::new(c, f, i));
    let scale = linear.determinant().cbrt();
    let rotation = linear * (1.0 / scale);
    let off = rotation * rotation.transpose() - DMat3::IDENTITY;
    let skewed = off.to_cols_array().iter().fold(0.0f64, |most, v| most.max(v.abs()));
    if !(numbers.iter().all(|v| v.is_finite()) && scale > 0.0 && skewed < 1e-3) {
        return Err(wrong("is no rotation, scale and translation"));
    }
    Ok(Similarity { scale, rigid: RigidTransform { rotation, translation: DVec3::new(x, y, z) } })
}

fn in_pool<T: Send>(threads: Option<usize>, work: impl FnOnce() -> Result<T, EngineError> + Send) -> Result<T, Failed> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.unwrap_or(0)).build();
    let pool = pool.map_err(|error| Failed { error: error.to_string(), hint: String::new(), input: false })?;
    Ok(pool.install(work)?)
}

fn progress(frames: usize) -> ProgressBar {
    let template = "{prefix:<15} {bar:20} {pos:>5}/{len:<5} {per_sec:>12} {eta:>8} left";
    let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    let bar = ProgressBar::new(frames as u64).with_prefix("animate").with_style(style);
    bar.enable_steady_tick(std::time::Duration::from_millis(250));
    bar
}

fn words(name: &str, s: &AnimationSummary) -> String {
    let peak = s.peak_mb.map_or_else(String::new, |mb| format!(", peak {mb:.0} MB"));
    let mut text = format!(
        "animation {name}: {} strands, {} particles; roots {:.1} mm from the scalp (rms, worst {:.1}), scale {:.3}\n\
         {} frames made, {} found; {:.2} s a frame, of which {:.2} s simulation{peak}\n\
         strands in the head: {}; change of length: {:.2} % on average, {:.1} % at most\n",
        s.strands,
        s.particles,
        s.roots_rms_mm,
        s.roots_worst_mm,
        s.scale,
        s.made,
        s.found,
        s.secs_a_frame,
        s.simulation_secs_a_frame,
        s.in_head,
        100.0 * s.length_change_mean,
        100.0 * s.length_change_most,
    );
    for finding in &s.findings {
        text += &format!("  {}: {}; {}\n", finding.place, finding.fact, finding.consequence);
    }
    text
}
