//! The hair at rest in the head frame: roots, combed strands over the head, locks, waves, edges of one length.

use glam::DVec3;
use rand::Rng;
use rayon::prelude::*;
use strandflow_core::TriMesh;

use crate::body::{Body, Skin};
use crate::head::{CRANIUM, NECK_END, distance, has_hair, normal, smooth_step};
use crate::motion::at_rest;
use crate::random::{normal as normal_number, signed, smooth_noise, stream};
use crate::spec::{GroomSpec, Style, SynthSpec};

/// The hair at rest, head frame \[mm\], root first. Any first part of the strands is spread evenly over the scalp.
#[derive(Clone, Debug, PartialEq)]
pub struct Groom {
    /// The strands; edges of one strand are of one length.
    pub strands: Vec<Vec<DVec3>>,
    /// Height above the skin that each strand keeps once away from its root \[mm\].
    pub layers: Vec<f64>,
    /// Brightness of each strand relative to the mean.
    pub brightness: Vec<f64>,
}

/// Grows the groom of a spec on the head's mesh.
pub fn groom(spec: &SynthSpec, mesh: &TriMesh) -> Groom {
    let g = &spec.groom;
    let skin = Skin { body: Body::of(spec), world_from_head: at_rest() };
    let roots = roots(spec, mesh);
    let layers: Vec<f64> = (0..roots.len()).map(|i| layer(spec, &roots, i)).collect();
    let combed: Vec<Vec<DVec3>> =
        (0..roots.len()).into_par_iter().map(|i| comb(spec, &skin, i, roots[i], layers[i])).collect();
    let locks = (roots.len() / 18).clamp(1, 600);
    let strands = (0..roots.len())
        .into_par_iter()
        .map(|i| {
            let lock = nearest(&roots[..locks], roots[i]);
            let mut line = gather(&combed[i], &combed[lock], g.clump);
            wave(spec, i, lock, &mut line);
            for (k, p) in line.iter_mut().enumerate().skip(1) {
                let rise = (k as f64 * g.edge_mm * 0.35).min(layers[i]).min(spec.physics.clearance_mm + 0.5);
                *p = skin.push_out(*p, rise);
            }
            even_edges(&line, g.edge_mm)
        })
        .collect();
    let brightness = (0..roots.len())
        .map(|i| {
            let mut rng = stream(spec.seed, &[3, i as u64]);
            let lock = nearest(&roots[..locks], roots[i]) as u64;
            let of_lock = normal_number(&mut stream(spec.seed, &[4, lock]));
            (g.colour_variation * (0.85 * normal_number(&mut rng) + 0.5 * of_lock)).clamp(-1.5, 1.5).exp()
        })
        .collect();
    Groom { strands, layers, brightness }
}

/// Roots by dart throwing with a shrinking distance: blue noise, and so is every first part of them (Cook 1986).
fn roots(spec: &SynthSpec, mesh: &TriMesh) -> Vec<DVec3> {
    let mut rng = stream(spec.seed, &[1]);
    let hairy = |f: usize| has_hair(mesh.corners(f).iter().sum::<DVec3>() / 3.0);
    let faces: Vec<usize> = (0..mesh.faces.len()).filter(|&f| hairy(f)).collect();
    let mut cumulative = Vec::with_capacity(faces.len());
    let mut area = 0.0;
    for &f in &faces {
        area += mesh.face_area(f);
        cumulative.push(area);
    }
    let count = spec.groom.strands;
    let mut cells = Cells::new((area / count as f64).sqrt());
    let (mut reach, mut misses) = ((area / 4.0).sqrt(), 0);
    let mut roots: Vec<DVec3> = Vec::with_capacity(count);
    while roots.len() < count {
        let at = rng.random::<f64>() * area;
        let f = faces[cumulative.partition_point(|&c| c < at).min(faces.len() - 1)];
        let [a, b, c] = mesh.corners(f);
        let (mut s, mut t): (f64, f64) = (rng.random(), rng.random());
        if s + t > 1.0 {
            (s, t) = (1.0 - s, 1.0 - t);
        }
        let p = a + (b - a) * s + (c - a) * t;
        if cells.any_within(&roots, p, reach) {
            misses += 1;
            if misses > 20 {
                (reach, misses) = (reach * 0.97, 0);
            }
            continue;
        }
        let p = p - normal(p) * distance(p);
        cells.insert(p, roots.len());
        roots.push(p);
        misses = 0;
    }
    roots
}

