//! Who did what when: a row for each kind of work, a bar for each time it went on, a tone for each place.

use std::fmt::Write;

use crate::{
    axis::Axis,
    html::{Html, escape},
    plot::Tone,
};

/// Some work: from, to, and the number of the place.
pub type Stretch = (f64, f64, usize);

/// Rows of work over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Timeline {
    x: Axis,
    alt: String,
    rows: Vec<(String, Vec<Stretch>)>,
    places: Vec<String>,
}

/// As plots are: letters of 12 units, which are 12 pixels on the narrowest phone.
const WIDTH: f64 = 360.0;
const ROW: f64 = 18.0;
/// Room for the names of rows: the longest has fifteen letters.
const LEFT: f64 = 114.0;
const RIGHT: f64 = 14.0;
const BOTTOM: f64 = 38.0;
/// Places of higher numbers begin with the first tone again: more cannot be told apart.
const TONES: [Tone; 4] = [Tone::Blue, Tone::Orange, Tone::Green, Tone::Magenta];

impl Timeline {
    /// Rows from above; `alt` says in words what they show. Where there is more than one place, a row has a lane for each.
    pub fn new(x: Axis, alt: impl Into<String>, rows: Vec<(String, Vec<Stretch>)>, places: Vec<String>) -> Self {
        Self { x, alt: alt.into(), rows, places }
    }

    /// The timeline as a figure with a legend of places.
    pub fn figure(&self, caption: &str) -> Html {
        let mut html = format!("<figure>{}", self.svg());
        if self.places.len() > 1 {
            html += "<ul class=\"legend\">";
            for (place, name) in self.places.iter().enumerate() {
                let class = tone(place).class();
                let _ = write!(
                    html,
                    "<li><svg class=\"swatch\" viewBox=\"0 0 24 12\" aria-hidden=\"true\"><rect class=\"fill {class}\" width=\"24\" \
                     height=\"12\"/></svg>{}</li>",
                    escape(name)
                );
            }
            html += "</ul>";
        }
        let _ = write!(html, "<figcaption>{}</figcaption>", escape(caption));
        Html::raw(html + "</figure>")
    }

    fn svg(&self) -> String {
        let low = ROW * self.rows.len() as f64 + 4.0;
        let mut svg = format!(
            "<svg class=\"plot\" viewBox=\"0 0 {WIDTH} {}\" role=\"img\" aria-label=\"{}\">",
            low + BOTTOM,
            escape(&self.alt)
        );
        for (value, text) in self.x.ticks() {
            let Some(x) = self.across(value) else { continue };
            let _ = write!(svg, "<path class=\"grid\" d=\"M{x:.1} {low}V0\"/>");
            let _ = write!(svg, "<text x=\"{x:.1}\" y=\"{}\" class=\"middle\">{text}</text>", low + 16.0);
        }
        for (row, (name, stretches)) in self.rows.iter().enumerate() {
            let top = ROW * row as f64;
            let _ =
                write!(svg, "<text x=\"{}\" y=\"{}\" class=\"end\">{}</text>", LEFT - 8.0, top + 14.0, escape(name));
            stretches.iter().for_each(|stretch| self.bar(top + 3.0, *stretch, &mut svg));
        }
        let _ = write!(svg, "<path class=\"axis\" d=\"M{LEFT} 0V{low}H{}\"/>", WIDTH - RIGHT);
        let middle = 0.5 * (LEFT + WIDTH - RIGHT);
        let _ =
            write!(svg, "<text x=\"{middle}\" y=\"{}\" class=\"middle\">{}</text>", low + 32.0, escape(self.x.label()));
        svg + "</svg>"
    }

    fn bar(&self, top: f64, (from, to, place): Stretch, svg: &mut String) {
        let (Some(a), Some(b)) = (self.across(from), self.across(to)) else { return };
        let lane = (ROW - 4.0) / self.places.len().max(1) as f64;
        let _ = write!(
            svg,
            "<rect class=\"fill {}\" x=\"{a:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{lane:.1}\"/>",
            tone(place).class(),
            top + lane * place as f64,
            // What took no time to speak of is there all the same.
            (b - a).max(1.0)
        );
    }

    fn across(&self, value: f64) -> Option<f64> {
        self.x.place(value).map(|at| LEFT + at * (WIDTH - LEFT - RIGHT))
    }
}

fn tone(place: usize) -> Tone {
    TONES[place % TONES.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_place_has_its_lane_and_names_are_escaped() {
        let rows = vec![("<a>".to_owned(), vec![(0.0, 50.0, 0), (50.0, 100.0, 1)])];
        let axis = Axis::exact("seconds", 0.0, 100.0);
        let svg = Timeline::new(axis, "two nodes", rows, vec!["n1".into(), "n2".into()]).figure("when").into_text();
        assert!(svg.contains("&lt;a&gt;") && !svg.contains("<a>"), "{svg}");
        assert!(svg.contains(r#"class="fill blue" x="114.0" y="3.0" width="116.0" height="7.0""#), "{svg}");
        assert!(svg.contains(r#"class="fill orange" x="230.0" y="10.0" width="116.0" height="7.0""#), "{svg}");
    }
}
