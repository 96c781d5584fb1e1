//! What neighbouring frames show of the same hair, carried along the flow of the images.
//!
//! Noise, highlights and crossings of layers change from frame to frame, the direction of the hair hardly does: the mean of
//! the doubled angles of five frames is surer than that of one. Reference for the mean: Granlund & Knutsson 1995.
//!
//! Deviation (robust mode): the paper reads every frame by itself. What it brings is in `docs/steps.md`.

use strandflow_core::{Mask, Plane, RgbImage};
pub use strandflow_image::flow::Flow;
use strandflow_image::{filter::either_side, flow::coarse_flow, region::Region, sample::bilinear_of};

use super::{OrientationMap, angle_of, length};

/// Halvings between an image and its flow: orientations are pooled over more pixels than a flow of this size errs by.
const FLOW_HALVINGS: usize = 3;
/// Pixels of [`Moment::half`] along one of [`Moment::back`].
const HALF_A_FLOW: f32 = (1 << (FLOW_HALVINGS - 1)) as f32;

/// A frame as its neighbours see it.
#[derive(Clone, Debug, PartialEq)]
pub struct Moment {
    /// Its own orientations at half the resolution of the image.
    pub half: OrientationMap,
    /// Where its hair was in the frame before it, at an eighth of the resolution \[px of that size\].
    pub back: Flow,
}

/// Width and height of [`Moment::half`] for an image's.
pub fn half_size((width, height): (usize, usize)) -> (usize, usize) {
    (width.div_ceil(2), height.div_ceil(2))
}

/// Width and height of [`Moment::back`] for an image's.
pub fn flow_size(image: (usize, usize)) -> (usize, usize) {
    (0..FLOW_HALVINGS).fold(image, |size, _| half_size(size))
}

/// [`Moment::back`] of an image; zero away from the hair.
pub fn flow_back(image: &RgbImage, before: &RgbImage, hair: &Mask) -> Flow {
    let (width, height) = flow_size((image.width, image.height));
    let mut back = Flow::zero(width, height);
    let Some(bounds) = Region::bounding(hair, |&m| m >= 128) else { return back };
    // Begins with a whole block of pixels, so that the region's coarse pixels are those of the image.
    let block = 1 << FLOW_HALVINGS;
    let near = bounds.grown(4 * block, image.width, image.height);
    let (x, y) = (near.x / block, near.y / block);
    let (right, bottom) = (near.x + near.width, near.y + near.height);
    let region = Region { x: x * block, y: y * block, width: right - x * block, height: bottom - y * block };
    let found = coarse_flow(image, before, region, FLOW_HALVINGS);
    let place = Region { x, y, width: found.u.width, height: found.u.height };
    place.paste(&found.u, &mut back.u);
    place.paste(&found.v, &mut back.v);
    back
}

/// [`Moment::half`] of a map: means over blocks of 2 × 2 pixels, of those that are hair.
pub fn half(map: &OrientationMap) -> OrientationMap {
    let (width, height) = half_size((map.angle.width, map.angle.height));
    let mut votes = Plane::filled(width, height, [0.0; 3]);
    for (x, y) in hair_of(map).into_iter().flat_map(Region::pixels) {
        add(&mut votes[(x / 2, y / 2)], vote(map, (x, y)));
    }
    let (angle, confidence) = votes.data.into_iter().map(read).unzip();
    let plane = |data| Plane { width, height, data };
    OrientationMap { angle: plane(angle), confidence: plane(confidence) }
}

/// A frame's map together with what the frames before and after it show, nearest first. `back` is the frame's own flow to
/// the frame before. Doubled angles are averaged with squared confidence as weight, and the confidence is that of their mean:
/// it falls where the frames disagree.
pub fn steady(own: &OrientationMap, back: &Flow, before: &[Moment], after: &[Moment]) -> OrientationMap {
    let Some(region) = hair_of(own) else { return own.clone() };
    let mut others = Others::of(own, region);
    let mut way = back.clone();
    for moment in before {
        others.hear(&moment.half, &way);
        way = way.then(&moment.back);
    }
    let mut way = Flow::zero(back.u.width, back.u.height);
    for moment in after {
        way = way.then(&moment.back.inverse());
        others.hear(&moment.half, &way);
    }
    let mut out = own.clone();
    let mut heard = vec![[0.0; 3]; region.width];
    for y in region.y..region.y + region.height {
        others.row(region.x, y, &mut heard);
        for (x, &heard) in (region.x..).zip(&heard).filter(|(x, _)| own.confidence[(*x, y)] > 0.0) {
            let at = (x, y);
            let mut votes = vote(own, at);
            add(&mut votes, heard);
            (out.angle[at], out.confidence[at]) = read(votes);
        }
    }
    out
}

