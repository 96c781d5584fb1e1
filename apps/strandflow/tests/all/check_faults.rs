//! `strandflow check` finds planted faults, names them, and is silent on a sound take. Writes the table of `docs/check.md`.
//!
//! `STRANDFLOW_WRITE_DOCS=1 cargo test -p strandflow --test all check_faults` writes the table anew.

use std::{
    collections::BTreeMap,
    ops::Range,
    path::Path,
    sync::{
        Mutex,
        atomic::{AtomicUsize, Ordering},
    },
};

use crate::common::{stderr, strandflow, text};
use crate::faults::{Copy, FRAMES, Sound, blurred, smaller};
use glam::{DMat3, DVec3};
use serde_json::Value;
use strandflow_core::{Camera, Plane, RgbImage, RigidTransform};

/// One planted fault: what was done, the name that `check` must give it, where, and how it is planted.
struct Planted {
    done: &'static str,
    fault: &'static str,
    place: &'static str,
    plant: fn(&mut Copy),
}

const fn planted(done: &'static str, fault: &'static str, place: &'static str, plant: fn(&mut Copy)) -> Planted {
    Planted { done, fault, place, plant }
}

const PLANTED: &[Planted] = &[
    planted("cameras of cam01 and cam04 exchanged", "swapped-views", "cam01 and cam04", |take| {
        take.rig(|rig| {
            rig.cameras.swap(1, 4);
            (rig.cameras[1].name, rig.cameras[4].name) = ("cam01".into(), "cam04".into());
        });
    }),
    planted("clips of cam01 and cam04 exchanged", "swapped-footage", "cam01 and cam04", |take| {
        for (from, to) in
            [("images/cam01", "images/SWAP"), ("images/cam04", "images/cam01"), ("images/SWAP", "images/cam04")]
        {
            take.replace(from, to);
        }
    }),
    planted("R of cam02 transposed", "transposed-rotation", "cam02", |take| {
        take.camera(2, |camera| {
            let rotation = &mut camera.camera_from_world.rotation;
            *rotation = rotation.transpose();
        });
    }),
    planted("R of all cameras transposed", "transposed-rotation", "all views", |take| {
        take.rig(|rig| {
            for camera in &mut rig.cameras {
                camera.camera_from_world.rotation = camera.camera_from_world.rotation.transpose();
            }
        });
    }),
    planted("pose of cam03 camera to world", "inverted-pose", "cam03", |take| {
        take.camera(3, |camera| camera.camera_from_world = camera.camera_from_world.inverse());
    }),
    planted("poses of all cameras camera to world", "inverted-pose", "all views", |take| {
        take.rig(|rig| {
            rig.cameras.iter_mut().for_each(|c| c.camera_from_world = c.camera_from_world.inverse());
        });
    }),
    planted("camera axes of OpenGL", "opengl-axes", "all views", |take| {
        let flip = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
        let flip = RigidTransform { rotation: flip, translation: DVec3::ZERO };
        take.rig(|rig| rig.cameras.iter_mut().for_each(|c| c.camera_from_world = flip.after(&c.camera_from_world)));
    }),
    planted("metres given as millimetres", "metres-for-millimetres", "calibration", |take| {
        take.rig(|rig| rig.cameras.iter_mut().for_each(|c| c.camera_from_world.translation *= 1e-3));
    }),
    planted("principal point of cam05 off by half", "principal-point", "cam05", |take| {
        take.camera(5, |camera| camera.principal[0] *= 0.5);
    }),
    planted("K of cam00 of an image of twice the size", "matrix-size", "cam00", |take| {
        take.camera(0, |camera| {
            (camera.focal, camera.principal) = (camera.focal.map(|f| 2.0 * f), camera.principal.map(|c| 2.0 * c));
        });
    }),
    planted("cam03 turned by 1° after the calibration", "view-off", "cam03", |take| {
        take.camera(3, |camera| turn(camera, DVec3::Y, 1.0));
    }),
    planted("cam01 turned sideways by half a degree after the calibration", "view-off", "cam01", |take| {
        take.camera(1, |camera| turn(camera, DVec3::Y, 0.5));
    }),
    planted("cam04 turned upward by a quarter of a degree", "epipolar", "cam04", |take| {
        take.camera(4, |camera| turn(camera, DVec3::X, 0.25));
    }),
    planted("cam05 turned by three degrees about its axis", "epipolar", "cam05", |take| {
        take.camera(5, |camera| turn(camera, DVec3::Z, 3.0));
    }),
    planted("a lens with k1 = −3 ignored", "distortion-missing", "all views", |take| take.distorted(-3.0, FRAMES)),
    planted("calibrated at another image size", "image-size", "all views", |take| {
        take.rig(|rig| {
            for camera in &mut rig.cameras {
                (camera.width, camera.height) = (2 * camera.width, 2 * camera.height);
                (camera.focal, camera.principal) = (camera.focal.map(|f| 2.0 * f), camera.principal.map(|c| 2.0 * c));
            }
        });
    }),
    planted("gravity along y", "gravity", "manifest", |take| {
        take.replace("gravity = [0.0, 0.0, -9806.65]", "gravity = [0.0, -9806.65, 0.0]");
    }),
    planted("gravity in m/s²", "gravity", "manifest", |take| {
        take.replace("gravity = [0.0, 0.0, -9806.65]", "gravity = [0.0, 0.0, -9.80665]");
    }),
    planted("labels 3 and 7 of cam02 exchanged", "swapped-labels", "cam02", |take| {
        take.labels(|markers| {
            let (a, b) = (markers[3]["views"]["cam02"].clone(), markers[7]["views"]["cam02"].clone());
            assert!(a.is_array() && b.is_array());
            (markers[3]["views"]["cam02"], markers[7]["views"]["cam02"]) = (b, a);
        });
    }),
    planted("a label of cam03 15 px off", "label-off", "cam03", |take| {
        take.labels(|markers| {
            let at = &mut markers[0]["views"]["cam03"][0];
            *at = (at.as_f64().unwrap_or_default() + 15.0).into();
        });
    }),
    planted("four markers labelled", "few-markers", "labels", |take| take.labels(|markers| markers.truncate(4))),
    planted("cam01 two frames late", "offset", "cam01", |take| take.clip(1, |frame| frame + 2, |image| image)),
    planted("cam04 lost frame 10", "dropped-frame", "cam04", |take| {
        take.clip(4, |frame| if frame < 10 { frame } else { frame + 1 }, |image| image);
    }),
    planted("cam02 has frame 10 twice, later ones late", "repeated-frame", "cam02", |take| {
        take.clip(2, |frame| if frame <= 10 { frame } else { frame - 1 }, |image| image);
    }),
    planted("cam02 shows frame 10 in place of 11", "copied-frame", "cam02", |take| {
        take.clip(2, |frame| if frame == 11 { 10 } else { frame }, |image| image);
    }),
    planted("cam05 has two frames less", "frame-count", "cam05", |take| {
        take.clip(5, |frame| frame, |image| image);
        take.replace(&format!("frames = \"0..{FRAMES}\"\n"), "");
    }),
    planted("a lamp in the plate of cam02 that is not in the clip", "another-part", "cam02", |take| {
        take.plate(2, |plate, _| brighten(plate, 20..60, 150..190));
    }),
    planted("a lamp in the plate of cam02 behind the subject", "mask-leak", "cam02", |take| {
        take.plate(2, |plate, _| brighten(plate, 70..140, 120..150));
    }),
    planted("the subject stood in the plate of cam03, in part", "mask-hole", "cam03", |take| {
        take.plate(3, |plate, first| {
            for y in 100..125 {
                (150..175).for_each(|x| plate[(x, y)] = first[(x, y)]);
            }
        });
    }),
    planted("the subject masks of cam01 lack the lower half", "mask-cut", "cam01", |take| {
        take.subject(1, |mask| Plane::from_fn(mask.width, mask.height, |x, y| if y < 110 { mask[(x, y)] } else { 0 }));
    }),
    planted("the subject masks of cam04 lie elsewhere", "hull-empty", "masks", |take| {
        take.subject(4, |mask| Plane::from_fn(mask.width, mask.height, |x, y| if x < 60 && y < 60 { 255 } else { 0 }));
    }),
    planted("cam05 sees no subject", "no-subject", "cam05", |take| {
        let plate = strandflow_io::read_rgb(&take.sound.capture.join("clean/cam05.png")).expect("the plate is there");
        take.clip(5, |frame| frame, |_| plate.clone());
    }),
    planted("cam01 out of focus", "blurred", "cam01", |take| take.clip(1, |frame| frame, |image| blurred(image, 1))),
    planted("cam02 overexposed", "overexposed", "cam02", |take| {
        take.clip(2, |frame| frame, |image| image.map(|c| c.map(|v| (f32::from(v) * 4.0).min(255.0) as u8)));
    }),
    planted("a hair mask of another view", "hair-outside-subject", "cam00", |take| {
        take.hair(|view, mask| match view {
            0 => Plane::from_fn(mask.width, mask.height, |x, y| if x >= 50 { mask[(x - 50, y)] } else { 0 }),
            _ => mask,
        });
    }),
    planted("images of a quarter of the size", "thin-hair", "all views", |take| {
        take.rig(|rig| {
            for camera in &mut rig.cameras {
                (camera.width, camera.height) = (camera.width / 4, camera.height / 4);
                (camera.focal, camera.principal) = (camera.focal.map(|f| f / 4.0), camera.principal.map(|c| c / 4.0));
            }
        });
        for view in 0..6 {
            take.clip(view, |frame| frame, |image| smaller(&image, 4));
            take.plate(view, |plate, _| *plate = smaller(plate, 4));
        }
        take.hair(|_, mask| smaller(&mask.map(|&m| [m; 3]), 4).map(|c| c[0]));
        take.labels(|markers| {
            let quarter = |v: &mut Value| *v = (v.as_f64().unwrap_or_default() / 4.0).into();
            for marker in markers {
                let views = marker["views"].as_object_mut().expect("labels are by view");
                views.values_mut().for_each(|at| at.as_array_mut().into_iter().flatten().for_each(quarter));
            }
        });
        take.replace("marker_radius_px = 3.0", "marker_radius_px = 1.0");
    }),
];

