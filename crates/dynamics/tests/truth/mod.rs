//! Synthetic strands of known motion: simulated at a finer step under a shaken head, with dials for noise.
#![allow(dead_code)] // each user takes its part

use glam::{DMat3, DVec3};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use strandflow_core::RigidTransform;
use strandflow_dynamics::{
    Forces, GRAVITY, Model, Params, RestShape, State, Workspace,
    refine::{Refined, Track},
    step,
};

/// Frame interval \[s\].
pub const FRAME_SECS: f64 = 0.01;

/// The rest shapes of the tables.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    Straight,
    Wavy,
    Helix,
}

impl Shape {
    /// `n` particles 5 mm apart from the origin on, outward along +x.
    pub fn points(self, n: usize) -> Vec<DVec3> {
        let at = |s: f64| match self {
            Self::Straight => DVec3::new(s, 0.0, 0.0),
            Self::Wavy => DVec3::new(s, 0.0, 6.0 * (s / 50.0 * std::f64::consts::TAU).sin()),
            Self::Helix => {
                let turn = s / 35.0 * std::f64::consts::TAU;
                DVec3::new(s, 8.0 * (turn.cos() - 1.0), 8.0 * turn.sin())
            }
        };
        let mut points = vec![at(0.0)];
        let mut s = 0.0;
        while points.len() < n {
            let last = points[points.len() - 1];
            let (mut low, mut high) = (s, s + 5.0);
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if at(middle).distance(last) < 5.0 { low = middle } else { high = middle }
            }
            s = high;
            points.push(at(s));
        }
        points
    }
}

/// A simulated strand under a shaken head.
pub struct Truth {
    pub n: usize,
    pub world_from_head: Vec<RigidTransform>,
    /// Shape (T, n).
    pub points: Vec<DVec3>,
}

/// What the truth is simulated with.
#[derive(Clone, Copy)]
pub struct Scene {
    pub shape: Shape,
    pub n: usize,
    pub frames: usize,
    pub step_secs: f64,
    /// Root mean square acceleration by an unmodelled wind \[mm/s²\].
    pub wind: f64,
    /// Distance of the root from the axis of the shake \[mm\].
    pub radius_mm: f64,
    /// Angle of the strand at the root below the horizon \[radians\].
    pub tilt: f64,
    /// How far the head turns, against ±46°.
    pub shake: f64,
    /// What the strand is made of.
    pub params: Params,
    pub seed: u64,
}

/// Stiffness, with damping tied to it by `tau`, and drag.
const fn material(k: [f64; 4], tau: f64, drag: f64) -> Params {
    Params { stiffness: k, damping: [tau * k[0], tau * k[1], tau * k[2], tau * k[3]], drag }
}

impl Scene {
    /// A livelier strand than that of the tables' bars: less drag, near resonance; the tip reaches 2.5 m/s.
    pub fn fast() -> Self {
        Self {
            radius_mm: 80.0,
            tilt: 0.9,
            params: material([1.3e7, 1.5e5, 0.7e5, 1.5e4], 1e-3, 4.0),
            ..Self::default()
        }
    }
}

impl Default for Scene {
    fn default() -> Self {
        Self {
            shape: Shape::Helix,
            n: 40,
            frames: 60,
            step_secs: 5e-4,
            wind: 0.0,
            radius_mm: 90.0,
            tilt: std::f64::consts::FRAC_PI_2,
            shake: 1.0,
            params: material([2e7, 3e5, 5e4, 3e4], 6e-4, 8.0),
            seed: 1,
        }
    }
}

/// The head: `shake` times ±46° about the vertical at 1.6 Hz.
pub fn head_at(secs: f64, shake: f64) -> RigidTransform {
    let angle = shake * 46f64.to_radians() * (std::f64::consts::TAU * 1.6 * secs).sin();
    RigidTransform { rotation: DMat3::from_rotation_z(angle), translation: DVec3::new(100.0, 0.0, 1500.0) }
}

