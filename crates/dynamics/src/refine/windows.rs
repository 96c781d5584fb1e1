//! Windows over a bundle in lockstep: every lane fits its own strand, all lanes evaluate together.

mod certainty;

use glam::DVec3;

pub use self::certainty::EXCITED_BELOW;
use self::certainty::{Count, Tally};
use crate::{
    kernels::Kernels,
    lanes::{V3, zero3},
    params::{LaneParams, Params},
    refine::{
        RefineOptions, Refined, Take,
        bundle::{Bundle, set},
        clean::clean,
        continuation::continued,
        filter,
        newton::{self, Newton},
        track::Prepared,
    },
    window::{WindowInput, WindowWorkspace},
};

/// Unit of the velocity variables \[mm/s\].
pub(super) const VELOCITY_UNIT: f64 = 100.0;
/// A window that ends further from the states it should refine than this share of the strand's length (root mean
/// square) plus [`FAILED_LEAST_MM`] failed.
const FAILED_SHARE: f64 = 0.15;
/// See [`FAILED_SHARE`] \[mm\].
const FAILED_LEAST_MM: f64 = 10.0;

/// Sweeps over linearised steps, and simulations for renewals, of one window's fit.
pub(crate) const LINEAR_SWEEPS: usize = newton::SWEEPS;
/// See [`LINEAR_SWEEPS`].
pub(crate) const RENEWING_RUNS: usize = newton::RENEWING;

/// Samples and their weights in lanes, shape (T, n).
struct Samples<R> {
    points: Vec<V3<R>>,
    weights: Vec<f64>,
}

/// The strands of one bundle on their way through the passes.
pub(crate) struct Fitting<'a, R> {
    bundle: Bundle<R>,
    take: &'a Take<'a>,
    options: &'a RefineOptions,
    /// Frames of a window.
    span: usize,
    cleaned: Vec<V3<R>>,
    samples: Samples<R>,
    states: Vec<LaneState>,
    workspace: WindowWorkspace<R>,
}

/// Refines the strands of one bundle.
pub fn refine_bundle<R: Kernels>(lanes: &[&Prepared], take: &Take, options: &RefineOptions) -> Vec<Refined> {
    let mut fitting = Fitting::<R>::new(lanes, take, options);
    let (n, frames) = (fitting.bundle.n, fitting.bundle.frames);
    let mut x = fitting.cleaned.clone();
    let mut scratch = Vec::with_capacity(n);
    if fitting.windows() > 0 {
        for pass in 0..options.outer_passes {
            x = fitting.pass(&x, pass + 1 == options.outer_passes);
            // Frame 0 is reached by no window.
            x[..n].copy_from_slice(&fitting.cleaned[..n]);
            if options.letter {
                fitting.samples.points.copy_from_slice(&x);
            } else {
                fitting.finish(&mut x, &mut scratch);
                let is_last = pass + 1 == options.outer_passes;
                add_structure(&fitting.bundle, lanes, take, is_last, &mut x);
            }
        }
        if !options.letter {
            fitting.finish(&mut x, &mut scratch);
        }
    }
    let Fitting { bundle, cleaned, states, span, .. } = fitting;
    (0..lanes.len())
        .map(|lane| {
            let of_lane = |x: &[V3<R>]| -> Vec<DVec3> {
                let m = bundle.counts[lane];
                (0..frames * m).map(|e| bundle.get(&x[e / m * n + e % m], lane)).collect()
            };
            let cleaned = of_lane(&cleaned);
            let mut points = of_lane(&x);
            for (point, fallback) in points.iter_mut().zip(&cleaned) {
                if !point.is_finite() {
                    *point = *fallback;
                }
            }
            let state = &states[lane];
            Refined {
                points,
                cleaned,
                params: state.mean_params(options),
                windows: state.windows,
                covariance: by_newton(options).then(|| state.tally.covariance(span, options)),
                held_out_mm: state.tally.held_out_mm(),
            }
        })
        .collect()
}

/// Whether the windows are fitted by Gauss–Newton.
fn by_newton(options: &RefineOptions) -> bool {
    options.newton_steps > 0 && !options.letter
}

/// Noise per coordinate at which samples and refinement count alike \[mm\]. Strands without noise keep their samples; those
/// that were followed from frame to frame have little of it, and what they err by is not noise.
const FAITHFUL_NOISE_MM: f64 = 0.12;