/// Turns a camera about an axis of its own by so many degrees.
fn turn(camera: &mut Camera, axis: DVec3, degrees: f64) {
    let rotation = DMat3::from_axis_angle(axis, degrees.to_radians());
    let turn = RigidTransform { rotation, translation: DVec3::ZERO };
    camera.camera_from_world = turn.after(&camera.camera_from_world);
}

fn brighten(plate: &mut RgbImage, columns: Range<usize>, rows: Range<usize>) {
    for y in rows {
        columns.clone().for_each(|x| plate[(x, y)] = plate[(x, y)].map(|c| c.saturating_add(70)));
    }
}

/// What `check` says of a take, and its exit code.
fn said(take: &Path) -> (Vec<Value>, i32) {
    let run = strandflow(&["check", text(take), "--json"]);
    let checks: Vec<Value> = serde_json::from_slice(&run.stdout).unwrap_or_else(|_| panic!("{}", stderr(&run)));
    let findings = checks.iter().flat_map(|c| c["findings"].as_array().cloned().unwrap_or_default()).collect();
    (findings, run.status.code().unwrap_or(-1))
}

fn field<'a>(finding: &'a Value, name: &str) -> &'a str {
    finding[name].as_str().unwrap_or_default()
}

#[test]
fn planted_faults_are_found_and_named() {
    let root = tempfile::tempdir().expect("a folder");
    let sound = Sound::make(root.path());
    let (findings, code) = said(&sound.root.join("sound"));
    assert!(findings.is_empty() && code == 0, "the sound take: {findings:#?}");
    let mut rows = vec!["| planted | named | what was said | beside it |".to_owned(), "|---|---|---|---|".to_owned()];
    let mut wrong = Vec::new();
    for row in in_threads(&sound) {
        match row {
            Ok(row) => rows.push(row),
            Err(fact) => wrong.push(fact),
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    run_refuses_only_what_cannot_work(&sound);
    keep(&rows.join("\n"));
}

/// `run` looks a take over, too; what it refuses wrongly, nobody gets.
fn run_refuses_only_what_cannot_work(sound: &Sound) {
    let run = |take: &Copy, more: &[&str]| {
        strandflow(&[&["run", text(&take.take), "--to", "masks", "--frames", "0..1"], more].concat())
    };
    let transposed = |take: &mut Copy| {
        take.camera(2, |camera| camera.camera_from_world.rotation = camera.camera_from_world.rotation.transpose());
    };
    let mut faulty = sound.copy("run-faulty");
    transposed(&mut faulty);
    let refused = run(&faulty, &[]);
    assert!(
        refused.status.code() == Some(2) && stderr(&refused).contains("transposed-rotation"),
        "{}",
        stderr(&refused)
    );
    assert!(stderr(&refused).contains("--unchecked"), "{}", stderr(&refused));
    assert!(run(&faulty, &["--unchecked"]).status.success());

    let mut held_out = sound.copy("run-held-out");
    transposed(&mut held_out);
    held_out.replace("# held_out = [\"cam03\"]", "held_out = [\"cam02\"]");
    let warned = run(&held_out, &[]);
    assert!(warned.status.success() && stderr(&warned).contains("transposed-rotation"), "{}", stderr(&warned));

    let mut few = sound.copy("run-three-views");
    few.keep_views(3);
    let mut hidden = sound.copy("run-hidden-markers");
    hidden.labels(|markers| {
        for marker in markers {
            let views = marker["views"].as_object_mut().expect("views by name");
            views.retain(|view, _| view != "cam00" && view != "cam05");
        }
    });
    for take in [few, hidden] {
        let passed = run(&take, &[]);
        assert!(passed.status.success(), "{}: {}", take.take.display(), stderr(&passed));
    }
}

/// Plants and checks, a few at a time, in the order of the table.
fn in_threads(sound: &Sound) -> Vec<Result<String, String>> {
    let next = AtomicUsize::new(0);
    let rows: Mutex<BTreeMap<usize, Result<String, String>>> = Mutex::default();
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    let Some(planted) = PLANTED.get(number) else { return };
                    let row = row(sound, number, planted);
                    rows.lock().expect("no thread failed").insert(number, row);
                }
            });
        }
    });
    rows.into_inner().expect("no thread failed").into_values().collect()
}

