//! Prints the joint table of the robust chain: error, jitter and length of straight, wavy and helical strands with 3 mm
//! of noise, clean, in unmodelled wind, and with outlier frames and hidden tails; then what is identifiable: standard
//! deviations of the log parameters, and held-out frames. With the argument `scalar` the same by the scalar
//! double-precision chain; with `both` the errors of the two beside one another.
#![allow(clippy::print_stdout, missing_docs)]

#[path = "../tests/truth/mod.rs"]
mod truth;

use std::time::Instant;

use strandflow_dynamics::{
    GRAVITY,
    refine::{RefineOptions, Refined, Take, Track, refine, refine_on},
};
use truth::{
    FRAME_SECS, Scene, Shape, Truth, error, jitter, lengths, noisy, regrown, spoil, swap, tip_speed, truth as simulate,
};

/// Strands of one kind: the truth and what is given of it.
type Scenes = [(Truth, Track)];
/// A row: its name, the true drag where the model has one, its strands.
type Kind<'a> = (&'a str, Option<f64>, Vec<(Truth, Track)>);

/// Whether the command line has this word.
fn asked(word: &str) -> bool {
    std::env::args().any(|a| a == word)
}

fn fitted(scenes: &Scenes, options: &RefineOptions, scalar: bool) -> Vec<Option<Refined>> {
    let tracks: Vec<Track> = scenes.iter().map(|(_, track)| track.clone()).collect();
    let take = Take { world_from_head: &scenes[0].0.world_from_head, gravity: GRAVITY, frame_secs: FRAME_SECS };
    if scalar { refine_on::<f64>(&tracks, &take, options) } else { refine(&tracks, &take, options) }
}

/// Mean refined error \[mm\] of the strands that came back.
fn refined_error(scenes: &Scenes, refined: &[Option<Refined>]) -> f64 {
    let of = |((truth, track), r): (&(Truth, Track), &Option<Refined>)| {
        r.as_ref().map(|r| error(&r.points, truth, |e| track.weights[e] > 0.0))
    };
    let each: Vec<f64> = scenes.iter().zip(refined).filter_map(of).collect();
    each.iter().sum::<f64>() / each.len().max(1) as f64
}

/// The packs' refined error beside that of scalar doubles; whether it is within 3 %, or 0.01 mm where it is under 0.05 mm.
fn beside(name: &str, scenes: &Scenes, options: &RefineOptions) -> bool {
    let [packs, doubles] = [false, true].map(|scalar| refined_error(scenes, &fitted(scenes, options, scalar)));
    println!("{name:22} {packs:9.4} {doubles:9.4} {:8.4} {:9.4}", packs / doubles, packs - doubles);
    if doubles > 0.05 { (packs / doubles - 1.0).abs() <= 0.03 } else { (packs - doubles).abs() <= 0.01 }
}

/// Standard deviations of the log parameters, how many strands excite each, held-out frames, and how far drag is from the
/// truth in standard deviations: root mean square, and the scatter among the strands alone.
fn certainty(name: &str, drag: Option<f64>, refined: &[Option<Refined>]) {
    let refined: Vec<&Refined> = refined.iter().flatten().collect();
    let share = 1.0 / refined.len().max(1) as f64;
    let (mut deviations, mut excited, mut held_out, mut z) = ([0.0; 4], [0; 4], [0.0; 2], [0.0; 2]);
    for r in &refined {
        let (Some(each), Some(found)) = (r.deviations(), r.excited()) else { return };
        (0..4).for_each(|a| deviations[a] += share * each[a]);
        (0..4).for_each(|a| excited[a] += usize::from(found[a]));
        let pair = r.held_out_mm.unwrap_or([f64::NAN; 2]);
        (0..2).for_each(|k| held_out[k] += share * pair[k]);
        let off = drag.map_or(f64::NAN, |drag| (r.params.drag / drag).ln() / each[3]);
        (0..2).for_each(|k| z[k] += share * off.powi(k as i32 + 1));
    }
    let [bend, torsion, altitude, d] = deviations;
    let [simulated, extrapolated] = held_out;
    print!(
        "{name:22} {bend:6.3} {torsion:7.3} {altitude:8.3} {d:6.3}  {excited:2?}  {simulated:6.3} {extrapolated:6.3}"
    );
    let [mean, square] = z;
    let scatter = (square - mean * mean).max(0.0).sqrt();
    println!(
        "{}",
        if mean.is_finite() { format!("{:8.1} {scatter:8.1}", square.sqrt()) } else { "       –        –".into() }
    );
}

