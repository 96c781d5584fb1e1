//! Separable filters on floating-point planes. Borders are repeated.

use strandflow_core::Plane;

/// Half a symmetric Gaussian kernel, centre first, that sums to one over both sides; radius is three sigma.
pub fn gaussian_half(sigma: f32) -> Vec<f32> {
    let radius = (3.0 * sigma).ceil().max(1.0) as usize;
    let raw: Vec<f32> = (0..=radius).map(|i| (-0.5 * (i as f32 / sigma.max(1e-6)).powi(2)).exp()).collect();
    let sum = raw[0] + 2.0 * raw[1..].iter().sum::<f32>();
    raw.iter().map(|w| w / sum).collect()
}

/// Correlation along rows with taps at −r..=r given as a half kernel, centre first. `odd`: taps at −i carry the
/// opposite sign and the centre is ignored.
pub fn along_rows(plane: &Plane<f32>, half: &[f32], odd: bool) -> Plane<f32> {
    let (w, r) = (plane.width, half.len() - 1);
    let mut out = Plane::filled(w, plane.height, 0.0f32);
    let mut padded = vec![0.0f32; w + 2 * r];
    for y in 0..plane.height {
        let row = plane.row(y);
        padded[..r].fill(row[0]);
        padded[r..r + w].copy_from_slice(row);
        padded[r + w..].fill(row[w - 1]);
        let pair = |i: usize| (&padded[r - i..r - i + w], &padded[r + i..r + i + w]);
        correlate(half, odd, &mut out.data[y * w..(y + 1) * w], pair);
    }
    out
}

/// Correlation along columns; see [`along_rows`].
pub fn along_columns(plane: &Plane<f32>, half: &[f32], odd: bool) -> Plane<f32> {
    let mut out = Plane::filled(plane.width, plane.height, 0.0f32);
    for y in 0..plane.height {
        let target = &mut out.data[y * plane.width..(y + 1) * plane.width];
        column_row(plane, half, odd, y, target);
    }
    out
}

/// One output row of [`along_columns`].
pub fn column_row(plane: &Plane<f32>, half: &[f32], odd: bool, y: usize, target: &mut [f32]) {
    correlate(half, odd, target, |i| (plane.row(y.saturating_sub(i)), plane.row((y + i).min(plane.height - 1))));
}

/// Σ kᵢ (bᵢ ± aᵢ) into `target`, (aᵢ, bᵢ) the pixels i before and behind each. On the widest registers there are; the same
/// operations in the same order on all, so that no machine gives other bits.
#[inline(always)]
fn correlate<'a>(half: &[f32], odd: bool, target: &mut [f32], pair: impl Fn(usize) -> (&'a [f32], &'a [f32])) {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        // SAFETY: the feature has just been detected.
        unsafe { correlate_avx2(half, odd, target, pair) };
        return;
    }
    correlate_taps(half, odd, target, pair);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
unsafe fn correlate_avx2<'a>(
    half: &[f32],
    odd: bool,
    target: &mut [f32],
    pair: impl Fn(usize) -> (&'a [f32], &'a [f32]),
) {
    correlate_taps(half, odd, target, pair);
}

#[inline(always)]
fn correlate_taps<'a>(half: &[f32], odd: bool, target: &mut [f32], pair: impl Fn(usize) -> (&'a [f32], &'a [f32])) {
    if odd {
        target.fill(0.0);
    } else {
        target.iter_mut().zip(pair(0).0).for_each(|(t, p)| *t = half[0] * p);
    }
    for (i, &k) in half.iter().enumerate().skip(1) {
        let (before, behind) = pair(i);
        if odd {
            target.iter_mut().zip(before.iter().zip(behind)).for_each(|(t, (a, b))| *t += k * (b - a));
        } else {
            target.iter_mut().zip(before.iter().zip(behind)).for_each(|(t, (a, b))| *t += k * (a + b));
        }
    }
}

/// Gaussian blur. A wide one is blurred at a lower resolution; the result is that of all pixels within 4e-3 of the contrast.
pub fn gaussian(plane: &Plane<f32>, sigma: f32) -> Plane<f32> {
    if sigma <= 0.0 {
        return plane.clone();
    }
    match WIDE_FACTORS.into_iter().find(|factor| sigma >= (4 * factor) as f32) {
        Some(factor) => gaussian_by_blocks(plane, sigma, factor),
        None => gaussian_by_taps(plane, sigma),
    }
}

/// Edges of the blocks that wide blurs are computed on \[px\], the coarsest first; each from four blocks of sigma on.
const WIDE_FACTORS: [usize; 2] = [4, 2];

fn gaussian_by_taps(plane: &Plane<f32>, sigma: f32) -> Plane<f32> {
    let half = gaussian_half(sigma);
    along_columns(&along_rows(plane, &half, false), &half, false)
}

/// The means of blocks, blurred by what the blocks and the interpolation between them do not blur already.
fn gaussian_by_blocks(plane: &Plane<f32>, sigma: f32, factor: usize) -> Plane<f32> {
    let f = factor as f32;
    // Variances of a block's mean and of the triangle of linear interpolation.
    let (mean, triangle) = ((f * f - 1.0) / 12.0, f * f / 6.0);
    let small = gaussian_by_taps(&block_means(plane, factor), (sigma * sigma - mean - triangle).sqrt() / f);
    enlarged(&small, factor, plane.width, plane.height)
}

