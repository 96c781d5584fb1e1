//! Curves in space from curves drawn in images.
//!
//! Points of two drawn curves correspond where a viewing ray of one meets a ray of the other; along the curves the
//! correspondence never runs backwards (dynamic programming over epipolar distances). From there the curve is the smooth
//! polyline whose projections lie nearest to all drawn curves: Gauss–Newton on distances *across* the drawn curves, so that
//! points are free to slide along them, which the correspondence leaves uncertain.

use glam::{DMat3, DVec2, DVec3};
use strandflow_core::Camera;

use crate::{
    project::{project, ray},
    triangulate::midpoint,
};

/// A curve in space that explains drawn curves.
#[derive(Clone, Debug, PartialEq)]
pub struct DrawnCurve {
    /// The curve at even lengths \[mm\], root first.
    pub points: Vec<DVec3>,
    /// Root mean square distance of its projections to the drawn curves \[px\].
    pub rms_px: f64,
}

/// Points of a drawn curve in the matching. More cost time with the square, fewer make steps longer than a pen is exact.
const MATCHED: usize = 120;

/// Points of the curve in space: 5 mm apart on hair of 25 cm.
const POINTS: usize = 48;

/// Weight of bending against distances across the curves \[px² per (px of second difference)²\]: with pixels of noise in what is
/// drawn less follows the hand's tremor, more cuts corners of waves that are eight points long.
const BENDING: f64 = 4.0;

/// Weight of unequal steps; only the position along the curve feels it.
const SPACING: f64 = 0.05;

/// Weight of the drawn ends, which a person places less exactly than the line.
const ENDS: f64 = 0.1;

/// The curve behind drawings in two or more views, each root first, in pixels with lens distortion; `None` with fewer than two
/// drawings of two points, or where their rays are parallel.
pub fn curve_from_drawings(drawings: &[(&Camera, &[DVec2])]) -> Option<DrawnCurve> {
    let drawn: Vec<(&Camera, Vec<DVec2>)> = drawings
        .iter()
        .filter(|(_, points)| points.len() >= 2 && points.iter().all(|point| point.is_finite()))
        .map(|(camera, points)| (*camera, evenly(points, MATCHED)))
        .collect();
    let (first, second) = widest_pair(&drawn)?;
    let start = matched(&drawn[first], &drawn[second])?;
    let mut points = evenly(&start, POINTS);
    for _ in 0..30 {
        let step = improve(&drawn, &mut points)?;
        if step < 1e-4 {
            break;
        }
    }
    let rms_px = rms(&drawn, &points)?;
    let points = evenly(&points, POINTS);
    points.iter().all(|point| point.is_finite()).then_some(DrawnCurve { points, rms_px })
}

/// Points in a space of any dimension.
trait Point: Copy + std::ops::Sub<Output = Self> {
    fn to(self, other: Self, part: f64) -> Self;
    fn norm(self) -> f64;
}

impl Point for DVec2 {
    fn to(self, other: Self, part: f64) -> Self {
        self.lerp(other, part)
    }
    fn norm(self) -> f64 {
        self.length()
    }
}

impl Point for DVec3 {
    fn to(self, other: Self, part: f64) -> Self {
        self.lerp(other, part)
    }
    fn norm(self) -> f64 {
        self.length()
    }
}

/// `count` points at equal lengths along a polyline, ends included.
fn evenly<P: Point>(points: &[P], count: usize) -> Vec<P> {
    let lengths: Vec<f32> = points.windows(2).map(|pair| (pair[1] - pair[0]).norm() as f32).collect();
    let at = |(segment, part): (usize, f32)| points[segment].to(points[segment + 1], f64::from(part));
    crate::polyline::even_places(&lengths, count).map(at).collect()
}

/// The two drawings whose middle rays meet under the angle nearest to a right one.
fn widest_pair(drawn: &[(&Camera, Vec<DVec2>)]) -> Option<(usize, usize)> {
    let axis: Vec<DVec3> =
        drawn.iter().map(|(camera, points)| ray(camera, points[points.len() / 2]).direction).collect();
    let pairs = (0..drawn.len()).flat_map(|a| (a + 1..drawn.len()).map(move |b| (a, b)));
    let sine = |&(a, b): &(usize, usize)| axis[a].cross(axis[b]).length();
    pairs.max_by(|a, b| sine(a).total_cmp(&sine(b))).filter(|pair| sine(pair) > 0.02)
}

