//! Stage 8: strands grown from the roots through the line field.
//!
//! From each root a strand follows the field's lines in steps of second order; the tensors d dᵀ are interpolated, not the
//! vectors, so that opposite signs of one line do not cancel. A line has two directions: the one of smaller angle to the
//! previous step is taken. Reference: Paris et al. 2008, section 6; Zhang et al. 2012, section 4.

mod carry;

use glam::{DVec3, Vec3, Vec4};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use strandflow_core::{Place, Provenance, Report, RigidTransform, SparseVoxels, Strands, grid::floor};
use strandflow_geometry::order::map_places;
use strandflow_volume::{tensor::Tensor, velocity::VoxelIndex};

use crate::{Mode, SettingViolation, StageError, field::FieldVoxel, grow::carry::Carrier};

/// What one frame needs.
pub struct GrowInput<'a> {
    /// The frame, for messages.
    pub frame: usize,
    /// The line field.
    pub field: &'a SparseVoxels<FieldVoxel>,
    /// Roots in head space \[mm\].
    pub roots: &'a [DVec3],
    /// Outward normals at the roots, head space.
    pub normals: &'a [DVec3],
    /// The head's motion.
    pub world_from_head: RigidTransform,
    /// Gravity \[mm/s²\], world.
    pub gravity: DVec3,
    /// The frame before, for strands that follow the same hair; `None` in the first frame.
    pub before: Option<Before<'a>>,
}

/// The strands of the frame before and how the hair moved since.
pub struct Before<'a> {
    /// What grew there, numbered like the roots.
    pub strands: &'a Strands,
    /// Displacement since then \[mm\], on the voxels of this frame's hair volume.
    pub motion: &'a SparseVoxels<Vec3>,
    /// The head's motion in the frame before.
    pub world_from_head: RigidTransform,
}

/// Settings of stage `grow`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GrowSettings {
    /// Arc length between points \[mm\].
    pub step_mm: f64,
    /// Longest strand \[mm\].
    pub max_length_mm: f64,
    /// Shortest strand that is kept \[mm\].
    pub min_length_mm: f64,
    /// How far a strand may run outside the hair volume before it ends \[mm\], robust mode; that piece is cut off again.
    pub gap_mm: f64,
    /// Least agreement of the lines around a point, 0 to 1, at which a strand goes on.
    pub min_purity: f32,
    /// Sharpest turn in one step \[degrees\].
    pub max_turn_deg: f32,
    /// How much of the previous direction enters the next one, 0 to below 1, robust mode.
    pub inertia: f32,
    /// Cosine between a step and the border's outward normal up to which the step is turned along the border instead of
    /// leaving, robust mode: 0.5 keeps strands that graze the hull and ends those that meet the hair's lower edge.
    pub slant: f32,
    /// Length over which a strand turns from the scalp's normal into the field \[mm\], robust mode.
    pub root_mm: f32,
    /// How much the strand of the frame before, carried by the motion, draws the new one, 0 to below 1, robust mode;
    /// 0 grows every frame by itself.
    pub follow: f32,
    /// The way within which a growing strand beside the carried one comes back to it \[mm\].
    pub aim_mm: f64,
    /// How much longer than the carried strand a strand may grow \[mm a frame\].
    pub extend_mm: f64,
}

impl Default for GrowSettings {
    fn default() -> Self {
        Self {
            step_mm: 2.0,
            max_length_mm: 600.0,
            min_length_mm: 20.0,
            gap_mm: 6.0,
            min_purity: 0.15,
            max_turn_deg: 40.0,
            inertia: 0.3,
            slant: 0.5,
            root_mm: 6.0,
            follow: 0.75,
            aim_mm: 8.0,
            extend_mm: 4.0,
        }
    }
}

