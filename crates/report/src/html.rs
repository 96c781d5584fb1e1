//! Pieces of a page. Text is escaped where it enters; pieces are balanced by themselves.

use std::fmt::Write;

/// Text as it may stand in HTML, between tags and in quotes.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out += "&amp;",
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '"' => out += "&quot;",
            // Control characters of a broken file name have no place in a document.
            c if c.is_control() && !c.is_whitespace() => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

/// A balanced piece of HTML.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Html(String);

/// A cell of a table: text to the left, numbers to the right.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    /// Words.
    Text(String),
    /// A number as text.
    Number(String),
    /// A bar of a share from 0 to 1.
    Bar(f64),
}

impl Html {
    /// HTML that is escaped and balanced already.
    pub(crate) fn raw(html: String) -> Self {
        Self(html)
    }

    /// A paragraph.
    pub fn paragraph(text: &str) -> Self {
        Self(format!("<p>{}</p>", escape(text)))
    }

    /// A small heading.
    pub fn heading(text: &str) -> Self {
        Self(format!("<h3>{}</h3>", escape(text)))
    }

    /// A paragraph that says that something is wrong or absent, and below it what to do.
    pub fn warning(fact: &str, hint: &str) -> Self {
        let hint = if hint.is_empty() { String::new() } else { format!("<br>{}", escape(hint)) };
        Self(format!("<p class=\"warning\">{}{hint}</p>", escape(fact)))
    }

    /// A list.
    pub fn list(items: impl IntoIterator<Item = String>) -> Self {
        let items: String = items.into_iter().map(|item| format!("<li>{}</li>", escape(&item))).collect();
        if items.is_empty() { Self::default() } else { Self(format!("<ul>{items}</ul>")) }
    }

    /// A table that scrolls by itself where the page is too narrow for it.
    pub fn table(header: &[&str], rows: impl IntoIterator<Item = Vec<Cell>>) -> Self {
        let mut html = String::from("<div class=\"wide\"><table><thead><tr>");
        html.extend(header.iter().map(|title| format!("<th scope=\"col\">{}</th>", escape(title))));
        html += "</tr></thead><tbody>";
        for row in rows {
            html += "<tr>";
            for cell in row {
                let _ = match cell {
                    Cell::Text(text) => write!(html, "<td>{}</td>", escape(&text)),
                    Cell::Number(text) => write!(html, "<td class=\"number\">{}</td>", escape(&text)),
                    Cell::Bar(share) => write!(html, "<td class=\"bar\">{}</td>", bar(share)),
                };
            }
            html += "</tr>";
        }
        Self(html + "</tbody></table></div>")
    }

    /// Pieces side by side where there is room, below each other where not.
    pub fn side_by_side(pieces: impl IntoIterator<Item = Self>) -> Self {
        let pieces: String = pieces.into_iter().map(|piece| piece.0).collect();
        if pieces.is_empty() { Self::default() } else { Self(format!("<div class=\"columns\">{pieces}</div>")) }
    }

    /// A line to open for more.
    pub fn more(summary: &str, inside: &Self) -> Self {
        Self(format!("<details><summary>{}</summary>{}</details>", escape(summary), inside.0))
    }

    /// Adds a piece.
    pub fn push(&mut self, piece: Self) {
        self.0 += &piece.0;
    }

    /// Whether there is nothing.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The HTML.
    pub fn into_text(self) -> String {
        self.0
    }
}

impl Extend<Html> for Html {
    fn extend<I: IntoIterator<Item = Html>>(&mut self, pieces: I) {
        pieces.into_iter().for_each(|piece| self.push(piece));
    }
}

impl FromIterator<Html> for Html {
    fn from_iter<I: IntoIterator<Item = Html>>(pieces: I) -> Self {
        Self(pieces.into_iter().map(|piece| piece.0).collect())
    }
}

fn bar(share: f64) -> String {
    let width = 100.0 * if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 };
    format!(
        "<svg viewBox=\"0 0 100 10\" preserveAspectRatio=\"none\" aria-hidden=\"true\">\
         <rect class=\"fill blue\" width=\"{width:.1}\" height=\"10\"/></svg>"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_cannot_become_markup() {
        let table = Html::table(&["<a>"], [vec![Cell::Text("\"x\" & <script>".into()), Cell::Bar(f64::NAN)]]);
        let text = table.into_text();
        assert!(text.contains("&lt;a&gt;") && text.contains("&quot;x&quot; &amp; &lt;script&gt;"), "{text}");
        assert_eq!(escape("a\u{0}b"), "a\u{fffd}b");
    }
}
