//! `strandflow view`: every address against what the store holds, who may ask, unfinished takes, and the page in a browser.
#![expect(clippy::unwrap_used, reason = "a failing unwrap is a failing test")]

use std::{
    path::{Path, PathBuf},
    process::Command,
    sync::LazyLock,
};

use crate::common::{
    assert_bad_input, bytes_below, stderr, strandflow, synthetic, text,
    viewer::{Viewer, pages},
};
use glam::{DVec3, Vec3};
use serde_json::Value;
use strandflow_core::{FrameRange, Provenance, StrandSequence};
use strandflow_engine::Take;
use strandflow_eval::lengths::present_length;
use strandflow_geometry::project::project;

const MAGIC: u32 = 0x5346_5331;

/// A finished take with an animation, and the truth of its capture; made once for all tests.
struct Made {
    _root: tempfile::TempDir,
    take: PathBuf,
    truth: PathBuf,
}

static MADE: LazyLock<Made> = LazyLock::new(|| {
    let root = tempfile::tempdir().unwrap();
    let capture = root.path().join("capture");
    synthetic::capture(&capture);
    let take = synthetic::take_of(&capture, "take", &[]);
    for args in [
        &["run", text(&take), "--json"][..],
        &["animate", text(&take), "--groom", "captured", "--name", "own", "--length", "2"],
    ] {
        let run = strandflow(args);
        assert!(run.status.success(), "{}", stderr(&run));
    }
    Made { truth: capture.join("gt"), take, _root: root }
});

fn with_truth() -> Viewer {
    Viewer::of(&MADE.take, &["--truth", text(&MADE.truth)])
}

fn header(body: &[u8]) -> [u32; 4] {
    std::array::from_fn(|i| u32::from_le_bytes(body[4 * i..4 * i + 4].try_into().unwrap()))
}

fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect()
}

fn points(bytes: &[u8]) -> Vec<Vec3> {
    floats(bytes).chunks_exact(3).map(Vec3::from_slice).collect()
}

/// The same numbers, NaN included.
fn same(a: &[f32], b: &[f32]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan()))
}

fn flat(points: &[Vec3]) -> Vec<f32> {
    points.iter().flat_map(|p| p.to_array()).collect()
}

fn stored(take: &Take, stage: &str, frame: usize) -> StrandSequence {
    let range = FrameRange { start: frame, end: frame + 1 };
    take.read_sequence_part(stage, range, 0..take.strand_count().unwrap()).unwrap()
}

