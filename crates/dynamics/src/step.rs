//! The scalar simulator: constant [`Model`], [`Params`], mutable [`State`], scratch [`Workspace`], and [`step`].
//!
//! ```
//! use glam::DVec3;
//! use strandflow_dynamics::{Forces, Model, Params, RestShape, State, Workspace, step};
//!
//! let rest: Vec<DVec3> = (0..20).map(|i| DVec3::new(5.0 * i as f64, 0.0, 0.0)).collect();
//! let model = Model::new(RestShape::from_positions(&rest, 5.0), 3);
//! let (mut state, mut workspace) = (State::at_rest(&rest), Workspace::new(&model));
//! let root = rest[..3].to_vec();
//! for _ in 0..50 {
//!     step(&model, &Params::default(), &mut state, &mut workspace, 0.002, &root, &Forces::default());
//! }
//! assert!(state.x[19].z < -10.0);
//! ```

use glam::DVec3;

use crate::{
    band,
    exact::{self, ExactWorkspace},
    lanes::V3,
    params::{LaneParams, Params},
    rest::{LaneRest, RestShape},
    system::{self, Jacobian, StepConstants},
};

/// Standard gravity along −z \[mm/s²\].
pub const GRAVITY: DVec3 = DVec3::new(0.0, 0.0, -9806.65);

/// What stays the same of a strand.
#[derive(Clone, Debug)]
pub struct Model {
    /// The rest shape.
    pub rest: RestShape,
    /// Kinematic particles, counted from the root. Three clamp position and direction; one is a free pendulum.
    pub kinematic: usize,
    /// Which Jacobian the step uses.
    pub jacobian: Jacobian,
    lanes: LaneRest<f64>,
}

impl Model {
    /// A strand of this rest shape with the clamped Jacobian.
    pub fn new(rest: RestShape, kinematic: usize) -> Self {
        let lanes = LaneRest::new(&[&rest]);
        Self { kinematic: kinematic.min(lanes.n), rest, jacobian: Jacobian::Clamped, lanes }
    }

    /// Number of particles.
    pub fn particle_count(&self) -> usize {
        self.lanes.n
    }
}

/// Where a strand is and how it moves.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct State {
    /// Positions \[mm\], root first.
    pub x: Vec<DVec3>,
    /// Velocities \[mm/s\], root first.
    pub v: Vec<DVec3>,
}

impl State {
    /// These positions with no velocity.
    pub fn at_rest(points: &[DVec3]) -> Self {
        Self { x: points.to_vec(), v: vec![DVec3::ZERO; points.len()] }
    }
}

/// What acts on a strand besides its springs and drag.
#[derive(Clone, Copy, Debug)]
pub struct Forces<'a> {
    /// Gravity \[mm/s²\].
    pub gravity: DVec3,
    /// Extra acceleration of each particle \[mm/s²\], or empty. Moving air of velocity u is drag · u.
    pub acceleration: &'a [DVec3],
}

impl Default for Forces<'_> {
    fn default() -> Self {
        Self { gravity: GRAVITY, acceleration: &[] }
    }
}

/// Scratch of one strand's steps; reused, so that a step allocates nothing.
#[derive(Clone, Debug)]
pub struct Workspace {
    x: Vec<V3<f64>>,
    v: Vec<V3<f64>>,
    q: Vec<V3<f64>>,
    a: Vec<band::BlockRow<f64>>,
    exact: ExactWorkspace,
}

impl Workspace {
    /// Scratch for this model.
    pub fn new(model: &Model) -> Self {
        let n = model.particle_count();
        Self {
            x: vec![[0.0; 3]; n],
            v: vec![[0.0; 3]; n],
            q: vec![[0.0; 3]; n],
            a: vec![band::zero_row(); n],
            exact: ExactWorkspace::default(),
        }
    }
}

/// Advances the state by one implicit Euler step of `dt` seconds (eq. 3). The model's kinematic particles go to
/// `targets` \[mm\] (at least `model.kinematic` entries); their velocity becomes the path's.
///
/// Positions stay finite for finite input: the clamped and the rank-1 system are positive definite for any state. The
/// exact one is not, and may throw a noisy strand far away.
/// Reference: Zhang, Wu, Zhang et al. 2012, eq. 3.
pub fn step(
    model: &Model,
    params: &Params,
    state: &mut State,
    workspace: &mut Workspace,
    dt: f64,
    targets: &[DVec3],
    forces: &Forces,
) {
    let Workspace { x, v, q, a, exact: scratch } = workspace;
    let (n, fixed) = (model.particle_count(), model.kinematic);
    for i in 0..n {
        (x[i], v[i]) = (state.x[i].to_array(), state.v[i].to_array());
    }
    let constants = StepConstants {
        dt,
        gravity: forces.gravity.to_array(),
        transverse: model.jacobian.transverse(),
        kinematic: fixed,
    };
    let params = LaneParams::splat(params);
    if model.jacobian == Jacobian::Exact {
        q.fill([0.0; 3]);
    } else {
        system::assemble(&model.lanes, &params, &constants, (x, v), a, q);
    }
    for (b, extra) in q.iter_mut().zip(forces.acceleration) {
        *b = (DVec3::from_array(*b) + dt * *extra).to_array();
    }
    // Known velocities first, then the free ones.
    for i in 0..fixed {
        q[i] = ((targets[i] - state.x[i]) / dt).to_array();
    }
    if model.jacobian == Jacobian::Exact {
        exact::solve_exact(&model.lanes, &params, &constants, (x, v), scratch, q);
    } else {
        system::condense(a, fixed, q);
        band::factor(a, fixed);
        band::solve(a, fixed, q);
    }
    for i in 0..n {
        state.v[i] = DVec3::from_array(q[i]);
        state.x[i] = if i < fixed { targets[i] } else { state.x[i] + dt * state.v[i] };
    }
}
