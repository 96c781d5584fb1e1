//! Properties of Alembic objects: scalars, arrays and compounds of them, and the headers that describe them.

use std::io::Result;

use super::ogawa::{Child, Keyed, Ogawa};

/// Types of numbers (Alembic's `PlainOldDataType`).
#[derive(Clone, Copy)]
#[repr(u32)]
pub(super) enum Pod {
    Uint8 = 1,
    Int16 = 4,
    Int32 = 6,
    Float32 = 10,
    Float64 = 11,
    Text = 12,
}

/// A property that holds samples, or holds properties.
pub(super) struct Property {
    pub name: &'static str,
    /// `key=value` pairs with `;` between them.
    pub metadata: &'static str,
    pub body: Body,
}

pub(super) enum Body {
    Compound(Vec<Property>),
    Samples(Samples),
}

/// The samples of a property, already written: one for all times, or one a frame.
pub(super) struct Samples {
    pod: Pod,
    /// Numbers in an element.
    extent: u32,
    shape: Shape,
    children: Vec<Child>,
    keys: Vec<u8>,
}

/// How many elements a sample has.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Shape {
    /// One, by type.
    Scalar,
    /// An array that happens to hold one.
    One,
    /// An array.
    Many,
}

impl Samples {
    pub fn new(pod: Pod, extent: u32, shape: Shape) -> Self {
        Self { pod, extent, shape, children: Vec::new(), keys: Vec::new() }
    }

    pub fn push(&mut self, file: &mut Ogawa, bytes: &[u8]) -> Result<()> {
        let Keyed { child, key } = file.sample(bytes)?;
        self.children.push(child);
        self.keys.extend(key);
        Ok(())
    }

    pub fn of(file: &mut Ogawa, kind: (Pod, u32, Shape), bytes: &[u8]) -> Result<Body> {
        let mut samples = Self::new(kind.0, kind.1, kind.2);
        samples.push(file, bytes)?;
        Ok(Body::Samples(samples))
    }
}

/// Bits of a header's first word.
const SIZES_OF_FOUR_BYTES: u32 = 2 << 2;
const HAS_TIME_SAMPLING: u32 = 1 << 8;
const SAME_SIZE_ALWAYS: u32 = 1 << 10;
const CONSTANT: u32 = 1 << 11;
/// The metadata follows in full, rather than by number in the archive's table.
const METADATA_INLINE: u32 = 0xff << 20;

/// The number of the archive's time sampling by frames; 0 is the one for constant properties.
const BY_FRAMES: u32 = 1;

/// Writes a compound: the groups of its properties, then their headers. Adds what tells its content to `keys`.
pub(super) fn write_compound(file: &mut Ogawa, properties: &[Property], keys: &mut Vec<u8>) -> Result<Child> {
    let (mut children, mut headers) = (Vec::new(), Vec::new());
    for property in properties {
        children.push(match &property.body {
            Body::Compound(inner) => write_compound(file, inner, keys)?,
            Body::Samples(samples) => write_samples(file, samples, keys)?,
        });
        put_header(&mut headers, property);
    }
    keys.extend(&headers);
    if children.is_empty() {
        return Ok(Child::EMPTY_GROUP);
    }
    children.push(file.data(&headers)?);
    file.group(&children)
}

/// Arrays have pairs of bytes and dimensions; without dimensions an array is of rank 1 and as long as its bytes.
fn write_samples(file: &mut Ogawa, samples: &Samples, keys: &mut Vec<u8>) -> Result<Child> {
    keys.extend(&samples.keys);
    match samples.shape {
        Shape::Scalar => file.group(&samples.children),
        Shape::One | Shape::Many => {
            let pairs: Vec<Child> = samples.children.iter().flat_map(|&child| [child, Child::EMPTY_DATA]).collect();
            file.group(&pairs)
        }
    }
}

fn put_header(headers: &mut Vec<u8>, property: &Property) {
    let mut words = Vec::new();
    let info = match &property.body {
        Body::Compound(_) => 0,
        Body::Samples(samples) => {
            let count = samples.children.len() as u32;
            words.push(count);
            let kind = match samples.shape {
                Shape::Scalar => 1,
                Shape::Many => 2,
                Shape::One => 3,
            };
            // Without CONSTANT every sample after the first counts as a change.
            let times = if count > 1 { HAS_TIME_SAMPLING } else { CONSTANT };
            if count > 1 {
                words.push(BY_FRAMES);
            }
            kind | (samples.pod as u32) << 4 | samples.extent << 12 | SAME_SIZE_ALWAYS | times
        }
    };
    words.insert(0, info | SIZES_OF_FOUR_BYTES | METADATA_INLINE);
    words.push(property.name.len() as u32);
    headers.extend(words.into_iter().flat_map(u32::to_le_bytes));
    headers.extend(property.name.bytes());
    headers.extend((property.metadata.len() as u32).to_le_bytes());
    headers.extend(property.metadata.bytes());
}
