//! Markers in the images: by appearance around a prediction, or by optical flow from frame to frame.

use glam::DVec2;
use strandflow_core::RgbImage;
use strandflow_image::{
    blob::Blob,
    colour::luma_of,
    flow::{FlowOptions, flow},
    region::Region,
};

/// A marker's look in one view by now.
#[derive(Clone, Copy, Debug)]
pub(super) struct Look {
    pub blob: Blob,
    /// Score where it was learnt.
    pub score: f64,
    /// Whether it was learnt in another view: this one never saw the marker.
    pub is_lent: bool,
}

impl Look {
    /// The score that a find is measured by: of a look that is lent more is asked.
    fn asked(&self) -> f64 {
        if self.is_lent { 1.2 * self.score.min(0.8) } else { self.score }
    }
}

/// The point of `to` that the point of `from` moved to, by robust flow in a window with a forward–backward check.
pub(super) fn by_flow(from: &RgbImage, to: &RgbImage, point: DVec2, half: usize, round_trip_px: f64) -> Option<DVec2> {
    let (x, y) = (point.x.floor() as i64, point.y.floor() as i64);
    if x < 0 || y < 0 || x >= from.width as i64 || y >= from.height as i64 {
        return None;
    }
    let region = Region { x: x as usize, y: y as usize, width: 1, height: 1 }.grown(half, from.width, from.height);
    let crop = |image: &RgbImage| {
        vec![
            region.crop(image, |&c| luma_of(c)),
            region.crop(image, |c| f32::from(c[0]) - f32::from(c[1])),
            region.crop(image, |c| f32::from(c[2]) - f32::from(c[1])),
        ]
    };
    let (a, b) = (crop(from), crop(to));
    let options = FlowOptions { levels: 3, ..FlowOptions::default() };
    let corner = DVec2::new(region.x as f64, region.y as f64);
    let step = |f: &strandflow_image::flow::Flow, p: DVec2| {
        let at = p - corner;
        let [u, v] = f.at(at.x as f32, at.y as f32);
        p + DVec2::new(f64::from(u), f64::from(v))
    };
    let there = step(&flow(&a, &b, &options), point);
    let back = step(&flow(&b, &a, &options), there);
    (back.distance(point) <= round_trip_px).then_some(there)
}

/// The marker near a predicted point, if what is there looks like it.
pub(super) fn by_look(image: &RgbImage, look: &Look, predicted: DVec2, reach: f64, accept: f64) -> Option<DVec2> {
    let (w, h) = (image.width as f64, image.height as f64);
    if !(predicted.x > -reach && predicted.y > -reach && predicted.x < w + reach && predicted.y < h + reach) {
        return None;
    }
    let found = look.blob.search(image, predicted, reach)?;
    (found.score >= accept * look.asked()).then_some(found.centre)
}
