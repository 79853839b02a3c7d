//! Is what was asked for there? From relevancies to a confidence.
//!
//! The score is what as many pixels as the smallest region has, or as many Gaussians as the smallest
//! object has, reach: a lone one is noise. confidence = 1 / (1 + exp(-s (score - p))), with p and s of
//! the bundle's manifest (`present_threshold`, `confidence_steepness`): there if it is at least one
//! half. The query's threshold has no say, so that a confidence means the same in every answer. Where
//! the bundle's author fitted p and s (`lexsplat evaluate --language` prints the fit) it is how often
//! such an answer is right; without, it orders answers.

/// Of bundles that do not say: 0.1 above the threshold is 0.88.
const DEFAULT_STEEPNESS: f32 = 20.0;

/// From where on, and how fast, a score means that something is there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Presence {
    threshold: f32,
    steepness: f32,
}

impl Presence {
    /// One half at `threshold`; `steepness` is the bundle's, above 0, if it has one.
    pub(super) fn new(threshold: f32, steepness: Option<f32>) -> Self {
        Self { threshold, steepness: steepness.unwrap_or(DEFAULT_STEEPNESS) }
    }

    /// How sure it is that what was asked for is there, 0..1, if `least` relevancies are enough to say
    /// so; 0 where there are fewer. A relevancy of 0 is a place without language.
    pub(super) fn confidence(&self, relevancies: impl Iterator<Item = f32>, least: usize) -> f32 {
        let mut scores: Vec<f32> = relevancies.filter(|score| *score > 0.0).collect();
        if scores.len() < least || least == 0 {
            return 0.0;
        }
        let (_, score, _) = scores.select_nth_unstable_by(least - 1, |a, b| b.total_cmp(a));
        1.0 / (1.0 + (self.steepness * (self.threshold - *score)).exp())
    }
}

/// Whether a confidence says that it is there.
pub(super) fn is_present(confidence: f32) -> bool {
    confidence >= 0.5
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_threshold_decides_and_the_steepness_says_how_fast() {
        let presence = Presence::new(0.6, None);
        let one = |presence: Presence, score: f32| presence.confidence([score].into_iter(), 1);
        assert!(is_present(one(presence, 0.61)) && !is_present(one(presence, 0.59)));
        assert!((one(presence, 0.7) - 0.88).abs() < 0.01);
        let steeper = Presence::new(0.6, Some(100.0));
        assert!(one(steeper, 0.7) > 0.999 && one(steeper, 0.5) < 0.001);
        assert_eq!(one(steeper, 0.6), 0.5);
    }

    #[test]
    fn a_lone_peak_is_noise_and_no_language_is_nothing() {
        let presence = Presence::new(0.6, None);
        let scores = [0.2, 0.99, 0.7, 0.1, 0.7, 0.0];
        let least = |count| presence.confidence(scores.into_iter(), count);
        assert!(least(1) > 0.99);
        assert!((least(3) - 0.88).abs() < 0.01, "three reach 0.7");
        assert!(!is_present(least(4)) && least(5) > 0.0);
        assert_eq!((least(6), presence.confidence([0.0; 9].into_iter(), 2)), (0.0, 0.0));
    }
}