/// Points in space of the cheapest monotone path through all pairs of points of two drawings, root to root and tip to tip.
fn matched(a: &(&Camera, Vec<DVec2>), b: &(&Camera, Vec<DVec2>)) -> Option<Vec<DVec3>> {
    let place = |i: usize, j: usize| -> Option<(f64, DVec3)> {
        let seen = [(a.0, a.1[i]), (b.0, b.1[j])];
        let point = midpoint(&seen)?;
        let miss = |(camera, pixel): &(&Camera, DVec2)| project(camera, point).map(|p| p.distance_squared(*pixel));
        Some((miss(&seen[0])? + miss(&seen[1])?, point))
    };
    let (n, m) = (a.1.len(), b.1.len());
    let costs: Vec<f64> = (0..n * m).map(|at| place(at / m, at % m).map_or(1e6, |(cost, _)| cost.min(1e6))).collect();
    // Steps along one drawing alone cost a little, so that flat stretches (along an epipolar line) are walked evenly.
    const ALONE: f64 = 0.05;
    let mut best = vec![f64::INFINITY; n * m];
    best[0] = costs[0];
    for i in 0..n {
        for j in 0..m {
            let from = |i: Option<usize>, j: Option<usize>, extra: f64| match (i, j) {
                (Some(i), Some(j)) => best[i * m + j] + extra,
                _ => f64::INFINITY,
            };
            let (up, left) = (i.checked_sub(1), j.checked_sub(1));
            let before = from(up, left, 0.0).min(from(up, Some(j), ALONE)).min(from(Some(i), left, ALONE));
            if i + j > 0 {
                best[i * m + j] = before + costs[i * m + j];
            }
        }
    }
    let mut path = Vec::new();
    let (mut i, mut j) = (n - 1, m - 1);
    loop {
        path.extend(place(i, j).map(|(_, point)| point));
        let value = |i: usize, j: usize| best[i * m + j];
        (i, j) = match (i, j) {
            (0, 0) => break,
            (0, _) => (0, j - 1),
            (_, 0) => (i - 1, 0),
            _ => {
                let diagonal = value(i - 1, j - 1);
                let (up, left) = (value(i - 1, j) + ALONE, value(i, j - 1) + ALONE);
                if diagonal <= up && diagonal <= left {
                    (i - 1, j - 1)
                } else if up <= left {
                    (i - 1, j)
                } else {
                    (i, j - 1)
                }
            }
        };
    }
    path.reverse();
    (path.len() >= 2).then_some(path)
}

/// The nearest point of a drawn curve, and the unit tangent there.
fn nearest(points: &[DVec2], to: DVec2) -> (DVec2, DVec2) {
    let mut best = (f64::INFINITY, points[0], DVec2::X);
    for pair in points.windows(2) {
        let along = pair[1] - pair[0];
        let part = ((to - pair[0]).dot(along) / along.length_squared().max(1e-12)).clamp(0.0, 1.0);
        let at = pair[0] + along * part;
        let distance = at.distance_squared(to);
        if distance < best.0 {
            best = (distance, at, along.normalize_or(DVec2::X));
        }
    }
    (best.1, best.2)
}

/// One Gauss–Newton step; returns the largest move \[mm\].
fn improve(drawn: &[(&Camera, Vec<DVec2>)], points: &mut [DVec3]) -> Option<f64> {
    let n = points.len();
    let mut system = Normal::new(n);
    // Millimetres a pixel at the curve, so that smoothness counts in pixels too.
    let mut pixels_a_mm = 0.0;
    for (camera, drawing) in drawn {
        for (k, point) in points.iter().enumerate() {
            let seen = project(camera, *point)?;
            let rows = jacobian(camera, *point, seen)?;
            pixels_a_mm += rows[0].length().max(rows[1].length()) / (n * drawn.len()) as f64;
            let (at, tangent) = nearest(drawing, seen);
            let across = tangent.perp();
            let gradient = rows[0] * across.x + rows[1] * across.y;
            system.add(&[(k, gradient)], across.dot(seen - at), 1.0);
            let end = match k {
                0 => Some(drawing[0]),
                k if k + 1 == n => Some(drawing[drawing.len() - 1]),
                _ => None,
            };
            if let Some(end) = end {
                system.add(&[(k, rows[0])], seen.x - end.x, ENDS);
                system.add(&[(k, rows[1])], seen.y - end.y, ENDS);
            }
        }
    }
    for k in 1..n - 1 {
        let bend = points[k - 1] - 2.0 * points[k] + points[k + 1];
        for axis in [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| axis * pixels_a_mm) {
            system.add(&[(k - 1, axis), (k, -2.0 * axis), (k + 1, axis)], axis.dot(bend), BENDING);
        }
        let along = (points[k + 1] - points[k - 1]).normalize_or_zero() * pixels_a_mm;
        system.add(&[(k - 1, along), (k, -2.0 * along), (k + 1, along)], along.dot(bend), SPACING);
    }
    let step = system.solve()?;
    // Far steps leave the place where distances are linear.
    let largest = step.iter().map(|d| d.length()).fold(0.0, f64::max);
    let scale = (20.0 / largest.max(1e-300)).min(1.0);
    points.iter_mut().zip(&step).for_each(|(point, d)| *point -= *d * scale);
    largest.is_finite().then_some(largest)
}

