//! USD as text, read: prims, and of their attributes those that strands need. References and variants are not followed.

use super::layer::{Layer, Prim, Value, is_needed, up_of};

/// Prims within prims: deeper files are damage.
const DEEPEST: usize = 256;

/// Reads a layer.
pub(super) fn read(data: &[u8]) -> Result<Layer, String> {
    let mut reader = Reader { data, at: 0, layer: Layer::default() };
    if !data.starts_with(b"#usda") {
        return Err("is no USD text file".into());
    }
    reader.file().map_err(|fact| {
        let line = 1 + data[..reader.at.min(data.len())].iter().filter(|&&byte| byte == b'\n').count();
        format!("line {line}: {fact}")
    })?;
    Ok(reader.layer)
}

struct Reader<'a> {
    data: &'a [u8],
    at: usize,
    layer: Layer,
}

type Fact<T> = Result<T, String>;

impl<'a> Reader<'a> {
    fn file(&mut self) -> Fact<()> {
        if self.next_is(b'(') {
            self.layer_metadata()?;
        }
        while self.peek().is_some() {
            self.statement(None, false, 0)?;
        }
        Ok(())
    }

    /// `metersPerUnit` and `upAxis` of the layer; its other entries are passed over.
    fn layer_metadata(&mut self) -> Fact<()> {
        self.expect(b'(')?;
        while !self.next_is(b')') {
            if self.peek().is_none() {
                return Err("ends within the layer's metadata".into());
            }
            let key = self.word();
            if key.is_empty() {
                self.skip_value()?;
                continue;
            }
            if !self.next_is(b'=') {
                continue;
            }
            self.expect(b'=')?;
            match key {
                "metersPerUnit" => self.layer.metres_per_unit = Some(self.number()?),
                "upAxis" => self.layer.up = up_of(self.string()?),
                _ => self.skip_value()?,
            }
        }
        self.expect(b')')
    }

    /// A prim, an attribute or a relationship.
    fn statement(&mut self, parent: Option<usize>, is_abstract: bool, depth: usize) -> Fact<()> {
        if self.next_is(b';') {
            return self.expect(b';');
        }
        match self.word() {
            "" => Err(format!("`{}` stands where a name should", self.peek().map_or(' ', char::from))),
            "def" | "over" => self.prim(parent, is_abstract, depth),
            "class" => self.prim(parent, true, depth),
            // What is within variants is not chosen.
            "variantSet" => {
                self.string()?;
                self.expect(b'=')?;
                self.skip_value()
            }
            first => self.attribute(first, parent),
        }
    }

    fn prim(&mut self, parent: Option<usize>, is_abstract: bool, depth: usize) -> Fact<()> {
        if depth > DEEPEST {
            return Err("prims stand too deep within each other".into());
        }
        let type_name = if self.next_is(b'"') { String::new() } else { self.word().to_owned() };
        let name = self.string()?.to_owned();
        if self.next_is(b'(') {
            self.skip_value()?;
        }
        let own = self.layer.prims.len();
        self.layer.prims.push(Prim { name, type_name, parent, is_abstract, ..Prim::default() });
        self.expect(b'{')?;
        while !self.next_is(b'}') {
            if self.peek().is_none() {
                return Err("ends within a prim".into());
            }
            self.statement(Some(own), is_abstract, depth + 1)?;
        }
        self.expect(b'}')
    }

    /// `[custom] [uniform] type name [= value] [(metadata)]`; relationships and list edits alike.
    fn attribute(&mut self, first: &'a str, prim: Option<usize>) -> Fact<()> {
        let mut kind = first;
        while matches!(
            kind,
            "custom" | "uniform" | "varying" | "config" | "prepend" | "append" | "add" | "delete" | "reorder"
        ) {
            kind = self.word();
        }
        let name = if self.next_is(b'=') { kind } else { self.word() };
        if self.next_is(b'=') {
            self.expect(b'=')?;
            let (name, is_sampled) = name.strip_suffix(".timeSamples").map_or((name, false), |name| (name, true));
            match prim.filter(|_| is_needed(name)) {
                Some(prim) => {
                    let value = if is_sampled { self.first_sample()? } else { self.value()? };
                    // The default goes before samples.
                    if let Some(value) = value {
                        let attributes = &mut self.layer.prims[prim].attributes;
                        if !is_sampled || !attributes.contains_key(name) {
                            attributes.insert(name.to_owned(), value);
                        }
                    }
                }
                None => self.skip_value()?,
            }
        }
        if self.next_is(b'(') { self.skip_value() } else { Ok(()) }
    }

    /// `{time: value, …}`, the first of them.
    fn first_sample(&mut self) -> Fact<Option<Value>> {
        self.expect(b'{')?;
        if self.next_is(b'}') {
            self.expect(b'}')?;
            return Ok(None);
        }
        self.number()?;
        self.expect(b':')?;
        let value = self.value()?;
        while !self.next_is(b'}') {
            if self.peek().is_none() {
                return Err("ends within time samples".into());
            }
            self.skip_value()?;
        }
        self.expect(b'}')?;
        Ok(value)
    }

