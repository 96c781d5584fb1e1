//! Children: the hairs that grow around each captured strand.
//!
//! A child keeps a place in its strand's cross-section. The cross-section is carried along the strand without twist
//! (parallel transport), from the scalp's tangent plane at the root; children come together towards the tips. All chance
//! comes from the strand's name and the number of the child, so a child is the same hair in every frame.

use std::f32::consts::{FRAC_1_PI, PI, TAU};

use glam::{DMat3, Mat3, Quat, Vec2, Vec3, Vec4};
use rayon::prelude::*;

use crate::{chance::Chance, scattering::ROUNDING, subject::Subject, thread::Vertex};

/// Share of a child's distance at the root that is left at the tip. At 1 hair has no locks; below 0.3 it looks wet.
const CLUMP: f32 = 0.4;

/// Share of a strand's length by which a child may be shorter: a cut is never exact, and blunt ends look like a wig's.
const SHORTER: f32 = 0.22;

/// Wander of a child at the tip \[mm\], one standard deviation; at the root none. Above 1.5 straight hair is frizzy.
const WANDER_MM: f32 = 0.55;

/// Share of children that stray, and how much more they wander.
const STRAYS: f32 = 0.03;
const STRAY: f32 = 4.5;

/// Length over which the cross-section turns from the scalp's plane to the strand's \[mm\].
const ROOTED_MM: f32 = 14.0;

/// A point of a hair and its motion from one frame to the next \[mm\].
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Point {
    /// World.
    pub at: Vec3,
    /// Over one frame.
    pub motion: Vec3,
}

/// All hairs, those of one strand after one another.
pub(crate) struct Grown {
    /// Points, world \[mm\]; a strand's hairs have equally many.
    pub points: Vec<Vec3>,
    /// The same points in the picture.
    pub vertices: Vec<Vertex>,
    /// Where each strand's hairs begin in `points`; one more than strands.
    pub starts: Vec<usize>,
    /// Points of a hair, by strand.
    pub counts: Vec<usize>,
    /// Hairs of a strand.
    pub density: usize,
}

/// How children are made.
pub(crate) struct Growth {
    /// Hairs a strand, the strand itself being the first.
    pub density: usize,
    /// Pieces into which an edge of a strand is rounded.
    pub pieces: usize,
    /// Rounds of polishing.
    pub polish: usize,
    /// Chance.
    pub seed: u64,
}

impl Grown {
    /// Grows the children of all strands. `seen` says where the points of a hair lie in the picture: while they are at
    /// hand, so that their motion is never stored.
    pub(crate) fn new(subject: &Subject, growth: &Growth, seen: impl Fn(&[Point], &mut [Vertex]) + Sync) -> Self {
        let hair = subject.hair;
        let counts: Vec<usize> = (0..hair.strand_count())
            .map(|n| match hair.strand(n).len() {
                0 | 1 => 0,
                points => (points - 1) * growth.pieces + 1,
            })
            .collect();
        let starts = starts(counts.iter().map(|count| count * growth.density));
        let mut points: Vec<Vec3> = touched(starts[counts.len()], || Vec3::ZERO);
        let mut vertices: Vec<Vertex> = touched(points.len(), Vertex::default);
        let cell = Cell::of(subject);
        let parts = (slices(&mut points, &starts), slices(&mut vertices, &starts));
        parts.into_par_iter().enumerate().for_each(|(n, (points, vertices))| {
            let count = counts[n];
            if count == 0 {
                return;
            }
            let range = hair.offsets[n]..hair.offsets[n + 1];
            let mut own: Vec<Point> = range.map(|i| Point { at: hair.points[i], motion: hair.motion[i] }).collect();
            polish(&mut own, growth.polish);
            let strand = Strand::new(rounded(&own, growth.pieces), &cell);
            let seed = growth.seed ^ u64::from(hair.names[n]) << 20;
            let mut grown = vec![Point::default(); count];
            for (child, (points, vertices)) in points.chunks_mut(count).zip(vertices.chunks_mut(count)).enumerate() {
                strand.child(&cell, seed, child as u64, &mut grown);
                seen(&grown, vertices);
                points.iter_mut().zip(&grown).for_each(|(out, point)| *out = point.at);
            }
        });
        Self { points, vertices, starts, counts, density: growth.density }
    }
}

