//! What any simulator of strands must do, whatever its springs.

use glam::{DMat3, DVec3};
use strandflow_dynamics::{Forces, GRAVITY, Model, Params, RestShape, State, Workspace, step};

fn helix(n: usize) -> Vec<DVec3> {
    (0..n).map(|i| DVec3::new(8.0 * (0.8 * i as f64).cos(), 8.0 * (0.8 * i as f64).sin(), -3.5 * i as f64)).collect()
}

/// A smooth velocity field \[mm/s\].
fn stir(i: usize) -> DVec3 {
    300.0 * DVec3::new((0.3 * i as f64).sin(), (0.2 * i as f64).cos(), (0.5 * i as f64).sin())
}

fn no_gravity() -> Forces<'static> {
    Forces { gravity: DVec3::ZERO, acceleration: &[] }
}

#[test]
fn a_turned_world_turns_the_motion() {
    let rest = helix(20);
    let turn = DMat3::from_rotation_x(0.7) * DMat3::from_rotation_z(1.9);
    let run = |r: DMat3| {
        let points: Vec<DVec3> = rest.iter().map(|p| r * *p).collect();
        let model = Model::new(RestShape::from_positions(&points, 5.0), 3);
        let mut state = State { v: (0..20).map(|i| r * stir(i)).collect(), x: points.clone() };
        let mut workspace = Workspace::new(&model);
        let forces = Forces { gravity: r * GRAVITY, acceleration: &[] };
        for _ in 0..100 {
            step(&model, &Params::default(), &mut state, &mut workspace, 2e-3, &points[..3], &forces);
        }
        state
    };
    let (plain, turned) = (run(DMat3::IDENTITY), run(turn));
    for (a, b) in plain.x.iter().zip(&turned.x) {
        assert!((turn * *a).distance(*b) < 1e-7, "{a} {b}");
    }
}

#[test]
fn springs_keep_momentum() {
    let rest = helix(20);
    let model = Model::new(RestShape::from_positions(&rest, 5.0), 0);
    let mut state = State { v: (0..20).map(stir).collect(), x: rest };
    let before: DVec3 = state.v.iter().sum();
    let mut workspace = Workspace::new(&model);
    let params = Params { drag: 0.0, ..Params::default() };
    for _ in 0..500 {
        step(&model, &params, &mut state, &mut workspace, 2e-3, &[], &no_gravity());
    }
    let after: DVec3 = state.v.iter().sum();
    assert!(before.distance(after) < 1e-6 * before.length(), "{before} {after}");
}

#[test]
fn energy_falls_and_never_rises_above_what_was_put_in() {
    let rest = helix(20);
    let model = Model::new(RestShape::from_positions(&rest, 5.0), 3);
    let mut state = State { v: (0..20).map(|i| if i < 3 { DVec3::ZERO } else { stir(i) }).collect(), x: rest.clone() };
    let kinetic = |s: &State| 0.5 * s.v.iter().map(|v| v.length_squared()).sum::<f64>();
    // At rest lengths no energy is in the springs.
    let given = kinetic(&state);
    let mut workspace = Workspace::new(&model);
    let params = Params { drag: 0.0, ..Params::default() };
    for _ in 0..2000 {
        step(&model, &params, &mut state, &mut workspace, 2e-3, &rest[..3], &no_gravity());
        assert!(kinetic(&state) <= given);
    }
    assert!(kinetic(&state) < 0.1 * given, "{} of {given}", kinetic(&state));
}

#[test]
fn a_hanging_chain_has_its_period() {
    // Edges alone: a chain. Its slowest mode turns with ½ j₀ √(g/L), j₀ = 2.4048 the first zero of the Bessel function.
    let n = 60;
    let rest: Vec<DVec3> = (0..n).map(|i| DVec3::new(0.0, 0.0, -5.0 * i as f64)).collect();
    let model = Model::new(RestShape::from_positions(&rest, 5.0), 1);
    let params = Params { stiffness: [1e8, 0.0, 0.0, 0.0], damping: [0.0; 4], drag: 0.0 };
    // Its shape at rest: J₀(j₀ √(s)), s from the free end; a parabola is near enough to start from.
    let shape = |i: usize| 2.0 * (i as f64 / (n - 1) as f64).powf(1.4);
    let mut state = State::at_rest(&rest.iter().enumerate().map(|(i, p)| *p + DVec3::X * shape(i)).collect::<Vec<_>>());
    let mut workspace = Workspace::new(&model);
    let dt = 2e-4;
    let mut crossings = Vec::new();
    let middle = |s: &State| s.x[2 * n / 3].x;
    for k in 0..20_000 {
        let before = middle(&state);
        step(&model, &params, &mut state, &mut workspace, dt, &rest[..1], &Forces::default());
        if before > 0.0 && middle(&state) <= 0.0 {
            crossings.push(k as f64 * dt);
        }
    }
    let periods = (crossings.len() - 1) as f64;
    let period = (crossings[crossings.len() - 1] - crossings[0]) / periods;
    // Masses sit at the particles: the chain is half an edge longer.
    let length = 5.0 * (n as f64 - 0.5);
    let wanted = std::f64::consts::TAU / (0.5 * 2.4048 * (9806.65 / length).sqrt());
    assert!((period / wanted - 1.0).abs() < 0.03, "{period} s, theory {wanted} s");
}

