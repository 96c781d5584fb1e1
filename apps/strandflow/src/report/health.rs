//! How each stage stands, in words.

use strandflow_engine::{
    FindingKinds, STAGES,
    status::{PhaseStatus, status},
    store::Store,
    table::Stage,
};
use strandflow_report::{Html, html::Cell};

use super::{advice::advice, motion::Motion, opened::Opened, percent};

/// Kinds of findings written out for each stage; the rest is in `run.log`.
const KINDS_SHOWN: usize = 12;

/// The stages of a take.
pub struct Health {
    stages: Vec<StageHealth>,
    /// What keeps the state from being judged, and what to do about it.
    unjudged: Option<(String, String)>,
}

/// How one stage stands.
struct StageHealth {
    name: &'static str,
    summary: &'static str,
    /// State of its phases; `None` where it cannot be judged.
    phases: Option<Vec<PhaseStatus>>,
    finished: usize,
    failures: Vec<(String, String)>,
    findings: FindingKinds,
    finding_count: usize,
}

impl Health {
    /// Looks at records, failures and, where the footage can be opened, at what the results rest on.
    pub fn of(take: &Opened) -> Self {
        let judged = take.whole().map_err(Clone::clone).and_then(|whole| status(whole, &whole.last_plan()?));
        let unjudged = judged.as_ref().err().map(|error| (error.to_string(), error.hint()));
        let judged = judged.ok();
        let of_stage = |stage: &'static Stage| {
            let own = |phase: &&PhaseStatus| stage.phases.iter().any(|known| known.name == phase.phase);
            let phases = judged.as_ref().map(|all| all.iter().filter(own).cloned().collect());
            StageHealth::of(stage, phases, take.store())
        };
        Self { stages: STAGES.iter().map(of_stage).collect(), unjudged }
    }

    /// Verdicts, figures of the whole, and what to do next.
    pub fn summary(&self, take: &Opened, motion: Option<&Motion>) -> Html {
        let mut html = Html::default();
        html.push(self.what_next(take));
        let row = |stage: &StageHealth| {
            vec![
                Cell::Text(stage.name.into()),
                Cell::Text(stage.summary.into()),
                Cell::Text(stage.verdict()),
                Cell::Text(stage.findings_in_short()),
            ]
        };
        html.push(Html::table(&["Stage", "makes", "is", "Findings"], self.stages.iter().map(row)));
        html.push(Html::list(figures(take, motion)));
        html
    }

    /// What to do next, the most urgent first.
    fn what_next(&self, take: &Opened) -> Html {
        if take.last_run().is_none() {
            let fact = "This take has not been run yet, so there is nothing to show but what it is made of.";
            return Html::warning(fact, &format!("Run `strandflow run {}`.", take.name()));
        }
        let mut html = Html::default();
        if let Some((error, hint)) = &self.unjudged {
            let fact = format!(
                "The footage cannot be opened: {error}. Pictures are left out, and whether results are up to date is not known."
            );
            html.push(Html::warning(&fact, hint));
        }
        let failed: Vec<&StageHealth> = self.stages.iter().filter(|stage| !stage.failures.is_empty()).collect();
        for stage in &failed {
            let (error, hint) = &stage.failures[0];
            let more = stage.failures.len() - 1;
            let more = if more > 0 { format!(" (and {more} more)") } else { String::new() };
            html.push(Html::warning(&format!("Stage {} failed: {error}{more}", stage.name), hint));
        }
        let stale = self.stages.iter().find(|stage| stage.sum(|p| p.stale) > 0);
        let open =
            self.stages.iter().find(|stage| stage.phases.as_ref().is_some_and(|p| !p.iter().all(PhaseStatus::is_done)));
        let run = format!("`strandflow run {}` does what is stale, missing or failed, and nothing else.", take.name());
        if let Some(stage) = stale {
            let fact = format!("Results are not up to date from stage {} on: {}.", stage.name, stage.reason());
            html.push(Html::warning(&fact, &run));
        } else if let (Some(stage), true) = (open, failed.is_empty()) {
            html.push(Html::warning(&format!("The take is unfinished from stage {} on.", stage.name), &run));
        }
        if html.is_empty() {
            let with_findings: Vec<&str> =
                self.stages.iter().filter(|stage| stage.finding_count > 0).map(|stage| stage.name).collect();
            html.push(Html::paragraph(&match with_findings.as_slice() {
                [] => "Every stage is done and up to date, and none found anything amiss.".to_owned(),
                names => format!(
                    "Every stage is done and up to date. What was met on the way and got over is written below, stage by stage: {}.",
                    names.join(", ")
                ),
            }));
        }
        html
    }

    /// Findings and failures in words, with advice.
    pub fn stages(&self) -> Html {
        let told: Html = self.stages.iter().filter_map(StageHealth::details).collect();
        if told.is_empty() { Html::paragraph("No stage found anything amiss.") } else { told }
    }
}

