//! Still images: PNG, JPEG, TIFF and EXR to 8-bit sRGB, masks to coverage, PNG out.

use std::path::{Path, PathBuf};

use image::{DynamicImage, ImageReader, Limits};
use strandflow_core::{Mask, Plane, RgbImage};

use crate::{
    IoError,
    error::At,
    exr_image::{is_exr, read_exr},
    whole_file::write_bytes,
};

/// File name endings that are read as images.
pub const IMAGE_EXTENSIONS: [&str; 7] = ["png", "jpg", "jpeg", "tif", "tiff", "exr", "PNG"];

/// No image is larger than this along one side \[px\]; a header that says so is a broken one.
const MAX_SIDE: u32 = 32_768;

/// Whether the file's name ends like an image's.
pub fn is_image(path: &Path) -> bool {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
    IMAGE_EXTENSIONS.iter().any(|known| known.eq_ignore_ascii_case(extension))
}

/// Reads a colour image as 8-bit sRGB. 16-bit samples are rounded, grey is repeated, alpha is dropped, EXR is tone-coded.
///
/// # Errors
/// The file cannot be read, is not an image, or holds non-finite samples.
pub fn read_rgb(path: &Path) -> Result<RgbImage, IoError> {
    if is_exr(path) {
        return read_exr(path);
    }
    let decoded = decode(path)?.to_rgb8();
    let (width, height) = (decoded.width() as usize, decoded.height() as usize);
    Ok(Plane { width, height, data: decoded.pixels().map(|pixel| pixel.0).collect() })
}

/// Reads a mask as coverage 0 to 255: the grey value; of an image with transparency and no grey of its own (all opaque
/// pixels alike), the alpha.
///
/// # Errors
/// As `read_rgb`.
pub fn read_mask(path: &Path) -> Result<Mask, IoError> {
    if is_exr(path) {
        return Ok(read_exr(path)?.map(|&[r, g, b]| r.max(g).max(b)));
    }
    let decoded = decode(path)?;
    let (width, height) = (decoded.width() as usize, decoded.height() as usize);
    if decoded.color().has_alpha() {
        let rgba = decoded.to_rgba8();
        let opaque = rgba.pixels().all(|pixel| pixel.0[3] == 255);
        let data = rgba
            .pixels()
            .map(|pixel| if opaque { pixel.0[..3].iter().copied().max().unwrap_or(0) } else { pixel.0[3] });
        return Ok(Plane { width, height, data: data.collect() });
    }
    // The largest channel: a mask painted in any pure colour counts as full.
    let rgb = decoded.to_rgb8();
    Ok(Plane { width, height, data: rgb.pixels().map(|pixel| pixel.0.into_iter().max().unwrap_or(0)).collect() })
}

fn decode(path: &Path) -> Result<DynamicImage, IoError> {
    let mut reader = ImageReader::open(path)
        .map_err(IoError::reading(path))?
        .with_guessed_format()
        .map_err(IoError::reading(path))?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    reader.limits(limits);
    reader.decode().map_err(|cause| unreadable(path, cause))
}

pub(crate) fn unreadable(path: &Path, cause: impl std::fmt::Display) -> IoError {
    IoError::content(
        path,
        At::FILE,
        format!("cannot be read as an image: {cause}"),
        "open it in an image viewer; if it is damaged, export or copy it again (PNG, JPEG, TIFF and EXR are read)",
    )
}

/// Writes an 8-bit sRGB PNG.
///
/// # Errors
/// The file cannot be written.
pub fn write_rgb_png(path: &Path, image: &RgbImage) -> Result<(), IoError> {
    let bytes: Vec<u8> = image.data.iter().flatten().copied().collect();
    write_png(path, image.width, image.height, &bytes, image::ExtendedColorType::Rgb8)
}

/// Writes an 8-bit sRGB PNG with coverage, not premultiplied.
///
/// # Errors
/// The file cannot be written.
pub fn write_rgba_png(path: &Path, image: &Plane<[u8; 4]>) -> Result<(), IoError> {
    let bytes: Vec<u8> = image.data.iter().flatten().copied().collect();
    write_png(path, image.width, image.height, &bytes, image::ExtendedColorType::Rgba8)
}

