//! One work item: whether it has to be done, doing it, and what it rests on made again where that is damaged.

use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{Mutex, PoisonError, atomic::Ordering},
    time::Instant,
};

use strandflow_core::{Finding, Place, Report};

use super::{Found, Runner, log::unix_secs};
use crate::{
    EngineError,
    events::{Event, Outcome},
    item::{BLOCK_STRANDS, Item, Kind},
    memory, node,
    store::{Failure, Record, Writer},
    table::{Inputs, Phase, Stage, item_of, phases},
};

/// What became of one item.
struct Settled {
    outcome: Outcome,
    findings: Vec<Finding>,
    failure: Option<Failure>,
}

impl Runner<'_> {
    /// Settles an item, and tells of it.
    pub(super) fn item(&self, stage: &Stage, phase: &'static Phase, item: Item, found: &Mutex<Found>) {
        let key = item.key(phase.name);
        let settled = self.told(phase, (item, &key), || self.settle(stage, phase, item, &key));
        let mut found = found.lock().unwrap_or_else(PoisonError::into_inner);
        settled.findings.iter().for_each(|finding| found.kinds.add(finding));
        let found = &mut found.summary;
        match settled.outcome {
            Outcome::Done => found.done += 1,
            Outcome::Fresh => found.fresh += 1,
            Outcome::Failed => found.failed += 1,
            Outcome::Blocked => found.blocked += 1,
        }
        found.findings += settled.findings.len();
        if let (Outcome::Failed, Some(failure)) = (settled.outcome, settled.failure) {
            found.failures.push((key, failure));
        }
    }

    /// Does something for an item, and writes down when, where and what became of it.
    fn told(&self, phase: &'static Phase, (item, key): (Item, &str), act: impl FnOnce() -> Settled) -> Settled {
        let (began, start) = (Instant::now(), unix_secs());
        let settled = act();
        let was_done = settled.outcome != Outcome::Fresh;
        let event = Event::Item {
            phase: phase.name,
            item: key.to_owned(),
            place: self.place(item),
            outcome: settled.outcome,
            secs: began.elapsed().as_secs_f64(),
            start,
            node: node::node(),
            peak_mb: was_done.then(memory::peak_mb).flatten(),
            findings: settled.findings.clone(),
            failure: settled.failure.clone(),
        };
        if was_done {
            self.log.write(&event);
        }
        (self.audience)(&event);
        settled
    }

    /// Decides whether the item has to be done, and does it.
    fn settle(&self, stage: &Stage, phase: &'static Phase, item: Item, key: &str) -> Settled {
        let store = self.job.take.store();
        let inputs = match self.inputs(stage, phase, item) {
            Ok(inputs) => inputs,
            Err(error @ (EngineError::Missing { .. } | EngineError::Store { .. })) => return blocked(&error),
            Err(error) => return self.refused(key, &error),
        };
        let record = match store.finished(key) {
            Ok(record) => record,
            Err(error) => return self.refused(key, &error),
        };
        let mut damage = None;
        if let Some(record) = record.as_ref().filter(|record| record.inputs == inputs.hashes) {
            damage = self.options.verify.then(|| store.damage(key)).flatten();
            if damage.is_none() {
                // Where even this is refused, the next run does it.
                let _ = store.forgive(key);
                return Settled { outcome: Outcome::Fresh, findings: record.findings.clone(), failure: None };
            }
        }
        // A record that was not there another process may have written by now, and it is not to go.
        if let Err(error) = if record.is_some() { store.forget(key) } else { store.forgive(key) } {
            return self.failed(key, &error);
        }
        let found = damage.map(|damage| damaged(self.place_of(item), &damage));
        match self.make(stage, phase, item, key, &inputs) {
            Ok(record) => {
                let findings = found.into_iter().chain(record.findings).collect();
                Settled { outcome: Outcome::Done, findings, failure: None }
            }
            // It was there a moment ago: another process makes it again.
            Err(error @ EngineError::Missing { .. }) => blocked(&error),
            Err(error) => self.failed(key, &error),
        }
    }

    /// What an item rests on. Where that cannot be read, what is damaged is made again first.
    fn inputs(&self, stage: &Stage, phase: &'static Phase, item: Item) -> Result<Inputs, EngineError> {
        let before = self.mended.load(Ordering::Relaxed);
        let stated = stage.inputs(phase, &self.job, item);
        if !matches!(stated, Err(EngineError::Store { .. })) {
            return stated;
        }
        // Of frames, views and blocks the hashes alone are read; of what the whole take shares, values.
        let needed = phases().filter(|(_, other)| phase.others.contains(&other.name) && other.kind == Kind::Take);
        let keys: Vec<String> = needed.map(|(_, other)| Item::Take.key(other.name)).collect();
        if self.mend(&keys, before) { stage.inputs(phase, &self.job, item) } else { stated }
    }

    /// Makes an item; where what it reads is damaged, makes that again first.
    fn make(
        &self,
        stage: &Stage,
        phase: &Phase,
        item: Item,
        key: &str,
        inputs: &Inputs,
    ) -> Result<Record, EngineError> {
        let attempt = || {
            let mut report = Report::default();
            let mut writer = Writer::new(self.job.take.store());
            let mut run = || self.pool.install(|| (phase.run)(&self.job, item, &mut writer, &mut report));
            catch_unwind(AssertUnwindSafe(&mut run))
                .unwrap_or_else(|panic| Err(panicked(stage.name, panic.as_ref())))?;
            writer.finish(key, inputs.hashes.clone(), report.findings)
        };
        let before = self.mended.load(Ordering::Relaxed);
        let made = attempt();
        if matches!(made, Err(EngineError::Store { .. })) && self.mend(&inputs.items, before) {
            return attempt();
        }
        made
    }

    /// Makes those finished items again whose files are not as they were written; whether there were any, or another thread has
    /// mended one since there were `before`, and all are whole now. Their records stay meanwhile: they hold for what is made
    /// again, and others read by them.
    fn mend(&self, keys: &[String], before: usize) -> bool {
        let store = self.job.take.store();
        let damaged_of = |key: &String| Some((key.clone(), store.damage(key)?));
        let broken: Vec<_> = keys.iter().filter_map(damaged_of).collect();
        let whole = broken.iter().all(|(key, damage)| self.mend_one(key, damage));
        whole && self.mended.load(Ordering::Relaxed) > before
    }

    fn mend_one(&self, key: &str, damage: &str) -> bool {
        let Ok((stage, phase, item)) = item_of(key, &self.job) else { return false };
        let settled = self.told(phase, (item, key), || {
            let finding = damaged(self.place_of(item), damage);
            let made = self.inputs(stage, phase, item);
            match made.and_then(|inputs| self.make(stage, phase, item, key, &inputs)) {
                Ok(_) => Settled { outcome: Outcome::Done, findings: vec![finding], failure: None },
                Err(error) => self.failed(key, &error),
            }
        });
        let done = settled.outcome == Outcome::Done;
        self.mended.fetch_add(usize::from(done), Ordering::Relaxed);
        done
    }

    /// What an item rests on could not be looked at: a result that it may have stays, for when it can.
    fn refused(&self, key: &str, error: &EngineError) -> Settled {
        let failure = failure_of(error);
        // Where even this cannot be written, the summary still has it.
        let _ = self.job.take.store().write_failure(key, &failure);
        Settled { outcome: Outcome::Failed, findings: Vec::new(), failure: Some(failure) }
    }

    fn failed(&self, key: &str, error: &EngineError) -> Settled {
        let failure = failure_of(error);
        let store = self.job.take.store();
        // Where even this cannot be written, the summary still has it.
        let _ = store.forget(key).and_then(|()| store.write_failure(key, &failure));
        Settled { outcome: Outcome::Failed, findings: Vec::new(), failure: Some(failure) }
    }

    fn place(&self, item: Item) -> String {
        match item {
            Item::Block(block) => format!("strands from {}", block * BLOCK_STRANDS),
            _ => self.place_of(item).to_string(),
        }
    }

    fn place_of(&self, item: Item) -> Place {
        let cameras = &self.job.take.rig().cameras;
        match item {
            Item::Take => Place::default(),
            Item::Frame(frame) => Place::frame(frame),
            Item::ViewFrame(view, frame) => Place::view_frame(&cameras[view].name, frame),
            Item::Block(block) => Place { strand: Some(block * BLOCK_STRANDS), ..Place::default() },
        }
    }
}

fn blocked(error: &EngineError) -> Settled {
    Settled { outcome: Outcome::Blocked, findings: Vec::new(), failure: Some(failure_of(error)) }
}

fn damaged(place: Place, damage: &str) -> Finding {
    Finding { place, fact: damage.to_owned(), consequence: "made again".to_owned() }
}

fn failure_of(error: &EngineError) -> Failure {
    Failure { error: error.to_string(), hint: error.hint(), input: error.is_input() }
}

fn panicked(stage: &str, panic: &(dyn std::any::Any + Send)) -> EngineError {
    let text = panic.downcast_ref::<&str>().map(|s| (*s).to_owned());
    let text = text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
    EngineError::Store { array: stage.to_owned(), fact: format!("the stage stopped unexpectedly: {text}") }
}
