//! A tiny capture made in the test: three views of a ball with a cap of hair, as folders of images.
#![expect(clippy::unwrap_used, reason = "helpers of tests: a failing unwrap is a failing test")]

pub mod before_fit;
pub mod browser;
pub mod records;
#[cfg(target_os = "linux")]
pub mod slurm;
pub mod synthetic;
pub mod viewer;

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    process::{Command, Output},
};

use glam::{DMat3, DVec2, DVec3};
use strandflow_core::{Camera, Distortion, Mask, RgbImage, RigidTransform};
use strandflow_geometry::project::{project, ray};

pub const VIEWS: usize = 3;
pub const FRAMES: usize = 4;
const SIZE: [usize; 2] = [64, 48];
const RADIUS_MM: f64 = 90.0;

/// Cameras a metre away around the back.
pub fn cameras() -> Vec<Camera> {
    (0..VIEWS)
        .map(|i| {
            let angle = (i as f64 - 1.0) * 0.9;
            let eye = DVec3::new(1000.0 * angle.cos(), 1000.0 * angle.sin(), 150.0);
            let forward = -eye.normalize();
            let right = forward.cross(DVec3::Z).normalize();
            let rotation = DMat3::from_cols(right, forward.cross(right), forward).transpose();
            Camera {
                name: format!("cam{i}"),
                width: SIZE[0],
                height: SIZE[1],
                focal: [180.0; 2],
                principal: [32.0, 24.0],
                distortion: Distortion::None,
                camera_from_world: RigidTransform { rotation, translation: -(rotation * eye) },
            }
        })
        .collect()
}

/// Makes the capture: images, plates, calibration, labels, hair masks.
pub fn capture(folder: &Path) {
    for camera in cameras() {
        for frame in 0..FRAMES {
            write_rgb(&folder.join(format!("images/{}/{frame:06}.png", camera.name)), &picture(&camera, Some(frame)));
        }
        write_rgb(&folder.join(format!("clean/{}.png", camera.name)), &picture(&camera, None));
        write_mask(&folder.join(format!("user/hair_masks/{}/000000.png", camera.name)), &hair(&camera));
    }
    write(&folder.join("calibration.json"), &calibration());
    write(&folder.join("user/marker_labels.json"), &labels(7));
}

/// A run of the command.
pub fn strandflow(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_strandflow")).args(args).output().unwrap()
}

/// A run of the command that may make no file of more than `blocks` × 512 bytes: as on a disk that is full, writing fails.
#[cfg(unix)]
pub fn on_full_disk(blocks: usize, args: &[&str]) -> Output {
    let script = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" \"$@\"");
    Command::new("sh").args(["-c", &script, env!("CARGO_BIN_EXE_strandflow")]).args(args).output().unwrap()
}

/// Asserts a failure that names `place` and has a hint about the disk.
pub fn assert_not_written(output: &Output, place: &Path) {
    let said = stderr(output);
    assert!(!output.status.success(), "{said}");
    let (error, hint) = said.split_once("error: ").and_then(|(_, said)| said.split_once("hint: ")).unwrap();
    let hidden = format!(".{}.tmp", place.file_name().unwrap().to_string_lossy());
    assert!(error.contains(text(place)) && !error.contains(&hidden), "{said}");
    assert!(["disk", "write elsewhere", "write to"].iter().any(|words| hint.contains(words)), "{said}");
}

/// A take of a fresh capture. Returns (capture, take).
pub fn take(root: &Path) -> (PathBuf, PathBuf) {
    let (from, take) = (root.join("capture"), root.join("take"));
    capture(&from);
    let made = strandflow(&["new", text(&take), "--capture", text(&from)]);
    assert!(made.status.success(), "{}", stderr(&made));
    (from, take)
}

/// A path as text.
pub fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// What a command said.
pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Asserts exit code 2, an `error:` that names all of `parts`, and a `hint:`.
pub fn assert_bad_input(output: &Output, parts: &[&str]) {
    let said = stderr(output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    let error = said.split_once("error: ").unwrap_or_else(|| panic!("no error: in {said}")).1;
    let (error, hint) = error.split_once("hint: ").unwrap_or_else(|| panic!("no hint: in {said}"));
    assert!(!hint.trim().is_empty());
    for part in parts {
        assert!(error.contains(part), "`{part}` is not in: {error}");
    }
}

/// Asserts that two takes have the same results.
pub fn assert_same(wanted: &Path, found: &Path) {
    let (wanted, found) = (bytes_below(&wanted.join("results.zarr")), bytes_below(&found.join("results.zarr")));
    let differing: Vec<_> = wanted.keys().chain(found.keys()).filter(|k| wanted.get(*k) != found.get(*k)).collect();
    assert!(differing.is_empty(), "{differing:?}");
}

/// All files below a folder with their bytes.
pub fn bytes_below(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    fn walk(at: &Path, root: &Path, found: &mut BTreeMap<PathBuf, Vec<u8>>) {
        for entry in std::fs::read_dir(at).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                walk(&path, root, found);
            } else {
                found.insert(path.strip_prefix(root).unwrap().to_owned(), std::fs::read(&path).unwrap());
            }
        }
    }
    let mut found = BTreeMap::new();
    walk(folder, folder, &mut found);
    found
}

