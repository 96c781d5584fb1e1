//! Every array of the store in one table; `docs/formats.md` is made from it.

/// The number types in use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DType {
    /// `uint8`, fill value 0.
    U8,
    /// `uint16`, fill value 0.
    U16,
    /// `uint32`, fill value 0.
    U32,
    /// `float32`, fill value NaN.
    F32,
    /// `float64`, fill value NaN.
    F64,
}

impl DType {
    /// Bytes a sample.
    pub fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Name in numpy and Zarr.
    pub fn name(self) -> &'static str {
        match self {
            Self::U8 => "uint8",
            Self::U16 => "uint16",
            Self::U32 => "uint32",
            Self::F32 => "float32",
            Self::F64 => "float64",
        }
    }
}

/// One array, or one array a frame where the path holds `FRAME`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArraySpec {
    /// Path in the store; `FRAME` stands for the six digits of a frame, `NAME` for the name of an animation.
    pub path: &'static str,
    /// Number type.
    pub dtype: DType,
    /// Dimension names.
    pub dims: &'static [&'static str],
    /// What one chunk holds.
    pub chunk: &'static str,
    /// Unit of the samples.
    pub units: &'static str,
    /// What the samples are.
    pub meaning: &'static str,
}

const fn spec(
    path: &'static str,
    (dtype, units): (DType, &'static str),
    dims: &'static [&'static str],
    chunk: &'static str,
    meaning: &'static str,
) -> ArraySpec {
    ArraySpec { path, dtype, dims, chunk, units, meaning }
}

use DType::{F32, F64, U8, U16, U32};

const IMAGE: &[&str] = &["frame", "view", "row", "column"];
const POINTS: &[&str] = &["frame", "strand", "point", "xyz"];
const SAMPLES: &[&str] = &["frame", "strand", "point"];
const PER_VIEW: &str = "one view of one frame";
const PER_FRAME: &str = "one frame";
const PER_TAKE: &str = "all";
const STRANDS: &str = "512 strands of one frame";
const BLOCK: &str = "512 strands";

const NUMBERS_OF_PROVENANCE: &str = "0 missing, 1 observed, 2 diffused, 3 simulated, 4 completed";
const ANIMATED: &str = "world position of a groom driven by the captured motion, root first; NaN past its end";
const CHECK: &str = "strands, strands in the head, sum and most of their relative changes of length";
const CONFIDENCE: &str = "trust 0 to 1, times 255";
const TO_FRAME_BEFORE: &str = "flow to the frame before, at an eighth of the resolution; zero away from the hair";
const POSITION: &str = "world position, root first; NaN where there is no point";
const COUNTS: &str = "particles of the strand in every frame; 0: the strand is absent";

