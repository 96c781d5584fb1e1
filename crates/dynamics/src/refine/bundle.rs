//! Strands in lanes: positions, trust and root paths of a bundle.

use glam::DVec3;

use crate::{
    kernels::Kernels,
    lanes::{V3, zero3},
    params::{LaneParams, Params},
    refine::{RefineOptions, Take, root::CLAMPED, track::Prepared},
    rest::LaneRest,
    system::{Jacobian, StepConstants},
    window::WindowWorkspace,
};

/// A bundle of strands; lanes past the last strand repeat the first.
pub struct Bundle<R> {
    /// Particles, padded.
    pub n: usize,
    /// Clamped particles.
    pub fixed: usize,
    /// Frames.
    pub frames: usize,
    /// Rest shapes.
    pub rest: LaneRest<R>,
    /// Kinematic positions, shape (T, fixed), relative to the lane's origin \[mm\].
    pub path: Vec<V3<R>>,
    /// The origin of each lane in the world \[mm\], so that single precision suffices.
    pub origins: Vec<DVec3>,
    /// Particles of each lane.
    pub counts: Vec<usize>,
    /// Constants of a simulation step.
    pub step: StepConstants<R>,
    /// Constants of a prox step.
    pub prox: StepConstants<R>,
    /// Constants of a finishing step.
    pub finish: StepConstants<R>,
    /// Parameters of a finishing step.
    pub finish_params: LaneParams<R>,
    /// Parameters of a prox step.
    pub prox_params: LaneParams<R>,
}

impl<R: Kernels> Bundle<R> {
    /// Puts prepared strands into lanes.
    pub fn new(lanes: &[&Prepared], take: &Take, options: &RefineOptions) -> Self {
        let frames = take.world_from_head.len();
        let shapes: Vec<_> = lanes.iter().map(|p| &p.rest).collect();
        let rest = LaneRest::new(&shapes);
        let n = rest.n;
        let fixed = CLAMPED.min(lanes.iter().map(|p| p.n).min().unwrap_or(0));
        let of_lane = |lane: usize| lanes.get(lane).or(lanes.first());
        let origins = (0..R::COUNT)
            .map(|lane| of_lane(lane).map_or(DVec3::ZERO, |p| take.world_from_head[frames / 2].point(p.median[0])))
            .collect();
        let constants = |dt: f64| StepConstants {
            dt: R::splat(dt),
            gravity: take.gravity.to_array().map(R::splat),
            transverse: Jacobian::Clamped.transverse(),
            kinematic: fixed,
        };
        let mut bundle = Self {
            n,
            fixed,
            frames,
            rest,
            path: vec![zero3(); frames * fixed],
            origins,
            counts: (0..R::COUNT).map(|lane| of_lane(lane).map_or(0, |p| p.n)).collect(),
            step: constants(take.frame_secs / options.substeps as f64),
            prox: constants(options.prox_secs),
            finish: constants(options.finish_secs),
            prox_params: LaneParams::splat(&options.start.undamped()),
            finish_params: LaneParams::splat(&options.start.undamped()),
        };
        for lane in 0..R::COUNT {
            // Prox weighs shape against data; cleaner data weigh more.
            let share = of_lane(lane).map_or(1.0, |p| (p.noise_mm / FULL_PROX_NOISE_MM).powi(4).clamp(1e-5, 1.0));
            let stiffness = options.start.stiffness.map(|k| share * k);
            (0..3).for_each(|axis| {
                bundle.prox.gravity[axis].set(lane, share * take.gravity[axis]);
                bundle.finish.gravity[axis].set(lane, share * take.gravity[axis]);
            });
            let mut finish = stiffness;
            finish[0] *= FINISH_EDGES;
            bundle.finish_params.set(lane, &Params { stiffness: finish, damping: [0.0; 4], drag: 0.0 });
            bundle.prox_params.set(lane, &Params { stiffness, damping: [0.0; 4], drag: 0.0 });
        }
        for t in 0..frames {
            for i in 0..fixed {
                for lane in 0..R::COUNT {
                    let Some(p) = of_lane(lane) else { continue };
                    let point = take.world_from_head[t].point(p.root(t)[i]) - bundle.origins[lane];
                    set(&mut bundle.path[t * fixed + i], lane, point);
                }
            }
        }
        bundle
    }

    /// World positions of one frame from a lane's points, padded past its end by a line that no spring holds.
    pub fn put(&self, out: &mut [V3<R>], lane: usize, points: impl Fn(usize) -> DVec3) {
        let count = self.counts[lane];
        let mut last = DVec3::ZERO;
        for (i, slot) in out.iter_mut().enumerate() {
            last = if i < count { points(i) - self.origins[lane] } else { last + DVec3::new(5.0, 0.0, 0.0) };
            set(slot, lane, last);
        }
    }

    /// World position of a lane \[mm\].
    pub fn get(&self, point: &V3<R>, lane: usize) -> DVec3 {
        DVec3::new(point[0].get(lane), point[1].get(lane), point[2].get(lane)) + self.origins[lane]
    }

    /// Prox of one frame in place, with the root on its path at frame `t`.
    pub fn relax(&self, t: usize, x: &mut [V3<R>], scratch: &mut Vec<V3<R>>, workspace: &mut WindowWorkspace<R>) {
        x[..self.fixed].copy_from_slice(&self.path[t * self.fixed..(t + 1) * self.fixed]);
        scratch.clear();
        scratch.extend_from_slice(x);
        R::relax(&self.rest, &self.prox_params, &self.prox, PROX_STEPS, (scratch, x), workspace);
    }

    /// Prox of one frame in place after a pass: restores the lengths and leaves the shape to the windows.
    pub fn finish(&self, t: usize, x: &mut [V3<R>], scratch: &mut Vec<V3<R>>, workspace: &mut WindowWorkspace<R>) {
        x[..self.fixed].copy_from_slice(&self.path[t * self.fixed..(t + 1) * self.fixed]);
        scratch.clear();
        scratch.extend_from_slice(x);
        R::relax(&self.rest, &self.finish_params, &self.finish, PROX_STEPS, (scratch, x), workspace);
    }

    /// Parameters in all lanes.
    pub fn params(&self, params: &Params) -> LaneParams<R> {
        LaneParams::splat(params)
    }
}

/// Noise per coordinate from which on the prox acts fully \[mm\]; below, its stiffness falls with the fourth power, so
/// that clean strands are left alone.
const FULL_PROX_NOISE_MM: f64 = 1.0;

/// Steps of the prox; after six it is within 0.01 mm of its limit.
const PROX_STEPS: usize = 6;

/// Edge stiffness of the finishing prox against that of the first: its step is shorter, so that the rest shape, which is
/// an estimate, bends the result less. With edges alike the length varies more.
const FINISH_EDGES: f64 = 4.0;

/// Sets one lane of a vector.
pub fn set<R: Kernels>(slot: &mut V3<R>, lane: usize, value: DVec3) {
    for (slot, value) in slot.iter_mut().zip(value.to_array()) {
        slot.set(lane, value);
    }
}
