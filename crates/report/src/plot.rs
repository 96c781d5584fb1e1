//! Plots as SVG that is part of the page: colours come from its style sheet, so they follow dark mode and print.
//!
//! A plot is 360 units wide and its letters 12 units high: on the narrowest phone letters are 12 pixels high. As a file of its own
//! it carries the style sheet, and its legend below.

use std::fmt::Write;

use crate::{
    axis::Axis,
    html::{Html, escape},
    page::STYLE,
};

/// What a mark is drawn in; the style sheet knows the colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tone {
    /// As in the overlays: observed.
    Green,
    /// Diffused.
    Blue,
    /// Simulated.
    Orange,
    /// Completed.
    Magenta,
    /// What came before, or does not matter.
    Grey,
}

impl Tone {
    /// Its name in the style sheet.
    pub fn class(self) -> &'static str {
        match self {
            Self::Green => "green",
            Self::Blue => "blue",
            Self::Orange => "orange",
            Self::Magenta => "magenta",
            Self::Grey => "grey",
        }
    }
}

/// Something drawn in a plot. Values that are not finite break a line and leave a bar out.
#[derive(Clone, Debug, PartialEq)]
pub enum Mark {
    /// A line through (x, y).
    Line(Vec<(f64, f64)>),
    /// One of many lines.
    ThinLine(Vec<(f64, f64)>),
    /// The area between low and high: (x, low, high).
    Area(Vec<(f64, f64, f64)>),
    /// Bars from the lower end of the axis: (from, to, height).
    Bars(Vec<(f64, f64, f64)>),
    /// A vertical line at a value.
    Rule(f64),
}

/// A plot.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    title: String,
    alt: String,
    x: Axis,
    y: Axis,
    marks: Vec<(Tone, Mark)>,
    legend: Vec<(Tone, bool, String)>,
}

const WIDTH: f64 = 360.0;
const HEIGHT: f64 = 240.0;
/// Room for numbers and labels: left, right, top, bottom.
const MARGIN: [f64; 4] = [50.0, 12.0, 22.0, 40.0];

/// Room above a plot that is a file of its own, and for each line of its legend.
const TITLE: f64 = 20.0;
const LEGEND: f64 = 18.0;

/// What stands for a mark in the legend, 24 × 12 units.
fn swatch(tone: Tone, filled: bool) -> String {
    let class = tone.class();
    if filled {
        format!("<rect class=\"fill {class}\" width=\"24\" height=\"12\"/>")
    } else {
        format!("<path class=\"line {class}\" d=\"M0 6H24\"/>")
    }
}

impl Plot {
    /// An empty plot; `alt` says in words what it shows.
    pub fn new(title: impl Into<String>, alt: impl Into<String>, x: Axis, y: Axis) -> Self {
        Self { title: title.into(), alt: alt.into(), x, y, marks: Vec::new(), legend: Vec::new() }
    }

    /// Adds a mark.
    #[must_use]
    pub fn with(mut self, tone: Tone, mark: Mark) -> Self {
        self.marks.push((tone, mark));
        self
    }

    /// Adds a mark with a line in the legend.
    #[must_use]
    pub fn named(mut self, tone: Tone, mark: Mark, name: impl Into<String>) -> Self {
        let filled = matches!(mark, Mark::Area(_) | Mark::Bars(_));
        self.legend.push((tone, filled, name.into()));
        self.with(tone, mark)
    }

    /// The plot as a figure with title, legend and caption.
    pub fn figure(&self, caption: &str) -> Html {
        let mut html = format!("<figure><p class=\"title\">{}</p>{}", escape(&self.title), self.svg());
        if !self.legend.is_empty() {
            html += "<ul class=\"legend\">";
            for (tone, filled, name) in &self.legend {
                let _ = write!(
                    html,
                    "<li><svg class=\"swatch\" viewBox=\"0 0 24 12\" aria-hidden=\"true\">{}</svg>{}</li>",
                    swatch(*tone, *filled),
                    escape(name)
                );
            }
            html += "</ul>";
        }
        if !caption.is_empty() {
            let _ = write!(html, "<figcaption>{}</figcaption>", escape(caption));
        }
        Html::raw(html + "</figure>")
    }

