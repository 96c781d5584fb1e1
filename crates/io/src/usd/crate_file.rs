//! USD's binary crate format, version 0.8.0: values as they arrive, then tables of tokens, fields, paths and specs.
//!
//! Header 88 bytes; TOC at the end. Token 0 is a dummy, because a negative element token marks a property. Children are
//! `TokenVector`s. An array is a 64-bit count and raw numbers. Tables of integers are delta coded, then LZ4.

use std::{
    collections::BTreeMap,
    fs::File,
    io::{BufWriter, Result, Seek, SeekFrom, Write},
    path::Path,
};

use glam::{Vec2, Vec3};

use super::{LayerHead, up_axis};
use crate::{
    IoError,
    whole_file::{Unfinished, write_whole},
};

/// Types of values (crate format's `TypeEnum`).
#[derive(Clone, Copy)]
#[repr(u64)]
enum Type {
    Bool = 1,
    Int = 3,
    Float = 8,
    Double = 9,
    Token = 11,
    Vec2f = 20,
    Vec3f = 24,
    TokenVector = 41,
    Specifier = 42,
    Variability = 44,
    TimeSamples = 46,
    DoubleVector = 48,
}

const ARRAY: u64 = 1 << 63;
const INLINED: u64 = 1 << 62;

/// Kinds of specs.
const ATTRIBUTE: u32 = 1;
const PRIM: u32 = 6;
const PSEUDO_ROOT: u32 = 7;

/// Writes a layer of one prim below `/hair`: its name and type, and its attributes, whose values `values` writes.
pub(super) fn write_layer(
    path: &Path,
    head: &LayerHead,
    (name, type_name): (&str, &str),
    values: impl FnOnce(&mut Crate) -> std::result::Result<Vec<Attribute>, Unfinished>,
) -> std::result::Result<(), IoError> {
    write_whole(path, |out| {
        let mut file = Crate::begin(out)?;
        let attributes = values(&mut file)?;

        // The pseudo-root and its layer's metadata.
        let mut root = Vec::new();
        for (name, number) in [
            ("endTimeCode", head.last()),
            ("framesPerSecond", head.fps),
            ("metersPerUnit", head.metres_per_unit),
            ("startTimeCode", head.first()),
            ("timeCodesPerSecond", head.fps),
        ] {
            root.push((name, file.double(number)?));
        }
        root.push(("defaultPrim", file.token_value("hair")));
        root.push(("upAxis", file.token_value(up_axis(head.up))));
        root.push(("primChildren", file.token_vector(&["hair"])?));
        file.spec(0, PSEUDO_ROOT, &root);

        // The two prims.
        let def = rep(Type::Specifier, INLINED, 0);
        let hair = [
            ("specifier", def),
            ("typeName", file.token_value("Xform")),
            ("primChildren", file.token_vector(&[name])?),
        ];
        file.spec(1, PRIM, &hair);
        let names: Vec<&str> = attributes.iter().map(|attribute| attribute.name).collect();
        let prim =
            [("specifier", def), ("typeName", file.token_value(type_name)), ("properties", file.token_vector(&names)?)];
        file.spec(2, PRIM, &prim);
        for (at, attribute) in attributes.iter().enumerate() {
            let fields = attribute.fields(&mut file);
            file.spec(3 + at as u32, ATTRIBUTE, &fields);
        }
        Ok(file.finish(name, &names)?)
    })
}

/// An attribute as it goes into the tables.
pub(super) struct Attribute {
    pub name: &'static str,
    pub type_name: &'static str,
    pub uniform: bool,
    pub interpolation: Option<&'static str>,
    pub default: Option<u64>,
    pub samples: Option<u64>,
}

impl Attribute {
    pub fn new(name: &'static str, type_name: &'static str) -> Self {
        Self { name, type_name, uniform: false, interpolation: None, default: None, samples: None }
    }

