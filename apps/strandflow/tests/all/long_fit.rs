//! Takes longer than the stretch that `fit` refines at a time.

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

    // What the motion tells of the material, a row a strand that is there.
    let out = one.path().join("material.csv");
    let wrote = strandflow(&["export", text(&takes[0]), "--stage", "fit", "--to", "csv", text(&out)]);
    assert!(wrote.status.success(), "{}", stderr(&wrote));
    let table = std::fs::read_to_string(&out).expect("the table was written");
    let mut lines = table.lines().filter(|line| !line.starts_with('#')).map(|line| line.split(',').collect::<Vec<_>>());
    let names = lines.next().expect("names of the columns");
    let column = |name: &str| names.iter().position(|n| *n == name).expect(name);
    let (strand, drag, deviation) = (column("strand"), column("drag"), column("sd_ln_drag"));
    let (held_out, kept) = (column("held_out_m"), column("kept_m"));
    let rows: Vec<Vec<&str>> = lines.collect();
    let strands: Vec<usize> = rows.iter().map(|row| row[strand].parse().expect("a number")).collect();
    assert_eq!(strands, (0..STRANDS).filter(|&n| !is_spoilt(n)).collect::<Vec<_>>());
    for row in &rows {
        let number = |at: usize| row[at].parse::<f64>().unwrap_or_else(|_| panic!("{row:?}"));
        assert_eq!(row.len(), names.len());
        assert!(number(drag) > 0.0 && number(deviation) > 0.0, "{row:?}");
        assert!(number(held_out) < number(kept), "{row:?}");
    }
    let excited = rows.iter().filter(|row| row[column("excited")].contains("drag")).count();
    assert!(2 * excited > rows.len(), "shaken hair tells drag: {excited} of {}", rows.len());
}
