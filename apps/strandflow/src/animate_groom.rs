//! The groom that `animate` drives: the take's own strands, the truth's, or a file's in millimetres and upright.

use std::path::Path;

use glam::DVec3;
use strandflow_core::RigidTransform;
use strandflow_engine::Performance;
use strandflow_eval::truth::Truth;
use strandflow_io::{Space, Up, read_groom};
use strandflow_stages::animate::place::{is_of_a_head, spread_ratio};

use crate::{args::AnimateArgs, failure::Failed};

/// Whether the groom is named by this word rather than by a file.
pub fn is(path: &Path, word: &str) -> bool {
    path == Path::new(word)
}

/// The strands to animate, in millimetres of their own space; of a file that is to be aligned and states its way up, in the head
/// space of the first frame shown, so that the search for the way up begins with what the file says.
pub fn groom(
    args: &AnimateArgs,
    performance: &Performance,
    truth: Option<&Truth>,
    first: usize,
    is_aligned: bool,
) -> Result<Vec<Vec<DVec3>>, Failed> {
    if is(&args.groom, "captured") {
        return Ok(performance.strands("blend", first)?);
    }
    if is(&args.groom, "truth") {
        let lacking = || Failed::input("--groom truth", format!("give --truth DIR, with frame {first}"));
        let truth = truth.ok_or_else(lacking)?;
        let t = truth.at(first as u32).ok_or_else(lacking)?;
        let strand = |n: usize| truth.strand(t, n).iter().map(|p| p.as_dvec3()).collect();
        return Ok((0..truth.strand_count()).map(strand).collect());
    }
    let scale = args.scale.unwrap_or(1.0);
    if !(scale.is_finite() && scale > 0.0) {
        return Err(Failed::input(format!("--scale {scale}"), "give the millimetres of a unit: 10 for centimetres"));
    }
    let mut groom = of_file(&args.groom, scale)?;
    if is_aligned {
        if groom.unit_known {
            check_unit(&args.groom, &groom.strands, &performance.scalp()?.roots, scale)?;
        }
        if let Some(up) = groom.up_axis {
            stand_up(&mut groom.strands, up, performance.gravity(), &performance.pose(first)?);
        }
    }
    Ok(groom.strands)
}

/// Strands of a file and what it says of them.
#[derive(Debug)]
struct Given {
    strands: Vec<Vec<DVec3>>,
    unit_known: bool,
    up_axis: Option<Up>,
}

/// Strands of a file times `scale`: millimetres if the file states its unit and `scale` is 1, or `scale` is that of its unit.
fn of_file(file: &Path, scale: f64) -> Result<Given, Failed> {
    if !file.is_file() {
        let error = format!("{}: there is no such file", file.display());
        return Err(Failed::input(error, "give one file of strands (.hair, .data, .npz, .ply, .abc, .usda or .usdc)"));
    }
    let groom = read_groom(file)?;
    let strand = |points: &Vec<_>| points.iter().map(|p: &glam::Vec3| p.as_dvec3() * scale).collect();
    let strands = groom.strands.iter().map(strand).collect();
    Ok(Given { strands, unit_known: groom.unit_known, up_axis: groom.up_axis })
}

/// From a file whose `up` points up into the head space of a frame.
fn stand_up(strands: &mut [Vec<DVec3>], up: Up, gravity: DVec3, world_from_head: &RigidTransform) {
    let world_from_file = Space { up, ..Space::default() }.linear_from_world(Some(gravity)).inverse();
    let head_from_world = world_from_head.inverse();
    strands.iter_mut().flatten().for_each(|p| *p = head_from_world.point(world_from_file * *p));
}

/// Factors by which a file's stated unit may be wrong: units of one another.
const FACTORS: [f64; 8] = [0.001, 0.01, 1.0 / 25.4, 0.1, 10.0, 25.4, 100.0, 1000.0];

