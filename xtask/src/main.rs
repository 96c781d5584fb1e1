//! Set-up, checks and tests of the workspace: `cargo xtask setup | web | test | fuzz | faults | licences`.

mod fuzz;
mod licences;

use std::{
    fs,
    path::{Path, PathBuf},
    process::{Command, ExitCode},
    time::SystemTime,
};

const USAGE: &str =
    "cargo xtask setup    install what the tests use beyond Rust: ffmpeg, python3-openvdb, Chromium, Slurm, foreign readers in
                     target/python, and build the page
cargo xtask web      build the pages of `strandflow view` and `annotate` into web/dist (needs Node); the next build of the program holds it
cargo xtask test     setup, then all tests; what could not be installed is skipped and said so
cargo xtask fuzz [--seconds N] [TARGET…]    builds the fuzz targets of the readers (needs a C++ compiler) and runs each for N seconds, 10 without
cargo xtask faults [--kills N]    kills runs N times at random moments, 100 without, damages what is on the disk, and prints what that cost
cargo xtask licences    looks at the licence and the source of every crate of the lock file";

fn main() -> ExitCode {
    if let Some(compiled) = fuzz::compile() {
        return compiled;
    }
    let task = std::env::args().nth(1).unwrap_or_default();
    let strict = std::env::var_os("CI").is_some();
    let done = match task.as_str() {
        "setup" => setup(strict),
        "web" => web(),
        "fuzz" => fuzz::fuzz(&std::env::args().skip(2).collect::<Vec<_>>()),
        "licences" => licences::licences(),
        "faults" => faults(&std::env::args().skip(2).collect::<Vec<_>>()),
        "test" => setup(strict).and_then(|()| test()),
        _ => Err(format!("no such task: `{task}`\n{USAGE}")),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(fact) => {
            eprintln!("error: {fact}");
            ExitCode::FAILURE
        }
    }
}

/// Installs Debian packages and the foreign readers, and builds the page. `strict`: a missing thing is an error, else a notice.
fn setup(strict: bool) -> Result<(), String> {
    for (what, had) in [
        ("ffmpeg (videos)", ffmpeg()),
        ("python3-openvdb (volumes)", openvdb()),
        ("chromium (pages)", chromium()),
        ("slurm-wlm and munge (a take on many machines)", slurm()),
        ("alembic3d, numpy, usd-core, zarr (foreign readers)", readers()),
        ("the pages of `strandflow view` and `annotate`", node().and_then(|()| web())),
    ] {
        match had {
            Ok(()) => {}
            Err(fact) if strict => return Err(format!("{what}: {fact}")),
            Err(fact) => eprintln!("notice: {what}: {fact}; the tests that need it will say `skipped`"),
        }
    }
    Ok(())
}

fn ffmpeg() -> Result<(), String> {
    debian("ffmpeg", Command::new("ffmpeg").arg("-version"))
}

/// A C++ compiler, for libFuzzer.
fn compiler() -> Result<(), String> {
    let program = std::env::var_os("CXX").unwrap_or_else(|| "c++".into());
    debian("g++", Command::new(program).arg("--version")).map_err(|fact| format!("a C++ compiler is needed: {fact}"))
}

/// Belongs to the system's interpreter; a virtual environment does not see it.
fn openvdb() -> Result<(), String> {
    debian("python3-openvdb", Command::new("/usr/bin/python3").args(["-c", "import pyopenvdb"]))
}

fn chromium() -> Result<(), String> {
    debian("chromium", Command::new("/usr/bin/chromium").arg("--version"))
}

/// A scheduler, which tests start on the loopback. Debian would start it as a service, where services are started.
fn slurm() -> Result<(), String> {
    debian("munge", Command::new("/usr/sbin/munged").arg("--version"))?;
    debian("slurm-wlm", Command::new("/usr/sbin/slurmctld").arg("-V"))
}

/// Node with npm, which builds the page and drives the browser.
fn node() -> Result<(), String> {
    debian("nodejs", Command::new("node").arg("--version"))?;
    debian("npm", Command::new("npm").arg("--version"))
}

/// Builds the page: third-party scripts by the lock file, then one bundle. The program builds without; it then says so.
fn web() -> Result<(), String> {
    let has = |program: &str| Command::new(program).arg("--version").output().is_ok_and(|o| o.status.success());
    if let Some(missing) = ["node", "npm"].into_iter().find(|program| !has(program)) {
        return Err(format!("`{missing}` is missing; install Node 20 or later with npm (Debian: nodejs npm)"));
    }
    let folder = root().join("web");
    if page_is_new(&folder) {
        return Ok(());
    }
    let npm = |args: &[&str]| run(Command::new("npm").current_dir(&folder).args(args));
    npm(&["ci", "--no-audit", "--no-fund"])?;
    npm(&["run", "build"])
}

