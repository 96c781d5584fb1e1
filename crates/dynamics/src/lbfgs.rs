//! Bound-constrained L-BFGS that is asked and told, so that many problems can be evaluated together.
//!
//! A projected quasi-Newton method: variables at a bound whose gradient points outward are held, the two-loop
//! recursion runs on the others, and the line search bends the step along the bounds. It takes the variables of one
//! window (some hundred, six of them bounded) with 8 pairs of history.
//!
//! ```
//! use strandflow_dynamics::lbfgs::{Lbfgs, Limits};
//!
//! let mut search = Lbfgs::new(vec![3.0], vec![1.0], vec![9.0], Limits::default());
//! while let Some(x) = search.ask() {
//!     let (f, g) = ((x[0] + 1.0).powi(2), 2.0 * (x[0] + 1.0));
//!     search.tell(f, &[g]);
//! }
//! assert_eq!(search.best().1, [1.0]);
//! ```
//!
//! Reference: Zhu, Byrd, Lu, Nocedal 1994; Bertsekas 1982 (two-metric projection).

/// When a search ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Accepted steps.
    pub iterations: usize,
    /// Evaluations.
    pub evaluations: usize,
    /// Ends when the projected gradient's largest entry is below this times (1 + |f|).
    pub gradient: f64,
    /// Ends when a step lowers f by less than this times |f|.
    pub decrease: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { iterations: 200, evaluations: 400, gradient: 1e-10, decrease: 1e-14 }
    }
}

/// Why a search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// Gradient or decrease fell below its limit.
    Converged,
    /// Iterations or evaluations used up.
    Limit,
    /// The line search found no lower value.
    Stalled,
    /// The value at the start is not finite.
    Failed,
}

/// Pairs of history.
const MEMORY: usize = 8;
/// Sufficient decrease of the line search.
const ARMIJO: f64 = 1e-4;
/// Trials of one line search.
const TRIALS: usize = 12;

/// One search.
#[derive(Clone, Debug)]
pub struct Lbfgs {
    limits: Limits,
    lower: Vec<f64>,
    upper: Vec<f64>,
    x: Vec<f64>,
    f: f64,
    g: Vec<f64>,
    trial: Vec<f64>,
    direction: Vec<f64>,
    length: f64,
    trials: usize,
    pairs: Vec<(Vec<f64>, Vec<f64>)>,
    scale: Option<f64>,
    iterations: usize,
    evaluations: usize,
    stop: Option<Stop>,
}

impl Lbfgs {
    /// A search from `start` (clamped into its bounds; infinite bounds are none).
    pub fn new(start: Vec<f64>, lower: Vec<f64>, upper: Vec<f64>, limits: Limits) -> Self {
        let x: Vec<f64> = start.iter().zip(&lower).zip(&upper).map(|((x, l), u)| x.max(*l).min(*u)).collect();
        let n = x.len();
        Self {
            limits,
            lower,
            upper,
            trial: x.clone(),
            x,
            f: f64::NAN,
            g: vec![0.0; n],
            direction: vec![0.0; n],
            length: 1.0,
            trials: 0,
            pairs: Vec::with_capacity(MEMORY),
            scale: None,
            iterations: 0,
            evaluations: 0,
            stop: None,
        }
    }

    /// Sets the length of the first step per unit of gradient, e.g. [`Lbfgs::scale`] of a similar search.
    #[must_use]
    pub fn with_scale(mut self, scale: Option<f64>) -> Self {
        self.scale = scale;
        self
    }

    /// The inverse curvature that the search has seen last.
    pub fn scale(&self) -> Option<f64> {
        self.scale
    }

    /// Where the next value is wanted; `None` when the search has ended.
    pub fn ask(&self) -> Option<&[f64]> {
        self.stop.is_none().then_some(self.trial.as_slice())
    }

    /// The best value and point so far.
    pub fn best(&self) -> (f64, &[f64]) {
        (self.f, &self.x)
    }

    /// Why the search ended, if it has.
    pub fn stop(&self) -> Option<Stop> {
        self.stop
    }

    /// Accepted steps and evaluations.
    pub fn effort(&self) -> (usize, usize) {
        (self.iterations, self.evaluations)
    }

    /// The value and gradient at the point of [`Lbfgs::ask`]. A value that is not finite counts as too large.
    pub fn tell(&mut self, f: f64, g: &[f64]) {
        if self.stop.is_some() {
            return;
        }
        self.evaluations += 1;
        let finite = f.is_finite() && g.iter().all(|g| g.is_finite());
        if self.evaluations == 1 {
            if !finite {
                self.stop = Some(Stop::Failed);
                return;
            }
            (self.f, self.g) = (f, g.to_vec());
            self.begin_step();
            return;
        }
        let slope: f64 = (0..self.x.len()).map(|i| self.g[i] * (self.trial[i] - self.x[i])).sum();
        if finite && f <= self.f + ARMIJO * slope {
            self.accept(f, g);
        } else {
            self.shorten(if finite { f } else { f64::INFINITY }, slope);
        }
    }

