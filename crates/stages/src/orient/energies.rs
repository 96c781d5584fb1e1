//! The energies of the filter bank, of every pixel by itself or pooled over its surroundings and along the strands.
//!
//! What is pooled over 4 px and more says at half the resolution all it has to say: there the coarse filters look, and all
//! pooling is done, on a quarter of the pixels. How much it saves and what it changes is in `docs/steps.md`.

use strandflow_core::Plane;
use strandflow_image::{
    filter::{BLUR_OF_HALVING, block_means, doubled, gaussian, halved, narrower},
    gabor::{OrientationEnergy, add_energy},
    pool::{along_lines, isotropic},
};

use super::{OrientSettings, length};

/// Wavelength \[px\] from which on filters look at half the resolution: four pixels of it.
const COARSE_WAVE_PX: f32 = 8.0;
/// Sigma of pooling \[px\] from which on half the resolution is enough: of waves that it cannot hold, the Gaussian leaves 3e-9.
const COARSE_POOL_PX: f32 = 4.0;
/// Way between two samples of a line \[px\].
const STEP_PX: f32 = 2.0;

/// Every pixel's own energies, of all wavelengths.
pub(super) fn of_pixels(texture: &Plane<f32>, settings: &OrientSettings) -> OrientationEnergy {
    seen(texture, Filter::all(settings))
}

/// Energies pooled over the surroundings and along the strands of the hair.
pub(super) fn pooled(texture: &Plane<f32>, inside: &Plane<bool>, settings: &OrientSettings) -> OrientationEnergy {
    if settings.pool_px < COARSE_POOL_PX {
        return pool(&of_pixels(texture, settings), inside, &Windows::of(settings));
    }
    let (coarse, fine): (Vec<_>, Vec<_>) =
        Filter::all(settings).partition(|filter| filter.wavelength >= COARSE_WAVE_PX);
    let mut energy = seen(texture, fine).each(|plane| block_means(plane, 2));
    if !coarse.is_empty() {
        let half = halved(texture);
        coarse.into_iter().for_each(|filter| filter.of_halved().add(&half, &mut energy));
    }
    let pooled = pool(&energy, &any_of_blocks(inside), &Windows::of(settings).of_halved());
    pooled.each(|plane| doubled(plane, texture.width, texture.height))
}

fn seen(texture: &Plane<f32>, filters: impl IntoIterator<Item = Filter>) -> OrientationEnergy {
    let mut energy = OrientationEnergy::zero(texture.width, texture.height);
    filters.into_iter().for_each(|filter| filter.add(texture, &mut energy));
    energy
}

/// The filter pairs of a wavelength \[px\], scaled so that white noise has the same energy at every wavelength.
struct Filter {
    wavelength: f32,
    sigma: f32,
    orientations: usize,
    gain: f32,
}

impl Filter {
    fn all(settings: &OrientSettings) -> impl Iterator<Item = Self> {
        settings.wavelengths_px.iter().map(|&wavelength| Self::of(wavelength, settings.orientations))
    }

    fn of(wavelength: f32, orientations: usize) -> Self {
        let sigma = 0.5 * wavelength;
        Self { wavelength, sigma, orientations, gain: sigma * sigma / orientations as f32 }
    }

    /// The one that sees in the halved image what this one sees in the image. Halving begins with a blur, and a Gabor filter
    /// behind a Gaussian one is a Gabor filter, of a wider envelope and a longer wave: so this one is narrower, its wave
    /// shorter, its gain higher.
    fn of_halved(self) -> Self {
        let omega = std::f32::consts::TAU / self.wavelength;
        let own = self.sigma * self.sigma;
        let left = own - BLUR_OF_HALVING;
        let response = (-0.5 * omega * omega * own * BLUR_OF_HALVING / left).exp();
        Self {
            wavelength: 0.5 * self.wavelength * left / own,
            sigma: 0.5 * left.sqrt(),
            gain: self.gain / (response * response),
            ..self
        }
    }

