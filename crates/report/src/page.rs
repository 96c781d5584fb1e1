//! One self-contained HTML file with a table of contents.

use std::fmt::Write;

use crate::html::{Html, escape};

/// The style sheet, also of plots that are files of their own.
pub(crate) const STYLE: &str = include_str!("style.css");

/// A page of sections.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Page {
    title: String,
    lead: Html,
    sections: Vec<(&'static str, String, Html)>,
}

impl Page {
    /// A page without sections.
    pub fn new(title: impl Into<String>, lead: Html) -> Self {
        Self { title: title.into(), lead, sections: Vec::new() }
    }

    /// Adds a section; `id` names it in addresses. A section without content says nothing and is left out.
    pub fn section(&mut self, id: &'static str, title: impl Into<String>, body: Html) {
        if !body.is_empty() {
            self.sections.push((id, title.into(), body));
        }
    }

    /// The whole file: no script, no address but those of its own sections, the same bytes for the same content.
    pub fn into_text(self) -> String {
        let title = escape(&self.title);
        let mut html = format!(
            "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
             <meta name=\"color-scheme\" content=\"light dark\"><title>{title}</title>\n<style>\n{STYLE}</style></head>\n\
             <body><header><h1>{title}</h1>{}</header>\n<nav aria-label=\"Contents\"><ol>",
            self.lead.into_text()
        );
        for (id, title, _) in &self.sections {
            let _ = write!(html, "<li><a href=\"#{id}\">{}</a></li>", escape(title));
        }
        html += "</ol></nav>\n<main>\n";
        for (id, title, body) in self.sections {
            let _ = writeln!(html, "<section id=\"{id}\"><h2>{}</h2>{}</section>", escape(&title), body.into_text());
        }
        html + "</main></body></html>\n"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_has_contents_and_leaves_out_what_is_empty() {
        let mut page = Page::new("A <take>", Html::paragraph("lead"));
        page.section("one", "One", Html::paragraph("body"));
        page.section("two", "Two", Html::default());
        let text = page.into_text();
        assert!(text.contains("<a href=\"#one\">One</a>") && text.contains("<h1>A &lt;take&gt;</h1>"));
        assert!(
            !text.contains("Two") && !text.contains("http") && !text.contains("<script") && !text.contains("<link")
        );
    }
}
