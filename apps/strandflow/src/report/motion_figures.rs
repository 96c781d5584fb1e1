//! Plots of the strands over time: coverage, lengths, jitter.

use strandflow_eval::Summary;
use strandflow_report::{Axis, Html, Mark, Plot, Tone};

use super::{
    motion::{Motion, StageMotion},
    opened::Opened,
    percent,
};

/// What each provenance is called, in the order of its number from 1 on.
const PROVENANCE: [(Tone, &str); 4] = [
    (Tone::Green, "observed: its line was triangulated from images"),
    (Tone::Blue, "diffused: its direction comes from around it"),
    (Tone::Orange, "simulated: the frame had no such point"),
    (Tone::Magenta, "completed: from neighbouring strands"),
];

/// Largest variation of a length that has its own bar \[share\]; the last bar holds what varies more.
const VARIATION_END: f64 = 0.12;
const VARIATION_BARS: usize = 24;

fn lacking() -> Html {
    Html::paragraph("There are no strands of fixed topology yet: stage smooth is not done.")
}

/// Provenance by frame.
pub fn coverage(take: &Opened, motion: Option<&Motion>) -> Html {
    let Some((motion, last)) = motion.and_then(|motion| Some((motion, motion.last()?))) else { return lacking() };
    let mut html = Html::paragraph(&format!(
        "Points of the strands after {}, by where they come from. What no camera sees is inferred, and says so in every export.",
        last.stage
    ));
    html.push(
        stacked(motion, last).figure("A frame in which less was observed is worth a look at its masks and pictures."),
    );
    let absent = motion.frames.len() - last.provenance.iter().filter(|counts| counts.iter().sum::<usize>() > 0).count();
    if absent > 0 {
        let hint = format!("`strandflow run {}` makes what is missing.", take.name());
        html.push(Html::warning(&format!("{absent} frames have no strands after {}.", last.stage), &hint));
    }
    html
}

fn stacked(motion: &Motion, stage: &StageMotion) -> Plot {
    let (start, end) = (motion.frames.start as f64, motion.frames.end as f64);
    let [observed, ..] = stage.shares();
    let alt = format!("Share of points by provenance in each frame; observed {} over all frames", percent(observed));
    let (x, y) = (Axis::exact("frame", start, end), Axis::exact("share of points [%]", 0.0, 100.0));
    let mut plot = Plot::new(format!("Provenance after {}", stage.stage), alt, x, y);
    for (kind, (tone, name)) in (1..).zip(PROVENANCE) {
        let mut band = Vec::new();
        for (t, counts) in stage.provenance.iter().enumerate() {
            let all = counts[1..].iter().sum::<usize>().max(1) as f64;
            let below = |kinds: &[usize]| 100.0 * kinds.iter().sum::<usize>() as f64 / all;
            let (low, high) = (below(&counts[1..kind]), below(&counts[1..=kind]));
            // A frame is as wide as a frame, so that a take of one frame shows too.
            band.extend([0.0, 1.0].map(|side| (start + t as f64 + side, low, high)));
        }
        plot = plot.named(tone, Mark::Area(band), name);
    }
    plot
}

/// Lengths of the longest strands before and after, and how much lengths vary.
pub fn lengths(motion: Option<&Motion>) -> Html {
    let Some(motion) = motion else { return lacking() };
    let mut html = Html::paragraph(
        "Hair does not stretch. As reconstructed frame by frame, lengths jump, because tips come and go; after the simulation \
         they should be level. The paper shows this in its Figure 6.",
    );
    let most = motion.stages.iter().flat_map(|stage| stage.longest.iter().flatten().copied());
    let y = Axis::from_zero("length [mm]", most);
    let shown = [motion.stages.first(), motion.stages.get(1..).and_then(<[_]>::last)];
    let panels = shown.into_iter().flatten().enumerate();
    html.push(Html::side_by_side(panels.map(|(i, stage)| over_time(motion, stage, i, y.clone()))));
    html.push(Html::side_by_side([variation(motion)]));
    if motion.stages.len() == 1 {
        html.push(Html::paragraph("Stage fit is not done, so there is no after."));
    }
    html
}

fn over_time(motion: &Motion, stage: &StageMotion, place: usize, y: Axis) -> Html {
    let (start, end) = (motion.frames.start, motion.frames.end);
    let x = Axis::exact("frame", start as f64, (end - 1).max(start) as f64);
    let alt = format!("Length of the {} longest strands in each frame after {}", stage.longest.len(), stage.stage);
    let when = ["before", "after"][place.min(1)];
    let mut plot = Plot::new(format!("The longest strands, {when} ({})", stage.stage), alt, x, y);
    let tone = [Tone::Grey, Tone::Blue][place.min(1)];
    for lengths in &stage.longest {
        plot = plot.with(tone, Mark::ThinLine((start..end).map(|f| f as f64).zip(lengths.iter().copied()).collect()));
    }
    plot.figure("")
}

