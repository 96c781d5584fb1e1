//! Images for the browser: photographs as JPEG, layers as PNG.

use image::{
    ExtendedColorType, ImageBuffer, ImageEncoder, Rgb,
    codecs::{
        jpeg::JpegEncoder,
        png::{CompressionType, FilterType, PngEncoder},
    },
    imageops,
};

use crate::{Picture, Refusal};

/// Quality of the JPEGs: hair shows blocks below 80, files double above 92.
const QUALITY: u8 = 88;

/// Content type and bytes. A photograph wider than `most_wide` pixels is shrunk to that width; a layer keeps its pixels.
///
/// # Errors
/// The picture has no pixels.
pub fn encoded(picture: &Picture, most_wide: Option<usize>) -> Result<(&'static str, Vec<u8>), Refusal> {
    let mut out = Vec::new();
    let (kind, done) = match picture {
        Picture::Photo(image) => {
            let encoder = JpegEncoder::new_with_quality(&mut out, QUALITY);
            let (bytes, size) = (image.data.as_flattened(), (image.width as u32, image.height as u32));
            let small = most_wide.filter(|wide| *wide < image.width).and_then(|wide| {
                let high = (image.height * wide).div_ceil(image.width).max(1);
                let whole: ImageBuffer<Rgb<u8>, &[u8]> = ImageBuffer::from_raw(size.0, size.1, bytes)?;
                Some(imageops::resize(&whole, wide as u32, high as u32, imageops::FilterType::Triangle))
            });
            let done = match &small {
                Some(small) => encoder.write_image(small, small.width(), small.height(), ExtendedColorType::Rgb8),
                None => encoder.write_image(bytes, size.0, size.1, ExtendedColorType::Rgb8),
            };
            ("image/jpeg", done)
        }
        Picture::Layer(layer) => {
            // Large areas of one colour: the fastest compression is small enough for a loopback.
            let encoder = PngEncoder::new_with_quality(&mut out, CompressionType::Fast, FilterType::Up);
            let (bytes, size) = (layer.data.as_flattened(), (layer.width as u32, layer.height as u32));
            ("image/png", encoder.write_image(bytes, size.0, size.1, ExtendedColorType::Rgba8))
        }
    };
    done.map_err(|error| Refusal::broken(format!("the picture cannot be encoded: {error}"), "look at the footage"))?;
    Ok((kind, out))
}

#[cfg(test)]
mod tests {
    use strandflow_core::{Plane, RgbImage};

    use super::*;

    #[test]
    fn pictures_can_be_read_back() {
        let photo = Picture::Photo(RgbImage::filled(16, 8, [200, 100, 50]).into());
        for (most_wide, size) in [(None, (16, 8)), (Some(16), (16, 8)), (Some(7), (7, 4))] {
            let (kind, bytes) = encoded(&photo, most_wide).unwrap();
            let read = image::load_from_memory(&bytes).unwrap().into_rgb8();
            let near = read.pixels().all(|p| p.0.iter().zip([200u8, 100, 50]).all(|(a, b)| a.abs_diff(b) < 8));
            assert!(kind == "image/jpeg" && read.dimensions() == size && near);
        }
        let mut layer = Plane::filled(16, 8, [0u8; 4]);
        layer[(3, 2)] = [1, 2, 3, 4];
        let (kind, bytes) = encoded(&Picture::Layer(layer), None).unwrap();
        let read = image::load_from_memory(&bytes).unwrap().into_rgba8();
        assert!(kind == "image/png" && read.dimensions() == (16, 8));
        assert_eq!((read.get_pixel(3, 2).0, read.get_pixel(4, 2).0), ([1, 2, 3, 4], [0; 4]));
    }
}
