//! Hairs and skin into a tile of the picture.
//!
//! A hair is far thinner than a pixel: what it covers is worked out, not sampled. Across the hair, coverage is its width
//! spread over the pixels by a tent of one pixel; along it, the part of the row that it crosses. So the sum of its coverage
//! over all pixels is its area, wherever it lies. Hairs are laid over one another from the nearest to the farthest, each
//! hiding its share of what is behind it; those behind the skin lie in a second layer, which the skin hides by its own
//! coverage. A hair that moves is spread over its way: the box of its width, widened to the variance of both.

use glam::{Vec2, Vec3};

use crate::{skin::SkinVertex, thread::Vertex};

/// Pixels along each side of a tile. Smaller tiles hold more hairs twice, larger ones are badly shared among threads.
pub(crate) const TILE: usize = 32;

/// Samples of the skin along each side of a pixel; each row of them sees another moment of the open shutter.
const SAMPLES: usize = 4;

/// Light that still comes through where hair counts as opaque: what is behind is then taken to look like what is before it.
/// From 0.008 to 0.02 pictures change by 0.06 levels of 8 bits, and take a quarter less time.
const OPAQUE: f32 = 0.03;

/// A square of the picture.
pub(crate) struct Tile {
    /// Its first pixel.
    origin: [usize; 2],
    /// Light of the hairs before and behind the skin, and what comes through them.
    layers: [Vec<Passed>; 2],
    skin: Vec<SkinPixel>,
    /// Pixels through which more is seen: a row each, the first pixel lowest.
    open: [u32; TILE],
    /// How many there are.
    open_count: usize,
}

/// Light gathered on the way into the picture, and the share of what is behind that is seen through it.
#[derive(Clone, Copy)]
struct Passed {
    light: Vec3,
    through: f32,
    /// What the hair covered when it was taken to be opaque; 1 where it was not.
    whole: f32,
}

impl Passed {
    const CLEAR: Self = Self { light: Vec3::ZERO, through: 1.0, whole: 1.0 };

    fn light(&self) -> Vec3 {
        self.light / self.whole
    }
}

/// What a piece of a hair adds to a pixel.
#[derive(Clone, Copy)]
pub(crate) struct Fragment {
    /// Share of the piece's light.
    weight: f32,
    /// Place along the piece, in 65,535ths.
    along: u16,
    /// Layer and pixel.
    pixel: u16,
}

#[derive(Clone, Copy, Default)]
struct SkinPixel {
    colour: Vec3,
    depth: f32,
    coverage: f32,
}

impl Tile {
    /// An empty tile at a pixel.
    pub(crate) fn new(origin: [usize; 2]) -> Self {
        let clear = vec![Passed::CLEAR; TILE * TILE];
        Self {
            origin,
            layers: [clear.clone(), clear],
            skin: vec![SkinPixel::default(); TILE * TILE],
            open: [u32::MAX; TILE],
            open_count: TILE * TILE,
        }
    }

    /// Draws the skin; before any hair.
    pub(crate) fn skin(&mut self, faces: &[[u32; 3]], chosen: &[u32], vertices: &[SkinVertex]) {
        const SIDE: usize = TILE * SAMPLES;
        if chosen.is_empty() {
            return;
        }
        let mut samples = vec![(f32::INFINITY, Vec3::ZERO); SIDE * SIDE];
        for &face in chosen {
            let corners = faces[face as usize].map(|v| &vertices[v as usize]);
            for row in 0..SAMPLES {
                let moment = (row as f32 + 0.5) / SAMPLES as f32 - 0.5;
                self.triangle(&mut samples, corners, row, moment);
            }
        }
        for (i, pixel) in self.skin.iter_mut().enumerate() {
            let (x, y) = (i % TILE * SAMPLES, i / TILE * SAMPLES);
            let hit = (0..SAMPLES * SAMPLES).map(|s| samples[(y + s / SAMPLES) * SIDE + x + s % SAMPLES]);
            let (sum, depth, n) = hit
                .filter(|s| s.0 < f32::INFINITY)
                .fold((Vec3::ZERO, 0.0, 0.0), |(c, d, n), s| (c + s.1, d + s.0, n + 1.0));
            if n > 0.0 {
                *pixel = SkinPixel { colour: sum / n, depth: depth / n, coverage: n / (SAMPLES * SAMPLES) as f32 };
                self.layers[1][i].through = if pixel.coverage < 1.0 { 1.0 } else { 0.0 };
            }
        }
    }

