//! Runs stages of a take: skips what is fresh, does what is not, item by item, with a bounded number in flight.

use std::{
    io::Write,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, AtomicUsize, Ordering},
    },
    time::{Instant, SystemTime, UNIX_EPOCH},
};

use strandflow_core::{Finding, Place, Report};

use crate::{
    EngineError, Plan, Take,
    events::{Event, Outcome},
    finding_kinds::FindingKinds,
    item::Item,
    memory,
    status::status_before,
    store::{Failure, Record, Writer},
    table::{Job, Phase, STAGES, Stage},
    take::RUN_LOG,
};

/// Which stages to run, and how wide.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// Index of the first stage.
    pub from: usize,
    /// Index of the last stage.
    pub to: usize,
    /// Threads; also the most items in flight.
    pub threads: usize,
    /// What was found wrong with the take before: logged and told first.
    pub found: Vec<Finding>,
}

impl Default for RunOptions {
    fn default() -> Self {
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        Self { from: 0, to: STAGES.len() - 1, threads, found: Vec::new() }
    }
}

/// What a run came to.
#[derive(Clone, Debug, Default)]
pub struct Summary {
    /// By phase, in order.
    pub phases: Vec<PhaseSummary>,
    /// Whether it was asked to stop.
    pub interrupted: bool,
}

/// What became of the items of one phase.
#[derive(Clone, Debug, Default)]
pub struct PhaseSummary {
    /// `stage/phase`.
    pub phase: &'static str,
    /// Wall-clock seconds.
    pub secs: f64,
    /// Largest resident memory \[MB\].
    pub peak_mb: Option<f64>,
    /// Items by outcome.
    pub done: usize,
    /// Items that were there already.
    pub fresh: usize,
    /// Items that failed.
    pub failed: usize,
    /// Items that something was missing for.
    pub blocked: usize,
    /// Number of findings.
    pub findings: usize,
    /// Kinds of findings: those of one view with the same consequence are one.
    pub finding_kinds: usize,
    /// The first of the first kinds, in words, by view.
    pub first_findings: Vec<String>,
    /// The failures, by item.
    pub failures: Vec<(String, Failure)>,
}

/// Kinds of findings kept in words per phase: one for each of seven views, and one more.
const FINDINGS_SHOWN: usize = 8;

impl Summary {
    /// Items that failed.
    pub fn failures(&self) -> impl Iterator<Item = &(String, Failure)> {
        self.phases.iter().flat_map(|phase| &phase.failures)
    }

    /// Whether everything asked for is there.
    pub fn complete(&self) -> bool {
        !self.interrupted && self.phases.iter().all(|phase| phase.failed == 0 && phase.blocked == 0)
    }

    fn ended(&self, secs: f64) -> Event {
        let sum = |of: fn(&PhaseSummary) -> usize| self.phases.iter().map(of).sum();
        Event::Ended {
            complete: self.complete(),
            interrupted: self.interrupted,
            done: sum(|phase| phase.done),
            fresh: sum(|phase| phase.fresh),
            failed: sum(|phase| phase.failed),
            blocked: sum(|phase| phase.blocked),
            secs,
        }
    }
}

/// Runs the stages of `options` on the frames of `plan`. `stop` is looked at between items; `audience` is told of
/// everything as it happens, from several threads.
///
/// # Errors
/// `Disk` or `Store` where the results cannot be written at all. Items that fail are in the summary.
pub fn run(
    take: &Take,
    plan: &Plan,
    options: &RunOptions,
    stop: &AtomicBool,
    audience: &(dyn Fn(&Event) + Sync),
) -> Result<Summary, EngineError> {
    let start = Instant::now();
    take.write_resolved(plan)?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(options.threads.max(1))
        .build()
        .map_err(|error| EngineError::disk(take.root(), error))?;
    let log = Log::open(take)?;
    if !options.found.is_empty() {
        let checked = Event::Checked { findings: options.found.clone() };
        log.write(&checked);
        audience(&checked);
    }
    let mut outdated = status_before(take, plan, options.from)?;
    outdated.retain(|phase| !phase.is_done());
    if !outdated.is_empty() {
        audience(&Event::Outdated { phases: outdated });
    }
    let runner = Runner { job: Job { take, plan }, pool, options, stop, audience, log };
    let mut summary = Summary::default();
    for stage in &STAGES[options.from..=options.to] {
        for phase in stage.phases {
            if stop.load(Ordering::Relaxed) {
                break;
            }
            summary.phases.push(runner.phase(stage, phase)?);
        }
    }
    summary.interrupted = stop.load(Ordering::Relaxed);
    audience(&summary.ended(start.elapsed().as_secs_f64()));
    Ok(summary)
}

