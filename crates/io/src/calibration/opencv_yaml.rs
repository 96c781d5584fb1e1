//! The part of YAML that OpenCV's file storage writes: indented maps, matrices, flow sequences, scalars.

use super::opencv::{Node, matrix_from_map, number};

/// Deeper nesting than this is no calibration.
const MAX_DEPTH: usize = 16;

type Fault = (usize, String);

/// Parses a file; an error is a line (from 1) and a fact.
pub(super) fn parse(text: &str) -> Result<Node, Fault> {
    let mut lines = Vec::new();
    for (i, line) in text.lines().enumerate() {
        let body = line.trim_end();
        let content = body.trim_start();
        if content.is_empty() || content.starts_with(['#', '%']) || content == "---" || content == "..." {
            continue;
        }
        lines.push(Line { number: i + 1, indent: body.len() - content.len(), content: content.to_owned() });
    }
    let mut parser = Parser { lines, at: 0 };
    let indent = parser.lines.first().map_or(0, |line| line.indent);
    let root = parser.block(indent, 0)?;
    match parser.lines.get(parser.at) {
        Some(line) => Err((line.number, "the indentation does not fit".into())),
        None => Ok(root),
    }
}

struct Line {
    number: usize,
    indent: usize,
    content: String,
}

struct Parser {
    lines: Vec<Line>,
    at: usize,
}

impl Parser {
    /// The lines of one indentation as a map; items of a sequence are numbered.
    fn block(&mut self, indent: usize, depth: usize) -> Result<Node, Fault> {
        let mut map: Vec<(String, Node)> = Vec::new();
        while let Some(line) = self.lines.get(self.at).filter(|line| line.indent == indent) {
            let (number_of_line, content) = (line.number, line.content.clone());
            if depth > MAX_DEPTH {
                return Err((number_of_line, "nested too deeply".into()));
            }
            let key;
            let value;
            if let Some(item) = content.strip_prefix('-').filter(|item| item.is_empty() || item.starts_with(' ')) {
                key = map.len().to_string();
                value = self.item(indent, item, depth)?;
            } else {
                let Some((name, rest)) = content.split_once(':') else {
                    return Err((number_of_line, format!("`{content}` is not `name: value`")));
                };
                key = name.trim().trim_matches(['"', '\'']).to_owned();
                self.at += 1;
                value = self.value(indent, rest.trim(), number_of_line, depth)?;
            }
            map.push((key, value));
        }
        Ok(Node::Map(map))
    }

    fn item(&mut self, indent: usize, item: &str, depth: usize) -> Result<Node, Fault> {
        let number_of_line = self.lines[self.at].number;
        let body = item.trim_start();
        if body.contains(": ") || body.ends_with(':') {
            // `- name: value` opens a map that is indented past the dash.
            let inner = indent + 1 + item.len() - body.len();
            self.lines[self.at] = Line { number: number_of_line, indent: inner, content: body.to_owned() };
            return self.block(inner, depth + 1);
        }
        self.at += 1;
        self.value(indent, body, number_of_line, depth)
    }

    fn value(&mut self, indent: usize, rest: &str, line: usize, depth: usize) -> Result<Node, Fault> {
        if rest.starts_with("!!opencv-matrix") || rest.starts_with("!!opencv-nd-matrix") {
            return match self.child(indent, depth)? {
                Node::Map(map) => matrix_from_map(map).map_err(|fact| (line, fact)),
                other => Ok(other),
            };
        }
        if rest.is_empty() {
            return self.child(indent, depth);
        }
        if rest.starts_with('[') {
            return self.flow(rest, line);
        }
        Ok(number(rest)
            .map_or_else(|| Node::Text(rest.trim_matches(['"', '\'']).to_owned()), |x| Node::Numbers(vec![x])))
    }

    fn child(&mut self, indent: usize, depth: usize) -> Result<Node, Fault> {
        match self.lines.get(self.at) {
            Some(next) if next.indent > indent => self.block(next.indent, depth + 1),
            _ => Ok(Node::Map(Vec::new())),
        }
    }

    /// `[ 1., 2., … ]`, perhaps over several lines.
    fn flow(&mut self, first: &str, line: usize) -> Result<Node, Fault> {
        let mut text = first.to_owned();
        let mut is_closed = first.contains(']');
        while !is_closed {
            let Some(next) = self.lines.get(self.at) else { return Err((line, "the list has no end".into())) };
            text.push(' ');
            text.push_str(&next.content);
            is_closed = next.content.contains(']');
            self.at += 1;
        }
        let inner = text.trim_start_matches('[').split(']').next().unwrap_or_default();
        let words = inner.split([',', ' ', '\t']).filter(|word| !word.is_empty());
        let numbers = words.map(|word| number(word).ok_or_else(|| (line, format!("`{word}` is no number"))));
        numbers.collect::<Result<_, _>>().map(Node::Numbers)
    }
}
