//! Scattering of one fibre: longitudinal and azimuthal lobes, attenuation.
//!
//! A fibre scatters as the product of a longitudinal lobe M and an azimuthal lobe N, summed over the paths R (reflected),
//! TT (through), TRT (reflected inside once) and all longer ones (Marschner 2003). M is d'Eon 2011 (eq. 7); the azimuthal
//! lobes are trimmed logistics and the residual lobe sums a geometric series (Chiang 2016), so that a fibre which absorbs
//! nothing loses nothing.
//!
//! | symbol | name | unit |
//! |---|---|---|
//! | θ | inclination of a direction towards the tip, from the fibre's normal plane | rad |
//! | φ | azimuth between two directions around the fibre; 0 back to the light | rad |
//! | h | offset at which a ray meets the fibre, −1 to 1 | radius |
//! | v, s | longitudinal variance, azimuthal scale | rad², rad |

use std::f32::consts::{FRAC_PI_8, PI, TAU};

use glam::Vec3;

/// Refractive index of hair (Marschner 2003, table 1).
const INDEX: f32 = 1.55;

/// Tilt of the cuticle's scales \[rad\]: 3°, the middle of what Marschner 2003 gives. At 0 the white and the coloured band
/// of a highlight fall on one another; beyond 5° they are further apart than on photographs.
const TILT: f32 = 0.052;

/// Paths: R, TT, TRT, all longer ones.
pub(crate) const PATHS: usize = 4;

/// Inclination of a direction against a fibre.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Inclination {
    /// sin θ.
    pub sin: f32,
    /// cos θ ≥ 0.
    pub cos: f32,
}

impl Inclination {
    /// Of a direction with this sine.
    pub(crate) fn of_sine(sin: f32) -> Self {
        let sin = sin.clamp(-1.0, 1.0);
        Self { sin, cos: (1.0 - sin * sin).sqrt() }
    }

    fn turned(self, by: f32) -> Self {
        let (s, c) = by.sin_cos();
        Self { sin: self.sin * c + self.cos * s, cos: (self.cos * c - self.sin * s).abs() }
    }
}

/// How rough a fibre is, each 0 to 1 (Chiang 2016).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Roughness {
    /// Along the fibre: the width of the highlight bands.
    pub longitudinal: f32,
    /// Around the fibre: how soft the hair looks.
    pub azimuthal: f32,
}

impl Default for Roughness {
    /// Clean, combed hair. Below 0.2 along the fibre it looks wet, above 0.45 dusty.
    fn default() -> Self {
        Self { longitudinal: 0.25, azimuthal: 0.3 }
    }
}

impl Roughness {
    /// Longitudinal variance of each path \[rad²\] (Chiang 2016, eq. 7): TT is sharper, TRT softer than R.
    fn variances(self) -> [f32; PATHS] {
        let b = self.longitudinal;
        let v = (0.726 * b + 0.812 * b * b + 3.7 * b.powi(20)).powi(2);
        [v, 0.25 * v, 4.0 * v, 4.0 * v]
    }

    /// Azimuthal scale of the logistic \[rad\] (Chiang 2016, eq. 8).
    fn scale(self) -> f32 {
        let b = self.azimuthal;
        FRAC_PI_8.sqrt() * (0.265 * b + 1.194 * b * b + 5.372 * b.powi(22))
    }

    /// M of each path, whose integral over the sphere of directions is 1 / 2π for each N: ∫ M cos θ dθ = 1.
    pub(crate) fn longitudinal(self, light: Inclination, eye: Inclination) -> [f32; PATHS] {
        // The scales tilt R towards the root, TT and TRT towards the tip (Marschner 2003, table 1).
        let turned = [eye.turned(2.0 * TILT), eye.turned(-TILT), eye.turned(-4.0 * TILT), eye];
        let variances = self.variances();
        // A turn moves the lobe into bands of another size on the sphere: what it gains there is taken off.
        let sized = |p: usize| (turned[p].cos / eye.cos.max(1e-3)).min(1.5);
        std::array::from_fn(|p| longitudinal(variances[p], light, turned[p]) * sized(p))
    }

