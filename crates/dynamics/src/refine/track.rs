//! One strand over time: trust in its samples, and what it is over the whole take.

use glam::DVec3;

use crate::{
    refine::{
        RefineOptions, Take,
        identity::keep_one_hair,
        root::{self, CLAMPED},
        shape::{median, median_point, median_shape, noise_mm, rest_shape},
    },
    rest::RestShape,
};

/// One strand as given.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// n.
    pub particle_count: usize,
    /// World positions \[mm\], shape (T, n); anything where the weight is zero.
    pub points: Vec<DVec3>,
    /// Trust in each sample, 0 (missing) to 1, shape (T, n).
    pub weights: Vec<f64>,
}

/// A strand ready for the bundle.
#[derive(Clone, Debug)]
pub struct Prepared {
    /// n.
    pub n: usize,
    /// Positions in head space \[mm\], shape (T, n).
    pub head: Vec<DVec3>,
    /// Trust after the median test, shape (T, n); zero is missing.
    pub weights: Vec<f64>,
    /// The rest shape.
    pub rest: RestShape,
    /// The median shape in head space, complete, length n.
    pub median: Vec<DVec3>,
    /// The way of the clamped particles in head space \[mm\], shape (T, min(n, 3)).
    way: Vec<DVec3>,
    /// Noise per coordinate \[mm\], from fourth differences in time, in which motion counts less than in third ones. Infinite
    /// where no five consecutive frames have a particle: then nothing says that the samples can be believed.
    pub noise_mm: f64,
}

/// What stays the same of a strand over a whole take: of one long take it is pooled from stretches of frames.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    /// The rest shape.
    pub rest: RestShape,
    /// The median shape in head space \[mm\], length n.
    pub median: Vec<DVec3>,
    /// As [`Prepared::noise_mm`].
    pub noise_mm: f64,
    /// The trust that all samples have together.
    pub weight: f64,
}

impl Body {
    /// The body of a strand as its samples show it; `None` if none can be used.
    pub fn of(track: &Track, take: &Take, options: &RefineOptions) -> Option<Self> {
        let Prepared { rest, median, noise_mm, weights, .. } = prepare(track, None, take, options)?;
        Some(Self { rest, median, noise_mm, weight: weights.iter().sum() })
    }

    /// What this stretch and another know together: means by their weights, of altitudes too, which are heights with a sign.
    /// Noise is averaged as a variance, over the stretches that have some.
    pub fn pooled(&self, other: &Self) -> Self {
        let weight = self.weight + other.weight;
        let share = other.weight / weight;
        let mean = |a: f64, b: f64| a + share * (b - a);
        let means = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| mean(*a, *b)).collect::<Vec<_>>();
        let lengths = std::array::from_fn(|k| means(&self.rest.lengths[k], &other.rest.lengths[k]));
        let altitudes = self.rest.altitudes.iter().zip(&other.rest.altitudes);
        let altitudes = altitudes.map(|(a, b)| std::array::from_fn(|k| mean(a[k], b[k]))).collect();
        let epsilon = mean(self.rest.epsilon, other.rest.epsilon);
        let noise_mm = match (self.noise_mm.is_finite(), other.noise_mm.is_finite()) {
            (true, true) => mean(self.noise_mm.powi(2), other.noise_mm.powi(2)).sqrt(),
            _ => self.noise_mm.min(other.noise_mm),
        };
        Self {
            rest: RestShape { lengths, altitudes, epsilon },
            median: self.median.iter().zip(&other.median).map(|(a, b)| a.lerp(*b, share)).collect(),
            noise_mm,
            weight,
        }
    }
}

/// Half-width of the sliding median \[frames\]. Over nine frames a swinging strand stays within millimetres of it.
const MEDIAN_HALF: usize = 4;
/// Deviations from the sliding median beyond this many typical ones lose their weight.
const OUTLIER: f64 = 2.5;
/// Further deviation allowed per way of the median between the ends of its reach.
const MOTION_SHARE: f64 = 0.5;
/// Beyond this many reaches a sample is gone.
const GONE: f64 = 2.0;
/// Typical deviations below this count as this \[mm\], so that clean data are not thinned.
const OUTLIER_FLOOR_MM: f64 = 1.5;