/// The row of the table; what was said instead where the fault was not named.
fn row(sound: &Sound, number: usize, planted: &Planted) -> Result<String, String> {
    let mut take = sound.copy(&format!("take{number:02}"));
    (planted.plant)(&mut take);
    let (findings, code) = said(&take.take);
    let is_it = |f: &&Value| field(f, "fault") == planted.fault && field(f, "place").contains(planted.place);
    let cannot = findings.iter().any(|f| field(f, "verdict") == "cannot_work");
    let Some(named) = findings.iter().find(is_it).filter(|_| code == i32::from(cannot)) else {
        return Err(format!("{}: {code} {findings:#?}", planted.done));
    };
    let mut beside: Vec<&str> =
        findings.iter().map(|f| field(f, "fault")).filter(|fault| *fault != planted.fault).collect();
    beside.dedup();
    let words = format!("{}: {}", field(named, "place"), field(named, "fact"));
    let words = words.replace(text(&sound.root), "…").replace('|', "/");
    let beside = if beside.is_empty() { "–".into() } else { beside.join(", ") };
    Ok(format!("| {} | `{}` | {words} | {beside} |", planted.done, planted.fault))
}

const BEGIN: &str = "<!-- begin: written by tests/all/check_faults.rs -->\n";
const END: &str = "\n<!-- end -->";

/// The table in `docs/check.md` is this one, but for its numbers, which may differ by a last digit between processors.
fn keep(table: &str) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/check.md");
    let written = std::fs::read_to_string(&file).expect("docs/check.md is there");
    let (head, rest) = written.split_once(BEGIN).expect("the table's beginning is marked");
    let (old, tail) = rest.split_once(END).expect("the table's end is marked");
    if std::env::var_os("STRANDFLOW_WRITE_DOCS").is_some() {
        std::fs::write(&file, format!("{head}{BEGIN}{table}{END}{tail}")).expect("docs/check.md can be written");
        return;
    }
    let plain = |text: &str| text.chars().filter(|c| !c.is_ascii_digit() && *c != '.').collect::<String>();
    let hint = "run STRANDFLOW_WRITE_DOCS=1 cargo test -p strandflow --test all check_faults";
    assert_eq!(plain(old), plain(table), "the table in docs/check.md is stale: {hint}");
}
