//! A synthetic scene written as a capture folder with truth, laid out as `docs/capture.md` says.

use std::{
    fs,
    io::Write,
    path::{Path, PathBuf},
};

use npyz::{WriterBuilder, npz::NpzWriter};
use strandflow_core::{RigidTransform, TriMesh};
use strandflow_io::{calibration::Calibration, write_mask_png, write_rgb_png};
use strandflow_synth::{MARKER_RADIUS_MM, Picture, Scene};

use crate::failure::Failed;

/// Acceleration between frames above which a strand does not count as stable \[mm\].
const JUMP_MM: f64 = 25.0;

/// Writes the capture, one frame at a time; `done` is called after each frame.
pub fn write_capture(scene: &Scene, folder: &Path, mut done: impl FnMut(usize)) -> Result<(), Failed> {
    let spec = &scene.spec;
    let names: Vec<&str> = scene.rig.cameras.iter().map(|camera| camera.name.as_str()).collect();
    for name in &names {
        for part in ["images", "gt/mask_hair", "gt/mask_subject", "user/hair_masks"] {
            make_folder(&folder.join(part).join(name))?;
        }
    }
    make_folder(&folder.join("clean"))?;
    for (view, name) in names.iter().enumerate() {
        write_rgb_png(&folder.join(format!("clean/{name}.png")), &scene.plate(view))?;
    }
    let calibration = Calibration {
        rig: scene.given_rig.clone(),
        gravity: Some(glam::DVec3::new(0.0, 0.0, -9806.65)),
        fps: Some(spec.rig.fps),
        ..Calibration::default()
    };
    strandflow_io::calibration::own_toml::write_toml(&folder.join("calibration.toml"), &calibration)?;
    write_text(
        &folder.join("synth.toml"),
        &toml::to_string(spec)
            .map_err(|error| Failed::input(error.to_string(), "this spec cannot be written as TOML"))?,
    )?;
    write_mesh(&folder.join("gt/head.obj"), &scene.head, "head in the head frame, metres; world = head_to_world * p")?;
    if let Some(body) = &scene.body {
        write_mesh(&folder.join("gt/body.obj"), body, "body in the world, metres; it stands still")?;
    }

    let mut poses = Vec::with_capacity(spec.rig.frames);
    let mut markers = MarkerTruth::default();
    for frame in 0..spec.rig.frames {
        let pictures = scene.render(frame);
        for (picture, name) in pictures.iter().zip(&names) {
            let file = format!("{name}/{frame:06}.png");
            write_rgb_png(&folder.join("images").join(&file), &picture.image)?;
            write_mask_png(&folder.join("gt/mask_hair").join(&file), &picture.hair)?;
            write_mask_png(&folder.join("gt/mask_subject").join(&file), &picture.subject)?;
        }
        if frame == 0 {
            write_user_part(scene, folder, &names, &pictures)?;
        }
        let truth = scene.frame(frame);
        write_strands(&folder.join(format!("gt/strands_{frame:06}.npz")), &truth.strands)?;
        poses.push(truth.world_from_head);
        markers.push(&pictures);
        done(frame);
    }
    write_poses(&folder.join("gt/head_pose.npz"), &poses)?;
    markers.write(&folder.join("gt/markers.npz"), &scene.frame(0).markers, &scene.markers)?;
    let mut npz = Npz::create(folder.join("gt/stable.npz"))?;
    npz.array("stable", &[scene.groom.strands.len()], scene.stable(JUMP_MM))
}

/// What a user would make: marker labels and hair masks of frame 0.
fn write_user_part(scene: &Scene, folder: &Path, names: &[&str], first: &[Picture]) -> Result<(), Failed> {
    for (view, name) in names.iter().enumerate() {
        let mask = scene.given_hair_mask(view, &first[view]);
        write_mask_png(&folder.join(format!("user/hair_masks/{name}/000000.png")), &mask)?;
    }
    let labels = scene.marker_labels(first);
    let markers: Vec<_> = labels
        .iter()
        .enumerate()
        .map(|(id, views)| {
            let seen: serde_json::Map<String, serde_json::Value> = views
                .iter()
                .zip(names)
                .filter_map(|(at, name)| at.map(|p| ((*name).to_owned(), serde_json::json!([p.x, p.y]))))
                .collect();
            serde_json::json!({ "id": id, "views": seen })
        })
        .collect();
    let text = serde_json::json!({
        "frame": 0,
        "pixel_convention": "first pixel centre at (0.5, 0.5)",
        "markers": markers,
    });
    write_text(&folder.join("user/marker_labels.json"), &format!("{text:#}\n"))
}

