//! What is done, stale, missing or failed, and why; looks, and changes nothing.

use std::{
    collections::{BTreeMap, HashSet},
    fmt,
};

use serde::Serialize;

use crate::{
    EngineError, Plan, Take,
    item::{Item, Kind},
    needs::Records,
    store::Failure,
    table::{Job, Phase, STAGES, Stage, phases},
};

/// The state of one work item.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum State {
    /// Finished, and rests on what is there now.
    Done,
    /// Finished, but rests on something that has changed.
    Stale(String),
    /// Not done yet.
    Missing,
    /// Tried, and failed.
    Failed(Failure),
}

/// The state of one phase.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PhaseStatus {
    /// `stage/phase`.
    pub phase: &'static str,
    /// Its work items; 0 where that is not known yet.
    pub items: usize,
    /// Items done.
    pub done: usize,
    /// Items stale.
    pub stale: usize,
    /// Items missing.
    pub missing: usize,
    /// Items failed.
    pub failed: usize,
    /// Why items are stale or failed, with how many say so.
    pub reasons: BTreeMap<String, usize>,
}

impl PhaseStatus {
    /// The items of a phase, counted.
    pub fn of(states: &PhaseStates) -> Self {
        let mut found = Self { phase: states.phase, ..Self::default() };
        for state in states.chains.iter().flatten() {
            found.items += 1;
            match state {
                State::Done => found.done += 1,
                State::Missing => found.missing += 1,
                State::Stale(reason) => {
                    found.stale += 1;
                    *found.reasons.entry(reason.clone()).or_default() += 1;
                }
                State::Failed(failure) => {
                    found.failed += 1;
                    *found.reasons.entry(failure.error.clone()).or_default() += 1;
                }
            }
        }
        found
    }

    /// Whether everything is there and rests on what is there now.
    pub fn is_done(&self) -> bool {
        self.items > 0 && self.done == self.items
    }
}

impl fmt::Display for PhaseStatus {
    /// What is not done, with the commonest reason.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parts = [(self.stale, "stale"), (self.missing, "missing"), (self.failed, "failed")];
        let parts: Vec<String> =
            parts.into_iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}")).collect();
        let parts = if parts.is_empty() { "not begun".to_owned() } else { parts.join(", ") };
        write!(f, "{}: {parts} of {}", self.phase, self.items)?;
        match self.reasons.iter().max_by_key(|(_, count)| **count) {
            Some((reason, _)) => write!(f, " ({reason})"),
            None => Ok(()),
        }
    }
}

/// The state of all phases under a plan.
///
/// # Errors
/// `Disk` where a file of the user cannot be read.
pub fn status(take: &Take, plan: &Plan) -> Result<Vec<PhaseStatus>, EngineError> {
    status_before(take, plan, phases().count())
}

/// The state of the first phases, as many as `count`.
///
/// # Errors
/// As [`status`].
pub fn status_before(take: &Take, plan: &Plan, count: usize) -> Result<Vec<PhaseStatus>, EngineError> {
    let states = states(take, plan, count, Look::Records)?;
    Ok(states.iter().map(PhaseStatus::of).collect())
}

/// How closely results are looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Look {
    /// By their records.
    Records,
    /// By their files too: reads all results.
    Files,
}

/// The items of one phase and their states.
#[derive(Clone, Debug)]
pub struct PhaseStates {
    /// `stage/phase`.
    pub phase: &'static str,
    /// The kind of its items.
    pub kind: Kind,
    /// The states, chain by chain; none where it is not known yet which items there are.
    pub chains: Vec<Vec<State>>,
}

/// The states of all items of the first phases, as many as `count`.
///
/// # Errors
/// As [`status`].
pub fn states(take: &Take, plan: &Plan, count: usize, look: Look) -> Result<Vec<PhaseStates>, EngineError> {
    let job = Job::new(take, plan);
    let looker = Looker { job, look, records: Records::default() };
    let mut unfinished = HashSet::new();
    phases().take(count).map(|(stage, phase)| looker.phase(stage, phase, &mut unfinished)).collect()
}

/// Looks at items; at each record once, however many rest on it.
struct Looker<'a> {
    job: Job<'a>,
    look: Look,
    records: Records,
}

/// What is seen of an item by itself.
enum Seen {
    /// It has this state, whatever became of others.
    Settled(State),
    /// Finished, and rests on these items; the hashes that differ now.
    Finished(Vec<String>, Vec<String>),
}

