//! COLMAP's text files `cameras.txt` and `images.txt`.

use std::{collections::BTreeMap, path::Path, str::FromStr};

use super::{
    colmap::{ModelCamera, ModelImage},
    dispatch::{read_model, text_of},
};
use crate::{IoError, error::At};

/// The cameras by number: `CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]`.
pub(super) fn cameras(file: &Path) -> Result<BTreeMap<u32, ModelCamera>, IoError> {
    cameras_from_text(file, &text_of(file, read_model(file)?)?)
}

/// The images: `IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME`, each followed by a line of points (perhaps empty).
pub(super) fn images(file: &Path) -> Result<Vec<ModelImage>, IoError> {
    images_from_text(file, &text_of(file, read_model(file)?)?)
}

fn cameras_from_text(file: &Path, text: &str) -> Result<BTreeMap<u32, ModelCamera>, IoError> {
    let mut cameras = BTreeMap::new();
    for (number, line) in text.lines().enumerate().map(|(i, line)| (i + 1, line.trim())) {
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let mut words = line.split_whitespace();
        let id = parse(file, number, words.next(), "camera number")?;
        let model = words.next().unwrap_or_default().to_owned();
        let size = [parse(file, number, words.next(), "width")?, parse(file, number, words.next(), "height")?];
        let parameters = words.map(|word| parse(file, number, Some(word), "parameter")).collect::<Result<_, _>>()?;
        cameras.insert(id, ModelCamera { model, size, parameters });
    }
    Ok(cameras)
}

fn images_from_text(file: &Path, text: &str) -> Result<Vec<ModelImage>, IoError> {
    let mut images = Vec::new();
    let mut lines = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim())).peekable();
    while let Some((number, line)) = lines.next() {
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let mut words = line.splitn(10, char::is_whitespace);
        let id = parse(file, number, words.next(), "image number")?;
        let mut numbers = [0.0; 7];
        for value in &mut numbers {
            *value = parse(file, number, words.next(), "pose")?;
        }
        let [w, x, y, z, tx, ty, tz] = numbers;
        let camera = parse(file, number, words.next(), "camera number")?;
        let name = words.next().unwrap_or_default().trim().to_owned();
        if name.is_empty() {
            return Err(wrong(file, number, "the image has no name"));
        }
        images.push(ModelImage { id, quaternion: [w, x, y, z], translation: [tx, ty, tz], camera, name });
        // The line of points ends in a number; files without such lines go straight on to the next image.
        if lines.peek().is_some_and(|(_, next)| next.split_whitespace().next_back().is_none_or(is_number)) {
            lines.next();
        }
    }
    Ok(images)
}

fn is_number(word: &str) -> bool {
    word.parse::<f64>().is_ok()
}

pub(super) fn parse<T: FromStr>(file: &Path, line: usize, word: Option<&str>, what: &str) -> Result<T, IoError> {
    let word = word.ok_or_else(|| wrong(file, line, &format!("the {what} is missing")))?;
    word.parse().map_err(|_| wrong(file, line, &format!("`{word}` is no {what}")))
}

pub(super) fn wrong(file: &Path, line: usize, fact: &str) -> IoError {
    IoError::content(file, At::line(line), fact, "export the COLMAP model again as text")
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERAS: &str = include_str!("../../tests/data/colmap/cameras.txt");
    const IMAGES: &str = include_str!("../../tests/data/colmap/images.txt");

    #[test]
    fn images_without_lines_of_points_are_read_too() {
        let bare: Vec<&str> = IMAGES.lines().filter(|line| line.ends_with(".png")).collect();
        assert_eq!(images_from_text(Path::new("i"), &bare.join("\n")).unwrap().len(), 2);
        assert_eq!(images_from_text(Path::new("i"), IMAGES).unwrap().len(), 2);
    }

    #[test]
    fn a_broken_number_names_the_line() {
        let error = cameras_from_text(Path::new("cameras.txt"), &CAMERAS.replacen("640", "wide", 1)).unwrap_err();
        assert_eq!(error.to_string(), "cameras.txt:3: `wide` is no width");
    }
}
