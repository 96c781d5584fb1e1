//! What the fit found for each strand, and whether the motion could tell.

use strandflow_dynamics::{Params, refine::EXCITED_BELOW};
use strandflow_eval::statistics::share;
use strandflow_report::{Axis, Html, Mark, Plot, Tone, axis::power_of_ten, html::Cell};

use super::{opened::Opened, percent};

/// Fitted logarithms: name with unit, and the factor by which it is shown.
const NAMES: [(&str, f64); 6] = [
    ("stretch stiffness [1/s²]", 1.0),
    ("bend stiffness [1/s²]", 1.0),
    ("torsion stiffness [1/s²]", 1.0),
    ("altitude stiffness [1/s²]", 1.0),
    ("damping time c/k [ms]", 1e3),
    ("air drag [1/s]", 1.0),
];
const BARS: usize = 32;
/// Within this share of the range of its start a parameter has hardly moved; within this share of an end it lies there.
const NEAR: f64 = 0.05;
/// What moves less than this share of the range was not moved: the rounding of single precision is a tenth of it.
const HELD: f64 = 1e-6;
/// Above this share of strands at start or ends, the motion does not tell a parameter.
const TELLS_LITTLE: f64 = 0.25;

/// How far a parameter of a strand went from its start, in units of half the search range: −1 and 1 are the ends.
struct Moves([Vec<f64>; 6]);

/// Distribution of the parameters.
pub fn section(take: &Opened) -> Html {
    let read = |path: &str| take.store().and_then(|store| store.read_all::<f32>(path).ok());
    let windows = take.store().and_then(|store| store.read_all::<u16>("fit/windows").ok());
    let (Some(rows), Some(windows), Some(plan)) = (read("fit/parameters"), windows, take.last_run()) else {
        return Html::paragraph("There are no fitted parameters yet: stage fit is not done.");
    };
    let range = plan.settings.fit.log_range;
    let moves = Moves::of(&rows, &windows, range);
    if moves.0[0].is_empty() {
        return Html::paragraph("No strand has fitted parameters: no window was fitted, or the search range is zero.");
    }
    let mut html = Html::paragraph(&format!(
        "Springs and drag that explain the motion of {} strands best, per unit mass; of each strand the geometric mean over its \
         windows of a few frames. Every search starts at the same values (dashed) and ends at the edges of the plot, a factor {:.0} \
         away.",
        moves.0[0].len(),
        range.exp()
    ));
    html.push(Html::side_by_side((0..6).map(|i| moves.plot(i, range))));
    html.push(moves.table(range));
    html.push(moves.verdict());
    if let (Some(covariance), Some(held_out)) = (read("fit/covariance"), read("fit/held_out_mm")) {
        html.push(certainty(&covariance, &held_out));
    }
    html
}

/// The fitted logarithms of a strand's covariance, by their places in [`NAMES`].
const FITTED: [usize; 4] = [1, 2, 3, 5];

/// What the motion tells, by the covariances and by frames held out. Empty where no strand has any.
fn certainty(covariance: &[f32], held_out: &[f32]) -> Html {
    let median = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied()
    };
    let finite = |values: &mut dyn Iterator<Item = f64>| values.filter(|v| v.is_finite()).collect::<Vec<f64>>();
    let deviations: [Vec<f64>; 4] =
        std::array::from_fn(|k| finite(&mut covariance.chunks_exact(16).map(|strand| f64::from(strand[5 * k]).sqrt())));
    let mut html = Html::default();
    let row = |k: usize| {
        let told = deviations[k].iter().filter(|d| **d < EXCITED_BELOW).count();
        Some(vec![
            Cell::Text(NAMES[FITTED[k]].0.split(" [").next()?.into()),
            Cell::Number(format!("× {:.2}", median(deviations[k].clone())?.exp())),
            Cell::Number(percent(share(told, deviations[k].len()))),
        ])
    };
    let rows: Vec<_> = (0..4).filter_map(row).collect();
    if !rows.is_empty() {
        html = Html::table(
            &["Parameter", "Known to a factor of (median)", "Strands that tell it to a factor of two"],
            rows,
        );
    }
    let error = |way: usize| median(finite(&mut held_out.chunks_exact(2).map(|strand| f64::from(strand[way]))));
    if let (Some(simulated), Some(kept)) = (error(0), error(1)) {
        html.push(Html::paragraph(&format!(
            "Frames that a window had not seen lie {simulated:.1} mm from where its simulation goes on to, and {kept:.1} mm from \
             where velocities that stay as they are lead (medians over the strands; both hold the noise of what was seen). The \
             covariance takes rest shapes and errors that are alike in time for known, so it is the least that parameters err by."
        )));
    }
    html
}

