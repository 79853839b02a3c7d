//! From relevancies to the confidence that the map contains what was asked for.
//!
//! A pixel or a Gaussian shows what was asked for with the probability
//! 1 / (1 + exp(-s (relevancy - p) r / spread)), a logistic curve (Platt scaling) that is the flatter the
//! further the codes of keyframes spread there. s and p are `confidence_steepness` and `present_threshold`
//! of the bundle's manifest; they are fitted in rooms with the spread r (`lexsplat evaluate --language`
//! prints the fit). Without the spread, one curve cannot serve rendered and real rooms: in the latter
//! relevancies are as large and much less reliable.
//!
//! The confidence of an answer is the k-th largest probability, with k the number of pixels of the smallest
//! component or of Gaussians of the smallest object: fewer are noise. The uncertainty of a pixel is the
//! probability that its part of the mask is wrong.

use crate::pipeline::evidence::REFERENCE_SPREAD;

/// Steepness of bundles without one: a score 0.1 above the midpoint has a confidence of 0.88.
const DEFAULT_STEEPNESS: f32 = 20.0;

/// A relevancy, 0..1, and the spread of the codes that it was computed from, greater than 0. A relevancy of 0
/// means "no language".
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Evidenced {
    pub relevancy: f32,
    pub spread: f32,
}

/// The logistic curve from relevancy to probability.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Calibration {
    /// The relevancy with a probability of one half.
    midpoint: f32,
    steepness: f32,
}

impl Calibration {
    /// `steepness` is greater than 0; `None`: a default.
    pub(crate) fn new(midpoint: f32, steepness: Option<f32>) -> Self {
        Self { midpoint, steepness: steepness.unwrap_or(DEFAULT_STEEPNESS) }
    }

    /// Logit of the probability that a place shows what was asked for.
    fn logit(&self, at: Evidenced) -> f32 {
        self.steepness * (at.relevancy - self.midpoint) * REFERENCE_SPREAD / at.spread
    }

    /// Confidence, 0..1: the `least`-th largest probability of places with language; 0 if there are fewer.
    pub(crate) fn confidence(&self, places: impl Iterator<Item = Evidenced>, least: usize) -> f32 {
        let known = places.filter(|place| place.relevancy > 0.0);
        let mut logits: Vec<f32> = known.map(|place| self.logit(place)).collect();
        if logits.len() < least || least == 0 {
            return 0.0;
        }
        probability(*logits.select_nth_unstable_by(least - 1, |a, b| b.total_cmp(a)).1)
    }

    /// Probability, 0..1, that a place is on the wrong side of the threshold; 0 without language.
    pub(crate) fn uncertainty(&self, at: Evidenced, threshold: f32) -> f32 {
        let probability = probability(self.logit(at));
        match at.relevancy {
            0.0 => 0.0,
            found if found > threshold => 1.0 - probability,
            _ => probability,
        }
    }
}

fn probability(logit: f32) -> f32 {
    1.0 / (1.0 + (-logit).exp())
}

/// Whether a confidence means that the map contains what was asked for.
pub(crate) fn is_present(confidence: f32) -> bool {
    confidence >= 0.5
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(relevancy: f32) -> Evidenced {
        Evidenced { relevancy, spread: REFERENCE_SPREAD }
    }

    #[test]
    fn confidence_is_one_half_at_the_midpoint_and_grows_with_the_steepness() {
        let calibration = Calibration::new(0.6, None);
        let one =
            |calibration: Calibration, score| calibration.confidence([at(score)].into_iter(), 1);
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
        let least = |count| calibration.confidence(scores.map(at).into_iter(), count);
        assert!(least(1) > 0.99);
        assert!((least(3) - 0.88).abs() < 0.01, "three are at least 0.7");
        assert!(!is_present(least(4)) && least(5) > 0.0);
        assert_eq!((least(6), calibration.confidence([at(0.0); 9].into_iter(), 2)), (0.0, 0.0));
    }

    #[test]
    fn a_wide_spread_draws_probabilities_to_one_half_and_does_not_change_sides() {
        let calibration = Calibration::new(0.6, None);
        let probability = |relevancy, spread| {
            super::probability(calibration.logit(Evidenced { relevancy, spread }))
        };
        let [sure, usual, unsure] = [0.1, 0.2, 0.8].map(|spread| probability(0.7, spread));
        assert!(sure > usual && usual > unsure && unsure > 0.5, "{sure} {usual} {unsure}");
        let [sure, unsure] = [0.1, 0.8].map(|spread| probability(0.5, spread));
        assert!(sure < unsure && unsure < 0.5, "{sure} {unsure}");
        // By hand: 20 * 0.1 * 0.2 / 0.8 = 0.5.
        assert!((probability(0.7, 0.8) - 1.0 / (1.0 + (-0.5_f32).exp())).abs() < 1e-6);
    }

    #[test]
    fn uncertainty_is_the_probability_of_the_other_side() {
        let calibration = Calibration::new(0.6, None);
        let uncertainty = |relevancy| calibration.uncertainty(at(relevancy), 0.5);
        assert!((uncertainty(0.7) - 0.12).abs() < 0.01, "found, and rather likely there");
        assert!((uncertainty(0.4) - 0.018).abs() < 0.001, "not found, and unlikely there");
        assert!(uncertainty(0.55) > 0.5, "found, though more likely not there");
        assert_eq!(uncertainty(0.0), 0.0);
    }
}
