//! Slurm: arrays of jobs, by its own commands; no shell is in between.

use std::{collections::BTreeMap, path::Path, process::Command};

use crate::{
    EngineError, Take,
    farm::{
        Array, Ledger, Submitted, Work,
        script::{name_of, quoted},
    },
    take::{FARM, TASK_OUTPUT},
};

/// What is asked of Slurm beside the work.
#[derive(Clone, Debug, Default)]
pub struct SlurmOptions {
    /// The most tasks of an array that run at once.
    pub throttle: Option<usize>,
    /// Processors of a task.
    pub processors: usize,
    /// How often a task that failed is tried again by itself.
    pub retries: usize,
    /// Options of `sbatch`, one a word: `--partition=long`.
    pub more: Vec<String>,
}

/// A script and the arguments of `sbatch`; where the script lies comes last.
#[derive(Clone, Debug, PartialEq)]
pub struct Submission {
    /// Name of the script within `farm/scripts`.
    pub file: String,
    /// The script.
    pub script: String,
    /// All arguments before the script.
    pub arguments: Vec<String>,
}

/// How an array is submitted; `job_of` gives the job of a phase that was submitted before.
pub fn submission(array: &Array, work: &Work, options: &SlurmOptions, job_of: impl Fn(&str) -> String) -> Submission {
    let name = name_of(array.phase());
    let mut arguments: Vec<String> =
        ["--parsable", "--requeue", "--kill-on-invalid-dep=yes", "--open-mode=append"].map(str::to_owned).to_vec();
    arguments.push(format!("--job-name=strandflow.{name}"));
    // Names of output files may hold patterns, names of folders may not: so they are relative to the take.
    arguments.push(format!("--chdir={}", work.take));
    arguments.push(format!("--output={TASK_OUTPUT}/{name}.%A.%a.txt"));
    // Slurm starts tasks of an array by rising number.
    let at_once = if array.in_order { Some(1) } else { options.throttle };
    arguments.push(format!("--array={}", numbers(&array.tasks, at_once)));
    arguments.push(format!("--cpus-per-task={}", options.processors));
    let waits: Vec<String> = array
        .after
        .iter()
        .map(|after| format!("{}:{}", if after.corresponding { "aftercorr" } else { "afterok" }, job_of(after.phase)))
        .collect();
    if !waits.is_empty() {
        arguments.push(format!("--dependency={}", waits.join(",")));
    }
    arguments.extend(options.more.iter().cloned());
    Submission { file: format!("{name}.sh"), script: script(array, work, options.retries), arguments }
}

/// A task: its items, and another try where that may help.
fn script(array: &Array, work: &Work, retries: usize) -> String {
    let per_task = array.per_task;
    let (phases, command) = (array.phases.join(", "), work.in_shell(&array.phases));
    format!(
        r#"#!/bin/sh
# {phases}: {per_task} parts a task. Written by strandflow.
# The program ends what it has in work when it is told to end. This shell stays until then: Slurm takes its end for the task's.
ended=
trap 'ended=yes' TERM
{command} --items "${{SLURM_ARRAY_TASK_ID}}x{per_task}"
code=$?
trap - TERM
# 2: the take itself is at fault, and another try would end the same way.
if [ -z "$ended" ] && [ "$code" -ne 0 ] && [ "$code" -ne 2 ] && [ "${{SLURM_RESTART_COUNT:-0}}" -lt {retries} ]; then
    scontrol requeue "${{SLURM_ARRAY_JOB_ID}}_${{SLURM_ARRAY_TASK_ID}}" && sleep 300
fi
exit "$code"
"#
    )
}

/// Numbers as Slurm has them: `0-4,7%2`.
fn numbers(tasks: &[usize], throttle: Option<usize>) -> String {
    let mut ranges: Vec<(usize, usize)> = Vec::new();
    for &task in tasks {
        match ranges.last_mut() {
            Some((_, last)) if *last + 1 == task => *last = task,
            _ => ranges.push((task, task)),
        }
    }
    let range = |&(first, last): &(usize, usize)| {
        if first == last { first.to_string() } else { format!("{first}-{last}") }
    };
    let text = ranges.iter().map(range).collect::<Vec<_>>().join(",");
    throttle.map_or(text.clone(), |most| format!("{text}%{most}"))
}

