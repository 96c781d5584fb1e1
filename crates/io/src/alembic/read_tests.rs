use std::io::Cursor;

use proptest::prelude::*;

use super::{groom::groom, *};
use crate::{
    read_groom,
    strands::{ask_python, sample},
};

fn ours(guides: bool) -> Vec<u8> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.abc");
    let chosen = guides.then(|| Guides::of(&sample(), 2).unwrap());
    write_alembic(&path, &sample(), chosen.as_ref(), &SceneOptions::default()).unwrap();
    std::fs::read(&path).unwrap()
}

#[test]
fn ours_comes_back_without_its_guides() {
    for guides in [false, true] {
        let read = groom(&mut Cursor::new(ours(guides))).unwrap();
        let expected = sample();
        assert_eq!(read.strands.len(), 3);
        for (strand, n) in read.strands.iter().zip([0, 2, 3]) {
            assert_eq!(strand, expected.strand(0, n));
        }
        assert!(!read.unit_known);
    }
}

/// Writes a groom by the reference library: two frames, transforms of every kind above two objects of which one does not
/// inherit, guides in an object and among curves; says where its points should be, by the library's own matrices.
const FOREIGN: &str = r#"
import sys, imath
from alembic3d import Abc, AbcGeom
V = imath.V3d
archive = Abc.CreateArchiveWithInfo(sys.argv[1], "foreign", "test")
def xform(parent, name, inherits=True, *ops):
    sample = AbcGeom.XformSample()
    sample.setInheritsXforms(inherits)
    for op, *values in ops:
        sample.addOp(AbcGeom.XformOp(op, 0), *values)
    node = AbcGeom.OXform(parent, name)
    node.getSchema().set(sample)
    return node, sample.getMatrix()
O = AbcGeom.XformOperationType
turned = imath.M44d(0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1)
outer, m1 = xform(archive.getTop(), "outer", True, (O.kTranslateOperation, V(1, 2, 3)), (O.kRotateXOperation, 30.0), (O.kScaleOperation, V(2, 3, 4)))
inner, m2 = xform(outer, "inner", True, (O.kMatrixOperation, turned), (O.kRotateOperation, V(1, 1, 0), 40.0), (O.kRotateYOperation, 20.0), (O.kRotateZOperation, 10.0))
alone, m3 = xform(outer, "alone", False, (O.kTranslateOperation, V(0, 0, 9)))
def curves(parent, name, counts, matrix, guide=None, frames=1):
    node = AbcGeom.OCurves(parent, name).getSchema()
    for t in range(frames):
        points = imath.V3fArray(sum(counts)); numbers = imath.IntArray(len(counts))
        for i in range(sum(counts)): points[i] = imath.V3f(i, 0.5 * i, 100 * t - i * i)
        for i, n in enumerate(counts): numbers[i] = n
        node.set(AbcGeom.OCurvesSchemaSample(points, numbers, AbcGeom.CurveType.kLinear))
    if guide is not None:
        flags = imath.IntArray(len(guide))
        for i, n in enumerate(guide): flags[i] = n
        scope = AbcGeom.GeometryScope.kUniformScope if len(guide) > 1 else AbcGeom.GeometryScope.kConstantScope
        param = AbcGeom.OInt32GeomParam(node.getArbGeomParams(), "groom_guide", INDEXED, scope, 1)
        sample = AbcGeom.OInt32GeomParamSample()
        sample.setVals(flags); sample.setScope(scope)
        if INDEXED:
            indices = imath.UnsignedIntArray(len(guide))
            for i in range(len(guide)): indices[i] = i
            sample.setIndices(indices)
        param.set(sample)
    flags = guide or [0]
    at = 0
    for n, count in enumerate(counts):
        if not (flags[n] if len(flags) > 1 else flags[0]):
            for i in range(at, at + count):
                print(*((V(i, 0.5 * i, -i * i) * matrix)))
            print()
        at += count
INDEXED = len(sys.argv) > 2
curves(inner, "moving", [3, 2], m2 * m1, None, 2)
curves(alone, "still", [4, 2, 3], m3, [0, 1, 0])
curves(inner, "guides", [2, 2], m1, [1])
"#;

#[test]
fn the_reference_library_s_curves_are_read() {
    let dir = tempfile::tempdir().unwrap();
    for (name, script) in [("plain", FOREIGN.to_owned()), ("indexed", FOREIGN.replace("len(sys.argv) > 2", "True"))] {
        let path = dir.path().join(format!("{name}.abc"));
        let Some(said) = ask_python(&script, &path) else { return };
        let expected: Vec<Vec<f32>> = said
            .split("\n\n")
            .map(|strand| strand.split_whitespace().map(|word| word.parse().unwrap()).collect())
            .filter(|strand: &Vec<f32>| !strand.is_empty())
            .collect();
        let mut read = read_groom(&path).unwrap().strands;
        let mut lengths: Vec<usize> = read.iter().map(Vec::len).collect();
        // Objects come as the library orders them.
        if lengths[0] == 4 {
            read.rotate_left(2);
            lengths.rotate_left(2);
        }
        assert_eq!(lengths, [3, 2, 4, 3], "{name}");
        for (strand, expected) in read.iter().zip(&expected) {
            let far = strand.iter().flat_map(|p| p.to_array()).zip(expected).map(|(a, b)| (a - b).abs());
            assert!(far.fold(0.0, f32::max) < 1e-3, "{name}: {strand:?} {expected:?}");
        }
        damaged_copies_are_safe(&std::fs::read(&path).unwrap());
    }
}

/// Prefixes, and every byte flipped in turn.
fn damaged_copies_are_safe(data: &[u8]) {
    for at in 0..data.len() {
        let _ = groom(&mut Cursor::new(&data[..at]));
        let mut flipped = data.to_vec();
        flipped[at] ^= 1 << (at % 8);
        let _ = groom(&mut Cursor::new(flipped));
    }
}

#[test]
fn a_group_within_itself_is_told() {
    let mut data = ours(false);
    let root = u64::from_le_bytes(data[8..16].try_into().unwrap()) as usize;
    // The topmost object names the root as its child.
    let top = u64::from_le_bytes(data[root + 24..root + 32].try_into().unwrap()) as usize;
    data[top + 16..top + 24].copy_from_slice(&(top as u64).to_le_bytes());
    assert!(groom(&mut Cursor::new(data)).unwrap_err().contains("contain each other"));
}

proptest! {
    #[test]
    fn any_bytes_are_safe(cut in 0usize..9000, flips in prop::collection::vec((0usize..9000, any::<u8>()), 0..8)) {
        let mut data = ours(true);
        for (at, value) in flips { let n = data.len(); data[at % n] = value; }
        data.truncate(cut);
        let _ = groom(&mut Cursor::new(data));
    }
}
