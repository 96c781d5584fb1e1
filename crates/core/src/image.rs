//! Image buffers, row major, origin in the top-left corner.

/// A rectangle of samples, row major.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plane<T> {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Samples, shape (height, width).
    pub data: Vec<T>,
}

/// 8-bit sRGB colour.
pub type RgbImage = Plane<[u8; 3]>;

/// Soft coverage, 0 (outside) to 255 (inside); a pixel is inside from 128 on.
pub type Mask = Plane<u8>;

impl<T: Clone> Plane<T> {
    /// A plane of one value.
    pub fn filled(width: usize, height: usize, value: T) -> Self {
        Self { width, height, data: vec![value; width * height] }
    }
}

impl<T> Plane<T> {
    /// A plane from a function of (column, row).
    pub fn from_fn(width: usize, height: usize, mut f: impl FnMut(usize, usize) -> T) -> Self {
        let mut data = Vec::with_capacity(width * height);
        (0..height).for_each(|y| data.extend((0..width).map(|x| f(x, y))));
        Self { width, height, data }
    }

    /// The same shape with every sample mapped.
    pub fn map<U>(&self, f: impl FnMut(&T) -> U) -> Plane<U> {
        Plane { width: self.width, height: self.height, data: self.data.iter().map(f).collect() }
    }

    /// Row `y`.
    pub fn row(&self, y: usize) -> &[T] {
        &self.data[y * self.width..(y + 1) * self.width]
    }

    /// The sample whose pixel contains the image point (`u`, `v`) \[px\], if inside.
    pub fn at_point(&self, u: f64, v: f64) -> Option<&T> {
        if u >= 0.0 && v >= 0.0 && u < self.width as f64 && v < self.height as f64 {
            Some(&self.data[v as usize * self.width + u as usize])
        } else {
            None
        }
    }
}

impl<T> std::ops::Index<(usize, usize)> for Plane<T> {
    type Output = T;

    /// Indexed by (column, row).
    fn index(&self, (x, y): (usize, usize)) -> &T {
        debug_assert!(x < self.width);
        &self.data[y * self.width + x]
    }
}

impl<T> std::ops::IndexMut<(usize, usize)> for Plane<T> {
    fn index_mut(&mut self, (x, y): (usize, usize)) -> &mut T {
        debug_assert!(x < self.width);
        &mut self.data[y * self.width + x]
    }
}