/// What a phase's items came to, while they run.
#[derive(Default)]
struct Found {
    summary: PhaseSummary,
    kinds: FindingKinds,
}

struct Runner<'a> {
    job: Job<'a>,
    pool: rayon::ThreadPool,
    options: &'a RunOptions,
    stop: &'a AtomicBool,
    audience: &'a (dyn Fn(&Event) + Sync),
    log: Log,
}

impl Runner<'_> {
    fn phase(&self, stage: &Stage, phase: &'static Phase) -> Result<PhaseSummary, EngineError> {
        let start = Instant::now();
        memory::reset_peak();
        let ready = phase.chains(&self.job).and_then(|chains| (phase.prepare)(&self.job).map(|()| chains));
        let chains = match ready {
            Ok(chains) => chains,
            // What the phase is made of is not there: it is blocked as a whole, or its arrays cannot be made.
            Err(EngineError::Missing { .. } | EngineError::Store { .. }) => Vec::new(),
            Err(error) => return Err(error),
        };
        let blocked_whole = chains.is_empty();
        let items = chains.iter().map(Vec::len).sum();
        (self.audience)(&Event::PhaseStarted { phase: phase.name, summary: stage.summary, items });
        let found = Mutex::new(Found::default());
        self.work(stage, phase, &chains, &found);
        let Found { mut summary, kinds } = found.into_inner().unwrap_or_else(PoisonError::into_inner);
        summary.phase = phase.name;
        (summary.finding_kinds, summary.first_findings) = (kinds.count(), kinds.in_words(FINDINGS_SHOWN));
        summary.blocked += usize::from(blocked_whole);
        (summary.secs, summary.peak_mb) = (start.elapsed().as_secs_f64(), memory::peak_mb());
        summary.failures.sort_by(|a, b| a.0.cmp(&b.0));
        let (secs, peak_mb) = (summary.secs, summary.peak_mb);
        let finished = Event::PhaseFinished { phase: phase.name, secs, peak_mb };
        if summary.done + summary.failed > 0 {
            self.log.write(&finished);
        }
        (self.audience)(&finished);
        Ok(summary)
    }

    /// As many workers as threads take chains in order; the stages' own parallel loops run in the pool.
    fn work(&self, stage: &Stage, phase: &'static Phase, chains: &[Vec<Item>], found: &Mutex<Found>) {
        let next = AtomicUsize::new(0);
        std::thread::scope(|scope| {
            for _ in 0..self.options.threads.clamp(1, chains.len().max(1)) {
                scope.spawn(|| {
                    while let Some(chain) = chains.get(next.fetch_add(1, Ordering::Relaxed)) {
                        for &item in chain {
                            if self.stop.load(Ordering::Relaxed) {
                                return;
                            }
                            self.item(stage, phase, item, found);
                        }
                    }
                });
            }
        });
    }

    fn item(&self, stage: &Stage, phase: &'static Phase, item: Item, found: &Mutex<Found>) {
        let start = Instant::now();
        let key = item.key(phase.name);
        let (outcome, findings, failure) = self.settle(stage, phase, item, &key);
        let secs = start.elapsed().as_secs_f64();
        let place = self.place(item);
        {
            let mut found = found.lock().unwrap_or_else(PoisonError::into_inner);
            findings.iter().for_each(|finding| found.kinds.add(finding));
            let found = &mut found.summary;
            match outcome {
                Outcome::Done => found.done += 1,
                Outcome::Fresh => found.fresh += 1,
                Outcome::Failed => found.failed += 1,
                Outcome::Blocked => found.blocked += 1,
            }
            found.findings += findings.len();
            if let (Outcome::Failed, Some(failure)) = (outcome, &failure) {
                found.failures.push((key.clone(), failure.clone()));
            }
        }
        let event = Event::Item { phase: phase.name, item: key, place, outcome, secs, findings, failure };
        if outcome != Outcome::Fresh {
            self.log.write(&event);
        }
        (self.audience)(&event);
    }

    /// Decides whether the item has to be done, and does it.
    fn settle(&self, stage: &Stage, phase: &Phase, item: Item, key: &str) -> (Outcome, Vec<Finding>, Option<Failure>) {
        let store = self.job.take.store();
        let inputs = match stage.inputs(phase, &self.job, item) {
            Ok(inputs) => inputs,
            Err(error @ (EngineError::Missing { .. } | EngineError::Store { .. })) => {
                return (Outcome::Blocked, Vec::new(), Some(failure_of(&error)));
            }
            Err(error) => return self.failed(key, &error),
        };
        if let Some(record) = store.record(key)
            && record.inputs == inputs.hashes
        {
            return (Outcome::Fresh, record.findings, None);
        }
        if let Err(error) = store.forget(key) {
            return self.failed(key, &error);
        }
        let mut report = Report::default();
        let mut writer = Writer::new(store);
        let result = catch_unwind(AssertUnwindSafe(|| {
            self.pool.install(|| (phase.run)(&self.job, item, &mut writer, &mut report))
        }))
        .unwrap_or_else(|panic| Err(panicked(stage.name, panic.as_ref())));
        if let Err(error) = result {
            return self.failed(key, &error);
        }
        let record = Record { inputs: inputs.hashes, outputs: writer.finish(), findings: report.findings };
        match store.write_record(key, &record) {
            Ok(()) => (Outcome::Done, record.findings, None),
            Err(error) => self.failed(key, &error),
        }
    }

    fn failed(&self, key: &str, error: &EngineError) -> (Outcome, Vec<Finding>, Option<Failure>) {
        let failure = failure_of(error);
        let store = self.job.take.store();
        // Where even this cannot be written, the summary still has it.
        let _ = store.forget(key).and_then(|()| store.write_failure(key, &failure));
        (Outcome::Failed, Vec::new(), Some(failure))
    }

    fn place(&self, item: Item) -> String {
        let cameras = &self.job.take.rig().cameras;
        match item {
            Item::Take => Place::default().to_string(),
            Item::Frame(frame) => Place::frame(frame).to_string(),
            Item::ViewFrame(view, frame) => Place::view_frame(&cameras[view].name, frame).to_string(),
            Item::Block(block) => format!("strands from {}", block * crate::item::BLOCK_STRANDS),
        }
    }
}

fn failure_of(error: &EngineError) -> Failure {
    Failure { error: error.to_string(), hint: error.hint(), input: error.is_input() }
}

fn panicked(stage: &str, panic: &(dyn std::any::Any + Send)) -> EngineError {
    let text = panic.downcast_ref::<&str>().map(|s| (*s).to_owned());
    let text = text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
    EngineError::Store { array: stage.to_owned(), fact: format!("the stage stopped unexpectedly: {text}") }
}

/// `run.log`: one line of JSON a work item that was not fresh, and one a phase that had such items.
struct Log(Mutex<std::fs::File>);

impl Log {
    fn open(take: &Take) -> Result<Self, EngineError> {
        let path = take.root().join(RUN_LOG);
        let file = std::fs::OpenOptions::new().create(true).append(true).open(&path);
        Ok(Self(Mutex::new(file.map_err(|error| EngineError::disk(&path, error))?)))
    }

    fn write(&self, event: &Event) {
        let unix_secs = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |d| d.as_secs_f64());
        let Ok(mut line) = serde_json::to_value(event) else { return };
        line["unix_secs"] = unix_secs.into();
        let mut file = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        // A log that cannot be written must not cost a result.
        let _ = writeln!(file, "{line}");
    }
}