/// Adds back what the samples say consistently over time against the simulation, in head space. Before the last pass only what
/// samples without noise say: windows start from the states of the pass before, and would go astray further in each.
fn add_structure<R: Kernels>(bundle: &Bundle<R>, lanes: &[&Prepared], take: &Take, is_last: bool, x: &mut [V3<R>]) {
    let n = bundle.n;
    for (lane, p) in lanes.iter().enumerate() {
        let m = p.n;
        let head: Vec<DVec3> = (0..bundle.frames * m)
            .map(|e| take.world_from_head[e / m].inverse().point(bundle.get(&x[e / m * n + e % m], lane)))
            .collect();
        let residual =
            |e: usize| if p.weights[e] > 0.0 && head[e].is_finite() { p.head[e] - head[e] } else { DVec3::ZERO };
        let residuals: Vec<DVec3> = (0..head.len()).map(residual).collect();
        let faith = 1.0 / (1.0 + (p.noise_mm / FAITHFUL_NOISE_MM).powi(4));
        let structure = is_last.then(|| filter::structure(&residuals, &p.weights, m));
        let faithful = continued(&residuals, &p.weights, m, p.noise_mm);
        let correction = |e: usize| structure.as_ref().map_or(DVec3::ZERO, |s| s[e]).lerp(faithful[e], faith);
        let mut corrected: Vec<DVec3> = (0..head.len()).map(|e| head[e] + correction(e)).collect();
        if is_last {
            filter::settle_ends(&mut corrected, m, |e| if p.weights[e] > 0.0 { 1.0 - faith } else { 1.0 });
        }
        for t in 0..bundle.frames {
            let point = |i: usize| take.world_from_head[t].point(corrected[t * m + i]);
            bundle.put(&mut x[t * n..(t + 1) * n], lane, point);
        }
    }
}

/// Trust in the cleaned position where there is no sample. At 0 simulations of what is long unseen drift: on two hundred frames
/// they end 2 mm further off and shake by a quarter more; at 0.3 little changes.
///
/// *Deviation*: the paper's windows have the samples of the strand alone.
const HELD: f64 = 0.1;

/// Targets: the samples, with their trust; the cleaned positions elsewhere, with none.
fn samples_of<R: Kernels>(bundle: &Bundle<R>, lanes: &[&Prepared], take: &Take, cleaned: &[V3<R>]) -> Samples<R> {
    let n = bundle.n;
    let mut samples = Samples { points: cleaned.to_vec(), weights: vec![0.0; cleaned.len() * R::COUNT] };
    for (lane, p) in lanes.iter().enumerate() {
        for e in 0..bundle.frames * p.n {
            let (t, i) = (e / p.n, e % p.n);
            if p.weights[e] > 0.0 {
                let world = take.world_from_head[t].point(p.head[e]);
                set(&mut samples.points[t * n + i], lane, world - bundle.origins[lane]);
                samples.weights[(t * n + i) * R::COUNT + lane] = p.weights[e];
            }
        }
    }
    samples
}

/// What one lane carries from window to window.
pub(super) struct LaneState {
    pub(super) theta: [f64; 6],
    /// What earlier windows know about the parameters: the prior of the next.
    pub(super) known: [[f64; 6]; 6],
    pub(super) scale: Option<f64>,
    sum: [f64; 6],
    fitted: usize,
    windows: [usize; 3],
    /// What this pass says about certainty.
    pub(super) tally: Tally,
}

impl LaneState {
    fn new(options: &RefineOptions) -> Self {
        Self {
            theta: options.start.to_log(),
            known: [[0.0; 6]; 6],
            scale: None,
            sum: [0.0; 6],
            fitted: 0,
            windows: [0; 3],
            tally: Tally::default(),
        }
    }

    /// Counts a window: what it found, or that it failed.
    pub(super) fn count(&mut self, found: Option<(&[f64; 6], bool)>) {
        let Some((theta, done)) = found else {
            self.windows[2] += 1;
            return;
        };
        self.theta = *theta;
        (0..6).for_each(|a| self.sum[a] += theta[a]);
        self.fitted += 1;
        self.windows[usize::from(!done)] += 1;
    }

    fn begin_pass(&mut self) {
        (self.sum, self.fitted, self.tally) = ([0.0; 6], 0, Tally::default());
    }

    fn mean_params(&self, options: &RefineOptions) -> Params {
        if self.fitted == 0 { options.start } else { Params::from_log(&self.sum.map(|s| s / self.fitted as f64)) }
    }
}