#[test]
fn the_take_is_described() {
    let (viewer, take) = (with_truth(), Take::open(&MADE.take).unwrap());
    let json: Value = serde_json::from_slice(&viewer.body("/api/take")).unwrap();
    let strands = take.strand_count().unwrap();
    assert_eq!((&json["name"], &json["frames"]), (&Value::from("take"), &serde_json::json!([0, synthetic::FRAMES])));
    assert_eq!(json["fps"], take.manifest().fps);
    assert_eq!(json["notes"], serde_json::json!([]));
    let sets = json["sets"].as_array().unwrap();
    let ids: Vec<&str> = sets.iter().map(|set| set["id"].as_str().unwrap()).collect();
    assert_eq!(ids, ["grow", "prune", "smooth", "fit", "blend", "animate/own", "truth"]);
    for set in &sets[..5] {
        assert_eq!((&set["strands"], &set["done"]), (&Value::from(strands), &serde_json::json!([0, 1, 2, 3])), "{set}");
    }
    assert_eq!((&sets[5]["done"], &sets[6]["strands"]), (&serde_json::json!([0, 1]), &Value::from(400)));
    let names =
        |i: usize| sets[i]["attributes"].as_array().unwrap().iter().map(|a| a.as_str().unwrap()).collect::<Vec<_>>();
    let common = ["provenance", "confidence", "speed", "relative_speed", "length", "length_change"];
    assert_eq!(names(0), [&common[..], &["rejected", "error"]].concat());
    assert_eq!(names(4), [&common[..], &["residual", "error"]].concat());
    assert_eq!(names(5), common);
    for attribute in json["attributes"].as_array().unwrap() {
        assert!(attribute["range"][0].as_f64() < attribute["range"][1].as_f64(), "{attribute}");
    }
    let view = &json["views"][2];
    let camera = &take.rig().cameras[2];
    assert_eq!((&view["name"], &view["fx"]), (&Value::from(camera.name.as_str()), &Value::from(camera.focal[0])));
    assert_eq!(view["center"][1], camera.centre_in_world().y);
    assert!(view["footage"] == true && view["held_out"] == false && json["views"].as_array().unwrap().len() == 5);
    let pose = take.read_pose(3).unwrap().to_rows();
    assert_eq!(json["world_from_head"]["first"], 0);
    let given: Vec<f64> =
        json["world_from_head"]["poses"][3].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    assert_eq!(given, pose.as_flattened());
    assert!(json["layers"].as_object().unwrap().values().all(|there| there == true));
    assert!(json["stages"].as_array().unwrap().iter().all(|stage| stage["state"] == "done"), "{}", json["stages"]);
    assert_eq!(json["stages"][0]["detail"], "20 of 20 images");
    let inside = |p: &Vec3| {
        (0..3).all(|k| {
            let side = |name: &str| json["bounds"][name][k].as_f64().unwrap();
            (side("lo") - 60.0..side("hi") + 60.0).contains(&f64::from(p[k]))
        })
    };
    assert!(stored(&take, "blend", 0).points.iter().filter(|p| p.is_finite()).all(inside));
}

#[test]
fn positions_are_those_of_the_store() {
    let (viewer, take) = (with_truth(), Take::open(&MADE.take).unwrap());
    let sequence = stored(&take, "blend", 2);
    let (strands, width) = (sequence.strand_count, sequence.point_count);
    // The store's own points, up to the last that any strand of the answer has.
    let own = |numbers: &[usize]| {
        let row = |n: usize| &sequence.points[n * width..(n + 1) * width];
        let ends = numbers.iter().filter_map(|n| row(*n).iter().rposition(|p| p.is_finite()));
        let longest = ends.max().unwrap() + 1;
        (longest as u32, numbers.iter().flat_map(|n| flat(&row(*n)[..longest])).collect::<Vec<f32>>())
    };
    let all: Vec<usize> = (0..strands).collect();
    let body = viewer.body("/api/strands/blend/2");
    let (longest, expected) = own(&all);
    assert_eq!(header(&body), [MAGIC, strands as u32, longest, 32]);
    assert!(same(&floats(&body[16..]), &expected));

    // From one block into the next, every third.
    let body = viewer.body("/api/strands/blend/2?first=500&count=9&stride=3");
    let (longest, expected) = own(&(0..9).map(|i| 500 + 3 * i).collect::<Vec<_>>());
    assert_eq!(header(&body), [MAGIC, 9, longest, 32]);
    assert!(same(&floats(&body[16..]), &expected));

    // Evenly along the strand: its ends stay, its steps are alike.
    let body = viewer.body("/api/strands/blend/2?points=6");
    let resampled = points(&body[16..]);
    assert_eq!((header(&body), resampled.len()), ([MAGIC, strands as u32, 6, 32], strands * 6));
    let mut compared = 0;
    for (n, six) in resampled.chunks_exact(6).enumerate() {
        let present: Vec<Vec3> =
            sequence.points[n * width..(n + 1) * width].iter().copied().filter(|p| p.is_finite()).collect();
        if present.len() < 2 {
            assert!(six.iter().all(|p| p.is_nan()));
            continue;
        }
        let ends = [present[0], present[present.len() - 1]];
        assert!(six[0].distance(ends[0]) < 1e-3 && six[5].distance(ends[1]) < 1e-3, "strand {n}: {six:?} {ends:?}");
        assert!(present_length(six).unwrap() <= present_length(&present).unwrap() + 1e-3);
        compared += 1;
    }
    assert!(compared > strands / 2);

    // Sixteen bits.
    let body = viewer.body("/api/strands/blend/2?points=6&bits=16");
    assert_eq!((header(&body), body.len()), ([MAGIC, strands as u32, 6, 16], 64 + strands * 36));
    let number = |i: usize| f64::from_le_bytes(body[16 + 8 * i..24 + 8 * i].try_into().unwrap());
    for (i, p) in resampled.iter().enumerate() {
        let step = |k: usize| u16::from_le_bytes(body[64 + 6 * i + 2 * k..66 + 6 * i + 2 * k].try_into().unwrap());
        let read = DVec3::from_array([0, 1, 2].map(|k| number(k) + number(3 + k) * f64::from(step(k))));
        let half = DVec3::from_array([0, 1, 2].map(|k| 0.51 * number(3 + k)));
        let fine = if p.is_nan() { step(0) == u16::MAX } else { (read - p.as_dvec3()).abs().cmple(half).all() };
        assert!(fine, "{i}: {read} for {p}");
    }

    // Other sets: as grown, of an animation, true.
    let grown = take.read_strands("grow", 1).unwrap();
    let body = viewer.body("/api/strands/grow/1?first=7&count=1");
    let own = grown.strand(7);
    assert!(same(&floats(&body[16..])[..3 * own.len()], &flat(own)));
    let body = viewer.body("/api/strands/animate/own/1?count=4");
    let [_, count, points_each, _] = header(&body);
    let animated: Vec<f32> =
        take.store().read("animate/own/points", &[1..2, 0..4, 0..points_each as usize, 0..3]).unwrap();
    assert!(count == 4 && same(&floats(&body[16..]), &animated));
    let truth = strandflow_eval::truth::read(&MADE.truth).unwrap();
    let body = viewer.body("/api/strands/truth/3?first=11&count=1");
    assert!(same(&floats(&body[16..])[..3 * truth.strand(3, 11).len()], &flat(truth.strand(3, 11))));
}

