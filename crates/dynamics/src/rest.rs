//! The shape a strand's springs pull towards.

use glam::DVec3;

use crate::{
    altitude::altitudes,
    lanes::{Lanes, V3, dot, sub},
};

/// Regularisation of altitudes: ε = this · edge² (METHOD §3). It decides below which area a triangle counts as flat.
pub const ALTITUDE_EPSILON: f64 = 0.1;

/// Rest values of all springs of a strand with n particles.
#[derive(Clone, Debug, PartialEq)]
pub struct RestShape {
    /// Distances over 1, 2 and 3 edges \[mm\]; n−1, n−2 and n−3 entries (fewer particles: fewer or none).
    pub lengths: [Vec<f64>; 3],
    /// Signed regularised altitudes of each tetrahedron of four consecutive particles \[mm\], n−3 entries.
    pub altitudes: Vec<[f64; 7]>,
    /// ε of the altitudes \[mm²\].
    pub epsilon: f64,
}

impl RestShape {
    /// The rest shape of these positions \[mm\]; `edge_mm` sets ε.
    pub fn from_positions(points: &[DVec3], edge_mm: f64) -> Self {
        let n = points.len();
        let epsilon = ALTITUDE_EPSILON * edge_mm * edge_mm;
        let span = |order: usize| (order..n).map(|i| points[i].distance(points[i - order])).collect();
        let x: Vec<V3<f64>> = points.iter().map(|p| p.to_array()).collect();
        let altitudes = x.windows(4).map(|t| altitudes([t[0], t[1], t[2], t[3]], epsilon * epsilon)).collect();
        Self { lengths: [span(1), span(2), span(3)], altitudes, epsilon }
    }

    /// Number of particles.
    pub fn particle_count(&self) -> usize {
        self.lengths[0].len() + 1
    }

    /// Total length of the edges \[mm\].
    pub fn length_mm(&self) -> f64 {
        self.lengths[0].iter().sum()
    }
}

/// Rest shapes of all lanes, padded to a common particle count. `on` is 1 where a lane has the spring and 0 past its end.
#[derive(Clone, Debug)]
pub struct LaneRest<R> {
    /// Padded particle count.
    pub n: usize,
    /// Rest lengths \[mm\] by order.
    pub lengths: [Vec<R>; 3],
    /// 1 for springs that exist, by order; those of order 3 also switch the tetrahedra.
    pub on: [Vec<R>; 3],
    /// Rest altitudes \[mm\].
    pub altitudes: Vec<[R; 7]>,
    /// ε² \[mm⁴\].
    pub epsilon2: R,
}

impl<R: Lanes> LaneRest<R> {
    /// One rest shape a lane; lanes past the last shape repeat the first.
    pub fn new(shapes: &[&RestShape]) -> Self {
        let n = shapes.iter().map(|s| s.particle_count()).max().unwrap_or(1);
        let (one, zero) = (R::splat(1.0), R::zero());
        let springs = |order: usize| n.saturating_sub(order);
        let mut rest = Self {
            n,
            lengths: [1, 2, 3].map(|order| vec![one; springs(order)]),
            on: [1, 2, 3].map(|order| vec![zero; springs(order)]),
            altitudes: vec![[zero; 7]; springs(3)],
            epsilon2: one,
        };
        for lane in 0..R::COUNT {
            let Some(shape) = shapes.get(lane).or(shapes.first()) else { continue };
            for order in 0..3 {
                for (i, &length) in shape.lengths[order].iter().enumerate() {
                    rest.lengths[order][i].set(lane, length);
                    rest.on[order][i].set(lane, 1.0);
                }
            }
            for (slots, values) in rest.altitudes.iter_mut().zip(&shape.altitudes) {
                for (slot, &value) in slots.iter_mut().zip(values) {
                    slot.set(lane, value);
                }
            }
            rest.epsilon2.set(lane, shape.epsilon * shape.epsilon);
        }
        rest
    }
}

/// Distance between two points.
#[inline(always)]
pub fn distance<R: Lanes>(a: V3<R>, b: V3<R>) -> R {
    let d = sub(a, b);
    dot(d, d).sqrt()
}
