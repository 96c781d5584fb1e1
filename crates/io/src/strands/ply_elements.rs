//! PLY's header and rows of numbers: scalars by column, lists passed over.

use crate::bytes::Bytes;

/// The header.
pub(super) struct Elements {
    pub all: Vec<Element>,
    pub comments: Vec<String>,
}

/// A kind of element: so many rows of columns.
pub(super) struct Element {
    pub name: String,
    pub count: u64,
    pub columns: Vec<Column>,
}

pub(super) struct Column {
    pub name: String,
    kind: Kind,
    /// The type of the length, where the column holds lists.
    list: Option<Kind>,
}

/// One number a column; 0 for lists.
pub(super) type Row = [f64];

#[derive(Clone, Copy)]
enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Kind {
    fn of(word: &str) -> Result<Self, String> {
        Ok(match word {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            other => return Err(format!("has a property of the type {other}, which PLY has not")),
        })
    }
}

impl Elements {
    /// The header, and the numbers behind it.
    pub fn of(data: &[u8]) -> Result<(Self, Numbers<'_>), String> {
        let mut lines = Lines { rest: data };
        if lines.next() != Some("ply") {
            return Err("is no PLY file".into());
        }
        let mut elements = Self { all: Vec::new(), comments: Vec::new() };
        let mut is_text = None;
        loop {
            let line = lines.next().ok_or("ends in its header")?;
            let words: Vec<&str> = line.split_ascii_whitespace().collect();
            match words.as_slice() {
                ["end_header"] => break,
                ["format", "ascii", _] => is_text = Some(true),
                ["format", "binary_little_endian", _] => is_text = Some(false),
                ["format", other, ..] => return Err(format!("has the format {other}, which is not read")),
                ["comment" | "obj_info", rest @ ..] => elements.comments.push(rest.join(" ")),
                ["element", name, count] => {
                    let count = count.parse().map_err(|_| format!("has a count that is no number: {line}"))?;
                    elements.all.push(Element { name: (*name).into(), count, columns: Vec::new() });
                }
                ["property", rest @ ..] => {
                    let column = Column::of(rest)?;
                    elements.all.last_mut().ok_or("has a property before an element")?.columns.push(column);
                }
                [] => {}
                _ => return Err(format!("has a header line that is not understood: {line}")),
            }
        }
        let numbers = match is_text.ok_or("does not state its format")? {
            true => Numbers::Text(Box::new(
                std::str::from_utf8(lines.rest).map_err(|_| "is not text")?.split_ascii_whitespace(),
            )),
            false => Numbers::Binary(Bytes::new(lines.rest)),
        };
        Ok((elements, numbers))
    }

    /// The number behind a word in a comment.
    pub fn comment(&self, word: &str) -> Option<usize> {
        let number = |comment: &String| comment.strip_prefix(word)?.trim_start_matches([' ', '=', ':']).parse().ok();
        self.comments.iter().find_map(number)
    }
}

impl Column {
    fn of(words: &[&str]) -> Result<Self, String> {
        match words {
            ["list", length, kind, name] => {
                Ok(Self { name: (*name).into(), kind: Kind::of(kind)?, list: Some(Kind::of(length)?) })
            }
            [kind, name] => Ok(Self { name: (*name).into(), kind: Kind::of(kind)?, list: None }),
            _ => Err(format!("has a property that is not understood: {}", words.join(" "))),
        }
    }
}

struct Lines<'a> {
    rest: &'a [u8],
}

impl<'a> Lines<'a> {
    fn next(&mut self) -> Option<&'a str> {
        let end = self.rest.iter().position(|&byte| byte == b'\n')?;
        let line = std::str::from_utf8(&self.rest[..end]).ok()?;
        self.rest = &self.rest[end + 1..];
        Some(line.trim_end_matches('\r'))
    }
}

/// What stands behind the header.
pub(super) enum Numbers<'a> {
    Text(Box<std::str::SplitAsciiWhitespace<'a>>),
    Binary(Bytes<'a>),
}

impl Numbers<'_> {
    /// All rows of an element.
    pub fn rows(&mut self, element: &Element, mut each: impl FnMut(&Row) -> Result<(), String>) -> Result<(), String> {
        // Elements without columns take no bytes: their count says nothing.
        let count = if element.columns.is_empty() { 0 } else { element.count };
        let mut row = vec![0.0; element.columns.len()];
        for at in 0..count {
            for (value, column) in row.iter_mut().zip(&element.columns) {
                let number = self.column(column);
                *value = number.ok_or_else(|| format!("ends, or is no number, at {} {at}", element.name))?;
            }
            each(&row)?;
        }
        Ok(())
    }

    fn column(&mut self, column: &Column) -> Option<f64> {
        let Some(length) = column.list else { return self.number(column.kind) };
        for _ in 0..self.number(length)? as u64 {
            self.number(column.kind)?;
        }
        Some(0.0)
    }

    fn number(&mut self, kind: Kind) -> Option<f64> {
        let bytes = match self {
            Self::Text(words) => return words.next()?.parse().ok(),
            Self::Binary(bytes) => bytes,
        };
        Some(match kind {
            Kind::I8 => f64::from(bytes.take(1)?[0] as i8),
            Kind::U8 => f64::from(bytes.take(1)?[0]),
            Kind::I16 => f64::from(bytes.u16()? as i16),
            Kind::U16 => f64::from(bytes.u16()?),
            Kind::I32 => f64::from(bytes.i32()?),
            Kind::U32 => f64::from(bytes.u32()?),
            Kind::F32 => f64::from(bytes.f32()?),
            Kind::F64 => bytes.f64()?,
        })
    }
}
