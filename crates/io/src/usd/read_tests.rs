use std::io::Cursor;

use proptest::prelude::*;

use super::*;
use crate::{
    Carrier, Target, read_groom,
    strands::{ask_python, sample},
};

fn ours(name: &str) -> Vec<u8> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    write_usd(&path, &sample(), &SceneOptions::default()).unwrap();
    std::fs::read(&path).unwrap()
}

fn text(data: &[u8]) -> Result<Groom, String> {
    read_text::read(data)?.groom()
}

fn binary(data: &[u8]) -> Result<Groom, String> {
    read_crate::read(&mut Cursor::new(data))?.groom()
}

#[test]
fn ours_comes_back_in_millimetres() {
    let dir = tempfile::tempdir().unwrap();
    for (name, space, up) in [
        ("a.usda", Target::Blender.space(Carrier::Usd), Up::Z),
        ("b.usdc", Target::Blender.space(Carrier::Usd), Up::Z),
        ("c.usda", Target::Maya.space(Carrier::Usd), Up::Y),
        ("d.usd", Target::Maya.space(Carrier::Usd), Up::Y),
    ] {
        let path = dir.path().join(name);
        write_usd(&path, &sample(), &SceneOptions { space, ..SceneOptions::default() }).unwrap();
        let read = read_groom(&path).unwrap();
        assert_eq!((read.unit_known, read.up_axis, read.strands.len()), (true, Some(up), 3), "{name}");
        let expected = sample();
        for (strand, n) in read.strands.iter().zip([0, 2, 3]) {
            let turned = |p: &glam::Vec3| if up == Up::Y { glam::Vec3::new(p.x, p.z, -p.y) } else { *p };
            let far = strand.iter().zip(expected.strand(0, n)).map(|(a, b)| a.distance(turned(b)));
            assert!(far.fold(0.0, f32::max) < 1e-4, "{name}");
        }
    }
}

/// Writes a groom by USD's own library: transforms of every kind, a class, curves with a default, with samples and with both,
/// long ones among them; says where its points should be, by the library's own matrices.
const FOREIGN: &str = r#"
import sys
from pxr import Usd, UsdGeom, Gf, Sdf, Vt
stage = Usd.Stage.CreateNew(sys.argv[1])
UsdGeom.SetStageMetersPerUnit(stage, 0.01)
UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
stage.GetRootLayer().comment = 'A layer with "quotes", {braces} and # signs'
stage.GetRootLayer().customLayerData = {"a": {"b": Vt.IntArray([1, 2, 3])}, "c": "text ) ]"}
top = UsdGeom.Xform.Define(stage, "/top")
stage.SetDefaultPrim(top.GetPrim())
top.AddTranslateOp().Set(Gf.Vec3d(1, 2.5, 3))
top.AddRotateXYZOp().Set(Gf.Vec3f(10, 20, 30))
top.AddScaleOp().Set(Gf.Vec3f(2, 3, 4))
inner = UsdGeom.Xform.Define(stage, "/top/inner")
inner.AddTransformOp().Set(Gf.Matrix4d(0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 5, 6, 7.5, 1))
inner.AddOrientOp().Set(Gf.Quatf(0.5, 0.5, 0.5, 0.5))
inner.AddRotateZYXOp(opSuffix="late").Set(Gf.Vec3f(5, 6, 7))
for order in ("XZY", "YXZ", "YZX", "ZXY"):
    getattr(inner, "AddRotate" + order + "Op")(opSuffix="more").Set(Gf.Vec3f(15, 25, 35))
pivot = Gf.Vec3f(1, 2, 3)
inner.AddTranslateOp(UsdGeom.XformOp.PrecisionFloat, "pivot").Set(pivot)
inner.AddRotateYOp().Set(33.0)
inner.AddTranslateOp(UsdGeom.XformOp.PrecisionFloat, "pivot", True)
alone = UsdGeom.Xform.Define(stage, "/top/inner/alone")
alone.AddTransformOp().Set(Gf.Matrix4d(Gf.Vec4d(2, 3, 4, 1)))
alone.SetResetXformStack(True)
def curves(path, counts, default, samples):
    c = UsdGeom.BasisCurves.Define(stage, path)
    c.CreateTypeAttr("linear"); c.CreateWrapAttr("nonperiodic")
    c.CreateCurveVertexCountsAttr(counts)
    points = lambda t: Vt.Vec3fArray([Gf.Vec3f(i, 0.5 * i, 100 * t - 0.25 * i * i) for i in range(sum(counts))])
    attr = c.CreatePointsAttr()
    if default: attr.Set(points(0))
    for t in samples: attr.Set(points(t), t + 10)
    c.CreateWidthsAttr([0.1]); c.SetWidthsInterpolation("constant")
    c.GetPrim().SetMetadata("documentation", "a 'groom' with\nlines")
    UsdGeom.PrimvarsAPI(c).CreatePrimvar("tag", Sdf.ValueTypeNames.String).Set("it's \"quoted\" ]")
    c.GetPrim().CreateRelationship("hair:target").SetTargets(["/top"])
    c.GetPrim().CreateAttribute("file", Sdf.ValueTypeNames.Asset).Set("./a.png")
    c.GetPrim().CreateAttribute("nothing", Sdf.ValueTypeNames.Float)
    return c
