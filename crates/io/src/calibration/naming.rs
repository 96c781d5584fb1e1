//! Names of views: from paths of images, and matched between a calibration and footage.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

/// How views were matched to cameras.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MatchedBy {
    /// The names are equal.
    Name,
    /// The names are equal but for case, separators and leading zeros.
    LooseName,
    /// The name of every view contains one camera's (or the other way round), and no other.
    PartOfName,
    /// Only the order of both lists; they have the same length.
    Order,
}

/// The camera of each view.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Matched {
    /// Index of the camera by view.
    pub cameras: Vec<usize>,
    /// How it was found.
    pub by: MatchedBy,
}

/// Matches views to cameras by the strictest rule that gives every view a camera of its own; `None` where no rule does.
/// There may be more cameras than views, except for the last rule, the order.
pub fn match_views(views: &[&str], cameras: &[&str]) -> Option<Matched> {
    let matched = |by: MatchedBy, found: Vec<Option<usize>>| {
        let cameras: Vec<usize> = found.into_iter().collect::<Option<_>>()?;
        let distinct: BTreeSet<_> = cameras.iter().collect();
        (distinct.len() == cameras.len()).then_some(Matched { cameras, by })
    };
    let exact: BTreeMap<&str, usize> = cameras.iter().enumerate().map(|(i, name)| (*name, i)).collect();
    let by_name = || matched(MatchedBy::Name, views.iter().map(|view| exact.get(view).copied()).collect());
    let camera_words: Vec<Vec<String>> = cameras.iter().map(|name| words(name)).collect();
    let view_words: Vec<Vec<String>> = views.iter().map(|name| words(name)).collect();
    let only = |fits: &dyn Fn(&[String], &[String]) -> bool, view: &[String]| {
        let mut fitting = (0..cameras.len()).filter(|&i| fits(view, &camera_words[i]));
        fitting.next().filter(|_| fitting.next().is_none())
    };
    let by = |by, fits: &dyn Fn(&[String], &[String]) -> bool| {
        matched(by, view_words.iter().map(|view| only(fits, view)).collect())
    };
    by_name()
        .or_else(|| by(MatchedBy::LooseName, &|view, camera| view == camera))
        .or_else(|| by(MatchedBy::PartOfName, &|view, camera| contains(view, camera) || contains(camera, view)))
        .or_else(|| {
            let same = views.len() == cameras.len() && !views.is_empty();
            same.then(|| Matched { cameras: (0..views.len()).collect(), by: MatchedBy::Order })
        })
}

/// The runs of letters and of digits in a name, in lower case, digits without leading zeros.
fn words(name: &str) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    let mut last = None;
    for c in name.chars().flat_map(char::to_lowercase) {
        let kind = if c.is_ascii_digit() { Some(true) } else { c.is_alphanumeric().then_some(false) };
        match (kind, words.last_mut()) {
            (Some(_), Some(word)) if kind == last => word.push(c),
            (Some(_), _) => words.push(c.into()),
            (None, _) => {}
        }
        last = kind;
    }
    for word in &mut words {
        let bare = word.trim_start_matches('0');
        if word.starts_with('0') {
            *word = if bare.is_empty() { "0".into() } else { bare.to_owned() };
        }
    }
    words
}

fn contains(long: &[String], short: &[String]) -> bool {
    !short.is_empty() && long.windows(short.len()).any(|part| part == short)
}

/// A view's name from the path of each image: the image's folder (`cam00/000000.png`), or where all lie in one folder, the
/// image's name without ending.
pub(crate) fn names_of_images(paths: &[&str]) -> Vec<String> {
    let part = |name: Option<&std::ffi::OsStr>| name.map(|name| name.to_string_lossy().into_owned());
    let plain: Vec<String> = paths.iter().map(|path| path.replace('\\', "/")).collect();
    let folders: Vec<Option<String>> =
        plain.iter().map(|path| part(Path::new(path).parent().and_then(Path::file_name))).collect();
    let one_folder = paths.len() > 1 && folders.iter().all(|folder| *folder == folders[0]);
    let name = |(path, folder): (&String, &Option<String>)| match folder {
        Some(folder) if !one_folder => folder.clone(),
        _ => part(Path::new(path).file_stem()).unwrap_or_default(),
    };
    plain.iter().zip(&folders).map(name).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_find_their_cameras() {
        let by = |views: &[&str], cameras: &[&str]| match_views(views, cameras).map(|found| (found.by, found.cameras));
        assert_eq!(by(&["b", "a"], &["a", "c", "b"]), Some((MatchedBy::Name, vec![2, 0])));
        assert_eq!(by(&["cam02", "cam10"], &["Cam_10", "Cam_2"]), Some((MatchedBy::LooseName, vec![1, 0])));
        assert_eq!(by(&["take3_cam02", "take3_cam01"], &["cam1", "cam2"]), Some((MatchedBy::PartOfName, vec![1, 0])));
        assert_eq!(by(&["1", "2"], &["Camera 02", "Camera 01"]), Some((MatchedBy::PartOfName, vec![1, 0])));
        assert_eq!(by(&["left", "right"], &["A", "B"]), Some((MatchedBy::Order, vec![0, 1])));
        assert_eq!(by(&["left", "right"], &["A", "B", "C"]), None);
        assert_eq!(
            by(&["cam1", "cam1b"], &["cam1", "cam3"]),
            Some((MatchedBy::Order, vec![0, 1])),
            "one camera for two"
        );
    }

    #[test]
    fn images_name_their_views() {
        assert_eq!(names_of_images(&["cam00/000000.png", "cam01/000000.png"]), ["cam00", "cam01"]);
        assert_eq!(names_of_images(&["left.jpg", "right.jpg"]), ["left", "right"]);
        assert_eq!(names_of_images(&["./images/a.png", "images\\b.png"]), ["a", "b"]);
        assert_eq!(names_of_images(&["cam00/000000.png"]), ["cam00"]);
    }
}