    /// N of each path: share of the light that the fibre sends into azimuths \[1/rad\], averaged over where the rays meet
    /// it, for a difference angle θd of light and eye.
    pub(crate) fn azimuthal(self, absorption: Vec3, cos_d: f32, phi: &[f32]) -> Vec<[Vec3; PATHS]> {
        /// Strips of the fibre's width: with half of them single strips show in smooth fibres.
        const STRIPS: usize = 40;
        let scale = self.scale();
        let mut sums = vec![[Vec3::ZERO; PATHS]; phi.len()];
        for strip in 0..STRIPS {
            let h = (strip as f32 + 0.5) * 2.0 / STRIPS as f32 - 1.0;
            let (shares, angles) = paths(absorption, cos_d, h);
            for (sum, phi) in sums.iter_mut().zip(phi) {
                for p in 0..PATHS - 1 {
                    sum[p] += shares[p] * trimmed_logistic(phi - angles[p], scale);
                }
                sum[PATHS - 1] += shares[PATHS - 1] / TAU;
            }
        }
        sums.into_iter().map(|sum| sum.map(|s| s / STRIPS as f32)).collect()
    }
}

/// Share of the light on each path, and the azimuth into which the first three leave, for a ray that meets the fibre at h.
fn paths(absorption: Vec3, cos_d: f32, h: f32) -> ([Vec3; PATHS], [f32; PATHS - 1]) {
    let cos_d = cos_d.max(1e-3);
    let sin_d2 = 1.0 - cos_d * cos_d;
    // The plane of the cross-section sees a higher index (Marschner 2003, eq. 3).
    let index = (INDEX * INDEX - sin_d2).sqrt() / cos_d;
    let (outside, inside) = (h.asin(), (h / index).asin());
    let path = 2.0 * inside.cos() / (1.0 - sin_d2 / (INDEX * INDEX)).sqrt();
    let through = (-absorption * path).exp();
    let f = fresnel(cos_d * outside.cos());
    let tt = through * (1.0 - f) * (1.0 - f);
    let trt = tt * through * f;
    let longer = trt * through * f / (Vec3::ONE - through * f);
    let angle = |p: f32| 2.0 * p * inside - 2.0 * outside + p * PI;
    ([Vec3::splat(f), tt, trt, longer], [angle(0.0), angle(1.0), angle(2.0)])
}

/// Reflectance of a smooth dielectric for unpolarised light.
fn fresnel(cos_outside: f32) -> f32 {
    let sin_inside2 = (1.0 - cos_outside * cos_outside) / (INDEX * INDEX);
    let cos_inside = (1.0 - sin_inside2).sqrt();
    let along = (INDEX * cos_outside - cos_inside) / (INDEX * cos_outside + cos_inside);
    let across = (cos_outside - INDEX * cos_inside) / (cos_outside + INDEX * cos_inside);
    0.5 * (along * along + across * across)
}

/// d'Eon 2011, eq. 7, in logarithms: its factors alone leave the range of numbers for sharp lobes.
fn longitudinal(variance: f32, light: Inclination, eye: Inclination) -> f32 {
    let a = light.cos * eye.cos / variance;
    let b = light.sin * eye.sin / variance;
    let log_sinh = 1.0 / variance - 2f32.ln() + (-(-2.0 / variance).exp()).ln_1p();
    (log_bessel(a) - b - (2.0 * variance).ln() - log_sinh).exp()
}

/// Logarithm of the modified Bessel function of order zero: its series, and for large arguments its asymptote.
fn log_bessel(x: f32) -> f32 {
    if x > 12.0 {
        return x - 0.5 * (TAU * x).ln() + (1.0 / (8.0 * x) + 9.0 / (128.0 * x * x)).ln_1p();
    }
    let quarter = 0.25 * x * x;
    let (mut sum, mut term) = (1.0, 1.0);
    for k in 1..30 {
        term *= quarter / (k * k) as f32;
        sum += term;
    }
    f32::ln(sum)
}