/// Submits arrays in order and writes down their jobs. Where one is refused, those before it are cancelled.
///
/// # Errors
/// `Input` where Slurm refuses, or is not there; `Disk` where scripts cannot be written.
pub fn submit(take: &Take, arrays: &[Array], work: &Work, options: &SlurmOptions) -> Result<Ledger, EngineError> {
    let folder = take.root().join(FARM);
    let output = take.root().join(TASK_OUTPUT);
    std::fs::create_dir_all(&output).map_err(|error| EngineError::disk(&output, error))?;
    let mut ledger = Ledger::default();
    let mut jobs: BTreeMap<&str, u64> = BTreeMap::new();
    for array in arrays {
        let job_of = |phase: &str| jobs.get(phase).map(u64::to_string).unwrap_or_default();
        let submission = submission(array, work, options, job_of);
        let script = folder.join("scripts").join(&submission.file);
        take.store().put(&script, submission.script.as_bytes())?;
        let job = match sbatch(&submission, &script) {
            Ok(job) => job,
            Err(error) => {
                cancel(&ledger)?;
                return Err(error);
            }
        };
        jobs.insert(array.phase(), job);
        let phases = array.phases.iter().map(ToString::to_string).collect();
        ledger.jobs.push(Submitted { job, phases, per_task: array.per_task, tasks: array.tasks.clone() });
        // After each: whatever ends this program, the jobs are known.
        ledger.write(take)?;
    }
    Ok(ledger)
}

fn sbatch(submission: &Submission, script: &Path) -> Result<u64, EngineError> {
    let script = script.canonicalize().map_err(|error| EngineError::disk(script, error))?;
    let told = said(Command::new("sbatch").args(&submission.arguments).arg(&script))?;
    let job = told.trim().split(';').next().and_then(|id| id.parse().ok());
    job.ok_or_else(|| EngineError::input("sbatch", format!("said `{}`, no job number", told.trim()), SEE_SLURM))
}

/// All that would be submitted, as text: scripts, and commands for a shell.
pub fn as_text(arrays: &[Array], work: &Work, options: &SlurmOptions) -> String {
    let mut text = String::new();
    for array in arrays {
        let submission = submission(array, work, options, |phase| format!("JOB({})", name_of(phase)));
        let words = submission.arguments.iter().map(|word| quoted(word)).collect::<Vec<_>>().join(" ");
        let script = quoted(&format!("{}/{FARM}/scripts/{}", work.take, submission.file));
        text += &format!("# {FARM}/scripts/{}\n{}\nsbatch {words} {script}\n\n", submission.file, submission.script);
    }
    text
}

/// How many tasks can run at once, by the processors of the nodes that are up; `None` where Slurm does not say.
pub fn at_once(options: &SlurmOptions) -> Option<usize> {
    let of_nodes = options.more.iter().filter(|word| word.starts_with("--partition="));
    let told = said(Command::new("sinfo").args(["--noheader", "--format=%C"]).args(of_nodes)).ok()?;
    let count: usize = told.lines().filter_map(processors_up).sum::<usize>() / options.processors.max(1);
    Some(options.throttle.map_or(count, |most| most.min(count)))
}

/// Processors by state, `allocated/idle/other/total`: those of the first two.
fn processors_up(line: &str) -> Option<usize> {
    let mut counts = line.trim().split('/').map(str::parse::<usize>);
    Some(counts.next()?.ok()? + counts.next()?.ok()?)
}

/// A task that waits or runs.
#[derive(Clone, Debug, PartialEq)]
pub struct QueuedTask {
    /// Number of its job.
    pub job: u64,
    /// Its number within the array.
    pub task: usize,
    /// Whether it runs; else it waits.
    pub runs: bool,
    /// Where it runs.
    pub node: String,
    /// Why it waits, in Slurm's words.
    pub reason: String,
}

/// The tasks of a ledger that wait or run.
///
/// # Errors
/// `Input` where Slurm does not answer.
pub fn queue(ledger: &Ledger) -> Result<Vec<QueuedTask>, EngineError> {
    if ledger.jobs.is_empty() {
        return Ok(Vec::new());
    }
    let told = said(Command::new("squeue").args(["--noheader", "--array", "--me", "--format=%F|%K|%T|%N|%r"]))?;
    let ours = |task: &QueuedTask| ledger.jobs.iter().any(|job| job.job == task.job);
    Ok(told.lines().filter_map(queued).filter(ours).collect())
}

/// One line of the queue. States that Slurm passes through before and after running count as running: the task is there.
fn queued(line: &str) -> Option<QueuedTask> {
    let mut parts = line.split('|').map(str::trim);
    let (job, task) = (parts.next()?.parse().ok()?, parts.next()?.parse().ok()?);
    let runs = !matches!(parts.next()?, "PENDING" | "REQUEUED" | "REQUEUE_HOLD" | "SPECIAL_EXIT" | "REQUEUE_FED");
    let (node, reason) = (parts.next()?.to_owned(), parts.next()?.to_owned());
    Some(QueuedTask { job, task, runs, node, reason })
}

/// Cancels all jobs of a ledger; those that have ended are passed over.
///
/// # Errors
/// `Input` where Slurm does not answer.
pub fn cancel(ledger: &Ledger) -> Result<(), EngineError> {
    if ledger.jobs.is_empty() {
        return Ok(());
    }
    said(Command::new("scancel").arg("--quiet").args(ledger.jobs.iter().map(|job| job.job.to_string()))).map(|_| ())
}

