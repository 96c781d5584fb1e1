//! Separable filters on floating-point planes. Borders are repeated.

use strandflow_core::Plane;

/// How far a Gaussian kernel reaches \[px\].
pub fn gaussian_reach(sigma: f32) -> usize {
    (3.0 * sigma).ceil().max(1.0) as usize
}

/// Half a symmetric Gaussian kernel, centre first, that sums to one over both sides; radius is three sigma.
pub fn gaussian_half(sigma: f32) -> Vec<f32> {
    let radius = gaussian_reach(sigma);
    let raw: Vec<f32> = (0..=radius).map(|i| (-0.5 * (i as f32 / sigma.max(1e-6)).powi(2)).exp()).collect();
    let sum = raw[0] + 2.0 * raw[1..].iter().sum::<f32>();
    raw.iter().map(|w| w / sum).collect()
}

/// Correlation along rows with taps at −r..=r given as a half kernel, centre first. `odd`: taps at −i carry the
/// opposite sign and the centre is ignored.
pub fn along_rows(plane: &Plane<f32>, half: &[f32], odd: bool) -> Plane<f32> {
    let [out] = rows_by(plane, half.len() - 1, One { half, odd });
    out
}

/// Correlation along columns; see [`along_rows`].
pub fn along_columns(plane: &Plane<f32>, half: &[f32], odd: bool) -> Plane<f32> {
    let mut out = Plane::filled(plane.width, plane.height, 0.0f32);
    for (y, target) in out.data.chunks_exact_mut(plane.width.max(1)).enumerate() {
        column_row_by(plane, y, One { half, odd }, [target]);
    }
    out
}

/// Correlation along rows by an even and an odd filter of one length at once; see [`along_rows`].
pub fn even_and_odd_along_rows(plane: &Plane<f32>, even: &[f32], odd: &[f32]) -> [Plane<f32>; 2] {
    rows_by(plane, even.len() - 1, Both { even, odd })
}

/// One output row of the correlations along columns by an even and an odd filter of one length.
pub fn even_and_odd_column_row(plane: &Plane<f32>, even: &[f32], odd: &[f32], y: usize, targets: [&mut [f32]; 2]) {
    column_row_by(plane, y, Both { even, odd }, targets);
}

/// All rows by taps at −r..=r.
fn rows_by<const OUT: usize>(plane: &Plane<f32>, r: usize, taps: impl Taps<OUT>) -> [Plane<f32>; OUT] {
    let w = plane.width;
    let mut out = [(); OUT].map(|()| Plane::filled(w, plane.height, 0.0f32));
    let mut padded = vec![0.0f32; w + 2 * r];
    for y in 0..plane.height {
        fill_padded(plane.row(y), r, &mut padded);
        let pair = |i: usize| (&padded[r - i..r - i + w], &padded[r + i..r + i + w]);
        on_widest(taps, out.each_mut().map(|plane| &mut plane.data[y * w..(y + 1) * w]), pair);
    }
    out
}

/// One output row of taps along columns.
fn column_row_by<const OUT: usize>(plane: &Plane<f32>, y: usize, taps: impl Taps<OUT>, targets: [&mut [f32]; OUT]) {
    on_widest(taps, targets, |i| (plane.row(y.saturating_sub(i)), plane.row((y + i).min(plane.height - 1))));
}

/// A row with its ends repeated `r` times.
fn fill_padded(row: &[f32], r: usize, padded: &mut [f32]) {
    let w = row.len();
    padded[..r].fill(row[0]);
    padded[r..r + w].copy_from_slice(row);
    padded[r + w..].fill(row[w - 1]);
}

/// Filters over pairs of pixels i before and behind each pixel: `OUT` sums a pixel.
trait Taps<const OUT: usize>: Copy {
    /// The sums of `N` pixels, of which those i before and behind are `N` of the slices that `pair(i)` gives, from `at` on.
    fn block<'a, const N: usize>(self, at: usize, pair: &impl Fn(usize) -> (&'a [f32], &'a [f32])) -> [[f32; N]; OUT];
}

/// Σ kᵢ (bᵢ ± aᵢ).
#[derive(Clone, Copy)]
struct One<'k> {
    half: &'k [f32],
    odd: bool,
}

