//! USD's binary crate format, read: versions 0.7 to 0.13, and of them the parts that strands need.
//!
//! See [`super::crate_file`] for the layout. A value is a type, flags, and 48 bits: itself, or the place where it lies.

use std::{
    collections::BTreeMap,
    io::{Read, Seek},
};

use super::{
    layer::{Layer, Prim, Value, is_needed, up_of},
    unpack::{integers, unpack},
    values::Values,
};
use crate::{bytes::Bytes, placed::Placed};

/// Kinds of specs.
const ATTRIBUTE: i32 = 1;
const PRIM: i32 = 6;
const PSEUDO_ROOT: i32 = 7;

/// The token of the specifier `class`.
const CLASS: u64 = 2;

/// Rows of a table a byte of the file, at most. Packed tables of equal rows shrink to nothing, but the names and values that
/// rows point to do not.
const MOST_ROWS_A_BYTE: u64 = 1;

/// Bytes of names that one byte unpacks to, at most: LZ4 makes 255 of one where all is equal, and names are not.
const MOST_NAMES_A_BYTE: u64 = 32;

/// The tables of a file.
struct Tables {
    tokens: Vec<String>,
    /// (name, value)
    fields: Vec<(usize, u64)>,
    field_sets: Vec<i32>,
    paths: BTreeMap<i32, Path>,
    /// (path, first of its fields, kind)
    specs: Vec<(i32, i32, i32)>,
}

/// One path: of a prim or of its property.
#[derive(Clone)]
struct Path {
    parent: Option<i32>,
    token: usize,
}

/// Reads a layer.
pub(super) fn read(source: &mut (impl Read + Seek)) -> Result<Layer, String> {
    let mut file = Placed::new(source)?;
    let header = file.bytes(0, 24)?;
    if !header.starts_with(b"PXR-USDC") {
        return Err("is no USD crate file".into());
    }
    let (major, minor) = (header[8], header[9]);
    if major != 0 || !(7..=13).contains(&minor) {
        return Err(format!("is a USD crate of version {major}.{minor}; 0.7 to 0.13 are read"));
    }
    let tables = tables(&mut file)?;
    let mut values = Values { file, tokens: &tables.tokens };
    tables.layer(&mut values)
}

/// Where the parts of the file lie: place and size by name.
type Sections = BTreeMap<Vec<u8>, (u64, u64)>;

fn tables<R: Read + Seek>(file: &mut Placed<R>) -> Result<Tables, String> {
    let sections = sections(file)?;
    let mut section = |name: &str| {
        let &(at, size) = sections.get(name.as_bytes()).ok_or_else(|| format!("is damaged: it lacks {name}"))?;
        file.bytes(at, size)
    };
    let (tokens, fields, sets) = (section("TOKENS")?, section("FIELDS")?, section("FIELDSETS")?);
    let (paths, specs) = (section("PATHS")?, section("SPECS")?);
    let damaged = |name: &'static str| move || format!("is damaged: at its {name}");
    let most = MOST_ROWS_A_BYTE * file.len();
    let tokens = read_tokens(&tokens, most).ok_or_else(damaged("TOKENS"))?;
    Ok(Tables {
        fields: read_fields(&fields, most).ok_or_else(damaged("FIELDS"))?,
        field_sets: read_field_sets(&sets, most).ok_or_else(damaged("FIELDSETS"))?,
        paths: read_paths(&paths, most).ok_or_else(damaged("PATHS"))?,
        specs: read_specs(&specs, most).ok_or_else(damaged("SPECS"))?,
        tokens,
    })
}

