//! Hair colours as absorption, and sRGB.

use glam::Vec3;

/// What a hair absorbs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HairColour {
    /// Concentrations of the two melanins: eumelanin (brown to black) and pheomelanin (red).
    Melanin {
        /// 0.3 blond, 1.3 brown, 8 black.
        eumelanin: f32,
        /// 0 to 2; it reddens.
        pheomelanin: f32,
    },
    /// The colour that a thick bundle of such hair shows under white light, linear RGB, each 0 to 1.
    Bundle(Vec3),
}

impl HairColour {
    /// Brown.
    pub const BROWN: Self = Self::Melanin { eumelanin: 0.8, pheomelanin: 0.45 };
    /// Black.
    pub const BLACK: Self = Self::Melanin { eumelanin: 6.0, pheomelanin: 0.0 };
    /// Blond.
    pub const BLOND: Self = Self::Melanin { eumelanin: 0.17, pheomelanin: 0.2 };
    /// Red.
    pub const RED: Self = Self::Bundle(Vec3::new(0.25, 0.05, 0.012));
    /// Grey.
    pub const GREY: Self = Self::Bundle(Vec3::new(0.42, 0.42, 0.43));

    /// Absorption across a fibre of radius 1, linear RGB, for an azimuthal roughness.
    ///
    /// Melanins: d'Eon 2011. Bundle colours: the inversion of Chiang 2016 (eq. 9).
    pub fn absorption(self, azimuthal_roughness: f32) -> Vec3 {
        /// A channel that is darker absorbs no more that a picture could show, and zero has no logarithm.
        const DARKEST: f32 = 1e-3;
        match self {
            Self::Melanin { eumelanin, pheomelanin } => {
                Vec3::new(0.419, 0.697, 1.37) * eumelanin + Vec3::new(0.187, 0.4, 1.05) * pheomelanin
            }
            Self::Bundle(colour) => {
                let b = azimuthal_roughness;
                let scale = 5.969 + b * (-0.215 + b * (2.532 + b * (-10.73 + b * (5.574 + b * 0.245))));
                let log = colour.clamp(Vec3::splat(DARKEST), Vec3::ONE).map(f32::ln) / scale;
                log * log
            }
        }
    }
}

/// Linear light of an 8-bit sRGB value (IEC 61966-2-1), 0 to 1.
pub fn linear_of_srgb(value: u8) -> f32 {
    let v = f32::from(value) / 255.0;
    if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// 8-bit sRGB of linear light (IEC 61966-2-1), rounded; what is beyond 0 to 1 is clipped.
pub fn srgb_of_linear(linear: f32) -> u8 {
    coded(linear).round() as u8
}

/// As [`srgb_of_linear`], not rounded, 0 to 255.
pub(crate) fn coded(linear: f32) -> f32 {
    let v = linear.clamp(0.0, 1.0);
    255.0 * if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_round_trips() {
        for value in 0..=255 {
            assert_eq!(srgb_of_linear(linear_of_srgb(value)), value);
        }
    }

    #[test]
    fn darker_hair_absorbs_more() {
        let of = |colour: HairColour| colour.absorption(0.3).element_sum();
        assert!(of(HairColour::BLACK) > of(HairColour::BROWN) && of(HairColour::BROWN) > of(HairColour::BLOND));
        assert_eq!(HairColour::Bundle(Vec3::ONE).absorption(0.3), Vec3::ZERO);
        assert!(HairColour::Bundle(Vec3::ZERO).absorption(0.3).is_finite());
    }
}