impl Looker<'_> {
    fn phase(
        &self,
        stage: &Stage,
        phase: &'static Phase,
        unfinished: &mut HashSet<String>,
    ) -> Result<PhaseStates, EngineError> {
        let chains = match phase.chains(&self.job) {
            Ok(chains) => chains,
            Err(EngineError::Missing { .. }) => Vec::new(),
            Err(error) => return Err(error),
        };
        let items: Vec<Item> = chains.iter().flatten().copied().collect();
        // Items are seen side by side; what they make of one another follows in their order.
        let seen = side_by_side(&items, |item| self.item(stage, phase, *item));
        let mut states = seen.into_iter().zip(&items).map(|(seen, item)| {
            let state = judged(seen?, unfinished);
            if state != State::Done {
                unfinished.insert(item.key(phase.name));
            }
            Ok(state)
        });
        let chains = chains.iter().map(|chain| states.by_ref().take(chain.len()).collect());
        Ok(PhaseStates { phase: phase.name, kind: phase.kind, chains: chains.collect::<Result<_, EngineError>>()? })
    }

    fn item(&self, stage: &Stage, phase: &Phase, item: Item) -> Result<Seen, EngineError> {
        let (store, key) = (self.job.take.store(), item.key(phase.name));
        let Some(record) = self.records.of(store, &key)? else {
            return Ok(Seen::Settled(store.failure(&key).map_or(State::Missing, State::Failed)));
        };
        // A failure beside a record: the last run could not look at the item. Its result is there all the same.
        if let Some(damage) = (self.look == Look::Files).then(|| store.damage(&key)).flatten() {
            return Ok(Seen::Settled(State::Stale(format!("damaged: {damage}"))));
        }
        let stale = |why: String| Ok(Seen::Settled(State::Stale(why)));
        let inputs = match stage.inputs_by(phase, &self.job, item, Some(&self.records)) {
            Ok(inputs) => inputs,
            Err(EngineError::Missing { item }) => return stale(format!("{} is not done", stage_of(&item))),
            Err(EngineError::Store { .. }) => return stale("a result it rests on is gone".into()),
            Err(error) => return Err(error),
        };
        let kinds: HashSet<&String> = record.inputs.keys().chain(inputs.hashes.keys()).collect();
        let changed = kinds.into_iter().filter(|kind| record.inputs.get(*kind) != inputs.hashes.get(*kind));
        Ok(Seen::Finished(inputs.items, changed.cloned().collect()))
    }
}

fn judged(seen: Seen, unfinished: &HashSet<String>) -> State {
    let (items, changed) = match seen {
        Seen::Settled(state) => return state,
        Seen::Finished(items, changed) => (items, changed),
    };
    if let Some(first) = items.iter().find(|key| unfinished.contains(*key)) {
        return State::Stale(format!("{} is to be done again", stage_of(first)));
    }
    let mut changed: Vec<&str> = changed.iter().map(|kind| kind.strip_prefix("stage ").unwrap_or(kind)).collect();
    changed.sort_unstable();
    if changed.is_empty() { State::Done } else { State::Stale(format!("changed: {}", changed.join(", "))) }
}

/// The same for each element, by as many threads as there are processors; the order stays.
fn side_by_side<T: Sync, R: Send>(all: &[T], act: impl Fn(&T) -> R + Sync) -> Vec<R> {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let each = all.len().div_ceil(threads).max(1);
    std::thread::scope(|scope| {
        let parts = all.chunks(each).map(|part| scope.spawn(|| part.iter().map(&act).collect::<Vec<R>>()));
        let parts: Vec<_> = parts.collect();
        parts
            .into_iter()
            .flat_map(|part| part.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
            .collect()
    })
}

impl Take {
    /// Asks for a stage's results to be there, whether or not they are stale.
    ///
    /// # Errors
    /// `Input` where an item is not finished.
    pub fn must_be_done(&self, stage: &str, plan: &Plan) -> Result<(), EngineError> {
        let job = Job::new(self, plan);
        for phase in STAGES[crate::stage_index(stage)?].phases {
            let chains = phase.chains(&job).unwrap_or_default();
            let mut keys = chains.iter().flatten().map(|item| item.key(phase.name)).peekable();
            let missing = if keys.peek().is_none() {
                Some(phase.name.to_owned())
            } else {
                keys.find(|k| self.store().record(k).is_none())
            };
            if let Some(key) = missing {
                let hint = format!("run `strandflow run {}` to its end", self.root().display());
                return Err(EngineError::input(format!("stage {stage}"), format!("`{key}` is not done"), hint));
            }
        }
        Ok(())
    }
}

fn stage_of(key: &str) -> &str {
    key.split('/').next().unwrap_or(key)
}