    fn fields(&self, file: &mut Crate) -> Vec<(&'static str, u64)> {
        let mut fields = vec![
            ("custom", rep(Type::Bool, INLINED, 0)),
            ("typeName", file.token_value(self.type_name)),
            ("variability", rep(Type::Variability, INLINED, u64::from(self.uniform))),
        ];
        if let Some(interpolation) = self.interpolation {
            fields.push(("interpolation", file.token_value(interpolation)));
        }
        fields.extend(self.default.map(|value| ("default", value)));
        fields.extend(self.samples.map(|value| ("timeSamples", value)));
        fields
    }
}

fn rep(kind: Type, flags: u64, payload: u64) -> u64 {
    flags | (kind as u64) << 48 | payload
}

/// A crate file being written.
pub(super) struct Crate<'a> {
    out: &'a mut BufWriter<File>,
    at: u64,
    tokens: Vec<String>,
    token_numbers: BTreeMap<String, u32>,
    fields: Vec<(u32, u64)>,
    field_sets: Vec<u32>,
    /// (path, first field of its set, kind)
    specs: Vec<(u32, u32, u32)>,
}

impl<'a> Crate<'a> {
    fn begin(out: &'a mut BufWriter<File>) -> Result<Self> {
        let mut file = Self {
            out,
            at: 0,
            tokens: Vec::new(),
            token_numbers: BTreeMap::new(),
            fields: Vec::new(),
            field_sets: Vec::new(),
            specs: Vec::new(),
        };
        file.token(";-)");
        file.put(&[0; 88])?;
        Ok(file)
    }

    fn put(&mut self, bytes: &[u8]) -> Result<()> {
        self.at += bytes.len() as u64;
        self.out.write_all(bytes)
    }

    fn put_u64(&mut self, number: u64) -> Result<()> {
        self.put(&number.to_le_bytes())
    }

    /// The start of a value, aligned to 8 bytes so that readers can map arrays.
    fn start(&mut self) -> Result<u64> {
        let padding = (8 - self.at % 8) % 8;
        self.put(&[0; 8][..padding as usize])?;
        Ok(self.at)
    }

    fn token(&mut self, text: &str) -> u32 {
        if let Some(&number) = self.token_numbers.get(text) {
            return number;
        }
        let number = self.tokens.len() as u32;
        self.tokens.push(text.to_owned());
        self.token_numbers.insert(text.to_owned(), number);
        number
    }

    pub fn token_value(&mut self, text: &str) -> u64 {
        rep(Type::Token, INLINED, u64::from(self.token(text)))
    }

    /// Whether something is so.
    pub fn boolean(is_so: bool) -> u64 {
        rep(Type::Bool, INLINED, u64::from(is_so))
    }

    fn token_vector(&mut self, names: &[&str]) -> Result<u64> {
        let at = self.start()?;
        self.put_u64(names.len() as u64)?;
        for name in names {
            let number = self.token(name);
            self.put(&number.to_le_bytes())?;
        }
        Ok(rep(Type::TokenVector, 0, at))
    }

    fn double(&mut self, number: f64) -> Result<u64> {
        let at = self.start()?;
        self.put(&number.to_le_bytes())?;
        Ok(rep(Type::Double, 0, at))
    }

    pub fn doubles(&mut self, numbers: &[f64]) -> Result<u64> {
        let at = self.start()?;
        self.put_u64(numbers.len() as u64)?;
        numbers.iter().try_for_each(|x| self.put(&x.to_le_bytes()))?;
        Ok(rep(Type::DoubleVector, 0, at))
    }

    /// An array of 4-byte numbers, `count` elements.
    fn array(&mut self, kind: Type, count: usize, words: impl Iterator<Item = [u8; 4]>) -> Result<u64> {
        if count == 0 {
            return Ok(rep(kind, ARRAY, 0));
        }
        let at = self.start()?;
        self.put_u64(count as u64)?;
        for word in words {
            self.put(&word)?;
        }
        Ok(rep(kind, ARRAY, at))
    }

    pub fn ints(&mut self, numbers: &[i32]) -> Result<u64> {
        self.array(Type::Int, numbers.len(), numbers.iter().map(|x| x.to_le_bytes()))
    }

    pub fn floats(&mut self, numbers: &[f32]) -> Result<u64> {
        self.array(Type::Float, numbers.len(), numbers.iter().map(|x| x.to_le_bytes()))
    }