#[test]
fn attributes_follow_from_the_store() {
    let (viewer, take) = (with_truth(), Take::open(&MADE.take).unwrap());
    let frames: Vec<StrandSequence> = (0..synthetic::FRAMES).map(|t| stored(&take, "blend", t)).collect();
    let (now, fps) = (&frames[1], take.manifest().fps);
    let (strands, width) = (now.strand_count, now.point_count);
    let values = |name: &str, frame: usize, query: &str| {
        let body = viewer.body(&format!("/api/attribute/blend/{name}/{frame}{query}"));
        (header(&body), floats(&body[16..]))
    };
    // Index in the store of each value of an answer that begins with strand `first`.
    let indices = |[_, count, points, _]: [u32; 4], first: usize| -> Vec<usize> {
        let (count, points) = (count as usize, points as usize);
        (0..count * points).map(|i| (first + i / points) * width + i % points).collect()
    };
    let (head, provenance) = values("provenance", 1, "");
    assert!(head[1] == strands as u32 && head[2] >= 2 && head[2] <= width as u32);
    let numbers = provenance.iter().zip(indices(head, 0));
    assert!(numbers.clone().all(|(v, i)| *v == f32::from(now.provenance[i] as u8)));
    let (head, confidence) = values("confidence", 1, "?first=9&count=2");
    assert!(confidence.iter().zip(indices(head, 9)).all(|(v, i)| *v == now.confidence[i]));

    let speed_of = |t: usize, i: usize| -> f32 {
        let p = |t: usize| frames[t].points[i];
        let v = if t == 0 { p(1) - p(0) } else { (p(t + 1) - p(t - 1)) * 0.5 };
        v.length() * fps as f32
    };
    for t in [0, 1] {
        let (head, speed) = values("speed", t, "");
        let both = speed.iter().zip(indices(head, 0)).filter(|(v, i)| v.is_finite() && speed_of(t, *i).is_finite());
        let mut compared = 0;
        for (v, i) in both {
            assert!((v - speed_of(t, i)).abs() < 0.05 + 1e-3 * v, "frame {t}, sample {i}: {v}");
            compared += 1;
        }
        assert!(compared > 1000, "{compared}");
    }
    // A root moves with the head: beside it, it stands.
    let (_, beside) = values("relative_speed", 1, "?points=4");
    let (_, whole) = values("speed", 1, "?points=4");
    let root_speed = |all: &[f32]| {
        let mut roots: Vec<f32> = all.iter().step_by(4).copied().filter(|v| v.is_finite()).collect();
        roots.sort_by(f32::total_cmp);
        roots[roots.len() / 2]
    };
    assert!(root_speed(&beside) <= 0.5 * root_speed(&whole) + 1.0, "{} {}", root_speed(&beside), root_speed(&whole));

    let (head, lengths) = values("length", 1, "");
    assert_eq!(head, [MAGIC, strands as u32, 1, 32]);
    let length = |t: usize, n: usize| present_length(&frames[t].points[n * width..(n + 1) * width]);
    let (_, change) = values("length_change", 1, "");
    for n in 0..strands {
        assert!(length(1, n).map_or(lengths[n].is_nan(), |l| (l as f32 - lengths[n]).abs() < 1e-3));
        let mut all: Vec<f64> = (0..synthetic::FRAMES).filter_map(|t| length(t, n)).collect();
        all.sort_by(f64::total_cmp);
        let expected = length(1, n).map(|l| 100.0 * (l / all[all.len() / 2] - 1.0));
        assert!(expected.map_or(change[n].is_nan(), |c| (c as f32 - change[n]).abs() < 1e-2), "strand {n}");
    }
    let residual: Vec<f32> = take.store().read_all("fit/residual_mm").unwrap();
    assert!(same(&values("residual", 1, "").1, &residual));
    let flags: Vec<u8> = take.store().read("prune/flags", &[1..2, 0..strands]).unwrap();
    let body = viewer.body("/api/attribute/grow/rejected/1");
    assert!(floats(&body[16..]).iter().zip(&flags).all(|(v, flag)| *v == f32::from(*flag)));

    // Errors against the nearest of all true segments.
    let truth = strandflow_eval::truth::read(&MADE.truth).unwrap();
    let (_, errors) = values("error", 1, "?stride=40&points=5");
    let at = points(&viewer.body("/api/strands/blend/1?stride=40&points=5")[16..]);
    let nearest = |p: Vec3| {
        let segments = (0..truth.strand_count()).flat_map(|n| truth.strand(1, n).windows(2));
        let off = segments.map(|pair| {
            let part = ((p - pair[0]).dot(pair[1] - pair[0]) / pair[0].distance_squared(pair[1])).clamp(0.0, 1.0);
            p.distance(pair[0].lerp(pair[1], part))
        });
        off.fold(50.0f32, f32::min)
    };
    let mut compared = 0;
    for (point, error) in at.iter().zip(&errors).filter(|(p, _)| p.is_finite()) {
        let expected = nearest(*point);
        assert!(*error >= expected - 1e-3 && *error < expected + 2.0, "{point}: {error} instead of {expected}");
        compared += 1;
    }
    assert!(compared > 20, "{compared}");
}

