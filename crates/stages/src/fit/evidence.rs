//! Whether a refined strand can be passed on.

use glam::DVec3;

use super::FitSettings;

/// A strand of which more than this share of the windows failed is given up and completed from its neighbours. A failed
/// window keeps the cleaned positions, so a strand survives many of them; much lower, and strands are replaced by their
/// neighbours that knew better themselves; near 1, strands that jump between different hair from frame to frame stay.
const FAILED_SHARE: f64 = 0.4;
/// Edges outside these shares of the particle spacing are torn.
pub const EDGE_RANGE: (f64, f64) = (0.7, 1.4);
/// A strand of which more than this share of the edges is torn shows a simulation that came apart. Fewer are mended: a
/// sample astray in one frame is no reason to lose a strand.
const TORN_SHARE: f64 = 0.03;

/// A strand of which more than this share of the samples lies beyond [`STRAY_MM`] from what it was made into is given up: it
/// shows several hairs, and the simulation of one goes its own way where the others were seen. At 0 every outlier costs a
/// strand.
const STRAY_SHARE: f64 = 0.15;
/// See [`STRAY_SHARE`] \[mm\].
const STRAY_MM: f64 = 10.0;

/// A strand that shakes more than this many times as much as where it was seen is given up: its simulation ran away, as a rule
/// in the windows at the take's ends. A simulation is to take shaking off; at 2, strands go that are only livelier than before.
const SHAKE_RATIO: f64 = 3.0;
/// Less shaking \[mm a frame²\] than this is none.
const LEAST_SHAKE_MM: f64 = 0.2;

/// What speaks for a refined strand and against it, gathered frame by frame: most windows explain it, its edges kept their
/// length, it is where it was seen, and it does not shake.
#[derive(Default)]
pub struct Evidence {
    edges: usize,
    torn: usize,
    seen: usize,
    stray: usize,
    shake: Shake,
    seen_shake: Shake,
}

impl Evidence {
    /// The next frame: refined points, and the given ones, which count where they have a weight.
    pub fn add(&mut self, points: &[DVec3], given: &[DVec3], weights: &[f64], settings: &FitSettings) {
        let (least, most) = (EDGE_RANGE.0 * settings.edge_mm, EDGE_RANGE.1 * settings.edge_mm);
        let lengths = points.windows(2).map(|p| p[0].distance(p[1]));
        self.edges += points.len().saturating_sub(1);
        self.torn += lengths.filter(|length| !(least..=most).contains(length)).count();
        for e in (0..given.len()).filter(|&e| weights[e] > 0.0) {
            self.seen += 1;
            self.stray += usize::from(points[e].distance(given[e]) > STRAY_MM);
        }
        self.shake.add(points.iter().map(|p| Some(*p)).collect());
        self.seen_shake.add(given.iter().zip(weights).map(|(p, w)| (*w > 0.0).then_some(*p)).collect());
    }

    /// What speaks against it. `windows`: fitted, stopped, failed.
    pub fn doubts(&self, windows: [usize; 3]) -> Doubts {
        let all: usize = windows.iter().sum();
        let shake = self.shake.mean().unwrap_or(0.0);
        Doubts {
            is_torn: self.torn as f64 > TORN_SHARE * self.edges as f64,
            shakes: self.seen_shake.mean().is_some_and(|seen| shake > SHAKE_RATIO * seen.max(LEAST_SHAKE_MM)),
            is_astray: self.stray as f64 > STRAY_SHARE * self.seen as f64,
            failed: windows[2] as f64 > FAILED_SHARE * all as f64,
        }
    }
}

/// What speaks against a refined strand.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Doubts {
    /// Its edges did not keep their length.
    pub is_torn: bool,
    /// It shakes more than where it was seen.
    pub shakes: bool,
    /// It is not where it was seen.
    pub is_astray: bool,
    /// Most windows do not explain it.
    pub failed: bool,
}

impl Doubts {
    /// Whether anything does.
    pub fn any(self) -> bool {
        self != Self::default()
    }
}

/// Root mean square second difference over the frames of a strand's points.
#[derive(Default)]
struct Shake {
    /// The two frames before.
    before: [Vec<Option<DVec3>>; 2],
    sum: f64,
    count: u32,
}

impl Shake {
    fn add(&mut self, frame: Vec<Option<DVec3>>) {
        let [first, second] = &self.before;
        for ((a, b), c) in first.iter().zip(second).zip(&frame) {
            if let (Some(a), Some(b), Some(c)) = (a, b, c) {
                self.sum += (c - 2.0 * b + a).length_squared();
                self.count += 1;
            }
        }
        self.before.swap(0, 1);
        self.before[1] = frame;
    }

    /// `None` where no point counts in three frames in a row.
    fn mean(&self) -> Option<f64> {
        (self.count > 0).then(|| (self.sum / f64::from(self.count)).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_strand_that_is_elsewhere_than_it_was_seen_or_runs_away_is_given_up() {
        let settings = FitSettings::default();
        let (frames, particles) = (20, 8);
        let point = |e: usize| DVec3::X * settings.edge_mm * (e % particles) as f64;
        let points: Vec<DVec3> = (0..frames * particles).map(point).collect();
        let swung = |mm: f64| {
            let aside = |e: usize| DVec3::Y * mm * (1.3 * (e / particles) as f64).sin();
            (0..points.len()).map(|e| points[e] + aside(e)).collect::<Vec<_>>()
        };
        let is_believed = |refined: &[DVec3], given: &[DVec3], weights: &[f64]| {
            let mut evidence = Evidence::default();
            for at in (0..frames).map(|t| t * particles..(t + 1) * particles) {
                evidence.add(&refined[at.clone()], &given[at.clone()], &weights[at], &settings);
            }
            !evidence.doubts([40, 0, 0]).any()
        };
        // Seen in the first frames where it is, in the last ones 40 mm aside; the rest was not seen.
        let weights = |here: usize, aside: usize| -> Vec<f64> {
            let is_seen = |t: usize| t < here || t >= frames - aside;
            (0..points.len()).map(|e| f64::from(u8::from(is_seen(e / particles)))).collect()
        };
        let seen = |here: usize, aside: usize| {
            let off = |e: usize| if e / particles >= frames - aside { DVec3::Y * 40.0 } else { DVec3::ZERO };
            let given: Vec<DVec3> = (0..points.len()).map(|e| points[e] + off(e)).collect();
            is_believed(&points, &given, &weights(here, aside))
        };
        assert!(seen(12, 0));
        assert!(seen(12, 1), "one frame astray costs no strand");
        assert!(!seen(9, 6));
        // It swings aside and back by 0.8 mm: twice as far as that is lively, ten times has run away.
        assert!(is_believed(&swung(1.6), &swung(0.8), &weights(12, 0)));
        assert!(!is_believed(&swung(8.0), &swung(0.8), &weights(12, 0)));
    }
}
