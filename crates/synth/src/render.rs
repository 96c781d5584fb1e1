//! Pictures and masks of a frame, in every view.

use glam::{DVec2, DVec3, Vec2, Vec3};
use rayon::prelude::*;
use strandflow_core::{Camera, Mask, Plane, RgbImage, RigidTransform};

use crate::light::{Density, Light, density_grid, fibre, lights};
use crate::picture::{careless, expose};
use crate::raster::{BACKGROUND, Band, HAIR, MARKER, Vertex};
use crate::scene::{MARKER_COLOURS, MARKER_RADIUS_MM, Scene};
use crate::spec::Style;

/// Rows of pixels that are rendered as one piece of work.
const BAND_ROWS: usize = 8;

/// Share of a marker that a person must see to click it.
const CLICKABLE: f64 = 0.6;

/// What a camera records of a frame, with its truth.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// The image.
    pub image: RgbImage,
    /// Coverage by hair (before lens blur).
    pub hair: Mask,
    /// Coverage by head, hair and markers.
    pub subject: Mask,
    /// Image points of the markers \[px\]; `None` behind the camera.
    pub markers: Vec<Option<DVec2>>,
    /// Share of each marker's disc that is seen, 0 to 1.
    pub visible: Vec<f64>,
}

/// The clicks a person makes in frame 0: per marker, per view, the image point where it can be seen \[px\].
pub type MarkerLabels = Vec<Vec<Option<DVec2>>>;

impl Scene {
    /// The view without the subject.
    pub fn plate(&self, view: usize) -> RgbImage {
        expose(&self.spec, view, u64::MAX, &self.plates[view])
    }

    /// All views of a frame.
    pub fn render(&self, frame: usize) -> Vec<Picture> {
        let in_step = self.delays.iter().all(|&d| d == 0.0).then(|| self.lit(frame as f64));
        (0..self.rig.view_count())
            .map(|view| match &in_step {
                Some(lit) => self.picture(view, frame, lit),
                None => self.render_view(view, frame),
            })
            .collect()
    }

    /// One view of a frame.
    pub fn render_view(&self, view: usize, frame: usize) -> Picture {
        self.picture(view, frame, &self.lit(frame as f64 + self.delays[view]))
    }

    /// The marker labels of frame 0 from its pictures: clicks, with their error, on markers that can be seen.
    pub fn marker_labels(&self, first: &[Picture]) -> MarkerLabels {
        (0..self.markers.len())
            .map(|m| {
                let seen = |v: usize| first[v].markers[m].filter(|_| first[v].visible[m] >= CLICKABLE);
                (0..first.len()).map(|v| seen(v).map(|at| self.clicked(v, m, at))).collect()
            })
            .collect()
    }

    /// The hair mask that a user gives for a view, from its picture of frame 0: with the error of `noise.mask_px`.
    pub fn given_hair_mask(&self, view: usize, first: &Picture) -> Mask {
        careless(&self.spec, view, &first.hair)
    }

