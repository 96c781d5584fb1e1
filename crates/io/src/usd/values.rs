//! Values of a crate file: numbers and names, themselves in the table or at a place in the file.

use std::io::{Read, Seek};

use super::{layer::Value, unpack::integers};
use crate::placed::Placed;

const ARRAY: u64 = 1 << 63;
const INLINED: u64 = 1 << 62;
const PACKED: u64 = 1 << 61;
const PLACE: u64 = (1 << 48) - 1;

/// Arrays of fewer numbers are never packed, whatever their flag says.
const FEWEST_PACKED: u64 = 16;

/// Reads values.
pub(super) struct Values<'a, R> {
    pub file: Placed<'a, R>,
    pub tokens: &'a [String],
}

/// A kind of number in a value.
#[derive(Clone, Copy)]
enum Scalar {
    Int,
    Half,
    Float,
    Double,
}

impl Scalar {
    fn size(self) -> u64 {
        match self {
            Self::Half => 2,
            Self::Int | Self::Float => 4,
            Self::Double => 8,
        }
    }

    fn all(self, bytes: &[u8]) -> Vec<f64> {
        match self {
            Self::Int => bytes.as_chunks().0.iter().map(|&x| f64::from(i32::from_le_bytes(x))).collect(),
            Self::Half => bytes.as_chunks().0.iter().map(|&x| half(u16::from_le_bytes(x))).collect(),
            Self::Float => bytes.as_chunks().0.iter().map(|&x| f64::from(f32::from_le_bytes(x))).collect(),
            Self::Double => bytes.as_chunks().0.iter().map(|&x| f64::from_le_bytes(x)).collect(),
        }
    }
}

/// Numbers of a type (crate format's `TypeEnum`): their kind, and how many are one value.
fn kind_of(type_number: u64) -> Option<(Scalar, u64)> {
    Some(match type_number {
        3 => (Scalar::Int, 1),
        7 => (Scalar::Half, 1),
        8 => (Scalar::Float, 1),
        9 => (Scalar::Double, 1),
        15 => (Scalar::Double, 16),
        16 => (Scalar::Double, 4),
        17 => (Scalar::Float, 4),
        18 => (Scalar::Half, 4),
        23 => (Scalar::Double, 3),
        24 => (Scalar::Float, 3),
        25 => (Scalar::Half, 3),
        _ => return None,
    })
}

const TOKEN: u64 = 11;
const QUATERNIONS: std::ops::RangeInclusive<u64> = 16..=18;
const MATRIX: u64 = 15;
const TIME_SAMPLES: u64 = 46;

impl<R: Read + Seek> Values<'_, R> {
    /// A value; `None` where it is of a kind that strands do not need, or empty.
    pub fn get(&mut self, value: u64) -> Result<Option<Value>, String> {
        let (type_number, payload) = (value >> 48 & 0xff, value & PLACE);
        if type_number == TOKEN {
            return Ok(Some(Value::Names(self.names(value)?)));
        }
        let Some((scalar, width)) = kind_of(type_number) else { return Ok(None) };
        let mut numbers = if value & ARRAY != 0 {
            self.array(value, scalar, width)?
        } else if value & INLINED != 0 {
            inlined(type_number, scalar, width, payload as u32)
        } else {
            scalar.all(&self.file.bytes(payload, width * scalar.size())?)
        };
        // The file has the imaginary part of quaternions first.
        if QUATERNIONS.contains(&type_number) && numbers.len() == 4 {
            numbers.rotate_right(1);
        }
        Ok(Some(Value::Numbers(numbers)))
    }

    fn names(&mut self, value: u64) -> Result<Vec<String>, String> {
        let payload = value & PLACE;
        let numbers = match value & (ARRAY | INLINED) {
            INLINED => vec![payload as u32],
            ARRAY if payload == 0 => Vec::new(),
            _ => {
                let size =
                    self.file.u64(payload)?.checked_mul(4).ok_or("is damaged: an array is larger than the file")?;
                let bytes = self.file.bytes(payload + 8, size)?;
                bytes.as_chunks().0.iter().map(|&number| u32::from_le_bytes(number)).collect()
            }
        };
        let name = |number: u32| {
            self.tokens.get(number as usize).cloned().ok_or_else(|| "is damaged: a token is missing".into())
        };
        numbers.into_iter().map(name).collect()
    }

    fn array(&mut self, value: u64, scalar: Scalar, width: u64) -> Result<Vec<f64>, String> {
        let place = value & PLACE;
        if place == 0 {
            return Ok(Vec::new());
        }
        let count = self.file.u64(place)?;
        if value & PACKED != 0 && count >= FEWEST_PACKED {
            let Scalar::Int = scalar else { return Err("has a packed array of a kind that is not read".into()) };
            // Packing shrinks equal numbers to nothing. Numbers of curves that are needed here count points, which are never
            // packed: there are fewer of them than bytes.
            if count > self.file.len() {
                return Err(format!("is damaged: it claims {count} packed numbers, more than it has bytes"));
            }
            let size = self.file.u64(place + 8)?;
            let packed = self.file.bytes(place + 16, size)?;
            let numbers = integers(&packed, count).ok_or("is damaged: at a packed array")?;
            return Ok(numbers.into_iter().map(f64::from).collect());
        }
        let size = count.checked_mul(width * scalar.size()).ok_or("is damaged: an array is larger than the file")?;
        Ok(scalar.all(&self.file.bytes(place + 8, size)?))
    }

    /// The first value of time samples: a jump to the times, a jump to the count and values.
    pub fn first_sample(&mut self, value: u64) -> Result<Option<Value>, String> {
        if value >> 48 & 0xff != TIME_SAMPLES || value & INLINED != 0 {
            return Ok(None);
        }
        let mut at = value & PLACE;
        at = self.jump(at)?;
        at = self.jump(at.saturating_add(8))?;
        if self.file.u64(at)? == 0 {
            return Ok(None);
        }
        let first = self.file.u64(at.saturating_add(8))?;
        self.get(first)
    }

    fn jump(&mut self, at: u64) -> Result<u64, String> {
        let far = self.file.u64(at)? as i64;
        at.checked_add_signed(far).ok_or_else(|| "is damaged: it points before its start".into())
    }
}

/// What 32 bits hold: a number (double precision as single), or small whole numbers; of a matrix the diagonal.
fn inlined(type_number: u64, scalar: Scalar, width: u64, bits: u32) -> Vec<f64> {
    let small = bits.to_le_bytes().map(|byte| f64::from(byte as i8));
    match (type_number, scalar) {
        (MATRIX, _) => (0..16).map(|at| if at % 5 == 0 { small[at / 5] } else { 0.0 }).collect(),
        (_, _) if width > 1 => small[..width.min(4) as usize].to_vec(),
        (_, Scalar::Int) => vec![f64::from(bits as i32)],
        (_, Scalar::Half) => vec![half(bits as u16)],
        _ => vec![f64::from(f32::from_bits(bits))],
    }
}

/// Half precision.
fn half(bits: u16) -> f64 {
    let (exponent, fraction) = (i32::from(bits >> 10 & 31), f64::from(bits & 1023));
    let size = match exponent {
        0 => fraction * 2f64.powi(-24),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1.0 + fraction / 1024.0) * 2f64.powi(exponent - 15),
    };
    if bits >> 15 == 1 { -size } else { size }
}