/// A standard normal number.
pub fn normal(rng: &mut Pcg64Mcg) -> f64 {
    let (u, v): (f64, f64) = (rng.random::<f64>().max(1e-300), rng.random());
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

/// Simulates a scene; the first half second settles the strand.
pub fn truth(scene: &Scene) -> Truth {
    let mut rng = Pcg64Mcg::seed_from_u64(scene.seed);
    let turn = DMat3::from_rotation_y(scene.tilt);
    let root = DVec3::new(scene.radius_mm, 0.0, 0.0);
    let rest: Vec<DVec3> = scene.shape.points(scene.n).iter().map(|p| turn * *p + root).collect();
    let model = Model::new(RestShape::from_positions(&rest, 5.0), 3);
    let params = scene.params;
    let mut state = State::at_rest(&rest.iter().map(|p| head_at(0.0, scene.shake).point(*p)).collect::<Vec<_>>());
    let mut workspace = Workspace::new(&model);
    let per_frame = (FRAME_SECS / scene.step_secs).round() as usize;
    let settle = 80 * per_frame;
    let mut points = Vec::new();
    let mut poses = Vec::new();
    // Gusts: a slowly turning vector with a correlation time of 0.15 s.
    let mut wind = DVec3::ZERO;
    let (keep, push) = ((-scene.step_secs / 0.15).exp(), scene.wind / 3f64.sqrt());
    let kick = push * (1.0 - keep * keep).sqrt();
    for k in 0..settle + scene.frames * per_frame {
        if k >= settle && (k - settle).is_multiple_of(per_frame) {
            points.extend_from_slice(&state.x);
            poses.push(head_at(k as f64 * scene.step_secs, scene.shake));
        }
        let head = head_at((k + 1) as f64 * scene.step_secs, scene.shake);
        let target: Vec<DVec3> = rest[..3].iter().map(|p| head.point(*p)).collect();
        wind = wind * keep + kick * DVec3::new(normal(&mut rng), normal(&mut rng), normal(&mut rng));
        let push = vec![wind; scene.n];
        let forces = Forces { gravity: GRAVITY, acceleration: &push };
        step(&model, &params, &mut state, &mut workspace, scene.step_secs, &target, &forces);
    }
    Truth { n: scene.n, world_from_head: poses, points }
}

/// The truth with independent noise of σ \[mm\] per coordinate; the three clamped particles have none.
pub fn noisy(truth: &Truth, sigma: f64, seed: u64) -> Track {
    let mut rng = Pcg64Mcg::seed_from_u64(seed ^ 0x5eed);
    let mut noise = || sigma * DVec3::new(normal(&mut rng), normal(&mut rng), normal(&mut rng));
    let points: Vec<DVec3> =
        truth.points.iter().enumerate().map(|(e, p)| if e % truth.n < 3 { *p } else { *p + noise() }).collect();
    let weights = vec![1.0; points.len()];
    Track { particle_count: truth.n, points, weights }
}

/// The truth as if grown anew in each frame: edges of 5 mm along a smooth curve that errs by about `tip` \[mm\] at the
/// tip, independently in every frame, and in one of twenty frames jumps to other hair halfway.
pub fn regrown(truth: &Truth, tip: f64, seed: u64) -> Track {
    let mut rng = Pcg64Mcg::seed_from_u64(seed ^ 0x60);
    let mut track = noisy(truth, 0.0, seed);
    let n = truth.n;
    for strand in track.points.chunks_exact_mut(n) {
        let mut random = || DVec3::new(normal(&mut rng), normal(&mut rng), normal(&mut rng)) / 3f64.sqrt();
        let (bend, wave, jump) = (random(), random(), random());
        let jumps = random().x > 0.95;
        let wanted: Vec<DVec3> = (0..n)
            .map(|i| {
                let s = i as f64 / (n - 1) as f64;
                let off = if jumps && s > 0.5 { 4.0 * (s - 0.5) } else { 0.0 };
                strand[i] + tip * (s * bend + 0.5 * s * (7.0 * s).sin() * wave + off * jump)
            })
            .collect();
        for i in 1..n {
            strand[i] = strand[i - 1] + 5.0 * (wanted[i] - wanted[i - 1]).normalize();
        }
    }
    track
}

/// Spoils a track: a tenth of the frames displaced by 45 mm, and tails hidden in spells, down to 35 % of the length.
pub fn spoil(track: &mut Track, seed: u64) {
    let mut rng = Pcg64Mcg::seed_from_u64(seed ^ 0xbad);
    let n = track.particle_count;
    let mut phase = rng.random::<f64>() * 6.0;
    for (points, weights) in track.points.chunks_exact_mut(n).zip(track.weights.chunks_exact_mut(n)) {
        if rng.random::<f64>() < 0.1 {
            let offset = DVec3::new(normal(&mut rng), normal(&mut rng), normal(&mut rng)).normalize() * 45.0;
            points[3..].iter_mut().for_each(|p| *p += offset);
        }
        phase += 0.15;
        let visible = (0.8 + 0.45 * phase.sin()).clamp(0.35, 1.0);
        let hidden = (visible * n as f64) as usize;
        weights[hidden..].fill(0.0);
    }
}

/// Makes a track another hair for the last third of its frames, after two in which it is lost: all but the clamped particles
/// 50 mm aside.
pub fn swap(track: &mut Track) {
    let n = track.particle_count;
    let frames = track.points.len() / n;
    let lost = 2 * frames / 3;
    track.weights[lost * n..(lost + 2) * n].fill(0.0);
    for points in track.points.chunks_exact_mut(n).skip(lost) {
        points[3..].iter_mut().for_each(|p| *p += DVec3::new(30.0, 0.0, 40.0));
    }
}

/// Mean distance \[mm\] over the samples that count.
pub fn error(points: &[DVec3], truth: &Truth, counts: impl Fn(usize) -> bool) -> f64 {
    let each: Vec<f64> =
        (0..points.len()).filter(|&e| counts(e)).map(|e| points[e].distance(truth.points[e])).collect();
    each.iter().sum::<f64>() / each.len().max(1) as f64
}

/// The highest speed of the tip \[mm/s\].
pub fn tip_speed(truth: &Truth) -> f64 {
    let tip = |t: usize| truth.points[(t + 1) * truth.n - 1];
    let frames = truth.points.len() / truth.n;
    (1..frames).map(|t| tip(t).distance(tip(t - 1)) / FRAME_SECS).fold(0.0, f64::max)
}

/// Mean length of the second difference in time \[mm\].
pub fn jitter(points: &[DVec3], n: usize) -> f64 {
    let each: Vec<f64> =
        (2 * n..points.len()).map(|e| (points[e] - 2.0 * points[e - n] + points[e - 2 * n]).length()).collect();
    each.iter().sum::<f64>() / each.len().max(1) as f64
}

/// Lengths over the frames \[mm\]: least, greatest, mean, standard deviation.
pub fn lengths(points: &[DVec3], n: usize) -> [f64; 4] {
    let each: Vec<f64> =
        points.chunks_exact(n).map(|strand| strand.windows(2).map(|e| e[0].distance(e[1])).sum()).collect();
    let mean = each.iter().sum::<f64>() / each.len() as f64;
    let variance = each.iter().map(|l| (l - mean).powi(2)).sum::<f64>() / each.len() as f64;
    let (least, greatest) = each.iter().fold((f64::MAX, f64::MIN), |(a, b), &l| (a.min(l), b.max(l)));
    [least, greatest, mean, variance.sqrt()]
}

/// Windows that failed.
pub fn failures(refined: &Refined) -> usize {
    refined.windows[2]
}
