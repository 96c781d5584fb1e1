//! Axes of plots: where a value lies, and which values are written beside it.

/// One axis of a plot. Its ends are finite and differ.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    label: String,
    low: f64,
    high: f64,
    logarithmic: bool,
}

/// Numbers beside an axis: more run into each other on a phone.
const TICKS: f64 = 5.0;
/// Decades of a logarithmic axis below the largest value: what is a million times smaller is as good as nothing.
const DECADES: f64 = 6.0;

impl Axis {
    /// From `low` to `high` exactly; a range without extent is widened around its middle.
    pub fn exact(label: impl Into<String>, low: f64, high: f64) -> Self {
        let usable = low.is_finite() && high.is_finite();
        let (low, high) = if usable { (low.min(high), low.max(high)) } else { (0.0, 1.0) };
        let half = if high > low { 0.0 } else { 0.5 * low.abs().max(1.0) };
        Self { label: label.into(), low: low - half, high: high + half, logarithmic: false }
    }

    /// From zero to a round number above the finite values.
    pub fn from_zero(label: impl Into<String>, values: impl IntoIterator<Item = f64>) -> Self {
        let most = values.into_iter().filter(|v| v.is_finite()).fold(0.0, f64::max);
        let most = if most > 0.0 { most } else { 1.0 };
        let step = round_step(most / TICKS);
        Self::exact(label, 0.0, (most / step).ceil() * step)
    }

    /// Logarithmic over the positive finite values, at most six decades below the largest.
    pub fn logarithmic(label: impl Into<String>, values: impl IntoIterator<Item = f64>) -> Self {
        let usable = values.into_iter().filter(|v| v.is_finite() && *v > 0.0);
        let (low, high) = usable.fold((f64::INFINITY, 0.0_f64), |(low, high), v| (low.min(v), high.max(v)));
        let (low, high) = if high > 0.0 { (low, high) } else { (0.1, 1.0) };
        let high = high.log10().ceil();
        let low = low.log10().floor().max(high - DECADES).min(high - 1.0);
        Self { label: label.into(), low: 10f64.powf(low), high: 10f64.powf(high), logarithmic: true }
    }

    /// Logarithmic from `low` to `high` exactly; both positive, `low` below `high`, or else one decade.
    pub fn logarithmic_exact(label: impl Into<String>, low: f64, high: f64) -> Self {
        let usable = low > 0.0 && high > low && high.is_finite();
        let (low, high) = if usable { (low, high) } else { (1.0, 10.0) };
        Self { label: label.into(), low, high, logarithmic: true }
    }

    /// What is measured, with its unit.
    pub fn label(&self) -> &str {
        &self.label
    }

    /// The end with the smallest value.
    pub fn low(&self) -> f64 {
        self.low
    }

    /// Where a value lies, 0 at the low end and 1 at the high end, kept within them; `None` where it has no place.
    pub fn place(&self, value: f64) -> Option<f64> {
        let (value, low, high) = if self.logarithmic {
            (value.log10(), self.low.log10(), self.high.log10())
        } else {
            (value, self.low, self.high)
        };
        let at = (value - low) / (high - low);
        // The logarithm of zero lies below every axis.
        if at.is_nan() { None } else { Some(at.clamp(0.0, 1.0)) }
    }

    /// Round values within the axis, with their text.
    pub fn ticks(&self) -> Vec<(f64, String)> {
        if self.logarithmic { self.decades() } else { self.round_values() }
    }

    fn round_values(&self) -> Vec<(f64, String)> {
        let step = round_step((self.high - self.low) / TICKS);
        let decimals = (-step.log10()).ceil().clamp(0.0, 9.0) as usize;
        let (first, last) = ((self.low / step - 1e-9).ceil() as i64, (self.high / step + 1e-9).floor() as i64);
        (first..=last).map(|i| i as f64 * step).map(|value| (value, format!("{value:.decimals$}"))).collect()
    }

    fn decades(&self) -> Vec<(f64, String)> {
        let (first, last) = ((self.low.log10() - 1e-9).ceil() as i32, (self.high.log10() + 1e-9).floor() as i32);
        let every = 1 + (last - first).max(0) / (DECADES as i32 + 1);
        let tick = |power: i32| (10f64.powi(power), power_of_ten(power));
        (first..=last).step_by(every as usize).map(tick).collect()
    }
}

/// The least of 1, 2, 5 times a power of ten that is not below `least`.
fn round_step(least: f64) -> f64 {
    let power = 10f64.powf(least.max(1e-12).log10().floor());
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|step| *step >= least * (1.0 - 1e-9)).unwrap_or(power)
}

/// A power of ten as people write it.
pub fn power_of_ten(power: i32) -> String {
    match power {
        0 => "1".into(),
        1 => "10".into(),
        2 => "100".into(),
        _ => format!("10{}", power.to_string().chars().map(raised).collect::<String>()),
    }
}

fn raised(c: char) -> char {
    match c {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        '0' | '4'..='9' => char::from_u32(u32::from('⁰') + c as u32 - u32::from('0')).unwrap_or(c),
        _ => c,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(axis: &Axis) -> Vec<String> {
        axis.ticks().into_iter().map(|(_, text)| text).collect()
    }

    #[test]
    fn ticks_are_round_and_within() {
        assert_eq!(texts(&Axis::from_zero("x", [0.0, 29.0])), ["0", "10", "20", "30"]);
        assert_eq!(texts(&Axis::exact("x", 0.0, 1.0)), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(texts(&Axis::logarithmic("x", [0.002, 30.0])), ["10⁻³", "10⁻²", "10⁻¹", "1", "10", "100"]);
        assert_eq!(texts(&Axis::logarithmic("x", [1e-30, 1e-12])).len(), 7);
    }

    #[test]
    fn what_has_no_place_has_none() {
        let log = Axis::logarithmic("x", [1.0, 100.0]);
        assert_eq!([10.0, 0.0, 1e9].map(|v| log.place(v)), [Some(0.5), Some(0.0), Some(1.0)]);
        assert_eq!([f64::NAN, -1.0].map(|v| log.place(v)), [None, None]);
        for empty in [Axis::from_zero("x", []), Axis::logarithmic("x", [f64::NAN, -1.0]), Axis::exact("x", 3.0, 3.0)] {
            assert!(empty.place(3.0).is_some() && empty.ticks().len() > 1, "{empty:?}");
        }
    }
}
