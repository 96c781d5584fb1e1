//! What a person can do about the findings of a stage.

/// What to look at, and what to do, where a stage has findings.
pub fn advice(stage: &str) -> &'static str {
    match stage {
        "masks" => {
            "Look at the frames named. Where a mask is wrong, paint it and save it as VIEW/FRAME.png in the folder of hair \
             masks (or subject masks); a corrected frame also helps those after it. Then run again."
        }
        "hull" => "Check the masks of the frames named and the calibration: a hull that lacks parts was cut by a mask.",
        "pose" => {
            "Poses of frames with too few markers are interpolated. Label more markers in the first frame, each in every \
             view that shows it, or make them easier to see in the next capture."
        }
        "scalp" => "Check the hair masks of the first frame: roots lie where hair meets the head in them.",
        "orient" => {
            "Views named here are believed less. Sharper focus, shorter exposure and softer light help in the next capture; \
             a view that harms can be left out."
        }
        "lift" | "field" => {
            "Few lines mean that few views see the hair alike: check calibration and orientation maps of these frames."
        }
        "grow" | "prune" => {
            "Frames that lose many strands are bridged by the stages after; check their masks and maps."
        }
        "smooth" => "Strands are trimmed to what most frames show; nothing needs to be done unless many are absent.",
        "fit" => {
            "Strands that no simulation explains are completed from their neighbours and say so by their provenance. \
             Nothing needs to be done unless they are many: then look at the strands before, over footage."
        }
        "flow" | "blend" => "Nothing needs to be done unless strands over footage look wrong in the frames named.",
        _ => "Look at the places named.",
    }
}
