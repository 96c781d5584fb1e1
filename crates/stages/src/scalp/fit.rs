//! Fits the generic head to the evidence by damped least squares: inside the hull everywhere, under the markers by what a
//! ball and its hair lift them, under the hull by hair that grows thicker downwards and is thick on some heads and thin on
//! others, against visible skin.
//!
//! Reference: Levenberg 1944; Marquardt 1963; robust weights after Geman & McClure 1985.

use glam::DVec3;
use nalgebra::{DMatrix, DVector};

use super::evidence::Evidence;
use super::template::{HeadPlacement, HeadShape};

/// Parameters: centre (3), turn (3), log scale (3), marker lift (1), hair thicker than usual (1).
const PARAMETERS: usize = 11;
/// Which of them is the markers' lift above [`LIFT_MM`], and which the hair above what is expected \[mm\].
const LIFT: usize = 9;
const HAIR: usize = 10;
/// Standard deviations of the priors. Sizes vary by 4 % between adults; the turn comes from the cameras' side only; hair, and
/// what the hull adds to it, differ by more than the hair of one head differs from place to place.
const PRIOR: [f64; PARAMETERS] = [30.0, 30.0, 30.0, 0.14, 0.07, 0.26, 0.04, 0.04, 0.045, 2.5, 3.0];
/// How far a marker's centre lies above the scalp: half a 10 mm ball and the hair under it \[mm\].
const LIFT_MM: f64 = 9.5;
/// Scatter of single markers about the common lift \[mm\].
const LIFT_SCATTER_MM: f64 = 1.5;
/// How many independent facts the hull's surface, the hull as a bound and the skin rays are worth: their samples are
/// many, and their errors common.
const SURFACE_FACTS: f64 = 30.0;
const BOUND_FACTS: f64 = 80.0;
const SKIN_FACTS: f64 = 6.0;

/// A fitted head.
pub struct FittedHead {
    /// Its shape.
    pub shape: HeadShape,
    /// Its placement.
    pub placement: HeadPlacement,
    /// Lift of the markers above it \[mm\].
    pub lift_mm: f64,
}

/// The head that explains the evidence best, from several turns.
pub fn fit_head(evidence: &Evidence, markers: &[DVec3]) -> FittedHead {
    let up = evidence.upright.z_axis;
    // The hull's top lies about a thumb's breadth of hair above the vertex.
    let height = evidence.top - 8.0 - HeadShape::MEAN_HEIGHT_MM;
    let centre = evidence.middle + up * (height - evidence.middle.dot(up));
    let problem = Problem { evidence, markers, centre, bound: directions(400) };
    let starts = [0.0, -0.3, 0.3].map(|turn| {
        let mut x = DVector::zeros(PARAMETERS);
        x[5] = turn;
        problem.minimise(x)
    });
    let [first, rest @ ..] = starts;
    let (x, _) = rest.into_iter().fold(first, |best, next| if next.1 < best.1 { next } else { best });
    let placement = problem.placement(&x);
    FittedHead { shape: placement.shape(), placement, lift_mm: LIFT_MM + x[LIFT] }
}

struct Problem<'a> {
    evidence: &'a Evidence,
    markers: &'a [DVec3],
    centre: DVec3,
    /// Directions from the centre in which the head must stay inside the hull.
    bound: Vec<DVec3>,
}

