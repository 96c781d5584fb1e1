//! Summaries of many numbers.

use serde::{Deserialize, Serialize};

/// What a list of numbers looks like. All zero where the list is empty.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// How many.
    pub count: usize,
    /// Arithmetic mean.
    pub mean: f64,
    /// Median.
    pub median: f64,
    /// 95 % quantile.
    pub p95: f64,
    /// Smallest.
    pub min: f64,
    /// Largest.
    pub max: f64,
}

impl Summary {
    /// Of finite numbers; others are left out.
    pub fn of(numbers: impl IntoIterator<Item = f64>) -> Self {
        let mut sorted: Vec<f64> = numbers.into_iter().filter(|x| x.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        let count = sorted.len();
        if count == 0 {
            return Self::default();
        }
        let at = |q: f64| sorted[((count - 1) as f64 * q).round() as usize];
        let mean = sorted.iter().sum::<f64>() / count as f64;
        Self { count, mean, median: at(0.5), p95: at(0.95), min: sorted[0], max: sorted[count - 1] }
    }
}

/// Standard deviation over mean of positive numbers; `None` of fewer than three.
pub fn variation(numbers: &[f64]) -> Option<f64> {
    let count = numbers.len() as f64;
    let mean = numbers.iter().sum::<f64>() / count;
    let variance = numbers.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / count;
    (numbers.len() >= 3 && mean > 0.0).then(|| variance.sqrt() / mean)
}

/// Root of the mean square; 0 of nothing.
pub fn root_mean_square(numbers: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, count) = numbers.into_iter().fold((0.0, 0usize), |(s, n), x| (s + x * x, n + 1));
    if count == 0 { 0.0 } else { (sum / count as f64).sqrt() }
}

/// `part / whole`, 0 where there is no whole.
pub fn share(part: usize, whole: usize) -> f64 {
    if whole == 0 { 0.0 } else { part as f64 / whole as f64 }
}

/// At most `most` of 0..len, evenly spaced, first and last included; the same for the same arguments.
pub fn evenly(len: usize, most: usize) -> Vec<usize> {
    if len <= most || most < 2 {
        return (0..len.min(most)).collect();
    }
    (0..most).map(|i| i * (len - 1) / (most - 1)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_has_the_known_summary() {
        let s = Summary::of((0..=100).rev().map(f64::from).chain([f64::NAN]));
        assert_eq!((s.count, s.mean, s.median, s.p95, s.min, s.max), (101, 50.0, 50.0, 95.0, 0.0, 100.0));
        assert_eq!(Summary::of([]).count, 0);
        assert!((root_mean_square([3.0, 4.0]) - 12.5f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn even_choices_hold_the_ends() {
        assert_eq!(evenly(3, 10), [0, 1, 2]);
        assert_eq!(evenly(30, 4), [0, 9, 19, 29]);
        assert_eq!(evenly(5, 1), [0]);
        assert!(evenly(0, 4).is_empty());
    }
}
