//! From relevancies to the confidence that the map contains what was asked for.
//!
//! The score of an answer is the k-th largest relevancy, with k the number of pixels of the
//! smallest component or of Gaussians of the smallest object: fewer are noise. A logistic curve
//! (Platt scaling) turns it into the confidence 1 / (1 + exp(-s (score - p))). p and s are
//! `present_threshold` and `confidence_steepness` of the bundle's manifest. If they were fitted
//! (`lexsplat evaluate --language` prints the fit), the confidence is the probability that the
//! answer is right; if not, it only orders answers. The threshold of the query has no influence, so
//! that confidences of different answers are comparable.

/// Steepness of bundles without one: a score 0.1 above the midpoint has a confidence of 0.88.
const DEFAULT_STEEPNESS: f32 = 20.0;

/// The logistic curve from score to confidence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Calibration {
    /// The score with a confidence of one half.
    midpoint: f32,
    steepness: f32,
}

impl Calibration {
    /// `steepness` is greater than 0; `None`: a default.
    pub(crate) fn new(midpoint: f32, steepness: Option<f32>) -> Self {
        Self { midpoint, steepness: steepness.unwrap_or(DEFAULT_STEEPNESS) }
    }

    /// Confidence, 0..1, from the `least`-th largest relevancy; 0 if there are fewer. Relevancies
    /// of 0 mean "no language" and do not count.
    pub(crate) fn confidence(&self, relevancies: impl Iterator<Item = f32>, least: usize) -> f32 {
        let mut scores: Vec<f32> = relevancies.filter(|score| *score > 0.0).collect();
        if scores.len() < least || least == 0 {
            return 0.0;
        }
        let (_, score, _) = scores.select_nth_unstable_by(least - 1, |a, b| b.total_cmp(a));
        1.0 / (1.0 + (self.steepness * (self.midpoint - *score)).exp())
    }
}

/// Whether a confidence means that the map contains what was asked for.
pub(crate) fn is_present(confidence: f32) -> bool {
    confidence >= 0.5
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn confidence_is_one_half_at_the_midpoint_and_grows_with_the_steepness() {
        let calibration = Calibration::new(0.6, None);
        let one =
            |calibration: Calibration, score: f32| calibration.confidence([score].into_iter(), 1);
        assert!(is_present(one(calibration, 0.61)) && !is_present(one(calibration, 0.59)));
        assert!((one(calibration, 0.7) - 0.88).abs() < 0.01);
        let steeper = Calibration::new(0.6, Some(100.0));
        assert!(one(steeper, 0.7) > 0.999 && one(steeper, 0.5) < 0.001);
        assert_eq!(one(steeper, 0.6), 0.5);
    }

    #[test]
    fn few_relevancies_are_noise_and_zeros_do_not_count() {
        let calibration = Calibration::new(0.6, None);
        let scores = [0.2, 0.99, 0.7, 0.1, 0.7, 0.0];
        let least = |count| calibration.confidence(scores.into_iter(), count);
        assert!(least(1) > 0.99);
        assert!((least(3) - 0.88).abs() < 0.01, "three are at least 0.7");
        assert!(!is_present(least(4)) && least(5) > 0.0);
        assert_eq!((least(6), calibration.confidence([0.0; 9].into_iter(), 2)), (0.0, 0.0));
    }
}