fn row(name: &str, scenes: &Scenes, options: &RefineOptions) -> Vec<Option<Refined>> {
    let start = Instant::now();
    let mut means = [0.0; 8];
    let (mut low, mut high) = (f64::MAX, f64::MIN);
    let mut windows = [0; 3];
    let refined = fitted(scenes, options, asked("scalar"));
    let secs = start.elapsed().as_secs_f64();
    let tip = scenes.iter().map(|(truth, _)| tip_speed(truth) / 1000.0).fold(0.0, f64::max);
    for ((truth, track), strand) in scenes.iter().zip(&refined) {
        let Some(refined) = strand else { continue };
        let length = lengths(&refined.points, truth.n);
        (low, high) = (low.min(length[0]), high.max(length[1]));
        let all = |e: usize| track.weights[e] > 0.0;
        let values = [
            error(&track.points, truth, all),
            error(&refined.cleaned, truth, all),
            error(&refined.points, truth, all),
            jitter(&track.points, truth.n),
            jitter(&refined.cleaned, truth.n),
            jitter(&refined.points, truth.n),
            jitter(&truth.points, truth.n),
            length[3],
        ];
        (0..8).for_each(|k| means[k] += values[k] / scenes.len() as f64);
        (0..3).for_each(|k| windows[k] += refined.windows[k]);
    }
    let [input, cleaned, after, j_input, j_cleaned, j, j_truth, deviation] = means;
    println!(
        "{name:22} error {input:5.2} {cleaned:5.2} {after:5.2}  jitter {j_input:5.2} {j_cleaned:5.2} {j:5.2} (truth \
         {j_truth:4.2}, tip {tip:.1} m/s)  length {low:.1}-{high:.1} std {deviation:.2}  windows {windows:?}  {:.3} ms/window",
        1e3 * secs / windows.iter().sum::<usize>().max(1) as f64
    );
    refined
}

fn main() {
    let mut options = RefineOptions::default();
    // `search` takes the quasi-Newton search instead of Gauss–Newton, a number so many Gauss–Newton steps.
    for arg in std::env::args().skip(1) {
        options.newton_steps = if arg == "search" { 0 } else { arg.parse().unwrap_or(options.newton_steps) };
    }
    let mut kinds: Vec<Kind> = Vec::new();
    let (plain, fast) = (Scene::default(), Scene::fast());
    for (name, scene, sigma) in [
        ("straight", Scene { shape: Shape::Straight, ..plain }, 3.0),
        ("wavy", Scene { shape: Shape::Wavy, ..plain }, 3.0),
        ("helix", plain, 3.0),
        ("straight, clean", Scene { shape: Shape::Straight, ..plain }, 0.0),
        ("helix, clean", plain, 0.0),
        ("helix, sigma 1", plain, 1.0),
        ("helix, wind", Scene { wind: 8000.0, step_secs: 1e-3, ..plain }, 3.0),
        ("fast straight", Scene { shape: Shape::Straight, ..fast }, 3.0),
        ("fast wavy", Scene { shape: Shape::Wavy, ..fast }, 3.0),
        ("fast helix", fast, 3.0),
        ("fast helix, storm", Scene { wind: 32000.0, step_secs: 1e-3, ..fast }, 3.0),
    ] {
        // Wind is no part of the model, so that there is no true drag.
        let drag = (scene.wind == 0.0).then_some(scene.params.drag);
        kinds.push((name, drag, strands(scene, |truth, seed| noisy(truth, sigma, seed))));
    }
    let half = Scene { frames: 30, ..plain };
    for (name, tip) in [("helix, regrown 15 mm", 15.0), ("helix, regrown 40 mm", 40.0)] {
        kinds.push((name, Some(plain.params.drag), strands(half, |truth, seed| regrown(truth, tip, seed))));
    }
    for (name, damage) in
        [("helix, spoilt", spoil as fn(&mut Track, u64)), ("helix, two hairs", |track, _| swap(track))]
    {
        let damaged = |truth: &Truth, seed| {
            let mut track = noisy(truth, 3.0, seed);
            damage(&mut track, seed);
            track
        };
        kinds.push((name, Some(plain.params.drag), strands(plain, damaged)));
    }
    if asked("both") {
        println!("refined error [mm]         packs   doubles    ratio     apart");
        let kept = kinds.iter().filter(|(name, _, scenes)| beside(name, scenes, &options)).count();
        println!("alike within 3 % (clean: 0.01 mm) in {kept} of {} rows", kinds.len());
        return;
    }
    println!("                        input, cleaned, refined [mm]");
    let refined: Vec<_> = kinds.iter().map(|(name, _, scenes)| row(name, scenes, &options)).collect();
    if options.newton_steps > 0 {
        println!(
            "\nstandard deviations of log parameters, strands of 16 that excite them, held-out frames [mm], z of drag"
        );
        println!(
            "                         bend torsion altitude   drag  excited           simul. extrap. rms z  scatter"
        );
        for ((name, drag, _), refined) in kinds.iter().zip(&refined) {
            certainty(name, *drag, refined);
        }
    }
}

/// Sixteen strands of a scene, one a seed, and their tracks.
fn strands(scene: Scene, track: impl Fn(&Truth, u64) -> Track) -> Vec<(Truth, Track)> {
    (0..16)
        .map(|seed| {
            let truth = simulate(&Scene { seed, ..scene });
            let track = track(&truth, seed);
            (truth, track)
        })
        .collect()
}