    fn add(&self, texture: &Plane<f32>, into: &mut OrientationEnergy) {
        add_energy(texture, (self.wavelength, self.sigma), self.orientations, self.gain, into);
    }
}

/// Blocks of 2 × 2 pixels of which at least one is set.
fn any_of_blocks(mask: &Plane<bool>) -> Plane<bool> {
    let mut any = Plane::filled(mask.width.div_ceil(2), mask.height.div_ceil(2), false);
    for (blocks, rows) in any.data.chunks_exact_mut(mask.width.div_ceil(2)).zip(mask.data.chunks(2 * mask.width)) {
        for row in rows.chunks_exact(mask.width) {
            blocks.iter_mut().zip(row.chunks(2)).for_each(|(any, block)| *any |= block.contains(&true));
        }
    }
    any
}

/// The windows of pooling, in pixels of the plane that is pooled.
struct Windows {
    around: f32,
    along: f32,
    step: f32,
    support: f32,
}

impl Windows {
    fn of(settings: &OrientSettings) -> Self {
        let &OrientSettings { pool_px, pool_along_px, support_px, .. } = settings;
        Self { around: pool_px, along: pool_along_px, step: STEP_PX, support: support_px }
    }

    /// In a plane of half the resolution that is doubled again.
    fn of_halved(self) -> Self {
        let half = |px: f32| 0.5 * px;
        Self {
            around: narrower(self.around, 2),
            along: half(self.along),
            step: half(self.step),
            support: half(self.support),
        }
    }
}

fn pool(energy: &OrientationEnergy, inside: &Plane<bool>, windows: &Windows) -> OrientationEnergy {
    let line = (windows.along, windows.step);
    let wide = isotropic(energy, windows.around);
    let once = along_lines(&wide, &wide, inside, line);
    let along = along_lines(&wide, &once, inside, line);
    supported(along, windows.support)
}

