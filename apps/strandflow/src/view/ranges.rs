//! Ranges that show most values well: from a sample of the last stage's middle frame.

use strandflow_view::{Selection, describe::Attribute};

use super::{
    attributes,
    sets::{Kind, Set},
    viewer::Viewer,
};

/// Strands and points of the sample.
const STRANDS: usize = 400;
const POINTS: usize = 8;
/// Share of the values that lie within the range: the rest is drawn in the colour of its end.
const SHOWN: f64 = 0.98;

/// Every attribute with a range that suits the take, as far as there are strands to tell.
pub fn attributes(viewer: &Viewer, sets: &[Set]) -> Vec<Attribute> {
    let mut all = attributes::all();
    for attribute in all.iter_mut().filter(|a| a.categories.is_none() && a.name != attributes::name::CONFIDENCE) {
        // The last stage that has it is the nearest to a result; truth and animations have their own ranges.
        let is_stage = |set: &&Set| matches!(set.kind, Kind::Frames | Kind::Blocks);
        let stages = sets.iter().rev().filter(is_stage);
        let in_order = stages.chain(sets.iter().filter(|set| !is_stage(set)));
        let largest = in_order.into_iter().find_map(|set| largest(viewer, set, attribute.name));
        let Some(most) = largest.filter(|most| *most > 0.0).map(rounded_up) else { continue };
        attribute.range = if attribute.range[0] < 0.0 { [-most, most] } else { [0.0, most] };
    }
    all
}

/// The magnitude that most values of a set stay below.
fn largest(viewer: &Viewer, set: &Set, name: &str) -> Option<f64> {
    let done = set.done(viewer.source());
    let frame = *done.get(done.len() / 2)?;
    let stride = set.strands.div_ceil(STRANDS).max(1);
    let selection = Selection { stride, points: Some(POINTS), ..Selection::default() };
    let found = attributes::values(viewer, set, name, frame, &selection).ok()?;
    let mut values: Vec<f32> = found.values.into_iter().filter(|v| v.is_finite()).map(f32::abs).collect();
    values.sort_by(f32::total_cmp);
    values.get(((values.len().max(1) - 1) as f64 * SHOWN).round() as usize).map(|v| f64::from(*v))
}

/// Up to one or two digits that are easy to read.
fn rounded_up(value: f64) -> f64 {
    let power = 10f64.powf(value.log10().floor());
    let steps = [1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0];
    steps.map(|step| step * power).into_iter().find(|step| *step >= value * (1.0 - 1e-9)).unwrap_or(10.0 * power)
}

#[cfg(test)]
mod tests {
    #[test]
    fn ranges_end_at_easy_numbers() {
        let found = [0.0123, 1.0, 1.01, 47.0, 99.0, 1234.0].map(super::rounded_up);
        let expected = [0.015, 1.0, 1.5, 50.0, 100.0, 1500.0];
        assert!(found.iter().zip(expected).all(|(a, b)| (a / b - 1.0).abs() < 1e-9), "{found:?}");
    }
}