/// The means of blocks of `factor`² pixels; the border is repeated where the last blocks stand over.
fn block_means(plane: &Plane<f32>, factor: usize) -> Plane<f32> {
    let (width, height) = (plane.width.div_ceil(factor), plane.height.div_ceil(factor));
    let mut out = Plane::filled(width, height, 0.0f32);
    let share = 1.0 / (factor * factor) as f32;
    for y in 0..height * factor {
        let (row, last) = (plane.row(y.min(plane.height - 1)), plane.width - 1);
        let target = &mut out.data[y / factor * width..][..width];
        let whole = row.chunks_exact(factor);
        let rest = whole.remainder();
        target.iter_mut().zip(whole).for_each(|(sum, block)| *sum += block.iter().sum::<f32>());
        if !rest.is_empty() {
            target[width - 1] += rest.iter().sum::<f32>() + (factor - rest.len()) as f32 * row[last];
        }
    }
    out.data.iter_mut().for_each(|sum| *sum *= share);
    out
}

/// Linear interpolation between the centres of blocks.
fn enlarged(small: &Plane<f32>, factor: usize, width: usize, height: usize) -> Plane<f32> {
    // The two blocks that a pixel of a line lies between, and the share of the second; beyond the outermost centres the line
    // through the last two goes on.
    let between = |n: usize, blocks: usize| -> Vec<(usize, usize, f32)> {
        let at = |i: usize| {
            let at = (i as f32 + 0.5) / factor as f32 - 0.5;
            let first = (at.max(0.0) as usize).min(blocks.saturating_sub(2));
            (first, (first + 1).min(blocks - 1), at - first as f32)
        };
        (0..n).map(at).collect()
    };
    let columns = between(width, small.width);
    let mut out = Plane { width, height, data: Vec::with_capacity(width * height) };
    let mut row = vec![0.0f32; small.width];
    for (above, below, share) in between(height, small.height) {
        let pairs = small.row(above).iter().zip(small.row(below));
        row.iter_mut().zip(pairs).for_each(|(r, (a, b))| *r = a + share * (b - a));
        out.data.extend(columns.iter().map(|&(left, right, share)| row[left] + share * (row[right] - row[left])));
    }
    out
}

/// Gaussian blur of `plane` where `weight` is known, normalised by the blurred weight (Knutsson & Westin 1993); where
/// the blurred weight is below 1e-4 the result is 0.
pub fn gaussian_where(plane: &Plane<f32>, weight: &Plane<f32>, sigma: f32) -> Plane<f32> {
    let weighted = Plane { data: plane.data.iter().zip(&weight.data).map(|(p, w)| p * w).collect(), ..*plane };
    let (mut top, bottom) = (gaussian(&weighted, sigma), gaussian(weight, sigma));
    top.data.iter_mut().zip(&bottom.data).for_each(|(t, b)| *t = if *b > 1e-4 { *t / b } else { 0.0 });
    top
}

/// Central differences (five-point, exact for cubics) along x and y \[1/px\].
pub fn gradients(plane: &Plane<f32>) -> (Plane<f32>, Plane<f32>) {
    let half = [0.0, 8.0 / 12.0, -1.0 / 12.0];
    (along_rows(plane, &half, true), along_columns(plane, &half, true))
}

/// Half the resolution after a Gaussian blur of sigma 1; odd sizes round up.
pub fn halved(plane: &Plane<f32>) -> Plane<f32> {
    let smooth = gaussian(plane, 1.0);
    Plane::from_fn(plane.width.div_ceil(2), plane.height.div_ceil(2), |x, y| {
        let (x0, y0) = (2 * x, 2 * y);
        let (x1, y1) = ((x0 + 1).min(plane.width - 1), (y0 + 1).min(plane.height - 1));
        0.25 * (smooth[(x0, y0)] + smooth[(x1, y0)] + smooth[(x0, y1)] + smooth[(x1, y1)])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wide_blur_by_blocks_is_that_by_taps() {
        // Steps of full contrast; sides that are no multiple of a block.
        let plane = Plane::from_fn(137, 90, |x, y| if (x / 13 + y / 29) % 2 == 0 { 1.0 } else { 0.0 });
        for sigma in [8.0f32, 12.0, 16.0, 24.0] {
            let (blocks, taps) = (gaussian(&plane, sigma), gaussian_by_taps(&plane, sigma));
            assert_eq!((blocks.width, blocks.height), (taps.width, taps.height));
            let most = blocks.data.iter().zip(&taps.data).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(most < 4e-3, "sigma {sigma}: {most}");
        }
    }

    #[test]
    fn blur_keeps_constants_and_widens_an_impulse_by_sigma() {
        let flat = Plane::filled(20, 20, 7.0f32);
        assert!(gaussian(&flat, 2.0).data.iter().all(|v| (v - 7.0).abs() < 1e-4));
        let mut impulse = Plane::filled(41, 41, 0.0f32);
        impulse[(20, 20)] = 1.0;
        let g = gaussian(&impulse, 2.0);
        let variance: f32 = (0..41)
            .flat_map(|y| (0..41).map(move |x| (x, y)))
            .map(|(x, y)| g[(x, y)] * (x as f32 - 20.0).powi(2))
            .sum();
        assert!((variance - 4.0).abs() < 0.15, "{variance}");
    }

    #[test]
    fn gradients_are_exact_on_a_ramp_and_normalised_blur_ignores_the_unknown() {
        let ramp = Plane::from_fn(16, 12, |x, y| 3.0 * x as f32 - 2.0 * y as f32);
        let (gx, gy) = gradients(&ramp);
        assert!((gx[(8, 6)] - 3.0).abs() < 1e-4 && (gy[(8, 6)] + 2.0).abs() < 1e-4);
        let plane = Plane::from_fn(16, 12, |x, _| if x < 8 { 5.0 } else { 100.0 });
        let known = plane.map(|&v| if v < 50.0 { 1.0 } else { 0.0 });
        assert!((gaussian_where(&plane, &known, 2.0)[(7, 6)] - 5.0).abs() < 1e-4);
    }
}
