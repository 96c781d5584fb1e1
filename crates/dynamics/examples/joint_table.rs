//! Prints the joint table of the robust chain: error, jitter and length of straight, wavy and helical strands with 3 mm
//! of noise, clean, in unmodelled wind, and with outlier frames and hidden tails. With the argument `scalar` the same by
//! the scalar double-precision chain.
#![allow(clippy::print_stdout, missing_docs)]

#[path = "../tests/truth/mod.rs"]
mod truth;

use std::time::Instant;

use strandflow_dynamics::{
    GRAVITY,
    refine::{RefineOptions, Take, Track, refine, refine_on},
};
use truth::{
    FRAME_SECS, Scene, Shape, Truth, error, jitter, lengths, noisy, regrown, spoil, swap, tip_speed, truth as simulate,
};

fn row(name: &str, scenes: &[(Truth, Track)], options: &RefineOptions) {
    let scalar = std::env::args().any(|a| a == "scalar");
    let start = Instant::now();
    let mut means = [0.0; 8];
    let (mut low, mut high) = (f64::MAX, f64::MIN);
    let mut windows = [0; 3];
    let tracks: Vec<Track> = scenes.iter().map(|(_, track)| track.clone()).collect();
    let take = Take { world_from_head: &scenes[0].0.world_from_head, gravity: GRAVITY, frame_secs: FRAME_SECS };
    let refined = if scalar { refine_on::<f64>(&tracks, &take, options) } else { refine(&tracks, &take, options) };
    let secs = start.elapsed().as_secs_f64();
    let tip = scenes.iter().map(|(truth, _)| tip_speed(truth) / 1000.0).fold(0.0, f64::max);
    for ((truth, track), refined) in scenes.iter().zip(&refined) {
        let Some(refined) = refined else { continue };
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
    let [input, cleaned, refined, j_input, j_cleaned, j, j_truth, deviation] = means;
    println!(
        "{name:22} error {input:5.2} {cleaned:5.2} {refined:5.2}  jitter {j_input:5.2} {j_cleaned:5.2} {j:5.2} (truth \
         {j_truth:4.2}, tip {tip:.1} m/s)  length {low:.1}-{high:.1} std {deviation:.2}  windows {windows:?}  {:.3} ms/window",
        1e3 * secs / windows.iter().sum::<usize>().max(1) as f64
    );
}

fn main() {
    let mut options = RefineOptions::default();
    // `search` takes the quasi-Newton search instead of Gauss–Newton, a number so many Gauss–Newton steps.
    for arg in std::env::args().skip(1) {
        options.newton_steps = if arg == "search" { 0 } else { arg.parse().unwrap_or(options.newton_steps) };
    }
    println!("                        input, cleaned, refined [mm]");
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
        let scenes: Vec<(Truth, Track)> = (0..16)
            .map(|seed| {
                let truth = simulate(&Scene { seed, ..scene });
                let track = noisy(&truth, sigma, seed);
                (truth, track)
            })
            .collect();
        row(name, &scenes, &options);
    }
    for (name, tip) in [("helix, regrown 15 mm", 15.0), ("helix, regrown 40 mm", 40.0)] {
        let scenes: Vec<(Truth, Track)> = (0..16)
            .map(|seed| {
                let truth = simulate(&Scene { frames: 30, seed, ..Scene::default() });
                let track = regrown(&truth, tip, seed);
                (truth, track)
            })
            .collect();
        row(name, &scenes, &options);
    }
    for (name, damage) in
        [("helix, spoilt", spoil as fn(&mut Track, u64)), ("helix, two hairs", |track, _| swap(track))]
    {
        let scenes: Vec<(Truth, Track)> = (0..16)
            .map(|seed| {
                let truth = simulate(&Scene { seed, ..Scene::default() });
                let mut track = noisy(&truth, 3.0, seed);
                damage(&mut track, seed);
                (truth, track)
            })
            .collect();
        row(name, &scenes, &options);
    }
}
