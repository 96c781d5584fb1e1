//! Which tasks there are, how many items each has, and what it waits for.

use std::{collections::BTreeSet, ops::Range};

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
    /// How many tasks can run at once, where that is known.
    pub at_once: Option<usize>,
    /// Whether the scheduler can run the tasks of an array in their order, one at a time.
    pub in_order: bool,
}

impl Sizes {
    /// Tasks for work of so many seconds. Where it is known how many run at once, so many that none of them is left without one
    /// while the others do their last; tasks of half the length are better than machines with nothing to do.
    fn tasks(&self, secs: f64) -> usize {
        let of = |task_secs: f64| (secs / task_secs) as usize;
        let lasting = of(self.task_secs);
        match self.at_once {
            Some(at_once) if at_once > 0 && lasting >= at_once => lasting - lasting % at_once,
            Some(at_once) => at_once.min(of(self.task_secs / 2.0)).max(lasting),
            None => lasting,
        }
    }
}

/// The tasks of some phases that one task does one after the other; of one phase as a rule.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// `stage/phase`, in order.
    pub phases: Vec<&'static str>,
    /// Parts ([`Kind::parts`]) of the phase with the most; of strands, which are not counted before the scalp is there, as many as
    /// there can be.
    pub parts: usize,
    /// Parts of a task: task n does those from n times as many on.
    pub per_task: usize,
    /// Tasks that have something to do.
    pub tasks: Vec<usize>,
    /// Whether they have to run one at a time in their order: each goes on where the one before ends.
    pub in_order: bool,
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

    /// How many tasks cover all parts.
    pub fn task_count(&self) -> usize {
        self.parts.div_ceil(self.per_task)
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

fn arrays_of(rows: Vec<Row>, sizes: Sizes) -> Vec<Array> {
    let mut groups = fused(rows);
    size(&mut groups, sizes);
    let groups = with_short_ones_joined(groups, sizes.task_secs);
    (0..groups.len()).map(|at| array_of(&groups[at], &groups[..at])).collect()
}

/// Phases of which part n reads part n of the one before, in one task: it starts once and waits once, and no machine waits for the
/// others between them.
fn fused(rows: Vec<Row>) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    for row in rows {
        match groups.last_mut() {
            Some(group) if group.takes(&row) => group.rows.push(row),
            _ => groups.push(Group { rows: vec![row], per_task: 1 }),
        }
    }
    groups
}

/// What runs in order is cut into so many tasks at least, short as they may be: other machines do what follows of one while the next
/// runs.
const STRETCHES: usize = 4;

/// Chooses how many parts a task has: as many as last long enough, spread evenly; of what goes on from one that runs in order, as
/// many as that has.
fn size(groups: &mut [Group], sizes: Sizes) {
    for at in 0..groups.len() {
        let (before, group) = (at.checked_sub(1).map(|before| &groups[before]), &groups[at]);
        let followed = before.filter(|before| before.is_in_order() && sizes.in_order && group.goes_on_from(before));
        groups[at].per_task = followed.map_or_else(|| group.own_size(sizes), |before| before.per_task);
    }
}

/// Groups of one task each that together last no longer than a task has to: a job for each would cost more than it does.
fn with_short_ones_joined(groups: Vec<Group>, task_secs: f64) -> Vec<Group> {
    let mut joined: Vec<Group> = Vec::new();
    for group in groups {
        let is_short = |group: &Group| group.per_task == group.parts();
        match joined.last_mut() {
            Some(last) if is_short(last) && is_short(&group) && last.secs() + group.secs() <= task_secs => {
                last.rows.extend(group.rows);
                last.per_task = last.parts();
            }
            _ => joined.push(group),
        }
    }
    joined
}

fn array_of(group: &Group, before: &[Group]) -> Array {
    // Tasks that run in order wait for all: were one of those before put back into the queue, a later one would come first.
    let after = |(at, other): (usize, &Group)| {
        let nearest = at + 1 == before.len() && !group.is_in_order();
        let corresponding = nearest && group.goes_on_from(other) && other.tasks() == group.tasks();
        After { phase: other.rows[0].phase.name, corresponding }
    };
    let after = before.iter().enumerate().filter(|(_, other)| group.reads(other)).map(after).collect();
    Array {
        phases: group.rows.iter().map(|row| row.phase.name).collect(),
        parts: group.parts(),
        per_task: group.per_task,
        tasks: group.tasks().into_iter().collect(),
        in_order: group.is_in_order() && group.tasks().len() > 1,
        after,
    }
}

