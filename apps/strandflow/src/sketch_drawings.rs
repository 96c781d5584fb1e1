//! Drawn strands as curves in space: what the user drew (`user/sketches` of the take), or what a person would draw of true strands.

use std::{collections::BTreeMap, path::Path};

use glam::DVec2;
use strandflow_core::{Camera, Rig};
use strandflow_engine::{Take, footage::numbered};
use strandflow_eval::{
    Truth,
    drawing::{Hand, drawable, stroke},
    statistics::evenly,
};
use strandflow_geometry::sketch::curve_from_drawings;
use strandflow_io::sketches::{SketchedStrand, read_sketches};

use crate::{failure::Failed, sketched::Drawn};

/// Where sketches lie in a take: one file a frame, `000012.json`.
const SKETCHES: &str = "user/sketches";

/// Frames in which true strands are drawn, evenly chosen: a person has an afternoon.
const FRAMES: usize = 10;

/// The curves of drawn strands by number, in the order of frames.
pub type Drawings = BTreeMap<u32, Vec<Drawn>>;

/// What the user drew.
pub fn by_user(take: &Take) -> Result<Drawings, Failed> {
    let folder = take.root().join(SKETCHES);
    let files = numbered(&folder, |path| path.extension().is_some_and(|extension| extension == "json"))?;
    if files.is_empty() {
        let hint =
            "draw strands over two or more views of a frame, and save them as user/sketches/000012.json of the take";
        return Err(Failed::input(format!("{}: there are no sketches", folder.display()), hint));
    }
    let mut drawings = Drawings::new();
    for (frame, file) in files {
        for strand in read_sketches(&file)? {
            add(&mut drawings, take.rig(), frame, &strand, &file)?;
        }
    }
    Ok(drawings)
}

/// At most `count` true strands, drawn in the frames of the take; numbered as in the truth.
pub fn of_truth(take: &Take, truth: &Truth, count: usize) -> Result<Drawings, Failed> {
    let plan = take.last_plan()?;
    let known: Vec<usize> = (plan.frames.start..plan.frames.end).filter_map(|frame| truth.at(frame as u32)).collect();
    let times: Vec<usize> = evenly(known.len(), FRAMES).into_iter().map(|i| known[i]).collect();
    let (rig, hand) = (take.rig(), Hand::default());
    let chosen = drawable(truth, rig, &(0..rig.view_count()).collect::<Vec<_>>(), &times, &hand, count);
    let mut drawings = Drawings::new();
    for &t in &times {
        let frame = truth.frames[t] as usize;
        for one in &chosen {
            let drawn = |&view: &usize| {
                let seed = ((one.strand * rig.view_count() + view) as u64) << 32 | frame as u64;
                let points = stroke(&rig.cameras[view], truth.strand(t, one.strand), &hand, seed)?;
                Some((rig.cameras[view].name.clone(), points.into_iter().map(<[f64; 2]>::from).collect()))
            };
            let strand = SketchedStrand { id: one.strand as u32, views: one.views.iter().filter_map(drawn).collect() };
            add(&mut drawings, rig, frame, &strand, Path::new("the truth"))?;
        }
    }
    if drawings.is_empty() {
        let fact = "the truth has no strand that three views show in all frames";
        return Err(Failed::input(fact, "draw strands by `strandflow annotate`, and evaluate with --sketches"));
    }
    Ok(drawings)
}

/// Adds a drawn strand's curve, or says why it has none.
fn add(drawings: &mut Drawings, rig: &Rig, frame: usize, strand: &SketchedStrand, file: &Path) -> Result<(), Failed> {
    let mut views: Vec<(&Camera, Vec<DVec2>)> = Vec::new();
    for (view, points) in &strand.views {
        let Some(at) = rig.view_named(view) else {
            let fact = format!("{}: strand {} is drawn in `{view}`, which is no view", file.display(), strand.id);
            return Err(Failed::input(fact, "views are named as in the take's manifest"));
        };
        views.push((&rig.cameras[at], points.iter().map(|&point| DVec2::from(point)).collect()));
    }
    let views: Vec<(&Camera, &[DVec2])> = views.iter().map(|(camera, points)| (*camera, points.as_slice())).collect();
    match curve_from_drawings(&views) {
        Some(found) => {
            let one = Drawn { frame, views: views.len(), rms_px: found.rms_px, curve: found.points };
            drawings.entry(strand.id).or_default().push(one);
        }
        None => eprintln!(
            "note: {}: strand {} is left out: it needs drawings in two views that look from different sides",
            file.display(),
            strand.id
        ),
    }
    Ok(())
}
