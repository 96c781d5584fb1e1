//! Connected components, holes, dilation and erosion of binary planes.

use strandflow_core::Plane;

/// Four-connected components of the pixels that are `true`: a label (from 1 on, 0 outside) a pixel, and areas by label.
pub fn components(mask: &Plane<bool>) -> (Plane<u32>, Vec<usize>) {
    let (width, height) = (mask.width, mask.height);
    let mut labels = Plane::filled(width, height, 0u32);
    let mut areas = vec![0usize];
    let mut stack = Vec::new();
    for start in 0..mask.data.len() {
        if !mask.data[start] || labels.data[start] != 0 {
            continue;
        }
        let label = areas.len() as u32;
        areas.push(0);
        labels.data[start] = label;
        stack.push(start);
        while let Some(i) = stack.pop() {
            areas[label as usize] += 1;
            let (x, y) = (i % width, i / width);
            let mut visit = |j: usize| {
                if mask.data[j] && labels.data[j] == 0 {
                    labels.data[j] = label;
                    stack.push(j);
                }
            };
            if x > 0 {
                visit(i - 1);
            }
            if x + 1 < width {
                visit(i + 1);
            }
            if y > 0 {
                visit(i - width);
            }
            if y + 1 < height {
                visit(i + width);
            }
        }
    }
    (labels, areas)
}

/// Clears components smaller than `area` pixels.
pub fn without_specks(mask: &Plane<bool>, area: usize) -> Plane<bool> {
    let (labels, areas) = components(mask);
    labels.map(|&label| label != 0 && areas[label as usize] >= area)
}

/// Fills holes (components of the complement) smaller than `area` pixels.
pub fn without_holes(mask: &Plane<bool>, area: usize) -> Plane<bool> {
    without_specks(&mask.map(|&m| !m), area).map(|&m| !m)
}

/// Dilation by a square of `radius` pixels.
pub fn dilated(mask: &Plane<bool>, radius: usize) -> Plane<bool> {
    let (width, height, reach) = (mask.width, mask.height, 2 * radius + 1);
    let mut rows = Plane::filled(width, height, false);
    for (row, out) in mask.data.chunks_exact(width.max(1)).zip(rows.data.chunks_exact_mut(width.max(1))) {
        let mut left = 0;
        for x in 0..width + radius {
            if x < width && row[x] {
                left = reach;
            }
            if x >= radius {
                out[x - radius] = left > 0;
            }
            left = left.saturating_sub(1);
        }
    }
    let mut out = Plane::filled(width, height, false);
    // How many more rows each column stays set, all columns side by side.
    let mut left = vec![0u32; width];
    for y in 0..height + radius {
        if y < height {
            left.iter_mut().zip(rows.row(y)).for_each(|(left, &set)| *left = if set { reach as u32 } else { *left });
        }
        if y >= radius {
            let at = (y - radius) * width;
            out.data[at..at + width].iter_mut().zip(&left).for_each(|(out, &left)| *out = left > 0);
        }
        left.iter_mut().for_each(|left| *left = left.saturating_sub(1));
    }
    out
}

/// Erosion by a square of `radius` pixels; what lies outside the image counts as inside.
pub fn eroded(mask: &Plane<bool>, radius: usize) -> Plane<bool> {
    dilated(&mask.map(|&m| !m), radius).map(|&m| !m)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn specks_go_holes_close_and_squares_grow() {
        let mut mask = Plane::from_fn(30, 20, |x, y| (5..20).contains(&x) && (5..15).contains(&y));
        mask[(10, 10)] = false;
        mask[(25, 3)] = true;
        let clean = without_holes(&without_specks(&mask, 10), 10);
        assert_eq!(clean.data.iter().filter(|&&m| m).count(), 150);
        let grown = dilated(&clean, 2);
        assert_eq!(grown.data.iter().filter(|&&m| m).count(), 19 * 14);
        assert_eq!(eroded(&grown, 2), clean);
        assert!(grown[(3, 3)] && !grown[(2, 3)]);
    }
}