made = [curves("/top/inner/still", [3, 2], True, []), curves("/top/inner/alone/moving", [4], False, [0, 1, 2]),
        curves("/top/both", [2] * 40 + [30], True, [1, 2])]
stage.CreateClassPrim("/_class"); curves("/_class/hidden", [2], True, [])
UsdGeom.Mesh.Define(stage, "/top/mesh").CreatePointsAttr([(0, 0, 0)])
cache = UsdGeom.XformCache()
for c in made:
    time = Usd.TimeCode.Default() if c.GetPointsAttr().Get() is not None else Usd.TimeCode(10)
    matrix = cache.GetLocalToWorldTransform(c.GetPrim()); points = c.GetPointsAttr().Get(time); at = 0
    for n in c.GetCurveVertexCountsAttr().Get():
        for p in points[at:at + n]:
            q = matrix.Transform(Gf.Vec3d(p)) * 10
            print(*q)
        print("end"); at += n
stage.GetRootLayer().Save()
"#;

#[test]
fn the_reference_library_s_layers_are_read() {
    let dir = tempfile::tempdir().unwrap();
    // The library writes the oldest crate version that holds the layer, unless told otherwise.
    for (name, version) in [("a.usda", "0.8.0"), ("b.usdc", "0.7.0"), ("c.usd", "0.8.0"), ("d.usdc", "0.13.0")] {
        let path = dir.path().join(name);
        let told = format!("import os\nos.environ['USD_WRITE_NEW_USDC_FILES_AS_VERSION'] = '{version}'\n");
        let Some(said) = ask_python(&(told + FOREIGN), &path) else { return };
        let mut read = read_groom(&path).unwrap();
        assert_eq!((read.unit_known, read.up_axis), (true, Some(Up::Y)));
        let mut expected: Vec<Vec<f32>> = said
            .split("end")
            .map(|strand| strand.split_whitespace().map(|word| word.parse().unwrap()).collect())
            .filter(|strand: &Vec<f32>| !strand.is_empty())
            .collect();
        assert_eq!(read.strands.len(), 44, "{name}");
        // Prims come in the file's order.
        expected.sort_by(|a, b| a[0].total_cmp(&b[0]));
        read.strands.sort_by(|a, b| a[0].x.total_cmp(&b[0].x));
        for (strand, expected) in read.strands.iter().zip(&expected) {
            assert_eq!(strand.len() * 3, expected.len(), "{name}");
            let far = strand.iter().flat_map(|p| p.to_array()).zip(expected).map(|(a, b)| (a - b).abs());
            assert!(far.fold(0.0, f32::max) < 0.02, "{name}: {strand:?} {expected:?}");
        }
        let data = std::fs::read(&path).unwrap();
        let read: fn(&[u8]) -> Result<Groom, String> = if name.ends_with('a') { text } else { binary };
        for at in (0..data.len()).step_by(3) {
            let _ = read(&data[..at]);
            let mut flipped = data.clone();
            flipped[at] ^= 1 << (at % 8);
            let _ = read(&flipped);
        }
    }
}

#[test]
fn what_is_not_read_is_told() {
    assert!(text(b"#usda 1.0\ndef Xform \"a\"\n{\n").unwrap_err().starts_with("line 4: ends within a prim"));
    assert!(
        text(b"#usda 1.0\ndef Xform \"a\" (\n    references = @b.usd@</c>\n)\n{\n}\n")
            .unwrap_err()
            .contains("BasisCurves")
    );
    let points = |count: u8| {
        format!(
            "#usda 1.0\ndef BasisCurves \"a\" {{\nint[] curveVertexCounts = [{count}]\npoint3f[] points = [(1, 2, 3), (4, 5, 6)]\n}}"
        )
    };
    let read = text(points(2).as_bytes()).unwrap();
    assert_eq!((read.unit_known, read.strands[0][1].to_array()), (false, [4.0, 5.0, 6.0]));
    assert!(text(points(3).as_bytes()).unwrap_err().contains("have 2 points, but count 3"));
    let mut old = ours("a.usdc");
    old[9] = 6;
    assert!(binary(&old).unwrap_err().contains("version 0.6"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]
    #[test]
    fn any_bytes_are_safe(cut in 0usize..6000, flips in prop::collection::vec((0usize..6000, any::<u8>()), 0..8)) {
        for (name, read) in [("a.usda", text as fn(&[u8]) -> _), ("a.usdc", binary)] {
            let mut data = ours(name);
            for &(at, value) in &flips { let n = data.len(); data[at % n] = value; }
            let _ = read(&data);
            data.truncate(cut);
            let _ = read(&data);
        }
    }
}