impl Taps<1> for One<'_> {
    #[inline(always)]
    fn block<'a, const N: usize>(self, at: usize, pair: &impl Fn(usize) -> (&'a [f32], &'a [f32])) -> [[f32; N]; 1] {
        let mut sums = [0.0f32; N];
        if !self.odd {
            sums.iter_mut().zip(&pair(0).0[at..at + N]).for_each(|(sum, p)| *sum = self.half[0] * p);
        }
        for (i, &k) in self.half.iter().enumerate().skip(1) {
            let (before, behind) = pair(i);
            let pixels = before[at..at + N].iter().zip(&behind[at..at + N]);
            if self.odd {
                sums.iter_mut().zip(pixels).for_each(|(sum, (a, b))| *sum += k * (b - a));
            } else {
                sums.iter_mut().zip(pixels).for_each(|(sum, (a, b))| *sum += k * (a + b));
            }
        }
        [sums]
    }
}

/// An even and an odd filter: each pixel is fetched once for both.
#[derive(Clone, Copy)]
struct Both<'k> {
    even: &'k [f32],
    odd: &'k [f32],
}

impl Taps<2> for Both<'_> {
    #[inline(always)]
    fn block<'a, const N: usize>(self, at: usize, pair: &impl Fn(usize) -> (&'a [f32], &'a [f32])) -> [[f32; N]; 2] {
        let (mut evens, mut odds) = ([0.0f32; N], [0.0f32; N]);
        evens.iter_mut().zip(&pair(0).0[at..at + N]).for_each(|(sum, p)| *sum = self.even[0] * p);
        for (i, (&of_sum, &of_difference)) in self.even.iter().zip(self.odd).enumerate().skip(1) {
            let (before, behind) = pair(i);
            let pixels = before[at..at + N].iter().zip(&behind[at..at + N]);
            for ((even, odd), (a, b)) in evens.iter_mut().zip(&mut odds).zip(pixels) {
                *even += of_sum * (a + b);
                *odd += of_difference * (b - a);
            }
        }
        [evens, odds]
    }
}

/// A row of sums into `targets`, `pair(i)` being the row's pixels i before and behind. On the widest registers there are; the
/// same operations in the same order on all, so that no machine gives other bits.
#[inline(always)]
fn on_widest<'a, const OUT: usize>(
    taps: impl Taps<OUT>,
    targets: [&mut [f32]; OUT],
    pair: impl Fn(usize) -> (&'a [f32], &'a [f32]),
) {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx512f") {
        // SAFETY: the feature has just been detected.
        unsafe { on_avx512(taps, targets, pair) };
        return;
    } else if std::arch::is_x86_feature_detected!("avx2") {
        // SAFETY: as above.
        unsafe { on_avx2(taps, targets, pair) };
        return;
    }
    in_blocks::<OUT, 16>(taps, targets, pair);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
unsafe fn on_avx512<'a, const OUT: usize>(
    taps: impl Taps<OUT>,
    targets: [&mut [f32]; OUT],
    pair: impl Fn(usize) -> (&'a [f32], &'a [f32]),
) {
    in_blocks::<OUT, 64>(taps, targets, pair);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
unsafe fn on_avx2<'a, const OUT: usize>(
    taps: impl Taps<OUT>,
    targets: [&mut [f32]; OUT],
    pair: impl Fn(usize) -> (&'a [f32], &'a [f32]),
) {
    in_blocks::<OUT, 32>(taps, targets, pair);
}

/// Blocks of `N` sums stay in registers over all taps: two loads a tap instead of three and a store.
#[inline(always)]
fn in_blocks<'a, const OUT: usize, const N: usize>(
    taps: impl Taps<OUT>,
    mut targets: [&mut [f32]; OUT],
    pair: impl Fn(usize) -> (&'a [f32], &'a [f32]),
) {
    match targets[0].len() {
        0..8 => cover::<OUT, 1>(taps, &mut targets, &pair),
        width if width < N => cover::<OUT, 8>(taps, &mut targets, &pair),
        _ => cover::<OUT, N>(taps, &mut targets, &pair),
    }
}

