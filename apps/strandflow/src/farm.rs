//! `strandflow run --engine slurm|script`: the work sent to other machines, waited for, cancelled.

use std::{
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

use strandflow_engine::{
    Plan, RunOptions, Take,
    farm::{
        Array, Durations, Ledger, Sizes, Work, arrays,
        slurm::{self, SlurmOptions},
        template::{TEMPLATES, render},
    },
    run::prepare_from,
    status::{Look, State, states},
    take::TASK_OUTPUT,
};

use crate::{
    args::{Engine, FarmArgs, RunArgs},
    failure::Failed,
    run::stop_on_ctrl_c,
    stdout::print,
};

/// Time between two looks at the queue.
const LOOK_EVERY: Duration = Duration::from_secs(2);

/// Time that cancelled tasks have to end; Slurm by itself ends them by force after half a minute.
const ENDS_WITHIN: Duration = Duration::from_secs(90);

/// A run of a take on a farm.
pub struct Farm<'a> {
    args: &'a FarmArgs,
    take: &'a Take,
    plan: &'a Plan,
    options: &'a RunOptions,
    /// Processors of a task.
    threads: usize,
    work: Work,
}

/// What of the arguments is of another engine than the one asked for; taken for a wish that nobody fulfils, it would be run.
pub fn must_fit(args: &RunArgs) -> Result<(), Failed> {
    let FarmArgs { engine, dry_run, wait, cancel, .. } = args.farm;
    let of_slurm = [("--dry-run", dry_run), ("--wait", wait), ("--cancel", cancel)];
    if let Some((option, _)) = of_slurm.iter().find(|(_, given)| *given && engine != Engine::Slurm) {
        return Err(Failed::input(format!("{option} is of Slurm"), "add --engine slurm, or leave it away"));
    }
    if args.items.is_some() && engine != Engine::Local {
        return Err(Failed::input("--items is of a task", "leave it away: the engine chooses the items of its tasks"));
    }
    Ok(())
}

/// Sends the stages of `options` to other machines.
pub fn farm(args: &RunArgs, take: &Take, plan: &Plan, options: &RunOptions) -> Result<(), Failed> {
    // What a task may use is reserved for it, so one core is asked for where nothing is said.
    let threads = args.threads.unwrap_or(1);
    let work = Work::new(take.root(), plan, threads)?;
    let farm = Farm { args: &args.farm, take, plan, options, threads, work };
    match args.farm.engine {
        Engine::Script => farm.script(),
        Engine::Slurm if args.farm.dry_run => Ok(print(&slurm::as_text(&farm.arrays()?, &farm.work, &farm.slurm()))?),
        Engine::Slurm if args.farm.cancel => farm.cancel(),
        Engine::Slurm | Engine::Local => farm.submit_and_wait(&farm.slurm()),
    }
}

