//! Hair that the image cuts off.

use strandflow_core::{Mask, Place, Report};

/// Share of a side of the image that hair must cover to be reported: three pixels of 640 are a flyaway hair.
const SHARE: f64 = 0.005;

/// Says on which sides hair leaves the image.
pub fn say_where_cut(hair: &Mask, place: &Place, report: &mut Report) {
    let (w, h) = (hair.width, hair.height);
    if w == 0 || h == 0 {
        return;
    }
    let column = |x: usize| (0..h).filter(|&y| hair[(x, y)] >= 128).count();
    let row = |y: usize| hair.row(y).iter().filter(|&&m| m >= 128).count();
    let sides = [("left", column(0), h), ("right", column(w - 1), h), ("upper", row(0), w), ("lower", row(h - 1), w)];
    for (side, cut, length) in sides {
        let share = cut as f64 / length as f64;
        if share > SHARE {
            let fact = format!("hair covers {:.1} % of the image's {side} border", 100.0 * share);
            let consequence = format!("beyond the {side} border this view sees no hair and carves nothing");
            report.warn(place.clone(), fact, consequence);
        }
    }
}
