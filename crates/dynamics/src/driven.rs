//! Strands that a velocity field carries: eq. 3 with the field's velocities, and contact with a head.
//!
//! Before each substep a particle's velocity goes to the field's, at once or over the following time; then the springs act by
//! an implicit step, and particles that came too near to the head are moved out. Where the field says nothing a particle
//! keeps its velocity: hair that reaches past the captured one swings by itself. The longer the following time, the nearer
//! the motion is to that of a simulation on the moving head.
//!
//! Reference: Zhang, Wu, Zhang et al. 2012, §5.5 and eq. 3.
//! *Deviation*: the paper takes over the field's velocities once a frame; here every substep does, with the field interpolated in
//! time, and a following time can be given.

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use strandflow_core::RigidTransform;

use crate::{
    Jacobian, Params,
    kernels::{Kernels, LaneTask, on_widest_lanes},
    lanes::{V3, zero3},
    params::LaneParams,
    rest::LaneRest,
    system::StepConstants,
    window::{WindowInput, WindowWorkspace},
};

mod contact;
mod hung;

pub use contact::{Contact, lay_outside};
pub use hung::Hung;

/// Particles that follow the head, as in the fit.
pub const CLAMPED: usize = 3;

/// The field can tear at hair faster than its springs restore it; at the end of a frame no edge differs by more than this share
/// from the groom's. Hair stretches by less; much less than 1 % is within what single precision and contact leave.
const MOST_STRETCH: f64 = 0.01;

/// What the strands meet within a frame. A share is a time: 0 at the frame's start, 1 at the next frame.
pub trait Surroundings: Sync {
    /// The head.
    fn world_from_head(&self, share: f64) -> RigidTransform;
    /// The field's velocity \[mm/s\], world; `None` where it says nothing.
    fn velocity(&self, share: f64, point: DVec3) -> Option<DVec3>;
    /// What a point, world, meets that strands may not enter; `None` where it is free.
    fn contact(&self, share: f64, point: DVec3) -> Option<Contact>;
}

/// How strands are driven.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriveOptions {
    /// Time over which a particle's velocity goes to the field's where that is known \[s\]: 0, and the hair goes where the
    /// field goes; infinite, and the field is not asked at all.
    pub follow_secs: f64,
    /// Frame interval \[s\].
    pub frame_secs: f64,
    /// Implicit steps a frame.
    pub substeps: usize,
    /// Gravity \[mm/s²\], world.
    pub gravity: DVec3,
    /// Rate at which contact takes away speed along the head \[1/s\].
    pub friction: f64,
}

/// Positions and velocities of all particles, strand after strand.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DrivenState {
    /// World \[mm\].
    pub points: Vec<Vec3>,
    /// World \[mm/s\].
    pub velocities: Vec<Vec3>,
}

/// Advances all strands by one frame, in place. `strands` in the order of the state; strands of fewer than two particles stay.
///
/// The same bytes at any number of threads.
pub fn advance_frame(strands: &[Hung], state: &mut DrivenState, around: &dyn Surroundings, options: &DriveOptions) {
    struct Frame<'a>(&'a [Hung], &'a mut DrivenState, &'a dyn Surroundings, &'a DriveOptions);
    impl LaneTask for Frame<'_> {
        type Output = ();
        fn run<R: Kernels>(self) {
            advance_on::<R>(self.0, self.1, self.2, self.3);
        }
    }
    on_widest_lanes(Frame(strands, state, around, options));
}

/// [`advance_frame`] on a given lane type.
pub fn advance_on<R: Kernels>(
    strands: &[Hung],
    state: &mut DrivenState,
    around: &dyn Surroundings,
    options: &DriveOptions,
) {
    let mut starts = Vec::with_capacity(strands.len());
    let mut total = 0;
    for strand in strands {
        starts.push(total);
        total += strand.particle_count();
    }
    // Equal particle counts next to one another, so that lanes are padded little.
    let mut order: Vec<usize> = (0..strands.len()).filter(|&n| strands[n].particle_count() > 1).collect();
    order.sort_by_key(|&n| (strands[n].particle_count(), n));
    let given: &DrivenState = state;
    let advanced: Vec<Vec<(usize, Moved)>> = order
        .par_chunks(R::COUNT)
        .map(|members| {
            let lanes: Vec<Lane> = members
                .iter()
                .map(|&n| {
                    let range = starts[n]..starts[n] + strands[n].particle_count();
                    Lane {
                        strand: &strands[n],
                        points: &given.points[range.clone()],
                        velocities: &given.velocities[range],
                    }
                })
                .collect();
            let done = Bundle::<R>::new(&lanes, around, options).advance(around);
            members.iter().copied().zip(done).collect()
        })
        .collect();
    for (n, (points, velocities)) in advanced.into_iter().flatten() {
        let range = starts[n]..starts[n] + points.len();
        state.points[range.clone()].copy_from_slice(&points);
        state.velocities[range].copy_from_slice(&velocities);
    }
}

/// The head at the start and the end of a substep.
type Skin<'a> = (&'a RigidTransform, &'a RigidTransform);