    fn triangle(&self, samples: &mut [(f32, Vec3)], corners: [&SkinVertex; 3], row: usize, moment: f32) {
        const SIDE: usize = TILE * SAMPLES;
        let origin = Vec2::new(self.origin[0] as f32, self.origin[1] as f32);
        let place = |v: &SkinVertex| (v.at + v.motion * moment - origin) * SAMPLES as f32;
        let [a, b, c] = corners.map(place);
        let area = (b - a).perp_dot(c - a);
        if !area.is_finite() || area.abs() < 1e-9 {
            return;
        }
        let limit = |v: f32| v.clamp(0.0, SIDE as f32) as usize;
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let first = limit((low.y - 0.5).ceil());
        let first = first + (row + SAMPLES - first % SAMPLES) % SAMPLES;
        for y in (first..limit((high.y - 0.5).ceil())).step_by(SAMPLES) {
            for x in limit((low.x - 0.5).ceil())..limit((high.x - 0.5).ceil()) {
                let p = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                let wb = (p - a).perp_dot(c - a) / area;
                let wc = (b - a).perp_dot(p - a) / area;
                let wa = 1.0 - wb - wc;
                if wa >= 0.0 && wb >= 0.0 && wc >= 0.0 {
                    let depth = corners[0].depth * wa + corners[1].depth * wb + corners[2].depth * wc;
                    let sample = &mut samples[y * SIDE + x];
                    if depth < sample.0 {
                        *sample = (depth, corners[0].colour * wa + corners[1].colour * wb + corners[2].colour * wc);
                    }
                }
            }
        }
    }

    /// Number of pixels through which more is seen.
    pub(crate) fn open_count(&self) -> usize {
        self.open_count
    }

    /// Whether something that is behind all that was drawn and touches only these pixels can be seen.
    pub(crate) fn is_open(&self, span: Span) -> bool {
        let columns = (u32::MAX >> (TILE - 1 - usize::from(span.last[0]))) & (u32::MAX << span.first[0]);
        self.open[usize::from(span.first[1])..=usize::from(span.last[1])].iter().any(|row| row & columns != 0)
    }

    /// Lays a piece of a hair behind those that are there and tells where it is seen: its light is added later, when it is
    /// known for many pieces.
    pub(crate) fn piece(&mut self, a: &Vertex, b: &Vertex, seen: &mut Vec<Fragment>) {
        let origin = Vec2::new(self.origin[0] as f32, self.origin[1] as f32);
        let step = b.at - a.at;
        let length = step.length();
        // Sweeps the axis along which the hair runs; `swap` makes that the first coordinate.
        let steep = step.y.abs() >= step.x.abs();
        let swap = |v: Vec2| if steep { v.yx() } else { v };
        let (from, to) = (swap(a.at - origin), swap(b.at - origin));
        let run = to.x - from.x;
        if length < 1e-6 || !length.is_finite() {
            return;
        }
        let slant = length / run.abs();
        let across = step.perp() / length;
        let (moved_a, moved_b) = (a.motion.dot(across), b.motion.dot(across));
        let (low, high) = (from.x.min(to.x).max(0.0), from.x.max(to.x).min(TILE as f32));
        // Casts cut off: of numbers that are not negative that is the floor, and faster than asking for it.
        for i in low as usize..((high + 1.0).max(0.0) as usize).min(TILE) {
            let (start, end) = (low.max(i as f32), high.min((i + 1) as f32));
            if end <= start {
                continue;
            }
            let t = (0.5 * (start + end) - from.x) / run;
            let middle = from.y + (to.y - from.y) * t;
            let width = a.width + (b.width - a.width) * t;
            let moved = moved_a + (moved_b - moved_a) * t;
            let spread = (width * width + moved * moved).sqrt();
            let half = 0.5 * spread * slant;
            let dense = (end - start) * width / spread;
            let first = (middle - half - 0.5).max(0.0) as usize;
            let last = ((middle + half + 1.5).max(0.0) as usize).min(TILE);
            let depth = a.depth + (b.depth - a.depth) * t;
            for j in first..last {
                let pixel = if steep { i * TILE + j } else { j * TILE + i };
                let layer = self.layer(pixel, depth);
                if self.layers[layer][pixel].through > 0.0 {
                    let off = j as f32 + 0.5 - middle;
                    let share = dense * (tent_sum(off + half) - tent_sum(off - half));
                    let weight = self.lay(layer, pixel, share.min(1.0));
                    let along = (t * 65_535.0 + 0.5) as u16;
                    seen.push(Fragment { weight, along, pixel: (layer * TILE * TILE + pixel) as u16 });
                }
            }
        }
    }