/// Roots by cell, for neighbour queries while they are thrown.
struct Cells {
    size: f64,
    map: std::collections::BTreeMap<[i32; 3], Vec<usize>>,
}

impl Cells {
    fn new(size: f64) -> Self {
        Self { size, map: Default::default() }
    }

    fn key(&self, p: DVec3) -> [i32; 3] {
        (p / self.size).floor().as_ivec3().to_array()
    }

    fn insert(&mut self, p: DVec3, index: usize) {
        self.map.entry(self.key(p)).or_default().push(index);
    }

    fn any_within(&self, roots: &[DVec3], p: DVec3, reach: f64) -> bool {
        let n = (reach / self.size).ceil() as i32;
        if (2 * n as usize + 1).pow(3) > roots.len() {
            return roots.iter().any(|r| r.distance_squared(p) < reach * reach);
        }
        let [x, y, z] = self.key(p);
        for dz in -n..=n {
            for dy in -n..=n {
                for dx in -n..=n {
                    let Some(cell) = self.map.get(&[x + dx, y + dy, z + dz]) else { continue };
                    if cell.iter().any(|&i| roots[i].distance_squared(p) < reach * reach) {
                        return true;
                    }
                }
            }
        }
        false
    }
}

/// Hair from higher on the head lies over hair from below it.
fn layer(spec: &SynthSpec, roots: &[DVec3], i: usize) -> f64 {
    let height = smooth_step((roots[i].z - CRANIUM.z + 60.0) / 130.0);
    let jitter = stream(spec.seed, &[2, i as u64]).random::<f64>();
    spec.physics.clearance_mm + 0.5 + spec.groom.layer_mm * (0.65 * height + 0.35 * jitter)
}

/// A smooth strand that leaves the scalp, follows the comb, falls, and stays outside of its layer's height.
fn comb(spec: &SynthSpec, skin: &Skin, i: usize, root: DVec3, layer: f64) -> Vec<DVec3> {
    let g = &spec.groom;
    let mut rng = stream(spec.seed, &[5, i as u64]);
    let step = g.edge_mm * 0.5;
    let n = normal(root);
    let length = g.length_mm * (0.86 + 0.14 * rng.random::<f64>());
    let cut = -g.cut_below_mm + 6.0 * signed(&mut rng);
    let wander = |k: u64| 0.12 * smooth_noise(spec.seed ^ k, root / 22.0);
    let disorder = DVec3::new(wander(11), wander(12), wander(13)) + 0.05 * normal_number(&mut rng) * DVec3::X;
    let mut d = (n * 0.45 + combed_direction(g, root, n) + disorder).normalize_or(n);
    let mut line = vec![root];
    let mut p = root;
    let steps = (length / step).round() as usize;
    for k in 1..=steps {
        let walked = k as f64 * step;
        let least = (walked * 0.45).min(layer);
        let bend = step / (14.0 + 0.25 * layer);
        let mut next = d + DVec3::NEG_Z * bend;
        let height = distance(p);
        if height < layer + 6.0 {
            let n = normal(p);
            next -= n * (next.dot(n) * bend * 2.0 * (height / layer.max(1.0)).min(1.0));
        }
        d = next.normalize_or(d);
        let q = skin.push_out(p + d * step, least);
        d = (q - p).normalize_or(d);
        p += d * step;
        line.push(p);
        let neck_ends = p.z < NECK_END + 10.0 && g.cut_below_mm < -NECK_END;
        if (p.z < cut || neck_ends) && walked > 25.0 {
            break;
        }
    }
    line
}

/// Where the comb draws the hair at a root: away from the crown, or to the sides of a part.
fn combed_direction(g: &GroomSpec, root: DVec3, n: DVec3) -> DVec3 {
    let crown = CRANIUM + DVec3::new(4.0, 45.0, 72.0);
    let away = (root - crown).normalize_or(DVec3::NEG_Z);
    let front = smooth_step((30.0 - root.y) / 60.0);
    let side = DVec3::new(if root.x < 0.0 { -1.0 } else { 1.0 }, 0.45, -0.3);
    let top = smooth_step((root.z - CRANIUM.z - 5.0) / 50.0);
    let parted = if g.part { (0.85 * top).max(front) } else { front };
    let t = away * (1.0 - parted) + side * parted;
    (t - n * t.dot(n)).normalize_or(DVec3::NEG_Z)
}

