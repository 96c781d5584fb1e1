//! Hair cards: a ribbon along each guide, as wide as the strands it stands for, in one OBJ a frame or one animated USD mesh.
//!
//! A card has two vertices a point of its guide; u runs from 0 to 1 across it and v from 0 at the root to 1 at the tip by
//! length. Its width is that of a flat tuft with the strands' spread. Normals point away from the head, whose centre is that
//! of the sphere through the roots of the frame; faces are quads, anticlockwise seen from outside.
//!
//! OBJ states neither unit nor axes; they are those of the options' [`Space`](crate::Space).

use std::{io::Write, path::Path};

use glam::{Vec2, Vec3};

use crate::{
    IoError,
    guides::{Guides, PLACES},
    root_uv::sphere_centre,
    scene::{Scene, SceneOptions},
    strands::StrandFrames,
    usd::{CardMesh, CardSample, write_cards},
    whole_file::write_whole,
};

/// Cards of a sequence of strands.
pub struct Cards<'a> {
    scene: Scene<'a>,
    guides: &'a Guides,
}

/// A card of a frame: vertices left and right of each point of the guide, root first.
struct Card {
    points: Vec<[Vec3; 2]>,
    normals: Vec<Vec3>,
    uvs: Vec<[Vec2; 2]>,
}

impl<'a> Cards<'a> {
    /// Cards along these guides of these strands; `path` is what errors name.
    ///
    /// # Errors
    /// No strand takes part, or a frame cannot be read.
    pub fn new(
        path: &Path,
        strands: &'a dyn StrandFrames,
        guides: &'a Guides,
        options: &SceneOptions,
    ) -> Result<Self, IoError> {
        Ok(Self { scene: Scene::new(path, strands, &SceneOptions { velocities: false, ..*options })?, guides })
    }

    /// Frame numbers.
    pub fn frames(&self) -> &[u32] {
        self.scene.curves.frames()
    }

    /// Writes the cards of the `t`-th frame.
    ///
    /// # Errors
    /// The frame cannot be read, or the file cannot be written; the file is then as it was before.
    pub fn write_obj(&self, path: &Path, t: usize) -> Result<(), IoError> {
        let cards = self.of_frame(t)?;
        let unit = self.scene.options.space.unit_name();
        write_whole(path, |out| Ok(write_to(out, &cards, &self.guides.strands, &unit)?))
    }

    /// Writes the cards of all frames as one animated USD mesh; the ending of the file decides the form. Memory: a few frames.
    ///
    /// # Errors
    /// The ending is none of USD's, a frame cannot be read, or the file cannot be written; the file is then as it was before.
    pub fn write_usd(&self, path: &Path) -> Result<(), IoError> {
        let first = self.of_frame(0)?;
        // The guides of cards that were made, in their order.
        let drawn = self.guides.strands.iter().filter(|strand| self.scene.curves.strands.binary_search(strand).is_ok());
        let mesh = CardMesh {
            head: &self.scene,
            rows: first.iter().map(|card| card.points.len()).collect(),
            strands: drawn.map(|&strand| strand as i32).collect(),
            uvs: first.iter().flat_map(|card| card.uvs.iter().flatten().copied()).collect(),
        };
        write_cards(path, &mesh, |t| {
            let cards = self.of_frame(t)?;
            Ok(CardSample {
                points: cards.iter().flat_map(|card| card.points.iter().flatten().copied()).collect(),
                normals: cards.iter().flat_map(|card| card.normals.iter().flat_map(|n| [*n, *n])).collect(),
            })
        })
    }

    fn of_frame(&self, t: usize) -> Result<Vec<Card>, IoError> {
        let points = self.scene.sample(t)?.points;
        let ranges = self.scene.curves.ranges();
        let roots: Vec<Vec3> = ranges.iter().map(|range| points[range.start]).collect();
        let centre = sphere_centre(&roots).as_vec3();
        let per_mm = (1.0 / self.scene.options.space.unit_mm) as f32;
        let strands = self.guides.strands.iter().zip(&self.guides.spread);
        let card = |(strand, spread): (&u32, &[f32; PLACES])| {
            let curve = self.scene.curves.strands.binary_search(strand).ok()?;
            let half = spread.map(|spread| (spread * HALF_WIDTH * per_mm).max(self.scene.width() * 0.5));
            Some(Card::along(&points[ranges[curve].clone()], centre, &half))
        };
        Ok(strands.filter_map(card).collect())
    }
}

/// Strands spread evenly over a flat tuft of half width h lie h/√3 from its middle (root mean square); of a spread r about the
/// guide, half the square is along the card.
const HALF_WIDTH: f32 = 1.224_744_9;

/// Sine of the angle between a strand and the way out of the head below which the way out does not tell how the card lies, as
/// it is near the root; the card then lies as it does on the whole.
const ENOUGH_ANGLE: f32 = 0.2;

