//! From strands to a picture.

use glam::Vec2;
use rayon::prelude::*;
use strandflow_core::{Camera, Plane};

use crate::{
    RenderError,
    colour::HairColour,
    dome::Dome,
    fibre::Roughness,
    groom::{Grown, Growth},
    light::LightRig,
    picture::Picture,
    raster::{Span, TILE, Tile, rectangle},
    scattering::Scattering,
    shadow::{Shadow, Surface},
    skin::{SkinVertex, in_world, skin},
    subject::Subject,
    thread::{Eye, Lighting, Threads},
};

/// Largest picture along one side \[px\].
pub const MAX_SIDE: usize = 16_384;

/// Most hairs a strand.
pub const MAX_DENSITY: usize = 500;

/// Most points of all hairs: about 3 GB.
pub const MAX_POINTS: usize = 40_000_000;

/// Hairs of a human head (Robbins 2012: 80,000 to 150,000).
const HAIRS: f32 = 100_000.0;

/// Thickest that a hair is drawn \[mm\], where few strands stand for all.
const THICKEST_MM: f32 = 0.4;

/// How a picture is made.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Colour of the hair.
    pub colour: HairColour,
    /// Roughness of a fibre.
    pub roughness: Roughness,
    /// Hairs drawn for each strand; see [`full_density`]. Where they are fewer than a head has, they are drawn thicker.
    pub density: usize,
    /// Thickness of a hair \[mm\]; human hair has 0.05 to 0.1.
    pub hair_mm: f32,
    /// Share of a frame for which the shutter is open, 0 (sharp) to 1.
    pub shutter: f32,
    /// Whether the head is drawn. Else it hides and shades hair, and is a hole in the picture: footage has its own.
    pub skin: bool,
    /// Rounds by which strands are freed from the trembling of captured ones; 0 draws them as they are.
    pub polish: usize,
    /// Seed of the children and shades.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            colour: HairColour::BROWN,
            roughness: Roughness::default(),
            density: 10,
            hair_mm: 0.08,
            shutter: 0.5,
            skin: true,
            polish: 4,
            seed: 1,
        }
    }
}

impl Settings {
    /// # Errors
    /// A setting out of range.
    pub fn check(&self) -> Result<(), RenderError> {
        let wrong = |name, value: String, range: String| Err(RenderError::Setting { name, value, range });
        let in_range = |value: f32, low: f32, high: f32| (low..=high).contains(&value);
        let rough = [self.roughness.longitudinal, self.roughness.azimuthal];
        if !(1..=MAX_DENSITY).contains(&self.density) {
            return wrong("density", self.density.to_string(), format!("1..={MAX_DENSITY}"));
        }
        if self.polish > 100 {
            return wrong("polish", self.polish.to_string(), "0..=100".into());
        }
        if !in_range(self.shutter, 0.0, 1.0) {
            return wrong("motion blur", self.shutter.to_string(), "0..=1".into());
        }
        if !in_range(self.hair_mm, 0.005, 5.0) {
            return wrong("thickness of a hair", self.hair_mm.to_string(), "0.005..=5 mm".into());
        }
        match rough.iter().find(|r| !in_range(**r, 0.05, 1.0)) {
            Some(r) => wrong("roughness", r.to_string(), "0.05..=1".into()),
            None => Ok(()),
        }
    }

    /// Thickness at which a hair is drawn \[mm\]: all hairs together cover what those of a head do.
    fn width_mm(&self, strands: usize) -> f32 {
        let missing = HAIRS / (strands * self.density).max(1) as f32;
        (self.hair_mm * missing.max(1.0)).min(THICKEST_MM.max(self.hair_mm))
    }
}

/// The density at which hair looks full in a picture where a millimetre at the head has `px_per_mm` pixels: as many hairs
/// as a head has, or as many as are a seventh of a pixel thin, which look the same.
pub fn full_density(strands: usize, px_per_mm: f64) -> usize {
    /// Thickness below which more and thinner hairs change nothing that is seen \[px\].
    const FINE_PX: f64 = 0.14;
    let fine = f64::from(HAIRS) * 0.08 * px_per_mm.max(1e-6) / FINE_PX;
    let hairs = fine.min(f64::from(HAIRS));
    ((hairs / strands.max(1) as f64).round() as usize).clamp(1, 60)
}