/// Prepares a strand, with the body that the whole take gave it where there is one; `None` if no sample can be used and there is
/// no body.
pub fn prepare(track: &Track, body: Option<&Body>, take: &Take, options: &RefineOptions) -> Option<Prepared> {
    let (n, frames) = (track.particle_count, take.world_from_head.len());
    if n == 0 || frames == 0 || track.points.len() != n * frames || track.weights.len() != n * frames {
        return None;
    }
    let head_from_world: Vec<_> = take.world_from_head.iter().map(|t| t.inverse()).collect();
    let mut weights: Vec<f64> = track
        .weights
        .iter()
        .zip(&track.points)
        .map(|(&w, p)| if p.is_finite() && w.is_finite() { w.clamp(0.0, 1.0) } else { 0.0 })
        .collect();
    let head: Vec<DVec3> = (0..n * frames)
        .map(|e| if weights[e] > 0.0 { head_from_world[e / n].point(track.points[e]) } else { DVec3::ZERO })
        .collect();
    if !options.letter {
        keep_one_hair(&head, &mut weights, n);
        distrust_outliers(&head, &mut weights, n);
    }
    let (rest, median, noise_mm) = match body.cloned() {
        Some(Body { rest, median, noise_mm, .. }) => (rest, median, noise_mm),
        None => {
            let median = median_shape(&head, &weights, n, options.edge_mm)?;
            let rest = rest_shape(&head, &weights, n, &median, options.edge_mm);
            let noise_mm = noise_mm(&head, &weights, n);
            (rest, median, noise_mm)
        }
    };
    let way = if options.letter {
        median[..CLAMPED.min(n)].repeat(frames)
    } else {
        root::way(&head, &weights, n, &median, &rest)
    };
    Some(Prepared { n, head, weights, rest, median, way, noise_mm })
}

impl Prepared {
    /// The clamped particles of a frame in head space \[mm\].
    pub fn root(&self, frame: usize) -> &[DVec3] {
        let fixed = CLAMPED.min(self.n);
        &self.way[frame * fixed..(frame + 1) * fixed]
    }
}

/// Lowers the weight of samples far from the sliding median in head space, and of what hangs on them towards the tip.
fn distrust_outliers(head: &[DVec3], weights: &mut [f64], n: usize) {
    let frames = head.len() / n;
    let mut deviation = vec![0.0; head.len()];
    let mut middles = vec![None; head.len()];
    let mut scratch = Vec::new();
    for i in 0..n {
        for t in 0..frames {
            if weights[t * n + i] == 0.0 {
                continue;
            }
            let (from, to) = (t.saturating_sub(MEDIAN_HALF), (t + MEDIAN_HALF + 1).min(frames));
            let near = (from..to).map(|s| s * n + i).filter(|&e| weights[e] > 0.0);
            let middle = median_point(near.map(|e| head[e]), &mut scratch);
            deviation[t * n + i] = middle.map_or(0.0, |m| m.distance(head[t * n + i]));
            middles[t * n + i] = middle;
        }
    }
    let original = weights.to_vec();
    for i in 0..n {
        scratch.clear();
        scratch.extend((0..frames).map(|t| t * n + i).filter(|&e| original[e] > 0.0).map(|e| deviation[e]));
        let Some(typical) = median(&mut scratch) else { continue };
        for t in 0..frames {
            // Where the strand accelerates the median lags; allow for what it moves itself.
            let (before, after) = (t.saturating_sub(MEDIAN_HALF), (t + MEDIAN_HALF).min(frames - 1));
            let motion = match (middles[before * n + i], middles[after * n + i]) {
                (Some(a), Some(b)) => a.distance(b),
                _ => 0.0,
            };
            let reach = OUTLIER * typical.max(OUTLIER_FLOOR_MM) + MOTION_SHARE * motion;
            let ratio = (deviation[t * n + i] / reach).max(1.0);
            weights[t * n + i] = if ratio > GONE { 0.0 } else { original[t * n + i] / ratio.powi(4) };
        }
    }
}