impl GrowSettings {
    /// All violations.
    pub fn check(&self) -> Vec<SettingViolation> {
        let mut found = Vec::new();
        let mut unless = |ok, field: &str, value: f64, range: &str, reason: &str| {
            SettingViolation::unless(ok, &mut found, (field, value), (range, reason));
        };
        let [purity, turn, inertia] = [self.min_purity, self.max_turn_deg, self.inertia].map(f64::from);
        let [slant, root] = [self.slant, self.root_mm].map(f64::from);
        let (step, longest, shortest) = (self.step_mm, self.max_length_mm, self.min_length_mm);
        unless((0.1..=20.0).contains(&step), "grow.step_mm", step, "0.1..=20", "about a voxel");
        unless((step..=5000.0).contains(&longest), "grow.max_length_mm", longest, "step_mm..=5000", "hair is shorter");
        unless(
            (0.0..=longest).contains(&shortest),
            "grow.min_length_mm",
            shortest,
            "0..=max_length_mm",
            "else none is left",
        );
        unless((0.0..=100.0).contains(&self.gap_mm), "grow.gap_mm", self.gap_mm, "0..=100", "a gap, not a strand");
        unless((0.0..1.0).contains(&purity), "grow.min_purity", purity, "0..1", "1 is a pure line");
        unless((1.0..=90.0).contains(&turn), "grow.max_turn_deg", turn, "1..=90", "beyond 90° a line turns back");
        unless((0.0..1.0).contains(&inertia), "grow.inertia", inertia, "0..1", "1 never turns");
        unless((0.0..=1.0).contains(&slant), "grow.slant", slant, "0..=1", "a cosine");
        unless((0.0..=100.0).contains(&root), "grow.root_mm", root, "0..=100", "hair lies down within centimetres");
        let follow = f64::from(self.follow);
        unless((0.0..1.0).contains(&follow), "grow.follow", follow, "0..1", "1 would see nothing of this frame");
        unless((step..=200.0).contains(&self.aim_mm), "grow.aim_mm", self.aim_mm, "step_mm..=200", "it aims ahead");
        unless((0.0..=1e4).contains(&self.extend_mm), "grow.extend_mm", self.extend_mm, "0..=10000", "a length");
        found
    }

    /// The most points a strand can have.
    pub fn max_points(&self) -> usize {
        (self.max_length_mm / self.step_mm).ceil() as usize + 1
    }
}

/// One strand a root (empty where none could be grown), in the order of the roots.
pub fn grow(
    input: &GrowInput,
    mode: Mode,
    settings: &GrowSettings,
    report: &mut Report,
) -> Result<Strands, StageError> {
    check_input(input)?;
    let field = LineField::new(input.field);
    let grower = Grower { field, mode, settings, down: input.gravity.as_vec3().normalize_or_zero() };
    let carrier = input.before.as_ref().filter(|_| mode == Mode::Robust && settings.follow > 0.0);
    let carrier = carrier.map(|before| Carrier::new(before, input.world_from_head));
    let roots: Vec<Vec3> = input.roots.iter().map(|root| input.world_from_head.point(*root).as_vec3()).collect();
    let grown: Vec<Grown> = map_places(&roots, |i| {
        let normal = input.world_from_head.vector(input.normals[i]).as_vec3().normalize_or_zero();
        let carried = carrier.as_ref().map(|carrier| carrier.carried(i)).unwrap_or_default();
        grower.grow(roots[i], normal, &carried)
    });
    let mut strands = Strands::new();
    grown.iter().for_each(|strand| strands.push(&strand.points, &strand.provenance, &strand.confidence));

    let empty = grown.iter().filter(|strand| strand.points.is_empty()).count();
    if 2 * empty > grown.len() {
        let fact = format!("{empty} of {} roots grew no strand", grown.len());
        report.warn(Place::frame(input.frame), fact, "most of the hair is missing in this frame");
    }
    Ok(strands)
}

fn check_input(input: &GrowInput) -> Result<(), StageError> {
    let place = Place::frame(input.frame);
    if input.roots.len() != input.normals.len() {
        let fact = format!("{} roots but {} normals", input.roots.len(), input.normals.len());
        return Err(StageError::Input { place, fact, hint: "run the scalp stage again".into() });
    }
    let strand = (0..input.roots.len()).find(|&i| !input.roots[i].is_finite() || !input.normals[i].is_finite());
    match strand {
        Some(_) => Err(StageError::NonFinite { place: Place { strand, ..place }, what: "a root or its normal".into() }),
        None => Ok(()),
    }
}

