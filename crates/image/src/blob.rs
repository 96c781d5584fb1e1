//! Small coloured balls in images: a colour model from one picture, sub-pixel centres in the next.

use glam::{DVec2, Vec3};
use strandflow_core::RgbImage;

use crate::colour::opponent;

/// The look of a ball in the images.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blob {
    /// Mean opponent colour of the ball.
    pub colour: [f32; 3],
    /// Opponent colour around it.
    pub around: [f32; 3],
    /// Colour distance at which membership has fallen to e^(−1/2).
    pub spread: f32,
    /// Radius \[px\].
    pub radius: f64,
    /// Way of the ball while the shutter is open \[px\].
    pub streak: DVec2,
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

fn colour_at(image: &RgbImage, x: i64, y: i64) -> Option<[f32; 3]> {
    let inside = x >= 0 && y >= 0 && x < image.width as i64 && y < image.height as i64;
    inside.then(|| opponent(image[(x as usize, y as usize)].map(f32::from)))
}

/// Visits the pixels whose centre lies within `radius` of the line from `centre` − `half` to `centre` + `half`, a disc where
/// `half` is zero: (offset from the centre, distance from the line, column, row).
fn stadium(centre: DVec2, half: DVec2, radius: f64, mut visit: impl FnMut(DVec2, f64, i64, i64)) {
    let reach = half.abs() + radius;
    let (low, high) = ((centre - reach).floor(), (centre + reach).ceil());
    let squared = half.length_squared();
    for y in low.y as i64..=high.y as i64 {
        for x in low.x as i64..=high.x as i64 {
            let offset = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - centre;
            let along = if squared > 0.0 { (offset.dot(half) / squared).clamp(-1.0, 1.0) } else { 0.0 };
            let distance = (offset - half * along).length();
            if distance <= radius {
                visit(offset, distance, x, y);
            }
        }
    }
}

/// Colours in which distance counts.
fn weighted([l, a, b]: [f32; 3]) -> Vec3 {
    Vec3::new(LUMA_WEIGHT * l, a, b)
}

