//! Binary bodies: four little-endian u32, then numbers.

use glam::Vec3;
use strandflow_core::{Mask, TriMesh};

/// First word of every body.
pub const MAGIC: u32 = 0x5346_5331;
/// In x of a 16-bit position: the point is missing.
pub const MISSING: u16 = u16::MAX;
/// Largest step number of a 16-bit position.
const STEPS: f64 = 65534.0;

fn body(header: [u32; 3], bytes: usize) -> Vec<u8> {
    let mut out = Vec::with_capacity(16 + bytes);
    out.extend(MAGIC.to_le_bytes());
    header.iter().for_each(|word| out.extend(word.to_le_bytes()));
    out
}

fn word(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}

/// Positions \[mm\] of `points` points a strand as f32 xyz; NaN where missing.
pub fn positions(points: usize, xyz: &[Vec3]) -> Vec<u8> {
    let mut out = body([word(xyz.len() / points.max(1)), word(points), 32], xyz.len() * 12);
    xyz.iter().for_each(|p| p.to_array().iter().for_each(|v| out.extend(v.to_le_bytes())));
    out
}

/// Positions as u16 steps within the box around them: off by at most half a step, 1/131068 of the box.
pub fn positions_16(points: usize, xyz: &[Vec3]) -> Vec<u8> {
    let present = || xyz.iter().filter(|p| p.is_finite()).map(|p| p.as_dvec3());
    let low = present().reduce(glam::DVec3::min).unwrap_or_default();
    let high = present().reduce(glam::DVec3::max).unwrap_or_default();
    let step = (high - low) / STEPS;
    let mut out = body([word(xyz.len() / points.max(1)), word(points), 16], 48 + xyz.len() * 6);
    low.to_array().iter().chain(&step.to_array()).for_each(|v| out.extend(v.to_le_bytes()));
    // A flat box has one step.
    let per_step = step.map(|s| if s > 0.0 { 1.0 / s } else { 0.0 });
    for p in xyz {
        let steps = ((p.as_dvec3() - low) * per_step).round().clamp(glam::DVec3::ZERO, glam::DVec3::splat(STEPS));
        let steps = if p.is_finite() { steps.to_array().map(|s| s as u16) } else { [MISSING; 3] };
        steps.iter().for_each(|s| out.extend(s.to_le_bytes()));
    }
    out
}

/// f32 values, `points` a strand with `parts` numbers each (1 for a value, 2 for an image point).
pub fn values(points: usize, parts: usize, values: &[f32]) -> Vec<u8> {
    let strands = values.len() / (points * parts).max(1);
    let mut out = body([word(strands), word(points), 32], values.len() * 4);
    values.iter().for_each(|v| out.extend(v.to_le_bytes()));
    out
}

/// A mesh: f32 xyz \[mm\], then u32 corners.
pub fn mesh(mesh: &TriMesh) -> Vec<u8> {
    let (vertices, faces) = (mesh.vertices.len(), mesh.faces.len());
    let mut out = body([word(vertices), word(faces), 0], (vertices + faces) * 12);
    mesh.vertices.iter().for_each(|v| v.as_vec3().to_array().iter().for_each(|x| out.extend(x.to_le_bytes())));
    mesh.faces.iter().flatten().for_each(|corner| out.extend(corner.to_le_bytes()));
    out
}

/// A mask: width, height and a number that says where it comes from, then its coverage.
pub fn mask(mask: &Mask, origin: u32) -> Vec<u8> {
    let mut out = body([word(mask.width), word(mask.height), origin], mask.data.len());
    out.extend(&mask.data);
    out
}

/// A list of rows of f32.
pub fn rows<const N: usize>(rows: &[[f32; N]]) -> Vec<u8> {
    let mut out = body([word(rows.len()), 0, 0], rows.len() * N * 4);
    rows.iter().flatten().for_each(|v| out.extend(v.to_le_bytes()));
    out
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn words(bytes: &[u8]) -> [u32; 4] {
        std::array::from_fn(|i| u32::from_le_bytes(bytes[4 * i..4 * i + 4].try_into().unwrap()))
    }

    fn floats(bytes: &[u8]) -> Vec<f32> {
        bytes.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect()
    }

    #[test]
    fn positions_are_as_given() {
        let xyz = [Vec3::new(1.0, 2.0, 3.0), Vec3::NAN, Vec3::X, Vec3::Y];
        let bytes = positions(2, &xyz);
        assert_eq!((words(&bytes), bytes.len()), ([MAGIC, 2, 2, 32], 16 + 48));
        let read = floats(&bytes[16..]);
        assert!(read[..3] == [1.0, 2.0, 3.0] && read[3..6].iter().all(|v| v.is_nan()));
    }

    #[test]
    fn sixteen_bits_err_by_half_a_step_and_keep_gaps() {
        let xyz: Vec<Vec3> = (0..100)
            .map(|i| if i == 7 { Vec3::NAN } else { Vec3::new(i as f32 * 3.7 - 90.0, (i as f32).sin() * 50.0, 12.0) })
            .collect();
        let bytes = positions_16(10, &xyz);
        assert_eq!((words(&bytes), bytes.len()), ([MAGIC, 10, 10, 16], 16 + 48 + 600));
        let double = |i: usize| f64::from_le_bytes(bytes[16 + 8 * i..24 + 8 * i].try_into().unwrap());
        let (low, step) = ([0, 1, 2].map(double), [3, 4, 5].map(double));
        let short = |i: usize| u16::from_le_bytes(bytes[64 + 2 * i..66 + 2 * i].try_into().unwrap());
        for (i, p) in xyz.iter().enumerate() {
            if i == 7 {
                assert_eq!(short(3 * i), MISSING);
                continue;
            }
            let read = DVec3::from_array([0, 1, 2].map(|k| low[k] + step[k] * f64::from(short(3 * i + k))));
            let off = (read - p.as_dvec3()).abs();
            assert!(short(3 * i) != MISSING && (0..3).all(|k| off[k] <= 0.5 * step[k] + 1e-9), "{off}");
        }
        assert_eq!(positions_16(5, &[Vec3::NAN; 5])[64..], [0xff; 30]);
    }

    #[test]
    fn meshes_and_rows_have_their_counts() {
        let triangle = TriMesh { vertices: vec![DVec3::ZERO, DVec3::X, DVec3::Y], faces: vec![[0, 1, 2]] };
        let bytes = mesh(&triangle);
        assert_eq!((words(&bytes), bytes.len()), ([MAGIC, 3, 1, 0], 16 + 48));
        assert_eq!(floats(&bytes[16 + 12..16 + 24]), [1.0, 0.0, 0.0]);
        assert_eq!(words(&rows(&[[0.0f32; 7]; 2])), [MAGIC, 2, 0, 0]);
        assert_eq!(words(&values(3, 2, &[0.0; 12])), [MAGIC, 2, 3, 32]);
        let bytes = mask(&Mask::filled(3, 2, 7), 1);
        assert_eq!((words(&bytes), &bytes[16..]), ([MAGIC, 3, 2, 1], &[7u8; 6][..]));
    }
}
