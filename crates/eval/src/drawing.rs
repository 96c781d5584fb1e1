//! What a person would draw of true strands: sketches with a hand's tremor, so that judging by sketches can be judged itself.

use glam::{DVec2, Vec3};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;
use strandflow_core::{Camera, Rig, normal_from_even};
use strandflow_geometry::project::project;

use crate::{raster::StrandView, truth::Truth};

/// How a person draws.
#[derive(Clone, Debug, PartialEq)]
pub struct Hand {
    /// Standard deviation of the pen from the strand, in each of the two directions \[px\].
    pub noise_px: f64,
    /// Length along the stroke over which the pen's error stays alike \[px\]: of a tenth a stroke is jagged as no hand draws, of
    /// ten times the whole stroke is shifted instead.
    pub steady_px: f64,
    /// Between the points of a stroke \[px\].
    pub step_px: f64,
    /// Views that a strand is drawn in.
    pub views: usize,
    /// The least share of a strand that each of these views shows, on average over the frames; who draws less guesses.
    pub visible: f64,
    /// A point counts as shown up to so far behind the nearest hair or head \[mm\].
    pub visible_mm: f64,
}

impl Default for Hand {
    fn default() -> Self {
        Self { noise_px: 1.0, steady_px: 12.0, step_px: 4.0, views: 3, visible: 0.7, visible_mm: 4.0 }
    }
}

/// A strand that can be drawn, and the views to draw it in, which show most of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawable {
    /// Its number in the truth.
    pub strand: usize,
    /// Indices of views.
    pub views: Vec<usize>,
    /// Share of it that the least of these views shows, on average over the frames.
    pub visible: f64,
}

/// At most `count` stable strands that a person can see whole in enough of the `views` (indices of the rig), in all the frames
/// `times` (indices of the truth): of all lengths, the longest among them, by falling length.
pub fn drawable(
    truth: &Truth,
    rig: &Rig,
    views: &[usize],
    times: &[usize],
    hand: &Hand,
    count: usize,
) -> Vec<Drawable> {
    let shares: Vec<Vec<f64>> = views.iter().map(|&view| mean_shares(truth, &rig.cameras[view], times, hand)).collect();
    let of_strand = |strand: usize| -> Option<Drawable> {
        let mut best: Vec<(usize, f64)> = views.iter().zip(&shares).map(|(view, of)| (*view, of[strand])).collect();
        // The sort is stable: views alike stay in the rig's order.
        best.sort_by(|a, b| b.1.total_cmp(&a.1));
        best.truncate(hand.views);
        let visible = best.last()?.1;
        let enough = best.len() == hand.views && visible >= hand.visible;
        enough.then(|| Drawable { strand, views: best.into_iter().map(|(view, _)| view).collect(), visible })
    };
    let stable = (0..truth.strand_count()).filter(|&strand| truth.stable[strand]);
    let mut all: Vec<Drawable> = stable.filter_map(of_strand).collect();
    let Some(&first) = times.first() else { return Vec::new() };
    let length = |one: &Drawable| strandflow_geometry::polyline::length(truth.strand(first, one.strand));
    all.sort_by(|a, b| length(b).total_cmp(&length(a)));
    crate::statistics::evenly(all.len(), count).into_iter().map(|at| all[at].clone()).collect()
}

/// By strand, the share of its points that a view shows, mean over frames; 0 where the image cuts the strand off in any.
fn mean_shares(truth: &Truth, camera: &Camera, times: &[usize], hand: &Hand) -> Vec<f64> {
    let by_frame: Vec<Vec<Option<f64>>> = times.par_iter().map(|&t| shares(truth, camera, t, hand)).collect();
    let mean = |n: usize| -> Option<f64> {
        let sum: Option<f64> = by_frame.iter().map(|frame| frame[n]).sum();
        sum.map(|sum| sum / by_frame.len() as f64)
    };
    (0..truth.strand_count()).map(|n| mean(n).unwrap_or(0.0)).collect()
}

/// The same in one frame; `None` where the image cuts the strand off.
fn shares(truth: &Truth, camera: &Camera, t: usize, hand: &Hand) -> Vec<Option<f64>> {
    let strands = (0..truth.strand_count()).map(|n| (n as u32, truth.strand(t, n)));
    let view = StrandView::draw(camera, strands, &truth.head_at(truth.frames[t]));
    let (width, height) = (camera.width as f64, camera.height as f64);
    let in_image = |point: &Vec3| {
        let pixel = project(camera, point.as_dvec3());
        pixel.is_some_and(|p| p.x >= 0.0 && p.y >= 0.0 && p.x < width && p.y < height)
    };
    let share = |points: &[Vec3]| {
        let whole = points.len() > 1 && points.iter().all(in_image);
        let seen = || points.iter().filter(|point| view.sees(camera, **point, hand.visible_mm)).count();
        whole.then(|| seen() as f64 / points.len() as f64)
    };
    (0..truth.strand_count()).map(|n| share(truth.strand(t, n))).collect()
}