/// Adds to every pixel what its wider surroundings agree on, weighted by their own agreement: where texture says little
/// the surroundings decide. What is left of the total is the trust: how well the pixel's own energy agrees, times how well
/// the directions around it do. Where layers of strands cross, a pixel's own texture can be clear and still show another
/// layer than its neighbour's; of the hair of fast frames that is most of the error.
fn supported(mut pooled: OrientationEnergy, sigma: f32) -> OrientationEnergy {
    if sigma <= 0.0 {
        return pooled;
    }
    let n = pooled.total.data.len();
    let agreed = |plane: &Plane<f32>| {
        let share = |i: usize| {
            let total = pooled.total.data[i].max(1e-12);
            let agreement = length(pooled.cos2.data[i], pooled.sin2.data[i]) / total;
            agreement * plane.data[i] / total
        };
        Plane { data: (0..n).map(share).collect(), ..*plane }
    };
    let (c, s) = (agreed(&pooled.cos2), agreed(&pooled.sin2));
    let (wide_c, wide_s) = (gaussian(&c, sigma), gaussian(&s, sigma));
    let strength = gaussian(&Plane { data: (0..n).map(|i| length(c.data[i], s.data[i])).collect(), ..c }, sigma);
    for i in 0..n {
        let coherence = length(wide_c.data[i], wide_s.data[i]) / strength.data[i].max(1e-9);
        let own = length(pooled.cos2.data[i], pooled.sin2.data[i]) / pooled.total.data[i].max(1e-12);
        let trusted = own.sqrt() * coherence.powi(4) * pooled.total.data[i];
        let (x, y) = (c.data[i] + 0.5 * wide_c.data[i], s.data[i] + 0.5 * wide_s.data[i]);
        let norm = length(x, y);
        if norm > 0.0 {
            (pooled.cos2.data[i], pooled.sin2.data[i]) = (x / norm * trusted, y / norm * trusted);
        }
    }
    pooled
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (usize, usize) = (151, 120);

    fn wave(length: f32, degrees: f32) -> Plane<f32> {
        let (sine, cosine) = degrees.to_radians().sin_cos();
        let across = |x: usize, y: usize| x as f32 * cosine + y as f32 * sine;
        Plane::from_fn(SIZE.0, SIZE.1, |x, y| (std::f32::consts::TAU / length * across(x, y)).sin())
    }

    #[test]
    fn filters_of_the_halved_image_see_what_those_of_the_image_see() {
        let filter = || Filter::of(9.5, 12);
        let (width, height) = SIZE;
        // Waves shorter than, as long as, and longer than the filter's.
        for (length, degrees) in [(7.5, 0.0), (9.5, 0.0), (9.5, 28.0), (9.5, 45.0), (9.5, 90.0), (13.0, 110.0)] {
            let texture = wave(length, degrees);
            let (all, half) = (seen(&texture, [filter()]), seen(&halved(&texture), [filter().of_halved()]));
            assert_eq!((half.total.width, half.total.height), (width.div_ceil(2), height / 2));
            for (x, y) in [(38, 30), (30, 25), (45, 33)] {
                let of = |energy: &OrientationEnergy, at: (usize, usize)| {
                    [energy.cos2[at], energy.sin2[at], energy.total[at]]
                };
                let (all, half) = (of(&all, (2 * x, 2 * y)), of(&half, (x, y)));
                assert!(
                    all.iter().zip(half).all(|(a, h)| (a - h).abs() < 0.02 * all[2]),
                    "{length} px at {degrees}°: {all:?}, {half:?}"
                );
            }
        }
    }

    #[test]
    fn half_the_resolution_reads_what_all_pixels_do() {
        // Fine and coarse lines that bend, and noise; the hair ends on odd pixels.
        let settings = OrientSettings::default();
        let texture = Plane::from_fn(SIZE.0, SIZE.1, |x, y| {
            let (x, y) = (x as f32, y as f32);
            let noise = ((x * 12.9898 + y * 78.233).sin() * 43_758.547).fract();
            (1.2 * (x + 9.0 * (y / 25.0).sin())).sin() + 0.7 * (0.6 * (x + 0.3 * y)).sin() + 0.5 * noise
        });
        let inside = Plane::from_fn(SIZE.0, SIZE.1, |x, y| (x as f32 - 75.0).hypot(y as f32 - 59.0) < 47.0);
        let all = pool(&of_pixels(&texture, &settings), &inside, &Windows::of(&settings));
        let half = pooled(&texture, &inside, &settings);
        let hair = || (0..inside.data.len()).filter(|&i| inside.data[i]);
        let share = |of: &OrientationEnergy, i: usize| length(of.cos2.data[i], of.sin2.data[i]) / of.total.data[i];
        let turned = |i: usize| {
            let twice = half.sin2.data[i].atan2(half.cos2.data[i]) - all.sin2.data[i].atan2(all.cos2.data[i]);
            0.5 * twice.sin().atan2(twice.cos()).abs().to_degrees()
        };
        let mean = hair().map(turned).sum::<f32>() / hair().count() as f32;
        let worst = hair().map(turned).fold(0.0, f32::max);
        let off = hair().map(|i| (share(&half, i) - share(&all, i)).abs()).fold(0.0, f32::max);
        assert!(mean < 0.3 && worst < 4.0 && off < 0.05, "angles {mean}°, {worst}°; confidence {off}");
        // Windows that half the resolution would not show are left to all pixels.
        let narrow = OrientSettings { pool_px: 2.5, ..settings };
        assert_eq!(
            pooled(&texture, &inside, &narrow),
            pool(&of_pixels(&texture, &narrow), &inside, &Windows::of(&narrow))
        );
    }

    #[test]
    fn a_block_is_hair_where_a_pixel_is() {
        let mask = Plane::from_fn(5, 3, |x, y| (x, y) == (4, 2) || (x, y) == (1, 0));
        let any = any_of_blocks(&mask);
        assert_eq!((any.width, any.height), (3, 2));
        assert_eq!(any.data, [true, false, false, false, false, true]);
    }
}