#[test]
fn a_curved_cantilever_sags_as_beam_theory_says() {
    // An arc in the plane whose joints turn by β. A bend spring over a joint of edges e resists a change of the angle
    // with κ = k (e sin β/2)²; the moment of the weight beyond the joint, over κ, is how far it turns.
    let (n, beta, edge) = (20, 0.3, 5.0);
    let mut rest = vec![DVec3::ZERO];
    for i in 1..n {
        let angle = beta * i as f64;
        rest.push(rest[i - 1] + edge * DVec3::new(angle.cos(), 0.0, angle.sin()));
    }
    let model = Model::new(RestShape::from_positions(&rest, edge), 3);
    let k = 1e5;
    let params = Params { stiffness: [1e9, k, 0.0, 0.0], damping: [0.0; 4], drag: 20.0 };
    // A weight so small that the joints turn by less than a hundredth of β.
    let weight = DVec3::new(0.0, 0.0, -0.05);
    let mut state = State::at_rest(&rest);
    let mut workspace = Workspace::new(&model);
    let forces = Forces { gravity: weight, acceleration: &[] };
    for _ in 0..20_000 {
        step(&model, &params, &mut state, &mut workspace, 0.02, &rest[..3], &forces);
    }
    let kappa = k * (edge * (0.5 * beta).sin()).powi(2);
    let mut wanted = DVec3::ZERO;
    for joint in 2..n - 1 {
        let moment: f64 = (joint + 1..n).map(|i| (rest[i] - rest[joint]).cross(weight).y).sum();
        wanted += (moment / kappa) * DVec3::Y.cross(rest[n - 1] - rest[joint]);
    }
    let found = state.x[n - 1] - rest[n - 1];
    assert!(wanted.length() > 0.01, "{wanted}");
    assert!(found.distance(wanted) < 0.03 * wanted.length(), "{found} against {wanted}");
}

#[test]
fn halving_the_step_halves_the_error() {
    let rest = helix(12);
    let model = Model::new(RestShape::from_positions(&rest, 5.0), 3);
    let params = Params { stiffness: [1e5, 1e4, 1e4, 1e3], damping: [100.0, 10.0, 10.0, 1.0], drag: 5.0 };
    let after = |steps: usize| {
        let (mut state, mut workspace) = (State::at_rest(&rest), Workspace::new(&model));
        for _ in 0..steps {
            let dt = 0.05 / steps as f64;
            step(&model, &params, &mut state, &mut workspace, dt, &rest[..3], &Forces::default());
        }
        state.x
    };
    let exact = after(25_600);
    let error = |steps: usize| -> f64 { after(steps).iter().zip(&exact).map(|(a, b)| a.distance(*b)).sum() };
    let ratio = error(100) / error(200);
    assert!((1.8..2.2).contains(&ratio), "{ratio}");
}

#[test]
fn ten_thousand_steps_stay_sane() {
    let rest = helix(40);
    let model = Model::new(RestShape::from_positions(&rest, 5.0), 3);
    // Points a millimetre or two off, as a reconstruction gives them.
    let mut state = State::at_rest(&rest.iter().enumerate().map(|(i, p)| *p + 0.005 * stir(7 * i)).collect::<Vec<_>>());
    let mut workspace = Workspace::new(&model);
    for k in 0..10_000 {
        let shake = DVec3::X * 30.0 * (0.02 * k as f64).sin();
        let root: Vec<DVec3> = rest[..3].iter().map(|p| *p + shake).collect();
        step(&model, &Params::default(), &mut state, &mut workspace, 2e-3, &root, &Forces::default());
        assert!(state.x.iter().all(|p| p.is_finite() && p.distance(root[0]) < 250.0), "step {k}");
    }
    let length = |x: &[DVec3]| x.windows(2).map(|e| e[0].distance(e[1])).sum::<f64>();
    assert!((length(&state.x) / length(&rest) - 1.0).abs() < 0.01);
}
