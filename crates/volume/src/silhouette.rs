//! A view's silhouette: soft mask to inside/outside, and how many inside pixels a rectangle holds in constant time.

use strandflow_core::Mask;

/// Inside/outside of one view with a summed-area table.
///
/// Reference: Crow 1984 (summed-area tables).
#[derive(Clone, Debug, PartialEq)]
pub struct Silhouette {
    width: usize,
    height: usize,
    inside: Vec<bool>,
    /// Inside pixels above and left of each pixel corner, shape (height + 1, width + 1).
    sums: Vec<u32>,
}

/// How a rectangle of the image plane lies to a silhouette.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coverage {
    /// Entirely outside the image: the view says nothing.
    Unseen,
    /// In the image and entirely outside the silhouette.
    Outside,
    /// In the image and entirely inside the silhouette.
    Inside,
    /// Partly outside the image, and what is in it holds no inside pixel: a point of it is carved or not seen.
    Unsupported,
    /// None of these.
    Mixed,
}

impl Silhouette {
    /// Pixels with a coverage of at least `threshold`, grown by a disc of `grow_px` pixels. Growth starts inside the
    /// image: what lies beyond its border is not known.
    pub fn from_mask(mask: &Mask, threshold: u8, grow_px: f64) -> Self {
        let core: Vec<bool> = mask.data.iter().map(|&coverage| coverage >= threshold).collect();
        let inside = grown(&core, mask.width, mask.height, grow_px);
        let stride = mask.width + 1;
        let mut sums = vec![0u32; stride * (mask.height + 1)];
        for y in 0..mask.height {
            let mut row = 0;
            for x in 0..mask.width {
                row += u32::from(inside[y * mask.width + x]);
                sums[(y + 1) * stride + x + 1] = sums[y * stride + x + 1] + row;
            }
        }
        Self { width: mask.width, height: mask.height, inside, sums }
    }

    /// Whether the image point \[px\] is inside; `None` outside the image.
    #[inline]
    pub fn at(&self, u: f64, v: f64) -> Option<bool> {
        let seen = u >= 0.0 && v >= 0.0 && u < self.width as f64 && v < self.height as f64;
        seen.then(|| self.inside[v as usize * self.width + u as usize])
    }

    /// How the rectangle from (`low`) to (`high`) \[px\] lies to the silhouette. Image points on its border count.
    pub fn coverage(&self, low: [f64; 2], high: [f64; 2]) -> Coverage {
        let (w, h) = (self.width as f64, self.height as f64);
        if high[0] < 0.0 || high[1] < 0.0 || low[0] >= w || low[1] >= h {
            return Coverage::Unseen;
        }
        let cut = low[0] < 0.0 || low[1] < 0.0 || high[0] >= w || high[1] >= h;
        let (x0, y0) = (low[0].max(0.0) as usize, low[1].max(0.0) as usize);
        let (x1, y1) = ((high[0].min(w - 1.0)) as usize + 1, (high[1].min(h - 1.0)) as usize + 1);
        let inside = self.count(x0, y0, x1, y1) as usize;
        match inside {
            0 if cut => Coverage::Unsupported,
            // A rectangle that leaves the image may be out of sight in part, and there nothing carves it.
            _ if cut => Coverage::Mixed,
            0 => Coverage::Outside,
            n if n == (x1 - x0) * (y1 - y0) => Coverage::Inside,
            _ => Coverage::Mixed,
        }
    }

    /// Number of inside pixels.
    pub fn area(&self) -> usize {
        self.sums.last().map_or(0, |&n| n as usize)
    }

    fn count(&self, x0: usize, y0: usize, x1: usize, y1: usize) -> u32 {
        let at = |x: usize, y: usize| self.sums[y * (self.width + 1) + x];
        at(x1, y1) + at(x0, y0) - at(x0, y1) - at(x1, y0)
    }
}

/// Pixels within `radius` of an inside pixel (centre to centre).
fn grown(core: &[bool], width: usize, height: usize, radius: f64) -> Vec<bool> {
    let reach = radius.max(0.0) as usize;
    let mut out = core.to_vec();
    if reach == 0 {
        return out;
    }
    // Row by row: each inside pixel marks, in the rows around it, the half width of the disc there.
    let half: Vec<usize> = (0..=reach).map(|dy| (radius * radius - (dy * dy) as f64).sqrt() as usize).collect();
    for y in 0..height {
        let row = &core[y * width..(y + 1) * width];
        for (start, end) in runs(row) {
            for (dy, &half) in half.iter().enumerate() {
                let (a, b) = (start.saturating_sub(half), (end + half).min(width));
                if y >= dy {
                    out[(y - dy) * width + a..(y - dy) * width + b].fill(true);
                }
                if y + dy < height {
                    out[(y + dy) * width + a..(y + dy) * width + b].fill(true);
                }
            }
        }
    }
    out
}

/// Half-open runs of inside pixels of a row.
fn runs(row: &[bool]) -> Vec<(usize, usize)> {
    let mut out = Vec::new();
    let mut x = 0;
    while x < row.len() {
        let start = x;
        while x < row.len() && row[x] {
            x += 1;
        }
        if x > start {
            out.push((start, x));
        }
        x += 1;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use strandflow_core::Plane;

    #[test]
    fn rectangles_are_counted_and_growth_is_a_disc() {
        let mask = Plane::from_fn(20, 16, |x, y| if (x, y) == (9, 7) { 200 } else { 30 });
        let point = Silhouette::from_mask(&mask, 40, 0.0);
        assert_eq!(
            (point.area(), point.at(9.5, 7.5), point.at(8.5, 7.5), point.at(20.0, 3.0)),
            (1, Some(true), Some(false), None)
        );
        let disc = Silhouette::from_mask(&mask, 40, 2.0);
        assert_eq!(disc.area(), 13);
        assert!(Silhouette::from_mask(&mask, 30, 0.0).area() == 320);
        assert_eq!(disc.coverage([8.0, 6.0], [10.9, 8.9]), Coverage::Inside);
        assert_eq!(disc.coverage([0.0, 0.0], [6.9, 15.9]), Coverage::Outside);
        assert_eq!(disc.coverage([0.0, 0.0], [7.0, 15.9]), Coverage::Mixed);
        assert_eq!(disc.coverage([-9.0, 0.0], [-0.1, 15.9]), Coverage::Unseen);
        assert_eq!(disc.coverage([-9.0, 0.0], [3.0, 15.9]), Coverage::Unsupported);
        assert_eq!(disc.coverage([-9.0, 0.0], [9.0, 15.9]), Coverage::Mixed);
    }
}