impl StageHealth {
    fn of(stage: &'static Stage, phases: Option<Vec<PhaseStatus>>, store: Option<&Store>) -> Self {
        let (name, summary) = (stage.name, stage.summary);
        let mut health = Self {
            name,
            summary,
            phases,
            finished: 0,
            failures: Vec::new(),
            findings: FindingKinds::default(),
            finding_count: 0,
        };
        let Some(store) = store else { return health };
        for key in stage.phases.iter().flat_map(|phase| store.items_of(phase.name)) {
            if let Some(failure) = store.failure(&key) {
                health.failures.push((failure.error, failure.hint));
            } else if let Some(record) = store.record(&key) {
                health.finished += 1;
                health.finding_count += record.findings.len();
                record.findings.iter().for_each(|finding| health.findings.add(finding));
            }
        }
        health
    }

    fn sum(&self, count: fn(&PhaseStatus) -> usize) -> usize {
        self.phases.iter().flatten().map(count).sum()
    }

    fn verdict(&self) -> String {
        let (items, done, stale) = (self.sum(|p| p.items), self.sum(|p| p.done), self.sum(|p| p.stale));
        let begun = self.finished + self.failures.len() > 0;
        match &self.phases {
            _ if !begun => "not begun".into(),
            None if self.failures.is_empty() => format!("there, {} items", self.finished),
            None => format!("failed in {} items, {} there", self.failures.len(), self.finished),
            Some(phases) if phases.iter().all(PhaseStatus::is_done) => "done".into(),
            Some(_) if !self.failures.is_empty() => format!("failed in {} of {items} items", self.failures.len()),
            Some(_) if stale > 0 => format!("stale in {stale} of {items} items"),
            Some(_) => format!("unfinished, {done} of {items} items"),
        }
    }

    /// The commonest reason why items are stale.
    fn reason(&self) -> String {
        let reasons = self.phases.iter().flatten().flat_map(|phase| &phase.reasons);
        reasons.max_by_key(|(_, count)| **count).map_or("not known".into(), |(reason, _)| reason.clone())
    }

    fn findings_in_short(&self) -> String {
        match (self.finding_count, self.findings.count()) {
            (0, _) => "none".into(),
            (1, _) => "1".into(),
            (n, 1) => format!("{n}, of one kind"),
            (n, kinds) => format!("{n}, of {kinds} kinds"),
        }
    }

    fn details(&self) -> Option<Html> {
        if self.finding_count + self.failures.len() == 0 {
            return None;
        }
        let mut html = Html::heading(self.name);
        html.push(Html::paragraph(&format!("Makes {}; {}.", self.summary, self.verdict())));
        let failures = self.failures.iter().take(KINDS_SHOWN);
        html.extend(failures.map(|(error, hint)| Html::warning(error, hint)));
        html.push(Html::list(self.findings.in_words(KINDS_SHOWN)));
        let more = self.findings.count().saturating_sub(KINDS_SHOWN);
        if more > 0 {
            html.push(Html::paragraph(&format!("And {more} more kinds, which are in run.log.")));
        }
        html.push(Html::paragraph(advice(self.name)));
        Some(html)
    }
}

/// The take in a few figures.
fn figures(take: &Opened, motion: Option<&Motion>) -> Vec<String> {
    let (Some(store), Some(frames)) = (take.store(), take.frames()) else { return Vec::new() };
    let mut said = Vec::new();
    let (mut voxels, mut observed) = (0, 0);
    for frame in frames.start..frames.end {
        let flags: Vec<u8> = store.read_all(&format!("field/{frame:06}/observed")).unwrap_or_default();
        voxels += flags.len();
        observed += flags.iter().filter(|flag| **flag != 0).count();
    }
    if voxels > 0 {
        let share = percent(observed as f64 / voxels as f64);
        said.push(format!("{share} of the hair's voxels were observed by three or more views; the others took their direction from around them."));
    }
    if let Ok(flags) = store.read_all::<u8>("prune/flags") {
        let strands = store.shape("prune/flags").map_or(0, |shape| shape[1]);
        let own = flags.get(frames.start * strands..frames.end * strands).unwrap_or_default();
        let kept = own.iter().filter(|flag| **flag == 0).count();
        if !own.is_empty() {
            said.push(format!(
                "{} of the grown strands were kept by stage prune.",
                percent(kept as f64 / own.len() as f64)
            ));
        }
    }
    if let Some(motion) = motion {
        said.extend(motion.in_words());
    }
    said
}
