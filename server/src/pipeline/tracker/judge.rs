//! Decides whether a pose is believed, by what it leaves unexplained.
//!
//! In: the quality of an alignment. Out: convincing, believable, or neither. At a wrong pose many pixels
//! contradict the reference; how many do so at a right one depends on the sensor. So the judge compares with
//! the share that the last tracked frames left unexplained.

use super::config::TrackerConfig;
use super::quality::AlignmentQuality;
use serde::{Deserialize, Serialize};

/// Unexplained share that is expected before any frame was tracked.
const FIRST_USUAL: f64 = 0.04;
/// The usual share is never taken to be more than this, so that wrong poses cannot raise it far.
const MOST_USUAL: f64 = 0.09;
/// Least weight of a new frame in the usual share; the first frames weigh more.
const LEARNING: f64 = 0.02;
/// After so many frames the usual share is known.
const KNOWN: u32 = 5;

/// Knows how much tracked frames usually leave unexplained.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct Judge {
    usual: f64,
    /// Tracked frames, and one for the expectation before them.
    count: u32,
}

impl Default for Judge {
    fn default() -> Self {
        Self { usual: FIRST_USUAL, count: 1 }
    }
}

impl Judge {
    /// Whether a pose is hardly in doubt.
    pub fn is_convincing(&self, quality: &AlignmentQuality, config: &TrackerConfig) -> bool {
        let allowed = (config.convincing_factor * self.usual).max(config.convincing_disagreement);
        1.0 - quality.agreement <= allowed
    }

    /// Whether no other start needs to be tried. As long as the sensor is not known, that takes more.
    pub fn ends_search(&self, quality: &AlignmentQuality, config: &TrackerConfig) -> bool {
        let is_known = self.count > KNOWN;
        self.is_convincing(quality, config)
            && (is_known || 1.0 - quality.agreement <= config.convincing_disagreement)
    }

    /// Whether the best of all starts may be the pose.
    pub fn is_believable(&self, quality: &AlignmentQuality, config: &TrackerConfig) -> bool {
        let allowed = (config.max_factor * self.usual).max(config.max_disagreement);
        1.0 - quality.agreement <= allowed
    }

    /// Adds a tracked frame.
    pub fn learn(&mut self, quality: &AlignmentQuality) {
        let unexplained = (1.0 - quality.agreement).min(MOST_USUAL);
        self.count = self.count.saturating_add(1);
        let weight = LEARNING.max(1.0 / f64::from(self.count));
        self.usual += weight * (unexplained - self.usual);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quality(agreement: f64) -> AlignmentQuality {
        AlignmentQuality { agreement, ..AlignmentQuality::PERFECT }
    }

    #[test]
    fn what_is_believed_follows_the_sensor() {
        let config = TrackerConfig::default();
        let believed = |judge: &Judge, agreement| judge.is_believable(&quality(agreement), &config);
        let mut exact = Judge::default();
        assert!(believed(&exact, 0.85), "nothing is known of the sensor yet");
        (0..40).for_each(|_| exact.learn(&quality(0.995)));
        assert!(!believed(&exact, 0.85) && believed(&exact, 0.97));
        let mut noisy = Judge::default();
        (0..40).for_each(|_| noisy.learn(&quality(0.92)));
        assert!(believed(&noisy, 0.85) && !believed(&noisy, 0.6));
        (0..400).for_each(|_| noisy.learn(&quality(0.3)));
        assert!(!believed(&noisy, 0.6), "wrong poses do not make worse ones believable");
        assert!(!believed(&Judge::default(), f64::NAN));
    }

    #[test]
    fn at_first_only_little_may_be_unexplained_without_another_start() {
        let config = TrackerConfig::default();
        let convinced =
            |judge: &Judge, agreement: f64| judge.ends_search(&quality(agreement), &config);
        let mut judge = Judge::default();
        assert!(convinced(&judge, 0.98) && !convinced(&judge, 0.95));
        (0..KNOWN).for_each(|_| judge.learn(&quality(0.95)));
        assert!(convinced(&judge, 0.95), "that is what the sensor usually leaves");
        // Wrong poses that become worse step by step do not make each other believable.
        let mut judge = Judge::default();
        (0..40).for_each(|_| judge.learn(&quality(0.999)));
        let is_believed = |step: &i32| {
            let quality = quality(0.99 - 0.01 * f64::from(*step));
            judge.learn(&quality);
            judge.is_believable(&quality, &config)
        };
        assert!((0..30).take_while(is_believed).count() < 10);
    }
}