/// A strand while it grows.
#[derive(Default)]
struct Grown {
    points: Vec<Vec3>,
    provenance: Vec<Provenance>,
    confidence: Vec<f32>,
}

impl Grown {
    fn push(&mut self, point: Vec3, sample: Option<&Sample>) {
        let observed = sample.is_some_and(|sample| sample.observed);
        self.points.push(point);
        self.provenance.push(if observed { Provenance::Observed } else { Provenance::Diffused });
        self.confidence.push(sample.map_or(0.0, |sample| sample.trust));
    }

    fn truncate(&mut self, len: usize) {
        self.points.truncate(len);
        self.provenance.truncate(len);
        self.confidence.truncate(len);
    }
}

/// What the field says at a point.
struct Sample {
    direction: Vec3,
    purity: f32,
    trust: f32,
    observed: bool,
}

struct LineField {
    voxels: Vec<Voxel>,
    lookup: VoxelIndex,
}

/// What is interpolated between voxels, on one half of a cache line.
#[derive(Clone, Copy)]
#[repr(align(32))]
struct Voxel {
    /// The line's tensor: xx, yy, zz, xy.
    first: Vec4,
    /// Its xz and yz, the trust, and 1 where the line was observed.
    second: Vec4,
}

impl Voxel {
    fn new(voxel: &FieldVoxel) -> Self {
        let Tensor([xx, yy, zz, xy, xz, yz]) = Tensor::of_line(voxel.direction);
        let observed = if voxel.observed { 1.0 } else { 0.0 };
        Self { first: Vec4::new(xx, yy, zz, xy), second: Vec4::new(xz, yz, voxel.trust, observed) }
    }
}

impl LineField {
    fn new(field: &SparseVoxels<FieldVoxel>) -> Self {
        Self { voxels: field.values.par_iter().map(Voxel::new).collect(), lookup: VoxelIndex::of_sparse(field) }
    }

    /// The interpolated line at a point, turned towards `previous`; `None` outside the hair volume.
    fn at(&self, point: Vec3, previous: Vec3) -> Option<Sample> {
        let c = self.lookup.grid.continuous(point.as_dvec3()) - 0.5;
        let base = c.to_array().map(floor);
        let f = (c - DVec3::from_array(base.map(|b| b as f64))).as_vec3();
        let (mut first, mut second, mut weight) = (Vec4::ZERO, Vec4::ZERO, 0.0);
        for (corner, rank) in self.lookup.corners(base).into_iter().enumerate() {
            let Some(rank) = rank else { continue };
            let side = |axis: usize| if corner >> axis & 1 == 1 { f[axis] } else { 1.0 - f[axis] };
            let share = side(0) * side(1) * side(2);
            first += self.voxels[rank].first * share;
            second += self.voxels[rank].second * share;
            weight += share;
        }
        let sum = Tensor([first.x, first.y, first.z, first.w, second.x, second.y]);
        // Less than a third of the surrounding weight: outside.
        (weight > 0.33 && sum.trace() > 1e-6).then_some(())?;
        let normalised = sum * (1.0 / sum.trace());
        let (line, purity) =
            normalised.principal(previous.lerp(normalised.rough_direction(), 0.5).normalize_or(Vec3::X));
        let direction = if line.dot(previous) < 0.0 { -line } else { line };
        Some(Sample { direction, purity, trust: second.z / weight, observed: second.w > 0.5 * weight })
    }

    /// The voxel at a point.
    fn voxel_at(&self, point: Vec3) -> [i64; 3] {
        self.lookup.grid.continuous(point.as_dvec3()).to_array().map(floor)
    }

    /// Whether the voxel at a point belongs to the hair volume.
    fn contains(&self, point: Vec3) -> bool {
        self.lookup.holds(self.voxel_at(point))
    }