#[test]
fn one_strand_is_told_over_time() {
    let (viewer, take) = (with_truth(), Take::open(&MADE.take).unwrap());
    let residual: Vec<f32> = take.store().read_all("fit/residual_mm").unwrap();
    let n = residual.iter().position(|r| r.is_finite()).unwrap();
    let json: Value = serde_json::from_slice(&viewer.body(&format!("/api/strand/blend/{n}"))).unwrap();
    assert_eq!(json["frames"], serde_json::json!([0, 1, 2, 3]));
    let mut shares = 0.0;
    for t in 0..synthetic::FRAMES {
        let frame = stored(&take, "blend", t);
        let own = &frame.points[n * frame.point_count..(n + 1) * frame.point_count];
        let expected = present_length(own);
        assert!(json["length_mm"][t].as_f64().zip(expected).is_none_or(|(a, b)| (a - b).abs() < 1e-3), "{json}");
        assert_eq!(json["length_mm"][t].is_null(), expected.is_none());
        let observed = (0..own.len()).filter(|k| frame.provenance[n * frame.point_count + k] == Provenance::Observed);
        shares += observed.count() as f64;
    }
    assert!((json["residual_mm"].as_f64().unwrap() - f64::from(residual[n])).abs() < 1e-9);
    let parameters: Vec<f32> = take.store().read("fit/parameters", &[n..n + 1, 0..9]).unwrap();
    assert!(
        (json["parameters"]["k_bend"].as_f64().unwrap() - f64::from(parameters[1])).abs()
            < 1e-6 * f64::from(parameters[1])
    );
    assert_eq!(json["parameters"].as_object().unwrap().len(), 9);
    let provenance = json["provenance"].as_object().unwrap();
    assert!((provenance.values().map(|v| v.as_f64().unwrap()).sum::<f64>() - 1.0).abs() < 1e-9);
    assert_eq!(shares > 0.0, provenance["observed"].as_f64().unwrap() > 0.0);
    for list in ["speed_mm_s", "relative_speed_mm_s", "error_mm"] {
        assert_eq!(json[list].as_array().unwrap().len(), 4, "{list}");
        assert!(json[list].as_array().unwrap().iter().any(|v| v.as_f64().is_some_and(|v| v >= 0.0)), "{list}");
    }
    for set in ["truth", "grow", "animate%2Fown"] {
        let ends = floats(&viewer.body(&format!("/api/strands/{set}/0?points=2"))[16..]);
        let present = ends.chunks_exact(6).position(|ends| ends[0].is_finite()).unwrap();
        let json: Value = serde_json::from_slice(&viewer.body(&format!("/api/strand/{set}/{present}"))).unwrap();
        assert!(json["points"].as_u64().unwrap() > 0 && json.get("parameters").is_none(), "{set}: {json}");
    }
}