    /// Strands and head with the light that reaches them.
    fn lit(&self, frame: f64) -> Lit {
        let (strands, world_from_head) = self.moment(frame);
        let density = Density::new(&self.spec, &strands, &self.head_opacity, density_grid(&self.spec));
        let to_head = world_from_head.inverse();
        let lights = lights();
        let local: Vec<Vec3> = lights.iter().map(|l| to_head.vector(l.towards.as_dvec3()).as_vec3()).collect();
        let reaching = |p: DVec3| -> [f32; 4] {
            std::array::from_fn(|l| lights[l].strength * density.transmittance(p.as_vec3(), local[l]))
        };
        let pieces = if self.spec.groom.style == Style::Straight { 1 } else { 2 };
        let fibres = strands
            .par_iter()
            .enumerate()
            .map(|(i, strand)| {
                let fine = rounded(strand, pieces);
                // Light changes slowly along a strand: every second point is enough.
                let light: Vec<[f32; 4]> = strand.iter().step_by(2).map(|&p| reaching(p)).collect();
                Fibre {
                    points: fine.iter().map(|&p| world_from_head.point(p)).collect(),
                    light: (0..fine.len()).map(|k| between(&light, k, 2 * pieces)).collect(),
                    colour: Vec3::from_array(self.spec.groom.colour.map(|c| c as f32))
                        * self.groom.brightness[i] as f32,
                    seed: crate::random::mix(self.spec.seed ^ (0xf1b3e + i as u64)),
                }
            })
            .collect();
        let normals: Vec<DVec3> = self.head.vertices.par_iter().map(|&v| crate::head::normal(v)).collect();
        let skin = (0..self.head.vertices.len())
            .into_par_iter()
            .map(|v| {
                let p = self.head.vertices[v];
                let n = normals[v].as_vec3();
                let light = reaching(p + normals[v] * 1.5);
                let direct: f32 = (0..4).map(|l| light[l] * (0.85 * n.dot(local[l]) + 0.15).max(0.0)).sum();
                let base =
                    if crate::head::has_hair(p) { Vec3::new(0.25, 0.16, 0.11) } else { Vec3::new(0.95, 0.66, 0.50) };
                (world_from_head.point(p), base * (0.62 * direct + 0.16))
            })
            .collect();
        Lit { fibres, skin, world_from_head, lights }
    }

    fn picture(&self, view: usize, frame: usize, lit: &Lit) -> Picture {
        let camera = &self.rig.cameras[view];
        let ss = self.spec.rig.subsamples;
        let lens = Lens { camera, ss };
        let skin: Vec<Vertex> = lit.skin.iter().map(|&(p, colour)| lens.vertex(p, colour)).collect();
        let hair: Vec<Vec<Vertex>> = lit.fibres.par_iter().map(|fibre| fibre.seen(&lens, &lit.lights)).collect();
        let balls: Vec<Vertex> =
            self.markers.iter().map(|&m| lens.vertex(lit.world_from_head.point(m), Vec3::ZERO)).collect();
        let bands = camera.height.div_ceil(BAND_ROWS);
        let hair_of_band =
            binned(&hair, bands, (BAND_ROWS * ss) as f32, lens.width(self.spec.groom.width_mm, &lit.fibres));
        let skin_of_band = binned_faces(&self.head.faces, &skin, bands, (BAND_ROWS * ss) as f32);
        let rows: Vec<Resolved> = (0..bands)
            .into_par_iter()
            .map(|b| {
                let first = b * BAND_ROWS;
                let last = (first + BAND_ROWS).min(camera.height);
                let mut band = Band::new(camera.width * ss, first * ss..last * ss);
                for &f in &skin_of_band[b] {
                    band.triangle(self.head.faces[f as usize].map(|v| &skin[v as usize]));
                }
                for &(i, k) in &hair_of_band[b] {
                    let (p, q) = (&hair[i as usize][k as usize], &hair[i as usize][k as usize + 1]);
                    let width = self.spec.groom.width_mm * camera.focal[0] * ss as f64 / p.depth as f64;
                    band.ribbon(p, q, width as f32);
                }
                let discs = self.draw_balls(&mut band, &lens, &balls, &lit.lights);
                self.resolve(view, &band, first..last, discs)
            })
            .collect();
        self.assemble(view, frame, rows)
    }

    /// Draws the marker balls and returns the samples of each one's disc.
    fn draw_balls(&self, band: &mut Band, lens: &Lens, balls: &[Vertex], lights: &[Light]) -> Vec<usize> {
        let r = lens.camera.camera_from_world.rotation;
        balls
            .iter()
            .enumerate()
            .map(|(m, ball)| {
                let radius = MARKER_RADIUS_MM * lens.camera.focal[0] * lens.ss as f64 / ball.depth as f64;
                let colour = Vec3::from_array(MARKER_COLOURS[m]);
                let shade = |n: Vec3| {
                    let world = (r.transpose() * DVec3::new(n.x as f64, n.y as f64, -n.z as f64)).as_vec3();
                    let direct: f32 =
                        lights.iter().map(|l| l.strength * (0.6 * world.dot(l.towards) + 0.4).max(0.0)).sum();
                    colour * (0.42 * direct + 0.25)
                };
                band.ball(ball, radius as f32, MARKER_RADIUS_MM as f32, MARKER + m as u8, shade)
            })
            .collect()
    }