/// All arrays, in the order of the pipeline.
pub const ARRAYS: &[ArraySpec] = &[
    spec("masks/subject", (U8, "1/255"), IMAGE, PER_VIEW, "coverage by head, hair and markers; inside from 128 on"),
    spec("masks/hair", (U8, "1/255"), IMAGE, PER_VIEW, "coverage by hair; inside from 128 on"),
    spec(
        "hull/grid/origin",
        (F64, "mm"),
        &["xyz"],
        PER_TAKE,
        "corner of voxel (0, 0, 0) with the smallest coordinates",
    ),
    spec("hull/grid/voxel_mm", (F64, "mm"), &["one"], PER_TAKE, "edge of a voxel"),
    spec("hull/grid/dims", (U32, "voxels"), &["xyz"], PER_TAKE, "voxels along x, y, z"),
    spec("hull/occupancy", (U8, "1"), &["frame", "z", "y", "x"], PER_FRAME, "1 inside the visual hull"),
    spec(
        "pose/world_from_head",
        (F64, "mm"),
        &["frame", "row", "column"],
        PER_TAKE,
        "head space (the world of the first frame) to world",
    ),
    spec(
        "pose/markers",
        (F64, "mm"),
        &["frame", "marker", "xyz"],
        PER_TAKE,
        "marker positions; NaN where not triangulated",
    ),
    spec(
        "pose/tracks",
        (F64, "px"),
        &["frame", "view", "marker", "uv"],
        PER_TAKE,
        "marker image points; NaN where lost, occluded or the view is held out",
    ),
    spec("pose/ids", (U32, "1"), &["marker"], PER_TAKE, "numbers of the markers, as labelled"),
    spec("pose/rms_px", (F64, "px"), &["frame"], PER_TAKE, "root mean square reprojection error of the markers used"),
    spec("pose/used", (U32, "markers"), &["frame"], PER_TAKE, "markers that the pose rests on"),
    spec("pose/interpolated", (U8, "1"), &["frame"], PER_TAKE, "1 where the pose was interpolated"),
    spec("scalp/vertices", (F64, "mm"), &["vertex", "xyz"], PER_TAKE, "head surface, head space"),
    spec("scalp/faces", (U32, "1"), &["face", "corner"], PER_TAKE, "vertex indices, outward faces"),
    spec("scalp/roots", (F64, "mm"), &["strand", "xyz"], PER_TAKE, "hair roots, head space"),
    spec("scalp/normals", (F64, "1"), &["strand", "xyz"], PER_TAKE, "outward unit normals at the roots, head space"),
    spec("orient/frames/angle", (U16, "π/65536 rad"), IMAGE, PER_VIEW, "as orient/angle, from this frame alone"),
    spec("orient/frames/confidence", (U8, "1/255"), IMAGE, PER_VIEW, CONFIDENCE),
    spec("orient/frames/half_angle", (U16, "π/65536 rad"), IMAGE, PER_VIEW, "the same at half the resolution"),
    spec("orient/frames/half_confidence", (U8, "1/255"), IMAGE, PER_VIEW, CONFIDENCE),
    spec("orient/frames/back_u", (F32, "8 px"), IMAGE, PER_VIEW, TO_FRAME_BEFORE),
    spec("orient/frames/back_v", (F32, "8 px"), IMAGE, PER_VIEW, TO_FRAME_BEFORE),
    spec(
        "orient/angle",
        (U16, "π/65536 rad"),
        IMAGE,
        PER_VIEW,
        "undirected orientation from +x (right) towards +y (down)",
    ),
    spec("orient/confidence", (U8, "1/255"), IMAGE, PER_VIEW, CONFIDENCE),
    spec("lift/FRAME/voxel", (U32, "1"), &["line"], PER_FRAME, "linear index on the take's grid, x fastest; rising"),
    spec(
        "lift/FRAME/direction",
        (F32, "1"),
        &["line", "xyz"],
        PER_FRAME,
        "unit direction of an observed line; sign without meaning",
    ),
    spec("lift/FRAME/confidence", (F32, "1"), &["line"], PER_FRAME, "trust 0 to 1"),
    spec(
        "lift/FRAME/residual",
        (F32, "rad"),
        &["line"],
        PER_FRAME,
        "root mean square angle between the line and its planes",
    ),
    spec("lift/FRAME/views", (U8, "views"), &["line"], PER_FRAME, "views that took part"),
    spec("field/FRAME/voxel", (U32, "1"), &["voxel"], PER_FRAME, "linear index on the take's grid, x fastest; rising"),
    spec(
        "field/FRAME/direction",
        (F32, "1"),
        &["voxel", "xyz"],
        PER_FRAME,
        "unit direction of the line field; sign without meaning",
    ),
    spec(
        "field/FRAME/trust",
        (F32, "1"),
        &["voxel"],
        PER_FRAME,
        "anisotropy times what arrived from observed lines, 0 to 1",
    ),
    spec("field/FRAME/observed", (U8, "1"), &["voxel"], PER_FRAME, "1 where the voxel itself was observed"),
    spec(
        "field/FRAME/motion",
        (F32, "mm"),
        &["voxel", "xyz"],
        PER_FRAME,
        "displacement of the hair in the voxel since the frame before, world; the head's where nothing was seen",
    ),
    spec("grow/points", (F32, "mm"), POINTS, STRANDS, POSITION),
    spec("grow/provenance", (U8, "1"), SAMPLES, STRANDS, NUMBERS_OF_PROVENANCE),
    spec("grow/confidence", (U8, "1/255"), SAMPLES, STRANDS, CONFIDENCE),
    spec("prune/points", (F32, "mm"), POINTS, STRANDS, POSITION),
    spec("prune/provenance", (U8, "1"), SAMPLES, STRANDS, NUMBERS_OF_PROVENANCE),
    spec("prune/confidence", (U8, "1/255"), SAMPLES, STRANDS, CONFIDENCE),
    spec(
        "prune/flags",
        (U8, "1"),
        &["frame", "strand"],
        PER_FRAME,
        "0 kept, rejected by 1 reprojection, 2 voxel field, 3 length",
    ),
    spec("smooth/frames/points", (F32, "mm"), POINTS, STRANDS, POSITION),
    spec("smooth/frames/provenance", (U8, "1"), SAMPLES, STRANDS, NUMBERS_OF_PROVENANCE),
    spec("smooth/frames/confidence", (U8, "1/255"), SAMPLES, STRANDS, CONFIDENCE),
    spec(
        "smooth/point_count",
        (U32, "points"),
        &["one"],
        PER_TAKE,
        "particles that 999 of 1000 strands keep within; longer ones lose their tips",
    ),
    spec(
        "smooth/longest",
        (U16, "points"),
        &["strand"],
        PER_TAKE,
        "particles beyond which the strand outgrows those around it; 65535: no limit",
    ),
    spec("smooth/points", (F32, "mm"), POINTS, STRANDS, POSITION),
    spec("smooth/provenance", (U8, "1"), SAMPLES, STRANDS, NUMBERS_OF_PROVENANCE),
    spec("smooth/confidence", (U8, "1/255"), SAMPLES, STRANDS, CONFIDENCE),
    spec("smooth/counts", (U16, "points"), &["strand"], BLOCK, COUNTS),
    spec("fit/points", (F32, "mm"), POINTS, STRANDS, POSITION),
    spec("fit/provenance", (U8, "1"), SAMPLES, STRANDS, NUMBERS_OF_PROVENANCE),
    spec("fit/confidence", (U8, "1/255"), SAMPLES, STRANDS, CONFIDENCE),
    spec("fit/counts", (U16, "points"), &["strand"], BLOCK, COUNTS),
    spec(
        "fit/parameters",
        (F32, "1/s² (k), 1/s (c, drag)"),
        &["strand", "parameter"],
        BLOCK,
        "k_edge, k_bend, k_torsion, k_alt, c_edge, c_bend, c_torsion, c_alt, drag, per unit mass",
    ),
    spec(
        "fit/residual_mm",
        (F32, "mm"),
        &["strand"],
        BLOCK,
        "root mean square distance of the refined to the given points",
    ),
    spec(
        "fit/covariance",
        (F32, "1"),
        &["strand", "logarithm", "logarithm"],
        BLOCK,
        "covariance of ln k_bend, ln k_torsion, ln k_alt, ln drag; NaN where there is none",
    ),
    spec(
        "fit/held_out_mm",
        (F32, "mm"),
        &["strand", "way"],
        BLOCK,
        "distance to samples of frames that the windows before had not seen: of the simulation, of velocities kept; NaN where there are none",
    ),
    spec("fit/windows", (U16, "windows"), &["strand", "kind"], BLOCK, "fitted, stopped without converging, failed"),
    spec("flow/FRAME/voxel", (U32, "1"), &["voxel"], PER_FRAME, "linear index on the take's grid, x fastest; rising"),
    spec("flow/FRAME/velocity", (F32, "mm/s"), &["voxel", "xyz"], PER_FRAME, "velocity, world"),
    spec("blend/points", (F32, "mm"), POINTS, STRANDS, POSITION),
    spec("blend/provenance", (U8, "1"), SAMPLES, STRANDS, NUMBERS_OF_PROVENANCE),
    spec("blend/confidence", (U8, "1/255"), SAMPLES, STRANDS, CONFIDENCE),
    spec("blend/counts", (U16, "points"), &["frame", "strand"], PER_FRAME, "particles of the strand in this frame"),
    spec("animate/NAME/points", (F32, "mm"), POINTS, STRANDS, ANIMATED),
    spec("animate/NAME/velocities", (F32, "mm/s"), POINTS, STRANDS, "velocity, from which the next frame goes on"),
    spec("animate/NAME/world_from_head", (F64, "mm"), &["frame", "row", "column"], PER_FRAME, "head space to world"),
    spec("animate/NAME/check", (F64, "1"), &["frame", "figure"], PER_FRAME, CHECK),
    spec("animate/NAME/counts", (U16, "points"), &["strand"], PER_TAKE, "particles of the strand of the groom"),
];

