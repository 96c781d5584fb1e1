//! Whether a refined strand can be passed on.

use glam::DVec3;

use super::{EDGE_RANGE, FitSettings};

/// A strand of which more than this share of the windows failed is given up and completed from its neighbours. A failed
/// window keeps the cleaned positions, so a strand survives many of them; much lower, and strands are replaced by their
/// neighbours that knew better themselves; near 1, strands that jump between different hair from frame to frame stay.
const FAILED_SHARE: f64 = 0.4;
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

    /// Whether the strand can be passed on. `windows`: fitted, stopped, failed.
    pub fn is_believable(&self, windows: [usize; 3]) -> bool {
        let all: usize = windows.iter().sum();
        let shake = self.shake.mean().unwrap_or(0.0);
        self.torn as f64 <= TORN_SHARE * self.edges as f64
            && self.seen_shake.mean().is_none_or(|seen| shake <= SHAKE_RATIO * seen.max(LEAST_SHAKE_MM))
            && self.stray as f64 <= STRAY_SHARE * self.seen as f64
            && windows[2] as f64 <= FAILED_SHARE * all as f64
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