fn variation(motion: &Motion) -> Html {
    let bar = VARIATION_END / VARIATION_BARS as f64;
    let histogram = |stage: &StageMotion| {
        let mut shares = [0.0; VARIATION_BARS];
        let each = 100.0 / stage.variation.len().max(1) as f64;
        stage.variation.iter().for_each(|v| shares[((v / bar) as usize).min(VARIATION_BARS - 1)] += each);
        shares
    };
    let all: Vec<(&StageMotion, [f64; VARIATION_BARS])> = motion.stages.iter().map(|s| (s, histogram(s))).collect();
    let y = Axis::from_zero("share of strands [%]", all.iter().flat_map(|(_, shares)| *shares));
    let x = Axis::exact("variation of length over time [%]", 0.0, 100.0 * VARIATION_END);
    let alt = "Distribution of the standard deviation of strand lengths over time, by stage";
    let mut plot = Plot::new("How much lengths vary", alt, x, y);
    let mut words = Vec::new();
    for (i, (stage, shares)) in all.iter().enumerate() {
        let edges = (0..VARIATION_BARS).map(|k| (100.0 * bar * k as f64, 100.0 * bar * (k + 1) as f64, shares[k]));
        let mark = match i {
            0 => Mark::Bars(edges.collect()),
            _ => Mark::Line(edges.flat_map(|(from, to, share)| [(from, share), (to, share)]).collect()),
        };
        plot = plot.named(tone_of(i), mark, stage.stage);
        let steady = stage.variation.iter().filter(|v| **v < 0.02).count() as f64 / stage.variation.len().max(1) as f64;
        let median = percent(Summary::of(stage.variation.iter().copied()).median);
        words.push(format!("{}: median {median}, {} of the strands below 2 %", stage.stage, percent(steady)));
    }
    plot.figure(&format!("Standard deviation over mean; the last bar holds what varies more. {}.", words.join("; ")))
}

fn tone_of(stage: usize) -> Tone {
    [Tone::Grey, Tone::Blue, Tone::Orange][stage.min(2)]
}

/// Power spectra of the positions.
pub fn jitter(take: &Opened, motion: Option<&Motion>) -> Html {
    let Some(motion) = motion else { return lacking() };
    let spectra: Vec<_> = motion.stages.iter().filter_map(|s| Some((s.stage, s.spectrum.as_ref()?))).collect();
    if spectra.is_empty() {
        return Html::paragraph(
            "No spectrum can be taken: it needs eight frames or more in which middles and tips of strands are seen throughout.",
        );
    }
    let mut html = Html::paragraph(
        "Power over frequency of the middles and tips of strands, seen from the head. Hair swings at a few hertz; what does not \
         fall off towards high frequencies is jitter of the reconstruction. Motion that is really fast is in here too.",
    );
    let highest = take.manifest().fps / 2.0;
    let powers = spectra.iter().flat_map(|(_, spectrum)| spectrum.power.iter().copied());
    let (x, y) = (Axis::exact("frequency [Hz]", 0.0, highest), Axis::logarithmic("power [mm²/Hz]", powers));
    let mut plot = Plot::new("Power spectrum of the strands", "Power of positions over frequency, by stage", x, y);
    for (i, (stage, spectrum)) in spectra.iter().enumerate() {
        let points = spectrum.hz.iter().copied().zip(spectrum.power.iter().copied()).collect();
        plot = plot.named(tone_of(i), Mark::Line(points), *stage);
    }
    html.push(plot.figure(&format!(
        "Mean over {} series of the same points in every stage. The axis ends at half the frame rate, {highest} Hz.",
        motion.series
    )));
    let rms = |low: f64, high: f64| {
        let of = |(stage, s): &(&str, &strandflow_eval::spectrum::Spectrum)| {
            format!("{stage} {:.2} mm", s.between(low, high).sqrt())
        };
        spectra.iter().map(of).collect::<Vec<_>>().join(", ")
    };
    html.push(Html::list([
        format!("Root mean square above {:.0} Hz: {}.", highest / 2.0, rms(highest / 2.0, highest)),
        format!("Below, where the motion is: {}.", rms(0.0, highest / 2.0)),
    ]));
    html
}
