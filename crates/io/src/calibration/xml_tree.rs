//! The part of XML that calibrations use: elements with attributes and text. Entities are left as they are, but for the
//! five of the standard.

/// Deeper nesting than this is no calibration.
const MAX_DEPTH: usize = 32;

/// A line (from 1) and a fact.
pub(super) type Fault = (usize, String);

/// An element.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Element {
    pub name: String,
    pub attributes: Vec<(String, String)>,
    pub children: Vec<Element>,
    /// All text directly inside.
    pub text: String,
    /// From 1.
    pub line: usize,
}

impl Element {
    /// The first child of this name.
    pub fn find(&self, name: &str) -> Option<&Self> {
        self.children.iter().find(|child| child.name == name)
    }

    /// All children of this name.
    pub fn all<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a Self> {
        self.children.iter().filter(move |child| child.name == name)
    }

    /// An attribute.
    pub fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(key, _)| key == name).map(|(_, value)| value.as_str())
    }

    /// The text as numbers.
    pub fn numbers(&self) -> Option<Vec<f64>> {
        self.text.split_whitespace().map(|word| word.parse().ok()).collect()
    }

    /// The text of the first child of this name as one number.
    pub fn number_in(&self, name: &str) -> Option<f64> {
        self.find(name)?.text.trim().parse().ok()
    }
}

/// The document as an element without a name whose children are the root (and whatever follows it).
pub(super) fn parse(text: &str) -> Result<Element, Fault> {
    let mut open = vec![Element { line: 1, ..Element::default() }];
    let (mut at, mut line) = (0, 1);
    while at < text.len() {
        let rest = &text[at..];
        let end = if rest.starts_with('<') {
            tag_end(rest).ok_or((line, "a tag has no end".to_owned()))?
        } else {
            rest.find('<').unwrap_or(rest.len())
        };
        let piece = &rest[..end];
        if let Some(closing) = piece.strip_prefix("</") {
            let name = closing.trim_end_matches('>').trim();
            let current = open.last().map_or("", |element| element.name.as_str());
            if open.len() == 1 || current != name {
                return Err((line, format!("</{name}> closes <{current}>")));
            }
            close(&mut open);
        } else if let Some(inner) = piece.strip_prefix('<') {
            let inner = inner.strip_suffix('>').unwrap_or(inner);
            if !inner.starts_with(['?', '!']) {
                let is_closed = inner.ends_with('/');
                if open.len() > MAX_DEPTH {
                    return Err((line, "nested too deeply".into()));
                }
                open.push(element(inner.trim_end_matches('/'), line)?);
                if is_closed {
                    close(&mut open);
                }
            }
        } else if let Some(current) = open.last_mut() {
            current.text.push_str(&plain(piece));
        }
        line += piece.bytes().filter(|&byte| byte == b'\n').count();
        at += end;
    }
    match open.pop() {
        Some(root) if open.is_empty() => Ok(root),
        Some(unclosed) => Err((unclosed.line, format!("<{}> has no end", unclosed.name))),
        None => Err((1, "is not XML".into())),
    }
}

fn close(open: &mut Vec<Element>) {
    if let Some(done) = open.pop()
        && let Some(parent) = open.last_mut()
    {
        parent.children.push(done);
    }
}

/// One past the end of the tag, comment or declaration at the start of a text.
fn tag_end(text: &str) -> Option<usize> {
    if text.starts_with("<!--") {
        return Some(text.find("-->")? + 3);
    }
    // `>` may stand in a quoted attribute.
    let mut quote = None;
    for (i, c) in text.char_indices() {
        match (quote, c) {
            (None, '>') => return Some(i + 1),
            (None, '"' | '\'') => quote = Some(c),
            (Some(open), c) if open == c => quote = None,
            _ => {}
        }
    }
    None
}

fn element(inner: &str, line: usize) -> Result<Element, Fault> {
    let (name, mut rest) = inner.split_at(inner.find(char::is_whitespace).unwrap_or(inner.len()));
    if name.is_empty() {
        return Err((line, "a tag has no name".into()));
    }
    let mut attributes = Vec::new();
    while let Some((key, after)) = rest.split_once('=') {
        let after = after.trim_start();
        let fault = || (line, format!("an attribute of <{name}> has no quotes"));
        let quote = after.chars().next().filter(|c| matches!(c, '"' | '\'')).ok_or_else(fault)?;
        let (value, behind) = after[1..].split_once(quote).ok_or_else(fault)?;
        attributes.push((key.trim().to_owned(), plain(value)));
        rest = behind;
    }
    Ok(Element { name: name.to_owned(), attributes, line, ..Element::default() })
}

fn plain(text: &str) -> String {
    if !text.contains('&') {
        return text.to_owned();
    }
    let entities = [("&lt;", "<"), ("&gt;", ">"), ("&quot;", "\""), ("&apos;", "'"), ("&amp;", "&")];
    entities.iter().fold(text.to_owned(), |text, (entity, c)| text.replace(entity, c))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elements_attributes_and_text() {
        let text = "<?xml version=\"1.0\"?>\n<!-- <a> -->\n<a b='1' c=\"x > y &amp; z\">\n <d>1 2 3</d><e/>\n</a>\n";
        let root = parse(text).unwrap();
        let a = root.find("a").unwrap();
        assert_eq!((a.attribute("b"), a.attribute("c"), a.line), (Some("1"), Some("x > y & z"), 3));
        assert_eq!(a.find("d").unwrap().numbers().unwrap(), [1.0, 2.0, 3.0]);
        assert_eq!((a.children.len(), a.find("d").unwrap().line), (2, 4));
    }

    #[test]
    fn mistakes_name_the_line() {
        assert_eq!(parse("<a>\n<b>\n</a>").unwrap_err(), (3, "</a> closes <b>".into()));
        assert_eq!(parse("<a>\n<b></b>").unwrap_err(), (1, "<a> has no end".into()));
        assert!(parse("<a b=1></a>").unwrap_err().1.contains("quotes"));
        assert!(parse(&"<a>".repeat(1000)).unwrap_err().1.contains("deep"));
    }
}
