//! The check `time`: delays between views, frames lost, frames shown twice.

use strandflow_core::FrameRange;

use crate::{
    Evidence, Finding, Outcome,
    clock::{Clock, clocks},
    follow::{Followed, follow},
    labels::median,
};

/// Frames looked at, the labelled one among them. More, and a take of minutes takes minutes.
const MOST_FRAMES: usize = 150;
/// Delay that counts \[frames\]: markers and hair of a fast head move by 5 px a frame, and lines may be off by one.
const DELAYED: f64 = 0.2;
/// Standard errors a delay must be away from none.
const SURE: f64 = 4.0;
/// Standard error above which a delay is not known well enough to say that there is none \[frames\].
const KNOWN: f64 = 0.1;

/// The check `time`.
pub(crate) fn check(evidence: &mut Evidence) -> Outcome {
    let frames = looked_at(evidence);
    let left_out: Vec<usize> =
        (0..evidence.views.len()).filter(|view| evidence.distrusted.contains(view) || !evidence.fits(*view)).collect();
    if frames.len() < 3 || left_out.len() + 3 > evidence.views.len() {
        return Outcome::unjudged("needs three frames and three views of known calibration");
    }
    let followed = follow(evidence, frames);
    let mut findings = copied(evidence, &followed, frames.start);
    let clocks = clocks(&evidence.mended, &followed, &left_out, evidence.settings.pose.inlier_px);
    for (view, clock) in clocks.iter().enumerate() {
        let copies: Vec<usize> = copies_of(&followed, view);
        let found = clock.as_ref().and_then(|clock| of_clock(clock, &copies, frames.start));
        evidence.out_of_time.extend(found.iter().map(|_| view));
        findings.extend(
            found.map(|finding| Finding { place: format!("view {}{}", evidence.name(view), finding.place), ..finding }),
        );
    }
    evidence.followed = followed;
    match in_words(&clocks, frames) {
        Ok(measured) => Outcome::of(measured, findings),
        Err(why) if findings.is_empty() => Outcome::unjudged(why),
        Err(why) => Outcome::of(why, findings),
    }
}

/// The take's first frames; where the labels are not among them, those around the labels.
fn looked_at(evidence: &Evidence) -> FrameRange {
    let all = evidence.frames;
    let is_early = evidence.labelled < all.start + MOST_FRAMES;
    let start = if is_early { all.start } else { evidence.labelled - MOST_FRAMES / 2 };
    FrameRange { start, end: all.end.min(start + MOST_FRAMES) }
}

/// What was measured; why nothing was.
fn in_words(clocks: &[Option<Clock>], frames: FrameRange) -> Result<String, String> {
    let known: Vec<&Clock> = clocks.iter().flatten().filter(|clock| clock.error < KNOWN).collect();
    let largest = known.iter().map(|clock| clock.ahead.abs()).fold(0.0, f64::max);
    let error = known.iter().map(|clock| clock.error).fold(0.0, f64::max);
    match known.len() {
        0 => {
            Err(format!("in frames {frames} the markers move too little, or are lost, to tell one moment from another"))
        }
        n => Ok(format!(
            "{n} of {} views timed by their markers in frames {frames}: at most {largest:.2} frames apart (± {error:.2})",
            clocks.len()
        )),
    }
}

/// What a view's clock says; the place is what follows the view's name.
fn of_clock(clock: &Clock, copies: &[usize], first: usize) -> Option<Finding> {
    let suffers = "lift, field: lines and motion of this view belong to another moment";
    if let Some((at, before, after)) = clock.change {
        let step = after - before;
        let place = format!(", frame {}", first + at);
        let (count, near) = (step.abs().round().max(1.0), copies.iter().any(|&copy| copy.abs_diff(at) <= 2));
        let moments = format!("{before:+.2} frames before it and {after:+.2} after, against the other views");
        return Some(if step > 0.0 {
            Finding::look("dropped-frame", place, format!("{count:.0} frame(s) are missing about here: {moments}"))
                .suffers(suffers)
                .hint("repeat or interpolate the frame there and cut the end, or take the frames before or after it with `frames`")
        } else {
            let what = if near { "a frame is there twice" } else { "the clip falls behind" };
            Finding::look(
                "repeated-frame",
                place,
                format!("{what}, and all later ones come {count:.0} frame(s) late: {moments}"),
            )
            .suffers(suffers)
            .hint("take the repeated frame out, or take the frames before or after it with `frames`")
        });
    }
    let late = clock.ahead;
    if late.abs() < DELAYED || late.abs() < SURE * clock.error || clock.error > DELAYED {
        return None;
    }
    let (which, way) = if late > 0.0 { ("later", "begins too late") } else { ("earlier", "begins too early") };
    let fact = format!("shows moments {:.2} frames {which} than the other views (± {:.2})", late.abs(), clock.error);
    let whole = late.abs().round();
    let hint = match late > 0.0 {
        _ if whole < 1.0 => "trigger the cameras together; less than a frame cannot be cut away".into(),
        true => format!(
            "the clip {way}: cut {whole:.0} frame(s) from the beginning of the other clips, and as many from this one's end"
        ),
        false => format!(
            "the clip {way}: cut {whole:.0} frame(s) from its beginning, and as many from the end of the others"
        ),
    };
    Some(Finding::look("offset", "", fact).suffers(suffers).hint(hint))
}

/// Change against the usual below which a frame is a copy of the one before: noise alone keeps half.
const COPY: f32 = 0.15;

/// Frames of a view, from its first, that are copies of the frame before.
fn copies_of(followed: &[Followed], view: usize) -> Vec<usize> {
    let change = &followed[view].change;
    let usual = median(change.iter().flatten().map(|&c| f64::from(c))).unwrap_or(0.0) as f32;
    (1..change.len()).filter(|&frame| change[frame].is_some_and(|c| c < COPY * usual)).collect()
}

fn copied(evidence: &Evidence, followed: &[Followed], first: usize) -> Vec<Finding> {
    let mut findings = Vec::new();
    for view in 0..followed.len() {
        let copies = copies_of(followed, view);
        if copies.is_empty() {
            continue;
        }
        let frames: Vec<String> = copies.iter().take(5).map(|frame| (first + frame).to_string()).collect();
        let more = if copies.len() > 5 { format!(" and {} more", copies.len() - 5) } else { String::new() };
        let fact = format!("frame {}{more} shows the same image as the frame before", frames.join(", "));
        findings.push(
            Finding::look("copied-frame", format!("view {}", evidence.name(view)), fact)
                .suffers("lift, field: hair that moves in other views stands still in this one")
                .hint("the camera or the conversion repeated a frame: convert without changing the frame rate, or leave the frame out"),
        );
    }
    findings
}