/// A row in blocks of `N`, at least one long. The last ends with the row, and so gives some pixels a second time.
#[inline(always)]
fn cover<'a, const OUT: usize, const N: usize>(
    taps: impl Taps<OUT>,
    targets: &mut [&mut [f32]; OUT],
    pair: &impl Fn(usize) -> (&'a [f32], &'a [f32]),
) {
    let width = targets[0].len();
    for from in (0..width).step_by(N) {
        let at = from.min(width - N);
        let sums = taps.block::<N>(at, pair);
        targets.iter_mut().zip(sums).for_each(|(target, sums)| target[at..at + N].copy_from_slice(&sums));
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
    let small = gaussian_by_taps(&block_means(plane, factor), narrower(sigma, factor));
    enlarged(&small, factor, plane.width, plane.height)
}

/// What [`block_means`] and the linear interpolation between them leave of a sigma \[px\], in blocks.
pub fn narrower(sigma: f32, factor: usize) -> f32 {
    let f = factor as f32;
    // Variances of a block's mean and of the triangle of linear interpolation.
    let (mean, triangle) = ((f * f - 1.0) / 12.0, f * f / 6.0);
    (sigma * sigma - mean - triangle).sqrt() / f
}

/// The two of `blocks` that a pixel of a line lies between, and the share of the second; beyond the outermost centres the line
/// through the last two goes on.
#[inline]
fn between(pixel: usize, factor: usize, blocks: usize) -> (usize, usize, f32) {
    let at = (pixel as f32 + 0.5) / factor as f32 - 0.5;
    let first = (at.max(0.0) as usize).min(blocks.saturating_sub(2));
    (first, (first + 1).min(blocks - 1), at - first as f32)
}

/// The means of blocks of `factor`² pixels; the border is repeated where the last blocks stand over.
pub fn block_means(plane: &Plane<f32>, factor: usize) -> Plane<f32> {
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
    let columns: Vec<_> = (0..width).map(|x| between(x, factor, small.width)).collect();
    let mut out = Plane { width, height, data: Vec::with_capacity(width * height) };
    let mut row = vec![0.0f32; small.width];
    for (above, below, share) in (0..height).map(|y| between(y, factor, small.height)) {
        let pairs = small.row(above).iter().zip(small.row(below));
        row.iter_mut().zip(pairs).for_each(|(r, (a, b))| *r = a + share * (b - a));
        out.data.extend(columns.iter().map(|&(left, right, share)| row[left] + share * (row[right] - row[left])));
    }
    out
}

/// Sums of values that some pixels have, in wide Gaussian windows; for those who ask at some pixels only.
pub struct Spread<const N: usize> {
    factor: usize,
    blocks: Plane<[f32; N]>,
}

impl<const N: usize> Spread<N> {
    /// Of pixels (column, row) of a plane of `width` × `height`, for a sigma \[px\] of at least [`Spread::LEAST_SIGMA`]; all
    /// others have nothing.
    pub fn new(
        (width, height): (usize, usize),
        pixels: impl IntoIterator<Item = ([usize; 2], [f32; N])>,
        sigma: f32,
    ) -> Self {
        debug_assert!(sigma >= Self::LEAST_SIGMA);
        let factor = WIDE_FACTORS.into_iter().find(|factor| sigma >= (4 * factor) as f32).unwrap_or(WIDE_FACTORS[1]);
        let mut blocks = Plane::filled(width.div_ceil(factor), height.div_ceil(factor), [0.0; N]);
        let share = 1.0 / (factor * factor) as f32;
        for ([x, y], values) in pixels {
            blocks[(x / factor, y / factor)].iter_mut().zip(values).for_each(|(sum, value)| *sum += share * value);
        }
        let narrower = narrower(sigma, factor);
        for k in 0..N {
            let blurred = gaussian_by_taps(&blocks.map(|values| values[k]), narrower);
            blocks.data.iter_mut().zip(blurred.data).for_each(|(values, value)| values[k] = value);
        }
        Self { factor, blocks }
    }

    /// The narrowest window \[px\].
    pub const LEAST_SIGMA: f32 = 8.0;

    /// The sums around a pixel.
    #[inline]
    pub fn at(&self, x: usize, y: usize) -> [f32; N] {
        let (left, right, along) = between(x, self.factor, self.blocks.width);
        let (above, below, down) = between(y, self.factor, self.blocks.height);
        let [a, b, c, d] = [(left, above), (right, above), (left, below), (right, below)].map(|at| &self.blocks[at]);
        std::array::from_fn(|k| {
            let (first, second) = (a[k] + down * (c[k] - a[k]), b[k] + down * (d[k] - b[k]));
            first + along * (second - first)
        })
    }
}

/// Gaussian blur of `plane` where `weight` is known, normalised by the blurred weight (Knutsson & Westin 1993); where
/// the blurred weight is below 1e-4 the result is 0.
pub fn gaussian_where(plane: &Plane<f32>, weight: &Plane<f32>, sigma: f32) -> Plane<f32> {
    Window::new(weight, sigma).mean(plane, weight)
}

/// The Gaussian window of [`gaussian_where`] around every pixel, for several planes of one weight.
pub struct Window {
    /// The blurred weight.
    pub weight: Plane<f32>,
    sigma: f32,
}

impl Window {
    /// Of a sigma \[px\].
    pub fn new(weight: &Plane<f32>, sigma: f32) -> Self {
        Self { weight: gaussian(weight, sigma), sigma }
    }

    /// The means of `plane` in the windows; `weight` is that of the windows.
    pub fn mean(&self, plane: &Plane<f32>, weight: &Plane<f32>) -> Plane<f32> {
        let weighted = plane.data.iter().zip(&weight.data).map(|(p, w)| p * w).collect();
        let mut mean = gaussian(&Plane { data: weighted, ..*plane }, self.sigma);
        mean.data.iter_mut().zip(&self.weight.data).for_each(|(m, w)| *m = if *w > 1e-4 { *m / w } else { 0.0 });
        mean
    }
}

/// Central differences (five-point, exact for cubics) along x and y \[1/px\].
pub fn gradients(plane: &Plane<f32>) -> (Plane<f32>, Plane<f32>) {
    let half = [0.0, 8.0 / 12.0, -1.0 / 12.0];
    (along_rows(plane, &half, true), along_columns(plane, &half, true))
}

/// Sigma of the Gaussian that [`halved`] begins with \[px\].
const HALVING_SIGMA: f32 = 1.0;

/// Variance of what [`halved`] blurs by in all: by its Gaussian, and by the mean of two pixels \[px²\].
pub const BLUR_OF_HALVING: f32 = HALVING_SIGMA * HALVING_SIGMA + 0.25;

/// Half the resolution after a Gaussian blur of sigma 1; odd sizes round up.
pub fn halved(plane: &Plane<f32>) -> Plane<f32> {
    let smooth = gaussian(plane, HALVING_SIGMA);
    Plane::from_fn(plane.width.div_ceil(2), plane.height.div_ceil(2), |x, y| {
        let (x0, y0) = (2 * x, 2 * y);
        let (x1, y1) = ((x0 + 1).min(plane.width - 1), (y0 + 1).min(plane.height - 1));
        0.25 * (smooth[(x0, y0)] + smooth[(x1, y0)] + smooth[(x0, y1)] + smooth[(x1, y1)])
    })
}

/// A plane of `width` × `height` from one of half the resolution, linear between the centres of its pixels. At the border, unlike
/// that of wide blurs, it stays within their values: energies must not become negative.
pub fn doubled(half: &Plane<f32>, width: usize, height: usize) -> Plane<f32> {
    let between = |near: f32, far: f32| 0.75 * near + 0.25 * far;
    let mut out = Plane { width, height, data: Vec::with_capacity(width * height) };
    let mut row = vec![0.0f32; half.width];
    for y in 0..height {
        let [near, far] = either_side(y, half.height).map(|y| half.row(y));
        row.iter_mut().zip(near.iter().zip(far)).for_each(|(value, (&near, &far))| *value = between(near, far));
        out.data.extend((0..width).map(|x| {
            let [near, far] = either_side(x, half.width).map(|x| row[x]);
            between(near, far)
        }));
    }
    out
}

/// The two of `halves` pixels of half the resolution whose centres a pixel of a line lies between: its own, a quarter away, and
/// the next, three quarters away; its own twice at the ends.
#[inline]
pub fn either_side(pixel: usize, halves: usize) -> [usize; 2] {
    let own = pixel / 2;
    [own, if pixel.is_multiple_of(2) { own.saturating_sub(1) } else { (own + 1).min(halves - 1) }]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_registers_give_the_same_bits() {
        // Widths with and without remainders of all blocks.
        for width in [1, 7, 8, 31, 64, 100, 143] {
            let plane = Plane::from_fn(width, 9, |x, y| ((x * x + 31 * y) % 101) as f32 * 0.37 - 11.0);
            let (even, odd) = ([0.31f32, 0.2, -0.1, 0.07], [0.0f32, 0.6, 0.25, -0.03]);
            let at = |x: usize, y: usize, i: isize| plane[(x.saturating_add_signed(i).min(width - 1), y)];
            let sum = |half: &[f32], sign: f32, x: usize, y: usize| {
                let first = if sign > 0.0 { half[0] * at(x, y, 0) } else { 0.0 };
                (1..4).fold(first, |sum, i| {
                    let (a, b) = (at(x, y, -(i as isize)), at(x, y, i as isize));
                    sum + half[i] * if sign > 0.0 { a + b } else { b - a }
                })
            };
            let evens = Plane::from_fn(width, 9, |x, y| sum(&even, 1.0, x, y));
            let odds = Plane::from_fn(width, 9, |x, y| sum(&odd, -1.0, x, y));
            assert_eq!(along_rows(&plane, &even, false), evens);
            assert_eq!(along_rows(&plane, &odd, true), odds);
            assert_eq!(even_and_odd_along_rows(&plane, &even, &odd), [evens, odds]);
            let columns = [along_columns(&plane, &even, false), along_columns(&plane, &odd, true)];
            let mut rows = [vec![0.0; width], vec![0.0; width]];
            let [a, b] = &mut rows;
            even_and_odd_column_row(&plane, &even, &odd, 5, [a, b]);
            assert_eq!([columns[0].row(5), columns[1].row(5)], [&rows[0][..], &rows[1][..]]);
        }
    }

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
    fn what_a_few_pixels_have_spreads_as_a_blur_does() {
        let plane = Plane::from_fn(136, 92, |x, y| if (x * 7 + y * 13) % 11 == 0 { (x % 17) as f32 } else { 0.0 });
        let some = (0..92).flat_map(|y| (0..136).map(move |x| [x, y]));
        for sigma in [8.0, 24.0] {
            let pixels =
                some.clone().map(|[x, y]| ([x, y], [plane[(x, y)], 1.0])).filter(|(_, [value, _])| *value > 0.0);
            let (spread, blurred) = (Spread::new((136, 92), pixels, sigma), gaussian(&plane, sigma));
            for [x, y] in some.clone() {
                assert!((spread.at(x, y)[0] - blurred[(x, y)]).abs() < 1e-4, "{x} {y}");
            }
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

    #[test]
    fn halving_blurs_as_it_says_and_doubling_brings_slow_waves_back() {
        for degrees in [0.0f32, 20.0, 45.0, 90.0] {
            let (sine, cosine) = degrees.to_radians().sin_cos();
            let wave = |length: f32, u: f32, v: f32| (std::f32::consts::TAU / length * (u * cosine + v * sine)).sin();
            let plane = Plane::from_fn(61, 47, |x, y| wave(9.5, x as f32 + 0.5, y as f32 + 0.5));
            let half = halved(&plane);
            assert_eq!((half.width, half.height), (31, 24));
            let left = (-0.5 * BLUR_OF_HALVING * (std::f32::consts::TAU / 9.5).powi(2)).exp();
            for (y, x) in (4..20).flat_map(|y| (4..26).map(move |x| (y, x))) {
                let expected = left * wave(9.5, 2.0 * (x as f32 + 0.5), 2.0 * (y as f32 + 0.5));
                assert!((half[(x, y)] - expected).abs() < 5e-3, "{degrees}°: {} {expected}", half[(x, y)]);
            }
            let slow = Plane::from_fn(31, 24, |x, y| wave(60.0, 2.0 * (x as f32 + 0.5), 2.0 * (y as f32 + 0.5)));
            let full = doubled(&slow, 61, 47);
            for (y, x) in (2..44).flat_map(|y| (2..58).map(move |x| (y, x))) {
                assert!((full[(x, y)] - wave(60.0, x as f32 + 0.5, y as f32 + 0.5)).abs() < 6e-3);
            }
            assert_eq!(full[(0, 0)], slow[(0, 0)]);
        }
    }
}