impl Farm<'_> {
    fn arrays(&self) -> Result<Vec<Array>, Failed> {
        let (task_secs, max_tasks) = (self.args.task_secs, self.args.max_tasks as usize);
        let on_slurm = self.args.engine == Engine::Slurm;
        let at_once = on_slurm.then(|| slurm::at_once(&self.slurm())).flatten();
        let sizes = Sizes { task_secs, max_tasks, at_once, in_order: on_slurm };
        let durations = Durations::of_take(self.take.root());
        Ok(arrays(self.take, self.plan, self.options.phases.clone(), sizes, &durations)?)
    }

    fn slurm(&self) -> SlurmOptions {
        let FarmArgs { partition, account, time, memory, slurm_option, throttle, retries, .. } = self.args;
        let named = [("partition", partition), ("account", account), ("time", time), ("mem", memory)];
        let named = named.into_iter().filter_map(|(name, value)| Some(format!("--{name}={}", value.as_ref()?)));
        SlurmOptions {
            throttle: throttle.map(|n| n as usize),
            processors: self.threads,
            retries: *retries as usize,
            more: named.chain(slurm_option.iter().cloned()).collect(),
        }
    }

    fn script(&self) -> Result<(), Failed> {
        let names = TEMPLATES.map(|(name, _)| name).join(", ");
        let Some(asked) = &self.args.template else {
            return Err(Failed::input("--engine script needs a template", format!("--template {names}, or a file")));
        };
        let known = TEMPLATES.iter().find(|(name, _)| Path::new(name) == asked).map(|(_, text)| (*text).to_owned());
        let text = known.map_or_else(|| std::fs::read_to_string(asked), Ok).map_err(|error| {
            let hint = format!("give a file, or one of {names}");
            Failed::input(format!("{}: {error}", asked.display()), hint)
        })?;
        prepare_from(0, self.take, self.plan)?;
        self.take.write_resolved(self.plan)?;
        Ok(print(&render(&asked.to_string_lossy(), &text, &self.arrays()?, &self.work)?)?)
    }

    /// Cancels all, and waits for the tasks at work: until they have ended, they write, and another run is refused.
    fn cancel(&self) -> Result<(), Failed> {
        let ledger = Ledger::of_take(self.take.root())?;
        let queued = slurm::queue(&ledger)?.len();
        slurm::cancel(&ledger)?;
        eprintln!("{queued} tasks cancelled; what is done stays");
        let end = Instant::now() + ENDS_WITHIN;
        loop {
            let left = slurm::queue(&ledger)?;
            let Some(task) = left.first() else { return Ok(()) };
            if Instant::now() > end {
                let error = format!("{} of them have not ended, the first on node `{}`", left.len(), task.node);
                let hint = "`squeue` says in what state they are; the take is free for another run once they are gone";
                return Err(Failed { error, hint: hint.into(), input: false });
            }
            std::thread::sleep(Duration::from_millis(200));
        }
    }

    /// Submits what is to be done; where it is waited for, also what failed, as long as that leads on.
    fn submit_and_wait(&self, slurm: &SlurmOptions) -> Result<(), Failed> {
        self.must_be_idle()?;
        self.take.store().sweep();
        let stop = stop_on_ctrl_c();
        let mut left = usize::MAX;
        for _ in 0..=self.args.retries {
            let arrays = self.arrays()?;
            if arrays.is_empty() {
                eprintln!("all is done");
                return Ok(());
            }
            self.take.write_resolved(self.plan)?;
            prepare_from(0, self.take, self.plan)?;
            let ledger = slurm::submit(self.take, &arrays, &self.work, slurm)?;
            let tasks: usize = arrays.iter().map(|array| array.tasks.len()).sum();
            let phases: usize = arrays.iter().map(|array| array.phases.len()).sum();
            eprintln!("{tasks} tasks of {phases} phases submitted; `strandflow status` tells of them");
            if !self.args.wait {
                return Ok(());
            }
            self.wait(&ledger, &stop)?;
            let before = left;
            left = self.unfinished()?.count;
            // Tasks that were killed may have left files half written.
            self.take.store().sweep();
            if left == 0 || left >= before {
                break;
            }
        }
        self.conclude()
    }

    fn must_be_idle(&self) -> Result<(), Failed> {
        let queued = slurm::queue(&Ledger::of_take(self.take.root())?)?.len();
        if queued == 0 {
            return Ok(());
        }
        let hint = "wait for them (`strandflow status` tells of them), or cancel them: --engine slurm --cancel";
        Err(Failed::input(format!("{queued} tasks of this take are waiting or running"), hint))
    }

    /// Looks at the queue until none of the jobs is in it.
    fn wait(&self, ledger: &Ledger, stop: &AtomicBool) -> Result<(), Failed> {
        let mut told = String::new();
        loop {
            if stop.load(Ordering::Relaxed) {
                let hint =
                    "the jobs go on; `strandflow status` tells of them, `--engine slurm --cancel` ends them".into();
                return Err(Failed { error: "no longer waiting".into(), hint, input: false });
            }
            let queue = slurm::queue(ledger)?;
            if queue.is_empty() {
                return Ok(());
            }
            let (running, waiting): (Vec<_>, Vec<_>) = queue.iter().partition(|task| task.runs);
            let phase = running.first().and_then(|task| ledger.jobs.iter().find(|job| job.job == task.job));
            let phase = phase.and_then(|job| job.phases.first()).map_or("-", String::as_str);
            let now = format!("{phase:<16} {} running, {} waiting", running.len(), waiting.len());
            if now != told {
                eprintln!("{now}");
                told = now;
            }
            std::thread::sleep(LOOK_EVERY);
        }
    }

    fn conclude(&self) -> Result<(), Failed> {
        let Unfinished { count, first } = self.unfinished()?;
        if count == 0 {
            return Ok(());
        }
        let hint = format!(
            "`strandflow status` says what; output of tasks is in {}",
            self.take.root().join(TASK_OUTPUT).display()
        );
        match first {
            Some(failure) => Err(Failed {
                error: format!("{}\n  {count} items are not done", failure.error),
                hint: failure.hint,
                input: failure.input,
            }),
            None => Err(Failed { error: format!("{count} items are not done"), hint, input: false }),
        }
    }

    fn unfinished(&self) -> Result<Unfinished, Failed> {
        let mut found = Unfinished::default();
        let phases = states(self.take, self.plan, self.options.phases.end, Look::Records)?;
        for phase in &phases[self.options.phases.start..] {
            let states: Vec<&State> = phase.chains.iter().flatten().collect();
            found.count +=
                states.iter().filter(|state| ***state != State::Done).count() + usize::from(states.is_empty());
            let failure =
                states.iter().find_map(|state| if let State::Failed(failure) = state { Some(failure) } else { None });
            found.first = found.first.or_else(|| failure.cloned());
        }
        Ok(found)
    }
}

/// What is not done.
#[derive(Default)]
struct Unfinished {
    count: usize,
    first: Option<strandflow_engine::store::Failure>,
}
