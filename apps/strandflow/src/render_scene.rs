//! What `strandflow render` shows: strands, head, cameras and backdrops of a take.

use std::rc::Rc;

use glam::{DVec3, Vec3};
use strandflow_core::{Camera, RigidTransform, StrandSequence, TriMesh};
use strandflow_engine::{Take, animation::AnimationStrands};
use strandflow_io::{StrandFrames, read_calibration};
use strandflow_render::{Backdrop, Hair, HairColour, Head, MAX_SIDE, colour::linear_of_srgb, resized, turntable};

use crate::{args::RenderArgs, failure::Failed};

/// Size of a picture whose camera has none \[px\].
const SIZE: [usize; 2] = [960, 960];

/// One picture to make.
pub struct Shot {
    /// Index of the frame in the strands.
    pub t: usize,
    /// The camera.
    pub camera: Camera,
}

/// What goes behind the hair.
pub enum Background {
    /// The same in every picture.
    Fixed(Backdrop),
    /// The footage of a view, frame by frame.
    Footage(usize),
    /// Nothing: the picture keeps its coverage.
    Nothing,
}

/// The head's surface, where the take has one, and its motion.
pub struct HeadOf<'a> {
    take: &'a Take,
    mesh: Option<TriMesh>,
    /// Whose head moves otherwise than the take's.
    animation: Option<&'a AnimationStrands<'a>>,
}

impl<'a> HeadOf<'a> {
    /// Of a take.
    pub fn new(take: &'a Take) -> Self {
        let mesh = take.read_scalp().ok().map(|scalp| scalp.mesh).filter(|mesh| !mesh.faces.is_empty());
        Self { take, mesh, animation: None }
    }

    /// Of an animation.
    pub fn animated(take: &'a Take, strands: &'a AnimationStrands<'a>) -> Self {
        Self { animation: Some(strands), ..Self::new(take) }
    }

    /// The head in a frame.
    pub fn at(&self, frame: usize) -> Option<Head<'_>> {
        let pose = |frame: usize| {
            let pose = match self.animation {
                Some(strands) => strands.world_from_head(frame).ok(),
                None => self.take.frames().contains(frame).then(|| self.take.read_pose(frame).ok()).flatten(),
            };
            pose.filter(|p: &RigidTransform| p.rotation.is_finite() && p.translation.is_finite())
        };
        let world_from_head = pose(frame)?;
        // At the end the motion is that of the frame before.
        let next = pose(frame + 1);
        let before = frame.checked_sub(1).and_then(pose);
        let next_world_from_head =
            next.or_else(|| Some(world_from_head.after(&before?.inverse()).after(&world_from_head)));
        let next_world_from_head = next_world_from_head.unwrap_or(world_from_head);
        Some(Head { mesh: self.mesh.as_ref()?, world_from_head, next_world_from_head })
    }
}

/// Strands frame by frame with their motion. The frames that the last picture looked at are kept: most pictures share two
/// of their three with the one before.
pub struct Moments<'a> {
    strands: &'a dyn StrandFrames,
    /// Frames by their index, at most three.
    kept: Vec<(usize, Rc<StrandSequence>)>,
}

impl<'a> Moments<'a> {
    /// Nothing read yet.
    pub fn new(strands: &'a dyn StrandFrames) -> Self {
        Self { strands, kept: Vec::new() }
    }

    /// The strands of the `t`-th frame with their motion; parts of strands that the frame lacks are left out.
    pub fn hair(&mut self, t: usize) -> Result<Hair, Failed> {
        self.kept.retain(|(other, _)| other.abs_diff(t) <= 1);
        let now = self.frame(t)?;
        let numbers = self.strands.frames();
        let (number, frames) = (numbers[t], numbers.len());
        let follows = |a: usize, b: usize| numbers[a].checked_add(1) == Some(numbers[b]);
        let before = t.checked_sub(1).filter(|&before| follows(before, t));
        let after = Some(t + 1).filter(|&after| after < frames && follows(t, after));
        let before = before.map(|t| self.frame(t)).transpose()?;
        let after = after.map(|t| self.frame(t)).transpose()?;
        let hair = moving(&now, [before.as_deref(), after.as_deref()]);
        if hair.strand_count() == 0 {
            return Err(Failed::input(format!("frame {number} has no strands"), "name other frames, or another stage"));
        }
        Ok(hair)
    }

    fn frame(&mut self, t: usize) -> Result<Rc<StrandSequence>, Failed> {
        if let Some((_, frame)) = self.kept.iter().find(|(other, _)| *other == t) {
            return Ok(frame.clone());
        }
        let frame = Rc::new(self.strands.frame(t)?);
        self.kept.push((t, frame.clone()));
        Ok(frame)
    }
}

/// The strands of a frame, moving as the frames beside it say.
fn moving(now: &StrandSequence, [before, after]: [Option<&StrandSequence>; 2]) -> Hair {
    let step = |other: Option<&StrandSequence>, at: usize| -> Option<Vec3> {
        let p = *other?.points.get(at)?;
        p.is_finite().then(|| p - now.points[at])
    };
    let mut hair = Hair::default();
    for n in 0..now.strand_count {
        let known = |at: &usize| now.valid(*at) && now.points[*at].is_finite();
        let range = now.range(0, n);
        let kept: Vec<usize> = range.skip_while(|at| !known(at)).take_while(known).collect();
        if kept.len() < 2 {
            continue;
        }
        let points: Vec<Vec3> = kept.iter().map(|&at| now.points[at]).collect();
        let motion: Vec<Vec3> = kept
            .iter()
            .map(|&at| match (step(before, at), step(after, at)) {
                (Some(back), Some(on)) => (on - back) * 0.5,
                (None, Some(on)) => on,
                (Some(back), None) => -back,
                (None, None) => Vec3::ZERO,
            })
            .collect();
        hair.push(n as u32, &points, &motion);
    }
    hair
}

