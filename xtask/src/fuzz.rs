//! `cargo xtask fuzz`: builds the targets of `fuzz/` with libFuzzer's coverage counters, which stable Rust can insert, and runs
//! each for some seconds from the fixtures of the tests.

use std::{fs, path::Path, process::Command};

use crate::{root, run};

const TARGETS: [&str; 5] = ["calibrations", "models", "grooms", "drawings", "scenes"];

/// What `cargo fuzz run -s none` passes, but for one code unit a crate.
const COVERAGE: &str = "--cfg fuzzing -Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 \
     -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table \
     -Cllvm-args=-sanitizer-coverage-trace-compares";

/// Runs all targets, or the named ones, for so many seconds each. What is found lies in `target/fuzz/found`, what reaches new code
/// in `target/fuzz/corpus`, from where the next run goes on.
pub fn fuzz(arguments: &[String]) -> Result<(), String> {
    let (seconds, named) = chosen(arguments)?;
    let triple = host()?;
    let folder = root().join("target/fuzz");
    let mut build = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    build.current_dir(root().join("fuzz")).env("RUSTFLAGS", COVERAGE);
    // With a target, build scripts and macros are built without counters, which only libFuzzer's main function provides.
    build.args(["build", "--locked", "--target", &triple, "--target-dir"]).arg(&folder);
    run(&mut build)?;
    for target in named {
        let program = folder.join(&triple).join("debug").join(target);
        one(&program, target, &folder, seconds)
            .map_err(|fact| format!("{target}: {fact}; the input lies in {}", folder.join("found").display()))?;
    }
    Ok(())
}

fn one(program: &Path, target: &str, folder: &Path, seconds: u32) -> Result<(), String> {
    let (corpus, seeds, found) =
        (folder.join("corpus").join(target), folder.join("seeds").join(target), folder.join("found").join(target));
    for made in [&corpus, &seeds, &found] {
        fs::create_dir_all(made).map_err(|error| format!("{}: {error}", made.display()))?;
    }
    run(Command::new(program).env("STRANDFLOW_FUZZ_SEEDS", &seeds))?;
    let mut fuzz = Command::new(program);
    fuzz.arg(format!("-max_total_time={seconds}"));
    // No fixture is longer; no file of that length may take seconds, nor memory beyond what all of the program needs.
    fuzz.args(["-max_len=16384", "-timeout=10", "-rss_limit_mb=1024", "-print_final_stats=1", "-verbosity=0"]);
    fuzz.arg(format!("-artifact_prefix={}/", found.display()));
    run(fuzz.arg(corpus).arg(seeds))
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

/// The triple that the compiler builds for.
fn host() -> Result<String, String> {
    let told = Command::new("rustc").arg("-vV").output().map_err(|error| format!("rustc: {error}"))?;
    let told = String::from_utf8_lossy(&told.stdout).into_owned();
    let line = told.lines().find_map(|line| line.strip_prefix("host: "));
    line.map(str::to_owned).ok_or_else(|| "rustc does not say its host".into())
}
