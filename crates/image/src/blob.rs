//! Small coloured balls in images: a colour model from one picture, sub-pixel centres in the next.

use glam::DVec2;
use strandflow_core::RgbImage;

use crate::colour::opponent;

/// The look of a ball in the images.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blob {
    /// Mean opponent colour of the ball.
    pub colour: [f32; 3],
    /// Colour distance at which membership has fallen to e^(−1/2).
    pub spread: f32,
    /// Radius \[px\].
    pub radius: f64,
}

/// A ball found in an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// Centre \[px\].
    pub centre: DVec2,
    /// Mean membership within the radius less that in the ring around it, −1 to 1.
    pub score: f64,
}

/// Brightness counts less than hue: the lit and the dark side of a ball are one ball.
const LUMA_WEIGHT: f32 = 0.35;

fn distance2(a: [f32; 3], b: [f32; 3]) -> f32 {
    let l = LUMA_WEIGHT * (a[0] - b[0]);
    l * l + (a[1] - b[1]).powi(2) + (a[2] - b[2]).powi(2)
}

fn colour_at(image: &RgbImage, x: i64, y: i64) -> Option<[f32; 3]> {
    let inside = x >= 0 && y >= 0 && x < image.width as i64 && y < image.height as i64;
    inside.then(|| opponent(image[(x as usize, y as usize)].map(f32::from)))
}

/// Visits the pixels whose centre lies within `radius` of `centre`: (offset from the centre, column, row).
fn disc(centre: DVec2, radius: f64, mut visit: impl FnMut(DVec2, i64, i64)) {
    let (low, high) = ((centre - radius).floor(), (centre + radius).ceil());
    for y in low.y as i64..=high.y as i64 {
        for x in low.x as i64..=high.x as i64 {
            let offset = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - centre;
            if offset.length() <= radius {
                visit(offset, x, y);
            }
        }
    }
}

fn median_colour(mut colours: Vec<[f32; 3]>) -> Option<[f32; 3]> {
    if colours.is_empty() {
        return None;
    }
    let middle = colours.len() / 2;
    Some([0, 1, 2].map(|k| {
        colours.sort_by(|a, b| a[k].total_cmp(&b[k]));
        colours[middle][k]
    }))
}

impl Blob {
    /// Learns the ball at a labelled point; `None` where it lies outside the image or looks like what is around it.
    pub fn learn(image: &RgbImage, centre: DVec2, radius: f64) -> Option<Self> {
        let (mut ball, mut around) = (Vec::new(), Vec::new());
        disc(centre, 2.2 * radius, |offset, x, y| {
            let Some(colour) = colour_at(image, x, y) else { return };
            if offset.length() < 0.6 * radius {
                ball.push(colour);
            } else if offset.length() > 1.5 * radius {
                around.push(colour);
            }
        });
        let (colour, around) = (median_colour(ball)?, median_colour(around)?);
        let contrast = distance2(colour, around).sqrt();
        (contrast > 12.0).then(|| Self { colour, spread: (0.4 * contrast).clamp(8.0, 40.0), radius })
    }

    /// Membership of a pixel, 0 to 1.
    fn membership(&self, image: &RgbImage, x: i64, y: i64) -> f64 {
        let Some(colour) = colour_at(image, x, y) else { return 0.0 };
        f64::from((-0.5 * distance2(colour, self.colour) / (self.spread * self.spread)).exp())
    }

    /// Mean membership inside less the mean in the ring around.
    pub fn score(&self, image: &RgbImage, centre: DVec2) -> f64 {
        let (mut inside, mut n, mut ring, mut m) = (0.0, 0.0, 0.0, 0.0);
        disc(centre, 1.7 * self.radius, |offset, x, y| {
            let member = self.membership(image, x, y);
            if offset.length() <= 0.9 * self.radius {
                (inside, n) = (inside + member, n + 1.0);
            } else if offset.length() >= 1.2 * self.radius {
                (ring, m) = (ring + member, m + 1.0);
            }
        });
        inside / f64::max(n, 1.0) - ring / f64::max(m, 1.0)
    }

    /// The centroid of membership near a point (mean shift with a soft disc, 12 steps at most).
    pub fn centroid(&self, image: &RgbImage, start: DVec2) -> DVec2 {
        let mut centre = start;
        for _ in 0..12 {
            let (mut sum, mut total) = (DVec2::ZERO, 0.0);
            disc(centre, 1.8 * self.radius, |offset, x, y| {
                let window = ((1.8 - offset.length() / self.radius) / 0.5).clamp(0.0, 1.0);
                let w = window * self.membership(image, x, y);
                sum += offset * w;
                total += w;
            });
            if total < 0.5 {
                break;
            }
            let step = sum / total;
            centre += step;
            if step.length() < 1e-3 {
                break;
            }
        }
        centre
    }

    /// Searches the ball within `reach` \[px\] of a predicted point; the nearer of two equals wins.
    pub fn search(&self, image: &RgbImage, predicted: DVec2, reach: f64) -> Option<Found> {
        let mut best: Option<(f64, DVec2)> = None;
        let steps = (reach / 2.0).ceil() as i64;
        for j in -steps..=steps {
            for i in -steps..=steps {
                let offset = DVec2::new(i as f64, j as f64) * 2.0;
                if offset.length() > reach {
                    continue;
                }
                let score = self.score(image, predicted + offset) - 0.15 * offset.length() / reach.max(1.0);
                if best.is_none_or(|(s, _)| score > s) {
                    best = Some((score, predicted + offset));
                }
            }
        }
        let centre = self.centroid(image, best?.1);
        (centre.distance(predicted) <= reach + self.radius).then(|| Found { centre, score: self.score(image, centre) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use strandflow_core::Plane;

    fn scene(centre: DVec2) -> RgbImage {
        let mut state = 3u32;
        Plane::from_fn(80, 60, |x, y| {
            let d = DVec2::new(x as f64 + 0.5, y as f64 + 0.5).distance(centre);
            let a = (5.0 - d).clamp(0.0, 1.0);
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let n = f64::from(state >> 24) / 16.0 - 8.0;
            [(220.0, 120.0), (40.0, 95.0), (50.0, 70.0)].map(|(f, b)| (a * f + (1.0 - a) * b + n) as u8)
        })
    }

    #[test]
    fn a_ball_is_found_to_a_tenth_of_a_pixel() {
        let blob = Blob::learn(&scene(DVec2::new(30.2, 25.7)), DVec2::new(30.5, 25.2), 4.5).unwrap();
        let truth = DVec2::new(38.63, 20.31);
        let found = blob.search(&scene(truth), DVec2::new(31.0, 26.0), 12.0).unwrap();
        assert!(found.centre.distance(truth) < 0.12 && found.score > 0.5, "{found:?}");
        assert!(blob.score(&scene(truth), DVec2::new(10.0, 10.0)) < 0.2);
        assert!(Blob::learn(&scene(truth), DVec2::new(10.0, 10.0), 4.5).is_none());
    }
}