impl<'a, R: Kernels> Fitting<'a, R> {
    /// Puts the strands into lanes and cleans them.
    pub(crate) fn new(lanes: &[&Prepared], take: &'a Take<'a>, options: &'a RefineOptions) -> Self {
        let bundle = Bundle::<R>::new(lanes, take, options);
        let span = options.window_frames.min(bundle.frames.saturating_sub(1));
        let mut workspace = WindowWorkspace::new(bundle.n, (span * options.substeps).max(options.substeps).max(1));
        let cleaned = clean(&bundle, lanes, take, options, &mut workspace);
        let samples = samples_of(&bundle, lanes, take, &cleaned);
        let states = lanes.iter().map(|_| LaneState::new(options)).collect();
        Self { bundle, take, options, span, cleaned, samples, states, workspace }
    }

    /// Windows of a pass.
    pub(crate) fn windows(&self) -> usize {
        if self.bundle.n > self.bundle.fixed && self.span > 0 { self.bundle.frames - self.span } else { 0 }
    }

    /// The states after cleaning, shape (T, n).
    pub(crate) fn cleaned(&self) -> &[V3<R>] {
        &self.cleaned
    }

    /// Finishing prox of all frames.
    fn finish(&mut self, x: &mut [V3<R>], scratch: &mut Vec<V3<R>>) {
        for (t, frame) in x.chunks_exact_mut(self.bundle.n).enumerate() {
            self.bundle.finish(t, frame, scratch, &mut self.workspace);
        }
    }

    /// Fits all windows of one pass from the states `x` and averages what they predict, shape (T, n). The last pass also
    /// foretells frames.
    pub(crate) fn pass(&mut self, x: &[V3<R>], last: bool) -> Vec<V3<R>> {
        let Self { bundle, take, options, span, samples, states, workspace, .. } = self;
        let (n, frames, span) = (bundle.n, bundle.frames, *span);
        states.iter_mut().for_each(LaneState::begin_pass);
        let mut sum = x.to_vec();
        let mut count = vec![0.0; frames];
        let mut window = Window::new(bundle, span);
        let mut newton = Newton::new(n, span);
        for start in 0..frames - span {
            window.begin(bundle, samples, x, start, take, options);
            let failed = if by_newton(options) {
                window.fit_newton(bundle, start, options, states, &mut newton, workspace)
            } else {
                window.fit_search(bundle, start, options, states, workspace)
            };
            if last && !options.letter {
                window.foretell(bundle, samples, start, options, (states, &failed), workspace);
            }
            for frame in 1..=span {
                let t = start + frame;
                let simulated = &window.best[(frame - 1) * n..frame * n];
                let first = count[t] == 0.0;
                count[t] += 1.0;
                for i in 0..n {
                    let mut point = simulated[i];
                    // A lane that failed keeps its start state.
                    for (lane, failed) in failed.iter().enumerate().take(states.len()) {
                        if *failed {
                            let kept = bundle.get(&x[t * n + i], lane) - bundle.origins[lane];
                            set(&mut point, lane, kept);
                        }
                    }
                    let slot = &mut sum[t * n + i];
                    for axis in 0..3 {
                        slot[axis] = if first { point[axis] } else { slot[axis] + point[axis] };
                    }
                }
            }
        }
        for t in 1..frames {
            let share = R::splat(1.0 / f64::max(count[t], 1.0));
            for slot in &mut sum[t * n..(t + 1) * n] {
                *slot = slot.map(|axis| axis * share);
            }
        }
        sum
    }
}

/// The window that all lanes are in, with its buffers.
pub(super) struct Window<R> {
    pub(super) span: usize,
    x0: Vec<V3<R>>,
    pub(super) v0: Vec<V3<R>>,
    pub(super) start_v: Vec<V3<R>>,
    targets: Vec<V3<R>>,
    pub(super) weights: Vec<R>,
    /// The states of the last frame before this pass.
    end: Vec<V3<R>>,
    pub(super) gradient: Vec<f64>,
    /// Predicted frames of the best fit, shape (span, n).
    pub(super) best: Vec<V3<R>>,
    /// Velocities in its last frame \[mm/s\], length n.
    pub(super) end_v: Vec<V3<R>>,
    /// What the weights of each lane hide.
    pub(super) counts: Vec<Count>,
}