impl Moves {
    /// Of the strands that have a fitted window.
    fn of(rows: &[f32], windows: &[u16], range: f64) -> Self {
        let start = Params::default().to_log();
        let mut moves: [Vec<f64>; 6] = Default::default();
        let fitted = rows.chunks_exact(9).zip(windows.chunks_exact(3)).filter(|(_, w)| range > 0.0 && w[0] + w[1] > 0);
        for (row, _) in fitted {
            let log = Params::from_array(std::array::from_fn(|i| f64::from(row[i]))).to_log();
            if log.iter().all(|value| value.is_finite()) {
                (0..6).for_each(|i| moves[i].push(((log[i] - start[i]) / range).clamp(-1.0, 1.0)));
            }
        }
        moves.iter_mut().for_each(|values| values.sort_by(f64::total_cmp));
        Self(moves)
    }

    fn at_start(&self, i: usize) -> f64 {
        share(self.0[i].iter().filter(|m| m.abs() < NEAR).count(), self.0[i].len())
    }

    /// Whether no strand moved it at all.
    fn held(&self, i: usize) -> bool {
        self.0[i].iter().all(|m| m.abs() < HELD)
    }

    fn at_ends(&self, i: usize) -> f64 {
        share(self.0[i].iter().filter(|m| m.abs() > 1.0 - NEAR).count(), self.0[i].len())
    }

    fn value(i: usize, moved: f64, range: f64) -> f64 {
        (Params::default().to_log()[i] + moved * range).exp() * NAMES[i].1
    }

    fn plot(&self, i: usize, range: f64) -> Html {
        let mut bars = [0.0; BARS];
        let each = 100.0 / self.0[i].len() as f64;
        self.0[i].iter().for_each(|m| bars[(((m + 1.0) * 0.5 * BARS as f64) as usize).min(BARS - 1)] += each);
        let edge = |k: usize| Self::value(i, 2.0 * k as f64 / BARS as f64 - 1.0, range);
        let (name, _) = NAMES[i];
        let x = Axis::logarithmic_exact(name, edge(0), edge(BARS));
        let y = Axis::from_zero("share of strands [%]", bars);
        let alt = format!("Distribution of the {name} over the strands within the search range");
        Plot::new(name, alt, x, y)
            .with(Tone::Blue, Mark::Bars((0..BARS).map(|k| (edge(k), edge(k + 1), bars[k])).collect()))
            .with(Tone::Grey, Mark::Rule(Self::value(i, 0.0, range)))
            .figure("")
    }

    fn table(&self, range: f64) -> Html {
        let quantile = |i: usize, q: f64| {
            let at = ((self.0[i].len() - 1) as f64 * q).round() as usize;
            number(Self::value(i, self.0[i][at], range))
        };
        let row = |i: usize| {
            vec![
                Cell::Text(NAMES[i].0.into()),
                Cell::Number(number(Self::value(i, 0.0, range))),
                Cell::Number(quantile(i, 0.5)),
                Cell::Number(format!("{} … {}", quantile(i, 0.25), quantile(i, 0.75))),
                Cell::Number(percent(self.at_start(i))),
                Cell::Number(percent(self.at_ends(i))),
            ]
        };
        let header = ["Parameter", "Start", "Median", "Middle half", "Still at start", "At an end"];
        Html::table(&header, (0..6).map(row))
    }