fn is_done<'a>(mut states: impl Iterator<Item = &'a State>) -> bool {
    states.all(|state| *state == State::Done)
}

/// A phase that has something left to do.
struct Row {
    phase: &'static Phase,
    /// Whether something is left to do, part by part.
    pending: Vec<bool>,
    /// Seconds of the longest part.
    part_secs: f64,
}

impl Row {
    /// `None` where nothing is left to do.
    fn of(phase: &'static Phase, states: &PhaseStates, at_least: usize, item_secs: f64) -> Option<Self> {
        let parts = phase.kind.parts(&states.chains);
        let mut pending: Vec<bool> = parts.iter().map(|part| !is_done(part.iter())).collect();
        pending.resize(pending.len().max(at_least), true);
        let longest = parts.iter().map(|part| part.len()).max().unwrap_or(1);
        let row = Self { phase, pending, part_secs: longest as f64 * item_secs };
        row.pending.contains(&true).then_some(row)
    }

    fn reads(&self, other: &Self) -> bool {
        self.phase.same.contains(&other.phase.name) || self.phase.others.contains(&other.phase.name)
    }
}

/// Phases that share their tasks: an array in the making.
struct Group {
    rows: Vec<Row>,
    per_task: usize,
}

impl Group {
    fn parts(&self) -> usize {
        self.rows.iter().map(|row| row.pending.len()).max().unwrap_or(1)
    }

    /// Seconds of a part of all phases.
    fn part_secs(&self) -> f64 {
        self.rows.iter().map(|row| row.part_secs).sum()
    }

    /// Seconds of all that is to be done.
    fn secs(&self) -> f64 {
        let of_row = |row: &Row| row.pending.iter().filter(|pending| **pending).count() as f64 * row.part_secs;
        self.rows.iter().map(of_row).sum()
    }

    fn tasks(&self) -> BTreeSet<usize> {
        let of_row = |row: &Row| {
            let tasks = row.pending.chunks(self.per_task).enumerate();
            tasks.filter(|(_, pending)| pending.contains(&true)).map(|(task, _)| task).collect::<Vec<_>>()
        };
        self.rows.iter().flat_map(of_row).collect()
    }

    fn is_in_order(&self) -> bool {
        self.rows.iter().any(|row| row.phase.kind == Kind::FrameChained)
    }

    /// Parts of a task, by how long they last.
    fn own_size(&self, sizes: Sizes) -> usize {
        let parts = self.parts();
        let tasks = match (self.is_in_order(), sizes.tasks(parts as f64 * self.part_secs())) {
            (false, tasks) => tasks,
            (true, tasks) if sizes.in_order => tasks.max(STRETCHES),
            (true, _) => 1,
        };
        parts.div_ceil(tasks.clamp(1, sizes.max_tasks.clamp(1, parts)))
    }

    fn reads(&self, other: &Self) -> bool {
        self.rows.iter().any(|row| other.rows.iter().any(|other| row.reads(other)))
    }

    /// Whether one task can do a part of these phases and of one more.
    fn takes(&self, row: &Row) -> bool {
        let Some(last) = self.rows.last() else { return false };
        let reads_no_other = self.rows.iter().all(|other| !row.reads(other) || row.phase.follows(other.phase));
        let alike = last.phase.kind == row.phase.kind && last.pending.len() == row.pending.len();
        alike && row.phase.follows(last.phase) && reads_no_other
    }

