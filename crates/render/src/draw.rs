//! Hair and skin into the tiles of a picture, from the nearest to the farthest.

use std::time::{Duration, Instant};

use glam::Vec2;
use rayon::prelude::*;
use strandflow_core::Plane;

use crate::{
    account::Account,
    groom::Grown,
    picture::Picture,
    raster::{Fragment, Span, TILE, Tile, rectangle},
    skin::SkinVertex,
    thread::{Threads, Vertex},
};

/// What is drawn.
pub(crate) struct Drawn<'a> {
    /// The hair.
    pub grown: &'a Grown,
    /// Its light.
    pub threads: &'a Threads<'a>,
    /// The head's faces.
    pub faces: &'a [[u32; 3]],
    /// Its vertices.
    pub skin: &'a [SkinVertex],
    /// Whether the head is seen; else it only hides.
    pub draw_skin: bool,
}

/// Draws a picture of a width and a height \[px\].
pub(crate) fn draw(drawn: &Drawn, [width, height]: [usize; 2], account: &mut Account) -> Picture {
    let grid = [width.div_ceil(TILE), height.div_ceil(TILE)];
    let parts = drawn.pieces_of_tiles(grid);
    let faces = drawn.faces_of_tiles(grid);
    account.end("deal to tiles", "pieces", parts.iter().flatten().map(Vec::len).sum());
    let tiles: Vec<(Vec<[f32; 4]>, Work)> = (0..grid[0] * grid[1])
        .into_par_iter()
        .map(|t| {
            let mut tile = Tile::new([t % grid[0] * TILE, t / grid[0] * TILE]);
            tile.skin(drawn.faces, &faces[t], drawn.skin);
            let work = drawn.hair(&mut tile, parts.iter().map(|part| part[t].as_slice()).collect::<Vec<_>>().concat());
            let pixel = if drawn.draw_skin { Tile::pixel } else { Tile::hair_of_pixel };
            ((0..TILE * TILE).map(|i| pixel(&tile, i % TILE, i / TILE)).collect(), work)
        })
        .collect();
    let sum = |of: &dyn Fn(&Work) -> (usize, Duration)| {
        tiles.iter().map(|(_, work)| of(work)).fold((0, Duration::ZERO), |sum, w| (sum.0 + w.0, sum.1 + w.1))
    };
    account.end("draw", "tiles", tiles.len());
    account.within("draw: order", "pieces", sum(&|work| work.ordered));
    account.within("draw: cover", "fragments", sum(&|work| work.covered));
    account.within("draw: light", "points", sum(&|work| work.lit));
    account.within("draw: add", "fragments", sum(&|work| (work.covered.0, work.added)));
    let linear =
        Plane::from_fn(width, height, |x, y| tiles[y / TILE * grid[0] + x / TILE].0[y % TILE * TILE + x % TILE]);
    Picture { linear }
}

/// What was done in a tile, and how long it took.
#[derive(Default)]
struct Work {
    ordered: (usize, Duration),
    covered: (usize, Duration),
    lit: (usize, Duration),
    added: Duration,
}

/// A piece of a hair in a tile.
#[derive(Clone, Copy)]
struct Piece {
    /// Depths are positive: their bits are in the order of the numbers.
    depth: u32,
    /// Its first point.
    point: u32,
    /// What it may touch.
    span: Span,
}

impl Piece {
    /// Of equally far ones the first is nearer.
    fn order(&self) -> u64 {
        u64::from(self.depth) << 32 | u64::from(self.point)
    }
}

/// Pieces that are seen, with what they add to pixels.
#[derive(Default)]
struct Strokes {
    fragments: Vec<Fragment>,
    /// First point of each piece, and where its fragments end.
    pieces: Vec<(u32, usize)>,
    /// Points of the pieces, ascending.
    points: Vec<u32>,
}

impl Strokes {
    fn clear(&mut self) {
        self.fragments.clear();
        self.pieces.clear();
        self.points.clear();
    }

    /// What came to the fragments since the last piece is of this one.
    fn end_piece(&mut self, point: u32) {
        if self.pieces.last().map_or(0, |last| last.1) < self.fragments.len() {
            self.pieces.push((point, self.fragments.len()));
        }
    }

    fn gather_points(&mut self) {
        self.points.extend(self.pieces.iter().flat_map(|(point, _)| [*point, point + 1]));
        self.points.sort_unstable();
        self.points.dedup();
    }
}