/// The rectangle in which a map has orientations.
fn hair_of(map: &OrientationMap) -> Option<Region> {
    Region::bounding(&map.confidence, |&c| c > 0.0)
}

/// c² cos 2a, c² sin 2a and how many pixels said so: what adds up.
type Votes = [f32; 3];

fn add(sum: &mut Votes, more: Votes) {
    sum.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
}

fn vote(map: &OrientationMap, at: (usize, usize)) -> Votes {
    let (angle, confidence) = (map.angle[at], map.confidence[at]);
    if confidence <= 0.0 {
        return [0.0; 3];
    }
    let (sine, cosine) = (2.0 * angle).sin_cos();
    let weight = confidence * confidence;
    [weight * cosine, weight * sine, 1.0]
}

/// Angle in [0, π) and confidence of a sum.
fn read([cos2, sin2, count]: Votes) -> (f32, f32) {
    if count <= 0.0 {
        return (0.0, 0.0);
    }
    (angle_of(cos2, sin2), (length(cos2, sin2) / count).sqrt().min(1.0))
}

/// What other frames say about the hair of this one, at half its resolution.
struct Others {
    votes: Plane<Votes>,
    /// The pixels (column, row) that hair pixels of the image lie between.
    asked: Vec<[usize; 2]>,
}

impl Others {
    fn of(own: &OrientationMap, region: Region) -> Self {
        let (width, height) = half_size((own.angle.width, own.angle.height));
        let mut near = Plane::filled(width, height, false);
        for (x, y) in region.pixels().filter(|&at| own.confidence[at] > 0.0) {
            let ([left, right], [above, below]) = (either_side(x, width), either_side(y, height));
            for at in [(left, above), (right, above), (left, below), (right, below)] {
                near[at] = true;
            }
        }
        let asked = Region::whole(&near).pixels().filter(|&at| near[at]).map(|(x, y)| [x, y]).collect();
        Self { votes: Plane::filled(width, height, [0.0; 3]), asked }
    }

    /// Adds another frame's map as the flow to that frame shows it.
    fn hear(&mut self, half: &OrientationMap, way: &Flow) {
        let mut votes = Plane::filled(half.angle.width, half.angle.height, [0.0; 3]);
        hair_of(half).into_iter().flat_map(Region::pixels).for_each(|at| votes[at] = vote(half, at));
        for &[x, y] in &self.asked {
            let (u, v) = (x as f32 + 0.5, y as f32 + 0.5);
            let [du, dv] = way.at(u / HALF_A_FLOW, v / HALF_A_FLOW);
            add(&mut self.votes[(x, y)], bilinear_of(&votes, u + HALF_A_FLOW * du, v + HALF_A_FLOW * dv));
        }
    }