#[test]
fn layers_are_those_of_the_store() {
    let (viewer, take) = (with_truth(), Take::open(&MADE.take).unwrap());
    let dir = tempfile::tempdir().unwrap();
    let picture = |address: &str, name: &str| {
        let path = dir.path().join(name);
        std::fs::write(&path, viewer.body(address)).unwrap();
        strandflow_io::read_rgb(&path).unwrap()
    };
    let (shown, filmed) = (picture("/api/image/cam03/2", "a.jpg"), take.images().image(3, 2).unwrap());
    assert_eq!((shown.width, shown.height), (filmed.width, filmed.height));
    let off = |(a, b): (&[u8; 3], &[u8; 3])| (0..3).map(|k| f64::from(a[k].abs_diff(b[k]))).sum::<f64>() / 3.0;
    let mean = shown.data.iter().zip(&filmed.data).map(off).sum::<f64>() / shown.data.len() as f64;
    assert!(mean < 6.0, "{mean}");
    assert_eq!(picture("/api/image/cam03/2?width=64", "small.jpg").width, 64);

    let (mask, masks) = (picture("/api/mask/cam01/2", "mask.png"), take.read_masks(1, 2).unwrap());
    let hair = mask.data.iter().zip(&masks.hair.data).filter(|(_, hair)| **hair >= 128);
    assert!(hair.clone().count() > 50 && hair.clone().all(|(pixel, _)| *pixel == [255, 140, 40]));
    let (map, stored_map) = (picture("/api/orientation/cam01/2", "map.png"), take.read_orientation(1, 2).unwrap());
    let trusted =
        stored_map.confidence.data.iter().zip(&stored_map.angle.data).zip(&map.data).filter(|((c, _), _)| **c > 0.1);
    let right = |((_, angle), pixel): &((&f32, &f32), &[u8; 3])| {
        **pixel == strandflow_report::hue::colour_of_angle(**angle, 1.0)
    };
    assert!(trusted.clone().count() > 20 && trusted.clone().all(|t| right(&t)));

    let scalp = take.read_scalp().unwrap();
    let body = viewer.body("/api/mesh/head");
    let (vertices, faces) = (scalp.mesh.vertices.len(), scalp.mesh.faces.len());
    assert_eq!(header(&body), [MAGIC, vertices as u32, faces as u32, 0]);
    assert_eq!(body.len(), 16 + 12 * (vertices + faces));
    assert_eq!(points(&body[16..28])[0], scalp.mesh.vertices[0].as_vec3());

    let body = viewer.body("/api/mesh/hull/1");
    let [_, vertices, faces, _] = header(&body);
    let hull = take.read_hull(1).unwrap();
    assert!(vertices > 100 && faces > 200);
    // Every vertex lies within two voxels of one that is occupied.
    for point in points(&body[16..16 + 12 * vertices as usize]) {
        let near = |k: usize| {
            let step = |axis: usize| (k / 5usize.pow(axis as u32) % 5) as f64 - 2.0;
            hull.contains(point.as_dvec3() + DVec3::new(step(0), step(1), step(2)) * hull.grid.voxel_mm)
        };
        assert!((0..125).any(near), "{point}");
    }

    let lines = take.read_lines(2).unwrap();
    let body = viewer.body("/api/lines/2");
    assert_eq!((header(&body)[1], body.len()), (lines.len() as u32, 16 + 28 * lines.len()));
    let row = &floats(&body[16..])[7 * (lines.len() - 1)..];
    let last = lines.grid.centre_of_index(lines.indices[lines.len() - 1] as usize).as_vec3();
    assert!(Vec3::from_slice(row) == last && row[6] == lines.values[lines.len() - 1].confidence);
    let flow = take.read_flow(2).unwrap();
    let body = viewer.body("/api/arrows/2?most=7");
    assert_eq!((header(&body)[1], body.len()), (7, 16 + 24 * 7));
    assert_eq!(Vec3::from_slice(&floats(&body[16..])[3..]), flow.values[0]);

    let body = viewer.body("/api/project/fit/cam04/1?points=3&stride=50");
    let at = points(&viewer.body("/api/strands/fit/1?points=3&stride=50")[16..]);
    let pixels = floats(&body[16..]);
    assert_eq!((header(&body)[1..3].to_vec(), pixels.len()), (vec![at.len() as u32 / 3, 3], 2 * at.len()));
    for (point, uv) in at.iter().zip(pixels.chunks_exact(2)) {
        let expected = project(&take.rig().cameras[4], point.as_dvec3()).filter(|_| point.is_finite());
        assert!(
            expected
                .map_or(uv[0].is_nan(), |e| (e.as_vec2() - Vec3::new(uv[0], uv[1], 0.0).truncate()).length() < 1e-2)
        );
    }
}

