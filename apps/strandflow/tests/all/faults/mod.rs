//! Faults planted in a take by altering its files and its manifest.
#![expect(clippy::unwrap_used, reason = "helpers of tests: a failing unwrap is a failing test")]

use std::path::{Path, PathBuf};

use glam::DVec2;
use strandflow_core::{Camera, Distortion, Mask, Plane, RgbImage, Rig};
use strandflow_geometry::project::{distort, undistort};
use strandflow_io::{Calibration, read_calibration, read_mask, read_rgb, write_mask_png, write_rgb_png};

use crate::common::{stderr, strandflow, text, write};

/// Frames of the take; the capture has two more, so that a clip can begin late or lose one.
pub const FRAMES: usize = 18;

/// Small, and swinging early: six views of 320 × 240 pixels.
const SPEC: &str = "
seed = 5
[rig]
frames = 20
views = 6
width = 320
height = 240
subsamples = 2
[groom]
strands = 1500
guides = 60
width_mm = 0.7
[motion]
quiet_frames = 4
turn_deg = 30.0
[physics]
settle_secs = 0.1
";

/// Marker balls are 3 px in radius in these images.
const SETTINGS: &str = "\n[settings.pose]\nmarker_radius_px = 3.0\n";

/// The sound capture and its take, made once.
pub struct Sound {
    pub root: PathBuf,
    pub capture: PathBuf,
    manifest: String,
}

impl Sound {
    pub fn make(root: &Path) -> Self {
        let (capture, spec, take) = (root.join("capture"), root.join("spec.toml"), root.join("sound"));
        write(&spec, SPEC);
        for args in [
            vec!["synth", text(&capture), "--spec", text(&spec)],
            vec!["new", text(&take), "--capture", text(&capture)],
        ] {
            let made = strandflow(&args);
            assert!(made.status.success(), "{}", stderr(&made));
        }
        let written = std::fs::read_to_string(take.join("strandflow.toml")).unwrap();
        let frames = format!("frames = \"0..{FRAMES}\"\n");
        let manifest = written.replace("# frames = \"0..30\"\n", &frames) + SETTINGS;
        assert!(manifest.contains(&frames));
        std::fs::write(take.join("strandflow.toml"), &manifest).unwrap();
        Self { root: root.to_owned(), capture, manifest }
    }

    /// A take in which faults can be planted.
    pub fn copy(&self, name: &str) -> Copy<'_> {
        let take = self.root.join(name);
        std::fs::create_dir_all(&take).unwrap();
        let copy = Copy { sound: self, take, manifest: self.manifest.clone() };
        copy.save();
        copy
    }
}

/// A take of the sound capture, in which single files are others.
pub struct Copy<'a> {
    pub sound: &'a Sound,
    pub take: PathBuf,
    manifest: String,
}

