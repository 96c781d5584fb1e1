//! `strandflow render`: pictures of strands as hair.

use std::{sync::mpsc::sync_channel, thread};

use indicatif::{ProgressBar, ProgressStyle};
use strandflow_engine::{Take, animation::AnimationStrands, stage_index};
use strandflow_io::StrandFrames;
use strandflow_render::{
    Backdrop, Hair, LightRig, Picture, RenderError, Settings, Subject, full_density, render as draw,
};

use crate::{
    args::RenderArgs,
    failure::Failed,
    foreign,
    render_out::{Finished, Kind, Output},
    render_scene::{Background, HeadOf, Moments, Shot, background, hair_colour, shots},
    status::tell_of_outdated,
};

/// Pictures a second of a turntable's video: one turn in four seconds where it has 100.
const TURNTABLE_FPS: f64 = 25.0;

impl From<RenderError> for Failed {
    fn from(error: RenderError) -> Self {
        Self::input(error.to_string(), error.hint())
    }
}

pub fn render(args: &RenderArgs) -> Result<(), Failed> {
    let colour = hair_colour(&args.colour)?;
    let settings = Settings {
        colour,
        shutter: args.motion_blur,
        density: args.density.unwrap_or(1),
        polish: args.polish,
        skin: args.background != "footage",
        ..Settings::default()
    };
    settings.check()?;
    let take = Take::open(&args.take)?;
    let behind = background(args, &take)?;
    if let Some(file) = &args.strands {
        let strands = foreign::read(file, take.gravity(), &mut |line| eprintln!("note: {line}"))?;
        return sequence(args, &take, &strands, HeadOf::new(&take), &behind, &settings);
    }
    if let Some(name) = &args.animation {
        let strands = AnimationStrands::open(take.store(), name)?;
        return sequence(args, &take, &strands, HeadOf::animated(&take, &strands), &behind, &settings);
    }
    let plan = take.last_plan()?;
    take.must_be_done(args.stage.name(), &plan)?;
    tell_of_outdated(&take, &plan, stage_index(args.stage.name())?)?;
    sequence(args, &take, &take.strands_of(args.stage.name(), plan.frames)?, HeadOf::new(&take), &behind, &settings)
}

/// Renders one picture after the other, each on all threads, while the next one's strands are read and the one before is
/// written: memory holds these three.
fn sequence(
    args: &RenderArgs,
    take: &Take,
    strands: &dyn StrandFrames,
    head: HeadOf,
    behind: &Background,
    settings: &Settings,
) -> Result<(), Failed> {
    let kind = Kind::of(&args.out);
    if kind == Kind::Video && matches!(behind, Background::Nothing) {
        return Err(Failed::input("a video has no transparency", "give a --background, or write a folder of PNGs"));
    }
    let shots = shots(args, take, strands, kind == Kind::Still)?;
    if kind == Kind::Still && shots.len() > 1 {
        let fact = format!("{} pictures do not go into one PNG", shots.len());
        return Err(Failed::input(fact, "ask for one frame (--frames 20..21), or name a folder or a video"));
    }
    let threads = args.threads.unwrap_or(0);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|error| Failed::input(format!("{threads} threads: {error}"), "ask for fewer threads"))?;
    let fps = if args.turntable.is_some() { TURNTABLE_FPS } else { take.manifest().fps };
    let mut scene = Scene { take, strands, head, behind, settings: settings.clone(), pool };
    let first = &shots[0];
    if args.turntable.is_some() && shots.iter().all(|shot| shot.t == first.t) {
        // What stands still on a turntable is sharp, however fast it moved when it was taken.
        scene.settings.shutter = 0.0;
    }
    if args.density.is_none() {
        scene.settings.density = scene.full(first)?;
    }
    let mut out = Output::open(&args.out, [first.camera.width, first.camera.height], fps)?;
    match scene.draw_all(&shots, &mut out) {
        Ok(()) => out.finish()?,
        Err(failed) => {
            out.abandon();
            return Err(failed);
        }
    }
    eprintln!("wrote {}", args.out.display());
    Ok(())
}

