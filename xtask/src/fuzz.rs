//! `cargo xtask fuzz`: builds the targets of `fuzz/` with libFuzzer's coverage counters, which stable Rust can insert, and runs
//! each for some seconds from the fixtures of the tests.
//!
//! Counters are in our own crates alone: cargo asks [`compile`] to compile those, and takes the others as the tests have built
//! them. A build beside that of the tests takes minutes, and its counters would lead into other people's decoders.

use std::{
    ffi::OsString,
    fs,
    path::{Path, PathBuf},
    process::{Command, ExitCode, Stdio},
    sync::atomic::{AtomicUsize, Ordering},
};

use crate::{cargo, compiler, run, target};

const TARGETS: [&str; 6] = ["calibrations", "models", "grooms", "drawings", "scenes", "manifest"];

/// Crates of the readers, which get counters beside the targets themselves.
const READERS: [&str; 4] = ["strandflow_core", "strandflow_engine", "strandflow_fuzz", "strandflow_io"];

/// What `cargo fuzz run -s none` passes, but for one code unit a crate.
const COVERAGE: [&str; 11] = [
    "--cfg",
    "fuzzing",
    "-Cpasses=sancov-module",
    "-Cllvm-args=-sanitizer-coverage-level=4",
    "-Cllvm-args=-sanitizer-coverage-inline-8bit-counters",
    "-Cllvm-args=-sanitizer-coverage-pc-table",
    "-Cllvm-args=-sanitizer-coverage-trace-compares",
    // More optimisation costs more than it gains in a short run; panics say their place without debug information.
    "-Copt-level=1",
    "-Cdebuginfo=0",
    "-Cdebug-assertions=on",
    "-Coverflow-checks=on",
];

/// Our crates that no target runs: the stages, whose settings are read, and what they are made of.
const BESIDE: [&str; 2] = ["-Copt-level=0", "-Cdebuginfo=0"];

/// Tells this program that cargo called it in the compiler's place.
const COMPILES: &str = "STRANDFLOW_FUZZ_COMPILES";

/// Compiles in the compiler's place where cargo asks for that: the arguments are the compiler and its own.
pub fn compile() -> Option<ExitCode> {
    std::env::var_os(COMPILES)?;
    let arguments: Vec<OsString> = std::env::args_os().skip(1).collect();
    let (compiler, arguments) = arguments.split_first()?;
    let name = arguments.windows(2).find(|pair| pair[0] == "--crate-name").and_then(|pair| pair[1].to_str());
    let further: &[&str] = match name {
        Some(name) if READERS.contains(&name) || TARGETS.contains(&name) => &COVERAGE,
        // Questions about the compiler have no name, and a build script has no main function of libFuzzer.
        None | Some("build_script_build") => &[],
        Some(_) => &BESIDE,
    };
    let status = Command::new(compiler).args(arguments).args(further).status();
    Some(if status.is_ok_and(|status| status.success()) { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Runs all targets, or the named ones, for so many seconds each, as many at once as the machine has processors. What is found
/// lies in `fuzz/found` of the build's folder, what reaches new code in `fuzz/corpus`, from where the next run goes on.
pub fn fuzz(arguments: &[String]) -> Result<(), String> {
    let (seconds, named) = chosen(arguments)?;
    compiler()?;
    build(&named)?;
    let next = AtomicUsize::new(0);
    let at_once = std::thread::available_parallelism().map_or(1, usize::from).min(named.len());
    let work = || {
        let mut wrong = Vec::new();
        while let Some(name) = named.get(next.fetch_add(1, Ordering::Relaxed)) {
            match one(name, seconds) {
                Ok(told) => eprintln!("fuzz: {name}: {told}"),
                Err(fact) => wrong.push(format!("{name}: {fact}")),
            }
        }
        wrong
    };
    let wrong: Vec<String> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..at_once).map(|_| scope.spawn(work)).collect();
        workers
            .into_iter()
            .flat_map(|worker| worker.join().unwrap_or_else(|_| vec!["a thread failed".into()]))
            .collect()
    });
    if wrong.is_empty() { Ok(()) } else { Err(wrong.join("\n")) }
}

fn build(named: &[&str]) -> Result<(), String> {
    let this = std::env::current_exe().map_err(|error| format!("this program: {error}"))?;
    let mut build = cargo();
    build.env("RUSTC_WORKSPACE_WRAPPER", this).env(COMPILES, "1").env("CARGO_INCREMENTAL", "0");
    // All of the workspace, and an example: so the features of other people's crates are those that the tests have.
    build.args(["build", "--workspace", "--features", "strandflow-fuzz/libfuzzer", "--example", "features-of-tests"]);
    for name in named {
        build.args(["--bin", name]);
    }
    run(&mut build)
}

