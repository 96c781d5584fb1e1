//! Rasterising ribbons, triangles and spheres into the sub-samples of bands of rows. Nearest wins.
//!
//! Every sample is decided by its own position alone, so the picture is the same at any number of bands and threads.

use std::ops::Range;

use glam::{Vec2, Vec3};

/// What the nearest surface of a sample is.
pub(crate) const BACKGROUND: u8 = 0;
/// Skin.
pub(crate) const HEAD: u8 = 1;
/// A strand.
pub(crate) const HAIR: u8 = 2;
/// The hand.
pub(crate) const HAND: u8 = 3;
/// The first marker; the others follow.
pub(crate) const MARKER: u8 = 4;

/// A vertex in sample coordinates.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Vertex {
    /// Position in samples (pixels times sub-samples).
    pub at: Vec2,
    /// Distance along the optical axis \[mm\].
    pub depth: f32,
    /// Linear colour.
    pub colour: Vec3,
}

/// Rows of samples with nearest depth, colour and kind.
pub(crate) struct Band {
    width: usize,
    rows: Range<usize>,
    depth: Vec<f32>,
    /// Colour of each sample, row major.
    pub colour: Vec<Vec3>,
    /// Kind of each sample.
    pub kind: Vec<u8>,
}

impl Band {
    /// Sample rows `rows` of an image `width` samples wide, empty.
    pub(crate) fn new(width: usize, rows: Range<usize>) -> Self {
        let n = width * rows.len();
        Self { width, rows, depth: vec![f32::INFINITY; n], colour: vec![Vec3::ZERO; n], kind: vec![BACKGROUND; n] }
    }

    fn put(&mut self, x: usize, y: usize, depth: f32, colour: impl FnOnce() -> Vec3, kind: u8) {
        let i = (y - self.rows.start) * self.width + x;
        if depth < self.depth[i] {
            (self.depth[i], self.colour[i], self.kind[i]) = (depth, colour(), kind);
        }
    }

    /// The samples whose centres lie in from..to, clipped to the band's rows.
    fn rows_within(&self, from: f32, to: f32) -> Range<usize> {
        let r = centres(from, to, self.rows.end);
        r.start.max(self.rows.start)..r.end
    }

    /// A ribbon of constant width \[samples\] that faces the viewer.
    pub(crate) fn ribbon(&mut self, a: &Vertex, b: &Vertex, width: f32) {
        let d = b.at - a.at;
        if d.length_squared() < 1e-12 {
            return;
        }
        // Sweep the longer axis; the section across the other has the half width w / (2 cos).
        if d.y.abs() >= d.x.abs() {
            let half = 0.5 * width * d.length() / d.y.abs();
            for y in self.rows_within(a.at.y.min(b.at.y), a.at.y.max(b.at.y)) {
                let t = (y as f32 + 0.5 - a.at.y) / d.y;
                let x = a.at.x + d.x * t;
                for x in centres(x - half, x + half, self.width) {
                    self.put(x, y, a.depth + (b.depth - a.depth) * t, || a.colour.lerp(b.colour, t), HAIR);
                }
            }
        } else {
            let half = 0.5 * width * d.length() / d.x.abs();
            for x in centres(a.at.x.min(b.at.x), a.at.x.max(b.at.x), self.width) {
                let t = (x as f32 + 0.5 - a.at.x) / d.x;
                let y = a.at.y + d.y * t;
                for y in self.rows_within(y - half, y + half) {
                    self.put(x, y, a.depth + (b.depth - a.depth) * t, || a.colour.lerp(b.colour, t), HAIR);
                }
            }
        }
    }

    /// A triangle of skin.
    pub(crate) fn triangle(&mut self, [a, b, c]: [&Vertex; 3]) {
        let area = (b.at - a.at).perp_dot(c.at - a.at);
        if area.abs() < 1e-9 {
            return;
        }
        let low = a.at.min(b.at).min(c.at);
        let high = a.at.max(b.at).max(c.at);
        for y in self.rows_within(low.y, high.y) {
            for x in centres(low.x, high.x, self.width) {
                let p = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                let wb = (p - a.at).perp_dot(c.at - a.at) / area;
                let wc = (b.at - a.at).perp_dot(p - a.at) / area;
                let wa = 1.0 - wb - wc;
                if wa >= 0.0 && wb >= 0.0 && wc >= 0.0 {
                    let depth = wa * a.depth + wb * b.depth + wc * c.depth;
                    self.put(x, y, depth, || a.colour * wa + b.colour * wb + c.colour * wc, HEAD);
                }
            }
        }
    }

    /// A disc of a marker ball: `radius` in samples, `bulge` the radius in millimetres; `shade` from the normal
    /// (x right, y down, z towards the viewer). Returns how many samples the disc has in this band.
    pub(crate) fn ball(
        &mut self,
        centre: &Vertex,
        radius: f32,
        bulge: f32,
        kind: u8,
        shade: impl Fn(Vec3) -> Vec3,
    ) -> usize {
        let mut all = 0;
        for y in self.rows_within(centre.at.y - radius, centre.at.y + radius) {
            for x in centres(centre.at.x - radius, centre.at.x + radius, self.width) {
                let n = (Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - centre.at) / radius;
                let z = 1.0 - n.length_squared();
                if z >= 0.0 {
                    all += 1;
                    let z = z.sqrt();
                    self.put(x, y, centre.depth - bulge * z, || shade(n.extend(z)), kind);
                }
            }
        }
        all
    }
}

/// Indices of the samples with centres (i + 0.5) in from..to, clipped to 0..limit.
fn centres(from: f32, to: f32, limit: usize) -> Range<usize> {
    let index = |v: f32| (v - 0.5).ceil().clamp(0.0, limit as f32) as usize;
    let (start, end) = (index(from), index(to));
    start..end.max(start)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ribbon_covers_its_area_in_every_direction_and_bands_do_not_matter() {
        for degrees in [0.0f32, 20.0, 45.0, 70.0, 90.0, 130.0] {
            let d = Vec2::from_angle(degrees.to_radians());
            let middle = Vec2::new(50.3, 50.6);
            let vertex = |s: f32| Vertex { at: middle + d * s, depth: 1.0, colour: Vec3::ONE };
            let (a, b) = (vertex(-30.0), vertex(30.0));
            let mut whole = Band::new(100, 0..100);
            whole.ribbon(&a, &b, 5.0);
            let covered = whole.kind.iter().filter(|&&k| k == HAIR).count() as f32;
            assert!((covered / 300.0 - 1.0).abs() < 0.05, "{covered} at {degrees}");
            let parts: Vec<u8> = [0..37, 37..100]
                .into_iter()
                .flat_map(|rows| {
                    let mut band = Band::new(100, rows);
                    band.ribbon(&a, &b, 5.0);
                    band.kind
                })
                .collect();
            assert_eq!(parts, whole.kind);
        }
    }
}
