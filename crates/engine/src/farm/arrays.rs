//! Which tasks there are, how many items each has, and what it waits for.

use std::ops::Range;

use crate::{
    EngineError, Plan, Take,
    farm::Durations,
    item::{BLOCK_STRANDS, Kind},
    status::{Look, PhaseStates, State, states},
    table::{Phase, phases},
};

/// How long tasks are to be.
#[derive(Clone, Copy, Debug)]
pub struct Sizes {
    /// Seconds that a task lasts at least, where there is so much to do.
    pub task_secs: f64,
    /// The most tasks of one array.
    pub max_tasks: usize,
}

/// The tasks of one phase, or the one task of several that are short.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// `stage/phase`, in order.
    pub phases: Vec<&'static str>,
    /// Chains of the phase with the most; of strands, which are not counted before the scalp is there, as many as there can be.
    pub chains: usize,
    /// Chains of a task: task n does those from n times as many on.
    pub per_task: usize,
    /// Tasks that have something to do.
    pub tasks: Vec<usize>,
    /// What they wait for.
    pub after: Vec<After>,
}

/// An array that another waits for.
#[derive(Clone, Debug, PartialEq)]
pub struct After {
    /// Its first phase.
    pub phase: &'static str,
    /// Whether each task waits for the task of its own number alone.
    pub corresponding: bool,
}

impl Array {
    /// The first of its phases, by which it is called.
    pub fn phase(&self) -> &'static str {
        self.phases.first().copied().unwrap_or_default()
    }

    /// How many tasks cover all chains.
    pub fn task_count(&self) -> usize {
        self.chains.div_ceil(self.per_task)
    }
}

/// The arrays of some phases (indices into the table), as far as anything is left to do in them.
///
/// # Errors
/// `Disk` where a file of the user cannot be read.
pub fn arrays(
    take: &Take,
    plan: &Plan,
    range: Range<usize>,
    sizes: Sizes,
    durations: &Durations,
) -> Result<Vec<Array>, EngineError> {
    let states = states(take, plan, range.end, Look::Records)?;
    let scalp_is_done =
        states.iter().any(|states| states.phase == "scalp/scalp" && is_done(states.chains.iter().flatten()));
    let blocks = if scalp_is_done { 0 } else { plan.settings.scalp.root_count.div_ceil(BLOCK_STRANDS) };
    let asked = phases().zip(&states).skip(range.start);
    let rows = asked.filter_map(|((_, phase), states)| {
        let at_least = if phase.kind == Kind::Block { blocks } else { 1 };
        let secs = durations.secs(phase, plan.frames.len());
        Row::of(phase, states, at_least, secs)
    });
    Ok(arrays_of(rows.collect(), sizes))
}

fn arrays_of(mut rows: Vec<Row>, sizes: Sizes) -> Vec<Array> {
    Row::size(&mut rows, sizes);
    let mut groups: Vec<Vec<Row>> = Vec::new();
    for row in rows {
        match groups.last_mut() {
            Some(group) if are_short(group, &row, sizes.task_secs) => group.push(row),
            _ => groups.push(vec![row]),
        }
    }
    (0..groups.len()).map(|at| array_of(&groups[at], &groups[..at])).collect()
}

/// Whether phases of one task each last no longer together than a task has to: a job for each would cost more than it does.
fn are_short(group: &[Row], row: &Row, task_secs: f64) -> bool {
    let rows = || group.iter().chain([row]);
    rows().all(|row| row.per_task == row.pending.len()) && rows().map(Row::secs).sum::<f64>() <= task_secs
}

fn array_of(group: &[Row], before: &[Vec<Row>]) -> Array {
    let tasks = group[0].tasks();
    let reads = |row: &Row, other: &Row| {
        row.phase.same.contains(&other.phase.name) || row.phase.others.contains(&other.phase.name)
    };
    let nearest = before.last().map(|group| group[0].phase.name);
    let after = |other: &[Row]| {
        let (first, alone) = (&other[0], other.len() == 1 && group.len() == 1);
        let corresponding =
            alone && nearest == Some(first.phase.name) && group[0].follows(first) && first.tasks() == tasks;
        After { phase: first.phase.name, corresponding }
    };
    let is_read = |other: &&Vec<Row>| group.iter().any(|row| other.iter().any(|other| reads(row, other)));
    let most = |of: fn(&Row) -> usize| group.iter().map(of).max().unwrap_or(1);
    let after = before.iter().filter(is_read).map(|other| after(other)).collect();
    Array {
        phases: group.iter().map(|row| row.phase.name).collect(),
        chains: most(|row| row.pending.len()),
        per_task: most(|row| row.per_task),
        tasks,
        after,
    }
}

fn is_done<'a>(mut states: impl Iterator<Item = &'a State>) -> bool {
    states.all(|state| *state == State::Done)
}

/// Times longer. A block is trimmed in a tenth of the time in which it is fitted: with the same blocks a task, one machine fitted
/// all of them on the take of `docs/farm.md`, in 55 s instead of 31.
const MUCH_LONGER: usize = 2;

/// An array in the making.
struct Row {
    phase: &'static Phase,
    /// Whether something is left to do, chain by chain.
    pending: Vec<bool>,
    /// Seconds of the longest chain.
    chain_secs: f64,
    per_task: usize,
}

impl Row {
    /// `None` where nothing is left to do.
    fn of(phase: &'static Phase, states: &PhaseStates, at_least: usize, item_secs: f64) -> Option<Self> {
        let mut pending: Vec<bool> = states.chains.iter().map(|chain| !is_done(chain.iter())).collect();
        pending.resize(pending.len().max(at_least), true);
        let longest = states.chains.iter().map(Vec::len).max().unwrap_or(1);
        let row = Self { phase, pending, chain_secs: longest as f64 * item_secs, per_task: 1 };
        row.pending.contains(&true).then_some(row)
    }

