//! The fibre's scattering in tables, so that millions of points can be lit: for some shades of one colour.
//!
//! Also what a crowd of fibres does to light, by dual scattering (Zinke 2008) in a light form: see [`Crowd`].

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use crate::{
    colour::HairColour,
    fibre::{Inclination, PATHS, Roughness},
};

/// Shades of the colour, from light to dark: strands of one head differ. Fewer show as groups.
pub(crate) const SHADES: usize = 8;

/// How far the lightest and the darkest shade are from the middle, in logarithm of absorption.
const SHADE_REACH: f32 = 0.9;

/// Entries along each sine of inclination. The sharpest lobe (TT) is about 0.1 wide: four entries.
const SINES: usize = 96;
/// Entries of the azimuth, 0 to π, and of cos θd, 0 to 1: both lobes are wide.
const AZIMUTHS: usize = 48;
const DIFFERENCES: usize = 12;

/// The tables.
pub(crate) struct Scattering {
    /// M, shape (SINES, SINES, PATHS): light, eye.
    along: Vec<Vec4>,
    /// N, shape (SHADES, DIFFERENCES, AZIMUTHS, RGB, PATHS).
    around: Vec<[Vec4; 3]>,
    /// Of each shade.
    pub crowds: Vec<Crowd>,
}

/// What a crowd of fibres of one shade does to light, averaged over directions, linear RGB.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Crowd {
    /// Share of light that goes on forward at a fibre (Zinke 2008, ā_f).
    pub forward: Vec3,
    /// Share that comes back from many fibres behind one another (Zinke 2008, Ā_b).
    pub backward: Vec3,
    /// Share that one fibre scatters at all.
    pub albedo: Vec3,
}

impl Scattering {
    /// Tables of a colour.
    pub(crate) fn new(colour: HairColour, roughness: Roughness) -> Self {
        let sine = |i: usize| Inclination::of_sine(2.0 * i as f32 / (SINES - 1) as f32 - 1.0);
        let along = (0..SINES * SINES)
            .into_par_iter()
            .map(|i| Vec4::from_array(roughness.longitudinal(sine(i / SINES), sine(i % SINES))))
            .collect();
        let absorption = colour.absorption(roughness.azimuthal);
        let phi: Vec<f32> = (0..AZIMUTHS).map(|a| a as f32 / (AZIMUTHS - 1) as f32 * std::f32::consts::PI).collect();
        let rows: Vec<Vec<[Vec3; PATHS]>> = (0..SHADES * DIFFERENCES)
            .into_par_iter()
            .map(|i| {
                let (shade, d) = (i / DIFFERENCES, i % DIFFERENCES);
                let log = SHADE_REACH * (2.0 * shade as f32 / (SHADES - 1) as f32 - 1.0);
                roughness.azimuthal(absorption * log.exp(), d as f32 / (DIFFERENCES - 1) as f32, &phi)
            })
            .collect();
        let crowds = rows.chunks(DIFFERENCES).map(Crowd::of).collect();
        let by_colour = |paths: &[Vec3; PATHS]| std::array::from_fn(|c| Vec4::from_array(paths.map(|n| n[c])));
        let around = rows.iter().flatten().map(by_colour).collect();
        Self { along, around, crowds }
    }

    /// Light sent from a light to an eye \[1/sr\], by the single fibre, and spread evenly around it (the last path's lobe).
    pub(crate) fn towards(&self, shade: usize, light: Inclination, eye: Inclination, cos_phi: f32) -> (Vec3, f32) {
        let m = self.along_at(light, eye);
        let cos_d = (0.5 * (1.0 + light.cos * eye.cos + light.sin * eye.sin)).max(0.0).sqrt();
        let n = self.around_at(shade, cos_d, arc_cosine(cos_phi) / std::f32::consts::PI);
        let single = Vec3::new(n[0].dot(m), n[1].dot(m), n[2].dot(m));
        (single, m.w / std::f32::consts::TAU)
    }

    fn along_at(&self, light: Inclination, eye: Inclination) -> Vec4 {
        let place = |sin: f32| {
            let at = (sin * 0.5 + 0.5) * (SINES - 1) as f32;
            let i = (at as usize).min(SINES - 2);
            (i, at - i as f32)
        };
        let ((i, fi), (j, fj)) = (place(light.sin), place(eye.sin));
        let row = |i: usize| {
            let pair = &self.along[i * SINES + j..i * SINES + j + 2];
            pair[0] + (pair[1] - pair[0]) * fj
        };
        let (low, high) = (row(i), row(i + 1));
        low + (high - low) * fi
    }

    fn around_at(&self, shade: usize, cos_d: f32, turn: f32) -> [Vec4; 3] {
        let d = cos_d.min(1.0) * (DIFFERENCES - 1) as f32;
        let a = turn.clamp(0.0, 1.0) * (AZIMUTHS - 1) as f32;
        let (i, j) = ((d as usize).min(DIFFERENCES - 2), (a as usize).min(AZIMUTHS - 2));
        let (fi, fj) = (d - i as f32, a - j as f32);
        let row = (shade * DIFFERENCES + i) * AZIMUTHS + j;
        let (low, high) = (&self.around[row..row + 2], &self.around[row + AZIMUTHS..row + AZIMUTHS + 2]);
        let weights = [(1.0 - fi) * (1.0 - fj), (1.0 - fi) * fj, fi * (1.0 - fj), fi * fj];
        std::array::from_fn(|c| {
            low[0][c] * weights[0] + low[1][c] * weights[1] + high[0][c] * weights[2] + high[1][c] * weights[3]
        })
    }
}

