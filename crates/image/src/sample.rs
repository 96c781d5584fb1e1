//! Sampling between pixels. Points are image points: the first pixel's centre is (0.5, 0.5); borders are repeated.

use strandflow_core::Plane;

/// Bilinear sample at an image point \[px\].
#[inline]
pub fn bilinear(plane: &Plane<f32>, u: f32, v: f32) -> f32 {
    let Corners { at, share } = Corners::around(plane, u, v);
    share.of(at.map(|at| plane.data[at]))
}

/// [`bilinear`] of several values a pixel at once.
#[inline]
pub fn bilinear_of<const N: usize>(plane: &Plane<[f32; N]>, u: f32, v: f32) -> [f32; N] {
    let Corners { at, share } = Corners::around(plane, u, v);
    let corners = at.map(|at| &plane.data[at]);
    let mut out = [0.0; N];
    out.iter_mut().enumerate().for_each(|(k, out)| *out = share.of(corners.map(|values| values[k])));
    out
}

/// [`bilinear`] of two planes of one size at once.
#[inline]
pub fn bilinear_both([first, second]: [&Plane<f32>; 2], u: f32, v: f32) -> [f32; 2] {
    debug_assert_eq!((first.width, first.height), (second.width, second.height));
    let Corners { at, share } = Corners::around(first, u, v);
    [share.of(at.map(|at| first.data[at])), share.of(at.map(|at| second.data[at]))]
}

/// The four pixels around an image point: top left, top right, bottom left, bottom right.
struct Corners {
    at: [usize; 4],
    share: Share,
}

impl Corners {
    #[inline]
    fn around<T>(plane: &Plane<T>, u: f32, v: f32) -> Self {
        let (x, y) = ((u - 0.5).clamp(0.0, (plane.width - 1) as f32), (v - 0.5).clamp(0.0, (plane.height - 1) as f32));
        let (x0, y0) = (x as usize, y as usize);
        let (x1, y1) = ((x0 + 1).min(plane.width - 1), (y0 + 1).min(plane.height - 1));
        let (top, bottom) = (y0 * plane.width, y1 * plane.width);
        Self { at: [top + x0, top + x1, bottom + x0, bottom + x1], share: Share { x: x - x0 as f32, y: y - y0 as f32 } }
    }
}

/// How far a point lies on the way from the first corner to the last.
struct Share {
    x: f32,
    y: f32,
}

impl Share {
    /// Of values at the four [`Corners`].
    #[inline]
    fn of(&self, corners: [f32; 4]) -> f32 {
        let top = corners[0] + self.x * (corners[1] - corners[0]);
        let bottom = corners[2] + self.x * (corners[3] - corners[2]);
        top + self.y * (bottom - top)
    }
}

/// Catmull–Rom bicubic sample at an image point \[px\].
pub fn bicubic(plane: &Plane<f32>, u: f32, v: f32) -> f32 {
    let (x, y) = ((u - 0.5).clamp(0.0, (plane.width - 1) as f32), (v - 0.5).clamp(0.0, (plane.height - 1) as f32));
    let (x0, y0) = (x.floor(), y.floor());
    let (wx, wy) = (cubic_weights(x - x0), cubic_weights(y - y0));
    let at = |i: isize, n: usize| i.clamp(0, n as isize - 1) as usize;
    let mut sum = 0.0;
    for (j, wy) in wy.iter().enumerate() {
        let row = plane.row(at(y0 as isize + j as isize - 1, plane.height));
        for (i, wx) in wx.iter().enumerate() {
            sum += wx * wy * row[at(x0 as isize + i as isize - 1, plane.width)];
        }
    }
    sum
}

fn cubic_weights(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [-0.5 * t + t2 - 0.5 * t3, 1.0 - 2.5 * t2 + 1.5 * t3, 0.5 * t + 2.0 * t2 - 1.5 * t3, -0.5 * t2 + 0.5 * t3]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_ramps_are_reproduced() {
        let plane = Plane::from_fn(12, 10, |x, y| 2.0 * (x as f32 + 0.5) - 3.0 * (y as f32 + 0.5));
        for (u, v) in [(3.2, 4.9), (5.5, 5.5), (8.01, 3.99)] {
            let truth = 2.0 * u - 3.0 * v;
            assert!((bilinear(&plane, u, v) - truth).abs() < 1e-4);
            assert!((bicubic(&plane, u, v) - truth).abs() < 1e-4);
        }
        assert_eq!(bilinear(&plane, -5.0, -5.0), plane[(0, 0)]);
    }
}