#[test]
fn only_this_machine_with_the_token_is_answered() {
    let before = bytes_below(&MADE.take);
    let viewer = with_truth();
    let token = format!("Authorization: Bearer {}", viewer.token);
    let ask = |path: &str, headers: &[&str]| viewer.ask("GET", path, headers).status;
    let host = "Host: localhost:9999";
    assert_eq!(ask("/api/take", &[host, &token]), 200);
    assert_eq!(ask("/api/take", &[host]), 401);
    assert_eq!(ask(&format!("/api/take?token={}", viewer.token), &[host]), 401);
    assert_eq!(ask("/api/strands/blend/0", &[host, "Authorization: Bearer 0123456789abcdef0123456789abcdef"]), 401);
    for other in ["Host: example.org", "Host: 192.168.0.7:8470", "Host: 127.0.0.1.example.org"] {
        assert_eq!(ask("/api/take", &[other, &token]), 403);
        assert_eq!(ask("/app.js", &[other]), 403);
    }
    // The page holds no data.
    ["/", "/app.js", "/app.css"].iter().for_each(|path| assert_eq!(ask(path, &[host]), 200));
    assert_eq!(viewer.ask("POST", "/api/take", &[host, &token, "Content-Length: 0"]).status, 405);
    let page = viewer.ask("GET", &format!("/?token={}", viewer.token), &[host]);
    assert!(page.status == 200 && String::from_utf8(page.body).unwrap().contains("<title>"));
    let policy = &page.headers["content-security-policy"];
    assert!(
        policy.contains("default-src 'none'") && policy.contains("script-src 'self'") && !policy.contains("unsafe")
    );
    assert_eq!(
        (page.headers["cache-control"].as_str(), page.headers["x-content-type-options"].as_str()),
        ("no-store", "nosniff")
    );
    let refused = viewer.ask("GET", "/api/take", &[host]);
    assert_eq!(refused.headers["cache-control"], "no-store");
    let told: Value = serde_json::from_slice(&refused.body).unwrap();
    assert!(told["error"].as_str().unwrap().contains("token") && !told["hint"].as_str().unwrap().is_empty());
    assert!(bytes_below(&MADE.take) == before, "a look changes nothing in the take");
}

