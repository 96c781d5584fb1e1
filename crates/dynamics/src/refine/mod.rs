//! The whole chain from noisy strand tracks to refined ones, many strands at a time.
//!
//! 1. [`track`]: samples of one hair and the trust in each from its neighbours in time; the shape behind their noise (`shape`) and
//!    the way of the root (`root`).
//! 2. [`clean`]: missing samples filled by simulation and by what is seen beside them (`continuation`), a local quadratic filter in
//!    head space, and prox.
//! 3. [`windows`]: overlapping windows fitted to the *original* samples with parameters and initial velocity free,
//!    averaged; repeated; what the samples say beside them added back; finished with prox.
//!
//! Strands of similar particle count share a bundle, one strand a lane. Results do not depend on threads.
//!
//! Reference: Zhang, Wu, Zhang et al. 2012, §5.2.
//! Deviation: cleaning, velocities as variables, original targets in all passes, prox. Measured on a helix with 3 mm of
//! noise: error 0.93 mm instead of 1.61 (paper's loop), and no growth with the number of passes.

pub mod bundle;
pub mod clean;
mod continuation;
mod fields;
pub mod filter;
mod identity;
mod newton;
mod root;
mod search;
mod shape;
pub mod track;
pub mod windows;

use glam::DVec3;
use rayon::prelude::*;
use strandflow_core::RigidTransform;

use crate::{
    kernels::{Kernels, LaneTask, on_widest_lanes},
    params::Params,
};

pub use track::{Body, Track};
pub use windows::EXCITED_BELOW;

/// The parameters that Gauss–Newton moves, in the order of [`Refined::covariance`].
pub const MOVED: [&str; 4] = ["k_bend", "k_torsion", "k_alt", "drag"];

/// Choices of the chain.
#[derive(Clone, Debug, PartialEq)]
pub struct RefineOptions {
    /// Passes over the take.
    pub outer_passes: usize,
    /// Frames that a window predicts.
    pub window_frames: usize,
    /// σ of the aging weights \[frames\].
    pub aging_frames: f64,
    /// Steps per frame.
    pub substeps: usize,
    /// Accepted optimiser steps per window.
    pub iterations: usize,
    /// Evaluations per window.
    pub evaluations: usize,
    /// Gauss–Newton steps per window; 0 takes the quasi-Newton search of `iterations` and `evaluations` instead. One comes
    /// about as far as eight of its steps; see `docs/dynamics.md`.
    pub newton_steps: usize,
    /// Half the range of the log parameters around the start.
    pub log_range: f64,
    /// Weight of Σ (δv / 100 mm/s)² against the mean squared distance \[mm²\].
    pub velocity_prior: f64,
    /// Step of the prox \[s\].
    pub prox_secs: f64,
    /// Step of the prox after a pass \[s\]; with the 5 ms of the first a noisy helix ends further off.
    pub finish_secs: f64,
    /// Edge length of the strands \[mm\], used where the data are too noisy to tell.
    pub edge_mm: f64,
    /// Where the parameters start.
    pub start: Params,
    /// The letter of the paper: no cleaning, forward velocity, updated positions as targets, no prox.
    pub letter: bool,
}

impl Default for RefineOptions {
    fn default() -> Self {
        Self {
            outer_passes: 2,
            window_frames: 6,
            aging_frames: 4.0,
            substeps: 5,
            iterations: 8,
            evaluations: 12,
            newton_steps: 1,
            log_range: 4.0,
            velocity_prior: 1e-2,
            prox_secs: 5e-3,
            finish_secs: 2e-3,
            edge_mm: 5.0,
            start: Params::default(),
            letter: false,
        }
    }
}

/// What all strands of a take share.
#[derive(Clone, Copy, Debug)]
pub struct Take<'a> {
    /// The head's motion, one entry a frame.
    pub world_from_head: &'a [RigidTransform],
    /// Gravity \[mm/s²\], world.
    pub gravity: DVec3,
    /// Frame interval \[s\].
    pub frame_secs: f64,
}

/// One refined strand.
#[derive(Clone, Debug, PartialEq)]
pub struct Refined {
    /// Positions \[mm\], world, shape (T, n). Finite.
    pub points: Vec<DVec3>,
    /// Positions after cleaning, before any window, shape (T, n).
    pub cleaned: Vec<DVec3>,
    /// Geometric mean of the parameters over the windows of the last pass.
    pub params: Params,
    /// Windows of all passes: fitted, stopped where the last step made nothing better (or at the limit of the quasi-Newton
    /// search), failed (and replaced by the cleaned state).
    pub windows: [usize; 3],
    /// Covariance of the logarithms of bend, torsion and altitude stiffness and drag, from the windows of the last pass; no
    /// variance exceeds `log_range`² / 3. None without Gauss–Newton. Derived in `windows/certainty.rs`.
    pub covariance: Option<[[f64; 4]; 4]>,
    /// Root mean square distance to the samples of frames that the windows before them had not seen \[mm\], weighted by
    /// trust: of the simulation, and of velocities kept from where the fitted windows end. Holds the samples' own noise.
    /// None where no such frame has a sample.
    pub held_out_mm: Option<[f64; 2]>,
}

/// Refines strands. Strands without any usable sample come back as `None`, in the order of the input.
pub fn refine(tracks: &[Track], take: &Take, options: &RefineOptions) -> Vec<Option<Refined>> {
    on_widest_lanes(All { tracks, bodies: &[], take, options })
}

/// [`refine`] for a stretch of a longer take, over which strand i has the body `bodies[i]`: those are refined even where no
/// sample can be used.
pub fn refine_stretch(
    tracks: &[Track],
    bodies: &[Option<Body>],
    take: &Take,
    options: &RefineOptions,
) -> Vec<Option<Refined>> {
    on_widest_lanes(All { tracks, bodies, take, options })
}

/// [`refine`] on a given lane type.
pub fn refine_on<R: Kernels>(tracks: &[Track], take: &Take, options: &RefineOptions) -> Vec<Option<Refined>> {
    All { tracks, bodies: &[], take, options }.run::<R>()
}

/// Strands, and their bodies where these are known.
struct All<'a> {
    tracks: &'a [Track],
    bodies: &'a [Option<Body>],
    take: &'a Take<'a>,
    options: &'a RefineOptions,
}

impl LaneTask for All<'_> {
    type Output = Vec<Option<Refined>>;

    fn run<R: Kernels>(self) -> Self::Output {
        let Self { tracks, bodies, take, options } = self;
        let body = |i: usize| bodies.get(i).and_then(Option::as_ref);
        let prepared: Vec<Option<track::Prepared>> =
            (0..tracks.len()).into_par_iter().map(|i| track::prepare(&tracks[i], body(i), take, options)).collect();
        // Equal particle counts next to one another, so that lanes are padded little.
        let mut order: Vec<usize> = (0..tracks.len()).filter(|&i| prepared[i].is_some()).collect();
        order.sort_by_key(|&i| (tracks[i].particle_count, i));
        let done: Vec<Vec<(usize, Refined)>> = order
            .par_chunks(R::COUNT)
            .map(|members| {
                let lanes: Vec<&track::Prepared> = members.iter().filter_map(|&i| prepared[i].as_ref()).collect();
                let refined = windows::refine_bundle::<R>(&lanes, take, options);
                members.iter().copied().zip(refined).collect()
            })
            .collect();
        let mut out = vec![None; tracks.len()];
        for (i, refined) in done.into_iter().flatten() {
            out[i] = Some(refined);
        }
        out
    }
}