/// Renders a subject as a camera sees it, by the light of a rig.
///
/// # Errors
/// There is no strand, a position is not finite, a setting is out of range, the hairs have more than [`MAX_POINTS`], or the camera's picture is empty or larger
/// than [`MAX_SIDE`].
pub fn render(subject: &Subject, camera: &Camera, rig: &LightRig, settings: &Settings) -> Result<Picture, RenderError> {
    settings.check()?;
    subject.hair.check()?;
    let (width, height) = (camera.width, camera.height);
    if !(1..=MAX_SIDE).contains(&width) || !(1..=MAX_SIDE).contains(&height) {
        return Err(RenderError::Size { width, height });
    }
    let width_mm = settings.width_mm(subject.hair.strand_count());
    let pieces = pieces(subject, camera);
    let points = subject.hair.points.len().saturating_mul(pieces).saturating_mul(settings.density);
    if points > MAX_POINTS {
        return Err(RenderError::TooMany { points });
    }
    let growth = Growth { density: settings.density, pieces, polish: settings.polish, seed: settings.seed };
    let grown = Grown::new(subject, &growth);
    let vertices = subject.head.as_ref().map(in_world);
    let surface = subject.head.as_ref().zip(vertices.as_ref());
    let surface = surface.map(|(head, vertices)| Surface { vertices, faces: &head.mesh.faces });
    let shadows: Vec<Shadow> =
        rig.lights.iter().map(|l| Shadow::new(l.towards, &grown, width_mm, surface.as_ref())).collect();
    let dome = Dome::new(&grown, width_mm, surface.as_ref(), rig.up);
    let scattering = Scattering::new(settings.colour, settings.roughness);
    let lighting = Lighting { rig, shadows: &shadows, dome: &dome, scattering: &scattering };
    let centre = camera.centre_in_world().as_vec3();
    let eye = Eye { camera, centre, shutter: settings.shutter, width_mm, seed: settings.seed };
    let skin = match (&subject.head, &surface) {
        (Some(head), Some(surface)) => skin(head, surface, subject.hair, &lighting, &eye),
        _ => Vec::new(),
    };
    let threads = Threads::new(subject.hair, &grown, &lighting, &eye);
    let faces = surface.as_ref().map_or(&[][..], |surface| surface.faces);
    Ok(draw(&Drawn { grown: &grown, threads: &threads, faces, skin: &skin, draw_skin: settings.skin }, [width, height]))
}

/// Pieces into which an edge is rounded, so that none is longer than some pixels.
fn pieces(subject: &Subject, camera: &Camera) -> usize {
    /// Edges of 6 px show no corner at the curvature of hair.
    const LONGEST_PX: f64 = 6.0;
    let hair = subject.hair;
    let depth = strandflow_geometry::project::depth(camera, subject.middle()).max(1.0);
    let edges = (0..hair.strand_count()).step_by(17).flat_map(|n| hair.strand(n).windows(2));
    let (sum, count) = edges.fold((0.0, 0.0), |(sum, n), pair| (sum + f64::from(pair[0].distance(pair[1])), n + 1.0));
    let edge_px = sum / f64::max(count, 1.0) * camera.focal[0] / depth;
    (edge_px / LONGEST_PX).ceil().clamp(1.0, 8.0) as usize
}

/// What is drawn.
struct Drawn<'a> {
    grown: &'a Grown,
    threads: &'a Threads<'a>,
    faces: &'a [[u32; 3]],
    skin: &'a [SkinVertex],
    draw_skin: bool,
}

fn draw(drawn: &Drawn, [width, height]: [usize; 2]) -> Picture {
    let grid = [width.div_ceil(TILE), height.div_ceil(TILE)];
    let pieces = drawn.pieces_of_tiles(grid);
    let faces = drawn.faces_of_tiles(grid);
    let tiles: Vec<Vec<[f32; 4]>> = (0..grid[0] * grid[1])
        .into_par_iter()
        .map(|t| {
            let mut tile = Tile::new([t % grid[0] * TILE, t / grid[0] * TILE]);
            tile.skin(drawn.faces, &faces[t], drawn.skin);
            drawn.hair(&mut tile, pieces.iter().flat_map(|part| &part[t]).copied().collect());
            let pixel = if drawn.draw_skin { Tile::pixel } else { Tile::hair_of_pixel };
            (0..TILE * TILE).map(|i| pixel(&tile, i % TILE, i / TILE)).collect()
        })
        .collect();
    let linear = Plane::from_fn(width, height, |x, y| tiles[y / TILE * grid[0] + x / TILE][y % TILE * TILE + x % TILE]);
    Picture { linear }
}