/// Runs one target, and says how many inputs it ran.
fn one(name: &str, seconds: u32) -> Result<String, String> {
    let (program, below) = (target().join("debug").join(name), target().join("fuzz"));
    let [corpus, seeds, found, said] = ["corpus", "seeds", "found", "said"].map(|part| below.join(part).join(name));
    for made in [&corpus, &seeds, &found, &below.join("said")] {
        fs::create_dir_all(made).map_err(|error| format!("{}: {error}", made.display()))?;
    }
    let folder = folder_of(name);
    supervised(Command::new(&program).env("STRANDFLOW_FUZZ_SEEDS", &seeds), &folder, &said)?;
    let mut fuzz = Command::new(program);
    fuzz.arg(format!("-max_total_time={seconds}"));
    // No fixture is longer; no file of that length may take seconds, nor memory beyond what all of the program needs.
    fuzz.args(["-max_len=16384", "-timeout=10", "-rss_limit_mb=1024", "-print_final_stats=1", "-verbosity=0"]);
    fuzz.arg(format!("-artifact_prefix={}/", found.display())).arg(corpus).arg(seeds);
    supervised(&mut fuzz, &folder, &said).map_err(|fact| format!("{fact}\nthe input lies in {}", found.display()))?;
    let text = fs::read_to_string(&said).unwrap_or_default();
    let count = |name: &str| {
        let of = |line: &str| line.strip_prefix("stat::")?.strip_prefix(name)?.strip_prefix(':').map(str::to_owned);
        text.lines().find_map(of).map_or("?".to_owned(), |count| count.trim().to_owned())
    };
    let [inputs, secs, mb] = ["number_of_executed_units", "slowest_unit_time_sec", "peak_rss_mb"].map(count);
    let spent = text.lines().last().map_or("?", str::trim);
    Ok(format!(
        "{inputs} inputs in {spent} (user, system), the longest {secs} s (whole seconds), at most {mb} MB, nothing found"
    ))
}

/// Where the files lie that are read: in memory, where the system has such a place.
fn folder_of(name: &str) -> PathBuf {
    let shared = Path::new("/dev/shm");
    let root = if shared.is_dir() { shared.to_owned() } else { std::env::temp_dir() };
    root.join(format!("strandflow-fuzz-{name}-{}", std::process::id()))
}

/// Runs a program with what it says in a file, and removes its folder at the end, whatever ends it: a shell waits for it, which
/// outlives an interrupt of the terminal and this program. The last line said is the processor time of the program.
fn supervised(program: &mut Command, folder: &Path, said: &Path) -> Result<(), String> {
    const SHELL: &str = r#"trap : INT TERM HUP; "$@"; ended=$?; times; rm -rf "$STRANDFLOW_FUZZ_FOLDER"; exit $ended"#;
    let file = fs::File::create(said).map_err(|error| format!("{}: {error}", said.display()))?;
    let second = file.try_clone().map_err(|error| format!("{}: {error}", said.display()))?;
    let mut shell = Command::new("sh");
    shell.args(["-c", SHELL, "sh"]).arg(program.get_program()).args(program.get_args());
    shell.envs(program.get_envs().filter_map(|(name, value)| Some((name, value?))));
    shell.env("STRANDFLOW_FUZZ_FOLDER", folder).stdin(Stdio::null()).stdout(file).stderr(second);
    let status = shell.status().map_err(|error| format!("sh: {error}"))?;
    if status.success() {
        return Ok(());
    }
    let text = fs::read(said).unwrap_or_default();
    let text = String::from_utf8_lossy(&text);
    let lines: Vec<&str> = text.lines().collect();
    Err(format!("{}\nended with {status}", lines[lines.len().saturating_sub(60)..].join("\n")))
}

/// `--seconds N`, 10 without, and the targets that are named, all without.
fn chosen(arguments: &[String]) -> Result<(u32, Vec<&'static str>), String> {
    let (mut seconds, mut named) = (10, Vec::new());
    let mut arguments = arguments.iter();
    while let Some(argument) = arguments.next() {
        if argument == "--seconds" {
            let number = arguments.next().and_then(|number| number.parse().ok());
            seconds = number.filter(|n| *n > 0).ok_or("give `--seconds` a number")?;
        } else if let Some(target) = TARGETS.into_iter().find(|target| target == argument) {
            named.push(target);
        } else {
            return Err(format!("no such target: `{argument}`; there are {}", TARGETS.join(", ")));
        }
    }
    Ok((seconds, if named.is_empty() { TARGETS.to_vec() } else { named }))
}
