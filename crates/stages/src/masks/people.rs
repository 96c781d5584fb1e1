//! Whom a view shows: parts of the subject that are another person.

use strandflow_core::{Mask, Place, Report};
use strandflow_image::morph::{components, dilated};

/// Size of a part, against the part with the hair, from which on it is a person rather than a speck. A hand is a tenth of
/// a head with hair; smaller parts are flyaway hair and markers, which must stay.
const PERSON: f64 = 0.1;
/// Share of a part that may be expected hair without it being the person with the hair: the flow slips by a few pixels.
const SLIP: f64 = 0.05;

/// The subject without large separate parts in which no hair is expected, softly bordered by `border_px`. What is left out
/// is reported, and so are large parts that stay because hair is expected in several.
pub fn the_one_with_hair(subject: Mask, expected: &Mask, border_px: usize, place: &Place, report: &mut Report) -> Mask {
    let (labels, areas) = components(&subject.map(|&m| m >= 128));
    let mut hair = vec![0usize; areas.len()];
    for (&label, _) in labels.data.iter().zip(&expected.data).filter(|(_, expected)| **expected >= 128) {
        hair[label as usize] += 1;
    }
    // Background has label 0.
    let Some(main) = (1..areas.len()).max_by_key(|&label| hair[label]).filter(|&label| hair[label] > 0) else {
        return subject;
    };
    let large = |&label: &usize| label != main && areas[label] as f64 >= PERSON * areas[main] as f64;
    let bears_hair = |&label: &usize| hair[label] as f64 > SLIP * areas[label] as f64;
    let (alike, others): (Vec<usize>, Vec<usize>) = (1..areas.len()).filter(large).partition(bears_hair);
    for (found, consequence) in [
        (&alike, "hair is expected in all of them: all are kept"),
        (&others, "the part without the hair is taken for another person and left out"),
    ] {
        if !found.is_empty() {
            let sizes: Vec<String> = found.iter().map(|&label| areas[label].to_string()).collect();
            let fact = format!("the subject falls into parts of {} and {} pixels", areas[main], sizes.join(", "));
            report.warn(place.clone(), fact, consequence);
        }
    }
    if others.is_empty() {
        return subject;
    }
    let is_other = labels.map(|&label| others.contains(&(label as usize)));
    let is_kept = labels.map(|&label| label != 0 && !others.contains(&(label as usize)));
    // Their soft borders go with them, except where these are others' too.
    let (near_other, near_kept) = (dilated(&is_other, 2 * border_px), dilated(&is_kept, 2 * border_px));
    let mut rest = subject;
    for (i, coverage) in rest.data.iter_mut().enumerate() {
        if is_other.data[i] || (near_other.data[i] && !near_kept.data[i]) {
            *coverage = 0;
        }
    }
    rest
}
