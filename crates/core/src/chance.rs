//! Numbers by chance.

/// A number of the standard normal distribution, of two that are even in 0..1.
///
/// Reference: Box & Muller 1958.
pub fn normal_from_even(a: f64, b: f64) -> f64 {
    // From 1 down, because an even number may be 0 and is never 1.
    (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_and_variance_are_those_of_the_standard() {
        let side = 200;
        let even = |k: usize| (k as f64 + 0.5) / side as f64;
        let all: Vec<f64> = (0..side * side).map(|n| normal_from_even(even(n / side), even(n % side))).collect();
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        let variance = all.iter().map(|x| x * x).sum::<f64>() / all.len() as f64;
        assert!(mean.abs() < 1e-9 && (variance - 1.0).abs() < 0.01, "{mean} {variance}");
        assert!(normal_from_even(0.0, 0.0).is_finite());
    }
}