    /// What may be believed.
    fn verdict(&self) -> Html {
        let words = (0..6).filter_map(|i| {
            let (name, start, ends) = (NAMES[i].0.split(" [").next()?, self.at_start(i), self.at_ends(i));
            let told = match (start > TELLS_LITTLE, ends > TELLS_LITTLE) {
                _ if self.held(i) => {
                    "the fit holds it at its start, because short motion of hair hardly depends on it".into()
                }
                (true, _) => format!(
                    "{} of the strands left it where it started, so their motion does not excite it",
                    percent(start)
                ),
                (_, true) => format!(
                    "in {} of the strands it ran to an end of the range, so only a bound is known",
                    percent(ends)
                ),
                _ => return None,
            };
            Some(format!("Do not read the {name} as a property of the hair: {told}."))
        });
        let words: Vec<String> = words.collect();
        let mut html = Html::list(words);
        html.push(Html::paragraph(
            "Still at start: within 5 % of half the search range of its start. At an end: within 5 % of an end. A strand whose \
             parameter sits at its start or at an end says that its motion does not tell this parameter, or that the model errs in \
             another way that this parameter takes up; and a mean over windows can lie between ends that single windows ran to. \
             The positions are the result; parameters explain them over a few frames.",
        ));
        html
    }
}

/// Three digits.
fn number(value: f64) -> String {
    match value {
        v if v >= 1e4 => {
            let power = v.log10().floor();
            format!("{:.1}·{}", v / 10f64.powf(power), power_of_ten(power as i32))
        }
        v if v >= 100.0 => format!("{v:.0}"),
        v if v >= 1.0 => format!("{v:.1}"),
        v => format!("{v:.3}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_says_what_the_motion_tells_and_how_frames_held_out_fare() {
        let strand = |drag: f32| {
            let mut rows = [0.0; 16];
            (rows[0], rows[5], rows[10], rows[15]) = (4.0, 4.0, 4.0, drag);
            rows
        };
        let covariance = [strand(0.01), strand(0.04), strand(4.0), [f32::NAN; 16]].concat();
        let text = certainty(&covariance, &[1.0, 2.0, 1.5, 3.0, 1.25, 2.5, f32::NAN, f32::NAN]).into_text();
        // e^0.2 is the median; two of three are below ln 2.
        assert!(text.contains("× 1.22") && text.contains("67 %") && text.contains("0 %"), "{text}");
        assert!(text.contains("1.2 mm") && text.contains("2.5 mm"), "{text}");
        assert!(!certainty(&[f32::NAN; 16], &[f32::NAN; 2]).into_text().contains("factor"));
    }

    #[test]
    fn strands_at_start_and_at_ends_are_told_apart_and_unfitted_ones_left_out() {
        let row = |moved: f64| {
            let mut log = Params::default().to_log();
            log[1] += moved;
            Params::from_log(&log).to_array().map(|p| p as f32)
        };
        let rows = [row(0.0), row(0.1), row(4.0), row(-2.0), row(3.0)].concat();
        let windows = [[1, 0, 0], [0, 2, 0], [3, 0, 1], [4, 0, 0], [0, 0, 5]].concat();
        let moves = Moves::of(&rows, &windows, 4.0);
        assert_eq!((moves.0[1].len(), moves.at_start(1), moves.at_ends(1), moves.at_start(5)), (4, 0.5, 0.25, 1.0));
        let text = moves.verdict().into_text();
        assert!(
            text.contains("the bend stiffness as a property") && text.contains("50 % of the strands left it"),
            "{text}"
        );
        assert!(
            moves.held(0)
                && !moves.held(1)
                && text.contains("stretch stiffness")
                && text.contains("holds it at its start")
        );
        assert!(Moves::of(&rows, &windows, 0.0).0[0].is_empty());
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!([1e7, 123.4, 5.04, 0.0123].map(number), ["1.0·10⁷", "123", "5.0", "0.012"]);
    }
}
