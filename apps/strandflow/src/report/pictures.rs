//! Strands over footage, and the orientation maps behind them.

use strandflow_core::{FrameRange, RgbImage, StrandSequence};
use strandflow_engine::Take;
use strandflow_eval::overlay::{OverlayColour, overlay};
use strandflow_report::{
    Html, Picture, hue,
    picture::{shrunk, shrunk_camera},
};

use super::opened::Opened;

/// Every so many strands are drawn, as `strandflow overlay` does.
const EVERY: usize = 8;

/// Strands of the last stage over footage, with the plain footage beside, frame by frame.
pub fn strands(opened: &Opened, frames: &[usize], views: &[usize]) -> Html {
    let take = match opened.whole() {
        Ok(take) => take,
        Err(_) if opened.last_run().is_none() => return Html::paragraph("There are no strands yet."),
        Err(error) => {
            return Html::warning(&format!("Left out, because the footage cannot be opened: {error}"), &error.hint());
        }
    };
    let mut html = Html::paragraph(
        "One strand in eight, each in a colour of its own; bright where it is trusted. Beside it (on a phone \
         below) the same in the colours of provenance: green observed, blue diffused, orange simulated, magenta completed.",
    );
    for &frame in frames {
        html.push(Html::heading(&format!("Frame {frame}")));
        let Some(stage) = opened.last_strands(frame) else {
            html.push(Html::paragraph("This frame has no strands yet."));
            continue;
        };
        let range = FrameRange { start: frame, end: frame + 1 };
        let read = take.strand_count().and_then(|count| take.read_sequence_part(stage, range, 0..count));
        match read {
            Ok(sequence) => views.iter().for_each(|view| html.push(of_view(take, stage, &sequence, *view, frame))),
            Err(error) => html.push(Html::warning(&error.to_string(), &error.hint())),
        }
    }
    html
}

/// Footage, strands and provenance of one view.
fn of_view(take: &Take, stage: &str, sequence: &StrandSequence, view: usize, frame: usize) -> Html {
    let image = match take.images().image(view, frame) {
        Ok(image) => image,
        Err(error) => return Html::warning(&error.to_string(), &error.hint),
    };
    let camera = shrunk_camera(&take.rig().cameras[view]);
    let image = shrunk(&image, &camera);
    let name = &camera.name;
    let drawn = |colour| overlay(&image, &camera, sequence, 0, EVERY, colour);
    let where_and_when = format!("view {name}, frame {frame}");
    Html::side_by_side([
        figure(&image, &format!("Footage, {where_and_when}"), &format!("{name}: footage")),
        figure(
            &drawn(OverlayColour::Strand),
            &format!("Strands after {stage} over footage, {where_and_when}"),
            &format!("{name}: strands after {stage}"),
        ),
        figure(
            &drawn(OverlayColour::Provenance),
            &format!("Strands after {stage} coloured by provenance, {where_and_when}"),
            &format!("{name}: provenance"),
        ),
    ])
}

/// Orientation maps of the same frames and views. They need the calibration, not the footage.
pub fn orientations(opened: &Opened, frames: &[usize], views: &[usize]) -> Html {
    let (Some(store), Some(rig)) = (opened.store(), opened.rig()) else {
        return Html::paragraph(
            "There are no orientation maps: stage orient is not done, or the calibration cannot be read.",
        );
    };
    let mut html = Html::default();
    for &frame in frames {
        let of_view = |&view: &usize| {
            let camera = rig.cameras.get(view)?;
            let map = store.read_orientation(view, frame, (camera.width, camera.height)).ok()?;
            // A map that is all zero was never made.
            map.confidence.data.iter().any(|c| *c > 0.0).then_some(())?;
            let image = shrunk(&hue::orientation_image(&map.angle, &map.confidence), &shrunk_camera(camera));
            let name = &camera.name;
            let alt = format!("Orientation map of view {name}, frame {frame}");
            Some(figure(&image, &alt, &format!("{name}, frame {frame}")))
        };
        html.push(Html::side_by_side(views.iter().filter_map(of_view)));
    }
    if html.is_empty() {
        return Html::paragraph("There are no orientation maps of these frames and views: stage orient is not done.");
    }
    let mut with_key = Html::paragraph(
        "The direction of the hair in every pixel as colour, its confidence as brightness. Neighbouring locks should be smooth in \
         colour; black hair, glints and blur are dark.",
    );
    with_key.push(hue::key());
    with_key.push(html);
    with_key
}

fn figure(image: &RgbImage, alt: &str, caption: &str) -> Html {
    Picture::of(image).map_or_else(Html::default, |picture| picture.figure(alt, caption))
}