/// The description of an array by its path in the store.
pub fn spec_of(path: &str) -> Option<&'static ArraySpec> {
    ARRAYS.iter().find(|spec| {
        let (mut wanted, mut found) = (spec.path.split('/'), path.split('/'));
        loop {
            match (wanted.next(), found.next()) {
                (None, None) => return true,
                (Some("NAME"), Some(name)) if !name.is_empty() => {}
                (Some("FRAME"), Some(digits)) if digits.len() == 6 && digits.bytes().all(|b| b.is_ascii_digit()) => {}
                (Some(a), Some(b)) if a == b => {}
                _ => return false,
            }
        }
    })
}

/// The table of `docs/formats.md`.
pub fn markdown_table() -> String {
    let mut text = String::from("| array | type | dimensions | chunk | unit | meaning |\n|---|---|---|---|---|---|\n");
    for a in ARRAYS {
        let dims = a.dims.join(", ");
        text +=
            &format!("| `{}` | {} | {dims} | {} | {} | {} |\n", a.path, a.dtype.name(), a.chunk, a.units, a.meaning);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_found_with_their_frames() {
        assert_eq!(spec_of("lift/000012/voxel").map(|s| s.path), Some("lift/FRAME/voxel"));
        assert_eq!(spec_of("lift/12/voxel"), None);
        assert_eq!(spec_of("fit/points").map(|s| s.dtype), Some(F32));
    }

    /// `STRANDFLOW_WRITE_DOCS=1 cargo test -p strandflow-engine` writes the table into the page.
    #[test]
    fn the_page_of_formats_holds_this_table() {
        let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/formats.md");
        let text = std::fs::read_to_string(page).unwrap();
        let (before, rest) = text.split_once("<!-- arrays -->\n").unwrap();
        let (table, after) = rest.split_once("<!-- end of arrays -->").unwrap();
        if std::env::var_os("STRANDFLOW_WRITE_DOCS").is_some() {
            let new = format!("{before}<!-- arrays -->\n{}<!-- end of arrays -->{after}", markdown_table());
            std::fs::write(page, new).unwrap();
        } else {
            assert_eq!(table, markdown_table(), "set STRANDFLOW_WRITE_DOCS=1 to write docs/formats.md anew");
        }
    }
}
