use proptest::prelude::*;
use strandflow_core::Grid;

use super::*;
use crate::{Carrier, Target};

/// 8,000 of the voxels of a grid that spans several leaves and lower nodes; x of a velocity is the voxel's number.
fn field() -> SparseVoxels<Vec3> {
    let grid = Grid { origin: DVec3::new(-100.0, 20.0, 1500.0), voxel_mm: 2.0, dims: [150, 140, 30] };
    let indices: Vec<u32> = (0..630_000).filter(|i| i % 79 == 3).collect();
    let velocity = |&index: &u32| Vec3::new(index as f32, -(index as f32) * 0.5, 100.0);
    SparseVoxels { grid, values: indices.iter().map(velocity).collect(), indices }
}

const SCRIPT: &str = r#"
import sys
import pyopenvdb as vdb
grids, meta = vdb.readAll(sys.argv[1])
grid = grids[0]
print(len(grids), type(grid).__name__, grid.name, grid.activeVoxelCount(), grid.background, grid["unit"], grid.vectorType, meta["creator"].split()[0])
print([round(x, 4) for x in grid.transform.indexToWorld((0, 0, 0))], [round(x, 4) for x in grid.transform.indexToWorld((149, 139, 29))])
print([round(x, 5) for x in grid.transform.voxelSize()])
values = {item.min: item.value for item in grid.citerOnValues() if item.min == item.max}
wrong = 0
for index in range(3, 630000, 79):
    at = (index % 150, index // 150 % 140, index // 21000)
    x = values[at]
    expected = [float(a) for a in sys.argv[2].split(",")]
    want = [index * expected[0] + expected[3], index * expected[1] + expected[4], index * expected[2] + expected[5]]
    wrong += any(abs(a - b) > 1e-5 * max(1, abs(b)) for a, b in zip(x, want))
print(len(values), "wrong", wrong)
vdb.write(sys.argv[1] + ".again", grids=[grid])
"#;

/// Debian's python3-openvdb belongs to the system's interpreter. `None` where it is absent, which under CI is an error.
fn ask_openvdb(path: &Path, expected: &str) -> Option<String> {
    let out = std::process::Command::new("/usr/bin/python3").args(["-c", SCRIPT]).arg(path).arg(expected).output();
    let (said, errors, fine) = match out {
        Ok(out) => (
            String::from_utf8_lossy(&out.stdout).into_owned(),
            String::from_utf8_lossy(&out.stderr).into_owned(),
            out.status.success(),
        ),
        Err(error) => (String::new(), format!("No module named: {error}"), false),
    };
    if errors.contains("No module named") {
        assert!(std::env::var_os("CI").is_none(), "python3-openvdb is missing: {errors}");
        println!("skipped: no python3-openvdb");
        return None;
    }
    assert!(fine, "{errors}");
    Some(said)
}

#[test]
fn openvdb_reads_every_voxel() {
    let dir = tempfile::tempdir().unwrap();
    let gravity = Some(DVec3::NEG_Z);
    for (name, zip) in [("zip.vdb", true), ("raw.vdb", false)] {
        let path = dir.path().join(name);
        write_velocity_vdb(&path, &field(), &VdbOptions { zip, gravity, ..VdbOptions::default() }).unwrap();
        let Some(said) = ask_openvdb(&path, "1,-0.5,0,0,0,100") else { return };
        let count = field().len();
        let expected = format!(
            "1 Vec3SGrid velocity {count} (0.0, 0.0, 0.0) mm/s contravariant relative strandflow\n\
             [-99.0, 21.0, 1501.0] [199.0, 299.0, 1559.0]\n[2.0, 2.0, 2.0]\n{count} wrong 0"
        );
        assert_eq!(said.trim(), expected);
        // OpenVDB itself writes Blosc, which is told.
        let told = read_vdb(&dir.path().join(format!("{name}.again"))).unwrap_err();
        assert!(told.to_string().contains("Blosc"), "{told}");
    }
}

#[test]
fn targets_get_their_unit_and_axes() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.vdb");
    // Gravity along −Z; Houdini takes y for up: (x, y, z) → (x, z, −y), metres.
    let space = Target::Houdini.space(Carrier::Vdb);
    write_velocity_vdb(&path, &field(), &VdbOptions { space, ..VdbOptions::default() }).unwrap();
    let Some(said) = ask_openvdb(&path, "0.001,0,0.0005,0,0.1,0") else { return };
    assert!(said.contains("[-0.099, 1.501, -0.021] [0.199, 1.559, -0.299]") && said.contains(" m/s "), "{said}");
    assert!(said.contains("wrong 0"), "{said}");
}