impl<R: Kernels> Window<R> {
    fn new(bundle: &Bundle<R>, span: usize) -> Self {
        let n = bundle.n;
        Self {
            span,
            x0: vec![zero3(); n],
            v0: vec![zero3(); n],
            start_v: vec![zero3(); n],
            targets: vec![zero3(); span * n],
            weights: vec![R::zero(); span * n],
            end: vec![zero3(); n],
            gradient: Vec::new(),
            best: vec![zero3(); span * n],
            end_v: vec![zero3(); n],
            counts: vec![Count::default(); R::COUNT],
        }
    }

    /// Initial state, targets and weights of the window that starts in frame `start`.
    fn begin(
        &mut self,
        bundle: &Bundle<R>,
        samples: &Samples<R>,
        x: &[V3<R>],
        start: usize,
        take: &Take,
        options: &RefineOptions,
    ) {
        let n = bundle.n;
        self.x0.copy_from_slice(&x[start * n..(start + 1) * n]);
        self.end.copy_from_slice(&x[(start + self.span) * n..(start + self.span + 1) * n]);
        let per_frame = R::splat(1.0 / take.frame_secs);
        let (half, two, three) = (R::splat(0.5), R::splat(2.0), R::splat(1.5));
        for i in 0..n {
            #[expect(clippy::needless_range_loop, reason = "one index through several arrays reads as the formula")]
            for axis in 0..3 {
                let at = |t: usize| x[t * n + i][axis];
                let difference = if options.letter || bundle.frames < 3 {
                    at(start + 1) - at(start)
                } else if start == 0 {
                    two * at(1) - three * at(0) - half * at(2)
                } else {
                    half * (at(start + 1) - at(start - 1))
                };
                self.start_v[i][axis] = per_frame * difference;
            }
        }
        self.v0.copy_from_slice(&self.start_v);
        self.targets.copy_from_slice(&samples.points[(start + 1) * n..(start + 1 + self.span) * n]);
        // Aging weights by frame, normalised by the lane's total trust.
        let aging: Vec<f64> =
            (0..=self.span).map(|frame| (-0.5 * (frame as f64 / options.aging_frames).powi(2)).exp()).collect();
        for lane in 0..R::COUNT {
            let trust = |frame: usize, i: usize| samples.weights[((start + frame) * n + i) * R::COUNT + lane];
            let held = |i: usize| if options.letter || i >= bundle.counts[lane] { 0.0 } else { HELD };
            let at = |frame: usize, i: usize| match trust(frame, i) {
                0.0 => aging[frame] * held(i),
                trust => aging[frame] * trust,
            };
            let mut total = 0.0;
            for frame in 1..=self.span {
                total += (bundle.fixed..n).map(|i| at(frame, i)).sum::<f64>();
            }
            let seen = |i: usize| (1..=self.span).filter(|&frame| trust(frame, i) > 0.0).count();
            let spare: usize = (bundle.fixed..n).map(|i| seen(i).saturating_sub(1)).sum();
            let is_seen = (bundle.fixed..n).any(|i| seen(i) > 0);
            self.counts[lane] = Count { trust: if is_seen { total } else { 0.0 }, spare: spare as f64 };
            let norm = if total > 0.0 { 1.0 / total } else { 0.0 };
            for frame in 1..=self.span {
                for i in 0..n {
                    self.weights[(frame - 1) * n + i].set(lane, norm * at(frame, i));
                }
            }
        }
    }

    /// The simulation of the window with these parameters.
    pub(super) fn input<'a>(
        &'a self,
        bundle: &'a Bundle<R>,
        start: usize,
        params: LaneParams<R>,
        options: &RefineOptions,
    ) -> WindowInput<'a, R> {
        WindowInput {
            rest: &bundle.rest,
            params,
            constants: bundle.step,
            substeps: options.substeps,
            x0: &self.x0,
            v0: &self.v0,
            path: &bundle.path[start * bundle.fixed..(start + self.span + 1) * bundle.fixed],
            targets: &self.targets,
            weights: &self.weights,
        }
    }

    /// Whether a lane's simulation ended somewhere its samples cannot have meant.
    pub(super) fn strayed(&self, bundle: &Bundle<R>, end: &[V3<R>], lane: usize, options: &RefineOptions) -> bool {
        let count = bundle.counts[lane];
        let square: f64 =
            (0..count).map(|i| bundle.get(&end[i], lane).distance_squared(bundle.get(&self.end[i], lane))).sum();
        let reach = FAILED_SHARE * options.edge_mm * count as f64 + FAILED_LEAST_MM;
        let rms = (square / count as f64).sqrt();
        !rms.is_finite() || rms > reach
    }
}
