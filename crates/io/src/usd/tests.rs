use glam::DVec3;
use strandflow_core::StrandSequence;

use super::*;
use crate::{Carrier, Target, strands::sample};

const SCRIPT: &str = r#"
import sys
from pxr import Usd, UsdGeom
stage = Usd.Stage.Open(sys.argv[1])
curves = UsdGeom.BasisCurves(stage.GetPrimAtPath("/hair/strands"))
prim = curves.GetPrim()
points = curves.GetPointsAttr()
print("default", stage.GetDefaultPrim().GetPath(), prim.GetTypeName(), curves.GetTypeAttr().Get(), curves.GetWrapAttr().Get())
print("stage", UsdGeom.GetStageMetersPerUnit(stage), UsdGeom.GetStageUpAxis(stage), stage.GetTimeCodesPerSecond(),
      stage.GetFramesPerSecond(), stage.GetStartTimeCode(), stage.GetEndTimeCode())
print("counts", list(curves.GetCurveVertexCountsAttr().Get()), points.GetTimeSamples())
print("shape", [len(points.Get(t)) for t in points.GetTimeSamples()])
print("point", [round(x, 4) for x in points.Get(6)[6]])
print("velocity", [round(x, 3) for x in curves.GetVelocitiesAttr().Get(5)[0]])
print("extent", [[round(x, 2) for x in v] for v in curves.GetExtentAttr().Get(4)])
print("widths", [round(x, 4) for x in curves.GetWidthsAttr().Get()], curves.GetWidthsInterpolation())
api = UsdGeom.PrimvarsAPI(prim)
print("st", api.GetPrimvar("st").GetInterpolation(), api.GetPrimvar("st").GetTypeName(),
      [[round(x, 3) for x in uv] for uv in api.GetPrimvar("st").Get()])
for name in ("strand", "provenance", "confidence"):
    p = api.GetPrimvar(name)
    print(name, p.GetInterpolation(), p.GetTypeName(), list(p.Get(6)))
"#;

const EXPECTED: &str = "default /hair BasisCurves linear nonperiodic
stage 0.001 Z 50.0 50.0 4.0 6.0
counts [5, 3, 4] [4.0, 5.0, 6.0]
shape [12, 12, 12]
point [20.0, 5.0, 2.5]
velocity [0.0, 0.0, 50.0]
extent [[-0.04, -0.04, 0.46], [30.04, 20.04, 0.54]]
widths [0.08] constant
st uniform texCoord2f[] [[1.0, 0.5], [0.5, 0.5], [0.5, 0.5]]
strand uniform int[] [0, 2, 3]
provenance vertex int[] [1, 2, 0, 4, 0, 1, 2, 3, 1, 2, 3, 4]
confidence vertex float[] [0.0, 0.25, 0.0, 0.75, 0.0, 0.0, 0.25, 0.5, 0.0, 0.25, 0.5, 0.75]";

/// In `sample` gravity points along −y: the file's z is the world's y, its y the world's −z.
#[test]
fn the_reference_library_reads_both_forms() {
    let dir = tempfile::tempdir().unwrap();
    let options = SceneOptions { fps: 50.0, gravity: Some(DVec3::NEG_Y * 9810.0), ..SceneOptions::default() };
    for name in ["a.usda", "a.usdc", "a.usd"] {
        let path = dir.path().join(name);
        write_usd(&path, &sample(), &options).unwrap();
        let Some(said) = crate::strands::ask_python(SCRIPT, &path) else { return };
        assert_eq!(said.trim(), EXPECTED, "{name}");
    }
}

/// A point 30 mm along x, 5 mm against gravity and 5 mm along z.
#[test]
fn a_target_s_unit_and_axis_stand_in_the_file() {
    let script = r#"
import sys
from pxr import Usd, UsdGeom
stage = Usd.Stage.Open(sys.argv[1])
curves = UsdGeom.BasisCurves(stage.GetPrimAtPath("/hair/strands"))
print(UsdGeom.GetStageMetersPerUnit(stage), UsdGeom.GetStageUpAxis(stage), [round(x, 5) for x in curves.GetPointsAttr().Get(6)[9]],
      [round(x, 6) for x in curves.GetWidthsAttr().Get()])
"#;
    let dir = tempfile::tempdir().unwrap();
    for (target, expected) in [
        (Target::Unreal, "0.01 Z [3.0, 0.5, 0.25] [0.008]"),
        (Target::Houdini, "1.0 Y [0.03, 0.0025, -0.005] [8e-05]"),
        (Target::Blender, "1.0 Z [0.03, 0.005, 0.0025] [8e-05]"),
        (Target::Maya, "0.01 Y [3.0, 0.25, -0.5] [0.008]"),
    ] {
        for name in ["a.usda", "a.usdc"] {
            let path = dir.path().join(name);
            let space = target.space(Carrier::Usd);
            let options = SceneOptions { space, gravity: Some(DVec3::NEG_Y), ..SceneOptions::default() };
            write_usd(&path, &sample(), &options).unwrap();
            let Some(said) = crate::strands::ask_python(script, &path) else { return };
            assert_eq!(said.trim(), expected, "{target:?} {name}");
        }
    }
}

#[test]
fn files_repeat_and_mistakes_are_told() {
    let dir = tempfile::tempdir().unwrap();
    let (a, b) = (dir.path().join("a.usdc"), dir.path().join("b.usdc"));
    write_usd(&a, &sample(), &SceneOptions::default()).unwrap();
    write_usd(&b, &sample(), &SceneOptions::default()).unwrap();
    let bytes = std::fs::read(&a).unwrap();
    assert!(bytes == std::fs::read(&b).unwrap() && bytes.starts_with(b"PXR-USDC"));
    let empty = StrandSequence::missing(vec![0], vec![3], 3);
    assert!(write_usd(&a, &empty, &SceneOptions::default()).unwrap_err().to_string().contains("no strand"));
    assert!(write_usd(&dir.path().join("a.abc"), &sample(), &SceneOptions::default()).is_err());
}