    /// Averages the samples of each pixel of a band.
    fn resolve(&self, view: usize, band: &Band, rows: std::ops::Range<usize>, discs: Vec<usize>) -> Resolved {
        let (width, ss) = (self.spec.rig.width, self.spec.rig.subsamples);
        let mut out = Resolved { discs, seen: vec![0; self.markers.len()], ..Resolved::default() };
        let share = 1.0 / (ss * ss) as f32;
        for (y, row) in rows.enumerate() {
            for x in 0..width {
                let (mut colour, mut hair, mut empty) = (Vec3::ZERO, 0usize, 0usize);
                for sy in 0..ss {
                    let start = (y * ss + sy) * width * ss + x * ss;
                    for i in start..start + ss {
                        match band.kind[i] {
                            BACKGROUND => empty += 1,
                            HAIR => hair += 1,
                            kind if kind >= MARKER => out.seen[(kind - MARKER) as usize] += 1,
                            _ => {}
                        }
                        colour += band.colour[i];
                    }
                }
                let behind = self.plates[view][(x, row)] * empty as f32;
                let level = |n: usize| (255.0 * n as f32 * share).round() as u8;
                out.colour.push((colour + behind) * share);
                out.hair.push(level(hair));
                out.subject.push(level(ss * ss - empty));
            }
        }
        out
    }

    fn assemble(&self, view: usize, frame: usize, rows: Vec<Resolved>) -> Picture {
        let (width, height) = (self.spec.rig.width, self.spec.rig.height);
        let total = |of: fn(&Resolved) -> &Vec<usize>, m: usize| rows.iter().map(|r| of(r)[m]).sum::<usize>();
        let visible = (0..self.markers.len())
            .map(|m| total(|r| &r.seen, m) as f64 / total(|r| &r.discs, m).max(1) as f64)
            .collect();
        let linear = Plane { width, height, data: rows.iter().flat_map(|r| r.colour.iter().copied()).collect() };
        Picture {
            image: expose(&self.spec, view, frame as u64, &linear),
            hair: Mask { width, height, data: rows.iter().flat_map(|r| r.hair.iter().copied()).collect() },
            subject: Mask { width, height, data: rows.iter().flat_map(|r| r.subject.iter().copied()).collect() },
            markers: self.marker_points(view, frame),
            visible,
        }
    }
}

/// Strands and head with the light that reaches them, before a camera looks.
struct Lit {
    fibres: Vec<Fibre>,
    skin: Vec<(DVec3, Vec3)>,
    world_from_head: RigidTransform,
    lights: [Light; 4],
}

struct Fibre {
    points: Vec<DVec3>,
    light: Vec<[f32; 4]>,
    colour: Vec3,
    seed: u64,
}

/// The pixels of a band.
#[derive(Default)]
struct Resolved {
    colour: Vec<Vec3>,
    hair: Vec<u8>,
    subject: Vec<u8>,
    discs: Vec<usize>,
    seen: Vec<usize>,
}

struct Lens<'a> {
    camera: &'a Camera,
    ss: usize,
}

impl Lens<'_> {
    fn vertex(&self, p: DVec3, colour: Vec3) -> Vertex {
        let depth = self.camera.camera_from_world.point(p).z as f32;
        let at = strandflow_geometry::project::project(self.camera, p).unwrap_or(DVec2::splat(-1e6)) * self.ss as f64;
        Vertex { at: at.as_vec2(), depth, colour }
    }

    /// A bound of the width of all ribbons in samples.
    fn width(&self, width_mm: f64, fibres: &[Fibre]) -> f32 {
        let nearest = fibres
            .iter()
            .filter_map(|f| f.points.first())
            .map(|&p| self.camera.camera_from_world.point(p).z)
            .fold(f64::INFINITY, f64::min);
        (width_mm * self.camera.focal[0] * self.ss as f64 / (nearest - 400.0).max(50.0)) as f32
    }
}

