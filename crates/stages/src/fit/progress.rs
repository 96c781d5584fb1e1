//! One strand on its way through the stretches of a take.

use std::ops::Range;

use glam::{DMat4, DVec3};
use strandflow_core::{Provenance, StrandSequence};
use strandflow_dynamics::{
    Params,
    refine::{Body, RefineOptions, Refined, Track},
};

use super::{
    FitSettings,
    evidence::{Doubts, EDGE_RANGE, Evidence},
    stretches::{self, Stretch},
};
use crate::Mode;

/// One strand on its way through the stretches.
#[derive(Default)]
pub struct Progress {
    pub count: u16,
    /// What the stretches know together of its body; none where there is but one stretch.
    pub body: Option<Body>,
    evidence: Evidence,
    /// Its way past the settled frames, which the next stretch is to join: shape (frames of a seam, n).
    tail: Vec<DVec3>,
    /// What each stretch found.
    pub found: Vec<Found>,
    /// Squared distances of the refined to the given points, and how many.
    square: f64,
    given: u32,
}

/// What a stretch found of a strand.
pub struct Found {
    params: Params,
    /// Fitted, stopped without converging, failed.
    windows: [usize; 3],
    covariance: Option<[[f64; 4]; 4]>,
    held_out_mm: Option<[f64; 2]>,
}

impl Found {
    /// How much it counts.
    fn weight(&self) -> f64 {
        (self.windows[0] + self.windows[1]) as f64
    }
}

impl Progress {
    /// A strand of so many particles.
    pub fn new(count: u16) -> Self {
        Self { count, ..Self::default() }
    }

    /// Takes up a refined stretch, joined to the one before over their seam: the strand's way over the settled frames.
    pub fn go_on(&mut self, refined: Refined, track: &Track, stretch: &Stretch, settings: &FitSettings) -> Vec<DVec3> {
        let n = track.particle_count;
        let Refined { mut points, params, windows, covariance, held_out_mm, .. } = refined;
        let settled = stretch.settled_places();
        stretches::join(&self.tail, &mut points[settled.start * n..], n);
        self.tail = points[settled.end * n..].iter().take(stretches::SEAM * n).copied().collect();
        self.found.push(Found { params, windows, covariance, held_out_mm });
        for t in settled.clone() {
            let at = t * n..(t + 1) * n;
            self.evidence.add(&points[at.clone()], &track.points[at.clone()], &track.weights[at], settings);
        }
        points.truncate(settled.end * n);
        points.drain(..settled.start * n);
        points
    }

    /// Writes the strand's way over the settled frames.
    pub fn write(
        &mut self,
        way: &[DVec3],
        strand: usize,
        settled: &Range<usize>,
        given: &StrandSequence,
        out: &mut StrandSequence,
        settings: &FitSettings,
    ) {
        let points = mended(way, self.count.into(), settings);
        let from = settled.clone().flat_map(|t| given.range(t, strand));
        let to: Vec<usize> = (0..settled.len()).flat_map(|t| out.range(t, strand)).collect();
        for ((e, o), point) in from.zip(to).zip(points) {
            out.points[o] = point.as_vec3();
            if given.valid(e) && given.points[e].is_finite() {
                self.square += given.points[e].as_dvec3().distance_squared(point);
                self.given += 1;
            } else {
                out.provenance[o] = Provenance::Simulated;
                out.confidence[o] = 0.0;
            }
        }
    }

    /// Windows of all stretches: fitted, stopped without converging, failed.
    pub fn windows(&self) -> [usize; 3] {
        std::array::from_fn(|k| self.found.iter().map(|found| found.windows[k]).sum())
    }

    /// The geometric mean of the stretches' parameters, by their windows.
    pub fn params(&self, options: &RefineOptions) -> Params {
        let (mut sum, mut total) = ([0.0; 6], 0.0);
        match &self.found[..] {
            [] => return options.start,
            [found] => return found.params,
            _ => {}
        }
        for found in &self.found {
            let weight = found.weight();
            found.params.to_log().iter().zip(&mut sum).for_each(|(p, sum)| *sum += weight * p);
            total += weight;
        }
        if total > 0.0 { Params::from_log(&sum.map(|s| s / total)) } else { options.start }
    }

    /// The stretches' covariances together: what each knows adds up. NaN where there is none.
    pub fn covariance(&self) -> DMat4 {
        let each: Vec<DMat4> =
            self.found.iter().filter_map(|found| found.covariance).map(|c| DMat4::from_cols_array_2d(&c)).collect();
        match &each[..] {
            [] => DMat4::NAN,
            [covariance] => *covariance,
            _ => each.iter().map(DMat4::inverse).sum::<DMat4>().inverse(),
        }
    }

    /// The stretches' errors on frames held out, by their windows. NaN where there are none.
    pub fn held_out_mm(&self) -> [f64; 2] {
        let (mut squares, mut total) = ([0.0; 2], 0.0);
        for (found, errors) in self.found.iter().filter_map(|found| Some((found, found.held_out_mm?))) {
            squares.iter_mut().zip(errors).for_each(|(sum, error)| *sum += found.weight() * error * error);
            total += found.weight();
        }
        squares.map(|sum| if total > 0.0 { (sum / total).sqrt() } else { f64::NAN })
    }

    /// Root mean square distance of the refined to the given points \[mm\].
    pub fn residual_mm(&self) -> f64 {
        (self.square / f64::from(self.given.max(1))).sqrt()
    }

    /// What speaks against a strand that was refined; never anything in paper mode.
    pub fn doubts(&self, mode: Mode) -> Doubts {
        if mode == Mode::Paper { Doubts::default() } else { self.evidence.doubts(self.windows()) }
    }

    /// Whether the refined strand can be passed on.
    pub fn stays(&self, mode: Mode) -> bool {
        !self.found.is_empty() && !self.doubts(mode).any()
    }
}

/// The strands of all frames with torn edges brought back to the range; what hangs on an edge moves with it.
fn mended(points: &[DVec3], particles: usize, settings: &FitSettings) -> Vec<DVec3> {
    let (least, most) = (EDGE_RANGE.0 * settings.edge_mm, EDGE_RANGE.1 * settings.edge_mm);
    let mut out = Vec::with_capacity(points.len());
    for frame in points.chunks(particles.max(1)) {
        let mut at = frame[0];
        out.push(at);
        for pair in frame.windows(2) {
            let edge = pair[1] - pair[0];
            let length = edge.length();
            at += edge * (length.clamp(least, most) / length.max(1e-9));
            out.push(at);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_torn_edge_is_mended_and_its_tail_keeps_its_shape() {
        let settings = FitSettings::default();
        let edge = settings.edge_mm;
        let straight: Vec<DVec3> = (0..6).map(|i| DVec3::X * edge * f64::from(i)).collect();
        let mut torn = straight.clone();
        torn[3..].iter_mut().for_each(|p| p.x += 3.0 * edge);
        let both: Vec<DVec3> = straight.iter().chain(&torn).copied().collect();
        let found = mended(&both, 6, &settings);
        assert_eq!(found[..6], straight);
        let lengths: Vec<f64> = found[6..].windows(2).map(|p| p[0].distance(p[1]) / edge).collect();
        for (length, expected) in lengths.iter().zip([1.0, 1.0, EDGE_RANGE.1, 1.0, 1.0]) {
            assert!((length - expected).abs() < 1e-12, "{lengths:?}");
        }
    }
}