    pub fn vectors(&mut self, points: &[Vec3]) -> Result<u64> {
        self.array(Type::Vec3f, points.len(), points.iter().flat_map(|p| p.to_array()).map(f32::to_le_bytes))
    }

    pub fn coordinates(&mut self, points: &[Vec2]) -> Result<u64> {
        self.array(Type::Vec2f, points.len(), points.iter().flat_map(|p| p.to_array()).map(f32::to_le_bytes))
    }

    /// Times by their earlier written vector, then one value a time; the two offsets skip nothing.
    pub fn time_samples(&mut self, times: u64, values: &[u64]) -> Result<u64> {
        let at = self.start()?;
        for number in [8, times, 8, values.len() as u64].iter().chain(values) {
            self.put_u64(*number)?;
        }
        Ok(rep(Type::TimeSamples, 0, at))
    }

    fn spec(&mut self, path: u32, kind: u32, fields: &[(&str, u64)]) {
        self.specs.push((path, self.field_sets.len() as u32, kind));
        for &(name, value) in fields {
            let token = self.token(name);
            self.field_sets.push(self.fields.len() as u32);
            self.fields.push((token, value));
        }
        self.field_sets.push(u32::MAX);
    }

    /// The tables and the TOC. Paths: `/`, `/hair`, the prim `name` below it and its properties, numbered in this order.
    fn finish(mut self, name: &str, properties: &[&str]) -> Result<()> {
        let (paths, elements, jumps) = self.paths(name, properties);
        let mut sections: Vec<(&str, u64, u64)> = Vec::new();

        let start = self.start()?;
        let text: Vec<u8> = self.tokens.iter().flat_map(|token| token.bytes().chain([0])).collect();
        let packed = lz4(&text);
        for number in [self.tokens.len() as u64, text.len() as u64, packed.len() as u64] {
            self.put_u64(number)?;
        }
        self.put(&packed)?;
        sections.push(("TOKENS", start, self.at - start));

        let start = self.start()?;
        self.put_u64(0)?;
        sections.push(("STRINGS", start, self.at - start));

        let start = self.start()?;
        let fields = std::mem::take(&mut self.fields);
        self.put_u64(fields.len() as u64)?;
        self.put_integers(fields.iter().map(|(token, _)| *token as i32))?;
        let values: Vec<u8> = fields.iter().flat_map(|(_, value)| value.to_le_bytes()).collect();
        let packed = lz4(&values);
        self.put_u64(packed.len() as u64)?;
        self.put(&packed)?;
        sections.push(("FIELDS", start, self.at - start));

        let start = self.start()?;
        let sets = std::mem::take(&mut self.field_sets);
        self.put_u64(sets.len() as u64)?;
        self.put_integers(sets.iter().map(|&field| field as i32))?;
        sections.push(("FIELDSETS", start, self.at - start));

        let start = self.start()?;
        self.put_u64(paths.len() as u64)?;
        self.put_u64(paths.len() as u64)?;
        for table in [paths, elements, jumps] {
            self.put_integers(table.into_iter())?;
        }
        sections.push(("PATHS", start, self.at - start));

        let start = self.start()?;
        let specs = std::mem::take(&mut self.specs);
        self.put_u64(specs.len() as u64)?;
        self.put_integers(specs.iter().map(|spec| spec.0 as i32))?;
        self.put_integers(specs.iter().map(|spec| spec.1 as i32))?;
        self.put_integers(specs.iter().map(|spec| spec.2 as i32))?;
        sections.push(("SPECS", start, self.at - start));

        let toc = self.start()?;
        self.put_u64(sections.len() as u64)?;
        for (name, start, size) in sections {
            let mut label = [0u8; 16];
            label[..name.len()].copy_from_slice(name.as_bytes());
            self.put(&label)?;
            self.put_u64(start)?;
            self.put_u64(size)?;
        }
        self.out.seek(SeekFrom::Start(0))?;
        self.out.write_all(b"PXR-USDC")?;
        self.out.write_all(&[0, 8, 0, 0, 0, 0, 0, 0])?;
        self.out.write_all(&toc.to_le_bytes())?;
        self.out.flush()
    }

