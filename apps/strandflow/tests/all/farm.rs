//! A take by many processes: the bytes of one run, whatever becomes of tasks and nodes.
#![expect(clippy::unwrap_used, reason = "helpers of tests: a failing unwrap is a failing test")]

use std::{collections::BTreeSet, path::Path, process::Command};

use strandflow_engine::{
    EngineError, Take,
    store::Failure,
    table::{Job, item_of, phases},
};

use crate::common::{assert_bad_input, assert_same, stderr, strandflow, synthetic, take, text};

/// What tasks wait for follows from the table; what items read follows from their rooms. They must not disagree. And tasks
/// side by side, phase by phase, end with the bytes of one run.
#[test]
fn tasks_side_by_side_make_the_bytes_of_one_run() {
    let root = tempfile::tempdir().unwrap();
    let capture = root.path().join("capture");
    synthetic::capture(&capture);
    let whole = synthetic::take_of(&capture, "whole", &[]);
    let run = strandflow(&["run", text(&whole), "--threads", "2"]);
    assert!(run.status.success(), "{}", stderr(&run));
    table_says_what_items_read(&whole);

    let parts = synthetic::take_of(&capture, "parts", &[]);
    for (_, phase) in phases() {
        let task = |items: &str| {
            let args =
                ["run", text(&parts), "--from", phase.name, "--to", phase.name, "--threads", "1", "--items", items];
            Command::new(env!("CARGO_BIN_EXE_strandflow")).args(args).spawn().unwrap()
        };
        // The second pair does what the first does, and more than there is.
        let tasks = ["0x3", "1x3", "0..7", "7..40"].map(task);
        for mut task in tasks {
            assert!(task.wait().unwrap().success(), "{}", phase.name);
        }
    }
    assert_same(&whole, &parts);
    let again = strandflow(&["run", text(&parts), "--json"]);
    let last: serde_json::Value =
        serde_json::from_slice(again.stdout.split(|b| *b == b'\n').rev().nth(1).unwrap()).unwrap();
    assert!(last["done"] == 0 && last["complete"] == true, "{last}");
    frames_are_grown_alone_only_after_bad_ones(&parts);
}

/// A frame before that is not there is not taken for one that cannot be grown: another task may be making it.
fn frames_are_grown_alone_only_after_bad_ones(take: &Path) {
    let take = Take::open(take).unwrap();
    let plan = take.last_plan().unwrap();
    let job = Job::new(&take, &plan);
    let before = "grow/grow/000001";
    let (stage, phase, item) = item_of("grow/grow/000002", &job).unwrap();
    let inputs = || stage.inputs(phase, &job, item);
    assert!(inputs().unwrap().items.iter().any(|key| key == before));
    take.store().forget(before).unwrap();
    assert!(matches!(inputs(), Err(EngineError::Missing { item }) if item == before));
    let failure = Failure { error: "a bad frame".into(), hint: "none".into(), input: true };
    take.store().write_failure(before, &failure).unwrap();
    assert!(inputs().unwrap().items.iter().all(|key| key != before));
}

fn table_says_what_items_read(take: &Path) {
    let take = Take::open(take).unwrap();
    let plan = take.last_plan().unwrap();
    let job = Job::new(&take, &plan);
    for (stage, phase) in phases() {
        let mut read = BTreeSet::new();
        for &item in phase.chains(&job).unwrap().iter().flatten() {
            for key in stage.inputs(phase, &job, item).unwrap().items {
                let (_, of, needed) = item_of(&key, &job).unwrap();
                assert!(!phase.same.contains(&of.name) || needed == item, "{} reads {key}", item.key(phase.name));
                read.insert(of.name);
            }
        }
        read.remove(phase.name);
        let told: BTreeSet<&str> = phase.same.iter().chain(phase.others).copied().collect();
        assert_eq!(read, told, "{}", phase.name);
    }
}

#[test]
fn a_task_says_by_its_code_whether_another_try_may_help() {
    let root = tempfile::tempdir().unwrap();
    let (capture, take) = take(root.path());
    let task =
        |phase: &str, items: &str| strandflow(&["run", text(&take), "--from", phase, "--to", phase, "--items", items]);
    assert_bad_input(&task("hull", "1..2"), &["--items beyond the first count the work items of one phase"]);
    assert!(!stderr(&task("field", "20..21")).contains("--items beyond"), "both phases of field go by frames");
    assert_bad_input(&task("hull/hulls", "0..1"), &["phase `hull/hulls`"]);
    assert_eq!(task("masks", "1..0").status.code(), Some(2));
    assert_bad_input(&strandflow(&["run", text(&take), "--cancel"]), &["--cancel is of Slurm"]);
    // An image that cannot be read: no try will mend that, and what comes after goes on without it.
    std::fs::write(capture.join("images/cam1/000003.png"), b"no image").unwrap();
    let settled = task("masks/masks", "0x3");
    assert!(settled.status.success(), "{}", stderr(&settled));
    assert!(stderr(&settled).contains("warning: ") && stderr(&settled).contains("frame 3"), "{}", stderr(&settled));
    let status = strandflow(&["status", text(&take)]);
    assert!(String::from_utf8_lossy(&status.stdout).contains("000003.png"));
}

