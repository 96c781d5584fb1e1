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
    let (width, height) = (mask.width, mask.height);
    let spread = |len: usize, get: &dyn Fn(usize) -> bool, set: &mut dyn FnMut(usize)| {
        let mut until = 0usize;
        for i in 0..len + radius {
            if i < len && get(i) {
                until = i + 2 * radius + 1;
            }
            if i < until && i >= radius {
                set(i - radius);
            }
        }
    };
    let mut rows = Plane::filled(width, height, false);
    for y in 0..height {
        spread(width, &|x| mask[(x, y)], &mut |x| rows[(x, y)] = true);
    }
    let mut out = Plane::filled(width, height, false);
    for x in 0..width {
        spread(height, &|y| rows[(x, y)], &mut |y| out[(x, y)] = true);
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
