//! `strandflow evaluate`: against truth, and against images that had no part in the reconstruction.

use std::path::Path;

use strandflow_core::StrandSequence;
use strandflow_engine::{STAGES, Take, disk::write_atomic, stage_index};
use strandflow_eval::{Truth, truth};

use crate::{
    args::EvaluateArgs,
    failure::Failed,
    foreign, held_out,
    scores::{SEQUENCE_STAGES, Scores, score_take},
    sketch_drawings,
    sketch_lengths::LengthsOverTime,
    sketched,
    status::tell_of_outdated,
    stdout::print,
};

pub fn evaluate(args: &EvaluateArgs) -> Result<(), Failed> {
    let take = Take::open(&args.take)?;
    let (scores, longest) = measure(args, &take)?;
    if args.truth.is_none() && !args.sketches && take.views().held_out().is_empty() {
        eprintln!(
            "note: no view was held out, so these views took part and flatter; hold one out with `strandflow new \
             --hold-out VIEW` or `held_out = [\"VIEW\"]` in the manifest"
        );
    }
    print(&scores.text())?;
    if let Some(file) = &args.json {
        let text = serde_json::to_string_pretty(&scores).map_err(std::io::Error::other)?;
        write_atomic(file, (text + "\n").as_bytes())?;
    }
    let Some(file) = &args.plot else { return Ok(()) };
    let Some(longest) = longest else {
        return Err(Failed::input("no stage has a drawn strand to plot", "run the stages `smooth`, `fit` or `blend`"));
    };
    Ok(write_atomic(file, longest.svg().as_bytes())?)
}

fn measure(args: &EvaluateArgs, take: &Take) -> Result<(Scores, Option<LengthsOverTime>), Failed> {
    let plan = take.last_plan()?;
    let stage = args.stage.as_deref().map(stage_index).transpose()?;
    let mut note = |line: &str| eprintln!("note: {line}");
    let mut read = |file| Ok::<_, Failed>((name_of(file), foreign::read(file, take.gravity(), &mut note)?));
    let given = args.strands.as_deref().map(&mut read).transpose()?;
    if given.is_none() {
        tell_of_outdated(take, &plan, stage.unwrap_or(STAGES.len() - 1))?;
    }
    let stage = stage.map(|index| STAGES[index].name);
    let truth = args.truth.as_deref().map(read_truth).transpose()?;
    let mut scores = match (&args.truth, &truth) {
        (Some(folder), Some(truth)) if args.sketch_truth.is_none() => match &given {
            Some((name, sequence)) => Scores::of_sequence(name, sequence, take, truth),
            None => score_take(take, &plan, truth, folder, stage)?,
        },
        _ => Scores::default(),
    };
    let mut longest = None;
    if let (Some(count), Some(truth)) = (args.sketch_truth, &truth) {
        let drawn = sketch_drawings::of_truth(take, truth, usize::from(count))?;
        (scores.sketches, longest) = sketched::score(take, stage, &drawn, Some(truth));
    } else if args.sketches {
        (scores.sketches, longest) = sketched::score(take, stage, &sketch_drawings::by_user(take)?, None);
    } else if args.truth.is_none() || !take.views().held_out().is_empty() {
        scores.views = in_views(take, given.as_ref(), stage);
    }
    if scores.is_empty() {
        return Err(nothing_to_score(args));
    }
    Ok((scores, longest))
}

fn read_truth(folder: &Path) -> Result<Truth, Failed> {
    let hint = "give the gt/ folder of a capture: see docs/capture.md";
    truth::read(folder).map_err(|error| Failed::input(error.to_string(), hint))
}

fn nothing_to_score(args: &EvaluateArgs) -> Failed {
    let what = args.stage.as_ref().map_or("the take".into(), |stage| format!("stage {stage}"));
    let hint = match &args.truth {
        None => "run `strandflow run TAKE` up to smooth, fit or blend; other stages are scored with --truth DIR/gt",
        Some(_) => "run `strandflow run TAKE` first; the truth must be of the same frames",
    };
    Failed::input(format!("{what}: there is nothing to score"), hint)
}

/// Strands in the views that were held out, or, where none was, in all.
fn in_views(take: &Take, given: Option<&(String, StrandSequence)>, stage: Option<&str>) -> Vec<held_out::ViewScores> {
    if let Some((name, sequence)) = given {
        return held_out::score(name, sequence, take);
    }
    let stages = SEQUENCE_STAGES.iter().filter(|name| stage.is_none_or(|only| only == **name));
    let read = stages.filter_map(|name| Some((*name, take.read_sequence(name).ok()?)));
    read.flat_map(|(name, sequence)| held_out::score(name, &sequence, take)).collect()
}

fn name_of(file: &Path) -> String {
    file.file_name().unwrap_or(file.as_os_str()).to_string_lossy().into_owned()
}
