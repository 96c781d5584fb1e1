use glam::DVec3;
use strandflow_core::StrandSequence;

use super::*;
use crate::{
    Carrier, Target,
    strands::{ask_python, sample},
};

const SCRIPT: &str = r#"
import sys
from alembic3d import Abc, AbcGeom
top = Abc.IArchive(sys.argv[1]).getTop()
hair = top.children[0]
print(hair.getName(), AbcGeom.IXform.matches(hair.getMetaData()), [child.getName() for child in hair.children])
user = AbcGeom.IXform(hair, Abc.WrapExistingFlag.kWrapExisting).getSchema().getUserProperties()
for name in ("groom_version_major", "groom_version_minor"):
    print(name, Abc.IInt16Property(user, name).getValue())
print(Abc.IStringProperty(user, "groom_tool").getValue().split()[0])
for child in (part.children[0] for part in hair.children):
    curves = AbcGeom.ICurves(child, Abc.WrapExistingFlag.kWrapExisting).getSchema()
    print(child.getName(), curves.getNumSamples(), str(curves.getTopologyVariance()))
    times = curves.getTimeSampling()
    at = lambda t: Abc.ISampleSelector(times.getSampleTime(t))
    print("times", [round(times.getSampleTime(i), 6) for i in range(curves.getNumSamples())])
    sample = curves.getValue(at(2))
    print("counts", list(sample.getCurvesNumVertices()), str(sample.getType()), str(sample.getWrap()), str(sample.getBasis()))
    for t in range(curves.getNumSamples()):
        points = curves.getValue(at(t)).getPositions()
        print("points", len(points), [[round(x, 5) + 0.0 for x in (p.x, p.y, p.z)] for p in (points[0], points[len(points) - 1])])
    box = sample.getSelfBounds()
    print("bounds", [round(x, 3) for v in (box.min(), box.max()) for x in (v.x, v.y, v.z)])
    width = curves.getWidthsParam()
    print("width", str(width.getScope()), [round(w, 6) for w in width.getExpandedValue().getVals()])
    params = curves.getArbGeomParams()
    for kind, names in ((AbcGeom.IInt32GeomParam, ("groom_group_id", "groom_guide", "groom_id", "strand", "provenance")),
                        (AbcGeom.IFloatGeomParam, ("groom_width", "confidence")),
                        (AbcGeom.IV2fGeomParam, ("groom_root_uv",)),
                        (AbcGeom.IV3iGeomParam, ("groom_closest_guides",)), (AbcGeom.IV3fGeomParam, ("groom_guide_weights",))):
        for name in names:
            if params.getPropertyHeader(name) is None:
                continue
            param = kind(params, name)
            values = param.getExpandedValue(at(2)).getVals()
            shown = [list(round(x, 3) for x in v) if hasattr(v, "__len__") else round(v, 6) for v in values]
            print(name, str(param.getScope()), param.getNumSamples(), shown)
"#;

/// In `sample` gravity points along −y: the file's z is the world's y, its y the world's z (negated twice: by the turn, and for
/// Unreal's left hand), in centimetres. The last frame lacks two points of strand 0, the middle one lacks strand 2.
const EXPECTED: &str = "hair True ['strands', 'guides']
groom_version_major 1
groom_version_minor 4
strandflow
strands 3 kHomogenousTopology
times [0.08, 0.1, 0.12]
counts [5, 3, 4] kLinear kNonPeriodic kNoBasis
points 12 [[0.0, 0.0, 0.05], [3.0, -1.5, 0.05]]
points 12 [[0.0, 0.0, 0.15], [3.0, -1.5, 0.15]]
points 12 [[0.0, 0.0, 0.25], [3.0, -1.5, 0.25]]
bounds [-0.004, -1.504, 0.246, 3.004, 0.004, 0.254]
width kConstantScope [0.008]
groom_group_id kConstantScope 1 [0]
groom_guide kConstantScope 1 [0]
groom_id kUniformScope 1 [0, 2, 3]
strand kUniformScope 1 [0, 2, 3]
provenance kVertexScope 3 [1, 2, 0, 4, 0, 1, 2, 3, 1, 2, 3, 4]
groom_width kConstantScope 1 [0.008]
confidence kVertexScope 3 [0.0, 0.25, 0.0, 0.75, 0.0, 0.0, 0.25, 0.5, 0.0, 0.25, 0.5, 0.75]
groom_root_uv kUniformScope 1 [[1.0, 0.5], [0.5, 0.5], [0.5, 0.5]]
groom_closest_guides kUniformScope 1 [[4, 4, 4], [5, 5, 5], [5, 5, 5]]
groom_guide_weights kUniformScope 1 [[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
guides 3 kHomogenousTopology
times [0.08, 0.1, 0.12]
counts [5, 3] kLinear kNonPeriodic kNoBasis
points 8 [[0.0, 0.0, 0.05], [2.0, -1.0, 0.05]]
points 8 [[0.0, 0.0, 0.15], [2.0, -1.0, 0.05]]
points 8 [[0.0, 0.0, 0.25], [2.0, -1.0, 0.25]]
bounds [-0.004, -1.504, 0.246, 2.004, 0.004, 0.254]
width kConstantScope [0.008]
groom_group_id kConstantScope 1 [0]
groom_guide kConstantScope 1 [1]
groom_id kUniformScope 1 [4, 5]
strand kUniformScope 1 [0, 2]
provenance kVertexScope 3 [1, 2, 0, 4, 0, 1, 2, 3]
groom_width kConstantScope 1 [0.008]
confidence kVertexScope 3 [0.0, 0.25, 0.0, 0.75, 0.0, 0.0, 0.25, 0.5]
groom_root_uv kUniformScope 1 [[1.0, 0.5], [0.5, 0.5]]";

#[test]
fn the_reference_library_reads_the_groom() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.abc");
    let space = Target::Unreal.space(Carrier::Alembic);
    let options = SceneOptions { fps: 50.0, gravity: Some(DVec3::NEG_Y * 9810.0), space, ..SceneOptions::default() };
    let strands = sample();
    let guides = Guides::of(&strands, 2).unwrap();
    write_alembic(&path, &strands, Some(&guides), &options).unwrap();
    let Some(said) = ask_python(SCRIPT, &path) else { return };
    assert_eq!(said.trim(), EXPECTED, "{said}");
}

#[test]
fn files_repeat_and_mistakes_are_told() {
    let dir = tempfile::tempdir().unwrap();
    let (a, b) = (dir.path().join("a.abc"), dir.path().join("b.abc"));
    write_alembic(&a, &sample(), None, &SceneOptions::default()).unwrap();
    write_alembic(&b, &sample(), None, &SceneOptions::default()).unwrap();
    let bytes = std::fs::read(&a).unwrap();
    assert!(bytes == std::fs::read(&b).unwrap() && bytes.starts_with(b"Ogawa\xff\0\x01"));

    let empty = StrandSequence::missing(vec![0], vec![0], 3);
    let told = write_alembic(&a, &empty, None, &SceneOptions::default()).unwrap_err();
    assert!(told.to_string().contains("no strand"));
    let mut gap = sample();
    gap.frames = vec![4, 5, 7];
    let told = write_alembic(&a, &gap, None, &SceneOptions::default()).unwrap_err();
    assert!(told.to_string().contains("not evenly spaced"), "{told}");
    let nowhere = dir.path().join("none/a.abc");
    assert!(write_alembic(&nowhere, &sample(), None, &SceneOptions::default()).is_err());
    assert_eq!(std::fs::read(&a).unwrap(), bytes, "what was there is still there");
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 2, "nothing half written is left");
}