    /// The plot as an SVG file of its own, with title and legend.
    pub fn document(&self) -> String {
        let height = TITLE + HEIGHT + LEGEND * self.legend.len() as f64;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" width=\"{}\" height=\"{}\" role=\"img\" \
             aria-label=\"{}\">\n<style>{}</style>\n<rect width=\"100%\" height=\"100%\" style=\"fill: var(--paper)\"/>\n",
            2.0 * WIDTH,
            2.0 * height,
            escape(&self.alt),
            escape(STYLE)
        );
        let middle = 0.5 * WIDTH;
        let _ = writeln!(svg, "<text x=\"{middle}\" y=\"14\" class=\"middle\">{}</text>", escape(&self.title));
        let _ = write!(svg, "<g transform=\"translate(0 {TITLE})\">");
        self.drawing(&mut svg);
        svg += "</g>\n";
        for (row, (tone, filled, name)) in self.legend.iter().enumerate() {
            let y = TITLE + HEIGHT + LEGEND * row as f64;
            let _ = writeln!(
                svg,
                "<g transform=\"translate({} {y})\">{}<text x=\"32\" y=\"10\">{}</text></g>",
                MARGIN[0],
                swatch(*tone, *filled),
                escape(name)
            );
        }
        svg + "</svg>\n"
    }

    fn svg(&self) -> String {
        let mut svg = format!(
            "<svg class=\"plot\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{}\">",
            escape(&self.alt)
        );
        self.drawing(&mut svg);
        svg + "</svg>"
    }

    fn drawing(&self, svg: &mut String) {
        self.axes(svg);
        for (tone, mark) in &self.marks {
            self.mark(*tone, mark, svg);
        }
    }

    fn axes(&self, svg: &mut String) {
        let [left, right, top, bottom] = MARGIN;
        let (low, high) = (HEIGHT - bottom, top);
        for (value, text) in self.y.ticks() {
            let Some(y) = self.up(value) else { continue };
            let _ = write!(svg, "<path class=\"grid\" d=\"M{left} {y:.1}H{}\"/>", WIDTH - right);
            let _ = write!(svg, "<text x=\"{}\" y=\"{:.1}\" class=\"end\">{text}</text>", left - 5.0, y + 4.0);
        }
        for (value, text) in self.x.ticks() {
            let Some(x) = self.across(value) else { continue };
            let _ = write!(svg, "<path class=\"grid\" d=\"M{x:.1} {low}V{high}\"/>");
            let _ = write!(svg, "<text x=\"{x:.1}\" y=\"{}\" class=\"middle\">{text}</text>", low + 16.0);
        }
        let _ = write!(svg, "<path class=\"axis\" d=\"M{left} {high}V{low}H{}\"/>", WIDTH - right);
        let middle = 0.5 * (left + WIDTH - right);
        let _ = write!(
            svg,
            "<text x=\"{middle}\" y=\"{}\" class=\"middle\">{}</text>",
            HEIGHT - 6.0,
            escape(self.x.label())
        );
        let _ = write!(svg, "<text x=\"2\" y=\"12\">{}</text>", escape(self.y.label()));
    }

    fn mark(&self, tone: Tone, mark: &Mark, svg: &mut String) {
        let class = tone.class();
        let [_, _, top, bottom] = MARGIN;
        match mark {
            Mark::Line(points) => {
                let _ = write!(svg, "<path class=\"line {class}\" d=\"{}\"/>", self.polyline(points));
            }
            Mark::ThinLine(points) => {
                let _ = write!(svg, "<path class=\"thin {class}\" d=\"{}\"/>", self.polyline(points));
            }
            Mark::Area(points) => {
                let above: Vec<(f64, f64)> = points.iter().map(|p| (p.0, p.2)).collect();
                let below: Vec<(f64, f64)> = points.iter().rev().map(|p| (p.0, p.1)).collect();
                let back = self.polyline(&below).replacen('M', "L", 1);
                let _ = write!(svg, "<path class=\"fill {class}\" d=\"{}{back}Z\"/>", self.polyline(&above));
            }
            Mark::Bars(bars) => {
                for (from, to, height) in bars {
                    let (Some(a), Some(b), Some(y)) = (self.across(*from), self.across(*to), self.up(*height)) else {
                        continue;
                    };
                    let _ = write!(
                        svg,
                        "<rect class=\"fill {class}\" x=\"{a:.1}\" y=\"{y:.1}\" width=\"{:.1}\" height=\"{:.1}\"/>",
                        (b - a).max(0.5),
                        HEIGHT - bottom - y
                    );
                }
            }
            Mark::Rule(value) => {
                if let Some(x) = self.across(*value) {
                    let _ = write!(svg, "<path class=\"line {class}\" d=\"M{x:.1} {}V{top}\"/>", HEIGHT - bottom);
                }
            }
        }
    }

    fn polyline(&self, points: &[(f64, f64)]) -> String {
        let (mut path, mut pen_down) = (String::new(), false);
        for (x, y) in points {
            let at = self.across(*x).zip(self.up(*y));
            if let Some((x, y)) = at {
                let _ = write!(path, "{}{x:.1} {y:.1}", if pen_down { 'L' } else { 'M' });
            }
            pen_down = at.is_some();
        }
        path
    }

    fn across(&self, value: f64) -> Option<f64> {
        self.x.place(value).map(|at| MARGIN[0] + at * (WIDTH - MARGIN[0] - MARGIN[1]))
    }

    fn up(&self, value: f64) -> Option<f64> {
        self.y.place(value).map(|at| HEIGHT - MARGIN[3] - at * (HEIGHT - MARGIN[2] - MARGIN[3]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot() -> Plot {
        Plot::new("Title & more", "a < b", Axis::exact("Hz", 0.0, 10.0), Axis::exact("mm", 0.0, 1.0))
    }

    #[test]
    fn marks_lie_where_the_axes_say() {
        let line = Mark::Line(vec![(0.0, 0.0), (5.0, 0.5), (f64::NAN, 1.0), (10.0, 1.0)]);
        let html = plot().named(Tone::Blue, line, "the <fit>").figure("").into_text();
        assert!(html.contains("d=\"M50.0 200.0L199.0 111.0M348.0 22.0\""), "{html}");
        assert!(html.contains("the &lt;fit&gt;") && html.contains("Title &amp; more") && html.contains("a &lt; b"));
    }

    #[test]
    fn a_file_of_its_own_is_svg_with_style_and_legend() {
        let svg = plot().named(Tone::Blue, Mark::Line(vec![(0.0, 0.0), (10.0, 1.0)]), "the <fit>").document();
        assert!(svg.starts_with("<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 360 278\""), "{svg}");
        assert!(svg.contains(">the &lt;fit&gt;</text>") && svg.contains(">Title &amp; more</text>"));
        assert!(svg.contains("--blue: #2b6cc4") && svg.ends_with("</svg>\n"));
    }

    #[test]
    fn an_area_is_closed_and_bars_stand_on_the_axis() {
        let html = plot()
            .with(Tone::Green, Mark::Area(vec![(0.0, 0.0, 0.5), (10.0, 0.0, 1.0)]))
            .with(Tone::Grey, Mark::Bars(vec![(0.0, 10.0, 0.5), (1.0, f64::NAN, 1.0)]))
            .figure("")
            .into_text();
        assert!(html.contains("d=\"M50.0 111.0L348.0 22.0L348.0 200.0L50.0 200.0Z\""), "{html}");
        assert!(html.contains("y=\"111.0\" width=\"298.0\" height=\"89.0\""), "{html}");
        assert_eq!(html.matches("<rect").count(), 1);
    }
}