/// A strand drawn in a view, root first \[px, with lens distortion\]; the same for the same seed. `None` where the view has less
/// than two points of it.
pub fn stroke(camera: &Camera, strand: &[Vec3], hand: &Hand, seed: u64) -> Option<Vec<DVec2>> {
    let seen: Vec<DVec2> = strand.iter().filter_map(|point| project(camera, point.as_dvec3())).collect();
    let lengths: Vec<f32> = seen.windows(2).map(|pair| pair[0].distance(pair[1]) as f32).collect();
    let length: f64 = lengths.iter().copied().map(f64::from).sum();
    if !(length > 0.0 && length.is_finite()) {
        return None;
    }
    let count = (length / hand.step_px).ceil() as usize + 1;
    let step = length / (count - 1) as f64;
    let on_strand = strandflow_geometry::polyline::even_places(&lengths, count)
        .map(|(at, part)| seen[at].lerp(seen[at + 1], f64::from(part)));
    let tremor = tremor(count, step / hand.steady_px, seed);
    Some(on_strand.zip(tremor).map(|(point, off)| point + off * hand.noise_px).collect())
}

/// A smooth random course of unit variance everywhere, in both directions: independent numbers one unit apart, blended by a bell
/// as wide as their distance and scaled by the root of the sum of its squares.
fn tremor(count: usize, step: f64, seed: u64) -> Vec<DVec2> {
    const REACH: usize = 3;
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let knots = (count as f64 * step).ceil() as usize + 2 * REACH + 1;
    let free: Vec<DVec2> = (0..knots).map(|_| DVec2::new(normal(&mut random), normal(&mut random))).collect();
    let course = |i: usize| {
        let at = i as f64 * step + REACH as f64;
        let near = (at as usize - REACH)..=(at as usize + REACH).min(knots - 1);
        let (mut sum, mut squares) = (DVec2::ZERO, 0.0);
        for knot in near {
            let weight = (-2.0 * (at - knot as f64).powi(2)).exp();
            (sum, squares) = (sum + free[knot] * weight, squares + weight * weight);
        }
        sum / squares.sqrt()
    };
    (0..count).map(course).collect()
}

/// A number of the standard normal distribution.
fn normal(random: &mut Pcg64Mcg) -> f64 {
    let (a, b) = (random.random(), random.random());
    normal_from_even(a, b)
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};
    use strandflow_core::{Distortion, RigidTransform, TriMesh};

    use super::*;

    /// A camera 500 mm from the origin that looks at it from an angle about the y axis; 1 mm is 1 px there.
    fn camera(angle: f64) -> Camera {
        let rotation = DMat3::from_rotation_y(angle);
        Camera {
            name: format!("{angle}"),
            width: 200,
            height: 200,
            focal: [500.0; 2],
            principal: [100.0; 2],
            distortion: Distortion::None,
            camera_from_world: RigidTransform { rotation, translation: DVec3::new(0.0, 0.0, 500.0) },
        }
    }

    fn falling(x: f32, z: f32, length: f32) -> Vec<Vec3> {
        (0..=20).map(|i| Vec3::new(x, -60.0 + length * i as f32 / 20.0, z)).collect()
    }

    #[test]
    fn a_hand_is_off_by_what_is_said_and_never_jagged() {
        let (hand, camera, strand) = (Hand::default(), camera(0.0), falling(0.0, 0.0, 120.0));
        let strokes: Vec<Vec<DVec2>> = (0..400).map(|seed| stroke(&camera, &strand, &hand, seed).unwrap()).collect();
        let off: Vec<f64> = strokes.iter().flatten().map(|p| p.x - 100.0).collect();
        let deviation = crate::statistics::root_mean_square(off.iter().copied());
        // 12,000 numbers, of which each resembles the two beside it: 3 % is five standard errors.
        assert!((deviation - 1.0).abs() < 0.03, "{deviation}");
        let turns = strokes.iter().flat_map(|s| s.windows(2)).map(|pair| (pair[1].x - pair[0].x).powi(2));
        let step = (turns.clone().sum::<f64>() / turns.count() as f64).sqrt();
        assert!(step < 0.7, "{step} px from point to point; independent noise has 1.4");
        assert_eq!(stroke(&camera, &strand, &hand, 7), stroke(&camera, &strand, &hand, 7));
        assert!(strokes[0].windows(2).all(|pair| pair[1].y - pair[0].y < 9.0) && strokes[0].len() == 31);
        assert_eq!(stroke(&camera, &strand[..1], &hand, 0), None);
    }

    #[test]
    fn only_what_is_seen_whole_is_drawn() {
        // 0: free; 1: behind a board in every view; 2: leaves the image below; 3: free, short; 4: free, but not stable.
        let strands = [
            falling(0.0, -20.0, 100.0),
            falling(0.0, 40.0, 100.0),
            falling(30.0, 0.0, 300.0),
            falling(10.0, -20.0, 50.0),
            falling(-10.0, -20.0, 110.0),
        ];
        let mut truth = Truth { frames: vec![0], points: vec![strands.concat()], ..Truth::default() };
        truth.offsets = (0..=5).map(|n| 21 * n).collect();
        truth.stable = vec![true, true, true, true, false];
        let corner = |x: f64, y: f64| DVec3::new(x, y, 20.0);
        truth.head = TriMesh {
            vertices: vec![corner(-90.0, -90.0), corner(90.0, -90.0), corner(90.0, 90.0), corner(-90.0, 90.0)],
            faces: vec![[0, 1, 2], [0, 2, 3]],
        };
        let rig = Rig { cameras: [-0.3, 0.0, 0.3].map(camera).to_vec() };
        let found = drawable(&truth, &rig, &[0, 1, 2], &[0], &Hand::default(), 10);
        assert_eq!(found.iter().map(|one| one.strand).collect::<Vec<_>>(), [0, 3]);
        assert!(found.iter().all(|one| one.views.len() == 3 && one.visible > 0.9), "{found:?}");
        assert_eq!(drawable(&truth, &rig, &[0, 1], &[0], &Hand::default(), 10), []);
    }
}