impl Fibre {
    /// The vertices in an image with the light they return towards it.
    fn seen(&self, lens: &Lens, lights: &[Light; 4]) -> Vec<Vertex> {
        let eye = lens.camera.centre_in_world();
        let last = self.points.len() - 1;
        (0..self.points.len())
            .map(|k| {
                let p = self.points[k];
                let tangent =
                    (self.points[(k + 1).min(last)] - self.points[k.saturating_sub(1)]).normalize_or(DVec3::Z);
                let (t, v) = (tangent.as_vec3(), (eye - p).normalize().as_vec3());
                let along =
                    crate::random::smooth_noise(self.seed, DVec3::new(k as f64 / last.max(1) as f64 * 7.0, 0.5, 0.5));
                let base = self.colour * (1.0 + 0.15 * along as f32);
                let mut colour = Vec3::ZERO;
                let mut reaching = 0.0;
                for (light, &strength) in lights.iter().zip(&self.light[k]) {
                    let (neutral, coloured) = fibre(t, light.towards, v);
                    colour += (Vec3::splat(neutral) + base * coloured) * strength;
                    reaching += strength;
                }
                lens.vertex(p, colour + base * (0.03 + 0.10 * reaching))
            })
            .collect()
    }
}

/// For each band, the segments (strand, first vertex) that may touch it, in order.
fn binned(hair: &[Vec<Vertex>], bands: usize, rows: f32, width: f32) -> Vec<Vec<(u32, u32)>> {
    let mut out = vec![Vec::new(); bands];
    for (i, vertices) in hair.iter().enumerate() {
        for (k, pair) in vertices.windows(2).enumerate() {
            let (a, b) = (pair[0].at, pair[1].at);
            for band in touched(a.y.min(b.y) - width, a.y.max(b.y) + width, rows, bands) {
                out[band].push((i as u32, k as u32));
            }
        }
    }
    out
}

fn binned_faces(faces: &[[u32; 3]], vertices: &[Vertex], bands: usize, rows: f32) -> Vec<Vec<u32>> {
    let mut out = vec![Vec::new(); bands];
    for (f, face) in faces.iter().enumerate() {
        let corners: [Vec2; 3] = face.map(|v| vertices[v as usize].at);
        let low = corners.iter().fold(f32::INFINITY, |m, c| m.min(c.y));
        let high = corners.iter().fold(f32::NEG_INFINITY, |m, c| m.max(c.y));
        for band in touched(low, high, rows, bands) {
            out[band].push(f as u32);
        }
    }
    out
}

fn touched(low: f32, high: f32, rows: f32, bands: usize) -> std::ops::Range<usize> {
    let end = ((high / rows).floor() + 1.0).clamp(0.0, bands as f32) as usize;
    ((low / rows).floor().max(0.0) as usize).min(end)..end
}

/// A smooth curve through the points with `pieces` pieces an edge (Catmull and Rom 1974).
fn rounded(points: &[DVec3], pieces: usize) -> Vec<DVec3> {
    if pieces < 2 {
        return points.to_vec();
    }
    let last = points.len() - 1;
    let mut out = vec![points[0]];
    for k in 0..last {
        let (a, b, c, d) = (points[k.saturating_sub(1)], points[k], points[k + 1], points[(k + 2).min(last)]);
        for s in 1..=pieces {
            let t = s as f64 / pieces as f64;
            let curve = b * 2.0
                + (c - a) * t
                + (a * 2.0 - b * 5.0 + c * 4.0 - d) * (t * t)
                + (b * 3.0 - a - c * 3.0 + d) * (t * t * t);
            out.push(curve * 0.5);
        }
    }
    out
}

/// The value at fine point `k` between the values at the coarse points.
fn between(values: &[[f32; 4]], k: usize, pieces: usize) -> [f32; 4] {
    let (i, share) = ((k / pieces).min(values.len() - 1), (k % pieces) as f32 / pieces as f32);
    let next = values[(i + 1).min(values.len() - 1)];
    std::array::from_fn(|l| values[i][l] + (next[l] - values[i][l]) * share)
}