fn sections<R: Read + Seek>(file: &mut Placed<R>) -> Result<Sections, String> {
    let toc = file.u64(16)?;
    let count = file.u64(toc)?;
    let size = count.checked_mul(32).ok_or("is damaged: at its table of contents")?;
    let rows = file.bytes(toc.saturating_add(8), size)?;
    let mut sections = Sections::new();
    for row in rows.as_chunks::<32>().0 {
        let mut bytes = Bytes::new(&row[16..]);
        let name = row[..16].split(|&byte| byte == 0).next().unwrap_or_default();
        sections.insert(name.to_vec(), (bytes.u64().unwrap_or(0), bytes.u64().unwrap_or(0)));
    }
    Ok(sections)
}

/// The length of a table, if a file can have that many rows.
fn rows(bytes: &mut Bytes, most: u64) -> Option<u64> {
    bytes.u64().filter(|count| *count <= most)
}

fn read_tokens(data: &[u8], most: u64) -> Option<Vec<String>> {
    let mut bytes = Bytes::new(data);
    let (count, size, packed) = (rows(&mut bytes, most)?, bytes.u64()?, bytes.u64()?);
    if size > packed.saturating_mul(MOST_NAMES_A_BYTE) {
        return None;
    }
    let text = unpack(bytes.take(usize::try_from(packed).ok()?)?, size)?;
    let tokens = text.split(|&byte| byte == 0).take(usize::try_from(count).ok()?);
    Some(tokens.map(|token| String::from_utf8_lossy(token).into_owned()).collect())
}

/// A length, then packed integers.
fn table(bytes: &mut Bytes, count: u64) -> Option<Vec<i32>> {
    let packed = bytes.u64()?;
    integers(bytes.take(usize::try_from(packed).ok()?)?, count)
}

fn read_fields(data: &[u8], most: u64) -> Option<Vec<(usize, u64)>> {
    let mut bytes = Bytes::new(data);
    let count = rows(&mut bytes, most)?;
    let names = table(&mut bytes, count)?;
    let packed = bytes.u64()?;
    let values = unpack(bytes.take(usize::try_from(packed).ok()?)?, count.checked_mul(8)?)?;
    let values = values.as_chunks::<8>().0.iter().map(|&value| u64::from_le_bytes(value));
    Some(names.into_iter().map(|name| name as u32 as usize).zip(values).collect())
}

fn read_field_sets(data: &[u8], most: u64) -> Option<Vec<i32>> {
    let mut bytes = Bytes::new(data);
    let count = rows(&mut bytes, most)?;
    table(&mut bytes, count)
}

fn read_specs(data: &[u8], most: u64) -> Option<Vec<(i32, i32, i32)>> {
    let mut bytes = Bytes::new(data);
    let count = rows(&mut bytes, most)?;
    let [paths, sets, kinds] = [table(&mut bytes, count)?, table(&mut bytes, count)?, table(&mut bytes, count)?];
    Some(paths.into_iter().zip(sets).zip(kinds).map(|((path, set), kind)| (path, set, kind)).collect())
}

/// The tree, depth first: numbers, tokens of the last element (negative: a property), and jumps (above 0: a child follows and
/// the sibling lies so far on; 0: only a sibling follows; −1: only a child; −2: neither).
fn read_paths(data: &[u8], most: u64) -> Option<BTreeMap<i32, Path>> {
    let mut bytes = Bytes::new(data);
    let (_paths, count) = (bytes.u64()?, rows(&mut bytes, most)?);
    let [numbers, tokens, jumps] = [table(&mut bytes, count)?, table(&mut bytes, count)?, table(&mut bytes, count)?];
    let mut paths = BTreeMap::new();
    let mut open = vec![(0usize, None)];
    while let Some((at, parent)) = open.pop() {
        let Some((&number, &jump)) = numbers.get(at).zip(jumps.get(at)) else { continue };
        // A path that comes again was jumped to from two places.
        if paths.insert(number, Path { parent, token: tokens[at].unsigned_abs() as usize }).is_some() {
            return None;
        }
        if jump >= 0 {
            open.push((at + usize::try_from(jump.max(1)).ok()?, parent));
        }
        if jump > 0 || jump == -1 {
            open.push((at + 1, Some(number)));
        }
    }
    Some(paths)
}