impl Crowd {
    /// From the azimuthal table of a shade, shape (DIFFERENCES, AZIMUTHS).
    fn of(rows: &[Vec<[Vec3; PATHS]>]) -> Self {
        let (mut front, mut back) = (Vec3::ZERO, Vec3::ZERO);
        // Light meets fibres at all inclinations, seldom along them: the upper half of cos θd.
        for row in rows.iter().skip(DIFFERENCES / 2) {
            for (a, paths) in row.iter().enumerate() {
                let ends = if a == 0 || a == AZIMUTHS - 1 { 0.5 } else { 1.0 };
                let sum = paths.iter().sum::<Vec3>() * (ends * std::f32::consts::TAU / (AZIMUTHS - 1) as f32);
                if 2 * a < AZIMUTHS { back += sum } else { front += sum }
            }
        }
        let rows = (DIFFERENCES - DIFFERENCES / 2) as f32;
        let (front, back) = (front / rows, back / rows);
        let albedo = (front + back).min(Vec3::ONE);
        // One, and three times back, any number of times forward (Zinke 2008, eqs. 13 to 15). At a forward share of 1 the
        // series has no end: 0.97 is the lightest hair there is.
        let front = front.min(Vec3::splat(0.97));
        let onward = Vec3::ONE / (Vec3::ONE - front * front);
        let once = back * front * front * onward;
        let thrice = back * back * back * front * front * onward * onward * onward;
        Self { forward: front, backward: (once + thrice).min(Vec3::ONE), albedo }
    }
}

/// Added to a number of at most 2²², this rounds it to a whole one, which is in the last bits then: many times faster than a
/// cast, which asks for all that may go wrong.
pub(crate) const ROUNDING: f32 = 12_582_912.0;

/// The exponentials of four numbers that are not positive, to a part in 100,000: powers of two times a Taylor series over half of
/// a power, four at a time where the library takes one.
pub(crate) fn decayed(x: Vec4) -> Vec4 {
    let x = x.clamp(Vec4::splat(-80.0), Vec4::ZERO);
    let shifted = x * std::f32::consts::LOG2_E + ROUNDING;
    let whole = shifted - ROUNDING;
    let scale = Vec4::from_array(shifted.to_array().map(|p| f32::from_bits(p.to_bits().wrapping_add(127) << 23)));
    let rest = x - whole * std::f32::consts::LN_2;
    let series = [1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0];
    scale * series.into_iter().fold(Vec4::splat(1.0 / 720.0), |sum, term| sum * rest + term)
}

/// Arc cosine to 7e-5 rad (Abramowitz and Stegun 1964, 4.4.45).
fn arc_cosine(x: f32) -> f32 {
    let a = x.abs().min(1.0);
    let half = (1.0 - a).sqrt() * (1.570_728_8 + a * (-0.212_114_4 + a * (0.074_261 - a * 0.018_729_3)));
    if x < 0.0 { std::f32::consts::PI - half } else { half }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_follow_the_lobes() {
        let (colour, roughness) = (HairColour::BROWN, Roughness::default());
        let tables = Scattering::new(colour, roughness);
        let log = SHADE_REACH * (2.0 * 3.0 / (SHADES - 1) as f32 - 1.0);
        let absorption = colour.absorption(roughness.azimuthal) * log.exp();
        for (i, o, cos_phi) in [(0.1, -0.2, 0.9f32), (0.5, -0.4, 0.2), (-0.3, 0.35, -0.8), (0.0, 0.1, -0.99)] {
            let (light, eye) = (Inclination::of_sine(i), Inclination::of_sine(o));
            let m = roughness.longitudinal(light, eye);
            let cos_d = (0.5 * (1.0 + light.cos * eye.cos + light.sin * eye.sin)).sqrt();
            let n = roughness.azimuthal(absorption, cos_d, &[cos_phi.acos()])[0];
            let exact: Vec3 = (0..PATHS).map(|p| n[p] * m[p]).sum();
            let (table, _) = tables.towards(3, light, eye, cos_phi);
            let error = (table - exact).abs().max_element() / exact.max_element();
            assert!(error < 0.03, "{table} for {exact} at {i} {o} {cos_phi}");
        }
    }

    #[test]
    fn exponentials_are_those_of_the_library() {
        for i in 0..8000 {
            let x = -0.01 * i as f32;
            let got = decayed(Vec4::new(x, 0.3 * x, 0.0, -1e9)).to_array();
            for (got, wanted) in got.into_iter().zip([x.exp(), (0.3 * x).exp(), 1.0, 0.0]) {
                assert!((got - wanted).abs() <= 1e-5 * wanted + 1e-30, "{got} for {wanted} of {x}");
            }
        }
    }

    #[test]
    fn light_hair_sends_more_back_and_through_than_dark() {
        let of = |colour| Scattering::new(colour, Roughness::default()).crowds[SHADES / 2];
        let (blond, black) = (of(HairColour::BLOND), of(HairColour::BLACK));
        assert!(blond.forward.x > 0.5 && blond.backward.x > 0.05, "{blond:?}");
        assert!(black.backward.max_element() < 0.01 && black.albedo.max_element() < 0.4, "{black:?}");
        assert!(blond.forward.x > blond.forward.z, "{blond:?}");
    }
}