/// Writes an 8-bit grey PNG.
///
/// # Errors
/// The file cannot be written.
pub fn write_mask_png(path: &Path, mask: &Mask) -> Result<(), IoError> {
    write_png(path, mask.width, mask.height, &mask.data, image::ExtendedColorType::L8)
}

/// The bytes of an 8-bit grey PNG.
///
/// # Errors
/// The mask has no pixels.
pub fn mask_png(mask: &Mask) -> Result<Vec<u8>, image::ImageError> {
    encoded(mask.width, mask.height, &mask.data, image::ExtendedColorType::L8)
}

fn write_png(path: &Path, w: usize, h: usize, bytes: &[u8], colour: image::ExtendedColorType) -> Result<(), IoError> {
    let encoded = encoded(w, h, bytes, colour).map_err(|cause| IoError::writing(path)(std::io::Error::other(cause)))?;
    write_bytes(path, &encoded)
}

fn encoded(w: usize, h: usize, bytes: &[u8], colour: image::ExtendedColorType) -> Result<Vec<u8>, image::ImageError> {
    use image::ImageEncoder;
    let mut encoded = Vec::new();
    image::codecs::png::PngEncoder::new(&mut encoded).write_image(bytes, w as u32, h as u32, colour)?;
    Ok(encoded)
}

/// The images directly inside a folder, by name.
///
/// # Errors
/// The folder cannot be listed.
pub fn images_in(folder: &Path) -> Result<Vec<PathBuf>, IoError> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(IoError::reading(folder))? {
        let path = entry.map_err(IoError::reading(folder))?.path();
        let hidden = path.file_name().and_then(|name| name.to_str()).is_some_and(|name| name.starts_with('.'));
        if is_image(&path) && !hidden {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn png_round_trips_and_sixteen_bits_are_rounded() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        let picture = RgbImage::from_fn(17, 9, |x, y| [x as u8 * 15, y as u8 * 20, (x * y) as u8]);
        write_rgb_png(&path, &picture).unwrap();
        assert_eq!(read_rgb(&path).unwrap(), picture);
        let sixteen = image::ImageBuffer::from_fn(3, 2, |x, _| image::Luma([(x * 257 * 100) as u16]));
        sixteen.save(dir.path().join("b.tiff")).unwrap();
        assert_eq!(read_rgb(&dir.path().join("b.tiff")).unwrap().row(0), [[0; 3], [100; 3], [200; 3]]);
        assert_eq!(read_mask(&dir.path().join("b.tiff")).unwrap().row(1), [0, 100, 200]);
    }

    #[test]
    fn a_jpeg_is_close_and_alpha_is_a_mask() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.jpg");
        image::RgbImage::from_fn(32, 32, |x, y| image::Rgb([x as u8 * 4, y as u8 * 4, 90])).save(&path).unwrap();
        let read = read_rgb(&path).unwrap();
        assert!(read[(20, 12)].iter().zip([80u8, 48, 90]).all(|(a, b)| a.abs_diff(b) < 12), "{:?}", read[(20, 12)]);
        let path = dir.path().join("alpha.png");
        image::RgbaImage::from_fn(4, 4, |x, _| image::Rgba([9, 9, 9, x as u8 * 80])).save(&path).unwrap();
        assert_eq!(read_mask(&path).unwrap().row(0), [0, 80, 160, 240]);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn broken_images_are_errors_and_name_the_file(cut in 0usize..300, flips in prop::collection::vec((0usize..300, any::<u8>()), 0..6)) {
            let dir = tempfile::tempdir().unwrap();
            let path = dir.path().join("broken.png");
            write_rgb_png(&path, &RgbImage::from_fn(20, 10, |x, y| [x as u8, y as u8, 77])).unwrap();
            let mut bytes = std::fs::read(&path).unwrap();
            for (at, value) in flips { let n = bytes.len(); bytes[at % n] ^= value; }
            bytes.truncate(cut);
            std::fs::write(&path, &bytes).unwrap();
            if let Err(error) = read_rgb(&path) { prop_assert!(error.to_string().contains("broken.png")); }
        }
    }
}