    /// What was heard about a row of pixels of the image, from column `x` on; linear between the centres of votes.
    fn row(&self, x: usize, y: usize, heard: &mut [Votes]) {
        let [above, below] = either_side(y, self.votes.height).map(|row| self.votes.row(row));
        let between = |near: &Votes, far: &Votes| std::array::from_fn(|k| 0.75 * near[k] + 0.25 * far[k]);
        for (x, heard) in (x..).zip(heard) {
            let [left, right] =
                either_side(x, self.votes.width).map(|column| -> Votes { between(&above[column], &below[column]) });
            *heard = between(&left, &right);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (usize, usize) = (80, 64);

    /// Stripes at `angle` within a disc around (`x`, 32), with another error in every frame.
    fn frame(x: f32, angle: f32, error: f32) -> OrientationMap {
        let inside = |u: usize, v: usize| (u as f32 - x).hypot(v as f32 - 32.0) < 20.0;
        let plane = |value: f32| Plane::from_fn(SIZE.0, SIZE.1, |u, v| if inside(u, v) { value } else { 0.0 });
        OrientationMap { angle: plane((angle + error).rem_euclid(std::f32::consts::PI)), confidence: plane(0.8) }
    }

    fn moment(map: &OrientationMap, back_px: f32) -> Moment {
        let (width, height) = flow_size(SIZE);
        let mut back = Flow::zero(width, height);
        back.u.data.fill(back_px / (1 << FLOW_HALVINGS) as f32);
        Moment { half: half(map), back }
    }

    fn off(found: f32, truth: f32) -> f32 {
        let d = (found - truth).rem_euclid(std::f32::consts::PI);
        d.min(std::f32::consts::PI - d)
    }

    #[test]
    fn errors_of_moving_hair_average_out_across_the_wrap_of_angles() {
        // Hair that moves 6 px a frame; lines near 0 that noise turns to both sides of the wrap.
        let errors = [0.3f32, -0.25, 0.2, -0.3, 0.15];
        let maps: Vec<_> = (0..5).map(|t| frame(28.0 + 6.0 * t as f32, 0.02, errors[t])).collect();
        let moments: Vec<_> = maps.iter().map(|map| moment(map, -6.0)).collect();
        let (before, after) = ([moments[1].clone(), moments[0].clone()], [moments[3].clone(), moments[4].clone()]);
        let found = steady(&maps[2], &moments[2].back, &before, &after);
        for at in [(40, 32), (30, 28), (52, 38)] {
            assert!(off(found.angle[at], 0.02 + errors.iter().sum::<f32>() / 5.0) < 0.01, "{}", found.angle[at]);
            // Frames that disagree are believed less, and only by that.
            assert!((0.75..0.8).contains(&found.confidence[at]), "{}", found.confidence[at]);
        }
        assert_eq!((found.angle[(5, 5)], found.confidence[(5, 5)]), (0.0, 0.0));
        assert_eq!(steady(&maps[2], &moments[2].back, &[], &[]).confidence[(2, 2)], 0.0);
    }

    #[test]
    fn hair_that_a_neighbour_does_not_show_keeps_its_own_orientation() {
        let own = frame(40.0, 1.0, 0.0);
        let away = moment(&frame(200.0, 0.0, 0.0), 0.0);
        let found = steady(&own, &away.back, std::slice::from_ref(&away), &[]);
        assert!(off(found.angle[(40, 32)], 1.0) < 1e-3 && (found.confidence[(40, 32)] - 0.8).abs() < 1e-3);
    }

    #[test]
    fn rows_between_votes_are_bilinear_up_to_the_border() {
        // Sides that are no multiple of two.
        let own = OrientationMap { angle: Plane::filled(13, 9, 1.0), confidence: Plane::filled(13, 9, 0.5) };
        let mut others = Others::of(&own, Region::whole(&own.angle));
        assert_eq!(others.asked.len(), 7 * 5);
        others.votes.data.iter_mut().enumerate().for_each(|(i, votes)| *votes = [i as f32, (i * i % 17) as f32, 1.0]);
        let mut row = vec![[0.0; 3]; 13];
        for y in 0..9 {
            others.row(0, y, &mut row);
            for (x, found) in row.iter().enumerate() {
                let expected = bilinear_of(&others.votes, 0.5 * (x as f32 + 0.5), 0.5 * (y as f32 + 0.5));
                assert!(
                    found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-4),
                    "({x}, {y}): {found:?}, {expected:?}"
                );
            }
        }
    }

    #[test]
    fn what_moved_is_found_where_it_was() {
        let (width, height) = (160, 128);
        let texture = |x: f32, y: f32| 128.0 + 60.0 * (0.11 * x).sin() + 50.0 * (0.09 * y + 0.05 * x).cos();
        let image = |shift: f32| Plane::from_fn(width, height, |x, y| [texture(x as f32 - shift, y as f32) as u8; 3]);
        let hair =
            Plane::from_fn(width, height, |x, y| u8::from((41..120).contains(&x) && (27..100).contains(&y)) * 255);
        let back = flow_back(&image(12.0), &image(0.0), &hair);
        assert_eq!((back.u.width, back.u.height), (20, 16));
        let [u, v] = back.at(10.0, 8.0).map(|way| way * (1 << FLOW_HALVINGS) as f32);
        assert!((u + 12.0).abs() < 1.5 && v.abs() < 1.5, "{u} {v}");
    }
}
