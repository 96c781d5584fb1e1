//! What `fit` found of each strand, in SI units, for other simulators.

use std::fmt::Write;

use strandflow_dynamics::refine::{EXCITED_BELOW, MOVED};
use strandflow_engine::{EngineError, Take};

/// What is to be known before the numbers are used; `docs/dynamics.md` says more.
const CAVEATS: &str = "\
# Springs between particles 1 (edge), 2 (bend) and 3 (torsion) apart, altitude springs in each tetrahedron of four, dampers beside
# the springs, and drag relative to still air. SI units, per unit mass: multiply k [1/s^2] and c [1/s] by the mass of a particle [kg]
# for N/m and N s/m. A human hair of 70 um has 5.1e-6 kg a metre.
# This is a material that moves like the strand in this model, not the hair's own: bend, torsion and altitude exchange for one
# another; edge and the damping time c/k say nothing and stay where they start; another model of springs needs a fit of its own.
# sd_ln: standard deviation of the logarithm by the noise of the samples alone. Where it is above 0.69 (a factor of two) the motion
# does not tell the parameter; excited names the others, which may still err by more, as the model and the rest shape do.
# held_out_m: error on frames that the fit had not seen; kept_m: that of velocities kept.
";

const COLUMNS: &str = "strand,particles,spacing_m,k_edge,k_bend,k_torsion,k_alt,c_edge,c_bend,c_torsion,c_alt,drag,sd_ln_k_bend,\
                       sd_ln_k_torsion,sd_ln_k_alt,sd_ln_drag,excited,residual_m,held_out_m,kept_m,windows,windows_failed";

const METRES: f64 = 1e-3;

/// A row for each strand that was fitted; what is not known is left empty.
///
/// # Errors
/// `Store`.
pub fn csv(take: &Take) -> Result<String, EngineError> {
    let store = take.store();
    let read = |path: &str| store.read_all::<f32>(path);
    let counts: Vec<u16> = store.read_all("fit/counts")?;
    let windows: Vec<u16> = store.read_all("fit/windows")?;
    let (parameters, covariance) = (read("fit/parameters")?, read("fit/covariance")?);
    let (residual, held_out) = (read("fit/residual_mm")?, read("fit/held_out_mm")?);
    let spacing = take.last_plan()?.settings.fit.edge_mm * METRES;
    let mut out = format!("{CAVEATS}{COLUMNS}\n");
    for n in (0..counts.len()).filter(|&n| counts[n] > 0) {
        let mut cell = Cells { out: &mut out, is_first: true };
        cell.add(n);
        cell.add(counts[n]);
        cell.number(spacing);
        parameters[9 * n..9 * n + 9].iter().for_each(|&p| cell.number(p.into()));
        let deviations = [0, 1, 2, 3].map(|k| f64::from(covariance[16 * n + 5 * k]).sqrt());
        deviations.iter().for_each(|&d| cell.number(d));
        let told = MOVED.iter().zip(deviations).filter(|(_, d)| *d < EXCITED_BELOW);
        cell.add(told.map(|(name, _)| *name).collect::<Vec<_>>().join(" "));
        cell.number(f64::from(residual[n]) * METRES);
        held_out[2 * n..2 * n + 2].iter().for_each(|&d| cell.number(f64::from(d) * METRES));
        cell.add(windows[3 * n..3 * n + 3].iter().map(|&w| u32::from(w)).sum::<u32>());
        cell.add(windows[3 * n + 2]);
        out.push('\n');
    }
    Ok(out)
}

/// Cells of a row.
struct Cells<'a> {
    out: &'a mut String,
    is_first: bool,
}

impl Cells<'_> {
    fn add(&mut self, value: impl std::fmt::Display) {
        let comma = if std::mem::take(&mut self.is_first) { "" } else { "," };
        // Writing to a string does not fail.
        let _ = write!(self.out, "{comma}{value}");
    }

    /// Five digits; nothing for what is not finite.
    fn number(&mut self, value: f64) {
        if value.is_finite() { self.add(format_args!("{value:.4e}")) } else { self.add("") }
    }
}
