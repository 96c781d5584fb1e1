//! The asked-and-told optimiser against an independent L-BFGS-B on problems with active bounds.

use rcompat_lbfgsb::{Bounds, OptimControl, optim_lbfgsb_with_gradient};
use strandflow_dynamics::lbfgs::{Lbfgs, Limits, Stop};

/// The chained Rosenbrock function.
fn rosenbrock(x: &[f64]) -> (f64, Vec<f64>) {
    let mut g = vec![0.0; x.len()];
    let mut f = 0.0;
    for i in 0..x.len() - 1 {
        let (a, b) = (1.0 - x[i], x[i + 1] - x[i] * x[i]);
        f += a * a + 100.0 * b * b;
        g[i] += -2.0 * a - 400.0 * b * x[i];
        g[i + 1] += 200.0 * b;
    }
    (f, g)
}

fn solve(start: &[f64], lower: &[f64], upper: &[f64]) -> Lbfgs {
    let mut search = Lbfgs::new(start.to_vec(), lower.to_vec(), upper.to_vec(), Limits::default());
    while let Some(x) = search.ask() {
        let (f, g) = rosenbrock(x);
        search.tell(f, &g);
    }
    search
}

#[test]
fn bounded_rosenbrock_agrees_with_the_reference() {
    let n = 6;
    for (lower, upper) in [(-3.0, 3.0), (-3.0, 0.8), (1.1, 3.0), (-0.5, 0.5)] {
        let start: Vec<f64> = (0..n).map(|i| if i % 2 == 0 { -1.2 } else { 1.0 }).collect();
        let (low, high) = (vec![lower; n], vec![upper; n]);
        let clamped: Vec<f64> = start.iter().map(|x: &f64| x.clamp(lower, upper)).collect();
        let mut control = OptimControl::default_for_dimension(n);
        (control.maxit, control.factr) = (2000, 10.0);
        let bounds = Bounds::new(low.clone(), high.clone()).expect("bounds");
        let reference = optim_lbfgsb_with_gradient(clamped, bounds, |x| rosenbrock(x).0, |x| rosenbrock(x).1, control)
            .expect("ran");
        let search = solve(&start, &low, &high);
        let (f, x) = search.best();
        assert!(x.iter().all(|x| (lower..=upper).contains(x)));
        assert!((f - reference.value).abs() < 1e-6 * (1.0 + reference.value), "{f} {}", reference.value);
        for (a, b) in x.iter().zip(&reference.par) {
            assert!((a - b).abs() < 1e-3, "[{lower}, {upper}] {x:?} {:?}", reference.par);
        }
    }
}

#[test]
fn values_that_are_not_finite_shorten_the_step() {
    let mut search = Lbfgs::new(vec![2.0], vec![f64::NEG_INFINITY], vec![f64::INFINITY], Limits::default());
    while let Some(x) = search.ask() {
        let x = x[0];
        let (f, g) = if x <= 0.0 { (f64::NAN, f64::NAN) } else { (x - x.ln(), 1.0 - 1.0 / x) };
        search.tell(f, &[g]);
    }
    assert!((search.best().1[0] - 1.0).abs() < 1e-6);
    let mut failed = Lbfgs::new(vec![2.0], vec![0.0], vec![3.0], Limits::default());
    failed.tell(f64::NAN, &[0.0]);
    assert_eq!(failed.stop(), Some(Stop::Failed));
}
