//! From strands to a picture.

use strandflow_core::Camera;

use crate::{
    RenderError,
    account::{Account, Phase},
    colour::HairColour,
    dome::Dome,
    draw::{Drawn, draw},
    fibre::Roughness,
    groom::{Grown, Growth},
    light::LightRig,
    picture::Picture,
    scattering::Scattering,
    shadow::{Shadow, Surface},
    skin::{in_world, skin},
    subject::Subject,
    thread::{Eye, Lighting, Threads},
};

/// Largest picture along one side \[px\].
pub const MAX_SIDE: usize = 16_384;

/// Most hairs a strand.
pub const MAX_DENSITY: usize = 500;

/// Most points of all hairs: about 2 GB, and what is drawn of them.
pub const MAX_POINTS: usize = 40_000_000;

/// Hairs of a human head (Robbins 2012: 80,000 to 150,000).
const HAIRS: f32 = 100_000.0;

/// Thickest that a hair is drawn \[mm\], where few strands stand for all.
const THICKEST_MM: f32 = 0.4;

/// How a picture is made.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Colour of the hair.
    pub colour: HairColour,
    /// Roughness of a fibre.
    pub roughness: Roughness,
    /// Hairs drawn for each strand; see [`full_density`]. Where they are fewer than a head has, they are drawn thicker.
    pub density: usize,
    /// Thickness of a hair \[mm\]; human hair has 0.05 to 0.1.
    pub hair_mm: f32,
    /// Share of a frame for which the shutter is open, 0 (sharp) to 1.
    pub shutter: f32,
    /// Whether the head is drawn. Else it hides and shades hair, and is a hole in the picture: footage has its own.
    pub skin: bool,
    /// Rounds by which strands are freed from the trembling of captured ones; 0 draws them as they are.
    pub polish: usize,
    /// Seed of the children and shades.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            colour: HairColour::BROWN,
            roughness: Roughness::default(),
            density: 10,
            hair_mm: 0.08,
            shutter: 0.5,
            skin: true,
            polish: 4,
            seed: 1,
        }
    }
}

impl Settings {
    /// # Errors
    /// A setting out of range.
    pub fn check(&self) -> Result<(), RenderError> {
        let wrong = |name, value: String, range: String| Err(RenderError::Setting { name, value, range });
        let in_range = |value: f32, low: f32, high: f32| (low..=high).contains(&value);
        let rough = [self.roughness.longitudinal, self.roughness.azimuthal];
        if !(1..=MAX_DENSITY).contains(&self.density) {
            return wrong("density", self.density.to_string(), format!("1..={MAX_DENSITY}"));
        }
        if self.polish > 100 {
            return wrong("polish", self.polish.to_string(), "0..=100".into());
        }
        if !in_range(self.shutter, 0.0, 1.0) {
            return wrong("motion blur", self.shutter.to_string(), "0..=1".into());
        }
        if !in_range(self.hair_mm, 0.005, 5.0) {
            return wrong("thickness of a hair", self.hair_mm.to_string(), "0.005..=5 mm".into());
        }
        match rough.iter().find(|r| !in_range(**r, 0.05, 1.0)) {
            Some(r) => wrong("roughness", r.to_string(), "0.05..=1".into()),
            None => Ok(()),
        }
    }

    /// Thickness at which a hair is drawn \[mm\]: all hairs together cover what those of a head do.
    fn width_mm(&self, strands: usize) -> f32 {
        let missing = HAIRS / (strands * self.density).max(1) as f32;
        (self.hair_mm * missing.max(1.0)).min(THICKEST_MM.max(self.hair_mm))
    }
}

/// The density at which hair looks full in a picture where a millimetre at the head has `px_per_mm` pixels: as many hairs
/// as a head has, or as many as are a seventh of a pixel thin, which look the same.
pub fn full_density(strands: usize, px_per_mm: f64) -> usize {
    /// Thickness below which more and thinner hairs change nothing that is seen \[px\].
    const FINE_PX: f64 = 0.14;
    let fine = f64::from(HAIRS) * 0.08 * px_per_mm.max(1e-6) / FINE_PX;
    let hairs = fine.min(f64::from(HAIRS));
    ((hairs / strands.max(1) as f64).round() as usize).clamp(1, 60)
}