/// What is left to say when a thread beside this one broke off.
fn stopped() -> Failed {
    Failed::input("rendering broke off", "this is a fault of the program; please report it")
}

/// All that the pictures of one call have in common.
struct Scene<'a> {
    take: &'a Take,
    strands: &'a dyn StrandFrames,
    head: HeadOf<'a>,
    behind: &'a Background,
    settings: Settings,
    pool: rayon::ThreadPool,
}

impl Scene<'_> {
    fn draw_all(&self, shots: &[Shot], out: &mut Output) -> Result<(), Failed> {
        let bar = ProgressBar::new(shots.len() as u64);
        let template = "render {bar:20} {pos:>5}/{len:<5} {elapsed:>6} {eta:>6} left";
        bar.set_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()));
        let (hairs, next_hair) = sync_channel(0);
        let (pictures, next_picture) = sync_channel(0);
        let written = thread::scope(|scope| {
            scope.spawn(move || {
                let mut moments = Moments::new(self.strands);
                // Whoever waits for hair goes away when a picture fails: nothing more is to be read then.
                let _ = shots.iter().try_for_each(|shot| hairs.send(moments.hair(shot.t)));
            });
            let writer = scope.spawn(|| {
                next_picture.into_iter().try_for_each(|(shot, picture)| {
                    out.push(&self.finished(shot, picture)?)?;
                    bar.inc(1);
                    Ok(())
                })
            });
            let mut drawn = Ok(());
            for shot in shots {
                let hair = next_hair.recv().unwrap_or_else(|_| Err(stopped()));
                let picture = match hair.and_then(|hair| self.picture(shot, &hair)) {
                    Ok(picture) => picture,
                    Err(failed) => {
                        drawn = Err(failed);
                        break;
                    }
                };
                // The writer goes away where it cannot write; it says why.
                if pictures.send((shot, picture)).is_err() {
                    break;
                }
            }
            drop((pictures, next_hair));
            let written = writer.join().unwrap_or_else(|_| Err(stopped()));
            drawn.and(written)
        });
        bar.finish_and_clear();
        written
    }

    fn picture(&self, shot: &Shot, hair: &Hair) -> Result<Picture, Failed> {
        let subject = Subject { hair, head: self.head.at(self.strands.frames()[shot.t] as usize) };
        let rig = LightRig::studio(&shot.camera, -self.take.gravity());
        let settings = &self.settings;
        Ok(self.pool.install(|| draw(&subject, &shot.camera, &rig, settings))?)
    }

    fn finished(&self, shot: &Shot, picture: Picture) -> Result<Finished, Failed> {
        Ok(match self.behind {
            Background::Nothing => Finished::CutOut(picture.cut_out()),
            Background::Fixed(backdrop) => Finished::Opaque(picture.over(backdrop)),
            Background::Footage(view) => {
                let frame = self.strands.frames()[shot.t] as usize;
                let image = self.take.images().image(*view, frame);
                let image = image.map_err(|error| Failed::input(error.to_string(), error.hint))?;
                Finished::Opaque(picture.over(&Backdrop::Image(image.as_ref().clone())))
            }
        })
    }

    /// The density at which the hair looks full in a shot; the same for all pictures of a call.
    fn full(&self, shot: &Shot) -> Result<usize, Failed> {
        let hair = Moments::new(self.strands).hair(shot.t)?;
        let depths = hair.points.iter().step_by(101).map(|p| shot.camera.camera_from_world.point(p.as_dvec3()).z);
        let nearest = depths.filter(|depth| *depth > 1.0).fold(f64::INFINITY, f64::min);
        let present = self.strands.counts().iter().filter(|count| **count > 1).count();
        Ok(full_density(present, shot.camera.focal[0] / nearest))
    }
}
