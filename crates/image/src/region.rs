//! Rectangles of interest: work is done where the subject is.

use glam::DVec2;
use strandflow_core::Plane;

/// A half-open rectangle of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// First column.
    pub x: usize,
    /// First row.
    pub y: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Region {
    /// The whole of a plane.
    pub fn whole<T>(plane: &Plane<T>) -> Self {
        Self { x: 0, y: 0, width: plane.width, height: plane.height }
    }

    /// The smallest rectangle that holds every sample for which `inside` is true; `None` where there is none.
    pub fn bounding<T>(plane: &Plane<T>, inside: impl Fn(&T) -> bool) -> Option<Self> {
        let (mut x0, mut y0, mut x1, mut y1) = (usize::MAX, usize::MAX, 0, 0);
        for y in 0..plane.height {
            let row = plane.row(y);
            let Some(first) = row.iter().position(&inside) else { continue };
            let last = row.iter().rposition(&inside).unwrap_or(first);
            (x0, x1) = (x0.min(first), x1.max(last + 1));
            (y0, y1) = (y0.min(y), y + 1);
        }
        (x0 < x1).then(|| Self { x: x0, y: y0, width: x1 - x0, height: y1 - y0 })
    }

    /// Grown by `margin` pixels on every side, within `width` × `height`.
    pub fn grown(&self, margin: usize, width: usize, height: usize) -> Self {
        let (x, y) = (self.x.saturating_sub(margin), self.y.saturating_sub(margin));
        let (x1, y1) = ((self.x + self.width + margin).min(width), (self.y + self.height + margin).min(height));
        Self { x, y, width: x1 - x, height: y1 - y }
    }

    /// The smallest rectangle that holds both.
    pub fn union(&self, other: &Self) -> Self {
        let (x, y) = (self.x.min(other.x), self.y.min(other.y));
        let x1 = (self.x + self.width).max(other.x + other.width);
        let y1 = (self.y + self.height).max(other.y + other.height);
        Self { x, y, width: x1 - x, height: y1 - y }
    }

    /// All its pixels (column, row), row by row.
    pub fn pixels(self) -> impl Iterator<Item = (usize, usize)> {
        (self.y..self.y + self.height).flat_map(move |y| (self.x..self.x + self.width).map(move |x| (x, y)))
    }

    /// The corner with the smallest coordinates, as an image point \[px\].
    pub fn corner(&self) -> DVec2 {
        DVec2::new(self.x as f64, self.y as f64)
    }

    /// Whether an image point \[px\] lies inside.
    pub fn holds(&self, pixel: DVec2) -> bool {
        let inside = pixel - self.corner();
        inside.x >= 0.0 && inside.y >= 0.0 && inside.x < self.width as f64 && inside.y < self.height as f64
    }

    /// The samples of the rectangle, mapped; the rectangle must lie inside the plane.
    pub fn crop<T, U>(&self, plane: &Plane<T>, f: impl Fn(&T) -> U) -> Plane<U> {
        let mut data = Vec::with_capacity(self.width * self.height);
        (self.y..self.y + self.height)
            .for_each(|y| data.extend(plane.row(y)[self.x..self.x + self.width].iter().map(&f)));
        Plane { width: self.width, height: self.height, data }
    }

    /// Writes a cropped plane back into its place.
    pub fn paste<T: Copy>(&self, cropped: &Plane<T>, into: &mut Plane<T>) {
        for y in 0..self.height {
            let at = (self.y + y) * into.width + self.x;
            into.data[at..at + self.width].copy_from_slice(cropped.row(y));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounding_crop_and_paste_agree() {
        let plane = Plane::from_fn(9, 7, |x, y| u8::from((2..5).contains(&x) && (3..6).contains(&y)));
        let region = Region::bounding(&plane, |&v| v > 0).unwrap();
        assert_eq!(region, Region { x: 2, y: 3, width: 3, height: 3 });
        let grown = region.grown(3, 9, 7);
        assert_eq!(grown, Region { x: 0, y: 0, width: 8, height: 7 });
        let mut copy = Plane::filled(9, 7, 0u8);
        grown.paste(&grown.crop(&plane, |&v| v), &mut copy);
        assert_eq!(copy, plane);
        assert_eq!(Region::bounding(&copy, |&v| v > 1), None);
    }
}
