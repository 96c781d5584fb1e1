//! OpenEXR images: linear light to 8-bit sRGB.

use std::{path::Path, result::Result};

use exr::prelude::*;
use strandflow_core::{Plane, RgbImage};

use crate::{IoError, error::At, image_file::unreadable};

/// Whether the file's name ends in `.exr`.
pub fn is_exr(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("exr"))
}

/// Reads the first RGB layer (or the luminance `Y`) of an EXR; linear values 0 to 1 are coded as sRGB, larger ones clip.
///
/// # Errors
/// The file cannot be read, has no R, G, B or Y channel, or a sample is not a number.
pub fn read_exr(path: &Path) -> Result<RgbImage, IoError> {
    if let Err(cause) = std::fs::metadata(path) {
        return Err(IoError::reading(path)(cause));
    }
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .map_err(|cause| unreadable(path, cause))?;
    let (width, height) = (image.layer_data.size.width(), image.layer_data.size.height());
    let channel = |name: &str| image.layer_data.channel_data.list.iter().find(|c| c.name.to_string() == name);
    let channels = match (channel("R"), channel("G"), channel("B"), channel("Y")) {
        (Some(r), Some(g), Some(b), _) => [r, g, b],
        (_, _, _, Some(y)) => [y, y, y],
        _ => return Err(unreadable(path, "it has no channels R, G, B or Y")),
    };
    let samples = channels.map(|c| c.sample_data.values_as_f32().collect::<Vec<f32>>());
    if samples.iter().any(|channel| channel.len() != width * height) {
        return Err(unreadable(path, "its channels are subsampled"));
    }
    let mut data = Vec::with_capacity(samples[0].len());
    let [red, green, blue] = &samples;
    for (i, ((&r, &g), &b)) in red.iter().zip(green).zip(blue).enumerate() {
        let linear = [r, g, b];
        if linear.iter().any(|value| value.is_nan()) {
            let (x, y) = (i % width, i / width);
            return Err(IoError::content(
                path,
                At::FILE,
                format!("the sample at column {x}, row {y} is not a number"),
                "export the image again without NaN samples",
            ));
        }
        data.push(linear.map(srgb8_from_linear));
    }
    Ok(Plane { width, height, data })
}

/// 8-bit sRGB from linear light, IEC 61966-2-1.
pub fn srgb8_from_linear(linear: f32) -> u8 {
    let l = linear.clamp(0.0, 1.0);
    let coded = if l <= 0.003_130_8 { 12.92 * l } else { 1.055 * l.powf(1.0 / 2.4) - 0.055 };
    (coded * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_light_is_coded_as_srgb() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.exr");
        write_rgb_file(&path, 5, 3, |x, _| (x as f32 * 0.25, 0.18f32, 4.0f32)).unwrap();
        let image = crate::read_rgb(&path).unwrap();
        assert_eq!((image.width, image.height), (5, 3));
        // 18 % grey is 118 (117.7) in sRGB; half the light is 188.
        assert_eq!(image[(2, 1)], [188, 118, 255]);
        assert_eq!(image[(0, 0)][0], 0);
        let bytes = std::fs::read(&path).unwrap();
        for cut in (0..bytes.len()).step_by(7) {
            std::fs::write(&path, &bytes[..cut]).unwrap();
            let _ = crate::read_rgb(&path);
        }
        write_rgb_file(&path, 5, 3, |_, _| (f32::NAN, 0.18f32, 4.0f32)).unwrap();
        assert!(crate::read_rgb(&path).unwrap_err().to_string().contains("not a number"));
    }
}
