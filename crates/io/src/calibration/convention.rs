//! What calibrations leave open: the direction of poses, the axes of cameras, the first pixel's centre, the unit.

use std::{path::Path, str::FromStr};

use crate::{IoError, error::At};

/// Which way R and t lead.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pose {
    /// x_camera = R x_world + t.
    WorldToCamera,
    /// x_world = R x_camera + t: t is the camera's place.
    CameraToWorld,
}

/// The axes of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axes {
    /// x right, y down, z forward.
    OpenCv,
    /// x right, y up, z back (also Blender's and NeRF's).
    OpenGl,
}

/// What the user says of conventions that a file leaves open; parts that are not said are `None`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Convention {
    /// The direction of poses.
    pub pose: Option<Pose>,
    /// The axes of cameras.
    pub axes: Option<Axes>,
    /// The coordinates of the first pixel's centre, 0 or 0.5.
    pub first_pixel: Option<f64>,
    /// Distortion terms are a fisheye's.
    pub fisheye: bool,
}

/// The words of [`Convention`], for messages.
pub const CONVENTION_WORDS: &str = "w2c or c2w, opencv or opengl, pixel0 or pixel0.5, fisheye";

impl FromStr for Convention {
    type Err = String;

    /// Words joined by commas: `c2w,opengl`, `pixel0.5`, `fisheye`.
    fn from_str(text: &str) -> Result<Self, String> {
        let mut all = Self::default();
        for word in text.split(',').map(|word| word.trim().to_ascii_lowercase()) {
            let contradicted = match word.as_str() {
                "w2c" | "world-to-camera" => all.pose.replace(Pose::WorldToCamera).is_some(),
                "c2w" | "camera-to-world" => all.pose.replace(Pose::CameraToWorld).is_some(),
                "opencv" => all.axes.replace(Axes::OpenCv).is_some(),
                "opengl" | "blender" => all.axes.replace(Axes::OpenGl).is_some(),
                "pixel0" => all.first_pixel.replace(0.0).is_some(),
                "pixel0.5" => all.first_pixel.replace(0.5).is_some(),
                "fisheye" => std::mem::replace(&mut all.fisheye, true),
                _ => return Err(format!("`{word}` is no convention; write {CONVENTION_WORDS}, joined by commas")),
            };
            if contradicted {
                return Err(format!("`{word}` says again what is said already; write each part once"));
            }
        }
        Ok(all)
    }
}

/// The unit of lengths in a file, before the user is asked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Unit {
    /// The file says so: millimetres a unit.
    Stated(f64),
    /// The format's documentation says so; the user may know better.
    Customary(f64),
    /// Not said; the distance of the cameras tells metres from millimetres.
    Unsaid,
    /// The format scales the scene as it likes, so that no distance tells anything.
    Arbitrary,
}

/// Millimetres per named unit.
pub(crate) fn unit_from_name(file: &Path, name: &str) -> Result<f64, IoError> {
    named_unit(name).ok_or_else(|| {
        IoError::content(
            file,
            At::FILE,
            format!("the unit `{name}` is not known"),
            "write metres, centimetres or millimetres",
        )
    })
}

/// Millimetres of a unit by name.
pub fn named_unit(name: &str) -> Option<f64> {
    match name.trim().to_ascii_lowercase().as_str() {
        "m" | "metre" | "metres" | "meter" | "meters" => Some(1000.0),
        "cm" | "centimetre" | "centimetres" | "centimeter" | "centimeters" => Some(10.0),
        "mm" | "millimetre" | "millimetres" | "millimeter" | "millimeters" => Some(1.0),
        _ => None,
    }
}

/// What to add to image coordinates so that the first pixel's centre is (0.5, 0.5), from a convention in words.
pub(crate) fn pixel_shift(file: &Path, convention: Option<&str>) -> Result<f64, IoError> {
    let Some(text) = convention else { return Ok(0.0) };
    let plain: String = text.to_ascii_lowercase().replace(' ', "");
    if plain.contains("0.5") {
        return Ok(0.0);
    }
    if (plain.contains("centre") || plain.contains("center")) && (plain.contains("(0,0)") || plain.contains("[0,0]")) {
        return Ok(0.5);
    }
    if plain.contains("corner") {
        return Ok(0.0);
    }
    Err(IoError::content(
        file,
        At::FILE,
        format!("the pixel convention `{text}` is not understood"),
        "write \"first pixel centre at (0.5, 0.5)\" or \"first pixel centre at (0, 0)\"",
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixel_conventions_in_words() {
        let shift = |text| pixel_shift(Path::new("c"), Some(text)).ok();
        assert_eq!(shift("top-left image corner is (0,0); the centre of the first pixel is (0.5,0.5)"), Some(0.0));
        assert_eq!(shift("the center of the first pixel is (0, 0)"), Some(0.5));
        assert_eq!(shift("whatever"), None);
    }

    #[test]
    fn conventions_are_words_that_do_not_contradict() {
        let all: Convention = "c2w, OpenGL,pixel0.5,fisheye".parse().unwrap();
        let expected = Convention {
            pose: Some(Pose::CameraToWorld),
            axes: Some(Axes::OpenGl),
            first_pixel: Some(0.5),
            fisheye: true,
        };
        assert_eq!(all, expected);
        assert!("c2w,w2c".parse::<Convention>().unwrap_err().contains("again"));
        assert!("maya".parse::<Convention>().unwrap_err().contains("opengl"));
    }
}