impl Tables {
    fn token(&self, at: usize) -> &str {
        self.tokens.get(at).map_or("", String::as_str)
    }

    /// The value of a spec's field.
    fn field(&self, set: i32, name: &str) -> Option<u64> {
        let start = usize::try_from(set).ok()?;
        let fields = self.field_sets.get(start..)?.iter().take_while(|&&field| field >= 0);
        let mut fields = fields.filter_map(|&field| self.fields.get(field as usize));
        fields.find(|(token, _)| self.token(*token) == name).map(|(_, value)| *value)
    }

    fn layer<R: Read + Seek>(&self, values: &mut Values<R>) -> Result<Layer, String> {
        let mut layer = Layer::default();
        let order = self.prims(&mut layer, values)?;
        for &(path, set, kind) in &self.specs {
            if kind == PSEUDO_ROOT {
                if let Some(Value::Numbers(metres)) = self.value(set, "metersPerUnit", values)? {
                    layer.metres_per_unit = metres.first().copied();
                }
                if let Some(Value::Names(up)) = self.value(set, "upAxis", values)? {
                    layer.up = up.first().and_then(|up| up_of(up));
                }
            }
            let Some(place) = self.paths.get(&path).filter(|_| kind == ATTRIBUTE) else { continue };
            let (name, prim) = (self.token(place.token), place.parent.and_then(|parent| order.get(&parent)));
            let Some(&prim) = prim.filter(|_| is_needed(name)) else { continue };
            // The default goes before samples.
            let value = match self.value(set, "default", values)? {
                Some(value) => Some(value),
                None => self.field(set, "timeSamples").map(|value| values.first_sample(value)).transpose()?.flatten(),
            };
            layer.prims[prim].attributes.extend(value.map(|value| (name.to_owned(), value)));
        }
        Ok(layer)
    }

    fn value<R: Read + Seek>(&self, set: i32, name: &str, values: &mut Values<R>) -> Result<Option<Value>, String> {
        self.field(set, name).map(|value| values.get(value)).transpose().map(Option::flatten)
    }

    /// Puts prims into the layer, parents first; gives their places by path.
    fn prims<R: Read + Seek>(&self, layer: &mut Layer, values: &mut Values<R>) -> Result<BTreeMap<i32, usize>, String> {
        let specs = self.specs.iter().filter(|spec| spec.2 == PRIM);
        let mut waiting: BTreeMap<Option<i32>, Vec<(i32, i32)>> = BTreeMap::new();
        for &(path, set, _) in specs {
            let parent = self.paths.get(&path).ok_or("is damaged: a spec has no path")?.parent;
            waiting.entry(parent).or_default().push((path, set));
        }
        let mut order: BTreeMap<i32, usize> = BTreeMap::new();
        // The pseudo-root's path is the one without a parent.
        let root = self.paths.iter().find(|(_, path)| path.parent.is_none()).map(|(&number, _)| number);
        let mut open: Vec<Option<i32>> = vec![root];
        while let Some(parent) = open.pop() {
            for (path, set) in waiting.remove(&parent).unwrap_or_default() {
                let above = parent.and_then(|parent| order.get(&parent)).copied();
                let type_name = match self.value(set, "typeName", values)? {
                    Some(Value::Names(names)) => names.concat(),
                    _ => String::new(),
                };
                let is_class = self.field(set, "specifier").is_some_and(|value| value & 0xff == CLASS);
                let within_class = above.is_some_and(|above| layer.prims[above].is_abstract);
                order.insert(path, layer.prims.len());
                layer.prims.push(Prim {
                    name: self.paths.get(&path).map_or("", |path| self.token(path.token)).to_owned(),
                    type_name,
                    parent: above,
                    is_abstract: is_class || within_class,
                    ..Prim::default()
                });
                open.push(Some(path));
            }
        }
        Ok(order)
    }
}