#[test]
fn what_is_not_there_is_told_with_its_place() {
    let viewer = with_truth();
    let bare = Viewer::of(&MADE.take, &[]);
    let told = |viewer: &Viewer, path: &str, status: u16, words: &[&str]| {
        let answer = viewer.get(path);
        let json: Value = serde_json::from_slice(&answer.body).unwrap_or_else(|e| panic!("{path}: {e}"));
        let (error, hint) = (json["error"].as_str().unwrap(), json["hint"].as_str().unwrap());
        assert_eq!(answer.status, status, "{path}: {error}");
        assert!(!hint.is_empty());
        words
            .iter()
            .for_each(|w| assert!(error.contains(w) || hint.contains(w), "{path}: `{w}` is not in {error}: {hint}"));
    };
    for (path, status, words) in [
        ("/api/nothing", 404, &["address"][..]),
        ("/api/strands/none/0", 404, &["`none`"]),
        ("/api/strands/animate%2Fnone/0", 404, &["animate/none"]),
        ("/api/strands/blend", 400, &["`blend`"]),
        ("/api/strands/blend/4", 404, &["blend", "frame 4", "0..4"]),
        ("/api/strands/animate%2Fown/2", 404, &["frame 2"]),
        ("/api/strands/blend/x", 400, &["`x`"]),
        ("/api/strands/blend/0?count=601", 400, &["strand 600", "600"]),
        ("/api/strands/blend/0?stride=0", 400, &["stride=0"]),
        ("/api/strands/blend/0?points=1", 400, &["points=1"]),
        ("/api/strands/blend/0?bits=24", 400, &["bits=24"]),
        ("/api/strands/blend/0?colour=red", 400, &["`colour`"]),
        ("/api/attribute/blend/rejected/0", 404, &["rejected", "provenance"]),
        ("/api/attribute/grow/residual/0", 404, &["residual"]),
        ("/api/attribute/blend/speed/9", 404, &["frame 9"]),
        ("/api/strand/blend/600", 404, &["strand 600", "600"]),
        ("/api/image/cam09/0", 404, &["`cam09`", "cam00"]),
        ("/api/image/cam00/4", 404, &["frame 4", "4 frames"]),
        ("/api/image/cam00/0?width=2", 400, &["width=2"]),
        ("/api/mask/cam00/9", 404, &["masks/masks/view00/000009"]),
        ("/api/orientation/0/0", 404, &["`0`"]),
        ("/api/project/blend/cam5/0", 404, &["`cam5`"]),
        ("/api/mesh/hull/77", 404, &["000077"]),
        ("/api/lines/77", 404, &["000077"]),
        ("/api/arrows/1?most=0", 400, &["most=0"]),
    ] {
        told(&viewer, path, status, words);
    }
    told(&bare, "/api/strands/truth/0", 404, &["`truth`"]);
    told(&bare, "/api/attribute/blend/error/0", 404, &["--truth"]);
}