    /// Whether task n can begin where task n of the group before ends.
    fn goes_on_from(&self, before: &Self) -> bool {
        let of_row = |row: &Row| {
            let read = before.rows.iter().filter(|other| row.reads(other));
            { read }.all(|other| row.phase.follows(other.phase) && row.pending.len() == other.pending.len())
        };
        self.reads(before) && self.rows.iter().all(of_row)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(name: &str, pending: &[bool], secs: f64) -> Row {
        let phase = phases().find(|(_, phase)| phase.name == name).unwrap().1;
        Row { phase, pending: pending.to_vec(), part_secs: secs }
    }

    fn sized(rows: Vec<Row>, task_secs: f64, max_tasks: usize) -> Vec<Array> {
        arrays_of(rows, Sizes { task_secs, max_tasks, at_once: None, in_order: true })
    }

    #[test]
    fn phases_of_which_one_reads_the_same_frame_of_the_other_share_tasks() {
        let all = [true; 60];
        let frames = ["lift/lift", "field/field", "field/motion"].map(|name| row(name, &all, 1.0));
        let arrays = sized(frames.into(), 30.0, 1000);
        assert_eq!(arrays.len(), 1);
        assert_eq!(arrays[0].phases, ["lift/lift", "field/field", "field/motion"]);
        assert_eq!((arrays[0].per_task, &arrays[0].tasks[..]), (10, &[0, 1, 2, 3, 4, 5][..]));
        let arrays = sized(vec![row("flow/flow", &all, 40.0), row("blend/blend", &all, 40.0)], 30.0, 7);
        assert_eq!((arrays[0].per_task, arrays[0].task_count()), (9, 7));
        assert_eq!(arrays[1].after, [After { phase: "flow/flow", corresponding: false }], "it reads frames around");
    }

    #[test]
    fn what_follows_from_frame_to_frame_runs_in_order_beside_what_is_before_and_after_it() {
        let all = [true; 60];
        let rows = || {
            [("field/field", 2.0), ("field/motion", 3.0), ("grow/grow", 2.0), ("prune/prune", 1.5)]
                .map(|(name, secs)| row(name, &all, secs))
                .into()
        };
        let arrays = sized(rows(), 30.0, 1000);
        assert_eq!(
            arrays.iter().map(|array| (array.per_task, array.in_order)).collect::<Vec<_>>(),
            [(6, false), (15, true), (15, false)]
        );
        assert_eq!(arrays[1].after, [After { phase: "field/field", corresponding: false }]);
        assert_eq!(arrays[2].after, [After { phase: "grow/grow", corresponding: true }]);
        let arrays = arrays_of(rows(), Sizes { task_secs: 30.0, max_tasks: 1000, at_once: None, in_order: false });
        assert_eq!((arrays[1].per_task, arrays[1].task_count(), arrays[1].in_order), (60, 1, false));
        assert_eq!((arrays[0].per_task, arrays[2].per_task), (6, 20));
        assert_eq!(arrays[2].after, [After { phase: "grow/grow", corresponding: false }]);
    }

    #[test]
    fn what_takes_much_longer_is_not_crowded_into_few_tasks() {
        let all = [true; 80];
        let arrays = sized(vec![row("field/motion", &all, 20.0), row("grow/grow", &all, 1.0)], 30.0, 1000);
        assert_eq!((arrays[0].task_count(), arrays[1].task_count()), (40, 4));
        assert_eq!(arrays[1].after, [After { phase: "field/motion", corresponding: false }]);
    }

    #[test]
    fn tasks_last_long_enough_and_share_evenly() {
        let arrays = sized(vec![row("lift/lift", &[true; 60], 1.75)], 30.0, 1000);
        assert_eq!((arrays[0].per_task, arrays[0].task_count()), (20, 3), "105 s are three tasks of 35 s");
    }

    #[test]
    fn tasks_are_as_many_as_run_at_once_or_a_multiple() {
        let tasks = |at_once| {
            let sizes = Sizes { task_secs: 30.0, max_tasks: 1000, at_once, in_order: true };
            arrays_of(vec![row("lift/lift", &[true; 60], 2.8)], sizes)[0].task_count()
        };
        assert_eq!([None, Some(2), Some(4), Some(5), Some(0)].map(tasks), [5, 4, 4, 5, 5]);
        assert_eq!([Some(9), Some(90)].map(tasks), [9, 10], "168 s are eleven tasks of half the length");
    }

    #[test]
    fn what_is_done_is_no_task_and_tasks_of_other_numbers_wait_for_all() {
        let mut some = [false; 8];
        some[5] = true;
        let arrays = sized(vec![row("grow/grow", &some, 40.0), row("prune/prune", &[true; 8], 40.0)], 30.0, 1000);
        assert_eq!(arrays[0].tasks, [5]);
        assert_eq!(arrays[1].after, [After { phase: "grow/grow", corresponding: false }]);
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