/// Points and velocities of one strand at the end of the frame.
type Moved = (Vec<Vec3>, Vec<Vec3>);

/// One strand and its state at the start of the frame.
struct Lane<'a> {
    strand: &'a Hung,
    points: &'a [Vec3],
    velocities: &'a [Vec3],
}

/// Strands in lanes over one frame.
struct Bundle<'a, R> {
    lanes: &'a [Lane<'a>],
    options: &'a DriveOptions,
    n: usize,
    fixed: usize,
    rest: LaneRest<R>,
    params: LaneParams<R>,
    constants: StepConstants<R>,
    /// Where each lane has its zero, so that single precision suffices \[mm\].
    origins: Vec<DVec3>,
    /// Clamped particles at the start and end of each substep, shape (substeps + 1, fixed).
    path: Vec<V3<R>>,
    x: Vec<V3<R>>,
    v: Vec<V3<R>>,
    /// The field's velocities in the last substep, shape (lanes, n).
    field: Vec<DVec3>,
}

impl<'a, R: Kernels> Bundle<'a, R> {
    fn new(lanes: &'a [Lane<'a>], around: &dyn Surroundings, options: &'a DriveOptions) -> Self {
        let shapes: Vec<_> = lanes.iter().map(|lane| &lane.strand.rest).collect();
        let rest = LaneRest::new(&shapes);
        let n = rest.n;
        let fixed = CLAMPED.min(lanes.iter().map(|lane| lane.points.len()).min().unwrap_or(0));
        let of_lane = |lane: usize| lanes.get(lane).unwrap_or(&lanes[0]);
        let origins: Vec<DVec3> = (0..R::COUNT).map(|lane| of_lane(lane).points[0].as_dvec3()).collect();
        let mut params = LaneParams::splat(&Params::default());
        (0..R::COUNT).for_each(|lane| params.set(lane, &Params { drag: 0.0, ..of_lane(lane).strand.params }));
        let mut bundle = Self {
            lanes,
            options,
            n,
            fixed,
            rest,
            params,
            constants: StepConstants {
                dt: R::splat(options.frame_secs / options.substeps as f64),
                gravity: options.gravity.to_array().map(R::splat),
                transverse: Jacobian::Clamped.transverse(),
                kinematic: fixed,
            },
            origins,
            path: vec![zero3(); (options.substeps + 1) * fixed],
            x: vec![zero3(); n],
            v: vec![zero3(); n],
            field: vec![DVec3::ZERO; R::COUNT * n],
        };
        for lane in 0..R::COUNT {
            let (from, origin) = (of_lane(lane), bundle.origins[lane]);
            let mut last = DVec3::ZERO;
            for i in 0..n {
                // Past its end a lane goes on along a line that no spring holds.
                last = from.points.get(i).map_or(last + DVec3::X * 5.0, |p| p.as_dvec3() - origin);
                set(&mut bundle.x[i], lane, last);
                set(&mut bundle.v[i], lane, from.velocities.get(i).map_or(DVec3::ZERO, |v| v.as_dvec3()));
            }
            for s in 0..=options.substeps {
                let pose = around.world_from_head(s as f64 / options.substeps as f64);
                for i in 0..fixed {
                    let point = pose.point(from.strand.in_head[i]) - origin;
                    set(&mut bundle.path[s * fixed + i], lane, point);
                }
            }
        }
        bundle
    }

    /// The frame's substeps; points and velocities of each lane.
    fn advance(mut self, around: &dyn Surroundings) -> Vec<Moved> {
        let (n, fixed, substeps) = (self.n, self.fixed, self.options.substeps);
        let mut workspace = WindowWorkspace::<R>::new(n, 1);
        let (targets, weights) = (vec![zero3(); n], vec![R::zero(); n]);
        for s in 0..substeps {
            let share = |steps: f64| (s as f64 + steps) / substeps as f64;
            let pose = around.world_from_head(share(0.5));
            for lane in 0..self.lanes.len() {
                if s == 0 {
                    self.look_ahead(lane, around);
                }
                self.carry(lane, around, share(0.5), &pose);
            }
            let input = WindowInput {
                rest: &self.rest,
                params: self.params,
                constants: self.constants,
                substeps: 1,
                x0: &self.x,
                v0: &self.v,
                path: &self.path[s * fixed..(s + 2) * fixed],
                targets: &targets,
                weights: &weights,
            };
            R::simulate(&input, &mut workspace);
            self.x.copy_from_slice(workspace.positions(1));
            self.v.copy_from_slice(workspace.velocities(1));
            let (from, to) = (around.world_from_head(share(0.0)), around.world_from_head(share(1.0)));
            for lane in 0..self.lanes.len() {
                let meets = |point: DVec3| around.contact(share(1.0), point);
                if s + 1 == substeps {
                    self.settle(lane, &meets, (&from, &to));
                } else {
                    self.collide(lane, &meets, (&from, &to));
                }
            }
        }
        (0..self.lanes.len()).map(|lane| self.unloaded(lane)).collect()
    }

    /// The field's velocities where the frame begins.
    fn look_ahead(&mut self, lane: usize, around: &dyn Surroundings) {
        for i in 0..self.lanes[lane].points.len() {
            let here = self.get(&self.x[i], lane);
            self.field[lane * self.n + i] = around.velocity(0.0, here).unwrap_or(DVec3::ZERO);
        }
    }

    /// Before a step: the field's velocity, drag, and the force that held the strand at rest.
    fn carry(&mut self, lane: usize, around: &dyn Surroundings, share: f64, pose: &RigidTransform) {
        let (strand, dt) = (self.lanes[lane].strand, self.options.frame_secs / self.options.substeps as f64);
        let driven = self.options.follow_secs.is_finite();
        let kept = if self.options.follow_secs > 0.0 { (-dt / self.options.follow_secs).exp() } else { 0.0 };
        let slowed = (-dt * strand.params.drag).exp();
        for i in self.fixed..strand.particle_count() {
            let e = lane * self.n + i;
            let here = self.get(&self.x[i], lane);
            // Where the particle will be in the middle of the step, as far as the field knows.
            let known = if driven { around.velocity(share, here + 0.5 * dt * self.field[e]) } else { None };
            let before = vector(&self.v[i], lane);
            // Drag is relative to air that moves with the field.
            let carried = known.map_or(before * slowed, |field| field + (before - field) * (kept * slowed));
            self.field[e] = known.unwrap_or(carried);
            let held = strand.holding(i, self.tangent(lane, i), pose);
            set(&mut self.v[i], lane, carried + dt * held);
        }
    }

    /// Unit direction of the strand at a particle.
    fn tangent(&self, lane: usize, i: usize) -> DVec3 {
        let last = self.lanes[lane].points.len() - 1;
        let (a, b) = (self.get(&self.x[i.saturating_sub(1)], lane), self.get(&self.x[(i + 1).min(last)], lane));
        (b - a).normalize_or_zero()
    }

    /// At the frame's end: edges within [`MOST_STRETCH`] of the groom's, particles and edges outside of everything.
    fn settle(&mut self, lane: usize, meets: &impl Fn(DVec3) -> Option<Contact>, skin: Skin) {
        let groom = &self.lanes[lane].strand.in_head;
        let edge = |i: usize| groom[i].distance(groom[i - 1]);
        let limits = |i: usize| ((1.0 - MOST_STRETCH) * edge(i), (1.0 + MOST_STRETCH) * edge(i));
        let mut points: Vec<DVec3> = (0..groom.len()).map(|i| self.get(&self.x[i], lane)).collect();
        let mut touched: Vec<(usize, Contact)> = Vec::new();
        lay_outside(&mut points, self.fixed, limits, meets, |i, met| touched.push((i, *met)));
        for (i, met) in touched {
            self.slow(lane, i, &met, skin);
        }
        for (i, point) in points.into_iter().enumerate().skip(self.fixed) {
            set(&mut self.x[i], lane, point - self.origins[lane]);
        }
    }

    /// After a step within a frame: particles out of everything.
    fn collide(&mut self, lane: usize, meets: &impl Fn(DVec3) -> Option<Contact>, skin: Skin) {
        for i in self.fixed..self.lanes[lane].points.len() {
            let point = self.get(&self.x[i], lane);
            if let Some(met) = meets(point) {
                self.slow(lane, i, &met, skin);
                set(&mut self.x[i], lane, point + met.normal * met.depth - self.origins[lane]);
            }
        }
    }

    /// Takes away a particle's speed into what it met, and some of that along it.
    fn slow(&mut self, lane: usize, i: usize, met: &Contact, (from, to): Skin) {
        let dt = self.options.frame_secs / self.options.substeps as f64;
        let (here, velocity) = (self.get(&self.x[i], lane), vector(&self.v[i], lane));
        let surface = if met.on_head { (here - from.point(to.inverse().point(here))) / dt } else { DVec3::ZERO };
        let relative = velocity - surface;
        let across = relative.dot(met.normal);
        let along = relative - met.normal * across;
        let taken = met.normal * across.min(0.0) + along * (1.0 - (-self.options.friction * dt).exp());
        set(&mut self.v[i], lane, velocity - taken);
    }

    fn get(&self, point: &V3<R>, lane: usize) -> DVec3 {
        vector(point, lane) + self.origins[lane]
    }

    fn unloaded(&self, lane: usize) -> Moved {
        let count = self.lanes[lane].points.len();
        let points = (0..count).map(|i| self.get(&self.x[i], lane).as_vec3()).collect();
        (points, (0..count).map(|i| vector(&self.v[i], lane).as_vec3()).collect())
    }
}

fn vector<R: Kernels>(v: &V3<R>, lane: usize) -> DVec3 {
    DVec3::new(v[0].get(lane), v[1].get(lane), v[2].get(lane))
}

fn set<R: Kernels>(slot: &mut V3<R>, lane: usize, value: DVec3) {
    for (slot, value) in slot.iter_mut().zip(value.to_array()) {
        slot.set(lane, value);
    }
}

#[cfg(test)]
mod tests;
