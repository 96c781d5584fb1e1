//! Plain text with K, R and t, in the forms that are about:
//!
//! - labelled matrices, one camera a file or several told apart by a line `camera NAME`: `K`/`intrinsic`, `dist`, `R` and `t`,
//!   or `extrinsic` (world to camera), or `camera_to_world`, or `P`/`CONTOUR` (projection), `size` or `width` and `height`;
//!   with `extrinsic`, `intrinsic` and a range of depths also MVSNet's `*_cam.txt`;
//! - without labels twelve or sixteen numbers (projection), or K, R, t and perhaps distortion (KRTD);
//! - Middlebury's `*_par.txt`: the number of cameras, then a line `NAME K R t` each.
//!
//! Where a file does not say which way its poses lead, the rig tells or the user is asked.

use std::path::Path;

use super::{
    convention::{Axes, Pose, Unit},
    parts::{CameraParts, Lens, pose_of, rows_of},
    projection::taken_apart,
    settle::Described,
};
use crate::{IoError, error::At};

/// What a text says.
pub(super) fn described(path: &Path, text: &str) -> Result<Described, IoError> {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let mut sections = Vec::new();
    if let Some(cameras) = middlebury(path, text)? {
        let open = Described {
            pose: None,
            axes: None,
            first_pixel: None,
            ..Described::opencv(DIALECT, cameras, Unit::Unsaid, 0.0)
        };
        return Ok(open);
    }
    for (number, line) in text.lines().enumerate() {
        read_line(line, number + 1, &stem, &mut sections).map_err(|fact| wrong(path, At::line(number + 1), fact))?;
    }
    let mut file = Described {
        pose: None,
        axes: None,
        first_pixel: None,
        ..Described::opencv(DIALECT, vec![], Unit::Unsaid, 0.0)
    };
    for section in sections {
        let at = At::view(&section.name);
        let (parts, pose) = section.camera().map_err(|fact| wrong(path, at, fact))?;
        if file.cameras.is_empty() {
            (file.pose, file.axes) = pose;
        } else if (file.pose, file.axes) != pose {
            return Err(wrong(
                path,
                At::view(&parts.name),
                "is given in another form than the cameras before it".into(),
            ));
        }
        file.cameras.push(parts);
    }
    Ok(file)
}

const DIALECT: &str = "K/R/t text";

fn wrong(path: &Path, at: At, fact: String) -> IoError {
    let hint =
        "give K (9 numbers), R (9) and t (3), or extrinsic (12 or 16), each behind its name, or a projection of 12";
    IoError::content(path, at, fact, hint)
}

/// The numbers of one camera by kind.
struct Section {
    name: String,
    parts: Vec<(Kind, Vec<f64>)>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Unnamed,
    K,
    R,
    T,
    WorldToCamera,
    CameraToWorld,
    Projection,
    Distortion,
    Size,
    Width,
    Height,
}

fn kind(label: &str) -> Option<Kind> {
    Some(match label.to_ascii_lowercase().as_str() {
        "k" | "intrinsic" | "intrinsics" | "camera_matrix" => Kind::K,
        "r" | "rotation" => Kind::R,
        "t" | "tvec" | "translation" => Kind::T,
        "extrinsic" | "extrinsics" | "rt" | "world_to_camera" | "w2c" => Kind::WorldToCamera,
        "camera_to_world" | "c2w" | "pose" => Kind::CameraToWorld,
        "p" | "projection" | "contour" => Kind::Projection,
        "d" | "dist" | "distortion" => Kind::Distortion,
        "size" | "image_size" | "resolution" => Kind::Size,
        "width" => Kind::Width,
        "height" => Kind::Height,
        _ => return None,
    })
}

fn read_line(line: &str, number: usize, stem: &str, sections: &mut Vec<Section>) -> Result<(), String> {
    let content = line.split('#').next().unwrap_or_default();
    let mut words =
        content.split([' ', '\t', ',', ';', '[', ']', '=', ':', '(', ')']).filter(|word| !word.is_empty()).peekable();
    let first = words.peek().copied().unwrap_or_default();
    if ["camera", "cam", "name", "view"].contains(&first.to_ascii_lowercase().as_str()) {
        let name = words.nth(1).ok_or("a camera has no name")?;
        sections.push(Section { name: name.to_owned(), parts: Vec::new() });
    }
    for word in words {
        if sections.is_empty() {
            sections.push(Section { name: stem.trim_end_matches("_cam").to_owned(), parts: Vec::new() });
        }
        let Some(section) = sections.last_mut() else { return Err(format!("line {number} belongs to no camera")) };
        if let Ok(value) = word.parse::<f64>() {
            if section.parts.is_empty() {
                section.parts.push((Kind::Unnamed, Vec::new()));
            }
            if let Some((_, numbers)) = section.parts.last_mut() {
                numbers.push(value);
            }
        } else {
            let kind = kind(word).ok_or_else(|| format!("`{word}` is neither a number nor the name of a matrix"))?;
            section.parts.push((kind, Vec::new()));
        }
    }
    Ok(())
}

