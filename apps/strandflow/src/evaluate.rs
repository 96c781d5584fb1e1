//! `strandflow evaluate`: against truth, or against the images where there is none.

use std::path::Path;

use strandflow_core::StrandSequence;
use strandflow_engine::{Plan, STAGES, Take, stage_index};
use strandflow_eval::{Table, images::held_out_agreement, raster::StrandView, truth};

use crate::{
    args::EvaluateArgs,
    failure::Failed,
    scores::{Scores, score_take},
};

pub fn evaluate(args: &EvaluateArgs) -> Result<(), Failed> {
    let take = Take::open(&args.take)?;
    let plan = take.last_plan()?;
    let stage = args.stage.as_deref().map(stage_index).transpose()?.map(|index| STAGES[index].name);
    let Some(folder) = &args.truth else { return agreement(args, &take, &plan, stage.unwrap_or("blend")) };
    let truth = truth::read(folder)
        .map_err(|error| Failed::input(error.to_string(), "give the gt/ folder of a capture: see docs/capture.md"))?;
    let scores = match &args.strands {
        Some(file) => {
            let mut scores = Scores::default();
            scores.add_sequence(&file.display().to_string(), &read_foreign(file)?, &take, &truth);
            scores
        }
        None => score_take(&take, &plan, &truth, folder, stage)?,
    };
    print(&scores.text());
    write_json(args.json.as_deref(), &scores)
}

/// Strands against orientation maps: without truth, how well what was reconstructed explains the images.
fn agreement(args: &EvaluateArgs, take: &Take, plan: &Plan, stage: &str) -> Result<(), Failed> {
    let sequence = match &args.strands {
        Some(file) => read_foreign(file)?,
        None => take.read_sequence(stage)?,
    };
    let mut table = Table::new(&["view", "frame", "error of all pixels, degrees", "of the most confident half"]);
    let mut found = Vec::new();
    let head = strandflow_core::TriMesh::default();
    for (t, &frame) in sequence.frames.iter().enumerate() {
        let frame = frame as usize;
        if !plan.frames.contains(frame) || (t % sequence.frame_count().div_ceil(10)) != 0 {
            continue;
        }
        for (view, camera) in take.rig().cameras.iter().enumerate() {
            let Ok(map) = take.read_orientation(view, frame) else { continue };
            let strands = (0..sequence.strand_count).map(|n| (n as u32, sequence.strand(t, n)));
            let drawn = StrandView::draw(camera, strands, &head);
            let scores = held_out_agreement(&drawn, &map.angle, &map.confidence);
            table.row(
                &camera.name,
                [frame.to_string(), format!("{:.2}", scores.all.mean), format!("{:.2}", scores.confident_half.mean)],
            );
            found.push(serde_json::json!({ "view": camera.name, "frame": frame, "scores": scores }));
        }
    }
    print(&table.to_string());
    write_json(args.json.as_deref(), &found)
}

fn read_foreign(file: &Path) -> Result<StrandSequence, Failed> {
    Ok(strandflow_io::strands::npz::read_npz(file)?.sequence)
}

#[expect(clippy::print_stdout, reason = "the table is the data of evaluate")]
fn print(text: &str) {
    print!("{text}");
}

fn write_json(file: Option<&Path>, scores: &impl serde::Serialize) -> Result<(), Failed> {
    let Some(file) = file else { return Ok(()) };
    let text = serde_json::to_string_pretty(scores).map_err(std::io::Error::other)?;
    std::fs::write(file, text + "\n")
        .map_err(|error| Failed::input(format!("{}: {error}", file.display()), "give a file that you may write to"))
}
