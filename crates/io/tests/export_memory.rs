//! Exports of long takes: memory does not grow with the number of frames.

use glam::Vec3;
use strandflow_core::{Provenance, StrandSequence};
use strandflow_io::{
    ChosenStrands, Guides, Interchange, IoError, Resampled, SceneOptions, StrandFrames, write_alembic, write_npz,
    write_ply, write_usd,
};

const STRANDS: usize = 1000;
const POINTS: usize = 40;
/// 680 kB a frame in memory, 100 MB all of them.
const FRAMES: usize = 150;
/// Some frames, buffers and tables; a tenth of the take and more would be a leak.
const MOST_MB: f64 = 15.0;

/// Frames made when they are asked for; each lacks some strands, so that gaps are filled from other frames.
struct Made {
    frames: Vec<u32>,
    counts: Vec<u16>,
}

impl StrandFrames for Made {
    fn frames(&self) -> &[u32] {
        &self.frames
    }

    fn counts(&self) -> &[u16] {
        &self.counts
    }

    fn point_count(&self) -> usize {
        POINTS
    }

    fn frame(&self, t: usize) -> Result<StrandSequence, IoError> {
        let mut sequence = StrandSequence::missing(vec![self.frames[t]], self.counts.clone(), POINTS);
        for n in (0..STRANDS).filter(|n| (n + t) % 7 > 1) {
            for (p, at) in sequence.range(0, n).enumerate() {
                sequence.points[at] = Vec3::new(n as f32, t as f32, -5.0 * p as f32);
                sequence.provenance[at] = Provenance::Observed;
                sequence.confidence[at] = 0.5;
            }
        }
        Ok(sequence)
    }
}

/// Largest resident memory since the last call \[MB\]; `None` where the system does not tell.
fn peak_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let kilobytes = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?.split_whitespace().next()?;
    std::fs::write("/proc/self/clear_refs", "5").ok()?;
    Some(kilobytes.parse::<f64>().ok()? / 1024.0)
}

#[test]
fn long_takes_are_written_a_few_frames_at_a_time() {
    let dir = tempfile::tempdir().unwrap();
    let strands = Made { frames: (0..FRAMES as u32).collect(), counts: vec![POINTS as u16; STRANDS] };
    let Some(_) = peak_mb() else {
        eprintln!("skipped: the system does not tell the peak of memory");
        return;
    };
    let before = peak_mb().unwrap();
    write_npz(&dir.path().join("a.npz"), &strands, &[]).unwrap();
    let npz = peak_mb().unwrap() - before;
    write_usd(&dir.path().join("a.usdc"), &strands, &SceneOptions::default()).unwrap();
    let usd = peak_mb().unwrap() - before;
    let chosen = ChosenStrands::evenly(&strands, STRANDS * 3 / 4).unwrap();
    let resampled = Resampled::new(&chosen, POINTS as u16).unwrap();
    let guides = Guides::of(&resampled, 20).unwrap();
    write_alembic(&dir.path().join("a.abc"), &resampled, Some(&guides), &SceneOptions::default()).unwrap();
    let abc = peak_mb().unwrap() - before;
    let interchange = Interchange::new(&strands).unwrap();
    (0..FRAMES).step_by(10).for_each(|t| write_ply(&dir.path().join("a.ply"), &interchange, t).unwrap());
    let ply = peak_mb().unwrap() - before;
    assert!(
        [npz, usd, abc, ply].iter().all(|mb| *mb < MOST_MB),
        "npz {npz:.1}, usd {usd:.1}, abc {abc:.1}, ply {ply:.1} MB"
    );
}