/// Whether the page was built after its sources were last changed: built anew it would rebuild the program.
fn page_is_new(folder: &Path) -> bool {
    fn newest(path: &Path) -> Option<SystemTime> {
        let name = path.file_name()?.to_str()?;
        if ["node_modules", "dist", ".test"].contains(&name) {
            return None;
        }
        match fs::read_dir(path) {
            Ok(entries) => entries.flatten().filter_map(|entry| newest(&entry.path())).max(),
            Err(_) => fs::metadata(path).and_then(|data| data.modified()).ok(),
        }
    }
    let built = ["index.html", "app.js", "app.css", "annotate.html", "annotate.js", "annotate.css"]
        .map(|file| folder.join("dist").join(file));
    let oldest = built.iter().map(|file| fs::metadata(file).and_then(|data| data.modified()).ok()).min().flatten();
    folder.join("node_modules").is_dir() && oldest.is_some_and(|built| newest(folder).is_some_and(|made| made < built))
}

/// Installs a Debian package, unless the check says that it is there.
fn debian(package: &str, check: &mut Command) -> Result<(), String> {
    if check.output().is_ok_and(|o| o.status.success()) {
        return Ok(());
    }
    run(Command::new("apt-get").args(["update", "-qq"]))?;
    run(Command::new("apt-get").args(["install", "-y", "-qq", "--no-install-recommends", package]))?;
    if check.output().is_ok_and(|o| o.status.success()) {
        Ok(())
    } else {
        Err(format!("{package} was installed and does not run"))
    }
}

fn readers() -> Result<(), String> {
    let python = python();
    let have = || {
        let check = Command::new(&python).args(["-c", "import alembic3d, numpy, zarr; from pxr import Usd"]).output();
        check.is_ok_and(|o| o.status.success())
    };
    if have() {
        return Ok(());
    }
    let folder = root().join("target/python");
    run(Command::new("python3").args(["-m", "venv"]).arg(&folder))?;
    run(Command::new(&python).args(["-m", "pip", "install", "-q", "-r"]).arg(root().join("tools/requirements.txt")))?;
    if have() { Ok(()) } else { Err("installed, but cannot be imported".into()) }
}

/// The interpreter that holds the foreign readers; tests find it in `STRANDFLOW_PYTHON`.
fn python() -> PathBuf {
    root().join("target/python/bin/python3")
}

fn test() -> Result<(), String> {
    run(cargo().args(["test", "--workspace", "--no-fail-fast"]))
}

/// The tests of mishaps, those on a Slurm among them, one after the other, and what they tell: the table of `docs/faults.md`.
fn faults(arguments: &[String]) -> Result<(), String> {
    let kills = match arguments {
        [] => "100",
        [option, number] if option == "--kills" && number.parse::<usize>().is_ok() => number,
        _ => return Err("write `cargo xtask faults [--kills N]`".into()),
    };
    let rows = std::env::temp_dir().join(format!("strandflow-faults-{}.md", std::process::id()));
    let which = ["mishaps::", "farm::on_slurm", "--test-threads", "1"];
    let tests = [&["test", "-p", "strandflow", "--test", "all", "--"][..], &which].concat();
    let done = run(cargo().env("STRANDFLOW_KILLS", kills).env("STRANDFLOW_FAULTS", &rows).args(tests));
    let told = fs::read_to_string(&rows).unwrap_or_default();
    // It may not have been made.
    let _ = fs::remove_file(&rows);
    eprintln!("| fault | times | lost | made again | what became of it |\n|---|---:|---:|---:|---|\n{told}");
    done
}

fn cargo() -> Command {
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo.current_dir(root()).env("STRANDFLOW_PYTHON", python());
    cargo
}

fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
}

/// Where cargo builds.
fn target() -> PathBuf {
    // A relative one is relative to the folder that cargo was called in, which is the root where the gate calls it.
    root().join(std::env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into()))
}

/// What a command says.
fn said(command: &mut Command) -> Result<String, String> {
    let output = command.output().map_err(|error| format!("{command:?}: {error}"))?;
    if output.status.success() {
        return Ok(String::from_utf8_lossy(&output.stdout).into_owned());
    }
    Err(format!("{command:?} ended with {}\n{}", output.status, String::from_utf8_lossy(&output.stderr)))
}

fn run(command: &mut Command) -> Result<(), String> {
    eprintln!("running: {command:?}");
    let status = command.status().map_err(|error| format!("{command:?}: {error}"))?;
    if status.success() { Ok(()) } else { Err(format!("{command:?} ended with {status}")) }
}