/// Draws a strand towards its lock, more towards the tip (Watanabe and Suenaga 1992's wisps).
fn gather(line: &[DVec3], lock: &[DVec3], clump: f64) -> Vec<DVec3> {
    let last = (line.len() - 1).max(1) as f64;
    line.iter()
        .enumerate()
        .map(|(k, &p)| {
            let centre = lock[k.min(lock.len() - 1)];
            let share = k as f64 / last;
            let near = (1.0 - p.distance(centre) / 35.0).max(0.0);
            p.lerp(centre, clump * share.powf(1.5) * near)
        })
        .collect()
}

/// Adds the waves or curls of a strand and its small disorder, in a frame carried along the strand.
fn wave(spec: &SynthSpec, i: usize, lock: usize, line: &mut [DVec3]) {
    let g = &spec.groom;
    let mut of_lock = stream(spec.seed, &[6, lock as u64]);
    let mut own = stream(spec.seed, &[7, i as u64]);
    let lock_phase = std::f64::consts::TAU * of_lock.random::<f64>();
    let phase = lock_phase + 0.35 * normal_number(&mut own);
    let (own_size, tilt) = (1.0 + 0.15 * normal_number(&mut own), std::f64::consts::TAU * of_lock.random::<f64>());
    let hand = if of_lock.random::<bool>() { 1.0 } else { -1.0 };
    let wave_length = g.wave_length_mm * (1.0 + 0.12 * signed(&mut of_lock));
    let frizz_seed = own.random::<u64>();
    let base = line.to_vec();
    let last = (base.len() - 1).max(1);
    let mut across = DVec3::X;
    let mut walked = 0.0;
    for k in 1..base.len() {
        let tangent = (base[(k + 1).min(last)] - base[k - 1]).normalize_or(DVec3::NEG_Z);
        across = (across - tangent * across.dot(tangent)).normalize_or(tangent.any_orthonormal_vector());
        let other = tangent.cross(across);
        walked += base[k].distance(base[k - 1]);
        let share = k as f64 / last as f64;
        let size = g.wave_mm
            * own_size
            * smooth_step((share - g.wave_from) / 0.35 + 0.15 * (1.0 - g.wave_from))
            * smooth_step(walked / 30.0);
        let turn = std::f64::consts::TAU * walked / wave_length + phase;
        let offset = match g.style {
            Style::Straight => DVec3::ZERO,
            Style::Wavy => (across * tilt.cos() + other * tilt.sin()) * turn.sin(),
            Style::Curly => across * turn.cos() + other * (hand * turn.sin()),
        };
        let frizz = |axis: u64| smooth_noise(frizz_seed ^ axis, DVec3::new(walked / 45.0, 0.3, 0.6));
        let disorder = (across * frizz(1) + other * frizz(2)) * (g.frizz_mm * smooth_step(walked / 40.0));
        line[k] = base[k] + offset * size + disorder;
    }
}

/// Resamples a line so that neighbouring points are `edge` apart in space; the last, shorter piece is dropped.
fn even_edges(line: &[DVec3], edge: f64) -> Vec<DVec3> {
    let mut out = vec![line[0]];
    let mut from = line[0];
    for pair in line.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        let mut start = 0.0;
        // The first crossing of the sphere of radius `edge` about the last point, as often as this piece has one.
        while let Some(t) = crossing(a, b, from, edge, start) {
            from = a.lerp(b, t);
            out.push(from);
            start = t;
        }
    }
    if out.len() < 2 {
        out.push(line[0] + normal(line[0]) * edge);
    }
    out
}

/// The smallest parameter above `start` at which the piece a–b leaves the sphere about `centre`.
fn crossing(a: DVec3, b: DVec3, centre: DVec3, radius: f64, start: f64) -> Option<f64> {
    let (d, m) = (b - a, a - centre);
    let (qa, qb, qc) = (d.length_squared(), m.dot(d), m.length_squared() - radius * radius);
    let root = qb * qb - qa * qc;
    if qa < 1e-12 || root < 0.0 {
        return None;
    }
    let t = (-qb + root.sqrt()) / qa;
    (t > start && t <= 1.0).then_some(t)
}

pub(crate) fn nearest(points: &[DVec3], p: DVec3) -> usize {
    let mut best = (f64::INFINITY, 0);
    for (i, q) in points.iter().enumerate() {
        let d = q.distance_squared(p);
        if d < best.0 {
            best = (d, i);
        }
    }
    best.1
}