/// The logistic distribution on −π to π, whole again after what lies beyond was cut off.
fn trimmed_logistic(phi: f32, scale: f32) -> f32 {
    let phi = (phi + PI).rem_euclid(TAU) - PI;
    let e = (-(phi / scale).abs()).exp();
    let whole = (0.5 * PI / scale).tanh();
    e / (scale * (1.0 + e) * (1.0 + e)) / whole
}

#[cfg(test)]
mod tests {
    use std::f32::consts::FRAC_PI_2;

    use super::*;

    /// White furnace: what a fibre sends over the whole sphere when light comes from one direction.
    fn reflected(roughness: Roughness, absorption: Vec3, sin_light: f32) -> Vec3 {
        const ROWS: usize = 120;
        const COLUMNS: usize = 60;
        let light = Inclination::of_sine(sin_light);
        let mut sum = Vec3::ZERO;
        for row in 0..ROWS {
            let theta = ((row as f32 + 0.5) / ROWS as f32 - 0.5) * PI;
            let eye = Inclination { sin: theta.sin(), cos: theta.cos() };
            let m = roughness.longitudinal(light, eye);
            let cos_d = (0.5 * (1.0 + light.cos * eye.cos + light.sin * eye.sin)).sqrt();
            let phi: Vec<f32> = (0..COLUMNS).map(|column| (column as f32 + 0.5) / COLUMNS as f32 * TAU).collect();
            for n in roughness.azimuthal(absorption, cos_d, &phi) {
                let of_path = (0..PATHS).map(|p| n[p] * m[p]).sum::<Vec3>();
                sum += of_path * eye.cos * (PI / ROWS as f32) * (TAU / COLUMNS as f32);
            }
        }
        sum
    }

    #[test]
    fn a_fibre_that_absorbs_nothing_loses_nothing() {
        for longitudinal in [0.2, 0.3, 0.6] {
            for sin_light in [0.0, 0.4, -0.7] {
                let roughness = Roughness { longitudinal, ..Roughness::default() };
                let all = reflected(roughness, Vec3::ZERO, sin_light);
                assert!((all - Vec3::ONE).abs().max_element() < 0.04, "{all} at {longitudinal}, {sin_light}");
            }
        }
        let dark = reflected(Roughness::default(), Vec3::new(0.5, 1.0, 4.0), 0.2);
        assert!(dark.x > dark.y && dark.y > dark.z && dark.z > 0.03 && dark.x < 0.8, "{dark}");
    }

    #[test]
    fn lobes_are_whole_and_the_white_band_lies_towards_the_root() {
        let steps = 2000;
        for variance in [0.01f32, 0.08, 0.5] {
            let sum: f32 = (0..steps)
                .map(|k| {
                    let theta = ((k as f32 + 0.5) / steps as f32 - 0.5) * PI;
                    let eye = Inclination { sin: theta.sin(), cos: theta.cos() };
                    longitudinal(variance, Inclination::of_sine(0.3), eye) * eye.cos * PI / steps as f32
                })
                .sum();
            assert!((sum - 1.0).abs() < 2e-3, "{sum} at {variance}");
        }
        let peak = |p: usize| {
            let theta = |k: usize| (k as f32 / 400.0 - 0.5) * FRAC_PI_2;
            let m = |k: usize| {
                let eye = Inclination { sin: theta(k).sin(), cos: theta(k).cos() };
                Roughness::default().longitudinal(Inclination::of_sine(0.0), eye)[p]
            };
            theta((0..400).max_by(|&a, &b| m(a).total_cmp(&m(b))).unwrap())
        };
        assert!(peak(0) < -0.08 && peak(2) > 0.1, "{} {}", peak(0), peak(2));
    }

    #[test]
    fn the_bessel_function_is_continuous_and_known() {
        assert!((log_bessel(1.0) - 1.266_066f32.ln()).abs() < 1e-6);
        assert!((log_bessel(12.0) - log_bessel(12.000_1)).abs() < 1e-3);
    }
}
