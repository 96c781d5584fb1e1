//! COLMAP's binary files `cameras.bin` and `images.bin`; little endian.

use std::{collections::BTreeMap, path::Path};

use super::{
    colmap::{MODELS, ModelCamera, ModelImage},
    dispatch::read_model,
};
use crate::{IoError, bytes::Bytes, error::At};

/// The cameras by number.
pub(super) fn cameras(file: &Path) -> Result<BTreeMap<u32, ModelCamera>, IoError> {
    let data = read_model(file)?;
    cameras_from_bytes(file, &data)
}

/// The images in the order of the file.
pub(super) fn images(file: &Path) -> Result<Vec<ModelImage>, IoError> {
    let data = read_model(file)?;
    images_from_bytes(file, &data).ok_or_else(|| cut(file))
}

fn cut(file: &Path) -> IoError {
    IoError::content(file, At::FILE, "ends too early or is no COLMAP model", "export or copy the COLMAP model again")
}

fn cameras_from_bytes(file: &Path, data: &[u8]) -> Result<BTreeMap<u32, ModelCamera>, IoError> {
    let mut bytes = Bytes::new(data);
    let mut cameras = BTreeMap::new();
    for _ in 0..bytes.u64().ok_or_else(|| cut(file))? {
        let (id, model) = bytes.u32().zip(bytes.i32()).ok_or_else(|| cut(file))?;
        let Some((_, name, count)) = MODELS.iter().find(|(number, _, _)| *number == model) else {
            let hint = "calibrate with PINHOLE, RADIAL, OPENCV or OPENCV_FISHEYE";
            return Err(IoError::content(file, At::FILE, format!("camera {id} has the unknown model {model}"), hint));
        };
        let camera = (|| {
            let size = [bytes.u64()?, bytes.u64()?].map(|side| usize::try_from(side).unwrap_or(usize::MAX));
            let parameters = (0..*count).map(|_| bytes.f64()).collect::<Option<_>>()?;
            Some(ModelCamera { model: (*name).to_owned(), size, parameters })
        })();
        cameras.insert(id, camera.ok_or_else(|| cut(file))?);
    }
    Ok(cameras)
}

fn images_from_bytes(_: &Path, data: &[u8]) -> Option<Vec<ModelImage>> {
    let mut bytes = Bytes::new(data);
    let mut images = Vec::new();
    for _ in 0..bytes.u64()? {
        let id = bytes.u32()?;
        let quaternion = [bytes.f64()?, bytes.f64()?, bytes.f64()?, bytes.f64()?];
        let translation = [bytes.f64()?, bytes.f64()?, bytes.f64()?];
        let camera = bytes.u32()?;
        let name = String::from_utf8_lossy(bytes.until_zero()?).into_owned();
        let points = usize::try_from(bytes.u64()?).ok()?;
        bytes.skip(points.checked_mul(24)?)?;
        images.push(ModelImage { id, quaternion, translation, camera, name });
    }
    Some(images)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERAS: &[u8] = include_bytes!("../../tests/data/colmap_binary/cameras.bin");
    const IMAGES: &[u8] = include_bytes!("../../tests/data/colmap_binary/images.bin");

    #[test]
    fn truncated_files_are_errors() {
        for cut in 0..CAMERAS.len() {
            assert!(cameras_from_bytes(Path::new("c"), &CAMERAS[..cut]).is_err());
        }
        for cut in 0..IMAGES.len() {
            assert!(images_from_bytes(Path::new("c"), &IMAGES[..cut]).is_none());
        }
    }
}
