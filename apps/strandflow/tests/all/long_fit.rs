//! Takes longer than the stretch that `fit` refines at a time.
#![expect(clippy::unwrap_used, reason = "helpers of tests: a failing unwrap is a failing test")]

use strandflow_engine::Take;

use crate::common::{assert_same, before_fit, stderr, strandflow, text};

#[test]
fn strands_of_a_long_take_are_given_up_in_all_frames_or_in_none() {
    const STRANDS: usize = 18;
    const FRAMES: usize = 350;
    let is_spoilt = |strand: usize| strand == 7;
    let (one, two) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let takes = [(&one, "1"), (&two, "2")].map(|(root, threads)| {
        let take = before_fit::take(root.path(), STRANDS, FRAMES, is_spoilt);
        let ran = strandflow(&["run", text(&take), "--from", "fit", "--to", "fit", "--threads", threads]);
        assert!(ran.status.success(), "{}", stderr(&ran));
        assert!(stderr(&ran).contains("1 strands that no simulation explains"), "{}", stderr(&ran));
        take
    });
    assert_same(&takes[0], &takes[1]);
    let take = Take::open(&takes[0]).unwrap();
    let fitted = take.read_sequence("fit").unwrap();
    assert_eq!(fitted.frame_count(), FRAMES);
    for strand in 0..STRANDS {
        assert_eq!(fitted.counts[strand] == 0, is_spoilt(strand));
    }
    // Not by the counts, which say that there is none: what is in the arrays.
    for (e, point) in fitted.points.iter().enumerate() {
        let strand = e / fitted.point_count % STRANDS;
        assert_eq!(
            point.is_finite(),
            !is_spoilt(strand),
            "strand {strand}, frame {}",
            e / fitted.point_count / STRANDS
        );
    }
}