    fn accept(&mut self, f: f64, g: &[f64]) {
        let s: Vec<f64> = self.trial.iter().zip(&self.x).map(|(a, b)| a - b).collect();
        let y: Vec<f64> = g.iter().zip(&self.g).map(|(a, b)| a - b).collect();
        let (sy, yy) = (inner(&s, &y), inner(&y, &y));
        if sy > 1e-10 * (yy * inner(&s, &s)).sqrt() {
            if self.pairs.len() == MEMORY {
                self.pairs.remove(0);
            }
            self.pairs.push((s, y));
            self.scale = Some(sy / yy);
        }
        let decrease = self.f - f;
        self.x.copy_from_slice(&self.trial);
        self.g.copy_from_slice(g);
        self.f = f;
        self.iterations += 1;
        if decrease <= self.limits.decrease * f.abs() {
            self.stop = Some(Stop::Converged);
        } else {
            self.begin_step();
        }
    }

    /// Shortens the step: the minimum of the parabola through what is known, within a tenth and a half.
    fn shorten(&mut self, f: f64, slope: f64) {
        self.trials += 1;
        if self.trials >= TRIALS {
            self.stop = Some(Stop::Stalled);
        } else if self.evaluations >= self.limits.evaluations {
            self.stop = Some(Stop::Limit);
        }
        let factor = 0.5 * slope / (slope - (f - self.f));
        self.length *= if factor.is_finite() { factor.clamp(0.1, 0.5) } else { 0.1 };
        self.move_trial();
    }

    /// Whether a variable is held at its bound.
    fn held(&self, i: usize) -> bool {
        (self.x[i] <= self.lower[i] && self.g[i] > 0.0) || (self.x[i] >= self.upper[i] && self.g[i] < 0.0)
    }

    /// Ends the search or chooses the next direction and the first trial along it.
    fn begin_step(&mut self) {
        let n = self.x.len();
        let free: Vec<bool> = (0..n).map(|i| !self.held(i)).collect();
        let steepest = (0..n).filter(|&i| free[i]).fold(0.0f64, |m, i| m.max(self.g[i].abs()));
        if steepest <= self.limits.gradient * (1.0 + self.f.abs()) {
            self.stop = Some(Stop::Converged);
        } else if self.iterations >= self.limits.iterations || self.evaluations >= self.limits.evaluations {
            self.stop = Some(Stop::Limit);
        }
        if self.stop.is_some() {
            return;
        }
        self.two_loop(&free);
        let descent = inner(&self.direction, &self.g);
        if descent.is_nan() || descent >= 0.0 {
            self.pairs.clear();
            self.two_loop(&free);
        }
        (self.length, self.trials) = (1.0, 0);
        self.move_trial();
    }

    /// direction = −H g on the free variables.
    fn two_loop(&mut self, free: &[bool]) {
        let n = self.x.len();
        let on_free = |a: &[f64], b: &[f64]| (0..n).filter(|&i| free[i]).map(|i| a[i] * b[i]).sum::<f64>();
        let mut d: Vec<f64> = (0..n).map(|i| if free[i] { -self.g[i] } else { 0.0 }).collect();
        let mut weights = [0.0; MEMORY];
        for (slot, (s, y)) in weights[..self.pairs.len()].iter_mut().zip(&self.pairs).rev() {
            let sy = on_free(s, y);
            if sy > 0.0 {
                *slot = on_free(s, &d) / sy;
                (0..n).filter(|&i| free[i]).for_each(|i| d[i] -= *slot * y[i]);
            }
        }
        let scale = match (self.pairs.last(), self.scale) {
            (Some((s, y)), _) if on_free(s, y) > 0.0 => on_free(s, y) / on_free(y, y),
            (None, Some(scale)) => scale,
            _ => 1.0 / on_free(&d, &d).sqrt().max(1e-300),
        };
        d.iter_mut().for_each(|d| *d *= scale);
        for (weight, (s, y)) in weights.iter().zip(&self.pairs) {
            let sy = on_free(s, y);
            if sy > 0.0 {
                let b = on_free(y, &d) / sy;
                (0..n).filter(|&i| free[i]).for_each(|i| d[i] += (weight - b) * s[i]);
            }
        }
        self.direction = d;
    }

    fn move_trial(&mut self) {
        for i in 0..self.x.len() {
            self.trial[i] = (self.x[i] + self.length * self.direction[i]).max(self.lower[i]).min(self.upper[i]);
        }
    }
}

fn inner(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
