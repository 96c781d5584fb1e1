//! The part of XML that OpenCV's file storage writes: elements, `type_id="opencv-matrix"`, numbers as text.

use super::opencv::{Node, matrix_from_map, number};

/// Deeper nesting than this is no calibration.
const MAX_DEPTH: usize = 16;

type Fault = (usize, String);

/// Parses a file; an error is a line (from 1) and a fact.
pub(super) fn parse(text: &str) -> Result<Node, Fault> {
    let mut parser = Parser { text, at: 0 };
    while let Some(tag) = parser.tag_or_text() {
        if let Piece::Open { name: "opencv_storage", .. } = tag {
            return parser.element("opencv_storage", false, 0);
        }
    }
    Err((1, "is not an OpenCV file (no <opencv_storage>)".into()))
}

enum Piece<'a> {
    Open { name: &'a str, matrix: bool, closed: bool },
    Close(&'a str),
    Text(&'a str),
}

struct Parser<'a> {
    text: &'a str,
    at: usize,
}

impl<'a> Parser<'a> {
    fn line(&self) -> usize {
        self.text[..self.at].matches('\n').count() + 1
    }

    /// The next tag or text; comments and declarations are passed.
    fn tag_or_text(&mut self) -> Option<Piece<'a>> {
        loop {
            let rest = &self.text[self.at..];
            if rest.is_empty() {
                return None;
            }
            if !rest.starts_with('<') {
                let end = rest.find('<').unwrap_or(rest.len());
                self.at += end;
                return Some(Piece::Text(&rest[..end]));
            }
            let closing = if rest.starts_with("<!--") { "-->" } else { ">" };
            let end = rest.find(closing)?;
            self.at += end + closing.len();
            let inner = &rest[1..end];
            if inner.starts_with(['?', '!']) {
                continue;
            }
            if let Some(name) = inner.strip_prefix('/') {
                return Some(Piece::Close(name.trim()));
            }
            let name = inner.split([' ', '\t', '\n', '\r', '/']).next().unwrap_or_default();
            return Some(Piece::Open {
                name,
                matrix: inner.contains("opencv-matrix") || inner.contains("opencv-nd-matrix"),
                closed: inner.ends_with('/'),
            });
        }
    }

    /// What is between `<name>` and `</name>`.
    fn element(&mut self, name: &str, matrix: bool, depth: usize) -> Result<Node, Fault> {
        let line = self.line();
        if depth > MAX_DEPTH {
            return Err((line, "nested too deeply".into()));
        }
        let mut map = Vec::new();
        let mut words = String::new();
        loop {
            match self.tag_or_text() {
                Some(Piece::Text(text)) => words.push_str(text),
                Some(Piece::Open { name, closed: true, .. }) => map.push((name.to_owned(), Node::Map(Vec::new()))),
                Some(Piece::Open { name, matrix, .. }) => {
                    let node = self.element(name, matrix, depth + 1)?;
                    map.push((name.to_owned(), node));
                }
                Some(Piece::Close(end)) if end == name => break,
                Some(Piece::Close(end)) => return Err((self.line(), format!("</{end}> closes <{name}>"))),
                None => return Err((line, format!("<{name}> has no end"))),
            }
        }
        if matrix {
            return matrix_from_map(map).map_err(|fact| (line, fact));
        }
        if !map.is_empty() || depth == 0 {
            return Ok(Node::Map(map));
        }
        let numbers: Option<Vec<f64>> = words.split_whitespace().map(number).collect();
        Ok(match numbers {
            Some(numbers) if !numbers.is_empty() => Node::Numbers(numbers),
            _ => Node::Text(words.trim().trim_matches('"').to_owned()),
        })
    }
}