    /// The tree of paths, depth first: numbers, element tokens (negative: a property), and jumps (−1: only a child
    /// follows, 0: only a sibling, −2: neither).
    fn paths(&mut self, name: &str, properties: &[&str]) -> (Vec<i32>, Vec<i32>, Vec<i32>) {
        let numbers = (0..3 + properties.len() as i32).collect();
        let mut elements = vec![self.token("") as i32, self.token("hair") as i32, self.token(name) as i32];
        elements.extend(properties.iter().map(|name| -(self.token(name) as i32)));
        let mut jumps = vec![-1; 3];
        jumps.extend((0..properties.len()).map(|at| if at + 1 == properties.len() { -2 } else { 0 }));
        (numbers, elements, jumps)
    }

    fn put_integers(&mut self, numbers: impl Iterator<Item = i32>) -> Result<()> {
        let packed = lz4(&delta_coded(numbers));
        self.put_u64(packed.len() as u64)?;
        self.put(&packed)
    }
}

/// One LZ4 block behind a zero byte (the number of chunks, less one).
fn lz4(data: &[u8]) -> Vec<u8> {
    let mut packed = vec![0u8];
    packed.extend(lz4_flex::block::compress(data));
    packed
}

/// Differences: the commonest one, two bits each (0: the commonest, 1, 2, 3: one, two, four bytes follow), the rest.
fn delta_coded(numbers: impl Iterator<Item = i32>) -> Vec<u8> {
    let mut last = 0i32;
    let deltas: Vec<i32> = numbers.map(|x| x.wrapping_sub(std::mem::replace(&mut last, x))).collect();
    let mut counts = BTreeMap::new();
    deltas.iter().for_each(|&delta| *counts.entry(delta).or_insert(0usize) += 1);
    let common = counts.iter().max_by_key(|(_, count)| **count).map_or(0, |(delta, _)| *delta);
    let mut codes = vec![0u8; (deltas.len() * 2).div_ceil(8)];
    let mut rest = Vec::new();
    for (at, &delta) in deltas.iter().enumerate() {
        let code = if delta == common {
            0
        } else if let Ok(small) = i8::try_from(delta) {
            rest.extend(small.to_le_bytes());
            1
        } else if let Ok(middle) = i16::try_from(delta) {
            rest.extend(middle.to_le_bytes());
            2
        } else {
            rest.extend(delta.to_le_bytes());
            3u8
        };
        codes[at / 4] |= code << (at % 4 * 2);
    }
    [common.to_le_bytes().as_slice(), &codes, &rest].concat()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Up, read_groom};

    /// 40 million equal numbers in 40 KB: 480 MB once they are read.
    #[test]
    fn a_small_file_cannot_claim_more_than_it_can_hold() {
        const PACKED: u64 = 1 << 61;
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.usdc");
        let head = LayerHead { times: vec![0.0], fps: 25.0, metres_per_unit: 0.001, up: Up::Z };
        for (count, expected) in [(40_000_000usize, Some("claims 40000000 packed numbers")), (20, None)] {
            write_layer(&path, &head, ("strands", "BasisCurves"), |file| {
                let points = file.vectors(&vec![Vec3::ONE; if expected.is_none() { 2 * count } else { 2 }])?;
                let packed = lz4(&delta_coded(std::iter::repeat_n(2, count)));
                let at = file.start()?;
                file.put_u64(count as u64)?;
                file.put_u64(packed.len() as u64)?;
                file.put(&packed)?;
                let counts = rep(Type::Int, ARRAY | PACKED, at);
                Ok(vec![
                    Attribute { default: Some(counts), ..Attribute::new("curveVertexCounts", "int[]") },
                    Attribute { default: Some(points), ..Attribute::new("points", "point3f[]") },
                ])
            })
            .unwrap();
            let read = read_groom(&path);
            match expected {
                Some(fact) => {
                    assert!(std::fs::metadata(&path).unwrap().len() < 100_000);
                    let error = read.unwrap_err().to_string();
                    assert!(error.contains(fact), "{error}");
                }
                None => assert_eq!(read.unwrap().strands.len(), count, "equal numbers are packed well all the same"),
            }
        }
    }
}
