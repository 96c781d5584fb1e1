//! Robust optical flow in a pyramid with graduated non-convexity.
//!
//! Minimises Σ ρ(I₂(x + u) − I₁(x); σ_d) + λ Σ ρ(u_s − u_n; σ_s) over four-neighbours with the Geman–McClure function
//! ρ(r; σ) = r²/(1 + r²/σ²), from wide σ (nearly quadratic) to the final ones. Each stage reweights the quadratic
//! problem and relaxes it by successive over-relaxation; images are warped at every stage.
//!
//! Reference: Black & Anandan 1996. Deviation: ρ is minimised by reweighting instead of by SOR on ρ itself; the same
//! minima, and the sweeps are free of divisions by ρ.

use strandflow_core::{Plane, RgbImage};

use crate::{
    filter::{gradients, halved},
    region::Region,
    sample::{bilinear, bilinear_both},
};

/// How flow is computed.
#[derive(Clone, Debug, PartialEq)]
pub struct FlowOptions {
    /// Pyramid levels at most; the coarsest is at least 16 px on its short side.
    pub levels: usize,
    /// Final scale of brightness residuals \[code values\].
    pub data_sigma: f32,
    /// Final scale of flow differences between neighbours \[px\].
    pub smooth_sigma: f32,
    /// Weight of smoothness \[(code values/px)²\].
    pub lambda: f32,
    /// Graduated stages a level; σ starts 2^(stages−1) times wider. Each stage warps anew.
    pub stages: usize,
    /// Relaxation sweeps a stage.
    pub sweeps: usize,
}

impl Default for FlowOptions {
    fn default() -> Self {
        Self { levels: 5, data_sigma: 10.0, smooth_sigma: 0.4, lambda: 60.0, stages: 3, sweeps: 16 }
    }
}

/// Displacement of every pixel \[px\].
#[derive(Clone, Debug, PartialEq)]
pub struct Flow {
    /// Along x.
    pub u: Plane<f32>,
    /// Along y.
    pub v: Plane<f32>,
}

impl Flow {
    /// No displacement.
    pub fn zero(width: usize, height: usize) -> Self {
        Self { u: Plane::filled(width, height, 0.0), v: Plane::filled(width, height, 0.0) }
    }

    /// The displacement at an image point \[px\].
    pub fn at(&self, x: f32, y: f32) -> [f32; 2] {
        bilinear_both([&self.u, &self.v], x, y)
    }

    /// The same flow on a grid of twice the resolution (`width` × `height`).
    pub fn doubled(&self, width: usize, height: usize) -> Self {
        let up = |plane: &Plane<f32>| {
            Plane::from_fn(width, height, |x, y| 2.0 * bilinear(plane, 0.5 * (x as f32 + 0.5), 0.5 * (y as f32 + 0.5)))
        };
        Self { u: up(&self.u), v: up(&self.v) }
    }

    /// This flow and from where it ends the next one: x → x + u(x) + next(x + u(x)).
    pub fn then(&self, next: &Self) -> Self {
        self.mapped(|x, y, u, v| {
            let [nu, nv] = next.at(x + u, y + v);
            [u + nu, v + nv]
        })
    }

    /// The flow the other way, by fixed-point iteration; only near where the flow is smooth, as it is at coarse resolution.
    pub fn inverse(&self) -> Self {
        const ITERATIONS: usize = 4;
        let negative = |[u, v]: [f32; 2]| [-u, -v];
        let first = self.mapped(|_, _, u, v| negative([u, v]));
        (1..ITERATIONS).fold(first, |back, _| back.mapped(|x, y, u, v| negative(self.at(x + u, y + v))))
    }

    /// Another displacement for every pixel, from its image point and its displacement.
    fn mapped(&self, f: impl Fn(f32, f32, f32, f32) -> [f32; 2]) -> Self {
        let mut out = self.clone();
        for (i, (u, v)) in out.u.data.iter_mut().zip(&mut out.v.data).enumerate() {
            let (x, y) = (i % self.u.width, i / self.u.width);
            [*u, *v] = f(x as f32 + 0.5, y as f32 + 0.5, *u, *v);
        }
        out
    }
}

/// Flow from `from` to `to`, several channels each of one size: I_to(x + u) ≈ I_from(x).
pub fn flow(from: &[Plane<f32>], to: &[Plane<f32>], options: &FlowOptions) -> Flow {
    let (a, b) = (pyramid(from, options.levels), pyramid(to, options.levels));
    let coarsest = &a[a.len() - 1][0];
    let mut flow = Flow::zero(coarsest.width, coarsest.height);
    for level in (0..a.len()).rev() {
        let (from, to) = (&a[level], &b[level]);
        let slopes: Vec<_> = from.iter().map(gradients).collect();
        if (flow.u.width, flow.u.height) != (from[0].width, from[0].height) {
            flow = flow.doubled(from[0].width, from[0].height);
        }
        // Graduation matters where the initial error is large; finer levels start from a good flow.
        let stages = if level + 1 == a.len() { options.stages + 1 } else { options.stages };
        for stage in (0..stages).rev() {
            let widen = 2f32.powi(stage as i32);
            refine((from, &slopes), to, &mut flow, options, widen);
        }
    }
    flow
}

