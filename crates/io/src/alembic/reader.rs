//! The tree of objects and properties of an Ogawa archive, as far as first samples are asked for.

use std::io::{Read, Seek};

use crate::{bytes::Bytes, placed::Placed};

/// The top bit of a child's position: it is bytes, else a group.
const DATA: u64 = 1 << 63;
/// The key before each sample.
const KEY_BYTES: usize = 16;
/// The hashes behind the headers of an object's children.
const HASH_BYTES: usize = 32;

/// An archive being read.
pub(super) struct Archive<'a, R> {
    file: Placed<'a, R>,
    /// Metadata that headers name by number.
    metadata: Vec<String>,
}

/// An object: its properties and what lies below.
pub(super) struct Object {
    pub name: String,
    pub metadata: String,
    group: u64,
}

/// A property: a compound, or samples.
#[derive(Clone)]
pub(super) struct Property {
    pub name: String,
    /// `None`: a compound.
    pod: Option<u32>,
    is_scalar: bool,
    group: u64,
}

impl<'a, R: Read + Seek> Archive<'a, R> {
    /// Opens an archive; gives its topmost object too.
    pub fn open(source: &'a mut R) -> Result<(Self, Object), String> {
        let mut file = Placed::new(source)?;
        let header = file.bytes(0, 16)?;
        if !header.starts_with(b"Ogawa") {
            return Err("is no Alembic archive (Ogawa)".into());
        }
        if header[5] != 0xff {
            return Err("is no complete archive: its writer did not finish".into());
        }
        let root = file.u64(8)?;
        let mut archive = Self { file, metadata: Vec::new() };
        let children = archive.children(root)?;
        let &[_, _, top, _, _, table, ..] = children.as_slice() else {
            return Err("is damaged: its root lacks parts".into());
        };
        archive.metadata = metadata_table(&archive.data(table)?);
        Ok((archive, Object { name: String::new(), metadata: String::new(), group: top }))
    }

    /// Positions of a group's children.
    fn children(&mut self, group: u64) -> Result<Vec<u64>, String> {
        if group & DATA != 0 {
            return Err("is damaged: bytes stand where a group should".into());
        }
        if group == 0 {
            return Ok(Vec::new());
        }
        let count = self.file.u64(group)?;
        let bytes = count.checked_mul(8).ok_or("is damaged: a group is larger than the file")?;
        let bytes = self.file.bytes(group + 8, bytes)?;
        Ok(bytes.as_chunks::<8>().0.iter().map(|&child| u64::from_le_bytes(child)).collect())
    }

    fn data(&mut self, child: u64) -> Result<Vec<u8>, String> {
        if child & DATA == 0 {
            return Err("is damaged: a group stands where bytes should".into());
        }
        let at = child & !DATA;
        if at == 0 {
            return Ok(Vec::new());
        }
        let count = self.file.u64(at)?;
        self.file.bytes(at + 8, count)
    }

    /// The objects below one.
    pub fn objects(&mut self, object: &Object) -> Result<Vec<Object>, String> {
        let children = self.children(object.group)?;
        let Some((&last, groups)) = children.split_last().filter(|(last, _)| *last & DATA != 0) else {
            return Ok(Vec::new());
        };
        let headers = self.data(last)?;
        let mut bytes = Bytes::new(&headers[..headers.len().saturating_sub(HASH_BYTES)]);
        let mut objects = Vec::new();
        // The first group is the object's properties.
        for &group in groups.iter().skip(1) {
            let header = object_header(&mut bytes, &self.metadata);
            let (name, metadata) = header.ok_or_else(|| format!("is damaged: below `{}`", object.name))?;
            objects.push(Object { name, metadata, group });
        }
        Ok(objects)
    }

    /// The properties of an object.
    pub fn properties(&mut self, object: &Object) -> Result<Vec<Property>, String> {
        match self.children(object.group)?.first() {
            Some(&group) if group & DATA == 0 => self.compound(group),
            _ => Ok(Vec::new()),
        }
    }