    /// 1 behind the skin, 0 before it.
    fn layer(&self, pixel: usize, depth: f32) -> usize {
        let skin = &self.skin[pixel];
        usize::from(skin.coverage > 0.0 && depth > skin.depth)
    }

    /// Hides a share of what is behind a pixel; returns how much of what hides it is seen itself.
    fn lay(&mut self, layer: usize, pixel: usize, share: f32) -> f32 {
        let passed = &mut self.layers[layer][pixel];
        // What a single hair covers stays as it is.
        let is_first = passed.through == 1.0;
        let weight = passed.through * share;
        passed.through *= 1.0 - share;
        if passed.through <= OPAQUE && !is_first {
            (passed.whole, passed.through) = (1.0 - passed.through, 0.0);
            // What is behind opaque hair, or behind opaque skin, is not seen either.
            self.layers[1][pixel].through = 0.0;
            if layer == 0 {
                self.open[pixel / TILE] &= !(1 << (pixel % TILE));
                self.open_count -= 1;
            }
        }
        weight
    }

    /// Adds the light of a piece, which is known at its ends, where it is seen.
    pub(crate) fn light(&mut self, [from, to]: [Vec3; 2], seen: &[Fragment]) {
        let step = (to - from) / 65_535.0;
        for fragment in seen {
            let pixel = usize::from(fragment.pixel);
            let colour = from + step * f32::from(fragment.along);
            self.layers[pixel / (TILE * TILE)][pixel % (TILE * TILE)].light += colour * fragment.weight;
        }
    }

    /// Radiance and coverage of the hair alone: the skin hides what is behind it, and is itself a hole.
    pub(crate) fn hair_of_pixel(&self, x: usize, y: usize) -> [f32; 4] {
        let i = y * TILE + x;
        let [front, back] = [&self.layers[0][i], &self.layers[1][i]];
        let seen = 1.0 - self.skin[i].coverage;
        let light = front.light() + back.light() * (front.through * seen);
        let through = front.through * (1.0 - seen * (1.0 - back.through));
        [light.x, light.y, light.z, 1.0 - through]
    }

    /// Radiance and coverage of a pixel (column and row within the tile), premultiplied.
    pub(crate) fn pixel(&self, x: usize, y: usize) -> [f32; 4] {
        let i = y * TILE + x;
        let [front, back] = [&self.layers[0][i], &self.layers[1][i]];
        let skin = &self.skin[i];
        let past = front.through * (1.0 - skin.coverage);
        let light = front.light() + skin.colour * (front.through * skin.coverage) + back.light() * past;
        [light.x, light.y, light.z, 1.0 - past * back.through]
    }
}

/// Pixels of a tile: a rectangle, columns and rows.
#[derive(Clone, Copy)]
pub(crate) struct Span {
    first: [u8; 2],
    last: [u8; 2],
}

impl Span {
    /// The pixels of the tile at `origin` that a rectangle touches, which is at least partly within it \[px\].
    pub(crate) fn new([low, high]: [Vec2; 2], origin: Vec2) -> Self {
        let pixels = |at: Vec2| (at - origin).clamp(Vec2::ZERO, Vec2::splat((TILE - 1) as f32)).to_array();
        Self { first: pixels(low).map(|c| c as u8), last: pixels(high).map(|c| c as u8) }
    }
}

/// The rectangle within which a piece covers pixels \[px\]: along the axis on which it is longer it ends where it ends,
/// along the other one it is as wide as it is drawn, and a tent wider.
pub(crate) fn rectangle(a: &Vertex, b: &Vertex) -> [Vec2; 2] {
    let step = b.at - a.at;
    let across = step.perp() / step.length();
    let moved = a.motion.dot(across).abs().max(b.motion.dot(across).abs());
    // Half of what is drawn, at a slant of at most 45 degrees; the sum is more than the root of the squares.
    let half = 0.75 * (a.width.max(b.width) + moved) + 1.0;
    let reach = if step.y.abs() >= step.x.abs() { Vec2::new(half, 0.0) } else { Vec2::new(0.0, half) };
    [a.at.min(b.at) - reach, a.at.max(b.at) + reach]
}

