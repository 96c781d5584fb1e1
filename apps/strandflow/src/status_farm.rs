//! What the queue of a farm and the logs of its tasks add to the state of a take.

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt,
};

use serde::Serialize;
use serde_json::Value;
use strandflow_engine::{
    Take,
    farm::{
        Ledger, Submitted,
        script::name_of,
        slurm::{QueuedTask, queue},
    },
    run::log_lines,
    status::{PhaseStates, State},
    take::TASK_OUTPUT,
};

/// The tasks of one phase.
#[derive(Debug, Default, PartialEq, Serialize)]
pub struct Tasks {
    /// How many wait, by why.
    pub waiting: BTreeMap<String, usize>,
    /// How many run, by where.
    pub running: BTreeMap<String, usize>,
    /// Output of those that ended and left items undone.
    pub ended: Vec<String>,
    /// How many items failed last, by where.
    pub failed_on: BTreeMap<String, usize>,
}

impl fmt::Display for Tasks {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let counted = |counts: &BTreeMap<String, usize>| {
            counts.iter().map(|(what, count)| format!("{count}× {what}")).collect::<Vec<_>>().join(", ")
        };
        let mut parts = Vec::new();
        for (what, counts) in
            [("waiting", &self.waiting), ("running on", &self.running), ("failed on", &self.failed_on)]
        {
            if !counts.is_empty() {
                parts.push(format!("{what} {}", counted(counts)));
            }
        }
        if let Some(first) = self.ended.first() {
            parts.push(format!("{} ended undone ({first})", self.ended.len()));
        }
        write!(f, "tasks: {}", parts.join("; "))
    }
}

/// Tasks by phase; phases without are left out. Nothing where nothing was submitted.
pub fn tasks_of(take: &Take, states: &[PhaseStates]) -> BTreeMap<&'static str, Tasks> {
    let told = |error| eprintln!("warning: the queue is not known: {error}");
    let ledger = Ledger::of_take(take.root()).map_err(told).unwrap_or_default();
    if ledger.jobs.is_empty() {
        return BTreeMap::new();
    }
    let queued = queue(&ledger).map_err(told).ok();
    let failed = failed_on(take);
    let of_phase = |phase: &PhaseStates| {
        let job = ledger.jobs.iter().rfind(|job| job.phases.iter().any(|name| name == phase.phase))?;
        let failed_on = if count_failed(phase) > 0 {
            failed.get(phase.phase).cloned().unwrap_or_default()
        } else {
            BTreeMap::new()
        };
        let tasks = Tasks { failed_on, ..queued.as_ref().map(|queued| of_job(job, phase, queued)).unwrap_or_default() };
        (tasks != Tasks::default()).then_some((phase.phase, tasks))
    };
    states.iter().filter_map(of_phase).collect()
}

fn count_failed(phase: &PhaseStates) -> usize {
    phase.chains.iter().flatten().filter(|state| matches!(state, State::Failed(_))).count()
}

fn of_job(job: &Submitted, phase: &PhaseStates, queued: &[QueuedTask]) -> Tasks {
    let mut tasks = Tasks::default();
    let ours = || queued.iter().filter(|task| task.job == job.job);
    for task in ours() {
        let counts = if task.runs { &mut tasks.running } else { &mut tasks.waiting };
        *counts.entry(if task.runs { task.node.clone() } else { task.reason.clone() }).or_default() += 1;
    }
    let there: BTreeSet<usize> = ours().map(|task| task.task).collect();
    let parts = phase.kind.parts(&phase.chains);
    let undone = |task: &&usize| {
        let parts = parts.iter().skip(**task * job.per_task).take(job.per_task);
        parts.copied().flatten().any(|state| matches!(state, State::Missing | State::Stale(_)))
    };
    let ended = job.tasks.iter().filter(|task| !there.contains(task)).filter(undone);
    let output = |task: &usize| {
        format!("{TASK_OUTPUT}/{}.{}.{task}.txt", name_of(job.phases.first().map_or("", String::as_str)), job.job)
    };
    tasks.ended = ended.map(output).collect();
    tasks
}

/// Where items failed last, by phase.
fn failed_on(take: &Take) -> BTreeMap<String, BTreeMap<String, usize>> {
    let mut last: BTreeMap<(String, String), (f64, bool, String)> = BTreeMap::new();
    for event in log_lines(take.root()).filter_map(|line| serde_json::from_str::<Value>(&line).ok()) {
        let text = |field: &str| event[field].as_str().unwrap_or_default().to_owned();
        let (time, node) = (event["unix_secs"].as_f64().unwrap_or(0.0), text("node"));
        let newest = last.entry((text("phase"), text("item"))).or_insert((f64::NEG_INFINITY, false, String::new()));
        if event["event"] == "item" && time >= newest.0 {
            *newest = (time, event["outcome"] == "failed", node);
        }
    }
    let mut counts: BTreeMap<String, BTreeMap<String, usize>> = BTreeMap::new();
    for ((phase, _), (_, _, node)) in last.into_iter().filter(|(_, (_, failed, _))| *failed) {
        *counts.entry(phase).or_default().entry(node).or_default() += 1;
    }
    counts
}

#[cfg(test)]
mod tests {
    use strandflow_engine::Kind;

    use super::*;

    #[test]
    fn tasks_are_told_by_state_and_place() {
        let job = Submitted { job: 7, phases: vec!["lift/lift".into()], per_task: 2, tasks: vec![0, 1, 2, 3] };
        let task = |task, runs, node: &str| QueuedTask {
            job: 7,
            task,
            runs,
            node: node.into(),
            reason: if runs { "None".into() } else { "Resources".into() },
        };
        let chains =
            [State::Done, State::Done, State::Missing, State::Done, State::Missing, State::Missing, State::Missing];
        let phase =
            PhaseStates { phase: "lift/lift", kind: Kind::Frame, chains: chains.map(|state| vec![state]).to_vec() };
        let tasks = of_job(&job, &phase, &[task(2, true, "n2"), task(3, false, "")]);
        assert_eq!(
            tasks.to_string(),
            "tasks: waiting 1× Resources; running on 1× n2; 1 ended undone (farm/output/lift.lift.7.1.txt)"
        );
    }
}