/// The pictures to make, in order.
pub fn shots(args: &RenderArgs, take: &Take, strands: &dyn StrandFrames, still: bool) -> Result<Vec<Shot>, Failed> {
    let frames = strands.frames();
    let size = args.size.as_deref().map(size).transpose()?;
    let chosen: Vec<usize> = match args.frames {
        Some(range) => (0..frames.len()).filter(|&t| range.contains(frames[t] as usize)).collect(),
        None if still || args.turntable.is_some() => (0..frames.len().min(1)).collect(),
        None => (0..frames.len()).collect(),
    };
    if let Some(range) = args.frames.filter(|range| chosen.len() != range.len()) {
        let have = match (frames.first(), frames.last()) {
            (Some(first), Some(last)) => format!("the strands have frames {first}..{}", last + 1),
            _ => "the strands have no frame".into(),
        };
        return Err(Failed::input(format!("there are no strands of all frames {range}"), have));
    }
    let Some(&first) = chosen.first() else {
        return Err(Failed::input("there is no frame to render", "run the stage first"));
    };
    if let Some(count) = args.turntable {
        let points: Vec<DVec3> =
            Moments::new(strands).hair(first)?.points.iter().step_by(5).map(|p| p.as_dvec3()).collect();
        let from = take.rig().cameras.first().map_or(DVec3::Y, |camera| camera.centre_in_world());
        let cameras = turntable(&points, -take.gravity(), from, count as usize, size.unwrap_or(SIZE));
        let shots = cameras.into_iter().enumerate();
        return Ok(shots.map(|(k, camera)| Shot { t: chosen[k % chosen.len()], camera }).collect());
    }
    let camera = camera(args, take)?;
    let camera = size.map_or(camera.clone(), |size| resized(&camera, size));
    Ok(chosen.into_iter().map(|t| Shot { t, camera: camera.clone() }).collect())
}

fn camera(args: &RenderArgs, take: &Take) -> Result<Camera, Failed> {
    let rig = match &args.camera {
        Some(file) => read_calibration(file, None)?.rig,
        None => take.rig().clone(),
    };
    let found = match &args.view {
        Some(name) => rig.view_named(name),
        None => (!rig.cameras.is_empty()).then_some(0),
    };
    found.map(|view| rig.cameras[view].clone()).ok_or_else(|| {
        let names: Vec<&str> = rig.cameras.iter().map(|camera| camera.name.as_str()).collect();
        Failed::input(
            format!("no view `{}`", args.view.as_deref().unwrap_or_default()),
            format!("views: {}", names.join(", ")),
        )
    })
}

/// `WxH`.
fn size(text: &str) -> Result<[usize; 2], Failed> {
    let wrong = || {
        let hint = format!("write WIDTHxHEIGHT in pixels, each 1 to {MAX_SIDE}, like 1920x1080");
        Failed::input(format!("`{text}` is no size of a picture"), hint)
    };
    let (w, h) = text.split_once(['x', '×']).ok_or_else(wrong)?;
    let side = |text: &str| text.parse().ok().filter(|n| (1..=MAX_SIDE).contains(n)).ok_or_else(wrong);
    Ok([side(w)?, side(h)?])
}

/// A colour of hair by name or as `#rrggbb`.
pub fn hair_colour(text: &str) -> Result<HairColour, Failed> {
    match text {
        "brown" => Ok(HairColour::BROWN),
        "black" => Ok(HairColour::BLACK),
        "blond" => Ok(HairColour::BLOND),
        "red" => Ok(HairColour::RED),
        "grey" => Ok(HairColour::GREY),
        _ => hex(text).map(HairColour::Bundle).ok_or_else(|| {
            Failed::input(format!("`{text}` is no colour of hair"), "brown, black, blond, red, grey, or #rrggbb")
        }),
    }
}

/// What goes behind the pictures.
pub fn background(args: &RenderArgs, take: &Take) -> Result<Background, Failed> {
    let text = args.background.as_str();
    let view = || {
        let name = args.view.as_deref().or(take.rig().cameras.first().map(|camera| camera.name.as_str()));
        let own = args.turntable.is_none() && args.camera.is_none();
        name.and_then(|name| take.rig().view_named(name)).filter(|_| own).ok_or_else(|| {
            let hint = "name a view of the take with --view, or another --background";
            Failed::input(format!("--background {text} needs a view of the take"), hint)
        })
    };
    Ok(match text {
        "none" => Background::Nothing,
        "paper" => Background::Fixed(Backdrop::PAPER),
        "plate" => Background::Fixed(Backdrop::Image(take.plate(view()?)?.as_ref().clone())),
        "footage" => Background::Footage(view()?),
        _ => Background::Fixed(Backdrop::Solid(hex(text).ok_or_else(|| {
            let hint = "plate, footage, paper, none, or #rrggbb";
            Failed::input(format!("`{text}` is no background"), hint)
        })?)),
    })
}

/// Linear light of `#rrggbb`.
fn hex(text: &str) -> Option<Vec3> {
    let digits = text.strip_prefix('#').filter(|d| d.len() == 6 && d.chars().all(|c| c.is_ascii_hexdigit()))?;
    let byte = |i: usize| u8::from_str_radix(&digits[2 * i..2 * i + 2], 16).ok().map(linear_of_srgb);
    Some(Vec3::new(byte(0)?, byte(1)?, byte(2)?))
}