/// A file may state its unit and be wrong: scenes keep their default while grooms are modelled in another unit.
///
/// # Errors
/// The roots spread as those of no head, and a factor between units mends it; the hint has the factor.
fn check_unit(file: &Path, strands: &[Vec<DVec3>], captured: &[DVec3], scale: f64) -> Result<(), Failed> {
    let own: Vec<DVec3> = strands.iter().filter(|s| s.len() > 1).map(|s| s[0]).collect();
    let ratio = spread_ratio(&own, captured);
    let factor = FACTORS.into_iter().find(|factor| is_of_a_head(ratio * factor));
    match factor.filter(|_| !is_of_a_head(ratio)) {
        Some(factor) => {
            let factor = format!("{:.4}", factor * scale);
            let factor = factor.trim_end_matches('0').trim_end_matches('.');
            let fact =
                format!("in the unit of the file its roots spread over {ratio:.3} times as much as the captured ones");
            let hint = format!("it seems to be in another unit than it states: give --scale {factor}");
            Err(Failed::input(format!("{}: {fact}", file.display()), hint))
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, Vec3};
    use strandflow_core::{Provenance, StrandSequence};
    use strandflow_io::{Carrier, SceneOptions, Target, write_alembic, write_usd};

    use super::*;

    fn strand() -> StrandSequence {
        let mut sequence = StrandSequence::missing(vec![0], vec![2], 2);
        sequence.points = vec![Vec3::ZERO, Vec3::new(0.0, 0.0, 20.0)];
        sequence.provenance = vec![Provenance::Observed; 2];
        sequence
    }

    #[test]
    fn grooms_arrive_in_millimetres_times_the_scale() {
        let dir = tempfile::tempdir().unwrap();
        let (usd, abc) = (dir.path().join("a.usdc"), dir.path().join("a.abc"));
        let options = |carrier| SceneOptions { space: Target::Unreal.space(carrier), ..SceneOptions::default() };
        write_usd(&usd, &strand(), &options(Carrier::Usd)).unwrap();
        write_alembic(&abc, &strand(), None, &options(Carrier::Alembic)).unwrap();
        // Both hold centimetres; only USD says so.
        for (file, scale, expected) in [(&usd, 1.0, 20.0), (&usd, 2.0, 40.0), (&abc, 1.0, 2.0), (&abc, 10.0, 20.0)] {
            let given = of_file(file, scale).unwrap();
            assert!((given.strands[0][1].z - expected).abs() < 1e-4, "{} {scale}: {given:?}", file.display());
        }
        let told = of_file(dir.path(), 1.0).unwrap_err();
        assert!(told.input && told.error.contains("no such file") && told.hint.contains(".abc"));
    }

    /// A strand that rises 20 mm against gravity (here −x) in the world, and a head that is turned and elsewhere.
    #[test]
    fn a_stated_way_up_leads_into_the_head_s_space() {
        let dir = tempfile::tempdir().unwrap();
        let (gravity, file) = (DVec3::X * 9810.0, dir.path().join("a.usdc"));
        let mut sequence = strand();
        sequence.points[1] = Vec3::new(-20.0, 0.0, 0.0);
        let rotation = DMat3::from_rotation_z(0.3) * DMat3::from_rotation_x(-0.4);
        let pose = RigidTransform { rotation, translation: DVec3::new(5.0, 900.0, -3.0) };
        for target in [Target::Houdini, Target::Blender] {
            let space = target.space(Carrier::Usd);
            let options = SceneOptions { gravity: Some(gravity), space, ..SceneOptions::default() };
            write_usd(&file, &sequence, &options).unwrap();
            let mut given = of_file(&file, 1.0).unwrap();
            stand_up(&mut given.strands, given.up_axis.unwrap(), gravity, &pose);
            let expected = pose.inverse().point(DVec3::new(-20.0, 0.0, 0.0));
            assert!(given.strands[0][1].distance(expected) < 1e-4, "{target:?}: {given:?}");
        }
    }

    #[test]
    fn an_absurd_stated_unit_is_told_with_the_factor() {
        let captured: Vec<DVec3> = (0..40).map(|n| DVec3::new(f64::from(n % 7) * 20.0, f64::from(n), 3.0)).collect();
        let of = |factor: f64| -> Vec<Vec<DVec3>> {
            captured.iter().map(|p| vec![*p * factor, *p * factor + DVec3::Z]).collect()
        };
        let said = |factor, scale| check_unit(Path::new("a.usdc"), &of(factor), &captured, scale);
        assert!(said(1.1, 1.0).is_ok() && said(0.7, 1.0).is_ok());
        let error = said(100.0, 1.0).unwrap_err();
        assert!(error.error.starts_with("a.usdc: ") && error.hint.ends_with("--scale 0.01"), "{error:?}");
        assert!(said(0.1, 5.0).unwrap_err().hint.ends_with("--scale 50"));
    }
}