impl Drawn<'_> {
    /// Lays pieces over a tile from the nearest to the farthest. Most are behind hair that hides them: they are neither
    /// sorted nor looked at. Those that are seen are lit together.
    fn hair(&self, tile: &mut Tile, mut pieces: Vec<Piece>) -> Work {
        /// Pieces that are sorted and lit at a time: four a pixel. With fewer, neighbours along a hair are lit apart.
        const AT_A_TIME: usize = 4 * TILE * TILE;
        let mut work = Work::default();
        let mut strokes = Strokes::default();
        let mut rest = pieces.as_mut_slice();
        let mut open_count = tile.open_count();
        while !rest.is_empty() {
            let start = Instant::now();
            let count = rest.len().min(AT_A_TIME);
            if count < rest.len() {
                rest.select_nth_unstable_by_key(count, Piece::order);
            }
            let (near, far) = rest.split_at_mut(count);
            near.sort_unstable_by_key(Piece::order);
            let ordered = Instant::now();
            strokes.clear();
            self.cover(tile, near, &mut strokes);
            let covered = Instant::now();
            strokes.gather_points();
            let lit_points = self.threads.light_up(&strokes.points);
            let lit = Instant::now();
            self.add(tile, &strokes);
            let added = Instant::now();
            // To look through all that are left pays only when some more are hidden.
            let is_fewer = tile.open_count() + TILE < open_count;
            let open = if is_fewer { seen_first(far, |piece| tile.is_open(piece.span)) } else { far.len() };
            open_count = if is_fewer { tile.open_count() } else { open_count };
            rest = &mut far[..open];
            work.ordered = (work.ordered.0 + count, work.ordered.1 + (ordered - start) + added.elapsed());
            work.covered = (work.covered.0 + strokes.fragments.len(), work.covered.1 + (covered - ordered));
            work.lit = (work.lit.0 + lit_points, work.lit.1 + (lit - covered));
            work.added += added - lit;
        }
        work
    }

    /// Lays sorted pieces.
    fn cover(&self, tile: &mut Tile, near: &[Piece], strokes: &mut Strokes) {
        /// Pieces whose ends are fetched together: they lie all over the memory, and are waited for together.
        const AT_HAND: usize = 64;
        let vertices = &self.grown.vertices;
        let mut at_hand: Vec<(Piece, [Vertex; 2])> = Vec::with_capacity(AT_HAND);
        for near in near.chunks(AT_HAND) {
            at_hand.clear();
            let open = near.iter().filter(|piece| tile.is_open(piece.span));
            at_hand.extend(open.map(|piece| {
                let i = piece.point as usize;
                (*piece, [vertices[i], vertices[i + 1]])
            }));
            for (piece, [a, b]) in &at_hand {
                if tile.is_open(piece.span) {
                    tile.piece(a, b, &mut strokes.fragments);
                    strokes.end_piece(piece.point);
                }
            }
        }
    }

    /// Adds the light of pieces, whose points are lit.
    fn add(&self, tile: &mut Tile, strokes: &Strokes) {
        let mut start = 0;
        for &(point, end) in &strokes.pieces {
            let ends = [self.threads.light_of(point), self.threads.light_of(point + 1)];
            tile.light(ends, &strokes.fragments[start..end]);
            start = end;
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
                    for (hair, vertices) in self.grown.vertices[start..end].chunks(count.max(1)).enumerate() {
                        let first = start + hair * count;
                        for (k, pair) in vertices.windows(2).enumerate() {
                            let rectangle = rectangle(&pair[0], &pair[1]);
                            let (depth, point) = ((pair[0].depth + pair[1].depth).to_bits(), (first + k) as u32);
                            for_tiles(rectangle, grid, |t| {
                                let origin = Vec2::new((t % grid[0] * TILE) as f32, (t / grid[0] * TILE) as f32);
                                tiles[t].push(Piece { depth, point, span: Span::new(rectangle, origin) });
                            });
                        }
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
    // Casts cut off: of numbers that are not negative that is the floor, and faster than asking for it.
    let span = |low: f32, high: f32, n: usize| {
        let end = if high < 0.0 { 0 } else { (high as usize / TILE + 1).min(n) };
        (low.max(0.0) as usize / TILE).min(end)..end
    };
    for y in span(low.y, high.y, grid[1]) {
        span(low.x, high.x, grid[0]).for_each(|x| f(y * grid[0] + x));
    }
}