/// Renders a subject as a camera sees it, by the light of a rig.
///
/// # Errors
/// There is no strand, a position is not finite, a setting is out of range, the hairs have more than [`MAX_POINTS`], or the camera's picture is empty or larger
/// than [`MAX_SIDE`].
pub fn render(subject: &Subject, camera: &Camera, rig: &LightRig, settings: &Settings) -> Result<Picture, RenderError> {
    render_accounted(subject, camera, rig, settings).map(|(picture, _)| picture)
}

/// As [`render`], and says what each phase did and how long it took.
///
/// # Errors
/// As of [`render`].
pub fn render_accounted(
    subject: &Subject,
    camera: &Camera,
    rig: &LightRig,
    settings: &Settings,
) -> Result<(Picture, Vec<Phase>), RenderError> {
    settings.check()?;
    subject.hair.check()?;
    let (width, height) = (camera.width, camera.height);
    if !(1..=MAX_SIDE).contains(&width) || !(1..=MAX_SIDE).contains(&height) {
        return Err(RenderError::Size { width, height });
    }
    let width_mm = settings.width_mm(subject.hair.strand_count());
    let pieces = pieces(subject, camera);
    let points = subject.hair.points.len().saturating_mul(pieces).saturating_mul(settings.density);
    if points > MAX_POINTS {
        return Err(RenderError::TooMany { points });
    }
    let mut account = Account::start();
    let growth = Growth { density: settings.density, pieces, polish: settings.polish, seed: settings.seed };
    let centre = camera.centre_in_world().as_vec3();
    let eye = Eye { camera, centre, shutter: settings.shutter, width_mm, seed: settings.seed };
    let grown = Grown::new(subject, &growth, |hair, vertices| eye.place(hair, vertices));
    account.end("grow and place", "points", grown.points.len());

    let vertices = subject.head.as_ref().map(in_world);
    let surface = subject.head.as_ref().zip(vertices.as_ref());
    let surface = surface.map(|(head, vertices)| Surface { vertices, faces: &head.mesh.faces });
    let shadow = |towards| Shadow::new(towards, &grown, width_mm, surface.as_ref());
    let (shadows, dome) = rayon::join(
        || rig.lights.iter().map(|light| shadow(light.towards)).collect::<Vec<Shadow>>(),
        || Dome::new(&grown, width_mm, surface.as_ref(), rig.up),
    );
    account.end("shadows and dome", "cells", shadows.iter().map(Shadow::cells).sum());

    let scattering = Scattering::new(settings.colour, settings.roughness);
    let lighting = Lighting { rig, shadows: &shadows, dome: &dome, scattering: &scattering };
    let skin = match (&subject.head, &surface) {
        (Some(head), Some(surface)) => skin(head, surface, subject.hair, &lighting, &eye),
        _ => Vec::new(),
    };
    let threads = Threads::new(subject.hair, &grown, &lighting, &eye);
    account.end("tables and skin", "vertices", skin.len());

    let faces = surface.as_ref().map_or(&[][..], |surface| surface.faces);
    let drawn = Drawn { grown: &grown, threads: &threads, faces, skin: &skin, draw_skin: settings.skin };
    Ok((draw(&drawn, [width, height], &mut account), account.phases))
}

/// Pieces into which an edge is rounded, so that none is longer than some pixels.
fn pieces(subject: &Subject, camera: &Camera) -> usize {
    /// Edges of 6 px show no corner at the curvature of hair.
    const LONGEST_PX: f64 = 6.0;
    let hair = subject.hair;
    let depth = strandflow_geometry::project::depth(camera, subject.middle()).max(1.0);
    let edges = (0..hair.strand_count()).step_by(17).flat_map(|n| hair.strand(n).windows(2));
    let (sum, count) = edges.fold((0.0, 0.0), |(sum, n), pair| (sum + f64::from(pair[0].distance(pair[1])), n + 1.0));
    let edge_px = sum / f64::max(count, 1.0) * camera.focal[0] / depth;
    (edge_px / LONGEST_PX).ceil().clamp(1.0, 8.0) as usize
}
