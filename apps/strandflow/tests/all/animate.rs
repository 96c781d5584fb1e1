//! `strandflow animate` and what reads its result: resumed runs give the same bytes, bad input is a located error with a hint.
//! The take has results only, made up here: no footage, no calibration.
#![expect(clippy::unwrap_used, reason = "a failing unwrap is a failing test")]

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use crate::common::{assert_not_written, on_full_disk, stderr, strandflow, text};
use glam::{DMat3, DVec3, Vec3};
use strandflow_core::{FrameRange, Grid, Provenance, RigidTransform, StrandSequence};
use strandflow_engine::{
    Manifest, Plan,
    store::{Store, Writer},
};
use strandflow_geometry::primitives::icosphere;
use strandflow_io::{Interchange, SceneOptions, VdbOptions, write_usc_data, write_usd, write_velocity_vdb};

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
        out.finish(&format!("flow/flow/{t:06}"), BTreeMap::new(), Vec::new()).unwrap();
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

/// Names of the files in a folder.
fn names(folder: &Path) -> Vec<String> {
    std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

#[cfg(unix)]
#[test]
fn a_full_disk_is_told_and_what_is_finished_is_kept() {
    let root = tempfile::tempdir().unwrap();
    let take = take(root.path());
    let file = root.path().join("bob.data");
    groom(&file, 1.0, 20, false);
    assert!(animate(&take, &file, &[]).status.success());
    assert!(animate(&take, &file, &["--name", "part", "--length", "3"]).status.success());
    // Of a frame's 21.6 KB of points not even the packed bytes find room.
    let full = on_full_disk(8, &["animate", text(&take), "--groom", text(&file), "--name", "part"]);
    assert_not_written(&full, &take.join("results.zarr/animate/part"));
    let rest = animate(&take, &file, &["--name", "part"]);
    assert!(stderr(&rest).contains("4 frames made, 3 found"), "{}", stderr(&rest));
    assert_eq!(bytes_of(&take, "bob"), bytes_of(&take, "part"));

    let out = root.path().join("out");
    std::fs::create_dir(&out).unwrap();
    for (format, name) in [
        ("npz", "a.npz"),
        ("usd", "a.usda"),
        ("usd", "a.usdc"),
        ("abc", "a.abc"),
        ("cards", "cards.usdc"),
        ("cards", "cards"),
        ("ply", "ply"),
        ("hair", "hair"),
        ("data", "data"),
    ] {
        let export = |to: &Path| {
            let guides: &[&str] = if format == "cards" { &["--guides", "9"] } else { &[] };
            let args = ["export", text(&take), "--animation", "bob", "--to", format, text(to)];
            on_full_disk(2, &[&args, guides].concat())
        };
        assert_not_written(&export(&out.join(name)), &out.join(name));
        assert_eq!(names(&out), [""; 0], "{format}");
        // Where nobody may write, not even root: below a file, and in a folder that is none of the disk's.
        for place in [file.join(name), Path::new("/proc").join(name)] {
            let run = export(&place);
            let said = stderr(&run);
            assert!(!run.status.success() && said.contains("hint: "), "{said}");
            assert!(said.contains(text(place.parent().unwrap())), "{said}");
            assert!(!said.contains(&format!(".{name}.tmp")), "{said}");
        }
    }
}

/// A groom in a file that states Y up and metres: it needs neither --scale nor --transform; with a misstated unit the factor is
/// named.
#[test]
fn what_a_file_states_is_believed_first() {
    let root = tempfile::tempdir().unwrap();
    let take = take(root.path());
    let (data, usd) = (root.path().join("bob.data"), root.path().join("bob.usda"));
    groom(&data, 1.0, 20, false);
    let mut strands = StrandSequence::missing(vec![0], vec![20; 90], 20);
    for (n, strand) in strandflow_io::read_groom(&data).unwrap().strands.iter().enumerate() {
        for (at, p) in strands.range(0, n).zip(strand) {
            strands.points[at] = *p;
            strands.provenance[at] = Provenance::Observed;
        }
    }
    let space = strandflow_io::Target::Houdini.space(strandflow_io::Carrier::Usd);
    let options = SceneOptions { gravity: Some(DVec3::NEG_Z), space, ..SceneOptions::default() };
    write_usd(&usd, &strands, &options).unwrap();
    for (file, name) in [(&data, "data"), (&usd, "usd")] {
        let run = animate(&take, file, &["--name", name, "--length", "2"]);
        assert!(run.status.success(), "{}", stderr(&run));
    }
    // The groom is nearly round from above, so that only the way up is told by its shape.
    let store = Store::open(&take.join("results.zarr")).unwrap();
    let tips = |name: &str| -> f32 {
        let points = store.read_all::<f32>(&format!("animate/{name}/points")).unwrap();
        points[..90 * 20 * 3].chunks(60).map(|strand| strand[59] / 90.0).sum()
    };
    assert!((tips("data") - tips("usd")).abs() < 3.0, "{} {}", tips("data"), tips("usd"));
    let text_of = std::fs::read_to_string(&usd).unwrap();
    std::fs::write(&usd, text_of.replace("metersPerUnit = 1\n", "metersPerUnit = 100\n")).unwrap();
    refused(&animate(&take, &usd, &[]), &["bob.usda", "--scale 0.01"]);
    std::fs::write(&usd, text_of.replace("metersPerUnit = 1\n", "metersPerUnit = 0\n")).unwrap();
    refused(&animate(&take, &usd, &[]), &["bob.usda", "metersPerUnit"]);
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
