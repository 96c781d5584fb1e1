//! The scores as text.

use strandflow_eval::{
    Table,
    volume::{LineScores, MotionScores},
};

use crate::{held_out, scores::Scores, sketch_table};

impl Scores {
    /// The tables that `evaluate` prints.
    pub fn text(&self) -> String {
        let tables = [self.stages(), self.markers(), self.reliability(), self.shapes(), self.motion(), self.in_views()];
        let sketches = if self.sketches.is_empty() { Vec::new() } else { sketch_table::tables(&self.sketches) };
        tables.into_iter().flatten().chain(sketches).map(|table| format!("{table}\n")).collect()
    }

    /// Whether nothing was scored.
    pub fn is_empty(&self) -> bool {
        self.text().is_empty()
    }

    fn in_views(&self) -> Option<Table> {
        (!self.views.is_empty()).then(|| held_out::table(&self.views))
    }

    /// Stages before the strands: one figure a row.
    fn stages(&self) -> Option<Table> {
        let mut table = Table::new(&["stage", "figure", "worst", "mean"]);
        let mut row = |stage: &str, figure: &str, worst: f64, mean: f64| {
            table.row(stage, [figure.to_owned(), format!("{worst:.3}"), format!("{mean:.3}")]);
        };
        let mut any = !self.motion.is_empty();
        for (name, masks) in [("subject-mask IoU", &self.subject), ("hair-mask IoU", &self.hair)] {
            if let Some(masks) = masks {
                row("masks", name, masks.min, masks.mean);
                if let Some((least, mean)) = masks.truth_smoothed {
                    row("masks", "  truth against itself smoothed", least, mean);
                }
                any = true;
            }
        }
        if !self.hull.is_empty() {
            let of = |f: fn(&strandflow_eval::volume::HullScores) -> f64| -> Vec<f64> {
                self.hull.iter().map(|(_, hull)| f(hull)).collect()
            };
            row("hull", "true hair points inside", least(&of(|h| h.containment)), mean(&of(|h| h.containment)));
            row("hull", "IoU with hull of true masks", least(&of(|h| h.iou)), mean(&of(|h| h.iou)));
            any = true;
        }
        if let Some(pose) = &self.pose {
            row("pose", "rotation error, degrees", pose.worst_degrees, mean(&pose.degrees));
            row("pose", "displacement of the head, mm", pose.worst_mm, mean(&pose.mm));
            any = true;
        }
        if let Some(px) = &self.marker_px {
            row("pose", "marker reprojection, px", px.max, px.mean);
        }
        if let Some(scalp) = &self.scalp {
            row("scalp", "true roots to scalp, mm (95 %)", scalp.distance.p95, scalp.distance.mean);
            row("scalp", "found roots to true head, mm (95 %)", scalp.roots.p95, scalp.roots.mean);
            any = true;
        }
        if !self.orient.is_empty() {
            let all: Vec<f64> = self.orient.iter().map(|(_, s)| s.all.mean).collect();
            let half: Vec<f64> = self.orient.iter().map(|(_, s)| s.confident_half.mean).collect();
            let fifths: Vec<f64> = self.orient.iter().map(|(_, s)| s.confident_three_fifths.mean).collect();
            row("orient", "2D error, all hair pixels, degrees", most(&all), mean(&all));
            row("orient", "2D error, most confident 60 %, degrees", most(&fifths), mean(&fifths));
            row("orient", "2D error, most confident half, degrees", most(&half), mean(&half));
            any = true;
        }
        for (stage, lines) in [("lift", &self.lift), ("field", &self.field)] {
            if !lines.is_empty() {
                let of = |f: fn(&LineScores) -> f64| -> Vec<f64> { lines.iter().map(|(_, line)| f(line)).collect() };
                row(stage, "share of true hair voxels covered", least(&of(|l| l.coverage)), mean(&of(|l| l.coverage)));
                row(stage, "lines within 4 mm of hair", least(&of(|l| l.on_hair)), mean(&of(|l| l.on_hair)));
                row(stage, "angular error, degrees", most(&of(|l| l.degrees.mean)), mean(&of(|l| l.degrees.mean)));
                any = true;
            }
        }
        if !self.surface.is_empty() {
            let error: Vec<f64> = self.surface.iter().map(|(_, s)| s.error_mm.median).collect();
            let behind: Vec<f64> = self.surface.iter().map(|(_, s)| s.behind_mm).collect();
            row("field", "surface of the hair volume, mm (median)", most(&error), mean(&error));
            row("field", "  of it behind the true surface, mm", most(&behind), mean(&behind));
        }
        if !self.motion.is_empty() {
            let of = |f: fn(&MotionScores) -> f64| -> Vec<f64> { self.motion.iter().map(|(_, m)| f(m)).collect() };
            row("field", "motion error, mm a frame", most(&of(|m| m.error_mm.mean)), mean(&of(|m| m.error_mm.mean)));
            row(
                "field",
                "motion beside the head's, mm a frame",
                most(&of(|m| m.beside_head_mm)),
                mean(&of(|m| m.beside_head_mm)),
            );
            row("field", "share of it not explained (rms)", most(&of(|m| m.unexplained)), mean(&of(|m| m.unexplained)));
        }
        any.then_some(table)
    }