    /// The direction towards the inside of the hair volume at its border: from the centre of the 5³ voxels around a point
    /// to the centroid of those within.
    fn inwards(&self, point: Vec3) -> Option<Vec3> {
        let [x, y, z] = self.voxel_at(point);
        let mut sum = Vec3::ZERO;
        for [j, k] in (0..25).map(|i| [i % 5 - 2, i / 5 - 2]) {
            let row = self.lookup.row_bits([x - 2, y + j, z + k], 5);
            let along: i64 = (0..5).filter(|i| row >> i & 1 == 1).map(|i| i - 2).sum();
            sum += Vec3::new(along as f32, 0.0, 0.0) + Vec3::new(0.0, j as f32, k as f32) * row.count_ones() as f32;
        }
        sum.try_normalize()
    }
}

/// Points to either side over which the carried strand's direction is taken: a kink would live on from frame to frame.
const ALONG: usize = 2;
/// The sharpest bend of a strand that follows: its radius \[mm\].
const BEND_MM: f32 = 6.0;

struct Grower<'a> {
    field: LineField,
    mode: Mode,
    settings: &'a GrowSettings,
    down: Vec3,
}

/// Where a strand has got to.
struct Head {
    at: Vec3,
    direction: Vec3,
    /// Arc length from the root \[mm\].
    arc: f32,
    /// Whether the last step was turned along the border.
    slid: bool,
}