impl Card {
    fn along(guide: &[Vec3], centre: Vec3, half: &[f32; PLACES]) -> Self {
        let last = guide.len() - 1;
        let tangents: Vec<Vec3> = (0..=last)
            .map(|at| (guide[(at + 1).min(last)] - guide[at.saturating_sub(1)]).normalize_or(Vec3::NEG_Z))
            .collect();
        let sides: Vec<Vec3> =
            guide.iter().zip(&tangents).map(|(p, t)| t.cross((p - centre).normalize_or(Vec3::Z))).collect();
        let fallback = tangents[0].any_orthonormal_vector();
        let on_the_whole = sides.iter().sum::<Vec3>().normalize_or(fallback);
        let lengths = along(guide);
        let mut card = Self { points: Vec::new(), normals: Vec::new(), uvs: Vec::new() };
        for (at, (&point, &tangent)) in guide.iter().zip(&tangents).enumerate() {
            let side = sides[at] + ENOUGH_ANGLE * on_the_whole;
            let side = side.reject_from_normalized(tangent).normalize_or(tangent.any_orthonormal_vector());
            let half = at_place(half, at as f32 / last as f32);
            card.points.push([point - side * half, point + side * half]);
            card.normals.push(side.cross(tangent));
            card.uvs.push([Vec2::new(0.0, lengths[at]), Vec2::new(1.0, lengths[at])]);
        }
        card
    }
}

/// Part of the length before each point; by number where there is no length.
fn along(points: &[Vec3]) -> Vec<f32> {
    let mut lengths = vec![0.0];
    points.windows(2).for_each(|pair| lengths.push(lengths[lengths.len() - 1] + pair[0].distance(pair[1])));
    let (whole, last) = (lengths[points.len() - 1], (points.len() - 1) as f32);
    lengths.iter().enumerate().map(|(at, l)| if whole > 0.0 { l / whole } else { at as f32 / last }).collect()
}

/// A value between those at the places along a strand; `part` from 0 to 1.
fn at_place(values: &[f32; PLACES], part: f32) -> f32 {
    let at = part.clamp(0.0, 1.0) * (PLACES - 1) as f32;
    let place = (at as usize).min(PLACES - 2);
    values[place] + (values[place + 1] - values[place]) * (at - place as f32)
}