#[test]
fn unfinished_takes_and_takes_without_footage_show_what_they_have() {
    let root = tempfile::tempdir().unwrap();
    let (capture, take) = crate::common::take(root.path());
    let before = bytes_below(&take);
    let json = |viewer: &Viewer| serde_json::from_slice::<Value>(&viewer.body("/api/take")).unwrap();
    {
        // Never run: the cameras and the footage.
        let viewer = Viewer::of(&take, &[]);
        let json = json(&viewer);
        assert_eq!(
            (&json["sets"], &json["frames"]),
            (&serde_json::json!([]), &serde_json::json!([0, crate::common::FRAMES]))
        );
        assert!(json["views"][1]["footage"] == true && json["layers"]["masks"] == false);
        assert!(json["notes"].to_string().contains("not been run"));
        assert!(json["stages"][3]["state"] == "none" && json["world_from_head"]["poses"] == serde_json::json!([]));
        // What the cameras look at: the ball around the origin.
        assert!((0..3).all(
            |k| json["bounds"]["lo"][k].as_f64().unwrap() < 0.0 && json["bounds"]["hi"][k].as_f64().unwrap() > 0.0
        ));
        viewer.body("/api/image/cam1/3");
        assert_eq!((viewer.get("/api/strands/blend/0").status, viewer.get("/api/mesh/head").status), (404, 404));
        assert_eq!(bytes_below(&take), before, "nothing is made in a take that was never run");
    }
    let run = strandflow(&["run", text(&take), "--to", "hull"]);
    assert!(run.status.success(), "{}", stderr(&run));
    for gone in ["images", "calibration.json"] {
        std::fs::rename(capture.join(gone), capture.join("gone")).unwrap();
        let viewer = Viewer::of(&take, &[]);
        let json = json(&viewer);
        assert!(
            json["layers"]["hull"] == true && json["layers"]["lines"] == false && json["stages"][1]["state"] == "done"
        );
        viewer.body("/api/mesh/hull/2");
        if gone == "images" {
            assert!(json["views"][0]["footage"] == false && viewer.get("/api/image/cam0/0").status == 404);
            viewer.body("/api/mask/cam0/1");
        } else {
            assert!(json["views"] == serde_json::json!([]) && viewer.get("/api/mask/cam0/1").status == 404);
        }
        assert!(!json["notes"][0]["hint"].as_str().unwrap().is_empty());
        std::fs::rename(capture.join("gone"), capture.join(gone)).unwrap();
    }
}

#[test]
fn bad_input_is_told_and_ctrl_c_ends_well() {
    let root = tempfile::tempdir().unwrap();
    assert_bad_input(&strandflow(&["view", text(&root.path().join("none"))]), &["none", "no manifest"]);
    let no_truth = strandflow(&["view", text(&MADE.take), "--truth", text(root.path())]);
    assert_bad_input(&no_truth, &["strands_000000.npz"]);
    let viewer = Viewer::of(&MADE.take, &[]);
    let port = viewer.port.to_string();
    assert_bad_input(&strandflow(&["view", text(&MADE.take), "--port", &port]), &[&port, "in use"]);
    #[cfg(unix)]
    {
        let (said, well) = viewer.interrupt();
        assert!(well && said.contains(&format!("ssh -N -L {port}:127.0.0.1:{port}")), "{said}");
        assert_eq!(said.contains("cargo xtask web"), !strandflow_view::page::IS_BUILT);
    }
}

/// The page in a real Chromium, driven by `web/test/view.mjs`; its pictures stay in the target folder.
#[test]
fn view_page() {
    let Some(web) = pages() else { return };
    let viewer = with_truth();
    let shots = Path::new(env!("CARGO_TARGET_TMPDIR")).join("view_page");
    let run =
        Command::new("node").current_dir(&web).args(["test/view.mjs", &viewer.url()]).arg(&shots).output().unwrap();
    let said = String::from_utf8_lossy(&run.stdout);
    assert!(run.status.success(), "{said}{}", stderr(&run));
    let count = std::fs::read_dir(&shots).unwrap().count();
    assert!(count > 0, "no picture in {}", shots.display());
    println!("{said}{count} pictures in {}", shots.display());
}
