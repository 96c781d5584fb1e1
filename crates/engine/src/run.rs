//! Runs stages of a take: skips what is fresh, does what is not, item by item, with a bounded number in flight.

use std::{
    ops::Range,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, AtomicUsize, Ordering},
    },
    time::Instant,
};

use strandflow_core::Finding;

use crate::{
    EngineError, Plan, Take,
    events::Event,
    finding_kinds::FindingKinds,
    item::{Item, Kind},
    memory,
    status::status_before,
    table::{Job, Phase, Stage, phases},
};

mod log;
mod settle;
mod summary;

use log::Log;
pub use log::log_lines;
pub use summary::{PhaseSummary, Summary};

/// Which phases to run, and how wide.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// Indices of phases in the table.
    pub phases: Range<usize>,
    /// A task among many, which may run side by side on any machines: these parts of the phases ([`Kind::parts`]), by number, as
    /// far as there are so many. No two items write one chunk, so any ranges will do.
    pub items: Option<Range<usize>>,
    /// Threads; also the most items in flight.
    pub threads: usize,
    /// Whether results that are there are read and compared with their hashes.
    pub verify: bool,
    /// What was found wrong with the take before: logged and told first.
    pub found: Vec<Finding>,
}

impl Default for RunOptions {
    fn default() -> Self {
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        Self { phases: 0..phases().count(), items: None, threads, verify: false, found: Vec::new() }
    }
}

/// Kinds of findings kept in words per phase: one for each of seven views, and one more.
const FINDINGS_SHOWN: usize = 8;

/// Runs the phases of `options` on the frames of `plan`. `stop` is looked at between items; `audience` is told of
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
    let is_task = options.items.is_some();
    take.store().expect_complete();
    take.write_resolved(plan)?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(options.threads.max(1))
        .build()
        .map_err(|error| EngineError::disk(take.root(), error))?;
    let log = Log::open(take, is_task)?;
    if !options.found.is_empty() {
        let checked = Event::Checked { findings: options.found.clone() };
        log.write(&checked);
        audience(&checked);
    }
    // Who sends tasks looks at what is before them, once for all, and sweeps.
    if !is_task {
        take.store().sweep();
        tell_of_outdated(take, plan, options, audience)?;
    }
    let runner =
        Runner { job: Job { take, plan, is_task }, pool, options, stop, audience, log, mended: AtomicUsize::new(0) };
    let mut summary = Summary::default();
    for (at, (stage, phase)) in phases().enumerate().take(options.phases.end).skip(options.phases.start) {
        if stop.load(Ordering::Relaxed) {
            break;
        }
        summary.phases.push(runner.phase(stage, phase)?);
        if is_task && phase.kind == Kind::Take {
            prepare_from(at + 1, take, plan)?;
        }
    }
    summary.interrupted = stop.load(Ordering::Relaxed);
    audience(&summary.ended(start.elapsed().as_secs_f64()));
    Ok(summary)
}

/// Makes the arrays of the phases from one on, as far as what sets their shapes is known: the frames and images from the start,
/// the rest from items of the whole take. One process does so, before tasks find them made.
///
/// # Errors
/// `Disk`.
pub fn prepare_from(first: usize, take: &Take, plan: &Plan) -> Result<(), EngineError> {
    let job = Job::new(take, plan);
    phases().skip(first).try_for_each(|(_, phase)| match (phase.prepare)(&job) {
        Err(EngineError::Missing { .. } | EngineError::Store { .. }) => Ok(()),
        done => done,
    })
}

fn tell_of_outdated(
    take: &Take,
    plan: &Plan,
    options: &RunOptions,
    audience: &(dyn Fn(&Event) + Sync),
) -> Result<(), EngineError> {
    let mut outdated = status_before(take, plan, options.phases.start)?;
    outdated.retain(|phase| !phase.is_done());
    if !outdated.is_empty() {
        audience(&Event::Outdated { phases: outdated });
    }
    Ok(())
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
    /// Items made again because they were damaged.
    mended: AtomicUsize,
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
        let chains = match &self.options.items {
            Some(asked) => phase.kind.chains_of(&chains, asked),
            None => chains,
        };
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
}