/// Values to be overwritten, made on all threads: with tens of millions of them half of the time would go into the system's
/// handing out of memory to one thread.
pub(crate) fn touched<T: Send>(count: usize, value: impl Fn() -> T + Sync + Send) -> Vec<T> {
    (0..count).into_par_iter().with_min_len(1 << 14).map(|_| value()).collect()
}

/// Sums before each, and the whole.
fn starts(sizes: impl Iterator<Item = usize>) -> Vec<usize> {
    let mut out = vec![0];
    for size in sizes {
        out.push(out[out.len() - 1] + size);
    }
    out
}

/// The parts of a slice that begin at `starts`.
fn slices<'a, T>(mut rest: &'a mut [T], starts: &[usize]) -> Vec<&'a mut [T]> {
    let mut out = Vec::with_capacity(starts.len());
    for pair in starts.windows(2) {
        let (part, after) = rest.split_at_mut(pair[1] - pair[0]);
        out.push(part);
        rest = after;
    }
    out
}

/// The room that a strand has among its neighbours, and the scalp under it.
struct Cell {
    middle: Vec3,
    axes: Mat3,
    reach_mm: f32,
}

impl Cell {
    fn of(subject: &Subject) -> Self {
        let axes: DMat3 = subject.world_from_head().rotation;
        Self { middle: subject.middle().as_vec3(), axes: axes.as_mat3(), reach_mm: 0.85 * spacing(subject) }
    }

    /// Two unit vectors along the scalp at a root, and the normal; they turn with the head.
    fn scalp(&self, root: Vec3) -> [Vec3; 3] {
        let normal = (root - self.middle).normalize_or(self.axes.z_axis);
        let across = self.axes.x_axis.cross(normal);
        let across = if across.length() > 0.1 { across } else { self.axes.y_axis.cross(normal) };
        let u = across.normalize_or(self.axes.y_axis);
        [u, normal.cross(u), normal]
    }
}

/// Distance of neighbouring roots \[mm\]: the median of some, in quarters, so that a strand that comes or goes changes nothing.
fn spacing(subject: &Subject) -> f32 {
    const ASKED: usize = 199;
    let hair = subject.hair;
    let roots: Vec<Vec3> = (0..hair.strand_count()).filter_map(|n| hair.strand(n).first().copied()).collect();
    let step = (roots.len() / ASKED).max(1);
    let mut nearest: Vec<f32> = (0..roots.len())
        .step_by(step)
        .map(|i| {
            let far = |&(j, _): &(usize, &Vec3)| j != i;
            let squares = roots.iter().enumerate().filter(far).map(|(_, q)| q.distance_squared(roots[i]));
            squares.fold(f32::INFINITY, f32::min).sqrt()
        })
        .collect();
    nearest.sort_by(f32::total_cmp);
    let median = nearest.get(nearest.len() / 2).copied().unwrap_or(0.0);
    // A single strand has no neighbour; beyond 6 mm children would no longer be of this strand.
    if median.is_finite() { (median * 4.0).round().clamp(1.0, 24.0) / 4.0 } else { 2.0 }
}

/// A strand with its untwisted cross-sections.
struct Strand {
    points: Vec<Point>,
    frames: Vec<[Vec3; 2]>,
    arc: Vec<f32>,
    scalp: [Vec3; 2],
}

impl Strand {
    fn new(points: Vec<Point>, cell: &Cell) -> Self {
        let last = points.len() - 1;
        let tangent = |k: usize| (points[(k + 1).min(last)].at - points[k.saturating_sub(1)].at).normalize_or(Vec3::Z);
        let [u, v, normal] = cell.scalp(points[0].at);
        let mut turn = Quat::from_rotation_arc(normal, tangent(0));
        let mut frames = vec![[turn * u, turn * v]];
        let mut arc = vec![0.0];
        for k in 1..=last {
            turn = Quat::from_rotation_arc(tangent(k - 1), tangent(k)) * turn;
            frames.push([turn * u, turn * v]);
            arc.push(arc[k - 1] + points[k].at.distance(points[k - 1].at));
        }
        Self { points, frames, arc, scalp: [u, v] }
    }

