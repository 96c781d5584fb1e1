//! Pooling of orientation evidence along the lines themselves.
//!
//! Reference: Cabral & Leedom 1993 (line integrals along a vector field); Granlund & Knutsson 1995 (doubled angle).

use rayon::prelude::*;
use strandflow_core::Plane;

use crate::{filter::gaussian, gabor::OrientationEnergy};

/// Gaussian pooling with one sigma \[px\] in every direction.
pub fn isotropic(energy: &OrientationEnergy, sigma: f32) -> OrientationEnergy {
    let blur = |plane| gaussian(plane, sigma);
    OrientationEnergy { cos2: blur(&energy.cos2), sin2: blur(&energy.sin2), total: blur(&energy.total) }
}

/// Pools `energy` along the lines of the `guide` field with a Gaussian of `sigma` \[px\] of arc length (to 2 sigma).
///
/// Lines are followed in steps of one pixel through the nearest guide vector, so the window bends with the lines; it
/// ends where `inside` does or where the line turns by more than 60° in a step (another layer of lines).
pub fn along_lines(
    energy: &OrientationEnergy,
    guide: &OrientationEnergy,
    inside: &Plane<bool>,
    sigma: f32,
) -> OrientationEnergy {
    let (width, height) = (inside.width, inside.height);
    let reach = (2.0 * sigma).round().max(1.0) as usize;
    let weights: Vec<f32> = (0..=reach).map(|i| (-0.5 * (i as f32 / sigma).powi(2)).exp()).collect();
    // Unit line directions of the guide, once a pixel.
    let directions: Vec<[f32; 2]> = guide
        .cos2
        .data
        .iter()
        .zip(&guide.sin2.data)
        .map(|(&c, &s)| {
            let angle = 0.5 * s.atan2(c);
            [angle.cos(), angle.sin()]
        })
        .collect();
    let samples: Vec<[f32; 3]> = (0..energy.total.data.len())
        .map(|i| [energy.cos2.data[i], energy.sin2.data[i], energy.total.data[i]])
        .collect();
    let row = |y: usize| -> Vec<[f32; 3]> {
        (0..width)
            .map(|x| {
                let at = y * width + x;
                if !inside.data[at] {
                    return [0.0; 3];
                }
                let mut sum = samples[at];
                let mut norm = weights[0];
                for sign in [1.0f32, -1.0] {
                    let [mut dx, mut dy] = directions[at].map(|d| d * sign);
                    let (mut u, mut v) = (x as f32 + 0.5, y as f32 + 0.5);
                    for &weight in &weights[1..] {
                        u += dx;
                        v += dy;
                        if u < 0.0 || v < 0.0 || u >= width as f32 || v >= height as f32 {
                            break;
                        }
                        let i = v as usize * width + u as usize;
                        if !inside.data[i] {
                            break;
                        }
                        let [nx, ny] = directions[i];
                        let turn = nx * dx + ny * dy;
                        if turn.abs() < 0.5 {
                            break;
                        }
                        (dx, dy) = if turn < 0.0 { (-nx, -ny) } else { (nx, ny) };
                        let s = samples[i];
                        (0..3).for_each(|k| sum[k] += weight * s[k]);
                        norm += weight;
                    }
                }
                sum.map(|s| s / norm)
            })
            .collect()
    };
    let rows: Vec<Vec<[f32; 3]>> = (0..height).into_par_iter().map(row).collect();
    let take = |k: usize| Plane { width, height, data: rows.iter().flatten().map(|s| s[k]).collect() };
    OrientationEnergy { cos2: take(0), sin2: take(1), total: take(2) }
}