impl Copy<'_> {
    fn save(&self) {
        std::fs::write(self.take.join("strandflow.toml"), &self.manifest).unwrap();
    }

    /// Changes the manifest.
    pub fn replace(&mut self, from: &str, to: &str) {
        assert!(self.manifest.contains(from), "`{from}` is not in the manifest");
        self.manifest = self.manifest.replace(from, to);
        self.save();
    }

    /// Leaves all but the first views out of the manifest.
    pub fn keep_views(&mut self, count: usize) {
        let mut parts: Vec<&str> = self.manifest.split("[[views]]").collect();
        let settings = parts[parts.len() - 1].split_once("\n\n").unwrap().1;
        parts.truncate(count + 1);
        self.manifest = format!("{}\n\n{settings}", parts.join("[[views]]"));
        self.save();
    }

    fn file(&self, below: &str) -> PathBuf {
        self.sound.capture.join(below)
    }

    /// Has the manifest name another file or folder than the capture's.
    fn redirect(&mut self, below: &str) -> PathBuf {
        let to = self.take.join(below);
        std::fs::create_dir_all(to.parent().unwrap()).unwrap();
        let (from, there) = (format!("\"{}\"", self.file(below).display()), format!("\"{}\"", to.display()));
        self.replace(&from, &there);
        to
    }

    /// Alters the cameras.
    pub fn rig(&mut self, alter: impl FnOnce(&mut Rig)) {
        let mut calibration: Calibration = read_calibration(&self.file("calibration.toml"), None).unwrap();
        alter(&mut calibration.rig);
        let to = self.redirect("calibration.toml");
        strandflow_io::calibration::own_toml::write_toml(&to, &calibration).unwrap();
    }

    /// Alters one camera.
    pub fn camera(&mut self, view: usize, alter: impl FnOnce(&mut Camera)) {
        self.rig(|rig| alter(&mut rig.cameras[view]));
    }

    /// Makes the clip of a view anew: each of its frames shows a frame of the capture, altered.
    pub fn clip(&mut self, view: usize, shows: impl Fn(usize) -> usize, alter: impl Fn(RgbImage) -> RgbImage) {
        let below = format!("images/cam{view:02}");
        let (from, to) = (self.file(&below), self.redirect(&below));
        std::fs::create_dir_all(&to).unwrap();
        for frame in 0..FRAMES {
            let image = read_rgb(&from.join(format!("{:06}.png", shows(frame)))).unwrap();
            write_rgb_png(&to.join(format!("{frame:06}.png")), &alter(image)).unwrap();
        }
    }

    /// Makes the plate of a view anew.
    pub fn plate(&mut self, view: usize, alter: impl Fn(&mut RgbImage, &RgbImage)) {
        let below = format!("clean/cam{view:02}.png");
        let first = read_rgb(&self.file(&format!("images/cam{view:02}/000000.png"))).unwrap();
        let mut plate = read_rgb(&self.file(&below)).unwrap();
        alter(&mut plate, &first);
        let to = self.redirect(&below);
        write_rgb_png(&to, &plate).unwrap();
    }

    /// Alters the marker labels, as JSON: id and points by view.
    pub fn labels(&mut self, alter: impl FnOnce(&mut Vec<serde_json::Value>)) {
        let below = "user/marker_labels.json";
        let mut labels: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(self.file(below)).unwrap()).unwrap();
        alter(labels["markers"].as_array_mut().unwrap());
        let to = self.redirect(below);
        std::fs::write(to, labels.to_string()).unwrap();
    }

    /// Alters the hair masks of all views.
    pub fn hair(&mut self, alter: impl Fn(usize, Mask) -> Mask) {
        let to = self.redirect("user/hair_masks");
        for view in 0..6 {
            let below = format!("cam{view:02}/000000.png");
            let mask = read_mask(&self.file("user/hair_masks").join(&below)).unwrap();
            std::fs::create_dir_all(to.join(format!("cam{view:02}"))).unwrap();
            write_mask_png(&to.join(below), &alter(view, mask)).unwrap();
        }
    }

    /// Gives subject masks of a view in all frames: the true ones, altered.
    pub fn subject(&mut self, view: usize, alter: impl Fn(Mask) -> Mask) {
        let to = self.take.join("subject_masks");
        let line = "# subject_masks = \"corrections/subject_masks\"";
        self.replace(line, &format!("subject_masks = \"{}\"", to.display()));
        std::fs::create_dir_all(to.join(format!("cam{view:02}"))).unwrap();
        for frame in 0..FRAMES {
            let below = format!("cam{view:02}/{frame:06}.png");
            let mask = read_mask(&self.file("gt/mask_subject").join(&below)).unwrap();
            write_mask_png(&to.join(below), &alter(mask)).unwrap();
        }
    }

    /// The whole capture as a lens shows it that the calibration does not know: k1 in all views.
    pub fn distorted(&mut self, k1: f64, frames: usize) {
        let rig = read_calibration(&self.file("calibration.toml"), None).unwrap().rig;
        let lens = Distortion::BrownConrady([k1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        self.replace(&format!("frames = \"0..{FRAMES}\""), &format!("frames = \"0..{frames}\""));
        for view in 0..6 {
            let camera = rig.cameras[view].clone();
            let bend = move |image: &RgbImage| warped(image, &camera, &lens);
            let other = bend.clone();
            self.plate(view, |plate, _| *plate = other(plate));
            self.clip(view, |frame| frame, |image| bend(&image));
        }
        let cameras = rig.cameras.clone();
        self.hair(|view, mask| warped(&mask.map(|&m| [m; 3]), &cameras[view], &lens).map(|c| c[0]));
        self.labels(|markers| {
            for marker in markers {
                for (view, camera) in rig.cameras.iter().enumerate() {
                    let Some(at) = marker["views"].get_mut(&camera.name) else { continue };
                    let point = DVec2::new(at[0].as_f64().unwrap(), at[1].as_f64().unwrap());
                    let bent = through(camera, point, |n| distort(&lens, n));
                    assert!(view < 6);
                    *at = serde_json::json!([bent.x, bent.y]);
                }
            }
        });
    }
}

/// An image point through a map of normalised coordinates.
fn through(camera: &Camera, at: DVec2, map: impl Fn(DVec2) -> DVec2) -> DVec2 {
    let (focal, principal) = (DVec2::from_array(camera.focal), DVec2::from_array(camera.principal));
    map((at - principal) / focal) * focal + principal
}

/// An image of a pinhole as a lens shows it.
fn warped(image: &RgbImage, camera: &Camera, lens: &Distortion) -> RgbImage {
    Plane::from_fn(image.width, image.height, |x, y| {
        let at = through(camera, DVec2::new(x as f64 + 0.5, y as f64 + 0.5), |n| undistort(lens, n)) - 0.5;
        let (w, h) = (image.width as f64 - 1.001, image.height as f64 - 1.001);
        let at = at.clamp(DVec2::ZERO, DVec2::new(w, h));
        let (x0, y0) = (at.x as usize, at.y as usize);
        let (a, b) = (at.x.fract(), at.y.fract());
        [0, 1, 2].map(|c| {
            let v = |dx: usize, dy: usize| f64::from(image[(x0 + dx, y0 + dy)][c]);
            let top = v(0, 0) * (1.0 - a) + v(1, 0) * a;
            let bottom = v(0, 1) * (1.0 - a) + v(1, 1) * a;
            (top * (1.0 - b) + bottom * b).round() as u8
        })
    })
}

/// An image out of focus by a box of this many pixels, passed over three times.
pub fn blurred(image: RgbImage, radius: usize) -> RgbImage {
    let mut out = image;
    for _ in 0..3 {
        for across in [true, false] {
            let (w, h) = (out.width, out.height);
            out = Plane::from_fn(w, h, |x, y| {
                let (at, side) = if across { (x, w) } else { (y, h) };
                let range = at.saturating_sub(radius)..(at + radius + 1).min(side);
                let n = range.len() as f64;
                let of = |k: usize| if across { out[(k, y)] } else { out[(x, k)] };
                let sum = range.fold([0.0; 3], |sum, k| [0, 1, 2].map(|c| sum[c] + f64::from(of(k)[c])));
                sum.map(|s| (s / n).round() as u8)
            });
        }
    }
    out
}

/// An image of fewer pixels: means of squares.
pub fn smaller(image: &RgbImage, by: usize) -> RgbImage {
    Plane::from_fn(image.width / by, image.height / by, |x, y| {
        [0, 1, 2].map(|c| {
            let square = (0..by * by).map(|k| usize::from(image[(x * by + k % by, y * by + k / by)][c]));
            (square.sum::<usize>() / (by * by)) as u8
        })
    })
}