    /// The `child`-th hair; hair 0 is the strand itself.
    fn child(&self, cell: &Cell, seed: u64, child: u64, out: &mut [Point]) {
        if child == 0 {
            out.copy_from_slice(&self.points);
            return;
        }
        let mut chance = Chance::of(seed, child);
        let place = Vec2::from_angle(chance.share() * TAU) * (chance.share().sqrt() * cell.reach_mm);
        let end = 1.0 - SHORTER * chance.share().powi(2);
        let stray = if chance.share() < STRAYS { STRAY } else { 1.0 };
        let wander = WANDER_MM * stray;
        // Two waves a direction, 40 to 160 mm long.
        let waves: [[f32; 3]; 4] =
            std::array::from_fn(|_| [chance.normal() * wander, 0.04 + 0.12 * chance.share(), chance.share() * TAU]);
        let [height, per_mm, phase] = [0, 1, 2].map(|i| Vec4::from_array(waves.map(|wave| wave[i])));
        let at_root = sines(phase);
        let last = self.points.len() - 1;
        for (k, out) in out.iter_mut().enumerate() {
            let along = k as f32 * end;
            let i = (along as usize).min(last - 1);
            let f = along - i as f32;
            let (a, b) = (&self.points[i], &self.points[i + 1]);
            let arc = self.arc[i] + (self.arc[i + 1] - self.arc[i]) * f;
            let share = arc / self.arc[last].max(1e-3);
            let wave = height * (sines(per_mm * arc + phase) - at_root);
            let gather = 1.0 - (1.0 - CLUMP) * share * share * (3.0 - 2.0 * share);
            let x = place.x * gather + (wave.x + wave.y) * share;
            let y = place.y * gather + (wave.z + wave.w) * share;
            let free = (arc / ROOTED_MM).min(1.0);
            let axis = |d: usize| {
                let frame = self.frames[i][d].lerp(self.frames[i + 1][d], f);
                self.scalp[d].lerp(frame, free)
            };
            *out = Point { at: a.at.lerp(b.at, f) + axis(0) * x + axis(1) * y, motion: a.motion.lerp(b.motion, f) };
        }
    }
}

/// The sines of four angles of up to 100 rad, to 1e-5: those of the rest after whole half turns by their Taylor series.
fn sines(angle: Vec4) -> Vec4 {
    let shifted = angle * FRAC_1_PI + ROUNDING;
    let rest = angle - (shifted - ROUNDING) * PI;
    let sign = Vec4::from_array(shifted.to_array().map(|turns| f32::from_bits(1f32.to_bits() | turns.to_bits() << 31)));
    let series = [1.0 / 362_880.0, -1.0 / 5040.0, 1.0 / 120.0, -1.0 / 6.0, 1.0];
    let square = rest * rest;
    sign * rest * series.into_iter().fold(Vec4::splat(-1.0 / 39_916_800.0), |sum, term| sum * square + term)
}

/// Takes the trembling of captured strands out and leaves their waves: each round smooths and then unsmooths a little more
/// (Taubin 1995). Ends stay. With edges of 5 mm, four rounds leave 0 of a zigzag, 34 % of a wave of 20 mm, 93 % of one of
/// 38 mm and all of one of 60 mm.
fn polish(points: &mut [Point], rounds: usize) {
    const SMOOTH: f32 = 0.5;
    const UNSMOOTH: f32 = -0.53;
    let mut moved = vec![Vec3::ZERO; points.len()];
    for by in std::iter::repeat_n([SMOOTH, UNSMOOTH], rounds).flatten() {
        for k in 1..points.len() - 1 {
            moved[k] = ((points[k - 1].at + points[k + 1].at) * 0.5 - points[k].at) * by;
        }
        points.iter_mut().zip(&moved).for_each(|(p, by)| p.at += *by);
    }
}

