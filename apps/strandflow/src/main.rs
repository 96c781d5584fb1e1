//! The `strandflow` command.
//!
//! stdout is data, stderr is talk. Exit codes: 0 done, 1 failed, 2 bad usage or bad input.

mod animate;
mod animate_groom;
mod animate_score;
mod annotate;
mod args;
mod bench;
mod capture_files;
mod check;
mod demo;
mod evaluate;
mod export;
mod failure;
mod farm;
mod foreign;
mod held_out;
mod new;
mod overlay;
mod progress;
mod render;
mod render_out;
mod render_scene;
mod report;
mod run;
mod score_table;
mod scores;
mod serving;
mod sketch_drawings;
mod sketch_lengths;
mod sketch_table;
mod sketched;
mod status;
mod status_farm;
mod stdout;
mod synth;
mod view;

use std::process::ExitCode;

use clap::Parser;

use crate::{
    args::{Args, Command},
    failure::Failed,
};

fn main() -> ExitCode {
    let args = Args::parse();
    tracing_subscriber::fmt()
        .with_env_filter(tracing_subscriber::EnvFilter::from_env("STRANDFLOW_LOG"))
        .with_writer(std::io::stderr)
        .init();
    let result = match args.command {
        Command::New(args) => new::new(&args),
        Command::Check(args) => check::check(&args),
        Command::Run(args) => run::run(&args),
        Command::Status(args) => status::status(&args),
        Command::Evaluate(args) => evaluate::evaluate(&args),
        Command::Export(args) => export::export(&args),
        Command::Animate(args) => animate::animate(&args),
        Command::Overlay(args) => overlay::overlay(&args),
        Command::Render(args) => render::render(&args),
        Command::Report(args) => report::report(&args),
        Command::View(args) => view::view(&args),
        Command::Annotate(args) => annotate::annotate(&args),
        Command::Synth(args) => synth::synth(&args),
        Command::Demo(args) => demo::demo(&args),
        Command::Bench(args) => bench::bench(&args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(Failed { error, hint, input }) => {
            eprintln!("error: {error}");
            if !hint.is_empty() {
                eprintln!("hint: {hint}");
            }
            ExitCode::from(if input { 2 } else { 1 })
        }
    }
}
