//! How each stage stands, by what is there; whether it is up to date takes `strandflow status`.

use strandflow_engine::{
    Kind, Plan, STAGES,
    item::BLOCK_STRANDS,
    store::Store,
    table::{Phase, Span},
};
use strandflow_view::describe::StageState;

/// Finished and failed items of one phase, of how many.
#[derive(Clone, Copy, Default)]
struct Count {
    done: usize,
    failed: usize,
    all: usize,
}

/// The stages in order.
pub fn of(store: Option<&Store>, plan: Option<&Plan>, views: usize) -> Vec<StageState> {
    let (Some(store), Some(plan)) = (store, plan) else {
        let none = |name| StageState { name, state: "none", detail: "no run yet".into() };
        return STAGES.iter().map(|stage| none(stage.name)).collect();
    };
    let strands = store.shape("scalp/roots").map_or(0, |shape| shape[0]);
    STAGES
        .iter()
        .map(|stage| {
            let counts: Vec<Count> =
                stage.phases.iter().map(|phase| count(store, plan, phase, views, strands)).collect();
            let complete = counts.iter().all(|c| c.all > 0 && c.done >= c.all);
            let state = match () {
                () if counts.iter().any(|c| c.failed > 0) => "failed",
                () if complete => "done",
                () if counts.iter().any(|c| c.done > 0) => "partial",
                () => "none",
            };
            // The phase that is behind says most.
            let behind = counts.iter().position(|c| c.all == 0 || c.done < c.all).unwrap_or(counts.len() - 1);
            StageState { name: stage.name, state, detail: words(&stage.phases[behind], counts[behind]) }
        })
        .collect()
}

fn count(store: &Store, plan: &Plan, phase: &Phase, views: usize, strands: usize) -> Count {
    let frames = match phase.span {
        Span::Lead => plan.lead.len(),
        Span::Frames => plan.frames.len(),
    };
    let all = match phase.kind {
        Kind::Take => 1,
        Kind::Frame | Kind::FrameChained => frames,
        Kind::ViewFrame | Kind::ViewFrameChained => views * frames,
        Kind::Block => strands.div_ceil(BLOCK_STRANDS),
    };
    let items = store.items_of(phase.name);
    let failed = items.iter().filter(|key| store.failure(key).is_some()).count();
    // Items of frames that an earlier run had more do not make it more than done.
    Count { done: (items.len() - failed).min(all), failed, all }
}

fn words(phase: &Phase, count: Count) -> String {
    let what = match phase.kind {
        Kind::Take => "part",
        Kind::Frame | Kind::FrameChained => "frames",
        Kind::ViewFrame | Kind::ViewFrameChained => "images",
        Kind::Block => "strand blocks",
    };
    let failed = if count.failed > 0 { format!(", {} failed", count.failed) } else { String::new() };
    format!("{} of {} {what}{failed}", count.done, count.all)
}