/// The integral of the tent of one pixel from far left to `x` \[px\].
fn tent_sum(x: f32) -> f32 {
    let x = x.clamp(-1.0, 1.0);
    if x < 0.0 { 0.5 * (1.0 + x) * (1.0 + x) } else { 1.0 - 0.5 * (1.0 - x) * (1.0 - x) }
}

trait Swapped {
    fn yx(self) -> Self;
}

impl Swapped for Vec2 {
    fn yx(self) -> Self {
        Self::new(self.y, self.x)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lay_white(tile: &mut Tile, a: &Vertex, b: &Vertex) {
        let mut seen = Vec::new();
        tile.piece(a, b, &mut seen);
        tile.light([Vec3::ONE; 2], &seen);
    }

    fn coverage(a: Vec2, b: Vec2, width: f32, motion: Vec2) -> f32 {
        let mut tile = Tile::new([0, 0]);
        let vertex = |at| Vertex { at, depth: 1.0, width, motion };
        lay_white(&mut tile, &vertex(a), &vertex(b));
        (0..TILE * TILE).map(|i| tile.pixel(i % TILE, i / TILE)[3]).sum()
    }

    #[test]
    fn the_sum_of_coverage_is_the_area_at_any_place_angle_width_and_motion() {
        for degrees in [0.0f32, 13.0, 45.0, 77.0, 90.0, 160.0] {
            for (width, motion) in [(0.07f32, 0.0f32), (0.07, 3.0), (0.4, 0.7), (2.5, 0.0)] {
                for shift in [0.0, 0.21, 0.5, 0.83] {
                    let along = Vec2::from_angle(degrees.to_radians()) * 9.0;
                    let middle = Vec2::new(15.7 + shift, 16.1 - shift);
                    let got = coverage(middle - along, middle + along, width, along.perp() / 9.0 * motion);
                    let wanted = 18.0 * width;
                    assert!((got / wanted - 1.0).abs() < 2e-3, "{got} for {wanted} at {degrees}°, {width}, {motion}");
                }
            }
        }
    }

    #[test]
    fn a_hair_lies_where_it_is() {
        let mut tile = Tile::new([64, 32]);
        let vertex = |x: f32, y: f32| Vertex { at: Vec2::new(x, y), depth: 1.0, width: 0.1, motion: Vec2::ZERO };
        lay_white(&mut tile, &vertex(70.2, 40.0), &vertex(74.7, 58.0));
        let sum = |f: &dyn Fn(usize, usize) -> f32| (0..TILE * TILE).map(|i| f(i % TILE, i / TILE)).sum::<f32>();
        let whole = sum(&|x, y| tile.pixel(x, y)[3]);
        let mean_x = sum(&|x, y| tile.pixel(x, y)[3] * (x as f32 + 64.5)) / whole;
        let mean_y = sum(&|x, y| tile.pixel(x, y)[3] * (y as f32 + 32.5)) / whole;
        assert!((mean_x - 72.45).abs() < 0.01 && (mean_y - 49.0).abs() < 0.01, "{mean_x} {mean_y}");
    }

    #[test]
    fn skin_hides_hair_behind_it() {
        let mut tile = Tile::new([0, 0]);
        let corner = |x: f32, y: f32| SkinVertex {
            at: Vec2::new(x, y),
            depth: 10.0,
            motion: Vec2::ZERO,
            colour: Vec3::new(1.0, 0.0, 0.0),
        };
        tile.skin(&[[0, 1, 2]], &[0], &[corner(-5.0, -5.0), corner(90.0, -5.0), corner(-5.0, 90.0)]);
        let vertex = |y: f32, depth: f32| Vertex { at: Vec2::new(10.5, y), depth, width: 0.5, motion: Vec2::ZERO };
        lay_white(&mut tile, &vertex(2.0, 12.0), &vertex(30.0, 12.0));
        assert_eq!(tile.pixel(10, 12), [1.0, 0.0, 0.0, 1.0]);
        assert_eq!(tile.hair_of_pixel(10, 12), [0.0; 4]);
        lay_white(&mut tile, &vertex(2.0, 8.0), &vertex(30.0, 8.0));
        assert!(tile.pixel(10, 12)[1] > 0.3, "{:?}", tile.pixel(10, 12));
    }
}
