//! Packed parts of a crate file: LZ4 in chunks, and tables of integers.

use crate::bytes::Bytes;

/// LZ4 makes at most this many bytes of one: what claims more is no LZ4.
const MOST_A_BYTE: usize = 255;

/// Unpacks: a byte that says how many chunks there are (0: one, which goes to the end), then chunks with their lengths.
/// `size`: what the file says comes out.
pub(super) fn unpack(packed: &[u8], size: u64) -> Option<Vec<u8>> {
    let size = usize::try_from(size).ok()?;
    if size / MOST_A_BYTE > packed.len() {
        return None;
    }
    let mut bytes = Bytes::new(packed);
    let chunks = bytes.take(1)?[0];
    if chunks == 0 {
        return lz4_flex::block::decompress(bytes.take(bytes.remaining())?, size).ok();
    }
    let mut out = Vec::new();
    for _ in 0..chunks {
        let length = usize::try_from(bytes.i32()?).ok()?;
        let chunk = bytes.take(length)?;
        let left = size - out.len();
        out.extend(lz4_flex::block::decompress(chunk, left.min(chunk.len().saturating_mul(MOST_A_BYTE))).ok()?);
        if out.len() > size {
            return None;
        }
    }
    Some(out)
}

/// `count` integers: the commonest difference, two bits each (0: the commonest; 1, 2, 3: one, two, four bytes), the rest.
pub(super) fn integers(packed: &[u8], count: u64) -> Option<Vec<i32>> {
    if count == 0 {
        return Some(Vec::new());
    }
    // At worst four bytes each beside the codes.
    let most = count.checked_mul(4)?.checked_add(count.div_ceil(4))?.checked_add(4)?;
    let coded = unpack(packed, most.min(packed.len() as u64 * MOST_A_BYTE as u64))?;
    let mut bytes = Bytes::new(&coded);
    let common = bytes.i32()?;
    let codes = bytes.take(usize::try_from(count.div_ceil(4)).ok()?)?;
    let mut last = 0i32;
    let mut number = |at: usize| {
        let difference = match codes[at / 4] >> (at % 4 * 2) & 3 {
            0 => common,
            1 => i32::from(bytes.take(1)?[0] as i8),
            2 => i32::from(bytes.u16()? as i16),
            _ => bytes.i32()?,
        };
        last = last.wrapping_add(difference);
        Some(last)
    };
    (0..count as usize).map(&mut number).collect()
}
