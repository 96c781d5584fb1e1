//! Which moment of the capture each frame of an animation shows.

/// A walk over the frames of a capture: once, or to and fro.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timeline {
    /// First and last captured frame.
    pub first: usize,
    /// See `first`; not before it.
    pub last: usize,
    /// Captured frames a frame of the animation: 1 as captured, 0.5 at half speed.
    pub speed: f64,
    /// Frames to make; more than the capture has go back and forth.
    pub frames: usize,
}

/// Frames over which a walk to and fro turns, on either side: hair that turned from one frame to the next would jerk.
const TURN_FRAMES: f64 = 6.0;

impl Timeline {
    /// Once through the frames `first..=last`.
    pub fn once(first: usize, last: usize, speed: f64) -> Self {
        let frames = ((last - first) as f64 / speed + 1e-9).floor() as usize + 1;
        Self { first, last, speed, frames }
    }

    /// The captured time that frame `k` shows \[frames\]; `k` may lie between frames.
    pub fn source(&self, k: f64) -> f64 {
        let length = (self.last - self.first) as f64;
        let walked = k * self.speed;
        if length <= 0.0 || walked <= 0.0 {
            return self.first as f64;
        }
        if self.frames as f64 <= length / self.speed + 1.0 + 1e-9 {
            return self.first as f64 + walked.min(length);
        }
        // A triangle wave with corners rounded by parabolas; it starts at full speed.
        let ease = TURN_FRAMES.min(length / 2.0);
        let u = walked.rem_euclid(2.0 * length);
        let triangle = length - (u - length).abs();
        let from_top = (u - length).abs();
        let from_bottom = if walked < length { f64::INFINITY } else { u.min(2.0 * length - u) };
        let rounded = if from_top < ease {
            length - 0.5 * ease - from_top * from_top / (2.0 * ease)
        } else if from_bottom < ease {
            0.5 * ease + from_bottom * from_bottom / (2.0 * ease)
        } else {
            triangle
        };
        self.first as f64 + rounded
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn once_shows_every_frame_and_half_speed_twice_as_many() {
        let as_captured = Timeline::once(3, 32, 1.0);
        assert_eq!((as_captured.frames, as_captured.source(0.0), as_captured.source(29.0)), (30, 3.0, 32.0));
        let slow = Timeline::once(3, 32, 0.5);
        assert_eq!((slow.frames, slow.source(1.0), slow.source(58.0)), (59, 3.5, 32.0));
    }

    #[test]
    fn to_and_fro_stays_in_the_capture_and_never_jerks() {
        let walk = Timeline { frames: 200, ..Timeline::once(0, 29, 1.0) };
        let times: Vec<f64> = (0..2000).map(|k| walk.source(f64::from(k) * 0.1)).collect();
        assert!(times.iter().all(|t| (0.0..=29.0).contains(t)));
        let speeds: Vec<f64> = times.windows(2).map(|t| (t[1] - t[0]) / 0.1).collect();
        assert!(speeds.iter().any(|s| *s < -0.99) && speeds.iter().all(|s| s.abs() < 1.0 + 1e-6));
        assert!(speeds.windows(2).all(|s| (s[1] - s[0]).abs() < 0.1), "a speed of one changes over twelve frames");
    }
}
