//! NumPy's `.npy`: header and little-endian numbers. The memory taken follows the bytes that are there, not the header.

use std::io::Read;

/// An array, C order.
#[derive(Clone, Debug, PartialEq)]
pub struct NpyArray {
    /// Type code without byte order: `f4`, `i4`, `u1`, `b1`, …
    pub kind: String,
    /// Shape.
    pub shape: Vec<usize>,
    /// Little-endian (or byte-sized) elements.
    pub bytes: Vec<u8>,
}

impl NpyArray {
    /// Reads one array. Errors are facts.
    pub fn read(reader: &mut impl Read) -> Result<Self, String> {
        let mut start = [0u8; 10];
        reader.read_exact(&mut start).map_err(|_| "ends in its header")?;
        if &start[..6] != b"\x93NUMPY" {
            return Err("is no NumPy array".into());
        }
        let mut length = usize::from(u16::from_le_bytes([start[8], start[9]]));
        if start[6] >= 2 {
            let mut more = [0u8; 2];
            reader.read_exact(&mut more).map_err(|_| "ends in its header")?;
            length += usize::from(u16::from_le_bytes(more)) << 16;
        }
        let mut header = Vec::new();
        reader.by_ref().take(length.min(1 << 20) as u64).read_to_end(&mut header).map_err(|cause| cause.to_string())?;
        let (kind, shape) = parse_header(&String::from_utf8_lossy(&header))?;
        let size = kind[1..].parse::<usize>().map_err(|_| format!("has the type {kind}, which is not read"))?;
        let count = shape.iter().try_fold(1usize, |all, &n| all.checked_mul(n)).and_then(|n| n.checked_mul(size));
        let count = count.ok_or("has an impossible shape")?;
        let mut bytes = Vec::new();
        reader.take(count as u64).read_to_end(&mut bytes).map_err(|cause| cause.to_string())?;
        if bytes.len() != count {
            return Err(format!("has {} of {count} bytes", bytes.len()));
        }
        Ok(Self { kind, shape, bytes })
    }

    /// The elements as double-precision numbers, from any real type.
    pub fn as_f64(&self) -> Result<Vec<f64>, String> {
        macro_rules! numbers {
            ($type:ty) => {
                Ok(self.chunks().map(|b| <$type>::from_le_bytes(b) as f64).collect())
            };
        }
        match self.kind.as_str() {
            "f4" => numbers!(f32),
            "f8" => numbers!(f64),
            "i2" => numbers!(i16),
            "i4" => numbers!(i32),
            "i8" => numbers!(i64),
            "u2" => numbers!(u16),
            "u4" => numbers!(u32),
            "u8" => numbers!(u64),
            "u1" | "b1" => Ok(self.bytes.iter().map(|&b| f64::from(b)).collect()),
            "i1" => Ok(self.bytes.iter().map(|&b| f64::from(b as i8)).collect()),
            other => Err(format!("has the type {other}, which is not read")),
        }
    }

    /// The elements in single precision, from any real type.
    pub fn as_f32(&self) -> Result<Vec<f32>, String> {
        if self.kind == "f4" {
            return Ok(self.chunks().map(f32::from_le_bytes).collect());
        }
        Ok(self.as_f64()?.into_iter().map(|x| x as f32).collect())
    }

    fn chunks<const N: usize>(&self) -> impl Iterator<Item = [u8; N]> + '_ {
        self.bytes.as_chunks::<N>().0.iter().copied()
    }
}

/// Type and shape from `{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4), }`.
fn parse_header(text: &str) -> Result<(String, Vec<usize>), String> {
    let after = |key: &str| text.split_once(key).map(|(_, rest)| rest.trim_start_matches([' ', ':']));
    let descr = after("'descr'").and_then(|rest| rest.strip_prefix('\'')).and_then(|rest| rest.split('\'').next());
    let descr = descr.ok_or("has a header that is not understood")?;
    let kind = descr.trim_start_matches(['<', '|', '=']);
    if descr.starts_with('>') || kind.len() < 2 || !kind.is_ascii() {
        return Err(format!("has the type {descr}, which is not read"));
    }
    if after("'fortran_order'").is_none_or(|rest| !rest.starts_with("False")) {
        return Err("is in Fortran order; save np.ascontiguousarray of it".into());
    }
    let shape = after("'shape'").and_then(|rest| rest.strip_prefix('(')).and_then(|rest| rest.split(')').next());
    let shape = shape.ok_or("has a header that is not understood")?;
    let words = shape.split(',').map(|word| word.trim().trim_end_matches('L')).filter(|word| !word.is_empty());
    let shape =
        words.map(|word| word.parse().map_err(|_| format!("has the shape ({shape})"))).collect::<Result<_, _>>()?;
    Ok((kind.to_owned(), shape))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sample() -> Vec<u8> {
        let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }";
        let mut file = b"\x93NUMPY\x01\x00".to_vec();
        file.extend((header.len() as u16).to_le_bytes());
        file.extend(header.as_bytes());
        (0..6).for_each(|i| file.extend((i as f32).to_le_bytes()));
        file
    }

    #[test]
    fn an_array_is_read_and_a_boast_is_an_error() {
        let array = NpyArray::read(&mut sample().as_slice()).unwrap();
        assert_eq!(
            (array.shape.as_slice(), array.as_f64().unwrap()),
            ([2, 3].as_slice(), vec![0., 1., 2., 3., 4., 5.])
        );
        let boast = String::from_utf8_lossy(&sample()).replace("(2, 3)", "(99999999999, 3)");
        assert!(NpyArray::read(&mut boast.as_bytes()).is_err());
    }

    proptest! {
        #[test]
        fn any_bytes_are_safe(cut in 0usize..100, flips in prop::collection::vec((0usize..100, any::<u8>()), 0..5)) {
            let mut file = sample();
            for (at, value) in flips { let n = file.len(); file[at % n] = value; }
            file.truncate(cut);
            if let Ok(array) = NpyArray::read(&mut file.as_slice()) { let _ = array.as_f64(); }
        }
    }
}