fn jacobian(camera: &Camera, point: DVec3, seen: DVec2) -> Option<[DVec3; 2]> {
    const H: f64 = 1e-3;
    let mut rows = [DVec3::ZERO; 2];
    for (axis, e) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().enumerate() {
        let d = (project(camera, point + e * H)? - seen) / H;
        (rows[0][axis], rows[1][axis]) = (d.x, d.y);
    }
    Some(rows)
}

fn rms(drawn: &[(&Camera, Vec<DVec2>)], points: &[DVec3]) -> Option<f64> {
    let mut sum = 0.0;
    for (camera, drawing) in drawn {
        for point in points {
            let seen = project(camera, *point)?;
            sum += nearest(drawing, seen).0.distance_squared(seen);
        }
    }
    Some((sum / (drawn.len() * points.len()) as f64).sqrt())
}

/// Normal equations of points that are coupled with the two next to them; blocks of three.
struct Normal {
    /// Lower blocks of each row: two before, one before, diagonal.
    blocks: Vec<[DMat3; 3]>,
    right: Vec<DVec3>,
}

impl Normal {
    fn new(n: usize) -> Self {
        Self { blocks: vec![[DMat3::ZERO; 3]; n], right: vec![DVec3::ZERO; n] }
    }

    /// A residual with its gradients by point, in rising order, no more than two apart.
    fn add(&mut self, gradients: &[(usize, DVec3)], residual: f64, weight: f64) {
        for (at, (k, g)) in gradients.iter().enumerate() {
            self.right[*k] += *g * (weight * residual);
            for (l, h) in &gradients[..=at] {
                self.blocks[*k][2 - (k - l)] += outer(*g, *h) * weight;
            }
        }
    }

    /// By block Cholesky (L D Lᵀ) along the band; `None` where a block is singular.
    fn solve(mut self) -> Option<Vec<DVec3>> {
        let n = self.right.len();
        let mut inverse = vec![DMat3::ZERO; n];
        for k in 0..n {
            // L of the block one before: A(k, k−1) − L(k, k−2) D L(k−1, k−2)ᵀ, all kept times D.
            let [far, mut near, mut diagonal] = self.blocks[k];
            let mut right = self.right[k];
            if k >= 2 {
                let part = far * inverse[k - 2];
                near -= part * self.blocks[k - 1][1].transpose();
                right -= part * self.right[k - 2];
                diagonal -= part * far.transpose();
            }
            if k >= 1 {
                let part = near * inverse[k - 1];
                right -= part * self.right[k - 1];
                diagonal -= part * near.transpose();
            }
            (self.blocks[k], self.right[k]) = ([far, near, diagonal], right);
            // A point that no view and no neighbour holds in some direction stays where it is.
            inverse[k] = (diagonal + DMat3::from_diagonal(DVec3::splat(1e-9))).inverse();
            inverse[k].is_finite().then_some(())?;
        }
        let mut x = vec![DVec3::ZERO; n];
        for k in (0..n).rev() {
            let mut r = self.right[k];
            if k + 1 < n {
                r -= self.blocks[k + 1][1].transpose() * x[k + 1];
            }
            if k + 2 < n {
                r -= self.blocks[k + 2][0].transpose() * x[k + 2];
            }
            x[k] = inverse[k] * r;
        }
        Some(x)
    }
}

fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

#[cfg(test)]
#[path = "sketch_tests.rs"]
mod tests;