#[test]
fn a_grid_comes_back_and_files_repeat() {
    let dir = tempfile::tempdir().unwrap();
    for zip in [true, false] {
        let (a, b) = (dir.path().join("a.vdb"), dir.path().join("b.vdb"));
        let options = VdbOptions { zip, ..VdbOptions::default() };
        write_velocity_vdb(&a, &field(), &options).unwrap();
        write_velocity_vdb(&b, &field(), &options).unwrap();
        assert!(std::fs::read(&a).unwrap() == std::fs::read(&b).unwrap());
        let mut grids = read_vdb(&a).unwrap();
        let mut ours = VectorGrid::velocity(&field(), &options);
        grids[0].voxels.sort_by_key(|voxel| voxel.0);
        ours.voxels.sort_by_key(|voxel| voxel.0);
        assert_eq!(grids, [ours]);
    }
    // A frame without flow is a grid without voxels.
    let empty = SparseVoxels { indices: vec![], values: vec![], ..field() };
    let path = dir.path().join("empty.vdb");
    write_velocity_vdb(&path, &empty, &VdbOptions::default()).unwrap();
    assert!(read_vdb(&path).unwrap()[0].voxels.is_empty());
}

#[test]
fn wrong_files_are_told() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.vdb");
    std::fs::write(&path, b"not a volume at all").unwrap();
    assert!(read_vdb(&path).unwrap_err().to_string().contains("not an OpenVDB file"));
    write_velocity_vdb(&path, &field(), &VdbOptions::default()).unwrap();
    let whole = std::fs::read(&path).unwrap();
    std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    assert!(read_vdb(&path).unwrap_err().to_string().contains("too early"));
    assert!(write_velocity_vdb(&dir.path().join("none/a.vdb"), &field(), &VdbOptions::default()).is_err());
}

proptest! {
    #[test]
    fn damaged_bytes_are_safe(at in 0usize..4000, byte: u8, cut in 0usize..4000) {
        let mut small = field();
        small.indices.truncate(40);
        small.values.truncate(40);
        let mut bytes = write::file(&VectorGrid::velocity(&small, &VdbOptions::default()), "mm/s", true);
        let at = at % bytes.len();
        bytes[at] = byte;
        bytes.truncate(bytes.len().saturating_sub(cut % 50));
        let _ = read::file(&bytes);
    }
}

#[test]
fn a_field_comes_back_from_every_space() {
    let grid = Grid { origin: DVec3::new(-40.0, 12.0, 900.0), voxel_mm: 2.0, dims: [30, 20, 25] };
    let indices: Vec<u32> = (0..grid.len() as u32).step_by(7).collect();
    let values = indices.iter().map(|i| Vec3::new(*i as f32, -3.0, 0.25 * *i as f32)).collect();
    let field = SparseVoxels { grid, indices, values };
    for target in [crate::Target::Unreal, crate::Target::Houdini, crate::Target::Blender, crate::Target::Maya] {
        let space = target.space(crate::Carrier::Vdb);
        let options = VdbOptions { gravity: Some(DVec3::new(0.0, 9810.0, 0.0)), space, zip: false };
        let back = VectorGrid::velocity(&field, &options).to_velocity(&options).unwrap();
        assert_eq!(back.indices.len(), field.indices.len());
        for (a, b) in [0, 100, back.indices.len() - 1].map(|i| (i, i)) {
            let place = |f: &SparseVoxels<Vec3>, i: usize| f.grid.centre_of_index(f.indices[i] as usize);
            assert!(place(&back, a).distance(place(&field, b)) < 1e-6, "{target:?}");
            assert!(back.values[a].distance(field.values[b]) < 1e-2, "{target:?}");
        }
        let wrong = VdbOptions { gravity: Some(DVec3::X), ..options };
        assert!(VectorGrid::velocity(&field, &options).to_velocity(&wrong).unwrap_err().contains("axes"));
    }
}