impl Problem<'_> {
    fn placement(&self, x: &DVector<f64>) -> HeadPlacement {
        HeadPlacement {
            upright: self.evidence.upright,
            centre: self.centre + DVec3::new(x[0], x[1], x[2]),
            turn: DVec3::new(x[3], x[4], x[5]),
            log_scale: DVec3::new(x[6], x[7], x[8]),
        }
    }

    /// All residuals, in standard deviations.
    fn residuals(&self, x: &DVector<f64>) -> Vec<f64> {
        let placement = self.placement(x);
        let shape = placement.shape();
        let mut out: Vec<f64> = (0..PARAMETERS).map(|k| x[k] / PRIOR[k]).collect();
        for marker in self.markers {
            out.push(robust((shape.distance(*marker) - LIFT_MM - x[LIFT]) / LIFT_SCATTER_MM, 3.0));
        }
        let share = |facts: f64, count: usize| (facts / count.max(1) as f64).sqrt();
        let weight = share(SURFACE_FACTS, self.evidence.surface.len());
        for point in &self.evidence.surface {
            let p = shape.proportions(*point);
            let hair = expected_hair(p).map(|(mm, sd)| robust((shape.distance(*point) - mm - x[HAIR]) / sd, 2.0));
            out.push(weight * hair.unwrap_or(0.0));
        }
        let weight = share(BOUND_FACTS, self.bound.len());
        for direction in &self.bound {
            let way = shape.direction(*direction);
            let on_head = placement.centre + way * shape.reach(placement.centre, way);
            // The head's skin is at least two millimetres inside a hull that is grown by as much.
            out.push(weight * (self.evidence.hull_distance.distance(on_head) + 2.0).clamp(0.0, 30.0));
        }
        let weight = share(SKIN_FACTS, self.evidence.skin.len());
        for ray in &self.evidence.skin {
            out.push(weight * self.skin(&shape, ray.origin, ray.direction, placement.centre));
        }
        out
    }

    /// How far a ray that touches skin passes by the head. Noses and lips stand out from the template's face.
    fn skin(&self, shape: &HeadShape, origin: DVec3, direction: DVec3, centre: DVec3) -> f64 {
        let middle = (centre - origin).dot(direction);
        let along = (-10..=10).map(|k| origin + direction * (middle + f64::from(k) * 12.0));
        let nearest = along.map(|p| (shape.distance(p), p)).min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((distance, point)) = nearest else { return 0.0 };
        let p = shape.proportions(point);
        if p.y > 0.0 && p.z > -1.35 { robust((distance - 8.0) / 8.0, 2.0) } else { robust((distance - 2.0) / 8.0, 2.0) }
    }

    /// Damped Gauss–Newton: the solution and its cost.
    fn minimise(&self, start: DVector<f64>) -> (DVector<f64>, f64) {
        let cost = |r: &[f64]| r.iter().map(|v| v * v).sum::<f64>();
        let mut x = start;
        let mut r = self.residuals(&x);
        let mut best = cost(&r);
        let mut damping = 1e-2;
        for _ in 0..25 {
            let jacobian = self.jacobian(&x, &r);
            let residual = DVector::from_column_slice(&r);
            let (normal, gradient) = (jacobian.tr_mul(&jacobian), jacobian.tr_mul(&residual));
            let before = best;
            for _ in 0..6 {
                let mut damped = normal.clone();
                for k in 0..PARAMETERS {
                    damped[(k, k)] *= 1.0 + damping;
                }
                let Some(step) = damped.cholesky().map(|c| c.solve(&gradient)) else { break };
                let candidate = &x - step;
                let candidate_r = self.residuals(&candidate);
                let candidate_cost = cost(&candidate_r);
                if candidate_cost < best {
                    (x, r, best) = (candidate, candidate_r, candidate_cost);
                    damping *= 0.3;
                    break;
                }
                damping *= 5.0;
            }
            if before - best < 1e-4 * before {
                break;
            }
        }
        (x, best)
    }

    fn jacobian(&self, x: &DVector<f64>, r: &[f64]) -> DMatrix<f64> {
        let mut jacobian = DMatrix::zeros(r.len(), PARAMETERS);
        for k in 0..PARAMETERS {
            let step = PRIOR[k] * 1e-3;
            let mut moved = x.clone();
            moved[k] += step;
            for (row, (a, b)) in self.residuals(&moved).iter().zip(r).enumerate() {
                jacobian[(row, k)] = (a - b) / step;
            }
        }
        jacobian
    }
}

/// Residual whose square saturates: beyond `reach` standard deviations it hardly grows.
fn robust(residual: f64, reach: f64) -> f64 {
    residual / (1.0 + (residual / reach).powi(2)).sqrt()
}

/// Hair (and slack of the hull) over the scalp at a point in template proportions: mean over heads, and standard deviation
/// on one head \[mm\]; `None` where hair says nothing about the head: in front of the face, and below the ears.
fn expected_hair(p: DVec3) -> Option<(f64, f64)> {
    let before_face = p.y > 0.35 && p.z < 0.6;
    if before_face || p.z < -0.3 {
        return None;
    }
    let high = p.z.clamp(0.0, 1.0);
    Some((10.0 - 4.5 * high, 3.0 - 1.0 * high))
}

/// Nearly even directions on the sphere (Fibonacci lattice), without those that point down to the neck.
fn directions(count: usize) -> Vec<DVec3> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..count)
        .map(|i| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
            let r = (1.0 - z * z).sqrt();
            DVec3::new(r * (golden * i as f64).cos(), r * (golden * i as f64).sin(), z)
        })
        .filter(|d| d.z > -0.6)
        .collect()
}