#[test]
fn other_schedulers_get_text_that_holds_any_path() {
    let root = tempfile::tempdir().unwrap();
    let (_, plain) = take(root.path());
    let take = plain.with_file_name("it's $(HOME) & {{take}} <b>");
    std::fs::rename(&plain, &take).unwrap();
    let rendered = |template: &str| {
        let output =
            strandflow(&["run", text(&take), "--engine", "script", "--template", template, "--task-secs", "0.0001"]);
        assert!(output.status.success(), "{}", stderr(&output));
        String::from_utf8(output.stdout).unwrap()
    };
    let path = text(&take.canonicalize().unwrap()).to_owned();
    let jobs = kubernetes_is_made_of_jobs(&rendered("kubernetes"), &path);
    let opencue = rendered("opencue");
    let layers = opencue.matches("<layer name=").count();
    assert_eq!((layers, opencue.matches("</layer>").count()), (jobs, layers));
    assert!(opencue.contains("it&apos;\\&apos;&apos;s $(HOME) &amp; {{take}} &lt;b&gt;&apos;"), "{opencue}");
    let mine = root.path().join("mine.txt");
    std::fs::write(&mine, "{{#arrays}}{{job}} {{tasks}}x{{per_task}}\n{{/arrays}}").unwrap();
    assert!(rendered(text(&mine)).starts_with("strandflow-masks-masks "));
    let deadline = strandflow(&["run", text(&take), "--engine", "script", "--template", "deadline"]);
    assert_bad_input(&deadline, &["deadline", "which Deadline cannot pass on"]);
}

/// Reads the text as YAML and looks at what a cluster would look at; how many jobs there are.
fn kubernetes_is_made_of_jobs(text: &str, path: &str) -> usize {
    let jobs = yaml_rust2::YamlLoader::load_from_str(text).unwrap();
    let jobs: Vec<_> = jobs.iter().filter(|job| !job.is_null()).collect();
    let mut names = BTreeSet::new();
    let mut left = phases().map(|(_, phase)| phase.name);
    for job in &jobs {
        assert_eq!((job["apiVersion"].as_str(), job["kind"].as_str()), (Some("batch/v1"), Some("Job")));
        let after = job["metadata"]["annotations"]["strandflow/after"].as_str().unwrap();
        assert!(after.split_whitespace().all(|name| names.contains(name)), "{after}");
        names.insert(job["metadata"]["name"].as_str().unwrap());
        let spec = &job["spec"];
        assert_eq!(spec["completionMode"].as_str(), Some("Indexed"));
        assert!(spec["completions"].as_i64().unwrap() > 0 && spec["completions"] == spec["parallelism"]);
        let pod = &spec["template"]["spec"];
        assert_eq!(pod["restartPolicy"].as_str(), Some("Never"));
        let container = &pod["containers"][0];
        let words: Vec<&str> =
            container["command"].as_vec().unwrap().iter().map(|word| word.as_str().unwrap()).collect();
        assert_eq!((words[1], Some(words[4])), ("run", left.next()));
        assert!(words[4] == words[6] || left.any(|phase| phase == words[6]), "{words:?}");
        assert_eq!(words[2].replace("$$", "$"), path);
        assert!(words.last().unwrap().starts_with("$(JOB_COMPLETION_INDEX)x"));
        assert_eq!(container["volumeMounts"][0]["mountPath"].as_str(), Some(path));
        assert_eq!(container["volumeMounts"][0]["name"], pod["volumes"][0]["name"]);
    }
    assert_eq!(left.next(), None);
    jobs.len()
}

#[cfg(target_os = "linux")]
mod on_slurm {
    use std::{
        process::Stdio,
        thread::sleep,
        time::{Duration, Instant},
    };

    use serde_json::Value;
    use strandflow_engine::run::log_lines;

    use super::*;
    use crate::{
        common::slurm::{Slurm, kill, status},
        mishaps::{Dice, kills, tell},
    };

