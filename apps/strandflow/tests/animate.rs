//! `strandflow animate` and what reads its result: resumed runs give the same bytes, bad input is a located error with a hint.
//! The take has results only, made up here: no footage, no calibration.
#![expect(clippy::unwrap_used, reason = "a failing unwrap is a failing test")]

mod common;

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use common::{stderr, strandflow, text};
use glam::{DMat3, DVec3, Vec3};
use strandflow_core::{FrameRange, Grid, Provenance, RigidTransform, StrandSequence};
use strandflow_engine::{
    Manifest, Plan,
    store::{Record, Store, Writer},
};
use strandflow_geometry::primitives::icosphere;
use strandflow_io::{Interchange, VdbOptions, write_usc_data, write_velocity_vdb};

const FRAMES: usize = 7;
const MIDDLE: DVec3 = DVec3::new(20.0, 10.0, 1200.0);
const MANIFEST: &str = r#"
fps = 100.0
gravity = [0.0, 0.0, -9810.0]
[calibration]
file = "none.json"
[[views]]
name = "a"
source = "none_a.mp4"
plate = "none_a.png"
[[views]]
name = "b"
source = "none_b.mp4"
plate = "none_b.png"
[labels]
markers = "none.json"
hair_masks = "none"
"#;

fn pose(t: usize) -> RigidTransform {
    let rotation = DMat3::from_rotation_z(0.03 * t as f64);
    RigidTransform { rotation, translation: MIDDLE - rotation * MIDDLE }
}

/// A take whose head turns, with a field that turns four fifths as fast.
fn take(root: &Path) -> PathBuf {
    let take = root.join("take");
    std::fs::create_dir_all(&take).unwrap();
    std::fs::write(take.join("strandflow.toml"), MANIFEST).unwrap();
    let manifest = Manifest::read(&take).unwrap();
    let plan = Plan::new(&manifest, FrameRange { start: 0, end: FRAMES }, None, None).unwrap();
    std::fs::write(take.join("resolved.toml"), toml::to_string(&plan).unwrap()).unwrap();
    let store = Store::open(&take.join("results.zarr")).unwrap();
    let mut out = Writer::new(&store);
    let mut head = icosphere(DVec3::ZERO, 1.0, 3);
    head.vertices.iter_mut().for_each(|v| *v = MIDDLE + *v * DVec3::new(74.0, 92.0, 85.0));
    let flat = |points: &[DVec3]| points.iter().flat_map(|p| p.to_array()).collect::<Vec<f64>>();
    let roots: Vec<DVec3> = head.vertices.iter().filter(|p| p.z > MIDDLE.z).copied().collect();
    out.whole("scalp/vertices", &[head.vertices.len(), 3], &flat(&head.vertices)).unwrap();
    out.whole("scalp/faces", &[head.faces.len(), 3], head.faces.as_flattened()).unwrap();
    out.whole("scalp/roots", &[roots.len(), 3], &flat(&roots)).unwrap();
    out.whole("scalp/normals", &[roots.len(), 3], &vec![0.0f64; 3 * roots.len()]).unwrap();
    let rows: Vec<f64> = (0..FRAMES).flat_map(|t| pose(t).to_rows().as_flattened().to_vec()).collect();
    out.whole("pose/world_from_head", &[FRAMES, 4, 4], &rows).unwrap();
    let grid = Grid { origin: MIDDLE - DVec3::new(150.0, 150.0, 200.0), voxel_mm: 20.0, dims: [15, 15, 16] };
    out.whole("hull/grid/origin", &[3], &grid.origin.to_array()).unwrap();
    out.whole("hull/grid/voxel_mm", &[1], &[grid.voxel_mm]).unwrap();
    out.whole("hull/grid/dims", &[3], &grid.dims.map(|n| n as u32)).unwrap();
    let voxels: Vec<u32> = (0..grid.len() as u32).collect();
    let turning = |v: &u32| (DVec3::Z.cross(grid.centre_of_index(*v as usize) - MIDDLE) * 2.4).as_vec3().to_array();
    let velocities: Vec<f32> = voxels.iter().flat_map(turning).collect();
    for t in 0..FRAMES {
        let mut out = Writer::new(&store);
        out.whole(&format!("flow/{t:06}/voxel"), &[voxels.len()], &voxels).unwrap();
        out.whole(&format!("flow/{t:06}/velocity"), &[voxels.len(), 3], &velocities).unwrap();
        let record = Record { inputs: BTreeMap::new(), outputs: out.finish(), findings: Vec::new() };
        store.write_record(&format!("flow/flow/{t:06}"), &record).unwrap();
    }
    take
}

