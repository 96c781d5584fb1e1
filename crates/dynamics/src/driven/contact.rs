//! Strands outside of what they may not enter, with edges that keep their lengths.

use glam::DVec3;

/// What a particle meets where it is inside something, world space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// How far the particle has to go to be free \[mm\].
    pub depth: f64,
    /// Unit direction of the shortest way out.
    pub normal: DVec3,
    /// Whether the thing moves with the head; else it stands still.
    pub on_head: bool,
}

/// Rounds in which one particle is brought out and back to its edge's length, in turns. Ten bring a strand that points straight
/// at a skull around it.
const ROUNDS: usize = 24;
/// Depth that counts as free \[mm\].
const FREE_MM: f64 = 0.01;

/// Moves the particles of a strand so that each edge has its length and no particle and no middle of an edge is inside
/// anything, from the root on; what hangs on a particle moves with it.
///
/// `points`: root first \[mm\]; the first `held` stay where they are. `lengths`: least and most length of the edge that ends at a
/// particle \[mm\]. `contact`: what a point meets. `touched` hears which particle met what. Where both cannot be had, strands stay
/// out rather than keep their lengths.
pub fn lay_outside(
    points: &mut [DVec3],
    held: usize,
    lengths: impl Fn(usize) -> (f64, f64),
    contact: impl Fn(DVec3) -> Option<Contact>,
    mut touched: impl FnMut(usize, &Contact),
) {
    let mut shift = DVec3::ZERO;
    for i in held.max(1)..points.len() {
        let (before, given, (least, most)) = (points[i - 1], points[i], lengths(i));
        let mut point = given + shift;
        // Where a particle that was pushed back onto the one before it goes.
        let mut out = DVec3::ZERO;
        for _ in 0..ROUNDS {
            let edge = point - before;
            let length = edge.length();
            let limited = length.clamp(least, most);
            if limited != length {
                point = before + edge.normalize_or(out) * limited;
            }
            let mut free = true;
            let mut push = |met: Option<Contact>, share: f64| {
                let Some(met) = met.filter(|met| met.depth > FREE_MM) else { return DVec3::ZERO };
                free = false;
                touched(i, &met);
                out = met.normal;
                met.normal * (met.depth * share)
            };
            point += push(contact(point), 1.0);
            // The middle of an edge goes half as far as its end.
            point += push(contact(before.midpoint(point)), 2.0);
            if free {
                break;
            }
        }
        shift = point - given;
        points[i] = point;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RADIUS: f64 = 80.0;

    fn ball(point: DVec3) -> Option<Contact> {
        let depth = RADIUS - point.length();
        (depth > 0.0).then(|| Contact { depth, normal: point.normalize_or(DVec3::Z), on_head: true })
    }

    #[test]
    fn strands_in_a_ball_come_out_with_their_lengths() {
        for n in 0..50 {
            // From a root on the ball, straight through its middle or beside it.
            let root = DVec3::Z * RADIUS;
            let to = DVec3::new(0.6 * f64::from(n), 0.3 * f64::from(n % 7), -RADIUS);
            let mut points: Vec<DVec3> = (0..30).map(|i| root + (to - root).normalize() * 5.0 * f64::from(i)).collect();
            lay_outside(&mut points, 1, |_| (4.95, 5.05), ball, |_, _| {});
            for pair in points.windows(2) {
                assert!(pair[1].length() > RADIUS - 0.1, "{n}: {pair:?}");
                assert!(pair[0].midpoint(pair[1]).length() > RADIUS - 0.1, "{n}: {pair:?}");
                let edge = pair[0].distance(pair[1]);
                assert!((4.9..=5.1).contains(&edge), "{n}: {edge} mm");
            }
        }
    }

    #[test]
    fn what_is_free_and_of_its_length_stays() {
        let given: Vec<DVec3> = (0..20).map(|i| DVec3::new(100.0, f64::from(i), -5.0 * f64::from(i))).collect();
        let mut points = given.clone();
        let mut met = 0;
        lay_outside(&mut points, 1, |_| (5.0, 5.2), ball, |_, _| met += 1);
        assert_eq!((points, met), (given, 0));
    }
}