/// Flow of a region of one image to another in colour, computed after `halvings` of the resolution and doubled as often.
pub fn flow_of_region(from: &RgbImage, to: &RgbImage, region: Region, halvings: usize) -> Flow {
    let sizes: Vec<(usize, usize)> =
        (0..halvings).map(|k| (region.width.div_ceil(1 << k), region.height.div_ceil(1 << k))).collect();
    let coarse = coarse_flow(from, to, region, halvings);
    sizes.into_iter().rev().fold(coarse, |flow, (width, height)| flow.doubled(width, height))
}

/// Flow of a region of one image to another in colour, at the resolution that is left after `halvings` \[px of that size\].
pub fn coarse_flow(from: &RgbImage, to: &RgbImage, region: Region, halvings: usize) -> Flow {
    let channels = |image: &RgbImage| {
        let full = |c: usize| region.crop(image, |colour| f32::from(colour[c]));
        [0, 1, 2].map(|c| (0..halvings).fold(full(c), |plane, _| halved(&plane))).to_vec()
    };
    let options = FlowOptions { levels: 5 - halvings.min(4), ..FlowOptions::default() };
    flow(&channels(from), &channels(to), &options)
}

/// Length of the round trip x → x + f(x) → back \[px\] at every pixel.
pub fn round_trip(forward: &Flow, backward: &Flow) -> Plane<f32> {
    Plane::from_fn(forward.u.width, forward.u.height, |x, y| {
        let (u, v) = (forward.u[(x, y)], forward.v[(x, y)]);
        let [bu, bv] = backward.at(x as f32 + 0.5 + u, y as f32 + 0.5 + v);
        (u + bu).hypot(v + bv)
    })
}

/// `plane` seen through the flow: out(x) = plane(x + flow(x)).
pub fn warped(plane: &Plane<f32>, flow: &Flow) -> Plane<f32> {
    Plane::from_fn(flow.u.width, flow.u.height, |x, y| {
        bilinear(plane, x as f32 + 0.5 + flow.u[(x, y)], y as f32 + 0.5 + flow.v[(x, y)])
    })
}

fn pyramid(channels: &[Plane<f32>], levels: usize) -> Vec<Vec<Plane<f32>>> {
    let mut out = vec![channels.to_vec()];
    while out.len() < levels {
        let last = &out[out.len() - 1];
        if last[0].width.min(last[0].height) < 32 {
            break;
        }
        out.push(last.iter().map(halved).collect());
    }
    out
}

/// A channel's slopes along x and y.
type Slopes = (Plane<f32>, Plane<f32>);

