//! A Slurm of one machine and two nodes, started for a test and ended after it; and the processes of its tasks.
#![expect(clippy::unwrap_used, reason = "helpers of tests: a failing unwrap is a failing test")]

use std::{
    collections::BTreeMap,
    os::unix::fs::PermissionsExt,
    path::{Path, PathBuf},
    process::{Command, Output},
    time::{Duration, Instant},
};

use super::text;

/// Ended when it is dropped.
pub struct Slurm {
    folder: PathBuf,
}

impl Slurm {
    /// Starts it, where all is there that it needs; else says what is lacking and that the test is skipped.
    pub fn start() -> Option<Self> {
        let has = |program: &str| ["/usr/sbin", "/usr/bin"].iter().any(|at| Path::new(at).join(program).is_file());
        let lacking = ["slurmctld", "slurmd", "sbatch", "munged"].into_iter().find(|program| !has(program));
        let root = Command::new("id").arg("-u").output().is_ok_and(|out| out.stdout == b"0\n");
        if let Some(lacking) = lacking.or((!root).then_some("rights of root")) {
            let must = ["CI", "STRANDFLOW_REQUIRE"].iter().any(|name| std::env::var_os(name).is_some());
            assert!(!must, "the farm cannot be tested without {lacking}");
            eprintln!("skipped: no {lacking} (Debian: slurm-wlm munge)");
            return None;
        }
        // Its keys are read by a user of their own, whom a temporary folder of this one would keep out.
        let folder = PathBuf::from(format!("/var/tmp/strandflow-slurm-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::set_permissions(&folder, std::fs::Permissions::from_mode(0o755)).unwrap();
        let slurm = Self { folder };
        let up = Command::new(tool("up.sh")).arg(&slurm.folder).arg("2").output().unwrap();
        assert!(up.status.success(), "{}", String::from_utf8_lossy(&up.stderr));
        Some(slurm)
    }

    /// The command, with this Slurm.
    pub fn strandflow(&self, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_strandflow"));
        command.args(args).env("SLURM_CONF", self.folder.join("slurm.conf"));
        command
    }

    /// Ends a node as a power cut does: its daemon and all that runs there.
    pub fn kill_node(&self, node: &str) {
        let daemon = std::fs::read_to_string(self.folder.join(format!("slurmd-{node}.pid"))).unwrap();
        kill(&[daemon.trim().parse().unwrap()]);
        let there = processes().into_iter().filter(|process| process.node == node);
        let all: Vec<u32> = there.flat_map(|process| [process.step(), Some(process.id)]).flatten().collect();
        kill(&all);
    }

    /// Starts a node's daemon again.
    pub fn start_node(&self, node: &str) {
        let configuration = self.folder.join("slurm.conf");
        let started = Command::new("/usr/sbin/slurmd").arg("-f").arg(configuration).args(["-N", node]).status();
        assert!(started.unwrap().success());
    }

    /// The tasks of a take that are at work: process, and first phase.
    pub fn tasks_of(&self, take: &Path) -> Vec<(Process, String)> {
        let take = take.canonicalize().unwrap();
        let of_task = |process: Process| {
            let ours = process.words.get(2).is_some_and(|word| word == text(&take));
            let phase = process.words.iter().skip_while(|word| *word != "--from").nth(1)?.clone();
            ours.then_some((process, phase))
        };
        processes().into_iter().filter_map(of_task).collect()
    }

    /// Waits for a task of a take that `wanted` takes by its phase and node.
    pub fn task_of(&self, take: &Path, wanted: impl Fn(&str, &str) -> bool) -> Process {
        let end = Instant::now() + Duration::from_secs(90);
        let mut looked = Instant::now();
        while Instant::now() < end {
            let mut tasks = self.tasks_of(take).into_iter();
            if let Some((task, _)) = tasks.find(|(task, phase)| wanted(phase, &task.node)) {
                return task;
            }
            if looked.elapsed() > Duration::from_secs(5) {
                self.resume_drained();
                looked = Instant::now();
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        panic!("no such task came: {}", self.tell());
    }

    /// Gives back the nodes that Slurm itself took out, as who runs a cluster does: on a loaded machine it may hold one that is
    /// slow to end a job for one that cannot.
    fn resume_drained(&self) {
        let drained = self.said("sinfo", &["--Node", "--noheader", "--states=drain", "--format=%N"]);
        for node in drained.lines() {
            eprintln!("node {node} was drained: {}", self.said("sinfo", &["--list-reasons"]));
            self.said("scontrol", &["update", &format!("nodename={node}"), "state=resume"]);
        }
    }

    /// What a command of this Slurm says.
    fn said(&self, program: &str, args: &[&str]) -> String {
        let out = Command::new(program).args(args).env("SLURM_CONF", self.folder.join("slurm.conf")).output().unwrap();
        String::from_utf8_lossy(&out.stdout).into_owned()
    }

    /// Nodes, jobs and the end of the log, for a test that failed.
    fn tell(&self) -> String {
        let log = std::fs::read_to_string(self.folder.join("log/slurmctld.log")).unwrap_or_default();
        let lines: Vec<&str> = log.lines().collect();
        let end = lines[lines.len().saturating_sub(60)..].join("\n");
        self.said("sinfo", &["--Node", "--long"])
            + &self.said("squeue", &["--long", "--array"])
            + &format!("log:\n{end}")
    }
}

impl Drop for Slurm {
    fn drop(&mut self) {
        // Whatever became of it: nothing of it is to stay.
        let conf = self.folder.join("slurm.conf");
        let _ = Command::new("scancel").env("SLURM_CONF", &conf).args(["--user", "root"]).status();
        std::thread::sleep(Duration::from_secs(1));
        let _ = Command::new(tool("down.sh")).arg(&self.folder).status();
        std::thread::sleep(Duration::from_millis(500));
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

fn tool(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tools/slurm").join(name)
}

/// A process on a node.
#[derive(Debug)]
pub struct Process {
    pub id: u32,
    pub node: String,
    pub words: Vec<String>,
    parent: u32,
}

impl Process {
    /// The daemon of the job's step: the parent of the script.
    fn step(&self) -> Option<u32> {
        self.words.iter().any(|word| word.ends_with("slurm_script")).then_some(self.parent)
    }
}

/// All processes that know which node they are on.
pub fn processes() -> Vec<Process> {
    let of = |id: u32| {
        let read = |name: &str| std::fs::read(format!("/proc/{id}/{name}")).ok();
        let words =
            |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).split_terminator('\0').map(str::to_owned).collect();
        let environment: Vec<String> = words(read("environ")?);
        let node = environment.iter().find_map(|line| line.strip_prefix("SLURMD_NODENAME="))?.to_owned();
        let state = String::from_utf8_lossy(&read("stat")?).into_owned();
        let parent = state.rsplit_once(')')?.1.split_whitespace().nth(1)?.parse().ok()?;
        Some(Process { id, node, words: words(read("cmdline")?), parent })
    };
    let ids =
        std::fs::read_dir("/proc").unwrap().flatten().filter_map(|entry| entry.file_name().to_str()?.parse().ok());
    ids.filter_map(of).collect()
}

/// Ends processes at once.
pub fn kill(ids: &[u32]) {
    let ids: Vec<String> = ids.iter().map(u32::to_string).collect();
    // One may have ended by itself.
    let _ = Command::new("kill").arg("-KILL").args(ids).output();
}

/// The phases of `status --json` by name.
pub fn status(output: &Output) -> BTreeMap<String, serde_json::Value> {
    let rows: Vec<serde_json::Value> = serde_json::from_slice(&output.stdout).unwrap();
    rows.into_iter().map(|row| (row["phase"].as_str().unwrap().to_owned(), row)).collect()
}