/// A groom around the origin whose points are `unit` of a millimetre, written as metres as `.data` wants it.
fn groom(file: &Path, unit: f32, points: usize, broken: bool) {
    let mut sequence = StrandSequence::missing(vec![0], vec![points as u16; 90], points);
    for n in 0..90 {
        let (around, up) = (n as f32 * 0.7, 0.1 + 0.009 * n as f32);
        let root = Vec3::new(
            74.0 * around.cos() * (1.0 - up * up).sqrt(),
            92.0 * around.sin() * (1.0 - up * up).sqrt(),
            85.0 * up,
        );
        for (k, at) in sequence.range(0, n).enumerate() {
            let out = Vec3::new(root.x, root.y, 0.0).normalize() * 12.0 * (1.0 - (-0.4 * k as f32).exp());
            sequence.points[at] = (root + out - Vec3::Z * 4.5 * k as f32) * unit;
            sequence.provenance[at] = Provenance::Observed;
        }
    }
    write_usc_data(file, &Interchange::new(&sequence).unwrap(), 0).unwrap();
    if broken {
        let mut bytes = std::fs::read(file).unwrap();
        bytes[20..24].copy_from_slice(&f32::NAN.to_le_bytes());
        std::fs::write(file, bytes).unwrap();
    }
}

fn animate(take: &Path, groom: &Path, more: &[&str]) -> std::process::Output {
    let mut args = vec!["animate", text(take), "--groom", text(groom)];
    args.extend(more);
    strandflow(&args)
}

/// Bad input: exit code 2, and these words in the error or its hint.
fn refused(output: &std::process::Output, words: &[&str]) {
    let said = stderr(output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("error: ") && said.contains("hint: "), "{said}");
    words.iter().for_each(|word| assert!(said.contains(word), "`{word}` is not in: {said}"));
}

fn bytes_of(take: &Path, name: &str) -> BTreeMap<String, Vec<u8>> {
    let folder = take.join("results.zarr/animate").join(name).join("points/c");
    let mut files = BTreeMap::new();
    let mut stack = vec![folder.clone()];
    while let Some(path) = stack.pop() {
        if path.is_dir() {
            stack.extend(std::fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path()));
        } else {
            files.insert(path.strip_prefix(&folder).unwrap().display().to_string(), std::fs::read(&path).unwrap());
        }
    }
    files
}

/// The take's field as OpenVDB files for Houdini.
fn write_vdb(take: &Path, folder: &Path) {
    std::fs::create_dir(folder).unwrap();
    let store = Store::open(&take.join("results.zarr")).unwrap();
    let options = VdbOptions {
        gravity: Some(DVec3::NEG_Z),
        space: strandflow_io::Target::Houdini.space(strandflow_io::Carrier::Vdb),
        zip: true,
    };
    for t in 0..FRAMES {
        write_velocity_vdb(&folder.join(format!("{t:06}.vdb")), &store.read_flow(t).unwrap(), &options).unwrap();
    }
}

/// The largest distance between two animations of one groom.
fn farthest(take: &Path, a: &str, b: &str) -> f32 {
    let store = Store::open(&take.join("results.zarr")).unwrap();
    let points = |name: &str| store.read_all::<f32>(&format!("animate/{name}/points")).unwrap();
    points(a).iter().zip(points(b)).map(|(a, b)| (a - b).abs()).filter(|d| d.is_finite()).fold(0.0, f32::max)
}