    /// Marker tracks: counts.
    fn markers(&self) -> Option<Table> {
        let scores = self.markers.as_ref()?;
        let mut table = Table::new(&["markers", "visible marker-frames", "within 2 px", "swaps", "false tracks"]);
        let share = format!("{:.2} %", 100.0 * scores.share_within_2px());
        let cells = [scores.visible.to_string(), share, scores.swaps.to_string(), scores.false_tracks.to_string()];
        table.row("tracked", cells);
        Some(table)
    }

    /// 2D orientations in ten equal parts by confidence, means over the frames.
    fn reliability(&self) -> Option<Table> {
        let frames: Vec<_> = self.orient.iter().map(|(_, s)| &s.tenths).filter(|tenths| tenths.len() == 10).collect();
        if frames.is_empty() {
            return None;
        }
        let mut table =
            Table::new(&["orient, by tenths of confidence", "1", "2", "3", "4", "5", "6", "7", "8", "9", "10"]);
        let of = |which: fn(&(f64, f64)) -> f64| {
            (0..10)
                .map(|k| mean(&frames.iter().map(|tenths| which(&tenths[k])).collect::<Vec<_>>()))
                .collect::<Vec<_>>()
        };
        table.numbers("mean confidence", 2, of(|p| p.0));
        table.numbers("mean error, degrees", 1, of(|p| p.1));
        Some(table)
    }

    /// Strands as shapes: one row a stage.
    fn shapes(&self) -> Option<Table> {
        let first = self.strands.first()?;
        let mut header = vec!["strands".to_owned(), "per frame".to_owned()];
        for threshold in &first.1.thresholds {
            let at = format!("{:.0} mm/{:.0}°", threshold.distance_mm, threshold.angle_deg);
            header.extend([format!("P {at}"), format!("R {at}"), format!("F1 {at}"), format!("F1 visible {at}")]);
        }
        header.extend(["consistency", "occupancy F1", "surface mm", "behind mm"].map(str::to_owned));
        let mut table = Table::new(&header.iter().map(String::as_str).collect::<Vec<_>>());
        for (stage, scores) in &self.strands {
            let mut cells = vec![format!("{:.0}", scores.strands)];
            for t in &scores.thresholds {
                cells.extend([t.all.precision, t.all.recall, t.all.f1, t.visible.f1].map(|x| format!("{x:.3}")));
            }
            cells.extend([scores.consistency, scores.occupancy.f1].map(|x| format!("{x:.3}")));
            cells.extend([scores.surface_mm.0, scores.surface_mm.1].map(|x| format!("{x:.2}")));
            table.row(stage, cells);
        }
        Some(table)
    }

    /// Strands in motion: one row a stage.
    fn motion(&self) -> Option<Table> {
        let first = self.dynamics.first()?;
        let mut table = Table::new(&[
            "motion",
            "position mm",
            "of input's points",
            "velocity mm/s",
            "of true speed",
            "jitter mm",
            "excess",
            "jerk ratio",
            "length var. %",
            "95 %",
            "switches /100",
            "border ratio",
        ]);
        for (stage, s) in &self.dynamics {
            table.row(
                stage,
                [
                    format!("{:.2}", s.position_mm.mean),
                    s.position_of_input_mm.as_ref().map_or("".into(), |given| format!("{:.2}", given.mean)),
                    format!("{:.0}", s.velocity_mm_s.mean),
                    format!("{:.2}", s.velocity_share),
                    format!("{:.3}", s.jitter_mm),
                    format!("{:.3}", s.jitter_excess_mm),
                    format!("{:.2}", s.jerk_ratio),
                    format!("{:.2}", 100.0 * s.length_variation.mean),
                    format!("{:.2}", 100.0 * s.length_variation.p95),
                    format!("{:.2}", s.identity_switches),
                    format!("{:.2}", s.border_ratio),
                ],
            );
        }
        table.row(
            "truth",
            [
                "0".to_owned(),
                "0".to_owned(),
                "0".to_owned(),
                "0".to_owned(),
                format!("{:.3}", first.1.true_jitter_mm),
                "0".to_owned(),
                "1".to_owned(),
            ],
        );
        Some(table)
    }
}

fn mean(numbers: &[f64]) -> f64 {
    numbers.iter().sum::<f64>() / numbers.len().max(1) as f64
}

fn least(numbers: &[f64]) -> f64 {
    numbers.iter().copied().fold(f64::INFINITY, f64::min)
}

fn most(numbers: &[f64]) -> f64 {
    numbers.iter().copied().fold(f64::NEG_INFINITY, f64::max)
}
