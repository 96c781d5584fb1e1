//! Metrics, comparisons and report figures.
