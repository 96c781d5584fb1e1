//! `strandflow demo`: a small synthetic capture, all stages, its score, exports and a picture.

use std::path::Path;

use strandflow_synth::{Style, SynthSpec};

use crate::{
    args::{
        DemoArgs, EvaluateArgs, ExportArgs, ExportStage, FarmArgs, Format, NewArgs, OverlayArgs, RunArgs,
        SequenceStage, TargetArg,
    },
    evaluate, export,
    failure::Failed,
    new, overlay, run, synth,
};

pub fn demo(args: &DemoArgs) -> Result<(), Failed> {
    let take = &args.out;
    prepare(take, args.force)?;
    let capture = take.join("capture");
    synth::make(&SynthSpec::demo(Style::Straight), &capture)?;
    new::new(&NewArgs {
        take: take.clone(),
        capture: capture.clone(),
        calibration: None,
        unit: None,
        convention: None,
        fps: None,
        up: None,
        hold_out: Vec::new(),
    })?;
    ask_for_fewer_strands(&take.join("strandflow.toml"))?;
    run::run(&RunArgs {
        take: take.clone(),
        from: None,
        to: None,
        items: None,
        frames: None,
        mode: None,
        threads: args.threads,
        verify: false,
        confined: false,
        unchecked: false,
        json: false,
        farm: FarmArgs::default(),
    })?;
    let scores = take.join("scores.json");
    evaluate::evaluate(&EvaluateArgs {
        take: take.clone(),
        truth: Some(capture.join("gt")),
        stage: None,
        strands: None,
        sketches: false,
        sketch_truth: None,
        plot: None,
        json: Some(scores.clone()),
    })?;
    let folder = take.join("export");
    for (format, name) in [
        (Format::Usd, "strands.usdc"),
        (Format::Abc, "strands.abc"),
        (Format::Npz, "strands.npz"),
        (Format::Hair, "hair"),
        (Format::Data, "data"),
        (Format::Ply, "ply"),
        (Format::Cards, "cards"),
        (Format::Vdb, "velocity"),
    ] {
        let out = folder.join(name);
        let stage = if format == Format::Vdb { ExportStage::Flow } else { ExportStage::Blend };
        let target = matches!(format, Format::Abc | Format::Cards | Format::Vdb).then_some(TargetArg::Blender);
        let guides = matches!(format, Format::Abc | Format::Cards).then_some(DEMO_GUIDES);
        let args = ExportArgs {
            take: take.clone(),
            stage: Some(stage),
            animation: None,
            to: format,
            target,
            strands: None,
            points: None,
            guides,
            out,
        };
        export::export(&args)?;
    }
    let picture = take.join("overlay.png");
    overlay::overlay(&OverlayArgs {
        take: take.clone(),
        stage: SequenceStage::Blend,
        view: "cam03".into(),
        frame: SynthSpec::demo(Style::Straight).rig.frames * 3 / 4,
        every: 4,
        provenance: false,
        out: picture.clone(),
    })?;
    eprintln!();
    for (what, path) in [
        ("capture with truth", capture.as_path()),
        ("results (Zarr)", &take.join("results.zarr")),
        ("scores", &scores),
        ("exports", &folder),
        ("strands over footage", &picture),
    ] {
        eprintln!("{what:<22}{}", path.display());
    }
    Ok(())
}

/// Guides of the demo: one for every twenty strands.
const DEMO_GUIDES: u32 = 100;

/// Strands of the demo: a quarter of the default, so that it takes a minute or two on two cores.
const DEMO_STRANDS: usize = 2000;

fn ask_for_fewer_strands(manifest: &Path) -> Result<(), Failed> {
    let text = std::fs::read_to_string(manifest)?;
    std::fs::write(manifest, format!("{text}\n[settings.scalp]\nroot_count = {DEMO_STRANDS}\n"))?;
    Ok(())
}

/// Makes room for the demo; a folder that the demo did not make is never removed.
fn prepare(take: &Path, force: bool) -> Result<(), Failed> {
    if !take.exists() {
        return Ok(());
    }
    let ours = take.join("capture/synth.toml").is_file();
    if !force || !ours {
        let hint = "give another folder with --out; --force writes over an earlier demo, and over nothing else";
        return Err(Failed::input(format!("{} exists already", take.display()), hint));
    }
    std::fs::remove_dir_all(take).map_err(Failed::from)
}