/// One stage: warp, weigh, relax.
fn refine(
    (from, slopes): (&[Plane<f32>], &[Slopes]),
    to: &[Plane<f32>],
    flow: &mut Flow,
    options: &FlowOptions,
    widen: f32,
) {
    let (width, height) = (from[0].width, from[0].height);
    let n = width * height;
    // Normal equations of the data term in the increment (p, q), summed over channels.
    let mut data = vec![[0.0f32; 5]; n];
    let sigma2 = (options.data_sigma * widen).powi(2);
    for ((a, (ax, ay)), b) in from.iter().zip(slopes).zip(to) {
        let moved = warped(b, flow);
        let (mut gx, mut gy) = gradients(&moved);
        gx.data.iter_mut().zip(&ax.data).for_each(|(g, a)| *g = 0.5 * (*g + a));
        gy.data.iter_mut().zip(&ay.data).for_each(|(g, a)| *g = 0.5 * (*g + a));
        for (i, d) in data.iter_mut().enumerate() {
            let r = moved.data[i] - a.data[i];
            let w = 1.0 / (1.0 + r * r / sigma2).powi(2);
            let (x, y) = (gx.data[i], gy.data[i]);
            d[0] += w * x * x;
            d[1] += w * x * y;
            d[2] += w * y * y;
            d[3] += w * x * r;
            d[4] += w * y * r;
        }
    }
    let smooth2 = (options.smooth_sigma * widen).powi(2);
    let edge = |i: usize, j: usize| {
        let d2 = (flow.u.data[i] - flow.u.data[j]).powi(2) + (flow.v.data[i] - flow.v.data[j]).powi(2);
        options.lambda / (1.0 + d2 / smooth2).powi(2)
    };
    // Weights of the edges to the right and down; zero at the borders.
    let right: Vec<f32> = (0..n).map(|i| if i % width + 1 < width { edge(i, i + 1) } else { 0.0 }).collect();
    let down: Vec<f32> = (0..n).map(|i| if i + width < n { edge(i, i + width) } else { 0.0 }).collect();
    // Unknowns are the whole flow; the data term is linear around the flow of the warp.
    let start: Vec<[f32; 2]> = flow.u.data.iter().zip(&flow.v.data).map(|(&u, &v)| [u, v]).collect();
    let mut uv = start.clone();
    const OMEGA: f32 = 1.7;
    for _ in 0..options.sweeps {
        for y in 0..height {
            for x in 0..width {
                let i = y * width + x;
                let (mut su, mut sv, mut sw) = (0.0, 0.0, 1e-6);
                let mut add = |w: f32, j: usize| {
                    su += w * uv[j][0];
                    sv += w * uv[j][1];
                    sw += w;
                };
                if x > 0 {
                    add(right[i - 1], i - 1);
                }
                if x + 1 < width {
                    add(right[i], i + 1);
                }
                if y > 0 {
                    add(down[i - width], i - width);
                }
                if y + 1 < height {
                    add(down[i], i + width);
                }
                let [xx, xy, yy, xr, yr] = data[i];
                let [u0, v0] = start[i];
                let (bu, bv) = (su + xx * u0 + xy * v0 - xr, sv + xy * u0 + yy * v0 - yr);
                let (a, c) = (xx + sw, yy + sw);
                let det = a * c - xy * xy;
                let (u, v) = ((bu * c - bv * xy) / det, (bv * a - bu * xy) / det);
                uv[i][0] += OMEGA * (u - uv[i][0]);
                uv[i][1] += OMEGA * (v - uv[i][1]);
            }
        }
    }
    for (i, [u, v]) in uv.iter().enumerate() {
        // One warp cannot be trusted beyond a few pixels.
        flow.u.data[i] = start[i][0] + (u - start[i][0]).clamp(-3.0, 3.0);
        flow.v.data[i] = start[i][1] + (v - start[i][1]).clamp(-3.0, 3.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::gaussian;

    #[test]
    fn a_flow_and_its_inverse_end_where_they_began() {
        // A turn and a stretch about the middle, to 4 px at the borders.
        let (w, h) = (60, 50);
        let part = |of: fn(f32, f32) -> f32| Plane::from_fn(w, h, |x, y| of(x as f32 - 29.5, y as f32 - 24.5));
        let flow = Flow { u: part(|x, y| 0.05 * x - 0.1 * y), v: part(|x, y| 0.1 * x + 0.08 * y) };
        let there_and_back = flow.inverse().then(&flow);
        for (y, x) in (8..42).flat_map(|y| (8..52).map(move |x| (y, x))) {
            let off = there_and_back.u[(x, y)].hypot(there_and_back.v[(x, y)]);
            assert!(off < 0.02, "{x} {y}: {off} px");
        }
        // At (9.5, -0.5) from the middle: (0.525, 0.91), and from where that ends (0.50125 - 0.041, …).
        let twice = flow.then(&flow);
        assert!((twice.u[(39, 24)] - 0.985_25).abs() < 1e-4, "{}", twice.u[(39, 24)]);
    }

    fn noise(width: usize, height: usize, seed: u32) -> Plane<f32> {
        let mut state = seed;
        let raw = Plane::from_fn(width, height, |_, _| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 16) as f32 / 65536.0 - 0.5
        });
        gaussian(&raw, 2.0).map(|v| 128.0 + 600.0 * v)
    }

    #[test]
    fn a_moving_patch_over_a_still_ground_is_followed_to_its_border() {
        let (w, h) = (96, 80);
        let (ground, patch) = (noise(w, h, 1), noise(w, h, 2));
        let shift = [6.0f32, -4.0];
        let scene = |t: f32| {
            Plane::from_fn(w, h, |x, y| {
                let (px, py) = (x as f32 - t * shift[0], y as f32 - t * shift[1]);
                let inside = (30.0..66.0).contains(&px) && (25.0..60.0).contains(&py);
                if inside { bilinear(&patch, px + 0.5, py + 0.5) } else { ground[(x, y)] }
            })
        };
        let f = flow(&[scene(0.0)], &[scene(1.0)], &FlowOptions::default());
        let error = |x: usize, y: usize, t: [f32; 2]| (f.u[(x, y)] - t[0]).hypot(f.v[(x, y)] - t[1]);
        assert!(
            error(48, 42, shift) < 0.2 && error(38, 50, shift) < 0.3,
            "{} {}",
            error(48, 42, shift),
            error(38, 50, shift)
        );
        assert!(error(10, 10, [0.0; 2]) < 0.1 && error(85, 70, [0.0; 2]) < 0.1);
        let b = flow(&[scene(1.0)], &[scene(0.0)], &FlowOptions::default());
        let trip = round_trip(&f, &b);
        assert!(trip[(48, 42)] < 0.3 && trip[(10, 10)] < 0.2);
    }
}