type Direction = (Option<Pose>, Option<Axes>);

impl Section {
    fn numbers(&self, kind: Kind) -> Option<&[f64]> {
        self.parts.iter().find(|(of, _)| *of == kind).map(|(_, numbers)| numbers.as_slice())
    }

    fn camera(self) -> Result<(CameraParts, Direction), String> {
        let unnamed = self.numbers(Kind::Unnamed).unwrap_or_default();
        let size = self.size();
        let projection =
            self.numbers(Kind::Projection).or((unnamed.len() == 12 || unnamed.len() == 16).then_some(unnamed));
        if let Some(p) = projection {
            let p = p.get(..12).ok_or("a projection has 12 numbers")?;
            let parts = taken_apart(self.name.clone(), p).ok_or("the projection is singular or not finite")?;
            return Ok((CameraParts { size, ..parts }, (Some(Pose::WorldToCamera), Some(Axes::OpenCv))));
        }
        if unnamed.len() >= 21 {
            let (k, rest) = unnamed.split_at(9);
            let (r, rest) = rest.split_at(9);
            let (t, distortion) = rest.split_at(3);
            return Ok((parts_of(self.name.clone(), size, k, r, t, distortion)?, (None, None)));
        }
        let k = self.numbers(Kind::K).ok_or("has no K")?;
        // MVSNet's range of depths follows the intrinsics without a name.
        let k = if (11..=13).contains(&k.len()) { &k[..9] } else { k };
        let distortion = self.numbers(Kind::Distortion).unwrap_or_default();
        for (kind, pose) in [(Kind::WorldToCamera, Pose::WorldToCamera), (Kind::CameraToWorld, Pose::CameraToWorld)] {
            let Some(numbers) = self.numbers(kind) else { continue };
            let (r, t) = pose_of(numbers).ok_or_else(|| format!("an extrinsic matrix of {} numbers", numbers.len()))?;
            let parts = parts_of(self.name.clone(), size, k, r.as_flattened(), &t, distortion)?;
            return Ok((parts, (Some(pose), None)));
        }
        let (r, t) = self.numbers(Kind::R).zip(self.numbers(Kind::T)).ok_or("has no R and t, and no extrinsic")?;
        Ok((parts_of(self.name.clone(), size, k, r, t, distortion)?, (None, None)))
    }

    fn size(&self) -> Option<[usize; 2]> {
        let both = self.numbers(Kind::Size).and_then(|v| <[f64; 2]>::try_from(v).ok());
        let one = |kind| self.numbers(kind).and_then(|v| v.first().copied());
        let sides = both.or_else(|| Some([one(Kind::Width)?, one(Kind::Height)?]))?;
        Some(sides.map(|side| side as usize))
    }
}

fn parts_of(
    name: String,
    size: Option<[usize; 2]>,
    k: &[f64],
    r: &[f64],
    t: &[f64],
    distortion: &[f64],
) -> Result<CameraParts, String> {
    Ok(CameraParts {
        name,
        size,
        k: rows_of(k).ok_or_else(|| format!("K has {} numbers, not 9", k.len()))?,
        lens: Lens::OpenCv(distortion.to_vec()),
        rotation: rows_of(r).ok_or_else(|| format!("R has {} numbers, not 9", r.len()))?,
        translation: t.try_into().map_err(|_| format!("t has {} numbers, not 3", t.len()))?,
    })
}

/// Middlebury's form; `None` where the text has another.
fn middlebury(path: &Path, text: &str) -> Result<Option<Vec<CameraParts>>, IoError> {
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let Some(count) = lines.next().and_then(|(_, line)| line.trim().parse::<usize>().ok()) else { return Ok(None) };
    let mut cameras = Vec::new();
    for (number, line) in lines {
        let mut words = line.split_whitespace();
        let name = words.next().unwrap_or_default();
        let numbers: Option<Vec<f64>> = words.map(|word| word.parse().ok()).collect();
        let Some(numbers) = numbers.filter(|numbers| numbers.len() == 21 && name.parse::<f64>().is_err()) else {
            return if cameras.is_empty() {
                Ok(None)
            } else {
                Err(wrong(path, At::line(number + 1), "is not a name with K, R and t (21 numbers)".into()))
            };
        };
        let name = Path::new(name).file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let parts = parts_of(name, None, &numbers[..9], &numbers[9..18], &numbers[18..], &[]);
        cameras.push(parts.map_err(|fact| wrong(path, At::line(number + 1), fact))?);
    }
    match cameras.len() {
        found if found == count && found > 0 => Ok(Some(cameras)),
        0 => Ok(None),
        found => Err(wrong(path, At::FILE, format!("says that it has {count} cameras, and has {found}"))),
    }
}