    /// One take, through everything: no memory, a killed task, a dead node, cancelled jobs, a full resume.
    #[test]
    fn killed_tasks_and_dead_nodes_cost_no_byte() {
        let Some(slurm) = Slurm::start() else { return };
        let root = tempfile::tempdir().unwrap();
        let capture = root.path().join("capture");
        synthetic::capture(&capture);
        let whole = synthetic::take_of(&capture, "whole", &[]);
        assert!(strandflow(&["run", text(&whole), "--threads", "1"]).status.success());
        let far = synthetic::take_of(&capture, "it's $HOME & far", &[]);
        let far_text = text(&far).to_owned();
        let with = move |more: &[&str]| {
            let common = ["run", &far_text, "--engine", "slurm", "--task-secs", "0.2", "--max-tasks", "3"];
            [&common, more].concat().iter().map(ToString::to_string).collect::<Vec<_>>()
        };
        let slurm_run = |more: &[&str]| {
            let args = with(more);
            slurm.strandflow(&args.iter().map(String::as_str).collect::<Vec<_>>())
        };
        let state = || status(&slurm.strandflow(&["status", text(&far), "--json"]).output().unwrap());

        // Over its memory: every task is, and the scalp's lasts long enough for Slurm to see it. It is ended, and what waits
        // for it never runs.
        let short = slurm_run(&["--wait", "--to", "grow", "--memory", "10M", "--retries", "0"]).output().unwrap();
        assert_eq!(short.status.code(), Some(1), "{}", stderr(&short));
        let told = state();
        assert!(told["scalp/scalp"]["done"] == 0 && told["grow/grow"]["done"] == 0, "{told:?}");
        let ended = told.values().filter_map(|phase| phase["tasks"]["ended"][0].as_str());
        assert!({ ended }.all(|output| output.starts_with("farm/output/")));
        assert!(told["scalp/scalp"]["tasks"]["ended"][0].is_string(), "{told:?}");

        // Submitted and cancelled: nothing is left in the queue, and nothing done is lost.
        assert!(slurm_run(&[]).output().unwrap().status.success());
        let twice = slurm_run(&[]).output().unwrap();
        assert_bad_input(&twice, &["waiting or running"]);
        assert!(slurm_run(&["--cancel"]).output().unwrap().status.success());
        assert!(slurm.tasks_of(&far).is_empty(), "what was cancelled has ended");

        // A task is killed, and a node: both are done again by themselves.
        let waiting = slurm_run(&["--wait"]).stderr(Stdio::piped()).spawn().unwrap();
        kill(&[slurm.task_of(&far, |_, _| true).id]);
        let node = slurm.task_of(&far, |phase, _| !phase.starts_with("masks")).node;
        slurm.kill_node(&node);
        slurm.task_of(&far, |_, other| other != node);
        slurm.start_node(&node);
        let waited = waiting.wait_with_output().unwrap();
        assert!(waited.status.success(), "{}", stderr(&waited));
        assert_same(&whole, &far);
        assert!(state().values().all(|phase| phase["done"] == phase["items"]));
        assert!(stderr(&slurm_run(&["--wait"]).output().unwrap()).contains("all is done"));
        shaken(&slurm, &capture, &whole);
    }

    /// Tasks are killed at random moments, a quarter as many as runs elsewhere: each take ends with the bytes of one run.
    fn shaken(slurm: &Slurm, capture: &Path, whole: &Path) {
        let kills = kills() / 4;
        let (mut dice, mut killed, mut takes, mut again) = (Dice(0xfa12), 0, 0, 0);
        let mut phases = BTreeSet::new();
        while killed < kills {
            let take = synthetic::take_of(capture, &format!("shaken{takes}"), &[]);
            takes += 1;
            let args = ["run", text(&take), "--engine", "slurm", "--wait", "--task-secs", "0.2", "--retries", "9"];
            let mut run = slurm.strandflow(&args).stderr(Stdio::null()).spawn().unwrap();
            let mut due = Instant::now();
            while killed < kills && run.try_wait().unwrap().is_none() {
                sleep(Duration::from_millis(10).max(due.saturating_duration_since(Instant::now())));
                let mut tasks = slurm.tasks_of(&take);
                if !tasks.is_empty() {
                    let (task, phase) = tasks.swap_remove(dice.below(tasks.len()));
                    kill(&[task.id]);
                    phases.insert(phase);
                    killed += 1;
                    due = Instant::now() + Duration::from_secs_f64(10.0 * dice.share());
                }
            }
            assert!(run.wait().unwrap().success());
            assert_same(whole, &take);
            again += made_again(&take);
        }
        let told = format!("{takes} takes, tasks that begin with {}", Vec::from_iter(phases).join(", "));
        tell("task of a farm killed at a random moment", kills, again, &told);
    }

    /// Items that the logs tell to have been done more than once.
    fn made_again(take: &Path) -> usize {
        let events = log_lines(take).filter_map(|line| serde_json::from_str::<Value>(&line).ok());
        let done = events.filter(|event| event["event"] == "item" && event["outcome"] == "done");
        let done: Vec<String> = done.map(|event| event["item"].to_string()).collect();
        done.len() - done.iter().collect::<BTreeSet<_>>().len()
    }
}