fn mixed(a: [f32; 3], b: [f32; 3], share: f32) -> [f32; 3] {
    [0, 1, 2].map(|k| a[k] + (b[k] - a[k]) * share)
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
        stadium(centre, DVec2::ZERO, 2.2 * radius, |_, distance, x, y| {
            let Some(colour) = colour_at(image, x, y) else { return };
            if distance < 0.6 * radius {
                ball.push(colour);
            } else if distance > 1.5 * radius {
                around.push(colour);
            }
        });
        let (colour, around) = (median_colour(ball)?, median_colour(around)?);
        let contrast = weighted(colour).distance(weighted(around));
        let spread = (0.4 * contrast).clamp(8.0, 40.0);
        (contrast > 12.0).then_some(Self { colour, around, spread, radius, streak: DVec2::ZERO })
    }

    /// The same ball, smeared, as it is to be seen at a point of an image: it moves by `way` \[px\] while the shutter is open,
    /// so that what is around it there shines through.
    ///
    /// Where the way is longer than the ball, a pixel on it is covered for (diameter / way) of the time; 0.7 of that is the
    /// mean over the streak in code values. Ways below a quarter of the radius are left out.
    pub fn smeared(&self, image: &RgbImage, at: DVec2, way: DVec2) -> Self {
        let lengths = way.length() / self.radius;
        if lengths < 0.25 {
            return *self;
        }
        let share = if lengths < 2.0 { 1.0 - 0.15 * lengths } else { 1.4 / lengths } as f32;
        let streak = Self { streak: way, ..*self };
        let around = streak.surroundings(image, at).unwrap_or(self.around);
        // Towards its ends a streak fades: what is a third as strong as its mean still belongs to it.
        let spread = (0.5 * share * weighted(self.colour).distance(weighted(around))).max(8.0);
        Self { colour: mixed(around, self.colour, share), around, spread, ..streak }
    }

    /// Median colour of what lies around the streak.
    fn surroundings(&self, image: &RgbImage, at: DVec2) -> Option<[f32; 3]> {
        let mut colours = Vec::new();
        stadium(at, self.half(), 2.2 * self.radius, |_, distance, x, y| {
            if distance > 1.5 * self.radius {
                colours.extend(colour_at(image, x, y));
            }
        });
        median_colour(colours)
    }

    /// The same ball in `gain` times the light (in code values).
    pub fn in_light(&self, gain: f32) -> Self {
        Self { colour: self.colour.map(|c| gain * c), around: self.around.map(|c| gain * c), ..*self }
    }

    /// The same ball, its colours moved by a share towards those of another look of it.
    pub fn towards(&self, other: &Self, share: f32) -> Self {
        Self {
            colour: mixed(self.colour, other.colour, share),
            around: mixed(self.around, other.around, share),
            ..*self
        }
    }

    /// Half of the line in whose surroundings a smeared ball is seen by more than half of its most.
    fn half(&self) -> DVec2 {
        let lengths = self.streak.length() / self.radius;
        self.streak * if lengths < 2.0 { 0.25 } else { 0.5 - 0.5 / lengths }
    }

    /// Membership of a pixel, 0 to 1.
    fn membership(&self, image: &RgbImage, x: i64, y: i64) -> f64 {
        let Some(colour) = colour_at(image, x, y) else { return 0.0 };
        let mut off = weighted(colour) - weighted(self.colour);
        if self.streak != DVec2::ZERO {
            // More of the ball than the streak's mean is the ball still.
            let towards = (weighted(self.colour) - weighted(self.around)).normalize_or_zero();
            off -= towards * off.dot(towards).max(0.0);
        }
        f64::from((-0.5 * off.length_squared() / (self.spread * self.spread)).exp())
    }

    /// Mean membership inside less the mean in the ring around.
    pub fn score(&self, image: &RgbImage, centre: DVec2) -> f64 {
        let (mut inside, mut n, mut ring, mut m) = (0.0, 0.0, 0.0, 0.0);
        stadium(centre, self.half(), 1.7 * self.radius, |_, distance, x, y| {
            let member = self.membership(image, x, y);
            if distance <= 0.9 * self.radius {
                (inside, n) = (inside + member, n + 1.0);
            } else if distance >= 1.2 * self.radius {
                (ring, m) = (ring + member, m + 1.0);
            }
        });
        inside / f64::max(n, 1.0) - ring / f64::max(m, 1.0)
    }

    /// The centroid of membership near a point (mean shift with a soft disc or streak, 12 steps at most).
    pub fn centroid(&self, image: &RgbImage, start: DVec2) -> DVec2 {
        let mut centre = start;
        for _ in 0..12 {
            let (mut sum, mut total) = (DVec2::ZERO, 0.0);
            stadium(centre, self.half(), 1.8 * self.radius, |offset, distance, x, y| {
                let window = ((1.8 - distance / self.radius) / 0.5).clamp(0.0, 1.0);
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

    /// The mean of the ball on its way.
    fn smeared_scene(centre: DVec2, way: DVec2) -> RgbImage {
        let moments: Vec<RgbImage> = (0..16).map(|k| scene(centre + way * ((k as f64 + 0.5) / 16.0 - 0.5))).collect();
        Plane::from_fn(80, 60, |x, y| {
            [0, 1, 2].map(|c| (moments.iter().map(|m| u32::from(m[(x, y)][c])).sum::<u32>() / 16) as u8)
        })
    }

    #[test]
    fn a_smeared_ball_is_found_by_its_streak() {
        let blob = Blob::learn(&scene(DVec2::new(30.2, 25.7)), DVec2::new(30.5, 25.2), 4.5).unwrap();
        let truth = DVec2::new(40.6, 29.3);
        for way in [DVec2::new(7.0, 3.0), DVec2::new(-16.0, 9.0)] {
            let image = smeared_scene(truth, way);
            let smeared = blob.smeared(&image, truth, way);
            let found = smeared.search(&image, truth + DVec2::new(5.0, -4.0), 12.0).unwrap();
            assert!(found.centre.distance(truth) < 0.5 && found.score > 0.4, "{found:?} of {way}");
            if way.length() > 2.0 * blob.radius {
                assert!(found.score > blob.score(&image, truth) + 0.1, "unsmeared it is lost");
            }
        }
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
