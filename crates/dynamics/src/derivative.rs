//! The one checker that every derivative of the house goes through.

/// How far an analytic gradient is from central differences.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DerivativeError {
    /// Median over the entries of the error relative to the gradient's largest entry.
    pub median: f64,
    /// The largest such error.
    pub max: f64,
}

/// Compares a gradient with central differences of `value` at `x`, with the step `step` · (1 + |xᵢ|).
///
/// For positive parameters pass their logarithms, so that the step is relative.
pub fn check_derivative(
    x: &[f64],
    gradient: &[f64],
    step: f64,
    mut value: impl FnMut(&[f64]) -> f64,
) -> DerivativeError {
    let mut y = x.to_vec();
    let difference: Vec<f64> = (0..x.len())
        .map(|i| {
            let h = step * (1.0 + x[i].abs());
            y[i] = x[i] + h;
            let above = value(&y);
            y[i] = x[i] - h;
            let below = value(&y);
            y[i] = x[i];
            (above - below) / (2.0 * h)
        })
        .collect();
    let scale = gradient.iter().chain(&difference).fold(1e-300f64, |m, g| m.max(g.abs()));
    let mut errors: Vec<f64> = gradient.iter().zip(&difference).map(|(a, b)| (a - b).abs() / scale).collect();
    errors.sort_by(f64::total_cmp);
    DerivativeError {
        median: errors.get(errors.len() / 2).copied().unwrap_or(0.0),
        max: errors.last().copied().unwrap_or(0.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_right_gradient_passes_and_a_wrong_one_does_not() {
        let f = |x: &[f64]| x[0].sin() * x[1].exp();
        let x = [0.4f64, -0.3];
        let right = [x[0].cos() * x[1].exp(), f(&x)];
        assert!(check_derivative(&x, &right, 1e-5, f).max < 1e-9);
        assert!(check_derivative(&x, &[right[0] * 1.001, right[1]], 1e-5, f).max > 1e-4);
    }
}
