//! Percentiles of latencies.

use serde::Serialize;
use std::time::Duration;

/// Percentiles in milliseconds; all 0 without measurements.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Latencies {
    /// Number of measurements.
    pub count: usize,
    /// Median.
    pub p50: f64,
    /// 90th percentile.
    pub p90: f64,
    /// 99th percentile.
    pub p99: f64,
    /// Maximum.
    pub max: f64,
}

impl Latencies {
    /// Exact percentiles (nearest rank).
    pub fn of(mut all: Vec<Duration>) -> Self {
        all.sort_unstable();
        let Some(max) = all.last() else { return Self::default() };
        let rank = |share: f64| (share * all.len() as f64).ceil().max(1.0) as usize - 1;
        let [p50, p90, p99] = [0.5, 0.9, 0.99].map(|share| millis(all[rank(share)]));
        Self { count: all.len(), p50, p90, p99, max: millis(*max) }
    }
}

fn millis(duration: Duration) -> f64 {
    duration.as_secs_f64() * 1e3
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_nearest_ranks() {
        let all = (1..=200).rev().map(Duration::from_millis).collect();
        let found = Latencies::of(all);
        assert_eq!(found, Latencies { count: 200, p50: 100.0, p90: 180.0, p99: 198.0, max: 200.0 });
        let one = Latencies::of(vec![Duration::from_millis(7)]);
        assert_eq!((one.p50, one.p99, one.max), (7.0, 7.0, 7.0));
        assert_eq!(Latencies::of(Vec::new()), Latencies::default());
    }
}