#[test]
fn a_resumed_animation_has_the_same_bytes_and_can_be_exported() {
    let root = tempfile::tempdir().unwrap();
    let take = take(root.path());
    let file = root.path().join("bob.data");
    groom(&file, 1.0, 20, false);
    let whole = animate(&take, &file, &["--threads", "2"]);
    assert!(whole.status.success(), "{}", stderr(&whole));
    let said = stderr(&whole);
    assert!(said.contains("strands in the head: 0") && said.contains("7 frames made, 0 found"), "{said}");
    let part = animate(&take, &file, &["--name", "part", "--length", "4", "--threads", "1"]);
    assert!(stderr(&part).contains("4 frames made, 0 found"), "{}", stderr(&part));
    let rest = animate(&take, &file, &["--name", "part", "--threads", "1"]);
    assert!(stderr(&rest).contains("3 frames made, 4 found"), "{}", stderr(&rest));
    assert_eq!(bytes_of(&take, "bob"), bytes_of(&take, "part"));
    let vdb = root.path().join("field");
    write_vdb(&take, &vdb);
    let from_files = ["--name", "vdb", "--field", text(&vdb), "--field-for", "houdini"];
    let run = animate(&take, &file, &from_files);
    assert!(run.status.success(), "{}", stderr(&run));
    assert!(farthest(&take, "bob", "vdb") < 1e-2);
    std::fs::write(vdb.join("000002.vdb"), "no volume").unwrap();
    refused(&animate(&take, &file, &from_files), &["000002.vdb"]);
    let again = animate(&take, &file, &["--name", "part", "--amplitude", "0"]);
    assert!(stderr(&again).contains("7 frames made, 0 found"), "{}", stderr(&again));
    assert_ne!(bytes_of(&take, "bob"), bytes_of(&take, "part"));
    for format in ["npz", "usd", "abc"] {
        let out = root.path().join(format!("bob.{format}"));
        let run = strandflow(&["export", text(&take), "--animation", "bob", "--to", format, text(&out)]);
        assert!(run.status.success() && out.is_file(), "{}", stderr(&run));
    }
    let run = strandflow(&["export", text(&take), "--animation", "bop", "--to", "npz", "x.npz"]);
    refused(&run, &["bop", "there are: bob, part, vdb"]);
}

#[test]
fn bad_grooms_are_named_with_what_to_do() {
    let root = tempfile::tempdir().unwrap();
    let take = take(root.path());
    let file = root.path().join("groom.data");
    groom(&file, 0.001, 20, false);
    refused(&animate(&take, &file, &[]), &["spread over 0.001", "--scale 1000"]);
    let scaled = animate(&take, &file, &["--scale", "1000"]);
    assert!(scaled.status.success(), "{}", stderr(&scaled));
    groom(&file, 1.0, 1, false);
    let one = animate(&take, &file, &[]);
    assert!(stderr(&one).contains("hint: "), "{}", stderr(&one));
    groom(&file, 1.0, 20, true);
    refused(&animate(&take, &file, &[]), &["groom.data"]);
    groom(&file, 1.0, 20, false);
    refused(&animate(&take, &file, &["--as-given"]), &["mm from the captured scalp", "--transform"]);
    refused(&animate(&take, &file, &["--name", "a/b"]), &["a/b", "letters"]);
    refused(&animate(&take, &file, &["--frames", "0..90"]), &["0..7"]);
    let mesh = take.with_file_name("body.obj");
    std::fs::write(&mesh, "v 0 0 0\nv 0.4 0 0\nv 0 0.2 0\nf 1 2 3\n").unwrap();
    refused(&animate(&take, &file, &["--collide", text(&mesh)]), &["body.obj", "metres"]);
    std::fs::write(&mesh, "v 0 0 0\nf 1 2 3\n").unwrap();
    refused(&animate(&take, &file, &["--collide", text(&mesh)]), &["body.obj:2", "OBJ"]);
    refused(&animate(&take, &file, &["--amplitude=-1"]), &["amplitude", "0..=5"]);
    let cut = std::fs::read(&file).unwrap();
    std::fs::write(&file, &cut[..cut.len() / 2]).unwrap();
    refused(&animate(&take, &file, &[]), &["groom.data"]);
    refused(&animate(root.path(), &file, &[]), &["no manifest"]);
    std::fs::remove_file(take.join("results.zarr/.items/flow/flow/000003.json")).unwrap();
    groom(&file, 1.0, 20, false);
    refused(&animate(&take, &file, &[]), &["frame 3 has no velocity field", "strandflow run"]);
}
