//! Length over time of the longest drawn strand, by stage (Zhang et al. 2012, figure 6).

use strandflow_core::StrandSequence;
use strandflow_eval::{Truth, lengths::present_length};
use strandflow_report::{Axis, Mark, Plot, Tone};

use crate::sketched::{SketchScores, TRUTH, match_of};

/// Lengths of one drawn strand: by what it is called, frames and lengths \[mm\].
#[derive(Debug)]
pub struct LengthsOverTime {
    strand: u32,
    courses: Vec<(String, Vec<(f64, f64)>)>,
}

/// What each course is drawn in.
const TONES: [(&str, Tone); 5] = [
    (DRAWN, Tone::Grey),
    (TRUTH, Tone::Magenta),
    ("smooth", Tone::Orange),
    ("fit", Tone::Blue),
    ("blend", Tone::Green),
];

const DRAWN: &str = "drawn, triangulated";

/// Of the drawn strand that is longest in the mean over its frames, and that the stages have.
pub fn of_longest(
    scores: &[SketchScores],
    sequences: &[(&str, StrandSequence)],
    truth: Option<&Truth>,
) -> Option<LengthsOverTime> {
    let of = |id: u32| scores.iter().filter(move |score| score.id == id);
    let mean = |id: u32| of(id).map(|score| score.length_mm).sum::<f64>() / of(id).count() as f64;
    let matched = scores.iter().filter(|score| sequences.iter().any(|(name, _)| match_of(score, name).is_some()));
    let longest = matched.max_by(|a, b| mean(a.id).total_cmp(&mean(b.id)))?;
    let mut courses =
        vec![(DRAWN.to_owned(), of(longest.id).map(|score| (score.frame as f64, score.length_mm)).collect())];
    if let Some(truth) = truth {
        let lengths = truth.frames.iter().enumerate().map(|(t, frame)| {
            (f64::from(*frame), present_length(truth.strand(t, longest.id as usize)).unwrap_or(f64::NAN))
        });
        courses.push((TRUTH.to_owned(), lengths.collect()));
    }
    for (name, sequence) in sequences {
        let Some((n, _)) = match_of(longest, name) else { continue };
        let lengths = sequence.frames.iter().enumerate();
        let lengths =
            lengths.map(|(t, frame)| (f64::from(*frame), present_length(sequence.strand(t, n)).unwrap_or(f64::NAN)));
        courses.push(((*name).to_owned(), lengths.collect()));
    }
    Some(LengthsOverTime { strand: longest.id, courses })
}

impl LengthsOverTime {
    /// As an SVG file.
    pub fn svg(&self) -> String {
        let all = || self.courses.iter().flat_map(|(_, course)| course).filter(|(_, length)| length.is_finite());
        let ends = |of: fn(&(f64, f64)) -> f64| {
            all().map(of).fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
        };
        let ((first, last), (low, high)) = (ends(|p| p.0), ends(|p| p.1));
        // Lengths that are level must look level: no less than a quarter of the length from top to bottom.
        let room = (0.1 * (high - low)).max(0.5 * (0.25 * high - (high - low)));
        let y = Axis::exact("length [mm]", low - room, high + room);
        let alt = format!("Length of drawn strand {} in each frame, by stage", self.strand);
        let title = format!("The longest drawn strand ({})", self.strand);
        let mut plot = Plot::new(title, alt, Axis::exact("frame", first, last), y);
        for (name, tone) in TONES {
            if let Some((_, course)) = self.courses.iter().find(|(of, _)| of == name) {
                plot = plot.named(tone, Mark::Line(course.clone()), name);
            }
        }
        plot.document()
    }
}
