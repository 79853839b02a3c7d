//! Is what was asked for there? From the best score to a confidence.
//!
//! confidence = 1 / (1 + exp(-s (score - p))), p the bundle's `present_threshold`, s =
//! [`STEEPNESS`]; there if it is at least one half, 0 if nothing was above the query's threshold.
//! The steepness is chosen, not fitted: a confidence orders answers and is no calibrated
//! probability.

/// How fast confidence grows with the score: 0.1 above the threshold is 0.88.
const STEEPNESS: f32 = 20.0;

/// How sure it is that what was asked for is there, 0..1. `best`: the score of the best region or
/// object, if any.
pub(super) fn confidence(best: Option<f32>, present_threshold: f32) -> f32 {
    best.map_or(0.0, |score| 1.0 / (1.0 + (STEEPNESS * (present_threshold - score)).exp()))
}

/// Whether a confidence says that it is there.
pub(super) fn is_present(confidence: f32) -> bool {
    confidence >= 0.5
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_threshold_decides() {
        assert!(is_present(confidence(Some(0.61), 0.6)));
        assert!(!is_present(confidence(Some(0.59), 0.6)));
        assert!(!is_present(confidence(None, 0.0)));
        assert!((confidence(Some(0.7), 0.6) - 0.88).abs() < 0.01);
    }
}
