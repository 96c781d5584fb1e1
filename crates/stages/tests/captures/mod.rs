//! Reads captures with truth (masks, strands, head) where they are present on this machine.
#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "helpers of tests: they fail by unwrap and say what was skipped or measured"
)]
#![allow(dead_code)]

use std::{fs, path::PathBuf};

use glam::{DMat3, DVec3};
use npyz::npz::NpzArchive;
use strandflow_core::{Camera, Distortion, Mask, Rig, RigidTransform, TriMesh};

/// A capture folder.
pub struct Capture {
    pub folder: PathBuf,
    pub rig: Rig,
    pub gravity: DVec3,
}

/// The captures' folder: `STRANDFLOW_CAPTURES`, or `shared/captures` beside the repository.
pub fn capture(name: &str) -> Option<Capture> {
    let root = std::env::var_os("STRANDFLOW_CAPTURES")
        .map_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/captures")), PathBuf::from);
    let folder = root.join(name);
    let Ok(text) = fs::read_to_string(folder.join("calibration.json")) else {
        println!("skipped: captures not found");
        return None;
    };
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let number = |v: &serde_json::Value| v.as_f64().unwrap();
    let vector = |v: &serde_json::Value| DVec3::new(number(&v[0]), number(&v[1]), number(&v[2]));
    let camera = |c: &serde_json::Value| Camera {
        name: c["name"].as_str().unwrap().into(),
        width: c["width"].as_u64().unwrap() as usize,
        height: c["height"].as_u64().unwrap() as usize,
        focal: [number(&c["K"][0][0]), number(&c["K"][1][1])],
        principal: [number(&c["K"][0][2]), number(&c["K"][1][2])],
        distortion: Distortion::None,
        camera_from_world: RigidTransform {
            rotation: DMat3::from_cols(vector(&c["R"][0]), vector(&c["R"][1]), vector(&c["R"][2])).transpose(),
            translation: vector(&c["t"]) * 1000.0,
        },
    };
    let cameras = json["cameras"].as_array().unwrap().iter().map(camera).collect();
    Some(Capture { folder, rig: Rig { cameras }, gravity: vector(&json["gravity_world"]) * 1000.0 })
}

impl Capture {
    /// True coverage of all views in a frame; `kind` is `hair` or `subject`.
    pub fn masks(&self, kind: &str, frame: usize) -> Vec<Mask> {
        let one = |camera: &Camera| {
            let path = self.folder.join(format!("gt/mask_{kind}/{}/{frame:06}.png", camera.name));
            let picture = image::open(&path).unwrap().to_luma8();
            Mask { width: picture.width() as usize, height: picture.height() as usize, data: picture.into_raw() }
        };
        self.rig.cameras.iter().map(one).collect()
    }

    /// True strand points [mm] and the index of each strand's first.
    pub fn strands(&self, frame: usize) -> (Vec<DVec3>, Vec<usize>) {
        let path = format!("gt/strands_{frame:06}.npz");
        let points: Vec<f32> = self.array(&path, "points");
        let offsets: Vec<i32> = self.array(&path, "offsets");
        let points = points.chunks(3).map(|p| DVec3::new(p[0].into(), p[1].into(), p[2].into()) * 1000.0).collect();
        (points, offsets.iter().map(|&o| o as usize).collect())
    }

    /// True head motion since frame 0.
    pub fn world_from_head(&self, frame: usize) -> RigidTransform {
        self.transform("relative_to_frame0", frame)
    }

    /// The true head surface in head space (the world of frame 0) [mm].
    pub fn head(&self) -> TriMesh {
        let pose = self.transform("head_to_world", 0);
        let text = fs::read_to_string(self.folder.join("gt/head.obj")).unwrap();
        let mut mesh = TriMesh::default();
        for line in text.lines() {
            let words: Vec<&str> = line.split_whitespace().collect();
            match words.first() {
                Some(&"v") => {
                    let [x, y, z] = [1, 2, 3].map(|k| words[k].parse::<f64>().unwrap() * 1000.0);
                    mesh.vertices.push(pose.point(DVec3::new(x, y, z)));
                }
                Some(&"f") => {
                    let corners: Vec<u32> =
                        words[1..].iter().map(|w| w.split('/').next().unwrap().parse::<u32>().unwrap() - 1).collect();
                    mesh.faces.extend((2..corners.len()).map(|k| [corners[0], corners[k - 1], corners[k]]));
                }
                _ => {}
            }
        }
        mesh
    }

    /// True marker centres at frame 0 [mm].
    pub fn markers(&self) -> Vec<DVec3> {
        let points: Vec<f64> = self.array("gt/markers.npz", "points_frame0");
        points.chunks(3).map(|p| DVec3::new(p[0], p[1], p[2]) * 1000.0).collect()
    }

    fn transform(&self, name: &str, frame: usize) -> RigidTransform {
        let all: Vec<f64> = self.array("gt/head_pose.npz", name);
        let m = &all[frame * 16..frame * 16 + 16];
        let rows: [[f64; 4]; 4] = std::array::from_fn(|r| std::array::from_fn(|c| m[r * 4 + c]));
        let mut transform = RigidTransform::from_rows(&rows);
        transform.translation *= 1000.0;
        transform
    }

    fn array<T: npyz::Deserialize>(&self, file: &str, name: &str) -> Vec<T> {
        let mut archive = NpzArchive::open(self.folder.join(file)).unwrap();
        archive.by_name(name).unwrap().unwrap().into_vec().unwrap()
    }
}