impl Grower<'_> {
    /// A strand from a root, drawn by the carried one (no points where there is none).
    fn grow(&self, root: Vec3, normal: Vec3, carried: &[Vec3]) -> Grown {
        let step = self.settings.step_mm as f32;
        let robust_gap =
            if self.mode == Mode::Robust { (self.settings.gap_mm / self.settings.step_mm) as usize } else { 0 };
        let mut strand = Grown::default();
        let mut head = Head { at: root, direction: normal, arc: 0.0, slid: false };
        let mut outside = 0usize;
        while strand.points.len() < self.most_points(carried) {
            let aim = self.aim(&head, carried);
            let facing = self.facing(&head, normal, aim);
            let sample = self.field.at(head.at, facing);
            outside = if sample.is_some() { 0 } else { outside + 1 };
            strand.push(head.at, sample.as_ref());
            // A root may lie up to three steps off the volume: scalp and hull are right to a voxel.
            let gap = robust_gap.max(if head.arc < 4.0 * step { 3 } else { 0 });
            if outside > gap {
                break;
            }
            let Some(next) = self.next_direction(&head, normal, facing, sample, aim) else { break };
            (head.direction, head.slid) = self.kept_inside(&head, self.drawn(&head, next, aim));
            head.at += head.direction * step;
            head.arc += step;
        }
        // The piece beyond the last point inside was only a hope.
        strand.truncate(strand.points.len() - outside);
        if (strand.points.len() as f32 - 1.0) * step < self.settings.min_length_mm as f32 {
            strand.truncate(0);
        }
        strand
    }

    /// The most points that a strand may get: little more than it had in the frame before.
    fn most_points(&self, carried: &[Vec3]) -> usize {
        let most = self.settings.max_points();
        let more = (self.settings.extend_mm / self.settings.step_mm) as usize;
        if carried.is_empty() { most } else { most.min(carried.len() + more) }
    }

    /// The carried strand's direction here, turned so that a growing strand beside it comes back to it within `aim_mm`;
    /// `None` beyond its end. A chord to a point ahead would cut the corners of curved hair, a little more in every frame.
    fn aim(&self, head: &Head, carried: &[Vec3]) -> Option<Vec3> {
        let here = (head.arc / self.settings.step_mm as f32).round() as usize;
        let from = *carried.get(here)?;
        carried.get(here + 1)?;
        let (first, last) = (here.saturating_sub(ALONG), (here + 1 + ALONG).min(carried.len() - 1));
        let tangent = (carried[last] - carried[first]).try_normalize()?;
        let aside = (from - head.at).reject_from_normalized(tangent) / self.settings.aim_mm as f32;
        (tangent + aside.clamp_length_max(1.0)).try_normalize()
    }

    /// A direction drawn towards the carried strand, where there is one.
    fn drawn(&self, head: &Head, direction: Vec3, aim: Option<Vec3>) -> Vec3 {
        match aim {
            Some(aim) => {
                let drawn = direction.lerp(aim, self.settings.follow).normalize_or(direction);
                turned_at_most(head.direction, drawn, self.settings.step_mm as f32 / BEND_MM)
            }
            None => direction,
        }
    }

    /// The direction towards which a line is turned. Close to the root, where the normal is across the lines and does not
    /// decide between their two ends, hair falls.
    fn facing(&self, head: &Head, normal: Vec3, aim: Option<Vec3>) -> Vec3 {
        if let Some(aim) = aim {
            return (head.direction + aim).normalize_or(head.direction);
        }
        if self.mode == Mode::Paper || head.arc > self.settings.root_mm {
            return head.direction;
        }
        (head.direction + 0.5 * self.down.reject_from(normal)).normalize_or(head.direction)
    }

    /// The direction of the next step: the midpoint rule, blended with the previous direction; near the root a turn from
    /// the normal into the field. `None` where the lines around do not agree or turn too sharply.
    fn next_direction(
        &self,
        head: &Head,
        normal: Vec3,
        facing: Vec3,
        here: Option<Sample>,
        aim: Option<Vec3>,
    ) -> Option<Vec3> {
        let step = self.settings.step_mm as f32;
        let near_root = head.arc < self.settings.root_mm && self.mode == Mode::Robust;
        let Some(here) = here else {
            let back = if near_root { self.field.inwards(head.at) } else { None };
            return Some(back.unwrap_or(head.direction));
        };
        let middle = head.at + here.direction * (0.5 * step);
        let midpoint = self.field.at(middle, facing).unwrap_or(here);
        if head.arc == 0.0 && self.mode == Mode::Paper {
            return Some(normal);
        }
        if near_root {
            let s = (head.arc + step) / (self.settings.root_mm + step);
            let lifted = (normal * (1.0 - s) + midpoint.direction * s).normalize_or(normal);
            let stays = self.field.contains(head.at + lifted * step);
            return Some(if stays { lifted } else { midpoint.direction });
        }
        // The paper ends a strand at its greatest length and at the volume's border, nowhere else; its second step turns
        // from the normal into the field by any angle.
        if self.mode == Mode::Paper {
            return Some(midpoint.direction);
        }
        if aim.is_some() {
            // Where the lines do not agree the carried strand leads on.
            let doubt = (1.0 - midpoint.purity / self.settings.min_purity.max(1e-6)).clamp(0.0, 1.0);
            let inertia = self.settings.inertia + (1.0 - self.settings.inertia) * doubt;
            return Some(midpoint.direction.lerp(head.direction, inertia).normalize_or(head.direction));
        }
        (midpoint.purity >= self.settings.min_purity).then_some(())?;
        let turn = midpoint.direction.dot(head.direction);
        (head.slid || turn >= self.settings.max_turn_deg.to_radians().cos()).then_some(())?;
        let inertia = self.settings.inertia;
        Some((midpoint.direction * (1.0 - inertia) + head.direction * inertia).normalize_or(head.direction))
    }

    /// A step that would leave the hair volume at a slant is turned along its border (scalp or hull: hair neither enters the
    /// head nor leaves the hull); one that leaves it straight is left alone: there the hair ends. Second: whether it turned.
    fn kept_inside(&self, head: &Head, direction: Vec3) -> (Vec3, bool) {
        let step = self.settings.step_mm as f32;
        let leaves = |d: Vec3| !self.field.contains(head.at + d * step);
        if self.mode == Mode::Paper || !leaves(direction) {
            return (direction, false);
        }
        let Some(inwards) = self.field.inwards(head.at + direction * step) else { return (direction, false) };
        let lean = -direction.dot(inwards);
        if lean > self.settings.slant {
            return (direction, false);
        }
        let pushes = [0.1, 0.4, 0.8].map(|push| (direction + inwards * (lean.max(0.0) + push)).normalize_or(direction));
        pushes.into_iter().find(|&d| !leaves(d)).map_or((direction, false), |d| (d, true))
    }
}

/// `to`, or the direction on the way there from `from` that lies `most` radians off it.
fn turned_at_most(from: Vec3, to: Vec3, most: f32) -> Vec3 {
    let cosine = from.dot(to).clamp(-1.0, 1.0);
    match (to - from * cosine).try_normalize() {
        Some(side) if cosine < most.cos() => from * most.cos() + side * most.sin(),
        _ => to,
    }
}
