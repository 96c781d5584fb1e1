//! Orientation maps in colour: the hue is the angle, the brightness the confidence.

use std::f32::consts::PI;

use strandflow_core::{Plane, RgbImage};

use crate::html::Html;

/// The colour of an undirected angle \[rad\] from +x towards +y: once around the colours in half a turn.
pub fn colour_of_angle(angle: f32, brightness: f32) -> [u8; 3] {
    let hue = (angle / PI).rem_euclid(1.0);
    [0.0, 2.0 / 3.0, 1.0 / 3.0].map(|shift| {
        let x = ((hue + shift).fract() * 6.0 - 3.0).abs() - 1.0;
        (255.0 * brightness.clamp(0.0, 1.0) * x.clamp(0.0, 1.0)).round() as u8
    })
}

/// Angles \[rad\] and confidences from 0 to 1 as an image; black is no trust.
pub fn orientation_image(angle: &Plane<f32>, confidence: &Plane<f32>) -> RgbImage {
    let data = angle.data.iter().zip(&confidence.data).map(|(a, c)| colour_of_angle(*a, c.sqrt())).collect();
    RgbImage { width: angle.width, height: angle.height, data }
}

/// Lines in the key.
const SPOKES: usize = 12;

/// A key to the colours: short lines in the direction and colour of their angles.
pub fn key() -> Html {
    let spokes: String = (0..SPOKES)
        .map(|i| {
            let angle = PI * i as f32 / SPOKES as f32;
            let [r, g, b] = colour_of_angle(angle, 0.9);
            let (x, y) = (14.0 + 27.0 * i as f32, 16.0);
            let (dx, dy) = (10.0 * angle.cos(), 10.0 * angle.sin());
            let ends = format!("M{:.1} {:.1}L{:.1} {:.1}", x - dx, y - dy, x + dx, y + dy);
            format!("<path stroke=\"rgb({r},{g},{b})\" d=\"{ends}\"/>")
        })
        .collect();
    Html::raw(format!(
        "<svg class=\"key\" viewBox=\"0 0 325 32\" role=\"img\" \
         aria-label=\"Key: each line has the colour of its own direction\">\
         <rect width=\"325\" height=\"32\" rx=\"4\" fill=\"#111\"/>{spokes}</svg>"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_angle_and_its_opposite_look_alike() {
        assert_eq!(colour_of_angle(0.3, 1.0), colour_of_angle(0.3 + PI, 1.0));
        assert_eq!(colour_of_angle(0.0, 1.0), [255, 0, 0]);
        assert_eq!(colour_of_angle(PI / 3.0, 1.0), [0, 255, 0]);
        assert_eq!(colour_of_angle(1.0, 0.0), [0; 3]);
    }
}