pub fn write(path: &Path, text: &str) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, text).unwrap();
}

pub fn write_rgb(path: &Path, image: &RgbImage) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    strandflow_io::write_rgb_png(path, image).unwrap();
}

pub fn write_mask(path: &Path, mask: &Mask) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    strandflow_io::write_mask_png(path, mask).unwrap();
}

/// Labels of the first `count` markers.
pub fn labels(count: usize) -> String {
    let cameras = cameras();
    let marker = |i: usize| {
        let (sine, cosine) = (i as f64 * 0.9).sin_cos();
        let direction = DVec3::new(1.0, 0.35 * cosine, 0.35 * sine).normalize();
        let seen = |camera: &Camera| {
            let p = project(camera, direction * RADIUS_MM).unwrap();
            format!("\"{}\": [{}, {}]", camera.name, p.x, p.y)
        };
        format!("{{\"id\": {i}, \"views\": {{{}}}}}", cameras.iter().map(seen).collect::<Vec<_>>().join(", "))
    };
    format!("{{\"frame\": 0, \"markers\": [{}]}}", (0..count).map(marker).collect::<Vec<_>>().join(", "))
}

/// The calibration as the captures have it: metres, K/R/t.
pub fn calibration() -> String {
    let camera = |c: &Camera| {
        let rows = c.camera_from_world.to_rows();
        let r: Vec<String> = rows[..3].iter().map(|row| format!("{:?}", &row[..3])).collect();
        let t: Vec<f64> = rows[..3].iter().map(|row| row[3] / 1000.0).collect();
        format!(
            "{{\"name\": \"{}\", \"width\": {}, \"height\": {}, \"K\": [[{f}, 0, {}], [0, {f}, {}], [0, 0, 1]], \
             \"distortion\": [0, 0, 0, 0, 0], \"R\": [{}], \"t\": {t:?}}}",
            c.name,
            c.width,
            c.height,
            c.principal[0],
            c.principal[1],
            r.join(", "),
            f = c.focal[0],
        )
    };
    let cameras: Vec<String> = cameras().iter().map(camera).collect();
    format!(
        "{{\"units\": \"metres\", \"convention\": \"OpenCV: x_cam = R x_world + t, x right, y down, z forward\", \
         \"pixel_convention\": \"first pixel centre at (0.5, 0.5)\", \"gravity_world\": [0, 0, -9.81], \"fps\": 100, \
         \"cameras\": [{}]}}",
        cameras.join(",\n")
    )
}

/// Where the ray of a pixel meets the ball.
fn hit(camera: &Camera, x: usize, y: usize) -> Option<DVec3> {
    let ray = ray(camera, DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
    let b = ray.origin.dot(ray.direction);
    let root = b * b - ray.origin.length_squared() + RADIUS_MM * RADIUS_MM;
    (root > 0.0).then(|| ray.origin + ray.direction * (-b - root.sqrt()))
}

fn picture(camera: &Camera, frame: Option<usize>) -> RgbImage {
    RgbImage::from_fn(SIZE[0], SIZE[1], |x, y| {
        let noise = ((x * 7919 + y * 104_729 + frame.unwrap_or(99) * 1_299_709) % 5) as u8;
        match frame.and_then(|_| hit(camera, x, y)) {
            Some(p) if p.z > -20.0 => {
                let streak = (40.0 * p.y.atan2(p.z)).sin();
                [(80.0 + 30.0 * streak) as u8, (50.0 + 20.0 * streak) as u8, 30 + noise]
            }
            Some(_) => [200 + noise, 160, 140],
            None => [90 + noise, 120 + noise, 150 + noise],
        }
    })
}

fn hair(camera: &Camera) -> Mask {
    Mask::from_fn(SIZE[0], SIZE[1], |x, y| if hit(camera, x, y).is_some_and(|p| p.z > -20.0) { 255 } else { 0 })
}
