use super::*;
use crate::{
    Interchange, SceneOptions,
    strands::{ask_python, sample},
    write_alembic, write_hair, write_npz, write_ply, write_usc_data, write_usd,
};

/// What of our own files comes back: the first frame of the strands that have points.
#[test]
fn every_format_of_ours_comes_back_whatever_its_name() {
    let dir = tempfile::tempdir().unwrap();
    let sequence = sample();
    let strands = Interchange::new(&sequence).unwrap();
    let options = SceneOptions::default();
    let at = |name: &str| dir.path().join(name);
    write_hair(&at("a.hair"), &strands, 0).unwrap();
    write_usc_data(&at("a.data"), &strands, 0).unwrap();
    write_ply(&at("a.ply"), &strands, 0).unwrap();
    write_npz(&at("a.npz"), &sequence, &[]).unwrap();
    write_alembic(&at("a.abc"), &sequence, None, &options).unwrap();
    write_usd(&at("a.usda"), &sequence, &options).unwrap();
    write_usd(&at("a.usdc"), &sequence, &options).unwrap();
    for (name, unit_known, up_axis) in [
        ("a.hair", true, None),
        ("a.data", true, None),
        ("a.ply", true, None),
        ("a.npz", true, None),
        ("a.abc", false, None),
        ("a.usda", true, Some(Up::Z)),
        ("a.usdc", true, Some(Up::Z)),
    ] {
        let read = read_groom(&at(name)).unwrap();
        assert_eq!((read.unit_known, read.up_axis), (unit_known, up_axis), "{name}");
        let read: Vec<_> = read.strands.iter().filter(|strand| !strand.is_empty()).collect();
        assert_eq!(read.len(), 3, "{name}");
        for (strand, n) in read.into_iter().zip([0, 2, 3]) {
            let expected = sequence.strand(0, n);
            assert_eq!(strand.len(), expected.len(), "{name}");
            assert!(strand.iter().zip(expected).all(|(a, b)| a.distance(*b) < 1e-4), "{name}");
        }
        // The content decides; only formats without a mark need their ending.
        if name != "a.data" {
            std::fs::copy(at(name), at("renamed")).unwrap();
            assert_eq!(read_groom(&at("renamed")).unwrap(), read_groom(&at(name)).unwrap(), "{name}");
        }
    }
}

#[test]
fn arrays_of_strands_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("points.npz");
    let script = "import sys, numpy as np\np = np.arange(2 * 100 * 3, dtype=np.float64).reshape(2, 100, 3)\n\
                  p[1, 60:] = np.nan\nnp.savez_compressed(sys.argv[1], points=p, other=np.zeros(3))";
    let Some(_) = ask_python(script, &path) else { return };
    let read = read_groom(&path).unwrap();
    assert_eq!(read.strands.iter().map(Vec::len).collect::<Vec<_>>(), [100, 60]);
    assert_eq!((read.strands[1][0].x, read.unit_known), (300.0, false));
}

#[test]
fn what_is_no_groom_is_told_with_the_file_and_a_hint() {
    let dir = tempfile::tempdir().unwrap();
    for (name, content, fact) in [
        ("a.txt", b"hello".as_slice(), "of no format"),
        ("a.abc", b"\x89HDF\r\n\x1a\n", "HDF5"),
        ("a.usdz", b"PK\x03\x04", "package"),
        ("a.hair", b"", "ends in its header"),
        ("a.data", b"\0\0\0\0", "holds no strand"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\nend_header\n", "no strand"),
        ("a.npz", b"PK\x03\x04", "no .npz archive"),
        ("a.usdc", b"PXR-USDC", "lie past its end"),
    ] {
        let path = dir.path().join(name);
        std::fs::write(&path, content).unwrap();
        let told = read_groom(&path).unwrap_err();
        assert!(told.to_string().contains(name) && told.to_string().contains(fact), "{told}");
        assert!(!told.hint().is_empty(), "{told}");
    }
    assert!(matches!(read_groom(&dir.path().join("none.abc")), Err(IoError::System { .. })));
}