/// Markers over the capture: projections and visible share, shapes (T, V, M, 2) and (T, V, M).
#[derive(Default)]
struct MarkerTruth {
    uv: Vec<f64>,
    visible: Vec<f32>,
    shape: [usize; 3],
}

impl MarkerTruth {
    fn push(&mut self, pictures: &[Picture]) {
        for picture in pictures {
            self.uv.extend(picture.markers.iter().flat_map(|p| p.map_or([f64::NAN; 2], |p| [p.x, p.y])));
            self.visible.extend(picture.visible.iter().map(|&share| share as f32));
        }
        let markers = pictures.first().map_or(0, |picture| picture.markers.len());
        self.shape = [self.shape[0] + 1, pictures.len(), markers];
    }

    fn write(self, path: &Path, frame0: &[glam::DVec3], head: &[glam::DVec3]) -> Result<(), Failed> {
        let metres = |points: &[glam::DVec3]| points.iter().flat_map(|p| (*p * 1e-3).to_array()).collect::<Vec<f64>>();
        let [t, v, m] = self.shape;
        let mut npz = Npz::create(path.to_owned())?;
        npz.array("uv", &[t, v, m, 2], self.uv)?;
        npz.array("visible_fraction", &[t, v, m], self.visible)?;
        npz.array("points_frame0", &[frame0.len(), 3], metres(frame0))?;
        npz.array("points_head_frame", &[head.len(), 3], metres(head))?;
        npz.array("radius", &[], vec![MARKER_RADIUS_MM * 1e-3])
    }
}

fn write_strands(path: &Path, strands: &strandflow_core::Strands) -> Result<(), Failed> {
    let mut npz = Npz::create(path.to_owned())?;
    let metres: Vec<f32> = strands.points.iter().flat_map(|p| (*p * 1e-3).to_array()).collect();
    npz.array("points", &[strands.points.len(), 3], metres)?;
    npz.array("offsets", &[strands.offsets.len()], strands.offsets.iter().map(|&o| o as i32).collect())?;
    npz.array("strand_ids", &[strands.strand_count()], (0..strands.strand_count() as i32).collect())
}

fn write_poses(path: &Path, poses: &[RigidTransform]) -> Result<(), Failed> {
    let metres =
        |pose: &RigidTransform| RigidTransform { translation: pose.translation * 1e-3, ..*pose }.to_rows().concat();
    let first = poses.first().map(RigidTransform::inverse).unwrap_or_default();
    let mut npz = Npz::create(path.to_owned())?;
    npz.array("head_to_world", &[poses.len(), 4, 4], poses.iter().flat_map(metres).collect())?;
    let relative: Vec<f64> = poses.iter().flat_map(|pose| metres(&pose.after(&first))).collect();
    npz.array("relative_to_frame0", &[poses.len(), 4, 4], relative)
}

fn write_mesh(path: &Path, mesh: &TriMesh, what: &str) -> Result<(), Failed> {
    let mut text = format!("# {what}\n");
    for v in &mesh.vertices {
        text += &format!("v {:.6} {:.6} {:.6}\n", v.x * 1e-3, v.y * 1e-3, v.z * 1e-3);
    }
    for f in &mesh.faces {
        text += &format!("f {} {} {}\n", f[0] + 1, f[1] + 1, f[2] + 1);
    }
    write_text(path, &text)
}

/// An npz file being written; errors name it.
struct Npz {
    path: PathBuf,
    writer: NpzWriter<std::io::BufWriter<fs::File>>,
}

impl Npz {
    fn create(path: PathBuf) -> Result<Self, Failed> {
        let writer = NpzWriter::create(&path).map_err(|error| disk(&path, error))?;
        Ok(Self { path, writer })
    }

    fn array<T: npyz::AutoSerialize>(&mut self, name: &str, shape: &[usize], values: Vec<T>) -> Result<(), Failed> {
        let shape: Vec<u64> = shape.iter().map(|&n| n as u64).collect();
        let write = || {
            let builder = self.writer.array::<T>(name, Default::default())?;
            let mut array = builder.default_dtype().shape(&shape).begin_nd()?;
            array.extend(values)?;
            array.finish()
        };
        write().map_err(|error: std::io::Error| disk(&self.path, error))
    }
}

fn make_folder(path: &Path) -> Result<(), Failed> {
    fs::create_dir_all(path).map_err(|error| disk(path, error))
}

fn write_text(path: &Path, text: &str) -> Result<(), Failed> {
    let mut file = fs::File::create(path).map_err(|error| disk(path, error))?;
    file.write_all(text.as_bytes()).map_err(|error| disk(path, error))
}

fn disk(path: &Path, error: impl std::fmt::Display) -> Failed {
    let hint = "give a folder that you may write to, with room for the capture".to_owned();
    Failed { error: format!("{}: {error}", path.display()), hint, input: false }
}