fn write_to(out: &mut impl Write, cards: &[Card], strands: &[u32], unit: &str) -> std::io::Result<()> {
    writeln!(out, "# strandflow hair cards, {unit}; a group a card, named by its guide's strand")?;
    // OBJ counts vertices from 1 over the whole file.
    let mut first = 1;
    for (card, strand) in cards.iter().zip(strands) {
        writeln!(out, "g card{strand}")?;
        for p in card.points.iter().flatten() {
            writeln!(out, "v {} {} {}", p.x, p.y, p.z)?;
        }
        for uv in card.uvs.iter().flatten() {
            writeln!(out, "vt {} {}", uv.x, uv.y)?;
        }
        for n in card.normals.iter().flat_map(|n| [n, n]) {
            writeln!(out, "vn {} {} {}", n.x, n.y, n.z)?;
        }
        for row in 0..card.points.len() - 1 {
            let left = first + 2 * row;
            let corner = |at: usize| format!("{at}/{at}/{at}");
            let [a, b, c, d] = [left, left + 1, left + 3, left + 2].map(corner);
            writeln!(out, "f {a} {b} {c} {d}")?;
        }
        first += 2 * card.points.len();
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use strandflow_core::{Provenance, StrandSequence};

    use super::*;

    /// Tufts around a sphere of 100 mm, of strands that hang down 10 mm outside it.
    fn head() -> StrandSequence {
        let mut sequence = StrandSequence::missing(vec![0, 1], vec![6; 160], 6);
        for t in 0..2 {
            for n in 0..160 {
                let (tuft, member) = (n / 10, n % 10);
                let around = tuft as f32 * std::f32::consts::TAU / 16.0 + (member as f32 - 4.5) * 0.01;
                let height = 0.2 + 0.6 * (n * 37 % 160) as f32 / 160.0;
                let ring = (1.0f32 - height * height).sqrt();
                for (p, at) in sequence.range(t, n).enumerate() {
                    let root = Vec3::new(ring * around.cos(), ring * around.sin(), height) * 100.0;
                    let out = Vec3::new(around.cos(), around.sin(), 0.0) * if p > 0 { 110.0 } else { 0.0 };
                    let hang = Vec3::new(0.0, 0.0, 20.0 - 30.0 * p as f32);
                    sequence.points[at] = if p == 0 { root } else { out + hang };
                    sequence.provenance[at] = Provenance::Observed;
                }
            }
        }
        sequence
    }

    #[test]
    fn cards_face_outward_are_as_wide_as_their_tuft_and_have_whole_uvs() {
        let sequence = head();
        let guides = Guides::of(&sequence, 16).unwrap();
        let cards = Cards::new(Path::new("a"), &sequence, &guides, &SceneOptions::default()).unwrap();
        let of_frame = cards.of_frame(1).unwrap();
        assert_eq!(of_frame.len(), 16);
        let mut widths = Vec::new();
        for card in &of_frame {
            let middle = |at: usize| (card.points[at][0] + card.points[at][1]) * 0.5;
            for at in 1..6 {
                let outward = Vec3::new(middle(at).x, middle(at).y, 0.0).normalize();
                assert!(card.normals[at].dot(outward) > 0.5, "{at}: {}", card.normals[at]);
                let [left, right] = card.points[at];
                let below = if at < 5 { middle(at + 1) - middle(at) } else { middle(at) - middle(at - 1) };
                assert!((right - left).cross(below).dot(outward) > 0.0, "the face's own normal points outward too");
                widths.push(left.distance(right));
            }
            assert_eq!((card.uvs[0], card.uvs[5]), ([Vec2::ZERO, Vec2::X], [Vec2::Y, Vec2::ONE]));
        }
        // Ten strands at steps of 1.1 mm, 11 mm as a flat tuft; clusters need not be the tufts one for one.
        widths.sort_by(f32::total_cmp);
        assert!((5.0..14.0).contains(&widths[widths.len() / 2]), "{widths:?}");
    }

    #[test]
    fn a_file_has_every_vertex_and_quad_and_faces_name_them() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.obj");
        let sequence = head();
        let guides = Guides::of(&sequence, 16).unwrap();
        let cards = Cards::new(&path, &sequence, &guides, &SceneOptions::default()).unwrap();
        cards.write_obj(&path, 0).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let count = |start: &str| text.lines().filter(|line| line.starts_with(start)).count();
        assert_eq!(["g ", "v ", "vt ", "vn ", "f "].map(count), [16, 192, 192, 192, 80]);
        let largest = text.lines().filter_map(|line| line.strip_prefix("f ")).flat_map(|f| f.split([' ', '/']));
        assert_eq!(largest.map(|n| n.parse::<usize>().unwrap()).max(), Some(192));
        assert!(cards.write_obj(&dir.path().join("none/a.obj"), 0).is_err());
    }

    const SCRIPT: &str = r#"
import sys
from pxr import Usd, UsdGeom
stage = Usd.Stage.Open(sys.argv[1])
mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/hair/cards"))
points, normals = mesh.GetPointsAttr(), mesh.GetNormalsAttr()
counts, corners = mesh.GetFaceVertexCountsAttr().Get(), mesh.GetFaceVertexIndicesAttr().Get()
print("stage", UsdGeom.GetStageMetersPerUnit(stage), UsdGeom.GetStageUpAxis(stage), stage.GetStartTimeCode(), stage.GetEndTimeCode())
print("faces", len(counts), set(counts), min(corners), max(corners), list(corners[:8]), mesh.GetSubdivisionSchemeAttr().Get(),
      mesh.GetDoubleSidedAttr().Get())
print("valid", UsdGeom.Mesh.ValidateTopology(corners, counts, len(points.Get(0)))[0])
print("samples", points.GetTimeSamples(), [len(points.Get(t)) for t in points.GetTimeSamples()], len(normals.Get(1)),
      mesh.GetNormalsInterpolation())
api = UsdGeom.PrimvarsAPI(mesh.GetPrim())
st, strand = api.GetPrimvar("st"), api.GetPrimvar("strand")
print("st", st.GetInterpolation(), st.GetTypeName(), len(st.Get()), [tuple(uv) for uv in st.Get()[:2]], tuple(st.Get()[11]),
      len(st.GetAttr().GetTimeSamples()))
print("strand", strand.GetInterpolation(), len(strand.Get()), len(set(strand.Get())))
print("extent", all(a <= b for a, b in zip(*mesh.GetExtentAttr().Get(1))))
"#;

    const EXPECTED: &str = "stage 0.01 Z 0.0 1.0
faces 80 {4} 0 191 [0, 1, 3, 2, 2, 3, 5, 4] none True
valid True
samples [0.0, 1.0] [192, 192] 192 vertex
st vertex texCoord2f[] 192 [(0.0, 0.0), (1.0, 0.0)] (1.0, 1.0) 0
strand uniform 80 16
extent True";

    #[test]
    fn the_reference_library_reads_cards_as_one_animated_mesh() {
        let dir = tempfile::tempdir().unwrap();
        let sequence = head();
        let guides = Guides::of(&sequence, 16).unwrap();
        let space = crate::Target::Unreal.space(crate::Carrier::Usd);
        let options = SceneOptions { space, ..SceneOptions::default() };
        let cards = Cards::new(Path::new("a"), &sequence, &guides, &options).unwrap();
        for name in ["a.usda", "a.usdc", "a.usd"] {
            let path = dir.path().join(name);
            cards.write_usd(&path).unwrap();
            let Some(said) = crate::strands::ask_python(SCRIPT, &path) else { return };
            assert_eq!(said.trim(), EXPECTED, "{name}");
        }
        assert!(cards.write_usd(&dir.path().join("a.obj")).unwrap_err().to_string().contains("is no USD file name"));
    }
}