/// A piece of a hair in a tile.
#[derive(Clone, Copy)]
struct Piece {
    /// Its depth and then its first point, so that of equally far ones the first is nearer. Depths are positive: their
    /// bits are in the order of the numbers.
    order: u64,
    /// What it may touch.
    span: Span,
}

impl Piece {
    fn new(point: usize, depth: f32, span: Span) -> Self {
        Self { order: u64::from(depth.to_bits()) << 32 | point as u64, span }
    }

    fn point(&self) -> usize {
        self.order as u32 as usize
    }
}

impl Drawn<'_> {
    /// Lays pieces over a tile from the nearest to the farthest. Most are behind hair that hides them: they are neither
    /// sorted nor looked at.
    fn hair(&self, tile: &mut Tile, mut pieces: Vec<Piece>) {
        /// Pieces that are sorted at a time: four a pixel.
        const AT_A_TIME: usize = 4 * TILE * TILE;
        let mut rest = pieces.as_mut_slice();
        while !rest.is_empty() {
            let count = rest.len().min(AT_A_TIME);
            if count < rest.len() {
                rest.select_nth_unstable_by_key(count, |piece| piece.order);
            }
            let (near, far) = rest.split_at_mut(count);
            near.sort_unstable_by_key(|piece| piece.order);
            for piece in near {
                if tile.is_open(piece.span) {
                    let i = piece.point();
                    let light = || [self.threads.colour(i), self.threads.colour(i + 1)];
                    tile.piece(&self.threads.vertices[i], &self.threads.vertices[i + 1], light);
                }
            }
            let open = seen_first(far, |piece| tile.is_open(piece.span));
            rest = &mut far[..open];
        }
    }

    /// For parts of the hair, for each tile, the pieces that may touch it.
    fn pieces_of_tiles(&self, grid: [usize; 2]) -> Vec<Vec<Vec<Piece>>> {
        /// Strands a part: parts are fixed, so that the order does not depend on threads.
        const PART: usize = 512;
        let strands: Vec<usize> = (0..self.grown.counts.len()).collect();
        strands
            .par_chunks(PART)
            .map(|strands| {
                let mut tiles = vec![Vec::new(); grid[0] * grid[1]];
                for &n in strands {
                    let (start, end, count) = (self.grown.starts[n], self.grown.starts[n + 1], self.grown.counts[n]);
                    for i in (start..end).filter(|i| (i - start) % count + 1 < count) {
                        let (a, b) = (&self.threads.vertices[i], &self.threads.vertices[i + 1]);
                        let rectangle = rectangle(a, b);
                        for_tiles(rectangle, grid, |t| {
                            let origin = Vec2::new((t % grid[0] * TILE) as f32, (t / grid[0] * TILE) as f32);
                            tiles[t].push(Piece::new(i, a.depth + b.depth, Span::new(rectangle, origin)));
                        });
                    }
                }
                tiles
            })
            .collect()
    }

    fn faces_of_tiles(&self, grid: [usize; 2]) -> Vec<Vec<u32>> {
        let mut tiles = vec![Vec::new(); grid[0] * grid[1]];
        for (f, face) in self.faces.iter().enumerate() {
            let corners = face.map(|v| &self.skin[v as usize]);
            let reach = corners.iter().map(|c| c.motion.length()).fold(1.0, f32::max);
            let low = corners.iter().fold(Vec2::INFINITY, |m, c| m.min(c.at)) - reach;
            let high = corners.iter().fold(Vec2::NEG_INFINITY, |m, c| m.max(c.at)) + reach;
            for_tiles([low, high], grid, |t| tiles[t].push(f as u32));
        }
        tiles
    }
}

/// Puts those of which `seen` is true before the others, in any order; returns how many they are.
fn seen_first(pieces: &mut [Piece], seen: impl Fn(&Piece) -> bool) -> usize {
    let mut count = 0;
    for i in 0..pieces.len() {
        if seen(&pieces[i]) {
            pieces.swap(count, i);
            count += 1;
        }
    }
    count
}

fn for_tiles([low, high]: [Vec2; 2], grid: [usize; 2], mut f: impl FnMut(usize)) {
    if !(low.is_finite() && high.is_finite()) {
        return;
    }
    let tile = |v: f32| (v / TILE as f32).floor();
    let span = |low: f32, high: f32, n: usize| {
        let end = (tile(high) + 1.0).clamp(0.0, n as f32) as usize;
        (tile(low).max(0.0) as usize).min(end)..end
    };
    for y in span(low.y, high.y, grid[1]) {
        span(low.x, high.x, grid[0]).for_each(|x| f(y * grid[0] + x));
    }
}
