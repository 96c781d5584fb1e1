//! The check `cost`: what a run will take, from what runs took.

use std::{path::Path, process::Command};

use strandflow_stages::hull::MOST_VOXELS;

use crate::{Evidence, Finding, Outcome};

/// How large a run is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Size {
    /// Megapixels of all images.
    pub megapixels: f64,
    /// Million voxels of the grid, times frames.
    pub megavoxel_frames: f64,
    /// Strands times frames.
    pub strand_frames: f64,
    /// Million voxels of the grid.
    pub megavoxels: f64,
    /// Threads.
    pub threads: usize,
}

/// What a run takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cost {
    /// Wall-clock seconds.
    pub secs: f64,
    /// Resident memory \[MB\].
    pub memory_mb: f64,
    /// Results on disk \[MB\].
    pub disk_mb: f64,
}

/// Core seconds and megabytes of a unit, from a run of dev-straight (the disk also of dev-long-wavy) of `docs/results.md` on two cores: images (masks, pose,
/// orient), volumes (hull, lift, field, flow), strands (grow to blend). Strands of twice the length cost twice as much, and the
/// estimate does not know that: it is good to a factor of two.
const SECS_A_MEGAPIXEL: f64 = 1.4;
const SECS_A_MEGAVOXEL_FRAME: f64 = 1.5;
const SECS_A_STRAND_FRAME: f64 = 1.7e-3;
const MB_A_MEGAPIXEL: f64 = 0.8;
const MB_A_MEGAVOXEL_FRAME: f64 = 5.3;
const MB_A_STRAND_FRAME: f64 = 3.2e-3;
/// Resident megabytes of the program, and of a million voxels in each thread.
const MB_PROGRAM: f64 = 100.0;
const MB_A_MEGAVOXEL: f64 = 70.0;

/// What a run of this size takes.
pub fn cost(size: &Size) -> Cost {
    let Size { megapixels, megavoxel_frames, strand_frames, megavoxels, threads } = *size;
    let core_secs =
        SECS_A_MEGAPIXEL * megapixels + SECS_A_MEGAVOXEL_FRAME * megavoxel_frames + SECS_A_STRAND_FRAME * strand_frames;
    Cost {
        secs: core_secs / threads.max(1) as f64,
        memory_mb: MB_PROGRAM + MB_A_MEGAVOXEL * megavoxels * threads as f64,
        disk_mb: MB_A_MEGAPIXEL * megapixels
            + MB_A_MEGAVOXEL_FRAME * megavoxel_frames
            + MB_A_STRAND_FRAME * strand_frames,
    }
}

/// Voxels that stage `hull` refuses \[millions\].
const MOST_MEGAVOXELS: f64 = MOST_VOXELS as f64 / 1e6;

/// The check `cost`.
pub(crate) fn check(evidence: &mut Evidence) -> Outcome {
    let Some(grid) = evidence.hull.as_ref().map(|hull| hull.grid) else {
        return Outcome::unjudged("there is no hull: the grid's size is not known");
    };
    let frames = evidence.frames.len() as f64;
    let voxel = evidence.settings.hull.voxel_mm;
    let megavoxels = grid.len() as f64 * (grid.voxel_mm / voxel).powi(3) / 1e6;
    let pixels: f64 = evidence.mended.cameras.iter().map(|c| (c.width * c.height) as f64 / 1e6).sum();
    let size = Size {
        megapixels: pixels * frames,
        megavoxel_frames: megavoxels * frames,
        strand_frames: evidence.settings.scalp.root_count as f64 * frames,
        megavoxels,
        threads: std::thread::available_parallelism().map_or(1, usize::from),
    };
    let cost = cost(&size);
    let (disk, memory) = (free_mb(&evidence.root), memory_mb());
    let beside = |mb: Option<f64>| mb.map_or_else(String::new, |mb| format!(" (free: {})", in_bytes(mb)));
    let measured = format!(
        "about {:.1} million voxels of {voxel} mm, {} of memory{}, {} of disk{}, {} on {} threads",
        megavoxels,
        in_bytes(cost.memory_mb),
        beside(memory),
        in_bytes(cost.disk_mb),
        beside(disk),
        in_time(cost.secs),
        size.threads
    );
    Outcome::of(measured, of_cost(&cost, megavoxels, disk, memory))
}

fn of_cost(cost: &Cost, megavoxels: f64, disk: Option<f64>, memory: Option<f64>) -> Vec<Finding> {
    let mut findings = Vec::new();
    if megavoxels > MOST_MEGAVOXELS {
        let fact =
            format!("the grid would have about {megavoxels:.0} million voxels, at most {MOST_MEGAVOXELS:.0} are made");
        findings.push(
            Finding::cannot("grid-too-large", "settings", fact)
                .suffers("hull: refuses")
                .hint("raise hull.voxel_mm, or check the unit of the calibration"),
        );
    }
    for (what, needed, free, fault, hint) in [
        ("disk", cost.disk_mb, disk, "disk-space", "make room, move the take, or run fewer frames"),
        ("memory", cost.memory_mb, memory, "memory", "run with fewer --threads, or raise hull.voxel_mm"),
    ] {
        if let Some(free) = free.filter(|free| *free < needed) {
            let fact = format!("a run needs about {} of {what}, {} are free", in_bytes(needed), in_bytes(free));
            let suffers = "masks: the run stops where it is full, and goes on from there";
            findings.push(Finding::look(fault, "machine", fact).suffers(suffers).hint(hint));
        }
    }
    findings
}

fn in_bytes(mb: f64) -> String {
    if mb >= 1000.0 { format!("{:.1} GB", mb / 1000.0) } else { format!("{mb:.0} MB") }
}

fn in_time(secs: f64) -> String {
    match secs {
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

/// Free space of the file system of a folder \[MB\], where the system's `df` tells.
fn free_mb(folder: &Path) -> Option<f64> {
    let output = Command::new("df").arg("-Pk").arg(folder).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    let kib: f64 = text.lines().last()?.split_whitespace().nth(3)?.parse().ok()?;
    Some(kib * 1024.0 / 1e6)
}

/// Memory that can be had \[MB\], where the system tells (Linux).
fn memory_mb() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    Some(line.split_whitespace().next()?.parse::<f64>().ok()? * 1024.0 / 1e6)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_run_that_was_measured_is_estimated() {
        let size =
            Size { megapixels: 64.5, megavoxel_frames: 98.7, strand_frames: 240e3, megavoxels: 3.29, threads: 2 };
        let cost = cost(&size);
        // Measured: 320 s, 570 MB, 1,330 MB.
        assert!((cost.secs - 320.0).abs() < 40.0 && (cost.memory_mb - 570.0).abs() < 30.0, "{cost:?}");
        assert!((cost.disk_mb - 1330.0).abs() < 60.0, "{cost:?}");
        let faults =
            |disk, memory| of_cost(&cost, 3.3, Some(disk), Some(memory)).iter().map(|f| f.fault).collect::<Vec<_>>();
        assert_eq!((faults(2000.0, 600.0).len(), faults(1000.0, 100.0)), (0, vec!["disk-space", "memory"]));
        assert_eq!((in_time(90.0), in_time(320.0), in_bytes(1330.0)), ("90 s".into(), "5 min".into(), "1.3 GB".into()));
    }
}