    /// Whether task n can go on where task n of the array before ends.
    fn follows(&self, before: &Self) -> bool {
        let alike = self.phase.kind == before.phase.kind && self.phase.span == before.phase.span;
        alike && self.phase.same.contains(&before.phase.name) && self.pending.len() == before.pending.len()
    }

    /// Chooses how many chains a task has: as many as last long enough, spread evenly. Arrays of which one follows the other have
    /// the same where that makes no task much longer than it has to be.
    fn size(rows: &mut [Self], sizes: Sizes) {
        for row in &mut *rows {
            let chains = row.pending.len();
            let tasks = (chains as f64 * row.chain_secs / sizes.task_secs) as usize;
            row.per_task = chains.div_ceil(tasks.clamp(1, sizes.max_tasks.clamp(1, chains)));
        }
        let own: Vec<usize> = rows.iter().map(|row| row.per_task).collect();
        let mut first = 0;
        for at in 0..rows.len() {
            let alike = |other: usize| own[at].max(own[other]) < MUCH_LONGER * own[at].min(own[other]);
            if at > 0 && !(rows[at].follows(&rows[at - 1]) && (first..at).all(alike)) {
                first = at;
            }
            let most = own[first..=at].iter().copied().max().unwrap_or(1);
            rows[first..=at].iter_mut().for_each(|row| row.per_task = most);
        }
    }

    fn tasks(&self) -> Vec<usize> {
        let tasks = self.pending.chunks(self.per_task).enumerate();
        tasks.filter(|(_, pending)| pending.contains(&true)).map(|(task, _)| task).collect()
    }

    /// Seconds of all that is to be done.
    fn secs(&self) -> f64 {
        self.pending.iter().filter(|pending| **pending).count() as f64 * self.chain_secs
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(name: &str, pending: &[bool], secs: f64) -> Row {
        let phase = phases().find(|(_, phase)| phase.name == name).unwrap().1;
        Row { phase, pending: pending.to_vec(), chain_secs: secs, per_task: 0 }
    }

    fn sized(rows: Vec<Row>, task_secs: f64, max_tasks: usize) -> Vec<Array> {
        arrays_of(rows, Sizes { task_secs, max_tasks })
    }

    #[test]
    fn short_items_share_a_task_and_tasks_that_follow_one_another_have_the_same() {
        let all = [true; 60];
        let arrays = sized(vec![row("lift/lift", &all, 2.0), row("field/field", &all, 3.0)], 30.0, 1000);
        assert_eq!((arrays[0].per_task, arrays[1].per_task), (15, 15));
        assert_eq!(arrays[1].tasks, [0, 1, 2, 3]);
        assert_eq!(arrays[1].after, [After { phase: "lift/lift", corresponding: true }]);
        let arrays = sized(vec![row("flow/flow", &all, 40.0), row("blend/blend", &all, 40.0)], 30.0, 7);
        assert_eq!((arrays[0].per_task, arrays[0].task_count()), (9, 7));
        assert_eq!(arrays[1].after, [After { phase: "flow/flow", corresponding: false }], "it reads frames around");
    }

    #[test]
    fn what_takes_much_longer_is_not_crowded_into_few_tasks() {
        let all = [true; 8];
        let arrays = sized(vec![row("smooth/trim", &all, 5.0), row("fit/fit", &all, 60.0)], 30.0, 1000);
        assert_eq!((arrays[0].task_count(), arrays[1].task_count()), (1, 8));
        assert_eq!(arrays[1].after, [After { phase: "smooth/trim", corresponding: false }]);
    }

    #[test]
    fn tasks_last_long_enough_and_share_evenly() {
        let arrays = sized(vec![row("lift/lift", &[true; 60], 1.75)], 30.0, 1000);
        assert_eq!((arrays[0].per_task, arrays[0].task_count()), (20, 3), "105 s are three tasks of 35 s");
    }

    #[test]
    fn what_is_done_is_no_task_and_tasks_of_other_numbers_wait_for_all() {
        let mut some = [false; 8];
        some[5] = true;
        let arrays = sized(vec![row("prune/prune", &some, 40.0), row("smooth/frames", &[true; 8], 40.0)], 30.0, 1000);
        assert_eq!(arrays[0].tasks, [5]);
        assert_eq!(arrays[1].after, [After { phase: "prune/prune", corresponding: false }]);
    }

    #[test]
    fn nothing_waits_for_what_it_does_not_read() {
        let arrays = sized(vec![row("hull/hull", &[true; 4], 10.0), row("pose/pose", &[true], 40.0)], 30.0, 1000);
        assert!(arrays[1].after.is_empty());
    }

    #[test]
    fn short_phases_share_one_task() {
        let rows = vec![
            row("masks/masks", &[true; 6], 10.0),
            row("hull/grid", &[true], 1.0),
            row("hull/hull", &[true; 9], 1.0),
            row("pose/pose", &[true], 5.0),
            row("scalp/scalp", &[true], 20.0),
        ];
        let arrays = sized(rows, 30.0, 1000);
        let phases: Vec<_> = arrays.iter().map(|array| array.phases.len()).collect();
        assert_eq!(phases, [1, 3, 1], "the scalp would make it longer than a task has to be");
        assert_eq!((arrays[1].per_task, &arrays[1].tasks[..]), (9, &[0][..]));
        assert_eq!(arrays[1].after, [After { phase: "masks/masks", corresponding: false }]);
        let of_scalp: Vec<_> = arrays[2].after.iter().map(|after| after.phase).collect();
        assert_eq!(of_scalp, ["masks/masks", "hull/grid"], "called by their first phase");
    }
}
