//! Images as part of the page, as JPEG in a data address.

use base64::{Engine, engine::general_purpose::STANDARD};
use image::{ExtendedColorType, RgbImage as Pixels, codecs::jpeg::JpegEncoder, imageops};
use strandflow_core::{Camera, RgbImage};

use crate::html::{Html, escape};

/// Widest picture \[px\]: a column of the page on a dense screen.
pub const WIDEST: usize = 640;
/// Quality of the JPEGs; below 70 hair dissolves into blocks, above 85 they double in size.
const QUALITY: u8 = 78;

/// The share by which pictures of a camera are shrunk, at most 1, and the camera of the shrunk pictures.
pub fn shrunk_camera(camera: &Camera) -> Camera {
    let width = camera.width.clamp(1, WIDEST);
    let height = (camera.height * width).div_ceil(camera.width.max(1)).max(1);
    let (across, down) = (width as f64 / camera.width.max(1) as f64, height as f64 / camera.height.max(1) as f64);
    Camera {
        width,
        height,
        focal: [camera.focal[0] * across, camera.focal[1] * down],
        principal: [camera.principal[0] * across, camera.principal[1] * down],
        ..camera.clone()
    }
}

/// The image in the size of [`shrunk_camera`].
pub fn shrunk(image: &RgbImage, camera: &Camera) -> RgbImage {
    if (image.width, image.height) == (camera.width, camera.height) {
        return image.clone();
    }
    let (width, height) = (camera.width as u32, camera.height as u32);
    let resized = imageops::resize(&pixels(image), width, height, imageops::FilterType::Triangle);
    RgbImage { width: camera.width, height: camera.height, data: resized.pixels().map(|p| p.0).collect() }
}

fn pixels(image: &RgbImage) -> Pixels {
    Pixels::from_fn(image.width as u32, image.height as u32, |x, y| image::Rgb(image[(x as usize, y as usize)]))
}

/// A picture of the page.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    address: String,
    size: (usize, usize),
}

impl Picture {
    /// Encodes an image; `None` where it has no pixels.
    pub fn of(image: &RgbImage) -> Option<Self> {
        let bytes: Vec<u8> = image.data.iter().flatten().copied().collect();
        let mut jpeg = Vec::new();
        let (width, height) = (image.width as u32, image.height as u32);
        JpegEncoder::new_with_quality(&mut jpeg, QUALITY)
            .encode(&bytes, width, height, ExtendedColorType::Rgb8)
            .ok()?;
        let address = format!("data:image/jpeg;base64,{}", STANDARD.encode(jpeg));
        Some(Self { address, size: (image.width, image.height) })
    }

    /// As a figure; `alt` says in words what it shows.
    pub fn figure(&self, alt: &str, caption: &str) -> Html {
        Html::raw(format!(
            "<figure class=\"picture\"><img src=\"{}\" width=\"{}\" height=\"{}\" alt=\"{}\">\
             <figcaption>{}</figcaption></figure>",
            self.address,
            self.size.0,
            self.size.1,
            escape(alt),
            escape(caption)
        ))
    }
}

#[cfg(test)]
mod tests {
    use strandflow_core::{Distortion, RigidTransform};

    use super::*;

    #[test]
    fn a_large_image_is_shrunk_with_its_camera() {
        let camera = Camera {
            name: "c".into(),
            width: 1280,
            height: 720,
            focal: [1000.0; 2],
            principal: [640.0, 360.0],
            distortion: Distortion::None,
            camera_from_world: RigidTransform::IDENTITY,
        };
        let small = shrunk_camera(&camera);
        assert_eq!((small.width, small.height, small.focal, small.principal), (640, 360, [500.0; 2], [320.0, 180.0]));
        let image = shrunk(&RgbImage::filled(1280, 720, [9, 99, 199]), &small);
        assert!(image.width == 640 && image.data.iter().all(|p| *p == [9, 99, 199]));
        assert_eq!(shrunk_camera(&small), small);
    }

    #[test]
    fn a_picture_is_within_the_page() {
        let picture = Picture::of(&RgbImage::filled(8, 4, [1, 2, 3])).unwrap();
        let html = picture.figure("a \"view\"", "caption").into_text();
        assert!(html.contains("src=\"data:image/jpeg;base64,/9j/") && html.contains("a &quot;view&quot;"), "{html}");
        assert_eq!(Picture::of(&RgbImage::default()), None);
    }
}