    /// The properties of a compound; none of one that holds samples.
    pub fn inner(&mut self, property: &Property) -> Result<Vec<Property>, String> {
        if property.pod.is_some() { Ok(Vec::new()) } else { self.compound(property.group) }
    }

    fn compound(&mut self, group: u64) -> Result<Vec<Property>, String> {
        let children = self.children(group)?;
        let Some((&last, groups)) = children.split_last() else { return Ok(Vec::new()) };
        let headers = self.data(last)?;
        let mut bytes = Bytes::new(&headers);
        let property = |&group: &u64| property(&mut bytes, group).ok_or_else(|| "is damaged: at a property".to_owned());
        groups.iter().map(property).collect()
    }

    /// The first sample, as numbers; `None` where there is none or the property holds text or a compound.
    pub fn numbers(&mut self, property: &Property) -> Result<Option<Vec<f64>>, String> {
        let Some(pod) = property.pod else { return Ok(None) };
        let children = self.children(property.group)?;
        let Some(&first) = children.first() else { return Ok(None) };
        let sample = self.data(first)?;
        // A scalar's sample and an array's are alike but that an array without elements may have no bytes at all.
        let values = match sample.get(KEY_BYTES..) {
            Some(values) => values,
            None if !property.is_scalar => &[],
            None => return Err(format!("is damaged: at the sample of `{}`", property.name)),
        };
        Ok(numbers(pod, values))
    }
}

/// Numbers of Alembic's `PlainOldDataType`; `None` for text and half precision.
fn numbers(pod: u32, bytes: &[u8]) -> Option<Vec<f64>> {
    macro_rules! all {
        ($type:ty) => {
            bytes.as_chunks::<{ size_of::<$type>() }>().0.iter().map(|&x| <$type>::from_le_bytes(x) as f64).collect()
        };
    }
    Some(match pod {
        0 | 1 => all!(u8),
        2 => all!(i8),
        3 => all!(u16),
        4 => all!(i16),
        5 => all!(u32),
        6 => all!(i32),
        7 => all!(u64),
        8 => all!(i64),
        10 => all!(f32),
        11 => all!(f64),
        _ => return None,
    })
}

/// A length byte and text, again and again; number 0 is no metadata.
fn metadata_table(data: &[u8]) -> Vec<String> {
    let mut bytes = Bytes::new(data);
    let mut next = || {
        let length = bytes.take(1)?[0];
        Some(text(bytes.take(length.into())?))
    };
    std::iter::once(String::new()).chain(std::iter::from_fn(&mut next)).collect()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Name and metadata.
fn object_header(bytes: &mut Bytes, table: &[String]) -> Option<(String, String)> {
    let length = bytes.u32()?;
    let name = text(bytes.take(length as usize)?);
    let metadata = match bytes.take(1)?[0] {
        0xff => {
            let length = bytes.u32()?;
            text(bytes.take(length as usize)?)
        }
        number => table.get(usize::from(number))?.clone(),
    };
    Some((name, metadata))
}

/// A property's header: kind (2 bits), size of counts (2), type of numbers (4), flags, numbers in an element, metadata.
fn property(bytes: &mut Bytes, group: u64) -> Option<Property> {
    let info = bytes.u32()?;
    let size = 1usize << (info >> 2 & 3);
    let mut count =
        || bytes.take(size).map(|raw| raw.iter().rev().fold(0usize, |all, &byte| all << 8 | usize::from(byte)));
    let kind = info & 3;
    if kind != 0 {
        let has = |bit: u32| usize::from(info >> bit & 1 == 1);
        // The number of samples; the first and last that change; the time sampling.
        for _ in 0..1 + 2 * has(9) + has(8) {
            count()?;
        }
    }
    let length = count()?;
    let name = text(bytes.take(length)?);
    if info >> 20 & 0xff == 0xff {
        let raw = bytes.take(size)?;
        bytes.skip(raw.iter().rev().fold(0usize, |all, &byte| all << 8 | usize::from(byte)))?;
    }
    Some(Property { name, pod: (kind != 0).then_some(info >> 4 & 15), is_scalar: kind == 1, group })
}
