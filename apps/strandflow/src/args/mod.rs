//! All of clap: what can be typed. Resolved into domain objects by the subcommands before any work starts.

use clap::{Parser, Subcommand};

mod animate;
mod annotate;
mod check;
mod evaluate;
mod export;
mod farm;
mod new;
mod render;
mod run;
mod synth;
mod view;

pub use self::{
    animate::AnimateArgs,
    annotate::AnnotateArgs,
    check::CheckArgs,
    evaluate::EvaluateArgs,
    export::{ExportArgs, ExportStage, Format, TargetArg},
    farm::{Engine, FarmArgs},
    new::NewArgs,
    render::{OverlayArgs, RenderArgs, ReportArgs, SequenceStage},
    run::{BenchArgs, RunArgs, StatusArgs},
    synth::{DemoArgs, SynthArgs},
    view::ViewArgs,
};

const FIRST_STEPS: &str = "\
First steps:
  strandflow demo                           a small synthetic take, all stages, scores, exports
  strandflow new TAKE --capture DIR         footage, clean plates, a calibration of any format (docs/capture.md)
  strandflow check TAKE                     what is wrong with the rig, the footage or the labels, if anything
  strandflow run TAKE                       resumes where it stopped; Ctrl-C loses nothing
  strandflow status TAKE
  strandflow export TAKE --stage blend --to usd OUT.usdc";

/// Multi-view video of moving hair in, animated strands with fitted physics out.
///
/// Exit codes: 0 done, 1 failed, 2 bad usage or bad input.
#[derive(Debug, Parser)]
#[command(name = "strandflow", version, propagate_version = true, after_help = FIRST_STEPS)]
pub struct Args {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The subcommands, one file each.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Make a take for footage and a calibration; says what it guesses, copies no footage.
    New(NewArgs),
    /// Look a take over before a run: calibration, clocks, footage, masks, markers; says what is wrong and what to do.
    Check(CheckArgs),
    /// Run the stages; resumes where a run stopped, repeats what is stale.
    Run(RunArgs),
    /// What is done, stale, missing or failed, and why.
    Status(StatusArgs),
    /// Score results against truth, and in views that were held out.
    Evaluate(EvaluateArgs),
    /// Write strands, guides, hair cards or the velocity field in a format that other programs read.
    Export(ExportArgs),
    /// Drive another groom with the captured motion; needs the results of a take, not its footage.
    Animate(AnimateArgs),
    /// Draw strands over one image of the footage.
    Overlay(OverlayArgs),
    /// Render strands as hair: a still, a turntable or the footage's own view, as PNG or video.
    Render(RenderArgs),
    /// Write a page that says how a take stands: health by stage, strands over footage, plots, time, what to do next.
    Report(ReportArgs),
    /// Look at a take in the browser: strands in 3D and over footage, layers, timeline, one strand over time.
    View(ViewArgs),
    /// Label markers, paint masks, correct the head and sketch strands in the browser.
    Annotate(AnnotateArgs),
    /// Make a synthetic capture with truth.
    Synth(SynthArgs),
    /// Make a small synthetic capture, run everything on it, score it and write exports. Needs no file.
    Demo(DemoArgs),
    /// Time the dynamics on this machine: kernels, a strand, threads.
    Bench(BenchArgs),
}