    /// Numbers or names, in brackets of any depth or alone; `None` for a blocked value.
    fn value(&mut self) -> Fact<Option<Value>> {
        let (mut numbers, mut names, mut depth) = (Vec::new(), Vec::new(), 0usize);
        loop {
            match self.peek().ok_or("ends within a value")? {
                b'[' | b'(' => {
                    depth += 1;
                    self.at += 1;
                }
                b']' | b')' => {
                    depth = depth.checked_sub(1).ok_or("a bracket closes that did not open")?;
                    self.at += 1;
                }
                b',' => self.at += 1,
                b'"' | b'\'' => names.push(self.string()?.to_owned()),
                b'N' if self.data[self.at..].starts_with(b"None") => {
                    self.at += 4;
                    return Ok(None);
                }
                _ => numbers.push(self.number()?),
            }
            if depth == 0 {
                return Ok(Some(if names.is_empty() { Value::Numbers(numbers) } else { Value::Names(names) }));
            }
        }
    }

    /// Passes over one bracketed, quoted or bare thing.
    fn skip_value(&mut self) -> Fact<()> {
        let mut depth = 0usize;
        loop {
            match self.peek().ok_or("ends within a value")? {
                b'[' | b'(' | b'{' => {
                    depth += 1;
                    self.at += 1;
                }
                b']' | b')' | b'}' => {
                    depth = depth.checked_sub(1).ok_or("a bracket closes that did not open")?;
                    self.at += 1;
                }
                b'"' | b'\'' => drop(self.string()?),
                b'@' => self.asset()?,
                b'<' => self.until(b">")?,
                _ => {
                    if self.word().is_empty() {
                        self.at += 1;
                    }
                }
            }
            if depth == 0 {
                return Ok(());
            }
        }
    }

    fn asset(&mut self) -> Fact<()> {
        let quote: &[u8] = if self.data[self.at..].starts_with(b"@@@") { b"@@@" } else { b"@" };
        self.at += quote.len();
        self.until(quote)
    }

    /// Past the next `end`.
    fn until(&mut self, end: &[u8]) -> Fact<()> {
        let found = self.data[self.at..].windows(end.len()).position(|window| window == end);
        self.at += found.ok_or("something opens that does not close")? + end.len();
        Ok(())
    }

    /// A string in quotes, single or triple, as it stands.
    fn string(&mut self) -> Fact<&'a str> {
        let quote = self.peek().filter(|byte| matches!(byte, b'"' | b'\'')).ok_or("a string is missing")?;
        let length = if self.data[self.at..].starts_with(&[quote; 3]) { 3 } else { 1 };
        let start = self.at + length;
        let mut end = start;
        while !self.data.get(end..).is_some_and(|rest| rest.starts_with(&[quote; 3][..length])) {
            match self.data.get(end) {
                Some(b'\\') => end += 2,
                Some(_) => end += 1,
                None => return Err("a string does not end".into()),
            }
        }
        self.at = end + length;
        std::str::from_utf8(&self.data[start..end]).map_err(|_| "a string is not UTF-8".into())
    }

    /// Letters, digits and what joins them in names, types (`point3f[]`) and numbers; empty where there are none.
    fn word(&mut self) -> &'a str {
        self.peek();
        let start = self.at;
        while let Some(&byte) = self.data.get(self.at) {
            if byte.is_ascii_alphanumeric() || byte >= 0x80 || b"_:.+-".contains(&byte) {
                self.at += 1;
            } else if self.at > start && self.data[self.at..].starts_with(b"[]") {
                self.at += 2;
            } else {
                break;
            }
        }
        std::str::from_utf8(&self.data[start..self.at]).unwrap_or("\u{fffd}")
    }

    fn number(&mut self) -> Fact<f64> {
        self.peek();
        let start = self.at;
        while self.data.get(self.at).is_some_and(|byte| byte.is_ascii_alphanumeric() || b"+-.".contains(byte)) {
            self.at += 1;
        }
        let word = String::from_utf8_lossy(&self.data[start..self.at]);
        word.parse().map_err(|_| format!("`{word}` is no number"))
    }

    fn expect(&mut self, byte: u8) -> Fact<()> {
        if !self.next_is(byte) {
            return Err(format!("`{}` is missing", char::from(byte)));
        }
        self.at += 1;
        Ok(())
    }

    fn next_is(&mut self, byte: u8) -> bool {
        self.peek() == Some(byte)
    }

    /// The next byte that is no space or comment.
    fn peek(&mut self) -> Option<u8> {
        loop {
            match *self.data.get(self.at)? {
                b'#' => {
                    let line = self.data[self.at..].iter().position(|&byte| byte == b'\n');
                    self.at = line.map_or(self.data.len(), |end| self.at + end);
                }
                byte if byte.is_ascii_whitespace() => self.at += 1,
                byte => return Some(byte),
            }
        }
    }
}
