//! The tables of `evaluate --sketches`.

use std::collections::BTreeMap;

use strandflow_eval::{Summary, Table, sketches::CurveDistance, statistics::variation};

use crate::sketched::{COMPARED, SketchScores, match_of};

/// One row a drawn strand and frame, then one a stage.
pub fn tables(scores: &[SketchScores]) -> Vec<Table> {
    let names: Vec<&str> =
        COMPARED.into_iter().filter(|name| scores.iter().any(|s| s.stages.iter().any(|(of, ..)| of == name))).collect();
    let mut header =
        vec!["sketch".to_owned(), "frame".into(), "views".into(), "drawings, px".into(), "length, mm".into()];
    header.extend(
        names.iter().flat_map(|name| [format!("{name} strand"), "off, mm".into(), "worst".into(), "length".into()]),
    );
    let mut each = Table::new(&header.iter().map(String::as_str).collect::<Vec<_>>());
    for score in scores {
        let mut cells = vec![score.frame.to_string(), score.views.to_string()];
        cells.extend([format!("{:.2}", score.rms_px), format!("{:.1}", score.length_mm)]);
        for name in &names {
            let found = match_of(score, name);
            cells.push(found.map_or("-".into(), |(n, _)| n.to_string()));
            let numbers = found.and_then(|(_, distance)| distance);
            let of =
                |value: fn(&CurveDistance) -> f64| numbers.as_ref().map_or("-".into(), |d| format!("{:.1}", value(d)));
            cells.extend([of(|d| d.mean_mm), of(|d| d.worst_mm), of(|d| d.strand_mm)]);
        }
        each.row(score.id.to_string(), cells);
    }
    let mut means = Table::new(&[
        "stage",
        "strands and frames",
        "off, mm",
        "worst, mm",
        "length over drawn, %",
        "length varies, %",
    ]);
    for name in &names {
        let found: Vec<(&SketchScores, CurveDistance)> =
            scores.iter().filter_map(|score| Some((score, match_of(score, name)?.1?))).collect();
        if found.is_empty() {
            continue;
        }
        let off = Summary::of(found.iter().map(|(_, d)| d.mean_mm)).mean;
        let worst = found.iter().map(|(_, d)| d.worst_mm).fold(0.0, f64::max);
        let ratio = Summary::of(found.iter().map(|(score, d)| 100.0 * (d.strand_mm / score.length_mm - 1.0))).mean;
        let numbers = [off, worst, ratio].map(|number| format!("{number:.2}"));
        let varies = length_variation(&found).map_or("-".into(), |percent| format!("{percent:.2}"));
        means.row(*name, [found.len().to_string()].into_iter().chain(numbers).chain([varies]));
    }
    vec![each, means]
}

/// Mean over strands of the variation of the length over time, in percent; `None` where no strand was drawn in three frames.
fn length_variation(found: &[(&SketchScores, CurveDistance)]) -> Option<f64> {
    let mut by_strand: BTreeMap<u32, Vec<f64>> = BTreeMap::new();
    for (score, distance) in found {
        by_strand.entry(score.id).or_default().push(distance.strand_mm);
    }
    let each = Summary::of(by_strand.values().filter_map(|lengths| variation(lengths)));
    (each.count > 0).then_some(100.0 * each.mean)
}
