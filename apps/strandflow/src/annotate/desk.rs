//! The answers of a take that is being labelled.

use std::path::Path;

use strandflow_core::{Camera, FrameRange, Mask, Rig};
use strandflow_engine::{EngineError, take::RUN_LOG};
use strandflow_view::{
    Desk, Picture, Refusal,
    desk::{Document, MaskFound, MaskKind, Tracks, Work, WorkView},
};

use super::{
    home::{Home, version},
    labels, masks,
    refusals::Refusals,
    sketches, tracks,
};
use crate::view::{about, layers, source::Source};

/// A take being labelled.
pub struct TakeDesk {
    source: Source,
    home: Home,
    /// Of the take's folder.
    id: String,
    refusals: Refusals,
}

impl TakeDesk {
    /// Of a take.
    pub fn open(root: &Path, source: Source) -> Result<Self, EngineError> {
        let home = Home::open(root, source.manifest())?;
        let folder = root.canonicalize().unwrap_or_else(|_| root.to_owned());
        let id = version(folder.as_os_str().as_encoded_bytes());
        Ok(Self { source, home, id, refusals: Refusals::into_log(root.join(RUN_LOG)) })
    }

    fn rig(&self) -> Result<&Rig, Refusal> {
        let hint = "look at what `strandflow annotate` said when it began";
        self.source.rig().ok_or_else(|| Refusal::broken("the calibration cannot be read", hint))
    }

    /// The take's frames, whatever part of them was run.
    fn frames(&self) -> FrameRange {
        let stated = self.source.manifest().frames.as_deref().and_then(|text| text.parse().ok());
        let views = 0..self.source.manifest().views.len();
        let counts = views.filter_map(|view| Some(self.source.footage(view)?.frame_count()));
        stated.unwrap_or_else(|| FrameRange { start: 0, end: counts.min().unwrap_or(0) })
    }

    fn must_be_a_frame(&self, frame: usize) -> Result<(), Refusal> {
        let frames = self.frames();
        let fact = || format!("there is no frame {frame}");
        let is_one = (frames.start..frames.end).contains(&frame);
        is_one.then_some(()).ok_or_else(|| Refusal::missing(fact(), format!("the take has the frames {frames}")))
    }

    fn place<'a>(&self, view: &'a str, frame: usize) -> Result<masks::Place<'a>, Refusal> {
        self.must_be_a_frame(frame)?;
        let (index, camera) = layers::camera(&self.source, view)?;
        Ok(masks::Place { index, view, size: (camera.width, camera.height), frame })
    }
}

impl Desk for TakeDesk {
    fn work(&self) -> Result<Work, Refusal> {
        let (manifest, frames, rig) = (self.source.manifest(), self.frames(), self.rig()?);
        let names: Vec<String> = rig.cameras.iter().map(|camera| camera.name.clone()).collect();
        let with_lens = |(view, camera): (_, &Camera)| WorkView { view, distortion: camera.distortion };
        Ok(Work {
            id: self.id.clone(),
            name: self.source.name(),
            fps: manifest.fps,
            frames: [frames.start, frames.end],
            views: about::views(&self.source).into_iter().zip(&rig.cameras).map(with_lens).collect(),
            hair: masks::given(&self.home, MaskKind::Hair, &names)?,
            subject: masks::given(&self.home, MaskKind::Subject, &names)?,
            sketches: sketches::given(&self.home)?,
            marker_radius_px: manifest.settings.pose.marker_radius_px,
            notes: self.source.notes().to_vec(),
        })
    }

    fn image(&self, view: &str, frame: usize) -> Result<Picture, Refusal> {
        layers::image(&self.source, view, frame)
    }

    fn size(&self, view: &str) -> Result<(usize, usize), Refusal> {
        let (_, camera) = layers::camera(&self.source, view)?;
        Ok((camera.width, camera.height))
    }

    fn labels(&self) -> Result<Document, Refusal> {
        labels::get(&self.home, self.frames().start)
    }

    fn put_labels(&self, made_from: &str, json: &[u8]) -> Result<String, Refusal> {
        labels::put(&self.home, self.rig()?, self.frames(), made_from, json)
    }

    fn tracks(&self, frame: usize) -> Result<Tracks, Refusal> {
        tracks::get(&self.source, self.rig()?, frame)
    }

    fn mask(&self, kind: MaskKind, view: &str, frame: usize) -> Result<MaskFound, Refusal> {
        masks::get(&self.home, &self.source, kind, self.place(view, frame)?)
    }

    fn put_mask(
        &self,
        kind: MaskKind,
        view: &str,
        frame: usize,
        made_from: &str,
        mask: Option<&Mask>,
    ) -> Result<String, Refusal> {
        masks::put(&self.home, kind, self.place(view, frame)?, made_from, mask)
    }

    fn sketches(&self, frame: usize) -> Result<Document, Refusal> {
        self.must_be_a_frame(frame)?;
        sketches::get(&self.home, frame)
    }

    fn put_sketches(&self, frame: usize, made_from: &str, json: &[u8]) -> Result<String, Refusal> {
        self.must_be_a_frame(frame)?;
        sketches::put(&self.home, self.rig()?, frame, made_from, json)
    }

    fn refused(&self, request: &str, status: u16, why: &str) {
        self.refusals.tell(request, status, why);
    }
}