/// A smooth curve through the points with `pieces` pieces an edge (Catmull and Rom 1974).
fn rounded(points: &[Point], pieces: usize) -> Vec<Point> {
    if pieces < 2 {
        return points.to_vec();
    }
    let last = points.len() - 1;
    let mut out = vec![points[0]];
    for k in 0..last {
        let [a, b, c, d] = [points[k.saturating_sub(1)], points[k], points[k + 1], points[(k + 2).min(last)]];
        for s in 1..=pieces {
            let t = s as f32 / pieces as f32;
            let curve = b.at * 2.0
                + (c.at - a.at) * t
                + (a.at * 2.0 - b.at * 5.0 + c.at * 4.0 - d.at) * (t * t)
                + (b.at * 3.0 - a.at - c.at * 3.0 + d.at) * (t * t * t);
            out.push(Point { at: curve * 0.5, motion: b.motion.lerp(c.motion, t) });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::subject::Hair;

    fn bundle(shift: Vec3) -> Hair {
        let mut hair = Hair::default();
        for n in 0..50u32 {
            let root = Vec3::new((n % 10) as f32 * 3.0, (n / 10) as f32 * 3.0, 0.0) + shift;
            let strand: Vec<Vec3> =
                (0..30).map(|k| root + Vec3::new(0.0, 0.02 * (k * k) as f32, 5.0 * k as f32)).collect();
            hair.push(n, &strand, &[]);
        }
        hair
    }

    #[test]
    fn sines_are_those_of_the_library() {
        for i in 0..10_000 {
            let angle = 0.01 * i as f32;
            let got = sines(Vec4::new(angle, 0.5 * angle, 0.0, TAU)).to_array();
            for (got, wanted) in got.into_iter().zip([angle.sin(), (0.5 * angle).sin(), 0.0, 0.0]) {
                assert!((got - wanted).abs() < 1e-5, "{got} for {wanted} of {angle}");
            }
        }
    }

    #[test]
    fn polishing_takes_trembling_and_leaves_waves() {
        let amplitude = |edges: f32| {
            let wave = |k: usize| 3.0 * (TAU * k as f32 / edges).cos();
            let point = |k| Point { at: Vec3::new(wave(k), 0.0, 5.0 * k as f32), motion: Vec3::ZERO };
            let mut points: Vec<Point> = (0..61).map(point).collect();
            polish(&mut points, 4);
            points[24..36].iter().map(|p| p.at.x).fold(0.0, f32::max) / 3.0
        };
        assert!(amplitude(2.0) < 0.02 && amplitude(12.0) > 0.97, "{} {}", amplitude(2.0), amplitude(12.0));
    }

    #[test]
    fn children_stay_with_their_strand_and_move_with_it() {
        let growth = Growth { density: 8, pieces: 1, polish: 2, seed: 3 };
        let grown = |hair: &Hair| Grown::new(&Subject { hair, head: None }, &growth, |_, _| ());
        let (here, there) = (grown(&bundle(Vec3::ZERO)), grown(&bundle(Vec3::new(40.0, -20.0, 7.0))));
        let moved = here.points.iter().zip(&there.points).map(|(a, b)| *b - *a - Vec3::new(40.0, -20.0, 7.0));
        assert!(moved.map(Vec3::length).fold(0.0, f32::max) < 1e-2, "a child is the same hair in every frame");
        let hair = bundle(Vec3::ZERO);
        for n in 0..50 {
            let children = &here.points[here.starts[n]..here.starts[n + 1]];
            for child in children.chunks(30) {
                assert!(child[0].distance(hair.strand(n)[0]) < 3.0);
                let near = hair.strand(n).iter().map(|p| p.distance(child[29])).fold(f32::INFINITY, f32::min);
                assert!(near < 16.0, "{near} mm from its strand");
            }
        }
    }
}