const SEE_SLURM: &str = "try the command by hand; `--dry-run` prints it";

fn said(command: &mut Command) -> Result<String, EngineError> {
    let program = command.get_program().to_string_lossy().into_owned();
    let output = command.output().map_err(|error| {
        let hint = "run this where Slurm's commands are installed, or take `--engine script` for other schedulers";
        EngineError::input(program.clone(), error.to_string(), hint)
    })?;
    if output.status.success() {
        return Ok(String::from_utf8_lossy(&output.stdout).into_owned());
    }
    let fact = String::from_utf8_lossy(&output.stderr).trim().to_owned();
    Err(EngineError::input(program, fact, SEE_SLURM))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::farm::After;

    fn array() -> Array {
        let after = |phase, corresponding| After { phase, corresponding };
        let after = vec![after("pose/pose", false), after("lift/lift", true)];
        Array { phases: vec!["field/field"], parts: 60, per_task: 12, tasks: vec![0, 1, 2, 4], in_order: false, after }
    }

    fn work() -> Work {
        let more = vec!["--threads".to_owned(), "2".to_owned()];
        Work { program: "/opt/a b/strandflow".into(), take: "/data/it's $x".into(), more }
    }

    #[test]
    fn an_array_is_submitted_with_what_it_waits_for() {
        let options = SlurmOptions { throttle: Some(3), processors: 2, retries: 1, more: vec!["--qos=high".into()] };
        let submission = submission(&array(), &work(), &options, |phase| phase.len().to_string());
        for wanted in ["--array=0-2,4%3", "--cpus-per-task=2", "--dependency=afterok:9,aftercorr:9", "--qos=high"] {
            assert!(submission.arguments.iter().any(|argument| argument == wanted), "{wanted}: {submission:?}");
        }
        assert!(submission.arguments.contains(&"--chdir=/data/it's $x".to_owned()));
        let words = r"'/opt/a b/strandflow' 'run' '/data/it'\''s $x' '--from' 'field/field' '--to' 'field/field' '--threads' '2'";
        let command = format!("{words} --items \"${{SLURM_ARRAY_TASK_ID}}x12\"");
        assert!(submission.script.lines().any(|line| line == command), "{}", submission.script);
    }

    #[cfg(unix)]
    #[test]
    fn a_task_that_is_told_to_end_stays_until_its_program_has_ended() {
        use std::os::unix::{fs::PermissionsExt, process::CommandExt};
        let folder = tempfile::tempdir().unwrap();
        let within = |name: &str| folder.path().join(name);
        let executable = |name: &str, script: String| {
            std::fs::write(within(name), script).unwrap();
            std::fs::set_permissions(within(name), std::fs::Permissions::from_mode(0o755)).unwrap();
        };
        let [program, started, done, requeued, task] =
            ["program", "started", "done", "requeued", "task.sh"].map(within);
        // As ours: told to end, it first ends what it has in work.
        let ends = format!("trap 'sleep 0.5; : > {}; exit 1' TERM", done.display());
        executable("program", format!("#!/bin/sh\n{ends}\n: > {}\nwhile :; do sleep 0.05; done\n", started.display()));
        executable("scontrol", format!("#!/bin/sh\n: > {}\nexit 1\n", requeued.display()));
        let work = Work { program: program.display().to_string(), ..work() };
        std::fs::write(&task, script(&array(), &work, 2)).unwrap();
        let mut shell = Command::new("sh")
            .arg(&task)
            .env("SLURM_ARRAY_TASK_ID", "0")
            .env("PATH", format!("{}:{}", folder.path().display(), std::env::var("PATH").unwrap()))
            .process_group(0)
            .spawn()
            .unwrap();
        let end = std::time::Instant::now() + std::time::Duration::from_secs(20);
        while !started.exists() {
            assert!(std::time::Instant::now() < end, "the program has not begun");
            std::thread::sleep(std::time::Duration::from_millis(10));
        }
        let told = Command::new("kill").args(["-TERM", "--", &format!("-{}", shell.id())]).status().unwrap();
        assert!(told.success());
        assert_eq!(shell.wait().unwrap().code(), Some(1));
        assert!(done.exists(), "the shell was gone before its program");
        assert!(!requeued.exists(), "what was told to end is not put back into the queue");
    }

    #[test]
    fn processors_are_counted_that_are_up() {
        assert_eq!(processors_up("3/13/4/20"), Some(16));
        assert_eq!(processors_up("3.1K/13K/4/20K"), None, "rounded: not known");
    }

    #[test]
    fn a_queue_is_read() {
        let task = queued("41|7|RUNNING|n2|None").unwrap();
        assert_eq!((task.job, task.task, task.runs, task.node.as_str()), (41, 7, true, "n2"));
        assert!(!queued("41|8|PENDING||Dependency").unwrap().runs);
        assert_eq!(queued("41|N/A|PENDING||None"), None, "no array of ours");
    }
}
