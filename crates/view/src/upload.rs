//! What may be handed in: how large, and whether it is what it should be.

use std::io::Cursor;

use axum::{
    body::{Body, to_bytes},
    http::{HeaderMap, header},
};
use image::{ColorType, ImageDecoder, Limits, codecs::png::PngDecoder};
use strandflow_core::{Mask, Plane};

use crate::Refusal;

/// Largest JSON that is taken: sixteen views with a thousand labels in a thousand frames come nowhere near.
pub const MOST_JSON: usize = 16 << 20;

/// Largest PNG of one channel that is taken for an image of a size: what deflate adds where nothing can be compressed is a few
/// bytes in thousands.
pub fn most_png((width, height): (usize, usize)) -> usize {
    let raw = height.saturating_mul(width.saturating_add(1));
    raw.saturating_add(raw / 64).saturating_add(64 << 10)
}

/// The body of a request, if it is not larger than `most` bytes. Larger ones are not read to their end.
pub(crate) async fn body(headers: &HeaderMap, body: Body, most: usize) -> Result<Vec<u8>, Refusal> {
    let too_large = || {
        let fact = format!("more than {most} bytes were sent");
        Refusal::too_large(fact, "send a smaller document, or a PNG of the view's size with one channel")
    };
    let stated = headers.get(header::CONTENT_LENGTH).and_then(|length| length.to_str().ok()?.parse::<usize>().ok());
    if stated.is_some_and(|length| length > most) {
        return Err(too_large());
    }
    to_bytes(body, most).await.map(|bytes| bytes.to_vec()).map_err(|_| too_large())
}

/// A mask from a PNG with one channel of 8 bits, of the size stated.
///
/// # Errors
/// `Bad` where it is no such PNG. Its header is checked before memory is taken.
pub fn mask_from_png(png: &[u8], (width, height): (usize, usize)) -> Result<Mask, Refusal> {
    let hint = "send a PNG with one channel of 8 bits and the size of the view";
    let bad = |fact: String| Refusal::bad(fact, hint);
    let broken = |error: image::ImageError| bad(format!("the mask is no PNG that can be read: {error}"));
    let mut limits = Limits::default();
    limits.max_alloc = Some(2 * most_png((width, height)) as u64);
    let decoder = PngDecoder::with_limits(Cursor::new(png), limits).map_err(broken)?;
    let (w, h) = decoder.dimensions();
    if (w as usize, h as usize) != (width, height) {
        return Err(bad(format!("the mask is {w}×{h}, the view {width}×{height}")));
    }
    if decoder.color_type() != ColorType::L8 {
        return Err(bad(format!("the mask has the samples {:?}, not one channel of 8 bits", decoder.color_type())));
    }
    let mut data = vec![0; width * height];
    decoder.read_image(&mut data).map_err(broken)?;
    Ok(Plane { width, height, data })
}

#[cfg(test)]
mod tests {
    use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};

    use super::*;

    fn png(width: u32, height: u32, bytes: &[u8], colour: ExtendedColorType) -> Vec<u8> {
        let mut out = Vec::new();
        PngEncoder::new(&mut out).write_image(bytes, width, height, colour).unwrap();
        out
    }

    #[test]
    fn a_mask_of_the_views_size_is_taken_and_others_are_told_apart() {
        let grey: Vec<u8> = (0..12).collect();
        let good = png(4, 3, &grey, ExtendedColorType::L8);
        assert_eq!(mask_from_png(&good, (4, 3)).unwrap().data, grey);
        let said = |bytes: &[u8]| mask_from_png(bytes, (4, 3)).unwrap_err().error;
        assert!(said(&png(3, 4, &grey, ExtendedColorType::L8)).contains("3×4, the view 4×3"));
        assert!(said(&png(4, 3, &[7; 36], ExtendedColorType::Rgb8)).contains("Rgb8"));
        assert!(said(b"GIF89a").contains("no PNG"));
        // What lacks its last bytes only is whole: the image ends before them.
        for cut in 0..good.len() {
            let read = mask_from_png(&good[..cut], (4, 3));
            assert!(read.map_or_else(|r| r.status() == 400, |mask| mask.data == grey), "{cut}");
        }
        assert!(mask_from_png(&good[..good.len() / 2], (4, 3)).is_err());
        // A header that claims more than any memory.
        let mut vast = good;
        vast[16..24].copy_from_slice(&[0x7f, 0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff]);
        assert!(said(&vast).contains("PNG"));
    }

    #[test]
    fn noise_fits_and_twice_as_much_does_not() {
        let mut seed = 1u32;
        let noise: Vec<u8> = std::iter::repeat_with(|| {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (seed >> 24) as u8
        })
        .take(640 * 480)
        .collect();
        assert!(png(640, 480, &noise, ExtendedColorType::L8).len() <= most_png((640, 480)));
        assert!(most_png((640, 480)) < 2 * noise.len());
    }
}
