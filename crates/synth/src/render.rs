//! Pictures and masks of a frame, in every view.

use glam::{DVec2, DVec3, Vec2, Vec3};
use rayon::prelude::*;
use strandflow_core::{Mask, Plane, RgbImage};

use crate::light::Light;
use crate::picture::{careless, expose, light_of};
use crate::raster::{BACKGROUND, Band, HAIR, HAND, MARKER, Vertex};
use crate::scene::{MARKER_COLOURS, MARKER_RADIUS_MM, Scene};
use crate::studio::{Lens, Lit};

/// Rows of pixels that are rendered as one piece of work.
const BAND_ROWS: usize = 8;

/// Moments that a picture of an open shutter is the mean of: a way of 16 px in the exposure is drawn in steps of 3 px, a third
/// of a ball; each moment costs as much as a picture.
const MOMENTS: usize = 5;

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
        let in_step = self.delays.iter().all(|&d| d == 0.0).then(|| self.exposure(frame as f64));
        (0..self.rig.view_count())
            .map(|view| match &in_step {
                Some(moments) => self.picture(view, frame, moments),
                None => self.render_view(view, frame),
            })
            .collect()
    }

    /// One view of a frame.
    pub fn render_view(&self, view: usize, frame: usize) -> Picture {
        self.picture(view, frame, &self.exposure(frame as f64 + self.delays[view]))
    }

    /// The moments of an exposure around a time in frames, evenly spread.
    fn exposure(&self, frame: f64) -> Vec<Lit> {
        let shutter = self.spec.noise.shutter;
        let count = if shutter > 0.0 { MOMENTS } else { 1 };
        (0..count).map(|k| self.lit(frame + shutter * ((k as f64 + 0.5) / count as f64 - 0.5))).collect()
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

    fn picture(&self, view: usize, frame: usize, moments: &[Lit]) -> Picture {
        let drawn: Vec<Vec<Resolved>> = moments.iter().map(|lit| self.drawn(view, lit)).collect();
        self.assemble(view, frame, &drawn)
    }

    /// The bands of a view at one moment.
    fn drawn(&self, view: usize, lit: &Lit) -> Vec<Resolved> {
        let camera = &self.rig.cameras[view];
        let ss = self.spec.rig.subsamples;
        let lens = Lens { camera, ss };
        let skin: Vec<Vertex> = lit.skin.iter().map(|&(p, colour)| lens.vertex(p, colour)).collect();
        let hair: Vec<Vec<Vertex>> = lit.fibres.par_iter().map(|fibre| fibre.seen(&lens, &lit.lights)).collect();
        let coloured = self.markers.iter().zip(MARKER_COLOURS);
        let balls: Vec<Vertex> =
            coloured.map(|(&m, colour)| lens.vertex(lit.world_from_head.point(m), Vec3::from_array(colour))).collect();
        let bands = camera.height.div_ceil(BAND_ROWS);
        let hair_of_band =
            binned(&hair, bands, (BAND_ROWS * ss) as f32, lens.width(self.spec.groom.width_mm, &lit.fibres));
        let skin_of_band = binned_faces(&self.head.faces, &skin, bands, (BAND_ROWS * ss) as f32);
        let standing = self.body.iter().flat_map(|body| body.vertices.iter().zip(&self.cloth));
        let cloth: Vec<Vertex> = standing.map(|(&p, &colour)| lens.vertex(p, colour)).collect();
        let cloth_faces = self.body.as_ref().map_or(&[][..], |body| &body.faces);
        let cloth_of_band = binned_faces(cloth_faces, &cloth, bands, (BAND_ROWS * ss) as f32);
        let hand = lens.vertex(lit.hand, Vec3::new(0.75, 0.46, 0.34));
        (0..bands)
            .into_par_iter()
            .map(|b| {
                let first = b * BAND_ROWS;
                let last = (first + BAND_ROWS).min(camera.height);
                let mut band = Band::new(camera.width * ss, first * ss..last * ss);
                for &f in &skin_of_band[b] {
                    band.triangle(self.head.faces[f as usize].map(|v| &skin[v as usize]));
                }
                for &f in &cloth_of_band[b] {
                    band.triangle(cloth_faces[f as usize].map(|v| &cloth[v as usize]));
                }
                for &(i, k) in &hair_of_band[b] {
                    let (p, q) = (&hair[i as usize][k as usize], &hair[i as usize][k as usize + 1]);
                    let width = self.spec.groom.width_mm * camera.focal[0] * ss as f64 / p.depth as f64;
                    band.ribbon(p, q, width as f32);
                }
                let discs = self.draw_balls(&mut band, &lens, &balls, &lit.lights);
                self.draw_ball(&mut band, &lens, &hand, (self.spec.hand.radius_mm, HAND), &lit.lights);
                self.resolve(view, &band, first..last, discs)
            })
            .collect()
    }

    /// Draws the marker balls and returns the samples of each one's disc.
    fn draw_balls(&self, band: &mut Band, lens: &Lens, balls: &[Vertex], lights: &[Light]) -> Vec<usize> {
        let draw = |(m, ball)| self.draw_ball(band, lens, ball, (MARKER_RADIUS_MM, MARKER + m as u8), lights);
        balls.iter().enumerate().map(draw).collect()
    }

    /// Draws a ball of a radius \[mm\] and a kind in the light and returns the samples of its disc.
    fn draw_ball(
        &self,
        band: &mut Band,
        lens: &Lens,
        ball: &Vertex,
        (radius_mm, kind): (f64, u8),
        lights: &[Light],
    ) -> usize {
        if radius_mm == 0.0 {
            return 0;
        }
        let r = lens.camera.camera_from_world.rotation;
        let radius = radius_mm * lens.camera.focal[0] * lens.ss as f64 / ball.depth as f64;
        let shade = |n: Vec3| {
            let world = (r.transpose() * DVec3::new(n.x as f64, n.y as f64, -n.z as f64)).as_vec3();
            let direct: f32 = lights.iter().map(|l| l.strength * (0.6 * world.dot(l.towards) + 0.4).max(0.0)).sum();
            ball.colour * (0.42 * direct + 0.25)
        };
        band.ball(ball, radius as f32, radius_mm as f32, kind, shade)
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

    /// The picture of the mean of its moments.
    fn assemble(&self, view: usize, frame: usize, moments: &[Vec<Resolved>]) -> Picture {
        let (width, height) = (self.spec.rig.width, self.spec.rig.height);
        let bands = || moments.iter().flatten();
        let total = |of: fn(&Resolved) -> &Vec<usize>, m: usize| bands().map(|r| of(r)[m]).sum::<usize>();
        let visible = (0..self.markers.len())
            .map(|m| total(|r| &r.seen, m) as f64 / total(|r| &r.discs, m).max(1) as f64)
            .collect();
        let mut linear = Plane::filled(width, height, Vec3::ZERO);
        let light = light_of(&self.spec, frame) / moments.len() as f32;
        for rows in moments {
            let colours = rows.iter().flat_map(|r| &r.colour);
            linear.data.iter_mut().zip(colours).for_each(|(sum, colour)| *sum += *colour * light);
        }
        let mean = |of: fn(&Resolved) -> &Vec<u8>| {
            let mut sums = vec![0usize; width * height];
            for rows in moments {
                sums.iter_mut().zip(rows.iter().flat_map(of)).for_each(|(sum, &level)| *sum += usize::from(level));
            }
            let data = sums.into_iter().map(|sum| ((sum + moments.len() / 2) / moments.len()) as u8).collect();
            Mask { width, height, data }
        };
        Picture {
            image: expose(&self.spec, view, frame as u64, &linear),
            hair: mean(|r| &r.hair),
            subject: mean(|r| &r.subject),
            markers: self.marker_points(view, frame),
            visible,
        }
    }
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
