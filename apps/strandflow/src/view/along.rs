//! Points evenly along a strand, and the values of its own points there.

use glam::Vec3;
use strandflow_geometry::polyline::even_places;

/// A place on a strand: between its points `from` and `to`, `part` of the way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Index of the point before.
    pub from: usize,
    /// Index of the point behind; the next one that is present.
    pub to: usize,
    /// 0 at `from`, 1 at `to`.
    pub part: f32,
}

impl Place {
    /// The value there, by linear interpolation.
    pub fn mix(&self, values: &[f32]) -> f32 {
        // An end that has no value does not count where the place lies on the other.
        match self.part {
            0.0 => values[self.from],
            1.0 => values[self.to],
            part => values[self.from] + (values[self.to] - values[self.from]) * part,
        }
    }

    /// The point there.
    pub fn point(&self, points: &[Vec3]) -> Vec3 {
        points[self.from].lerp(points[self.to], self.part)
    }

    /// Index of the nearer point: for what cannot be mixed.
    pub fn nearer(&self) -> usize {
        if self.part < 0.5 { self.from } else { self.to }
    }
}

/// `count` places at equal lengths along the points that are present (finite), ends included; gaps are bridged by straight
/// lines. None where fewer than two points are present.
pub fn places(points: &[Vec3], count: usize) -> Option<Vec<Place>> {
    let present: Vec<usize> = (0..points.len()).filter(|&i| points[i].is_finite()).collect();
    if present.len() < 2 || count < 2 {
        return None;
    }
    let lengths: Vec<f32> = present.windows(2).map(|pair| points[pair[0]].distance(points[pair[1]])).collect();
    let place = |(k, part): (usize, f32)| Place { from: present[k], to: present[k + 1], part };
    Some(even_places(&lengths, count).map(place).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_even_and_bridge_gaps() {
        let points = [Vec3::ZERO, Vec3::X, Vec3::NAN, Vec3::X * 3.0, Vec3::X * 4.0, Vec3::NAN];
        let found = places(&points, 5).unwrap();
        let x: Vec<f32> = found.iter().map(|place| place.point(&points).x).collect();
        assert_eq!(x, [0.0, 1.0, 2.0, 3.0, 4.0]);
        assert_eq!((found[2].from, found[2].to, found[2].nearer()), (1, 3, 3));
        let values = [0.0, 10.0, f32::NAN, 30.0, 40.0, f32::NAN];
        assert_eq!(found.iter().map(|place| place.mix(&values)).collect::<Vec<_>>(), [0.0, 10.0, 20.0, 30.0, 40.0]);
        assert!(places(&points[1..3], 4).is_none() && places(&[], 4).is_none());
    }

    #[test]
    fn a_strand_without_length_stays_where_it_is() {
        let points = [Vec3::ONE; 3];
        assert!(places(&points, 4).unwrap().iter().all(|place| place.point(&points) == Vec3::ONE));
    }
}
